//! Where along a branch its load hangs.

use std::fmt;
use std::str::FromStr;

/// How a load is spread along a branch. It keeps its direction, across the straight branch, while the branch bends: a
/// weight on a branch that is level when it is straight.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Load {
    /// Evenly along the branch: the same load on every millimetre of it, as of leaves and twigs or of snow.
    #[default]
    Even,
    /// At the tip.
    Tip,
    /// The branch's own weight: proportional to its cross-section at each place.
    OwnWeight,
    /// At one place, a share of the branch's length from the root, in (0, 1].
    Share(f64),
    /// At one place, so many millimetres of branch from the root, more than 1.
    Millimetres(f64),
}

impl Load {
    /// The same load for a branch of this length (mm), with its place as a share of the length.
    ///
    /// # Errors
    /// A place beyond the tip, in words.
    pub fn on(self, length: f64) -> Result<Load, String> {
        match self {
            Load::Millimetres(at) if at > length => {
                Err(format!("--load {at} is beyond the tip: length_mm is {length}; expected a place on the branch"))
            }
            Load::Millimetres(at) => Ok(Load::Share(at / length)),
            load => Ok(load),
        }
    }

    /// The load in words, to follow "the load is taken as".
    pub fn words(self) -> String {
        match self {
            Load::Even => "spread evenly along the branch".into(),
            Load::Tip => "hanging at the tip".into(),
            Load::OwnWeight => "the branch's own weight".into(),
            Load::Share(at) => format!("hanging at {} of the length from the root", at),
            Load::Millimetres(at) => format!("hanging {at} mm from the root"),
        }
    }
}

/// The word that [`FromStr`] reads back.
impl fmt::Display for Load {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Load::Even => f.write_str("even"),
            Load::Tip => f.write_str("tip"),
            Load::OwnWeight => f.write_str("own-weight"),
            Load::Share(at) | Load::Millimetres(at) => write!(f, "{at}"),
        }
    }
}

impl FromStr for Load {
    type Err = String;

    fn from_str(text: &str) -> Result<Load, String> {
        match text {
            "even" => return Ok(Load::Even),
            "tip" => return Ok(Load::Tip),
            "own-weight" => return Ok(Load::OwnWeight),
            _ => {}
        }
        match text.parse::<f64>() {
            Ok(at) if at > 0.0 && at <= 1.0 => Ok(Load::Share(at)),
            Ok(at) if at > 1.0 && at.is_finite() => Ok(Load::Millimetres(at)),
            _ => {
                Err("expected tip, even, own-weight, or the place of a single load: its distance from the root, up to \
                      1 as a share of the length and above 1 in mm"
                    .into())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loads_are_read_back_and_placed() {
        for text in ["even", "tip", "own-weight", "0.75", "1", "120.5"] {
            assert_eq!(text.parse::<Load>().unwrap().to_string(), text);
        }
        for text in ["", "Tip", "0", "-3", "inf", "NaN", "end"] {
            assert!(text.parse::<Load>().unwrap_err().contains("own-weight"), "{text}");
        }
        assert_eq!("120".parse::<Load>().unwrap().on(480.0), Ok(Load::Share(0.25)));
        assert!("120".parse::<Load>().unwrap().on(100.0).unwrap_err().contains("beyond the tip"));
    }
}
