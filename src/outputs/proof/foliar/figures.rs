//! The numbers behind the pictures of `docs/foliar.md`, which show what B1 shows in its Fig. 3 to 5.

use mesophyll_optics::foliar::goniometer::{Goniometer, RINGS, SECTORS};
use mesophyll_optics::foliar::{LayeredLeaf, fsm, walk};
use mesophyll_optics::side::Side;

/// For the model's red, green and blue: the wavelength (nm), and the absorption of one crossing of the soybean leaf's
/// mesophyll there. The latter is 43.62 µg/cm² of chlorophyll (B1, Table 1) times the specific absorption of the public
/// ABM program.
pub const SOYBEAN: [(f64, f64); 3] = [(608.0, 0.8872), (551.0, 0.5147), (465.0, 1.8975)];
/// Chlorophyll of a vein as a share of the leaf's (B1).
pub const VEIN: f64 = 0.1;
/// Rays of each polar plot.
const RAYS: u64 = 8_000_000;

/// A curve of a plot over the angle of incidence or of view (degrees).
#[derive(Debug, Clone, PartialEq)]
pub struct FoliarProofCurve {
    /// What it shows.
    pub name: String,
    /// Angle (degrees) and value.
    pub points: Vec<(f64, f64)>,
}

/// Reflectance and transmittance of leaf and vein over the angle of incidence, a curve a colour: Fig. 3 and 4.
pub fn tables() -> [(&'static str, Vec<FoliarProofCurve>); 4] {
    let curves = |scale: f64, pick: fn(&fsm::FoliarShares) -> f64| -> Vec<FoliarProofCurve> {
        let one = |&(wavelength, depth): &(f64, f64)| FoliarProofCurve {
            name: format!("{wavelength:.0} nm"),
            points: fsm::table(&LayeredLeaf::soybean(depth * scale))
                .unwrap_or_default()
                .iter()
                .enumerate()
                .map(|(k, s)| (k as f64, pick(s)))
                .collect(),
        };
        SOYBEAN.iter().map(one).collect()
    };
    [
        ("leaf: reflected from inside", curves(1.0, |s| s.diffuse)),
        ("leaf: let through", curves(1.0, |s| s.through)),
        ("vein: reflected from inside", curves(VEIN, |s| s.diffuse)),
        ("vein: let through", curves(VEIN, |s| s.through)),
    ]
}

/// The goniometer's readings in the plane of incidence: the angle from the lit side's normal (−180° to 180°, positive
/// on the mirror side), and BRDF or BTDF (1/sr). Each reading is the mean of the two patches next to the plane.
pub fn in_plane(value: impl Fn(usize, usize) -> f64) -> Vec<(f64, f64)> {
    let half = SECTORS / 2;
    let both = |ring: usize, sector: usize| 0.5 * (value(ring, sector) + value(ring, (sector + SECTORS - 1) % SECTORS));
    let angle = |ring: usize| (ring as f64 + 0.5) * 180.0 / RINGS as f64;
    let mut points: Vec<(f64, f64)> = (0..RINGS).rev().map(|r| (-angle(r), both(r, 0))).collect();
    points.extend((0..RINGS).map(|r| (angle(r), both(r, half))));
    points
}

/// Polar plots of the leaf lit at an angle (degrees), by the ABM and by the FSM: Fig. 5.
pub fn lobes(side: Side, incidence: f64) -> [Vec<FoliarProofCurve>; 2] {
    let at = incidence.to_radians();
    let mut both = [Vec::new(), Vec::new()];
    for (wavelength, depth) in SOYBEAN {
        let leaf = LayeredLeaf::soybean(depth);
        let seen: Goniometer = walk::directions(&leaf, side, at, RAYS, 1, &|| false);
        let shares = {
            let (surface, n) = (leaf.surface_reflectance(at), seen.counts.rays as f64);
            let diffuse = seen.counts.reflected as f64 / n - surface;
            fsm::FoliarShares { surface, diffuse, through: seen.counts.transmitted as f64 / n }
        };
        let ob = leaf.oblateness.cuticle;
        let model =
            |r: usize, s: usize| fsm::patch(at, ob, shares, r, s) / mesophyll_optics::foliar::goniometer::projected(r);
        let name = format!("{wavelength:.0} nm");
        both[0].push(FoliarProofCurve { name: name.clone(), points: in_plane(|r, s| seen.reading(r, s).bdf.0) });
        both[1].push(FoliarProofCurve { name, points: in_plane(model) });
    }
    both
}
