//! What photographs may look like: other files, other ways to lay the leaf, noise that nobody states, and bad pictures.

use crate::common::{copy_tree, refused, run, succeeded};
use crate::photo::{changed, made, rows, text, toml};
use mesophyll::base::rgb::Rgb;
use mesophyll::capture::photo::{PhotoManifest, picture::LinearPhotograph, reduce};
use mesophyll::files::image::{ChannelMaps, Packing, read_exr, write_exr};
use mesophyll::optics::side::Side;
use std::path::Path;

/// Changes that leave a good capture good: what comes out is still right.
#[test]
fn what_people_do_is_not_refused() {
    let back = |folder: &Path| reduce(folder, &PhotoManifest::read(folder).unwrap()).unwrap().sides.back;
    let overlap = |folder: &Path| back(folder).figures["outline_overlap"];
    let good = overlap(&made().1);
    // A white ruler that is larger than the leaf lies in the back's picture as well, wholly inside or up to its border.
    for right in [196, 200] {
        let said = changed(|f| {
            let mut maps = read_exr(&f.join("back.exr")).unwrap();
            let w = maps.width;
            let on = |i: usize, j: usize| (100..147).contains(&j) && (if j < 112 { 4 } else { 58 }..right).contains(&i);
            maps.channels.iter_mut().for_each(|(_, v)| {
                (0..v.len()).filter(|k| on(k % w, k / w)).for_each(|k| v[k] = 0.6);
            });
            write_exr(&f.join("back.exr"), &maps, Packing::Raw).unwrap();
            let found = overlap(f);
            assert!((found - good).abs() < 0.01, "{found} {good}");
        });
        assert_eq!(said, "");
    }
    // The table has become darker since the bare picture, or the lamp has warmed up.
    for drift in [0.6, 0.8, 1.1] {
        let said = changed(|f| {
            rows(f, "table_leaf.exr", |r| r.iter_mut().for_each(|v| *v *= drift));
            let [before, after] = [&made().1, f].map(|f| {
                let reduced = reduce(f, &PhotoManifest::read(f).unwrap()).unwrap();
                let good = |k: &usize| reduced.sides.front.status[*k] == 1;
                let list: Vec<f64> = (0..reduced.sides.front.status.len())
                    .filter(good)
                    .map(|k| reduced.sides.front.rho_t[k][1])
                    .collect();
                list.iter().sum::<f64>() / list.len() as f64
            });
            assert!((after / before - 1.0).abs() < 2e-3, "{drift}: {before} {after}");
        });
        assert_eq!(said, "");
    }
}

/// The back up in the first picture of the table, the front in the second one: the same pictures, the same maps.
#[test]
fn the_back_may_lie_up_on_the_table() {
    let before = reduce(&made().1, &PhotoManifest::read(&made().1).unwrap()).unwrap();
    let said = changed(|f| {
        for [from, to] in [
            ["leaf = \"table_leaf.exr\"", "leaf = \"x\""],
            ["turned = \"table_turned.exr\"", "turned = \"table_leaf.exr\""],
            ["leaf = \"x\"", "leaf = \"table_turned.exr\""],
            ["up = \"front\"", "up = \"back\""],
        ] {
            toml(f, from, to);
        }
        let after = reduce(f, &PhotoManifest::read(f).unwrap()).unwrap();
        for side in [Side::Front, Side::Back] {
            let (a, b) = (&before.sides[side], &after.sides[side]);
            assert!(a.rho_t_seen && b.rho_t_seen);
            let same = |a: &[Rgb], b: &[Rgb]| {
                a.iter()
                    .flat_map(|v| v.iter())
                    .zip(b.iter().flat_map(|v| v.iter()))
                    .all(|(a, b)| (a - b).abs() < 1e-12 || a.is_nan() && b.is_nan())
            };
            assert!(same(&a.rho_t, &b.rho_t) && same(&a.rho_d, &b.rho_d) && a.status == b.status);
        }
        // With the back up alone, the front's ρt is what was seen of the back, mirrored.
        toml(f, "turned = \"table_leaf.exr\"\n", "");
        let alone = reduce(f, &PhotoManifest::read(f).unwrap()).unwrap();
        assert!(alone.sides.back.rho_t_seen && !alone.sides.front.rho_t_seen);
        let w = alone.width;
        for k in (0..alone.mask.len()).filter(|&k| alone.sides.front.status[k] == 1) {
            let (front, back) = (alone.sides.front.rho_t[k], alone.sides.back.rho_t[k / w * w + w - 1 - k % w]);
            assert_eq!(front, back);
        }
        // A leaf that lies the other way than stated is refused.
        toml(f, "up = \"back\"", "up = \"front\"");
    });
    assert!(said.contains("table_turned.exr") && said.contains("wrong way up"), "{said}");
}

