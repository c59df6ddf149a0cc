//! Faults of a measured spectrum, each put into the exact spectrum of a leaf of layers with noise. The verdict is the
//! fit's status; a fault must leave the pigments undetermined.

use super::stress::row;
use crate::stress::StressRow;
use mesophyll_base::random::RandomStream;
use mesophyll_fits::foliar::surface::FoliarFitSetting;
use mesophyll_fits::foliar::{FoliarFitConstants, FoliarFitModel, FoliarParameter, FoliarReading};
use mesophyll_optics::foliar::pigments::{OpticalConstants, OpticalSpectrum};
use mesophyll_optics::foliar::{LayeredLeaf, MesophyllPath, Oblateness, exact};
use mesophyll_optics::side::Side;
use std::time::Instant;

const NOISE: f64 = 2e-3;
const ASKED: [FoliarParameter; 3] =
    [FoliarParameter::Chlorophyll, FoliarParameter::Carotenoid, FoliarParameter::Oblateness];
/// Contents of the leaf (µg/cm²).
const CHLOROPHYLL: f64 = 40.0;
const CAROTENOID: f64 = 9.0;
const SETTING: FoliarFitSetting =
    FoliarFitSetting { palisade: 1.0, spongy: 5.0, path: MesophyllPath::Sieve, incidence: 0.14 };
const SPOILT: &str = "undetermined: chlorophyll_ug_cm2";

/// A fault, what must be said of it, and what it makes of R and T at a wavelength (nm).
type Fault = (&'static str, &'static str, fn(f64, [f64; 2]) -> [f64; 2]);

const FAULTS: [Fault; 8] = [
    ("none", "ok", |_, rt| rt),
    ("R and T exchanged", SPOILT, |_, [r, t]| [t, r]),
    ("R a fifth too large", SPOILT, |_, [r, t]| [1.2 * r, t]),
    ("a constant of .05 in R", SPOILT, |_, [r, t]| [r + 0.05, t]),
    ("a constant of .05 in both", SPOILT, |_, rt| rt.map(|v| v + 0.05)),
    ("a tenth of the light lost beside the ports", SPOILT, |_, rt| rt.map(|v| 0.9 * v)),
    ("saturated at .15", SPOILT, |_, rt| rt.map(|v| v.min(0.15))),
    ("readings of a white sheet in the red", SPOILT, |nm, rt| if nm > 600.0 { [0.8, 0.0] } else { rt }),
];

/// A spectrum of the size of a leaf's, made up, so that no database is needed.
fn spectrum(shift: f64) -> OpticalSpectrum {
    let bell = |nm: f64, at: f64, width: f64| (-((nm - at) / width).powi(2)).exp();
    let of = |nm: f64| OpticalConstants {
        specific: [
            5e4 * bell(nm, 440.0, 30.0) + 1e4 * bell(nm, 560.0, 90.0) + 4e4 * bell(nm, 675.0, 18.0),
            6e4 * bell(nm, 455.0, 40.0),
            10.0,
            4.0,
            1e-3,
        ],
        indices: [1.53 - 1e-4 * (nm - 450.0), 1.42, 1.41],
    };
    let points = (0..18).map(|k| 430.0 + 16.0 * f64::from(k)).map(|nm| (nm, of(nm + shift))).collect();
    OpticalSpectrum { points }
}

/// Runs every fault, and a wavelength scale that is 12 nm off.
pub fn rows() -> Vec<StressRow> {
    let known = FoliarFitConstants { contents: [0.0; 5], oblateness: 5.0 };
    let lights: Vec<(f64, Side)> = spectrum(0.0).points.iter().map(|p| (p.0, Side::Front)).collect();
    let model = match FoliarFitModel::new(&spectrum(0.0), &lights, SETTING, &ASKED, Some(NOISE)) {
        Ok(model) => model,
        Err(why) => return vec![row("fault of a spectrum", "ok", why, None, Instant::now())],
    };
    let run = |name: &str, expected: &str, shift: f64, change: &dyn Fn(f64, [f64; 2]) -> [f64; 2]| {
        let clock = Instant::now();
        let readings = measured(shift, change);
        let verdict = readings.map_or_else(
            || "wrong: the exact method does not settle".into(),
            |readings| model.fit(&readings, &known).status.to_string(),
        );
        row(&format!("fault of a spectrum: {name}"), expected, verdict, None, clock)
    };
    let mut out: Vec<StressRow> = FAULTS.iter().map(|(name, expected, put)| run(name, expected, 0.0, put)).collect();
    out.push(run("wavelengths 12 nm off", SPOILT, 12.0, &|_, rt| rt));
    out
}

/// The leaf's readings with noise, by the exact method.
fn measured(shift: f64, change: &dyn Fn(f64, [f64; 2]) -> [f64; 2]) -> Option<Vec<FoliarReading>> {
    let mut noise = RandomStream::new(3, &[0xf0]);
    let mut out = Vec::new();
    for (light, (nm, constants)) in spectrum(shift).points.into_iter().enumerate() {
        let per = constants.per_content();
        let [n_cuticle, n_mesophyll, n_antidermal] = constants.indices;
        let leaf = LayeredLeaf {
            depth: per[0] * CHLOROPHYLL + per[1] * CAROTENOID,
            n_cuticle,
            n_mesophyll,
            n_antidermal,
            oblateness: Oblateness { epidermis: 5.0, ..Oblateness::USUAL },
            path: SETTING.path,
        };
        let found = exact::response(&leaf, Side::Front, SETTING.incidence)?;
        let pair = noise.normal_pair();
        let both = change(nm, [found.reflectance, found.transmittance]);
        for through in [false, true] {
            let k = usize::from(through);
            out.push(FoliarReading { light, through, value: both[k] + NOISE * pair[k], err: f64::NAN });
        }
    }
    Some(out)
}
