//! Which tissue light is sent through (the slab of the leaf fit, the sources' table, or the user's numbers), and how
//! light enters it.
//!
//! There are two consistent pictures of a leaf's surface. In LEAFMOD's (`fit`) the leaf is index-matched: all light
//! enters, diffusely reflected light comes back out of the tissue, and A = 1. In H7's (`table`, numbers) the diffuse
//! reflectance ρd is the surface's: the share 1 − ρd enters (H9 Eq. 3.9, 3.13), and A = (1 + ρd)/(1 − ρd) of its mean
//! (H9 Eq. 3.4) describes the reflection back inside.

use super::source::TranslucencySideMaps;
use super::{Options, TissueName, TissueSource};
use crate::translucency::{Error, Result};
use mesophyll_optics::dipole::Tissue;
use strum::{Display, EnumIter, EnumMessage, EnumString, IntoStaticStr};

/// H9 Table 3.1, at 510 nm (1/mm).
pub const TABLE: [f64; 3] = [0.4, 10.2, 0.07];

/// How much light enters a texel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Display, EnumString, EnumIter, IntoStaticStr, EnumMessage)]
#[strum(serialize_all = "kebab-case")]
pub enum LightEntry {
    /// All of it.
    Matched,
    /// 1 − ρd of the texel.
    Albedo,
}

impl LightEntry {
    /// Its name on the command line and in `fit.toml`.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// How light enters, where the options leave it open.
pub fn entry(options: &Options) -> LightEntry {
    options.entry.unwrap_or(match options.tissue {
        TissueSource::Named(TissueName::Fit) => LightEntry::Matched,
        TissueSource::Named(TissueName::Table) | TissueSource::Given { .. } => LightEntry::Albedo,
    })
}

/// The tissue behind one side in channel `c`.
///
/// # Errors
/// [`Error::Missed`] when the leaf fit knows nothing of the slab in this channel and no other tissue was asked for.
pub fn of(side: &TranslucencySideMaps, c: usize, options: &Options) -> Result<Tissue> {
    let [sigma_a, sigma_s, g] = match options.tissue {
        TissueSource::Named(TissueName::Fit) => {
            let letter = ["R", "G", "B"][c];
            for (name, err) in [("sigma_a", side.sigma_err[0][c]), ("sigma_s", side.sigma_err[1][c])] {
                if err.is_infinite() {
                    let own = format!("{name}.{letter}");
                    let why =
                        side.undetermined.iter().find(|u| u.starts_with(&own)).map_or(own.as_str(), String::as_str);
                    return Err(Error::Missed(format!(
                        "the leaf fit leaves this undetermined on its {}: {why}; choose --channel, --tissue table or \
                         --sigma-a and --sigma-s",
                        side.name.name()
                    )));
                }
            }
            [side.sigma_a[c], side.sigma_s[c], 0.0]
        }
        TissueSource::Named(TissueName::Table) => TABLE,
        TissueSource::Given { sigma_a, sigma_s, g } => [sigma_a, sigma_s, g],
    };
    let a = options.a.unwrap_or_else(|| match entry(options) {
        LightEntry::Matched => 1.0,
        LightEntry::Albedo => {
            let rho = mean(&side.rho_d[c], &side.mask).clamp(0.0, 0.99);
            (1.0 + rho) / (1.0 - rho)
        }
    });
    Ok(Tissue { sigma_a, sigma_s, g, a })
}

/// The channel that lets most light through: green for green leaves, red for red ones (H9 p. 50: one dominant
/// wavelength).
pub fn dominant(sides: &[TranslucencySideMaps]) -> usize {
    let level = |c: usize| sides.iter().map(|s| mean(&s.rho_t[c], &s.mask)).sum::<f64>();
    (0..3).fold(0, |best, c| if level(c) > level(best) { c } else { best })
}

/// Mean over the leaf.
pub fn mean(plane: &[f32], mask: &[bool]) -> f64 {
    let (sum, count) = plane
        .iter()
        .zip(mask)
        .filter(|(v, m)| **m && v.is_finite())
        .fold((0.0, 0usize), |(s, n), (v, _)| (s + f64::from(*v), n + 1));
    sum / count.max(1) as f64
}
