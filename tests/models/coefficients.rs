//! `fit coefficients` and `fit foliar` with what it wrote, as they are called from outside.

use crate::common::skips::{Need, skip};
use assert_cmd::Command;
use flate2::read::GzDecoder;
use mesophyll::optics::plates::PlateIndex;
use std::collections::{BTreeSet, HashMap};
use std::path::Path;

const CONTENTS: [&str; 4] = ["chlorophyll_ug_cm2", "carotenoid_ug_cm2", "water_g_cm2", "dry_g_cm2"];

/// What a command printed on both streams, and whether it succeeded.
fn run(args: &[&str], folder: &Path) -> (bool, String, String) {
    let out = Command::cargo_bin("mesophyll").unwrap().args(args).current_dir(folder).output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (out.status.success(), text(out.stdout), text(out.stderr))
}

fn rows(text: &str) -> Vec<HashMap<String, String>> {
    csv::Reader::from_reader(text.as_bytes()).deserialize().map(|row| row.unwrap()).collect()
}

/// Made-up leaves of ten species in wide form.
fn leaves() -> String {
    let wavelengths: Vec<f64> = (0..36).map(|k| 400.0 + 60.0 * f64::from(k)).collect();
    let mut text = format!("leaf,species,measured_{}", CONTENTS.join(",measured_"));
    wavelengths.iter().for_each(|w| text += &format!(",R{w},T{w}"));
    for k in 0..30u32 {
        let wave = |a: f64, b: f64| 1.0 + b * (a * f64::from(k * k + 1)).sin();
        let chlorophyll = 50.0 * wave(1.1, 0.4);
        let contents =
            [chlorophyll, 0.22 * chlorophyll * wave(2.3, 0.2), 0.01 * wave(1.7, 0.5), 0.005 * wave(0.7, 0.4)];
        let unknown = k % 6 == 5;
        text += &format!("\nleaf {k},kind {}", k % 10);
        for (j, x) in contents.iter().enumerate() {
            text += &if unknown && j < 2 { ",".to_string() } else { format!(",{x}") };
        }
        for w in &wavelengths {
            let band = |at: f64, width: f64| (-0.5 * ((w - at) / width).powi(2)).exp();
            let depth = contents[0] * (0.04 * band(440.0, 50.0) + 0.03 * band(670.0, 30.0))
                + contents[1] * 0.05 * band(480.0, 30.0)
                + contents[2] * (40.0 * band(1450.0, 80.0) + 130.0 * band(1940.0, 90.0) + 60.0 * band(2500.0, 200.0))
                + contents[3] * (20.0 * band(1700.0, 150.0) + 60.0 * band(2200.0, 150.0))
                + 0.05 * wave(0.3, 0.5) * band(400.0, 300.0);
            let values = PlateIndex::new(1.45).values(depth, 1.6 * wave(0.9, 0.15), wave(1.3, 0.2));
            values.iter().for_each(|x| text += &format!(",{x:.4}"));
        }
    }
    text + "\n"
}

#[test]
fn coefficients_are_trained_and_used() {
    let dir = tempfile::tempdir().unwrap();
    let table = leaves();
    std::fs::write(dir.path().join("leaves.csv"), &table).unwrap();
    let train = ["fit", "coefficients", "--in", "leaves.csv", "-o", "coefficients.csv"];
    let (good, _, said) = run(&train, dir.path());
    assert!(good && said.contains("30 leaves of 10 species"), "{said}");
    let fit = ["fit", "foliar", "--pigments", "coefficients.csv", "--noise", "0.005", "--in"];
    let (good, out, said) = run(&[&fit[..], &["leaves.csv"]].concat(), dir.path());
    assert!(good, "{said}");
    let found = rows(&out);
    assert_eq!(found.len(), 30);
    for row in &found {
        let number = |name: &str| row[name].parse::<f64>().unwrap();
        assert!(number("rms") < 0.01, "{row:?}");
        for name in ["chlorophyll_ug_cm2", "water_g_cm2", "dry_g_cm2"] {
            let Ok(measured) = row[&format!("measured_{name}")].parse::<f64>() else { continue };
            let error = number(&format!("{name}_err"));
            assert!(error > 0.0 && (number(name) - measured).abs() < 4.0 * error + 0.02 * measured, "{name}: {row:?}");
        }
    }
    // The same leaf in long form, and what cannot be answered.
    let mut long = "leaf,wavelength_nm,R,T,side\n".to_string();
    let leaf = &rows(&table)[3];
    for w in (400..=2500).step_by(60) {
        let (r, t) = (&leaf[&format!("R{w}")], &leaf[&format!("T{w}")]);
        long += &format!("a,{w},{r},{t},\nb,{w},,{t},abaxial\nc,{w},{r},{t},\nc,{w},{r},{t},abaxial\n");
    }
    std::fs::write(dir.path().join("long.csv"), &long).unwrap();
    let (good, out, said) = run(&[&fit[..], &["long.csv", "--plots", "plots"]].concat(), dir.path());
    let answers = rows(&out);
    assert!(good && answers[0]["chlorophyll_ug_cm2"] == found[3]["chlorophyll_ug_cm2"], "{said} {out}");
    assert!(answers[1]["status"].starts_with("refused") && answers[1]["status"].contains("lit from below"), "{out}");
    // A leaf whose sides look alike is the leaf that one of them shows, and has a picture.
    let number = |row: &HashMap<String, String>, name: &str| row[name].parse::<f64>().unwrap();
    for name in CONTENTS {
        let (one, both) = (number(&answers[0], name), number(&answers[2], name));
        assert!((both / one - 1.0).abs() < 0.1, "{name}: {one} {both}");
    }
    let picture = std::fs::read_to_string(dir.path().join("plots/c.svg")).unwrap();
    assert!(picture.contains("c: measured less fitted") && picture.contains("transmittance, from below"), "{said}");
    for (more, want) in [
        (vec!["--fit", "water"], "--fit is for the layered leaf"),
        (vec!["--incidence-deg", "20"], "--incidence-deg is for the layered leaf"),
        (vec!["--plots", "p"], "--plots draws spectra in long form"),
    ] {
        let (good, _, said) = run(&[&fit[..], &["leaves.csv"], &more].concat(), dir.path());
        assert!(!good && said.contains(want), "{said}");
    }
    std::fs::write(dir.path().join("far.csv"), "leaf,R3000,T3000\na,0.1,0.1\n").unwrap();
    let (good, _, said) = run(&[&fit[..], &["far.csv"]].concat(), dir.path());
    assert!(!good && said.contains("a reading is at 3000 nm; the coefficients have 400 to 2500 nm"), "{said}");
    // A reading that is not used is said in both forms.
    std::fs::write(dir.path().join("further.csv"), long + "a,3000,0.1,0.1,\n").unwrap();
    let (good, _, said) = run(&[&fit[..], &["further.csv"]].concat(), dir.path());
    assert!(good && said.contains("1 reading outside 400 to 2500 nm"), "{said}");
}

