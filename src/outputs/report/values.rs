//! The values of a map that the page shows under the pointer: decimal numbers with a few significant digits, packed
//! into text.
//!
//! A value is a sign, a decade and a mantissa of a few digits. All three become one whole number that grows with
//! the value: 0 is a code for 0, 1 is the smallest mantissa of the lowest decade that occurs, and the negative numbers
//! are the same below 0. Neighbours in a map are alike, so differences along rows are stored: first the lowest byte of
//! all of them, then the next one, and the last. Deflate and base64 make it text. `page.js` reads it.

use crate::colour::base64;
use flate2::{Compression, write::ZlibEncoder};
use serde::Serialize;
use std::io::Write;

/// Stands for a texel without a value. No value has this code: it would take 900 decades.
const NONE: i64 = -(1 << 23);

/// The values of a map.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MapValues {
    /// Unit of the values; empty for a plain number.
    pub unit: String,
    /// Columns and rows that are kept.
    pub columns: usize,
    pub rows: usize,
    /// Texels from one kept column or row to the next.
    pub stride: usize,
    /// Significant digits.
    pub digits: u32,
    /// Power of ten of the lowest decade.
    pub lowest: i32,
    /// Values at the ends of the colour scale, and whether it has zero in its middle.
    pub range: [f64; 2],
    pub signed: bool,
    /// The packed numbers.
    pub packed: String,
}

/// Packs every `stride`-th value of a map of `width` × `height` texels. `value(i)` is that of texel `i`, row by row;
/// what is not finite counts as no value. `None` where there is no value at all.
pub fn pack(
    (width, height): (usize, usize),
    (stride, digits): (usize, u32),
    unit: &str,
    value: impl Fn(usize) -> f32,
) -> Option<MapValues> {
    let stride = stride.max(1);
    let (columns, rows) = (width.div_ceil(stride), height.div_ceil(stride));
    let kept = (0..columns * rows).map(|k| value(k / columns * stride * width + k % columns * stride));
    let split: Vec<Option<(i32, i64)>> = kept.map(|v| v.is_finite().then(|| decimal(f64::from(v), digits))).collect();
    let lowest = split.iter().flatten().filter(|d| d.1 != 0).map(|d| d.0).min();
    split.iter().flatten().next()?;
    let lowest = lowest.unwrap_or(0);
    let least = 10i64.pow(digits - 1);
    let code = |d: &Option<(i32, i64)>| match d {
        None => NONE,
        Some((_, 0)) => 0,
        Some((e, m)) => m.signum() * (1 + i64::from(e - lowest) * 9 * least + m.abs() - least),
    };
    let mut differences = Vec::with_capacity(split.len());
    let mut before = NONE;
    for d in &split {
        let now = code(d);
        let step = now - before;
        // 0, −1, 1, −2, … become 0, 1, 2, 3, ….
        differences.push(if step < 0 { -2 * step - 1 } else { 2 * step } as u32);
        before = now;
    }
    let bytes: Vec<u8> = (0..4).flat_map(|b| differences.iter().map(move |d| (d >> (8 * b)) as u8)).collect();
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(&bytes).ok()?;
    let packed = base64(&encoder.finish().ok()?);
    Some(MapValues {
        unit: unit.into(),
        columns,
        rows,
        stride,
        digits,
        lowest,
        range: [0.0, 1.0],
        signed: false,
        packed,
    })
}

/// The nearest number with `digits` significant digits, as its power of ten and its signed mantissa.
fn decimal(v: f64, digits: u32) -> (i32, i64) {
    if v == 0.0 {
        return (0, 0);
    }
    let exponent = v.abs().log10().floor() as i32;
    let most = 10i64.pow(digits);
    let mantissa = |e: i32| (v.abs() * 10f64.powi(digits as i32 - 1 - e)).round() as i64;
    // A logarithm beside a whole number may be rounded to either side of it, and a mantissa may be rounded up to the
    // next decade.
    let exponent = if mantissa(exponent) < most / 10 { exponent - 1 } else { exponent };
    let exponent = if mantissa(exponent) >= most { exponent + 1 } else { exponent };
    (exponent, if v < 0.0 { -mantissa(exponent) } else { mantissa(exponent) })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compared with the digits that the standard library prints.
    #[test]
    fn decimals_are_the_nearest_ones() {
        let mut state = 7u32;
        let mut random = move || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f32::from_bits(state)
        };
        let edges = [1.0, 9.9996, 999.96, 1e-5, 0.1, 1000.0, 1e-30, 3.4e38, 9.9995e-4];
        let all = edges.into_iter().chain((0..20_000).map(|_| random())).filter(|v: &f32| v.is_normal());
        for v in all.flat_map(|v| [v, -v]) {
            for digits in [2, 3, 4] {
                let (e, m) = decimal(f64::from(v), digits);
                let text = format!("{:.*e}", digits as usize - 1, v);
                let (mantissa, exponent) = text.split_once('e').unwrap();
                assert_eq!(mantissa.replace('.', "").parse::<i64>().unwrap(), m, "{v}: {text}");
                assert_eq!(exponent.parse::<i32>().unwrap(), e, "{v}: {text}");
            }
        }
    }

    #[test]
    fn every_second_texel_of_every_second_row_is_kept() {
        let all = pack((5, 3), (2, 3), "mm", |i| i as f32).unwrap();
        assert_eq!((all.columns, all.rows, all.stride, all.lowest), (3, 2, 2, 0));
        let few = [0.0, 2.0, 4.0, 10.0, 12.0, 14.0];
        assert_eq!(pack((3, 2), (1, 3), "mm", |i| few[i]).unwrap().packed, all.packed);
        assert_eq!(pack((5, 3), (1, 3), "", |_| f32::NAN), None);
    }
}
