//! Numbers as text: as many digits as the error supports, a true minus sign, and never `0 %` for something that is not
//! zero.

const MINUS: char = '\u{2212}';

/// `digits` significant digits. Very large and very small values are written like `1.2 × 10⁻⁵`, values that are not
/// finite in words.
pub fn significant(value: f64, digits: usize) -> String {
    if value.is_nan() {
        return "none".into();
    }
    if value.is_infinite() {
        return if value > 0.0 { "∞".into() } else { format!("{MINUS}∞") };
    }
    if value == 0.0 {
        return "0".into();
    }
    let exponent = rounded_exponent(value, digits);
    if !(-4..6).contains(&exponent) {
        return scientific(value, digits);
    }
    let decimals = (digits as i32 - 1 - exponent).max(0) as usize;
    sign(format!("{value:.decimals$}"))
}

/// Four significant digits without trailing zeros; whole numbers stay whole.
pub fn plain(value: f64) -> String {
    if value.fract() == 0.0 && value.abs() < 1e6 {
        return sign(format!("{value:.0}"));
    }
    let text = significant(value, 4);
    let (head, tail) = text.split_once(" × ").map_or((text.as_str(), ""), |(h, t)| (h, t));
    let head = if head.contains('.') { head.trim_end_matches('0').trim_end_matches('.') } else { head };
    if tail.is_empty() { head.to_string() } else { format!("{head} × {tail}") }
}

/// Decimal exponent of `value` after rounding to `digits` significant digits (9.996 to three digits is 10.0: exponent
/// 1).
fn rounded_exponent(value: f64, digits: usize) -> i32 {
    let text = format!("{:.*e}", digits.saturating_sub(1), value);
    text.rsplit('e').next().and_then(|e| e.parse().ok()).unwrap_or(0)
}

fn scientific(value: f64, digits: usize) -> String {
    let text = format!("{:.*e}", digits.saturating_sub(1), value);
    let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    sign(format!("{mantissa} × 10{}", superscript(exponent)))
}

/// Digits as superscripts.
pub(crate) fn superscript(text: &str) -> String {
    const DIGITS: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    text.chars().map(|c| if c == '-' { '⁻' } else { c.to_digit(10).map_or(c, |d| DIGITS[d as usize]) }).collect()
}

fn sign(text: String) -> String {
    text.replacen('-', &MINUS.to_string(), 1)
}

/// `0.412 ± 0.013`: the error with two digits, the value to the same decimal place. A missing or infinite error is
/// described in words.
pub fn plus_minus(value: f64, error: f64) -> String {
    if !value.is_finite() {
        return "not determined".into();
    }
    if !error.is_finite() {
        return format!("{} (error unbounded)", plain(value));
    }
    if error <= 0.0 {
        return format!("{} (no error given)", plain(value));
    }
    let place = 1 - rounded_exponent(error, 2);
    let largest = if value == 0.0 { 0 } else { value.abs().log10().floor() as i32 };
    if (0..=9).contains(&place) && largest < 7 {
        let decimals = place as usize;
        return sign(format!("{value:.decimals$} ± {error:.decimals$}"));
    }
    if (-5..0).contains(&place) && largest < 7 {
        let unit = 10f64.powi(-place);
        return sign(format!("{:.0} ± {:.0}", (value / unit).round() * unit, (error / unit).round() * unit));
    }
    let digits = (place + largest + 1).clamp(2, 9) as usize;
    format!("{} ± {}", significant(value, digits), significant(error, 2))
}

/// A share as a percentage: two significant digits, `100 %` and `0 %` only where exact.
pub fn percent(share: f64) -> String {
    if !share.is_finite() {
        return "unknown".into();
    }
    let p = share * 100.0;
    if p == 0.0 {
        return "0 %".into();
    }
    if (99.0..100.0).contains(&p) {
        // 99.98 % must not be written as 100 %.
        let lacking = 100.0 - p;
        if lacking < 0.001 {
            return "> 99.999 %".into();
        }
        let decimals = (-lacking.log10().floor()).max(1.0) as usize;
        return format!("{p:.decimals$} %");
    }
    format!("{} %", significant(p, if p.abs() >= 10.0 { 3 } else { 2 }))
}

/// Seconds as `3 min 20 s`, `4.1 s`, `27 ms`, `310 µs`.
pub fn duration(seconds: f64) -> String {
    if !seconds.is_finite() || seconds < 0.0 {
        return "unknown".into();
    }
    match seconds {
        s if s >= 3600.0 => format!("{} h {:02} min", (s / 3600.0) as u64, (s % 3600.0 / 60.0) as u64),
        s if s >= 60.0 => format!("{} min {:02} s", (s / 60.0) as u64, (s % 60.0) as u64),
        s if s >= 1.0 => format!("{} s", significant(s, 3)),
        s if s >= 1e-3 => format!("{} ms", significant(s * 1e3, 3)),
        0.0 => "0 s".into(),
        s => format!("{} µs", significant(s * 1e6, 3)),
    }
}

/// `12 345` with thin spaces.
pub fn count(n: usize) -> String {
    let digits = n.to_string();
    let mut out = String::new();
    for (k, c) in digits.chars().enumerate() {
        if k > 0 && (digits.len() - k).is_multiple_of(3) {
            out.push('\u{202f}');
        }
        out.push(c);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_set_the_digits() {
        assert_eq!(plus_minus(0.41234, 0.0129), "0.412 ± 0.013");
        assert_eq!(plus_minus(-10.2, 0.0996), "−10.20 ± 0.10");
        assert_eq!(plus_minus(1234.5, 78.0), "1234 ± 78");
        assert_eq!((plain(118.0), plain(0.0041), plain(-2.5)), ("118".into(), "0.0041".into(), "−2.5".into()));
        assert_eq!(plus_minus(1.5, f64::INFINITY), "1.5 (error unbounded)");
        assert_eq!(plus_minus(f64::NAN, 1.0), "not determined");
        assert_eq!(plus_minus(123456.0, 1234.0), "123500 ± 1200");
    }

    #[test]
    fn nothing_rounds_to_nothing_or_to_everything() {
        assert_eq!(percent(0.0), "0 %");
        assert_eq!(percent(1.0), "100 %");
        assert_eq!(percent(0.99983), "99.98 %");
        assert_eq!(percent(0.000012), "0.0012 %");
        assert_eq!(percent(0.9999999), "> 99.999 %");
        assert_eq!(percent(0.957), "95.7 %");
        assert_eq!(percent(-0.034), "−3.4 %");
    }

    #[test]
    fn scales_read_well() {
        assert_eq!(plain(0.0000123), "1.23 × 10⁻⁵");
        assert_eq!(significant(9.996, 3), "10.0");
        assert_eq!(duration(200.0), "3 min 20 s");
        assert_eq!(duration(0.00031), "310 µs");
        assert_eq!(count(1234567), "1\u{202f}234\u{202f}567");
    }
}
