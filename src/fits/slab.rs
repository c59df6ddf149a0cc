//! σa and σs of a slab from measured (ρd, ρt, thickness), one row at a time. `mesophyll fit slab` does this to each
//! row.
//!
//! Units: thickness in mm, σ in 1/mm, errors absolute standard errors.

use mesophyll_files::table::{OutputRow, Status};
use mesophyll_optics::slab::inverse::{
    self, InversionPrecision, SingleMeasurement, SlabCoefficient, SlabEstimate, SlabModel, SlabShare,
};

/// How rows are read.
#[derive(Clone, Copy)]
pub struct Options<'a> {
    /// How exactly the slab is computed.
    pub precision: InversionPrecision,
    /// Standard error of ρd and ρt where a row has none of its own; 0 for exact values, `None` where nobody stated it.
    pub noise: Option<f64>,
    /// The share of the measured ρd that the surface reflects before light enters the slab; it is subtracted.
    pub surface: f64,
    /// The slab's index, and what its faces reflect.
    pub model: &'a SlabModel,
    /// Whether the measured ρd has the mirror reflection of the faces.
    pub specular: SpecularPart,
}

/// Whether a measured reflectance has what the faces reflect as a mirror.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Default,
    strum::Display,
    strum::EnumString,
    strum::EnumIter,
    strum::IntoStaticStr,
    strum::EnumMessage,
)]
#[strum(serialize_all = "lowercase")]
pub enum SpecularPart {
    /// It has: an integrating sphere without an opening in the mirror direction.
    #[default]
    Included,
    /// It left through an opening of the sphere.
    Excluded,
}

/// A coefficient that is known beforehand (1/mm); an error that is NaN counts as none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CoefficientPrior {
    /// Which one.
    pub coefficient: SlabCoefficient,
    /// Its value.
    pub sigma: f64,
    /// Its standard error.
    pub err: f64,
}

/// Standard error that an inversion takes where none was stated, to tell which slabs can be found at all. No error is
/// printed for it.
pub const ASSUMED_NOISE: f64 = 1e-6;

/// Output columns of [`answer`].
pub const OUTPUTS: [&str; 4] = ["sigma_a", "sigma_s", "sigma_a_err", "sigma_s_err"];

/// One measurement; an error that is NaN was not measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlabMeasurement {
    /// Diffuse reflectance ρd, 0 to 1.
    pub rho_d: f64,
    /// Transmittance ρt, 0 to 1.
    pub rho_t: f64,
    /// Thickness (mm).
    pub thickness_mm: f64,
    /// Standard error of ρd.
    pub rho_d_err: f64,
    /// Standard error of ρt.
    pub rho_t_err: f64,
    /// A coefficient that is known; then one of ρd and ρt is NaN.
    pub known: Option<CoefficientPrior>,
}

impl SlabMeasurement {
    /// Whether the standard errors of what was measured are known, from the row or from the options.
    pub fn noise_is_stated(&self, options: &Options) -> bool {
        let missing = |value: f64, err: f64| err.is_nan() && !(self.known.is_some() && value.is_nan());
        options.noise.is_some() || !(missing(self.rho_d, self.rho_d_err) || missing(self.rho_t, self.rho_t_err))
    }
}

/// Inverts one measurement: the values of [`OUTPUTS`], NaN where there is none, and how it ended.
///
/// Where no noise is stated nothing is known of the errors, so they are NaN. The status then only says whether the
/// numbers belong to a slab and can be inverted: `ok`, or what stays open at a noise of [`ASSUMED_NOISE`].
pub fn found(options: &Options, m: &SlabMeasurement) -> ([f64; 4], Status) {
    let stated = m.noise_is_stated(options);
    let or_noise = |err: f64| if err.is_nan() { options.noise.unwrap_or(ASSUMED_NOISE) } else { err };
    let (rho_d, [d_err, t_err]) = (m.rho_d - options.surface, [m.rho_d_err, m.rho_t_err].map(or_noise));
    let (model, h) = (options.model, m.thickness_mm);
    let mut e = match m.known {
        None => with_mirror(options, m, rho_d, |rho_d| {
            inverse::invert_in(model, options.precision, rho_d, m.rho_t, h, d_err, t_err)
        }),
        Some(known) => {
            let single = |share: SlabShare, value: f64, err: f64| SingleMeasurement {
                share,
                value,
                err,
                known: known.coefficient,
                sigma: known.sigma,
                sigma_err: if known.err.is_nan() { 0.0 } else { known.err },
            };
            match (m.rho_d.is_nan(), m.rho_t.is_nan()) {
                (false, true) => with_mirror(options, m, rho_d, |rho_d| {
                    inverse::invert_single(model, &single(SlabShare::Reflected, rho_d, d_err), h)
                }),
                (true, false) => inverse::invert_single(model, &single(SlabShare::Transmitted, m.rho_t, t_err), h),
                (true, true) => return refused("rho_d and rho_t are both empty; a known sigma needs one of them"),
                (false, false) => {
                    return refused(
                        "rho_d, rho_t and a known sigma are all given; two of them determine the slab, leave one empty",
                    );
                }
            }
        }
    };
    if let Some(known) = m.known.filter(|k| k.err.is_nan()) {
        // Nothing was said of its error, so none is printed.
        match known.coefficient {
            SlabCoefficient::Absorption => e.sigma_a_err = f64::NAN,
            SlabCoefficient::Scattering => e.sigma_s_err = f64::NAN,
        }
    }
    let errors = if stated { [e.sigma_a_err, e.sigma_s_err] } else { [f64::NAN; 2] };
    let status = match e.status {
        Status::Undetermined(what) if !stated => {
            Status::undetermined([what], &format!("judged at a noise of {ASSUMED_NOISE:e}; none was stated"))
        }
        status => status,
    };
    ([e.sigma_a, e.sigma_s, errors[0], errors[1]], status)
}

