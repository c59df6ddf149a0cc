//! Looks made of pictures that are drawn here, whose colours, opacity and normals are formulas.

use super::*;
use crate::leaf_folder::edit::{LeafSideEdit, save};
use crate::leaf_folder::{LeafFit, LeafFitFile};
use image::{Rgb, RgbImage, Rgba, RgbaImage};
use mesophyll_files::quantity::Quantity;
use mesophyll_optics::side::{Side, Sides};
use std::f64::consts::PI;

const SIZE: u32 = 64;

/// Whether the pixel is on an ellipse around `middle`.
fn ellipse(x: u32, y: u32, middle: [f64; 2], half: [f64; 2]) -> bool {
    let d = [f64::from(x) + 0.5 - middle[0], f64::from(y) + 0.5 - middle[1]];
    (d[0] / half[0]).powi(2) + (d[1] / half[1]).powi(2) < 1.0
}

fn on(x: u32, y: u32) -> bool {
    ellipse(x, y, [32.0, 32.0], [28.0, 14.0])
}

/// A folder with an albedo whose green is redder on the left half, and a look of it.
fn leaf() -> (tempfile::TempDir, Look) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("leaf.png");
    let pixel = |x, y| Rgba([if x < 32 { 90 } else { 60 }, 120, 40, if on(x, y) { 255 } else { 0 }]);
    RgbaImage::from_fn(SIZE, SIZE, pixel).save(&path).unwrap();
    let text = format!("albedo = {:?}\ntransfer = \"srgb\"\nrho_t_factor = 0.8\nwidth_mm = 32\n", path.display());
    (dir, toml::from_str(&text).unwrap())
}

fn light(code: u8) -> f32 {
    TransferCurve::Srgb.light(f64::from(code) / 255.0) as f32
}

fn made(look: &Look, dir: &tempfile::TempDir) -> LeafFit {
    let out = dir.path().join("out");
    run(look, "leaf", &out, true).unwrap();
    LeafFit::open(&out).unwrap()
}

fn refused(look: &Look) -> String {
    texels::read(look).map(|_| String::new()).unwrap_or_else(|e| e.to_string())
}

#[test]
fn a_picture_becomes_the_maps_and_the_blade_of_a_leaf_that_says_it_is_stated() {
    let (dir, look) = leaf();
    let look = Look { rho_s: Some([0.03; 3]), ..look };
    let found = made(&look, &dir);
    assert!(found.is_stated() && found.record.kind.words() == "stated look");
    let stated = found.record.stated_in_one().unwrap();
    for part in ["not fitted", "leaf.png", "curve srgb", "taken from the front", "0.8 times", "program's default"] {
        assert!(stated.contains(part), "{part}: {stated}");
    }
    found.record.verify(&found.folder).unwrap();
    assert_eq!(found.record.contradictions(), Vec::<String>::new());
    let (w, maps) = (64, found.maps(Side::Front).unwrap());
    assert_eq!((maps.width, maps.height), (w, w));
    let mask = maps.scalar(Quantity::Mask).unwrap();
    let (rho_d, rho_t) = (maps.three(Quantity::RhoD).unwrap(), maps.three(Quantity::RhoT).unwrap());
    for (x, y) in (0..SIZE).flat_map(|y| (0..SIZE).map(move |x| (x, y))) {
        let k = y as usize * w + x as usize;
        assert_eq!(mask[k], f32::from(u8::from(on(x, y))), "{x} {y}");
        if on(x, y) {
            let want = light(if x < 32 { 90 } else { 60 });
            assert!((rho_d[0][k] - want).abs() < 1e-6 && (rho_t[0][k] - 0.8 * want).abs() < 1e-6, "{x} {y}");
        }
    }
    // The back's camera sees the same colours with its columns reversed.
    let back = found.maps(Side::Back).unwrap().three(Quantity::RhoD).unwrap();
    let (k, behind) = (32 * w + 20, 32 * w + (w - 1 - 20));
    assert!(back[0][behind] == rho_d[0][k] && back[0][k] != rho_d[0][k]);
    // Half a millimetre a pixel: an ellipse of 14 by 7 mm half axes.
    let area = found.record.sections["blade"].figures["blade_area_mm2"];
    assert!((area / (PI * 14.0 * 7.0) - 1.0).abs() < 0.02, "{area}");
    assert_eq!(found.texel_mm().unwrap(), 0.5);
    // What is made again of the same is not made at all, and another value makes it again.
    let hash = look.input_hash().unwrap();
    assert_eq!(hash, found.record.input_hash);
    assert_ne!(hash, Look { rho_t_factor: Some(0.7), ..look }.input_hash().unwrap());
}

