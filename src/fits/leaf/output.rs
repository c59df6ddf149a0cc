//! The files that a leaf fit writes: `fit.toml`, the maps of `data/README.md`, W's packed textures, the blade,
//! previews.

use crate::Result;
use crate::leaf::blade::{self, BladeMesh, TexelGrid, glb};
use crate::leaf::defect::OF_SCANS;
use crate::leaf::faults::transmittance;
use crate::leaf::held_out::{self, FrameSplits, HeldOutJudgement};
use crate::leaf::interior::{FittedTexel, LeafSideFit};
use crate::leaf::noise::CameraNoise;
use crate::leaf::truth::TruthComparison;
use crate::leaf::{Options, texels};
use crate::leaf_folder::{BLADE, LeafFitFile, filling, previews};
use crate::record::fault::{FaultGrade, MeasurementFault};
use crate::record::scan::{PASSES, ScanRecord};
use crate::record::{
    DISCARDED, FitParameter, FitRecord, MIRROR, NOISE_SEEN, READINGS, RecordSection, ResidualStatistics,
};
use mesophyll_base::rgb::Rgb;
use mesophyll_capture::inspection::{TubeInspection, mirror};
use mesophyll_capture::reader::TubeCapture;
use mesophyll_files::hash;
use mesophyll_files::image::{ChannelMaps, Packing, write_exr};
use mesophyll_files::quantity::Quantity;
use mesophyll_optics::side::Side;
use std::path::Path;

/// Writes options, gauges and defect names: everything in `fit.toml` that belongs to no single side.
pub fn describe(
    record: &mut FitRecord,
    capture: &TubeCapture,
    options: &Options,
    level: &CameraNoise,
    splits: &FrameSplits,
) {
    let m = &capture.manifest;
    let (lobe, lobe_index) = ScanRecord::name_lobe(options.lobe);
    record.scan = Some(ScanRecord {
        texel_mm: m.texel_mm,
        camera_deg: m.camera_deg,
        lightbox_camera_deg: m.lightbox.camera_deg,
        tube_height_mm: m.tube.height_mm,
        tube_length_mm: m.tube.length_mm,
        tube_radius_mm: m.tube.radius_mm,
        lobe,
        lobe_index,
        noise_relative: level.relative,
        noise_floor: level.floor,
        frames: ScanRecord::count_frames(m),
        hold_out: options.hold_out.every,
        hold_out_seed: options.hold_out.seed,
        stored_step: held_out::stored_step(m.width, m.height, m.passes.len()),
    });
    let mut say = |name: &str, text: String| record.options.insert(name.to_string(), text);
    say("method", options.method.name().into());
    say("lobe", format!("{:?}", options.lobe));
    say("robust", options.robust.to_string());
    say("held_out", held_out::in_words(m, options.hold_out, splits));
    say("gauge", "mean thickness over good texels = thickness_mm; mean gamma = 1 a channel".into());
    say("noise_relative", format!("{:?}{}", level.relative, if level.estimated { " (estimated)" } else { "" }));
    say("noise_floor", format!("{:?}{}", level.floor, if level.estimated { " (estimated)" } else { "" }));
    say("noise_lightbox", format!("{:?} of a frame's (from the empty box)", level.lightbox));
    say("size", format!("{}x{}", m.width, m.height));
    say("texel_mm", format!("{:?}", m.texel_mm));
    say(PASSES, m.passes.iter().map(|p| p.name.name()).collect::<Vec<_>>().join(" "));
    say("lightbox_camera_deg", format!("{:?}", m.lightbox.camera_deg));
    say(
        "filled",
        "where mask.Y is not 1, maps hold the nearest good texel's value so that interpolation at edges stays on the \
         leaf"
            .into(),
    );
    // The mirror strip tells whether the tube's position and the camera's angle are right. Without a strip nothing in
    // the capture can tell.
    let mut looked = TubeInspection::default();
    mirror::look(&capture.folder, m, &mut looked);
    let mirror = if looked.warnings.is_empty() {
        looked.notes.join("; ")
    } else {
        format!("warning: {}", looked.warnings.join("; "))
    };
    // The fit does not record where its capture lay.
    say(MIRROR, mirror.replace(&format!("{}/", capture.folder.display()), ""));
    if let Some(pass) = record.missing_pass() {
        let why = format!("undetermined: pass {} was not taken; maps hold 0, with infinite errors", pass.name());
        record.options.insert(Quantity::Normal.channel(pass as usize), why);
    }
    record.defects = OF_SCANS.iter().map(|d| (d.code().to_string(), d.name().to_string())).collect();
}

