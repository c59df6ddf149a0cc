//! Arrays, for processors without these vector instructions.

use super::{DoubleLanes, Lanes, SingleLanes, WIDTH, Waiting};
use crate::number::FloatingPoint;
use std::array::from_fn;

#[derive(Debug, Clone, Copy)]
pub struct ArrayLanes<T, const N: usize>([T; N]);

impl<T: FloatingPoint, const N: usize> ArrayLanes<T, N> {
    #[inline(always)]
    fn zip(self, o: Self, f: impl Fn(T, T) -> T) -> Self {
        ArrayLanes(from_fn(|k| f(self.0[k], o.0[k])))
    }
}

impl<T: FloatingPoint, const N: usize> Lanes for ArrayLanes<T, N> {
    const N: usize = N;
    const FUSED: bool = false;
    type Number = T;
    type Mask = [bool; N];
    #[inline(always)]
    fn splat(x: T) -> Self {
        ArrayLanes([x; N])
    }
    #[inline(always)]
    fn load(from: &[T]) -> Self {
        ArrayLanes(from_fn(|k| from[k]))
    }
    #[inline(always)]
    fn store(self, to: &mut [T]) {
        to[..N].copy_from_slice(&self.0);
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
        self.mul(b).add(c)
    }
    #[inline(always)]
    fn fms(self, b: Self, c: Self) -> Self {
        self.mul(b).sub(c)
    }
    #[inline(always)]
    fn min(self, o: Self) -> Self {
        self.zip(o, T::at_most)
    }
    #[inline(always)]
    fn max(self, o: Self) -> Self {
        self.zip(o, T::at_least)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        ArrayLanes(self.0.map(T::sqrt))
    }
    #[inline(always)]
    fn less(self, o: Self) -> [bool; N] {
        from_fn(|k| self.0[k] < o.0[k])
    }
    #[inline(always)]
    fn at_most(self, o: Self) -> [bool; N] {
        from_fn(|k| self.0[k] <= o.0[k])
    }
    #[inline(always)]
    fn or(self, mask: [bool; N], o: Self) -> Self {
        ArrayLanes(from_fn(|k| if mask[k] { self.0[k] } else { o.0[k] }))
    }
    #[inline(always)]
    fn both(a: [bool; N], b: [bool; N]) -> [bool; N] {
        from_fn(|k| a[k] & b[k])
    }
    #[inline(always)]
    fn bits(mask: [bool; N]) -> u32 {
        (0..N).fold(0, |bits, k| bits | u32::from(mask[k]) << k)
    }
}

impl DoubleLanes for ArrayLanes<f64, 4> {
    #[inline(always)]
    fn sum(self) -> f64 {
        (self.0[0] + self.0[2]) + (self.0[1] + self.0[3])
    }
    #[inline(always)]
    fn most(self) -> f64 {
        self.0[0].max(self.0[1]).max(self.0[2].max(self.0[3]))
    }
    #[inline(always)]
    fn scaled(self, k: Self) -> Self {
        self.zip(k, |p, k| f64::from_bits(p.to_bits().wrapping_add(k.to_bits() << 52)))
    }
}

impl SingleLanes for ArrayLanes<f32, WIDTH> {
    #[inline(always)]
    fn from_bits(bits: &[u32; WIDTH]) -> Self {
        ArrayLanes(bits.map(f32::from_bits))
    }
    #[inline(always)]
    fn sign(self) -> Self {
        ArrayLanes(self.0.map(|a| f32::from_bits(a.to_bits() & 1 << 31)))
    }
    #[inline(always)]
    fn flip(self, o: Self) -> Self {
        self.zip(o, |a, b| f32::from_bits(a.to_bits() ^ b.to_bits()))
    }
    #[inline(always)]
    fn signs(self) -> u32 {
        Self::bits(self.0.map(f32::is_sign_negative))
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
}
