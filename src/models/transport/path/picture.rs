//! A picture that is drawn in rounds: every pixel's mean radiance and its standard error, from independent
//! randomisations.
//!
//! A round gives every pixel the same number of paths, from one scrambled sequence of its own. Paths within a round are
//! correlated, but rounds are independent of each other. So the scatter of their means gives the error. For P rounds
//! with n_p paths and means m_p, whose mean weighted by n_p is m, the standard error is √(Σ n_p (m_p − m)²/((P − 1) Σ
//! n_p)).
//!
//! Means and sums are rounded to f32 after every round. So a picture that was stored and read again continues with the
//! same bits.

use super::samples::{MOST_PATHS, PathSampler};
use super::{Brought, PathTracer, SIDE_BY_SIDE};
use crate::camera::{CameraRays, ReferenceCamera};
use crate::seeds::{mix, scramble};
use crate::{Error, Result};
use mesophyll_base::statistics::median_of;
use mesophyll_files::image::{ChannelMaps, Packing, read_exr, write_exr};
use mesophyll_files::progress::{self, TaskProgress};
use rayon::prelude::*;
use std::path::Path;
use std::time::{Duration, Instant};

/// When drawing ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SamplingTarget {
    /// Camera paths for each pixel; with `None` drawing goes on until `error` is reached.
    pub samples: Option<u32>,
    /// Median relative error ([`PathPicture::median_error`]) at which drawing ends earlier.
    pub error: Option<f64>,
}

/// Everything that determines a picture's bits, besides the tracer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathRequest {
    /// The camera.
    pub camera: ReferenceCamera,
    /// Width and height in pixels.
    pub size: [usize; 2],
    /// Seed of the random numbers.
    pub seed: u64,
    /// When drawing ends.
    pub target: SamplingTarget,
}

/// How drawing ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DrawingOutcome {
    /// The number of paths or the error that was requested is reached.
    Done,
    /// A stop was requested; the picture can be continued.
    Stopped,
}

/// What has been drawn so far; row-major, row 0 on top.
#[derive(Debug, Clone, PartialEq)]
pub struct PathPicture {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Mean radiance.
    pub mean: Vec<[f32; 3]>,
    /// Σ n_p (m_p − m)².
    spread: Vec<[f32; 3]>,
    /// Number of paths of each pixel and number of rounds, for each row.
    done: Vec<[u32; 2]>,
    /// Whether any path of the pixel hit a leaf.
    met: Vec<bool>,
    /// Number of paths that were cut off because they scattered too often or carried too much. Their light is missing.
    pub cut: u64,
}

/// Paths of a pixel in a round, where only an error is requested.
const ROUND: u32 = 16;
/// Number of rounds from which on an error can end a picture. With fewer it is too uncertain.
const LEAST_ROUNDS: u32 = 4;
/// Time between two calls of the function that stores an unfinished picture.
const STORE_EVERY: Duration = Duration::from_secs(30);

impl PathPicture {
    /// A picture without any paths yet.
    pub fn new(width: usize, height: usize) -> PathPicture {
        let pixels = width * height;
        PathPicture {
            width,
            height,
            mean: vec![[0.0; 3]; pixels],
            spread: vec![[0.0; 3]; pixels],
            done: vec![[0; 2]; height],
            met: vec![false; pixels],
            cut: 0,
        }
    }

    /// Bytes of memory for a picture of this size while it is drawn and written.
    pub fn bytes(width: usize, height: usize) -> u64 {
        (width * height) as u64 * 120
    }

    /// The smallest and the largest number of paths of a pixel.
    pub fn paths(&self) -> [u32; 2] {
        let each = || self.done.iter().map(|d| d[0]);
        [each().min().unwrap_or(0), each().max().unwrap_or(0)]
    }

    /// Number of paths of all pixels together.
    pub fn total_paths(&self) -> u64 {
        self.done.iter().map(|d| u64::from(d[0]) * self.width as u64).sum()
    }

