//! Views of kind `capture`: renderer and reference draw a leaf as its scan saw it, and both are compared with frames
//! that the fit did not see.
//!
//! The gloss is drawn as it was fitted (Wang et al. 2005, Eq. 7). In scenes both renderers bound it by a V-cavity
//! factor that the fit does not have; the effect of that is measured with the same frame and printed as well.
//!
//! **The rule.** Residuals are in units of the measurement's noise, or of half a percent of the value where the noise
//! is smaller, because no picture has to be more accurate. A picture that is off by e of these units raises the mean
//! square of its residuals by e². Half a unit is allowed (unless a view's `max_error` says otherwise), in addition to
//! two standard errors of chance and to what a right fit leaves. The tube model's own prediction from the folder's maps
//! must be within one unit, and so must the light box's transmittance by the slab of σa, σs and h + δ.

use crate::{Options, told};
use mesophyll_base::error::{Error, Result};
use mesophyll_files::image::{to_srgb8, write_png};
use mesophyll_fits::leaf::held_out::{self, BAD, ResidualTally, StoredFrame, StoredFrames};
use mesophyll_fits::leaf_folder::LeafFitFile;
use mesophyll_fits::record::scan::ScanRecord;
use mesophyll_optics::side::Side;
use mesophyll_scene::draw::scan::ScanSide;
use mesophyll_scene::loaded::LoadedScene;
use mesophyll_scene::manifest::CaptureView;
use mesophyll_scene::verdict::{CaptureComparison, CaptureFigures, exceeds};
use mesophyll_transport as transport;
use mesophyll_viewer as gpu;

/// Pictures need not be more accurate than this share of a value.
const PICTURE: f64 = 0.005;
/// The error of a picture that is allowed where the view does not state one.
const ALLOWED: f64 = 0.5;

/// Draws and judges every capture view of the scene, and one frame for each side of every other fit that stores frames.
/// Sentences say what was skipped.
pub fn all(
    scene: &LoadedScene,
    renderer: &mut gpu::Renderer,
    options: &Options,
) -> Result<(Vec<CaptureFigures>, Vec<String>)> {
    let (mut out, mut skipped) = (Vec::new(), Vec::new());
    let manifest = &scene.manifest;
    for leaf in scene.leaves() {
        let name = &leaf.config.name;
        let Some(fitted) = &leaf.placed.fitted else { continue };
        for side in Side::ALL {
            let own = || manifest.captures().filter(|v| v.leaf == *name && v.side == side);
            let Some(kept) = held_out::kept(&fitted.folder, &fitted.record, side)? else {
                skipped.extend(own().map(|v| {
                    format!(
                        "view {} was skipped: the capture of {name} is not there, its fit keeps no held-out frame of \
                         the {}",
                        v.name,
                        side.name()
                    )
                }));
                continue;
            };
            let scanned = ScanSide::new(fitted, side)?;
            let changed =
                [LeafFitFile::Maps, LeafFitFile::HeldOut].into_iter().find_map(|f| fitted.verify(&f.name(side)).err());
            let mut wanted: Vec<(String, &StoredFrame, f64)> = Vec::new();
            for view in own() {
                match chosen(&kept, view) {
                    Some(frame) => wanted.push((view.name.clone(), frame, view.max_error.unwrap_or(ALLOWED))),
                    None => {
                        let list: Vec<String> = kept.frames.iter().map(StoredFrame::name).collect();
                        let what = format!("no such held-out frame; the fit keeps {}", list.join(", "));
                        return Err(Error::field(&manifest.path, &format!("view \"{}\"", view.name), what));
                    }
                }
            }
            if own().next().is_none() {
                wanted.extend(brightest(&kept).map(|frame| (format!("{name}-{}-scan", side.name()), frame, ALLOWED)));
            }
            for (name, frame, allowed) in wanted {
                let mut report = one(&scanned, &kept, frame, name, allowed, renderer, options)?;
                report.why.extend(changed.iter().map(ToString::to_string));
                report.passed = report.why.is_empty();
                out.push(report);
            }
        }
    }
    Ok((out, skipped))
}

