//! The code that synthesises a scan and the code that fits it are different. Here their results are compared.

use mesophyll::optics::gloss::Lobe;
use mesophyll::optics::tube::{Travel, Tube, TubeModel, TubePrecision};
use mesophyll::synth::illumination::TubeDevice;

#[test]
fn synthesis_and_fit_see_the_same_texel() {
    let [diffuse, gloss] = worst(500.0);
    assert!(diffuse < 1e-5 && gloss < 1e-5, "{diffuse} {gloss}");
}

/// Largest difference of D and S over both passes, in units of their peaks.
fn worst(length_mm: f64) -> [f64; 2] {
    let tube = Tube { height_mm: 100.0, length_mm, radius_mm: 2.5 };
    let camera = 55f64.to_radians();
    let fit = TubeModel::new(tube, [camera.sin(), 0.0, camera.cos()], Lobe::Beckmann, &TubePrecision::fine());
    let mut all = [0.0f64; 2];
    for travel in [Travel::X, Travel::Y] {
        let synth = TubeDevice::new(tube, travel, 55.0);
        for (at, normal, m) in [
            ([0.0, 0.0], [0.0f64, 0.0, 1.0], 0.2),
            ([25.0, -18.0], [0.1, -0.08, 1.0], 0.35),
            ([10.0, 12.0], [0.05, 0.1, 1.0], 0.55),
            ([-30.0, 20.0], [-0.1, 0.12, 1.0], 0.1),
        ] {
            let length = normal.iter().map(|v| v * v).sum::<f64>().sqrt();
            let normal = normal.map(|v| v / length);
            let (across, along) = if travel == Travel::X { (at[0], at[1]) } else { (at[1], at[0]) };
            let (mut peak, mut worst) = ([0.0f64; 2], [0.0f64; 2]);
            for k in 0..40 {
                let position = -400.0 + 650.0 * f64::from(k) / 39.0;
                let shown = synth.shown(&synth.seen(position, across), along, normal, Some(m), Lobe::Beckmann);
                let response = fit.response(travel, position, at, normal, m);
                for (c, (a, b)) in [(shown.diffuse, response.d), (shown.gloss, response.s)].into_iter().enumerate() {
                    peak[c] = peak[c].max(a);
                    worst[c] = worst[c].max((a - b).abs());
                }
            }
            for c in 0..2 {
                all[c] = all[c].max(worst[c] / peak[c]);
            }
        }
    }
    all
}
