//! Which lobe suits real leaves: the figures and the picture of `docs/evidence/lobes.md`, made from goniometer scans by
//! `fit gloss --samples`.
//!
//! With `MESOPHYLL_DATA`, the page's figures are computed again and must be the printed ones. With
//! `MESOPHYLL_WRITE_DOCS=1` as well, the page's table and `docs/lobes.svg` are written again: `MESOPHYLL_WRITE_DOCS=1
//! cargo test --release --test models lobes`.

mod picture;

use crate::skips;
use assert_cmd::Command;
use rand::{RngExt, SeedableRng};
use std::collections::HashMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};

const LOBES: [&str; 3] = ["beckmann", "ggx", "cook-torrance"];
const BEGIN: &str = "<!-- figures: begin -->\n";
const END: &str = "<!-- figures: end -->\n";

/// One measured direction: zenith of the source, zenith and azimuth of the view (degrees), BRF by value column.
pub struct Sample {
    pub source: f64,
    pub zenith: f64,
    pub azimuth: f64,
    pub brf: Vec<f64>,
}

/// The scan of a leaf and its three fits, by value column.
pub struct Leaf {
    pub name: String,
    pub species: String,
    pub samples: Vec<Sample>,
    pub fits: Vec<HashMap<String, f64>>,
}

impl Leaf {
    pub fn rms(&self, lobe: usize) -> f64 {
        self.fits[lobe]["rms"]
    }
    /// AIC of Beckmann's lobe minus that of the long-tailed one: n ln of the ratio of the sums of squares, because both
    /// have the same number of parameters.
    pub fn delta_aic(&self) -> f64 {
        let n = self.samples.iter().map(|s| s.brf.len()).sum::<usize>() as f64;
        2.0 * n * (self.rms(0) / self.rms(1)).ln()
    }
}