    /// Standard error of the mean of pixel `k`. It is undetermined, and NaN, with fewer than two rounds.
    pub fn error(&self, k: usize) -> [f32; 3] {
        let [paths, rounds] = self.done[k / self.width].map(f64::from);
        self.spread[k]
            .map(|s| if rounds < 2.0 { f32::NAN } else { (f64::from(s) / (rounds - 1.0) / paths).sqrt() as f32 })
    }

    /// Median, over the pixels that show a leaf, of the error relative to the radiance, each averaged over the
    /// channels. `None` where it is undetermined: after one round, or where no leaf is seen.
    pub fn median_error(&self) -> Option<f64> {
        let mean = |c: [f32; 3]| c.iter().map(|v| f64::from(*v)).sum::<f64>();
        let all = (0..self.mean.len())
            .filter(|k| self.met[*k] && mean(self.mean[*k]) > 0.0)
            .map(|k| mean(self.error(k)) / mean(self.mean[k]))
            .filter(|e| !e.is_nan());
        median_of(all)
    }

    /// Draws until the target is reached or a stop is requested. `store` is called with the current picture from time
    /// to time, and at the end.
    ///
    /// # Errors
    /// [`Error::Usage`] for an empty picture, no samples, or a camera that looks nowhere; those of `store`.
    pub fn draw(
        &mut self,
        tracer: &PathTracer,
        request: &PathRequest,
        what: &str,
        store: &mut dyn FnMut(&PathPicture) -> Result<()>,
    ) -> Result<DrawingOutcome> {
        let [width, height] = request.size;
        if width == 0 || height == 0 || [self.width, self.height] != request.size {
            return Err(Error::Usage(format!("a picture of {width}×{height} pixels, expected at least 1×1")));
        }
        if request.target.samples == Some(0) {
            return Err(Error::Usage("0 samples a pixel, expected at least 1".into()));
        }
        let lens = CameraRays::new(&request.camera, width, height)?;
        let mut stored = Instant::now();
        let (mut bar, before) = (None, self.total_paths());
        loop {
            let plan: Vec<Option<u32>> = self.done.iter().map(|d| next_round(*d, request.target)).collect();
            // Where no leaf is seen, there is no error to wait for.
            let reached = || request.target.error.is_some_and(|e| self.median_error().is_none_or(|now| now <= e));
            let level = self.done.iter().all(|d| *d == self.done[0]);
            if plan.iter().all(Option::is_none)
                || (level && self.done[0][1] >= LEAST_ROUNDS.min(rounds_of(request.target)) && reached())
            {
                store(self)?;
                return Ok(DrawingOutcome::Done);
            }
            let bar = bar.get_or_insert_with(|| self.bar(what, request.target));
            // The rows with the fewest rounds come first.
            let least = (0..height).filter(|j| plan[*j].is_some()).map(|j| self.done[j][1]).min().unwrap_or(0);
            let rows: Vec<(usize, u32)> = (0..height)
                .filter(|j| self.done[*j][1] == least)
                .filter_map(|j| plan[j].map(|paths| (j, paths)))
                .collect();
            let drawn: Vec<(usize, u32, Vec<Brought>, u64)> = rows
                .into_par_iter()
                .filter_map(|(j, paths)| {
                    let seed = |i: usize| pixel_seed(request.seed, j * width + i, least);
                    let row = tracer.row(&lens, j, width, paths, seed);
                    bar.advance(u64::from(paths) * width as u64);
                    row.map(|(row, cut)| (j, paths, row, cut))
                })
                .collect();
            for (j, paths, row, cut) in drawn {
                self.take(j, paths, &row);
                self.cut += cut;
            }
            if let Some(expected) = self.expected(request.target, self.total_paths() - before) {
                bar.set_total(expected);
            }
            if progress::stop_requested() {
                store(self)?;
                return Ok(DrawingOutcome::Stopped);
            }
            if stored.elapsed() > STORE_EVERY {
                store(self)?;
                stored = Instant::now();
            }
        }
    }

