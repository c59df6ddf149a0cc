//! Preetham's coefficients as few polynomials: everything with a closed form is divided out before the fit.
//!
//! θ is the angle of a direction from the zenith, γ its angle from the sun, θs the sun's zenith angle and τ the
//! turbidity. Each of Y, Y/y and Y·x/y is (function of θ)·(function of γ) times a prefactor that depends only on (θs,
//! τ). The prefactor is kept in closed form ([`PreethamTurbidity::prefactors`]); XYZ and RGB are linear in the three.
//! What is left, q_lm(θs, τ), is even in θs for even m and odd for odd m (a sun at −θs is a sun at azimuth π). It is
//! nearly a polynomial in ln(τ − 1.2029); 1.2029 is where B of the luminance vanishes. So
//!
//! q_lm = Σ_i Σ_{j < J_i} a_ij T_{2i + (m odd)}(2θs/π) T_j(v),   v = ln(τ − 1.2029) scaled to −1 … 1,
//!
//! The staircase J_0 ≥ J_1 ≥ … is common to all functions: high powers of one variable occur only with low powers of
//! the other.
//!
//! The three functions are stored in a mixed form, u = K P̄ q, where K is the colour matrix and P̄ are the prefactors
//! at the middle of the domain ([`ColourMix`]). Then u is nearly RGB already, and rgb = (K P P̄⁻¹ K⁻¹) u is nearly u.
//! Without the mixing, red would be a small difference of large numbers, and single precision would lose a digit.

use super::mix::{ColourMix, OrderIndices, scaled_turbidity};
use crate::harmonics::HarmonicCoefficients;
use crate::preetham::{self, PreethamTurbidity};
use crate::{SkyRefusal, check};
use mesophyll_base::chebyshev;
use mesophyll_base::dispatch_lanes;
use mesophyll_base::lanes::Lanes;
use mesophyll_base::number::FloatingPoint;
use mesophyll_base::processor::InstructionSet;
use std::f64::consts::FRAC_PI_2;

/// Largest number of rows (powers of θs) of a staircase.
pub const MOST_ROWS: usize = 32;
/// Largest number of columns (powers of v).
pub const MOST_COLUMNS: usize = 24;

/// Polynomials of every coefficient of N bands.
#[derive(Debug, Clone, PartialEq)]
pub struct FoldedPolynomials<T = f32> {
    bands: usize,
    turbidities: [f64; 2],
    rows: Vec<usize>,
    even: Vec<T>,
    odd: Vec<T>,
    orders: OrderIndices,
    mix: ColourMix,
}

impl<T: FloatingPoint> FoldedPolynomials<T> {
    /// From arrays. For each row i and each j < `rows[i]` they hold u_0 of the functions of `even` orders, then u_1,
    /// then u_2; `odd` is ordered in the same way.
    ///
    /// # Errors
    /// A sentence where lengths, bands or turbidities make no sense.
    pub fn new(
        bands: usize,
        turbidities: [f64; 2],
        rows: Vec<usize>,
        even: Vec<T>,
        odd: Vec<T>,
    ) -> Result<Self, String> {
        let orders = OrderIndices::new(bands);
        let terms: usize = rows.iter().sum();
        let finite = even.iter().chain(&odd).all(|v| v.wide().is_finite());
        if bands == 0 || rows.is_empty() || rows.len() > MOST_ROWS || rows.iter().any(|r| *r > MOST_COLUMNS) {
            return Err(format!(
                "{bands} bands and rows {rows:?}; expected 1 band or more and 1 to {MOST_ROWS} rows of at most \
                 {MOST_COLUMNS} terms"
            ));
        }
        if even.len() != terms * 3 * orders.even.len() || odd.len() != terms * 3 * orders.odd.len() || !finite {
            return Err(format!(
                "{} and {} values; expected {} and {} finite ones",
                even.len(),
                odd.len(),
                terms * 3 * orders.even.len(),
                terms * 3 * orders.odd.len()
            ));
        }
        let [low, high] = turbidities;
        if !(preetham::TURBIDITIES[0] <= low && low < high && high <= preetham::TURBIDITIES[1]) {
            return Err(format!("turbidities {low} to {high}; expected two within 1.7 to 10"));
        }
        let mix = ColourMix::new(turbidities);
        Ok(FoldedPolynomials { bands, turbidities, rows, even, odd, orders, mix })
    }

