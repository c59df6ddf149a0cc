//! `mesophyll export` as a program. Its files are read back, with other readers where there are any.

use crate::samples::{Sample, write_fit};
use mesophyll::files::image::{self, ChannelMaps};
use mesophyll::files::quantity::{Quantity, XYZ};
use mesophyll::fits::leaf::blade::{BladeMesh, glb};
use mesophyll::fits::leaf_folder::LeafFit;
use mesophyll::optics::gloss::Lobe;
use mesophyll::optics::side::Side;
use std::f64::consts::PI;
use std::path::Path;
use std::process::Command;

fn mesophyll(args: &[&str], folder: &Path) -> (i32, String, String) {
    let out = Command::new(env!("CARGO_BIN_EXE_mesophyll")).args(args).current_dir(folder).output().unwrap();
    let text = |b: &[u8]| String::from_utf8_lossy(b).into_owned();
    (out.status.code().unwrap_or(-1), text(&out.stdout), text(&out.stderr))
}

fn export(folder: &Path, format: &str, to: &str) {
    let (code, _, stderr) = mesophyll(&["export", "elm", "--to", format, "-o", to], folder);
    assert_eq!(code, 0, "{stderr}");
}

/// A sample fit with a blade of two triangles that covers the maps, 30 mm × 20 mm.
pub fn with_blade(folder: &Path) {
    write_fit(&folder.join("elm"), &Sample::default());
    let blade = BladeMesh {
        positions: vec![[-15.0, 10.0, 0.0], [15.0, 10.0, 0.0], [15.0, -10.0, 0.0], [-15.0, -10.0, 0.0]],
        normals: vec![[0.0, 0.0, 1.0]; 4],
        tangents: vec![[1.0, 0.0, 0.0, 1.0]; 4],
        uvs: vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]],
        indices: vec![0, 2, 1, 0, 3, 2],
        ..BladeMesh::default()
    };
    glb::write(&folder.join("elm/blade.glb"), "elm", &blade).unwrap();
}

/// 8-bit sRGB → linear, by the standard's own inverse.
fn linear(byte: u8) -> f32 {
    let s = f32::from(byte) / 255.0;
    if s <= 0.04045 { s / 12.92 } else { ((s + 0.055) / 1.055).powf(2.4) }
}

#[test]
fn the_exr_holds_every_map_and_error_bit_for_bit() {
    let dir = tempfile::tempdir().unwrap();
    with_blade(dir.path());
    export(dir.path(), "exr", "all.exr");
    let all = image::read_exr(&dir.path().join("all.exr")).unwrap();
    let mut channels = 0;
    for side in ["front", "back"] {
        for (file, prefix) in
            [(format!("{side}.exr"), side.to_string()), (format!("{side}_err.exr"), format!("{side}.err"))]
        {
            let own = image::read_exr(&dir.path().join("elm").join(file)).unwrap();
            for (name, samples) in &own.channels {
                let copy = all.get(&format!("{prefix}.{name}")).unwrap();
                assert!(
                    samples.iter().zip(copy).all(|(a, b)| a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan())),
                    "{prefix}.{name}"
                );
                channels += 1;
            }
        }
    }
    assert_eq!(channels, all.channels.len());
}

#[test]
fn the_table_has_a_row_a_texel_and_reads_back_exactly() {
    let dir = tempfile::tempdir().unwrap();
    with_blade(dir.path());
    export(dir.path(), "csv", "t.csv");
    let front = image::read_exr(&dir.path().join("elm/front.exr")).unwrap();
    let errors = image::read_exr(&dir.path().join("elm/front_err.exr")).unwrap();
    let on_leaf = front.scalar(Quantity::Mask).unwrap().iter().filter(|m| **m != 0.0).count();
    let mut table = csv::Reader::from_path(dir.path().join("t.csv")).unwrap();
    let head = table.headers().unwrap().clone();
    let at = |name: &str| head.iter().position(|h| h == name).unwrap_or_else(|| panic!("no column {name}"));
    let columns = [("sigma_a_g", "sigma_a.G"), ("thickness", "thickness.Y"), ("normal_y", "normal.Y")];
    let mut rows = 0;
    for row in table.records().map(Result::unwrap).filter(|r| &r[0] == "front") {
        rows += 1;
        let k = row[1].parse::<usize>().unwrap() + front.width * row[2].parse::<usize>().unwrap();
        for (column, channel) in columns {
            let expected = front.get(channel).unwrap()[k];
            let found = row[at(column)].parse::<f32>().ok();
            assert_eq!(found.map(f32::to_bits), expected.is_finite().then_some(expected.to_bits()), "{column} at {k}");
        }
        let expected = errors.plane(Quantity::SigmaA, 1).unwrap()[k];
        assert_eq!(row[at("sigma_a_g_err")].parse::<f32>().ok(), expected.is_finite().then_some(expected));
    }
    assert_eq!(rows, on_leaf);
}

