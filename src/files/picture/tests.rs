//! Pictures as other programs write them, made here part by part.

use super::*;
use exr::math::Vec2;
use exr::meta::attribute::{Chromaticities, IntegerBounds};
use exr::meta::header::{ImageAttributes, LayerAttributes};
use exr::prelude::{AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, WritableImage};
use std::path::PathBuf;

/// A channel: its name, and the value of pixel k.
type Channel<'a> = (&'a str, fn(usize) -> f32);

/// A part: its name, its size, the place of its first pixel, and its channels.
type Part<'a> = (&'a str, [usize; 2], [i32; 2], &'a [Channel<'a>]);

/// Writes an EXR file whose display window begins at `from` and has `display` columns and rows.
fn write(path: &Path, from: [i32; 2], display: [usize; 2], stated: Option<&Primaries>, parts: &[Part]) {
    let window = IntegerBounds::new(Vec2(from[0], from[1]), Vec2(display[0], display[1]));
    let mut attributes = ImageAttributes::new(window);
    let point = |[x, y]: [f64; 2]| Vec2(x as f32, y as f32);
    attributes.chromaticities = stated.map(|[red, green, blue, white]| Chromaticities {
        red: point(*red),
        green: point(*green),
        blue: point(*blue),
        white: point(*white),
    });
    let layer = |(name, [w, h], [x, y], channels): &Part| {
        let samples = |f: &fn(usize) -> f32| FlatSamples::F32((0..w * h).map(f).collect());
        let channels = channels.iter().map(|(name, f)| AnyChannel::new(*name, samples(f))).collect();
        let mut own = LayerAttributes::named(*name);
        own.layer_position = Vec2(*x, *y);
        Layer::new((*w, *h), own, Encoding::SMALL_LOSSLESS, AnyChannels::sort(channels))
    };
    let layers: Vec<Layer<AnyChannels<FlatSamples>>> = parts.iter().map(layer).collect();
    Image::from_layers(attributes, layers).write().non_parallel().to_file(path).unwrap();
}

const PLAIN: [Channel; 3] = [("R", |k| k as f32), ("G", |k| 2.0 * k as f32), ("B", |_| 0.5)];

fn at(name: &str) -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    (dir, path)
}

fn colours(path: &Path) -> Result<LinearPicture> {
    read(path, &PictureRequest { names: &RGB, all: false, outside: 0.0 }, |_, _| Ok(()))
}

#[test]
fn a_picture_stored_in_part_is_padded_and_one_beyond_its_window_is_cut() {
    let (_dir, path) = at("window.exr");
    // The display window itself need not begin at 0.
    write(&path, [10, 20], [6, 4], None, &[("", [3, 2], [12, 21], &PLAIN)]);
    let LinearPicture { maps, said } = colours(&path).unwrap();
    assert_eq!((maps.width, maps.height), (6, 4));
    let want = [[0.0; 6], [0.0, 0.0, 0.0, 1.0, 2.0, 0.0], [0.0, 0.0, 3.0, 4.0, 5.0, 0.0], [0.0; 6]];
    assert_eq!(maps.get("R").unwrap(), want.as_flattened());
    assert!(said.len() == 1 && said[0].contains("3 x 2 pixels lie at 2, 1 of 6 x 4"), "{said:?}");
    let nan = read(&path, &PictureRequest { names: &RGB, all: false, outside: f32::NAN }, |_, _| Ok(())).unwrap();
    assert!(nan.maps.get("B").unwrap()[0].is_nan() && nan.maps.get("B").unwrap()[8] == 0.5);
    write(&path, [0, 0], [2, 2], None, &[("", [4, 3], [-1, 0], &PLAIN)]);
    let LinearPicture { maps, said } = colours(&path).unwrap();
    assert_eq!(maps.get("R").unwrap(), [1.0, 2.0, 5.0, 6.0]);
    assert!(said[0].contains("cut off"), "{said:?}");
    write(&path, [0, 0], [2, 2], None, &[("", [4, 3], [2, 0], &PLAIN)]);
    assert!(colours(&path).unwrap_err().to_string().contains("is empty"));
}

