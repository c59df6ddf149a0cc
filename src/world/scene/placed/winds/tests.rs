//! Spectra of swaying branches, loads that bend them, and what is refused.

use super::*;
use std::f64::consts::TAU;

pub fn scene(speed: f64) -> (SceneManifest, Vec<PlacedPlant>) {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../data/scenes/plant.toml");
    let mut manifest = SceneManifest::read(&root).unwrap();
    manifest.wind = Some(crate::manifest::SceneWind {
        speed_m_s: speed,
        azimuth_deg: 30.0,
        turbulence: 0.3,
        seed: 7,
        time_s: 0.0,
        simplified: false,
    });
    let planted = crate::placed::plant::planted(&manifest, &Ledger::new()).unwrap();
    (manifest, planted)
}

fn winds(speed: f64) -> (Vec<PlacedPlant>, SwayingPlants) {
    let (manifest, planted) = scene(speed);
    let winds = SwayingPlants::new(&manifest, &planted, &Ledger::new()).unwrap().unwrap();
    println!("{} textures", winds.motions.len());
    (planted, winds)
}

/// The spectrum of every branch's deflection over three thousand periods, by a discrete Fourier transform of
/// segments, agrees with the formula. Bands are at least a quarter octave wide, from a tenth of the resonance to
/// one and a half times it.
#[test]
fn branches_have_the_spectra_of_their_own_resonance() {
    let (_, winds) = winds(4.0);
    let plant = winds.plants[0].as_ref().unwrap();
    let most = plant.answers.iter().flatten().map(|a| (a.faster - 1.0).abs()).fold(0.0, f64::max);
    assert!(most > 0.02 && most < 0.06, "{most}");
    let mut worst = 0.0f64;
    for k in [0, 14, 33] {
        let answer = plant.answers[k].as_ref().unwrap();
        let (f_h, tip) = (answer.sway.oscillator.resonance, plant.limbs.0[k].tip);
        // 128 segments of 512 readings, with eight readings in a period.
        let (dt, segment) = (0.125 / f_h, 512);
        let still = {
            let [_, r, s] = plant.limbs.0[k].axes.map(|v| v.to_array());
            answer.sway.steady(plant.towards[0][0].to_array(), r, s)
        };
        let readings: Vec<[f64; 2]> = (0..128 * segment)
            .map(|n| {
                let a = winds.amplitude(&winds.swing(plant, 0, k), 50.0 + n as f64 * dt);
                [0, 1].map(|c| a[c] * tip - still[c])
            })
            .collect();
        let step = 1.0 / (segment as f64 * dt);
        for band in [[6, 12], [12, 24], [24, 44], [44, 60], [60, 70], [70, 96]] {
            let (mut have, mut want) = (0.0, 0.0);
            for bin in band[0]..band[1] {
                let f = f64::from(bin) * step;
                want += answer.sway.spectrum(f);
                for part in readings.chunks(segment) {
                    for c in 0..2 {
                        let (mut re, mut im) = (0.0, 0.0);
                        let (sin, cos) = (TAU * f * dt).sin_cos();
                        let (mut x, mut y) = (1.0, 0.0);
                        for (n, v) in part.iter().enumerate() {
                            let window = (std::f64::consts::PI * n as f64 / segment as f64).sin().powi(2);
                            re += window * v[c] * x;
                            im += window * v[c] * y;
                            (x, y) = (x * cos - y * sin, x * sin + y * cos);
                        }
                        // Hann's window keeps 3/8 of the power.
                        have += 2.0 * dt * (re * re + im * im) / (0.375 * segment as f64) / 256.0;
                    }
                }
            }
            // There are at least 6 bins of 256 values each, half of them independent, so a standard deviation is at
            // most 4 %. The texture's other resonance changes the spectrum by 4 %.
            worst = worst.max((have / want - 1.0).abs());
        }
    }
    println!("bands are off by {:.3} at most", worst);
    assert!(worst < 0.16, "{worst}");
}