/// The frame that a view asks for; where it leaves something open, the brightest of the frames that match.
fn chosen<'a>(kept: &'a StoredFrames, view: &CaptureView) -> Option<&'a StoredFrame> {
    let fits = |f: &&StoredFrame| view.pass.is_none_or(|p| p == f.travel) && view.frame.is_none_or(|k| k == f.frame);
    kept.frames.iter().filter(fits).max_by(|a, b| light(a).total_cmp(&light(b)))
}

fn brightest(kept: &StoredFrames) -> Option<&StoredFrame> {
    kept.frames.iter().max_by(|a, b| light(a).total_cmp(&light(b)))
}

fn light(frame: &StoredFrame) -> f64 {
    frame.measured[1].iter().filter(|v| v.is_finite()).map(|v| f64::from(*v)).sum()
}

fn one(
    scanned: &ScanSide,
    kept: &StoredFrames,
    frame: &StoredFrame,
    name: String,
    allowed: f64,
    renderer: &mut gpu::Renderer,
    options: &Options,
) -> Result<CaptureFigures> {
    let (width, height) = (scanned.width as u32, scanned.height as u32);
    let mut scene = scanned.scene(frame, false)?;
    renderer.set_scene(&scene).map_err(told)?;
    let picture = renderer.scan(width, height).map_err(told)?;
    scene.scanner.iter_mut().for_each(|s| s.bounded = true);
    renderer.set_lights(&scene).map_err(told)?;
    let with_cavity = renderer.scan(width, height).map_err(told)?;
    let world = scanned.world(frame)?;
    let texels: Vec<usize> = (0..kept.width * kept.height).map(|k| kept.texel(k, scanned.width)).collect();
    let mut wanted = vec![false; scanned.width * scanned.height];
    (0..texels.len()).filter(|k| frame.predicted[1][*k].is_finite()).for_each(|k| wanted[texels[k]] = true);
    let truth = transport::ReferenceRenderer::new(&world)?.scan(scanned.width, scanned.height, |k| wanted[k])?;
    let drawn = |k: usize| [0, 1, 2].map(|c: usize| f64::from(picture.hdr[texels[k]][c]));
    let exact = |k: usize| truth[texels[k]];
    let (by_renderer, expected, z) = compare(scanned.scan, frame, drawn);
    let (by_reference, _, _) = compare(scanned.scan, frame, exact);
    let (bounded, _, _) =
        compare(scanned.scan, frame, |k| [0, 1, 2].map(|c: usize| f64::from(with_cavity.hdr[texels[k]][c])));
    let mut out = CaptureFigures {
        name,
        leaf: scanned.fitted.name.clone(),
        side: scanned.side.name().into(),
        pass: frame.travel.name().into(),
        frame: frame.frame,
        readings: frame.readings,
        expected,
        allowed,
        renderer: by_renderer,
        reference: by_reference,
        bounded,
        model_off: frame.off(),
        light_box_off: kept.light_box.as_ref().map(|l| l.off()),
        measured_image: None,
        image: None,
        reference_image: None,
        residual_image: None,
        passed: false,
        why: Vec::new(),
    };
    judge(&mut out);
    draw(&mut out, kept, frame, options, &drawn, &exact, &z)?;
    Ok(out)
}

