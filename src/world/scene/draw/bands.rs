//! What everything in a scene scatters at any wavelengths, for paths that carry them all.

use crate::loaded::LoadedScene;
use crate::manifest::{StatedSpectrum, UniformLeaf};
use crate::{Error, Result};
use mesophyll_files::spectra::SingleSpectrum;
use mesophyll_transport::path::SurfaceBands;

/// What each leaf of the world that [`super::reference::traced`] makes scatters at these wavelengths (nm).
///
/// # Errors
/// [`Error::Input`] naming the first leaf, plant or ground that has no spectrum, and a spectrum that does not cover the
/// wavelengths.
pub fn surfaces(scene: &LoadedScene, wavelengths: &[f64]) -> Result<Vec<SurfaceBands>> {
    let manifest = &scene.manifest;
    let bad = |field: &str, what: &str| Err(Error::field(&manifest.path, field, what));
    let mut out = Vec::new();
    for leaf in scene.drawn() {
        let field = format!("leaf \"{}\"", leaf.config.name);
        let stated = leaf.config.uniform().filter(|_| leaf.config.layers().is_none());
        let Some((stated, read)) = stated.and_then(|of| Some((of, read(of.spectrum.as_ref())?))) else {
            let what =
                "three channels say nothing of single wavelengths; expected uniform = { spectrum = \"leaf.csv\" }";
            return bad(&field, what);
        };
        if has_coloured_gloss(stated) {
            let what = "rho_s differs between channels, and nothing says how it depends on the wavelength; expected \
                        three equal numbers";
            return bad(&format!("{field}, uniform"), what);
        }
        let [front, back, through] = [0, 1, 2].map(|k| read.at(k, wavelengths));
        out.push(SurfaceBands { rho_d: [front?, back?], rho_t: through? });
    }
    if !scene.placed.grass.is_empty() {
        return bad("grass", "the blades of a lawn have no spectrum; expected a scene without a lawn");
    }
    let of_stands = scene.placed.stands.iter().flat_map(|stand| &stand.wood);
    if let Some(wood) = scene.placed.wood.iter().chain(of_stands).next() {
        let what = format!(
            "the wood of {} has three channels, and no field gives wood a spectrum; expected leaves alone, such as a \
             list of [[instance]], or --channel in place of --bands",
            wood.name
        );
        return bad("plant", &what);
    }
    if let Some(ground) = manifest.ground.as_ref().filter(|_| scene.placed.ground.is_some()) {
        let Some(read) = read(ground.spectrum.as_ref()) else {
            return bad("ground", "three channels say nothing of single wavelengths; expected spectrum = \"soil.csv\"");
        };
        out.push(SurfaceBands::opaque(read.at(0, wavelengths)?));
    }
    Ok(out)
}

fn read(spectrum: Option<&StatedSpectrum>) -> Option<&SingleSpectrum> {
    spectrum?.read.as_deref()
}

fn has_coloured_gloss(leaf: &UniformLeaf) -> bool {
    leaf.gloss().is_some_and(|[r, g, b]| r != g || r != b)
}
