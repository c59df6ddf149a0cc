//! The branches of a scene: their data from the manifest or a fit, their frames and meshes at rest, and how they bend
//! at a time. Everything is in f64. The reference renderer draws these meshes. The GPU renderer gets the same numbers
//! and bends in its own shader.
//!
//! A branch deflects like a tapered beam under an even load ([`mesophyll_plant`]). The load is its weight, towards the
//! ground, the mean wind, along the wind, and gusts. All branches share one motion texture for gusts, each on its own
//! line. Lengths are in mm, and amplitudes in units of a branch's length.

use super::placement::{OnBranch, frame};
use crate::ledger::Ledger;
use crate::{Error, Result};
use glam::{DMat4, DVec3, DVec4};
use mesophyll_files::mesh::LeafMesh;
use mesophyll_fit_branch::beam::basis;
use mesophyll_manifest::Manifest;
use mesophyll_plant::branch::Branch;
use mesophyll_plant::motion::{Motion, Trajectory};
use mesophyll_plant::motion_spectrum::Method;
use mesophyll_plant::wind::{Oscillator, Sway, Wind, resonance};
use mesophyll_record::FitRecord;
use std::f64::consts::{FRAC_PI_2, TAU};

/// Texels along a side of the motion texture. It holds frequencies down to 1/64 of the branch's resonance, and does not
/// repeat within 8,000 of its periods.
pub const MOTION_SIDE: usize = 1024;

/// A branch at rest, as the manifest and its fit describe it.
#[derive(Debug, Clone, PartialEq)]
pub struct Twig {
    /// Place where its axis begins (mm, world).
    pub root: DVec3,
    /// t from root to tip, s across it and as far up as possible, r = s × t.
    pub axes: [DVec3; 3],
    /// Length of the axis (mm).
    pub length: f64,
    /// Radius at the root (mm).
    pub radius: f64,
    /// Tip radius over root radius.
    pub taper: f64,
    /// F/(E′r₁⁴) (mm) under its own weight if it were horizontal.
    pub load: f64,
    /// Diffuse reflectance of each channel.
    pub bark: [f64; 3],
}

/// All branches at rest. Taper and load come from a fit where the manifest names one.
///
/// # Errors
/// [`Error::Input`] for a fit that cannot be read, or that did not determine a needed quantity.
pub fn twigs(manifest: &Manifest, ledger: &Ledger) -> Result<Vec<Twig>> {
    manifest
        .branches
        .iter()
        .map(|b| {
            let (root, axes) = frame(b);
            let (taper, load) = match &b.fit {
                None => (b.taper.unwrap_or(1.0), b.load_over_stiffness_mm.unwrap_or(0.0)),
                Some(folder) => fitted(manifest, b, &manifest.resolve(folder), ledger)?,
            };
            Ok(Twig { root, axes, length: b.length_mm, radius: b.radius_mm, taper, load, bark: b.bark })
        })
        .collect()
}

/// Taper and load of a measured branch.
fn fitted(
    manifest: &Manifest,
    b: &mesophyll_manifest::Branch,
    folder: &std::path::Path,
    ledger: &Ledger,
) -> Result<(f64, f64)> {
    let record = ledger.note("read", format!("{}/fit.toml", b.name), 0, || FitRecord::read(folder))?;
    let measured = b.measured.as_deref().unwrap_or(&b.name);
    let name = format!("branch {measured}");
    let place = folder.join("fit.toml");
    let Some(section) = record.sections.get(&name) else {
        let known: Vec<&str> = record.sections.keys().filter_map(|k| k.strip_prefix("branch ")).collect();
        let what = format!(
            "found no branch \"{measured}\", expected one of {} ({})",
            known.join(", "),
            manifest.path.display()
        );
        return Err(Error::field(&place, &name, what));
    };
    let one = |key: &str| match section.params.get(key) {
        Some(p) if p.undetermined.is_empty() && p.value.first().is_some_and(|v| v.is_finite()) => Ok(p.value[0]),
        Some(p) if !p.undetermined.is_empty() => {
            Err(Error::field(&place, &format!("{name}, {key}"), p.undetermined.join("; ")))
        }
        _ => Err(Error::field(&place, &format!("{name}, {key}"), "missing, expected a fitted number")),
    };
    Ok((one("alpha")?, one("load_over_stiffness")?))
}