    /// Number of bands N: l = 0 … N−1.
    pub fn bands(&self) -> usize {
        self.bands
    }
    /// Turbidities that the fit covers.
    pub fn turbidities(&self) -> [f64; 2] {
        self.turbidities
    }
    /// J_i: terms in v for each power of θs.
    pub fn rows(&self) -> &[usize] {
        &self.rows
    }
    /// The order of the functions in the arrays.
    pub fn orders(&self) -> &OrderIndices {
        &self.orders
    }
    /// How linear sRGB is mixed from the three fitted functions.
    pub fn mix(&self) -> &ColourMix {
        &self.mix
    }
    /// The arrays, as [`FoldedPolynomials::new`] takes them.
    pub fn arrays(&self) -> (&[T], &[T]) {
        (&self.even, &self.odd)
    }
    /// Number of terms of a function.
    pub fn terms(&self) -> usize {
        self.rows.iter().sum()
    }
    /// How many numbers are stored.
    pub fn len(&self) -> usize {
        self.even.len() + self.odd.len()
    }
    /// Whether nothing is stored.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
    /// Size of what is stored, in bytes.
    pub fn bytes(&self) -> usize {
        self.len() * size_of::<T>()
    }

    /// The same in another precision.
    pub fn to<U: FloatingPoint>(&self) -> FoldedPolynomials<U> {
        let cast = |v: &[T]| v.iter().map(|x| U::of(x.wide())).collect();
        FoldedPolynomials {
            bands: self.bands,
            turbidities: self.turbidities,
            rows: self.rows.clone(),
            even: cast(&self.even),
            odd: cast(&self.odd),
            orders: self.orders.clone(),
            mix: self.mix,
        }
    }

    /// Checks that the fit covers these parameters. Returns the sun's zenith angle, at most π/2.
    ///
    /// # Errors
    /// [`SkyRefusal`] outside the turbidities fitted, and for a sun below the horizon.
    pub fn accepts(&self, sun_zenith: f64, turbidity: f64) -> Result<f64, SkyRefusal> {
        check(sun_zenith, turbidity, self.turbidities)
    }

    /// N² coefficients, sun at azimuth 0.
    ///
    /// # Errors
    /// As [`FoldedPolynomials::accepts`].
    pub fn coefficients(&self, sun_zenith: f64, turbidity: f64) -> Result<HarmonicCoefficients, SkyRefusal> {
        let sun_zenith = self.accepts(sun_zenith, turbidity)?;
        let mut out = vec![[T::default(); 3]; self.bands * self.bands];
        self.fill(sun_zenith, turbidity, &mut out);
        Ok(widened(&out))
    }

    /// Writes N² triples at l(l+1)+m; places of m < 0 are left as they are. Parameters are not checked
    /// ([`FoldedPolynomials::accepts`]).
    pub fn fill(&self, sun_zenith: f64, turbidity: f64, out: &mut [[T; 3]]) {
        let sky = self;
        dispatch_lanes!(
            InstructionSet::detect(),
            F32[][T: FloatingPoint],
            fill(sky: &FoldedPolynomials<T>, sun_zenith: f64, turbidity: f64, out: &mut [[T; 3]])
        );
    }

