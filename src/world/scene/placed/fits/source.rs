//! The source of a leaf's fit: a folder that is up to date, or a capture or scan that must be fitted first.

use crate::manifest::{FitOrigin, SceneManifest, StatedLeaf, StatedScan};
use crate::placed::{Error, Result};
use mesophyll_capture::reader::TubeCapture;
use mesophyll_files::hash;
use mesophyll_fits::leaf::Options;
use mesophyll_fits::look::Look;
use mesophyll_fits::record::FitRecord;
use mesophyll_synth::spec::LeafSpec;
use std::path::{Path, PathBuf};

/// The state of a leaf's fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FitFreshness {
    /// Its input is the one it was fitted from (or is not given), so it is used unchanged.
    Reuse,
    /// There is no fit yet.
    Missing,
    /// Its input has changed since.
    Stale,
}

/// The source of a leaf's data.
#[derive(Debug, Clone, PartialEq)]
pub struct LeafSource {
    /// Whether the data exist and are up to date.
    pub status: FitFreshness,
    /// The fit folder to read, or the one where the fit will be.
    pub folder: Option<PathBuf>,
    /// The reason for the status, in words; empty where it is plain.
    pub why: String,
}

/// The options for the fit of a scene's leaf: the lobe with which it will be drawn.
pub fn fit_options(leaf: &StatedLeaf) -> Options {
    Options { lobe: leaf.lobe(), ..Options::default() }
}

/// The input hash that `fit.toml` would have if `capture` were fitted now.
fn input_hash(leaf: &StatedLeaf, capture: &Path) -> Result<String> {
    mesophyll_fits::leaf::input_hash(&TubeCapture::open(capture)?, &fit_options(leaf))
}

/// Finds the source of leaf `index`. `out` is a run's folder with its own fits. Where captures are to be `compared`, a
/// fit whose capture has changed since is not up to date.
///
/// # Errors
/// [`Error::Input`] when the scene names a fit that does not exist and nothing to make it from.
pub fn source(manifest: &SceneManifest, index: usize, out: Option<&Path>, compared: bool) -> Result<LeafSource> {
    let leaf = &manifest.leaves[index];
    if let Some(look) = leaf.look() {
        return stated(&look_of(manifest, look), out.map(|o| o.join("fits").join(leaf.data_name())));
    }
    let FitOrigin { fit, capture, scan, .. } = leaf.fit().ok_or_else(|| {
        Error::field(&manifest.path, &format!("leaf \"{}\"", leaf.name), "is stated, so that it has no fit")
    })?;
    let named = fit.as_ref().map(|f| manifest.resolve(f));
    let made = out.map(|o| o.join("fits").join(leaf.data_name()));
    let exists = |f: &Path| f.join("fit.toml").is_file();
    let mut stale = None;
    for (folder, is_named) in [(made.clone(), false), (named.clone(), true)] {
        let Some(folder) = folder.filter(|f| exists(f)) else { continue };
        let why = match (capture, scan) {
            (Some(capture), _) if compared => {
                let capture = manifest.resolve(capture);
                if FitRecord::read(&folder)?.input_hash != input_hash(leaf, &capture)? {
                    stale =
                        Some(format!("{} changed since {} was fitted from it", capture.display(), folder.display()));
                    continue;
                }
                "its capture is what it was fitted from"
            }
            (_, Some(scan)) if !is_named => {
                let stamp = scan_stamp(out.unwrap_or(Path::new(".")), leaf.data_name());
                if std::fs::read_to_string(&stamp).ok().as_deref() != Some(scan_hash(manifest, scan)?.as_str()) {
                    stale = Some(format!("the scan's specification changed since {} was fitted", folder.display()));
                    continue;
                }
                "its scan is what it was fitted from"
            }
            _ => "the scene names it",
        };
        return Ok(LeafSource { status: FitFreshness::Reuse, folder: Some(folder), why: why.into() });
    }
    if capture.is_none() && scan.is_none() {
        let folder = named.unwrap_or_default();
        return Err(Error::field(
            &manifest.path,
            &format!("leaf \"{}\": fit", leaf.name),
            format!(
                "there is no fit at {} (no fit.toml there), and no capture or scan to make it from",
                folder.display()
            ),
        ));
    }
    let from = if capture.is_some() { "capture" } else { "scan" };
    Ok(match stale {
        Some(why) => LeafSource { status: FitFreshness::Stale, folder: made, why },
        None => LeafSource {
            status: FitFreshness::Missing,
            folder: made,
            why: format!("not fitted yet; the scene names a {from}"),
        },
    })
}

