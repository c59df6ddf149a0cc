//! Few leaves with their factors beside all leaves, both drawn by `sketch`, from directions of which nothing was found
//! before.

use super::*;
use glam::Quat;

/// Numbers from 0 to 1 that are evenly spread.
fn evenly(k: usize, j: usize) -> f32 {
    const BY: [f64; 5] = [0.819_172_5, 0.671_043_6, 0.549_700_5, 0.450_330_0, 0.368_917_2];
    ((k as f64 + 0.5) * BY[j]).fract() as f32
}

/// A crown of 120 shoots of 25 leaves of 40 mm, with a gap on one side, turned by `by` in its own frame.
fn plant(by: Quat) -> FarPlant {
    let leaf = |k: usize| {
        let shoot = k / 25;
        let (z, a) = (2.0 * evenly(shoot, 0) - 1.0, 0.85 * std::f32::consts::TAU * evenly(shoot, 1));
        let flat = (1.0 - z * z).sqrt();
        let out = Vec3::new(flat * a.cos(), flat * a.sin(), z);
        let root = out * (0.35 + 0.5 * evenly(shoot, 2)) * Vec3::new(900.0, 900.0, 1200.0);
        let around = Vec3::new(evenly(k, 2) - 0.5, evenly(k, 3) - 0.5, evenly(k, 4) - 0.5);
        let turned = Quat::from_rotation_z(std::f32::consts::TAU * evenly(k, 3))
            * Quat::from_rotation_y(1.3 * evenly(k, 4).sqrt())
            * Quat::from_rotation_z(0.8);
        let turned = by * turned;
        Card {
            middle: by * (root + 320.0 * ((k % 25) as f32 / 25.0) * out + 90.0 * around),
            sides: [turned * Vec3::X * 20.0, turned * Vec3::Y * 20.0],
            normal: turned * Vec3::Z,
            sends: [0.12, 0.2, 0.1],
        }
    };
    let cards = (0..3000).map(leaf).collect();
    FarPlant::new(vec![FarLeaves { ranks: Vec::new(), cards, radius: 28.3 }], (Vec3::ZERO, 1450.0), by * Vec3::Z)
}

/// A direction above this height.
fn direction(k: usize, j: usize, low: f32) -> Vec3 {
    let (z, a) = (low + (1.0 - low) * evenly(k, j), std::f32::consts::TAU * evenly(k, j + 1));
    let flat = (1.0 - z * z).sqrt();
    Vec3::new(flat * a.cos(), flat * a.sin(), z)
}

/// The root mean square errors of coverage and of light at a width of pixels, without factors and with them.
fn errors(plant: &FarPlant, pixel: f32, pairs: usize) -> [[f32; 2]; 2] {
    let known = plant.patterns.get_or_init(|| plant.patterns()).as_ref().expect("patterns");
    let crown = &known.crown;
    let (all, drawn) = (crown.all(), plant.drawn(pixel));
    let mut squares = [[0.0; 2]; 2];
    let turn = Quat::from_rotation_arc(Vec3::Z, plant.up);
    for k in 0..pairs {
        let (view, sun) = (turn * direction(k, 0, -0.1), turn * direction(k, 2, 0.1));
        let suns = [crown.sketch(&all, 1.0, sun)];
        let of = |drawn: &[(u16, f32)], [larger, lit]: [f32; 2]| {
            let sketch = crown.sketch(drawn, larger, view);
            [sketch.covered(), sketch.covered() * lit * crown.light(&sketch, &suns)[0]]
        };
        let truth = of(&all, [1.0; 2]);
        for (factors, squares) in [[1.0; 2], plant.factors(pixel, view, Some(sun))].into_iter().zip(&mut squares) {
            let found = of(&drawn, factors);
            (0..2).for_each(|c| squares[c] += (found[c] / truth[c] - 1.0).powi(2) / pairs as f32);
        }
    }
    squares.map(|both| both.map(f32::sqrt))
}

/// The factors take most of the error away, the more the fewer leaves there are. What is left of the light is mainly
/// that of the coefficients, and the scatter of cells that are as large as leaves.
#[test]
fn few_leaves_with_their_factors_cover_and_send_as_much_as_all() {
    let plant = plant(Quat::IDENTITY);
    for (metres, leaves) in [(120.0, 400), (240.0, 100), (480.0, 26)] {
        let pixel = 0.88 * metres;
        let [without, with] = errors(&plant, pixel, 40);
        let drawn = plant.drawn(pixel).len();
        println!("{metres} m, {drawn} leaves: coverage and light off by {without:.3?}, with factors {with:.3?}");
        assert!(drawn < leaves && with[0] < 0.3 * without[0] && with[1] < 0.5 * without[1], "{metres}: {with:?}");
        assert!(with[0] < 0.05 && with[1] < 0.1, "{metres}: {with:?}");
    }
}

