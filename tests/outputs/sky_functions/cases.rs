//! Skies and directions that the exported functions are asked for, and what the library says of them.

use mesophyll::sky::harmonics::{HarmonicBasis, rotate_z};
use mesophyll::sky::irradiance::{add_ground, convolved, on_level_ground};
use mesophyll::sky::{HarmonicCoefficients, Preetham, Sky, sun};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// What is asked for in every direction: radiance, irradiance, the sky as it is drawn, the sun's disk.
pub const ANSWERS: usize = 4;
/// Directions a sky.
pub const DIRECTIONS: usize = 27;
/// Numbers given a sky: zenith angle, turbidity, cosine and sine of the azimuth, and the directions.
pub const GIVEN: usize = 4 + 3 * DIRECTIONS;

/// A sun and a turbidity, and directions to look into, rounded to single precision as shaders get them.
pub struct Case {
    pub zenith: f64,
    pub turbidity: f64,
    pub azimuth: f64,
    pub given: Vec<f32>,
}

impl Case {
    pub fn new(zenith: f64, turbidity: f64, azimuth: f64) -> Case {
        Case::with(zenith, turbidity, azimuth, directions)
    }

    /// With directions of one's own, made from the sun's zenith angle and azimuth.
    pub fn with(zenith: f64, turbidity: f64, azimuth: f64, into: impl Fn(f64, f64) -> Vec<[f64; 3]>) -> Case {
        let [zenith, turbidity] = [zenith, turbidity].map(|v| v as f32);
        let [cos, sin] = [azimuth.cos(), azimuth.sin()].map(|v| v as f32);
        let mut given = vec![zenith, turbidity, cos, sin];
        let azimuth = f64::from(sin).atan2(f64::from(cos));
        for d in into(f64::from(zenith), azimuth) {
            given.extend(d.map(|v| v as f32));
        }
        assert_eq!(given.len(), GIVEN);
        Case { zenith: f64::from(zenith), turbidity: f64::from(turbidity), azimuth, given }
    }

    pub fn directions(&self) -> impl Iterator<Item = [f64; 3]> + '_ {
        self.given[4..].chunks_exact(3).map(|d| [d[0], d[1], d[2]].map(f64::from))
    }
}

fn unit(theta: f64, phi: f64) -> [f64; 3] {
    [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()]
}

/// A spiral over the whole sphere, the horizon, the sun, beside its disk and within it, and the point opposite.
fn directions(zenith: f64, azimuth: f64) -> Vec<[f64; 3]> {
    let spiral = (0..18).map(|k| {
        let z = 1.0 - (2 * k + 1) as f64 / 18.0;
        unit(z.acos(), 2.4 * k as f64)
    });
    let near = [0.0, 0.2, -0.2, 0.34, -0.34].map(|deg: f64| unit(zenith + deg.to_radians(), azimuth));
    let edge = [(FRAC_PI_2 - 1e-5, 0.4), (FRAC_PI_2 - 0.02, 4.0), (0.0, 0.0), (PI - zenith, azimuth + PI)];
    spiral.chain(near).chain(edge.map(|(theta, phi)| unit(theta, phi))).collect()
}

/// Suns from the zenith to the horizon at several azimuths, and turbidities over the whole range.
pub fn all() -> Vec<Case> {
    let suns = [0.0, 0.2, 0.5, 0.785, 1.0, 1.2, 1.4, 1.5, 1.56, FRAC_PI_2];
    let turbidities = [2.5, 2.7, 3.3, 4.2, 5.1, 6.0];
    let pairs = suns.iter().flat_map(|s| turbidities.map(|t| (*s, t)));
    pairs.enumerate().map(|(k, (s, t))| Case::new(s, t, [0.0, 1.1, 2.9, -1.7][k % 4])).collect()
}

/// The largest differences to the library, each relative to what it says.
#[derive(Debug, Default, Clone, Copy)]
pub struct Differences {
    /// Of the harmonics, over c00 of their sky.
    pub harmonics: f64,
    /// Of radiance, over the sky's mean, and of irradiance, over that of level ground.
    pub lighting: f64,
    /// Of the sky as it is drawn, over its largest channel in the same direction.
    pub drawn: f64,
    /// Of the sun's direction, and of its light and disk over their largest channel.
    pub sun: f64,
}

