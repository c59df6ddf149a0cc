//! The folder of a leaf fit, from photographs: the same files, channels and sections as from a scan under a tube.

use super::DEFECTS;
use super::PhotoSideFit;
use crate::Result;
use crate::dome::output::judged;
use crate::leaf::blade::{TexelGrid, glb, mesh};
use crate::leaf::faults::thickness;
use crate::leaf::faults::transmittance;
use crate::leaf_folder::{BLADE, LeafFitFile, filling, previews};
use crate::record::{FitParameter, FitRecord, RecordSection, ResidualStatistics};
use mesophyll_base::rgb::Rgb;
use mesophyll_capture::photo::{PhotoManifest, PhotoMaps};
use mesophyll_capture::truth_path;
use mesophyll_files::hash;
use mesophyll_files::image::{ChannelMaps, Packing, read_exr, write_exr};
use mesophyll_files::quantity::Quantity;
use mesophyll_optics::side::{Side, mirror};
use mesophyll_optics::slab::inverse;
use std::path::Path;

/// Writes the maps and the blade and says in the record what they are.
///
/// # Errors
/// Files that cannot be written; a damaged `truth/`.
pub fn write(
    out: &Path,
    folder: &Path,
    manifest: &PhotoManifest,
    reduced: &PhotoMaps,
    sides: &[PhotoSideFit; 2],
    record: &mut FitRecord,
) -> Result<()> {
    describe(manifest, reduced, record);
    // Only one side was seen on the light table, so nothing compares what comes through both ways.
    record.faults = sides.iter().filter_map(|s| transmittance::energy(s.side.name(), &s.status)).collect();
    record.faults.extend(thickness("the stated thickness (mm)", manifest.thickness()[0], &["front", "back"]));
    let grid = TexelGrid { width: reduced.width, height: reduced.height, texel: reduced.texel_mm };
    let mut names = Vec::new();
    for fitted in sides {
        let (values, errors) = maps(manifest, &grid, reduced, fitted);
        write_exr(&LeafFitFile::Maps.path(out, fitted.side), &values, Packing::Zip)?;
        write_exr(&LeafFitFile::Errors.path(out, fitted.side), &errors, Packing::Zip)?;
        previews::write(out, fitted.side, &values)?;
        let mut section = section(manifest, reduced, fitted);
        transmittance::apply(&record.faults, fitted.side.name(), &mut section);
        section.state_depths(fitted.side.name(), &record.faults);
        if let Some(truth) = truth(folder, reduced, fitted.side)? {
            section.truth = judged(&truth, &fitted.status, &values, &errors);
        }
        record.sections.insert(fitted.side.name().into(), section);
        names.extend([LeafFitFile::Maps, LeafFitFile::Errors].map(|f| f.name(fitted.side)));
    }
    // Open shade shows no normals, so the blade is flat.
    let flat = vec![Some([0.0; 2]); grid.width * grid.height];
    let through: Vec<Rgb<f32>> =
        reduced.sides.front.rho_t.iter().map(|t| t.map(|v| if v.is_finite() { v as f32 } else { 1.0 })).collect();
    if let Some(blade) = mesh::build(&grid, &reduced.mask, Some(&through), &flat) {
        glb::write(&out.join(BLADE), &manifest.name, &blade)?;
        let figures = [("blade_area_mm2", blade.area), ("blade_vertices", blade.positions.len() as f64)];
        let figures = figures.map(|(n, v)| (n.to_string(), v)).into_iter().collect();
        record.sections.insert("blade".into(), RecordSection { figures, ..RecordSection::default() });
        names.push(BLADE.into());
    }
    for name in names {
        let path = out.join(&name);
        record.files.insert(name, hash::file(&path)?);
    }
    Ok(())
}