/// Reconstructs the blade from both sides' normals (the back's turned into the front's image).
pub fn blade(capture: &TubeCapture, sides: &[LeafSideFit]) -> Option<BladeMesh> {
    let m = &capture.manifest;
    let grid = TexelGrid { width: m.width, height: m.height, texel: m.texel_mm };
    let front = sides.iter().find(|s| s.side == Side::Front)?;
    let mut slopes: Vec<Option<[f64; 2]>> = vec![None; grid.width * grid.height];
    for fitted in sides {
        let Some([x, y, z]) = fitted.maps.three(Quantity::Normal) else { continue };
        for k in fitted.texels.iter().map(|texel| texel.at) {
            let n = [x[k], y[k], z[k]].map(f64::from);
            if !(n[2] > 0.2) {
                continue;
            }
            // Behind the leaf z′ = −z and x′ = −x: dz/dx keeps its sign, dz/dy changes it.
            let slope = match fitted.side {
                Side::Front => [-n[0] / n[2], -n[1] / n[2]],
                Side::Back => [-n[0] / n[2], n[1] / n[2]],
            };
            let at = fitted.side.in_front(k, grid.width);
            slopes[at] = Some(match slopes[at] {
                Some(other) => [0.5 * (other[0] + slope[0]), 0.5 * (other[1] + slope[1])],
                None => slope,
            });
        }
    }
    blade::mesh::build(&grid, &front.measured.mask, Some(&front.measured.rho_t), &slopes)
}

/// Writes one side's maps and adds its section to the record.
pub fn side(
    out: &Path,
    capture: &TubeCapture,
    fitted: &LeafSideFit,
    level: &CameraNoise,
    truth: TruthComparison,
    judged: HeldOutJudgement,
    record: &mut FitRecord,
) -> Result<()> {
    let (values, errors) = maps(fitted, capture);
    write_exr(&LeafFitFile::Maps.path(out, fitted.side), &values, Packing::Zip)?;
    write_exr(&LeafFitFile::Errors.path(out, fitted.side), &errors, Packing::Zip)?;
    // The report compares the σ maps with this truth. It is not part of the fit, so it is not hashed. The truth of an
    // earlier fit does not belong to this one and is removed.
    match &truth.pigment {
        Some(pigment) => write_exr(&LeafFitFile::Truth.path(out, fitted.side), pigment, Packing::Zip)?,
        None => drop(std::fs::remove_file(LeafFitFile::Truth.path(out, fitted.side))),
    }
    previews::write(out, fitted.side, &values)?;
    if let Some(frames) = &judged.stored {
        write_exr(&LeafFitFile::HeldOut.path(out, fitted.side), frames, Packing::Zip)?;
    }
    let section = RecordSection {
        held_out: judged.passes,
        light_box: judged.light_box,
        ..section(capture, fitted, level, truth, &record.faults)
    };
    record.sections.insert(fitted.side.name().into(), section);
    Ok(())
}

/// Writes the blade and the hashes of everything written.
pub fn finish(out: &Path, capture: &TubeCapture, blade: Option<&BladeMesh>, record: &mut FitRecord) -> Result<()> {
    if let Some(blade) = blade {
        glb::write(&out.join(BLADE), &capture.manifest.name, blade)?;
        let mut all = RecordSection::default();
        let mut figure = |name: &str, v: f64| all.figures.insert(name.into(), v);
        figure("blade_area_mm2", blade.area);
        figure("blade_vertices", blade.positions.len() as f64);
        figure("blade_triangles", (blade.indices.len() / 3) as f64);
        figure("blade_slope_residual", blade.slope_residual);
        record.sections.insert("blade".into(), all);
    }
    let mut names = vec![BLADE.to_string()];
    for side in &capture.manifest.sides {
        names.extend(LeafFitFile::ALL.map(|f| f.name(*side)));
    }
    for name in names {
        let path = out.join(&name);
        if path.exists() {
            record.files.insert(name, hash::file(&path)?);
        }
    }
    Ok(())
}

