//! Medians, quantiles and the scatter that wild values do not change.
//!
//! Floating-point numbers are ordered as by `total_cmp`, so a NaN is the largest or the smallest value and is counted.
//! Whoever does not want it there leaves it out first. Nothing has no median: the answer is `None`.
//!
//! A quantile of few values depends on the rule by which its place between two neighbours is rounded. The figures of
//! the program are defined by four rules, one function each. They agree for large lists only.

use std::cmp::Ordering;

/// The median of the absolute value of a normal variable with a standard deviation of 1.
pub const NORMAL_MEDIAN: f64 = 0.674_489_75;

/// The standard deviation of a normal variable over the median of its absolute value, with the five digits by which
/// scatters are usually defined. That is not exactly the inverse of [`NORMAL_MEDIAN`].
pub const NORMAL_SCATTER: f64 = 1.4826;

/// Numbers with an order that has a place for every value, NaN too.
pub trait TotalOrder: Copy {
    fn order(&self, other: &Self) -> Ordering;
}

impl TotalOrder for f32 {
    fn order(&self, other: &f32) -> Ordering {
        self.total_cmp(other)
    }
}

impl TotalOrder for f64 {
    fn order(&self, other: &f64) -> Ordering {
        self.total_cmp(other)
    }
}

/// The value at place `at` of the sorted values; the last one for a larger `at`. This puts `values` into another order.
fn ranked<T: TotalOrder>(values: &mut [T], at: usize) -> Option<T> {
    let last = values.len().checked_sub(1)?;
    Some(*values.select_nth_unstable_by(at.min(last), T::order).1)
}

/// The middle value, the upper of the two of an even count. This puts `values` into another order.
pub fn median<T: TotalOrder>(values: &mut [T]) -> Option<T> {
    ranked(values, values.len() / 2)
}

/// [`median`] of values that are not needed any more.
pub fn median_of<T: TotalOrder>(values: impl IntoIterator<Item = T>) -> Option<T> {
    median(&mut values.into_iter().collect::<Vec<T>>())
}

/// The median, and the scatter around it: [`NORMAL_SCATTER`] times the median absolute deviation, which for normal
/// values is their standard deviation. It stays valid until half of the values are wild.
pub fn spread(values: &[f64]) -> Option<(f64, f64)> {
    let middle = median_of(values.iter().copied())?;
    Some((middle, NORMAL_SCATTER * median_of(values.iter().map(|v| (v - middle).abs()))?))
}

/// The quantile `share` (0 … 1): the value that is nearest to this share of the way from the smallest to the largest.
/// This puts `values` into another order.
pub fn quantile<T: TotalOrder>(values: &mut [T], share: f64) -> Option<T> {
    ranked(values, (share * (values.len() as f64 - 1.0)).round() as usize)
}

/// As [`quantile`], but the lower of the two values between which it lies. This puts `values` into another order.
pub fn lower_quantile<T: TotalOrder>(values: &mut [T], share: f64) -> Option<T> {
    ranked(values, (share * (values.len() as f64 - 1.0)) as usize)
}

/// The smallest value that is not smaller than `parts` of `of` equal parts of the values, as the median is for one of
/// two. This puts `values` into another order.
pub fn upper_quantile<T: TotalOrder>(values: &mut [T], parts: usize, of: usize) -> Option<T> {
    ranked(values, values.len() * parts / of)
}

/// The smallest of the sorted values that at least the share `p` of the values does not exceed.
pub fn percentile<T: Copy>(sorted: &[T], p: f64) -> Option<T> {
    let at = (p * sorted.len() as f64).ceil() as usize;
    sorted.get(at.saturating_sub(1)).copied()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::RandomStream;

    /// Lists of every length up to 40 with ties, negative zeros and NaN among them.
    fn lists() -> impl Iterator<Item = Vec<f64>> {
        (0..40u64).map(|n| {
            (0..n)
                .map(|k| match RandomStream::new(5, &[n, k]).normal_pair()[0] {
                    v if v > 1.5 => f64::NAN,
                    v if v < -1.5 => -0.0,
                    v => (4.0 * v).round() / 4.0,
                })
                .collect()
        })
    }

    /// How many of the values are smaller than `v`, and how many are not larger, counted one by one.
    fn counts(values: &[f64], v: f64) -> [usize; 2] {
        [Ordering::is_lt as fn(Ordering) -> bool, Ordering::is_le]
            .map(|holds| values.iter().filter(|x| holds(x.total_cmp(&v))).count())
    }

    fn holds_place(values: &[f64], found: Option<f64>, place: usize) {
        match found {
            None => assert!(values.is_empty()),
            Some(v) => {
                let [below, up_to] = counts(values, v);
                assert!(below <= place && place < up_to, "{v} is not at place {place} of {values:?}");
            }
        }
    }

    #[test]
    fn order_statistics_are_at_their_places_in_the_sorted_list() {
        for values in lists() {
            let n = values.len();
            holds_place(&values, median(&mut values.clone()), n / 2);
            holds_place(&values, median_of(values.iter().copied()), n / 2);
            for (parts, of) in [(0, 1), (1, 4), (1, 2), (9, 10), (99, 100), (1, 1)] {
                let place = (parts * n / of).min(n.saturating_sub(1));
                holds_place(&values, upper_quantile(&mut values.clone(), parts, of), place);
            }
            let mut sorted = values.clone();
            sorted.sort_by(f64::total_cmp);
            for share in [0.0, 0.001, 0.25, 0.5, 0.75, 0.99, 1.0] {
                let between = share * n.saturating_sub(1) as f64;
                holds_place(&values, lower_quantile(&mut values.clone(), share), between.floor() as usize);
                // An exact half is rounded up.
                holds_place(&values, quantile(&mut values.clone(), share), (between + 0.5).floor() as usize);
                let enough = (1..=n).find(|k| *k as f64 >= share * n as f64).map(|k| sorted[k - 1]);
                assert_eq!(percentile(&sorted, share).map(f64::to_bits), enough.map(f64::to_bits), "{share} of {n}");
            }
        }
    }

    #[test]
    fn single_precision_has_the_same_order() {
        for values in lists() {
            let singles: Vec<f32> = values.iter().map(|v| *v as f32).collect();
            let found = median_of(singles).map(|v| f64::from(v).to_bits());
            assert_eq!(found, median_of(values).map(f64::to_bits));
        }
    }

    #[test]
    fn the_scatter_of_normal_values_is_their_deviation() {
        let normal = (0..20_000u64).flat_map(|k| RandomStream::new(6, &[k]).normal_pair());
        let mut values: Vec<f64> = normal.map(|x| 3.0 + 0.2 * x).collect();
        let (middle, scatter) = spread(&values).unwrap();
        assert!((middle - 3.0).abs() < 0.01 && (scatter / 0.2 - 1.0).abs() < 0.02, "{middle} {scatter}");
        // A fifth of wild values moves it by less than the share of them.
        values.iter_mut().step_by(5).for_each(|v| *v = 1e9);
        let (middle, scatter) = spread(&values).unwrap();
        assert!((middle - 3.0).abs() < 0.1 && scatter < 0.3, "{middle} {scatter}");
        assert_eq!(spread(&[]), None);
        assert!((NORMAL_SCATTER * NORMAL_MEDIAN - 1.0).abs() < 1e-5);
    }
}
