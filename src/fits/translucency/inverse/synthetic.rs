//! Photographs of known tissues, for tests and the stress table. A blade with relief and a vein is lit from a few
//! directions; the photographs are made by the convolver that renders, with more thickness levels and longer kernels
//! than a fit uses, and with seeded Gaussian noise.

use super::{ThicknessErrors, TissueChannel, TissueCoefficients, TissueImage, TissueMeasurement, TissueNoise};
use crate::translucency::Result;
use mesophyll_base::random::RandomStream;
use mesophyll_optics::dipole::Tissue;
use mesophyll_optics::side::{Side, mirror};
use mesophyll_optics::translucency::blade::BladeMaps;
use mesophyll_optics::translucency::convolution::{ConvolutionSettings, Convolver, TotalsSource};
use mesophyll_optics::translucency::horizon::Horizon;
use mesophyll_optics::translucency::irradiance::{Visibility, irradiance};
use mesophyll_optics::translucency::levels::ThicknessLevels;
use mesophyll_optics::translucency::lights::raised;
use mesophyll_synth::beams::slanting;

/// Cosine of the angle between the blade's normal and a light at this elevation.
fn cosine(elevation: f64) -> f64 {
    elevation.sin().clamp(1e-3, 1.0)
}

/// The scene that is photographed.
#[derive(Debug, Clone)]
pub struct TissueScene {
    /// Columns and rows of every photograph.
    pub size: usize,
    /// Size of a texel (mm).
    pub texel_mm: f64,
    /// Thickness of the lamina (mm). A vein is half as thick again, and the waves are a tenth of it.
    pub thickness_mm: f64,
    /// How high the waves of the blade are, as a share of the usual ones; 0 is a flat blade.
    pub relief: f64,
    /// The lights: the side that each falls on, its elevation and its azimuth (rad).
    pub beams: Vec<(Side, f64, f64)>,
    /// The tissue that the photographs are made from.
    pub truth: TissueCoefficients,
    /// Relative standard error of a reading; 0 gives exact values.
    pub noise: f64,
    /// Seed of the noise.
    pub seed: u64,
}

impl TissueScene {
    /// A fine patch of the paper's leaf in one channel, with texels of .08 mm, one beam from straight above and one
    /// slanting beam.
    pub fn fine(sigma_a: f64, reduced: f64) -> TissueScene {
        TissueScene {
            size: 24,
            texel_mm: 0.08,
            thickness_mm: 0.2,
            relief: 1.0,
            beams: vec![(Side::Front, 90f64.to_radians(), 0.0), (Side::Front, 45f64.to_radians(), 0.7)],
            truth: TissueCoefficients { sigma_a: vec![sigma_a], reduced: vec![reduced], scale: 1.0 },
            noise: 0.0,
            seed: 1,
        }
    }

    /// Heights of both sides over the middle plane (mm), in the front's columns.
    pub fn heights(&self) -> [Vec<f64>; 2] {
        let n = self.size;
        let half = |k: usize, which: f64| {
            let (x, y) = ((k % n) as f64 / n as f64, (k / n) as f64 / n as f64);
            let vein = (-((x - 0.55 - 0.1 * (4.0 * y).sin()) / 0.07).powi(2)).exp();
            let wave = (9.0 * x + 2.0 * which).sin() * (7.0 * y + 1.0).cos();
            0.5 * self.thickness_mm * (1.0 + self.relief * (0.5 * vein + 0.15 * wave))
        };
        [0.0, 1.0].map(|which| (0..n * n).map(|k| half(k, which)).collect())
    }

    /// The blade between the heights of both sides.
    pub fn blade(&self) -> BladeMaps {
        let n = self.size * self.size;
        let [front, back] = self.heights();
        let back = mirror(&back, self.size);
        BladeMaps::from_heights(
            self.size,
            self.size,
            self.texel_mm,
            vec![true; n],
            [front, back],
            [vec![1.0; n], vec![1.0; n]],
        )
    }

