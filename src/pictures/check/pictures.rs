//! The pictures that a check writes besides its figures.

use crate::Options;

use mesophyll_base::error::Result;
use mesophyll_files::image;
use mesophyll_scene::verdict::{ViewFigures, ViewPictures};
use mesophyll_transport::{ReferencePicture, comparison};
use mesophyll_viewer as gpu;

/// How much the picture of the difference is enlarged.
const GAIN: f64 = 8.0;
/// Round numbers that the scale of a FLIP map may end at.
const TOPS: [f64; 5] = [0.05, 0.1, 0.2, 0.5, 1.0];

/// Writes picture, reference, enlarged difference and FLIP map of a view, and notes the scales of the last two.
pub fn save(
    view: &mut ViewFigures,
    options: &Options,
    truth: &ReferencePicture,
    picture: &gpu::Picture,
    seen: &comparison::PictureComparison,
) -> Result<()> {
    let names = ["", "-reference", "-difference", "-flip"].map(|ending| format!("{}{ending}.png", view.name));
    let (w, h) = (truth.width, truth.height);
    image::write_png(&options.out.join(&names[0]), w, h, picture.ldr.as_flattened())?;
    image::write_png(&options.out.join(&names[1]), w, h, truth.ldr.as_flattened())?;
    image::write_png(
        &options.out.join(&names[2]),
        w,
        h,
        &comparison::difference_picture(&truth.ldr, &picture.ldr, GAIN),
    )?;
    // The scale includes twice the error that is seen and twice the error that is allowed, so that maps of good
    // pictures are not black.
    let needed = 2.0 * seen.flip_p99.max(view.threshold_flip_p99.unwrap_or(0.0));
    let top = TOPS.into_iter().find(|t| *t >= needed).unwrap_or(1.0);
    image::write_png(&options.out.join(&names[3]), seen.width, seen.height, &seen.flip_picture(top))?;
    let [image, reference, difference, flip] = names;
    view.pictures = Some(ViewPictures { image, reference, difference, flip });
    (view.flip_top, view.difference_top) = (Some(top), Some(128.0 / GAIN / 255.0));
    Ok(())
}
