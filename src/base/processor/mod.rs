//! The instruction sets for which the program's inner loops are compiled, and which of them this processor has. A loop
//! that comes in several versions asks [`InstructionSet::detect`] and calls the version for the answer.

#![warn(missing_docs)]

use std::sync::LazyLock;

/// The environment variable that names the largest set to use, so that a program can be tested and timed as it runs on
/// a smaller processor.
pub const SWITCH: &str = "MESOPHYLL_INSTRUCTIONS";

/// Vector instructions of the processor. A later set includes the earlier ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum InstructionSet {
    /// The instructions that every processor of this architecture has.
    Plain,
    /// AVX2 with fused multiply–add (FMA) and bit manipulation (BMI1): vectors of 256 bits.
    Avx2,
    /// AVX-512 Foundation: vectors of 512 bits.
    Avx512,
}

impl InstructionSet {
    /// Every set, the smallest first.
    pub const ALL: [InstructionSet; 3] = [InstructionSet::Plain, InstructionSet::Avx2, InstructionSet::Avx512];

    /// Their names, for [`SWITCH`].
    pub const NAMES: [&str; 3] = ["plain", "avx2", "avx512"];

    /// The largest set that this processor has, or that [`SWITCH`] leaves of it.
    #[inline]
    pub fn detect() -> InstructionSet {
        static FOUND: LazyLock<InstructionSet> = LazyLock::new(|| {
            let all = InstructionSet::of_processor();
            InstructionSet::limit().ok().flatten().map_or(all, |limit| limit.min(all))
        });
        *FOUND
    }

    /// The set that [`SWITCH`] names, if it is set.
    ///
    /// # Errors
    /// What it says, where that is none of [`InstructionSet::NAMES`]. [`InstructionSet::detect`] then has no limit.
    pub fn limit() -> Result<Option<InstructionSet>, String> {
        std::env::var_os(SWITCH).map(|name| InstructionSet::named(&name.to_string_lossy())).transpose()
    }

    fn named(name: &str) -> Result<InstructionSet, String> {
        let at = InstructionSet::NAMES.iter().position(|n| *n == name);
        at.map(|k| InstructionSet::ALL[k]).ok_or_else(|| name.into())
    }

    fn of_processor() -> InstructionSet {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") && is_x86_feature_detected!("bmi1") {
            return if is_x86_feature_detected!("avx512f") { InstructionSet::Avx512 } else { InstructionSet::Avx2 };
        }
        InstructionSet::Plain
    }

    /// The sets that this processor has, the smallest first.
    pub fn available() -> impl Iterator<Item = InstructionSet> {
        InstructionSet::ALL.into_iter().filter(|set| *set <= InstructionSet::detect())
    }

    /// This set if the processor has it, otherwise the largest one that it has.
    pub fn or_less(self) -> InstructionSet {
        self.min(InstructionSet::detect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_have_names() {
        assert_eq!(InstructionSet::NAMES.map(InstructionSet::named), InstructionSet::ALL.map(Ok));
        assert_eq!(InstructionSet::named("sse"), Err("sse".into()));
    }
}