/// A look whose gloss was changed in the window is saved as a look, whose ρd and ρt are those that were stated.
#[test]
fn an_edited_look_is_still_stated() {
    let (dir, look) = leaf();
    let found = made(&Look { rho_s: Some([0.04; 3]), m: Some(0.3), ..look }, &dir);
    let edit = LeafSideEdit { rho_s: 0.5, m: 2.0, sigma_a: [3.0; 3], ..LeafSideEdit::default() };
    let saved = save(&found.edited(Sides::of(|_| edit)), dir.path()).unwrap();
    let saved = LeafFit::open(&saved).unwrap();
    saved.record.verify(&saved.folder).unwrap();
    assert!(saved.is_stated() && saved.record.options["gloss"].ends_with("changed by hand since"));
    let (before, after) = (found.maps(Side::Front).unwrap(), saved.maps(Side::Front).unwrap());
    for quantity in [Quantity::RhoD, Quantity::RhoT, Quantity::Normal] {
        assert_eq!(before.three(quantity), after.three(quantity));
    }
    assert_eq!(after.plane(Quantity::RhoS, 1).unwrap()[100], 0.02);
    assert_eq!(after.scalar(Quantity::M).unwrap()[100], 0.6);
}

/// Means over blocks weigh each pixel by its opacity: what lies beside the leaf does not bleed in.
#[test]
fn texels_are_means_over_the_leaf_only() {
    let (dir, look) = leaf();
    let path = dir.path().join("fringe.png");
    // Off the leaf the picture is white.
    let pixel = |x, y| if on(x, y) { Rgba([60, 120, 40, 255]) } else { Rgba([255, 255, 255, 0]) };
    RgbaImage::from_fn(SIZE, SIZE, pixel).save(&path).unwrap();
    let found = texels::read(&Look { albedo: path, texels: Some(32), ..look }).unwrap();
    assert_eq!((found.width, found.height, found.texel_mm), (32, 32, 1.0));
    assert!(found.rho_d[0].iter().all(|c| (c[0] - light(60)).abs() < 1e-6 && (c[1] - light(120)).abs() < 1e-6));
    assert!(found.cover.iter().any(|c| *c > 0.05 && *c < 0.45) && found.scaled == 0);
}