#[test]
fn colours_are_found_in_a_later_part_or_layer() {
    let (_dir, path) = at("parts.exr");
    let depth: [Channel; 1] = [("Z", |_| 9.0)];
    write(&path, [0, 0], [3, 2], None, &[("depth", [3, 2], [0, 0], &depth), ("beauty", [3, 2], [0, 0], &PLAIN)]);
    let LinearPicture { maps, said } = colours(&path).unwrap();
    assert_eq!(maps.get("G").unwrap(), [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]);
    assert_eq!(said, ["R, G, B are those of part 2 (\"beauty\")"]);
    let layer: [Channel; 5] =
        [("sky.R", |_| 1.0), ("sky.G", |_| 2.0), ("sky.B", |_| 3.0), ("sky.A", |_| 0.25), ("Z", |_| 9.0)];
    write(&path, [0, 0], [3, 2], None, &[("", [3, 2], [0, 0], &layer)]);
    let all = read(&path, &PictureRequest { names: &RGB, all: true, outside: 0.0 }, |_, _| Ok(())).unwrap();
    let names: Vec<&str> = all.maps.channels.iter().map(|c| c.0.as_str()).collect();
    assert_eq!(names, ["R", "G", "B", "Z", "A"]);
    assert!(all.maps.get("B").unwrap()[0] == 3.0 && all.maps.get("A").unwrap()[5] == 0.25);
    assert!(all.said[0].contains("layer \"sky\""), "{:?}", all.said);
    let two: [Channel; 6] =
        [("a.R", |_| 1.0), ("a.G", |_| 1.0), ("a.B", |_| 1.0), ("b.R", |_| 2.0), ("b.G", |_| 2.0), ("b.B", |_| 2.0)];
    write(&path, [0, 0], [3, 2], None, &[("", [3, 2], [0, 0], &two)]);
    let sentence = colours(&path).unwrap_err().to_string();
    assert!(sentence.contains("layer \"a\"") && sentence.contains("layer \"b\""), "{sentence}");
    write(&path, [0, 0], [3, 2], None, &[("depth", [3, 2], [0, 0], &depth), ("red", [3, 2], [0, 0], &PLAIN[..1])]);
    let sentence = colours(&path).unwrap_err().to_string();
    assert!(sentence.contains("no such channel") && sentence.contains('Z') && sentence.contains('R'), "{sentence}");
}

/// The same light in CIE XYZ, in ACES AP0 and in linear sRGB is the same picture. XYZ of (1, 2, ½) by IEC 61966-2-1.
#[test]
fn stated_chromaticities_change_the_colours() {
    let (_dir, path) = at("xyz.exr");
    let xyz: [Channel; 3] = [("R", |_| 1.217_8), ("G", |_| 1.679_1), ("B", |_| 0.732_9)];
    let stated = [[1.0, 0.0], [0.0, 1.0], [0.0, 0.0], [1.0 / 3.0, 1.0 / 3.0]];
    write(&path, [0, 0], [2, 1], Some(&stated), &[("", [2, 1], [0, 0], &xyz)]);
    let LinearPicture { maps, said } = colours(&path).unwrap();
    for (name, want) in RGB.into_iter().zip([1.0, 2.0, 0.5]) {
        assert!((maps.get(name).unwrap()[1] - want).abs() < 2e-3, "{name}: {:?}", maps.get(name));
    }
    assert_eq!(said, ["its colours are in CIE XYZ and were changed to linear sRGB"]);
    let white: [Channel; 3] = [("R", |_| 3.0), ("G", |_| 3.0), ("B", |_| 3.0)];
    let ap0 = [[0.7347, 0.2653], [0.0, 1.0], [0.0001, -0.077], [0.321_68, 0.337_67]];
    write(&path, [0, 0], [2, 1], Some(&ap0), &[("", [2, 1], [0, 0], &white)]);
    let LinearPicture { maps, said } = colours(&path).unwrap();
    assert!(maps.channels.iter().all(|c| (c.1[0] - 3.0).abs() < 1e-5) && said[0].contains("ACES AP0"), "{maps:?}");
    // Channels that are no colours stay as they are.
    let one = read(&path, &PictureRequest { names: &["G"], all: true, outside: 0.0 }, |_, _| Ok(())).unwrap();
    assert!(one.maps.channels[0] == ("G".to_string(), vec![3.0; 2]) && one.said.is_empty());
}

