//! The models of the 27 problems, as each file prints them, written once for every precision (derivatives come by
//! forward mode).

use super::reader::NistDataset;
use crate::precise::{DoubleDouble, PreciseModel, PreciseModelProblem, PreciseProblem, PreciseReal};

/// The data and the formula in one type. The residual is `f(x; b) − y`; its sign does not matter.
macro_rules! models {
    ($($name:ident [$n:literal] |$b:ident, $x:ident| $formula:expr;)*) => {
        $(
            struct $name(Vec<Vec<DoubleDouble>>);

            impl PreciseModel<$n> for $name {
                fn residuals(&self) -> usize {
                    self.0.len()
                }

                fn residual<T: PreciseReal>(&self, $b: &[T; $n], index: usize) -> T {
                    let row = &self.0[index];
                    let $x = T::precise(row[1]);
                    let y: T = $formula;
                    y - T::precise(row[0])
                }
            }
        )*
    };
}

/// A whole number or a decimal fraction that `f64` holds exactly.
fn c<T: PreciseReal>(value: f64) -> T {
    T::constant(value)
}

fn cubic<T: PreciseReal>(a: [T; 4], x: T) -> T {
    a[0] + x * (a[1] + x * (a[2] + x * a[3]))
}

fn quadratic<T: PreciseReal>(a: [T; 3], x: T) -> T {
    a[0] + x * (a[1] + x * a[2])
}

/// exp(−((x − centre)/width)²)
fn bell<T: PreciseReal>(x: T, centre: T, width: T) -> T {
    (-((x - centre) / width).square()).exp()
}

models! {
    Misra1a[2] |b, x| b[0] * (c::<T>(1.0) - (-b[1] * x).exp());
    Misra1b[2] |b, x| b[0] * (c::<T>(1.0) - c::<T>(1.0) / (c::<T>(1.0) + b[1] * x / c(2.0)).square());
    Misra1c[2] |b, x| b[0] * (c::<T>(1.0) - c::<T>(1.0) / (c::<T>(1.0) + c::<T>(2.0) * b[1] * x).sqrt());
    Misra1d[2] |b, x| b[0] * b[1] * x / (c::<T>(1.0) + b[1] * x);
    Chwirut[3] |b, x| (-b[0] * x).exp() / (b[1] + b[2] * x);
    DanWood[2] |b, x| b[0] * x.pow(b[1]);
    Lanczos[6] |b, x| b[0] * (-b[1] * x).exp() + b[2] * (-b[3] * x).exp() + b[4] * (-b[5] * x).exp();
    Gauss[8] |b, x| b[0] * (-b[1] * x).exp() + b[2] * bell(x, b[3], b[4]) + b[5] * bell(x, b[6], b[7]);
    Kirby2[5] |b, x| quadratic([b[0], b[1], b[2]], x) / quadratic([c(1.0), b[3], b[4]], x);
    CubicRatio[7] |b, x| cubic([b[0], b[1], b[2], b[3]], x) / cubic([c(1.0), b[4], b[5], b[6]], x);
    Enso[9] |b, x| {
        let wave = |a: T, b: T, period: T| {
            let (sin, cos) = (c::<T>(2.0) * T::pi() * x / period).sin_cos();
            a * cos + b * sin
        };
        b[0] + wave(b[1], b[2], c(12.0)) + wave(b[4], b[5], b[3]) + wave(b[7], b[8], b[6])
    };
    Mgh09[4] |b, x| b[0] * (x.square() + x * b[1]) / (x.square() + x * b[2] + b[3]);
    Mgh10[3] |b, x| b[0] * (b[1] / (x + b[2])).exp();
    Mgh17[5] |b, x| b[0] + b[1] * (-x * b[3]).exp() + b[2] * (-x * b[4]).exp();
    Roszman1[4] |b, x| b[0] - b[1] * x - (b[2] / (x - b[3])).atan() / T::pi();
    Rat42[3] |b, x| b[0] / (c::<T>(1.0) + (b[1] - b[2] * x).exp());
    Rat43[4] |b, x| b[0] / (c::<T>(1.0) + (b[1] - b[2] * x).exp()).pow(c::<T>(1.0) / b[3]);
    Eckerle4[3] |b, x| b[0] / b[1] * (-((x - b[2]) / b[1]).square() / c(2.0)).exp();
    Bennett5[3] |b, x| b[0] * (b[1] + x).pow(-(c::<T>(1.0) / b[2]));
}

/// Nelson's response is a logarithm, and it has two predictors.
struct Nelson(Vec<Vec<DoubleDouble>>);

impl PreciseModel<3> for Nelson {
    fn residuals(&self) -> usize {
        self.0.len()
    }

    fn residual<T: PreciseReal>(&self, b: &[T; 3], index: usize) -> T {
        let row = &self.0[index];
        let (y, x1, x2) = (T::precise(row[0].ln()), T::precise(row[1]), T::precise(row[2]));
        b[0] - b[1] * x1 * (-b[2] * x2).exp() - y
    }
}

/// The problem in a file; `None` for a name or a shape that is not one of the 27.
pub fn problem(set: &NistDataset) -> Option<Box<dyn PreciseProblem + Send + Sync>> {
    let rows = set.rows.clone();
    let problem: Box<dyn PreciseProblem + Send + Sync> = match set.name.as_str() {
        "Misra1a" | "BoxBOD" => Box::new(PreciseModelProblem(Misra1a(rows))),
        "Misra1b" => Box::new(PreciseModelProblem(Misra1b(rows))),
        "Misra1c" => Box::new(PreciseModelProblem(Misra1c(rows))),
        "Misra1d" => Box::new(PreciseModelProblem(Misra1d(rows))),
        "Chwirut1" | "Chwirut2" => Box::new(PreciseModelProblem(Chwirut(rows))),
        "DanWood" => Box::new(PreciseModelProblem(DanWood(rows))),
        "Lanczos1" | "Lanczos2" | "Lanczos3" => Box::new(PreciseModelProblem(Lanczos(rows))),
        "Gauss1" | "Gauss2" | "Gauss3" => Box::new(PreciseModelProblem(Gauss(rows))),
        "Kirby2" => Box::new(PreciseModelProblem(Kirby2(rows))),
        "Hahn1" | "Thurber" => Box::new(PreciseModelProblem(CubicRatio(rows))),
        "ENSO" => Box::new(PreciseModelProblem(Enso(rows))),
        "MGH09" => Box::new(PreciseModelProblem(Mgh09(rows))),
        "MGH10" => Box::new(PreciseModelProblem(Mgh10(rows))),
        "MGH17" => Box::new(PreciseModelProblem(Mgh17(rows))),
        "Roszman1" => Box::new(PreciseModelProblem(Roszman1(rows))),
        "Rat42" => Box::new(PreciseModelProblem(Rat42(rows))),
        "Rat43" => Box::new(PreciseModelProblem(Rat43(rows))),
        "Eckerle4" => Box::new(PreciseModelProblem(Eckerle4(rows))),
        "Bennett5" => Box::new(PreciseModelProblem(Bennett5(rows))),
        "Nelson" => Box::new(PreciseModelProblem(Nelson(rows))),
        _ => return None,
    };
    let predictors = if set.name == "Nelson" { 2 } else { 1 };
    (problem.parameters() == set.values.len() && set.rows.iter().all(|r| r.len() == 1 + predictors)).then_some(problem)
}
