//! The pictures that a check leaves beside its figures.

use super::Options;
use super::report::ViewReport;
use crate::Result;
use crate::files::image;
use crate::transport::{ReferencePicture, compare};
use mesophyll_viewer as gpu;

/// Writes picture, reference, eightfold difference and FLIP of a view.
pub fn save(
    view: &mut ViewReport,
    options: &Options,
    truth: &ReferencePicture,
    picture: &gpu::Picture,
    seen: &compare::Comparison,
) -> Result<()> {
    let names = [format!("{}.png", view.name), format!("{}-reference.png", view.name), format!("{}-difference.png", view.name)];
    let (w, h) = (truth.width, truth.height);
    image::write_png(&options.out.join(&names[0]), w, h, picture.ldr.as_flattened())?;
    image::write_png(&options.out.join(&names[1]), w, h, truth.ldr.as_flattened())?;
    image::write_png(&options.out.join(&names[2]), w, h, &compare::difference_picture(&truth.ldr, &picture.ldr, 8.0))?;
    image::write_png(&options.out.join(format!("{}-flip.png", view.name)), w, h, &seen.flip_picture())?;
    view.pictures = Some(names);
    Ok(())
}
