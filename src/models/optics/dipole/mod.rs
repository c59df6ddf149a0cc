//! Diffusion of light through a leaf: where light leaves that entered at one point (H9 §3.3.5; Donner & Jensen 2005).
//!
//! T(r, d) is the exitance of the far side at distance r from the point of entry, per entering flux, in 1/mm². The slab
//! is flat and homogeneous and has the thickness d. From absorption σa, scattering σs, the mean cosine g of the phase
//! function and the internal reflection A follow: σt′ = σa + (1−g)σs, α′ = σs′/σt′ with σs′ = (1−g)σs, the mean free
//! path l = 1/σt′, the diffusion constant D = l/3, σtr = √(3 σa σt′) (the 2007 print has σt for σt′), and the
//! extrapolated distance z_b = 2AD. Units: mm and 1/mm.
//!
//! There are three forms, by name:
//! - [`DipoleForm::Dipoles`]`(n)`: the paper's sum over j = −n … n, with (1 + σtr ρ) e^(−σtr ρ) where it prints (1 +
//!   σtr ρ e^(−σtr ρ)). It is valid for d > l. The terms beyond n are 4e-4 of the total at d = .2 mm of the paper's
//!   tissue, but 28 % of it at σa = .01/mm and 67 % at .001/mm.
//! - [`DipoleForm::Images`]: n = ∞, exact by its Fourier transform. It is valid for d > l (NaN otherwise).
//! - [`DipoleForm::Thin`]: the source is the beam's own exponential, φ/(2A) leaves, and e^(−σt′ d) passes without being
//!   scattered. It is valid for every d > 0.
//!
//! The table compares the totals with the transport equation (isotropic scattering with σs′ = 9.486/mm, so l is about
//! .1 mm; A = 1). It shows the relative error in %:
//!
//! | σa 1/mm | form | d = .02 | .05 | .1 | .15 | .2 | .3 | .5 | 1 mm |
//! |---|---|---|---|---|---|---|---|---|---|
//! | → 0 | thin | .02 | .15 | .4 | .7 | .8 | .9 | .6 | .1 |
//! | | images | – | – | – | 5.8 | 3.9 | 2.1 | .8 | .1 |
//! | .4 | thin | −.1 | −.03 | .3 | .6 | .8 | 1.1 | .7 | −1.7 |
//! | | images | – | – | – | 2.3 | −.3 | −3.2 | −5.8 | −8.8 |
//! | 2 | thin | −.4 | −.4 | −.1 | .2 | .2 | −1.0 | −6.4 | −26 |
//! | | images | – | – | −5 | −13 | −18 | −27 | −38 | −55 |
//! | 10 | thin | −.6 | −.5 | −1.1 | −2.9 | −5.7 | −13 | −28 | −56 |
//! | | images | – | – | −55 | −68 | −77 | −88 | −96 | −100 |
//!
//! Diffusion needs σa well below σs′. Where the blade absorbs, it must also be only a few mean free paths thick; the
//! large errors of thick blades belong to transmittances below .03.
//!
//! **The unscattered light** of the thin form leaves where it entered: it is a delta function at r = 0, which no value
//! of T(r) can show. [`Tissue::transmittance`] and [`Tissue::beyond`] contain the scattered part only, and
//! [`Tissue::ballistic`] is the weight of the delta. [`Tissue::spectrum`] and [`Tissue::total`] contain both. Near r =
//! 0 the thin form's T grows as −ln r, because its source reaches the exit. So T(0) is infinite, but integrals over
//! texels are finite.

pub mod bessel;
mod hankel;
mod layer;
pub mod scalar;
mod sum;
pub mod verdict;

use layer::{BesselNumber, DipoleLayer};
use mesophyll_base::fourier::Complex;
use scalar::{Scalar, TissueDual};

/// What the inside of a leaf is made of, at one wavelength.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tissue {
    /// Absorption, 1/mm, ≥ 0.
    pub sigma_a: f64,
    /// Scattering, 1/mm, ≥ 0.
    pub sigma_s: f64,
    /// Mean cosine of the phase function, −1 < g < 1.
    pub g: f64,
    /// Internal reflection A = (1 + ρd)/(1 − ρd) ≥ 1 (H9 Eq. 3.4); 1 lets everything out.
    pub a: f64,
}