/// W's packing holds the named maps, and normals in the blade's frame as a reader of the mesh computes it.
#[test]
fn packed_textures_hold_the_named_maps() {
    let dir = tempfile::tempdir().unwrap();
    with_blade(dir.path());
    export(dir.path(), "packed", "packed");
    let leaf = LeafFit::open(&dir.path().join("elm")).unwrap();
    for side in Side::ALL {
        let read = |what: &str| {
            image::read_exr(&dir.path().join("packed").join(format!("{}_{what}.exr", side.name()))).unwrap()
        };
        let maps = leaf.maps(side).unwrap();
        let h = leaf.thickness(side).unwrap();
        let (first, second, normal) = (read("gamma_delta"), read("rho_s_m"), read("normal"));
        // The values are the same bit for bit, also where they are undetermined (NaN).
        let same = |a: &ChannelMaps, name: &str, quantity, c| {
            let (a, b) = (a.get(name).unwrap(), maps.plane(quantity, c).unwrap());
            assert!(a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits()), "{name}");
        };
        for (c, name) in ["R", "G", "B"].into_iter().enumerate() {
            same(&first, name, Quantity::Gamma, c);
            same(&second, name, Quantity::RhoS, c);
        }
        same(&second, "A", Quantity::M, 0);
        let (delta, whole) = (first.get("A").unwrap(), maps.scalar(Quantity::Thickness).unwrap());
        assert!(delta.iter().zip(whole).all(|(d, t)| t.is_nan() || (f64::from(*d) + h - f64::from(*t)).abs() < 1e-7));
        // The sample's blade is flat and lies along x, so its frame is that of the photograph on both sides.
        let (seen, turned) = (maps.three(Quantity::Normal).unwrap(), XYZ.map(|c| normal.get(c).unwrap()));
        let known: Vec<usize> = (0..whole.len()).filter(|&k| seen.iter().all(|p| p[k].is_finite())).collect();
        assert!(known.len() > whole.len() / 10, "{} texels have a normal", known.len());
        for (c, k) in known.into_iter().flat_map(|k| [0, 1, 2].map(|c| (c, k))) {
            assert!((seen[c][k] - turned[c][k]).abs() < 1e-6, "{} at {k}: {} {}", XYZ[c], seen[c][k], turned[c][k]);
        }
    }
}

#[test]
fn pictures_mean_what_their_ranges_say() {
    let dir = tempfile::tempdir().unwrap();
    with_blade(dir.path());
    export(dir.path(), "png", "maps");
    let ranges: serde_json::Value =
        serde_json::from_slice(&std::fs::read(dir.path().join("maps/ranges.json")).unwrap()).unwrap();
    let front = image::read_exr(&dir.path().join("elm/front.exr")).unwrap();
    let mask = front.scalar(Quantity::Mask).unwrap();
    let open = |name: &str| ::image::open(dir.path().join("maps").join(name)).unwrap().to_rgb8();
    let (rho, thickness) = (open("front_rho_d.png"), open("front_thickness.png"));
    let range = &ranges["files"]["front_thickness.png"];
    let (low, high) = (range["low"].as_f64().unwrap() as f32, range["high"].as_f64().unwrap() as f32);
    let step = (high - low) / 255.0;
    for k in (0..mask.len()).filter(|k| mask[*k] == 1.0) {
        let (x, y) = ((k % front.width) as u32, (k / front.width) as u32);
        let green = front.plane(Quantity::RhoD, 1).unwrap()[k];
        // a byte is at most 0.009 wide in linear light
        assert!((linear(rho.get_pixel(x, y)[1]) - green).abs() < 0.005, "{k}");
        let value = front.scalar(Quantity::Thickness).unwrap()[k];
        let read = low + step * f32::from(thickness.get_pixel(x, y)[0]);
        assert!((read - value.clamp(low, high)).abs() < 0.51 * step, "{k}: {read} against {value}");
    }
    assert!(ranges["files"]["front_rho_d.png"]["encoding"].as_str().unwrap().starts_with("sRGB"));
    assert_eq!(open("back_mask.png").dimensions(), (72, 54));
}