/// PNG in open shade, TIFF on the light table, 16 bits: the same maps as from the EXR files, to the rounding of a
/// number.
#[test]
fn png_and_tiff_are_reduced_as_exr() {
    let before = reduce(&made().1, &PhotoManifest::read(&made().1).unwrap()).unwrap();
    let said = changed(|f| {
        for (name, extension) in
            [("front", "png"), ("back", "png"), ("table_leaf", "tif"), ("table_turned", "tiff"), ("table_bare", "tif")]
        {
            let maps = read_exr(&f.join(format!("{name}.exr"))).unwrap();
            let plane = |c: &str| maps.get(c).unwrap();
            let [r, g, b] = ["R", "G", "B"].map(plane);
            let count = |v: f32| (v.clamp(0.0, 1.0) * 65535.0).round() as u16;
            image::ImageBuffer::from_fn(maps.width as u32, maps.height as u32, |i, j| {
                let k = j as usize * maps.width + i as usize;
                image::Rgb([r[k], g[k], b[k]].map(count))
            })
            .save(f.join(format!("{name}.{extension}")))
            .unwrap();
            toml(f, &format!("{name}.exr"), &format!("{name}.{extension}"));
        }
        let after = reduce(f, &PhotoManifest::read(f).unwrap()).unwrap();
        for side in [Side::Front, Side::Back] {
            let (a, b) = (&before.sides[side], &after.sides[side]);
            assert_eq!(a.status, b.status);
            let off = |a: &[Rgb], b: &[Rgb], err: &[Rgb], good: &[i16]| {
                let good = (0..a.len()).filter(|&k| good[k] == 1).flat_map(|k| [0, 1, 2].map(|c| (k, c)));
                good.map(|(k, c)| (a[k][c] - b[k][c]).abs() / err[k][c]).fold(0.0, f64::max)
            };
            let worst =
                [off(&a.rho_d, &b.rho_d, &a.rho_d_err, &a.status), off(&a.rho_t, &b.rho_t, &a.rho_t_err, &a.status)];
            println!("{}: {worst:?} errors", side.name());
            // Half a count of 65,535 in the darkest reading, blue of the leaf on the table, is 1 % of its noise; the
            // outlines may differ by a pixel.
            assert!(worst.iter().all(|w| *w < 0.2), "{worst:?}");
        }
    });
    assert_eq!(said, "");
}

