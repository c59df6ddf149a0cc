//! The gloss of each side as a measured material: RGL's tensor file (`.bsdf`), as Mitsuba's `measured` plugin and our
//! own `fit gloss --samples` read it.
//!
//! The format (Dupuy & Jakob 2018) has one material without texture, so the gloss is the mean over the leaf: ρs of each
//! colour, and the slope m weighted with ρs. It stores f cosθo = reading · D(u)/(4 σ(ui)). The place
//! u = (√(2 θm/π), (φm − φi + π)/2π) belongs to the half vector, and ui likewise to the incident direction. Here D is
//! the lobe's own distribution of facets and σ is cosθi, so that a reading is ρs·F·G, smooth and at most ρs. Readings
//! stand at even steps of a square that is warped to where visible facets are.

use crate::coat::ExportLoss;
use crate::foreign::micro::half;
use crate::foreign::nodes::DirectionPairs;
use crate::scene::{ExportScene, ExportSheet};
use crate::{Error, Result};
use mesophyll_files::atomic;
use mesophyll_optics::gloss::{Lobe, dot};
use mesophyll_optics::side::Side;
use serde_json::json;
use std::f64::consts::PI;
use std::path::{Path, PathBuf};

/// Incident directions, nodes each way of the table of visible facets and of the readings, and nodes of D and σ.
const DIRECTIONS: usize = 32;
const VISIBLE: usize = 32;
const READINGS: usize = 64;
const FINE: usize = 256;
/// Share of the largest density of visible facets that is added to it everywhere, so that no direction is lost.
const FLOOR: f64 = 0.01;
/// The last incident direction, as a share of 90°: beyond it readers repeat it.
const GRAZING: f64 = 0.998;
/// Smallest σ.
const LEAST: f64 = 1e-4;

/// Types of numbers in the file.
const UINT8: u8 = 1;
const FLOAT32: u8 = 10;

/// Writes the folder; returns its files and what is lost.
///
/// # Errors
/// [`Error::Usage`] where nothing has a gloss; [`Error::Write`].
pub fn write(shown: &ExportScene, folder: &Path) -> Result<(Vec<PathBuf>, ExportLoss)> {
    let (mut files, mut lost, mut unsaid) = (Vec::new(), Vec::new(), shown.left_out.clone());
    for sheet in &shown.sheets {
        for side in Side::ALL {
            let Some(gloss) = Mean::of(sheet, side) else { continue };
            let table = Table::new(&gloss);
            let path = folder.join(format!("{}_{}.bsdf", sheet.name, side.name()));
            atomic::write_bytes(&path, &table.bytes(&gloss))?;
            files.push(path);
            lost.push((sheet, side, loss(sheet, side, &gloss, &table)));
        }
    }
    if files.is_empty() {
        return Err(Error::Usage(format!("{}: no side has a gloss, which is all that --to bsdf holds", shown.name)));
    }
    unsaid.push("matte and transmitted light: the files hold the gloss alone, to be added to them".into());
    unsaid.push("maps and mapped normals: a file is one material, the mean over the leaf".into());
    Ok((files, lost_of(&lost, &unsaid)))
}

/// The mean gloss of a side.
struct Mean {
    rho_s: [f64; 3],
    m: f64,
    lobe: Lobe,
}

impl Mean {
    fn of(sheet: &ExportSheet, side: Side) -> Option<Mean> {
        let parts = || sheet.good.iter().map(|k| &sheet.texels[*k].sides[side]);
        let n = sheet.good.len() as f64;
        let rho_s = [0, 1, 2].map(|c| parts().map(|p| p.rho_s[c]).sum::<f64>() / n);
        let weight: f64 = rho_s.iter().sum::<f64>() * n;
        let m = parts().map(|p| p.m * p.rho_s.iter().sum::<f64>()).sum::<f64>() / weight;
        (weight > 0.0 && m > 0.0).then_some(Mean { rho_s, m, lobe: sheet.lobe() })
    }
}

/// Values on the unit square, row by row, linear between its nodes; x runs along a row.
struct Square {
    n: usize,
    values: Vec<f64>,
    /// The integral of each row.
    rows: Vec<f64>,
}

/// The index below a place in 0..1 of `n` nodes, and the share of the next one.
fn between(t: f64, n: usize) -> (usize, f64) {
    let t = t.clamp(0.0, 1.0) * (n - 1) as f64;
    let k = (t as usize).min(n - 2);
    (k, t - k as f64)
}