/// Plants with the same flutter share textures. Too many kinds, and leaves on still branches, are refused.
#[test]
fn kinds_of_flutter_are_counted() {
    let (mut manifest, mut planted) = scene(4.0);
    let said = |k: usize| Some(StatedFlutter { deg_per_m_s: 4.0, resonance_hz: 4.0 + 0.01 * k as f64, damping: 0.3 });
    manifest.plants[0].flutter = said(0);
    manifest.plants = vec![manifest.plants[0].clone(); 22];
    let one = planted.remove(0);
    planted = vec![one; 22];
    let winds = SwayingPlants::new(&manifest, &planted, &Ledger::new()).unwrap().unwrap();
    assert_eq!(winds.gusts.len(), 1);
    assert!(winds.plants.iter().flatten().all(|p| p.flutter.is_some()));
    (0..22).for_each(|k| manifest.plants[k].flutter = said(k));
    let error = SwayingPlants::new(&manifest, &planted, &Ledger::new()).unwrap_err().to_string();
    assert!(error.contains("and of 66 for the flutter of leaves, expected at most 64 in all"), "{error}");
    manifest.plants[0].drag_n_s_m3 = 0.0;
    let error = SwayingPlants::new(&manifest, &planted, &Ledger::new()).unwrap_err().to_string();
    assert!(error.contains("plant 1: flutter: leaves cannot flutter where no branch sways"), "{error}");
}

/// In a light wind, lengths in closed form move sections by almost the same, but not by the same numbers, and neither
/// is handed out for the other.
#[test]
fn lengths_in_closed_form_are_nearly_kept_in_a_light_wind() {
    let (_, winds) = winds(4.0);
    let kept = winds.sections(2.0);
    let closed = winds.sections_with(LengthConstraint::ClosedForm, 2.0);
    assert_eq!(kept, winds.sections(2.0));
    let apart = |(a, b): (&RigidMotion, &RigidMotion)| a.to.distance(b.to);
    let moved = kept.iter().map(|s| s.to.distance(s.from)).fold(0.0, f64::max);
    let worst = kept.iter().zip(closed.iter()).map(apart).fold(0.0, f64::max);
    assert!(worst > 0.0 && worst < 0.05 * moved, "{worst} mm of {moved} mm");
}

#[test]
fn storms_and_far_times_have_a_pose() {
    let (planted, winds) = winds(60.0);
    for time in [3.0, 1e6, -1e6] {
        let pose = winds.pose(0, 0, time).unwrap();
        let posed = pose.plant(&planted[0].plant);
        for (rest, now) in planted[0].plant.branches.iter().zip(&posed.branches) {
            assert!((now.length() / rest.length() - 1.0).abs() < 1e-5, "{time} {}", rest.name);
        }
        // In a hundredth of a second, no tip moves by a fifth of the plant.
        let next = winds.pose(0, 0, time + 0.01).unwrap();
        assert!((0..posed.branches.len()).all(|k| pose.tip(k).distance(next.tip(k)) < 240.0), "{time}");
    }
    assert!(winds.pose(1, 0, 0.0).is_none());
}

