//! Traces of known texels with seeded noise, for stress cases, benchmarks and tests. They are made by the plain model
//! with many nodes, not by the fast model of the fit.

use super::{GlossFitDevice, normal_of};
use mesophyll_optics::gloss::Lobe;
use mesophyll_optics::tube::{Travel, TubeModel, TubePrecision};
use rand::{RngExt, SeedableRng};

/// A texel whose parameters are known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GlossFitTruth {
    /// Diffuse reflectance ρd, 0 to 1, a channel each.
    pub rho_d: [f64; 3],
    /// Gloss reflectance ρs, a channel each.
    pub rho_s: [f64; 3],
    /// Slope of the gloss.
    pub m: f64,
    /// tilt, tilt_y (rad).
    pub tilt: [f64; 2],
}

/// Texels of a leaf for designs: place on the blade (mm), m, and tilts (rad).
pub const LEAF: [([f64; 2], f64, [f64; 2]); 6] = [
    ([-30.0, 10.0], 0.15, [0.05, -0.1]),
    ([30.0, -12.0], 0.22, [-0.1, 0.08]),
    ([0.0, 0.0], 0.3, [0.15, 0.02]),
    ([12.0, 18.0], 0.18, [-0.03, 0.15]),
    ([-15.0, -20.0], 0.25, [0.0, 0.0]),
    ([25.0, 5.0], 0.2, [0.1, -0.05]),
];

/// The default device: 100 mm high, 500 mm long, 2.5 mm radius, camera at 55°, floor 5e-4.
pub fn device(lobe: Lobe, noise_relative: f64) -> GlossFitDevice {
    let camera = 55f64.to_radians();
    GlossFitDevice {
        height_mm: 100.0,
        length_mm: 500.0,
        radius_mm: 2.5,
        camera: [camera.sin(), 0.0, camera.cos()],
        lobe,
        noise_relative,
        noise_floor: 5e-4,
    }
}

/// `n` positions from `from` to `to` (mm), both included.
pub fn ramp(from: f64, to: f64, n: usize) -> Vec<f64> {
    (0..n).map(|k| from + (to - from) * k as f64 / (n.max(2) - 1) as f64).collect()
}

/// Pass x of the default scan: u from −4 to 2.5.
pub fn pass_x(frames: usize) -> Vec<f64> {
    ramp(-400.0, 250.0, frames)
}

/// Seeded Gaussian deviates (Box & Muller).
pub struct GaussianDeviates(rand_pcg::Pcg64);

impl GaussianDeviates {
    /// Noise that this seed decides.
    pub fn new(seed: u64) -> GaussianDeviates {
        GaussianDeviates(rand_pcg::Pcg64::seed_from_u64(seed))
    }
    /// The next standard normal number.
    pub fn normal(&mut self) -> f64 {
        let (a, b): (f64, f64) = (self.0.random(), self.0.random());
        (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
    }
    /// Uniform on [from, to).
    pub fn uniform(&mut self, from: f64, to: f64) -> f64 {
        from + (to - from) * self.0.random::<f64>()
    }
}

/// The trace that the device records of a texel `truth`, with noise if it is given.
pub fn trace(
    device: &GlossFitDevice,
    travel: Travel,
    positions_mm: &[f64],
    texel_mm: [f64; 2],
    truth: &GlossFitTruth,
    mut noise: Option<&mut GaussianDeviates>,
) -> Vec<[f32; 3]> {
    let model = TubeModel::new(device.tube(), device.camera, device.lobe, &TubePrecision::fine());
    let normal = normal_of(truth.tilt);
    let mut out = Vec::with_capacity(positions_mm.len());
    for &x in positions_mm {
        let r = model.response(travel, x, texel_mm, normal, truth.m);
        out.push(std::array::from_fn(|c| {
            let value = truth.rho_d[c] * r.d + truth.rho_s[c] * r.s;
            let sd = (device.noise_relative * value).hypot(device.noise_floor);
            (value + noise.as_mut().map_or(0.0, |n| n.normal()) * sd) as f32
        }));
    }
    out
}