/// Options, gauges, and what this set-up cannot know.
fn describe(manifest: &PhotoManifest, reduced: &PhotoMaps, record: &mut FitRecord) {
    record.defects = DEFECTS.iter().map(|d| (d.code().to_string(), d.name().to_string())).collect();
    let mut say = |name: &str, text: String| record.options.insert(name.into(), text);
    say("capture_kind", "photo".into());
    say("size", format!("{}x{}", reduced.width, reduced.height));
    say("texel_mm", format!("{:?}", reduced.texel_mm));
    say("gauge", "mean thickness over good texels = the stated one; mean gamma = 1 a channel".into());
    let [h, err] = manifest.thickness();
    say("thickness", format!("stated: {h:.4} ± {err:.4} mm ({})", manifest.thickness_source()));
    let gloss = match manifest.gloss {
        Some(g) => format!("stated: index {:?}, slope {:?} (front, back); open shade shows none", g.index, g.slope),
        None => "undetermined: open shade shows none, and none is stated; maps hold none".into(),
    };
    say("gloss", gloss);
    say("normal", "undetermined: light from all sides shows no slopes; maps hold a flat leaf".into());
    say("color", "the channels of the files, white by the grey card; no camera profile was used".into());
    let by = if reduced.scale.by_ticks { "the ruler's ticks" } else { "two marks of the ruler" };
    say(
        "scale",
        format!("{:.6} mm a pixel ± {:.2} % by {by}", reduced.scale.pixel_mm, 100.0 * reduced.scale.relative_err),
    );
    let [r, g, b] = reduced.noise.photon.0;
    let photon = if reduced.noise.stated { format!("{g:.3e}") } else { format!("({r:.3e}, {g:.3e}, {b:.3e})") };
    let measured = if reduced.noise.stated { "" } else { " (red, green, blue; measured on the card)" };
    say(
        "noise",
        format!("variance of the mean of n pixels: ({photon} v + {:.3e})/n{measured}", reduced.noise.read.powi(2)),
    );
    let seen = reduced.sides.iter().filter(|(_, maps)| maps.rho_t_seen).map(|(side, _)| side.name());
    say("rho_t", format!("seen on the light table: {}", seen.collect::<Vec<_>>().join(", ")));
    say("lobe", "Beckmann".into());
    say(
        "filled",
        "where mask.Y is not 1, maps hold the nearest good texel's value so that interpolation at edges stays on the \
         leaf"
            .into(),
    );
}

fn maps(
    manifest: &PhotoManifest,
    grid: &TexelGrid,
    reduced: &PhotoMaps,
    fitted: &PhotoSideFit,
) -> (ChannelMaps, ChannelMaps) {
    let n = grid.width * grid.height;
    let side = &reduced.sides[fitted.side];
    let good: Vec<bool> = fitted.status.iter().map(|s| *s == 1).collect();
    let source = filling::sources(&good, grid.width, grid.height);
    let mut place = vec![0usize; n];
    fitted.at.iter().enumerate().for_each(|(k, &at)| place[at as usize] = k);
    let (mut values, mut errors) =
        (ChannelMaps::new(grid.width, grid.height), ChannelMaps::new(grid.width, grid.height));
    let mut add = |quantity: Quantity, c: usize, value: &dyn Fn(usize) -> f64, error: &dyn Fn(usize) -> f64| {
        // `value` and `error` take a good texel's place among the good ones.
        let from = |k: usize| place[source.as_ref().map_or(k, |s| s[k] as usize)];
        values.add(quantity, c, (0..n).map(|k| value(from(k)) as f32).collect());
        let error = |k: usize| if good[k] { error(place[k]) as f32 } else { f32::NAN };
        errors.add(quantity, c, (0..n).map(error).collect());
    };
    let (texels, locals) = (&fitted.texels, &fitted.wide.locals);
    for c in 0..3 {
        // What all texels share is part of every texel's error.
        let error = |k: usize| {
            let x = &texels[k];
            x.rho_d_err[c].hypot(side.shared[c]).hypot(side.alike * x.rho_d[c])
        };
        add(Quantity::RhoD, c, &|k| texels[k].rho_d[c], &error);
    }
    let s = usize::from(fitted.side == Side::Back);
    let gloss = manifest.gloss.map(|g| (((g.index[s] - 1.0) / (g.index[s] + 1.0)).powi(2), g.slope[s]));
    let (rho_s, m) = gloss.unwrap_or((0.0, 0.5));
    for c in 0..3 {
        add(Quantity::RhoS, c, &|_| rho_s, &|_| f64::INFINITY);
    }
    add(Quantity::M, 0, &|_| m, &|_| f64::INFINITY);
    for (i, value) in [0.0, 0.0, 1.0].into_iter().enumerate() {
        add(Quantity::Normal, i, &|_| value, &|_| f64::INFINITY);
    }
    for c in 0..3 {
        let error = |k: usize| texels[k].rho_t_floor[c].hypot(side.rho_t_shared[c] * texels[k].rho_t[c]);
        add(Quantity::RhoT, c, &|k| texels[k].rho_t[c], &error);
    }
    for (q, quantity) in [Quantity::SigmaA, Quantity::SigmaS].into_iter().enumerate() {
        for c in 0..3 {
            add(quantity, c, &|k| fitted.sigma[k][c].value[q], &|k| fitted.sigma[k][c].error[q]);
        }
    }
    let [h, h_err] = manifest.thickness();
    add(Quantity::Thickness, 0, &|k| locals[k].thickness, &|k| {
        locals[k].thickness_err.hypot(locals[k].thickness * h_err / h)
    });
    for c in 0..3 {
        add(Quantity::Gamma, c, &|k| locals[k].gamma[c], &|k| locals[k].gamma_err[c]);
    }
    values.add(Quantity::Mask, 0, fitted.status.iter().map(|s| f32::from(*s)).collect());
    (values, errors)
}

