//! Hands light between leaves to the renderer: the rows of a transfer, and the vertices' shares of the sun. Meshes and
//! instances are in the order of the transfer.

use crate::Result;
use glam::{DVec3, Vec3};
use mesophyll_fit_transfer::{OfLeaf, Transfer};
use mesophyll_transport::ReferenceMesh;
use mesophyll_transport::transfer::anchors::{coarser, levels};
use mesophyll_transport::transfer::{Columns, Rows};
use mesophyll_viewer::scene as viewer;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The camera of a scene's pictures.
pub struct Eye {
    /// Place of the camera (mm).
    pub at: Vec3,
    /// The least angle between neighbouring pixels of its pictures (rad).
    pub pixel: f32,
}

impl Eye {
    /// The eye of pictures of this size. At the angle θ from the axis a pixel covers a smaller angle than in the
    /// middle. Across the direction from the middle it is smaller by cos θ, because the place on the picture plane is
    /// farther away. Along this direction it is smaller by cos² θ, because the ray also meets the picture at a slant.
    /// The corner has the largest θ.
    pub fn new(camera: &viewer::Camera, [width, height]: [u32; 2]) -> Eye {
        let up = (0.5 * camera.fov_y_deg.to_radians()).tan();
        let pixels = height.max(1) as f32;
        let across = up * width as f32 / pixels;
        Eye { at: camera.eye, pixel: 2.0 * up / pixels / (1.0 + up * up + across * across) }
    }
}

/// As in `arrives.wgsl`: where anchors are fewer pixels apart than this, coarser anchors are mixed in.
const NEAR: f32 = 4.0;

/// Hands over the light at the anchors, and at the coarser anchors that represent them where leaves are small in a
/// picture. Levels for which none of the `eyes` is near enough are left out. Without eyes everything is kept.
pub fn arriving(found: &Transfer, eyes: &[Eye], out: &mut viewer::Scene) {
    for (mesh, of) in out.meshes.iter_mut().zip(&found.layout.leaves) {
        mesh.anchors = Some(viewer::Anchors {
            grid: of.anchors.grid.map(|n| n as u32),
            places: of.anchors.places.iter().map(|p| Vec3::from(*p)).collect(),
            rows: of.rows.count() as u32,
            levels: chain(of) as u32,
        });
    }
    // Instances that no view shows share the rows of another instance.
    let mut kept: BTreeMap<(usize, usize), u32> = BTreeMap::new();
    let places = || out.instances.iter().zip(&found.layout.first);
    for (instance, first) in places() {
        let level = finest(&out.meshes[instance.mesh], instance, eyes);
        kept.entry((instance.mesh, *first)).and_modify(|l| *l = (*l).min(level)).or_insert(level);
    }
    let columns = found.columns.count();
    let mut entries = Vec::new();
    let mut begins: BTreeMap<(usize, usize), u32> = BTreeMap::new();
    for (instance, first) in out.instances.iter_mut().zip(&found.layout.first) {
        let key = (instance.mesh, *first);
        instance.first_level = kept[&key];
        instance.first_row = *begins.entry(key).or_insert_with(|| {
            let begin = (entries.len() / columns) as u32;
            let of = &found.layout.leaves[instance.mesh];
            for level in instance.first_level as usize..chain(of) {
                append(found, of, *first, level, &mut entries);
            }
            begin
        });
    }
    let bands = match found.columns {
        Columns::Harmonics(bands) => Some(bands),
        Columns::Light => None,
    };
    out.transfer = Some(viewer::Transfer { bands, gloss_bands: found.gloss_bands, scale: found.scale, entries });
}

/// Number of levels of a mesh's anchors. Leaves have all levels of their grids; wood and ground have one.
fn chain(of: &OfLeaf) -> usize {
    if of.rows == Rows::Front { 1 } else { levels(of.anchors.grid) }
}

/// Adds the entries of a level's anchors, piece by piece. `first` is the first row of the finest anchors.
fn append(found: &Transfer, of: &OfLeaf, first: usize, level: usize, entries: &mut Vec<[f32; 4]>) {
    let an_anchor = of.rows.count() * found.columns.count();
    let count = of.anchors.points.len();
    let fine = &found.entries[first * found.columns.count()..][..count * an_anchor];
    if level == 0 {
        entries.extend(fine);
        return;
    }
    let nodes = coarser(of.anchors.grid, level);
    for piece in fine.chunks(an_anchor * of.anchors.grid[0] * of.anchors.grid[1]) {
        for node in &nodes {
            entries.extend((0..an_anchor).map(|entry| {
                let part =
                    |c: usize| node.iter().map(|(k, w)| w * f64::from(piece[k * an_anchor + entry][c])).sum::<f64>();
                [0, 1, 2, 3].map(|c| part(c) as f32)
            }));
        }
    }
}