/// Noise that nobody states is measured on the card, and the errors of texels are as large as with the stated noise.
#[test]
fn noise_is_measured_on_the_card() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("photo");
    let options = ["--acquisition", "photo", "--size", "340x255", "--seed", "5"];
    succeeded(&run([&["synth", "data/leaves/elm.toml", "-o", text(&folder)], &options[..]].concat()));
    // The stated rectangles are three fifths of the card; noise needs a little more.
    let manifest = PhotoManifest::read(&folder).unwrap();
    for [left, top, width, height] in [manifest.front.card, manifest.back.card] {
        let wide = format!("card = [{left}, {}, {width}, {}]", top - 2, height + 4);
        toml(&folder, &format!("card = [{left}, {top}, {width}, {height}]"), &wide);
    }
    let stated = reduce(&folder, &PhotoManifest::read(&folder).unwrap()).unwrap();
    let path = folder.join("capture.toml");
    let lines = std::fs::read_to_string(&path).unwrap();
    let lines: Vec<&str> = lines.lines().filter(|l| !l.starts_with("noise_")).collect();
    std::fs::write(&path, lines.join("\n")).unwrap();
    let measured = reduce(&folder, &PhotoManifest::read(&folder).unwrap()).unwrap();
    assert!(stated.noise.stated && !measured.noise.stated);
    for side in [Side::Front, Side::Back] {
        let (a, b) = (&stated.sides[side], &measured.sides[side]);
        let mean = |of: &dyn Fn(usize) -> f64| {
            let good: Vec<f64> = (0..a.status.len()).filter(|&k| a.status[k] == 1).map(of).collect();
            good.iter().sum::<f64>() / good.len() as f64
        };
        for c in 0..3 {
            let ratio = mean(&|k| b.rho_d_err[k][c] / a.rho_d_err[k][c]);
            println!("{} {c}: {ratio:.3}", side.name());
            assert!((ratio - 1.0).abs() < 0.2, "{ratio}");
        }
    }
    // On a card too small to see what neighbours share, nothing is guessed.
    let manifest = PhotoManifest::read(&folder).unwrap();
    let [left, top, ..] = manifest.front.card;
    toml(
        &folder,
        &format!("card = [{left}, {top}, {}, {}]", manifest.front.card[2], manifest.front.card[3]),
        &format!("card = [{left}, {top}, 20, 12]"),
    );
    let said = reduce(&folder, &PhotoManifest::read(&folder).unwrap()).unwrap_err().to_string();
    assert!(said.contains("front.card") && said.contains("noise_photon"), "{said}");
}

/// Each fault is refused in one sentence that names the file or the field.
#[test]
fn bad_pictures_are_refused() {
    let card = |folder: &Path, to: &str| {
        let path = folder.join("capture.toml");
        let old = std::fs::read_to_string(&path).unwrap();
        let at = old.find("card = [").unwrap();
        let end = at + old[at..].find('\n').unwrap();
        std::fs::write(path, format!("{}card = {to}{}", &old[..at], &old[end..])).unwrap();
    };
    let cases: Vec<(String, &str, &str)> = vec![
        (changed(|f| card(f, "[190, 120, 40, 20]")), "front.card", "inside the 200x150"),
        (changed(|f| card(f, "[2, 125, 40, 18]")), "front.card", "wholly on an even card"),
        (changed(|f| toml(f, "card]", "cart]")), "capture.toml", "cart"),
        (changed(|f| toml(f, "full_scale = 1.0", "full_scale = 0.1")), "front.exr", "card's pixels are clipped"),
        (changed(|f| card(f, "[46, 100, 10, 6]")), "front.card", "times as bright as the sheet"),
        (changed(|f| rows(f, "back.exr", |r| r.rotate_left(60))), "back.exr", "border"),
        (changed(|f| rows(f, "table_leaf.exr", |r| r.rotate_left(60))), "table_leaf.exr", "border"),
        (
            changed(|f| rows(f, "table_bare.exr", |r| r.iter_mut().for_each(|v| *v *= 1.25))),
            "table_bare.exr",
            "light table is clipped",
        ),
        (changed(|f| rows(f, "table_leaf.exr", <[f32]>::reverse)), "table_leaf.exr", "wrong way up"),
        (
            changed(|f| {
                let mut maps = read_exr(&f.join("back.exr")).unwrap();
                maps.channels.iter_mut().for_each(|(_, v)| v[..200 * 105].fill(0.035));
                write_exr(&f.join("back.exr"), &maps, Packing::Raw).unwrap();
            }),
            "back.exr",
            "",
        ),
        (changed(|f| toml(f, "back.exr", "../photo/back.exr")), "back.file", "inside the capture"),
        (changed(|f| toml(f, "table_bare.exr", "/etc/hostname")), "light_table.bare", "inside the capture"),
        (changed(|f| toml(f, "err_px = 1.0", "err_px = 1e6")), "ruler.err_px", "at most"),
        (
            changed(|f| toml(f, "thickness_err_mm", "thickness_range_mm = [0.1, 0.2]\nthickness_err_mm")),
            "thickness_mm",
            "either",
        ),
        (
            changed(|f| {
                let mut maps = read_exr(&f.join("table_leaf.exr")).unwrap();
                let bare = read_exr(&f.join("table_bare.exr")).unwrap();
                let half = maps.width / 2;
                for ((_, v), (_, b)) in maps.channels.iter_mut().zip(&bare.channels) {
                    (0..v.len()).filter(|k| k % (2 * half) > half).for_each(|k| v[k] = b[k]);
                }
                write_exr(&f.join("table_leaf.exr"), &maps, Packing::Raw).unwrap();
            }),
            "table_leaf.exr",
            "overlaps the front's by",
        ),
    ];
    for (said, file, words) in cases {
        assert!(said.contains(file) && said.contains(words), "{said:?} has no {file:?} or no {words:?}");
        assert!(!said.contains('\n') || said.contains("cart"), "{said}");
    }
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("photo");
    copy_tree(&made().1, &folder);
    std::fs::remove_file(folder.join("back.exr")).unwrap();
    refused(&run(["fit", "leaf", text(&folder), "-o", text(&dir.path().join("fit"))]), 2, &["back.exr"]);
    assert!(!dir.path().join("fit").exists());
}

