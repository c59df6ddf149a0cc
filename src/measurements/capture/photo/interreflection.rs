//! Light that goes to and fro between the leaf and what lies behind it. It comes from all sides, so it meets other
//! reflectances than a beam along the normal does ([`super::diffuse`]).
//!
//! - On the light table, the underside throws the share ρ of the table's light back, ρ being the slab's and the
//!   surface's reflectance of light from all sides. The table throws r of that up again. So the table behind the leaf
//!   is brighter by 1/(1 − rρ).
//! - In open shade, the sheet sends its reflectance s times what came through the leaf back to the underside, and the
//!   share ρt of that leaves along the normal: s T ρt/(1 − sρ), with T the slab's transmittance of light from all
//!   sides.
//!
//! Both depend on ρd and ρt and change them. They are small, so a few rounds settle it. They are worked out for the
//! leaf's mean; light spreads sideways on its way there and back.

use super::diffuse::over_normal;
use super::gloss::Gloss;
use super::manifest::PhotoManifest;
use mesophyll_base::rgb::Rgb;
use mesophyll_optics::side::{Side, Sides};

/// Rounds; each leaves a tenth of the change of the last one at most.
const ROUNDS: usize = 8;
/// Standard error of T/ρt, and of ρ/ρd of the slab, relative: the leaf's mean stands for places of different thickness.
const MEAN: f64 = 0.05;

/// What is seen of a side on the leaf's mean, a channel each.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen {
    /// Reflectance in open shade with all that adds to it.
    pub shade: Rgb,
    /// Its relative standard error.
    pub shade_err: f64,
    /// Leaf on the light table over bare table.
    pub table: Rgb,
    /// The side that faced the camera then: this side, or the other one where it alone was seen.
    pub up: Side,
}

/// What the other light adds to a side.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Returned {
    /// What the sheet adds in open shade, over the square of ρt; a channel.
    pub sheet: Rgb,
    /// By which share the leaf made the table behind it brighter, when this side's ρt was seen; a channel.
    pub table: Rgb,
    /// Relative standard error of ρt from that.
    pub table_err: Rgb,
    /// Share of light from all sides that this side reflects.
    pub all_round: Rgb,
}

/// What is returned for front and back.
pub(super) fn returned(m: &PhotoManifest, seen: &Sides<Seen>, gloss: &Sides<Gloss>) -> Sides<Returned> {
    let (r, r_err, sheet) = (m.light_table.reflectance, m.light_table.reflectance_err, m.background.reflectance);
    let mut found = Sides::<Returned>::default();
    for c in 0..3 {
        // Light from all sides that each side reflects, and its standard error.
        let mut all_round = Sides::<[f64; 2]>::default();
        for _ in 0..ROUNDS {
            let last = all_round;
            for (side, found) in found.iter_mut() {
                let (seen, gloss) = (&seen[side], &gloss[side]);
                let [under, below] = [seen.up.other(), side.other()].map(|s| last[s][0]);
                let t = seen.table[c] * (1.0 - r * under);
                found.table[c] = r * under / (1.0 - r * under);
                let by_sheet = found.sheet[c] * t * t;
                let d = (seen.shade[c] - gloss.normal.share - by_sheet).max(0.0);
                let [up, down] = over_normal(d, t);
                found.sheet[c] = sheet * down / (1.0 - sheet * below);
                let slab = up * d;
                let by_gloss = gloss.moves - up * gloss.normal.stderr;
                let err = by_gloss.hypot(gloss.all_round_err).hypot(slab * seen.shade_err).hypot(MEAN * slab);
                all_round[side] = [(slab + gloss.all_round).min(0.99), err];
            }
        }
        for (side, found) in found.iter_mut() {
            let [under, err] = all_round[seen[side].up.other()];
            // How far light spreads in the table before it returns is not known. All of it was taken off; anything
            // between none and all of it may be missing, which is r/√3 off in the mean square.
            let spread = r / 3f64.sqrt();
            found.table_err[c] = (under * r_err).hypot(under * spread).hypot(r * err) / (1.0 - r * under);
            found.all_round[c] = all_round[side][0];
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dome::highlight::Highlight;
    use mesophyll_synth::slab_truth::{gauss_legendre, response_at};

    /// A slab of known σ between sheet, table and camera; the truth is solved by doubling, at Gauss's cosines.
    #[test]
    fn a_known_slab_is_found_behind_its_own_light() {
        let text = r#"
            schema = 1
            kind = "photo"
            name = "x"
            thickness_mm = 0.2
            thickness_err_mm = 0.01
            card = { reflectance = 0.18, reflectance_err = 0.0 }
            background = { reflectance = 0.1, reflectance_err = 0.0 }
            ruler = { marks_px = [[0.0, 0.0], [90.0, 0.0]], length_mm = 50.0 }
            front = { file = "a.exr", card = [0, 0, 9, 9] }
            back = { file = "b.exr", card = [0, 0, 9, 9] }
            light_table = { leaf = "c.exr", bare = "d.exr", reflectance = 0.5, reflectance_err = 0.0 }
            "#;
        let m: PhotoManifest = toml::from_str(text).unwrap();
        let (sigma_a, sigma_s, h) = ([20.0, 3.0, 12.0], [4.0, 14.0, 9.0], 0.15);
        let (mirrored, all_round) = (0.028, 0.0768);
        let mut seen = Seen { shade: Rgb::default(), shade_err: 0.0, table: Rgb::default(), up: Side::Front };
        let mut truth = Vec::new();
        for c in 0..3 {
            let at = |mu: f64| response_at(mu, sigma_a[c], sigma_s[c], h);
            let normal = at(1.0);
            let (mut up, mut down) = (0.0, 0.0);
            for (x, w) in gauss_legendre(12) {
                let mu = 0.5 * (x + 1.0);
                up += w * mu * at(mu).rho_d;
                down += w * mu * at(mu).rho_t;
            }
            let under = up + all_round;
            seen.table[c] = normal.rho_t / (1.0 - 0.5 * under);
            seen.shade[c] = normal.rho_d + mirrored + 0.1 * down * normal.rho_t / (1.0 - 0.1 * under);
            truth.push((normal, under));
        }
        let normal = Highlight { share: mirrored, stderr: 0.0, at_most: 1.0, stated: true };
        let gloss = Gloss { normal, all_round, moves: 0.0, all_round_err: 0.0 };
        let seen_both = Sides { front: seen, back: Seen { up: Side::Back, ..seen } };
        for (_, found) in returned(&m, &seen_both, &Sides { front: gloss, back: gloss }).iter() {
            for (c, (slab, under)) in truth.iter().enumerate() {
                let t = seen.table[c] / (1.0 + found.table[c]);
                let d = seen.shade[c] - mirrored - found.sheet[c] * t * t;
                println!(
                    "{c}: ρt {t:.5} {:.5}, ρd {d:.5} {:.5}, all round {:.5} {under:.5}",
                    slab.rho_t, slab.rho_d, found.all_round[c]
                );
                assert!((t / slab.rho_t - 1.0).abs() < 1e-3, "{t} {}", slab.rho_t);
                assert!((d / slab.rho_d - 1.0).abs() < 2e-3, "{d} {}", slab.rho_d);
                assert!((found.all_round[c] / under - 1.0).abs() < 2e-3);
                // The reflectance along the normal, which is what open shade shows, says too little by far.
                let along = slab.rho_d + mirrored;
                let off = (1.0 - 0.5 * along) / (1.0 - 0.5 * under) - 1.0;
                assert!(off > 0.01, "{off}");
            }
        }
    }
}
