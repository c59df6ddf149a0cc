//! Forests that are hard to draw: plants that stand a million times, inside each other, at extreme scales, behind the
//! camera or so far away that nothing of them is as large as a pixel. Where the answer is known, pictures are compared
//! with pictures of the same leaves one by one. Also forests that a scene may not state.

use crate::stress::StressRow;
use crate::{Error, Result};
use mesophyll_scene::manifest::SceneManifest;
use std::path::Path;
use std::time::Instant;

/// A row about a forest.
fn row(case: &str, expected: &str, clock: Instant, verdict: String) -> StressRow {
    StressRow {
        model: "forest".into(),
        case: case.into(),
        expected: expected.into(),
        verdict,
        digits: None,
        condition: None,
        ms: clock.elapsed().as_secs_f64() * 1e3,
    }
}

/// What a scene states about a plant, and the verdict of its reader.
fn stated(fields: &str) -> String {
    let text = format!(
        "schema = 1\nname = \"f\"\n[[leaf]]\nname = \"a\"\nmesh = \"m.glb\"\n\
         uniform = {{ rho_d = [[0.1, 0.1, 0.1], [0.1, 0.1, 0.1]], rho_t = [0.1, 0.1, 0.1] }}\n\
         [[plant]]\nfile = \"p.glb\"\nmaterials = {{ leaf = \"a\" }}\n{fields}\n\
         [sky]\nradiance = [1, 1, 1]\n[[view]]\nname = \"v\"\nkind = \"perspective\"\neye_mm = [0, -1e3, 0]\n\
         target_mm = [0, 0, 0]\nfov_deg = 40\n"
    );
    match SceneManifest::parse(&text, Path::new("forest.toml")) {
        Ok(_) => "ok".into(),
        Err(error) => {
            // What follows the file and the line.
            let told = error.to_string();
            format!("refused: {}", told.splitn(3, ':').nth(2).unwrap_or(&told).trim())
        }
    }
}

/// The cases of `stress forest`. Without an adapter those that draw are left out, and a message says so.
///
/// # Errors
/// Those of opening the adapter, and a stop.
pub fn rows() -> Result<Vec<StressRow>> {
    let mut rows = Vec::new();
    for (case, expected, fields) in [
        ("more plants than a scene may have", "refused: plant.count", "count = 2000001\narea_mm = [1e6, 1e6]"),
        ("many plants without an area", "refused: plant.area_mm", "count = 1000"),
        (
            "a list of places beside a number",
            "refused: plant.positions",
            "positions = \"p.txt\"\ncount = 5\narea_mm = [1e6, 1e6]",
        ),
        ("a unit without a list", "refused: plant.unit", "unit = \"mm\""),
        ("scales that fall", "refused: plant.scales", "count = 9\narea_mm = [1e6, 1e6]\nscales = [2, 1]"),
        ("a scale of nothing", "refused: plant.scales", "count = 9\narea_mm = [1e6, 1e6]\nscales = [0, 1]"),
        ("two million plants in a strip", "ok", "count = 2000000\narea_mm = [1e9, 1]\nscales = [0.001, 1000]"),
    ] {
        let clock = Instant::now();
        rows.push(row(case, expected, clock, stated(fields)));
    }
    #[cfg(feature = "render")]
    rows.extend(drawn::rows()?);
    if mesophyll_files::progress::stop_requested() {
        return Err(Error::Interrupted("stopped".into()));
    }
    Ok(rows)
}

#[cfg(feature = "render")]
mod drawn {
    use super::row;
    use crate::Result;
    use crate::stress::StressRow;
    use glam::{Mat4, Quat, Vec2, Vec3, Vec4};
    use mesophyll_check::told;
    use mesophyll_files::progress;
    use mesophyll_viewer as gpu;
    use mesophyll_viewer::scene::{self as viewer, Instance, PlantStand, Scene, StandPlace};
    use std::sync::Arc;
    use std::time::Instant;

