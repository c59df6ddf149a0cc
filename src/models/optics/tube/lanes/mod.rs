//! Several f64 at a time: AVX-512, AVX2 with FMA, or plain arrays, chosen when the program runs.
//!
//! It has only what the tube integral and its fit need. The intrinsics are in `#[inline(always)]` methods, which are
//! sound only where the caller was compiled for the instruction set. [`dispatch`] is such a
//! caller, and the only one: nobody else can name the types whose methods these are.

use mesophyll_base::processor::InstructionSet;

/// A few f64.
pub trait Lanes: Copy {
    /// How many lanes there are.
    const N: usize;
    /// A truth value a lane.
    type Mask: Copy;
    /// The same number in every lane.
    fn splat(x: f64) -> Self;
    /// The first `N` values of `from`, which must have as many.
    fn load(from: &[f64]) -> Self;
    /// Writes the lanes into the first `N` places of `to`.
    fn store(self, to: &mut [f64]);
    /// self + o.
    fn add(self, o: Self) -> Self;
    /// self − o.
    fn sub(self, o: Self) -> Self;
    /// self · o.
    fn mul(self, o: Self) -> Self;
    /// self / o.
    fn div(self, o: Self) -> Self;
    /// self · b + c
    fn fma(self, b: Self, c: Self) -> Self;
    /// The smaller of both, lane by lane.
    fn min(self, o: Self) -> Self;
    /// The larger of both, lane by lane.
    fn max(self, o: Self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// Where self < o.
    fn less(self, o: Self) -> Self::Mask;
    /// `self` where the mask is set, else `o`.
    fn or(self, mask: Self::Mask, o: Self) -> Self;
    /// Where both masks are set.
    fn both(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// Whether the mask is set anywhere.
    fn any(mask: Self::Mask) -> bool;
    /// Whether the mask is set everywhere.
    fn all(mask: Self::Mask) -> bool;
    /// 1/x to 1e-8, for normal x.
    fn recip(self) -> Self;
    /// e^x for −700 ≤ x ≤ 0 to 1e-8 relative; smaller x give 0 or nearly.
    fn exp(self) -> Self;
    /// Sum of the lanes.
    fn sum(self) -> f64;
    /// The largest lane; NaN lanes may or may not be noticed.
    fn most(self) -> f64;
}

/// e^r on |r| ≤ ½ ln 2: Taylor to degree 7 (remainder 5e-9).
const EXP: [f64; 6] = [1.0 / 5040.0, 1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5];
const LOG2E: f64 = std::f64::consts::LOG2_E;
const LN2: f64 = std::f64::consts::LN_2;
/// Adding 1.5·2⁵² leaves the nearest integer in the low bits.
const MAGIC: f64 = 6755399441055744.0;

/// Arrays, for processors with neither instruction set.
#[derive(Clone, Copy)]
pub struct ArrayLanes([f64; 4]);

impl ArrayLanes {
    #[inline(always)]
    fn map(self, f: impl Fn(f64) -> f64) -> Self {
        ArrayLanes(self.0.map(f))
    }
    #[inline(always)]
    fn zip(self, o: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        ArrayLanes(std::array::from_fn(|k| f(self.0[k], o.0[k])))
    }
}

impl Lanes for ArrayLanes {
    const N: usize = 4;
    type Mask = [bool; 4];
    #[inline(always)]
    fn splat(x: f64) -> Self {
        ArrayLanes([x; 4])
    }
    #[inline(always)]
    fn load(from: &[f64]) -> Self {
        ArrayLanes([from[0], from[1], from[2], from[3]])
    }
    #[inline(always)]
    fn store(self, to: &mut [f64]) {
        to[..4].copy_from_slice(&self.0);
    }
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        self.zip(o, |a, b| a + b)
    }
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        self.zip(o, |a, b| a - b)
    }
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        self.zip(o, |a, b| a * b)
    }
    #[inline(always)]
    fn div(self, o: Self) -> Self {
        self.zip(o, |a, b| a / b)
    }
    #[inline(always)]
    fn fma(self, b: Self, c: Self) -> Self {
        ArrayLanes(std::array::from_fn(|k| self.0[k] * b.0[k] + c.0[k]))
    }
    #[inline(always)]
    fn min(self, o: Self) -> Self {
        self.zip(o, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn max(self, o: Self) -> Self {
        self.zip(o, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.map(f64::sqrt)
    }
    #[inline(always)]
    fn less(self, o: Self) -> [bool; 4] {
        std::array::from_fn(|k| self.0[k] < o.0[k])
    }
    #[inline(always)]
    fn or(self, mask: [bool; 4], o: Self) -> Self {
        ArrayLanes(std::array::from_fn(|k| if mask[k] { self.0[k] } else { o.0[k] }))
    }
    #[inline(always)]
    fn both(a: [bool; 4], b: [bool; 4]) -> [bool; 4] {
        std::array::from_fn(|k| a[k] & b[k])
    }
    #[inline(always)]
    fn any(mask: [bool; 4]) -> bool {
        mask[0] | mask[1] | mask[2] | mask[3]
    }
    #[inline(always)]
    fn all(mask: [bool; 4]) -> bool {
        mask[0] & mask[1] & mask[2] & mask[3]
    }
    #[inline(always)]
    fn recip(self) -> Self {
        self.map(|x| 1.0 / x)
    }
    #[inline(always)]
    fn exp(self) -> Self {
        self.map(|x| {
            let x = if x > -700.0 { x } else { -700.0 };
            let k = x * LOG2E + MAGIC;
            let r = x - (k - MAGIC) * LN2;
            let mut p = EXP[0];
            for c in &EXP[1..] {
                p = p * r + c;
            }
            let p = (p * r + 1.0) * r + 1.0;
            f64::from_bits(p.to_bits().wrapping_add(k.to_bits() << 52))
        })
    }
    #[inline(always)]
    fn sum(self) -> f64 {
        (self.0[0] + self.0[2]) + (self.0[1] + self.0[3])
    }
    #[inline(always)]
    fn most(self) -> f64 {
        self.0[0].max(self.0[1]).max(self.0[2].max(self.0[3]))
    }
}

#[cfg(target_arch = "x86_64")]
mod x86;

/// The largest number of values in a vector; columns are padded to whole vectors.
pub(crate) const PAD: usize = 8;

/// `n` rounded up to whole vectors.
pub fn padded(n: usize) -> usize {
    n.div_ceil(PAD) * PAD
}

/// Work that is done with vectors of any kind.
pub trait LaneJob {
    /// What it gives.
    type Output;
    /// Does it; `#[inline(always)]`, so that it is compiled for the vectors' instruction set.
    fn run<L: Lanes>(self) -> Self::Output;
}

/// Does `job` with the vectors of `set`, or of the largest set that the processor has.
#[inline]
pub fn dispatch<J: LaneJob>(set: InstructionSet, job: J) -> J::Output {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx2,fma")]
        fn avx2<J: LaneJob>(job: J) -> J::Output {
            job.run::<x86::Avx2>()
        }
        #[target_feature(enable = "avx512f")]
        fn avx512<J: LaneJob>(job: J) -> J::Output {
            job.run::<x86::Avx512>()
        }
        match set.or_less() {
            // SAFETY: `or_less` gives only what this processor has.
            InstructionSet::Avx512 => return unsafe { avx512(job) },
            // SAFETY: as above.
            InstructionSet::Avx2 => return unsafe { avx2(job) },
            InstructionSet::Plain => {}
        }
    }
    let _ = set;
    job.run::<ArrayLanes>()
}

/// Compiles a generic `#[inline(always)]` function for each instruction set and calls the one of `set` by [`dispatch`]:
/// `dispatch_lanes!(set, function(arg: Type, …) -> Return)`.
#[macro_export]
macro_rules! dispatch_lanes {
    ($set:expr, $function:ident($($arg:ident : $type:ty),* $(,)?)) => {
        $crate::dispatch_lanes!($set, $function($($arg: $type),*) -> ())
    };
    ($set:expr, $function:ident($($arg:ident : $type:ty),* $(,)?) -> $ret:ty) => {{
        struct Call<T>(T);
        impl $crate::tube::lanes::LaneJob for Call<($($type,)*)> {
            type Output = $ret;
            #[inline(always)]
            fn run<L: $crate::tube::lanes::Lanes>(self) -> $ret {
                let ($($arg,)*) = self.0;
                $function::<L>($($arg),*)
            }
        }
        $(let $arg: $type = $arg;)*
        $crate::tube::lanes::dispatch($set, Call(($($arg,)*)))
    }};
}

#[cfg(test)]
mod tests {
    use super::*;

    #[inline(always)]
    fn table<L: Lanes>(x: &[f64], exp: &mut [f64], recip: &mut [f64]) {
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
            dispatch_lanes!(level, table(xs: &[f64], es: &mut [f64], rs: &mut [f64]));
            for k in 0..x.len() {
                assert!((e[k] / x[k].exp() - 1.0).abs() < 1e-8, "{level:?} exp {}: {}", x[k], e[k]);
                assert!((r[k] * x[k] - 1.0).abs() < 1e-8, "{level:?} 1/{}", x[k]);
            }
        }
    }
}
