//! `fit leaf` of captures that lack something or hold something wrong: what is wrong is named.

use crate::common::{refused, succeeded};
use crate::leaf_fit::{damaged, fit, small_scan};
use mesophyll::files::image::{Packing, read_exr, write_exr};
use mesophyll::files::quantity::Quantity;
use mesophyll::fits::record::FitRecord;

#[test]
fn a_missing_frame_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let capture = damaged(&dir, |c| std::fs::remove_file(c.join("front/x/0007.exr")).unwrap());
    refused(&fit(&capture, &dir), 2, &["front/x/0007.exr", "no such file"]);
}

#[test]
fn a_frame_of_another_size_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let capture = damaged(&dir, |c| {
        let path = c.join("back/y/0003.exr");
        let mut maps = read_exr(&path).unwrap();
        maps.height -= 2;
        let n = maps.width * maps.height;
        maps.channels.iter_mut().for_each(|(_, s)| s.truncate(n));
        write_exr(&path, &maps, Packing::Raw).unwrap();
    });
    refused(&fit(&capture, &dir), 2, &["back/y/0003.exr", "24x16", "24x18"]);
}

#[test]
fn a_truncated_frame_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let capture = damaged(&dir, |c| {
        let path = c.join("front/y/0005.exr");
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() * 2 / 3]).unwrap();
    });
    refused(&fit(&capture, &dir), 2, &["front/y/0005.exr"]);
    assert!(!dir.path().join("fit/fit.toml").exists());
    // A fit that exists already stays unchanged.
    succeeded(&fit(small_scan().to_str().unwrap(), &dir));
    let before = std::fs::read(dir.path().join("fit/fit.toml")).unwrap();
    refused(&fit(&capture, &dir), 2, &["front/y/0005.exr"]);
    assert_eq!(std::fs::read(dir.path().join("fit/fit.toml")).unwrap(), before);
    FitRecord::read(&dir.path().join("fit")).unwrap().verify(&dir.path().join("fit")).unwrap();
}

#[test]
fn dead_pixels_are_left_out_and_texels_without_readings_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let at = 9 * 24 + 12;
    let capture = damaged(&dir, |c| {
        for k in 0..16 {
            for travel in ["x", "y"] {
                let path = c.join(format!("front/{travel}/{k:04}.exr"));
                let mut maps = read_exr(&path).unwrap();
                for (_, s) in &mut maps.channels {
                    s[at] = f32::NAN; // this texel has no reading in any frame
                    if k == 5 {
                        s[at + 1] = f32::NAN; // its neighbour lacks one frame
                    }
                }
                write_exr(&path, &maps, Packing::Raw).unwrap();
            }
        }
    });
    succeeded(&fit(&capture, &dir));
    let record = FitRecord::read(&dir.path().join("fit")).unwrap();
    assert!(record.sections["front"].counts["no_reading"] >= 1);
    let maps = read_exr(&dir.path().join("fit/front.exr")).unwrap();
    let mask = maps.scalar(Quantity::Mask).unwrap();
    assert_eq!((mask[at], mask[at + 1]), (-1.0, 1.0));
    assert_eq!(record.defects["-1"], "no_reading");
}

#[test]
fn a_scan_that_is_saturated_everywhere_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let capture = damaged(&dir, |c| {
        for k in 0..16 {
            for travel in ["x", "y"] {
                let path = c.join(format!("front/{travel}/{k:04}.exr"));
                let mut maps = read_exr(&path).unwrap();
                maps.channels.iter_mut().for_each(|(_, s)| s.fill(f32::NAN));
                write_exr(&path, &maps, Packing::Raw).unwrap();
            }
        }
    });
    refused(&fit(&capture, &dir), 1, &["front", "no texel could be fitted"]);
}

#[test]
fn the_manifest_is_checked_field_by_field() {
    let cases: [(&str, &str, &[&str]); 6] = [
        ("thickness_mm = ", "thickness_mm = -0.2 # ", &["capture.toml", "thickness_mm", "-0.2", "positive"]),
        ("schema = 1", "schema = 1\ncolour = \"green\"", &["capture.toml", "colour"]),
        ("schema = 1", "schema = 7", &["schema", "found 7", "expected 1"]),
        ("texel_mm = ", "texel_mm = \"wide\" # ", &["capture.toml", "string"]),
        ("frames = ", "frames = 2 # ", &["frames", "8 to 10000"]),
        ("camera_deg = ", "camera_deg = 90.0 # ", &["camera_deg", "90"]),
    ];
    for (from, to, words) in cases {
        let dir = tempfile::tempdir().unwrap();
        let capture = damaged(&dir, |c| {
            let path = c.join("capture.toml");
            let text = std::fs::read_to_string(&path).unwrap();
            assert!(text.contains(from), "{text}");
            std::fs::write(&path, text.replacen(from, to, 1)).unwrap();
        });
        refused(&fit(&capture, &dir), 2, words);
    }
}
