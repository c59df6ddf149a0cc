//! The scale of the front's picture: two stated marks of a ruler, and the ticks between them.
//!
//! The two marks say which ticks lie between them; no picture tells millimetres from sixteenths of an inch, or one
//! ruler from another object with stripes. Their places are only known to a pixel, though. The ticks between them give
//! the period to a small share of that: it is where the Fourier transform of the brightness along the line is largest,
//! near the frequency that the marks say. Where no such period stands out, the marks alone give the scale.

use super::manifest::Ruler;
use super::picture::LinearPhotograph;
use mesophyll_base::statistics::median_of;
use std::f64::consts::PI;

/// How many times the power beside it a period must have.
const STANDS_OUT: f64 = 10.0;
/// Rows beside the line over which the brightness is averaged.
const ROWS: i32 = 2;
/// Relative error of a length that ticks are printed and pictures are projected with.
const PRINTED: f64 = 1e-3;

/// The scale of a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PictureScale {
    /// Size of a pixel (mm).
    pub pixel_mm: f64,
    /// Its relative standard error.
    pub relative_err: f64,
    /// Whether the ticks were seen; otherwise the marks alone give the scale.
    pub by_ticks: bool,
}

/// The scale that `ruler` gives in `picture`.
pub fn scale(picture: &LinearPhotograph, ruler: &Ruler) -> PictureScale {
    let [a, b] = ruler.marks_px;
    let length = (b[0] - a[0]).hypot(b[1] - a[1]);
    let marks_err = std::f64::consts::SQRT_2 * ruler.err_px / length;
    let marks =
        PictureScale { pixel_mm: ruler.length_mm / length, relative_err: marks_err.hypot(PRINTED), by_ticks: false };
    let Some(tick_mm) = ruler.tick_mm else { return marks };
    let along = [(b[0] - a[0]) / length, (b[1] - a[1]) / length];
    let n = length.ceil() as usize;
    let values: Vec<f64> = (0..n)
        .map(|k| {
            let at = |row: i32| {
                let (s, t) = (length * k as f64 / n as f64, f64::from(row));
                let v = picture.at([a[0] + s * along[0] - t * along[1], a[1] + s * along[1] + t * along[0]]);
                v.iter().sum::<f64>()
            };
            (-ROWS..=ROWS).map(at).sum()
        })
        .collect();
    if values.iter().any(|v| !v.is_finite()) {
        return marks;
    }
    // A Hann window; what is even along the ruler is subtracted first.
    let window = |k: usize| 0.5 - 0.5 * (2.0 * PI * (k as f64 + 0.5) / n as f64).cos();
    let mean = values.iter().enumerate().map(|(k, v)| v * window(k)).sum::<f64>() / (0.5 * n as f64);
    // Power at `cycles` over the whole line.
    let power = |cycles: f64| {
        let (mut re, mut im) = (0.0, 0.0);
        for (k, v) in values.iter().enumerate() {
            let (sin, cos) = (2.0 * PI * cycles * k as f64 / n as f64).sin_cos();
            let v = (v - mean) * window(k);
            (re, im) = (re + v * cos, im + v * sin);
        }
        re * re + im * im
    };
    let stated = ruler.length_mm / tick_mm;
    // Two samples a period at least, with some distance; and enough periods to tell them from a slope.
    if stated < 8.0 || stated > 0.45 * length {
        return marks;
    }
    let reach = (3.0 * marks_err * stated).clamp(0.5, 0.2 * stated);
    const STEP: f64 = 0.05;
    let steps = (reach / STEP).ceil() as i32;
    let best = (-steps..=steps)
        .map(|s| stated + STEP * f64::from(s))
        .map(|c| (c, power(c)))
        .fold((stated, 0.0), |best, now| if now.1 > best.1 { now } else { best });
    let beside = (3..12).flat_map(|s| [-1.0, 1.0].map(|d| power(best.0 + d * f64::from(s))));
    let beside = median_of(beside).unwrap_or(f64::NAN);
    if (best.0 - stated).abs() > reach - STEP || best.1 < STANDS_OUT * beside {
        return marks;
    }
    let [l, m, r] = [-STEP, 0.0, STEP].map(|d| power(best.0 + d));
    let cycles = best.0 + 0.5 * STEP * (l - r) / (l - 2.0 * m + r).min(-f64::MIN_POSITIVE);
    // Standard error of a frequency from the signal-to-noise ratio at its peak (Rife & Boorstyn 1974), in cycles over
    // the line; the power beside the peak is the noise.
    let noise = (beside / best.1).sqrt();
    let err = 3f64.sqrt() / PI * noise / cycles;
    PictureScale { pixel_mm: cycles * tick_mm / length, relative_err: err.hypot(PRINTED), by_ticks: true }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesophyll_base::image::ImageSize;
    use mesophyll_base::rgb::Rgb;

    /// Ticks 7.31 pixels apart along a slanted line, under noise. The marks are clicked up to a pixel and a half off;
    /// the ticks give the scale to the printed accuracy. Without ticks the marks give it, at their own error.
    #[test]
    fn ticks_refine_what_the_marks_say() {
        let (width, height) = (420, 60);
        let along = [0.998_f64, 0.0632];
        let drawn = |ticks: bool| {
            let mut state = 1u64;
            let pixel = |k: usize| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                let noise = 0.1 * ((state >> 40) as f64 / (1u64 << 24) as f64 - 0.5);
                let [x, y] = ImageSize::new(width, height).middle(k);
                let phase = (x * along[0] + y * along[1]) / 7.31;
                let dark = if ticks && phase - phase.floor() < 0.3 { 0.5 } else { 0.0 };
                Rgb::splat((0.8 - dark + noise) as f32)
            };
            let pixels = (0..width * height).map(pixel).collect();
            LinearPhotograph { path: "ruler.exr".into(), width, height, pixels, highest: (0.85, 1), steps: None }
        };
        let place = |s: f64, off: f64| [20.0 + (s + off) * along[0], 15.0 + (s + off) * along[1]];
        let marks_px = [place(0.0, -1.2), place(50.0 * 7.31, 1.5)];
        let ruler = Ruler { marks_px, length_mm: 50.0, tick_mm: Some(1.0), err_px: 1.0 };
        let (fine, coarse) = (scale(&drawn(true), &ruler), scale(&drawn(false), &ruler));
        assert!(fine.by_ticks && !coarse.by_ticks, "{fine:?} {coarse:?}");
        assert!((fine.pixel_mm * 7.31 - 1.0).abs() < 3.0 * fine.relative_err, "{fine:?}");
        assert!(fine.relative_err < 0.5 * coarse.relative_err, "{fine:?} {coarse:?}");
        assert!((coarse.pixel_mm * 7.31 - 1.0).abs() < 3.0 * coarse.relative_err, "{coarse:?}");
    }
}