/// How T is computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::EnumDiscriminants)]
#[strum_discriminants(
    name(FormKind),
    doc = "The name of a [`Form`].",
    derive(strum::Display, strum::EnumString, strum::EnumIter, strum::IntoStaticStr, strum::EnumMessage),
    strum(serialize_all = "kebab-case")
)]
pub enum DipoleForm {
    /// The paper's sum of 2n + 1 dipoles, j = −n … n.
    Dipoles(u32),
    /// The same sum over infinitely many dipoles.
    Images,
    /// For blades of any thickness: exponential source, exit φ/(2A), unscattered light apart.
    Thin,
}

impl DipoleForm {
    /// The form of this name. `dipoles` is the n of the paper's sum; only [`DipoleForm::Dipoles`] uses it.
    pub fn of(kind: FormKind, dipoles: u32) -> DipoleForm {
        match kind {
            FormKind::Dipoles => DipoleForm::Dipoles(dipoles),
            FormKind::Images => DipoleForm::Images,
            FormKind::Thin => DipoleForm::Thin,
        }
    }
}

/// The quantities that the formulas are written in.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Coefficients<T> {
    /// σs′
    scattering: T,
    /// σt′
    extinction: T,
    /// α′
    albedo: T,
    /// σtr²
    transport2: T,
    /// l
    free_path: T,
    /// z_b
    extrapolation: T,
}

impl<T: Scalar> Coefficients<T> {
    fn new(sigma_a: T, sigma_s: T, g: T, a: f64) -> Self {
        let scattering = (T::of(1.0) - g) * sigma_s;
        let extinction = sigma_a + scattering;
        let free_path = T::of(1.0) / extinction;
        Coefficients {
            scattering,
            extinction,
            albedo: scattering / extinction,
            transport2: (sigma_a * extinction).times(3.0),
            free_path,
            extrapolation: free_path.times(2.0 * a / 3.0),
        }
    }

    fn map<U>(&self, f: impl Fn(T) -> U) -> Coefficients<U> {
        Coefficients {
            scattering: f(self.scattering),
            extinction: f(self.extinction),
            albedo: f(self.albedo),
            transport2: f(self.transport2),
            free_path: f(self.free_path),
            extrapolation: f(self.extrapolation),
        }
    }
}

/// A value that can be lifted into the complex plane, so that one inversion gives both values and derivatives.
pub(crate) trait Lift: BesselNumber {
    type Lifted: Scalar;
    fn lift(self) -> Self::Lifted;
    fn square(z: Complex<f64>) -> Self::Lifted;
    /// Re(w·t), component by component.
    fn gather(w: Complex<f64>, t: Self::Lifted) -> Self;
}

impl Lift for f64 {
    type Lifted = Complex<f64>;
    fn lift(self) -> Complex<f64> {
        Complex::new(self, 0.0)
    }
    fn square(z: Complex<f64>) -> Complex<f64> {
        z
    }
    fn gather(w: Complex<f64>, t: Complex<f64>) -> f64 {
        w.re * t.re - w.im * t.im
    }
}

impl Lift for TissueDual<f64> {
    type Lifted = TissueDual<Complex<f64>>;
    fn lift(self) -> Self::Lifted {
        TissueDual { value: self.value.lift(), by: self.by.map(f64::lift) }
    }
    fn square(z: Complex<f64>) -> Self::Lifted {
        let mut dual = Self::Lifted::of(0.0);
        dual.value = z;
        dual
    }
    fn gather(w: Complex<f64>, t: Self::Lifted) -> Self {
        TissueDual { value: f64::gather(w, t.value), by: t.by.map(|d| f64::gather(w, d)) }
    }
}

/// Spectrum without the unscattered light.
pub(crate) fn scattered<T: Scalar>(c: &Coefficients<T>, k_squared: T, d: T, form: DipoleForm) -> T {
    match form {
        DipoleForm::Dipoles(n) => sum::spectrum(c, k_squared, d, n),
        DipoleForm::Images => layer::images(c, k_squared, d),
        DipoleForm::Thin => layer::thin(c, k_squared, d),
    }
}

