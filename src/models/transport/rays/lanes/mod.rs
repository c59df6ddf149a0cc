//! Arithmetic on eight f32 at a time: with vector instructions where the processor has AVX2 and FMA, with an array
//! elsewhere.

#[cfg(target_arch = "x86_64")]
mod x86;

use crate::rays::traversal::Waiting;

/// Number of lanes of a vector.
pub(crate) const WIDTH: usize = 8;

/// A vector of eight f32. Comparisons return one bit for each lane, with lane 0 in the lowest bit. A comparison with
/// NaN is false.
pub(crate) trait Lanes: Copy {
    fn splat(x: f32) -> Self;
    /// Eight f32 from their bits.
    fn load(from: &[u32; WIDTH]) -> Self;
    fn store(self) -> [f32; WIDTH];
    fn add(self, o: Self) -> Self;
    fn sub(self, o: Self) -> Self;
    fn mul(self, o: Self) -> Self;
    /// self·b + c, with one rounding or two.
    fn mul_add(self, b: Self, c: Self) -> Self;
    /// self·b − c, with one rounding or two.
    fn mul_sub(self, b: Self, c: Self) -> Self;
    fn div(self, o: Self) -> Self;
    fn min(self, o: Self) -> Self;
    fn max(self, o: Self) -> Self;
    /// The absolute value.
    #[inline(always)]
    fn abs(self) -> Self {
        self.flip(self.sign())
    }
    /// Only the sign bits; all other bits are 0.
    fn sign(self) -> Self;
    /// self, with the sign changed where the sign bit of `o` is set.
    fn flip(self, o: Self) -> Self;
    /// The lanes where self ≤ o.
    fn at_most(self, o: Self) -> u32;
    /// Takes the lanes where `self` ≤ `far` into order, the largest `self` first, and returns how many there are. Entry
    /// k of `to` becomes the code of the k-th of them and its value (at least 0), less the last three bits. What is
    /// written behind them has no meaning.
    fn order(self, far: Self, codes: &[u32; WIDTH], to: &mut [Waiting; WIDTH]) -> usize;
    /// self where self ≤ far, and +∞ elsewhere.
    fn or_infinite(self, far: Self) -> Self;
    /// The lanes where the sign bit is set.
    fn signs(self) -> u32;
}

/// The version for processors without these vector instructions.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Plain([f32; WIDTH]);

impl Plain {
    #[inline(always)]
    fn with(self, o: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Plain(std::array::from_fn(|k| f(self.0[k], o.0[k])))
    }
}

impl Lanes for Plain {
    #[inline(always)]
    fn splat(x: f32) -> Self {
        Plain([x; WIDTH])
    }
    #[inline(always)]
    fn load(from: &[u32; WIDTH]) -> Self {
        Plain(from.map(f32::from_bits))
    }
    #[inline(always)]
    fn store(self) -> [f32; WIDTH] {
        self.0
    }
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        self.with(o, |a, b| a + b)
    }
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        self.with(o, |a, b| a - b)
    }
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        self.with(o, |a, b| a * b)
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        self.mul(b).add(c)
    }
    #[inline(always)]
    fn mul_sub(self, b: Self, c: Self) -> Self {
        self.mul(b).sub(c)
    }
    #[inline(always)]
    fn div(self, o: Self) -> Self {
        self.with(o, |a, b| a / b)
    }
    #[inline(always)]
    fn min(self, o: Self) -> Self {
        self.with(o, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn max(self, o: Self) -> Self {
        self.with(o, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn sign(self) -> Self {
        Plain(self.0.map(|a| f32::from_bits(a.to_bits() & 1 << 31)))
    }
    #[inline(always)]
    fn flip(self, o: Self) -> Self {
        self.with(o, |a, b| f32::from_bits(a.to_bits() ^ b.to_bits()))
    }
    #[inline(always)]
    fn at_most(self, o: Self) -> u32 {
        (0..WIDTH).fold(0, |mask, k| mask | u32::from(self.0[k] <= o.0[k]) << k)
    }
    #[inline(always)]
    fn order(self, far: Self, codes: &[u32; WIDTH], to: &mut [Waiting; WIDTH]) -> usize {
        let mut count = 0;
        for lane in (0..WIDTH).filter(|k| self.0[*k] <= far.0[*k]) {
            let near = f32::from_bits(self.0[lane].to_bits() & !(WIDTH as u32 - 1));
            let mut at = count;
            while at > 0 && to[at - 1].near < near {
                to[at] = to[at - 1];
                at -= 1;
            }
            to[at] = Waiting { code: codes[lane], near };
            count += 1;
        }
        count
    }
    #[inline(always)]
    fn or_infinite(self, far: Self) -> Self {
        self.with(far, |a, b| if a <= b { a } else { f32::INFINITY })
    }
    #[inline(always)]
    fn signs(self) -> u32 {
        (0..WIDTH).fold(0, |mask, k| mask | (self.0[k].to_bits() >> 31) << k)
    }
}

#[cfg(target_arch = "x86_64")]
pub(crate) use x86::Avx2;

/// Prefetches `LINES` cache lines that will soon be read.
#[inline(always)]
pub(crate) fn prefetch<const LINES: usize, T>(from: *const T) {
    #[cfg(target_arch = "x86_64")]
    for line in 0..LINES {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: a prefetch has no effect that a program can observe, whatever the address.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(from.cast::<i8>().wrapping_add(64 * line)) };
    }
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

/// Compiles a generic `#[inline(always)]` function for each instruction set, and calls the version for `set`:
/// `dispatch!(set, [flags], [generics] function(arg: Type, …) -> Return)`.
macro_rules! dispatch {
    (
        $set:expr, [$($flag:ident),*], [$($generic:ident: $bound:path),*],
        $function:ident($($arg:ident: $type:ty),*) -> $ret:ty
    ) => {{
        #[cfg(target_arch = "x86_64")]
        {
            #[target_feature(enable = "avx2,fma,bmi1")]
            fn avx2<$(const $flag: bool,)* $($generic: $bound),*>($($arg: $type),*) -> $ret {
                $function::<$crate::rays::lanes::Avx2, $($flag,)* $($generic),*>($($arg),*)
            }
            if $set >= mesophyll_base::processor::InstructionSet::Avx2 {
                // SAFETY: `InstructionSet::or_less` and `detect` name only what this processor has.
                unsafe { avx2::<$($flag,)* $($generic),*>($($arg),*) }
            } else {
                $function::<$crate::rays::lanes::Plain, $($flag,)* $($generic),*>($($arg),*)
            }
        }
        #[cfg(not(target_arch = "x86_64"))]
        {
            let _ = $set;
            $function::<$crate::rays::lanes::Plain, $($flag,)* $($generic),*>($($arg),*)
        }
    }};
}
pub(crate) use dispatch;
