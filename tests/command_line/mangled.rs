//! Random damage to files. Every reader gets files of the repository with changed bytes, and must return a value or an
//! error. It must never panic, and never take much time or memory. Where a reader turns a library's panic into an
//! error, a panic in this project's own code still counts.
//!
//! `MESOPHYLL_MANGLED=100000 cargo test --workspace --test command_line mangled:: -- --nocapture` tries that many files
//! for each reader. A failure prints the seed that makes the same file again.

use mesophyll::capture::dome::manifest::DomeManifest;
use mesophyll::capture::manifest::TubeManifest;
use mesophyll::files::table::{InputTable, TableRecord};
use mesophyll::files::{gltf_file, image, mesh};
use mesophyll::fits::gloss::geometry::GlossGeometry;
use mesophyll::fits::record::FitRecord;
use mesophyll::plants::growth::meadow::MeadowSpec;
use mesophyll::plants::growth::spec::PlantSpec;
use mesophyll::synth::spec::LeafSpec;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, Once};
use std::time::{Duration, Instant};

/// Number of files for each reader by default, which takes seconds.
const FEW: usize = 100;
/// The longest time that a reader may take for a file of these sizes on a busy machine.
const LONGEST: Duration = Duration::from_secs(20);

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Words that have a meaning for some reader, or that are extreme values.
const WORDS: [&[u8]; 21] = [
    b"nan",
    b"inf",
    b"-1",
    b"0",
    b"1e308",
    b"1e-320",
    b"18446744073709551616",
    b"4000000000000000",
    b"-9223372036854775808",
    b"\"",
    b"\n",
    b"\r",
    b",",
    b"[[",
    b"]",
    b"=",
    b"\xff\xff\xff\xff",
    b"\0\0\0\0",
    b"\xff\xff\xff\x7f",
    b"../",
    b"\xc3\x28",
];

/// The bytes with some damage.
fn mangled(bytes: &[u8], random: &mut Pcg64) -> Vec<u8> {
    let mut made = bytes.to_vec();
    for _ in 0..random.random_range(1..6) {
        let at = random.random_range(0..made.len().max(1)).min(made.len());
        let end = (at + random.random_range(0..40)).min(made.len());
        match random.random_range(0..6) {
            0 if at < made.len() => made[at] ^= 1 << random.random_range(0..8),
            1 => made.truncate(at),
            2 => drop(made.drain(at..end)),
            3 => {
                let piece = made[at..end].to_vec();
                let to = random.random_range(0..=made.len());
                made.splice(to..to, piece);
            }
            4 => drop(made.splice(at..at, WORDS[random.random_range(0..WORDS.len())].iter().copied())),
            // Puts a word in the place of a number, or in the place of bytes of the same length.
            _ => {
                let word = WORDS[random.random_range(0..WORDS.len())];
                let end = (at + word.len()).min(made.len());
                made.splice(at..end, word.iter().copied());
            }
        }
    }
    made
}

/// Panics in this project's own sources, whose paths Cargo gives relative to its folder.
static OWN_PANICS: Mutex<Vec<String>> = Mutex::new(Vec::new());

fn watch_for_panics() {
    static WATCHED: Once = Once::new();
    WATCHED.call_once(|| {
        let before = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            if panic.location().is_some_and(|at| at.file().starts_with("src/")) {
                OWN_PANICS.lock().unwrap().push(panic.to_string());
            }
            before(panic);
        }));
    });
}

/// Gives `read` damaged copies of `seed`, under the seed's name in a folder of their own. Returns how many it accepted.
#[track_caller]
fn try_all(seed: &Path, read: impl Fn(&Path) -> bool) {
    let count = std::env::var("MESOPHYLL_MANGLED").ok().and_then(|n| n.parse().ok()).unwrap_or(FEW);
    let bytes = std::fs::read(seed).unwrap_or_else(|e| panic!("{}: {e}", seed.display()));
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join(seed.file_name().unwrap());
    let (mut taken, mut slowest) = (0, Duration::ZERO);
    std::fs::write(&file, &bytes).unwrap();
    watch_for_panics();
    assert!(read(&file), "{}: the file as it is cannot be read", seed.display());
    for number in 0..count as u64 {
        std::fs::write(&file, mangled(&bytes, &mut Pcg64::seed_from_u64(number))).unwrap();
        let clock = Instant::now();
        let ended = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| read(&file)));
        slowest = slowest.max(clock.elapsed());
        let own = std::mem::take(&mut *OWN_PANICS.lock().unwrap());
        assert!(own.is_empty(), "{}: mistakes of seed {number}: {own:?}", seed.display());
        let Ok(read) = ended else { panic!("{}: mistakes of seed {number} make the reader panic", seed.display()) };
        assert!(slowest < LONGEST, "{}: mistakes of seed {number} keep the reader {slowest:?}", seed.display());
        taken += usize::from(read);
    }
    println!("{}: {count} mangled, {taken} readable all the same, slowest {slowest:?}", seed.display());
    // Damage that no reader notices would test nothing.
    assert!(taken < count, "{}: nothing was noticed", seed.display());
}