impl std::fmt::Display for Differences {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let Differences { harmonics, lighting, drawn, sun } = self;
        write!(f, "harmonics {harmonics:.1e}, lighting {lighting:.1e}, drawn {drawn:.1e}, sun {sun:.1e}")
    }
}

/// Compares the numbers that a language gave with the library: for every sky its harmonics, the sun's direction and
/// light, and the answers for every direction.
pub fn compare(
    got: &[f64],
    cases: &[Case],
    albedo: f64,
    coefficients: impl Fn(&Case) -> HarmonicCoefficients,
) -> Differences {
    assert_eq!(got.len(), cases.len() * 3 * (49 + 2 + ANSWERS * DIRECTIONS));
    assert!(got.iter().all(|v| v.is_finite()));
    let mut at = got.chunks_exact(3);
    let mut out = Differences::default();
    for case in cases {
        let mut off = |want: [f64; 3], over: [f64; 3]| {
            let found = at.next().unwrap();
            (0..3).map(|k| (found[k] - want[k]).abs() / over[k]).fold(0.0, f64::max)
        };
        let upper = coefficients(case);
        let c = if albedo > 0.0 { add_ground(&upper, [albedo; 3], [0.0; 3]) } else { upper.clone() };
        for want in c.values() {
            out.harmonics = out.harmonics.max(off(*want, c.get(0, 0)));
        }
        let turned = rotate_z(&c, case.azimuth);
        let (basis, weighted) = (HarmonicBasis::new(7), convolved(&turned));
        let level = on_level_ground(&upper);
        let mean = c.get(0, 0).map(|v| v / (2.0 * PI.sqrt()));
        let sky = Preetham.at(case.zenith, case.turbidity).unwrap();
        let light = sun::irradiance(case.zenith.min(FRAC_PI_2), case.turbidity);
        let largest = |v: [f64; 3]| [v.into_iter().fold(1e-300, |a: f64, b| a.max(b.abs())); 3];
        let toward = unit(case.zenith, case.azimuth);
        out.sun = out.sun.max(off(toward, [1.0; 3]));
        out.sun = out.sun.max(off(light, largest(light)));
        let radius = sun::RADIUS_DEG.to_radians();
        let disk = light.map(|v| v / (PI * radius.sin().powi(2)));
        for d in case.directions() {
            out.lighting = out.lighting.max(off(basis.sum(&turned, d), mean));
            out.lighting = out.lighting.max(off(basis.sum(&weighted, d), level));
            let (sin, cos) = case.azimuth.sin_cos();
            let own = [d[0] * cos + d[1] * sin, d[1] * cos - d[0] * sin, d[2]];
            let want = if d[2] < 0.0 { level.map(|v| albedo * v / PI) } else { sky.rgb(own) };
            out.drawn = out.drawn.max(off(want, largest(want)));
            let cosine: f64 = (0..3).map(|k| d[k] * toward[k]).sum();
            let seen = d[2] >= 0.0 && cosine.clamp(-1.0, 1.0).acos() < radius;
            out.sun = out.sun.max(off(if seen { disk } else { [0.0; 3] }, largest(disk)));
        }
    }
    out
}

/// Directions and weights of ∫ L max(0, n·d) dω, exact for seven bands: the rule's pole is the normal, so that the edge
/// of the cosine is where it ends.
pub fn cosine_rule(n: [f64; 3]) -> Vec<([f64; 3], f64)> {
    let cross =
        |a: [f64; 3], b: [f64; 3]| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let up = if n[2].abs() < 0.9 { [0.0, 0.0, 1.0] } else { [1.0, 0.0, 0.0] };
    let across = cross(up, n);
    let length = across.iter().map(|v| v * v).sum::<f64>().sqrt();
    let t = across.map(|v| v / length);
    let b = cross(n, t);
    let mut out = Vec::new();
    for &(x, w) in mesophyll::sky::quadrature::gauss(9).iter() {
        let mu: f64 = 0.5 * (1.0 + x);
        let s = (1.0 - mu * mu).sqrt();
        for k in 0..24 {
            let phi = TAU * (f64::from(k) + 0.5) / 24.0;
            let d = std::array::from_fn(|i| s * phi.cos() * t[i] + s * phi.sin() * b[i] + mu * n[i]);
            out.push((d, 0.5 * w * mu * TAU / 24.0));
        }
    }
    out
}
