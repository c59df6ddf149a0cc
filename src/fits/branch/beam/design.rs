//! Marks on a branch: where they tell most about its taper and stiffness.

use crate::branch::beam::curve::BranchFitMarks;
use crate::branch::beam::fit::{DeflectionMark, PositionReference};
use mesophyll_base::selection::{DesignAim, DesignParameter, DesignProblem, DesignSituation};
use mesophyll_base::solvers::Problem;
use mesophyll_plants::mechanics::elastica::Elastica;
use mesophyll_plants::mechanics::load::Load;

/// What is known before any reading: ln of the taper, and the load over the stiffness relative to itself.
const KNOWN: [f64; 2] = [1.5, 3.0];

/// A branch that will be loaded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BeamDesign {
    /// Its length (mm).
    pub length_mm: f64,
    /// Least and largest taper that it may have.
    pub taper: [f64; 2],
    /// How far its tip will move (mm).
    pub tip_mm: f64,
    /// How the load hangs on it.
    pub load: Load,
    /// What positions are measured along.
    pub along: PositionReference,
    /// Standard error of a deflection (mm).
    pub noise_mm: f64,
    /// Marks to choose among, evenly from the root's side to the tip.
    pub candidates: usize,
}

/// Tapers that a design has to serve.
const TAPERS: usize = 9;

impl BeamDesign {
    /// Positions of the marks (mm).
    pub fn positions(&self) -> Vec<f64> {
        (1..=self.candidates).map(|k| self.length_mm * k as f64 / self.candidates as f64).collect()
    }

    /// The tapers, evenly in their logarithm.
    pub fn tapers(&self) -> Vec<f64> {
        let [a, b] = self.taper.map(f64::ln);
        let at = |k: usize| (a + (b - a) * k as f64 / (TAPERS - 1) as f64).exp();
        if a == b { vec![self.taper[0]] } else { (0..TAPERS).map(at).collect() }
    }

    /// The load over the stiffness that moves the tip so far.
    ///
    /// # Errors
    /// In words, where no load does.
    pub fn amplitude(&self, taper: f64, load: Load) -> Result<f64, String> {
        let tip = |a: f64| Elastica::solve(load, taper, a).map(|bent| self.length_mm * bent.at(1.0).across);
        let mut most = 1e-6;
        while tip(most).ok_or("the branch cannot be bent so far")? < self.tip_mm {
            most *= 2.0;
            if most > 1e6 {
                return Err(format!("no load moves the tip by {} mm", self.tip_mm));
            }
        }
        let mut least = 0.5 * most;
        for _ in 0..60 {
            let middle = 0.5 * (least + most);
            if tip(middle).is_some_and(|t| t < self.tip_mm) {
                least = middle;
            } else {
                most = middle;
            }
        }
        Ok(0.5 * (least + most))
    }

    fn marks(&self) -> Vec<DeflectionMark> {
        let mark = |position| DeflectionMark { position, deflection: 0.0, error: self.noise_mm };
        self.positions().into_iter().map(mark).collect()
    }

    /// The problem of choosing marks: of ln α and of the load over the stiffness relative to itself.
    ///
    /// # Errors
    /// In words, where a branch of these tapers cannot be bent so far.
    pub fn problem(&self) -> Result<DesignProblem, String> {
        let marks = self.marks();
        let load = self.load.on(self.length_mm)?;
        let mut situations = Vec::new();
        for taper in self.tapers() {
            let amplitude = self.amplitude(taper, load)?;
            let curve = self.curve(&marks, load);
            let mut jacobian = vec![0.0; 2 * marks.len()];
            if !curve.jacobian(&[taper.ln(), amplitude], &mut jacobian) {
                return Err(format!("the curve of a branch of taper {taper:.3} cannot be computed"));
            }
            let (by_taper, by_load) = jacobian.split_at(marks.len());
            let rows = by_taper.iter().zip(by_load).map(|(a, b)| vec![*a, amplitude * b]).collect();
            situations.push(DesignSituation { values: vec![1.0, 1.0], rows });
        }
        let names = ["alpha", "load_over_stiffness"];
        let parameter = |(name, known): (&str, f64)| DesignParameter { name: name.into(), known, wanted: true };
        let parameters = names.into_iter().zip(KNOWN).map(parameter).collect();
        Ok(DesignProblem { aim: DesignAim::Parameters, parameters, situations, taken: Vec::new() })
    }

