//! Files of the public databases of measured materials, written here from a known lobe: `fit gloss --samples` finds
//! the lobe again, and damaged files are refused with the number that is wrong.

use crate::common::{refused, run, succeeded};
use mesophyll::capture::goniometer::GoniometerReadings;
use mesophyll::optics::gloss::Lobe;
use rand::{RngExt, SeedableRng};
use std::f64::consts::PI;
use std::path::Path;

const RHO_D: [f64; 3] = [0.05, 0.12, 0.03];
const RHO_S: f64 = 0.06;
const M: f64 = 0.25;
/// Standard deviation of the noise of a reflectance factor.
const NOISE: f64 = 0.004;

/// The reflectance factor of a channel with noise, which a counter decides.
fn factor(light: [f64; 3], view: [f64; 3], c: usize, count: &mut u64) -> f64 {
    *count += 1;
    // Uniform numbers by the golden ratio's multiples, scrambled; their spread is 1/√12.
    let x = (count.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (*count << 17)).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 11;
    let noise = NOISE * 12f64.sqrt() * (x as f64 / (1u64 << 53) as f64 - 0.5);
    RHO_D[c] + PI * RHO_S * Lobe::Beckmann.value([0.0, 0.0, 1.0], light, view, M) + noise
}

/// Fits a file and compares with the truth, in units of the stated errors.
#[track_caller]
fn finds_the_lobe(file: &Path, names: [&str; 3]) {
    let out = file.with_extension("csv");
    let (input, output) = (file.display().to_string(), out.display().to_string());
    succeeded(&run(["fit", "gloss", "--samples", "--in", &input, "-o", &output]));
    let mut table = csv::Reader::from_path(&out).unwrap();
    let head = table.headers().unwrap().clone();
    let rows: Vec<csv::StringRecord> = table.records().map(Result::unwrap).collect();
    let [row] = rows.as_slice() else { panic!("{} rows", rows.len()) };
    let cell = |name: &str| -> f64 { row[head.iter().position(|h| h == name).expect(name)].parse().unwrap() };
    assert_eq!(&row[0], file.file_stem().unwrap().to_str().unwrap());
    let mut truth = vec![("rho_s".to_string(), RHO_S), ("m".into(), M), ("tilt".into(), 0.0), ("tilt_y".into(), 0.0)];
    truth.extend(names.iter().zip(RHO_D).map(|(name, d)| (format!("rho_d_{name}"), d)));
    for (name, value) in truth {
        let (found, error) = (cell(&name), cell(&format!("{name}_err")));
        assert!((found - value).abs() < 4.5 * error && error < 0.02, "{name}: {found} ± {error}, expected {value}");
    }
    let rms = cell("rms");
    assert!((rms / NOISE - 1.0).abs() < 0.1, "{rms}");
}

/// A material in MERL's cells, computed at the middle of each cell that lies above the surface.
fn merl() -> Vec<u8> {
    let (sizes, mut count) = ([90usize, 90, 180], 0);
    let mut planes = vec![Vec::new(); 3];
    for i in 0..sizes[0] {
        for j in 0..sizes[1] {
            for k in 0..sizes[2] {
                let th = PI / 2.0 * ((i as f64 + 0.5) / 90.0).powi(2);
                let (td, pd) = (PI / 2.0 * (j as f64 + 0.5) / 90.0, PI * (k as f64 + 0.5) / 180.0);
                // The two directions are symmetric about the half vector: turned by ±θd about it.
                let across = [-(pd.cos()) * th.cos(), -(pd.sin()), pd.cos() * th.sin()];
                let h = [th.sin(), 0.0, th.cos()];
                let at = |sign: f64| [0, 1, 2].map(|n| h[n] * td.cos() - sign * across[n] * td.sin());
                let (l, v) = (at(1.0), at(-1.0));
                for (c, plane) in planes.iter_mut().enumerate() {
                    let scale = [1.0, 1.15, 1.66][c] / 1500.0;
                    let up = l[2].min(v[2]);
                    // Only what is read needs a number; below the surface the format has negative ones.
                    let value = if up > 0.1 { factor(l, v, c, &mut count) / PI / scale } else { -1.0 };
                    plane.extend(value.to_le_bytes());
                }
            }
        }
    }
    let mut bytes: Vec<u8> = sizes.iter().flat_map(|n| (*n as u32).to_le_bytes()).collect();
    bytes.extend(planes.concat());
    bytes
}

