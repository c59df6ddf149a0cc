//! AVX2 with FMA and AVX-512 on x86-64.

// This is sound because only functions that are compiled for the instruction set, and entered after a check of the
// processor, call these.
#![allow(clippy::undocumented_unsafe_blocks)]
use super::{EXP, LN2, LOG2E, Lanes, MAGIC};
use std::arch::x86_64::*;

#[derive(Clone, Copy)]
/// Four lanes of AVX2.
pub struct Avx2(__m256d);

impl Lanes for Avx2 {
    const N: usize = 4;
    type Mask = __m256d;
    #[inline(always)]
    fn splat(x: f64) -> Self {
        Avx2(unsafe { _mm256_set1_pd(x) })
    }
    #[inline(always)]
    fn load(from: &[f64]) -> Self {
        assert!(from.len() >= 4);
        Avx2(unsafe { _mm256_loadu_pd(from.as_ptr()) })
    }
    #[inline(always)]
    fn store(self, to: &mut [f64]) {
        assert!(to.len() >= 4);
        unsafe { _mm256_storeu_pd(to.as_mut_ptr(), self.0) }
    }
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Avx2(unsafe { _mm256_add_pd(self.0, o.0) })
    }
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        Avx2(unsafe { _mm256_sub_pd(self.0, o.0) })
    }
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        Avx2(unsafe { _mm256_mul_pd(self.0, o.0) })
    }
    #[inline(always)]
    fn div(self, o: Self) -> Self {
        Avx2(unsafe { _mm256_div_pd(self.0, o.0) })
    }
    #[inline(always)]
    fn fma(self, b: Self, c: Self) -> Self {
        Avx2(unsafe { _mm256_fmadd_pd(self.0, b.0, c.0) })
    }
    #[inline(always)]
    fn min(self, o: Self) -> Self {
        Avx2(unsafe { _mm256_min_pd(self.0, o.0) })
    }
    #[inline(always)]
    fn max(self, o: Self) -> Self {
        Avx2(unsafe { _mm256_max_pd(self.0, o.0) })
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Avx2(unsafe { _mm256_sqrt_pd(self.0) })
    }
    #[inline(always)]
    fn less(self, o: Self) -> __m256d {
        unsafe { _mm256_cmp_pd::<_CMP_LT_OQ>(self.0, o.0) }
    }
    #[inline(always)]
    fn or(self, mask: __m256d, o: Self) -> Self {
        Avx2(unsafe { _mm256_blendv_pd(o.0, self.0, mask) })
    }
    #[inline(always)]
    fn both(a: __m256d, b: __m256d) -> __m256d {
        unsafe { _mm256_and_pd(a, b) }
    }
    #[inline(always)]
    fn any(mask: __m256d) -> bool {
        unsafe { _mm256_movemask_pd(mask) != 0 }
    }
    #[inline(always)]
    fn all(mask: __m256d) -> bool {
        unsafe { _mm256_movemask_pd(mask) == 15 }
    }
    #[inline(always)]
    fn recip(self) -> Self {
        Avx2(unsafe { _mm256_div_pd(_mm256_set1_pd(1.0), self.0) })
    }
    #[inline(always)]
    fn exp(self) -> Self {
        unsafe {
            let x = _mm256_max_pd(self.0, _mm256_set1_pd(-700.0));
            let k = _mm256_fmadd_pd(x, _mm256_set1_pd(LOG2E), _mm256_set1_pd(MAGIC));
            let r = _mm256_fnmadd_pd(_mm256_sub_pd(k, _mm256_set1_pd(MAGIC)), _mm256_set1_pd(LN2), x);
            let mut p = _mm256_set1_pd(EXP[0]);
            for c in &EXP[1..] {
                p = _mm256_fmadd_pd(p, r, _mm256_set1_pd(*c));
            }
            let one = _mm256_set1_pd(1.0);
            let p = _mm256_fmadd_pd(_mm256_fmadd_pd(p, r, one), r, one);
            let shift = _mm256_slli_epi64::<52>(_mm256_castpd_si256(k));
            Avx2(_mm256_castsi256_pd(_mm256_add_epi64(_mm256_castpd_si256(p), shift)))
        }
    }
    #[inline(always)]
    fn sum(self) -> f64 {
        unsafe {
            let half = _mm_add_pd(_mm256_castpd256_pd128(self.0), _mm256_extractf128_pd::<1>(self.0));
            _mm_cvtsd_f64(_mm_add_sd(half, _mm_unpackhi_pd(half, half)))
        }
    }
    #[inline(always)]
    fn most(self) -> f64 {
        unsafe {
            let half = _mm_max_pd(_mm256_castpd256_pd128(self.0), _mm256_extractf128_pd::<1>(self.0));
            _mm_cvtsd_f64(_mm_max_sd(half, _mm_unpackhi_pd(half, half)))
        }
    }
}

