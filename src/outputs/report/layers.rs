//! The slab's σa compared with the absorption of the mesophyll, texel by texel, for fits of scans whose true leaf is
//! made of layers: per length, and over the leaf's whole thickness, which is what light can tell.

use super::ReportSource;
use super::maps::ReportSideMaps;
use super::quantity::channel_word;
use super::spectrum::{self, SpectrumLine, SpectrumPanel};
use crate::reader::sides;
use crate::{Error, Result};
use mesophyll_base::statistics::median_of;
use mesophyll_files::image::ChannelMaps;
use mesophyll_files::quantity::Quantity;
use std::path::{Path, PathBuf};

/// Largest number of texels that are drawn of a side.
const SHOWN: usize = 250;

/// Draws two pictures for each side into `folder`, with the channels side by side, and returns the files.
///
/// # Errors
/// [`Error::Input`] where a folder is no fit of such a scan; [`Error::Write`] where a file cannot be written.
pub fn pictures(sources: &[ReportSource], folder: &Path) -> Result<Vec<PathBuf>> {
    let mut all = Vec::new();
    for source in sources {
        let (name, sides) = sides(&source.folder)?;
        let before = all.len();
        for side in sides {
            for (whole, end) in [(false, ""), (true, "-crossing")] {
                let panels: Vec<SpectrumPanel> = (0..3).filter_map(|c| panel(&side, c, whole)).collect();
                if !panels.is_empty() {
                    all.push((format!("{name}-{}{end}", side.section), panels));
                }
            }
        }
        if all.len() == before {
            let what = "the fit has no true maps of absorption beside it; expected the scan of a leaf made of layers";
            return Err(Error::input(&source.folder, what));
        }
    }
    spectrum::pictures(folder, &all)
}

/// `whole`: over the leaf's thickness; the fit and the truth each use their own.
fn panel(side: &ReportSideMaps, c: usize, whole: bool) -> Option<SpectrumPanel> {
    let maps = [(&side.fit, Quantity::SigmaA), (side.truth.as_ref()?, Quantity::Absorption)];
    let of = |(maps, quantity): (&ChannelMaps, Quantity)| -> Option<Vec<f64>> {
        let (plane, thickness) = (maps.plane(quantity, c)?, maps.scalar(Quantity::Thickness)?);
        let times = |t: &f32| if whole { f64::from(*t) } else { 1.0 };
        Some(plane.iter().zip(thickness).map(|(s, t)| f64::from(*s) * times(t)).collect())
    };
    let (fit, truth) = (of(maps[0])?, of(maps[1])?);
    let pairs = fit.iter().zip(&truth).zip(&side.good).filter(|((s, a), good)| **good && s.is_finite() && **a > 0.0);
    let pairs: Vec<[f64; 2]> = pairs.map(|((s, a), _)| [*a, *s]).collect();
    let ratio = median_of(pairs.iter().map(|[a, s]| s / a))?;
    let [low, high] = pairs.iter().fold([f64::INFINITY, 0.0], |[l, h], p| [p[0].min(l), p[0].max(h)]);
    let step = pairs.len().div_ceil(SHOWN);
    let dots = pairs.iter().step_by(step).map(|[a, s]| [*a, *s, f64::NAN]).collect();
    let line = [low, high].map(|a| [a, ratio * a, f64::NAN]).to_vec();
    Some(SpectrumPanel {
        title: format!("{}, {}", side.section, channel_word(Quantity::SigmaA.letters()[c])),
        across: if whole { "absorption of a crossing" } else { "absorption of the mesophyll (1/mm)" }.into(),
        axis: if whole { "σa times thickness" } else { "σa (1/mm)" }.into(),
        logarithmic: false,
        lines: vec![
            SpectrumLine { name: "texels".into(), points: dots, dots: true },
            SpectrumLine { name: format!("{ratio:.2} times"), points: line, dots: false },
        ],
    })
}