/// The float maps of the contract and their standard errors.
fn maps(fitted: &LeafSideFit, capture: &TubeCapture) -> (ChannelMaps, ChannelMaps) {
    let (width, height) = (capture.manifest.width, capture.manifest.height);
    let n = width * height;
    let good: Vec<bool> = fitted.mask.iter().map(|m| *m == 1).collect();
    let mut values = ChannelMaps::new(width, height);
    let mut errors = ChannelMaps::new(width, height);
    let source = filling::sources(&good, width, height);
    let filled = |mut plane: Vec<f32>| {
        if let Some(source) = &source {
            for k in 0..n {
                plane[k] = plane[source[k] as usize];
            }
        }
        plane
    };
    // Only measured texels have errors: NaN elsewhere.
    let bare = |plane: Vec<f32>| -> Vec<f32> {
        plane.iter().zip(&good).map(|(v, g)| if *g { *v } else { f32::NAN }).collect()
    };
    let scatter = |value: &dyn Fn(&FittedTexel) -> f64| {
        let mut plane = vec![f32::NAN; n];
        for x in &fitted.texels {
            plane[x.at] = value(x) as f32;
        }
        plane
    };
    let mut add = |quantity: Quantity, c: usize, value: Vec<f32>, error: Vec<f32>| {
        values.add(quantity, c, value);
        errors.add(quantity, c, bare(error));
    };
    for quantity in [Quantity::RhoD, Quantity::RhoS, Quantity::M, Quantity::Normal] {
        for c in 0..quantity.letters().len() {
            let value = match quantity {
                Quantity::M => slope(fitted, &good, width, height),
                _ => filled(fitted.maps.plane(quantity, c).unwrap_or_default().to_vec()),
            };
            add(quantity, c, value, texels::error(&fitted.maps, quantity, c).to_vec());
        }
    }
    for c in 0..3 {
        let [rho_t, error] = fitted.rho_t(c);
        add(Quantity::RhoT, c, filled(rho_t), error);
    }
    for (q, quantity) in [Quantity::SigmaA, Quantity::SigmaS].into_iter().enumerate() {
        for c in 0..3 {
            let value = filled(scatter(&|x| x.sigma[c].value[q]));
            add(quantity, c, value, scatter(&|x| x.sigma[c].error[q]));
        }
    }
    let thickness = filled(scatter(&|x| x.interior.thickness));
    add(Quantity::Thickness, 0, thickness, scatter(&|x| x.interior.thickness_err));
    for c in 0..3 {
        let gamma = filled(scatter(&|x| x.interior.gamma[c]));
        add(Quantity::Gamma, c, gamma, scatter(&|x| x.interior.gamma_err[c]));
    }
    values.add(Quantity::Mask, 0, fitted.mask.iter().map(|m| f32::from(*m)).collect());
    let (chi2, freedom) = texels::chi2(&fitted.maps);
    let reduced =
        chi2.iter().zip(freedom).zip(&good).map(|((c, f), g)| if *g && *f > 0.0 { c / f } else { f32::NAN }).collect();
    values.add(Quantity::ReducedChi2, 0, reduced);
    (values, errors)
}

/// The slope m as renderers need it, without holes. A matte texel (ρs = 0, m undetermined with an infinite error) takes
/// the m of the nearest glossy texel. A leaf without any gloss gets a broad lobe of no weight.
fn slope(fitted: &LeafSideFit, good: &[bool], width: usize, height: usize) -> Vec<f32> {
    let mut plane = [fitted.maps.scalar(Quantity::M).unwrap_or_default().to_vec()];
    let known: Vec<bool> = good.iter().zip(&plane[0]).map(|(g, m)| *g && m.is_finite()).collect();
    filling::nearest(&mut plane, &known, width, height);
    plane[0].iter().map(|m| if m.is_finite() && *m > 0.0 { *m } else { 0.5 }).collect()
}