/// No numbers, for this reason.
fn refused(why: &str) -> ([f64; 4], Status) {
    ([f64::NAN; 4], Status::Refused(why.into()))
}

/// Adds to `rho_d` the mirror reflection that was left out of it. That of the far face depends on the slab, so the slab
/// is found, and found again, until it stays.
fn with_mirror(
    options: &Options,
    m: &SlabMeasurement,
    rho_d: f64,
    invert: impl Fn(f64) -> SlabEstimate,
) -> SlabEstimate {
    let mirror = options.model.mirror;
    if options.specular == SpecularPart::Included || mirror.is_none() {
        return invert(rho_d);
    }
    let mut added = mirror.face();
    let mut e = invert(rho_d + added);
    for _ in 0..30 {
        let depth = (e.sigma_a + e.sigma_s) * m.thickness_mm;
        let next = if depth.is_nan() { mirror.face() } else { mirror.unscattered(depth) };
        if (next - added).abs() < 1e-12 {
            break;
        }
        added = next;
        e = invert(rho_d + added);
    }
    e
}

/// [`found`] as the row of a batch.
pub fn answer(options: &Options, m: &SlabMeasurement) -> OutputRow {
    match found(options, m) {
        (_, Status::Refused(why)) => OutputRow::refused(why),
        (values, status) => OutputRow { values: values.to_vec(), status },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LEAF: SlabMeasurement = SlabMeasurement {
        rho_d: 0.3,
        rho_t: 0.2,
        thickness_mm: 0.2,
        rho_d_err: f64::NAN,
        rho_t_err: f64::NAN,
        known: None,
    };

    fn options(model: &SlabModel, noise: Option<f64>) -> Options<'_> {
        Options { precision: InversionPrecision::Fast, noise, surface: 0.0, model, specular: SpecularPart::Included }
    }

    fn with(noise: Option<f64>, m: SlabMeasurement) -> OutputRow {
        answer(&options(SlabModel::matched(), noise), &m)
    }

    /// Without stated noise the numbers are those of exact input, and no error is claimed.
    #[test]
    fn errors_are_empty_without_noise() {
        let (unstated, exact, noisy) = (with(None, LEAF), with(Some(0.0), LEAF), with(Some(5e-3), LEAF));
        assert!(unstated.values[2].is_nan() && unstated.values[3].is_nan() && unstated.status == Status::Ok);
        for k in 0..2 {
            assert!((unstated.values[k] / exact.values[k] - 1.0).abs() < 1e-9);
            assert!(
                exact.values[2 + k] < 1e-6 * exact.values[k],
                "exact values leave the model's own error only: {exact:?}"
            );
            assert!(noisy.values[2 + k] > 1e-3 * noisy.values[k]);
        }
        // One error alone does not say how sure σ is.
        assert!(with(None, SlabMeasurement { rho_d_err: 1e-3, ..LEAF }).values[2].is_nan());
        let both = with(None, SlabMeasurement { rho_d_err: 5e-3, rho_t_err: 5e-3, ..LEAF });
        assert_eq!(both, noisy);
    }

    #[test]
    fn what_cannot_be_inverted_is_named_without_noise_too() {
        let opaque = with(None, SlabMeasurement { rho_t: 0.0, ..LEAF });
        assert!(
            opaque.status.leaves_open("sigma_a") && opaque.status.to_string().contains("none was stated"),
            "{opaque:?}"
        );
        assert!(opaque.values[2].is_nan());
        assert!(matches!(with(None, SlabMeasurement { rho_d: 0.9, rho_t: 0.5, ..LEAF }).status, Status::Refused(_)));
    }

    /// One of ρd and ρt with one σ gives the other σ, and its error holds that of the known one.
    #[test]
    fn one_share_and_one_coefficient_give_the_other() {
        for index in [1.0, 1.41] {
            let model = SlabModel::of_index(index);
            let options = options(&model, Some(1e-3));
            let (both, _) = found(&options, &LEAF);
            for coefficient in [SlabCoefficient::Absorption, SlabCoefficient::Scattering] {
                let (known, unknown) = if coefficient == SlabCoefficient::Absorption { (0, 1) } else { (1, 0) };
                for (rho_d, rho_t) in [(0.3, f64::NAN), (f64::NAN, 0.2)] {
                    let at = |sigma: f64, err: f64, off: f64| {
                        let known = Some(CoefficientPrior { coefficient, sigma, err });
                        let m = SlabMeasurement { rho_d: rho_d + off, rho_t: rho_t + off, known, ..LEAF };
                        found(&options, &m)
                    };
                    let (values, status) = at(both[known], f64::NAN, 0.0);
                    assert_eq!(status, Status::Ok, "{index} {coefficient:?} {rho_d}");
                    assert!((values[unknown] / both[unknown] - 1.0).abs() < 1e-5, "{values:?} {both:?}");
                    assert_eq!(values[known], both[known]);
                    assert!(values[2 + known].is_nan());
                    // Its error by differences: the measurement and the known coefficient are moved.
                    let err = 0.02 * both[known];
                    let wide = at(both[known], err, 0.0).0;
                    let by_share = at(both[known], 0.0, 1e-3).0[unknown] - both[unknown];
                    let by_known = at(both[known] + err, 0.0, 0.0).0[unknown] - both[unknown];
                    let want = by_share.hypot(by_known);
                    assert!((wide[2 + unknown] / want - 1.0).abs() < 0.1, "{index} {coefficient:?}: {wide:?} {want}");
                    assert_eq!(wide[2 + known], err);
                }
            }
            let known = Some(CoefficientPrior { coefficient: SlabCoefficient::Absorption, sigma: both[0], err: 0.0 });
            let all = found(&options, &SlabMeasurement { known, ..LEAF }).1.to_string();
            assert!(all.starts_with("refused: rho_d, rho_t and a known sigma"), "{all}");
            let none =
                found(&options, &SlabMeasurement { known, rho_d: f64::NAN, rho_t: f64::NAN, ..LEAF }).1.to_string();
            assert!(none.starts_with("refused: rho_d and rho_t are both empty"), "{none}");
            // More than a slab that absorbs so strongly can reflect.
            let known = Some(CoefficientPrior { coefficient: SlabCoefficient::Absorption, sigma: 1e3, err: 0.0 });
            let m = SlabMeasurement { known, rho_d: 0.99, rho_t: f64::NAN, ..LEAF };
            let bright = found(&options, &m).1.to_string();
            assert!(bright.starts_with("refused: rho_d is 0.99; a slab of this thickness with sigma_a"), "{bright}");
        }
    }

    /// What leaves through an opening in the mirror direction is added again, that of the far face too.
    #[test]
    fn a_mirror_reflection_that_was_left_out_is_added() {
        let model = SlabModel::of_index(1.5);
        let included = options(&model, Some(1e-3));
        for (a, s, h) in [(0.5, 3.0, 0.2), (8.0, 6.0, 0.2), (0.02, 0.4, 2.0)] {
            let delta: f64 = (a + s) * h;
            let r = model.response(s / (a + s), a / (a + s), delta);
            let face = (0.5_f64 / 2.5).powi(2);
            let y = (-delta).exp();
            let unscattered = face + face * (1.0 - face).powi(2) * y * y / (1.0 - (face * y).powi(2));
            let m = SlabMeasurement { rho_d: r.rho_d - unscattered, rho_t: r.rho_t, thickness_mm: h, ..LEAF };
            let (values, _) = found(&Options { specular: SpecularPart::Excluded, ..included }, &m);
            assert!((values[0] / a - 1.0).abs() < 1e-4 && (values[1] / s - 1.0).abs() < 1e-4, "{values:?} {a} {s}");
            let (wrong, _) = found(&included, &m);
            assert!(!((wrong[1] / s - 1.0).abs() < 0.05), "{wrong:?}");
        }
    }
}
