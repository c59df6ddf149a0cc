//! How much memory there is. Work that does not fit is refused before it begins.

use crate::{Error, Result};

/// Bytes that the machine can still give, without swapping; `None` where the system does not say (only Linux does).
pub fn available() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|l| l.strip_prefix("MemAvailable:"))?;
    let kibibytes: u64 = line.split_whitespace().next()?.parse().ok()?;
    Some(kibibytes * 1024)
}

/// Refuses work that needs more memory than there is.
///
/// # Errors
/// [`Error::Usage`] that says what needs how much, and how much there is.
pub fn require(bytes: u64, what: &str) -> Result<()> {
    match available() {
        Some(there) if bytes > there => {
            let gib = |b: u64| b as f64 / (1u64 << 30) as f64;
            Err(Error::Usage(format!(
                "{what} needs about {:.1} GiB of memory; {:.1} GiB are available",
                gib(bytes),
                gib(there)
            )))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_than_there_is_is_refused_with_both_numbers() {
        if available().is_none() {
            return crate::skips::skip(crate::skips::Need::System, "no /proc/meminfo");
        }
        assert!(require(1 << 20, "a picture").is_ok());
        let sentence = require(1 << 60, "a picture").unwrap_err().to_string();
        assert!(sentence.contains("a picture needs about 1073741824.0 GiB"), "{sentence}");
    }
}