fn section(
    capture: &TubeCapture,
    fitted: &LeafSideFit,
    level: &CameraNoise,
    truth: TruthComparison,
    faults: &[MeasurementFault],
) -> RecordSection {
    let m = &capture.manifest;
    let mut s = RecordSection { figures: fitted.figures.clone(), truth: truth.errors, ..RecordSection::default() };
    s.figures.extend(truth.figures);
    s.figures.extend(level.seen.map(|seen| (NOISE_SEEN.to_string(), seen)));
    s.counts.insert("texels".into(), fitted.mask.len());
    s.counts.insert("outside".into(), fitted.mask.iter().filter(|m| **m == 0).count());
    s.counts.insert("good".into(), fitted.mask.iter().filter(|m| **m == 1).count());
    for d in OF_SCANS {
        s.counts.insert(d.name().into(), fitted.mask.iter().filter(|m| **m == d.code()).count());
    }
    let plane = |quantity| fitted.maps.scalar(quantity).unwrap_or_default();
    let undetermined = plane(Quantity::Undetermined);
    let spoils =
        |quantity: &str| faults.iter().find(|f| f.grade == FaultGrade::Wrong && f.spoils(fitted.side.name(), quantity));
    let undetermined = if spoils(Quantity::RhoS.name()).is_some() {
        fitted.texels.len()
    } else {
        fitted.texels.iter().filter(|x| undetermined[x.at] != 0.0).count()
    };
    s.counts.insert("gloss_undetermined".into(), undetermined);
    let (_, freedom) = texels::chi2(&fitted.maps);
    let discarded = texels::discarded(&fitted.maps);
    let inside = || fitted.measured.mask.iter().enumerate().filter(|(_, m)| **m).map(|(k, _)| k);
    let left_out: f64 = inside().map(|k| f64::from(discarded.get(k).copied().unwrap_or(0.0))).sum();
    let used: f64 = inside().map(|k| f64::from(freedom[k].max(0.0))).sum();
    s.counts.insert(DISCARDED.into(), left_out as usize);
    s.counts.insert(READINGS.into(), (used + left_out) as usize);
    for (code, mask) in plane(Quantity::Termination).iter().zip(&fitted.measured.mask) {
        if *mask {
            *s.terminations.entry(texels::termination_name(*code).into()).or_default() += 1;
        }
    }
    s.terminations.insert(format!("leaf_wide:{}", fitted.termination.name()), 1);
    s.residuals.insert("gloss".into(), gloss_residuals(fitted, m.width));
    let chi2: f64 = fitted.wide.locals.iter().map(|l| l.chi2).sum();
    let worst =
        fitted.wide.locals.iter().enumerate().fold((0, 0.0), |a, (k, l)| if l.chi2 > a.1 { (k, l.chi2) } else { a });
    let at = fitted.texels.get(worst.0).map_or(0, |x| x.at);
    s.residuals.insert(
        "transmittance".into(),
        ResidualStatistics {
            samples: 3 * fitted.texels.len(),
            chi2,
            reduced_chi2: chi2 / (2 * fitted.texels.len()).saturating_sub(6).max(1) as f64,
            rms: fitted.figures.get("transmittance_rms_exact").copied().unwrap_or(f64::NAN),
            worst: worst.1 / 2.0,
            worst_at: [at % m.width, at / m.width],
        },
    );
    let both = |c: usize| [Quantity::SigmaA, Quantity::SigmaS].map(|q| q.channel(c));
    s.correlation_names = (0..3).flat_map(both).collect();
    let c = &fitted.wide.covariance;
    s.correlation = (0..6).map(|i| (0..6).map(|j| c[(i, j)] / (c[(i, i)] * c[(j, j)]).sqrt()).collect()).collect();
    s.condition = Some(fitted.wide.condition);
    s.rank = Some(fitted.wide.rank);
    let err = m.thickness_err_mm;
    let caliper = err.unwrap_or(0.0) / m.thickness_mm;
    let parameter = |quantity: Quantity, value: Rgb, relative: Rgb| {
        let undetermined = (0..3)
            .filter_map(|c| {
                let name = quantity.channel(c);
                if let Some(chi2) = fitted.unexplained {
                    return Some(format!("{name}: the traces' residuals exceed the noise (reduced chi2 {chi2:.0})"));
                }
                if relative[c] <= 0.1 && value[c].is_finite() {
                    return None;
                }
                let bounds = fitted.bounds[c].as_ref().map_or(String::new(), |b| format!("; the mean texel says {b}"));
                Some(format!("{name}: relative standard error {:.2}{bounds}", relative[c]))
            })
            .collect();
        let stderr = value.zip(relative, |v, r| if r.is_finite() { v * r } else { f64::INFINITY });
        let stderr_caliper = if caliper > 0.0 { value.iter().map(|v| v * caliper).collect() } else { Vec::new() };
        FitParameter {
            value: value.to_vec(),
            stderr: stderr.to_vec(),
            stderr_caliper,
            unit: "1/mm".into(),
            undetermined,
        }
    };
    for (quantity, value, relative) in
        [(Quantity::SigmaA, fitted.sigma_a, fitted.sigma_a_rel), (Quantity::SigmaS, fitted.sigma_s, fitted.sigma_s_rel)]
    {
        s.params.insert(quantity.name().into(), parameter(quantity, value, relative));
    }
    transmittance::apply(faults, fitted.side.name(), &mut s);
    s.params.insert(
        Quantity::Thickness.name().into(),
        FitParameter {
            value: vec![m.thickness_mm],
            // An error that is not stated does not make h undetermined: h is the unit in which σ and δ are measured.
            stderr: vec![err.unwrap_or(f64::NAN)],
            stderr_caliper: err.into_iter().collect(),
            unit: "mm".into(),
            undetermined: vec![],
        },
    );
    // Residuals above the noise are no matter of the thickness.
    if fitted.unexplained.is_none() {
        s.state_depths(fitted.side.name(), faults);
    }
    s
}

fn gloss_residuals(fitted: &LeafSideFit, width: usize) -> ResidualStatistics {
    let (chi2, freedom) = texels::chi2(&fitted.maps);
    let mut r = ResidualStatistics::default();
    let mut total = 0.0;
    for k in fitted.texels.iter().map(|x| x.at) {
        let (c, f) = (f64::from(chi2[k]), f64::from(freedom[k]));
        r.chi2 += c;
        total += f;
        if f > 0.0 && c / f > r.worst {
            r.worst = c / f;
            r.worst_at = [k % width, k / width];
        }
    }
    r.samples = total as usize;
    r.reduced_chi2 = r.chi2 / total.max(1.0);
    // The residuals are weighted: they are in units of the stated noise.
    r.rms = r.reduced_chi2.sqrt();
    r
}
