//! Light between the leaves of a cluster: error, time and bytes for different numbers of anchors, paths and bands.

use crate::Result;
use crate::bench::BenchRow;
use crate::visibility::cluster::cluster;
use glam::DVec3;
use mesophyll_files::progress::TaskProgress;
use mesophyll_transport::path::{PathSettings, PathTracer};
use mesophyll_transport::transfer::anchors::{coarser, level, levels};
use mesophyll_transport::transfer::{
    Anchor, MeshAnchors, MeshPoint, TransferColumns, TransferMethod, TransferReceiver, TransferRequest, TransferRows,
    measure,
};
use mesophyll_transport::{ReferenceSun, ReferenceWorld};
use std::f64::consts::PI;
use std::time::Instant;

/// Steps of the sweep's bar.
pub const PIECES: u64 = 5;
/// The leaves that are compared, and the step between the vertices of a leaf that are compared.
const LEAVES: [usize; 3] = [3, 11, 20];
const VERTICES: usize = 9;
/// Number of paths for the truth at a vertex.
const MANY: u32 = 1 << 14;
const SKY: f64 = 0.35;
const SUN: f64 = 2.5;

/// The settings that are varied.
const REQUEST: TransferRequest =
    TransferRequest { method: TransferMethod::Paths, columns: TransferColumns::Light, paths: 2048, seed: 7 };

/// The grid whose chain of levels is looked at.
const CHAIN: [usize; 2] = [9, 5];

/// Paths from a probe.
const PROBED: usize = 256;

/// Direction `k` of [`PROBED`] that cover the sphere evenly.
fn spread(k: usize) -> DVec3 {
    let golden = PI * (3.0 - 5f64.sqrt());
    let z = 1.0 - 2.0 * (k as f64 + 0.5) / PROBED as f64;
    let (sin, cos) = (golden * k as f64).sin_cos();
    let r = (1.0 - z * z).sqrt();
    DVec3::new(r * cos, r * sin, z)
}

/// Irradiance of front and back, divided by π.
type Both = [f64; 2];

/// The sweep.
///
/// # Errors
/// [`crate::Error::Interrupted`] after Ctrl-C.
pub fn rows(bar: &TaskProgress) -> Result<Vec<BenchRow>> {
    let mut world = cluster();
    (world.sky, world.background) = (Some([SKY; 3]), [SKY; 3]);
    let direction = DVec3::new(0.4, -0.3, 0.8).normalize();
    world.sun = Some(ReferenceSun { direction, irradiance: [SUN; 3], radius: 0.00465 });
    let tracer = PathTracer::new(&world, PathSettings::default())?;
    let bench = Bench { truth: Vec::new(), tracer: &tracer, world: &world, sun: direction };
    let bench = Bench { truth: bench.truth()?, ..bench };
    bar.step()?;
    let mut rows = vec![bench.alone()];
    for anchors in [[1, 1], [2, 1], [3, 2], [5, 3], [9, 5]] {
        rows.push(bench.row("anchors", format!("{}x{}", anchors[0], anchors[1]), anchors, &REQUEST)?);
    }
    bar.step()?;
    for paths in [128, 512, 2048, 8192] {
        rows.push(bench.row("paths", paths.to_string(), [5, 3], &TransferRequest { paths, ..REQUEST })?);
    }
    for paths in [128, 512, 2048] {
        let request = TransferRequest { method: TransferMethod::AmbientOcclusion, paths, ..REQUEST };
        rows.push(bench.row("ambient occlusion", format!("{paths} rays"), [5, 3], &request)?);
    }
    bar.step()?;
    for bands in [1, 2, 3, 5, 7] {
        let request = TransferRequest { columns: TransferColumns::Harmonics(bands), ..REQUEST };
        rows.push(bench.row("bands", bands.to_string(), [5, 3], &request)?);
    }
    bar.step()?;
    for to in 0..levels(CHAIN) {
        rows.push(bench.level(to)?);
    }
    // As many bytes as 5×3 anchors, and ten and eighty times as many.
    for cells in [[7, 7, 6], [14, 14, 15], [28, 28, 30]] {
        rows.push(bench.probes(cells)?);
    }
    bar.step()?;
    Ok(rows)
}

