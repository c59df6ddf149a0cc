//! AVX2 with FMA on x86-64.

// This is sound because these are called only by functions that are compiled for the instruction set and entered after
// the processor was asked for it.
#![allow(clippy::undocumented_unsafe_blocks)]
use super::{Lanes, WIDTH};
use crate::rays::traversal::Waiting;
use std::arch::x86_64::*;

/// Eight lanes of AVX2.
#[derive(Clone, Copy)]
pub(crate) struct Avx2(__m256);

impl Lanes for Avx2 {
    #[inline(always)]
    fn splat(x: f32) -> Self {
        Avx2(unsafe { _mm256_set1_ps(x) })
    }
    #[inline(always)]
    fn load(from: &[u32; WIDTH]) -> Self {
        Avx2(unsafe { _mm256_loadu_ps(from.as_ptr().cast()) })
    }
    #[inline(always)]
    fn store(self) -> [f32; WIDTH] {
        let mut to = [0.0; WIDTH];
        unsafe { _mm256_storeu_ps(to.as_mut_ptr(), self.0) };
        to
    }
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Avx2(unsafe { _mm256_add_ps(self.0, o.0) })
    }
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        Avx2(unsafe { _mm256_sub_ps(self.0, o.0) })
    }
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        Avx2(unsafe { _mm256_mul_ps(self.0, o.0) })
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        Avx2(unsafe { _mm256_fmadd_ps(self.0, b.0, c.0) })
    }
    #[inline(always)]
    fn mul_sub(self, b: Self, c: Self) -> Self {
        Avx2(unsafe { _mm256_fmsub_ps(self.0, b.0, c.0) })
    }
    #[inline(always)]
    fn div(self, o: Self) -> Self {
        Avx2(unsafe { _mm256_div_ps(self.0, o.0) })
    }
    #[inline(always)]
    fn min(self, o: Self) -> Self {
        Avx2(unsafe { _mm256_min_ps(self.0, o.0) })
    }
    #[inline(always)]
    fn max(self, o: Self) -> Self {
        Avx2(unsafe { _mm256_max_ps(self.0, o.0) })
    }
    #[inline(always)]
    fn sign(self) -> Self {
        Avx2(unsafe { _mm256_and_ps(self.0, _mm256_set1_ps(-0.0)) })
    }
    #[inline(always)]
    fn flip(self, o: Self) -> Self {
        Avx2(unsafe { _mm256_xor_ps(self.0, o.0) })
    }
    #[inline(always)]
    fn at_most(self, o: Self) -> u32 {
        unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(self.0, o.0)) as u32 }
    }
    #[inline(always)]
    fn order(self, far: Self, codes: &[u32; WIDTH], to: &mut [Waiting; WIDTH]) -> usize {
        unsafe {
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
        }
    }
    #[inline(always)]
    fn or_infinite(self, far: Self) -> Self {
        let within = unsafe { _mm256_cmp_ps::<_CMP_LE_OQ>(self.0, far.0) };
        Avx2(unsafe { _mm256_blendv_ps(_mm256_set1_ps(f32::INFINITY), self.0, within) })
    }
    #[inline(always)]
    fn signs(self) -> u32 {
        unsafe { _mm256_movemask_ps(self.0) as u32 }
    }
}
