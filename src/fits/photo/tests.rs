//! Reduced photographs of a leaf that is known in closed form.

use super::*;
use mesophyll_base::rgb::Rgb;
use mesophyll_capture::photo::{PhotoSideMaps, PictureScale, SensorNoise};
use mesophyll_optics::side::Sides;
use mesophyll_optics::slab::medium::response;

const N: usize = 24;

fn manifest() -> PhotoManifest {
    toml::from_str(
        r#"
        schema = 1
        kind = "photo"
        name = "x"
        thickness_mm = 0.2
        thickness_err_mm = 0.008
        card = { reflectance = 0.18, reflectance_err = 0.0 }
        background = { reflectance = 0.04, reflectance_err = 0.0 }
        ruler = { marks_px = [[0.0, 0.0], [90.0, 0.0]], length_mm = 50.0 }
        front = { file = "a.exr", card = [0, 0, 9, 9] }
        back = { file = "b.exr", card = [0, 0, 9, 9] }
        light_table = { leaf = "c.exr", bare = "d.exr", reflectance = 0.3, reflectance_err = 0.1 }
        "#,
    )
    .unwrap()
}

const SIGMA: [[f64; 2]; 3] = [[12.0, 6.0], [4.0, 12.0], [20.0, 5.0]];

/// Both sides of an even leaf with noise `error` in ρd and ρt, a channel each; `shared` is the error that all texels
/// share: relative of ρd, absolute of ρd, relative of ρt.
fn reduced(change: impl Fn(usize, usize, &mut [f64; 2]), error: [[f64; 2]; 3], shared: [f64; 3]) -> PhotoMaps {
    let (mut rho_d, mut rho_t) = (Vec::new(), Vec::new());
    for k in 0..N * N {
        let pair = Rgb::of(|c| {
            let r = response(SIGMA[c][0], SIGMA[c][1], 0.2);
            let mut pair = [r.rho_d, r.rho_t];
            change(k, c, &mut pair);
            pair
        });
        rho_d.push(pair.map(|p| p[0]));
        rho_t.push(pair.map(|p| p[1]));
    }
    let side = PhotoSideMaps {
        rho_d,
        rho_d_err: vec![Rgb(error).map(|e| e[0]); N * N],
        alike: shared[0],
        shared: Rgb::splat(shared[1]),
        rho_t,
        rho_t_err: vec![Rgb(error).map(|e| e[1]); N * N],
        rho_t_shared: Rgb::splat(shared[2]),
        rho_t_seen: true,
        gloss: mesophyll_capture::dome::highlight::estimate(&[], &[], Some(1.4)),
        status: vec![1; N * N],
        figures: std::collections::BTreeMap::new(),
    };
    PhotoMaps {
        width: N,
        height: N,
        texel_mm: 0.5,
        scale: PictureScale { pixel_mm: 0.25, relative_err: 0.01, by_ticks: false },
        origin: [0; 2],
        step: 2,
        mask: vec![true; N * N],
        sides: Sides { front: side.clone(), back: side },
        noise: SensorNoise::stated(1e-4, 0.0),
    }
}

/// A normal deviate of its own for every texel and purpose.
fn normal(seed: usize) -> f64 {
    use rand::{RngExt, SeedableRng};
    let mut rng = rand_pcg::Pcg64::seed_from_u64(seed as u64);
    let (a, b): (f64, f64) = (rng.random(), rng.random());
    (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
}

/// Without noise, a texel of an even leaf is known as well as the leaf: its errors hold what all texels share.
#[test]
fn errors_of_a_texel_hold_what_all_share() {
    let (manifest, folder) = (manifest(), Path::new("capture"));
    let reduced = reduced(|_, _, _| {}, [[1e-7; 2]; 3], [0.02, 0.002, 0.015]);
    let sides = [Side::Front, Side::Back].map(|s| interior(folder, &manifest, &reduced, s).unwrap());
    let mut sides = sides;
    share(&manifest, &reduced, &mut sides, &mut crate::record::FitRecord::default());
    for c in 0..3 {
        for q in 0..2 {
            let of_leaf = sides[0].relative[q][c];
            let of_texel = sides[0].sigma[100][c].error[q] / sides[0].sigma[100][c].value[q];
            println!("{c} {q}: leaf {of_leaf:.4}, texel {of_texel:.4}");
            assert!(of_leaf > 0.04, "the caliper's error alone is 4 %");
            assert!((of_texel / of_leaf - 1.0).abs() < 0.1, "{c} {q}: {of_texel} {of_leaf}");
        }
    }
}

/// In blue nothing but noise comes through, and in red nothing but noise is reflected. Neither is called determined,
/// and green is.
#[test]
fn what_is_nothing_but_noise_is_undetermined() {
    let (manifest, folder) = (manifest(), Path::new("capture"));
    let change = |k: usize, c: usize, pair: &mut [f64; 2]| match c {
        0 => pair[0] = 2e-3 * normal(3 * k),
        1 => *pair = [pair[0] + 1e-3 * normal(3 * k + 1), pair[1] + 1e-3 * normal(3 * k + 7000)],
        _ => pair[1] = 1e-3 * normal(3 * k + 2),
    };
    let reduced = reduced(change, [[2e-3, 1e-3], [1e-3, 1e-3], [1e-3, 1e-3]], [0.01, 1e-4, 0.01]);
    let found = interior(folder, &manifest, &reduced, Side::Front).unwrap();
    println!("{:?}", found.relative);
    assert!((0..2).all(|q| found.relative[q][2].is_infinite()), "blue: {:?}", found.relative);
    // The mean of ρd is all due to the cut at zero, .4 of an error; σs is known to nothing better than itself.
    assert!(found.relative[1][0] > 0.4, "red σs: {:?}", found.relative);
    assert!(found.relative[0][1] < 0.05 && found.relative[1][1] < 0.05, "green: {:?}", found.relative);
}