/// T(r) and 2π ∫_r^∞ T s ds of the scattered light, r > 0.
pub(crate) fn in_space<T: Lift>(c: &Coefficients<T>, r: f64, d: T, form: DipoleForm) -> [T; 2] {
    let layer = match form {
        DipoleForm::Dipoles(n) => return [sum::transmittance(c, r, d, n), sum::beyond(c, r, d, n)],
        DipoleForm::Images => DipoleLayer::Images,
        DipoleForm::Thin => DipoleLayer::Thin,
    };
    let height = d.re() + 2.0 * c.extrapolation.re();
    // Far out, few modes are needed and none cancels. Nearer to the source the contour loses no digits.
    if r > 3.0 * height {
        return layer::modes(c, layer, r, d);
    }
    let falls = if form == DipoleForm::Thin {
        c.transport2.re().sqrt().min(c.extinction.re())
    } else {
        c.transport2.re().sqrt()
    };
    if falls * (d.re() - c.free_path.re()) > 800.0 {
        return [T::of(0.0); 2];
    }
    let depth = if form == DipoleForm::Images { d.re() - c.free_path.re() } else { 0.0 };
    let first_pole = c.transport2.re().sqrt().hypot(std::f64::consts::PI / height);
    let (lifted, thickness) = (c.map(T::lift), d.lift());
    let mut sums = [T::of(0.0); 2];
    for node in hankel::contour(r.max(1e-7 * depth), d.re(), first_pole, depth) {
        let t = scattered(&lifted, T::square(node.k_squared), thickness, form);
        sums[0] = sums[0] + T::gather(node.for_t, t);
        sums[1] = sums[1] + T::gather(node.for_beyond, t);
    }
    sums
}

/// Below this mean cosine [`Tissue::doubt`] warns: totals are 5 % off there.
const MOST_BACKWARD: f64 = -0.25;

impl Tissue {
    /// The paper's tissue at 510 nm (H9 Table 3.1), with A = 1.
    pub const TABLE: Tissue = Tissue { sigma_a: 0.4, sigma_s: 10.2, g: 0.07, a: 1.0 };

    /// What is wrong with the numbers, if anything is.
    pub fn fault(&self) -> Option<String> {
        if !(self.sigma_a >= 0.0 && self.sigma_a.is_finite()) {
            return Some(format!("sigma_a is {}; expected 0 or more (1/mm)", self.sigma_a));
        }
        if !(self.sigma_s >= 0.0 && self.sigma_s.is_finite()) {
            return Some(format!("sigma_s is {}; expected 0 or more (1/mm)", self.sigma_s));
        }
        if !(self.g > -1.0 && self.g < 1.0) {
            return Some(format!("g is {}; expected between -1 and 1", self.g));
        }
        if !(self.a >= 1.0 && self.a.is_finite()) {
            return Some(format!("a is {}; expected (1+rho_d)/(1-rho_d), 1 or more", self.a));
        }
        None
    }

    /// Why no form describes this tissue at any thickness: scattering that is mostly backward differs from what its
    /// reduced coefficients say. Compared with random walks through ten mean free paths (σa .4, σs′ 9.5), the forms
    /// transmit 6 % too little at g = −.3, 12 % at −.5 and 44 % at −.9. For forward scattering it is 7 % too much at g
    /// = .9.
    pub fn doubt(&self) -> Option<String> {
        let backward =
            || format!("scattering as backward as g = {} is not described by its reduced coefficients", self.g);
        (self.g < MOST_BACKWARD).then(backward)
    }

    /// σs′ = (1−g)σs, 1/mm.
    pub fn reduced_scattering(&self) -> f64 {
        (1.0 - self.g) * self.sigma_s
    }

    /// σt′, 1/mm.
    pub(crate) fn reduced_extinction(&self) -> f64 {
        self.sigma_a + self.reduced_scattering()
    }

    /// l = 1/σt′, mm; infinite where nothing absorbs or scatters.
    pub fn mean_free_path(&self) -> f64 {
        1.0 / self.reduced_extinction()
    }

    fn coefficients(&self) -> Coefficients<f64> {
        Coefficients::new(self.sigma_a, self.sigma_s, self.g, self.a)
    }

    /// The same with derivatives by σa, σs and g (the fourth is the thickness factor's).
    fn dual_coefficients(&self) -> Coefficients<TissueDual<f64>> {
        let p = TissueDual::parameter;
        Coefficients::new(p(self.sigma_a, 0), p(self.sigma_s, 1), p(self.g, 2), self.a)
    }

