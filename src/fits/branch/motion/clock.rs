//! Times as loggers write them: seconds, times of day, and dates with times.

/// Seconds in a day.
pub const DAY: f64 = 86_400.0;

/// What a column of times holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TimeStamp {
    /// A number, in the unit of its column.
    Number(f64),
    /// Seconds since midnight: `12:03:05.25` or `03:05.25`.
    OfDay(f64),
    /// Days since 1970 and seconds: `2026-05-01T12:03:05.250Z`, also with a blank, and with an offset from UTC. Apart,
    /// because together they would lose the digits of milliseconds.
    Dated(f64, f64),
}

impl TimeStamp {
    /// Seconds after another stamp of the same form; a number's unit is `unit` seconds.
    pub fn after(&self, first: &TimeStamp, unit: f64) -> f64 {
        match (self, first) {
            (TimeStamp::Number(t), TimeStamp::Number(first)) => (t - first) * unit,
            (TimeStamp::OfDay(t), TimeStamp::OfDay(first)) => t - first,
            (TimeStamp::Dated(day, t), TimeStamp::Dated(first_day, first)) => (day - first_day) * DAY + (t - first),
            _ => f64::NAN,
        }
    }
}

/// Reads a time; `None` where it is none.
pub fn parse(text: &str) -> Option<TimeStamp> {
    let text = text.trim();
    if let Ok(number) = text.parse::<f64>() {
        return number.is_finite().then_some(TimeStamp::Number(number));
    }
    let Some(at) = text.find(['T', 't', ' ']) else { return of_day(text).map(TimeStamp::OfDay) };
    let (date, time) = (&text[..at], text[at + 1..].trim());
    let (time, offset) = zone(time)?;
    Some(TimeStamp::Dated(days(date)?, of_day(time)? - offset))
}

/// Seconds of `h:m:s` or `m:s`, with a point or comma before the fraction.
fn of_day(text: &str) -> Option<f64> {
    let text = text.replace(',', ".");
    let parts: Vec<&str> = text.split(':').collect();
    let (hours, minutes, seconds) = match parts[..] {
        [h, m, s] => (whole(h)?, whole(m)?, s),
        [m, s] => (0.0, whole(m)?, s),
        _ => return None,
    };
    if !seconds.starts_with(|c: char| c.is_ascii_digit()) {
        return None;
    }
    let seconds: f64 = seconds.parse().ok()?;
    (minutes < 60.0 && (0.0..61.0).contains(&seconds)).then_some(hours * 3600.0 + minutes * 60.0 + seconds)
}

fn whole(text: &str) -> Option<f64> {
    let digits = !text.is_empty() && text.len() <= 6 && text.bytes().all(|b| b.is_ascii_digit());
    digits.then(|| text.parse().ok()).flatten()
}

/// The time of day, and its offset from UTC (s).
fn zone(time: &str) -> Option<(&str, f64)> {
    if let Some(time) = time.strip_suffix(['Z', 'z']) {
        return Some((time.trim_end(), 0.0));
    }
    let Some(at) = time.rfind(['+', '-']) else { return Some((time, 0.0)) };
    let sign = if time[at..].starts_with('-') { -1.0 } else { 1.0 };
    let digits = time[at + 1..].replace(':', "");
    let (hours, minutes) = (whole(digits.get(..2)?)?, digits.get(2..).filter(|m| !m.is_empty()));
    let minutes = minutes.map_or(Some(0.0), whole)?;
    Some((time[..at].trim_end(), sign * (hours * 3600.0 + minutes * 60.0)))
}

/// Days since 1970 of `y-m-d`, also with slashes (H. Hinnant, "chrono-compatible low-level date algorithms").
fn days(date: &str) -> Option<f64> {
    let parts: Vec<f64> = date.split(['-', '/', '.']).map(whole).collect::<Option<_>>()?;
    let [mut year, month, day] = parts[..] else { return None };
    if !(year >= 1000.0 && (1.0..=12.0).contains(&month) && (1.0..=31.0).contains(&day)) {
        return None;
    }
    if month <= 2.0 {
        year -= 1.0;
    }
    let era = (year / 400.0).floor();
    let of_era = year - era * 400.0;
    let of_year = ((153.0 * ((month + 9.0) % 12.0) + 2.0) / 5.0).floor() + day - 1.0;
    Some(era * 146_097.0 + of_era * 365.0 + (of_era / 4.0).floor() - (of_era / 100.0).floor() + of_year - 719_468.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_of_loggers_are_read() {
        assert_eq!(parse(" 1.25 "), Some(TimeStamp::Number(1.25)));
        assert_eq!(parse("12:03:05.25"), Some(TimeStamp::OfDay(43_385.25)));
        assert_eq!(parse("03:05,5"), Some(TimeStamp::OfDay(185.5)));
        // 2026-05-01 is 20,574 days after 1970-01-01: 56 years with 14 leap days, and 120 days.
        let (date, noon) = (56.0 * 365.0 + 14.0 + 120.0, 12.0 * 3600.0);
        for text in ["2026-05-01T12:03:05.250Z", "2026-05-01 14:03:05.250+02:00", "2026/05/01 12:03:05.25"] {
            assert_eq!(parse(text), Some(TimeStamp::Dated(date, noon + 185.25)), "{text}");
        }
        assert_eq!(parse("2026-05-01T02:03:05.25-1000"), Some(TimeStamp::Dated(date, noon + 185.25)));
        for text in ["", "12", "noon", "12:61:00", "1:2:3:4", "2026-13-01T00:00:00", "2026-05-01T", "::", "-1:00"] {
            assert!(!matches!(parse(text), Some(TimeStamp::OfDay(_) | TimeStamp::Dated(..))), "{text}");
        }
    }
}
