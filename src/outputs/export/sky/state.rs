//! What the functions of a sky depend on besides the direction: constants where the sky is fixed, and otherwise the
//! fields of a state that `sky_at` makes from sun and turbidity.

use super::language::{SourceText, ValueType};
use mesophyll_sky::irradiance::on_level_ground;
use mesophyll_sky::{HarmonicCoefficients, Preetham, SkyRefusal, sun};
use std::f64::consts::PI;

/// A field of the state.
struct Field {
    name: &'static str,
    kind: ValueType,
    /// Length of a list; 0 for a single value.
    count: usize,
    says: &'static str,
}

/// The fields of a sky of so many bands. Only Preetham's model has a closed form to draw.
fn fields(bands: usize, closed: bool) -> Vec<Field> {
    let field = |name, kind, count, says| Field { name, kind, count, says };
    let mut out = vec![
        field(
            "harmonics",
            ValueType::Triple,
            bands * bands,
            "Harmonics at l(l+1)+m, for a sun at azimuth 0, the ground's light among them (kcd/m2).",
        ),
        field("azimuth_cos", ValueType::Real, 0, "Cosine and sine of the sun's azimuth."),
        field("azimuth_sin", ValueType::Real, 0, ""),
        field("sun_cos", ValueType::Real, 0, "Cosine and sine of the sun's zenith angle."),
        field("sun_sin", ValueType::Real, 0, ""),
        field("sun_light", ValueType::Triple, 0, "Sunlight on a surface that faces the sun (klx)."),
        field("ground_light", ValueType::Triple, 0, "Radiance of the ground (kcd/m2)."),
    ];
    if closed {
        out.push(field("perez", ValueType::Triple, 5, "Perez' A to E, of Y, x and y."));
        out.push(field("scale", ValueType::Triple, 0, "Factors of Y, Y/y and Y x/y."));
    }
    out
}

/// One sky, with its numbers.
pub struct SkyConstants {
    /// Sun zenith angle, its azimuth (rad), and turbidity.
    pub sun_zenith: f64,
    pub azimuth: f64,
    pub turbidity: f64,
    /// With the ground's light.
    pub harmonics: HarmonicCoefficients,
    /// Radiance of the ground.
    pub ground: [f64; 3],
}

impl SkyConstants {
    /// The values of a field.
    fn values(&self, name: &str) -> Result<Vec<[f64; 3]>, SkyRefusal> {
        let one = |v: f64| vec![[v; 3]];
        let closed = || Preetham.at(self.sun_zenith, self.turbidity);
        Ok(match name {
            "harmonics" => self.harmonics.values().to_vec(),
            "azimuth_cos" => one(self.azimuth.cos()),
            "azimuth_sin" => one(self.azimuth.sin()),
            "sun_cos" => one(self.sun_zenith.cos()),
            "sun_sin" => one(self.sun_zenith.sin()),
            "sun_light" => vec![sun::irradiance(self.sun_zenith, self.turbidity)],
            "ground_light" => vec![self.ground],
            "perez" => {
                let of = closed()?.turbid().perez();
                (0..5).map(|k| [of[0][k], of[1][k], of[2][k]]).collect()
            }
            _ => vec![closed()?.prefactors()],
        })
    }
}

/// Radiance of level, matte ground under a sky of these harmonics, which are those of the upper hemisphere alone.
pub fn of_ground(upper: &HarmonicCoefficients, albedo: f64) -> [f64; 3] {
    on_level_ground(upper).map(|v| albedo * v / PI)
}

/// How the functions reach what they depend on.
#[derive(Clone, Copy)]
pub struct SkyAccess {
    /// Whether the sky is fixed.
    pub fixed: bool,
    /// Whether it has a closed form to draw.
    pub closed: bool,
    /// Whether a state is reached by `->`.
    pub arrow: bool,
}

impl SkyAccess {
    /// The expression of a field.
    pub fn at(self, name: &str) -> String {
        match (self.fixed, self.arrow) {
            (true, _) => format!("SKY_{}", name.to_uppercase()),
            (false, true) => format!("sky->{name}"),
            (false, false) => format!("sky.{name}"),
        }
    }

    /// The first argument of a function, where it needs one.
    pub fn takes(self) -> Vec<(ValueType, &'static str)> {
        if self.fixed { Vec::new() } else { vec![(ValueType::State, "sky")] }
    }
}

/// Writes the state's type.
pub fn describe(text: &mut SourceText, bands: usize, closed: bool) {
    text.says("All that depends on the sky and not on the direction: make it once for a sky, by sky_at.");
    let all = fields(bands, closed);
    let rows: Vec<_> = all.iter().map(|f| (f.kind, f.name, f.count, f.says)).collect();
    text.state(&rows);
}

/// Writes the constants of one sky.
///
/// # Errors
/// What the model refuses.
pub fn constants(text: &mut SourceText, sky: &SkyConstants, closed: bool) -> Result<(), SkyRefusal> {
    for field in fields(sky.harmonics.bands(), closed) {
        if !field.says.is_empty() {
            text.says(field.says);
        }
        let (name, values) = (format!("SKY_{}", field.name.to_uppercase()), sky.values(field.name)?);
        match (field.kind, field.count) {
            (ValueType::Triple, 1..) => text.triples(&name, &values),
            (ValueType::Triple, _) => {
                let [x, y, z] = values[0].map(|v| text.number(v));
                let value = text.language.triple([&x, &y, &z]);
                text.constant(field.kind, &name, &value);
            }
            _ => {
                let value = text.number(values[0][0]);
                text.constant(field.kind, &name, &value);
            }
        }
    }
    text.gap();
    Ok(())
}
