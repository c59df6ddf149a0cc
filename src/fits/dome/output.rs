//! The folder of a leaf fit, from a capture under a dome: the same files, channels and sections as from a scan under a
//! tube.

use super::{DomeSideFit, Options};
use crate::Result;
use crate::leaf::blade::{BladeMesh, TexelGrid, glb, mesh};
use crate::leaf::faults::thickness;
use crate::leaf::faults::transmittance::{self, TransmittanceView};
use crate::leaf_folder::{BLADE, LeafFitFile, filling, previews};
use crate::record::fault::MeasurementFault;
use crate::record::{FitParameter, FitRecord, RecordSection, TruthError};
use mesophyll_base::rgb::Rgb;
use mesophyll_base::statistics::{median, upper_quantile};
use mesophyll_capture::dome::DomeCapture;
use mesophyll_capture::dome::highlight::fresnel_normal;
use mesophyll_capture::dome::reduction::DEFECTS;
use mesophyll_capture::dome::reduction::DomeMaps;
use mesophyll_files::hash;
use mesophyll_files::image::{ChannelMaps, Packing, write_exr};
use mesophyll_files::quantity::Quantity;
use mesophyll_optics::side::Side;
use std::collections::BTreeMap;
use std::path::Path;

/// Writes the maps and the blade and says in the record what they are.
///
/// # Errors
/// Files that cannot be written; a damaged `truth/`.
pub fn write(
    out: &Path,
    capture: &DomeCapture,
    reduced: &DomeMaps,
    sides: &[DomeSideFit; 2],
    options: &Options,
    record: &mut FitRecord,
) -> Result<()> {
    let m = &capture.manifest;
    let grid = TexelGrid { width: m.width, height: m.height, texel: m.texel_mm };
    record.defects = DEFECTS.iter().map(|d| (d.code().to_string(), d.name().to_string())).collect();
    let mut say = |name: &str, text: String| record.options.insert(name.into(), text);
    say("capture_kind", "dome".into());
    say("size", format!("{}x{}", m.width, m.height));
    say("texel_mm", format!("{:?}", m.texel_mm));
    say("gauge", "thickness as measured, its highest place the caliper's; mean gamma = 1 a channel".into());
    say(
        "gloss",
        options.gloss.map_or("none: a dome shows none".into(), |[n, s]| format!("stated: index {n}, slope {s}")),
    );
    say(
        "noise_relative",
        format!("{:?}{}", reduced.noise.relative, if reduced.noise.stated { "" } else { " (estimated)" }),
    );
    say("noise_floor", format!("{:?}{}", reduced.noise.floor, if reduced.noise.stated { "" } else { " (estimated)" }));
    say("smooth_thickness_mm", format!("{:?}", reduced.alignment.smooth_thickness_mm));
    say("smooth_height_mm", format!("{:?}", reduced.alignment.smooth_height_mm));
    say("lobe", "Beckmann".into());
    record.faults = faults(reduced, sides, m.width);

    let blade = blade(&grid, reduced);
    let mut names = Vec::new();
    for fitted in sides {
        let (values, errors) = maps(&grid, reduced, fitted, options);
        write_exr(&LeafFitFile::Maps.path(out, fitted.side), &values, Packing::Zip)?;
        write_exr(&LeafFitFile::Errors.path(out, fitted.side), &errors, Packing::Zip)?;
        previews::write(out, fitted.side, &values)?;
        let mut section = section(reduced, fitted);
        transmittance::apply(&record.faults, fitted.side.name(), &mut section);
        section.state_depths(fitted.side.name(), &record.faults);
        section.truth = truth(capture, fitted, &values, &errors)?;
        record.sections.insert(fitted.side.name().into(), section);
        names.extend([LeafFitFile::Maps, LeafFitFile::Errors].map(|f| f.path(Path::new(""), fitted.side)));
    }
    if let Some(blade) = &blade {
        glb::write(&out.join(BLADE), &m.name, blade)?;
        let figures = [
            ("blade_area_mm2", blade.area),
            ("blade_vertices", blade.positions.len() as f64),
            ("blade_slope_residual", blade.slope_residual),
        ];
        let figures = figures.map(|(n, v)| (n.to_string(), v)).into_iter().collect();
        record.sections.insert("blade".into(), RecordSection { figures, ..RecordSection::default() });
        names.push(BLADE.into());
    }
    for name in names {
        let path = out.join(&name);
        record.files.insert(name.to_string_lossy().into_owned(), hash::file(&path)?);
    }
    Ok(())
}

