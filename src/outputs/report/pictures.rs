//! A scene that was found in pictures: what it shows, what is left of the readings, and how the search went.

use crate::chart::{self, AxisTitles, ChartSeries};
use crate::maps::ReportSideMaps;
use crate::model::SidePictures;
use crate::size::ReportDetail;
use crate::translucency::{gain, photograph, tile};
use mesophyll_files::image::read_exr;
use mesophyll_fits::record::{FitKind, FitRecord};
use std::collections::BTreeMap;
use std::path::Path;

/// Standard errors at the ends of the scale, as in the PNG files of the fit's folder.
const SCALE: f64 = 4.0;

/// For each picture, what the scene shows of it and the residuals of its channels. What is missing or unreadable is
/// described in `missing`.
pub fn residuals(
    folder: &Path,
    record: &FitRecord,
    detail: ReportDetail,
    missing: &mut Vec<String>,
) -> Vec<SidePictures> {
    let names = record.files.keys().filter(|_| record.kind == FitKind::Scene);
    let views = names.filter_map(|name| Some((name, name.strip_prefix("residual-")?.strip_suffix(".exr")?)));
    let mut out = Vec::new();
    for (file, view) in views {
        let maps = match read_exr(&folder.join(file)) {
            Ok(maps) => maps,
            Err(e) => {
                missing.push(format!("{e}; so no residuals of {view}"));
                continue;
            }
        };
        let plane = |name: &str| maps.channels.iter().find(|(own, _)| own == name).map(|(_, plane)| plane.clone());
        let all = ["R", "G", "B", "residual.R", "residual.G", "residual.B"].map(plane);
        let [Some(r), Some(g), Some(b), Some(of_r), Some(of_g), Some(of_b)] = all else {
            missing.push(format!(
                "{file}: found other channels than R, G, B and residual.R, …; so no residuals of {view}"
            ));
            continue;
        };
        let good = of_g.iter().map(|v| v.is_finite()).collect();
        let side = ReportSideMaps {
            section: view.into(),
            fit: maps,
            errors: None,
            truth: None,
            good,
            notes: BTreeMap::new(),
            texel_mm: None,
            detail,
            unjudged: None,
        };
        let rgb = [r.as_slice(), &g, &b];
        let shown = photograph(&side, rgb, gain(&side, &rgb), format!("{view}: what the scene shows"));
        let range = (-SCALE, SCALE);
        let of = |(plane, channel): (&[f32], &str)| {
            let caption = format!("{view}: reading less scene, {channel}");
            tile(&side, plane, range, true, "standard errors", caption)
        };
        let left = [(&of_r[..], "red"), (&of_g, "green"), (&of_b, "blue")].into_iter().filter_map(of);
        out.push(SidePictures {
            section: view.into(),
            looks: shown.into_iter().chain(left).collect(),
            ..SidePictures::default()
        });
    }
    out
}

/// The steps of `trace.csv`: processor time (s), how far the numbers were from the result, and their standard error.
/// Empty where there is no such table.
pub fn steps(folder: &Path, record: &FitRecord) -> Vec<[f64; 3]> {
    let text = match record.kind {
        FitKind::Scene => std::fs::read_to_string(folder.join("trace.csv")).unwrap_or_default(),
        _ => return Vec::new(),
    };
    let mut lines = text.lines();
    let head: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
    let places = ["processor_s", "distance", "standard_error"].map(|name| head.iter().position(|h| *h == name));
    let row = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        let number = |place: Option<usize>| cells.get(place?)?.parse::<f64>().ok();
        Some([number(places[0])?, number(places[1])?, number(places[2])?])
    };
    lines.filter_map(row).collect()
}

/// The steps as a chart.
pub fn chart(name: &str, steps: &[[f64; 3]]) -> Option<String> {
    let of = |name: &str, k: usize| ChartSeries {
        name: name.into(),
        points: steps.iter().map(|row| (row[0], row[k])).filter(|(x, y)| *x > 0.0 && *y > 0.0).collect(),
    };
    let series = [of("distance from the result", 1), of("standard error", 2)];
    let about = format!("Error of {name} against processor time");
    chart::log_log(&series, AxisTitles { x: "processor time (s)", y: "error, rms of all numbers", about: &about })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ReportSource, to_json, write_html};
    use mesophyll_files::hash;
    use mesophyll_files::image::{ChannelMaps, Packing, write_exr};

    /// A fit of a scene with one picture whose right half is too bright, and two steps.
    #[test]
    fn residuals_and_steps_are_shown() {
        let dir = tempfile::tempdir().unwrap();
        let mut maps = ChannelMaps::new(4, 2);
        for name in ["R", "G", "B", "residual.R", "residual.G", "residual.B"] {
            let side = if name.len() > 1 { -3.0 } else { 0.5 };
            maps.push(name, (0..8).map(|k| if k % 4 > 1 { side } else { 0.25 }).collect());
        }
        write_exr(&dir.path().join("residual-across.exr"), &maps, Packing::Zip).unwrap();
        let head =
            "step,seconds,processor_s,paths,half_chi2,reduced_chi2,step_in_standard_errors,distance,standard_error";
        let rows = "1,1,1.5,16,90,3,9,0.2,0.05\n2,2,3.5,64,30,1,1,0.01,0.01\n";
        std::fs::write(dir.path().join("trace.csv"), format!("{head}\n{rows}")).unwrap();
        let mut record = FitRecord::new(FitKind::Scene, "few", "hash".into());
        let file = "residual-across.exr";
        record.files.insert(file.into(), hash::file(&dir.path().join(file)).unwrap());
        record.write(dir.path()).unwrap();
        let source = [ReportSource::folder(dir.path())];
        let rows = to_json(&source).unwrap();
        assert_eq!(rows["fits"][0]["steps"][1], serde_json::json!([3.5, 0.01, 0.01]));
        let page = dir.path().join("report.html");
        write_html(&source, &page).unwrap();
        let text = std::fs::read_to_string(page).unwrap();
        for part in ["across: what the scene shows", "across: reading less scene, blue", "Error against processor time"]
        {
            assert!(text.contains(part), "{part}");
        }
    }
}
