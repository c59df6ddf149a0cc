//! The report in a browser: zoom, pan, wipe, values under the pointer, keyboard and print. `look_closer.js` does what a
//! reader does, in Chromium without a display, and what it saw is judged here.

use crate::programs::shown;
use crate::samples::{Sample, write_fit, write_run};
use mesophyll::files::image::{self, ChannelMaps};
use serde_json::Value;
use std::path::Path;
use std::process::Command;

const SCRIPT: &str = include_str!("look_closer.js");

fn report(folder: &Path, words: &[&str]) -> String {
    let args = [&["report", "--quiet", "-o", "r.html"], words].concat();
    let out = Command::new(env!("CARGO_BIN_EXE_mesophyll")).args(args).current_dir(folder).output().unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    std::fs::read_to_string(folder.join("r.html")).unwrap()
}

/// What the script saw on a page; `None` where there is no Chromium.
fn seen(folder: &Path, page: &str) -> Option<Value> {
    let text = shown(folder, &page.replace("</body>", &format!("<script>{SCRIPT}</script></body>")))?;
    Some(serde_json::from_slice(&text).unwrap())
}

/// The share of the picture at the view's left edge, and the zoom, of `translate(-10%, 0%) scale(1.5)`.
fn view(transform: &Value) -> (f64, f64) {
    let text = transform.as_str().unwrap_or_else(|| panic!("{transform}"));
    let after = |name: &str| text.split_once(name).unwrap_or_else(|| panic!("{text}")).1;
    let number = |text: &str| text.split(['%', ')', ',']).next().unwrap().parse::<f64>().unwrap();
    (number(after("translate(")) / 100.0, number(after("scale(")))
}

/// The value in a map's file that a picture named `side quantity channel: what` must show.
fn expected(label: &str, maps: &[(&str, ChannelMaps, ChannelMaps)], k: usize) -> Option<f64> {
    let names = [
        ("ρd green", "rho_d.G"),
        ("ρt green", "rho_t.G"),
        ("ρs green", "rho_s.G"),
        ("m", "m.Y"),
        ("h + δ", "thickness.Y"),
        ("γ green", "gamma.G"),
        ("σa green", "sigma_a.G"),
        ("σs green", "sigma_s.G"),
    ];
    // On the page, `h + δ` holds together by spaces that do not break.
    let label = label.replace('\u{a0}', " ");
    let (what, kind) = label.rsplit_once(": ")?;
    let (side, quantity) = what.split_once(' ')?;
    let channel = names.iter().find(|n| n.0 == quantity)?.1;
    let (_, fit, truth) = maps.iter().find(|m| m.0 == side)?;
    let (fit, truth) = (fit.get(channel)?[k], truth.get(channel)?[k]);
    if fit.is_nan() || fit_mask(maps, side, k) {
        return Some(f64::NAN);
    }
    match kind {
        "fit" => Some(f64::from(fit)),
        "truth" => Some(f64::from(truth)),
        "fit − truth" => Some(f64::from(fit - truth)),
        _ => None,
    }
}

fn fit_mask(maps: &[(&str, ChannelMaps, ChannelMaps)], side: &str, k: usize) -> bool {
    maps.iter().any(|m| m.0 == side && m.1.get("mask.Y").unwrap()[k] <= 0.5)
}