#[test]
fn a_merl_file_gives_its_lobe() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("known.binary");
    let mut bytes = merl();
    std::fs::write(&file, &bytes).unwrap();
    finds_the_lobe(&file, ["brf_r", "brf_g", "brf_b"]);
    bytes.truncate(1000);
    std::fs::write(&file, &bytes).unwrap();
    let name = file.display().to_string();
    let fit = || run(["fit", "gloss", "--samples", "--in", &name]);
    refused(&fit(), 2, &["known.binary", "1000 bytes", "34992012"]);
    bytes[0] = 91;
    std::fs::write(&file, &bytes).unwrap();
    refused(&fit(), 2, &["[91, 90, 180]", "[90, 90, 180]"]);
    std::fs::write(&file, b"short").unwrap();
    refused(&fit(), 2, &["12 bytes"]);
}

/// Fields of a tensor file: name, type, shape, bytes.
type Field = (&'static str, u8, Vec<u64>, Vec<u8>);

fn tensor(fields: &[Field]) -> Vec<u8> {
    let mut bytes = b"tensor_file\0\x01\x00".to_vec();
    bytes.extend((fields.len() as u32).to_le_bytes());
    let list: usize = fields.iter().map(|(name, _, shape, _)| 2 + name.len() + 2 + 1 + 8 + 8 * shape.len()).sum();
    let mut offset = bytes.len() + list;
    for (name, dtype, shape, data) in fields {
        bytes.extend((name.len() as u16).to_le_bytes());
        bytes.extend(name.as_bytes());
        bytes.extend((shape.len() as u16).to_le_bytes());
        bytes.push(*dtype);
        bytes.extend((offset as u64).to_le_bytes());
        bytes.extend(shape.iter().flat_map(|n| n.to_le_bytes()));
        offset += data.len();
    }
    fields.iter().for_each(|f| bytes.extend(&f.3));
    bytes
}

fn floats(values: &[f64]) -> Vec<u8> {
    values.iter().flat_map(|v| (*v as f32).to_le_bytes()).collect()
}

/// A material in RGL's coordinates. Visible normals are 1 + x over the square, so that x = √(1 + 3 s) − 1 for the
/// share s; the density D is 1 + y and the area σ is 2, to see that both are used.
fn rgl() -> Vec<Field> {
    let (n, mut count) = (16usize, 0);
    let theta: Vec<f64> = (0..6).map(|k| 0.05 + 0.22 * f64::from(k)).collect();
    let turn = 0.7f64;
    let mut readings = vec![0.0; 6 * 3 * n * n];
    for (t, theta) in theta.iter().enumerate() {
        let light = [theta.sin() * turn.cos(), theta.sin() * turn.sin(), theta.cos()];
        for (row, column) in (0..n).flat_map(|r| (0..n).map(move |c| (r, c))) {
            let (s, y) = (column as f64 / (n - 1) as f64, row as f64 / (n - 1) as f64);
            let x = (1.0 + 3.0 * s).sqrt() - 1.0;
            let (a, b) = (PI / 2.0 * x * x, (2.0 * y - 1.0) * PI + turn);
            let h = [a.sin() * b.cos(), a.sin() * b.sin(), a.cos()];
            let d: f64 = light.iter().zip(h).map(|(l, h)| l * h).sum();
            let view = [0, 1, 2].map(|k| 2.0 * d * h[k] - light[k]);
            for c in 0..3 {
                let f = if view[2] > 0.1 { factor(light, view, c, &mut count) / PI } else { 0.0 };
                readings[((t * 3 + c) * n + row) * n + column] = f * view[2] * 4.0 * 2.0 / (1.0 + y);
            }
        }
    }
    vec![
        ("description", 1, vec![4], b"test".to_vec()),
        ("phi_i", 10, vec![1], floats(&[turn])),
        ("theta_i", 10, vec![6], floats(&theta)),
        ("ndf", 10, vec![2, 2], floats(&[1.0, 1.0, 2.0, 2.0])),
        ("sigma", 10, vec![2, 2], floats(&[2.0; 4])),
        ("vndf", 10, vec![1, 6, 2, 2], floats(&[1.0, 2.0].repeat(12))),
        ("luminance", 10, vec![1, 6, 16, 16], floats(&[1.0; 6 * 256])),
        ("wavelengths", 10, vec![3], floats(&[640.0, 550.0, 460.0])),
        ("spectra", 10, vec![1, 6, 3, 16, 16], floats(&readings)),
        ("jacobian", 1, vec![1], vec![1]),
    ]
}

#[test]
fn an_rgl_file_gives_its_lobe() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("known.bsdf");
    let fields = rgl();
    std::fs::write(&file, tensor(&fields)).unwrap();
    finds_the_lobe(&file, ["brf_640", "brf_550", "brf_460"]);

    // The same by its colours.
    let mut colours = fields.clone();
    colours[8].0 = "rgb";
    std::fs::write(&file, tensor(&colours)).unwrap();
    finds_the_lobe(&file, ["brf_r", "brf_g", "brf_b"]);

    let name = file.display().to_string();
    let fails = |change: &dyn Fn(&mut Vec<Field>), words: &[&str]| {
        let mut fields = fields.clone();
        change(&mut fields);
        std::fs::write(&file, tensor(&fields)).unwrap();
        refused(&run(["fit", "gloss", "--samples", "--in", &name]), 2, words);
    };
    fails(&|f| f[8].2 = vec![1, 6, 3, 16, 1 << 40], &["spectra", "1099511627776"]);
    fails(&|f| f[8].2 = vec![u64::MAX; 5], &["spectra", "18446744073709551615"]);
    fails(&|f| f[2].2 = vec![5], &["spectra", "[1, 5, 3, 16, 16]"]);
    fails(&|f| f[3].1 = 9, &["ndf", "type 9"]);
    fails(&|f| f[3].1 = 77, &["ndf", "type 77"]);
    fails(&|f| f.retain(|f| f.0 != "vndf"), &["vndf", "missing"]);
    let mut bytes = tensor(&fields);
    bytes[14..18].copy_from_slice(&u32::MAX.to_le_bytes());
    std::fs::write(&file, &bytes).unwrap();
    refused(&run(["fit", "gloss", "--samples", "--in", &name]), 2, &["4294967295"]);
    bytes.truncate(16);
    std::fs::write(&file, &bytes).unwrap();
    refused(&run(["fit", "gloss", "--samples", "--in", &name]), 2, &["ends within"]);
}

