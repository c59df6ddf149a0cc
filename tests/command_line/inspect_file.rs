//! `mesophyll inspect FILE`, and the commands that take files of instruments.

use serde_json::Value;
use std::fmt::Write;
use std::path::Path;
use std::process::Command;

fn mesophyll(args: &[&str], folder: &Path) -> (i32, String, String) {
    let out = Command::new(env!("CARGO_BIN_EXE_mesophyll")).args(args).current_dir(folder).output().unwrap();
    let text = |b: &[u8]| String::from_utf8_lossy(b).into_owned();
    (out.status.code().unwrap_or(-1), text(&out.stdout), text(&out.stderr))
}

fn look(folder: &Path, file: &str) -> Value {
    let (code, stdout, stderr) = mesophyll(&["inspect", file, "--json"], folder);
    assert_eq!(code, 0, "{file}: {stderr}");
    serde_json::from_str(&stdout).unwrap()
}

/// A leaf's reflectance, in shares.
fn leaf(w: f64) -> f64 {
    0.05 + 0.4 / (1.0 + (-(w - 715.0) / 12.0).exp())
}

/// A file of two overlapping detectors, in per cent.
fn sig() -> String {
    let mut text = String::from(
        "/*** Spectra Vista SIG Data ***/\ninstrument= HI: 1 (HR-1024i)\nunits= Radiance, Radiance\ndata=\n",
    );
    let first = (0..500).map(|k| 340.0 + 1.4 * f64::from(k));
    let second = (0..400).map(|k| 980.0 + 3.0 * f64::from(k));
    for w in first.chain(second) {
        writeln!(text, "{w:.1} 1000.00 {:.2} {:.3}", 1e3 * leaf(w), 1e2 * leaf(w)).unwrap();
    }
    text
}

/// A table of inverse adding-doubling for a bare slab of this index.
fn rxt(index: f64, spheres: u32) -> String {
    format!(
        "IAD1\n{index} 1 # indices\n0.2 0 5 0.98\n{spheres}\n100 20 10 5 0.97\n100 20 0 5 0.97\n2\n550 0.12 \
         0.15\n650 0.06 0.05\n"
    )
}

#[test]
fn a_spectrum_of_an_instrument_says_what_it_is_and_which_fit_takes_it() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("my leaf.txt"), sig()).unwrap();
    let found = look(dir.path(), "my leaf.txt");
    assert_eq!(found["form"], "a Spectra Vista .sig file");
    assert_eq!(found["holds"], serde_json::json!(["radiance", "reflectance"]));
    assert_eq!((found["unit"].as_str(), found["wavelengths"].as_u64()), (Some("per cent"), Some(900)));
    assert_eq!(found["wavelength_nm"], serde_json::json!([340.0, 2177.0]));
    assert_eq!(found["spectra"], 3);
    assert_eq!(found["command"], "mesophyll fit foliar --pigments PIGMENTS.csv --percent --in 'my leaf.txt'");
    assert!(found["notes"].to_string().contains("joined in the middle"), "{found}");
    let (code, text, _) = mesophyll(&["inspect", "my leaf.txt"], dir.path());
    for part in ["a Spectra Vista .sig file", "340 to 2177 nm", "in per cent", "--percent --in 'my leaf.txt'"] {
        assert!(code == 0 && text.contains(part), "{part}: {text}");
    }
}

#[test]
fn what_no_fit_takes_has_a_reason() {
    let dir = tempfile::tempdir().unwrap();
    for (name, text, reason) in [
        ("a.rxt", rxt(1.4, 1), "not yet corrected"),
        (
            "b.sig",
            sig().lines().map(|l| l.rsplit_once(' ').map_or(l, |(l, _)| l).to_string() + "\n").collect(),
            "no reflectance",
        ),
        ("c.txt", "Model Name\tLI-180\n380nm\t1.0\n381nm\t1.1\n".into(), "irradiance"),
    ] {
        std::fs::write(dir.path().join(name), text).unwrap();
        let found = look(dir.path(), name);
        assert!(found["command"].is_null() && found["reason"].as_str().unwrap().contains(reason), "{name}: {found}");
    }
}

