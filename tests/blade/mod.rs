//! Fit folders that are made from formulas: an elliptic, domed blade with known σ, γ, δ, gloss and normals. They are
//! written exactly as `fit leaf` writes them.
#![allow(dead_code)]

use glam::{DVec2, DVec3};
use mesophyll::files::hash;
use mesophyll::files::image::{ChannelMaps, Packing, write_exr};
use mesophyll::fits::record::{FitParameter, FitRecord, RecordSection};
use mesophyll::optics::slab;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The properties of the leaf.
#[derive(Debug, Clone)]
pub struct Blade {
    pub width: usize,
    pub height: usize,
    pub texel_mm: f64,
    pub h: f64,
    /// The coefficients of the front and of the back.
    pub sigma_a: [[f64; 3]; 2],
    pub sigma_s: [[f64; 3]; 2],
    pub rho_s: [f64; 2],
    pub m: [f64; 2],
    /// With 0 the leaf is uniform. With 1 it has veins that are thicker by a third, and γ varies by ± 20 %.
    pub pattern: f64,
    /// Slope of the bumps in the mapped normals.
    pub bump: f64,
    /// Height of the dome (mm).
    pub dome: f64,
    /// Relative deviation of the pigment maps from the scalars.
    pub pigment: f64,
}

impl Default for Blade {
    fn default() -> Self {
        Blade {
            width: 96,
            height: 72,
            texel_mm: 0.5,
            h: 0.2,
            sigma_a: [[0.9, 0.35, 1.8], [0.8, 0.3, 1.6]],
            sigma_s: [[11.0, 12.0, 10.0], [14.0, 15.0, 13.0]],
            rho_s: [0.05, 0.0],
            m: [0.25, 0.4],
            pattern: 1.0,
            bump: 0.15,
            dome: 4.0,
            pigment: 0.0,
        }
    }
}

struct Frame {
    t: DVec3,
    b: DVec3,
    n: DVec3,
}

impl Blade {
    fn half(&self) -> (f64, f64) {
        (0.48 * self.width as f64 * self.texel_mm, 0.48 * self.height as f64 * self.texel_mm)
    }

    fn inside(&self, x: f64, y: f64) -> bool {
        let (a, b) = self.half();
        (x / a).powi(2) + (y / b).powi(2) <= 1.0
    }

    fn z(&self, x: f64, y: f64) -> f64 {
        let (a, b) = self.half();
        self.dome * (1.0 - 0.5 * ((x / a).powi(2) + (y / b).powi(2)))
    }

    fn frame(&self, x: f64, y: f64) -> Frame {
        let (a, b) = self.half();
        let (zx, zy) = (-self.dome * x / (a * a), -self.dome * y / (b * b));
        let n = DVec3::new(-zx, -zy, 1.0).normalize();
        let t = (DVec3::X - n * n.x).normalize();
        Frame { t, b: n.cross(t), n }
    }

    /// Strength of the veins at a point of the blade (0 to 1).
    fn vein(&self, x: f64, y: f64) -> f64 {
        let w = 2.5 * self.texel_mm;
        let ridge = |d: f64| (-(d / w) * (d / w)).exp();
        let side = (y.abs() - (x + 40.0).rem_euclid(8.0) + 4.0).abs();
        self.pattern * ridge(y).max(0.6 * ridge(side))
    }

