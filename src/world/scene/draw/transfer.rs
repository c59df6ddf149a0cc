//! Hands light between leaves to the renderer: the rows of a transfer, and the vertices' shares of the sun. Meshes and
//! instances are in the order of the transfer.

use crate::Result;
use crate::plan::levels::{self, PlanCamera};
use glam::{DVec3, Vec3};
use mesophyll_fits::transfer::{LeafRows, TransferFit};
use mesophyll_transport::transfer::anchors::coarser;
use mesophyll_transport::transfer::{TransferColumns, TransferRows};
use mesophyll_viewer::scene as viewer;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Hands over the light at the anchors, and at the coarser anchors that represent them where leaves are small in a
/// picture. Levels for which none of the `eyes` is near enough are left out. Without eyes everything is kept.
pub fn arriving(found: &TransferFit, eyes: &[PlanCamera], out: &mut viewer::Scene) {
    for (mesh, of) in out.meshes.iter_mut().zip(&found.layout.leaves) {
        mesh.anchors = Some(viewer::AnchorGrid {
            grid: of.anchors.grid.map(|n| n as u32),
            places: of.anchors.places.iter().map(|p| Vec3::from(*p)).collect(),
            rows: of.rows.count() as u32,
            levels: chain(of) as u32,
        });
    }
    // Instances that no view shows point to the rows of another instance.
    let mut kept: BTreeMap<(usize, usize), usize> = BTreeMap::new();
    let places = || out.instances.iter().zip(&found.layout.first);
    for (_, (instance, first)) in places().enumerate().filter(|(k, _)| found.layout.is_lit(*k)) {
        let (mesh, of) = (&out.meshes[instance.mesh], &found.layout.leaves[instance.mesh]);
        // Wood and ground have one level.
        let level = if chain(of) == 1 { 0 } else { levels::finest(ball(mesh, instance), of.anchors.grid, eyes) };
        kept.entry((instance.mesh, *first)).and_modify(|l| *l = (*l).min(level)).or_insert(level);
    }
    let columns = found.columns.count();
    let mut entries = Vec::new();
    let mut begins: BTreeMap<(usize, usize), u32> = BTreeMap::new();
    for (instance, first) in out.instances.iter_mut().zip(&found.layout.first) {
        let key = (instance.mesh, *first);
        instance.first_level = kept[&key] as u32;
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
        TransferColumns::Harmonics(bands) => Some(bands),
        TransferColumns::Light => None,
    };
    out.transfer =
        Some(viewer::RadianceTransfer { bands, gloss_bands: found.gloss_bands, scale: found.scale, entries });
}

/// Number of levels of a mesh's anchors. Leaves have all levels of their grids; wood and ground have one.
fn chain(of: &LeafRows) -> usize {
    if of.rows == TransferRows::Front { 1 } else { mesophyll_transport::transfer::anchors::levels(of.anchors.grid) }
}

/// Adds the entries of a level's anchors, piece by piece. `first` is the first row of the finest anchors.
fn append(found: &TransferFit, of: &LeafRows, first: usize, level: usize, entries: &mut Vec<[f32; 4]>) {
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

/// Centre and radius (mm) of a ball around an instance of a mesh.
fn ball(mesh: &viewer::Mesh, instance: &viewer::Instance) -> (DVec3, f64) {
    let (low, high) =
        mesh.positions.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(a, b), p| (a.min(*p), b.max(*p)));
    let scale = instance.transform.x_axis.truncate().length();
    let centre = instance.transform.transform_point3(0.5 * (low + high));
    (centre.as_dvec3(), f64::from(0.5 * scale * (high - low).length()))
}

/// Sets the shares of the sun that vertices see for this direction of the sun, where the transfer has them. The ground
/// uses shadow maps.
///
/// # Errors
/// [`Error::Usage`] for maps that cannot be decoded.
pub fn shade(found: &TransferFit, towards_sun: DVec3, out: &mut viewer::Scene) -> Result<()> {
    let Some(sun) = &found.sun else { return Ok(()) };
    for (k, instance) in out.instances.iter_mut().enumerate().filter(|(k, _)| Some(*k) != found.layout.ground) {
        instance.first_share = Some(sun.receivers.of(k).start as u32);
    }
    out.sun_shares = Some(Arc::new(sun.shares(towards_sun)?));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesophyll_transport::ReferenceCamera;
    use mesophyll_viewer::picking;

    /// No two neighbouring pixels are nearer to each other than stated. The smallest step at the corner is along the
    /// direction away from the middle, and the stated one is not much smaller.
    #[test]
    fn no_pixel_of_a_picture_is_smaller_than_is_said() {
        let (eye, target, up) = (DVec3::new(1.0, -5.0, 2.0), DVec3::ZERO, DVec3::Z);
        let view = ReferenceCamera { eye, target, up, fov_y_deg: 70.0 };
        let camera = crate::draw::handover::camera(&view);
        for [width, height] in [[160, 90], [90, 160], [120, 120]] {
            let ray = |x: u32, y: u32| {
                let [x, y] = [(x, width), (y, height)].map(|(k, n)| (k as f32 + 0.5) / n as f32);
                picking::ray(&camera, width as f32 / height as f32, x, y).1
            };
            let steps = (1..width).flat_map(|x| (1..height).map(move |y| (x, y)));
            let angle = |(x, y)| (ray(x, y) - ray(x - 1, y)).length().min((ray(x, y) - ray(x, y - 1)).length());
            let least = steps.map(angle).fold(f32::INFINITY, f32::min);
            let (found, up) = (PlanCamera::new(&view, [width, height]).pixel as f32, 35f32.to_radians().tan());
            let most = up.max(up * width as f32 / height as f32).hypot(1.0);
            // In single precision the angle has an error of a few parts in 1e5.
            assert!(found < 1.0001 * least && least < 1.02 * most * found, "{width}x{height}: {found} {least}");
        }
    }
}