    const SIZE: [u32; 2] = [320, 240];
    const FOV_DEG: f32 = 40.0;
    /// Pixels that may differ between two ways to draw the same, and by how much they must to count.
    const SHARE: f64 = 1e-3;
    const DIFFERENT: f32 = 0.02;

    /// A square leaf of 10 mm.
    fn square() -> viewer::Mesh {
        let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
        viewer::Mesh {
            positions: corners.iter().map(|(x, y)| Vec3::new(5.0 * x, 5.0 * y, 0.0)).collect(),
            normals: vec![Vec3::Z; 4],
            tangents: vec![Vec4::new(1.0, 0.0, 0.0, 1.0); 4],
            uvs: corners.iter().map(|(x, y)| Vec2::new(0.5 + 0.5 * x, 0.5 - 0.5 * y)).collect(),
            indices: vec![0, 1, 2, 0, 2, 3],
            ..viewer::Mesh::default()
        }
    }

    fn leaf() -> viewer::Material {
        let side = |rho: f32| viewer::SideMaps {
            interior: viewer::Interior::Maps { rho_d: vec![[rho; 3]], rho_t: vec![[0.5 * rho; 3]] },
            ..viewer::SideMaps::black()
        };
        viewer::Material::Leaf(viewer::LeafMaterial {
            name: "leaf".into(),
            width: 1,
            height: 1,
            thickness_mm: 0.2,
            lobe: viewer::Lobe::Beckmann,
            sides: viewer::Sides { front: side(0.2), back: side(0.3) },
            mask: None,
        })
    }

    /// The places of a plant's leaves: on a spiral around its stem.
    fn leaves(count: usize) -> impl Iterator<Item = Mat4> {
        (0..count).map(move |k| {
            let turn = Quat::from_rotation_z(2.4 * k as f32) * Quat::from_rotation_y(0.2 + 0.01 * (k % 90) as f32);
            let height = 100.0 * (k as f32 + 0.5) / 400.0f32.max(count as f32);
            Mat4::from_rotation_translation(turn, turn * Vec3::X * 12.0 + height * Vec3::Z)
        })
    }

    /// A plant of so many leaves at these places, under sun and sky and without shadows.
    fn scene(count: usize, places: &[Mat4], stand: bool) -> Scene {
        let mut scene = Scene { exposure: 1.0, msaa: 4, sky: Some([1.0; 3]), ..Scene::default() };
        scene.sun = Some(viewer::Sun { direction: Vec3::new(0.48, -0.6, 0.64), irradiance: [3.0; 3], radius: 0.00465 });
        let one = scene.add(square(), leaf());
        if stand {
            let at = |transform| Instance { transform, stand: Some(0), ..one };
            scene.instances = leaves(count).map(at).collect();
            let places = places.iter().map(|place| StandPlace { transform: *place, pose: 0 }).collect();
            scene.stands = vec![Arc::new(PlantStand { places, poses: 1, ..PlantStand::default() })];
        } else {
            let all = places.iter().flat_map(|place| leaves(count).map(move |leaf| *place * leaf));
            scene.instances = all.map(|transform| Instance { transform, ..one }).collect();
        }
        scene
    }

    /// A camera that looks along y at a point from a distance.
    fn camera(target: Vec3, distance: f32) -> viewer::Camera {
        let eye = target - distance * Vec3::new(0.1, 1.0, -0.2).normalize();
        viewer::Camera { eye, target, up: Vec3::Z, fov_y_deg: FOV_DEG }
    }

    fn grid(side: usize, spacing: f32) -> Vec<Mat4> {
        let at = |k: usize| Vec3::new((k % side) as f32, (k / side) as f32, 0.0) * spacing;
        let middle = 0.5 * (side as f32 - 1.0) * spacing * Vec3::new(1.0, 1.0, 0.0);
        (0..side * side)
            .map(|k| Mat4::from_rotation_translation(Quat::from_rotation_z(2.4 * k as f32), at(k) - middle))
            .collect()
    }