fn data(name: &str) -> PathBuf {
    root().join("data").join(name)
}

fn rows(path: &Path) -> bool {
    let Ok(mut table) = InputTable::open(path) else { return false };
    let mut record = TableRecord::default();
    let width = table.header.len();
    let mut whole = true;
    loop {
        match table.next_record(&mut record) {
            Ok(true) => whole &= record.fault(width).is_none() && (0..width).all(|k| record.text(Some(k)).is_some()),
            Ok(false) => return whole,
            Err(_) => return false,
        }
    }
}

#[test]
fn tables() {
    try_all(&data("tables/samples.csv"), rows);
    let quoted = tempfile::tempdir().unwrap();
    let file = quoted.path().join("quoted.csv");
    std::fs::write(&file, "leaf,note,x\n\"a, b\",\"says \"\"no\"\"\",1\n\"two\nlines\",,2.5\n").unwrap();
    try_all(&file, rows);
}

#[test]
fn descriptions() {
    try_all(&data("leaves/elm.toml"), |p| LeafSpec::read(p).is_ok());
    try_all(&data("plants/bird-cherry.toml"), |p| PlantSpec::read(p).is_ok());
    try_all(&data("grass/clover.toml"), |p| MeadowSpec::read(p).is_ok());
    try_all(&data("tables/device.toml"), |p| GlossGeometry::read(p).is_ok());
    try_all(&root().join("fits/elm/fit.toml"), |p| {
        // The question here is whether the file can be read, not whether it is the fit's own.
        FitRecord::read(p.parent().unwrap()).is_ok()
    });
    for scene in ["demo", "twig", "glossy-sky"] {
        try_all(&data(&format!("scenes/{scene}.toml")), |p| mesophyll::scene::manifest::SceneManifest::read(p).is_ok());
    }
}

#[test]
fn captures() {
    let folder = tempfile::tempdir().unwrap();
    let scan = crate::common::scan(folder.path(), "elm", &["--size", "16x12", "--frames", "8"]);
    try_all(&scan.join("capture.toml"), |p| TubeManifest::read(p.parent().unwrap()).is_ok());
    try_all(&scan.join("mask.exr"), |p| image::read_exr(p).is_ok());
    try_all(&scan.join("front/x/0000.exr"), |p| image::read_exr(p).is_ok());
    let dome = folder.path().join("dome");
    let made = ["synth", "data/leaves/elm.toml", "--acquisition", "dome", "--size", "16x12", "-o"];
    let out = crate::common::mesophyll().args(made).arg(&dome).output().unwrap();
    crate::common::succeeded(&out);
    try_all(&dome.join("capture.toml"), |p| DomeManifest::read(p.parent().unwrap()).is_ok());
}

#[test]
fn meshes() {
    try_all(&root().join("fits/elm/blade.glb"), |p| mesh::read(p, None).is_ok());
    let plant = data("plants/two-species.glb");
    try_all(&plant, |p| mesophyll::plants::file::read(p).is_ok());
    let kept = [mesophyll::plants::file::INSTANCING];
    try_all(&plant, |p| gltf_file::read(p, &kept, |opened| gltf_file::whole(p, &opened)).is_ok());
    // Branches and blades are looked for in whatever triangles are left.
    try_all(&plant, |p| {
        mesophyll::plants::import::soup::read(p, None).map(|s| mesophyll::plants::import::find(&s, &|_| None)).is_ok()
    });
}

/// Pictures of light from all around, as scenes read them.
#[test]
fn environments() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("around.exr");
    let mut maps = image::ChannelMaps::new(16, 8);
    for (c, name) in ["R", "G", "B"].into_iter().enumerate() {
        maps.push(name, (0..128u8).map(|k| f32::from(k) * 0.01 + c as f32).collect());
    }
    image::write_exr(&file, &maps, image::Packing::Zip).unwrap();
    try_all(&file, |p| mesophyll::transport::environment::Environment::read(p).is_ok());
    // A Radiance picture of the same size: its rows begin with 2, 2 and their length, then come four runs of bytes.
    let file = folder.path().join("around.hdr");
    let mut bytes = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=1.5\n\n-Y 8 +X 16\n".to_vec();
    for row in 0..8u8 {
        bytes.extend([2, 2, 0, 16]);
        [row, 2 * row, 99, 128].into_iter().for_each(|c| bytes.extend([144, 40 + c]));
    }
    std::fs::write(&file, bytes).unwrap();
    try_all(&file, |p| mesophyll::transport::environment::Environment::read(p).is_ok());
}