/// The share of even light that comes back: an average over 90,000 pairs of directions, both drawn by their cosines.
fn even(f: impl Fn([f64; 3], [f64; 3]) -> f64) -> f64 {
    let n = 90_000;
    let at = |k: usize, a: f64| (0.5 + a * k as f64).fract();
    let direction = |x: f64, y: f64| {
        let (sin, cos) = (2.0 * PI * y).sin_cos();
        [x.sqrt() * cos, x.sqrt() * sin, (1.0 - x).sqrt()]
    };
    let pair = |k: usize| f(direction(at(k, 0.8191725), 0.0), direction(at(k, 0.6710436), at(k, 0.5497005)));
    (0..n).map(pair).sum::<f64>() * PI / n as f64
}

/// glTF's D·V (Appendix B.3.2), for the normal z.
fn ggx(v: [f64; 3], l: [f64; 3], alpha: f64) -> f64 {
    let sum = [v[0] + l[0], v[1] + l[1], v[2] + l[2]];
    let h = sum[2] / (sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]).sqrt();
    let a2 = alpha * alpha;
    let d = a2 / (PI * ((h * h) * (a2 - 1.0) + 1.0).powi(2));
    let root = |a: f64| (a * a * (1.0 - a2) + a2).sqrt();
    d * 0.5 / (l[2] * root(v[2]) + v[2] * root(l[2]))
}

