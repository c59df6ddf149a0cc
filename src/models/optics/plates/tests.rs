use super::*;

/// The closed form of Stern (1964) for the mean of Fresnel's formula over a cone, as PROSPECT has it.
fn stern(angle: f64, n: f64) -> f64 {
    let n2 = n * n;
    let (np, nm, a) = (n2 + 1.0, n2 - 1.0, (n + 1.0).powi(2) / 2.0);
    let k = -(n2 - 1.0).powi(2) / 4.0;
    let sin2 = angle.sin().powi(2);
    let b2 = sin2 - np / 2.0;
    let b1 = if angle >= std::f64::consts::FRAC_PI_2 { 0.0 } else { (b2 * b2 + k).sqrt() };
    let b = b1 - b2;
    let ts = (k * k / (6.0 * b.powi(3)) + k / b - b / 2.0) - (k * k / (6.0 * a.powi(3)) + k / a - a / 2.0);
    let tp1 = -2.0 * n2 * (b - a) / (np * np);
    let tp2 = -2.0 * n2 * np * (b / a).ln() / (nm * nm);
    let tp3 = n2 * (1.0 / b - 1.0 / a) / 2.0;
    let (pb, pa) = (2.0 * np * b - nm * nm, 2.0 * np * a - nm * nm);
    let tp4 = 16.0 * n2 * n2 * (n2 * n2 + 1.0) * (pb / pa).ln() / (np.powi(3) * nm * nm);
    let tp5 = 16.0 * n2.powi(3) * (1.0 / pb - 1.0 / pa) / np.powi(3);
    (ts + tp1 + tp2 + tp3 + tp4 + tp5) / (2.0 * sin2)
}

#[test]
fn what_enters_is_what_the_closed_form_says() {
    for n in [1.1, 1.3, 1.42, 1.6] {
        for angle in [CONE, 1.0, std::f64::consts::FRAC_PI_2] {
            let [value, slope] = entering(angle, n);
            assert!((value - stern(angle, n)).abs() < 1e-9, "{n} {angle}: {value} {}", stern(angle, n));
            let numeric = (entering(angle, n + 1e-5)[0] - entering(angle, n - 1e-5)[0]) / 2e-5;
            assert!((slope - numeric).abs() < 1e-7, "{n} {angle}: {slope} {numeric}");
        }
    }
}

/// Follows the light of whole plates: each is added below the others, and its echoes are summed one by one.
fn added(depth: f64, count: usize, gloss: f64, n: f64) -> [f64; 2] {
    // 2 E₃ by quadrature over directions: E₃(k) = ∫ μ exp(−k/μ) dμ.
    let k = depth / count as f64;
    let through: f64 = quadrature::unit(400).into_iter().map(|(mu, w)| 2.0 * w * mu * (-k / mu).exp()).sum();
    let enter = stern(std::f64::consts::FRAC_PI_2, n);
    let leave = enter / (n * n);
    let plate = |enters: f64| {
        let (mut r, mut t, mut inside) = (1.0 - enters, 0.0, enters);
        for echo in 0..4000 {
            inside *= through;
            if echo % 2 == 0 {
                t += inside * leave
            } else {
                r += inside * leave
            }
            inside *= 1.0 - leave;
        }
        [r, t]
    };
    let [r, t] = plate(enter);
    let [mut above, mut down] = plate(1.0 - gloss * (1.0 - stern(CONE, n)));
    // What the stack reflects and lets through from below.
    let (mut below, mut up) = (r, t);
    for _ in 1..count {
        let (mut reflected, mut passed, mut light, mut seen) = (0.0, 0.0, down, 0.0);
        let (mut from_below, mut inward, mut rising) = (0.0, 0.0, t);
        for _ in 0..4000 {
            passed += light * t;
            light *= r;
            reflected += light * up;
            light *= below;
            inward += rising * up;
            rising *= below;
            from_below += rising * t;
            rising *= r;
            seen += light;
        }
        assert!(seen.is_finite());
        above += reflected;
        down = passed;
        (below, up) = (r + from_below, inward);
    }
    [above, down]
}

#[test]
fn whole_plates_are_those_added_one_by_one() {
    for count in [1, 2, 3, 5] {
        for depth in [1e-3, 0.05, 0.8, 6.0] {
            for (gloss, n) in [(1.0, 1.42), (0.0, 1.3), (2.5, 1.5)] {
                let [r, t] = PlateIndex::new(n).values(depth, count as f64, gloss);
                let [want_r, want_t] = added(depth, count, gloss, n);
                assert!((r - want_r).abs() < 2e-7 && (t - want_t).abs() < 2e-7, "{count} {depth}: {r} {want_r}");
            }
        }
    }
}

#[test]
fn light_is_conserved_where_nothing_is_absorbed() {
    for crossings in [1.0, 1.02, 1.5, 2.7, 9.0] {
        for depth in [0.0, 1e-14, 1e-12] {
            let [r, t] = PlateIndex::new(1.44).response(depth, crossings, 1.3);
            assert!((r.value + t.value - 1.0).abs() < 1e-10, "{crossings} {depth}: {}", r.value + t.value);
            // What is absorbed grows with the path, which is at least twice the depth.
            assert!(-(r.by_depth + t.by_depth) > 2.0, "{crossings} {depth}: {r:?} {t:?}");
            assert!((r.by_crossings + t.by_crossings).abs() < 1e-7 && (r.by_gloss + t.by_gloss).abs() < 1e-10);
        }
    }
}

