use super::*;

fn ridge(w: usize, h: usize) -> Vec<f64> {
    // A lamina of .2 mm with a midrib along x that is .15 mm thicker.
    (0..w * h).map(|k| 0.2 + 0.15 * (-((k / w) as f64 - 0.5 * h as f64).powi(2) / 36.0).exp()).collect()
}

fn drawn(n: usize, seed: u64) -> Vec<f64> {
    (0..n.div_ceil(2)).flat_map(|k| RandomStream::new(seed, &[k as u64]).normal_pair()).take(n).collect()
}

#[test]
fn the_plane_is_the_laminas_whatever_the_veins_do() {
    let (w, h) = (160, 120);
    let noise = drawn(w * h, 3);
    let lean = ScanPlane([1.5, 2e-4, -5e-4]);
    let middle = ridge(w, h);
    // A second vein off the middle, because of which plain least squares would lean.
    let values: Vec<f64> = (0..w * h)
        .map(|k| {
            let vein = if (k / w) > 90 && (k % w) < 40 { 0.1 } else { 0.0 };
            middle[k] + vein + 0.01 * noise[k] + lean.at(k, ImageSize::new(w, h))
        })
        .collect();
    let found = plane(&values, &vec![true; w * h], ImageSize::new(w, h)).unwrap();
    // σ_b = σ/(√n · w/√12) = 1.6e-6 per texel for the noise alone.
    assert!((found.lean()[0] - 2e-4).abs() < 1e-5 && (found.lean()[1] + 5e-4).abs() < 1e-5, "{found:?}");
    assert!(
        plane(&values, &(0..w * h).map(|k| k < w).collect::<Vec<_>>(), ImageSize::new(w, h)).is_none(),
        "one row says nothing of the other direction"
    );
}

#[test]
fn the_highest_place_is_not_the_noises() {
    let (w, h) = (160, 120);
    let filter = SmoothingKernel::gaussian(0.5);
    let contact = 1.5;
    let clean = pass(&ridge(w, h), w, &filter);
    // A ridge exp(−y²/36) has the variance 18. The contact flattens it to √(18/(18 + 2.25)). This holds away from the
    // image's upper and lower edges, beyond which there is nothing.
    let truth = 0.2 + 0.15 * (18f64 / (18.0 + contact * contact)).sqrt();
    let inside = |v: Vec<f64>| {
        v.into_iter()
            .enumerate()
            .map(|(k, v)| if (4..h - 4).contains(&(k / w)) && (4..w - 4).contains(&(k % w)) { v } else { f64::NAN })
            .collect::<Vec<_>>()
    };
    let exact = highest(&inside(clean.clone()), w, &filter, contact, 0.0).value;
    assert!((exact - truth).abs() < 1e-3, "{exact} {truth}");
    let mut misses = Vec::new();
    for seed in 0..6 {
        let noise = pass(&drawn(w * h, 100 + seed), w, &filter);
        let sd = 0.012;
        let values = inside(clean.iter().zip(&noise).map(|(v, n)| v + sd / filter.noise() * n).collect());
        let ThickestPlace { value: found, raised, error: err, .. } = highest(&values, w, &filter, contact, sd);
        assert!(raised > 0.001 && err > 0.0, "{raised} {err}");
        // The plain highest value is far too high.
        let plain = values.iter().copied().filter(|v| v.is_finite()).fold(f64::MIN, f64::max);
        assert!(plain - truth > 4.0 * (found - truth).abs(), "{plain} {found}");
        misses.push((found - truth) / err);
    }
    let mean = misses.iter().sum::<f64>() / 6.0;
    assert!(misses.iter().all(|m| m.abs() < 3.0) && mean.abs() < 1.3, "{misses:?}");
}

/// The error that is estimated from the map itself agrees with the error to the map without noise, and the chosen width
/// is nearly the best.
#[test]
fn smoothing_is_as_wide_as_serves_and_its_error_is_known() {
    let (w, h) = (160, 120);
    let filter = SmoothingKernel::gaussian(0.5);
    // Veins of a few texels' width on a lamina.
    let clean: Vec<f64> =
        (0..w * h).map(|k| 0.2 + 0.06 * (-(((k % w) % 20) as f64 - 10.0).powi(2) / 5.0).exp()).collect();
    let clean = pass(&clean, w, &filter);
    let sd = 0.014;
    let noise = pass(&drawn(w * h, 77), w, &filter);
    let values: Vec<f64> = clean.iter().zip(&noise).map(|(v, n)| v + sd / filter.noise() * n).collect();
    let met = |texels: f64| {
        let out = smooth(&values, &vec![1.0; w * h], w, &SmoothingKernel::gaussian(texels));
        let inner = (8..h - 8).flat_map(|j| (8..w - 8).map(move |i| j * w + i));
        let (sum, n) = inner.fold((0.0, 0.0), |(s, n), k| (s + (out[k] - clean[k]).powi(2), n + 1.0));
        (sum / n).sqrt()
    };
    let chosen = best_width(&values, w, &filter, sd, SmoothingGoal::Values, None);
    assert!((0.4..1.6).contains(&chosen.texels), "{chosen:?}");
    assert!((chosen.error / met(chosen.texels) - 1.0).abs() < 0.1, "{chosen:?} {}", met(chosen.texels));
    let best = WIDTHS.into_iter().map(met).fold(f64::MAX, f64::min);
    assert!(met(chosen.texels) < 1.05 * best, "{chosen:?} {best}");
    // A slope needs more smoothing.
    let slope = best_width(&values, w, &filter, sd, SmoothingGoal::Slopes, None);
    assert!(slope.texels >= chosen.texels, "{slope:?}");
    assert_eq!(best_width(&clean, w, &filter, 0.0, SmoothingGoal::Values, None).texels, 0.0);
    assert_eq!(best_width(&values, w, &filter, sd, SmoothingGoal::Values, Some(2.0)).texels, 2.0);
}