/// The finest level for which any eye is near enough: the distance between its pixels is fewer anchors than the next
/// level needs.
fn finest(mesh: &viewer::Mesh, instance: &viewer::Instance, eyes: &[Eye]) -> u32 {
    let Some(anchors) = &mesh.anchors else { return 0 };
    let (low, high) =
        mesh.positions.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(a, b), p| (a.min(*p), b.max(*p)));
    let scale = instance.transform.x_axis.truncate().length();
    let (centre, radius) =
        (instance.transform.transform_point3(0.5 * (low + high)), 0.5 * scale * (high - low).length());
    // The least number of anchors for a unit of length, because a piece is not longer than the mesh.
    let dense = anchors.grid.iter().map(|n| (n - 1) as f32 / (2.0 * radius)).fold(f32::INFINITY, f32::min);
    let level = |eye: &Eye| {
        let passed = (eye.at.distance(centre) - radius).max(0.0) * eye.pixel * dense;
        (NEAR * passed).log2().clamp(0.0, (anchors.levels - 1) as f32) as u32
    };
    eyes.iter().map(level).min().unwrap_or(0)
}

/// Sets the shares of the sun that vertices see for this direction of the sun, where the transfer has them. The ground
/// uses shadow maps.
///
/// # Errors
/// [`Error::Usage`] for maps that cannot be decoded.
pub fn shade(found: &Transfer, towards_sun: DVec3, out: &mut viewer::Scene) -> Result<()> {
    let Some(sun) = &found.sun else { return Ok(()) };
    for (k, instance) in out.instances.iter_mut().enumerate().filter(|(k, _)| Some(*k) != found.layout.ground) {
        instance.first_share = Some(sun.receivers.of(k).start as u32);
    }
    out.sun_shares = Some(Arc::new(sun.shares(towards_sun)?));
    Ok(())
}

/// A mesh of the transfer in the renderer's precision.
pub fn mesh(mesh: &ReferenceMesh) -> viewer::Mesh {
    viewer::Mesh {
        positions: mesh.positions.iter().map(|p| p.as_vec3()).collect(),
        normals: mesh.normals.iter().map(|p| p.as_vec3()).collect(),
        tangents: mesh.tangents.iter().map(|t| t.as_vec4()).collect(),
        uvs: mesh.uvs.iter().map(|p| p.as_vec2()).collect(),
        indices: mesh.indices.clone(),
        details: Vec::new(),
        anchors: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Mat4;
    use mesophyll_viewer::pick;

    /// No two neighbouring pixels are nearer to each other than stated. The smallest step at the corner is along the
    /// direction away from the middle, and the stated one is not much smaller.
    #[test]
    fn no_pixel_of_a_picture_is_smaller_than_is_said() {
        let camera =
            viewer::Camera { eye: Vec3::new(1.0, -5.0, 2.0), target: Vec3::ZERO, up: Vec3::Z, fov_y_deg: 70.0 };
        for [width, height] in [[160, 90], [90, 160], [120, 120]] {
            let ray = |x: u32, y: u32| {
                let [x, y] = [(x, width), (y, height)].map(|(k, n)| (k as f32 + 0.5) / n as f32);
                pick::ray(&camera, width as f32 / height as f32, x, y).1
            };
            let steps = (1..width).flat_map(|x| (1..height).map(move |y| (x, y)));
            let angle = |(x, y)| (ray(x, y) - ray(x - 1, y)).length().min((ray(x, y) - ray(x, y - 1)).length());
            let least = steps.map(angle).fold(f32::INFINITY, f32::min);
            let (found, up) = (Eye::new(&camera, [width, height]).pixel, 35f32.to_radians().tan());
            let most = up.max(up * width as f32 / height as f32).hypot(1.0);
            // In single precision the angle has an error of a few parts in 1e5.
            assert!(found < 1.0001 * least && least < 1.02 * most * found, "{width}x{height}: {found} {least}");
        }
    }

    /// A leaf 60 mm long with five by three anchors: the coarser the level, the farther away every eye must be. An eye
    /// inside its ball, or no eye at all, keeps everything.
    #[test]
    fn only_levels_that_an_eye_comes_near_are_kept() {
        let places = vec![Vec3::ZERO, Vec3::new(0.0, 4.0, 2.0)];
        let mesh = viewer::Mesh {
            positions: vec![Vec3::new(-30.0, -1.0, 0.0), Vec3::new(30.0, 1.0, 0.0)],
            anchors: Some(viewer::Anchors { grid: [5, 3], places, rows: 6, levels: 3 }),
            ..viewer::Mesh::default()
        };
        let instance = viewer::Instance { transform: Mat4::from_translation(Vec3::X * 100.0), ..Default::default() };
        let at = |far: &[f32]| {
            let eyes: Vec<Eye> = far.iter().map(|x| Eye { at: Vec3::X * (100.0 + x), pixel: 1e-3 }).collect();
            finest(&mesh, &instance, &eyes)
        };
        assert_eq!((at(&[]), at(&[10.0]), at(&[1e6])), (0, 0, 2));
        // Anchors are 30 mm apart across the leaf, which is half a distance for each pixel where a pixel is 15 mm wide.
        assert_eq!((at(&[1.45e4]), at(&[1.55e4]), at(&[1.55e4, 50.0])), (0, 1, 0));
    }
}