#[test]
fn a_gltf_reader_sees_both_sides_in_metres_with_their_colours() {
    let dir = tempfile::tempdir().unwrap();
    with_blade(dir.path());
    export(dir.path(), "gltf", "leaf.glb");
    let (document, buffers, images) = gltf::import(dir.path().join("leaf.glb")).unwrap();
    let node = document.nodes().next().unwrap();
    assert_eq!(node.transform().decomposed().2, [0.001; 3]);
    let primitives: Vec<_> = document.meshes().next().unwrap().primitives().collect();
    assert_eq!(primitives.len(), 2);
    let source = |name: &str| image::read_exr(&dir.path().join("elm").join(name)).unwrap();
    for (primitive, side) in primitives.iter().zip(["front", "back"]) {
        let reader = primitive.reader(|b| Some(&buffers[b.index()]));
        let p: Vec<[f32; 3]> = reader.read_positions().unwrap().collect();
        let n: Vec<[f32; 3]> = reader.read_normals().unwrap().collect();
        let uv: Vec<[f32; 2]> = reader.read_tex_coords(0).unwrap().into_f32().collect();
        let t: Vec<[f32; 4]> = reader.read_tangents().unwrap().collect();
        let i: Vec<u32> = reader.read_indices().unwrap().into_u32().collect();
        let up = if side == "front" { 1.0 } else { -1.0 };
        for f in i.chunks_exact(3) {
            let [a, b, c] = [f[0], f[1], f[2]].map(|k| p[k as usize]);
            let turning = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
            assert!(turning * up > 0.0, "{side}: triangles wind around their normal");
        }
        assert!(n.iter().all(|n| n[2] == up));
        // The leaf is 0.1612 mm thick, and its back stands so far behind.
        assert!(p.iter().all(|p| (p[2] - 0.0806 * (up - 1.0)).abs() < 1e-6), "{side}: {p:?}");
        // The bitangent w · n × t points up in the image (towards smaller v) on both sides.
        assert!(n.iter().zip(&t).all(|(n, t)| t[3] * (n[2] * t[0] - n[0] * t[2]) > 0.0));
        // This is a good texel of the side. Column i of the back's own camera lies at 1 − u.
        let maps = source(&format!("{side}.exr"));
        let mask = maps.scalar(Quantity::Mask).unwrap();
        let k = (0..mask.len()).filter(|k| mask[*k] == 1.0).nth(500).unwrap();
        let (column, row) = (k % maps.width, k / maps.width);
        let u = (column as f32 + 0.5) / maps.width as f32;
        let u = if side == "front" { u } else { 1.0 - u };
        assert!(uv.iter().any(|t| t[0] <= u) && uv.iter().any(|t| t[0] >= u));
        let at = |picture: &gltf::image::Data, channels: usize| {
            let x = (u * picture.width as f32) as usize;
            picture.pixels[channels * (row * picture.width as usize + x)..][..channels].to_vec()
        };
        let pbr = primitive.material().pbr_metallic_roughness();
        let base = at(&images[pbr.base_color_texture().unwrap().texture().source().index()], 3);
        let roughness = at(&images[pbr.metallic_roughness_texture().unwrap().texture().source().index()], 3)[1];
        let specular = primitive.material().extension_value("KHR_materials_specular").unwrap().clone();
        let texture = specular["specularColorTexture"]["index"].as_u64().unwrap() as usize;
        let gloss = at(&images[document.textures().nth(texture).unwrap().source().index()], 4);
        let alpha = (f64::from(roughness) / 255.0).powi(2);
        let w = f64::from(gloss[3]) / 255.0;
        // What it sends back of even light by glTF's own formulas (Appendix B) is what the fitted leaf sends back.
        for (c, name) in ["R", "G", "B"].iter().enumerate() {
            let value = |q: &str| f64::from(maps.get(&format!("{q}.{name}")).unwrap()[k]);
            let m = f64::from(maps.scalar(Quantity::M).unwrap()[k]);
            let (d, f0) = (f64::from(linear(base[c])), w * f64::from(linear(gloss[c])));
            let theirs = even(|v, l| (1.0 - w) * d / PI + f0 * ggx(v, l, alpha));
            let ours =
                even(|v, l| value("rho_d") / PI + value("rho_s") * Lobe::Beckmann.bounded([0.0, 0.0, 1.0], l, v, m));
            assert!((theirs - ours).abs() < 0.006, "{side} {name}: {theirs} against {ours}");
        }
    }
}

#[test]
fn what_shines_through_adds_up_to_what_was_fitted() {
    let dir = tempfile::tempdir().unwrap();
    with_blade(dir.path());
    export(dir.path(), "gltf-translucent", "leaf.glb");
    let bytes = std::fs::read(dir.path().join("leaf.glb")).unwrap();
    let json_length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let root: serde_json::Value = serde_json::from_slice(&bytes[20..20 + json_length]).unwrap();
    assert!(root["extensionsUsed"].as_array().unwrap().iter().any(|e| e == "KHR_materials_diffuse_transmission"));
    let (_, _, images) = gltf::import(dir.path().join("leaf.glb")).unwrap();
    let material = &root["materials"][0];
    let through = &material["extensions"]["KHR_materials_diffuse_transmission"];
    let picture = |reference: &serde_json::Value| {
        let texture = reference["index"].as_u64().unwrap() as usize;
        &images[root["textures"][texture]["source"].as_u64().unwrap() as usize]
    };
    let factor = picture(&through["diffuseTransmissionTexture"]);
    let colour = picture(&through["diffuseTransmissionColorTexture"]);
    let base = picture(&material["pbrMetallicRoughness"]["baseColorTexture"]);
    let gloss = picture(&material["extensions"]["KHR_materials_specular"]["specularTexture"]);
    export(dir.path(), "gltf", "opaque.glb");
    let (document, _, others) = gltf::import(dir.path().join("opaque.glb")).unwrap();
    let pbr = document.materials().next().unwrap().pbr_metallic_roughness();
    let opaque = &others[pbr.base_color_texture().unwrap().texture().source().index()].pixels;
    let maps = image::read_exr(&dir.path().join("elm/front.exr")).unwrap();
    let back = image::read_exr(&dir.path().join("elm/back.exr")).unwrap();
    let mask = maps.scalar(Quantity::Mask).unwrap();
    let mut compared = 0;
    for k in (0..mask.len()).filter(|k| mask[*k] == 1.0).step_by(7) {
        let t = f32::from(factor.pixels[4 * k + 3]) / 255.0;
        let w = f32::from(gloss.pixels[4 * k + 3]) / 255.0;
        for (c, letter) in ["R", "G", "B"].iter().enumerate() {
            // Light that leaves the front has entered the back, whose camera sees the columns in the other order.
            let there = k / maps.width * maps.width + maps.width - 1 - k % maps.width;
            let value = back.get(&format!("rho_t.{letter}")).unwrap()[there];
            if value.is_finite() && back.scalar(Quantity::Mask).unwrap()[there] == 1.0 {
                let through = (1.0 - w) * t * linear(colour.pixels[3 * k + c]);
                assert!((through - value).abs() < 0.006, "{k} {letter}: {through} against {value}");
                compared += 1;
            }
            // The opaque file has the same matte light without the share.
            let (d, alone) = ((1.0 - t) * linear(base.pixels[3 * k + c]), linear(opaque[3 * k + c]));
            assert!((d - alone).abs() < 0.006, "{k} {letter}: {d} against {alone}");
        }
    }
    assert!(compared > 300, "{compared}");
}

