//! The pictures of the leaf on the light table, laid over the front's: one, or one of each side.

use super::grid::Grid;
use super::light_table::{OverBare, on_light_table, over_bare};
use super::manifest::PhotoManifest;
use super::noise::SensorNoise;
use super::picture::LinearPhotograph;
use super::registration::{BinaryMask, OutlineMatch, register};
use super::texture::choose;
use crate::photo::{Error, Result};
use mesophyll_base::rgb::Rgb;
use mesophyll_optics::side::Side;
use std::path::Path;

/// Outlines of one leaf overlap by at least this.
pub(super) const OVERLAP: f64 = 0.9;
/// A mirror image counts as the better match where its overlap is larger by this.
const TURNED: f64 = 0.02;

/// What was seen on the light table.
pub(super) struct Views {
    up: Side,
    first: OverBare,
    turned: Option<OverBare>,
}

/// The front in open shade, which the other pictures are laid over.
#[derive(Clone, Copy)]
pub(super) struct PhotoFront<'a> {
    pub outline: BinaryMask<'a>,
    /// What its texels show.
    pub value: &'a [Rgb],
    /// By at least this (pixels of the front's picture) a view may lie askew, whatever its outline says.
    pub least_apart_px: f64,
}

impl Views {
    /// Reads the pictures. Takes texels that are not on the leaf in all of them from `mask`.
    ///
    /// # Errors
    /// Pictures that cannot be read, show no leaf, or whose outlines do not match the front's.
    pub fn read(
        folder: &Path,
        m: &PhotoManifest,
        front: PhotoFront,
        grid: &Grid,
        mask: &mut [bool],
        noise: &SensorNoise,
    ) -> Result<Views> {
        let bare = LinearPhotograph::read(&folder.join(&m.light_table.bare), m)?;
        let mut view = |file: &str, side: Side, way: &str| {
            let path = folder.join(file);
            let picture = LinearPhotograph::read(&path, m)?;
            let table = on_light_table(&picture, &bare)?;
            let outline = BinaryMask { inside: &table.mask, width: picture.width };
            let mirrored = side == Side::Back;
            let Some(found) = register(front.outline, outline, mirrored) else { return Err(mismatch(&path, 0.0)) };
            judge(&path, front.outline, outline, &found.best, mirrored, way)?;
            let mut found = choose(grid, mask, front.value, &picture, found);
            found.found.apart_px = found.found.apart_px.max(front.least_apart_px);
            (0..mask.len()).for_each(|k| mask[k] &= outline.holds(found.found.motion.at(grid.middle(k))));
            Ok(over_bare(&picture, &bare, &table, grid, mask, found, noise))
        };
        let (up, other) = match m.light_table.up {
            Side::Front => (Side::Front, Side::Back),
            Side::Back => (Side::Back, Side::Front),
        };
        let way = format!("the {} up, as light_table.up says", up.name());
        let first = view(&m.light_table.leaf, up, &way)?;
        let way = format!("the {} up, because light_table.turned is the leaf turned over", other.name());
        let turned = m.light_table.turned.as_ref().map(|file| view(file, other, &way)).transpose()?;
        Ok(Views { up, first, turned })
    }

    /// What was seen of a side, or of the other side where nobody took its picture; and whether it was this side.
    pub fn of(&self, side: Side) -> (&OverBare, bool) {
        match &self.turned {
            Some(turned) if side != self.up => (turned, true),
            _ => (&self.first, side == self.up),
        }
    }

    /// Every picture.
    pub fn each(&self) -> impl Iterator<Item = &OverBare> {
        [Some(&self.first), self.turned.as_ref()].into_iter().flatten()
    }
}

/// Relative standard errors of ρt where it was seen from the other side: of each texel, and of all.
///
/// A slab lets as much through one way as the other. But each surface has its own slopes, and a facet with the slope t
/// receives about 1 + t²/4 of what a flat one does (1/cos t times as much surface, which sees (1 + cos t)/2 of the
/// light). With slopes of a root mean square of .2 over both directions, t²/4 is .01 on the mean and scatters by .01,
/// on either side; the texels' difference scatters by √2 of that, and the means of both sides differ by less than
/// either.
pub(super) const OTHER_WAY: [f64; 2] = [0.014, 0.01];

/// The refusal of a picture whose leaf's outline is not the front's.
pub(super) fn mismatch(path: &Path, overlap: f64) -> Error {
    let share = 100.0 * overlap;
    let what =
        format!("the leaf's outline overlaps the front's by {share:.0} % only; expected one leaf, whole and flat");
    Error::input(path, what)
}

/// Refuses outlines that do not match, and a leaf that lies the wrong way up.
pub(super) fn judge(
    path: &Path,
    first: BinaryMask,
    second: BinaryMask,
    found: &OutlineMatch,
    mirrored: bool,
    way: &str,
) -> Result<()> {
    let other = register(first, second, !mirrored).map_or(0.0, |m| m.best.overlap);
    if other > found.overlap + TURNED {
        let [fits, turned] = [100.0 * found.overlap, 100.0 * other];
        let what = format!(
            "the leaf lies the wrong way up ({fits:.1} % overlap with the front's outline, {turned:.1} % if it is \
             turned over); expected it {way}"
        );
        return Err(Error::input(path, what));
    }
    if found.overlap < OVERLAP { Err(mismatch(path, found.overlap)) } else { Ok(()) }
}
