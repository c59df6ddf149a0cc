//! The pictures that were taken: their readings, with errors, and which of them count.

use crate::quantity::CHANNELS;
use crate::{Error, Result, reflectances};
use mesophyll_files::image::ChannelMaps;
use mesophyll_files::picture::{self, PictureRequest, RGB};
use mesophyll_files::progress;
use mesophyll_scene::manifest::{CheckSettings, SceneManifest, StatedPhotograph};
use mesophyll_transport::ReferenceCamera;
use std::path::Path;

/// Of so many readings, one is held back from the fit to judge it.
const HELD: u64 = 10;
/// Readings that are all equal to the largest one are saturated where there are at least so many, and at least this
/// share.
const SATURATED: (usize, f64) = (4, 1e-4);

/// A picture with its camera.
#[derive(Debug, Clone)]
pub struct ScenePhotograph {
    /// Its name in messages and files: that of its view, with a number where several are of one view.
    pub name: String,
    /// What saw it.
    pub by: ReadingKind,
    /// Columns and rows.
    pub size: [usize; 2],
    /// Readings of a place: three channels, or as many as there are bands.
    pub channels: usize,
    /// Readings, all channels of a place together; NaN where a band has none.
    pub seen: Vec<f64>,
    /// Standard errors that the file states.
    pub error: Option<Vec<f64>>,
    /// Further errors, as a share of what the scene shows; both add as squares.
    pub noise: f64,
    /// Errors of what is dark; they add as squares too.
    pub floor: f64,
    /// What each reading is used for.
    pub uses: Vec<PixelUse>,
    /// Name of its unknown factor.
    pub exposure: Option<String>,
    /// Zenith angle and azimuth of its sun (degrees), where that is not the scene's.
    pub sun_deg: Option<[f64; 2]>,
    /// Number of pixels that were left out because they are saturated.
    pub saturated: usize,
}

/// What readings are of.
#[derive(Debug, Clone)]
pub enum ReadingKind {
    /// A picture by a camera.
    Camera(ReferenceCamera),
    /// Reflectance factors towards directions: zenith and azimuth (rad).
    Directions(Vec<[f64; 2]>),
}

/// What a pixel is used for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PixelUse {
    /// It is fitted.
    Fitted,
    /// It is only predicted, and judges the fit.
    Held,
    /// It is far from what anything explains, and alone in that: it is only shown.
    Wild,
    /// It does not count.
    Out,
}

/// Reads every picture of a scene, and its tables of reflectance factors, which may be of `wavelengths` (nm).
///
/// # Errors
/// [`Error::Input`] for a picture that is missing, not linear, of another size, without noise, or not of numbers.
pub fn read(manifest: &SceneManifest, wavelengths: Option<&[f64]>) -> Result<Vec<ScenePhotograph>> {
    let mut out: Vec<ScenePhotograph> = Vec::new();
    for (k, taken) in manifest.taken.iter().enumerate() {
        let Some(view) = manifest.perspectives().find(|v| v.name == taken.view) else { continue };
        let mut shot = one(manifest, k, taken, view.camera)?;
        let mut number = 1;
        while out.iter().any(|s| s.name == shot.name) {
            number += 1;
            shot.name = format!("{}-{number}", taken.view);
        }
        out.push(shot);
    }
    for (k, factors) in manifest.factors.iter().enumerate() {
        out.push(reflectances::read(manifest, k, factors, wavelengths)?);
    }
    if !out.iter().any(|shot| shot.uses.contains(&PixelUse::Fitted)) {
        let what = "found no reading to fit: all pixels are masked, saturated or held out";
        return Err(Error::field(&manifest.path, "picture", what));
    }
    Ok(out)
}