#[test]
fn the_obj_has_normals_and_names_files_that_are_there() {
    let dir = tempfile::tempdir().unwrap();
    with_blade(dir.path());
    export(dir.path(), "obj", "out/leaf.obj");
    let text = std::fs::read_to_string(dir.path().join("out/leaf.obj")).unwrap();
    let count = |head: &str| text.lines().filter(|l| l.starts_with(head)).count();
    assert_eq!((count("v "), count("vt "), count("vn "), count("f ")), (8, 8, 8, 4));
    let vector = |l: &str| -> Vec<f64> { l.split_whitespace().skip(1).map(|v| v.parse().unwrap()).collect() };
    let list = |head: &str| -> Vec<Vec<f64>> { text.lines().filter(|l| l.starts_with(head)).map(vector).collect() };
    let (v, n) = (list("v "), list("vn "));
    for line in text.lines().filter(|l| l.starts_with("f ")) {
        let corners: Vec<usize> = line
            .split_whitespace()
            .skip(1)
            .map(|c| c.split('/').next().unwrap().parse::<usize>().unwrap() - 1)
            .collect();
        let [a, b, c] = [&v[corners[0]], &v[corners[1]], &v[corners[2]]];
        let turning = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        assert!(turning * n[corners[0]][2] > 0.0, "{line}");
    }
    // The top left corner of the maps has v = 1 in an OBJ file.
    assert_eq!(list("vt ")[0], [0.0, 1.0]);
    let materials = std::fs::read_to_string(dir.path().join("out/leaf.mtl")).unwrap();
    let mut pictures = 0;
    for line in materials.lines().filter(|l| l.starts_with("map_") || l.starts_with("norm")) {
        let file = line.split_whitespace().nth(1).unwrap();
        assert!(dir.path().join("out").join(file).exists(), "{file}");
        pictures += 1;
    }
    assert_eq!(pictures, 6, "colour, roughness and normals of both sides");
    let name = text.lines().find_map(|l| l.strip_prefix("mtllib ")).unwrap();
    assert!(dir.path().join("out").join(name).exists());
}

#[test]
fn parameters_come_out_as_json_without_invented_numbers() {
    let dir = tempfile::tempdir().unwrap();
    with_blade(dir.path());
    export(dir.path(), "json", "p.json");
    let json: serde_json::Value = serde_json::from_slice(&std::fs::read(dir.path().join("p.json")).unwrap()).unwrap();
    let sigma = &json["fit"]["front"]["sigma_a"];
    assert!(sigma["stderr"][2].is_null() && sigma["stderr"][0] == 0.06, "{sigma}");
    assert_eq!(sigma["undetermined"][0], "sigma_a.B: at least 7.9 1/mm");
    assert!(json["times"]["total_s"].as_f64().is_some());
}