/// A Radiance picture, written byte by byte: one row of three pixels, and eight with runs.
#[test]
fn radiance_pictures_are_read_and_their_exposure_is_taken_out() {
    let (_dir, path) = at("sky.hdr");
    let mut bytes = b"#?RGBE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2\nEXPOSURE=4\n\n-Y 1 +X 3\n".to_vec();
    bytes.extend([128, 64, 0, 129, 0, 0, 0, 0, 255, 1, 2, 137]);
    std::fs::write(&path, &bytes).unwrap();
    let LinearPicture { maps, said } = colours(&path).unwrap();
    assert_eq!(maps.get("R").unwrap(), [0.125, 0.0, 255.0 * 2.0 / 8.0]);
    assert_eq!(maps.get("G").unwrap(), [0.0625, 0.0, 0.25]);
    assert!(said.len() == 1 && said[0].contains("exposures"), "{said:?}");
    let mut runs = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 8\n".to_vec();
    runs.extend([2, 2, 0, 8, 136, 128, 136, 64, 136, 32, 4, 128, 128, 129, 129, 132, 128]);
    std::fs::write(&path, &runs).unwrap();
    let maps = colours(&path).unwrap().maps;
    assert_eq!(maps.get("R").unwrap(), [0.5, 0.5, 1.0, 1.0, 0.5, 0.5, 0.5, 0.5]);
    for (name, broken) in [
        ("cut", &bytes[..bytes.len() - 3]),
        ("header", &bytes[..30]),
        ("xyze", &b"#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n1234"[..]),
        ("turned", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n+X 1 -Y 1\n1234"),
        ("huge", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 999999 +X 999999\n1234"),
    ] {
        std::fs::write(&path, broken).unwrap();
        let sentence = colours(&path).expect_err(name).to_string();
        assert!(sentence.contains("sky.hdr"), "{name}: {sentence}");
    }
    let y = read(&path, &PictureRequest { names: &["Y"], all: false, outside: 0.0 }, |_, _| Ok(())).unwrap_err();
    assert!(y.to_string().contains("holds R, G, B"), "{y}");
}

#[test]
fn a_few_readings_that_are_no_radiance_are_clamped_and_counted() {
    let mut texels = vec![[1.0f32, 2.0, 3.0]; 100];
    assert_eq!(clamp(&mut texels, 10), Ok(None));
    (texels[13][1], texels[14][0], texels[15][2], texels[50][1]) = (-1e-6, f32::NAN, f32::INFINITY, 9.0);
    let said = clamp(&mut texels, 10).unwrap().unwrap();
    assert_eq!([texels[13][1], texels[14][0], texels[15][2]], [0.0, 0.0, 3.0]);
    assert!(said.contains("300 readings 1 are negative and 2 not finite"), "{said}");
    assert!(said.contains("channel G, column 3, row 1"), "{said}");
    let refused = |bad: f32, count: usize| {
        let mut texels = vec![[1.0f32; 3]; 100];
        texels[..count].iter_mut().for_each(|t| *t = [bad; 3]);
        clamp(&mut texels, 10).unwrap_err()
    };
    assert!(refused(f32::NAN, 2).contains("6 of 300 readings are not finite"));
    assert!(refused(-1.0, 2).contains("6 of 300 readings are negative, 2.041 % of the light"));
    // Any number of negative readings is small where their light is.
    let mut noisy: Vec<[f32; 3]> = (0..100).map(|k| if k % 2 == 0 { [-1e-4; 3] } else { [1.0; 3] }).collect();
    assert!(clamp(&mut noisy, 10).unwrap().unwrap().contains("150 are negative"));
}
