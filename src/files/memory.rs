//! How much memory there is. Work that does not fit is refused before it begins.

use crate::{Error, Result};
use std::fs::read_to_string;

/// Bytes that this program can still get, without swapping: what the machine has free, what the program's own limit
/// leaves (`ulimit -v`), or what a container's limit leaves, whichever is least. `None` where the system does not say
/// (only Linux does).
pub fn available() -> Option<u64> {
    let free = kibibytes(&read_to_string("/proc/meminfo").ok()?, "MemAvailable:")?;
    let of_container = |name: &str| read_to_string(format!("/sys/fs/cgroup/memory.{name}")).ok();
    let number = |name: &str| of_container(name)?.trim().parse::<u64>().ok();
    let container = number("max").zip(number("current")).map(|(most, used)| {
        // What is in use holds copies of files too, which give way.
        let stat = of_container("stat").unwrap_or_default();
        let file = stat.lines().find_map(|l| l.strip_prefix("file ")?.trim().parse::<u64>().ok()).unwrap_or(0);
        most.saturating_sub(used.saturating_sub(file))
    });
    [left_of_limit(), container].into_iter().flatten().chain([free]).min()
}

/// A number of KiB in a text of the system, in bytes.
fn kibibytes(text: &str, name: &str) -> Option<u64> {
    let line = text.lines().find_map(|l| l.strip_prefix(name))?;
    Some(line.split_whitespace().next()?.parse::<u64>().ok()? * 1024)
}

/// What the program's own limit leaves of its address space (bytes), where there is one.
pub fn left_of_limit() -> Option<u64> {
    let used = kibibytes(&read_to_string("/proc/self/status").ok()?, "VmSize:")?;
    Some(limit()?.saturating_sub(used))
}

/// The limit of the program's address space in bytes (`ulimit -v`), where there is one.
pub fn limit() -> Option<u64> {
    let text = read_to_string("/proc/self/limits").ok()?;
    text.lines().find_map(|l| l.strip_prefix("Max address space"))?.split_whitespace().next()?.parse().ok()
}

/// What the limit of the address space has to do with something that failed: a sentence's end, or nothing where there
/// is no limit, or one of more than 4 GiB.
pub fn hint() -> String {
    let small = limit().filter(|bytes| *bytes < 1 << 32);
    small.map_or_else(String::new, |bytes| {
        format!("; the limit of memory for this program is {} MiB (ulimit -v), which may be the cause", bytes >> 20)
    })
}

/// Refuses work that needs more memory than there is.
///
/// # Errors
/// [`Error::Usage`] that says what needs how much, and how much there is.
pub fn require(bytes: u64, what: &str) -> Result<()> {
    match available() {
        Some(there) if bytes > there => {
            let size = |b: u64| match b as f64 / (1u64 << 30) as f64 {
                gib if gib >= 1.0 => format!("{gib:.1} GiB"),
                gib => format!("{:.0} MiB", 1024.0 * gib),
            };
            Err(Error::Usage(format!("{what} needs about {} of memory; {} are available", size(bytes), size(there))))
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
