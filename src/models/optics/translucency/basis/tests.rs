use super::*;
use std::f64::consts::PI;

fn all() -> Vec<HemisphereBasis> {
    let mut list = vec![HemisphereBasis::HalfLife2];
    list.extend([3, 6].map(|count| HemisphereBasis::Bent { count }));
    list.extend([4, 6].map(|count| HemisphereBasis::HBasis { count }));
    list.extend([1, 2, 3, 4].map(|bands| HemisphereBasis::Spherical { bands }));
    list.extend([1, 2, 3, 4].map(|bands| HemisphereBasis::Hemispherical { bands }));
    list.extend([1, 2, 3].map(|degree| HemisphereBasis::Cosine { degree }));
    list
}

/// The function whose coefficients are given, in one direction: Σ c_i φ_i(ω).
fn reconstruct(basis: HemisphereBasis, coefficients: &[f64], direction: [f64; 3]) -> f64 {
    coefficients.iter().enumerate().map(|(i, c)| c * basis.value(i, direction)).sum()
}

/// The Half-Life 2 coefficients of v·ω.
fn from_vector(v: [f64; 3]) -> [f64; 3] {
    HALF_LIFE_2.map(|h| (TAU / 3.0).sqrt() * (h[0] * v[0] + h[1] * v[1] + h[2] * v[2]))
}

fn gram(basis: HemisphereBasis, i: usize, j: usize) -> f64 {
    let rule = DirectionSet::new(DirectionRule::Product { levels: 20, azimuths: 24 });
    rule.directions.iter().zip(&rule.weights).map(|(d, w)| w * basis.value(i, *d) * basis.value(j, *d)).sum()
}

#[test]
fn names_are_read_back() {
    for basis in all() {
        assert_eq!(HemisphereBasis::named(&basis.name()), Some(basis));
    }
    for name in ["", "half-life-3", "cosine-4", "none: one light", "bent-5", "spherical-8"] {
        assert_eq!(HemisphereBasis::named(name), None, "{name}");
    }
}

#[test]
fn orthonormal_bases_are() {
    for basis in all() {
        for i in 0..basis.count() {
            for j in 0..basis.count() {
                if basis.orthonormal() {
                    let want = f64::from(u8::from(i == j));
                    assert!((gram(basis, i, j) - want).abs() < 1e-12, "{} {i} {j}", basis.name());
                }
            }
            let norm = gram(basis, i, i);
            assert!(norm > 0.01, "{} {i}: {norm}", basis.name());
            if matches!(basis, HemisphereBasis::Spherical { .. }) {
                // Each real harmonic is even or odd in z: half of the sphere's 1.
                assert!((norm - 0.5).abs() < 1e-12, "{i}: {norm}");
            }
        }
    }
}

#[test]
fn a_flat_leaf_has_the_papers_coefficients() {
    assert!((FLAT - TAU.sqrt() / 3.0).abs() < 1e-15);
    let h = from_vector([0.0, 0.0, 1.0]);
    assert!(h.iter().all(|c| (c - FLAT).abs() < 1e-15));
    let v = vector([0.3, -0.2, 0.9]);
    let back = from_vector(v);
    assert!([0.3, -0.2, 0.9].iter().zip(back).all(|(a, b)| (a - b).abs() < 1e-15));
    let w = [0.48, -0.6, 0.64];
    let dot = v[0] * w[0] + v[1] * w[1] + v[2] * w[2];
    assert!((reconstruct(HemisphereBasis::HalfLife2, &[0.3, -0.2, 0.9], w) - dot).abs() < 1e-15);
    let total: f64 = HemisphereBasis::HalfLife2.integrals().iter().map(|s| FLAT * s).sum();
    // ∫ n·ω dω over the hemisphere is π.
    assert!((total - PI).abs() < 1e-13, "{total}");
}

/// With the Gram matrix of the samples, a function in the span is reproduced exactly. The plain sum misses it by some
/// per cent.
#[test]
fn the_gram_matrix_undoes_the_samples_chance() {
    let mut plain_error = 0.0;
    for seed in 0..20 {
        let lights = DirectionSet::new(DirectionRule::Stratified { count: 128, seed });
        let flat: Vec<f64> = lights.directions.iter().map(|d| d[2]).collect();
        for basis in [HemisphereBasis::HalfLife2, HemisphereBasis::Bent { count: 3 }] {
            let h = Projector::new(basis, &lights, SampleWeights::Gram).unwrap().project(&flat);
            assert!(h.iter().all(|c| (c / FLAT - 1.0).abs() < 1e-12), "{h:?}");
        }
        let h = Projector::new(HemisphereBasis::HalfLife2, &lights, SampleWeights::Plain).unwrap().project(&flat);
        let rule = DirectionSet::new(DirectionRule::Product { levels: 8, azimuths: 16 });
        let square = |d: &[f64; 3]| (reconstruct(HemisphereBasis::HalfLife2, &h, *d) - d[2]).powi(2);
        plain_error += rule.directions.iter().zip(&rule.weights).map(|(d, w)| w * square(d)).sum::<f64>() / 20.0;
    }
    // RMS error over the hemisphere relative to f's own RMS (√(1/3)). It is far above rounding, of the order of 1/√128.
    let relative = (plain_error / TAU * 3.0).sqrt();
    assert!((1e-3..0.1).contains(&relative), "{relative}");
    for basis in all() {
        let lights = DirectionSet::new(DirectionRule::Stratified { count: 128, seed: 3 });
        let wanted: Vec<f64> = (0..basis.count()).map(|i| 0.3 + (i as f64).sin()).collect();
        let samples: Vec<f64> = lights.directions.iter().map(|d| reconstruct(basis, &wanted, *d)).collect();
        let found = Projector::new(basis, &lights, SampleWeights::Gram).unwrap().project(&samples);
        assert!(wanted.iter().zip(&found).all(|(a, b)| (a - b).abs() < 1e-10), "{}", basis.name());
    }
}

#[test]
fn too_few_lights_are_a_sentence() {
    let lights = DirectionSet::new(DirectionRule::Stratified { count: 5, seed: 1 });
    assert!(
        Projector::new(HemisphereBasis::Spherical { bands: 3 }, &lights, SampleWeights::Gram)
            .unwrap_err()
            .contains("5 light directions")
    );
    // Two rings of one height: the constant and z cannot be told apart.
    let ring = DirectionSet::new(DirectionRule::Product { levels: 1, azimuths: 8 });
    assert!(Projector::new(HemisphereBasis::HBasis { count: 4 }, &ring, SampleWeights::Gram).is_err());
    assert!(
        Projector::new(HemisphereBasis::Spherical { bands: 2 }, &ring, SampleWeights::Plain)
            .unwrap_err()
            .contains("orthonormal")
    );
}
