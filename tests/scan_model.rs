//! The scan as it is synthesised and as it is fitted are different code; here they meet.

use mesophyll::capture::manifest::{Travel, Tube as SynthTube};
use mesophyll::capture::synth::illumination::{Device, Lobe as SynthLobe};
use mesophyll::optics::gloss::Lobe;
use mesophyll::optics::tube::{Model, Precision, Travel as FitTravel, Tube};

#[test]
fn synthesis_and_fit_see_the_same_texel() {
    let tube = SynthTube { height_mm: 100.0, length_mm: 500.0, radius_mm: 2.5 };
    let camera = 55f64.to_radians();
    let fit = Model::new(
        Tube { height_mm: 100.0, length_mm: 500.0, radius_mm: 2.5 },
        [camera.sin(), 0.0, camera.cos()],
        Lobe::Beckmann,
        &Precision::fine(),
    );
    for (travel, other) in [(Travel::X, FitTravel::X), (Travel::Y, FitTravel::Y)] {
        let synth = Device::new(tube, travel, 55.0);
        for (at, normal, m, within) in [
            ([0.0, 0.0], [0.0f64, 0.0, 1.0], 0.2, 3e-5),
            ([25.0, -18.0], [0.1, -0.08, 1.0], 0.35, 3e-5),
            ([10.0, 12.0], [0.05, 0.1, 1.0], 0.55, 3e-5),
            // In pass y this narrow lobe looks at the very end of the tube, which the fit places at the surface's mean distance.
            ([-30.0, 20.0], [-0.15, 0.2, 1.0], 0.08, 1e-3),
        ] {
            let length = normal.iter().map(|v| v * v).sum::<f64>().sqrt();
            let normal = normal.map(|v| v / length);
            let (across, along) = if travel == Travel::X { (at[0], at[1]) } else { (at[1], at[0]) };
            let (mut peak, mut worst) = ([0.0f64; 2], [0.0f64; 2]);
            for k in 0..40 {
                let position = -400.0 + 650.0 * f64::from(k) / 39.0;
                let shown = synth.shown(&synth.seen(position, across), along, normal, Some(m), SynthLobe::Beckmann);
                let response = fit.response(other, position, at, normal, m);
                for (c, (a, b)) in [(shown.diffuse, response.d), (shown.gloss, response.s)].into_iter().enumerate() {
                    peak[c] = peak[c].max(a);
                    worst[c] = worst[c].max((a - b).abs());
                }
            }
            assert!(worst[0] < 3e-5 * peak[0] && worst[1] < within * peak[1], "{travel:?} {at:?} m = {m}: {worst:?} of {peak:?}");
        }
    }
}