/// A plant whose own frame lies on its side is looked at and lit from the same directions of the world.
#[test]
fn a_tilted_plant_has_factors_of_its_own_up() {
    let plant = plant(Quat::from_rotation_x(std::f32::consts::FRAC_PI_2));
    let [without, with] = errors(&plant, 0.88 * 240.0, 40);
    assert!(with[0] < 0.3 * without[0] && with[1] < 0.5 * without[1], "{without:?} {with:?}");
    assert!(with[0] < 0.05 && with[1] < 0.1, "{with:?}");
}

/// Far below the directions that coefficients were found for, light has no factor; on the way there is no step.
#[test]
fn light_from_below_has_no_factor() {
    let plant = plant(Quat::IDENTITY);
    let from = |height: f32| Vec3::new((1.0 - height * height).sqrt(), 0.0, height);
    let at = |sun: f32| plant.factors(0.88 * 480.0, from(-0.4), Some(from(sun)))[1];
    assert!(at(0.1) != 1.0 && at(-0.3) == 1.0);
    let steps: Vec<f32> = (0..=200).map(|k| at(0.1 - 0.002 * k as f32)).collect();
    assert!(steps.windows(2).all(|s| (s[0] - s[1]).abs() < 0.05), "{steps:?}");
}

/// Needles and black leaves have no card that tells what they send.
#[test]
fn leaves_that_send_nothing_have_no_factors() {
    let mut black = plant(Quat::IDENTITY);
    black.leaves[0].cards.iter_mut().for_each(|card| card.sends = [0.0; 3]);
    assert_eq!(black.factors(0.88 * 240.0, Vec3::X, Some(Vec3::Z)), [1.0; 2]);
}

/// All leaves have no factors, and factors begin at 1.
#[test]
fn factors_begin_where_leaves_are_left_out() {
    let plant = plant(Quat::IDENTITY);
    let first = 2.0 * 28.3 / WIDE;
    let at = |pixel: f32| plant.factors(pixel, Vec3::X, Some(Vec3::Z));
    assert_eq!(at(0.99 * first), [1.0; 2]);
    assert!(at(1.001 * first).iter().all(|f| (f - 1.0).abs() < 0.01), "{:?}", at(1.001 * first));
    let [a, b] = [1.6, 1.61].map(|by| at(by * first));
    assert!((0..2).all(|c| (a[c] - b[c]).abs() < 0.02), "{a:?} {b:?}");
}

/// A linear function of directions is met between the nodes, on both halves of the ball.
#[test]
fn what_is_found_at_nodes_holds_between_them() {
    let (grid, along) = (OnDirections::new(), Vec3::new(0.3, -0.5, 0.8));
    for k in 0..500 {
        let d = direction(k, 0, -1.0);
        let around = grid.around(d, |d| d.dot(along));
        let found: f32 = around.iter().map(|(value, share)| *value * share).sum();
        assert!((around.iter().map(|(_, share)| share).sum::<f32>() - 1.0).abs() < 1e-5);
        assert!((found - d.dot(along)).abs() < 0.01, "{d}: {found}");
        assert!((grid.nearest(d, |d| d.dot(along)) - d.dot(along)).abs() < 0.15, "{d}");
    }
}

/// Half of a leaf is in the shadow of a leaf above it, and nothing of one beside it.
#[test]
fn a_leaf_over_another_hides_it() {
    let leaf =
        |middle: Vec3| Card { middle, sides: [20.0 * Vec3::X, 20.0 * Vec3::Y], normal: Vec3::Z, sends: [1.0; 3] };
    let crown = Crown::new(vec![leaf(Vec3::ZERO), leaf(Vec3::new(20.0, 0.0, 10.0))], (Vec3::ZERO, 60.0));
    let both = crown.sketch(&crown.all(), 1.0, Vec3::Z);
    let cell = 2.0 * 1.3 * 60.0 / 128.0;
    assert!((both.covered() * cell * cell / 2400.0 - 1.0).abs() < 0.05, "{}", both.covered());
    let shown = |s: f32| crown.shows(&both, 0, crown.place(0, 1.0, s, 0.1));
    assert!(shown(-0.5) && !shown(0.5));
    // The other is lit and so is the half of the lower one that is seen.
    assert!((crown.light(&both, &[crown.sketch(&crown.all(), 1.0, Vec3::Z)])[0] - 1.0).abs() < 0.02);
    let bare = Crown::new(vec![leaf(Vec3::ZERO)], (Vec3::ZERO, 60.0));
    let aslant = Vec3::new(0.6, 0.0, 0.8);
    let light = bare.light(&bare.sketch(&bare.all(), 1.0, Vec3::Z), &[bare.sketch(&bare.all(), 1.0, aslant)])[0];
    assert!((light - 0.8).abs() < 1e-3, "{light}");
}
