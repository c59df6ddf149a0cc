//! The time that processors spent on this program.

/// Seconds of processor time of all threads so far. `None` where the system does not say (only Linux does).
pub fn seconds() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The name of the program, in brackets, may hold anything. After it come the state, and twelve fields on are the
    // ticks in the program and in the system, of which Linux shows a hundred a second.
    let (_, rest) = text.rsplit_once(')')?;
    let mut fields = rest.split_whitespace().skip(11);
    let mut ticks = || fields.next()?.parse::<f64>().ok();
    Some((ticks()? + ticks()?) / 100.0)
}

#[cfg(test)]
mod tests {
    #[test]
    fn work_takes_processor_time() {
        let Some(before) = super::seconds() else { return };
        let clock = std::time::Instant::now();
        let mut sum = 0u64;
        while clock.elapsed().as_secs_f64() < 0.3 {
            sum = sum.wrapping_mul(31).wrapping_add(1);
        }
        assert!(sum != 1);
        let spent = super::seconds().unwrap_or_default() - before;
        // Other threads of the tests may work meanwhile; a busy machine gives less.
        assert!(spent > 0.02 && spent < 0.3 * 256.0, "{spent}");
    }
}