    /// Writes the fit folder and returns the fit's record.
    pub fn write(&self, dir: &Path, name: &str) -> FitRecord {
        std::fs::create_dir_all(dir).unwrap();
        let (w, h) = (self.width, self.height);
        // The gauge: the mean of δ over the good texels is zero.
        let veins: Vec<f64> = (0..w * h)
            .map(|k| ((k % w) as f64 + 0.5 - w as f64 / 2.0, h as f64 / 2.0 - (k / w) as f64 - 0.5))
            .map(|(i, j)| (i * self.texel_mm, j * self.texel_mm))
            .filter(|&(x, y)| self.inside(x, y))
            .map(|(x, y)| self.vein(x, y))
            .collect();
        let mean_vein = veins.iter().sum::<f64>() / veins.len() as f64;
        let mut sections = BTreeMap::new();
        for (s, side) in ["front", "back"].iter().enumerate() {
            let mut planes: BTreeMap<String, Vec<f32>> = BTreeMap::new();
            let mut put = |name: String, v: f64| planes.entry(name).or_default().push(v as f32);
            for j in 0..h {
                for i in 0..w {
                    // The back's column i is the front's column w − 1 − i.
                    let column = if s == 0 { i } else { w - 1 - i };
                    let x = (column as f64 + 0.5 - w as f64 / 2.0) * self.texel_mm;
                    let y = (h as f64 / 2.0 - j as f64 - 0.5) * self.texel_mm;
                    let good = self.inside(x, y);
                    let or_nan = |v: f64| if good { v } else { f64::NAN };
                    let vein = self.vein(x, y);
                    let delta = 0.3 * self.h * (vein - mean_vein);
                    let thickness = self.h + delta;
                    let f = self.frame(x, y);
                    let (bx, by) = ((0.9 * x).sin() * self.bump, (0.7 * y + 0.3 * x).cos() * self.bump);
                    let out = if s == 0 { f.n } else { -f.n };
                    let normal = (out + f.t * bx + f.b * by).normalize();
                    // The normal as this side's camera sees it. For the back, the blade was turned about y.
                    let seen = if s == 0 { normal } else { DVec3::new(-normal.x, normal.y, -normal.z) };
                    for (k, v) in seen.to_array().into_iter().enumerate() {
                        put(format!("normal.{}", ["X", "Y", "Z"][k]), or_nan(v));
                    }
                    for c in 0..3 {
                        let gamma = 1.0 + self.pattern * 0.2 * ((0.35 * x + c as f64).sin() * (0.3 * y).cos());
                        let stray = 1.0 + self.pigment * (0.5 * x).sin() * (0.4 * y + s as f64).cos();
                        let (sa, ss) = (self.sigma_a[s][c] * stray, self.sigma_s[s][c]);
                        let model = slab::response(self.sigma_a[s][c], ss, thickness);
                        let pigmented = slab::response(sa, ss, thickness);
                        let ch = ["R", "G", "B"][c];
                        put(format!("rho_d.{ch}"), or_nan(gamma * model.rho_d));
                        put(format!("rho_t.{ch}"), or_nan(pigmented.rho_t));
                        put(format!("rho_s.{ch}"), or_nan(self.rho_s[s]));
                        put(format!("sigma_a.{ch}"), or_nan(sa));
                        put(format!("sigma_s.{ch}"), or_nan(ss));
                        put(format!("gamma.{ch}"), or_nan(gamma));
                    }
                    put("m.Y".into(), or_nan(self.m[s]));
                    put("thickness.Y".into(), or_nan(thickness));
                    put("mask.Y".into(), f64::from(u8::from(good)));
                    put("reduced_chi2.Y".into(), 1.0);
                }
            }
            let mut maps = ChannelMaps::new(w, h);
            for (name, plane) in planes {
                maps.push(name, plane);
            }
            write_exr(&dir.join(format!("{side}.exr")), &maps, Packing::Zip).unwrap();
            write_exr(&dir.join(format!("{side}_err.exr")), &maps, Packing::Zip).unwrap();
            let param = |value: Vec<f64>, unit: &str| FitParameter {
                stderr: vec![0.0; value.len()],
                value,
                unit: unit.into(),
                ..FitParameter::default()
            };
            let params = BTreeMap::from([
                ("sigma_a".to_string(), param(self.sigma_a[s].to_vec(), "1/mm")),
                ("sigma_s".to_string(), param(self.sigma_s[s].to_vec(), "1/mm")),
                ("thickness".to_string(), param(vec![self.h], "mm")),
            ]);
            sections.insert(side.to_string(), RecordSection { params, ..Default::default() });
        }
        std::fs::write(dir.join("blade.glb"), self.glb()).unwrap();
        let mut record = FitRecord {
            schema: 1,
            kind: mesophyll::fits::record::FitKind::Leaf,
            name: name.into(),
            program: "test".into(),
            input_hash: hash::bytes(format!("{self:?}").as_bytes()),
            sections,
            ..Default::default()
        };
        record.files = hashes(dir);
        record.write(dir).unwrap();
        record
    }