fn leaves(brf: &Path) -> Vec<Leaf> {
    let mut reader = csv::Reader::from_path(brf).unwrap();
    let header: Vec<String> = reader.headers().unwrap().iter().map(String::from).collect();
    let mut leaves: Vec<Leaf> = Vec::new();
    for record in reader.records() {
        let record = record.unwrap();
        let text = |name: &str| record[header.iter().position(|h| h == name).unwrap()].to_string();
        let number = |name: &str| text(name).parse::<f64>().unwrap();
        let brf = header.iter().filter(|h| h.starts_with("brf")).map(|h| number(h)).collect();
        let [source, zenith, azimuth] = ["source_zenith_deg", "view_zenith_deg", "view_azimuth_deg"].map(number);
        if leaves.last().is_none_or(|l| l.name != text("leaf")) {
            leaves.push(Leaf { name: text("leaf"), species: text("species"), samples: Vec::new(), fits: Vec::new() });
        }
        leaves.last_mut().unwrap().samples.push(Sample { source, zenith, azimuth, brf });
    }
    for lobe in LOBES {
        let out = Command::cargo_bin("mesophyll")
            .unwrap()
            .args(["-q", "fit", "gloss", "--samples", "--lobe", lobe, "--in", brf.to_str().unwrap()])
            .output()
            .unwrap();
        assert!(out.status.success());
        for (row, leaf) in
            csv::Reader::from_reader(&out.stdout[..]).deserialize::<HashMap<String, String>>().zip(&mut leaves)
        {
            let row = row.unwrap();
            assert_eq!(row["leaf"], leaf.name);
            leaf.fits.push(row.iter().filter_map(|(k, v)| Some((k.clone(), v.parse().ok()?))).collect());
        }
    }
    leaves
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Two-sided sign test: the probability that fair coins split at least as unevenly.
fn sign_test(wins: usize, of: usize) -> f64 {
    let most = wins.max(of - wins);
    let choose = |k: usize| (0..k).fold(1.0, |c, i| c * (of - i) as f64 / (i + 1) as f64);
    (2.0 * (most..=of).map(choose).sum::<f64>() / 2f64.powi(of as i32)).min(1.0)
}

/// The 95 % interval of the mean over groups that are drawn with replacement.
fn bootstrap(groups: &[Vec<f64>]) -> [f64; 2] {
    let mut rng = rand_pcg::Pcg64::seed_from_u64(1);
    let mut means: Vec<f64> = (0..20_000)
        .map(|_| {
            let (mut sum, mut count) = (0.0, 0usize);
            for _ in groups {
                let group = &groups[rng.random_range(0..groups.len())];
                sum += group.iter().sum::<f64>();
                count += group.len();
            }
            sum / count as f64
        })
        .collect();
    means.sort_by(f64::total_cmp);
    [means[means.len() / 40], means[means.len() - 1 - means.len() / 40]]
}

/// The page's table and sentence of figures.
fn figures(leaves: &[Leaf]) -> String {
    let mut text = String::from(
        "| scan | species | source | RMS beckmann | RMS ggx | RMS cook-torrance | ΔAIC | m beckmann | m ggx \
         |\n|---|---|---|---|---|---|---|---|---|\n",
    );
    for l in leaves {
        let _ = writeln!(
            text,
            "| {} | *{}* | {:.0}° | {:.5} | {:.5} | {:.5} | {:.1} | {:.2} | {:.2} |",
            l.name,
            l.species.split_whitespace().take(2).collect::<Vec<_>>().join(" "),
            l.samples[0].source,
            l.rms(0),
            l.rms(1),
            l.rms(2),
            l.delta_aic(),
            l.fits[0]["m"],
            l.fits[1]["m"]
        );
    }
    let medians = [0, 1, 2].map(|k| median(leaves.iter().map(|l| l.rms(k)).collect()));
    let _ = writeln!(
        text,
        "| **median** | | | **{:.5}** | **{:.5}** | **{:.5}** | | | |\n",
        medians[0], medians[1], medians[2]
    );
    let gains: Vec<f64> = leaves.iter().map(Leaf::delta_aic).collect();
    let wins = gains.iter().filter(|d| **d > 0.0).count();
    let mut species: Vec<(&str, Vec<f64>)> = Vec::new();
    for (l, d) in leaves.iter().zip(&gains) {
        match species.iter_mut().find(|s| s.0 == l.species) {
            Some(s) => s.1.push(*d),
            None => species.push((&l.species, vec![*d])),
        }
    }
    let by_scan = bootstrap(&gains.iter().map(|d| vec![*d]).collect::<Vec<_>>());
    let by_species = bootstrap(&species.iter().map(|s| s.1.clone()).collect::<Vec<_>>());
    let better = species.iter().filter(|s| s.1.iter().sum::<f64>() > 0.0).count();
    let _ = writeln!(
        text,
        "GGX is better on {wins} of {} scans (two-sided sign test p = {:.3}). Mean ΔAIC {:.1}, 95 % of bootstrap means \
         over scans {:.1} to {:.1}; \
         over species {:.1} to {:.1}, and GGX is better in the sum of {better} of {} species.",
        leaves.len(),
        sign_test(wins, leaves.len()),
        gains.iter().sum::<f64>() / gains.len() as f64,
        by_scan[0],
        by_scan[1],
        by_species[0],
        by_species[1],
        species.len(),
    );
    text
}

/// Whether two texts are the same, except that the last digit of a number may differ by up to two.
fn agree(a: &str, b: &str) -> bool {
    let words = |t: &str| {
        t.split_whitespace().map(|w| w.trim_matches(['*', ',', ';', ')', '.', '°']).to_string()).collect::<Vec<_>>()
    };
    let (a, b) = (words(a), words(b));
    let same = |a: &String, b: &String| match (a.parse::<f64>(), b.parse::<f64>()) {
        (Ok(x), Ok(y)) => (x - y).abs() <= 2.1 * 0.1f64.powi(b.split_once('.').map_or(0, |p| p.1.len() as i32)),
        _ => a == b,
    };
    a.len() == b.len() && a.iter().zip(&b).all(|(a, b)| same(a, b))
}

#[test]
fn the_page_s_figures_are_what_the_data_say() {
    let Some(data) = skips::data("leaves/brf.csv") else { return };
    let leaves = leaves(&Path::new(&data).join("leaves/brf.csv"));
    assert!(leaves.iter().all(|l| l.fits.len() == LOBES.len()));
    let now = figures(&leaves);
    println!("{now}");
    let docs = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("docs");
    let page = std::fs::read_to_string(docs.join("evidence/lobes.md")).unwrap();
    let (head, rest) = page.split_once(BEGIN).expect("a mark where the figures begin");
    let (printed, tail) = rest.split_once(END).expect("a mark where the figures end");
    if std::env::var_os("MESOPHYLL_WRITE_DOCS").is_some() {
        std::fs::write(docs.join("evidence/lobes.md"), format!("{head}{BEGIN}{now}{END}{tail}")).unwrap();
        std::fs::write(docs.join("lobes.svg"), picture::draw(&leaves)).unwrap();
        return;
    }
    assert!(agree(printed, &now), "docs/evidence/lobes.md prints\n{printed}\nbut the data say\n{now}");
}

#[test]
fn a_sign_test_and_a_comparison_that_can_fail() {
    // 12 of 15: 2 (C(15,12) + C(15,13) + C(15,14) + 1)/2¹⁵ = 2 · 576/32768
    assert!((sign_test(12, 15) - 2.0 * 576.0 / 32768.0).abs() < 1e-12);
    assert_eq!(sign_test(1, 2), 1.0);
    assert!(
        agree("a 0.123, b", "a 0.124; b") && !agree("a 0.123", "a 0.133") && !agree("a 1", "b 1") && !agree("a", "a b")
    );
    let narrow = bootstrap(&vec![vec![3.0]; 5]);
    assert_eq!(narrow, [3.0, 3.0]);
}

/// The text of a program's file without comments and unit tests; nothing of a file of tests.
fn code(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    if name.ends_with("tests.rs") {
        return String::new();
    }
    let text = std::fs::read_to_string(path).unwrap();
    let text = text.split("#[cfg(test)]").next().unwrap_or_default();
    let conditions = |l: &&str| l.trim_start().starts_with("//#if") || !l.trim_start().starts_with("//");
    text.lines().filter(conditions).collect::<Vec<_>>().join("\n")
}

fn sources(folder: &Path, out: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()) {
        if entry.is_dir() {
            sources(&entry, out);
        } else if entry.extension().is_some_and(|e| e == "rs" || e == "wgsl") {
            out.push(entry);
        }
    }
}