    /// The polynomials in θs alone that remain when the turbidity is fixed.
    ///
    /// # Errors
    /// As [`FoldedPolynomials::accepts`].
    pub fn at(&self, turbidity: f64) -> Result<FixedSky<T>, SkyRefusal> {
        self.accepts(0.0, turbidity)?;
        let mut columns = [0.0; MOST_COLUMNS];
        chebyshev::fill(scaled_turbidity(turbidity, self.turbidities), 0, 1, &mut columns);
        let contract = |from: &[T], width: usize| {
            let mut to = vec![T::default(); self.rows.len() * width];
            let mut term = 0;
            for (i, row) in self.rows.iter().enumerate() {
                let mut sums = vec![0.0; width];
                for column in &columns[..*row] {
                    sums.iter_mut().zip(&from[term * width..]).for_each(|(s, a)| *s += a.wide() * column);
                    term += 1;
                }
                to[i * width..].iter_mut().zip(sums).for_each(|(t, s)| *t = T::of(s));
            }
            to
        };
        Ok(FixedSky {
            bands: self.bands,
            rows: self.rows.len(),
            turbid: PreethamTurbidity::new(turbidity),
            even: contract(&self.even, 3 * self.orders.even.len()),
            odd: contract(&self.odd, 3 * self.orders.odd.len()),
            orders: self.orders.clone(),
            mix: self.mix,
        })
    }
}

/// A sky of fixed turbidity: only the sun moves.
#[derive(Debug, Clone, PartialEq)]
pub struct FixedSky<T = f32> {
    bands: usize,
    rows: usize,
    turbid: PreethamTurbidity,
    even: Vec<T>,
    odd: Vec<T>,
    orders: OrderIndices,
    mix: ColourMix,
}

impl<T: FloatingPoint> FixedSky<T> {
    /// Number of bands N: l = 0 … N−1.
    pub fn bands(&self) -> usize {
        self.bands
    }
    /// The turbidity that was chosen.
    pub fn turbidity(&self) -> f64 {
        self.turbid.turbidity
    }

    /// N² coefficients, sun at azimuth 0.
    ///
    /// # Errors
    /// [`SkyRefusal`] for a sun below the horizon.
    pub fn coefficients(&self, sun_zenith: f64) -> Result<HarmonicCoefficients, SkyRefusal> {
        let sun_zenith = check(sun_zenith, self.turbid.turbidity, preetham::TURBIDITIES)?;
        let mut out = vec![[T::default(); 3]; self.bands * self.bands];
        self.fill(sun_zenith, &mut out);
        Ok(widened(&out))
    }

    /// Writes N² triples at l(l+1)+m; places of m < 0 are left as they are. The sun is not checked.
    pub fn fill(&self, sun_zenith: f64, out: &mut [[T; 3]]) {
        let sky = self;
        dispatch_lanes!(
            InstructionSet::detect(),
            F32[][T: FloatingPoint],
            fill_fixed(sky: &FixedSky<T>, sun_zenith: f64, out: &mut [[T; 3]])
        );
    }
}

#[inline(always)]
fn fill<L: Lanes, T: FloatingPoint>(sky: &FoldedPolynomials<T>, sun_zenith: f64, turbidity: f64, out: &mut [[T; 3]]) {
    let (mut even, mut odd) = ([0.0; MOST_ROWS], [0.0; MOST_ROWS]);
    let n = sky.rows.len();
    suns(sun_zenith, &mut even[..n], &mut odd[..n]);
    let mut columns = [0.0; MOST_COLUMNS];
    chebyshev::fill(scaled_turbidity(turbidity, sky.turbidities), 0, 1, &mut columns);
    let mut products = [[T::default(); 2]; MOST_ROWS * MOST_COLUMNS];
    let mut terms = 0;
    for (i, row) in sky.rows.iter().enumerate() {
        for column in &columns[..*row] {
            products[terms] = [T::of(even[i] * column), T::of(odd[i] * column)];
            terms += 1;
        }
    }
    let matrix = sky.mix.matrix(&PreethamTurbidity::new(turbidity), sun_zenith).map(|row| row.map(T::of));
    let products = &products[..terms];
    finish::<L, T>(&sky.even, |k| products[k][0], terms, &sky.orders.even, &matrix, out);
    finish::<L, T>(&sky.odd, |k| products[k][1], terms, &sky.orders.odd, &matrix, out);
}

