use super::*;
use crate::dispatch_lanes;
use crate::processor::InstructionSet;

#[inline(always)]
fn table<L: DoubleLanes>(x: &[f64], exp: &mut [f64], recip: &mut [f64]) {
    for k in (0..x.len()).step_by(L::N) {
        L::load(&x[k..]).exp().store(&mut exp[k..]);
        L::load(&x[k..]).recip().store(&mut recip[k..]);
    }
}

#[test]
fn exp_and_reciprocal() {
    let x: Vec<f64> = (1..=4000).map(|k| -f64::from(k) * 0.0173).collect();
    // A set that the processor lacks is answered by a smaller one.
    for level in InstructionSet::ALL {
        let (mut e, mut r) = (vec![0.0; x.len()], vec![0.0; x.len()]);
        let (xs, es, rs) = (&x[..], &mut e[..], &mut r[..]);
        dispatch_lanes!(level, F64, table(xs: &[f64], es: &mut [f64], rs: &mut [f64]));
        for k in 0..x.len() {
            assert!((e[k] / x[k].exp() - 1.0).abs() < 1e-8, "{level:?} exp {}: {}", x[k], e[k]);
            assert!((r[k] * x[k] - 1.0).abs() < 1e-8, "{level:?} 1/{}", x[k]);
        }
    }
}

/// Everything that is exact, of two lists of numbers.
#[inline(always)]
fn exact<L: Lanes>(a: &[L::Number], b: &[L::Number], to: &mut Vec<L::Number>) -> Vec<u32> {
    let mut bits = Vec::new();
    for k in (0..a.len()).step_by(L::N) {
        let (x, y) = (L::load(&a[k..]), L::load(&b[k..]));
        let (less, at_most) = (x.less(y), x.at_most(y));
        let both = L::both(less, at_most);
        for lanes in
            [x.add(y), x.sub(y), x.mul(y), x.div(y), x.min(y), x.max(y), x.mul(x).sqrt(), x.or(less, y), L::splat(a[k])]
        {
            let start = to.len();
            to.extend_from_slice(&a[k..k + L::N]);
            lanes.store(&mut to[start..]);
        }
        bits.extend([less, at_most, both].map(L::bits));
        assert!(L::any(less) == (L::bits(less) != 0) && L::all(less) == (L::bits(less).count_ones() == L::N as u32));
    }
    bits
}

#[inline(always)]
fn exact_doubles<L: DoubleLanes>(a: &[f64], b: &[f64]) -> (Vec<f64>, Vec<u32>, usize, [f64; 2]) {
    let mut to = Vec::new();
    let bits = exact::<L>(a, b, &mut to);
    (to, bits, L::N, [L::load(a).sum(), L::load(a).most()])
}

#[inline(always)]
fn exact_singles<L: SingleLanes>(a: &[f32], b: &[f32]) -> (Vec<f32>, Vec<u32>, Vec<[u32; 3]>) {
    let mut to = Vec::new();
    let bits = exact::<L>(a, b, &mut to);
    let codes = [9, 8, 7, 6, 5, 4, 3, 2];
    let mut found = Vec::new();
    for k in (0..a.len()).step_by(WIDTH) {
        let lanes = L::from_bits(&std::array::from_fn(|j| a[k + j].to_bits()));
        let mut room = [Waiting::default(); WIDTH];
        let count = lanes.abs().order(L::load(&b[k..]), &codes, &mut room);
        found.extend(room[..count].iter().map(|w| [w.code, w.near.to_bits(), lanes.signs()]));
    }
    (to, bits, found)
}

/// Numbers of both signs, without a pattern.
fn numbers(count: u32, seed: u32) -> Vec<f64> {
    (0..count).map(|k| f64::from((k + seed).wrapping_mul(2_654_435_761) >> 8) / f64::from(1 << 23) - 1.0).collect()
}

#[test]
fn all_sets_compute_the_same() {
    let (a, b) = (numbers(64, 1), numbers(64, 1000));
    let (a32, b32) = (a.iter().map(|x| *x as f32).collect::<Vec<_>>(), b.iter().map(|x| *x as f32).collect::<Vec<_>>());
    let (x, y, s, t) = (&a[..], &b[..], &a32[..], &b32[..]);
    let plain = dispatch_lanes!(InstructionSet::Plain, F32, exact_singles(s: &[f32], t: &[f32])
        -> (Vec<f32>, Vec<u32>, Vec<[u32; 3]>));
    assert!(plain.2.len() > 8, "{:?}", plain.2);
    for set in InstructionSet::available() {
        let (found, bits, n, [sum, most]) = dispatch_lanes!(set, F64, exact_doubles(x: &[f64], y: &[f64])
            -> (Vec<f64>, Vec<u32>, usize, [f64; 2]));
        for k in 0..a.len() {
            let (p, q) = (a[k], b[k]);
            let want = [p + q, p - q, p * q, p / q, p.min(q), p.max(q), p.abs(), if p < q { p } else { q }];
            let [block, lane] = [k / n, k % n];
            for (which, want) in want.into_iter().enumerate() {
                assert_eq!(found[(9 * block + which) * n + lane], want, "{set:?}: operation {which} of {p} and {q}");
            }
            assert!((0..3).all(|which| (bits[3 * block + which] >> lane & 1 == 1) == (p < q)), "{set:?}");
        }
        let total: f64 = a[..n].iter().sum();
        assert!((sum - total).abs() < 1e-14 && most == a[..n].iter().fold(f64::MIN, |m, v| m.max(*v)), "{set:?}");
        let singles = dispatch_lanes!(set, F32, exact_singles(s: &[f32], t: &[f32])
            -> (Vec<f32>, Vec<u32>, Vec<[u32; 3]>));
        assert_eq!(singles, plain, "{set:?}");
    }
}
