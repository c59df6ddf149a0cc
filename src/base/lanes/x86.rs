//! AVX2 with FMA and AVX-512 on x86-64.

use super::{DoubleLanes, Lanes, SingleLanes, WIDTH, Waiting};
use std::arch::x86_64::*;

/// Methods of a vector that call intrinsics.
macro_rules! intrinsics {
    ($($name:ident($($arg:ident: $type:ty),*) -> $out:ty = $body:expr;)*) => {$(
        #[inline(always)]
        fn $name($($arg: $type),*) -> $out {
            // SAFETY: only functions that are compiled for the instruction set, and entered after a check of the
            // processor, can call this. What reads or writes memory has references to as much of it.
            #[allow(unused_unsafe)] // Masks of AVX-512 are numbers and need no intrinsics.
            unsafe { $body }
        }
    )*};
}

/// A type of vector: the intrinsics that do nothing but what their names say, then the methods that differ by type.
macro_rules! vector {
    (
        $(#[$doc:meta])*
        $vector:ident: $n:literal $number:ident in $register:ty, $mask:ty;
        $splat:ident $load:ident $store:ident $add:ident $sub:ident $mul:ident $div:ident $fma:ident $fms:ident
        $min:ident $max:ident $sqrt:ident $compare:ident;
        $($own:tt)*
    ) => {
        $(#[$doc])*
        #[derive(Clone, Copy)]
        pub struct $vector($register);

        impl Lanes for $vector {
            const N: usize = $n;
            const FUSED: bool = true;
            type Number = $number;
            type Mask = $mask;
            intrinsics! {
                splat(x: $number) -> Self = $vector($splat(x));
                load(from: &[$number]) -> Self = $vector($load(from[..$n].as_ptr()));
                store(self: Self, to: &mut [$number]) -> () = $store(to[..$n].as_mut_ptr(), self.0);
                add(self: Self, o: Self) -> Self = $vector($add(self.0, o.0));
                sub(self: Self, o: Self) -> Self = $vector($sub(self.0, o.0));
                mul(self: Self, o: Self) -> Self = $vector($mul(self.0, o.0));
                div(self: Self, o: Self) -> Self = $vector($div(self.0, o.0));
                fma(self: Self, b: Self, c: Self) -> Self = $vector($fma(self.0, b.0, c.0));
                fms(self: Self, b: Self, c: Self) -> Self = $vector($fms(self.0, b.0, c.0));
                min(self: Self, o: Self) -> Self = $vector($min(self.0, o.0));
                max(self: Self, o: Self) -> Self = $vector($max(self.0, o.0));
                sqrt(self: Self) -> Self = $vector($sqrt(self.0));
                less(self: Self, o: Self) -> $mask = $compare::<_CMP_LT_OQ>(self.0, o.0);
                at_most(self: Self, o: Self) -> $mask = $compare::<_CMP_LE_OQ>(self.0, o.0);
                $($own)*
            }
        }
    };
}

vector! {
    /// Four f64 of AVX2.
    DoublesAvx2: 4 f64 in __m256d, __m256d;
    _mm256_set1_pd _mm256_loadu_pd _mm256_storeu_pd _mm256_add_pd _mm256_sub_pd _mm256_mul_pd _mm256_div_pd
    _mm256_fmadd_pd _mm256_fmsub_pd _mm256_min_pd _mm256_max_pd _mm256_sqrt_pd _mm256_cmp_pd;
    or(self: Self, mask: __m256d, o: Self) -> Self = DoublesAvx2(_mm256_blendv_pd(o.0, self.0, mask));
    both(a: __m256d, b: __m256d) -> __m256d = _mm256_and_pd(a, b);
    bits(mask: __m256d) -> u32 = _mm256_movemask_pd(mask) as u32;
}

vector! {
    /// Eight f32 of AVX2.
    SinglesAvx2: 8 f32 in __m256, __m256;
    _mm256_set1_ps _mm256_loadu_ps _mm256_storeu_ps _mm256_add_ps _mm256_sub_ps _mm256_mul_ps _mm256_div_ps
    _mm256_fmadd_ps _mm256_fmsub_ps _mm256_min_ps _mm256_max_ps _mm256_sqrt_ps _mm256_cmp_ps;
    or(self: Self, mask: __m256, o: Self) -> Self = SinglesAvx2(_mm256_blendv_ps(o.0, self.0, mask));
    both(a: __m256, b: __m256) -> __m256 = _mm256_and_ps(a, b);
    bits(mask: __m256) -> u32 = _mm256_movemask_ps(mask) as u32;
}

vector! {
    /// Eight f64 of AVX-512.
    DoublesAvx512: 8 f64 in __m512d, __mmask8;
    _mm512_set1_pd _mm512_loadu_pd _mm512_storeu_pd _mm512_add_pd _mm512_sub_pd _mm512_mul_pd _mm512_div_pd
    _mm512_fmadd_pd _mm512_fmsub_pd _mm512_min_pd _mm512_max_pd _mm512_sqrt_pd _mm512_cmp_pd_mask;
    or(self: Self, mask: __mmask8, o: Self) -> Self = DoublesAvx512(_mm512_mask_blend_pd(mask, o.0, self.0));
    both(a: __mmask8, b: __mmask8) -> __mmask8 = a & b;
    bits(mask: __mmask8) -> u32 = u32::from(mask);
}

impl DoubleLanes for DoublesAvx2 {
    intrinsics! {
        sum(self: Self) -> f64 = {
            let half = _mm_add_pd(_mm256_castpd256_pd128(self.0), _mm256_extractf128_pd::<1>(self.0));
            _mm_cvtsd_f64(_mm_add_sd(half, _mm_unpackhi_pd(half, half)))
        };
        most(self: Self) -> f64 = {
            let half = _mm_max_pd(_mm256_castpd256_pd128(self.0), _mm256_extractf128_pd::<1>(self.0));
            _mm_cvtsd_f64(_mm_max_sd(half, _mm_unpackhi_pd(half, half)))
        };
        scaled(self: Self, k: Self) -> Self = {
            let shift = _mm256_slli_epi64::<52>(_mm256_castpd_si256(k.0));
            DoublesAvx2(_mm256_castsi256_pd(_mm256_add_epi64(_mm256_castpd_si256(self.0), shift)))
        };
    }
}

impl DoubleLanes for DoublesAvx512 {
    intrinsics! {
        sum(self: Self) -> f64 = _mm512_reduce_add_pd(self.0);
        most(self: Self) -> f64 = _mm512_reduce_max_pd(self.0);
        scaled(self: Self, k: Self) -> Self = {
            let shift = _mm512_slli_epi64::<52>(_mm512_castpd_si512(k.0));
            DoublesAvx512(_mm512_castsi512_pd(_mm512_add_epi64(_mm512_castpd_si512(self.0), shift)))
        };
        // 2^-14, then a Newton step: 2^-28.
        recip(self: Self) -> Self = {
            let a = _mm512_rcp14_pd(self.0);
            DoublesAvx512(_mm512_mul_pd(a, _mm512_fnmadd_pd(self.0, a, _mm512_set1_pd(2.0))))
        };
    }
}

impl SingleLanes for SinglesAvx2 {
    intrinsics! {
        from_bits(bits: &[u32; WIDTH]) -> Self = SinglesAvx2(_mm256_loadu_ps(bits.as_ptr().cast()));
        sign(self: Self) -> Self = SinglesAvx2(_mm256_and_ps(self.0, _mm256_set1_ps(-0.0)));
        flip(self: Self, o: Self) -> Self = SinglesAvx2(_mm256_xor_ps(self.0, o.0));
        signs(self: Self) -> u32 = _mm256_movemask_ps(self.0) as u32;
        order(self: Self, far: Self, codes: &[u32; WIDTH], to: &mut [Waiting; WIDTH]) -> usize = {
            let within = _mm256_cmp_ps::<_CMP_LE_OQ>(self.0, far.0);
            let lanes = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
            let last = _mm256_set1_epi32(WIDTH as i32 - 1);
            // A value of at least 0 is ordered as its bits are. Its last bits give way to its lane. The lanes that are
            // left out get −1, the least of all.
            let values = _mm256_or_si256(_mm256_andnot_si256(last, _mm256_castps_si256(self.0)), lanes);
            let outside = _mm256_xor_si256(_mm256_castps_si256(within), _mm256_set1_epi32(-1));
            let mut sorted = _mm256_or_si256(values, outside);
            // Batcher's bitonic network: in each step every lane has a partner, and the upper one of the two gets the
            // smaller number.
            macro_rules! step {
                ($partners:expr, $smaller:literal) => {
                    let partners = $partners;
                    let (less, more) = (_mm256_min_epi32(sorted, partners), _mm256_max_epi32(sorted, partners));
                    sorted = _mm256_blend_epi32::<$smaller>(more, less);
                };
            }
            step!(_mm256_shuffle_epi32::<0b10_11_00_01>(sorted), 0b1010_1010);
            step!(_mm256_shuffle_epi32::<0b00_01_10_11>(sorted), 0b1100_1100);
            step!(_mm256_shuffle_epi32::<0b10_11_00_01>(sorted), 0b1010_1010);
            step!(_mm256_permutevar8x32_epi32(sorted, _mm256_setr_epi32(7, 6, 5, 4, 3, 2, 1, 0)), 0b1111_0000);
            step!(_mm256_shuffle_epi32::<0b01_00_11_10>(sorted), 0b1100_1100);
            step!(_mm256_shuffle_epi32::<0b10_11_00_01>(sorted), 0b1010_1010);
            let codes = _mm256_permutevar8x32_epi32(_mm256_loadu_si256(codes.as_ptr().cast()), sorted);
            let nears = _mm256_andnot_si256(last, sorted);
            // Pairs of a code and a value: the first and third, then the second and fourth pair of pairs.
            let (low, high) = (_mm256_unpacklo_epi32(codes, nears), _mm256_unpackhi_epi32(codes, nears));
            let to = to.as_mut_ptr().cast::<__m256i>();
            _mm256_storeu_si256(to, _mm256_permute2x128_si256::<0x20>(low, high));
            _mm256_storeu_si256(to.add(1), _mm256_permute2x128_si256::<0x31>(low, high));
            (_mm256_movemask_ps(within) as u32).count_ones() as usize
        };
    }
}

/// Prefetches `LINES` cache lines.
#[inline(always)]
pub fn prefetch<const LINES: usize>(from: *const i8) {
    for line in 0..LINES {
        // SAFETY: a prefetch has no effect that a program can observe, whatever the address.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(from.wrapping_add(64 * line)) };
    }
}
