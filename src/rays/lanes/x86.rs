//! AVX2 with FMA on x86-64.

// This is sound because these are called only by functions that are compiled for the instruction set and entered after
// the processor was asked for it.
#![allow(clippy::undocumented_unsafe_blocks)]
use super::{Lanes, WIDTH};
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
    fn signs(self) -> u32 {
        unsafe { _mm256_movemask_ps(self.0) as u32 }
    }
}