/// `docs/adding.md` lists the files to change for a new lobe. They are the files that name a lobe, except the list of
/// lobes that the tube's lanes know.
#[test]
fn few_files_name_a_lobe() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = Vec::new();
    ["src", "viewer/src"].iter().for_each(|folder| sources(&root.join(folder), &mut files));
    assert!(files.len() > 300, "{} files", files.len());
    let names =
        |path: &PathBuf| ["Lobe::Ggx", "#if ggx", "LobeKind::Ggx", "    Ggx,"].iter().any(|n| code(path).contains(n));
    let mut found: Vec<String> = files
        .iter()
        .filter(|p| names(p))
        .map(|p| p.strip_prefix(root).unwrap().to_string_lossy().replace('\\', "/"))
        .collect();
    found.sort();
    let page = std::fs::read_to_string(root.join("docs/adding.md")).unwrap();
    assert!(found.iter().all(|f| page.contains(f.as_str())), "{found:?}");
    assert_eq!(
        found,
        [
            "src/base/surface/gloss.rs",
            "src/measurements/synth/illumination.rs",
            "src/models/optics/tube/evaluator/mod.rs",
            "src/outputs/export/foreign/micro.rs",
            "src/outputs/proof/gloss/stress.rs",
            "viewer/src/passes/lobe.wgsl",
        ]
    );
}
