//! What another model or another minimum is worth beside the one that was taken, where the readings leave it open.

/// A rival that is at least this many times as probable is left open by the readings: one chance in twenty, as a 95 %
/// interval leaves out.
pub const POSSIBLE: f64 = 0.05;
/// A rival that is this many times as probable is evidence against what was taken (H. Jeffreys, *Theory of
/// Probability*, appendix B: substantial).
pub const SUBSTANTIAL: f64 = 5.0;

/// How well a rival of these odds explains the readings, beside what was taken.
pub fn how_well(odds: f64) -> &'static str {
    match odds {
        odds if odds >= 100.0 => "far better",
        odds if odds > SUBSTANTIAL => "as well or better",
        odds if odds >= 1.0 / SUBSTANTIAL => "about as well",
        _ => "nearly as well",
    }
}