fn one(
    manifest: &SceneManifest,
    k: usize,
    taken: &StatedPhotograph,
    camera: ReferenceCamera,
) -> Result<ScenePhotograph> {
    let path = manifest.resolve(&taken.file);
    let maps = linear(&path)?;
    let size = [maps.width, maps.height];
    let check = &manifest.check;
    let (stated, default) = ([check.width, check.height].map(|n| n as usize), CheckSettings::default());
    if stated != size && stated != [default.width, default.height].map(|n| n as usize) {
        let (found, expected) = (format!("{}x{} pixels", size[0], size[1]), format!("{}x{}", stated[0], stated[1]));
        return Err(Error::input(&path, format!("found {found}, expected {expected}, the size that [check] states")));
    }
    let field = |key: &str| format!("picture[{k}].{key}");
    let plane = |name: &str| maps.channels.iter().find(|(own, _)| own == name).map(|(_, v)| v);
    let three = |names: [String; 3]| -> Option<Vec<[f64; 3]>> {
        let planes = [plane(&names[0])?, plane(&names[1])?, plane(&names[2])?];
        Some((0..size[0] * size[1]).map(|i| planes.map(|p| f64::from(p[i]))).collect())
    };
    let seen = three(CHANNELS.map(String::from)).unwrap_or_default();
    let error = three(CHANNELS.map(|c| format!("error.{c}")));
    if error.is_none() && taken.noise.is_none() {
        let what = format!("missing; {} has no channels error.R, error.G, error.B", path.display());
        return Err(Error::field(&manifest.path, &field("noise"), what));
    }
    let mut uses = match &taken.mask {
        None => vec![PixelUse::Fitted; seen.len()],
        Some(mask) => {
            let mask = manifest.resolve(mask);
            let read = mesophyll_files::image::read_exr(&mask)?;
            if [read.width, read.height] != size {
                let found = format!("found {}x{} pixels", read.width, read.height);
                return Err(Error::input(&mask, format!("{found}, expected {}x{}, as its picture", size[0], size[1])));
            }
            let own = |name: &str| read.channels.iter().find(|(n, _)| n == name);
            let only = || read.channels.first().filter(|_| read.channels.len() == 1);
            let Some((_, first)) = own("Y").or_else(|| own("R")).or_else(only) else {
                return Err(Error::input(&mask, "found neither a channel Y nor R, expected a mask"));
            };
            first.iter().map(|v| if *v >= 0.5 { PixelUse::Fitted } else { PixelUse::Out }).collect()
        }
    };
    let counts = |i: &usize| uses[*i] != PixelUse::Out;
    let bad = (0..seen.len()).filter(counts).find(|i| {
        let sound = |v: &f64, low: f64| v.is_finite() && *v >= low;
        !seen[*i].iter().all(|v| v.is_finite()) || error.as_ref().is_some_and(|e| !e[*i].iter().all(|v| sound(v, 0.0)))
    });
    if let Some(i) = bad {
        let place = format!("column {}, row {}", i % size[0], i / size[0]);
        let what = format!("found {:?} at {place}, expected finite numbers and errors of at least 0", seen[i]);
        return Err(Error::input(&path, what));
    }
    let counted = || (0..seen.len()).filter(|i| uses[*i] != PixelUse::Out);
    let brightest = [0, 1, 2].map(|c| counted().map(|i| seen[i][c]).fold(0.0, f64::max));
    let full = |i: usize| (0..3).filter(|c| brightest[*c] > 0.0 && seen[i][*c] >= brightest[*c]).count() > 0;
    let at_top = counted().filter(|i| full(*i)).count();
    let mut saturated = 0;
    if at_top >= SATURATED.0 && at_top as f64 > SATURATED.1 * seen.len() as f64 + 2.0 {
        saturated = at_top;
        progress::say(format_args!(
            "{}: {at_top} pixels share the largest reading; they are taken for saturated and left out",
            path.display()
        ));
        (0..seen.len()).filter(|i| full(*i)).for_each(|i| uses[i] = PixelUse::Out);
    }
    hold_back(&mut uses, k, taken.held_out);
    Ok(ScenePhotograph {
        name: taken.view.clone(),
        by: ReadingKind::Camera(camera),
        size,
        channels: 3,
        seen: seen.into_flattened(),
        error: error.map(Vec::into_flattened),
        noise: taken.noise.unwrap_or(0.0),
        floor: taken.noise_floor.unwrap_or(0.0),
        uses,
        exposure: taken.exposure.clone(),
        sun_deg: taken.sun_deg,
        saturated,
    })
}

/// Keeps some pixels of picture `k` from the fit, or `all` of them.
pub fn hold_back(uses: &mut [PixelUse], k: usize, all: bool) {
    // A picture of few pixels has none to spare.
    let large = uses.len() >= 100;
    for (i, own) in uses.iter_mut().enumerate().filter(|(_, own)| **own == PixelUse::Fitted) {
        // A number without order, so that held-out pixels lie everywhere.
        let mixed = (i as u64 ^ (k as u64) << 32).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 33;
        if all || large && mixed.is_multiple_of(HELD) {
            *own = PixelUse::Held;
        }
    }
}

/// A linear picture, with all channels.
fn linear(path: &Path) -> Result<ChannelMaps> {
    let ending = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    if ["png", "jpg", "jpeg", "tif", "tiff"].contains(&ending.as_str()) {
        let what = "found a picture that is meant for display, expected linear radiance as OpenEXR: develop it without \
                    a tone curve (`dcraw -4 -T -o 0`, or darktable's linear Rec. 709), and save it as .exr";
        return Err(Error::input(path, what));
    }
    let request = PictureRequest { names: &RGB, all: true, outside: f32::NAN };
    let read = picture::read(path, &request, |_, _| Ok(()))?;
    picture::tell(path, &read.said);
    Ok(read.maps)
}