    fn scaled(by: f32, places: &[Mat4]) -> Vec<Mat4> {
        places.iter().map(|place| Mat4::from_scale(Vec3::splat(by)) * *place).collect()
    }

    /// How a picture ended: it must be finite.
    fn finite(picture: &gpu::Picture) -> std::result::Result<f64, String> {
        if picture.hdr.iter().flatten().any(|v| !v.is_finite()) {
            return Err("wrong: radiance that is no number".into());
        }
        Ok(picture.hdr.iter().filter(|p| p[3] > 0.0).count() as f64 / picture.hdr.len() as f64)
    }

    /// Whether two pictures show the same.
    fn same(a: &gpu::Picture, b: &gpu::Picture) -> String {
        let differ = |(a, b): &(&[f32; 4], &[f32; 4])| (0..3).any(|c| !((a[c] - b[c]).abs() <= DIFFERENT));
        let share = a.hdr.iter().zip(&b.hdr).filter(differ).count() as f64 / a.hdr.len() as f64;
        let covered = b.hdr.iter().filter(|p| p[3] > 0.0).count();
        match (share <= SHARE, covered > 100) {
            (true, true) => "ok".into(),
            (_, false) => format!("wrong: only {covered} pixels show anything"),
            (false, _) => format!("wrong: {:.3} % of the pixels differ", 100.0 * share),
        }
    }