/// Damaged bytes give readings or a sentence: no panic, and nothing that takes long.
#[test]
fn damage_is_a_sentence_or_readings() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("x.bsdf");
    let whole = tensor(&rgl());
    let mut random = rand_pcg::Pcg64::seed_from_u64(3);
    let start = std::time::Instant::now();
    let mut refused = 0;
    for _ in 0..300 {
        let mut bytes = whole.clone();
        for _ in 0..random.random_range(1..5) {
            // Mostly in the list of arrays, which has some 500 bytes.
            let most = if random.random_range(0..4) > 0 { 500 } else { bytes.len() };
            let at = random.random_range(0..most);
            bytes[at] = [0, 1, 2, 255, 127, random.random()][random.random_range(0..6)];
        }
        std::fs::write(&file, &bytes).unwrap();
        refused += usize::from(GoniometerReadings::read(&file).is_err());
    }
    assert!(refused > 50, "{refused}");
    assert!(start.elapsed().as_secs() < 20, "{:?}", start.elapsed());
}

/// Mitsuba's own reader of these files shows the same material.
#[test]
fn mitsuba_reads_the_same_material() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("known.bsdf"), tensor(&rgl())).unwrap();
    let python = std::env::var("MESOPHYLL_PYTHON").unwrap_or_else(|_| "python3".into());
    let script = "
import mitsuba as mi, math
mi.set_variant('scalar_spectral')
bsdf = mi.load_dict({'type': 'measured', 'filename': 'known.bsdf'})
si = mi.SurfaceInteraction3f()
si.wavelengths = [550, 550, 550, 550]
direction = lambda t, p: mi.Vector3f(math.sin(t) * math.cos(p), math.sin(t) * math.sin(p), math.cos(t))
# Incident at a node of the table, where nothing is interpolated between incident directions.
si.wi = direction(.49, .7)
for t, p in [(.3, 3.6), (.5, 3.9), (.6, 1.5), (.8, 3.2)]:
    print(*bsdf.eval(mi.BSDFContext(), si, direction(t, p)))";
    let Ok(out) = std::process::Command::new(python).args(["-c", script]).current_dir(folder.path()).output() else {
        return crate::common::skips::skip(crate::common::skips::Need::Peer, "no Python (MESOPHYLL_PYTHON)");
    };
    if !out.status.success() {
        let why = String::from_utf8_lossy(&out.stderr).lines().last().unwrap_or_default().to_string();
        assert!(why.contains("No module named 'mitsuba'"), "{why}");
        return crate::common::skips::skip(
            crate::common::skips::Need::Peer,
            "Python has no mitsuba (MESOPHYLL_PYTHON)",
        );
    }
    let direction = |t: f64, p: f64| [t.sin() * p.cos(), t.sin() * p.sin(), t.cos()];
    for (line, (t, p)) in
        String::from_utf8_lossy(&out.stdout).lines().zip([(0.3, 3.6), (0.5, 3.9), (0.6, 1.5), (0.8, 3.2)])
    {
        let theirs: f64 = line.split_whitespace().next().unwrap().parse().unwrap();
        let (l, v): ([f64; 3], [f64; 3]) = (direction(0.49, 0.7), direction(t, p));
        let exact = (RHO_D[1] / PI + RHO_S * Lobe::Beckmann.value([0.0, 0.0, 1.0], l, v, M)) * v[2];
        // The table has 16 nodes each way, and noise.
        assert!((theirs / exact - 1.0).abs() < 0.25, "{t} {p}: {theirs} against {exact}");
    }
}
