//! What readings scatter with the discs that are drawn, where nobody knows which of them stand.

use crate::Result;
use crate::photographs::{PixelUse, ScenePhotograph};
use crate::pictures::{LitScene, LitWorld, draw, exposure, rounds};
use crate::steps::{ReadingComparison, SceneNormal};
use crate::unknowns::SceneUnknowns;
use mesophyll_transport::path::slopes::DerivativePicture;
use nalgebra::{DMatrix, DVector};
use std::ops::Range;

/// The draws that are compared. Those of the fit come before them.
const COMPARED: Range<u64> = 2000..2008;

/// Pictures of several draws of the discs.
pub struct AreaScatter {
    /// For each draw, the pictures of all shots.
    draws: Vec<Vec<DerivativePicture>>,
    /// What the scatter of the draws is multiplied by, as a variance.
    share: f64,
}

impl AreaScatter {
    /// Pictures with the present numbers, by paths with the same random numbers. `None` where no area is unknown.
    ///
    /// # Errors
    /// As [`draw`].
    pub fn new(
        numbers: &SceneUnknowns,
        shots: &[ScenePhotograph],
        paths: u32,
        seed: u64,
    ) -> Result<Option<AreaScatter>> {
        if numbers.areas().next().is_none() {
            return Ok(None);
        }
        let [rounds, each] = rounds(paths, 1);
        let one = |number: u64| {
            let worlds = LitWorld::all(numbers, shots, number..number + 1, false)?;
            draw(&LitScene::all(numbers, &worlds)?, shots, |_| true, None, [2 * rounds, each], seed)
        };
        // The real discs are one draw, and the fit's are the mean of several. An error from so few draws has the
        // distribution of Student, whose variance has f − 2 in place of f degrees of freedom.
        let share = (1.0 + 1.0 / numbers.draws() as f64) / ((COMPARED.end - COMPARED.start) as f64 - 3.0);
        Ok(Some(AreaScatter { draws: COMPARED.map(one).collect::<Result<_>>()?, share }))
    }

    /// What a reading is in each draw, less the mean of all.
    fn apart(&self, numbers: &SceneUnknowns, shots: &[ScenePhotograph], [s, k, c]: [usize; 3]) -> Vec<f64> {
        let (factor, at) = (exposure(numbers, &shots[s]), k * shots[s].channels + c);
        let all: Vec<f64> = self.draws.iter().map(|pictures| factor * pictures[s].mean[at]).collect();
        let mean = all.iter().sum::<f64>() / all.len() as f64;
        all.iter().map(|v| v - mean).collect()
    }

    /// Adds to a covariance what the numbers scatter with the draws, and returns that part.
    pub fn widen(
        &self,
        numbers: &SceneUnknowns,
        shots: &[ScenePhotograph],
        normal: &SceneNormal,
        covariance: &mut DMatrix<f64>,
    ) -> DMatrix<f64> {
        let n = covariance.nrows();
        let known: Vec<bool> = (0..n).map(|k| covariance[(k, k)].is_finite()).collect();
        let mut pulls = vec![DVector::<f64>::zeros(n); self.draws.len()];
        let apart: Vec<Vec<f64>> = normal.compared.iter().map(|c| self.apart(numbers, shots, c.at)).collect();
        for (place, number, slope) in normal.slopes.iter().filter(|(_, number, _)| known[*number]) {
            let reading = &normal.compared[*place];
            if reading.of == PixelUse::Fitted {
                let weight = slope / (reading.error * reading.error);
                pulls.iter_mut().zip(&apart[*place]).for_each(|(pull, apart)| pull[*number] += weight * apart);
            }
        }
        let moves = DMatrix::from_fn(n, n, |i, j| if known[i] && known[j] { covariance[(i, j)] } else { 0.0 });
        let mut part: DMatrix<f64> = DMatrix::zeros(n, n);
        for pull in pulls {
            let moved = &moves * pull;
            part += &moved * moved.transpose() * self.share;
        }
        *covariance += &part;
        part
    }

    /// Gives readings the scatter of the draws as an error of its own, and returns its mean share of their variances.
    pub fn judge(&self, numbers: &SceneUnknowns, shots: &[ScenePhotograph], compared: &mut [ReadingComparison]) -> f64 {
        let (mut shares, readings) = (0.0, compared.len().max(1) as f64);
        for reading in compared {
            let apart = self.apart(numbers, shots, reading.at);
            let variance = self.share * apart.iter().map(|v| v * v).sum::<f64>();
            let error = reading.error.hypot(variance.sqrt());
            shares += variance / (error * error);
            reading.residual *= reading.error / error;
            reading.error = error;
        }
        shares / readings
    }
}