    pub fn rows() -> Result<Vec<StressRow>> {
        let mut renderer = match gpu::Renderer::headless(&gpu::Options::default()) {
            Err(gpu::Error::NoAdapter) => {
                progress::say("no graphics adapter: the forests that are drawn are left out");
                return Ok(Vec::new());
            }
            opened => opened.map_err(told)?,
        };
        let mut rows = Vec::new();
        let [w, h] = SIZE;
        let mut add = |case: &str, expected: &str, run: &mut dyn FnMut(&mut gpu::Renderer) -> Verdict| {
            let clock = Instant::now();
            let verdict = match run(&mut renderer) {
                Ok(verdict) => verdict,
                Err(gpu::Error::Scene { place, found, expected }) => {
                    format!("refused: {place}: found {found}, expected {expected}")
                }
                Err(other) => format!("wrong: {other}"),
            };
            rows.push(row(case, expected, clock, verdict));
        };
        type Verdict = gpu::Result<String>;
        let draw = |renderer: &mut gpu::Renderer, scene: &Scene, camera: &viewer::Camera| {
            renderer.set_scene(scene)?;
            renderer.render(camera, w, h)
        };
        let covers = |picture: &gpu::Picture, least: f64, most: f64| match finite(picture) {
            Ok(share) if (least..=most).contains(&share) => "ok".to_string(),
            Ok(share) => format!("wrong: {:.3} % of the picture are covered", 100.0 * share),
            Err(wrong) => wrong,
        };
        add("a plant of one leaf, a million times", "ok", &mut |r| {
            let seen = camera(Vec3::ZERO, 4e4);
            Ok(covers(&draw(r, &scene(1, &grid(1000, 40.0), true), &seen)?, 0.01, 1.0))
        });
        add("a plant of 400 leaves, a million times, far away", "ok", &mut |r| {
            let plain = draw(r, &scene(400, &grid(1000, 400.0), true), &camera(Vec3::ZERO, 6e5))?;
            let drawn = r.stats().triangles;
            Ok(if drawn > 40_000_000 { format!("wrong: {drawn} triangles") } else { covers(&plain, 0.01, 0.5) })
        });
        let near = camera(40.0 * Vec3::Z, 300.0);
        add("a thousand plants inside each other", "ok", &mut |r| {
            let one = draw(r, &scene(40, &[Mat4::IDENTITY], true), &near)?;
            Ok(same(&draw(r, &scene(40, &[Mat4::IDENTITY; 1000], true), &near)?, &one))
        });
        let few = grid(6, 60.0);
        add("a plant of one leaf", "ok", &mut |r| {
            let alone = draw(r, &scene(1, &few, false), &near)?;
            Ok(same(&draw(r, &scene(1, &few, true), &near)?, &alone))
        });
        for (case, by) in [("a scale of 0.001", 1e-3), ("a scale of 1,000", 1e3)] {
            add(case, "ok", &mut |r| {
                let alone = draw(r, &scene(40, &few, false), &near)?;
                let seen = viewer::Camera { eye: by * near.eye, target: by * near.target, ..near };
                Ok(same(&draw(r, &scene(40, &scaled(by, &few), true), &seen)?, &alone))
            });
        }
        add("scales from 0.001 to 1,000 in one forest", "ok", &mut |r| {
            let places: Vec<Mat4> = few
                .iter()
                .enumerate()
                .map(|(k, m)| *m * Mat4::from_scale(Vec3::splat(10f32.powi(k as i32 % 7 - 3))))
                .collect();
            Ok(covers(&draw(r, &scene(40, &places, true), &near)?, 0.01, 1.0))
        });
        add("all behind the camera", "ok", &mut |r| {
            let away = viewer::Camera { target: 2.0 * near.eye - near.target, ..near };
            let picture = draw(r, &scene(40, &few, true), &away)?;
            let drawn = r.stats().triangles;
            Ok(if drawn > 0 { format!("wrong: {drawn} triangles") } else { covers(&picture, 0.0, 0.0) })
        });
        add("all so far away that none covers a pixel", "ok", &mut |r| {
            Ok(covers(&draw(r, &scene(40, &few, true), &camera(Vec3::ZERO, 1e9))?, 0.0, 1e-3))
        });
        add("a camera inside a crown", "ok", &mut |r| {
            let inside = viewer::Camera { eye: Vec3::new(30.0, 30.0, 5.0), target: Vec3::new(31.0, 35.0, 5.5), ..near };
            let alone = draw(r, &scene(40, &few, false), &inside)?;
            Ok(same(&draw(r, &scene(40, &few, true), &inside)?, &alone))
        });
        add("a kilometre from the origin", "ok", &mut |r| {
            let moved: Vec<Mat4> = few.iter().map(|m| Mat4::from_translation(1e6 * Vec3::X) * *m).collect();
            let seen = viewer::Camera { eye: near.eye + 1e6 * Vec3::X, target: near.target + 1e6 * Vec3::X, ..near };
            let alone = draw(r, &scene(40, &moved, false), &seen)?;
            Ok(same(&draw(r, &scene(40, &moved, true), &seen)?, &alone))
        });
        add("no place at all", "ok", &mut |r| Ok(covers(&draw(r, &scene(40, &[], true), &near)?, 0.0, 0.0)));
        let broken = |change: fn(&mut Mat4)| {
            let mut places = few.clone();
            change(&mut places[3]);
            scene(4, &places, true)
        };
        add("a place that is no number", "refused: stand 0, place 3", &mut |r| {
            draw(r, &broken(|m| m.w_axis.x = f32::NAN), &near).map(|_| "ok".into())
        });
        add("a plant that is flattened", "refused: stand 0, place 3", &mut |r| {
            draw(r, &broken(|m| m.z_axis *= 0.5), &near).map(|_| "ok".into())
        });
        add("a pose that there is not", "refused: stand 0, place 0, pose", &mut |r| {
            let mut forest = scene(4, &few, true);
            let mut stand = (*forest.stands[0]).clone();
            stand.places[0].pose = 1;
            forest.stands = vec![Arc::new(stand)];
            draw(r, &forest, &near).map(|_| "ok".into())
        });
        Ok(rows)
    }
}