/// Faults that the photographs and the scans show of themselves.
fn faults(reduced: &DomeMaps, sides: &[DomeSideFit; 2], width: usize) -> Vec<MeasurementFault> {
    let single = |side: Side| -> Vec<Rgb<f32>> {
        reduced.sides[side].transmittance.iter().map(|t| t.map(|v| v as f32)).collect()
    };
    let on = |fitted: &DomeSideFit| -> Vec<bool> { fitted.status.iter().map(|s| *s != 0).collect() };
    let (front, back) = ((on(&sides[0]), single(Side::Front)), (on(&sides[1]), single(Side::Back)));
    let mut out: Vec<MeasurementFault> = transmittance::turned(
        &TransmittanceView::from(&front),
        &TransmittanceView::from(&back),
        width,
        "back/translucency.exr",
    )
    .into_iter()
    .collect();
    out.extend(sides.iter().filter_map(|s| transmittance::energy(s.side.name(), &s.status)));
    out.extend(thickness("the mean thickness by both height scans", mean(&sides[0]), &["front", "back"]));
    out
}

/// Mean thickness of the good texels (mm).
fn mean(fitted: &DomeSideFit) -> f64 {
    let (sum, count) = fitted
        .status
        .iter()
        .zip(&fitted.thickness)
        .filter(|(s, _)| **s == 1)
        .fold((0.0, 0usize), |(s, n), (_, d)| (s + d, n + 1));
    sum / count.max(1) as f64
}

/// The blade's mesh halfway between both sides, from the normals of the front.
fn blade(grid: &TexelGrid, reduced: &DomeMaps) -> Option<BladeMesh> {
    let side = &reduced.sides.front;
    let slopes: Vec<Option<[f64; 2]>> = side
        .normal
        .iter()
        .zip(&side.status)
        .map(|(n, status)| (*status == 1 && n[2] > 0.2).then(|| [-n[0] / n[2], -n[1] / n[2]]))
        .collect();
    let through: Vec<Rgb<f32>> =
        side.transmittance.iter().map(|t| t.map(|v| if v.is_finite() { v as f32 } else { 1.0 })).collect();
    mesh::build(grid, &reduced.mask, Some(&through), &slopes)
}

fn maps(grid: &TexelGrid, reduced: &DomeMaps, fitted: &DomeSideFit, options: &Options) -> (ChannelMaps, ChannelMaps) {
    let (width, height) = (grid.width, grid.height);
    let side = &reduced.sides[fitted.side];
    let which = usize::from(fitted.side == Side::Back);
    let slope_err = reduced.alignment.slope_error[which];
    let good: Vec<bool> = fitted.status.iter().map(|s| *s == 1).collect();
    let source = filling::sources(&good, width, height);
    let (mut values, mut errors) = (ChannelMaps::new(width, height), ChannelMaps::new(width, height));
    let mut add = |quantity: Quantity, c: usize, value: &dyn Fn(usize) -> f64, error: &dyn Fn(usize) -> f64| {
        let from = |k: usize| source.as_ref().map_or(k, |s| s[k] as usize);
        values.add(quantity, c, (0..good.len()).map(|k| value(from(k)) as f32).collect());
        errors.add(quantity, c, (0..good.len()).map(|k| if good[k] { error(k) as f32 } else { f32::NAN }).collect());
    };
    // Two errors are shared by all texels and so are part of every texel's error: that of the highlight which was
    // subtracted, and that of the caliper's zero.
    let common = side.highlight.stderr;
    let thickness_err = reduced.alignment.thickness_error_mm.hypot(reduced.alignment.offset_err_mm);
    for c in 0..3 {
        add(Quantity::RhoD, c, &|k| side.albedo[k][c].max(0.0), &|k| side.albedo_err[k][c].hypot(common));
    }
    let [rho_s, slope] = options.gloss.map_or([0.0, 0.5], |[n, slope]| [fresnel_normal(n), slope]);
    for c in 0..3 {
        add(Quantity::RhoS, c, &|_| rho_s, &|_| f64::INFINITY);
    }
    add(Quantity::M, 0, &|_| slope, &|_| f64::INFINITY);
    for i in 0..3 {
        add(Quantity::Normal, i, &|k| side.normal[k][i], &|_| slope_err);
    }
    for c in 0..3 {
        add(Quantity::RhoT, c, &|k| side.transmittance[k][c], &|k| side.transmittance_err[k][c]);
    }
    for (q, quantity) in [Quantity::SigmaA, Quantity::SigmaS].into_iter().enumerate() {
        for c in 0..3 {
            add(quantity, c, &|k| fitted.sigma[k][c].value[q], &|k| fitted.sigma[k][c].error[q]);
        }
    }
    add(Quantity::Thickness, 0, &|k| fitted.thickness[k], &|_| thickness_err);
    for c in 0..3 {
        add(Quantity::Gamma, c, &|k| fitted.gamma[k][c][0], &|k| fitted.gamma[k][c][1]);
    }
    values.add(Quantity::Mask, 0, fitted.status.iter().map(|s| f32::from(*s)).collect());
    (values, errors)
}