/// Where no column names species, each leaf is one, and that is said.
#[test]
fn a_table_without_species_is_trained_on() {
    let dir = tempfile::tempdir().unwrap();
    let table = leaves();
    std::fs::write(dir.path().join("leaves.csv"), table.replace("species", "kind")).unwrap();
    let (good, out, said) = run(&["fit", "coefficients", "--in", "leaves.csv"], dir.path());
    assert!(good && said.contains("no column species, so each leaf counts as a species of its own"), "{said}");
    assert!(said.contains("30 leaves, each taken for a species of its own"), "{said}");
    std::fs::write(dir.path().join("coefficients.csv"), out).unwrap();
    std::fs::write(dir.path().join("others.csv"), table).unwrap();
    let fit = ["fit", "foliar", "--pigments", "coefficients.csv", "--noise", "0.005", "--in", "others.csv"];
    let (good, out, said) = run(&fit, dir.path());
    assert!(good, "{said}");
    for row in rows(&out) {
        let number = |name: &str| row[name].parse::<f64>().unwrap();
        let (found, measured) = (number("water_g_cm2"), number("measured_water_g_cm2"));
        assert!((found - measured).abs() < 4.0 * number("water_g_cm2_err") + 0.02 * measured, "{row:?}");
    }
}

#[test]
fn a_table_of_training_is_not_overwritten_and_lower_sides_are_left_out_by_name() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("leaves.csv");
    let table = leaves();
    std::fs::write(&path, &table).unwrap();
    let (good, _, said) = run(&["fit", "coefficients", "--in", "leaves.csv", "-o", "leaves.csv"], dir.path());
    assert!(!good && said.contains("leaves.csv is what is to be read"), "{said}");
    assert_eq!(std::fs::read_to_string(&path).unwrap(), table);
    let sided = |side: &str| -> String {
        let cell = |k: usize| if k == 0 { "side" } else { side };
        table.lines().enumerate().map(|(k, line)| format!("{line},{}\n", cell(k))).collect()
    };
    for (side, want) in [("abaxial", "a leaf lit from below"), ("top", "side is \"top\"; expected adaxial or abaxial")]
    {
        std::fs::write(&path, sided(side)).unwrap();
        let (good, _, said) = run(&["fit", "coefficients", "--in", "leaves.csv", "-o", "out.csv"], dir.path());
        assert!(!good && said.contains(want) && said.contains("it has 0 leaves that can be used"), "{said}");
        assert!(!dir.path().join("out.csv").exists());
    }
}

#[test]
fn tables_that_cannot_be_trained_on_are_refused_by_name() {
    let dir = tempfile::tempdir().unwrap();
    let table = leaves();
    let few: String = table.lines().take(8).map(|l| format!("{l}\n")).collect();
    let reflectance = table.replace(",T", ",X");
    for (text, want) in [
        (table.replace("measured_water_g_cm2", "water"), "measured_water_g_cm2: no such column"),
        (few, "7 leaves that can be used, expected at least 10"),
        (table.lines().next().unwrap().to_string(), "0 leaves that can be used"),
        (reflectance, "only one of reflectance and transmittance"),
        ("leaf,wavelength_nm,R,T\na,400,0.1,0.1\n".into(), "a column of wavelengths, so a row is no leaf"),
        ("leaf,species\na,b\n".into(), "no columns of readings"),
        ("".into(), "no header"),
    ] {
        std::fs::write(dir.path().join("t.csv"), text).unwrap();
        let (good, _, said) = run(&["fit", "coefficients", "--in", "t.csv", "-o", "out.csv"], dir.path());
        assert!(!good && said.contains(want), "{want}: {said}");
        assert!(!dir.path().join("out.csv").exists());
    }
}

