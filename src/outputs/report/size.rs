//! How large a page may be, and what is shown more coarsely so that it stays below that.
//!
//! A page that is larger than [`LIMIT`] is made again with the next [`ReportDetail`] of [`DETAILS`]. What a reader
//! misses least goes first: the red and blue maps, which are folded away, then truths, differences and pictures that
//! stand beside others, then the maps of the fit, and the pictures of the check at last.

/// Largest page (bytes). Mail servers and issue trackers take files of this size.
pub const LIMIT: usize = 5_000_000;

/// How finely maps and pictures are shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReportDetail {
    /// Of the maps of the fit, every so-manyth texel of every so-manyth row is kept.
    pub fit: usize,
    /// The same for truths and differences.
    pub others: usize,
    /// The same for everything that is red or blue.
    pub colours: usize,
    /// Significant digits of these values.
    pub digits: u32,
    /// Largest width of the pictures that stand for maps where no script runs (pixels).
    pub thumb: usize,
    /// Pictures that a check drew and its references are averaged over squares of so many pixels a side.
    pub shots: usize,
    /// The same for the pictures that stand beside them, and for colours that are computed from maps.
    pub aside: usize,
}

/// From fine to coarse.
pub const DETAILS: [ReportDetail; 11] = [
    ReportDetail { fit: 1, others: 1, colours: 1, digits: 4, thumb: 120, shots: 1, aside: 1 },
    ReportDetail { fit: 1, others: 1, colours: 1, digits: 3, thumb: 80, shots: 1, aside: 1 },
    ReportDetail { fit: 1, others: 1, colours: 2, digits: 3, thumb: 48, shots: 1, aside: 2 },
    ReportDetail { fit: 1, others: 2, colours: 2, digits: 3, thumb: 48, shots: 1, aside: 2 },
    ReportDetail { fit: 1, others: 2, colours: 4, digits: 3, thumb: 40, shots: 1, aside: 2 },
    ReportDetail { fit: 1, others: 3, colours: 4, digits: 3, thumb: 40, shots: 1, aside: 3 },
    ReportDetail { fit: 2, others: 3, colours: 4, digits: 3, thumb: 40, shots: 1, aside: 3 },
    ReportDetail { fit: 2, others: 4, colours: 6, digits: 3, thumb: 40, shots: 2, aside: 3 },
    ReportDetail { fit: 3, others: 6, colours: 8, digits: 3, thumb: 32, shots: 2, aside: 4 },
    ReportDetail { fit: 5, others: 10, colours: 12, digits: 3, thumb: 24, shots: 4, aside: 8 },
    ReportDetail { fit: 10, others: 20, colours: 24, digits: 3, thumb: 16, shots: 8, aside: 16 },
];

/// The detail to try after a page of `bytes` at `level`; `None` where it is small enough, or where nothing is coarser.
/// A page that is much too large skips some.
pub fn next(level: usize, bytes: usize) -> Option<usize> {
    let skip = match bytes {
        b if b <= LIMIT => return None,
        b if b <= LIMIT + LIMIT / 2 => 1,
        b if b <= 4 * LIMIT => 2,
        _ => 4,
    };
    let next = (level + skip).min(DETAILS.len() - 1);
    (next > level).then_some(next)
}

impl ReportDetail {
    /// What the page leaves out, in words.
    pub fn words(&self) -> String {
        let digits = self.digits;
        let mut out = format!("Values have {digits} significant digits; the maps' files have all of them.");
        let list = |parts: &[(&str, usize)], say: &dyn Fn(usize) -> String| {
            let said: Vec<String> =
                parts.iter().filter(|p| p.1 > 1).map(|(what, step)| format!("{what} {}", say(*step))).collect();
            said.join(", ")
        };
        let maps =
            [("maps of the fit", self.fit), ("truths and differences", self.others), ("red and blue", self.colours)];
        let kept = list(&maps, &|step| format!("1 of {step}"));
        if !kept.is_empty() {
            out.push_str(&format!(" To stay small, this page keeps not every column and row of the maps: {kept}."));
        }
        let averaged =
            list(&[("pictures of the check", self.shots), ("others", self.aside)], &|s| format!("{s} × {s}"));
        if !averaged.is_empty() {
            out.push_str(&format!(" Pictures are averaged over squares of pixels: {averaged}."));
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn details_become_coarser_until_the_page_fits() {
        for pair in DETAILS.windows(2) {
            let of = |d: &ReportDetail| [d.fit, d.others, d.colours, d.shots, d.aside];
            assert!(of(&pair[0]).iter().zip(of(&pair[1])).all(|(a, b)| *a <= b), "{pair:?}");
            assert!(pair[0].digits >= pair[1].digits && pair[0].thumb >= pair[1].thumb && pair[0] != pair[1]);
            assert!(pair[1].fit <= pair[1].others && pair[1].others <= pair[1].colours, "{pair:?}");
        }
        assert_eq!((next(0, LIMIT), next(0, LIMIT + 1), next(0, 3 * LIMIT)), (None, Some(1), Some(2)));
        let last = DETAILS.len() - 1;
        assert_eq!((next(last - 1, 9 * LIMIT), next(last, 9 * LIMIT)), (Some(last), None));
        assert!(!DETAILS[0].words().contains("small") && DETAILS[5].words().contains("red and blue 1 of 4"));
    }
}