/// The integrals of a polygon with these values at even steps, up to each of them.
fn sums(values: &[f64]) -> Vec<f64> {
    let mut sum = 0.0;
    let steps = values.windows(2).map(|w| {
        sum += 0.5 * (w[0] + w[1]);
        sum
    });
    std::iter::once(0.0).chain(steps).collect()
}

/// Where (0 to 1) the share of a polygon's integral is reached.
fn place(values: &[f64], share: f64) -> f64 {
    let sums = sums(values);
    let left = share * sums[sums.len() - 1];
    let k = sums.partition_point(|s| *s <= left).clamp(1, values.len() - 1) - 1;
    let (a, b, left) = (values[k], values[k + 1], left - sums[k]);
    // a t + (b − a) t²/2 = left.
    let t = 2.0 * left / (a + (a * a + 2.0 * (b - a) * left).max(0.0).sqrt());
    (k as f64 + t.clamp(0.0, 1.0)) / (values.len() - 1) as f64
}

/// The inverse of [`place`].
fn share(values: &[f64], at: f64) -> f64 {
    let (sums, (k, t)) = (sums(values), between(at, values.len()));
    (sums[k] + values[k] * t + 0.5 * (values[k + 1] - values[k]) * t * t) / sums[sums.len() - 1]
}

impl Square {
    fn new(n: usize, values: Vec<f64>) -> Square {
        let rows = values.chunks_exact(n).map(|row| sums(row)[n - 1]).collect();
        Square { n, values, rows }
    }

    fn row(&self, y: f64) -> Vec<f64> {
        let (k, f) = between(y, self.n);
        let line = |k: usize| &self.values[k * self.n..][..self.n];
        line(k).iter().zip(line(k + 1)).map(|(a, b)| a + (b - a) * f).collect()
    }

    fn at(&self, x: f64, y: f64) -> f64 {
        let (row, (k, f)) = (self.row(y), between(x, self.n));
        row[k] + (row[k + 1] - row[k]) * f
    }

    /// The height below which the share y of the function lies by rows, and the row there. The point of the square
    /// with the shares (x, y) is at [`place`] x of this row.
    fn line(&self, y: f64) -> (f64, Vec<f64>) {
        let v = place(&self.rows, y);
        (v, self.row(v))
    }

    /// The shares of a point, the inverse of [`Square::line`] and [`place`].
    fn unwarp(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [share(&self.row(y), x), share(&self.rows, y)]
    }

    fn mixed(&self, other: &Square, f: f64) -> Square {
        let mix = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a + (b - a) * f).collect();
        Square { n: self.n, values: mix(&self.values, &other.values), rows: mix(&self.rows, &other.rows) }
    }
}

fn direction(theta: f64, phi: f64) -> [f64; 3] {
    [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()]
}

/// The half vector of a place on the square of half vectors, for light at azimuth 0.
fn facet([x, y]: [f64; 2]) -> [f64; 3] {
    direction(0.5 * PI * x * x, (2.0 * y - 1.0) * PI)
}

/// Tables of a lobe for ρs = 1, as the file has them.
struct Table {
    thetas: Vec<f64>,
    /// For each incident direction.
    visible: Vec<Square>,
    readings: Vec<Square>,
    /// D and σ at even steps of √(2 θ/π).
    density: Vec<f64>,
    area: Vec<f64>,
}