#[test]
fn a_slab_of_inverse_adding_doubling_is_fitted_like_its_table() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("s.rxt"), rxt(1.0, 0)).unwrap();
    std::fs::write(
        dir.path().join("s.csv"),
        "leaf,wavelength_nm,R,T,thickness_mm\ns,550,.12,.15,.2\ns,650,.06,.05,.2\n",
    )
    .unwrap();
    assert_eq!(look(dir.path(), "s.rxt")["command"], "mesophyll fit slab --in s.rxt");
    let numbers = |file: &str| -> Vec<Vec<String>> {
        let (code, out, err) = mesophyll(&["fit", "slab", "--noise", "0.002", "--in", file], dir.path());
        assert_eq!(code, 0, "{err}");
        out.lines().skip(1).map(|l| l.split(',').skip(5).map(String::from).collect()).collect()
    };
    let found = numbers("s.rxt");
    assert!(found.len() == 2 && found == numbers("s.csv"), "{found:?}");
}

/// What gzip packed is looked into, as the fits do.
#[test]
fn a_packed_table_is_told_by_what_is_in_it() {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| {
        let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        std::io::Write::write_all(&mut packed, bytes).unwrap();
        std::fs::write(dir.path().join(name), bytes).unwrap();
        std::fs::write(dir.path().join(format!("{name}.gz")), packed.finish().unwrap()).unwrap();
    };
    write("s.csv", b"leaf,wavelength_nm,R,T,thickness_mm\ns,550,.12,.15,.2\ns,650,.06,.05,.2\n");
    write("leaf.sig", sig().as_bytes());
    write("cases.csv", b"omega,delta\n0.9,1\n");
    for name in ["s.csv", "leaf.sig", "cases.csv"] {
        let packed = format!("{name}.gz");
        let (plain, found) = (look(dir.path(), name), look(dir.path(), &packed));
        let text = |value: &Value| value.as_str().unwrap().to_string();
        assert_eq!(text(&found["form"]), format!("a gzip archive with {}", text(&plain["form"])));
        assert_eq!(text(&found["command"]), text(&plain["command"]).replace(name, &packed));
        for key in ["holds", "unit", "wavelength_nm", "wavelengths", "spectra", "rows"] {
            assert_eq!(found[key], plain[key], "{name}: {key}");
        }
    }
    write("sky.exr", b"\x76\x2f\x31\x01\x02\0\0\0");
    let mut tar = vec![b'a'; 600];
    tar[257..262].copy_from_slice(b"ustar");
    write("all.tar", &tar);
    for (name, form) in [("sky.exr.gz", "OpenEXR"), ("all.tar.gz", ".tar")] {
        let found = look(dir.path(), name);
        assert!(found["command"].is_null() && found["reason"] == "unpack it first", "{found}");
        assert!(found["form"].as_str().unwrap().contains(form), "{found}");
    }
}

#[test]
fn a_command_that_cannot_use_the_form_names_it_and_what_helps() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("leaf.sig"), sig()).unwrap();
    std::fs::write(dir.path().join("wet.rxt"), rxt(1.4, 2)).unwrap();
    for (args, parts) in [
        (vec!["fit", "beam", "--in", "leaf.sig"], ["a Spectra Vista .sig file has no column alpha", "fit foliar"]),
        (
            vec!["fit", "slab", "--in", "leaf.sig"],
            ["has no transmittance and no thickness; it holds reflectance", "fit foliar"],
        ),
        (vec!["fit", "gloss", "--samples", "--in", "leaf.sig"], ["a Spectra Vista .sig file", "fit foliar"]),
        (vec!["fit", "motion", "--in", "leaf.sig"], ["a Spectra Vista .sig file", "fit foliar"]),
        (vec!["eval", "slab", "--in", "leaf.sig"], ["a Spectra Vista .sig file has no column omega", "--percent"]),
        (
            vec!["fit", "slab", "--in", "wet.rxt"],
            ["an iad .rxt file: it was measured with 2 integrating spheres", "iad"],
        ),
    ] {
        let (code, _, stderr) = mesophyll(&args, dir.path());
        let message = stderr.lines().last().unwrap_or_default();
        assert!(code == 2 && parts.iter().all(|p| message.contains(p)), "{args:?}: {stderr}");
        assert!(stderr.len() < 900, "{stderr}");
    }
}

