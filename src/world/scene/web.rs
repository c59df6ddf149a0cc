//! A scene as one file for the viewer in a browser.

use crate::draw::handover;
use crate::loaded::LoadedScene;
use crate::manifest::{InteriorSource, PerspectiveView};
use crate::placed::ledger::Ledger;
use crate::{Error, Result};
use mesophyll_base::tone::PictureDisplay;
use mesophyll_files::quantity::Quantity;
use mesophyll_optics::side::Sides;
use mesophyll_transport::environment::Environment;
use mesophyll_viewer::scene as viewer;
use mesophyll_web::bundle::{Bundle, BundleView, LeafSlabs, SideSlab, StillSections};
use std::path::Path;
use std::sync::Arc;

/// Columns of the picture of a sky, which would be most of the file otherwise.
const SKY: usize = 1024;
/// Texels along a side of a shadow map that every browser can hold (WebGL 2 promises no more).
const SHADOW_SIDE: u32 = 2048;

/// Everything that the browser needs of a scene. `pictures` is the folder of a run or check, whose reference pictures
/// are taken over. The plants stand as in the first view.
///
/// # Errors
/// [`Error::Input`] where a map or a picture cannot be read, or where the scene has no perspective view.
pub fn bundle(scene: &LoadedScene, pictures: &Path, ledger: &Ledger) -> Result<Bundle> {
    let manifest = &scene.manifest;
    let seen = || manifest.perspectives();
    let Some(first) = seen().next() else {
        return Err(Error::unexpected(&manifest.path, "view", "only cards", "a perspective view"));
    };
    if let Some(stand) = scene.placed.stands.first() {
        let found = format!("{} plants of a kind, which share poses", stand.places.len());
        let expected = "fewer plants: the viewer in a browser draws each by itself";
        return Err(Error::unexpected(&manifest.path, "plant", found, expected));
    }
    let time_s = manifest.time_of(first);
    let mut drawn = handover::shown(scene, manifest.display(), ledger)?;
    if let Some(wind) = &mut drawn.wind {
        wind.time_s = time_s;
    }
    // As many texels in maps that every browser can hold.
    let finer = (drawn.shadow_resolution / SHADOW_SIDE).max(1);
    drawn.shadow_resolution /= finer;
    drawn.shadow_samples *= finer * finer;
    // The grain of the ground would be most of the file.
    for material in &mut drawn.materials {
        if let viewer::Material::Opaque(opaque) = material {
            opaque.pattern = None;
        }
    }
    if let Some(picture) = drawn.dome.as_mut().and_then(|dome| dome.picture.as_mut()) {
        let [width, height] = [picture.width, picture.height].map(|n| n as usize);
        let map = Environment::new(width, height, picture.texels.to_vec()).map_err(Error::Usage)?.reduced(SKY);
        let (width, height, texels) = map.texels();
        (picture.width, picture.height, picture.texels) = (width as u32, height as u32, Arc::new(texels.to_vec()));
    }
    let size = [manifest.check.width, manifest.check.height];
    let view = |v: &PerspectiveView| -> Result<BundleView> {
        // Reference pictures have no bloom and are shown plainly, and they show the plants at their own view's time.
        let plain = drawn.bloom.is_none() && drawn.display == PictureDisplay::default();
        let same = manifest.time_of(v) == time_s && plain;
        let path = pictures.join(format!("{}-reference.png", v.name));
        let reference = if same && path.is_file() { Some(picture(&path, size)?) } else { None };
        Ok(BundleView { name: v.name.clone(), camera: handover::camera(&v.camera), size, reference })
    };
    let views = seen().map(view).collect::<Result<Vec<BundleView>>>()?;
    let still = StillSections::of(&drawn);
    Ok(Bundle {
        title: manifest.name.clone(),
        program: format!("mesophyll {}", env!("CARGO_PKG_VERSION")),
        still,
        views,
        leaves: slabs(scene)?,
        scene: drawn,
    })
}

/// The leaves whose σ are one number for the whole leaf. A leaf with a map of σ is shown as fitted.
fn slabs(scene: &LoadedScene) -> Result<Vec<LeafSlabs>> {
    let mut out = Vec::new();
    // `drawn` has the order of the renderer's materials.
    for (material, leaf) in scene.drawn().enumerate() {
        let Some(fitted) =
            leaf.placed.fitted.as_ref().filter(|_| leaf.placed.interior(leaf.config) == InteriorSource::Scalars)
        else {
            continue;
        };
        let sides = Sides::try_of(|side| {
            if !(fitted.has(side) && leaf.plan.needs(side).interior()) {
                return Ok(None);
            }
            let rgb = |quantity| fitted.rgb(side, quantity);
            Ok::<_, Error>(Some(SideSlab { sigma_a: rgb(Quantity::SigmaA)?, sigma_s: rgb(Quantity::SigmaS)? }))
        })?;
        out.push(LeafSlabs { material, thickness_mm: fitted.thickness(fitted.lead())?, sides });
    }
    Ok(out)
}

/// The bytes of a PNG file, which must have this size.
fn picture(path: &Path, size: [u32; 2]) -> Result<Vec<u8>> {
    let bytes = std::fs::read(path).map_err(|e| Error::input(path, e))?;
    // A PNG file begins with 8 bytes of its own, the length and name of the first part, and the picture's size.
    let side = |at: usize| bytes.get(at..at + 4).and_then(|b| b.try_into().ok()).map(u32::from_be_bytes);
    let [width, height] = size;
    if [side(16), side(20)] != [Some(width), Some(height)] {
        let found = [side(16), side(20)].map(|s| s.unwrap_or(0).to_string()).join("x");
        let what = format!("found a picture of {found} pixels, expected {width}x{height}; `mesophyll check` draws it");
        return Err(Error::input(path, what));
    }
    Ok(bytes)
}