#[inline(always)]
fn fill_fixed<L: Lanes, T: FloatingPoint>(sky: &FixedSky<T>, sun_zenith: f64, out: &mut [[T; 3]]) {
    let (mut even, mut odd) = ([0.0; MOST_ROWS], [0.0; MOST_ROWS]);
    suns(sun_zenith, &mut even[..sky.rows], &mut odd[..sky.rows]);
    let matrix = sky.mix.matrix(&sky.turbid, sun_zenith).map(|row| row.map(T::of));
    finish::<L, T>(&sky.even, |k| T::of(even[k]), sky.rows, &sky.orders.even, &matrix, out);
    finish::<L, T>(&sky.odd, |k| T::of(odd[k]), sky.rows, &sky.orders.odd, &matrix, out);
}

/// T_0, T_2, … and T_1, T_3, … of the sun's zenith angle over π/2.
#[inline(always)]
pub fn suns(sun_zenith: f64, even: &mut [f64], odd: &mut [f64]) {
    let x = sun_zenith / FRAC_PI_2;
    chebyshev::fill(x, 0, 2, even);
    chebyshev::fill(x, 1, 2, odd);
}

/// Largest number of functions of one parity (those of 12 bands), times three.
const MOST_WIDTH: usize = 3 * 80;

/// Sums `terms` rows of `from`, each times its factor, and writes the colours.
#[inline(always)]
fn finish<L: Lanes, T: FloatingPoint>(
    from: &[T],
    factor: impl Fn(usize) -> T,
    terms: usize,
    places: &[usize],
    matrix: &[[T; 3]; 3],
    out: &mut [[T; 3]],
) {
    let each = places.len();
    let width = 3 * each;
    let mut kept = [T::default(); MOST_WIDTH];
    let mut large = Vec::new();
    let sums: &mut [T] = if width <= MOST_WIDTH {
        &mut kept[..width]
    } else {
        large.resize(width, T::default());
        &mut large
    };
    // Blocks that stay in registers while all terms are added.
    let mut start = 0;
    while start < width {
        start += match width - start {
            left if left >= 24 => block::<L, T, 24>(from, &factor, terms, width, start, sums),
            left if left >= 12 => block::<L, T, 12>(from, &factor, terms, width, start, sums),
            _ => block::<L, T, 1>(from, &factor, terms, width, start, sums),
        };
    }
    for (e, place) in places.iter().enumerate() {
        let s = [sums[e], sums[each + e], sums[2 * each + e]];
        out[*place] = matrix.map(|row| fma::<L, T>(row[2], s[2], fma::<L, T>(row[1], s[1], row[0] * s[0])));
    }
}

/// a · b + c, as [`Lanes::fma`] rounds.
#[inline(always)]
fn fma<L: Lanes, T: FloatingPoint>(a: T, b: T, c: T) -> T {
    if L::FUSED { a.fma::<true>(b, c) } else { a.fma::<false>(b, c) }
}

#[inline(always)]
fn block<L: Lanes, T: FloatingPoint, const W: usize>(
    from: &[T],
    factor: &impl Fn(usize) -> T,
    terms: usize,
    width: usize,
    start: usize,
    sums: &mut [T],
) -> usize {
    let mut acc = [T::default(); W];
    // The sum runs from the small terms of high degree to the large ones, which gives the least rounding.
    for (k, row) in from[..terms * width].chunks_exact(width).enumerate().rev() {
        let f = factor(k);
        let row = &row[start..start + W];
        for (a, x) in acc.iter_mut().zip(row) {
            *a = fma::<L, T>(f, *x, *a);
        }
    }
    sums[start..start + W].copy_from_slice(&acc);
    W
}

fn widened<T: FloatingPoint>(values: &[[T; 3]]) -> HarmonicCoefficients {
    HarmonicCoefficients::from_values(values.iter().map(|v| v.map(T::wide)).collect()).unwrap_or_default()
}
