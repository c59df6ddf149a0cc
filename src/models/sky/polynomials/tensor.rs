//! Coefficients as a product of two polynomial bases in θs and τ: one polynomial for each coefficient and channel
//! (Habel 2009 Eq. 5.1).

use crate::harmonics::HarmonicCoefficients;
use crate::{SkyRefusal, check};
use mesophyll_base::chebyshev;
use mesophyll_base::number::FloatingPoint;
use std::f64::consts::FRAC_PI_2;

/// The functions of a variable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PolynomialBasis {
    /// θs^i τ^j, unscaled: the dissertation's choice.
    Monomials,
    /// T_i and T_j on the domain, scaled to −1 … 1.
    Chebyshev,
}

/// Largest number of powers of a variable.
pub const MOST: usize = 32;

/// Polynomials of every coefficient of m ≥ 0 and channel.
#[derive(Debug, Clone, PartialEq)]
pub struct PolynomialTensor<T = f32> {
    /// The basis of the polynomials.
    pub basis: PolynomialBasis,
    bands: usize,
    turbidities: [f64; 2],
    /// Powers of θs and of τ: degrees plus one.
    powers: [usize; 2],
    /// For each i, for each j: R of all functions (l(l+1)/2 + m), then G, then B.
    values: Vec<T>,
}

impl<T: FloatingPoint> PolynomialTensor<T> {
    /// # Errors
    /// A sentence where lengths make no sense.
    pub fn new(
        basis: PolynomialBasis,
        bands: usize,
        turbidities: [f64; 2],
        powers: [usize; 2],
        values: Vec<T>,
    ) -> Result<Self, String> {
        let expected = powers[0] * powers[1] * 3 * bands * (bands + 1) / 2;
        if values.len() != expected || powers.iter().any(|p| !(1..=MOST).contains(p)) || bands == 0 {
            return Err(format!(
                "{} values for {bands} bands and powers {powers:?}; expected {expected}, and 1 to {MOST} powers",
                values.len()
            ));
        }
        Ok(PolynomialTensor { basis, bands, turbidities, powers, values })
    }

    /// Number of bands N: l = 0 … N−1.
    pub fn bands(&self) -> usize {
        self.bands
    }
    /// Turbidities that the fit covers.
    pub fn turbidities(&self) -> [f64; 2] {
        self.turbidities
    }
    /// Powers of the sun zenith and of the turbidity: degrees plus one.
    pub fn powers(&self) -> [usize; 2] {
        self.powers
    }
    /// What is stored, in the order of [`PolynomialTensor::new`].
    pub fn values(&self) -> &[T] {
        &self.values
    }
    /// Size of what is stored, in bytes.
    pub fn bytes(&self) -> usize {
        self.values.len() * size_of::<T>()
    }

    /// The same in another precision.
    pub fn to<U: FloatingPoint>(&self) -> PolynomialTensor<U> {
        let values = self.values.iter().map(|v| U::of(v.wide())).collect();
        PolynomialTensor {
            basis: self.basis,
            bands: self.bands,
            turbidities: self.turbidities,
            powers: self.powers,
            values,
        }
    }

    /// N² coefficients, sun at azimuth 0. The sums are computed in `T`, as in the dissertation.
    ///
    /// # Errors
    /// [`SkyRefusal`] outside the turbidities fitted, and for a sun below the horizon.
    pub fn coefficients(&self, sun_zenith: f64, turbidity: f64) -> Result<HarmonicCoefficients, SkyRefusal> {
        let sun_zenith = check(sun_zenith, turbidity, self.turbidities)?;
        let (mut a, mut b) = ([0.0; MOST], [0.0; MOST]);
        fill(self.basis, sun_zenith, [0.0, FRAC_PI_2], &mut a[..self.powers[0]]);
        fill(self.basis, turbidity, self.turbidities, &mut b[..self.powers[1]]);
        let size = self.bands * (self.bands + 1) / 2;
        let width = 3 * size;
        let mut sums = vec![T::default(); width];
        let mut rows = self.values.chunks_exact(width);
        for x in &a[..self.powers[0]] {
            for y in &b[..self.powers[1]] {
                let product = T::of(*x) * T::of(*y);
                if let Some(row) = rows.next() {
                    sums.iter_mut().zip(row).for_each(|(s, v)| *s += product * *v);
                }
            }
        }
        let even: Vec<[f64; 3]> = (0..size).map(|k| std::array::from_fn(|c| sums[c * size + k].wide())).collect();
        Ok(crate::projection::spread(self.bands, &even, |v| v))
    }
}

/// The functions of one variable.
pub fn fill(basis: PolynomialBasis, x: f64, [low, high]: [f64; 2], out: &mut [f64]) {
    match basis {
        PolynomialBasis::Monomials => {
            let mut power = 1.0;
            for v in out.iter_mut() {
                *v = power;
                power *= x;
            }
        }
        PolynomialBasis::Chebyshev => chebyshev::fill((2.0 * x - low - high) / (high - low), 0, 1, out),
    }
}
