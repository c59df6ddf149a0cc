//! Checks the numbers of a leaf specification.

use super::spec::{InteriorSpec, LeafSpec, OutlineSpec};
use crate::{Error, Result};
use std::path::Path;

impl LeafSpec {
    /// Checks every number against its range.
    ///
    /// # Errors
    /// [`Error::Input`] naming the file, the field, what was found and what was expected.
    pub(super) fn validate(&self, path: &Path) -> Result<()> {
        let bad = |field: &str, found: String, expected: &str| Err(Error::unexpected(path, field, found, expected));
        if self.schema != 1 {
            return bad("schema", self.schema.to_string(), "1");
        }
        if self.name.is_empty() || self.name.contains(['/', '\\', '\n']) {
            return bad("name", format!("{:?}", self.name), "a name without slashes");
        }
        let tube = self.device.tube;
        let positive = [
            ("field_mm", self.field_mm[0]),
            ("field_mm", self.field_mm[1]),
            ("thickness_mm", self.thickness_mm),
            ("outline.length_mm", self.outline.length_mm),
            ("veins.width_mm", self.veins.width_mm[0]),
            ("veins.width_mm", self.veins.width_mm[1]),
            ("veins.width_mm", self.veins.width_mm[2]),
            ("relief.bulge_width_mm", self.relief.bulge_width_mm[0]),
            ("relief.bulge_width_mm", self.relief.bulge_width_mm[1]),
            ("relief.wave_length_mm", self.relief.wave_length_mm),
            ("device.tube.height_mm", tube.height_mm),
            ("device.tube.length_mm", tube.length_mm),
            ("device.full_scale", self.device.full_scale),
            ("front.m", self.front.m),
            ("back.m", self.back.m),
        ];
        for (field, value) in positive {
            if !(value > 0.0 && value.is_finite()) {
                return bad(field, value.to_string(), "a positive number");
            }
        }
        let colours = [
            ("interior.sigma_a", self.interior.sigma_a),
            ("interior.sigma_s", self.interior.sigma_s),
            ("device.gain", self.device.gain),
        ];
        let layers_only = self.interior == InteriorSpec::default();
        for (field, values) in colours.into_iter().skip(if layers_only { 2 } else { 0 }) {
            if values.iter().any(|v| !(*v > 0.0 && v.is_finite())) {
                return bad(field, format!("{values:?}"), "three positive numbers");
            }
        }
        for (field, value) in [
            ("front.rho_s", self.front.rho_s),
            ("back.rho_s", self.back.rho_s),
            ("device.dark", self.device.dark),
            ("device.noise_floor", self.device.noise_floor),
            ("device.tube.radius_mm", tube.radius_mm),
            ("margin.tooth_mm", self.margin.tooth_mm),
            ("veins.tertiary_mm", self.veins.tertiary_mm),
            ("veins.areole_mm", self.veins.areole_mm),
        ] {
            if !(value >= 0.0 && value.is_finite()) {
                return bad(field, value.to_string(), "zero or a positive number");
            }
        }
        if tube.radius_mm >= tube.height_mm {
            return bad("device.tube.radius_mm", tube.radius_mm.to_string(), "less than device.tube.height_mm");
        }
        for (field, angle) in [
            ("device.camera_deg", self.device.camera_deg),
            ("device.lightbox_camera_deg", self.device.lightbox_camera_deg),
        ] {
            if angle.is_nan() || angle.abs() > 85.0 {
                return bad(field, angle.to_string(), "-85 to 85 degrees");
            }
        }
        if let Some(index) = self.lobe.index()
            && !(index > 1.0 && index < 4.0)
        {
            return bad("lobe.index", index.to_string(), "a refractive index between 1 and 4");
        }
        if self.veins.tertiary_mm > 0.0 && self.veins.tertiary_mm < 0.2 {
            return bad("veins.tertiary_mm", self.veins.tertiary_mm.to_string(), "0, or 0.2 mm and more");
        }
        for (field, value, [low, high]) in self.ranges() {
            if !(low..=high).contains(&value) {
                return bad(field, value.to_string(), &format!("{low} to {high}"));
            }
        }
        // Leaves of finer veins and teeth would grow for hours, and need more memory than there is.
        let across = self.outline.largest_mm();
        for (field, value, most) in [
            ("veins.tertiary_mm", self.veins.tertiary_mm, 500.0),
            ("veins.areole_mm", self.veins.areole_mm, 5000.0),
            ("margin.tooth_mm", self.margin.tooth_mm, 5000.0),
        ] {
            if value > 0.0 && value < across / most {
                let expected = format!("0, or at least {} (1/{most} of the outline)", across / most);
                return bad(field, value.to_string(), &expected);
            }
        }
        let (profile, polar) = (&self.outline.profile, &self.outline.polar);
        let rises = |list: Vec<f64>, a: f64, b: f64| {
            list.len() >= 3 && list[0] == a && list[list.len() - 1] == b && list.windows(2).all(|w| w[1] > w[0])
        };
        if profile.is_empty() == polar.is_empty() {
            return bad("outline", "both or neither of profile and polar".into(), "one of them");
        }
        if !profile.is_empty() && !rises(profile.iter().map(|p| p[0]).collect(), 0.0, 1.0) {
            return bad("outline.profile", "other abscissae".into(), "at least three rows rising from 0 to 1");
        }
        if !polar.is_empty() && !rises(polar.iter().map(|p| p[0]).collect(), -180.0, 180.0) {
            return bad("outline.polar", "other angles".into(), "at least three rows rising from -180 to 180");
        }
        if profile.iter().any(|p| p[1] < 0.0 || p[2] < 0.0) || polar.iter().any(|p| p[1] <= 0.0) {
            return bad("outline", "a negative width".into(), "half widths of zero or more and positive radii");
        }
        Ok(())
    }