/// Median, pooled root mean square, and the answers of leaves of a half of LOPEX93 by coefficients of the other half.
fn halves(table: &str, train_on: usize, folder: &Path) -> Vec<HashMap<String, String>> {
    let all = rows(table);
    let species: BTreeSet<&String> = all.iter().map(|r| &r["species"]).collect();
    let half = |k: usize| -> BTreeSet<&String> { species.iter().skip(k).step_by(2).copied().collect() };
    let header = table.lines().next().unwrap();
    // Every second wavelength is enough, and makes the test short.
    let kept: Vec<usize> = (0..header.split(',').count()).filter(|k| *k < 9 || (k - 9) / 2 % 4 == 0).collect();
    for (name, k) in [("train.csv", train_on), ("judge.csv", 1 - train_on)] {
        let mut text = String::new();
        for (line, row) in table.lines().zip([None].into_iter().chain(all.iter().map(Some))) {
            if row.is_none_or(|r| half(k).contains(&r["species"])) {
                let cells: Vec<&str> = line.split(',').collect();
                text += &kept.iter().map(|k| cells[*k]).collect::<Vec<_>>().join(",");
                text += "\n";
            }
        }
        std::fs::write(folder.join(name), text).unwrap();
    }
    let (good, _, said) = run(&["fit", "coefficients", "--in", "train.csv", "-o", "coefficients.csv"], folder);
    assert!(good, "{said}");
    let fit = ["fit", "foliar", "--pigments", "coefficients.csv", "--noise", "0.005", "--in", "judge.csv"];
    let (good, out, said) = run(&fit, folder);
    assert!(good, "{said}");
    rows(&out)
}

/// Trained on one half of the species of LOPEX93 and judged on the other, which the coefficients never saw. The limits
/// are those of PROSPECT-D on the same leaves, and what was promised.
#[test]
fn real_leaves_of_unseen_species_are_found() {
    let file = std::env::var_os("MESOPHYLL_DATA").map(|d| Path::new(&d).join("leaves/lopex93_spectra.csv.gz"));
    let Some(file) = file.filter(|f| f.exists()) else {
        return skip(Need::Data, "MESOPHYLL_DATA has no leaves/lopex93_spectra.csv.gz");
    };
    let mut table = String::new();
    std::io::Read::read_to_string(&mut GzDecoder::new(std::fs::File::open(file).unwrap()), &mut table).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let found: Vec<HashMap<String, String>> = (0..2).flat_map(|half| halves(&table, half, dir.path())).collect();
    let number = |row: &HashMap<String, String>, name: &str| row[name].parse::<f64>().unwrap_or(f64::NAN);
    let mut rms: Vec<f64> = found.iter().map(|r| number(r, "rms")).collect();
    rms.sort_by(f64::total_cmp);
    let pooled = (rms.iter().map(|r| r * r).sum::<f64>() / rms.len() as f64).sqrt();
    println!("{} leaves: median {:.4}, pooled {pooled:.4}", rms.len(), rms[rms.len() / 2]);
    assert!(found.len() == 225 && rms[rms.len() / 2] <= 0.008 && pooled <= 0.0105, "{pooled} {rms:?}");
    for (name, least_r, most_bias, laboratory) in
        [(CONTENTS[0], 0.68, 0.24, 0.1), (CONTENTS[1], 0.58, 0.25, 0.1), (CONTENTS[2], 0.97, 0.03, 0.0)]
    {
        let of = |r: &HashMap<String, String>| {
            [number(r, name), number(r, &format!("measured_{name}")), number(r, &format!("{name}_err"))]
        };
        let all: Vec<[f64; 3]> = found.iter().map(of).filter(|x| !x[1].is_nan()).collect();
        let mean = |k: usize| all.iter().map(|x| x[k]).sum::<f64>() / all.len() as f64;
        let means = [mean(0), mean(1)];
        let product = |i: usize, j: usize| all.iter().map(|x| (x[i] - means[i]) * (x[j] - means[j])).sum::<f64>();
        let r = product(0, 1) / (product(0, 0) * product(1, 1)).sqrt();
        let bias = means[0] / means[1] - 1.0;
        let held = |x: &&[f64; 3]| (x[0] - x[1]).abs() <= 1.96 * x[2].hypot(laboratory * x[1]);
        let held = all.iter().filter(held).count() as f64 / all.len() as f64;
        println!("{name}: r {r:.3}, bias {bias:+.3}, {:.1} % in their intervals", 100.0 * held);
        assert!(r >= least_r && bias.abs() <= most_bias && (0.88..=0.99).contains(&held), "{name} {r} {bias} {held}");
    }
}
