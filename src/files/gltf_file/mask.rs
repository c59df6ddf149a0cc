//! The outline that a material cuts out of a picture, as cards of leaves have it.

use super::{GltfDocument, load};
use serde_json::Value;
use std::path::Path;

/// Where a material's picture is opaque.
#[derive(Debug, Clone, PartialEq)]
pub struct AlphaMask {
    size: [usize; 2],
    /// Opacity from 0 to 255, row by row from the top.
    alpha: Vec<u8>,
    /// Opacity from 0 to 1 from which on something is there.
    cutoff: f32,
}

impl AlphaMask {
    /// A mask of width and height `size` from opacities (0 to 255), row by row from the top, of which those from
    /// `cutoff` (0 to 1) on are there.
    ///
    /// # Panics
    /// Where there are not as many opacities as texels, or none.
    pub fn new(size: [usize; 2], alpha: Vec<u8>, cutoff: f32) -> AlphaMask {
        assert!(!alpha.is_empty() && alpha.len() == size[0] * size[1], "one opacity a texel");
        AlphaMask { size, alpha, cutoff }
    }

    /// The mask of the material with this index. `None` where it cuts nothing out, and where its picture cannot be
    /// read, has no opacity or is laid on by a transform.
    pub fn of(path: &Path, opened: &GltfDocument, material: usize) -> Option<AlphaMask> {
        let root = &opened.root;
        let material = &root["materials"][material];
        let cutoff = match material["alphaMode"].as_str()? {
            "MASK" => material["alphaCutoff"].as_f64().unwrap_or(0.5) as f32,
            "BLEND" => 0.5,
            _ => return None,
        };
        let colour = &material["pbrMetallicRoughness"]["baseColorTexture"];
        if colour["extensions"]["KHR_texture_transform"].is_object() || colour["texCoord"].as_u64().unwrap_or(0) != 0 {
            return None;
        }
        let picture = texture(path, opened, colour).filter(|p| p.color().has_alpha())?.into_rgba8();
        let size = [picture.width(), picture.height()].map(|side| side as usize);
        let alpha: Vec<u8> = picture.pixels().map(|p| p.0[3]).collect();
        alpha.iter().any(|a| *a != alpha[0]).then(|| AlphaMask::new(size, alpha, cutoff))
    }

    /// How much more opaque than its limit the picture is at a texture coordinate; below 0 nothing is there. The
    /// picture repeats.
    pub fn at(&self, uv: [f64; 2]) -> f64 {
        let [x, y] = [0, 1].map(|c| uv[c].rem_euclid(1.0) * self.size[c] as f64 - 0.5);
        let texel = |dx: f64, dy: f64| {
            let wrap = |v: f64, n: usize| (v.floor() as i64).rem_euclid(n as i64) as usize;
            f64::from(self.alpha[wrap(y + dy, self.size[1]) * self.size[0] + wrap(x + dx, self.size[0])]) / 255.0
        };
        let (s, t) = (x - x.floor(), y - y.floor());
        let rows = [0.0, 1.0].map(|dy| texel(0.0, dy) * (1.0 - s) + texel(1.0, dy) * s);
        rows[0] * (1.0 - t) + rows[1] * t - f64::from(self.cutoff)
    }
}

/// The colour of the material with this index: linear reflectances of red, green and blue, the mean of its picture
/// where that is opaque. White where the file says nothing of it.
pub fn colour(path: &Path, opened: &GltfDocument, material: usize) -> [f64; 3] {
    let said = &opened.root["materials"][material]["pbrMetallicRoughness"];
    let factor = [0, 1, 2].map(|c| said["baseColorFactor"][c].as_f64().unwrap_or(1.0));
    let Some(picture) = texture(path, opened, &said["baseColorTexture"]) else { return factor };
    let (mut sum, mut opaque) = ([0.0; 3], 0.0);
    for p in picture.into_rgba8().pixels().filter(|p| p.0[3] >= 128) {
        opaque += 1.0;
        (0..3).for_each(|c| sum[c] += crate::image::from_srgb8(p.0[c]));
    }
    if opaque > 0.0 { [0, 1, 2].map(|c| factor[c] * sum[c] / opaque) } else { factor }
}

/// The picture that a material refers to in this way. `None` where it refers to none, or to one that cannot be read.
fn texture(path: &Path, opened: &GltfDocument, reference: &Value) -> Option<image::DynamicImage> {
    let root = &opened.root;
    let texture = &root["textures"][reference["index"].as_u64()? as usize];
    let image = &root["images"][texture["source"].as_u64()? as usize];
    image::load_from_memory(&picture(path, opened, image)?).ok()
}

/// The bytes of a picture that lies in the file or beside it.
fn picture(path: &Path, opened: &GltfDocument, image: &Value) -> Option<Vec<u8>> {
    if let Some(view) = image["bufferView"].as_u64() {
        let view = &opened.root["bufferViews"][view as usize];
        let start = view["byteOffset"].as_u64().unwrap_or(0) as usize;
        let end = start.checked_add(view["byteLength"].as_u64()? as usize)?;
        return opened.buffers.get(view["buffer"].as_u64()? as usize)?.0.get(start..end).map(<[u8]>::to_vec);
    }
    image["uri"].as_str()?;
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    load(path, folder, "images", image, &mut None).ok()
}
