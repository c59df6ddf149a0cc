//! Random numbers and elementary functions for many rays at a time, in single precision and without branches, so that a
//! compiler makes vector code of every loop over them.
//!
//! Single precision is enough: a ray that is off by 1e-7 takes another path with a probability of about 1e-7, while 1e9
//! rays tell shares apart by 1e-5.

/// Streams of random numbers that run side by side.
pub const LANES: usize = 16;

/// Sixteen generators xoshiro128++ (Blackman & Vigna 2021) side by side.
#[derive(Debug, Clone)]
pub struct RandomLanes {
    state: [[u32; LANES]; 4],
}

impl RandomLanes {
    /// The streams of part `part`, started by `seed`.
    pub fn new(seed: u64, part: u64) -> RandomLanes {
        let mut at = mix(seed ^ mix(part ^ 0x5851_f42d_4c95_7f2d));
        let mut state = [[0; LANES]; 4];
        for lane in 0..LANES {
            for word in 0..2 {
                at = at.wrapping_add(0x9e37_79b9_7f4a_7c15);
                let bits = mix(at);
                state[2 * word][lane] = bits as u32;
                state[2 * word + 1][lane] = (bits >> 32) as u32;
            }
        }
        RandomLanes { state }
    }

    /// Fills `out`, whose length is a multiple of [`LANES`], with uniform numbers in (0, 1].
    #[inline(always)]
    pub fn fill(&mut self, out: &mut [f32]) {
        let [mut a, mut b, mut c, mut d] = self.state;
        for out in out.as_chunks_mut::<LANES>().0 {
            for k in 0..LANES {
                let bits = a[k].wrapping_add(d[k]).rotate_left(7).wrapping_add(a[k]);
                let t = b[k] << 9;
                c[k] ^= a[k];
                d[k] ^= b[k];
                b[k] ^= c[k];
                a[k] ^= d[k];
                c[k] ^= t;
                d[k] = d[k].rotate_left(11);
                // the signed conversion is one instruction everywhere
                out[k] = ((bits >> 8) as i32 as f32 + 0.5) * (1.0 / 16_777_216.0);
            }
        }
        self.state = [a, b, c, d];
    }
}

/// The finaliser of SplitMix64 (Steele et al. 2014).
fn mix(x: u64) -> u64 {
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// log₂ x for normal x > 0, to 2e-7 of 1 + |log₂ x|.
#[inline(always)]
pub fn log2(x: f32) -> f32 {
    // x = 2^e · m with m between √½ and √2
    let bits = x.to_bits() as i32;
    let e = (bits - 0x3f35_04f3) >> 23;
    let m = f32::from_bits((bits - (e << 23)) as u32);
    // ln m = 2 artanh((m − 1)/(m + 1))
    let t = (m - 1.0) / (m + 1.0);
    let q = t * t;
    let series = 1.0 + q * (1.0 / 3.0 + q * (0.2 + q * (1.0 / 7.0 + q * (1.0 / 9.0))));
    e as f32 + t * series * (2.0 * std::f32::consts::LOG2_E)
}

/// 2^x for x ≤ 0, to 2e-7; 0 below −126.
#[inline(always)]
pub fn exp2(x: f32) -> f32 {
    let x = if x > -126.0 { x } else { -127.0 };
    // Rounds to the nearest whole number: the sum has no digits left for a fraction.
    let shifted = x + 12_582_912.0;
    let f = (x - (shifted - 12_582_912.0)) * std::f32::consts::LN_2;
    let series =
        1.0 + f * (1.0 + f * (0.5 + f * (1.0 / 6.0 + f * (1.0 / 24.0 + f * (1.0 / 120.0 + f * (1.0 / 720.0))))));
    let e = (shifted.to_bits() as i32).wrapping_sub(0x4b40_0000).wrapping_add(127) << 23;
    series * f32::from_bits(e.max(0) as u32)
}

/// 1 − 2^x for x ≤ 0, with all digits near x = 0.
#[inline(always)]
pub fn falls_short(x: f32) -> f32 {
    let y = -x * std::f32::consts::LN_2;
    let near = y * (1.0 - y * (0.5 - y * (1.0 / 6.0 - y * (1.0 / 24.0 - y * (1.0 / 120.0)))));
    if y < 0.1 { near } else { 1.0 - exp2(x) }
}

/// cos πx for x in [0, 1], to 1e-7.
#[inline(always)]
pub fn cos_pi(x: f32) -> f32 {
    // sin π(½ − x)
    let t = (0.5 - x) * std::f32::consts::PI;
    let q = t * t;
    let tail = 1.0 / 362_880.0 - q * (1.0 / 39_916_800.0);
    t * (1.0 - q * (1.0 / 6.0 - q * (1.0 / 120.0 - q * (1.0 / 5_040.0 - q * tail))))
}

/// cos x for x in [0, 1], to 1e-7.
#[inline(always)]
pub fn cos(x: f32) -> f32 {
    let q = x * x;
    1.0 - q * (0.5 - q * (1.0 / 24.0 - q * (1.0 / 720.0 - q * (1.0 / 40_320.0 - q * (1.0 / 3_628_800.0)))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_agree_with_those_of_the_library() {
        for k in 1..=20_000u32 {
            let x = k as f32 / 20_000.0;
            let exactly = f64::from(x);
            let close = |got: f32, want: f64, by: f64| assert!((f64::from(got) - want).abs() < by, "{x}: {got} {want}");
            close(log2(x), exactly.log2(), 3e-7 * (1.0 - exactly.log2()));
            close(cos(x), exactly.cos(), 2e-7);
            close(cos_pi(x), (std::f64::consts::PI * exactly).cos(), 3e-7);
            let y = -40.0 * x;
            close(exp2(y), f64::from(y).exp2(), 3e-7 * f64::from(y).exp2());
            let want = -(f64::from(y) * std::f64::consts::LN_2).exp_m1();
            close(falls_short(y), want, 5e-7 * want);
            close(
                falls_short(1e-4 * y),
                -(1e-4f32 as f64 * f64::from(y) * std::f64::consts::LN_2).exp_m1(),
                1e-6 * want,
            );
        }
        assert_eq!([exp2(-1e9), exp2(f32::NEG_INFINITY), exp2(0.0), log2(1.0)], [0.0, 0.0, 1.0, 0.0]);
    }

    #[test]
    fn numbers_are_uniform_and_streams_differ() {
        let (mut a, mut b) = (RandomLanes::new(1, 0), RandomLanes::new(1, 1));
        let (mut x, mut y) = (vec![0.0; 1 << 16], vec![0.0; 1 << 16]);
        a.fill(&mut x);
        b.fill(&mut y);
        let n = x.len() as f64;
        let mean = |v: &[f32]| v.iter().map(|&u| f64::from(u)).sum::<f64>() / n;
        let square = |v: &[f32]| v.iter().map(|&u| f64::from(u).powi(2)).sum::<f64>() / n;
        let product = x.iter().zip(&y).map(|(&a, &b)| f64::from(a) * f64::from(b)).sum::<f64>() / n;
        assert!(x.iter().all(|u| (0.0..=1.0).contains(u) && *u > 0.0));
        // five standard errors
        assert!((mean(&x) - 0.5).abs() < 5.0 * (1.0 / 12.0 / n).sqrt());
        assert!((square(&x) - 1.0 / 3.0).abs() < 5.0 * (4.0 / 45.0 / n).sqrt());
        assert!((product - 0.25).abs() < 5.0 * (7.0 / 144.0 / n).sqrt());
    }
}