    /// The blade as binary glTF: rings of an ellipse.
    fn glb(&self) -> Vec<u8> {
        let (rings, spokes) = (40usize, 96usize);
        let (a, b) = self.half();
        let (mut positions, mut normals, mut tangents, mut uvs, mut indices) =
            (vec![], vec![], vec![], vec![], Vec::<u32>::new());
        let (span_x, span_y) = (self.width as f64 * self.texel_mm, self.height as f64 * self.texel_mm);
        let mut vertex = |x: f64, y: f64| {
            let f = self.frame(x, y);
            positions.push(DVec3::new(x, y, self.z(x, y)));
            normals.push(f.n);
            tangents.push(f.t);
            uvs.push(DVec2::new(0.5 + x / span_x, 0.5 - y / span_y));
        };
        vertex(0.0, 0.0);
        for r in 1..=rings {
            for k in 0..spokes {
                let (s, c) = (std::f64::consts::TAU * k as f64 / spokes as f64).sin_cos();
                vertex(a * c * r as f64 / rings as f64, b * s * r as f64 / rings as f64);
            }
        }
        let at = |r: usize, k: usize| if r == 0 { 0 } else { (1 + (r - 1) * spokes + k % spokes) as u32 };
        for r in 0..rings {
            for k in 0..spokes {
                if r > 0 {
                    indices.extend([at(r, k), at(r + 1, k + 1), at(r, k + 1)]);
                }
                indices.extend([at(r, k), at(r + 1, k), at(r + 1, k + 1)]);
            }
        }
        let mut bin: Vec<u8> = Vec::new();
        let (mut views, mut accessors) = (Vec::new(), Vec::new());
        let mut add = |bytes: Vec<u8>, kind: &str, component: u32, count: usize| {
            views.push(format!(r#"{{"buffer":0,"byteOffset":{},"byteLength":{}}}"#, bin.len(), bytes.len()));
            accessors.push(format!(
                r#"{{"bufferView":{},"componentType":{component},"count":{count},"type":"{kind}",
                    "min":[-999,-999,-999],"max":[999,999,999]}}"#,
                views.len() - 1
            ));
            bin.extend(bytes);
        };
        let floats = |list: Vec<f64>| list.into_iter().flat_map(|v| (v as f32).to_le_bytes()).collect::<Vec<u8>>();
        let n = positions.len();
        add(floats(positions.iter().flat_map(|p| p.to_array()).collect()), "VEC3", 5126, n);
        add(floats(normals.iter().flat_map(|p| p.to_array()).collect()), "VEC3", 5126, n);
        add(floats(tangents.iter().flat_map(|p| [p.x, p.y, p.z, 1.0]).collect()), "VEC4", 5126, n);
        add(floats(uvs.iter().flat_map(|p| p.to_array()).collect()), "VEC2", 5126, n);
        add(indices.iter().flat_map(|i| i.to_le_bytes()).collect(), "SCALAR", 5125, indices.len());
        let mut json = format!(
            r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],
                "nodes":[{{"mesh":0,"scale":[0.001,0.001,0.001]}}],"meshes":[{{"primitives":[{{
                "attributes":{{"POSITION":0,"NORMAL":1,"TANGENT":2,"TEXCOORD_0":3}},"indices":4}}]}}],
                "buffers":[{{"byteLength":{}}}],"bufferViews":[{}],"accessors":[{}]}}"#,
            bin.len(),
            views.join(","),
            accessors.join(",")
        );
        while json.len() % 4 != 0 {
            json.push(' ');
        }
        let mut out = Vec::new();
        out.extend(b"glTF");
        for v in [2u32, (12 + 8 + json.len() + 8 + bin.len()) as u32, json.len() as u32, 0x4E4F_534A] {
            out.extend(v.to_le_bytes());
        }
        out.extend(json.as_bytes());
        out.extend((bin.len() as u32).to_le_bytes());
        out.extend(0x004E_4942u32.to_le_bytes());
        out.extend(bin);
        out
    }
}

