//! Linear systems whose matrix is symmetric, positive and banded.

/// A symmetric matrix of which only a band below the diagonal is kept: row `i` has the columns `i − band` to `i`.
pub(super) struct BandedMatrix {
    band: usize,
    rows: Vec<f64>,
}

impl BandedMatrix {
    pub fn zeros(n: usize, band: usize) -> BandedMatrix {
        BandedMatrix { band, rows: vec![0.0; n * (band + 1)] }
    }

    /// The entry of a row and of a column that is not beyond it and within the band.
    pub fn at(&mut self, row: usize, column: usize) -> &mut f64 {
        &mut self.rows[row * (self.band + 1) + column + self.band - row]
    }

    /// Cholesky's factor; `None` where the matrix is not positive.
    pub fn factor(mut self) -> Option<BandedFactor> {
        let band = self.band;
        let n = self.rows.len() / (band + 1);
        for i in 0..n {
            let first = i.saturating_sub(band);
            for j in first..=i {
                let from = first.max(j.saturating_sub(band));
                let mut sum = *self.at(i, j);
                for k in from..j {
                    sum -= *self.at(i, k) * *self.at(j, k);
                }
                if i == j {
                    if sum <= 0.0 || !sum.is_finite() {
                        return None;
                    }
                    *self.at(i, i) = sum.sqrt();
                } else {
                    *self.at(i, j) = sum / *self.at(j, j);
                }
            }
        }
        Some(BandedFactor { band, rows: self.rows })
    }
}

/// Cholesky's factor of a [`BandedMatrix`].
pub(super) struct BandedFactor {
    band: usize,
    rows: Vec<f64>,
}

impl BandedFactor {
    fn at(&self, row: usize, column: usize) -> f64 {
        self.rows[row * (self.band + 1) + column + self.band - row]
    }

    /// Solves the system for a right side.
    pub fn solve(&self, mut b: Vec<f64>) -> Vec<f64> {
        for i in 0..b.len() {
            for k in i.saturating_sub(self.band)..i {
                b[i] -= self.at(i, k) * b[k];
            }
            b[i] /= self.at(i, i);
        }
        for i in (0..b.len()).rev() {
            b[i] /= self.at(i, i);
            for k in i.saturating_sub(self.band)..i {
                b[k] -= self.at(i, k) * b[i];
            }
        }
        b
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_banded_system_is_solved() {
        let (n, band) = (9, 3);
        let entry = |i: usize, j: usize| if i == j { 5.0 + i as f64 } else { 1.0 / (1.0 + (i * j) as f64) };
        let truth: Vec<f64> = (0..n).map(|k| (k as f64).sin()).collect();
        let mut matrix = BandedMatrix::zeros(n, band);
        let mut b = vec![0.0; n];
        for i in 0..n {
            for j in i.saturating_sub(band)..=i {
                *matrix.at(i, j) = entry(i, j);
                b[i] += entry(i, j) * truth[j];
                if i != j {
                    b[j] += entry(i, j) * truth[i];
                }
            }
        }
        let found = matrix.factor().unwrap().solve(b);
        assert!(found.iter().zip(&truth).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
        let mut negative = BandedMatrix::zeros(1, 0);
        *negative.at(0, 0) = -1.0;
        assert!(negative.factor().is_none());
    }
}
