//! The variables and the colours in which the folded polynomials are stored.

use crate::colour;
use crate::preetham::{self, PreethamTurbidity};
use std::f64::consts::FRAC_PI_2;

/// Where B of the luminance's horizon factor vanishes: .4275/.3554.
pub const TURBIDITY_ZERO: f64 = 1.2029;

/// How the three separable functions are mixed before they are stored, and how linear sRGB is recovered.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColourMix {
    /// K: linear sRGB from (Y, Y/y, Y·x/y).
    pub colours: [[f64; 3]; 3],
    /// P̄⁻¹ K⁻¹.
    pub back: [[f64; 3]; 3],
    /// P̄.
    pub middle: [f64; 3],
}

impl ColourMix {
    /// P̄ is taken at a sun 45° high and the geometric mean of τ − τ₀ over the domain.
    pub fn new([low, high]: [f64; 2]) -> ColourMix {
        let turbidity = TURBIDITY_ZERO + ((low - TURBIDITY_ZERO) * (high - TURBIDITY_ZERO)).sqrt();
        let middle = PreethamTurbidity::new(turbidity).prefactors(FRAC_PI_2 / 2.0);
        let colours = rgb_from_separable();
        // (Y, Y/y, Y·x/y) from RGB: Y, X + Y + Z and X of the inverse colour matrix
        let columns = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|e| {
            let [x, y, z] = colour::xyz_from_rgb(e);
            [y, x + y + z, x]
        });
        let back = std::array::from_fn(|q| std::array::from_fn(|c| columns[c][q] / middle[q]));
        ColourMix { colours, back, middle }
    }

    /// u = K P̄ q.
    pub fn mixed(&self, q: [f64; 3]) -> [f64; 3] {
        self.colours.map(|row| (0..3).map(|k| row[k] * self.middle[k] * q[k]).sum())
    }

    /// K P P̄⁻¹ K⁻¹: linear sRGB from u.
    #[inline(always)]
    pub fn matrix(&self, turbid: &PreethamTurbidity, sun_zenith: f64) -> [[f64; 3]; 3] {
        let p = turbid.prefactors(sun_zenith);
        std::array::from_fn(|r| {
            std::array::from_fn(|c| (0..3).map(|q| self.colours[r][q] * p[q] * self.back[q][c]).sum())
        })
    }
}

/// l(l+1)+m of the functions of even and of odd m, in the order in which the arrays hold them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OrderIndices {
    /// Functions of even m.
    pub even: Vec<usize>,
    /// Functions of odd m.
    pub odd: Vec<usize>,
}

impl OrderIndices {
    /// The functions of `bands` bands, l from 0 to `bands` − 1.
    pub fn new(bands: usize) -> OrderIndices {
        let of = |parity: usize| {
            (0..bands).flat_map(|l| (0..=l).filter(move |m| m % 2 == parity).map(move |m| l * (l + 1) + m)).collect()
        };
        OrderIndices { even: of(0), odd: of(1) }
    }
}

/// Linear sRGB from (Y, Y/y, Y·x/y), rows R, G, B.
pub fn rgb_from_separable() -> [[f64; 3]; 3] {
    let columns = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
        .map(|s| colour::rgb_from_xyz(preetham::xyz_from_separable(s)));
    std::array::from_fn(|c| std::array::from_fn(|q| columns[q][c]))
}

/// v: −1 at the lower turbidity, 1 at the upper.
#[inline]
pub fn scaled_turbidity(turbidity: f64, [low, high]: [f64; 2]) -> f64 {
    let (a, b) = ((low - TURBIDITY_ZERO).ln(), (high - TURBIDITY_ZERO).ln());
    (2.0 * (turbidity - TURBIDITY_ZERO).ln() - a - b) / (b - a)
}