    fn curve<'a>(&self, marks: &'a [DeflectionMark], load: Load) -> BranchFitMarks<'a> {
        let (length, along) = (self.length_mm, self.along);
        BranchFitMarks { readings: marks, length, along, load, stated: true, untapered: false }
    }

    /// How many standard deviations of χ² another load adds at the chosen marks, the least over the tapers.
    pub fn lack_of_fit(&self, problem: &DesignProblem, chosen: &[usize], other: Load) -> Option<f64> {
        let (marks, load, other) = (self.marks(), self.load.on(self.length_mm).ok()?, other.on(self.length_mm).ok()?);
        let mut least = f64::INFINITY;
        for (k, taper) in self.tapers().into_iter().enumerate() {
            let values = |load: Load| {
                let mut out = vec![0.0; marks.len()];
                let amplitude = self.amplitude(taper, load).ok()?;
                self.curve(&marks, load).evaluate(&[taper.ln(), amplitude], &mut out);
                Some(out)
            };
            let (own, theirs) = (values(load)?, values(other)?);
            let difference: Vec<Vec<f64>> = own.iter().zip(&theirs).map(|(a, b)| vec![b - a]).collect();
            let freedom = chosen.len().saturating_sub(2) as f64;
            let left = problem.lack_of_fit(k, chosen, &difference)?;
            least = least.min(if freedom > 0.0 { left / (2.0 * freedom).sqrt() } else { 0.0 });
        }
        Some(least)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::branch::beam::fit::{MeasuredBranch, fit};
    use crate::gloss::synthetic::GaussianDeviates;

    const BRANCH: BeamDesign = BeamDesign {
        length_mm: 400.0,
        taper: [0.3, 0.3],
        tip_mm: 40.0,
        load: Load::Tip,
        along: PositionReference::Branch,
        noise_mm: 0.3,
        candidates: 40,
    };

    #[test]
    fn planned_errors_are_the_scatter_of_fits() {
        let problem = BRANCH.problem().unwrap();
        let choice = problem.choose(6).unwrap();
        let amplitude = BRANCH.amplitude(0.3, Load::Tip).unwrap();
        let bent = Elastica::solve(Load::Tip, 0.3, amplitude).unwrap();
        assert!((400.0 * bent.at(1.0).across - 40.0).abs() < 1e-6);
        let mut noise = GaussianDeviates::new(7);
        let (draws, mut squares) = (300, [0.0; 2]);
        for _ in 0..draws {
            let mark = |k: &usize| {
                let position = BRANCH.positions()[*k];
                let deflection = 400.0 * bent.at(position / 400.0).across + 0.3 * noise.normal();
                DeflectionMark { position, deflection, error: 0.3 }
            };
            let readings = choice.chosen.iter().map(mark).collect();
            let branch = MeasuredBranch { length: 400.0, readings, load: [f64::NAN; 2], modulus: [f64::NAN; 2] };
            let found = fit(&branch, PositionReference::Branch, Some(Load::Tip)).unwrap();
            squares[0] += (found.taper.value / 0.3).ln().powi(2);
            squares[1] += (found.load_over_stiffness.value / (400.0 * amplitude) - 1.0).powi(2);
        }
        for (square, stated) in squares.into_iter().zip(&choice.errors) {
            let seen = f64::sqrt(square / f64::from(draws));
            assert!((seen / stated - 1.0).abs() < 0.12, "{seen} {stated}");
        }
    }

    /// An even load bends a branch of another taper nearly as a load at the tip bends this one, so only precise
    /// readings tell them apart, and two marks never do.
    #[test]
    fn only_precise_marks_tell_the_load() {
        let all: Vec<usize> = (0..40).collect();
        let seen = |noise_mm: f64, chosen: &[usize]| {
            let design = BeamDesign { taper: [0.2, 0.8], noise_mm, ..BRANCH };
            design.lack_of_fit(&design.problem().unwrap(), chosen, Load::Even).unwrap()
        };
        assert!(seen(0.01, &all) > 4.0 && seen(0.3, &all) < 4.0);
        assert_eq!(seen(0.01, &[19, 39]), 0.0);
    }
}