fn section(manifest: &PhotoManifest, reduced: &PhotoMaps, fitted: &PhotoSideFit) -> RecordSection {
    let mut s = RecordSection::default();
    let count = |code: i16| fitted.status.iter().filter(|v| **v == code).count();
    s.counts.insert("texels".into(), fitted.status.len());
    s.counts.insert("outside".into(), count(0));
    s.counts.insert("good".into(), count(1));
    for defect in DEFECTS {
        s.counts.insert(defect.name().into(), count(defect.code()));
    }
    s.terminations.insert(format!("leaf_wide:{}", fitted.wide.termination.name()), 1);
    let [h, h_err] = manifest.thickness();
    let parameter = |quantity: Quantity, value: Rgb, relative: Rgb| {
        let open = |c: &usize| !(relative[*c] <= inverse::DETERMINED && value[*c].is_finite());
        FitParameter {
            value: value.to_vec(),
            stderr: value.zip(relative, |v, r| if r.is_finite() { v * r } else { f64::INFINITY }).to_vec(),
            stderr_caliper: value.iter().map(|v| v * h_err / h).collect(),
            unit: "1/mm".into(),
            undetermined: (0..3)
                .filter(open)
                .map(|c| format!("{}: relative standard error {:.2}", quantity.channel(c), relative[c]))
                .collect(),
        }
    };
    let wide = &fitted.wide;
    for (quantity, value, relative) in
        [(Quantity::SigmaA, wide.sigma_a, fitted.relative[0]), (Quantity::SigmaS, wide.sigma_s, fitted.relative[1])]
    {
        s.params.insert(quantity.name().into(), parameter(quantity, value, relative));
    }
    let thickness = FitParameter {
        value: vec![h],
        stderr: vec![h_err],
        stderr_caliper: vec![h_err],
        unit: "mm".into(),
        undetermined: Vec::new(),
    };
    s.params.insert(Quantity::Thickness.name().into(), thickness);
    let chi2: f64 = wide.locals.iter().map(|l| l.chi2).sum();
    let (worst, most) =
        wide.locals.iter().enumerate().fold((0, 0.0), |a, (k, l)| if l.chi2 > a.1 { (k, l.chi2) } else { a });
    let at = fitted.at.get(worst).map_or(0, |k| *k as usize);
    let reduced_chi2 = chi2 / (2 * fitted.at.len()).saturating_sub(6).max(1) as f64;
    s.residuals.insert(
        "transmittance".into(),
        ResidualStatistics {
            samples: 3 * fitted.at.len(),
            chi2,
            reduced_chi2,
            rms: reduced_chi2.sqrt(),
            worst: 0.5 * most,
            worst_at: [at % reduced.width, at / reduced.width],
        },
    );
    s.condition = Some(wide.condition);
    s.rank = Some(wide.rank);
    let side = &reduced.sides[fitted.side];
    s.figures = side.figures.iter().map(|(n, v)| (n.to_string(), *v)).collect();
    for (c, letter) in ["R", "G", "B"].into_iter().enumerate() {
        s.figures.insert(format!("rho_d_err_shared.{letter}"), side.shared[c]);
        s.figures.insert(format!("rho_t_relative_err_shared.{letter}"), side.rho_t_shared[c]);
    }
    s
}

/// The true maps of a synthetic capture on the texels of the fit; `None` where there are none. They have the pixels of
/// the front's picture, the back's mirrored.
fn truth(folder: &Path, reduced: &PhotoMaps, side: Side) -> Result<Option<ChannelMaps>> {
    let path = truth_path(folder, side);
    if !path.exists() {
        return Ok(None);
    }
    let pixels = read_exr(&path)?;
    let (w, step) = (pixels.width, reduced.step);
    let mut maps = ChannelMaps::new(reduced.width, reduced.height);
    for (name, plane) in &pixels.channels {
        let mean = |k: usize| {
            let [x, y] = [reduced.origin[0] + k % reduced.width * step, reduced.origin[1] + k / reduced.width * step];
            let mut sum = 0.0;
            for (i, j) in (y..y + step).flat_map(|j| (x..x + step).map(move |i| (i, j))) {
                let column = if side == Side::Back { (w - 1).wrapping_sub(i) } else { i };
                sum += if column < w { plane.get(j * w + column).copied().unwrap_or(0.0) } else { 0.0 };
            }
            sum / (step * step) as f32
        };
        let front: Vec<f32> = (0..reduced.width * reduced.height).map(mean).collect();
        let seen = if side == Side::Back { mirror(&front, reduced.width) } else { front };
        maps.push(name.clone(), seen);
    }
    Ok(Some(maps))
}