/// 16-bit PNG and TIFF files hold the same light as EXR files, linear or by the sRGB curve. 8 bits need a curve.
#[test]
fn developed_pictures_are_read() {
    let dir = tempfile::tempdir().unwrap();
    let mut manifest = PhotoManifest::read(&made().1).unwrap();
    let light = |i: u32, j: u32| [0.9 * i as f32 / 32.0, 0.02 * j as f32, 0.001 * (i + j) as f32];
    let encode = |v: f32| if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    for (name, srgb) in [("a.png", false), ("b.tif", false), ("c.tiff", true)] {
        let path = dir.path().join(name);
        let count = |v: f32| ((if srgb { encode(v) } else { v }) * 65535.0).round() as u16;
        image::ImageBuffer::from_fn(32, 24, |i, j| image::Rgb(light(i, j).map(count))).save(&path).unwrap();
        manifest.transfer = toml_transfer(srgb);
        let picture = LinearPhotograph::read(&path, &manifest).unwrap();
        for k in 0..32 * 24 {
            for (found, truth) in picture.pixels[k].into_iter().zip(light(k as u32 % 32, k as u32 / 32)) {
                // Half a count; the curve is at most 2.4 / 1.055 times as steep.
                assert!((found - truth).abs() < 1.3 / 65535.0 + 1e-6, "{name} {k}: {found} {truth}");
            }
        }
    }
    let path = dir.path().join("d.png");
    image::ImageBuffer::from_fn(32, 24, |_, _| image::Rgb([9u8; 3])).save(&path).unwrap();
    let coarse = LinearPhotograph::read(&path, &manifest).unwrap();
    assert!(coarse.steps.is_some() && (coarse.pixels[0][0] - 9.0 / 255.0 / 12.92).abs() < 1e-6);
    manifest.transfer = toml_transfer(false);
    let said = LinearPhotograph::read(&path, &manifest).unwrap_err().to_string();
    assert!(said.contains("d.png") && said.contains("16 bits"), "{said}");
    let mut maps = ChannelMaps::new(32, 24);
    ["R", "G", "B"].iter().for_each(|c| maps.push(*c, vec![f32::NAN; 32 * 24]));
    write_exr(&dir.path().join("e.exr"), &maps, Packing::Raw).unwrap();
    assert!(
        LinearPhotograph::read(&dir.path().join("e.exr"), &manifest).unwrap_err().to_string().contains("no reading")
    );
}

fn toml_transfer(srgb: bool) -> mesophyll::capture::photo::manifest::TransferCurve {
    use mesophyll::capture::photo::manifest::TransferCurve;
    if srgb { TransferCurve::Srgb } else { TransferCurve::Linear }
}