#[test]
fn derivatives_are_those_of_differences() {
    for depth in [1e-6, 1e-3, 0.03, 0.5, 3.0, 40.0] {
        for crossings in [1.03, 1.6, 3.2] {
            for (gloss, n) in [(1.0, 1.42), (0.3, 1.31), (3.0, 1.5)] {
                let at = |d: f64, m: f64, g: f64, n: f64| PlateIndex::new(n).values(d, m, g);
                let found = PlateIndex::new(n).response(depth, crossings, gloss);
                let h = 1e-5;
                let hd = h * depth;
                let pairs = [
                    (at(depth + hd, crossings, gloss, n), at(depth - hd, crossings, gloss, n), hd),
                    (at(depth, crossings + h, gloss, n), at(depth, crossings - h, gloss, n), h),
                    (at(depth, crossings, gloss + h, n), at(depth, crossings, gloss - h, n), h),
                    (at(depth, crossings, gloss, n + h), at(depth, crossings, gloss, n - h), h),
                ];
                for (k, value) in found.iter().enumerate() {
                    let slopes = [value.by_depth, value.by_crossings, value.by_gloss, value.by_index];
                    assert_eq!(value.value, at(depth, crossings, gloss, n)[k]);
                    for (slope, (up, down, step)) in slopes.iter().zip(&pairs) {
                        let numeric = (up[k] - down[k]) / (2.0 * step);
                        // What rounding makes of the difference, and its third order.
                        let allowed = 1e-6 * (1.0 + slope.abs()) + 1e-14 / step;
                        assert!((slope - numeric).abs() < allowed, "{depth} {crossings} {k}: {slope} {numeric}");
                    }
                }
            }
        }
    }
}

#[test]
fn a_black_leaf_shows_its_surface_only() {
    let index = PlateIndex::new(1.4);
    for depth in [200.0, 1e4] {
        let [r, t] = index.response(depth, 1.8, 1.5);
        assert!((r.value - 1.5 * index.surface()).abs() < 1e-12 && t.value.abs() < 1e-12, "{r:?} {t:?}");
        assert!([r, t].iter().all(|x| x.by_depth.is_finite() && x.by_crossings.is_finite() && x.by_index.is_finite()));
    }
}

/// A leaf of two plates over two others, each pair with its own absorption, added plate by plate.
fn two_over_two(depth: f64, gloss: f64, lean: f64, n: f64) -> [f64; 2] {
    let enter = entering(std::f64::consts::FRAC_PI_2, n)[0];
    let plate = |k: f64| {
        let through: f64 =
            mesophyll_base::quadrature::unit(200).into_iter().map(|(m, w)| 2.0 * m * w * (-k / m).exp()).sum();
        let out = enter / (n * n);
        let t = enter * through * out / (1.0 - (1.0 - out).powi(2) * through * through);
        [1.0 - enter + (1.0 - out) * through * t, t]
    };
    // Seen from above and from below: [R, T] and [R, T].
    let add = |a: [[f64; 2]; 2], b: [[f64; 2]; 2]| {
        let echo = 1.0 / (1.0 - a[1][0] * b[0][0]);
        [
            [a[0][0] + a[0][1] * b[0][0] * a[1][1] * echo, a[0][1] * b[0][1] * echo],
            [b[1][0] + b[1][1] * a[1][0] * b[0][1] * echo, b[1][1] * a[1][1] * echo],
        ]
    };
    let (upper, lower) = ([plate(0.25 * depth * (1.0 + lean)); 2], [plate(0.25 * depth * (1.0 - lean)); 2]);
    let [[r, t], _] = add(add(add(upper, upper), lower), lower);
    let mirrored = gloss * (1.0 - entering(CONE, n)[0]);
    [mirrored + (r - (1.0 - enter)) * (1.0 - mirrored) / enter, t * (1.0 - mirrored) / enter]
}

#[test]
fn a_leaf_with_two_sides_is_its_plates_one_after_the_other() {
    let index = PlateIndex::new(1.43);
    for (depth, lean) in [(0.0, 0.3), (0.4, 0.0), (0.4, 0.6), (2.5, -0.5), (9.0, 0.8)] {
        let sides = index.sides(depth, 4.0, [1.2, 0.7], lean);
        for (side, want) in
            sides.iter().zip([two_over_two(depth, 1.2, lean, 1.43), two_over_two(depth, 0.7, -lean, 1.43)])
        {
            for (found, want) in side.iter().zip(want) {
                assert!((found.0 - want).abs() < 1e-9, "{depth} {lean}: {} {want}", found.0);
            }
        }
        let numbers = [depth.max(0.01), 4.0, 1.2, 0.7, lean];
        let at = |[depth, crossings, above, below, lean]: [f64; 5]| index.sides(depth, crossings, [above, below], lean);
        for k in 0..5 {
            let moved = |by: f64| at(std::array::from_fn(|j| numbers[j] + if j == k { by } else { 0.0 }));
            let (more, less, here) = (moved(1e-5), moved(-1e-5), moved(0.0));
            for (side, which) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                let numeric = (more[side][which].0 - less[side][which].0) / 2e-5;
                let slope = here[side][which].1[k];
                assert!((slope - numeric).abs() < 1e-6 * (1.0 + slope.abs()), "{depth} {k}: {slope} {numeric}");
            }
        }
    }
    // Without lean both sides are those of equal plates.
    let (sides, equal) = (index.sides(0.7, 1.6, [1.1; 2], 0.0), index.values(0.7, 1.6, 1.1));
    for side in sides {
        assert!(side.iter().zip(equal).all(|(a, b)| (a.0 - b).abs() < 1e-12), "{side:?} {equal:?}");
    }
}
