//! A map as run lengths, which is the source's code: a value, and the number of consecutive receivers that have it.

use std::iter;

/// The values, with the number of times (at least 1) that each occurs in a row.
pub(super) fn runs(map: &[u8]) -> impl Iterator<Item = (u8, usize)> + '_ {
    let mut rest = map;
    iter::from_fn(move || {
        let value = *rest.first()?;
        let count = rest.iter().position(|v| *v != value).unwrap_or(rest.len());
        rest = &rest[count..];
        Some((value, count))
    })
}

/// Codes run lengths. Each run has its value and then its length less one, in groups of seven bits, the lowest first.
/// The eighth bit of a byte means that more follow.
pub fn encode(map: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    for (value, count) in runs(map) {
        out.push(value);
        let mut left = count - 1;
        while left > 127 {
            out.push(left as u8 | 128);
            left >>= 7;
        }
        out.push(left as u8);
    }
    out
}

/// Decodes the bytes of [`encode`] into `map`, whose length must fit. The error says what is wrong with the bytes.
pub fn decode(coded: &[u8], map: &mut [u8]) -> Result<(), String> {
    let mut at = 0;
    for run in parse(coded) {
        let (value, count) = run?;
        let end = at + count;
        map.get_mut(at..end).ok_or("the runs are longer than the map")?.fill(value);
        at = end;
    }
    if at == map.len() { Ok(()) } else { Err(format!("{at} values, expected {}", map.len())) }
}

/// The runs in the bytes of [`encode`]. Each is at most 2³⁵ long, for any bytes.
pub(super) fn parse(coded: &[u8]) -> impl Iterator<Item = Result<(u8, usize), String>> + '_ {
    let mut rest = coded.iter().copied();
    iter::from_fn(move || {
        let value = rest.next()?;
        let mut left = 0;
        for shift in [0, 7, 14, 21, 28] {
            let Some(byte) = rest.next() else { return Some(Err("the last run is cut off".into())) };
            left |= usize::from(byte & 127) << shift;
            if byte < 128 {
                return Some(Ok((value, left + 1)));
            }
        }
        Some(Err("a run without an end".into()))
    })
}