/// The tables of the docs are taken by the commands of their sections.
#[test]
fn every_table_of_the_docs_is_known() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let page = std::fs::read_to_string(root.join("docs/tables.md")).unwrap();
    let mut known = 0;
    for line in page.lines().filter(|l| l.starts_with("mesophyll ")) {
        let words: Vec<&str> = line.split_whitespace().collect();
        let Some(at) = words.iter().position(|w| ["--in", "--deflections"].contains(w)) else { continue };
        let file = words[at + 1];
        let found = look(root, file);
        let command = found["command"].as_str().unwrap_or_else(|| panic!("{file}: {found}"));
        // A table of R, T and thickness may go to both fits of spectra.
        let either = format!("{command} {}", found["notes"]);
        let verb = words[1..3].join(" ");
        assert!(either.contains(&format!("mesophyll {verb} ")) && command.contains(file), "{line}: {found}");
        known += 1;
    }
    assert!(known >= 10, "{known}");
}

#[test]
fn other_files_are_told_by_their_content() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for (file, form, command) in [
        ("data/scenes/day.toml", "a scene", "mesophyll render"),
        ("data/plants/wych-elm.toml", "a plant", "mesophyll grow"),
        ("data/grass/lawn.toml", "a meadow", "mesophyll grow"),
        ("data/leaves/elm.toml", "synthetic leaf", "mesophyll synth"),
        ("data/looks/elm.toml", "a leaf's look", "mesophyll import"),
        ("data/looks/scene.toml", "a scene", "mesophyll render"),
        ("data/tables/device.toml", "linear light source", "mesophyll fit gloss --geometry"),
        ("data/plants/two-species.glb", "glTF", "mesophyll import"),
        ("fits/elm/fit.toml", "record of a fit", "mesophyll report fits/elm"),
        ("data/tables/pigments.csv", "a table", "mesophyll fit foliar --pigments data/tables/pigments.csv"),
    ] {
        let found = look(root, file);
        let (got, to) = (found["form"].as_str().unwrap(), found["command"].as_str().unwrap());
        assert!(got.contains(form) && to.starts_with(command), "{file}: {found}");
    }
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| std::fs::write(dir.path().join(name), bytes).unwrap();
    write("p.png", b"\x89PNG\r\n\x1a\n0000");
    write("p.exr", b"\x76\x2f\x31\x01\x02\0\0\0");
    write("old.xls", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1\0\0\0");
    assert!(look(dir.path(), "p.png")["reason"].as_str().unwrap().contains("capture.toml"));
    assert!(look(dir.path(), "p.exr")["command"].as_str().unwrap().contains("fit sky --panorama p.exr"));
    assert!(look(dir.path(), "old.xls")["reason"].as_str().unwrap().contains("save it as .xlsx"));
    write("capture.toml", b"[tube]\n");
    assert_eq!(look(dir.path(), "p.png")["command"], "mesophyll inspect .");
    write("empty", b"");
    write("noise.bin", &(0..3000u32).map(|k| (k.wrapping_mul(2654435761) >> 24) as u8).collect::<Vec<_>>());
    write("half.asd", &[b"as8".as_slice(), &[0; 100]].concat());
    for (name, word) in [("empty", "empty"), ("noise.bin", "unknown"), ("half.asd", "inside its header")] {
        let (code, _, stderr) = mesophyll(&["inspect", name], dir.path());
        assert!(code == 2 && stderr.contains(word), "{name}: {stderr}");
    }
}