    /// The number of paths after which the error will probably be as small as requested. `None` if only a number of
    /// paths is requested, or if the error is not known yet. Half the error needs four times the paths.
    fn expected(&self, target: SamplingTarget, followed: u64) -> Option<u64> {
        let ratio = self.median_error()? / target.error.filter(|_| target.samples.is_none())?;
        let wanted = self.total_paths() as f64 * ratio * ratio;
        // A whole number of rounds, and at least the number from which on an error can end a picture.
        let round = (self.width * self.height) as f64 * f64::from(ROUND);
        let wanted = (wanted / round).ceil().max(f64::from(LEAST_ROUNDS)) * round;
        Some(followed + (wanted as u64).saturating_sub(self.total_paths()))
    }

    /// A progress bar over the remaining paths. Where only an error is requested, their number is not known.
    fn bar(&self, what: &str, target: SamplingTarget) -> TaskProgress {
        match target.samples {
            Some(samples) => {
                let left = (u64::from(samples) * (self.width * self.height) as u64).saturating_sub(self.total_paths());
                TaskProgress::new(what, left)
            }
            None => TaskProgress::of(what),
        }
    }

    /// Adds a round of row `j`. Weighted mean and sum of squares are updated by the method of West 1979.
    pub(super) fn take(&mut self, j: usize, paths: u32, row: &[Brought]) {
        let weight = f64::from(paths);
        let total = f64::from(self.done[j][0]) + weight;
        for (i, brought) in row.iter().enumerate() {
            let k = j * self.width + i;
            for c in 0..3 {
                let (old, new) = (f64::from(self.mean[k][c]), brought.radiance[c]);
                let mean = old + (new - old) * weight / total;
                self.mean[k][c] = mean as f32;
                self.spread[k][c] = (f64::from(self.spread[k][c]) + weight * (new - old) * (new - mean)) as f32;
            }
            self.met[k] |= brought.met;
        }
        self.done[j] = [self.done[j][0] + paths, self.done[j][1] + 1];
    }

    /// Writes R, G, B (radiance) and their standard errors error.R, error.G, error.B.
    ///
    /// # Errors
    /// [`Error::Write`] naming the file.
    pub fn write(&self, path: &Path) -> Result<()> {
        let mut maps = ChannelMaps::new(self.width, self.height);
        let errors: Vec<[f32; 3]> = (0..self.mean.len()).map(|k| self.error(k)).collect();
        for (prefix, values) in [("", &self.mean), ("error.", &errors)] {
            for (c, channel) in ["R", "G", "B"].into_iter().enumerate() {
                maps.push(format!("{prefix}{channel}"), values.iter().map(|v| v[c]).collect());
            }
        }
        write_exr(path, &maps, Packing::Zip)
    }

    /// Writes everything that [`PathPicture::restore`] needs to continue.
    ///
    /// # Errors
    /// [`Error::Write`] naming the file.
    pub fn store(&self, path: &Path) -> Result<()> {
        let mut maps = ChannelMaps::new(self.width, self.height);
        let row = |k: usize| k / self.width;
        for (c, channel) in ["R", "G", "B"].into_iter().enumerate() {
            maps.push(channel, self.mean.iter().map(|v| v[c]).collect());
            maps.push(format!("spread.{channel}"), self.spread.iter().map(|v| v[c]).collect());
        }
        for (q, name) in ["paths", "rounds"].into_iter().enumerate() {
            maps.push(name, (0..self.mean.len()).map(|k| self.done[row(k)][q] as f32).collect());
        }
        maps.push("met", self.met.iter().map(|m| f32::from(u8::from(*m))).collect());
        // A count that f32 cannot hold exactly occurs only in a picture that is useless anyway.
        maps.push("cut", vec![self.cut as f32; self.mean.len()]);
        write_exr(path, &maps, Packing::Zip)
    }