fn section(reduced: &DomeMaps, fitted: &DomeSideFit) -> RecordSection {
    let mut s = RecordSection::default();
    s.counts.insert("texels".into(), fitted.status.len());
    s.counts.insert("outside".into(), fitted.status.iter().filter(|v| **v == 0).count());
    s.counts.insert("good".into(), fitted.status.iter().filter(|v| **v == 1).count());
    for (name, count) in reduced.defects(fitted.side) {
        s.counts.insert(name.into(), count);
    }
    let parameter = |of: &dyn Fn(usize) -> [f64; 2], name: &str| FitParameter {
        value: (0..3).map(|c| of(c)[0]).collect(),
        stderr: (0..3).map(|c| of(c)[1]).collect(),
        unit: "1/mm".into(),
        undetermined: fitted
            .slab
            .iter()
            .flat_map(|s| s.undetermined.iter())
            .filter(|u| u.starts_with(name))
            .cloned()
            .collect(),
        ..FitParameter::default()
    };
    s.params.insert("sigma_a".into(), parameter(&|c| fitted.slab[c].sigma_a, "sigma_a"));
    s.params.insert("sigma_s".into(), parameter(&|c| fitted.slab[c].sigma_s, "sigma_s"));
    let thickness = FitParameter {
        value: vec![mean(fitted)],
        stderr: vec![reduced.alignment.offset_err_mm],
        unit: "mm".into(),
        ..FitParameter::default()
    };
    s.params.insert("thickness".into(), thickness);
    let side = &reduced.sides[fitted.side];
    let a = &reduced.alignment;
    let which = usize::from(fitted.side == Side::Back);
    let figures = [
        ("highlight_share", side.highlight.share),
        ("highlight_stderr", side.highlight.stderr),
        ("height_noise_mm", a.height_noise_mm),
        ("thickness_noise_mm", a.thickness_noise_mm),
        ("thickness_error_mm", a.thickness_error_mm),
        ("slope_noise", a.slope_noise[which]),
        ("slope_error", a.slope_error[which]),
        ("scans_tilt_x", a.tilt[0]),
        ("scans_tilt_y", a.tilt[1]),
    ];
    s.figures = figures.map(|(n, v)| (n.to_string(), v)).into_iter().collect();
    s
}

/// Errors to the truth of a synthetic capture, by quantity, over the good texels.
fn truth(
    capture: &DomeCapture,
    fitted: &DomeSideFit,
    values: &ChannelMaps,
    errors: &ChannelMaps,
) -> Result<BTreeMap<String, TruthError>> {
    let truth = capture.truth(fitted.side)?;
    Ok(truth.map(|truth| judged(&truth, &fitted.status, values, errors)).unwrap_or_default())
}

/// The same from the true maps and the status of every texel.
pub fn judged(
    truth: &ChannelMaps,
    status: &[i16],
    values: &ChannelMaps,
    errors: &ChannelMaps,
) -> BTreeMap<String, TruthError> {
    let mut out = BTreeMap::new();
    // The camera saw light that had scattered sideways through neighbouring texels. The fit is compared with what was
    // measured, not with the slab of each texel alone.
    let pairs = [
        (Quantity::RhoD, Quantity::RhoD),
        (Quantity::RhoT, Quantity::Transmittance),
        (Quantity::Thickness, Quantity::Thickness),
    ];
    for (quantity, of) in pairs {
        let (mut relative, mut inside, mut judged) = (Vec::new(), 0usize, 0usize);
        for c in 0..quantity.letters().len() {
            let (Some(t), Some(v), Some(e)) =
                (truth.plane(of, c), values.plane(quantity, c), errors.plane(quantity, c))
            else {
                continue;
            };
            for k in (0..t.len()).filter(|&k| status[k] == 1 && t[k] != 0.0) {
                let (t, v, e) = (f64::from(t[k]), f64::from(v[k]), f64::from(e[k]));
                relative.push((v / t - 1.0).abs());
                judged += 1;
                inside += usize::from((v - t).abs() <= 1.96 * e + 2.4e-7 * t.abs());
            }
        }
        if let (Some(median_relative), Some(p99_relative)) =
            (median(&mut relative), upper_quantile(&mut relative, 99, 100))
        {
            let coverage95 = Some(inside as f64 / judged as f64);
            out.insert(
                quantity.name().into(),
                TruthError { median_relative, p99_relative, coverage95, judged: Some(judged) },
            );
        }
    }
    out
}
