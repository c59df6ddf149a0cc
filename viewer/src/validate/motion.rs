//! Refuses branches, sections and winds that contradict themselves.

use super::wrong;
use crate::error::Result;
use crate::gpu::Gpu;
use crate::passes::bend::{SECTIONS_WIDE, VERTICES_WIDE};
use crate::scene::{MOST_BRANCHES, Scene};

/// Validates sections: a texture must hold all of them, and everything that is carried must have one.
pub(super) fn sections(gpu: &Gpu, scene: &Scene) -> Result<()> {
    let (count, of_vertices) = scene.sections.as_ref().map_or((0, [].as_slice()), |s| (s.count, &s.of_vertices));
    // A number in single precision names each section, and such numbers are exact up to 2^24.
    let rows = (gpu.device.limits().max_texture_dimension_2d as usize).min(8192);
    let most = [rows * SECTIONS_WIDE as usize, rows * VERTICES_WIDE as usize];
    for (what, found, most) in [("sections", count, most[0]), ("vertices of bark", of_vertices.len(), most[1])] {
        if found > most {
            return Err(wrong(what, found, format!("at most {most}")));
        }
    }
    for (i, instance) in scene.instances.iter().enumerate() {
        let Some(carried) = instance.carried else { continue };
        let own = match carried.vertices {
            None => Some(0),
            Some(first) => {
                let end = first as usize + scene.meshes[instance.mesh].positions.len();
                of_vertices.get(first as usize..end).map(|of| of.iter().copied().max().unwrap_or(0))
            }
        };
        if own.is_none_or(|own| carried.first as usize + own as usize >= count) {
            return Err(wrong(format!("instance {i}, section"), format!("{carried:?}"), format!("below {count}")));
        }
    }
    Ok(())
}

pub(super) fn branches(scene: &Scene) -> Result<()> {
    let n = scene.branches.len();
    if n > MOST_BRANCHES {
        return Err(wrong("branches", n, format!("at most {MOST_BRANCHES}")));
    }
    for (i, b) in scene.branches.iter().enumerate() {
        let across = [b.t.dot(b.r), b.r.dot(b.s), b.s.dot(b.t)];
        let unit = [b.t, b.r, b.s].map(|v| v.length() - 1.0);
        if !across.into_iter().chain(unit).all(|v| v.abs() < 1e-3) {
            return Err(wrong(
                format!("branch {i}, t r s"),
                format!("{} {} {}", b.t, b.r, b.s),
                "an orthonormal frame",
            ));
        }
        if !(b.length > 0.0 && b.alpha > 0.0) {
            return Err(wrong(
                format!("branch {i}, length and taper"),
                format!("{} and {}", b.length, b.alpha),
                "both above 0",
            ));
        }
        let numbers = [b.length, b.alpha, b.ln_alpha, b.ell, b.gain]
            .into_iter()
            .chain(b.a)
            .chain(b.still)
            .chain(b.root.to_array());
        let line = b.start.into_iter().chain(b.velocity);
        if !numbers.map(f64::from).chain(line).all(f64::is_finite) {
            return Err(wrong(format!("branch {i}"), "a value that is not finite", "finite values"));
        }
    }
    for (i, instance) in scene.instances.iter().enumerate() {
        let Some(ride) = instance.ride else { continue };
        if ride.branch >= n {
            return Err(wrong(format!("instance {i}, branch"), ride.branch, format!("below {n}")));
        }
        if !ride.at.is_none_or(|at| (0.0..=1.0).contains(&at)) {
            return Err(wrong(format!("instance {i}, place on its branch"), format!("{:?}", ride.at), "0 to 1"));
        }
    }
    let Some(wind) = &scene.wind else { return Ok(()) };
    let sways = scene.branches.iter().any(|b| b.gain != 0.0);
    if (wind.size == 0 && sways) || wind.motion.len() != wind.size as usize * wind.size as usize {
        return Err(wrong("motion texture", format!("{} texels", wind.motion.len()), format!("{0} x {0}", wind.size)));
    }
    if !(wind.time_s.is_finite() && wind.motion.as_flattened().iter().all(|v| v.is_finite())) {
        return Err(wrong("wind", "a value that is not finite", "finite values"));
    }
    Ok(())
}
