//! Several numbers at a time, with AVX-512, AVX2 and FMA, or plain arrays, chosen when the program runs.
//!
//! A loop is written once, as a generic function over [`Lanes`], and [`dispatch_lanes!`](crate::dispatch_lanes)
//! compiles it for each instruction set. There are only the operations that such loops need.
//!
//! The intrinsics are in `#[inline(always)]` methods, which are sound only where the caller was compiled for the
//! instruction set. [`dispatch`] is such a caller, and the only one: nobody else can name the types whose methods these
//! are.

#![warn(missing_docs)]

mod array;
mod dispatch;
#[cfg(target_arch = "x86_64")]
mod x86;

pub use dispatch::{LaneJob, LaneSet, dispatch, widest};

/// A few numbers.
pub trait Lanes: Copy {
    /// How many lanes there are.
    const N: usize;
    /// Whether [`Lanes::fma`] rounds once, so that it is an instruction of the processor.
    const FUSED: bool;
    /// What is in a lane.
    type Number: Copy;
    /// A truth value a lane. A comparison with NaN is false.
    type Mask: Copy;
    /// The same number in every lane.
    fn splat(x: Self::Number) -> Self;
    /// The first `N` values of `from`, which must have as many.
    fn load(from: &[Self::Number]) -> Self;
    /// Writes the lanes into the first `N` places of `to`.
    fn store(self, to: &mut [Self::Number]);
    /// self + o.
    fn add(self, o: Self) -> Self;
    /// self − o.
    fn sub(self, o: Self) -> Self;
    /// self · o.
    fn mul(self, o: Self) -> Self;
    /// self / o.
    fn div(self, o: Self) -> Self;
    /// self · b + c, with one rounding or two.
    fn fma(self, b: Self, c: Self) -> Self;
    /// self · b − c, with one rounding or two.
    fn fms(self, b: Self, c: Self) -> Self;
    /// The smaller of both, lane by lane.
    fn min(self, o: Self) -> Self;
    /// The larger of both, lane by lane.
    fn max(self, o: Self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// Where self < o.
    fn less(self, o: Self) -> Self::Mask;
    /// Where self ≤ o.
    fn at_most(self, o: Self) -> Self::Mask;
    /// `self` where the mask is set, else `o`.
    fn or(self, mask: Self::Mask, o: Self) -> Self;
    /// Where both masks are set.
    fn both(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// One bit a lane, that of the first lane the lowest.
    fn bits(mask: Self::Mask) -> u32;
    /// Whether the mask is set anywhere.
    #[inline(always)]
    fn any(mask: Self::Mask) -> bool {
        Self::bits(mask) != 0
    }
    /// Whether the mask is set everywhere.
    #[inline(always)]
    fn all(mask: Self::Mask) -> bool {
        Self::bits(mask) == (1 << Self::N) - 1
    }
}

/// e^r on |r| ≤ ½ ln 2: Taylor to degree 7 (remainder 5e-9).
const EXP: [f64; 6] = [1.0 / 5040.0, 1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5];
/// Adding 1.5·2⁵² leaves the nearest integer in the low bits.
const MAGIC: f64 = 6755399441055744.0;

/// A few f64.
pub trait DoubleLanes: Lanes<Number = f64> {
    /// Sum of the lanes.
    fn sum(self) -> f64;
    /// The largest lane; NaN lanes may or may not be noticed.
    fn most(self) -> f64;
    /// self · 2^k, where k is the integer in the lowest bits of `k`, and the result is a normal number.
    fn scaled(self, k: Self) -> Self;
    /// 1/x to 1e-8, for normal x.
    #[inline(always)]
    fn recip(self) -> Self {
        Self::splat(1.0).div(self)
    }
    /// e^x for −700 ≤ x ≤ 0 to 1e-8 relative; smaller x give 0 or nearly.
    #[inline(always)]
    fn exp(self) -> Self {
        let (one, magic) = (Self::splat(1.0), Self::splat(MAGIC));
        let x = self.max(Self::splat(-700.0));
        let k = x.fma(Self::splat(std::f64::consts::LOG2_E), magic);
        let r = k.sub(magic).fma(Self::splat(-std::f64::consts::LN_2), x);
        let mut p = Self::splat(EXP[0]);
        for c in &EXP[1..] {
            p = p.fma(r, Self::splat(*c));
        }
        p.fma(r, one).fma(r, one).scaled(k)
    }
}

/// How many f32 there are in a vector of them.
pub const WIDTH: usize = 8;

/// What waits to be looked at, such as a box that a ray enters.
#[derive(Debug, Clone, Copy, Default)]
#[repr(C)]
pub struct Waiting {
    /// What it is.
    pub code: u32,
    /// Where it begins.
    pub near: f32,
}

/// Eight f32.
pub trait SingleLanes: Lanes<Number = f32> {
    /// Eight f32 from their bits.
    fn from_bits(bits: &[u32; WIDTH]) -> Self;
    /// Only the sign bits; all other bits are 0.
    fn sign(self) -> Self;
    /// self, with the sign changed where the sign bit of `o` is set.
    fn flip(self, o: Self) -> Self;
    /// The lanes where the sign bit is set, as [`Lanes::bits`].
    fn signs(self) -> u32;
    /// Takes the lanes where `self` ≤ `far` into order, the largest `self` first, and returns how many there are. Entry
    /// k of `to` becomes the code of the k-th of them and its value (at least 0), less the last three bits. What is
    /// written behind them has no meaning.
    fn order(self, far: Self, codes: &[u32; WIDTH], to: &mut [Waiting; WIDTH]) -> usize;
    /// The absolute value.
    #[inline(always)]
    fn abs(self) -> Self {
        self.flip(self.sign())
    }
}

/// The largest number of f64 in a vector; columns are padded to whole vectors.
pub const PAD: usize = 8;

/// `n` rounded up to whole vectors.
pub fn padded(n: usize) -> usize {
    n.div_ceil(PAD) * PAD
}

/// Prefetches `LINES` cache lines that will soon be read.
#[inline(always)]
pub fn prefetch<const LINES: usize, T>(from: *const T) {
    #[cfg(target_arch = "x86_64")]
    x86::prefetch::<LINES>(from.cast());
    #[cfg(not(target_arch = "x86_64"))]
    let _ = from;
}

/// Fetches numbers from memory, ahead of time: at most two cache lines of them.
#[inline]
pub fn fetch<T>(soon: &[T]) {
    let (from, bytes) = (soon.as_ptr().cast::<u8>(), size_of_val(soon));
    prefetch::<1, _>(from);
    prefetch::<1, _>(from.wrapping_add(bytes.saturating_sub(1)));
}

#[cfg(test)]
mod tests;