/// A look whose pictures lie where the manifest says.
pub fn look_of(manifest: &SceneManifest, look: &Look) -> Look {
    look.resolved(|picture| manifest.resolve(picture))
}

/// The source of a leaf whose look is stated, with the folder of a run where its maps are.
fn stated(look: &Look, folder: Option<PathBuf>) -> Result<LeafSource> {
    let made = folder.as_ref().filter(|f| f.join("fit.toml").is_file());
    let (status, why) = match made {
        None => (FitFreshness::Missing, "stated, not fitted; its maps are not made yet from the pictures of the scene"),
        Some(f) if FitRecord::read(f)?.input_hash == look.input_hash()? => {
            (FitFreshness::Reuse, "stated, not fitted; its pictures are what its maps were made from")
        }
        Some(_) => (FitFreshness::Stale, "stated, not fitted; its pictures, or what is stated beside them, changed"),
    };
    Ok(LeafSource { status, folder, why: why.into() })
}

/// The hash of a scan's input: its specification and the options of `synth`.
pub fn scan_hash(manifest: &SceneManifest, scan: &StatedScan) -> Result<String> {
    let path = manifest.resolve(&scan.spec);
    let spec = hash::file(&path)?;
    // An error in the specification is reported when the scan is made.
    let pigments = LeafSpec::read(&path).ok().and_then(|spec| spec.foliar).map(|layers| hash::file(&layers.pigments));
    let pigments = pigments.transpose()?.unwrap_or_default();
    let field = scan.field_mm.map(|f| format!("{f:?}")).unwrap_or_default();
    let inside = scan.sigma_a.iter().chain(&scan.sigma_s).map(|s| format!(" {s:?}")).collect::<String>();
    let told = format!(
        "{:?} {:?} {:?} {:?} {}{field}{inside}{pigments}",
        scan.size,
        scan.frames,
        scan.noise,
        scan.seed,
        env!("CARGO_PKG_VERSION")
    );
    Ok(hash::combine([("spec", spec.as_str()), ("told", told.as_str())]))
}

/// The file in which a run notes the input of its scan of a leaf, after the scan is complete.
pub fn scan_stamp(out: &Path, leaf: &str) -> PathBuf {
    out.join("captures").join(format!("{leaf}.scan"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A leaf of layers also depends on a table of pigments.
    #[test]
    fn another_table_of_pigments_asks_for_another_scan() {
        let folder = tempfile::tempdir().unwrap();
        let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../data");
        for (from, to) in [("leaves/soybean.toml", "leaves"), ("tables/pigments.csv", "tables")] {
            std::fs::create_dir(folder.path().join(to)).unwrap();
            std::fs::copy(data.join(from), folder.path().join(from)).unwrap();
        }
        let scene = folder.path().join("s.toml");
        let text = "schema = 1\nname = \"s\"\n[[leaf]]\nname = \"leaf\"\nscan = { spec = \"leaves/soybean.toml\" }\n\
             [[instance]]\nleaf = \"leaf\"\n[sky]\nradiance = [1, 1, 1]\n[[view]]\nname = \"v\"\nkind = \
             \"perspective\"\n\
             eye_mm = [0, 0, 300]\ntarget_mm = [0, 0, 0]\nup = [0, 1, 0]\nfov_deg = 20\n";
        std::fs::write(&scene, text).unwrap();
        let manifest = SceneManifest::read(&scene).unwrap();
        let hash = || scan_hash(&manifest, manifest.leaves[0].fit().unwrap().scan.as_ref().unwrap()).unwrap();
        let before = hash();
        assert_eq!(before, hash());
        let table = folder.path().join("tables/pigments.csv");
        let said = std::fs::read_to_string(&table).unwrap();
        let lines: Vec<&str> = said.lines().collect();
        let (last, rest) = lines.split_last().unwrap();
        // The last wavelength is moved slightly.
        let (wavelength, others) = last.split_once(',').unwrap();
        let moved = format!("{}\n{},{others}\n", rest.join("\n"), wavelength.parse::<f64>().unwrap() + 0.5);
        std::fs::write(&table, moved).unwrap();
        assert_ne!(before, hash());
    }
}