struct Bench<'a> {
    /// The truth at the vertices of each leaf that is compared.
    truth: Vec<Vec<Both>>,
    tracer: &'a PathTracer<'a>,
    world: &'a ReferenceWorld,
    sun: DVec3,
}

impl Bench<'_> {
    /// The light that arrives at the anchors of an instance, front and back, and the mesh's normals there.
    fn arriving(&self, instance: usize, anchors: &[Anchor], request: &TransferRequest) -> Result<Vec<[DVec3; 2]>> {
        let found = measure(self.tracer, &TransferReceiver { instance, anchors, rows: TransferRows::Both }, request);
        let columns = request.columns;
        mesophyll_files::progress::go_on()?;
        let light = self.light(columns);
        let row = |entries: &[[f32; 4]]| -> f64 {
            entries.iter().zip(&light).map(|(e, [both, sky])| f64::from(e[1]) * both + f64::from(e[3]) * sky).sum()
        };
        let count = columns.count();
        let vectors = found.entries.chunks(6 * count).map(|anchor| {
            let rows: Vec<f64> = anchor.chunks(count).map(row).collect();
            [DVec3::new(rows[0], rows[1], rows[2]), DVec3::new(rows[3], rows[4], rows[5])]
        });
        Ok(vectors.collect())
    }

    /// For each column: the light of sky and sun together, and that of the sky alone.
    fn light(&self, columns: TransferColumns) -> Vec<[f64; 2]> {
        let TransferColumns::Harmonics(bands) = columns else { return vec![[1.0, 0.0]] };
        let mut sun = vec![0.0; bands * bands];
        mesophyll_sky::harmonics::HarmonicBasis::new(bands).fill(self.sun.to_array(), &mut sun);
        let sky = |k: usize| if k == 0 { SKY * (4.0 * PI).sqrt() } else { 0.0 };
        sun.iter().enumerate().map(|(k, y)| [SUN * y + sky(k), sky(k)]).collect()
    }

    /// Irradiance on a surface with the mesh's normal at a vertex.
    fn both(&self, instance: usize, vertex: usize, [front, back]: [DVec3; 2]) -> Both {
        let placed = &self.world.instances[instance];
        let normal = self.world.leaves[placed.leaf].mesh.normals[vertex];
        let normal = placed.transform.transform_vector3(normal).normalize_or(DVec3::Z);
        [front.dot(normal) / PI, -back.dot(normal) / PI]
    }

    fn vertices(&self, instance: usize) -> impl Iterator<Item = usize> {
        (0..self.world.leaves[self.world.instances[instance].leaf].mesh.positions.len()).step_by(VERTICES)
    }

    /// The truth, by many paths from every vertex itself.
    fn truth(&self) -> Result<Vec<Vec<Both>>> {
        let of = |instance: &usize| {
            let indices = &self.world.leaves[self.world.instances[*instance].leaf].mesh.indices;
            let at = |vertex: usize| {
                let k = indices.iter().position(|i| *i as usize == vertex).unwrap_or(0);
                let barycentric = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]][k % 3];
                Anchor { points: vec![MeshPoint { triangle: k / 3, barycentric }] }
            };
            let anchors: Vec<Anchor> = self.vertices(*instance).map(at).collect();
            let found = self.arriving(*instance, &anchors, &TransferRequest { paths: MANY, ..REQUEST })?;
            Ok(self.vertices(*instance).zip(found).map(|(v, f)| self.both(*instance, v, f)).collect())
        };
        LEAVES.iter().map(of).collect()
    }

    /// Root mean square error, divided by the mean irradiance.
    fn error(&self, found: &[Vec<Both>]) -> f64 {
        let pairs = || found.iter().flatten().flatten().zip(self.truth.iter().flatten().flatten());
        let count = pairs().count() as f64;
        let mean = pairs().map(|(_, t)| t).sum::<f64>() / count;
        (pairs().map(|(f, t)| (f - t).powi(2)).sum::<f64>() / count).sqrt() / mean
    }

    /// The error when every leaf is treated as if it stood alone.
    fn alone(&self) -> BenchRow {
        let found: Vec<Vec<Both>> = self.truth.iter().map(|t| vec![[SKY; 2]; t.len()]).collect();
        let note = "no light between leaves: the sky all around, the sun by shadows alone; 0 bytes".into();
        BenchRow {
            model: "transfer".into(),
            knob: "light between leaves".into(),
            setting: "none".into(),
            error: self.error(&found),
            us: 0.0,
            note,
        }
    }

    /// A level of the chain: what coarser anchors say that are means of the finer ones.
    fn level(&self, to: usize) -> Result<BenchRow> {
        let (mut found, mut bytes, mut us) = (Vec::new(), 0, 0.0);
        for instance in LEAVES {
            let leaf = &self.world.leaves[self.world.instances[instance].leaf];
            let anchors = MeshAnchors::on_leaf(leaf, CHAIN);
            let fine = self.arriving(instance, &anchors.points, &REQUEST)?;
            let start = Instant::now();
            let nodes = coarser(CHAIN, to);
            let of = |piece: &[[DVec3; 2]], node: &Vec<(usize, f64)>| {
                node.iter().fold([DVec3::ZERO; 2], |s, (k, w)| [0, 1].map(|side| s[side] + piece[*k][side] * *w))
            };
            let coarse: Vec<[DVec3; 2]> = match to {
                0 => fine,
                _ => fine.chunks(CHAIN[0] * CHAIN[1]).flat_map(|p| nodes.iter().map(move |n| of(p, n))).collect(),
            };
            us += start.elapsed().as_secs_f64() * 1e6 / LEAVES.len() as f64;
            bytes = coarse.len() * 6 * 8;
            let places = anchors.at_level(to);
            found.push(self.vertices(instance).map(|v| self.both(instance, v, places.between(v, &coarse))).collect());
        }
        let [x, y] = level(CHAIN, to);
        Ok(BenchRow {
            model: "transfer".into(),
            knob: "level of detail".into(),
            setting: format!("{to}: {x}x{y}"),
            error: self.error(&found),
            us,
            note: format!("means of 9x5 anchors, seen as from near; a leaf, {bytes} bytes without gloss"),
        })
    }

    /// Probes in the air between the leaves instead: at every node of a grid the radiance that arrives there, as nine
    /// harmonics, which a vertex interpolates and folds with its cosine (Ramamoorthi & Hanrahan 2001; Greger et al.
    /// 1998, "The irradiance volume").
    fn probes(&self, cells: [usize; 3]) -> Result<BenchRow> {
        const BANDS: usize = 3;
        // Of the cosine, by band, over π.
        const FOLD: [f64; BANDS] = [1.0, 2.0 / 3.0, 0.25];
        let place = |instance: usize, vertex: usize| {
            let p = &self.world.instances[instance];
            p.transform.transform_point3(self.world.leaves[p.leaf].mesh.positions[vertex])
        };
        let all = (0..self.world.instances.len()).flat_map(|k| self.vertices(k).map(move |v| place(k, v)));
        let (low, high) = all.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), p| (a.min(p), b.max(p)));
        let last = DVec3::from(cells.map(|n| (n - 1) as f64));
        let basis = mesophyll_sky::harmonics::HarmonicBasis::new(BANDS);
        let start = Instant::now();
        let at = |k: usize| {
            let node = [k % cells[0], k / cells[0] % cells[1], k / cells[0] / cells[1]].map(|n| n as f64);
            let eye = low + (high - low) * DVec3::from(node) / last;
            let (mut sum, mut y) = ([0.0; BANDS * BANDS], [0.0; BANDS * BANDS]);
            for ray in 0..PROBED {
                let d = spread(ray);
                // The sun's own light is drawn by its shadows.
                let direct = d.dot(self.sun) > (0.01f64).cos();
                let l =
                    if direct { SKY } else { self.tracer.look(eye, d, 1, (k * PROBED + ray) as u64).radiance[1].mean };
                basis.fill(d.to_array(), &mut y);
                (0..y.len()).for_each(|i| sum[i] += l * y[i] * 4.0 * PI / PROBED as f64);
            }
            sum
        };
        let count = cells.iter().product::<usize>();
        let probes: Vec<_> = (0..count).map(at).collect();
        mesophyll_files::progress::go_on()?;
        let us = start.elapsed().as_secs_f64() * 1e6 / self.world.instances.len() as f64;
        let found = LEAVES.map(|instance| {
            let of = |vertex: usize| {
                let x = (place(instance, vertex) - low) / (high - low) * last;
                let mut sum = [0.0; BANDS * BANDS];
                for corner in 0..8usize {
                    let (mut node, mut weight, mut stride) = (0, 1.0, 1);
                    for axis in 0..3 {
                        let first = (x[axis] as usize).min(cells[axis] - 2);
                        let t = x[axis] - first as f64;
                        let far = corner >> axis & 1;
                        weight *= if far == 1 { t } else { 1.0 - t };
                        node += stride * (first + far);
                        stride *= cells[axis];
                    }
                    (0..sum.len()).for_each(|i| sum[i] += weight * probes[node][i]);
                }
                let placed = &self.world.instances[instance];
                let normal = self.world.leaves[placed.leaf].mesh.normals[vertex];
                let normal = placed.transform.transform_vector3(normal).normalize_or(DVec3::Z);
                [normal, -normal].map(|n| {
                    let mut y = [0.0; BANDS * BANDS];
                    basis.fill(n.to_array(), &mut y);
                    (0..y.len()).map(|i| sum[i] * y[i] * FOLD[i.isqrt()]).sum::<f64>().max(0.0)
                })
            };
            self.vertices(instance).map(of).collect::<Vec<Both>>()
        });
        Ok(BenchRow {
            model: "transfer".into(),
            knob: "probes".into(),
            setting: format!("{}x{}x{}", cells[0], cells[1], cells[2]),
            error: self.error(&found),
            us,
            note: format!(
                "nine harmonics a probe in the air, {PROBED} paths each, instead of anchors on the leaves; a leaf, {} \
                 bytes",
                count * BANDS * BANDS * 8 / self.world.instances.len()
            ),
        })
    }

    fn row(&self, knob: &str, setting: String, grid: [usize; 2], request: &TransferRequest) -> Result<BenchRow> {
        let (mut us, mut bytes) = (0.0, 0);
        let mut found = Vec::new();
        for instance in LEAVES {
            let leaf = &self.world.leaves[self.world.instances[instance].leaf];
            let start = Instant::now();
            let anchors = MeshAnchors::on_leaf(leaf, grid);
            let arriving = self.arriving(instance, &anchors.points, request)?;
            us += start.elapsed().as_secs_f64() * 1e6 / LEAVES.len() as f64;
            bytes = anchors.points.len() * 6 * request.columns.count() * 8;
            let at = |v: usize| self.both(instance, v, anchors.between(v, &arriving));
            found.push(self.vertices(instance).map(at).collect());
        }
        Ok(BenchRow {
            model: "transfer".into(),
            knob: knob.into(),
            setting,
            error: self.error(&found),
            us,
            note: format!(
                "RMS of irradiance over its mean, against {MANY} paths from every {VERTICES}th vertex; a leaf, {bytes} \
                 bytes without gloss"
            ),
        })
    }
}
