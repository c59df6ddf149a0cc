//! 8-bit previews of a fit's maps, for people.

use crate::leaf_folder::Result;
use mesophyll_base::statistics::lower_quantile;
use mesophyll_files::image::{ChannelMaps, to_srgb8, write_png};
use mesophyll_files::quantity::Quantity;
use mesophyll_optics::side::Side;
use std::path::Path;

/// Writes them into the folder `out`: colours as sRGB on transparent ground, numbers as grey between their 1st and 99th
/// percentile.
///
/// # Errors
/// A folder that cannot be written.
pub fn write(out: &Path, side: Side, values: &ChannelMaps) -> Result<()> {
    let mask = values.scalar(Quantity::Mask).unwrap_or_default();
    let alpha = |k: usize| if mask[k] == 0.0 { 0 } else { 255 };
    let save = |what: &str, pixel: &dyn Fn(usize) -> [u8; 3]| {
        let bytes: Vec<u8> = (0..mask.len())
            .flat_map(|k| {
                let [r, g, b] = pixel(k);
                [r, g, b, alpha(k)]
            })
            .collect();
        write_png(&out.join(format!("{}_{what}.png", side.name())), values.width, values.height, &bytes)
    };
    let three = |q| values.three(q).unwrap_or_default();
    for quantity in [Quantity::RhoD, Quantity::RhoT, Quantity::RhoS] {
        let planes = three(quantity);
        save(quantity.name(), &|k| planes.map(|p| to_srgb8(p[k])))?;
    }
    for quantity in [Quantity::M, Quantity::Thickness] {
        let plane = values.scalar(quantity).unwrap_or_default();
        let mut good: Vec<f32> =
            plane.iter().zip(mask).filter(|(v, m)| **m == 1.0 && v.is_finite()).map(|(v, _)| *v).collect();
        let [lo, hi] = [0.01, 0.99].map(|share| lower_quantile(&mut good, share).unwrap_or(0.0));
        save(quantity.name(), &|k| [(((plane[k] - lo) / (hi - lo).max(1e-12)).clamp(0.0, 1.0) * 255.0) as u8; 3])?;
    }
    let normal = three(Quantity::Normal);
    save(Quantity::Normal.name(), &|k| normal.map(|p| ((p[k] * 0.5 + 0.5).clamp(0.0, 1.0) * 255.0 + 0.5) as u8))
}
