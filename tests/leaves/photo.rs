//! Photographs in open shade and on a light table: from synthesis to a fit, against the truth, and bad pictures.

use crate::common::{copy_tree, refused, run, succeeded};
use mesophyll::capture::synth::spec::Spec;
use mesophyll::files::image::{Maps, Packing, read_exr, write_exr};
use mesophyll::leaf::LeafFit;
use mesophyll::optics::side::Side;
use mesophyll::optics::slab::exact;
use mesophyll::photo::{Manifest, picture::Picture, reduce};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A noisy capture, made once.
fn made() -> &'static (tempfile::TempDir, PathBuf) {
    static ONCE: OnceLock<(tempfile::TempDir, PathBuf)> = OnceLock::new();
    ONCE.get_or_init(|| {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("photo");
        let options = ["--acquisition", "photo", "--size", "200x150", "--seed", "2"];
        succeeded(&run([&["synth", "data/leaves/elm.toml", "-o", text(&folder)], &options[..]].concat()));
        (dir, folder)
    })
}

/// What a folder with a change says when it is reduced; empty where nothing is wrong.
fn changed(change: impl FnOnce(&Path)) -> String {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("photo");
    copy_tree(&made().1, &folder);
    change(&folder);
    let outcome = Manifest::read(&folder).and_then(|m| reduce(&folder, &m));
    outcome.err().map_or_else(String::new, |e| e.to_string())
}

fn toml(folder: &Path, from: &str, to: &str) {
    let path = folder.join("capture.toml");
    let old = std::fs::read_to_string(&path).unwrap();
    assert!(old.contains(from), "{from} is not in\n{old}");
    std::fs::write(path, old.replacen(from, to, 1)).unwrap();
}

/// Rewrites a picture row by row.
fn rows(folder: &Path, file: &str, change: impl Fn(&mut [f32])) {
    let mut maps = read_exr(&folder.join(file)).unwrap();
    let w = maps.width;
    maps.channels.iter_mut().for_each(|(_, v)| v.chunks_mut(w).for_each(&change));
    write_exr(&folder.join(file), &maps, Packing::Raw).unwrap();
}

/// The pixels of this small picture are half a millimetre wide, and the finest veins are not. So the maps have texels
/// of four pixels, where the blur of sampling is small beside noise.
///
/// The truth lies within the stated errors: σa and σs of both sides, and the maps of ρd and ρt. What no photograph
/// shows is said by name, and the folder is a leaf fit that the report and the exports take.
#[test]
fn a_photographed_leaf_is_found_within_its_errors() {
    let (dir, folder) = made();
    let (out, coarse) = (dir.path().join("fit"), dir.path().join("coarse"));
    copy_tree(folder, &coarse);
    toml(&coarse, "noise_photon", "texel_mm = 2.0\nnoise_photon");
    let folder = &coarse;
    succeeded(&run(["fit", "leaf", text(folder), "-o", text(&out)]));
    let fit = LeafFit::open(&out).unwrap();
    let spec = Spec::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("data/leaves/elm.toml")).unwrap();
    for side in [Side::Front, Side::Back] {
        let section = fit.section(side).unwrap();
        for (name, truth) in [("sigma_a", spec.interior.sigma_a), ("sigma_s", spec.interior.sigma_s)] {
            let found = &section.params[name];
            for (c, truth) in truth.into_iter().enumerate() {
                let (value, error) = (found.value[c], found.stderr[c]);
                println!("{} {name} {c}: {value:.3} ± {error:.3}, truth {truth}", side.name());
                // Twelve numbers: three standard errors are passed by chance once in thirty.
                assert!((value - truth).abs() < 3.0 * error, "{} {name} {c}", side.name());
                assert!(error < 0.4 * truth, "{} {name} {c}: an error of {error} says nothing", side.name());
            }
        }
        for name in ["rho_d", "rho_t"] {
            let truth = section.truth[name];
            println!("{} {name}: {truth:?}", side.name());
            // The front was up on the table. Light that crosses the leaf the other way spreads a little differently, so
            // the back's ρt is not what was photographed.
            if (name, side) != ("rho_t", Side::Back) {
                assert!(truth.coverage95.unwrap() > 0.9, "{} {name}: {truth:?}", side.name());
            }
        }
        let errors = read_exr(&out.join(format!("{}_err.exr", side.name()))).unwrap();
        let open = |name: &str| errors.get(name).unwrap().iter().all(|e| e.is_nan() || e.is_infinite());
        assert!(open("normal.X") && open("rho_s.G") && open("m.Y") && !open("rho_d.G"));
    }
    let said = |name: &str| fit.record.options[name].clone();
    assert!(said("normal").starts_with("undetermined") && said("gloss").starts_with("stated"));
    // A tick is two of these pixels from the next, which is too fine, so the marks alone give the scale.
    let scale_err = fit.section(Side::Front).unwrap().figures["scale_relative_err"];
    assert!(said("scale").contains("two marks") && scale_err < 0.03, "{}", said("scale"));
    // The field is 76 mm wide or 57 mm tall in the upper .76 of the picture.
    let pixel = 4.0 * f64::max(76.0 / 200.0, 57.0 / (0.76 * 150.0));
    let off = fit.texel_mm().unwrap() / pixel - 1.0;
    assert!(off.abs() < 3.0 * scale_err, "{off} {scale_err}");
    let report = run(["report", text(&out), "-o", text(&dir.path().join("fit.html"))]);
    succeeded(&report);
    succeeded(&run(["export", text(&out), "--to", "gltf", "-o", text(&dir.path().join("fit.glb"))]));
    // The same command again finds its own fit and writes nothing.
    let written = || std::fs::metadata(out.join("front.exr")).unwrap().modified().unwrap();
    let before = written();
    succeeded(&run(["fit", "leaf", text(folder), "-o", text(&out)]));
    assert_eq!(before, written());
    refused(&run(["fit", "leaf", text(folder), "-o", text(&out), "--gloss", "1.4,0.3"]), 2, &["[gloss]"]);
}

