//! σ·h: the absorption and the scattering on the way through a whole leaf. Its spectra tell them even where nobody
//! knows the thickness h well, because the slab holds σ and h only as their product.

use super::fault::{FaultGrade, MeasurementFault};
use super::{FitParameter, RecordSection};
use mesophyll_base::rgb::Rgb;
use mesophyll_files::quantity::{Quantity, RGB};
use mesophyll_optics::slab::inverse::DETERMINED;

/// The fault of a thickness that no leaf has. It spoils σ and leaves σ·h as it is.
pub const THICKNESS_FAULT: &str = "thickness";

/// Absorption and scattering through the whole leaf, with the coefficients that they belong to.
const DEPTHS: [(&str, Quantity); 2] = [("sigma_a_h", Quantity::SigmaA), ("sigma_s_h", Quantity::SigmaS)];

impl RecordSection {
    /// States σ·h (a pure number a channel) of each coefficient that is open because of the thickness: its error
    /// without the caliper's part is at most 10 % in a channel where the coefficient itself is undetermined, and
    /// nothing else spoils it. Channels that stay open are named with the coefficient's own reason.
    pub fn state_depths(&mut self, side: &str, faults: &[MeasurementFault]) {
        let Some([h]) = self.params.get(Quantity::Thickness.name()).map(|p| p.value.as_slice()) else { return };
        let h = *h;
        for (name, coefficient) in DEPTHS {
            let spoilt = |f: &MeasurementFault| f.grade == FaultGrade::Wrong && f.name != THICKNESS_FAULT;
            if faults.iter().any(|f| spoilt(f) && f.spoils(side, coefficient.name())) {
                continue;
            }
            let Some(sigma) = self.params.get(coefficient.name()).filter(|p| p.value.len() == RGB.len()) else {
                continue;
            };
            let stderr = Rgb::of(|c| {
                let caliper = sigma.stderr_caliper.get(c).copied().unwrap_or(0.0);
                h * (sigma.stderr[c].powi(2) - caliper.powi(2)).max(0.0).sqrt()
            });
            let value = Rgb::of(|c| h * sigma.value[c]);
            let reason = |c: usize| {
                let channel = format!("{}:", coefficient.channel(c));
                sigma.undetermined.iter().find_map(|text| text.strip_prefix(&channel))
            };
            let known = |c: usize| value[c].is_finite() && stderr[c] <= DETERMINED * value[c];
            if !(0..RGB.len()).any(|c| known(c) && reason(c).is_some()) {
                continue;
            }
            let open = |c: usize| {
                (!known(c)).then(|| format!("{name}.{}:{}", RGB[c], reason(c).unwrap_or(" its error is above 10 %")))
            };
            let undetermined = (0..RGB.len()).filter_map(open).collect();
            let (value, stderr) = (value.to_vec(), stderr.to_vec());
            self.params.insert(name.into(), FitParameter { value, stderr, undetermined, ..FitParameter::default() });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A side whose σa is off by `stderr` in all, `caliper` of it from the thickness, for the reason `why` where it is
    /// open.
    fn section(stderr: [f64; 3], caliper: f64, why: &str) -> RecordSection {
        let value = [4.0, 1.0, 10.0];
        let open = |c: &usize| stderr[*c] > DETERMINED * value[*c] || !why.is_empty();
        let sigma = FitParameter {
            value: value.to_vec(),
            stderr: stderr.to_vec(),
            stderr_caliper: value.iter().map(|v| v * caliper).collect(),
            unit: "1/mm".into(),
            undetermined: (0..3).filter(open).map(|c| format!("sigma_a.{}: {why}", RGB[c])).collect(),
        };
        let thickness = FitParameter { value: vec![0.2], stderr: vec![0.2 * caliper], ..FitParameter::default() };
        let params = [("sigma_a".to_string(), sigma), ("thickness".to_string(), thickness)].into();
        RecordSection { params, ..RecordSection::default() }
    }

    fn fault(name: &str) -> MeasurementFault {
        MeasurementFault {
            name: name.into(),
            grade: FaultGrade::Wrong,
            sides: vec!["front".into()],
            spoils: vec!["sigma_a".into()],
            says: "wrong".into(),
        }
    }

    #[test]
    fn what_only_the_caliper_leaves_open_is_known_through_the_leaf() {
        // The caliper is off by 12 %, the fit by 3, 5 and 40 %.
        let all = |own: f64, value: f64| value * own.hypot(0.12);
        let mut side = section([all(0.03, 4.0), all(0.05, 1.0), all(0.4, 10.0)], 0.12, "");
        side.state_depths("front", &[]);
        let depth = &side.params["sigma_a_h"];
        assert_eq!(depth.value, [4.0 * 0.2, 0.2, 2.0]);
        for (got, expected) in depth.stderr.iter().zip([0.03 * 0.8, 0.05 * 0.2, 0.4 * 2.0]) {
            assert!((got - expected).abs() < 1e-12, "{got} {expected}");
        }
        assert_eq!(depth.undetermined.len(), 1);
        assert!(depth.undetermined[0].starts_with("sigma_a_h.B:"), "{:?}", depth.undetermined);
        assert!(!side.params.contains_key("sigma_s_h"));
    }

    #[test]
    fn a_determined_coefficient_and_one_spoilt_by_other_faults_have_none() {
        let small = [0.1, 0.02, 0.3];
        let stated = |why: &str, faults: &[MeasurementFault]| {
            let mut side = section(small, 0.0, why);
            side.state_depths("front", faults);
            side.params.contains_key("sigma_a_h")
        };
        assert!(!stated("", &[]));
        assert!(stated("no leaf has this thickness", &[fault(THICKNESS_FAULT)]));
        assert!(!stated("no leaf has this thickness", &[fault(THICKNESS_FAULT), fault("energy")]));
    }
}