/// Two leaves in one picture, with an opacity picture, a picture of the light that comes through, and normals of a
/// wave whose crests run across the picture.
#[test]
fn a_region_of_an_atlas_picks_one_leaf_with_all_its_maps() {
    let (dir, look) = leaf();
    let at = |name: &str| dir.path().join(name);
    let two = |x, y| ellipse(x, y, [64.0, 32.0], [40.0, 20.0]) || ellipse(x, y, [190.0, 32.0], [40.0, 20.0]);
    let first = |x: u32| x < 128;
    let (w, h) = (256, 64);
    RgbImage::from_fn(w, h, |x, _| Rgb([if first(x) { 60 } else { 90 }, 120, 40])).save(at("albedo.png")).unwrap();
    image::GrayImage::from_fn(w, h, |x, y| image::Luma([if two(x, y) { 230 } else { 10 }])).save(at("o.png")).unwrap();
    RgbImage::from_fn(w, h, |x, _| Rgb([if first(x) { 10 } else { 100 }, 130, 20])).save(at("t.png")).unwrap();
    let slope = |y: u32| 0.3 * (f64::from(y) * 0.2).cos();
    let normals = |sign: f64| {
        RgbImage::from_fn(w, h, move |_, y| {
            let l = (1.0 + slope(y).powi(2)).sqrt();
            Rgb([0.0, sign * slope(y) / l, 1.0 / l].map(|v| ((v + 1.0) * 127.5).round() as u8))
        })
    };
    normals(1.0).save(at("gl.png")).unwrap();
    normals(-1.0).save(at("dx.png")).unwrap();
    let atlas = Look {
        albedo: at("albedo.png"),
        opacity: Some(at("o.png")),
        translucency: Some(at("t.png")),
        rho_t_factor: None,
        normal: Some(at("gl.png")),
        green: Some(GreenConvention::Opengl),
        ..look
    };
    // The rectangles that the refusal offers are those of the leaves.
    let said = refused(&atlas);
    assert!(said.contains("region: missing") && said.contains("2 pieces"), "{said}");
    assert!(said.contains("[23, 11, 82, 42]") && said.contains("[149, 11, 82, 42]"), "{said}");
    let region = Some([149, 11, 82, 42]);
    let found = texels::read(&Look { region, ..atlas.clone() }).unwrap();
    assert_eq!((found.width, found.height), (82, 42));
    assert!((found.texel_mm - 32.0 / 82.0).abs() < 1e-12);
    let k = 21 * 82 + 41;
    assert!(found.on[k] && (found.rho_d[0][k][0] - light(90)).abs() < 1e-6);
    assert!((found.rho_t[k][0] - light(100)).abs() < 1e-6, "{:?}", found.rho_t[k]);
    // Row 21 of the maps is row 32 of the picture.
    let l = (1.0 + slope(32).powi(2)).sqrt();
    assert!((f64::from(found.normal[k][1]) - slope(32) / l).abs() < 0.01, "{:?}", found.normal[k]);
    let directx = Look { normal: Some(at("dx.png")), green: Some(GreenConvention::Directx), region, ..atlas.clone() };
    let other = texels::read(&directx).unwrap();
    assert!(other.normal.iter().zip(&found.normal).all(|(a, b)| (0..3).all(|c| (a[c] - b[c]).abs() < 0.02)));
    // A grey picture is a share of the albedo.
    let share = Look { translucency: Some(at("o.png")), rho_t_factor: Some(0.5), region, ..atlas.clone() };
    let want = 0.5 * 230.0 / 255.0 * light(90);
    assert!((texels::read(&share).unwrap().rho_t[k][0] - want).abs() < 1e-4);
    // A region that cuts the neighbour leaves it out, and says so.
    let wide = texels::read(&Look { region: Some([90, 0, 166, 64]), ..atlas.clone() }).unwrap();
    let count = |on: &[bool]| on.iter().filter(|on| **on).count();
    assert!(count(&wide.on) == count(&found.on) && wide.warnings[0].contains("border"), "{:?}", wide.warnings);
    // The whole picture as a region keeps both, for a mesh whose texture coordinates pick among them.
    let both = texels::read(&Look { region: Some([0, 0, 256, 64]), ..atlas.clone() }).unwrap();
    assert!((both.width, both.height) == (256, 64) && count(&both.on) > 2 * count(&found.on) - 9);
    // On the back, bumps are dents: the same slope with its vertical part turned.
    let folder = at("back");
    run(&Look { region, ..atlas.clone() }, "leaf", &folder, false).unwrap();
    let fit = LeafFit::open(&folder).unwrap();
    let back = fit.maps(Side::Back).unwrap().three(Quantity::Normal).unwrap();
    assert!((back[1][k] + found.normal[k][1]).abs() < 1e-6 && LeafFitFile::Maps.path(&folder, Side::Back).is_file());
}

/// A bump has slopes across and down, so a wrong sign of green is seen.
#[test]
fn the_wrong_way_of_green_is_noticed() {
    let (dir, look) = leaf();
    let path = dir.path().join("n.png");
    let normal = |x: u32, y: u32| {
        // z = 3 sin(0.2 (x + y)) with y up: both slopes are the same, down the picture the second one turns.
        let s = 0.6 * (0.2 * (f64::from(x) - f64::from(y))).cos();
        let l = (1.0 + 2.0 * s * s).sqrt();
        Rgb([-s / l, -s / l, 1.0 / l].map(|v| ((v + 1.0) * 127.5).round() as u8))
    };
    RgbImage::from_fn(SIZE, SIZE, normal).save(&path).unwrap();
    let with = |green| texels::read(&Look { normal: Some(path.clone()), green: Some(green), ..look.clone() }).unwrap();
    assert_eq!(with(GreenConvention::Opengl).warnings, Vec::<String>::new());
    let said = with(GreenConvention::Directx).warnings.join(" ");
    assert!(said.contains("green = \"opengl\""), "{said}");
}