/// Whether anything bends: a load, or a wind that some branch leans in.
pub fn moves(manifest: &Manifest, twigs: &[Twig]) -> bool {
    twigs.iter().any(|t| t.load != 0.0) || sways(manifest)
}

/// Whether there is a wind that some branch sways in.
pub fn sways(manifest: &Manifest) -> bool {
    manifest.wind.as_ref().is_some_and(|w| w.speed_m_s > 0.0) && manifest.branches.iter().any(|b| b.lean_per_m_s > 0.0)
}

/// The time at which a view shows the scene (s).
pub fn time(manifest: &Manifest, view: &mesophyll_manifest::View) -> f64 {
    view.time_s.unwrap_or_else(|| rest_time(manifest))
}

/// The time at which a scene opens (s).
pub fn rest_time(manifest: &Manifest) -> f64 {
    manifest.wind.as_ref().map_or(0.0, |w| w.time_s)
}

/// One branch that bends.
#[derive(Debug, Clone)]
pub struct Bending {
    /// Its shape without load and wind.
    pub rest: Branch<f64>,
    /// Amplitude towards r and s by weight and mean wind.
    pub still: [f64; 2],
    /// Amplitude for 1 in the motion texture.
    pub gain: f64,
    /// Its line through the motion texture.
    pub line: Option<Trajectory>,
}

/// All branches of a scene in which something bends.
#[derive(Debug, Clone)]
pub struct Bends {
    /// The branches, in the manifest's order.
    pub branches: Vec<Bending>,
    /// The texture that moves them; `None` where there is no wind.
    pub motion: Option<Motion>,
}

/// The strength of a gust, in standard deviations, under which the length of a branch must still be kept.
const STRONGEST: f64 = 4.0;

impl Bends {
    /// `twigs` is the result of the function [`twigs`]. The coefficients come from the beam fit, and the gusts from one
    /// motion texture.
    ///
    /// # Errors
    /// [`Error::Input`] for a branch whose tip would move further than its length, or whose sway has no spectrum.
    pub fn new(manifest: &Manifest, twigs: &[Twig], ledger: &Ledger) -> Result<Bends> {
        // The coefficients of all tapers are fitted at most once during a run of the program.
        if ledger.count("fit", "beam") == 0 {
            ledger.note("fit", "beam", 0, basis::smooth);
        }
        let wrong = |k: usize, what: String| {
            Error::field(&manifest.path, &format!("branch \"{}\"", manifest.branches[k].name), what)
        };
        let sways: Vec<Option<Sway>> = manifest.branches.iter().map(|b| sway(manifest, b)).collect();
        let lead = sways.iter().flatten().next().copied();
        let seed = manifest.wind.as_ref().map_or(0, |w| w.seed);
        let motion = match lead {
            None => None,
            Some(sway) => {
                let make = || Motion::new(|f| sway.spectrum(f), sway.highest(), MOTION_SIDE, seed, Method::Directed);
                let made = ledger.note("make", "motion texture", (MOTION_SIDE * MOTION_SIDE * 8) as u64, make);
                let missing = || {
                    Error::field(
                        &manifest.path,
                        "wind",
                        "the branches' sway has no spectrum that is positive and finite",
                    )
                };
                Some(made.ok_or_else(missing)?)
            }
        };
        let mut branches = Vec::new();
        for (k, (twig, sway)) in twigs.iter().zip(&sways).enumerate() {
            let [t, r, s] = twig.axes.map(|v| v.to_array());
            let shape = basis::shape(twig.taper);
            let rest = Branch { root: twig.root.to_array(), t, r, s, length: twig.length, shape };
            let whole = shape.tip();
            // Only the weight's component across the branch bends it.
            let weight = [1, 2].map(|axis| -twig.axes[axis].z * twig.load / twig.length);
            let (mut still, mut gain, mut line) = (weight, 0.0, None);
            if let (Some(sway), Some(lead), Some(motion)) = (sway, &lead, &motion) {
                let lean = sway.steady(wind_direction(manifest).to_array(), r, s);
                still = [0, 1].map(|c| still[c] + lean[c] / whole);
                gain = (variance(sway) / variance(lead)).sqrt() / whole;
                line = Some(motion.trajectory(
                    seed.wrapping_add(1 + k as u64),
                    sway.oscillator.resonance / lead.oscillator.resonance,
                ));
            }
            let gusts = sway.as_ref().map_or(0.0, |s| STRONGEST * variance(s).sqrt());
            let tip = whole * still[0].hypot(still[1]);
            if (tip + gusts).is_nan() || tip + gusts > 1.0 {
                return Err(wrong(
                    k,
                    format!(
                        "its tip goes by {tip:.2} of its length and {gusts:.2} more in gusts, expected at most 1 in all"
                    ),
                ));
            }
            branches.push(Bending { rest, still, gain, line });
        }
        Ok(Bends { branches, motion })
    }