/// `-o -` prints the content of the file, and `glb` is another name of gltf.
#[test]
fn one_file_goes_to_standard_output() {
    let dir = tempfile::tempdir().unwrap();
    with_blade(dir.path());
    for (format, name) in [
        ("csv", "elm.csv"),
        ("json", "elm.json"),
        ("exr", "elm.exr"),
        ("glb", "elm.glb"),
        ("gltf-translucent", "thin.glb"),
    ] {
        export(dir.path(), if format == "glb" { "gltf" } else { format }, name);
        let args = ["export", "elm", "--to", format, "-o", "-"];
        let out = Command::new(env!("CARGO_BIN_EXE_mesophyll")).args(args).current_dir(dir.path()).output().unwrap();
        // A material's loss goes to standard error, away from the file; data have none.
        let said = String::from_utf8_lossy(&out.stderr);
        let material = ["glb", "gltf-translucent"].contains(&format);
        assert!(out.status.success() && said.contains("BRDF error") == material, "{said}");
        assert!(material || said.is_empty(), "{said}");
        assert!(!out.stdout.is_empty() && out.stdout == std::fs::read(dir.path().join(name)).unwrap(), "{format}");
    }
    assert!(!dir.path().join("-").exists());
}

#[test]
fn mistakes_are_one_sentence_and_write_nothing() {
    let dir = tempfile::tempdir().unwrap();
    with_blade(dir.path());
    std::fs::create_dir(dir.path().join("folder")).unwrap();
    std::fs::create_dir(dir.path().join("twigs")).unwrap();
    std::fs::write(
        dir.path().join("twigs/fit.toml"),
        "schema = 1\nkind = \"beam\"\nname = \"t\"\nprogram = \"p\"\ninput_hash = \"h\"\n",
    )
    .unwrap();
    let cases: [(&[&str], &str); 7] = [
        (&["export", "elm", "--to", "png", "-o", "-"], "-o -: --to png writes several files"),
        (&["export", "elm", "--to", "obj", "--out", "-"], "-o -: --to obj writes several files"),
        (&["export", "elm", "--to", "csv", "-o", "-", "--json"], "standard output holds the exported file itself"),
        (&["export", "nowhere", "--to", "csv", "-o", "x"], "fit.toml: no such file or folder"),
        (&["export", "twigs", "--to", "csv", "-o", "x"], "is a beam fit, which has no maps"),
        (&["export", "elm", "--to", "csv", "-o", "folder"], "found a folder, expected the name of a file"),
        (&["export", "elm", "--to", "obj", "-o", "a leaf.obj"], "without blanks"),
    ];
    for (args, said) in cases {
        let (code, stdout, stderr) = mesophyll(args, dir.path());
        assert_eq!((code, stdout.as_str()), (2, ""), "{args:?}: {stderr}");
        assert!(stderr.contains(said) && stderr.lines().count() == 1, "{args:?}: {stderr}");
    }
    for (format, words) in [("fbx", "possible values: png, exr"), ("glft", "a similar value exists: 'gltf'")] {
        let (code, stdout, stderr) = mesophyll(&["export", "elm", "--to", format, "-o", "x"], dir.path());
        assert!(code == 2 && stdout.is_empty() && stderr.contains(words), "{format}: {stderr}");
    }
    assert!(!dir.path().join("x").exists() && !dir.path().join("-").exists());
    std::fs::write(dir.path().join("elm/blade.glb"), b"glTF nonsense").unwrap();
    let (code, _, stderr) = mesophyll(&["export", "elm", "--to", "gltf", "-o", "x"], dir.path());
    assert!(code == 2 && stderr.contains("blade.glb"), "{stderr}");
    std::fs::remove_file(dir.path().join("elm/blade.glb")).unwrap();
    let (code, _, stderr) = mesophyll(&["export", "elm", "--to", "obj", "-o", "x.obj"], dir.path());
    assert!(code == 2 && stderr.contains("blade.glb: no such file"), "{stderr}");
}