    /// Reads what [`PathPicture::store`] wrote.
    ///
    /// # Errors
    /// [`Error::Input`] for a file that is missing, damaged or of another size.
    pub fn restore(path: &Path, [width, height]: [usize; 2]) -> Result<PathPicture> {
        let maps = read_exr(path)?;
        if [maps.width, maps.height] != [width, height] {
            let found = format!("a picture of {}×{} pixels, expected {width}×{height}", maps.width, maps.height);
            return Err(Error::input(path, found));
        }
        let mut out = PathPicture::new(width, height);
        for (c, channel) in ["R", "G", "B"].into_iter().enumerate() {
            let (mean, spread) = (maps.require(path, channel)?, maps.require(path, &format!("spread.{channel}"))?);
            for k in 0..width * height {
                (out.mean[k][c], out.spread[k][c]) = (mean[k], spread[k]);
            }
        }
        for (q, name) in ["paths", "rounds"].into_iter().enumerate() {
            let values = maps.require(path, name)?;
            (0..height).for_each(|j| out.done[j][q] = values[j * width] as u32);
        }
        let met = maps.require(path, "met")?;
        out.met = met.iter().map(|m| *m > 0.5).collect();
        out.cut = maps.require(path, "cut")?[0] as u64;
        Ok(out)
    }
}

/// Number of rounds of a picture with so many paths for each pixel: enough rounds for a good error, each long enough to
/// cover its dimensions evenly.
fn rounds_of(target: SamplingTarget) -> u32 {
    match target.samples {
        Some(samples) => {
            let even = 2u32 << (f64::from(samples).sqrt().log2() as u32);
            even.clamp(2, 32).min(samples).max(samples.div_ceil(MOST_PATHS))
        }
        None => u32::MAX,
    }
}

/// Number of paths of the next round of a row with `[paths, rounds]`; `None` where the row is finished.
fn next_round([paths, rounds]: [u32; 2], target: SamplingTarget) -> Option<u32> {
    let Some(samples) = target.samples else { return Some(ROUND) };
    let left = samples.checked_sub(paths).filter(|n| *n > 0)?;
    let of = |samples: u32, count: u32, k: u32| samples / count + u32::from(k < samples % count);
    // A row that was begun for the same number of paths continues with the next of the same rounds.
    let count = rounds_of(target);
    let begun: u64 = (0..rounds.min(count)).map(|k| u64::from(of(samples, count, k))).sum();
    if rounds < count && begun == u64::from(paths) {
        return Some(of(samples, count, rounds));
    }
    // A row that was begun for another number of paths gets rounds of the same size, or of twice the size if they were
    // small. Means of rounds of about the same size have about the same scatter.
    Some((paths / rounds.max(1)).max(of(samples, count, 0).min(2 * paths / rounds.max(1))).clamp(1, left))
}

/// A different seed for every round of every pixel.
pub(super) fn pixel_seed(seed: u64, pixel: usize, round: u32) -> u32 {
    scramble(mix(seed, pixel as u64), u64::from(round))
}

impl PathTracer<'_> {
    /// The means of `paths` paths through each pixel of row `j`, and how many were cut off: a box filter over the
    /// pixel's square. `None` where a stop was asked for.
    pub(super) fn row(
        &self,
        lens: &CameraRays,
        j: usize,
        width: usize,
        paths: u32,
        seed: impl Fn(usize) -> u32,
    ) -> Option<(Vec<Brought>, u64)> {
        let (mut row, mut cut) = (vec![Brought::default(); width], 0);
        let all = width as u64 * u64::from(paths);
        let pixel = |n: u64| (n / u64::from(paths)) as usize;
        for first in (0..all).step_by(SIDE_BY_SIDE as usize) {
            if progress::stop_requested() {
                return None;
            }
            let numbers = first..all.min(first + u64::from(SIDE_BY_SIDE));
            let mut samples: Vec<PathSampler> =
                numbers.clone().map(|n| PathSampler::new(seed(pixel(n)), (n % u64::from(paths)) as u32)).collect();
            let begun = numbers.clone().zip(&mut samples).map(|(n, samples)| {
                let [x, y, ..] = samples.next();
                (lens.ray(pixel(n) as f64 + x, j as f64 + y), samples)
            });
            for (n, brought) in numbers.clone().zip(self.follow_each(begun)) {
                let sum = &mut row[pixel(n)];
                (0..3).for_each(|c| sum.radiance[c] += brought.radiance[c] / f64::from(paths));
                sum.met |= brought.met;
                cut += u64::from(brought.cut);
            }
        }
        Some((row, cut))
    }
}