#[test]
fn pictures_can_be_looked_at_closer() {
    let dir = tempfile::tempdir().unwrap();
    let sample = Sample { name: "elm".into(), ..Sample::default() };
    write_fit(&dir.path().join("elm"), &sample);
    write_run(&dir.path().join("run"), true);
    let page = report(dir.path(), &["elm", "run"]);
    let Some(seen) = seen(dir.path(), &page) else { return };

    // Values are those of the float maps, to the digits that are shown, and their unit stands behind them.
    let open = |name: &str| image::read_exr(&dir.path().join("elm").join(name)).unwrap();
    let sides = ["front", "back"];
    let maps: Vec<(&str, ChannelMaps, ChannelMaps)> =
        sides.iter().map(|s| (*s, open(&format!("{s}.exr")), open(&format!("truth_{s}.exr")))).collect();
    let (mut compared, mut empty, mut units) = (0, 0, 0);
    for row in seen["values"].as_array().unwrap() {
        let (column, line) = (row["column"].as_u64().unwrap(), row["row"].as_u64().unwrap());
        let (label, text) = (row["label"].as_str().unwrap(), row["text"].as_str().unwrap());
        let place = format!("column {column}, row {line}: ");
        let shown = text.strip_prefix(&place).unwrap_or_else(|| panic!("{label}: {text}, expected {place}"));
        let k = line as usize * sample.width + column as usize;
        let Some(value) = expected(label, &maps, k) else { continue };
        if !value.is_finite() {
            assert_eq!(shown, "no value", "{label}");
            empty += 1;
            continue;
        }
        let (number, unit) = shown.split_once(' ').unwrap_or((shown, ""));
        let wanted = if label.contains('σ') { "1/mm" } else { "" };
        assert_eq!(unit, if label.contains("δ") { "mm" } else { wanted }, "{label}: {shown}");
        units += usize::from(!unit.is_empty());
        let number: f64 = number.replace('−', "-").parse().unwrap_or_else(|_| panic!("{label}: {shown}"));
        // Four digits: half a unit of the last one is at most 5e-4 of the value.
        let unit_of_last = 10f64.powi(value.abs().log10().floor() as i32 - 3);
        let off = (number - value).abs();
        assert!(value == 0.0 && number == 0.0 || off <= 0.501 * unit_of_last, "{label}: {shown}, not {value}");
        compared += 1;
    }
    assert!(compared > 100 && empty > 20 && units > 20, "{compared} {empty} {units}");
    // All maps of a side are pointed at together, and none of the other side.
    let (linked, all) = (seen["linked"].as_u64().unwrap(), seen["values"].as_array().unwrap().len() as u64 / 5);
    assert!(linked > 20 && linked <= all / 2 + 1, "{linked} of {all}");
    assert_eq!(seen["left"], 0);

    // The arrow keys go from texel to texel, from the middle.
    let walked = seen["walked"].as_str().unwrap();
    assert!(walked.starts_with("column 46, row 28: "), "{walked}");
    assert_eq!(seen["kept"], seen["walked"]);
    assert_eq!(seen["live"], "polite");
    // Zooming keeps the texel in its place and moves every map of the side.
    assert_eq!(view(&seen["whole"]), (0.0, 1.0));
    let (left, zoom) = view(&seen["zoomed"][0]);
    let u = 46.5 / 72.0;
    assert!((zoom - 1.5).abs() < 1e-9 && (left + zoom * u - u).abs() < 1e-6, "{left} {zoom}");
    assert_eq!(seen["zoomed"][0], seen["zoomed"][1]);
    let (dragged, _) = view(&seen["dragged"]);
    assert!((dragged - (left + 0.1)).abs() < 1e-6, "{dragged} from {left}");
    let (wheel_left, wheel) = view(&seen["wheel"]);
    // Browsers print six digits of a transform.
    assert!((wheel - 1.5 * 1f64.exp()).abs() < 1e-5, "{wheel}");
    // The place under the pointer, here the middle, stays. A wheel's pointer has whole pixels, about 1/345 of the
    // picture.
    assert!((((0.5 - wheel_left) / wheel) - (0.5 - dragged) / 1.5).abs() < 4e-3, "{wheel_left} from {dragged}");
    assert_eq!(view(&seen["again"]), (0.0, 1.0));
    assert_eq!(view(&seen["scrolls"]), (0.0, 1.0), "without a click the wheel scrolls the page");

    // The wipe cuts the reference at the line.
    for (k, share) in [50.0, 25.0, 0.0, 100.0].into_iter().enumerate() {
        let cut = seen["wipe"][k][0].as_str().unwrap();
        let left = cut.rsplit_once(' ').unwrap().1.trim_end_matches("%)").parse::<f64>().unwrap();
        assert_eq!((left, seen["wipe"][k][1].as_str().unwrap()), (share, format!("{share}%").as_str()), "{cut}");
    }
    assert!(seen["slider"].as_str().unwrap().contains("renderer"));

    assert_eq!(seen["large"], serde_json::json!([true, true, true]));
    assert_eq!(seen["tools"].as_array().unwrap().len(), 4);
    assert!((view(&seen["largeZoom"]).1 - 1.5).abs() < 1e-9);
    assert_eq!(seen["back"], serde_json::json!([false, true, true]));

    assert_eq!((&seen["unnamed"], &seen["unreachable"]), (&0.into(), &0.into()));
    assert!(seen["usable"].as_u64().unwrap() > 60);
    assert_eq!(seen["outline"], serde_json::json!(["solid", "3px"]));
    assert_eq!(seen["folded"], serde_json::json!([true, 0, true]));
}

/// A page that would be larger than 5 MB keeps fewer texels and says so. A smaller page keeps all.
#[test]
fn a_page_stays_below_five_megabytes() {
    let dir = tempfile::tempdir().unwrap();
    write_fit(&dir.path().join("small"), &Sample { sides: vec!["front"], ..Sample::default() });
    let small = report(dir.path(), &["small"]);
    assert!(small.contains("have 4 significant digits") && !small.contains("To stay small"));
    let size = Sample { width: 320, height: 240, ..Sample::default() };
    write_fit(&dir.path().join("large"), &size);
    let page = report(dir.path(), &["large"]);
    println!("{} bytes", page.len());
    assert!(page.len() <= 5_000_000, "{}", page.len());
    assert!(page.len() > 2_500_000, "{}: more could have been kept", page.len());
    assert!(page.contains("To stay small, this page keeps not every column and row of the maps"));
    // What is kept in full is the fit: a map of 320 × 240 values.
    assert!(page.contains("data-grid=\"320 240 1 "));
}