#[test]
fn few_texels_that_shine_are_scaled_and_many_are_refused() {
    let (dir, look) = leaf();
    let path = dir.path().join("bright.png");
    let bright = |n: u32| {
        let pixel = move |x, y| {
            let code = if x == 32 && (20..20 + n).contains(&y) { 250 } else { 90 };
            Rgba([code, 120, 40, if on(x, y) { 255 } else { 0 }])
        };
        RgbaImage::from_fn(SIZE, SIZE, pixel).save(&path).unwrap();
        Look { albedo: path.clone(), rho_s: Some([0.02; 3]), ..look.clone() }
    };
    let found = texels::read(&bright(3)).unwrap();
    assert_eq!(found.scaled, 3);
    assert!(found.warnings[0].contains("3 of") && found.warnings[0].contains("scaled"), "{:?}", found.warnings);
    for k in (0..found.on.len()).filter(|k| found.on[*k]) {
        let sum = found.rho_d[0][k][0] + found.rho_t[k][0] + 0.02;
        assert!(sum <= 1.0 + 1e-5, "{sum}");
        // The colour of the light that comes through keeps its share.
        assert!((found.rho_t[k][0] - 0.8 * found.rho_d[0][k][0]).abs() < 1e-5);
    }
    let said = refused(&bright(20));
    assert!(said.contains("more light than falls on them") && said.contains("rho_t_factor"), "{said}");
}

#[test]
fn what_contradicts_itself_is_refused_by_name() {
    let (dir, look) = leaf();
    let at = |name: &str| dir.path().join(name);
    RgbImage::from_pixel(32, 32, Rgb([128, 128, 255])).save(at("small.png")).unwrap();
    image::GrayImage::from_pixel(SIZE, SIZE, image::Luma([0])).save(at("empty.png")).unwrap();
    RgbImage::from_pixel(SIZE, SIZE, Rgb([90, 120, 40])).save(at("bare.png")).unwrap();
    // A map of normals that was brightened as a colour.
    RgbImage::from_pixel(SIZE, SIZE, Rgb([188, 188, 255])).save(at("brightened.png")).unwrap();
    let normal = |name: &str| Look { normal: Some(at(name)), green: Some(GreenConvention::Opengl), ..look.clone() };
    for (look, words) in [
        (normal("small.png"), "small.png: found 32x32 pixels, expected 64x64 as the albedo has"),
        (normal("brightened.png"), "normal of length 1"),
        (Look { opacity: Some(at("empty.png")), ..look.clone() }, "empty.png: opacity: only 0 of"),
        (Look { albedo: at("bare.png"), ..look.clone() }, "holds no opacity"),
        (Look { transfer: None, ..look.clone() }, "no colour profile"),
        (Look { transfer: Some(TransferCurve::Linear), ..look.clone() }, "8 bits"),
        (Look { region: Some([0, 0, 65, 64]), ..look.clone() }, "region: found [0, 0, 65, 64], expected"),
        (Look { region: Some([0, 0, 64, 3]), ..look.clone() }, "opacity: only 0 of"),
    ] {
        let said = refused(&look);
        assert!(said.contains(words), "{said}\nexpected {words}");
    }
    for (look, field) in [
        (Look { width_mm: None, ..look.clone() }, "width_mm"),
        (Look { rho_t_factor: None, ..look.clone() }, "rho_t_factor"),
        (Look { cutoff: Some(0.0), ..look.clone() }, "cutoff"),
        (Look { m: Some(0.3), ..look.clone() }, "m"),
        (Look { normal: Some(at("small.png")), ..look.clone() }, "green"),
        (Look { rho_s: Some([0.1, 0.1, f64::NAN]), ..look.clone() }, "rho_s"),
    ] {
        assert_eq!(look.fault().map(|f| f.0), Some(field));
    }
    assert_eq!(look.fault(), None);
    let file = at("look.toml");
    std::fs::write(&file, "albedo = \"leaf.png\"\nrho_t_factor = 0.8\nwidth_m = 3\n").unwrap();
    assert!(Look::read(&file).unwrap_err().to_string().contains("look.toml:3: unknown field `width_m`"));
}