    /// The fields that are neither checked to be positive nor by rules of their own, or that have an upper limit too,
    /// and their ranges. They are wide: they keep out what no leaf can be.
    fn ranges(&self) -> Vec<(&'static str, f64, [f64; 2])> {
        let LeafSpec { outline, margin, veins, relief, variation, .. } = self;
        let length = [0.0, LONGEST_MM];
        let mut all = vec![
            ("field_mm", self.field_mm[0], length),
            ("field_mm", self.field_mm[1], length),
            ("thickness_mm", self.thickness_mm, [0.0, 100.0]),
            ("outline.length_mm", outline.length_mm, length),
            ("outline.bow_mm", outline.bow_mm, [-LONGEST_MM, LONGEST_MM]),
            ("outline.petiole_mm", outline.petiole_mm, length),
            ("outline.petiole_width_mm", outline.petiole_width_mm, length),
            ("margin.tooth_mm", margin.tooth_mm, length),
            ("margin.depth_mm", margin.depth_mm, [0.0, 0.5 * outline.largest_mm()]),
            ("margin.second", margin.second, [0.0, 100.0]),
            ("margin.second_depth_mm", margin.second_depth_mm, [0.0, 0.5 * outline.largest_mm()]),
            ("margin.lean", margin.lean, [0.0, 1.0]),
            ("veins.count", veins.count as f64, [0.0, 1000.0]),
            ("veins.angle_deg", veins.angle_deg, [0.0, 180.0]),
            ("veins.arch", veins.arch, [0.0, 1.0]),
            ("veins.jitter", veins.jitter, [0.0, 1.0]),
            ("relief.fold_deg", relief.fold_deg, [-85.0, 85.0]),
            ("relief.droop_mm", relief.droop_mm, [-LONGEST_MM, LONGEST_MM]),
            ("relief.wave_mm", relief.wave_mm, [-LONGEST_MM, LONGEST_MM]),
            ("relief.wave_length_mm", relief.wave_length_mm, [0.01, LONGEST_MM]),
        ];
        let mut each = |field, values: &[f64], range| all.extend(values.iter().map(|value| (field, *value, range)));
        each("outline.profile", &outline.profile.iter().flat_map(|[_, l, r]| [*l, *r]).collect::<Vec<_>>(), length);
        each("outline.polar", &outline.polar.iter().map(|[_, radius]| *radius).collect::<Vec<_>>(), length);
        each("veins.width_mm", &veins.width_mm, length);
        each("relief.sunk_mm", &relief.sunk_mm, [-100.0, 100.0]);
        each("relief.raised_mm", &relief.raised_mm, [-100.0, 100.0]);
        each("relief.bulge_mm", &relief.bulge_mm, [-100.0, 100.0]);
        each("relief.bulge_width_mm", &relief.bulge_width_mm, length);
        each("variation.veins", &variation.veins, [-1.0, 100.0]);
        each("variation.lamina", &variation.lamina, [0.0, 100.0]);
        all
    }
}

/// The longest leaf (mm): the leaves of some palms reach 25 m, and no leaflet does.
const LONGEST_MM: f64 = 30_000.0;

impl OutlineSpec {
    /// The largest of its lengths, half widths and radii (mm).
    fn largest_mm(&self) -> f64 {
        let widths = self.profile.iter().flat_map(|[_, left, right]| [*left, *right]);
        widths.chain(self.polar.iter().map(|[_, radius]| *radius)).fold(self.length_mm, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The elm with one field changed: what is said of it, or nothing.
    fn told(change: impl FnOnce(&mut LeafSpec)) -> Option<String> {
        let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../data/leaves/elm.toml"));
        let mut spec = LeafSpec::read(path).unwrap();
        change(&mut spec);
        spec.validate(path).err().map(|e| e.to_string())
    }

    #[test]
    fn leaves_that_would_grow_for_ever_are_refused_by_name() {
        assert_eq!(told(|_| {}), None);
        assert_eq!(told(|s| s.veins.tertiary_mm = 0.0), None);
        type Change = fn(&mut LeafSpec);
        let wrong: [(&str, Change); 8] = [
            ("outline.length_mm: found 4000000000000000", |s| s.outline.length_mm = 4e15),
            ("outline.bow_mm: found inf", |s| s.outline.bow_mm = f64::INFINITY),
            ("outline.profile: found 1000000000", |s| s.outline.profile[3][1] = 1e9),
            ("margin.depth_mm: found 4000", |s| s.margin.depth_mm = 4000.0),
            ("margin.tooth_mm: found 0.000001", |s| s.margin.tooth_mm = 1e-6),
            ("veins.count: found 4000000000", |s| s.veins.count = 4_000_000_000),
            ("veins.tertiary_mm: found 0.2, expected 0, or at least 2", |s| {
                (s.outline.length_mm, s.veins.tertiary_mm) = (1000.0, 0.2);
            }),
            ("relief.wave_mm: found NaN", |s| s.relief.wave_mm = f64::NAN),
        ];
        for (expected, change) in wrong {
            let found = told(change).unwrap_or_default();
            assert!(found.contains(expected), "{found:?}, expected {expected:?}");
        }
    }
}
