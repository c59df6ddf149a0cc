//! Motion textures compared with the spectra that they were made from.

use super::super::wind::{Oscillator, Sway, Wind};
use super::*;

fn sway(ratio: f64) -> Sway {
    Sway { wind: Wind { speed: 3.0, turbulence: 0.3 }, oscillator: Oscillator::of_branch(1.2, false, ratio), lean: 0.1 }
}

#[test]
fn lines_have_the_wanted_spectrum() {
    // Isotropic textures. Where the inverse is exact, two errors remain: the uneven number of lattice waves at each
    // frequency, and the filter, which takes 10 % at the highest one. A sharp resonance (a tenth of critical
    // damping) has no inverse: 0.18 is the best that an isotropic texture can do.
    for (ratio, limit) in [(2.0, 0.08), (0.25, 0.08), (0.1, 0.25)] {
        let s = sway(ratio);
        let of = |method| {
            let motion = MotionTexture::new(|f| s.spectrum(f), s.highest(), 256, 5, method).unwrap();
            deviation(&motion, |f| s.spectrum(f), 4, 16).0
        };
        let (plain, abel, directed) =
            (of(SpectrumMethod::Plain), of(SpectrumMethod::InverseAbel), of(SpectrumMethod::Directed));
        println!(
            "damping {ratio} of critical: RMS log10 deviation {plain:.3} plain, {abel:.3} inverse Abel, \
             {directed:.3} directed"
        );
        // A directed texture has no such limit.
        assert!(directed < 0.08, "{ratio}: {directed}");
        assert!(abel < limit && abel < 0.6 * plain, "{ratio}: {abel} against {plain}");
    }
}

#[test]
fn textures_are_seeded_periodic_and_in_units() {
    let s = sway(0.5);
    let make =
        |seed| MotionTexture::new(|f| s.spectrum(f), s.highest(), 128, seed, SpectrumMethod::InverseAbel).unwrap();
    let a = make(3);
    assert_eq!(a, make(3));
    assert_ne!(a, make(4));
    for p in [[0.1, 0.7], [0.999, 0.001], [0.0, 0.5]] {
        for (p, q) in a.sample(p).iter().zip(a.sample([p[0] + 3.0, p[1] - 2.0])) {
            assert!((p - q).abs() < 1e-9 * a.rms()[0]);
        }
    }
    // The values at texel centres are those of the texels.
    let v = a.sample([(7.0 + 0.5) / 128.0, (100.0 + 0.5) / 128.0]);
    assert!((v[0] - f64::from(a.values[100 * 128 + 7][0])).abs() < 1e-6 * a.rms()[0]);
    // Twice the lean gives twice the motion: the texture has units and is not normalised.
    let twice = Sway { lean: 0.2, ..s };
    let b = MotionTexture::new(|f| twice.spectrum(f), s.highest(), 128, 3, SpectrumMethod::InverseAbel).unwrap();
    assert!((b.rms()[1] / a.rms()[1] - 2.0).abs() < 1e-5);
    // The variance is that of the band: the sum over the lattice's frequencies of what a line sees, within the
    // scatter of one draw.
    let wanted: f64 = (1..=16).map(|j| s.spectrum(f64::from(j) * a.lowest) * a.lowest).sum();
    let have = (a.rms()[0].powi(2) + a.rms()[1].powi(2)) / 2.0;
    println!("variance {have:.3e} of {wanted:.3e} in the band from the lowest frequency");
    assert!(have / wanted > 0.8 && have / wanted < 2.0, "{have} {wanted}");
}

/// A line through a directed texture does not resemble itself later, for ten minutes and more.
#[test]
fn lines_do_not_repeat_within_ten_minutes() {
    let s = sway(0.15);
    let motion = MotionTexture::new(|f| s.spectrum(f), s.highest(), 1024, 5, SpectrumMethod::Directed).unwrap();
    let dt = 0.11;
    for seed in 0..3 {
        let path = motion.trajectory(seed, 1.0);
        let n = (1200.0 / dt) as usize;
        let line: Vec<f64> = (0..n).map(|k| motion.sample(path.at(k as f64 * dt))[0]).collect();
        let square: f64 = line.iter().map(|v| v * v).sum::<f64>() / n as f64;
        // The correlation dies away within ten seconds; a repetition would bring it back completely.
        let worst = ((10.0 / dt) as usize..(600.0 / dt) as usize)
            .map(|lag| {
                let pairs = n - lag;
                (0..pairs).map(|k| line[k] * line[k + lag]).sum::<f64>().abs() / (pairs as f64 * square)
            })
            .fold(0.0, f64::max);
        println!("line {seed}: largest correlation with itself between 10 s and 10 min {worst:.2}");
        assert!(worst < 0.4, "{worst}");
    }
}

#[test]
fn impossible_textures_are_refused_and_lines_do_not_close() {
    let s = sway(0.5);
    assert!(MotionTexture::new(|f| s.spectrum(f), 0.0, 128, 1, SpectrumMethod::Plain).is_none());
    assert!(MotionTexture::new(|f| s.spectrum(f), 1.0, 16, 1, SpectrumMethod::Plain).is_none());
    assert!(MotionTexture::new(|_| f64::NAN, 1.0, 64, 1, SpectrumMethod::Plain).is_none());
    let directed = MotionTexture::new(|f| s.spectrum(f), s.highest(), 64, 1, SpectrumMethod::Directed).unwrap();
    for seed in 0..200 {
        let line = directed.trajectory(seed, 1.0).velocity;
        assert!(line[0] == directed.lowest && (1.0 / 9.0..=1.03 / 9.0).contains(&(line[1] / line[0]).abs()));
        let path = Trajectory::new(seed, 0.5);
        assert!(!nearly_rational(path.velocity[1].atan2(path.velocity[0])));
        assert!((path.velocity[0].hypot(path.velocity[1]) - 0.5).abs() < 1e-12);
    }
}