impl Table {
    fn new(gloss: &Mean) -> Table {
        let steps = |n: usize| (0..n).map(move |k| k as f64 / (n - 1) as f64);
        let density = |theta: f64| {
            let tan = theta.tan();
            // At 90° no facet is seen.
            if theta < 0.5 * PI - 1e-9 { gloss.lobe.distribution(tan * tan, gloss.m) } else { 0.0 }
        };
        // Closer steps at grazing, where a lobe changes most.
        let thetas: Vec<f64> = steps(DIRECTIONS).map(|t| 0.5 * PI * GRAZING * (1.0 - (1.0 - t) * (1.0 - t))).collect();
        let (mut all_visible, mut readings) = (Vec::new(), Vec::new());
        for theta in &thetas {
            let light = direction(*theta, 0.0);
            let grid = |n: usize| steps(n).flat_map(move |y| steps(n).map(move |x| [x, y]));
            let seen = |at: [f64; 2]| {
                let (h, tilt) = (facet(at), 0.5 * PI * at[0] * at[0]);
                let facing = dot(light, h).max(0.0);
                density(tilt) * facing * tilt.sin() * at[0]
            };
            let mut values: Vec<f64> = grid(VISIBLE).map(seen).collect();
            let most = values.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
            values.iter_mut().for_each(|v| *v = *v / most + FLOOR);
            // The file's tables have the mean 1, as readers make them.
            let whole = sums(&Square::new(VISIBLE, values.clone()).rows)[VISIBLE - 1];
            let scale = ((VISIBLE - 1) * (VISIBLE - 1)) as f64 / whole;
            values.iter_mut().for_each(|v| *v *= scale);
            let visible = Square::new(VISIBLE, values);
            let reading = |at: [f64; 2]| {
                let h = facet(at);
                let facing = dot(light, h);
                let view = [0, 1, 2].map(|k| 2.0 * facing * h[k] - light[k]);
                let tan2 = (1.0 - h[2] * h[2]).max(0.0) / (h[2] * h[2]);
                let (f, d) =
                    (gloss.lobe.bounded([0.0, 0.0, 1.0], light, view, gloss.m), gloss.lobe.distribution(tan2, gloss.m));
                if facing > 0.0 && d > f64::MIN_POSITIVE { f * view[2] * 4.0 * light[2] / d } else { 0.0 }
            };
            let mut values = Vec::with_capacity(READINGS * READINGS);
            for (v, row) in steps(READINGS).map(|y| visible.line(y)) {
                values.extend(steps(READINGS).map(|x| reading([place(&row, x), v])));
            }
            readings.push(Square::new(READINGS, values));
            all_visible.push(visible);
        }
        let theta = |u: f64| 0.5 * PI * u * u;
        Table {
            thetas,
            visible: all_visible,
            readings,
            density: steps(FINE).map(|u| density(theta(u))).collect(),
            area: steps(FINE).map(|u| theta(u).cos().max(LEAST)).collect(),
        }
    }

    /// f (1/sr) for ρs = 1 as a reader finds it in the file: `incident` is the direction whose tables are used.
    fn value(&self, incident: [f64; 3], other: [f64; 3]) -> f64 {
        if incident[2] <= 0.0 || other[2] <= 0.0 {
            return 0.0;
        }
        let h = half(incident, other);
        let angle = |z: f64| (2.0 / PI * z.clamp(-1.0, 1.0).acos()).sqrt();
        let turn = h[1].atan2(h[0]) - incident[1].atan2(incident[0]);
        let u = [angle(h[2]), ((turn + PI) / (2.0 * PI)).rem_euclid(1.0)];
        let theta = incident[2].acos();
        let k = self.thetas.partition_point(|t| *t <= theta).clamp(1, self.thetas.len() - 1) - 1;
        let f = ((theta - self.thetas[k]) / (self.thetas[k + 1] - self.thetas[k])).clamp(0.0, 1.0);
        let at = self.visible[k].mixed(&self.visible[k + 1], f).unwarp(u);
        let [low, high] = [k, k + 1].map(|k| self.readings[k].at(at[0], at[1]));
        let line = |values: &[f64], t: f64| {
            let (k, f) = between(t, values.len());
            values[k] + (values[k + 1] - values[k]) * f
        };
        (low + (high - low) * f) * line(&self.density, u[0]) / (4.0 * line(&self.area, angle(incident[2]))) / other[2]
    }

    /// The file.
    fn bytes(&self, gloss: &Mean) -> Vec<u8> {
        let floats = |values: &mut dyn Iterator<Item = f64>| -> Vec<u8> {
            values.flat_map(|v| (v as f32).to_le_bytes()).collect()
        };
        let twice = |line: &[f64]| floats(&mut line.iter().chain(line).copied());
        let readings = |scale: f64| self.readings.iter().flat_map(move |s| s.values.iter().map(move |v| v * scale));
        let luminance = 0.2126 * gloss.rho_s[0] + 0.7152 * gloss.rho_s[1] + 0.0722 * gloss.rho_s[2];
        let coloured = self
            .readings
            .iter()
            .flat_map(|s| gloss.rho_s.into_iter().flat_map(move |rho| s.values.iter().map(move |v| v * rho)));
        let description = format!("gloss of a leaf, made by mesophyll {}", env!("CARGO_PKG_VERSION")).into_bytes();
        let (n, v, r) = (DIRECTIONS, VISIBLE, READINGS);
        let fields: [(&str, u8, Vec<usize>, Vec<u8>); 9] = [
            ("description", UINT8, vec![description.len()], description),
            ("phi_i", FLOAT32, vec![1], floats(&mut std::iter::once(0.0))),
            ("theta_i", FLOAT32, vec![n], floats(&mut self.thetas.iter().copied())),
            ("ndf", FLOAT32, vec![2, FINE], twice(&self.density)),
            ("sigma", FLOAT32, vec![2, FINE], twice(&self.area)),
            ("vndf", FLOAT32, vec![1, n, v, v], floats(&mut self.visible.iter().flat_map(|s| s.values.clone()))),
            ("luminance", FLOAT32, vec![1, n, r, r], floats(&mut readings(luminance))),
            ("rgb", FLOAT32, vec![1, n, 3, r, r], floats(&mut { coloured })),
            ("jacobian", UINT8, vec![1], vec![1]),
        ];
        let mut bytes = b"tensor_file\0\x01\x00".to_vec();
        bytes.extend((fields.len() as u32).to_le_bytes());
        let list: usize = fields.iter().map(|(name, _, shape, _)| 2 + name.len() + 2 + 1 + 8 + 8 * shape.len()).sum();
        let mut offset = bytes.len() + list;
        for (name, kind, shape, data) in &fields {
            bytes.extend((name.len() as u16).to_le_bytes());
            bytes.extend(name.as_bytes());
            bytes.extend((shape.len() as u16).to_le_bytes());
            bytes.push(*kind);
            bytes.extend((offset as u64).to_le_bytes());
            bytes.extend(shape.iter().flat_map(|n| (*n as u64).to_le_bytes()));
            offset += data.len();
        }
        fields.iter().for_each(|field| bytes.extend(&field.3));
        bytes
    }
}