    /// Amplitude of branch `k` towards r and s at a time (s).
    pub fn amplitude(&self, k: usize, time: f64) -> [f64; 2] {
        let b = &self.branches[k];
        match (&self.motion, &b.line) {
            (Some(motion), Some(line)) => {
                let gust = motion.sample(line.at(time));
                [0, 1].map(|c| b.still[c] + b.gain * gust[c])
            }
            _ => b.still,
        }
    }

    /// The tip of branch `k` at a time (s), in mm.
    pub fn tip(&self, k: usize, time: f64) -> [f64; 3] {
        self.branches[k].rest.joint(self.amplitude(k, time), 1.0).position
    }

    /// The transform of something that hangs on a branch: that at rest, moved with the branch.
    pub fn transform(&self, ride: OnBranch, time: f64, rest: DMat4) -> DMat4 {
        let branch = &self.branches[ride.branch].rest;
        let joint = branch.joint(self.amplitude(ride.branch, time), ride.at);
        let turn = |v: DVec4| DVec3::from(branch.turn(&joint, v.truncate().to_array())).extend(0.0);
        let place = DVec3::from(branch.carry(&joint, ride.at, rest.w_axis.truncate().to_array())).extend(1.0);
        DMat4::from_cols(turn(rest.x_axis), turn(rest.y_axis), turn(rest.z_axis), place)
    }

    /// The mesh of branch `k`, bent.
    pub fn mesh(&self, k: usize, time: f64, rest: &LeafMesh) -> LeafMesh {
        let (branch, amplitude) = (&self.branches[k].rest, self.amplitude(k, time));
        let mut out = rest.clone();
        for v in 0..rest.positions.len() {
            let (p, n, (t, _)) = (rest.positions[v], rest.normals[v], rest.tangents[v]);
            let moved = branch.deform(amplitude, p.to_array(), t.to_array(), n.to_array());
            out.positions[v] = moved.position.into();
            out.normals[v] = moved.normal.into();
            out.tangents[v].0 = moved.tangent.into();
        }
        out
    }
}

fn sway(manifest: &Manifest, b: &mesophyll_manifest::Branch) -> Option<Sway> {
    let wind = manifest.wind.as_ref().filter(|w| w.speed_m_s > 0.0 && b.lean_per_m_s > 0.0)?;
    let f = b.resonance_hz.unwrap_or_else(|| resonance(b.length_mm / 1000.0, false));
    Some(Sway {
        wind: Wind { speed: wind.speed_m_s, turbulence: wind.turbulence },
        // `damping` is relative to the critical damping 4π f_h.
        oscillator: Oscillator { resonance: f, damping: b.damping * 2.0 * TAU * f },
        lean: b.lean_per_m_s * wind.speed_m_s,
    })
}

/// Variance of the tip's deflection over the length, for the frequencies that a motion texture holds.
pub(super) fn variance(sway: &Sway) -> f64 {
    let count = MOTION_SIDE / mesophyll_plant::motion::TEXELS_A_CYCLE;
    let step = sway.highest() / count as f64;
    (1..=count).map(|j| sway.spectrum(j as f64 * step) * step).sum()
}

/// The direction that the wind blows to.
pub(super) fn wind_direction(manifest: &Manifest) -> DVec3 {
    let azimuth = manifest.wind.as_ref().map_or(0.0, |w| w.azimuth_deg.to_radians());
    DVec3::new(azimuth.cos(), azimuth.sin(), 0.0)
}

/// Numbers of sides of a branch's mesh, of rings along it, and of rings in each rounded end.
const SIDES: usize = 16;
const RINGS: usize = 48;
const CAP: usize = 4;

