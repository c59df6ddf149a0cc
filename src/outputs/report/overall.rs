//! The verdict of a check, and the one over everything in the report.

use crate::captures;
use crate::model::{CheckReport, FitReport, QualityLevel, ReportVerdict, VerdictReason};

/// Judges a check.
pub(crate) fn of_check(check: &CheckReport) -> VerdictReason {
    let failed: Vec<&str> = check.views.iter().filter(|v| v.passed == Some(false)).map(|v| v.name.as_str()).collect();
    match check.passed {
        Some(true) if failed.is_empty() => {
            let views = check.views.len();
            let what = if views == 1 { "the picture agrees".into() } else { format!("all {views} pictures agree") };
            VerdictReason {
                level: QualityLevel::Good,
                text: format!("{what} with the reference renderer ({})", check.adapter),
            }
        }
        None => VerdictReason {
            level: QualityLevel::Doubtful,
            text: "check.json does not say whether the check passed".into(),
        },
        _ if failed.is_empty() => {
            VerdictReason { level: QualityLevel::Bad, text: "the picture check missed its threshold".into() }
        }
        _ => VerdictReason {
            level: QualityLevel::Bad,
            text: format!("the picture check missed its threshold in {}", failed.join(", ")),
        },
    }
}

/// The verdict over everything in the report.
pub(crate) fn overall(fits: &[FitReport], checks: &[CheckReport]) -> ReportVerdict {
    let mut reasons: Vec<VerdictReason> = fits
        .iter()
        .map(|f| VerdictReason { level: f.verdict.level, text: f.verdict.sentence.trim_end_matches('.').to_string() })
        .collect();
    reasons.extend(checks.iter().map(of_check));
    reasons.extend(checks.iter().filter_map(|c| captures::reason(&c.captures)));
    let level = reasons.iter().map(|r| r.level).max().unwrap_or(QualityLevel::Doubtful);
    let sentence = match (level, reasons.is_empty()) {
        (_, true) => "There is nothing to judge: no fit and no check were found.".into(),
        (QualityLevel::Good, _) => "Every fit and check met its mark.".into(),
        (QualityLevel::Doubtful, _) => "Something needs a look before the numbers are relied on.".into(),
        (QualityLevel::Bad, _) => "Something missed its mark.".into(),
    };
    ReportVerdict { level, sentence, missed: level == QualityLevel::Bad, reasons }
}
