//! The source of the translucency maps of a scene's leaf: a folder of `fit translucency` that the scene names, or one
//! that a run has made.

use super::source::{FitFreshness, LeafSource};
use crate::manifest::{SceneManifest, StatedTranslucency as Asked, TranslucencyBasis};
use crate::placed::Result;
use mesophyll_files::hash;
use mesophyll_fits::leaf_folder::LeafFit;
use mesophyll_fits::record::{FitKind, FitRecord};
use mesophyll_fits::translucency::recipe::TranslucencyRecipe;
use mesophyll_optics::translucency::basis::HemisphereBasis as Functions;
use std::path::{Path, PathBuf};

/// The translucency maps that the scene requests.
#[derive(Debug, Clone)]
pub struct PlacedTranslucency {
    /// Their folder, and whether it is up to date.
    pub source: LeafSource,
    /// The open fit, where the maps exist and are up to date. Its files have names like `LEAF/translucency/…`.
    pub fitted: Option<LeafFit>,
}

/// The folder of a run's own translucency maps of a leaf.
pub fn folder(manifest: &SceneManifest, index: usize, out: &Path) -> PathBuf {
    out.join("fits").join(format!("{}-translucency", manifest.leaves[index].data_name()))
}

/// Searches for a leaf's maps; `None` where the scene requests none.
///
/// # Errors
/// [`Error::Input`] for a folder of another kind of fit.
pub fn find(
    manifest: &SceneManifest,
    index: usize,
    out: Option<&Path>,
    fitted_leaf: Option<&LeafFit>,
) -> Result<Option<PlacedTranslucency>> {
    let leaf = &manifest.leaves[index];
    let Some(asked) = &leaf.translucency else { return Ok(None) };
    let named = asked.fit.as_ref().map(|f| manifest.resolve(f));
    let made = out.map(|o| folder(manifest, index, o));
    let exists = |f: &Option<PathBuf>| f.clone().filter(|f| f.join("fit.toml").is_file());
    // If the maps state their input, it must be the leaf's present fit.
    let now = fitted_leaf.map(|f| hash::file(&f.folder.join("fit.toml"))).transpose()?;
    let mut stale = false;
    let mut found = None;
    for (place, is_named) in [(exists(&made), false), (exists(&named), true)] {
        let Some(place) = place else { continue };
        let record = FitRecord::read(&place)?;
        let from = record.options.get("leaf");
        if (from.is_some() && now.is_some() && from != now.as_ref()) || !as_asked(asked, &record, is_named) {
            stale = true;
        } else if found.is_none() {
            found = Some(place);
        }
    }
    let Some(place) = found else {
        let (status, why) = match stale {
            true => {
                (FitFreshness::Stale, "the leaf's fit, or what the scene asks of it, changed since the maps were made")
            }
            false => (FitFreshness::Missing, "not made yet; `mesophyll run` and `check` make it from the leaf's fit"),
        };
        let source = LeafSource { status, folder: made, why: why.into() };
        return Ok(Some(PlacedTranslucency { source, fitted: None }));
    };
    let fitted = LeafFit::open_as(&place, FitKind::Translucency)?.called(&format!("{}/translucency", leaf.name));
    let source = LeafSource { status: FitFreshness::Reuse, folder: Some(place), why: "the scene asks for it".into() };
    Ok(Some(PlacedTranslucency { source, fitted: Some(fitted) }))
}

/// Whether maps that state how they were made were made as the scene requests. Where the scene requests no basis, a
/// named folder may have any.
fn as_asked(asked: &Asked, record: &FitRecord, named: bool) -> bool {
    let wanted = asked.basis.or_else(|| (!named).then(TranslucencyBasis::default));
    let of = |b: TranslucencyBasis| {
        record.options.get("basis").map_or(b == TranslucencyBasis::default(), |s| Functions::named(s) == Some(b.into()))
    };
    TranslucencyRecipe::agrees(record, &asked.options()) && wanted.is_none_or(of)
}