    /// Whether the form is defined at this thickness (mm): d ≥ 0, and d > l for [`DipoleForm::Images`].
    fn defined(&self, d_mm: f64, form: DipoleForm) -> bool {
        d_mm >= 0.0 && (form != DipoleForm::Images || d_mm > self.mean_free_path())
    }

    /// T(r, d) in 1/mm²: exitance at distance `r_mm` ≥ 0 per entering flux, of scattered light only. The relative error
    /// is about 1e-12 for the two exact forms while σtr d < 50. The value is infinite at r = 0 for
    /// [`DipoleForm::Thin`], NaN where the form is not defined, and 0 where it underflows.
    pub fn transmittance(&self, r_mm: f64, d_mm: f64, form: DipoleForm) -> f64 {
        if !(self.defined(d_mm, form) && r_mm >= 0.0) {
            return f64::NAN;
        }
        if form == DipoleForm::Thin && (self.reduced_scattering() == 0.0 || d_mm == 0.0) {
            return 0.0;
        }
        if form == DipoleForm::Thin && r_mm == 0.0 {
            return f64::INFINITY;
        }
        in_space(&self.coefficients(), r_mm, d_mm, form)[0]
    }

    /// 2π ∫_r^∞ T(s, d) s ds: share of the entering flux that leaves farther than `r_mm` ≥ 0 away. Errors as
    /// [`Tissue::transmittance`].
    pub fn beyond(&self, r_mm: f64, d_mm: f64, form: DipoleForm) -> f64 {
        if !(self.defined(d_mm, form) && r_mm >= 0.0) {
            return f64::NAN;
        }
        if form == DipoleForm::Thin && (self.reduced_scattering() == 0.0 || d_mm == 0.0) {
            return 0.0;
        }
        if r_mm == 0.0 {
            return scattered(&self.coefficients(), 0.0, d_mm, form);
        }
        in_space(&self.coefficients(), r_mm, d_mm, form)[1]
    }

    /// [`Tissue::beyond`] and its derivatives by σa, σs, g and a factor on the thickness (∂/∂ ln d). The derivatives of
    /// [`DipoleForm::Dipoles`] by σa are infinite at σa = 0, where a truncated sum has a root; those of the other forms
    /// are ordinary there.
    pub fn beyond_with_partials(&self, r_mm: f64, d_mm: f64, form: DipoleForm) -> TissueDual<f64> {
        let d = TissueDual { value: d_mm, by: [0.0, 0.0, 0.0, d_mm] };
        if !(self.defined(d_mm, form) && r_mm >= 0.0) {
            return TissueDual { value: f64::NAN, by: [f64::NAN; scalar::PARTIALS] };
        }
        let c = self.dual_coefficients();
        if form == DipoleForm::Thin && (self.reduced_extinction() == 0.0 || d_mm == 0.0) {
            return TissueDual::of(0.0);
        }
        if r_mm == 0.0 { scattered(&c, TissueDual::of(0.0), d, form) } else { in_space(&c, r_mm, d, form)[1] }
    }

    /// Share of the flux that passes unscattered and leaves at r = 0: e^(−σt′ d) for [`DipoleForm::Thin`]; 0 for the
    /// other forms, which have no such part.
    pub fn ballistic(&self, d_mm: f64, form: DipoleForm) -> f64 {
        if form == DipoleForm::Thin { (-self.reduced_extinction() * d_mm).exp() } else { 0.0 }
    }

    /// Hankel transform ∫ T e^(−ik·x) d²x at wave number `k_per_mm` ≥ 0, the unscattered light included. NaN where the
    /// form is not defined.
    pub fn spectrum(&self, k_per_mm: f64, d_mm: f64, form: DipoleForm) -> f64 {
        if !self.defined(d_mm, form) {
            return f64::NAN;
        }
        let ballistic = self.ballistic(d_mm, form);
        if form == DipoleForm::Thin && (self.reduced_scattering() == 0.0 || d_mm == 0.0) {
            return ballistic;
        }
        scattered(&self.coefficients(), k_per_mm * k_per_mm, d_mm, form) + ballistic
    }

    /// Transmitted share of the entering flux: the spectrum at k = 0.
    pub fn total(&self, d_mm: f64, form: DipoleForm) -> f64 {
        self.spectrum(0.0, d_mm, form)
    }
}

#[cfg(test)]
mod tests;
