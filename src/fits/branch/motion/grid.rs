//! Even times behind times as they are written: rounded, with readings dropped, or only roughly even.

use mesophyll_base::statistics::median_of;

/// Where readings stand on a grid of even times.
#[derive(Debug, Clone, PartialEq)]
pub struct TimeGrid {
    /// Time between neighbours (s).
    pub step: f64,
    /// Place of each reading, rising; `None` where its time repeats or goes back.
    pub places: Vec<Option<usize>>,
    /// The reading that is furthest from its place, and by how much (s), beyond what rounding explains.
    pub worst: (usize, f64),
    /// How many readings are further from their places than evenness allows.
    pub uneven: usize,
    /// Sum of the squared distances from the places (s²); a reading without a place counts a step.
    pub misfit: f64,
}

/// Times may deviate from even spacing by this share of the step.
const EVEN: f64 = 0.05;
/// Times are exact where all distances are whole numbers of steps to this share, ...
const EXACT: f64 = 0.02;
/// ... and at most this share of the times is missing: coarsely rounded times may look so, too.
const GAPS: f64 = 0.05;
/// How far the expected time of the next reading follows each reading: clocks drift slowly.
const FOLLOW: f64 = 0.1;
/// After a gap of more steps than this, the next reading sets the time anew.
const PAUSE: f64 = 4.0;
/// Numbers of steps over which the step is measured.
const SPANS: [usize; 5] = [1, 2, 8, 32, 128];

/// Finds the grid of `times` (s), which are written in steps of `resolution` (s), with a stated time between readings
/// or without.
///
/// # Errors
/// A sentence that says why there is none.
pub fn find(times: &[f64], resolution: f64, step: Option<f64>) -> Result<TimeGrid, String> {
    if let Some(step) = step {
        return Ok(place(times, resolution, step));
    }
    let n = times.len();
    let median =
        |span: usize| median_of(times.windows(span + 1).map(|w| (w[span] - w[0]) / span as f64)).unwrap_or(0.0);
    let usual = median(1);
    let refined = |step: f64, resolution: f64| {
        let mut grid = place(times, resolution, step);
        for _ in 0..3 {
            let pairs = grid.places.iter().zip(times).filter_map(|(p, t)| p.map(|p| (p as f64, *t)));
            let (_, slope) = regression(pairs);
            if slope > 0.0 && (slope / grid.step - 1.0).abs() < 0.5 {
                grid = place(times, resolution, slope);
            }
        }
        grid
    };
    // Times that are written exactly, with or without gaps.
    let steps: Vec<f64> = times.windows(2).map(|w| (w[1] - w[0]) / usual).collect();
    let exact = usual > 0.0 && steps.iter().all(|s| s.round() >= 1.0 && (s - s.round()).abs() < EXACT);
    if exact && steps.iter().map(|s| s.round() - 1.0).sum::<f64>() <= GAPS * n as f64 {
        return Ok(refined(usual, 0.0));
    }
    // Even times without a gap: the mean step, and nothing off by more than rounding.
    let even = regression(times.iter().enumerate().map(|(k, t)| (k as f64, *t)));
    if even.1 > 0.0 {
        let off = |(k, t): (usize, &f64)| (t - even.0 - k as f64 * even.1).abs();
        let allowed = 0.55 * resolution + EVEN * even.1;
        if times.iter().enumerate().map(off).all(|d| d <= allowed) {
            let places = (0..n).map(Some).collect();
            return Ok(TimeGrid { step: even.1, places, worst: (0, 0.0), uneven: 0, misfit: 0.0 });
        }
    }
    if !(usual > 0.0) {
        return Err("most times repeat the one before or go back; --rate HZ states how often the branch was read, \
                    where the times are written too coarsely"
            .into());
    }
    let near: Vec<f64> = times.windows(2).map(|w| w[1] - w[0]).filter(|d| (0.5..1.5).contains(&(d / usual))).collect();
    let mut steps = vec![near.iter().sum::<f64>() / near.len() as f64];
    steps.extend(SPANS.iter().filter(|s| 4 * **s < n).map(|s| median(*s)));
    // Of steps that place the readings equally well, the one with the fewest gaps.
    let last = |g: &TimeGrid| g.places.iter().rev().find_map(|p| *p).unwrap_or(0);
    let placed: Vec<TimeGrid> = steps.into_iter().map(|step| refined(step, resolution)).collect();
    let least = placed.iter().map(|g| g.misfit).fold(f64::INFINITY, f64::min);
    let near = 1.2 * least + 1e-6 * usual * usual * n as f64;
    let good = placed.into_iter().filter(|g| g.misfit <= near);
    good.min_by_key(last).ok_or_else(|| "found no even steps".into())
}

/// Intercept and slope of the line through pairs.
fn regression(pairs: impl Iterator<Item = (f64, f64)> + Clone) -> (f64, f64) {
    let (mut count, mut x, mut y) = (0.0, 0.0, 0.0);
    for (a, b) in pairs.clone() {
        (count, x, y) = (count + 1.0, x + a, y + b);
    }
    let (x, y) = (x / count, y / count);
    let (mut xx, mut xy) = (0.0, 0.0);
    for (a, b) in pairs {
        xx += (a - x) * (a - x);
        xy += (a - x) * (b - y);
    }
    let slope = xy / xx;
    (y - slope * x, slope)
}

/// Places readings that are `step` apart or some steps more.
fn place(times: &[f64], resolution: f64, step: f64) -> TimeGrid {
    let mut out = TimeGrid { step, places: Vec::with_capacity(times.len()), worst: (0, 0.0), uneven: 0, misfit: 0.0 };
    // Where times are written more coarsely than readings follow one another, only their order tells.
    let near = if resolution > 1.5 * step { resolution } else { 0.5 * step };
    let follow = FOLLOW * (step / (2.0 * resolution)).min(1.0);
    let mut at: Option<(usize, f64)> = None;
    for (k, t) in times.iter().enumerate() {
        let Some((place, expected)) = &mut at else {
            at = Some((0, *t));
            out.places.push(Some(0));
            continue;
        };
        let steps = if (t - *expected - step).abs() <= near { 1.0 } else { ((t - *expected) / step).round() };
        if !(steps >= 1.0 && *place as f64 + steps < 1e15) {
            out.places.push(None);
            out.misfit += step * step;
            continue;
        }
        let off = t - *expected - steps * step;
        *place += steps as usize;
        *expected += steps * step + off * if steps > PAUSE { 1.0 } else { follow };
        out.misfit += off * off;
        let beyond = off.abs() - 1.1 * resolution;
        if beyond > EVEN * step && steps <= PAUSE {
            out.uneven += 1;
        }
        if beyond > out.worst.1 {
            out.worst = (k, beyond);
        }
        out.places.push(Some(*place));
    }
    out
}
