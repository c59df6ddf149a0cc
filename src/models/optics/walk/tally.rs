//! Sums over histories and their standard errors. Histories are run in batches, which are added up in a fixed order, so
//! that the result does not depend on the number of threads.

use mesophyll_base::error::{Error, Result};
use rand::RngExt;
use rand_pcg::Pcg64;
use rayon::prelude::*;

/// Number of histories in a batch; each batch has its own random stream.
const BATCH: u64 = 8192;

/// The number of histories, and the seed of their streams.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Histories {
    /// How many histories are run.
    pub count: u64,
    /// Seed of their random streams.
    pub seed: u64,
}

/// A mean over histories and its standard error.
///
/// Where no history scored at all, the value is 0 and the error is that of a single history of full weight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HistoryEstimate {
    /// The mean.
    pub value: f64,
    /// Its standard error.
    pub error: f64,
}

impl HistoryEstimate {
    /// Distance from a known value in standard errors.
    pub fn deviation(&self, known: f64) -> f64 {
        (self.value - known) / self.error
    }

    /// The same in another unit: value and error times `by`.
    pub fn scaled(self, by: f64) -> HistoryEstimate {
        HistoryEstimate { value: self.value * by, error: self.error * by.abs() }
    }
}

/// Σ x and Σ x² over the histories that scored.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ScoreSums {
    sum: f64,
    squares: f64,
}

impl ScoreSums {
    /// Adds the score of a history.
    pub fn add(&mut self, x: f64) {
        self.sum += x;
        self.squares += x * x;
    }

    /// Adds the sums of another batch.
    pub fn merge(&mut self, other: &ScoreSums) {
        self.sum += other.sum;
        self.squares += other.squares;
    }

    /// Mean over `count` histories.
    pub fn mean(&self, count: u64) -> HistoryEstimate {
        let n = count as f64;
        if self.squares == 0.0 {
            return HistoryEstimate { value: 0.0, error: 1.0 / n };
        }
        let value = self.sum / n;
        let variance = (self.squares / n - value * value).max(0.0) / (n - 1.0).max(1.0);
        HistoryEstimate { value, error: variance.sqrt() }
    }

    /// The share of this part in `whole`, of which it is a part.
    pub fn share(&self, whole: &ScoreSums) -> HistoryEstimate {
        if whole.sum <= 0.0 {
            return HistoryEstimate { value: f64::NAN, error: f64::NAN };
        }
        let p = self.sum / whole.sum;
        // Σ (w_part − p w)² over the histories: (1−p)² within the part, p² outside it
        let spread = self.squares * (1.0 - 2.0 * p) + p * p * whole.squares;
        HistoryEstimate { value: p, error: spread.max(0.0).sqrt() / whole.sum }
    }
}

/// Adds each part of one run to its counterpart.
pub fn merge<'a>(into: impl IntoIterator<Item = &'a mut ScoreSums>, from: impl IntoIterator<Item = &'a ScoreSums>) {
    into.into_iter().zip(from).for_each(|(a, b)| a.merge(b));
}

/// Where the flux of one run went, whatever shape it ran through.
#[derive(Debug, Clone, Default)]
pub struct FluxFates {
    /// Flux that was inside and left through the lit face.
    pub reflected: ScoreSums,
    /// Flux that was reflected without entering.
    pub glossy: ScoreSums,
    /// Flux that left through the other face.
    pub transmitted: ScoreSums,
    /// Flux that the tissue absorbed.
    pub absorbed: ScoreSums,
    /// Flux that was given up after too many events.
    pub lost: ScoreSums,
    /// Sum of all the above, history by history.
    pub balance: ScoreSums,
}

impl FluxFates {
    /// Adds the sums of another batch.
    pub fn merge(&mut self, o: &FluxFates) {
        let FluxFates { reflected, glossy, transmitted, absorbed, lost, balance } = self;
        merge(
            [reflected, glossy, transmitted, absorbed, lost, balance],
            [&o.reflected, &o.glossy, &o.transmitted, &o.absorbed, &o.lost, &o.balance],
        );
    }
}

/// A weighted mean Σ w x / Σ w over histories; its standard error to first order in the spread (a ratio of two sums).
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct RatioSums {
    w: f64,
    wx: f64,
    ww: f64,
    wwx: f64,
    wwxx: f64,
}

impl RatioSums {
    /// Adds the value `x` with the weight `w`.
    pub fn add(&mut self, w: f64, x: f64) {
        self.w += w;
        self.wx += w * x;
        self.ww += w * w;
        self.wwx += w * w * x;
        self.wwxx += w * w * x * x;
    }

    /// Adds the sums of another batch.
    pub fn merge(&mut self, o: &RatioSums) {
        self.w += o.w;
        self.wx += o.wx;
        self.ww += o.ww;
        self.wwx += o.wwx;
        self.wwxx += o.wwxx;
    }

    /// NaN where no history scored.
    pub fn mean(&self) -> HistoryEstimate {
        let q = self.wx / self.w;
        let spread = self.wwxx - 2.0 * q * self.wwx + q * q * self.ww;
        HistoryEstimate { value: q, error: spread.max(0.0).sqrt() / self.w }
    }
}

/// A uniform number in (0, 1].
pub fn uniform(rng: &mut Pcg64) -> f64 {
    1.0 - rng.random::<f64>()
}

/// The sums of one run.
pub trait Tally: Send {
    /// Adds the sums of another batch.
    fn merge(&mut self, other: &Self);
}

/// Runs `one` for each history: batches in parallel, added up in their order.
pub fn run<T: Tally>(
    histories: Histories,
    empty: impl Fn() -> T + Sync,
    one: impl Fn(&mut Pcg64, &mut T) + Sync,
) -> Result<T> {
    if histories.count < 2 {
        return Err(Error::Usage(format!("random walk: {} histories, expected at least 2", histories.count)));
    }
    let batches = histories.count.div_ceil(BATCH);
    // Not all batches run at once, because a tally may contain an image.
    let group = 2 * rayon::current_num_threads() as u64;
    let mut total = empty();
    for first in (0..batches).step_by(group as usize) {
        let parts: Vec<T> = (first..batches.min(first + group))
            .into_par_iter()
            .map(|batch| {
                let mut rng = stream(histories.seed, batch);
                let mut part = empty();
                for _ in 0..BATCH.min(histories.count - batch * BATCH) {
                    one(&mut rng, &mut part);
                }
                part
            })
            .collect();
        for part in &parts {
            total.merge(part);
        }
    }
    Ok(total)
}

/// The stream of one batch: its own increment and its own start.
fn stream(seed: u64, batch: u64) -> Pcg64 {
    let (a, b) = (mix(seed), mix(seed ^ mix(batch.wrapping_add(0x9e37_79b9_7f4a_7c15))));
    Pcg64::new((u128::from(a) << 64) | u128::from(b), (u128::from(b.rotate_left(32)) << 64) | u128::from(batch))
}

/// The finaliser of SplitMix64 (Steele et al. 2014).
fn mix(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}