/// A branch that carries a stated load is the tapered beam under this load: its places agree with a numerical
/// integration of the beam's own equation, and a load that no beam carries is refused.
#[test]
fn a_stated_load_bends_a_branch_as_a_beam() {
    let (mut manifest, _) = scene(4.0);
    manifest.wind = None;
    let told = |load: f64, taper: f64| crate::manifest::BranchOverride {
        name: Some("trunk".into()),
        load_over_stiffness_mm: Some(load),
        taper: Some(taper),
        ..Default::default()
    };
    manifest.plants[0].rotation_deg = [0.0, 90.0, 0.0];
    manifest.plants[0].branches = vec![told(60.0, 0.4)];
    let stand = |manifest: &SceneManifest| {
        let ledger = Ledger::new();
        let planted = crate::placed::plant::planted(manifest, &ledger).unwrap();
        let winds = SwayingPlants::new(manifest, &planted, &ledger).map_err(|e| e.to_string());
        (planted, winds)
    };
    let (planted, winds) = stand(&manifest);
    let winds = winds.unwrap().unwrap();
    assert!(winds.motions.is_empty() && winds.gusts.is_empty());
    let pose = winds.pose(0, 0, 3.0).unwrap();
    let trunk = &planted[0].plant.branches[0];
    assert!((trunk.taper() - 0.4).abs() < 1e-12);
    // The plant lies along the world's x, so the load acts across its trunk.
    let down = DMat3::from_mat4(planted[0].places[0]).transpose() * DVec3::NEG_Z;
    let moved = (pose.tip(0) - trunk.point(1.0).0).dot(down.normalize());
    // u″ = 2 F/(π E′ r₁⁴) · (1 − x)²/(r/r₁)⁴ over the length L, twice integrated with 20,000 steps. The beam's load F
    // is spread evenly: its moment at x is F (1 − x)²/2, and its stiffness is E′ π r⁴/4.
    let (length, n) = (trunk.length(), 20_000);
    let amplitude = 60.0 / length;
    let (mut slope, mut u) = (0.0, 0.0);
    for k in 0..n {
        let x = (k as f64 + 0.5) / n as f64;
        let r = 1.0 - 0.6 * x;
        let curvature = 2.0 / std::f64::consts::PI * amplitude * (1.0 - x).powi(2) / r.powi(4);
        u += (slope + 0.5 * curvature / n as f64) / n as f64;
        slope += curvature / n as f64;
    }
    // The trunk wanders from its chord by a few hundredths, and a bent beam keeps its length.
    assert!((moved / (u * length) - 1.0).abs() < 0.03, "{moved} mm, expected {} mm", u * length);
    manifest.plants[0].branches = vec![told(1e5, 0.4)];
    let said = stand(&manifest).1.unwrap_err();
    assert!(said.contains("plant 1: branch \"trunk\": found a load under which its tip goes by"), "{said}");
    // A straight branch on a plant of twice the size, at several tilts from the vertical and in a wind that moves
    // nothing: the part of a small load across it bends it, downwards in the plane of the tilt.
    let mut straight = planted[0].clone();
    straight.plant.leaves.clear();
    straight.plant.branches.truncate(1);
    let branch = &mut straight.plant.branches[0];
    branch.axis = vec![DVec3::ZERO, DVec3::X * 500.0];
    (branch.load, branch.bending_load) = (5.0, 5.0);
    manifest.plants[0].drag_n_s_m3 = 0.0;
    for tilt in [0.0, 0.4, 1.0, 1.57, 2.4] {
        let turn = glam::DQuat::from_rotation_z(0.7) * glam::DQuat::from_rotation_y(tilt);
        let upright = glam::DQuat::from_rotation_arc(straight.plant.branches[0].axes[0], DVec3::Z);
        straight.places = vec![DMat4::from_scale_rotation_translation(DVec3::splat(2.0), turn * upright, DVec3::ONE)];
        let winds = SwayingPlants::new(&manifest, &[straight.clone()], &Ledger::new()).unwrap().unwrap();
        assert!(!winds.sways());
        let place = straight.places[0];
        let tip = place.transform_point3(winds.pose(0, 0, 0.0).unwrap().tip(0));
        let rest = place.transform_point3(straight.plant.branches[0].point(1.0).0);
        let along = (rest - place.transform_point3(straight.plant.branches[0].root)).normalize();
        let across = (DVec3::NEG_Z + along * along.z).normalize_or_zero();
        let expected = mesophyll_plants::mechanics::beam::deflection(0.4, 1.0) * 5.0 * tilt.sin() * 2.0;
        let moved = tip - rest;
        assert!((moved.dot(across) - expected).abs() < 2e-3 * expected + 1e-9, "{tilt}: {moved}, expected {expected}");
        assert!((moved - across * moved.dot(across)).length() < 0.01 * expected + 1e-9, "{tilt}: {moved}");
    }
    // A curved branch is judged by the beam that it bends as.
    let curl = |k: i32| DVec3::new(f64::from(k).mul_add(0.1, 0.0).sin(), 0.0, 1.0 - (0.1 * f64::from(k)).cos()) * 100.0;
    straight.plant.branches[0].axis = (0..=47).map(curl).collect();
    let whole = straight.plant.branches[0].length();
    straight.plant.branches[0].bending_load = 0.9 * whole / mesophyll_plants::mechanics::beam::deflection(0.4, 1.0);
    straight.places = vec![DMat4::from_rotation_x(1.2)];
    let said = SwayingPlants::new(&manifest, &[straight], &Ledger::new()).map(|_| ()).unwrap_err().to_string();
    assert!(said.contains("expected at most 0.75"), "{said}");
    for (own, expected) in [
        (told(1.0, 1.0), "plant 1: branch.name: found \"bough\", expected a branch of the plant (trunk"),
        (
            crate::manifest::BranchOverride { name: None, level: Some(9), ..told(1.0, 1.0) },
            "plant 1: branch.level: found 9",
        ),
    ] {
        let name = own.name.as_ref().map(|_| "bough".to_string());
        manifest.plants[0].branches = vec![crate::manifest::BranchOverride { name, ..own }];
        let said = crate::placed::plant::planted(&manifest, &Ledger::new()).unwrap_err().to_string();
        assert!(said.contains(expected), "{said}");
    }
}