#[derive(Clone, Copy)]
/// Eight lanes of AVX-512.
pub struct Avx512(__m512d);

impl Lanes for Avx512 {
    const N: usize = 8;
    type Mask = __mmask8;
    #[inline(always)]
    fn splat(x: f64) -> Self {
        Avx512(unsafe { _mm512_set1_pd(x) })
    }
    #[inline(always)]
    fn load(from: &[f64]) -> Self {
        assert!(from.len() >= 8);
        Avx512(unsafe { _mm512_loadu_pd(from.as_ptr()) })
    }
    #[inline(always)]
    fn store(self, to: &mut [f64]) {
        assert!(to.len() >= 8);
        unsafe { _mm512_storeu_pd(to.as_mut_ptr(), self.0) }
    }
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Avx512(unsafe { _mm512_add_pd(self.0, o.0) })
    }
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        Avx512(unsafe { _mm512_sub_pd(self.0, o.0) })
    }
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        Avx512(unsafe { _mm512_mul_pd(self.0, o.0) })
    }
    #[inline(always)]
    fn div(self, o: Self) -> Self {
        Avx512(unsafe { _mm512_div_pd(self.0, o.0) })
    }
    #[inline(always)]
    fn fma(self, b: Self, c: Self) -> Self {
        Avx512(unsafe { _mm512_fmadd_pd(self.0, b.0, c.0) })
    }
    #[inline(always)]
    fn min(self, o: Self) -> Self {
        Avx512(unsafe { _mm512_min_pd(self.0, o.0) })
    }
    #[inline(always)]
    fn max(self, o: Self) -> Self {
        Avx512(unsafe { _mm512_max_pd(self.0, o.0) })
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Avx512(unsafe { _mm512_sqrt_pd(self.0) })
    }
    #[inline(always)]
    fn less(self, o: Self) -> __mmask8 {
        unsafe { _mm512_cmp_pd_mask::<_CMP_LT_OQ>(self.0, o.0) }
    }
    #[inline(always)]
    fn or(self, mask: __mmask8, o: Self) -> Self {
        Avx512(unsafe { _mm512_mask_blend_pd(mask, o.0, self.0) })
    }
    #[inline(always)]
    fn both(a: __mmask8, b: __mmask8) -> __mmask8 {
        a & b
    }
    #[inline(always)]
    fn any(mask: __mmask8) -> bool {
        mask != 0
    }
    #[inline(always)]
    fn all(mask: __mmask8) -> bool {
        mask == 255
    }
    #[inline(always)]
    fn recip(self) -> Self {
        // 2^-14, then a Newton step: 2^-28.
        unsafe {
            let two = _mm512_set1_pd(2.0);
            let a = _mm512_rcp14_pd(self.0);
            Avx512(_mm512_mul_pd(a, _mm512_fnmadd_pd(self.0, a, two)))
        }
    }
    #[inline(always)]
    fn exp(self) -> Self {
        unsafe {
            let x = _mm512_max_pd(self.0, _mm512_set1_pd(-700.0));
            let k = _mm512_fmadd_pd(x, _mm512_set1_pd(LOG2E), _mm512_set1_pd(MAGIC));
            let r = _mm512_fnmadd_pd(_mm512_sub_pd(k, _mm512_set1_pd(MAGIC)), _mm512_set1_pd(LN2), x);
            let mut p = _mm512_set1_pd(EXP[0]);
            for c in &EXP[1..] {
                p = _mm512_fmadd_pd(p, r, _mm512_set1_pd(*c));
            }
            let one = _mm512_set1_pd(1.0);
            let p = _mm512_fmadd_pd(_mm512_fmadd_pd(p, r, one), r, one);
            let shift = _mm512_slli_epi64::<52>(_mm512_castpd_si512(k));
            Avx512(_mm512_castsi512_pd(_mm512_add_epi64(_mm512_castpd_si512(p), shift)))
        }
    }
    #[inline(always)]
    fn sum(self) -> f64 {
        unsafe { _mm512_reduce_add_pd(self.0) }
    }
    #[inline(always)]
    fn most(self) -> f64 {
        unsafe { _mm512_reduce_max_pd(self.0) }
    }
}