/// A branch's mesh at rest in world space: a cone with rounded ends. Normals point outward, u goes around, and v from
/// root to tip.
pub fn tube(twig: &Twig) -> LeafMesh {
    let [t, r, s] = twig.axes;
    let (thick, thin) = (twig.radius, twig.radius * twig.taper);
    let slope = (thin - thick) / twig.length;
    // Each ring has a distance along the axis, a radius, and the component of its normal along the axis.
    let mut rings: Vec<[f64; 3]> = Vec::new();
    let round = |k: usize| (FRAC_PI_2 * k as f64 / CAP as f64).sin_cos();
    rings.extend((0..CAP).map(|k| {
        let (sin, cos) = round(k);
        [-thick * cos, thick * sin, -cos]
    }));
    let lean = -slope / slope.hypot(1.0);
    rings.extend((0..=RINGS).map(|k| {
        let x = k as f64 / RINGS as f64;
        [x * twig.length, thick + (thin - thick) * x, lean]
    }));
    rings.extend((0..CAP).rev().map(|k| {
        let (sin, cos) = round(k);
        [twig.length + thin * cos, thin * sin, cos]
    }));
    let mut mesh = LeafMesh::default();
    for (row, [along, radius, tilt]) in rings.iter().enumerate() {
        for i in 0..=SIDES {
            let (sin, cos) = (TAU * i as f64 / SIDES as f64).sin_cos();
            let (out, around) = (r * cos + s * sin, s * cos - r * sin);
            mesh.positions.push(twig.root + t * *along + out * *radius);
            mesh.normals.push((out * (1.0 - tilt * tilt).max(0.0).sqrt() + t * *tilt).normalize());
            mesh.tangents.push((around, -1.0));
            mesh.uvs.push(glam::DVec2::new(i as f64 / SIDES as f64, row as f64 / (rings.len() - 1) as f64));
        }
    }
    let width = SIDES as u32 + 1;
    for row in 0..rings.len() as u32 - 1 {
        for i in 0..SIDES as u32 {
            let a = row * width + i;
            mesh.indices.extend([a, a + 1, a + width, a + 1, a + width + 1, a + width]);
        }
    }
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;

    fn twig() -> Twig {
        let b = mesophyll_manifest::Branch {
            direction: [1.0, 0.4, 0.3],
            position_mm: [3.0, -2.0, 1.0],
            ..mesophyll_manifest::Branch::default()
        };
        let (root, axes) = frame(&b);
        Twig { root, axes, length: 150.0, radius: 2.0, taper: 0.3, load: 10.0, bark: [0.1; 3] }
    }

    #[test]
    fn frames_are_right_handed_and_upright() {
        for direction in [[1.0, 0.0, 0.0], [0.3, -0.5, 0.8], [0.0, 0.0, 1.0], [0.0, 0.0, -2.0]] {
            let (_, [t, r, s]) =
                frame(&mesophyll_manifest::Branch { direction, ..mesophyll_manifest::Branch::default() });
            assert!((t.cross(r) - s).length() < 1e-12 && t.dot(s).abs() < 1e-12 && (r.length() - 1.0).abs() < 1e-12);
            assert!(s.z >= -1e-12);
        }
    }

    /// Area and volume of the mesh agree with those of a cone with half balls on its ends, and normals agree with the
    /// facets.
    #[test]
    fn the_mesh_is_a_closed_cone_with_outward_normals() {
        let twig = twig();
        let mesh = tube(&twig);
        let centre = twig.root + twig.axes[0] * 70.0;
        let (mut volume, mut worst) = (0.0, 3.0f64);
        for k in 0..mesh.triangles() {
            let [a, b, c] = mesh.triangle(k);
            let [p, q, r] = [a, b, c].map(|v| mesh.positions[v] - centre);
            let facet = (q - p).cross(r - p);
            volume += p.dot(q.cross(r)) / 6.0;
            if facet.length() > 1e-9 {
                worst = worst.min(facet.normalize().dot(mesh.normals[a] + mesh.normals[b] + mesh.normals[c]));
            }
        }
        let (big, small) = (2.0f64, 0.6f64);
        let pi = std::f64::consts::PI;
        let exact = pi / 3.0 * 150.0 * (big * big + big * small + small * small)
            + 2.0 / 3.0 * pi * (big.powi(3) + small.powi(3));
        // Sixteen chords have 2.6 % less area than the circle.
        assert!((volume / exact - 0.974).abs() < 0.004, "{volume} {exact}");
        assert!(worst > 2.5, "{worst}");
        for (n, (t, _)) in mesh.normals.iter().zip(&mesh.tangents) {
            assert!((n.length() - 1.0).abs() < 1e-12 && n.dot(*t).abs() < 1e-12);
        }
    }
}