/// Content hashes of every map and mesh of a folder.
pub fn hashes(dir: &Path) -> BTreeMap<String, String> {
    std::fs::read_dir(dir)
        .unwrap()
        .flatten()
        .map(|e| e.file_name().to_string_lossy().into_owned())
        .filter(|n| !n.ends_with(".toml"))
        .map(|n| (n.clone(), hash::file(&dir.join(&n)).unwrap()))
        .collect()
}

/// Writes the hashes of the present files into `fit.toml`, as someone would who wants a change to go unnoticed.
pub fn rehash(dir: &Path) {
    let mut record = FitRecord::read(dir).unwrap();
    record.files = hashes(dir);
    record.write(dir).unwrap();
}

/// Changes every sample of some channels of a map.
pub fn edit(path: &Path, change: impl Fn(&str, f32) -> f32) {
    let mut maps = mesophyll::files::image::read_exr(path).unwrap();
    for (name, plane) in &mut maps.channels {
        for v in plane.iter_mut() {
            *v = change(name, *v);
        }
    }
    write_exr(path, &maps, Packing::Zip).unwrap();
}

/// Copies a folder of plain files.
pub fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap().flatten() {
        std::fs::copy(entry.path(), to.join(entry.file_name())).unwrap();
    }
}

/// Changes that someone might make to a fit folder.
pub fn tamper(how: &str, fit: &Path) {
    let srgb = |v: f32| if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    match how {
        "mirrored normal" => edit(&fit.join("front.exr"), |c, v| if c == "normal.X" { -v } else { v }),
        "swapped sides" => {
            let (a, b) = (fit.join("front.exr"), fit.join("back.exr"));
            let (x, y) = (std::fs::read(&a).unwrap(), std::fs::read(&b).unwrap());
            std::fs::write(a, y).unwrap();
            std::fs::write(b, x).unwrap();
            let mut record = FitRecord::read(fit).unwrap();
            let (front, back) = (record.sections["front"].clone(), record.sections["back"].clone());
            record.sections.insert("front".into(), back);
            record.sections.insert("back".into(), front);
            record.write(fit).unwrap();
        }
        "thicker" => {
            let mut record = FitRecord::read(fit).unwrap();
            for side in ["front", "back"] {
                record.sections.get_mut(side).unwrap().params.get_mut("thickness").unwrap().value[0] *= 1.3;
                edit(&fit.join(format!("{side}.exr")), |c, v| if c == "thickness.Y" { 1.3 * v } else { v });
            }
            record.write(fit).unwrap();
        }
        "thicker in fit.toml alone" => {
            let mut record = FitRecord::read(fit).unwrap();
            for side in ["front", "back"] {
                record.sections.get_mut(side).unwrap().params.get_mut("thickness").unwrap().value[0] *= 1.3;
            }
            record.write(fit).unwrap();
        }
        "sRGB read as linear" => {
            for side in ["front", "back"] {
                edit(&fit.join(format!("{side}.exr")), |c, v| if c.starts_with("gamma") { srgb(v) } else { v });
            }
        }
        other => panic!("{other}"),
    }
}

/// Writes a scene file beside `fits/`: one leaf under a sun with the given zenith angle, with a sky if one is given,
/// seen from above.
pub fn scene(dir: &Path, name: &str, leaf: &str, sun_zenith: Option<f64>, sky: Option<f64>, extra: &str) -> PathBuf {
    let sun = sun_zenith.map_or(String::new(), |z| {
        format!("[sun]\nzenith_deg = {z}\nazimuth_deg = 30\nirradiance = [3.0, 3.0, 2.8]\n")
    });
    let sky = sky.map_or(String::new(), |l| format!("[sky]\nradiance = [{l}, {l}, {l}]\n"));
    let text = format!(
        r#"schema = 1
name = "{name}"
tolerance = 0.004
[[leaf]]
name = "{leaf}"
fit = "fits/{leaf}"
[[instance]]
leaf = "{leaf}"
{sun}{sky}
[[view]]
name = "above"
kind = "perspective"
eye_mm = [10, -25, 90]
target_mm = [0, 0, 2]
fov_deg = 30
flip_p99 = 0.15
max_error = 0.012
[check]
width = 160
height = 120
samples = 32
frames = 1
{extra}"#
    );
    let path = dir.join(format!("{name}.toml"));
    std::fs::write(&path, text).unwrap();
    path
}