/// What the photographs of open shade and of the table measure is the slab's ρd and ρt: light from the whole
/// hemisphere, added up direction by direction, that is scattered once towards a camera along the normal. With an
/// albedo of 1e-3 a second scattering adds at most that share.
#[test]
fn a_camera_over_open_shade_sees_the_slab() {
    const STEPS: usize = 20_000;
    for delta in [0.2, 1.0, 3.0] {
        let omega = 1e-3;
        let slab = exact::response((1.0 - omega) * delta, omega * delta, 1.0);
        let (mut up, mut down) = (0.0, f64::exp(-delta));
        for k in 0..STEPS {
            let mu: f64 = (k as f64 + 0.5) / STEPS as f64;
            // Radiance 1 from every direction; the source of the scattered light at depth x is ω/2 ∫ exp(−x/μ) dμ, and
            // exp(−x) or exp(−(δ − x)) of it reaches the camera.
            up += 0.5 * omega * (1.0 - f64::exp(-delta * (1.0 + 1.0 / mu))) / (1.0 + 1.0 / mu) / STEPS as f64;
            let steep = 1.0 / mu - 1.0;
            down += 0.5 * omega * f64::exp(-delta) * -f64::exp_m1(-delta * steep) / steep / STEPS as f64;
        }
        assert!((slab.rho_d / up - 1.0).abs() < 2.0 * omega, "{delta}: {} {up}", slab.rho_d);
        let scattered = (down - f64::exp(-delta)) / down;
        assert!((slab.rho_t / down - 1.0).abs() < 2.0 * omega * scattered + 1e-8, "{delta}: {} {down}", slab.rho_t);
    }
}

/// A range of thickness enters the errors in full: σ × thickness is what was measured.
#[test]
fn a_range_of_thickness_widens_every_error() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("photo");
    copy_tree(&made().1, &folder);
    let stated = std::fs::read_to_string(folder.join("capture.toml")).unwrap();
    let lines = stated.lines().filter(|l| !l.starts_with("thickness")).collect::<Vec<_>>().join("\n");
    let ranged = lines.replace("transfer =", "thickness_range_mm = [0.1, 0.2]\ntransfer =");
    std::fs::write(folder.join("capture.toml"), ranged).unwrap();
    let out = dir.path().join("fit");
    succeeded(&run(["fit", "leaf", text(&folder), "-o", text(&out)]));
    let fit = LeafFit::open(&out).unwrap();
    let found = &fit.section(Side::Front).unwrap().params["sigma_a"];
    // A thickness that may lie anywhere in a range has the standard deviation of its width over √12.
    let width = 0.1 / 12f64.sqrt() / 0.15;
    assert!((0..3).all(|c| found.stderr[c] / found.value[c] > width && found.stderr[c] / found.value[c] < 1.2 * width));
    assert_eq!(found.undetermined.len(), 3, "{found:?}");
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

/// 16-bit PNG and TIFF files hold the same light as EXR files, linear or by the sRGB curve; 8 bits are refused.
#[test]
fn developed_pictures_are_read() {
    let dir = tempfile::tempdir().unwrap();
    let mut manifest = Manifest::read(&made().1).unwrap();
    let light = |i: u32, j: u32| [0.9 * i as f32 / 32.0, 0.02 * j as f32, 0.001 * (i + j) as f32];
    let encode = |v: f32| if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    for (name, srgb) in [("a.png", false), ("b.tif", false), ("c.tiff", true)] {
        let path = dir.path().join(name);
        let count = |v: f32| ((if srgb { encode(v) } else { v }) * 65535.0).round() as u16;
        image::ImageBuffer::from_fn(32, 24, |i, j| image::Rgb(light(i, j).map(count))).save(&path).unwrap();
        manifest.transfer = toml_transfer(srgb);
        let picture = Picture::read(&path, &manifest).unwrap();
        for k in 0..32 * 24 {
            for (found, truth) in picture.pixels[k].into_iter().zip(light(k as u32 % 32, k as u32 / 32)) {
                // Half a count; the curve is at most 2.4 / 1.055 times as steep.
                assert!((found - truth).abs() < 1.3 / 65535.0 + 1e-6, "{name} {k}: {found} {truth}");
            }
        }
    }
    let path = dir.path().join("d.png");
    image::ImageBuffer::from_fn(32, 24, |_, _| image::Rgb([9u8; 3])).save(&path).unwrap();
    let said = Picture::read(&path, &manifest).unwrap_err().to_string();
    assert!(said.contains("d.png") && said.contains("16 bits"), "{said}");
    let mut maps = Maps::new(32, 24);
    ["R", "G", "B"].iter().for_each(|c| maps.push(*c, vec![f32::NAN; 32 * 24]));
    write_exr(&dir.path().join("e.exr"), &maps, Packing::Raw).unwrap();
    assert!(Picture::read(&dir.path().join("e.exr"), &manifest).unwrap_err().to_string().contains("no reading"));
}

fn toml_transfer(srgb: bool) -> mesophyll::photo::manifest::Transfer {
    use mesophyll::photo::manifest::Transfer;
    if srgb { Transfer::Srgb } else { Transfer::Linear }
}