    /// The photographs without values: light and geometry. No texel within `border` of the map's edge counts.
    pub fn frame(&self, border: usize) -> TissueMeasurement {
        let mut blade = self.blade();
        for side in [&mut blade.front, &mut blade.back] {
            // A slope receives the light of its own area, which is larger than the texel's.
            side.entry.iter_mut().zip(&side.normal).for_each(|(e, n)| *e /= n[2]);
        }
        let n = self.size;
        let horizons = [Side::Front, Side::Back].map(|s| Horizon::new(&blade.lit(s)));
        let used = |k: usize| (border..n - border).contains(&(k % n)) && (border..n - border).contains(&(k / n));
        let image = |&(side, elevation, azimuth): &(Side, f64, f64)| {
            let map = usize::from(side == Side::Back);
            let light =
                irradiance(&blade.lit(side), &horizons[map], raised(elevation.sin(), azimuth), Visibility::Hard);
            TissueImage {
                map,
                light,
                cosine: cosine(elevation),
                exit: vec![1.0; n * n],
                seen: vec![0.0; n * n],
                used: (0..n * n).map(used).collect(),
            }
        };
        let images: Vec<TissueImage> = self.beams.iter().map(image).collect();
        let letters = ["R", "G", "B"];
        let channels = (0..self.truth.sigma_a.len()).map(|c| TissueChannel {
            name: letters[c].into(),
            a: 1.0,
            images: images.clone(),
        });
        TissueMeasurement {
            width: n,
            texel_mm: self.texel_mm,
            thickness: [Side::Front, Side::Back].map(|s| blade.lit(s).thickness.into_owned()).to_vec(),
            thickness_errors: ThicknessErrors::default(),
            channels: channels.collect(),
            noise: if self.noise > 0.0 {
                TissueNoise { relative: self.noise, floor: 0.1 * self.noise, known: true }
            } else {
                TissueNoise::EXACT
            },
        }
    }

    /// The photographs.
    ///
    /// # Errors
    /// A tissue that no kernel can be made of.
    pub fn photograph(&self) -> Result<TissueMeasurement> {
        let mut measured = self.frame(0);
        for c in 0..measured.channels.len() {
            let tissue = Tissue { sigma_a: self.truth.sigma_a[c], sigma_s: self.truth.reduced[c], g: 0.0, a: 1.0 };
            let levels = ThicknessLevels { count: 14, ..ThicknessLevels::default() };
            let settings = ConvolutionSettings {
                levels,
                totals: TotalsSource::Transport,
                tail: 1e-9,
                ..ConvolutionSettings::new(tissue, self.texel_mm)
            };
            let maps: Vec<Vec<f64>> =
                measured.thickness.iter().map(|m| m.iter().map(|d| d * self.truth.scale).collect()).collect();
            let Some(convolver) = Convolver::for_map(&settings, self.size, &maps[0])? else { continue };
            for image in &mut measured.channels[c].images {
                let light: Vec<f64> = image
                    .light
                    .iter()
                    .zip(&maps[image.map])
                    .map(|(l, d)| l * slanting(&tissue, *d, image.cosine))
                    .collect();
                image.seen = convolver.run(&maps[image.map], &[light]).swap_remove(0);
            }
        }
        disturb(&mut measured, self.noise, self.seed);
        Ok(measured)
    }
}

/// Adds noise of the measured sd to every reading.
pub fn disturb(measured: &mut TissueMeasurement, noise: f64, seed: u64) {
    if noise == 0.0 {
        return;
    }
    for (c, channel) in measured.channels.iter_mut().enumerate() {
        for (i, image) in channel.images.iter_mut().enumerate() {
            let mut stream = RandomStream::new(seed, &[30, c as u64, i as u64]);
            for pair in image.seen.chunks_mut(2) {
                for (value, n) in pair.iter_mut().zip(stream.normal_pair()) {
                    *value += n * (measured.noise.relative * *value).hypot(measured.noise.floor);
                }
            }
        }
    }
}