/// What is lost of a side's gloss.
struct Loss {
    /// Relative root mean square of the gloss alone, over the texels and for the mean itself.
    rms: [f64; 2],
    /// Albedo of the gloss of each colour, and theirs less ours.
    albedo: [[f64; 3]; 2],
}

fn loss(sheet: &ExportSheet, side: Side, gloss: &Mean, table: &Table) -> Loss {
    let n = [0.0, 0.0, 1.0];
    let (mut squares, mut albedo) = ([[0.0; 2]; 2], [[0.0; 3]; 2]);
    let nodes = DirectionPairs::new(gloss.lobe, gloss.m);
    for node in &nodes.all {
        let theirs = table.value(node.view, node.light);
        let mean = gloss.lobe.bounded(n, node.light, node.view, gloss.m);
        for k in &sheet.good {
            let part = &sheet.texels[*k].sides[side];
            let own = gloss.lobe.bounded(n, node.light, node.view, part.m.max(1e-3));
            for c in 0..3 {
                let (g, f) = (gloss.rho_s[c] * theirs, part.rho_s[c] * own);
                squares[0][0] += node.weight * (g - f) * (g - f);
                squares[0][1] += node.weight * f * f;
                albedo[0][c] += node.weight * f / PI / sheet.good.len() as f64;
                albedo[1][c] += node.weight * (g - f) / PI / sheet.good.len() as f64;
            }
        }
        for rho in gloss.rho_s {
            squares[1][0] += node.weight * (rho * (theirs - mean)).powi(2);
            squares[1][1] += node.weight * (rho * mean).powi(2);
        }
    }
    Loss { rms: squares.map(|[difference, ours]| (difference / ours).sqrt()), albedo }
}

fn lost_of(all: &[(&ExportSheet, Side, Loss)], unsaid: &[String]) -> ExportLoss {
    let mut surfaces: Vec<serde_json::Value> = Vec::new();
    let mut lines = Vec::new();
    for (sheet, side, lost) in all {
        let [texels, table] = lost.rms;
        if surfaces.last().is_none_or(|s| s["name"] != sheet.name.as_str()) {
            surfaces.push(json!({"name": sheet.name, "texels": sheet.good.len()}));
        }
        if let Some(own) = surfaces.last_mut() {
            own[side.name()] = json!({
                "gloss_rms": texels, "table_rms": table,
                "albedo": {"gloss": lost.albedo[0]}, "albedo_error": {"gloss": lost.albedo[1]},
            });
        }
        lines.push(format!(
            "{}, {}: error of the gloss {:.2} % (relative RMS over the leaf; the table alone loses {:.2} %); albedo \
             error of the gloss {}",
            sheet.name,
            side.name(),
            100.0 * texels,
            100.0 * table,
            lost.albedo[1].map(|v| format!("{v:+.4}")).join(" ")
        ));
    }
    let meaning = "gloss_rms: relative root mean square error of the gloss alone over both hemispheres and the texels, \
                   weighted with both cosines; table_rms: the same for the mean gloss, which is what the table itself \
                   loses; albedo_error: theirs less ours for red, green and blue (docs/export.md)";
    ExportLoss::other("bsdf", meaning, surfaces, lines, unsaid)
}