/// A picture against a frame: figures, the expectation, and the green residuals.
fn compare(
    scan: &ScanRecord,
    frame: &StoredFrame,
    drawn: impl Fn(usize) -> [f64; 3],
) -> (CaptureComparison, f64, Vec<f32>) {
    let (mut tally, mut model, mut most, mut share) = (ResidualTally::default(), 0.0, 0f64, 0.0);
    let mut green = vec![f32::NAN; frame.predicted[1].len()];
    for k in (0..green.len()).filter(|k| frame.predicted[1][*k].is_finite()) {
        let value = drawn(k);
        let unit = value.map(|v| scan.noise(v).max(PICTURE * v));
        let z = [0, 1, 2].map(|c: usize| (f64::from(frame.measured[c][k]) - value[c]) / unit[c]);
        tally.add(z.into_iter(), k);
        green[k] = z[1] as f32;
        for c in 0..3 {
            let d = (value[c] - f64::from(frame.predicted[c][k])) / unit[c];
            model += d * d;
            // A picture with a value that is not a number counts as infinitely far off.
            most = if d.is_nan() { f64::INFINITY } else { most.max(d.abs()) };
            share += (scan.noise(value[c]) / unit[c]).powi(2);
        }
    }
    let n = 3.0 * green.iter().filter(|z| !z.is_nan()).count() as f64;
    let expected = frame.expected * share / n;
    let excess = tally.reduced_chi2() - 2.0 * tally.stderr() - expected;
    let out = CaptureComparison {
        reduced_chi2: tally.reduced_chi2(),
        off: if excess.is_nan() { f64::INFINITY } else { excess.max(0.0).sqrt() },
        share_beyond_3: tally.share_beyond_3(),
        bias: tally.bias(),
        from_model: (model / n).sqrt(),
        from_model_most: most,
    };
    (out, expected, green)
}

fn judge(out: &mut CaptureFigures) {
    for (who, drawn) in [("the renderer's picture", out.renderer), ("the reference's picture", out.reference)] {
        if exceeds(drawn.off, out.allowed) {
            out.why.push(format!(
                "{who} is off by {:.2} of the measurement's noise, at most {:.2} allowed (reduced χ² {:.3}, {:.3} \
                 expected)",
                drawn.off, out.allowed, drawn.reduced_chi2, out.expected
            ));
        }
    }
    if exceeds(out.model_off, BAD) {
        out.why.push(format!(
            "the fit's maps predict this frame off by {:.2} of its noise, at most {BAD:.2} allowed",
            out.model_off
        ));
    }
    if let Some(off) = out.light_box_off.filter(|o| exceeds(*o, BAD)) {
        out.why.push(format!("σa, σs and h + δ miss the light box by {off:.2} of its noise, at most {BAD:.2} allowed"));
    }
    if out.readings == 0 {
        out.why.push("nothing was compared: no texel of the frame is good".into());
    }
}

fn draw(
    out: &mut CaptureFigures,
    kept: &StoredFrames,
    frame: &StoredFrame,
    options: &Options,
    drawn: &dyn Fn(usize) -> [f64; 3],
    exact: &dyn Fn(usize) -> [f64; 3],
    z: &[f32],
) -> Result<()> {
    let brightest = frame.measured.iter().flatten().copied().filter(|v| v.is_finite()).fold(0f32, f32::max).max(1e-6);
    let gain = 0.9 / brightest;
    let save = |what: &str, pixel: &dyn Fn(usize) -> [u8; 3]| -> Result<Option<String>> {
        let shown = |k: usize| {
            if z[k].is_nan() {
                [0; 4]
            } else {
                let [r, g, b] = pixel(k);
                [r, g, b, 255]
            }
        };
        let bytes: Vec<u8> = (0..z.len()).flat_map(shown).collect();
        let file = if what.is_empty() { format!("{}.png", out.name) } else { format!("{}-{what}.png", out.name) };
        write_png(&options.out.join(&file), kept.width, kept.height, &bytes)?;
        Ok(Some(file))
    };
    let colour = |v: [f64; 3]| v.map(|x| to_srgb8(x as f32 * gain));
    let measured = save("measured", &|k| [0, 1, 2].map(|c: usize| to_srgb8(frame.measured[c][k] * gain)))?;
    let image = save("", &|k| colour(drawn(k)))?;
    let reference = save("reference", &|k| colour(exact(k)))?;
    let residual = save("residual", &|k| {
        let t = f64::from(z[k] / 4.0).clamp(-1.0, 1.0);
        let fade = (255.0 * (1.0 - t.abs())) as u8;
        if t > 0.0 { [255, fade, fade] } else { [fade, fade, 255] }
    })?;
    (out.measured_image, out.image, out.reference_image, out.residual_image) = (measured, image, reference, residual);
    Ok(())
}
