//! The leaf fit of a capture under a dome (H9 §3.3.2). It reads maps of albedo, transmittance, thickness and normals,
//! and finds the absorption σa and the scattering σs of the tissue (1/mm) and γ, a texel's reflectance relative to the
//! leaf's. It writes the same folder as the fit of a scan under a tube, so that the report, the translucency fit,
//! scenes and exports work on either.
//!
//! A dome does not show gloss. The caller states its refractive index and slope, or gloss is left out.

pub(crate) mod output;
mod slab;

use crate::leaf::curve::Incidence;
use crate::leaf::slabmaps::{SigmaEstimate, SlabInverter};
use crate::record::FitKind;
use crate::record::maker::{self, FitMaker, FitOutcome};
use crate::{Error, Result};
use mesophyll_base::rgb::Rgb;
use mesophyll_capture::dome::DomeCapture;
use mesophyll_capture::dome::reduction::{DomeMaps, Options as Reduction, reduce};
use mesophyll_optics::side::Side;
use rayon::prelude::*;
use slab::{DomeSharedErrors, DomeSlabFit, DomeTexel};
use std::path::Path;
use std::time::Instant;

/// What the fit is told beside the capture.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Options {
    /// Effective refractive index and slope m of both sides' gloss (Bousquet et al. 2005: 1.2 to 1.7 and .078 to .5);
    /// `None`: matte.
    pub gloss: Option<[f64; 2]>,
    /// Fit again although the folder holds this very fit.
    pub force: bool,
}

/// One fitted side. Its maps are in the image of the camera that saw this side.
pub struct DomeSideFit {
    /// Which side it is.
    pub side: Side,
    /// 1 good, 0 off the leaf, negative a defect.
    pub status: Vec<i16>,
    /// Thickness (mm) of every texel.
    pub thickness: Vec<f64>,
    /// The mean tissue of each channel.
    pub slab: Rgb<DomeSlabFit>,
    /// σa and σs with their standard errors, a texel and channel; NaN where a texel is not good.
    pub sigma: Vec<Rgb<SigmaEstimate>>,
    /// γ and its standard error.
    pub gamma: Vec<Rgb<[f64; 2]>>,
}

/// Fits the capture into the folder `out`.
///
/// # Errors
/// Unreadable or invalid captures (exit code 2), a folder that cannot be written or holds something else (2).
pub fn run(capture: &Path, out: &Path, options: &Options) -> Result<FitOutcome> {
    let (folder, options) = (capture.to_path_buf(), *options);
    maker::make(FitKind::Leaf, out, &[capture], move |maker| fit(&folder, &options, maker))
}

fn fit(folder: &Path, options: &Options, maker: &mut FitMaker) -> Result<FitOutcome> {
    let step = Instant::now();
    let capture = DomeCapture::open(folder)?;
    let told = format!("{:?}", Options { force: false, ..*options });
    let input = maker::input_hash([("capture", capture.hash()?.as_str()), ("options", &told)]);
    if let Some(found) = maker.up_to_date(input, options.force)? {
        return Ok(found);
    }
    maker.times.capture = Some(capture.folder.display().to_string());
    maker.times.phase("open and hash the capture", step);
    let reduced = maker.phase("reduce to maps", || reduce(&capture, &Reduction::default()))?;
    let [front, back] = maker.phase("slab of every texel and of the leaf", || {
        Ok([Side::Front, Side::Back].map(|side| interior(&capture, &reduced, side)))
    })?;
    let sides = [front?, back?];
    let step = Instant::now();
    let mut record = maker.record(&capture.manifest.name);
    output::write(maker.begin()?, &capture, &reduced, &sides, options, &mut record)?;
    maker.times.phase("blade and maps", step);
    Ok(FitOutcome::Done(maker.finish(record)?))
}

/// σ of the leaf, and σ and γ of every texel, for one side.
fn interior(capture: &DomeCapture, reduced: &DomeMaps, name: Side) -> Result<DomeSideFit> {
    let (side, width) = (&reduced.sides[name], reduced.size.width);
    let own = |map: &[f64]| match name {
        Side::Front => map.to_vec(),
        Side::Back => mesophyll_optics::side::mirror(map, width),
    };
    let (thickness, thickness_err) = (own(&reduced.thickness), own(&reduced.thickness_err));
    let good: Vec<usize> = (0..side.status.len()).filter(|&k| side.status[k] == 1).collect();
    if good.is_empty() {
        let found: Vec<String> = reduced.defects(name).iter().map(|(n, c)| format!("{c} {n}")).collect();
        return Err(Error::input(
            &capture.folder,
            format!("no texel of the {} is good: {}", name.name(), found.join(", ")),
        ));
    }
    let mean = good.iter().map(|&k| thickness[k]).sum::<f64>() / good.len() as f64;
    let shared = DomeSharedErrors { rho_d: side.highlight.stderr, thickness: reduced.alignment.offset_err_mm / mean };
    let texel = |k: usize, c: usize| DomeTexel {
        thickness: thickness[k],
        rho_d: side.albedo[k][c],
        rho_t: side.transmittance[k][c],
        rho_d_err: side.albedo_err[k][c],
        rho_t_err: side.transmittance_err[k][c],
    };
    let slab =
        Rgb::of(|c| slab::fit(&good.iter().map(|&k| texel(k, c)).collect::<Vec<_>>(), shared, ["R", "G", "B"][c]));
    let inverter = SlabInverter::new(Incidence(1.0));
    let unknown = SigmaEstimate { value: [f64::NAN; 2], error: [f64::NAN; 2] };
    let (sigma, gamma) = (0..side.status.len())
        .into_par_iter()
        .map(|k| {
            if side.status[k] != 1 {
                return (Rgb::splat(unknown), Rgb::splat([f64::NAN; 2]));
            }
            // σ is inversely proportional to the thickness, and each texel's thickness has noise of its own.
            let relative = thickness_err[k] / thickness[k];
            let channel = |c: usize| {
                let t = texel(k, c);
                let mut s = inverter.invert(t.rho_d, t.rho_t, t.thickness, [t.rho_d_err, t.rho_t_err]);
                (0..2).for_each(|q| s.error[q] = s.error[q].hypot(s.value[q] * relative));
                let model = mesophyll_optics::slab::response(slab[c].sigma_a[0], slab[c].sigma_s[0], t.thickness).rho_d;
                (s, [t.rho_d / model, t.rho_d_err / model])
            };
            Rgb::of(channel).unzip()
        })
        .unzip();
    Ok(DomeSideFit { side: name, status: side.status.clone(), thickness, slab, sigma, gamma })
}
