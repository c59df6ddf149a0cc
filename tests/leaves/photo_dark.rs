//! Photographs of a leaf that is about as dark as the black sheet: its outline comes from the light table.

use crate::common::{run, succeeded};
use crate::photo::{rows, scatter, text, toml};
use mesophyll::capture::photo::{PhotoManifest, reduce};
use mesophyll::files::image::{Packing, read_exr, write_exr};
use mesophyll::optics::side::Side;
use std::path::{Path, PathBuf};

/// Photographs of an elm that absorbs `factor` times as much. Its reflectance, gloss included, is about that of the
/// sheet, and at a factor of 4 the leaf is darker than the sheet.
fn photographs(folder: &Path, factor: f64) -> PathBuf {
    let spec = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("data/leaves/elm.toml")).unwrap();
    let dark = [20.6, 11.4, 25.6].map(|v| v * factor);
    let spec = spec.replacen("sigma_a = [20.6, 11.4, 25.6]", &format!("sigma_a = {dark:?}"), 1);
    assert!(spec.contains(&format!("{dark:?}")));
    let path = folder.join("dark.toml");
    std::fs::write(&path, spec).unwrap();
    let photo = folder.join("photo");
    let options = ["--acquisition", "photo", "--size", "300x225", "--seed", "1"];
    succeeded(&run([&["synth", text(&path), "-o", text(&photo)], &options[..]].concat()));
    photo
}

fn said(folder: &Path) -> String {
    let outcome = PhotoManifest::read(folder).and_then(|m| reduce(folder, &m));
    outcome.err().map_or_else(String::new, |e| e.to_string())
}

#[test]
fn a_leaf_as_dark_as_the_sheet_has_the_outline_of_the_light_table() {
    for factor in [1.8, 4.0] {
        let dir = tempfile::tempdir().unwrap();
        let folder = photographs(dir.path(), factor);
        let found = reduce(&folder, &PhotoManifest::read(&folder).unwrap()).unwrap();
        for side in [Side::Front, Side::Back] {
            assert_eq!(found.sides[side].figures["outline_of_light_table"], 1.0, "{factor} {}", side.name());
        }
        // The truth has the pixels of the front's picture. Texels that lie wholly on the leaf, or wholly beside it:
        let truth = read_exr(&folder.join("truth/front.exr")).unwrap();
        let through = truth.get("transmittance.G").unwrap();
        let share = |k: usize| {
            let [x, y] = [k % found.width, k / found.width].map(|v| v * found.step);
            let on = (0..found.step)
                .flat_map(|j| (0..found.step).map(move |i| (i, j)))
                .filter(|(i, j)| through[(found.origin[1] + y + j) * truth.width + found.origin[0] + x + i] > 0.0);
            on.count() as f64 / (found.step * found.step) as f64
        };
        let shares: Vec<f64> = (0..found.mask.len()).map(share).collect();
        let of = |want: f64, inside: bool| {
            let such: Vec<usize> = (0..shares.len()).filter(|&k| shares[k] == want).collect();
            such.iter().filter(|&&k| found.mask[k] == inside).count() as f64 / such.len() as f64
        };
        let (on, beside) = (of(1.0, true), of(0.0, false));
        println!("{factor}: {on:.4} of the leaf's texels found, {beside:.4} of those beside it left out");
        assert!(on > 0.97 && beside > 0.99, "{factor}: {on} {beside}");
        // The places are right to the errors that they are said to have.
        toml(&folder, "noise_photon", "texel_mm = 2.0\nnoise_photon");
        for (name, scatter) in scatter(&folder) {
            println!("{factor}: {name} {scatter:.3}");
            assert!(scatter < 1.25, "{factor}: {name} {scatter}");
        }
    }
}

#[test]
fn a_dark_leaf_that_lies_wrong_or_cannot_be_told_from_the_sheet_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let folder = photographs(dir.path(), 4.0);
    assert_eq!(said(&folder), "");
    rows(&folder, "table_leaf.exr", <[f32]>::reverse);
    let wrong = said(&folder);
    assert!(wrong.contains("front.exr") && wrong.contains("wrong way up"), "{wrong}");
    rows(&folder, "table_leaf.exr", <[f32]>::reverse);
    // The front's picture without its leaf: card and ruler stay in the lower part.
    let path = folder.join("front.exr");
    let mut maps = read_exr(&path).unwrap();
    let (w, h) = (maps.width, maps.height);
    // The light over the sheet, as the synthesis has it, and the sheet left of the leaf.
    let light = |k: usize| {
        let [x, y] = [(k % w) as f32 / w as f32, (k / w) as f32 / h as f32].map(|v| 2.0 * v - 1.0);
        1.0 + 0.10 * x - 0.06 * y - 0.04 * x * x - 0.03 * y * y
    };
    for (_, v) in &mut maps.channels {
        for k in 0..w * h * 3 / 4 {
            let from = k / w * w + k % w % 16;
            v[k] = v[from] * light(k) / light(from);
        }
    }
    write_exr(&path, &maps, Packing::Raw).unwrap();
    let none = said(&folder);
    assert!(none.contains("front.exr") && none.contains("differs from the sheet"), "{none}");
}
