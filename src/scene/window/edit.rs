//! What the window asks of the library: an edit of h, σa, σs or the gloss becomes a new slab (so that a thicker leaf
//! really dims), a reference picture, a verdict, a saved fit, a texel's numbers.

use super::save;
use crate::Result;
use crate::draw::handover;
use crate::draw::reference::{self, Chebyshev};
use crate::draw::sunlit::relight_where;
use crate::fits::fitted::Fitted;
use crate::ledger::Ledger;
use crate::loaded::curve::curve;
use crate::loaded::{Leaf, Scene};
use crate::manifest::{Interior, View, ViewKind};
use crate::placed::branch;
use crate::placed::daylight::{self, Daylight};
use crate::placed::placement::Ride;
use glam::DVec3;
use mesophyll_files::image::Maps;
use mesophyll_optics::side::{Side, Sides};
use mesophyll_transport::{self as transport, compare};
use mesophyll_viewer as gpu;
use mesophyll_viewer::editor::{Editor, LeafEdit, LeafUpdate, Measure, ReferencePicture, SideEdit, SkyUpdate, Verdict};
use mesophyll_viewer::scene as viewer;
use std::path::PathBuf;
use std::sync::Arc;

/// The editor behind a window on one scene.
pub struct SceneEditor {
    scene: Scene,
    ledger: Ledger,
    /// The scene's leaves by the renderer's index.
    shown: Vec<usize>,
    starts: Vec<LeafEdit>,
    edits: Vec<LeafEdit>,
    /// `front.exr` and `back.exr` of every shown leaf.
    maps: Vec<[Option<Maps>; 2]>,
    /// Edited fits go here.
    out: PathBuf,
    judged: Option<transport::ReferencePicture>,
}

impl SceneEditor {
    /// `scene` must be one for a window ([`crate::placed::leaf::Search::free`]), with every leaf fitted.
    ///
    /// # Errors
    /// [`crate::Error::Input`] for a map that cannot be read.
    pub fn new(scene: Scene, out: PathBuf) -> Result<SceneEditor> {
        let ledger = Ledger::new();
        let shown: Vec<usize> = scene.drawn().map(|l| l.placed.index).collect();
        let (mut starts, mut maps) = (Vec::new(), Vec::new());
        for &index in &shown {
            let mut sides = [None, None];
            let mut start = LeafEdit { thickness_mm: 0.0, sides: Sides::of(|_| unedited()) };
            if let Some(fitted) = &scene.placed.leaves[index].fitted {
                for (s, side) in Side::ALL.into_iter().enumerate().filter(|(_, side)| fitted.has(*side)) {
                    let path = fitted.folder.join(format!("{}.exr", side.name()));
                    sides[s] = Some(ledger.note("read", fitted.entry(&format!("{}.exr", side.name())), 0, || {
                        mesophyll_files::image::read_exr(&path)
                    })?);
                    let edit = &mut start.sides[side];
                    (edit.sigma_a, edit.sigma_s) = (
                        fitted.rgb(side, "sigma_a")?.map(|v| v as f32),
                        fitted.rgb(side, "sigma_s")?.map(|v| v as f32),
                    );
                    if scene.manifest.leaves[index].interior == Interior::Maps
                        && let Some(maps) = &sides[s]
                    {
                        (edit.sigma_a, edit.sigma_s) = (mean(maps, "sigma_a"), mean(maps, "sigma_s"));
                    }
                }
                start.thickness_mm = fitted.thickness(lead(fitted))? as f32;
            }
            starts.push(start);
            maps.push(sides);
        }
        Ok(SceneEditor { scene, ledger, shown, edits: starts.clone(), starts, maps, out, judged: None })
    }

    fn leaf(&self, leaf: usize) -> Leaf<'_> {
        self.scene.leaf(self.shown[leaf])
    }

    fn side(&self, leaf: usize, side: Side, edit: &LeafEdit) -> Result<viewer::Interior> {
        let s = side as usize;
        let of = self.leaf(leaf);
        let black = viewer::Interior::Scalars(viewer::SlabCurve::default());
        let Some(fitted) = of.placed.fitted.as_ref().filter(|f| f.has(Side::ALL[s]) && of.plan.sides[s].interior())
        else {
            return Ok(black);
        };
        let of_side = &edit.sides[Side::ALL[s]];
        match of.config.interior {
            Interior::Scalars => {
                let (low, high) = self.range(leaf, s, edit);
                let (sigma_a, sigma_s) = (of_side.sigma_a.map(f64::from), of_side.sigma_s.map(f64::from));
                let what = format!("{}/{} slab curve", fitted.name, Side::ALL[s].name());
                Ok(viewer::Interior::Scalars(handover::slab_curve(&curve(
                    sigma_a,
                    sigma_s,
                    low,
                    high,
                    1e-4,
                    &what,
                    &self.ledger,
                ))))
            }
            Interior::Maps => {
                let [rho_d, rho_t] = handover::pigment(of, Side::ALL[s], &self.scaling(leaf, s, edit), &self.ledger)?;
                Ok(viewer::Interior::Maps { rho_d, rho_t })
            }
        }
    }

    /// Thinnest and thickest texel of a side with an edited h (mm).
    fn range(&self, leaf: usize, s: usize, edit: &LeafEdit) -> (f64, f64) {
        let h = f64::from(edit.thickness_mm);
        let none = Vec::new();
        let texels = self.leaf(leaf).loaded.textures[s].gamma_delta.as_ref().unwrap_or(&none);
        let (low, high) =
            texels.iter().fold((h, h), |(a, b), t| (a.min(h + f64::from(t[3])), b.max(h + f64::from(t[3]))));
        // An edit may ask for less blade than a vein is thinner than the mean.
        (low.max(1e-3 * h), high)
    }

    /// What pigment maps are multiplied with, and what is added to the thickness.
    fn scaling(&self, leaf: usize, s: usize, edit: &LeafEdit) -> handover::Scaling {
        let [start, now] = [&self.starts[leaf], edit].map(|e| &e.sides[Side::ALL[s]]);
        let ratio = |a: [f32; 3], b: [f32; 3]| [0, 1, 2].map(|c| if b[c] > 0.0 { f64::from(a[c] / b[c]) } else { 1.0 });
        handover::Scaling {
            sigma_a: ratio(now.sigma_a, start.sigma_a),
            sigma_s: ratio(now.sigma_s, start.sigma_s),
            thickness_mm: f64::from(edit.thickness_mm - self.starts[leaf].thickness_mm),
        }
    }

    /// The reference's world with the edits and the window's lights in it.
    fn world(&self, scene: &viewer::Scene, eye: DVec3) -> Result<transport::World> {
        let mut world = reference::world(&self.scene, &self.ledger)?;
        for (leaf, edit) in self.edits.iter().enumerate().take(self.shown.len()) {
            let drawn = &mut world.leaves[leaf];
            for (s, side) in [&mut drawn.front, &mut drawn.back].into_iter().enumerate() {
                let of_side = &edit.sides[Side::ALL[s]];
                if let Some(gloss) = &mut side.gloss {
                    gloss.rho_s.iter_mut().flatten().for_each(|v| *v *= of_side.rho_s_scale);
                    gloss.m.iter_mut().for_each(|v| *v *= of_side.m_scale);
                }
                if *edit == self.starts[leaf] {
                    continue;
                }
                match &mut side.interior {
                    transport::Interior::Scalars { thickness, curve, .. } => {
                        let more = edit.thickness_mm - self.starts[leaf].thickness_mm;
                        thickness.iter_mut().for_each(|v| *v += more);
                        let (low, high) = self.range(leaf, s, edit);
                        let slab =
                            Chebyshev::new(of_side.sigma_a.map(f64::from), of_side.sigma_s.map(f64::from), low, high);
                        *curve = Arc::new(move |h| slab.at(h));
                    }
                    transport::Interior::Maps { rho_d, rho_t } if self.leaf(leaf).plan.sides[s].interior() => {
                        let [d, t] = handover::pigment(
                            self.leaf(leaf),
                            Side::ALL[s],
                            &self.scaling(leaf, s, edit),
                            &self.ledger,
                        )?;
                        *rho_d = [0, 1, 2].map(|c| d.iter().map(|v| v[c]).collect());
                        *rho_t = [0, 1, 2].map(|c| t.iter().map(|v| v[c]).collect());
                    }
                    transport::Interior::Maps { .. } => {}
                }
            }
        }
        let time = scene.wind.as_ref().map_or_else(|| branch::rest_time(&self.scene.manifest), |w| w.time_s);
        let place = |i: &viewer::Instance| {
            let rest = i.transform.as_dmat4();
            let ride = i.ride.and_then(|r| Some(Ride { branch: r.branch, at: f64::from(r.at?) }));
            let transform = match (&self.scene.placed.bends, ride) {
                (Some(bends), Some(ride)) => bends.transform(ride, time, rest),
                _ => rest,
            };
            transport::Placement { leaf: i.material, transform }
        };
        world.instances = scene.instances.iter().map(place).collect();
        if let Some(bends) = &self.scene.placed.bends {
            reference::move_branches(&mut world, &self.scene.placed, bends, time);
        }
        world.sun = scene.sun.map(|s| transport::ReferenceSun {
            direction: s.direction.as_dvec3(),
            irradiance: s.irradiance.map(f64::from),
            radius: f64::from(s.radius),
        });
        world.sky = scene.sky.map(|c| c.map(f64::from));
        world.dome = match &scene.dome {
            Some(dome) => {
                let (zenith, azimuth) = angles(dome.sun);
                let daylight = Daylight::at(&self.scene.manifest, zenith, azimuth, f64::from(dome.turbidity))?;
                Some(reference::dome(&self.scene.manifest, daylight, f64::from(dome.strength)))
            }
            None => None,
        };
        (world.background, world.exposure) = (scene.background.map(f64::from), f64::from(scene.exposure));
        let has =
            |leaf: usize, s: usize| scene.leaf(leaf).is_some_and(|l| l.sides[Side::ALL[s]].translucency.is_some());
        relight_where(&mut world, &self.scene, &[eye], has)?;
        Ok(world)
    }
}

/// Zenith angle and azimuth (rad) of a direction.
fn angles(towards: glam::Vec3) -> (f64, f64) {
    let d = towards.as_dvec3().normalize();
    (d.truncate().length().atan2(d.z), d.y.atan2(d.x))
}

fn unedited() -> SideEdit {
    SideEdit { sigma_a: [0.0; 3], sigma_s: [0.0; 3], rho_s_scale: 1.0, m_scale: 1.0 }
}

/// The side whose h a leaf is drawn with.
fn lead(fitted: &Fitted) -> Side {
    if fitted.has(Side::Front) { Side::Front } else { Side::Back }
}

/// Means of three channels over the good texels.
fn mean(maps: &Maps, what: &str) -> [f32; 3] {
    let mask = maps.get("mask.Y");
    ["R", "G", "B"].map(|c| {
        let plane = maps.get(&format!("{what}.{c}")).unwrap_or_default();
        let good = plane.iter().enumerate().filter(|(k, v)| v.is_finite() && mask.is_none_or(|m| m[*k] > 0.0));
        let (sum, n) = good.fold((0.0, 0u32), |(s, n), (_, v)| (s + f64::from(*v), n + 1));
        (sum / f64::from(n.max(1))) as f32
    })
}

impl Editor for SceneEditor {
    fn start(&self, leaf: usize) -> LeafEdit {
        self.starts[leaf]
    }

    fn recompute(&mut self, leaf: usize, edit: &LeafEdit) -> std::result::Result<LeafUpdate, String> {
        if !(edit.thickness_mm > 0.0 && edit.thickness_mm.is_finite()) {
            return Err(format!("h: found {} mm, expected a positive thickness", edit.thickness_mm));
        }
        let sides = Sides::try_of(|side| self.side(leaf, side, edit).map_err(|e| e.to_string()))?;
        let update = LeafUpdate { thickness_mm: edit.thickness_mm, sides };
        self.edits[leaf] = *edit;
        Ok(update)
    }

    fn sky(&mut self, sun: glam::Vec3, turbidity: f32) -> std::result::Result<SkyUpdate, String> {
        let (zenith, azimuth) = angles(sun);
        let new = || -> Result<SkyUpdate> {
            let daylight = Daylight::at(&self.scene.manifest, zenith, azimuth, f64::from(turbidity))?;
            let [low, high] = mesophyll_sky::preetham::TRUSTED;
            let fitted = (low..=high)
                .contains(&daylight.turbidity)
                .then(|| daylight::polynomials(self.scene.plan.light.sun_moves, &self.ledger))
                .transpose()?;
            let dome = handover::dome(&daylight, self.scene.plan.light.sky_bands, fitted.flatten())?;
            Ok(SkyUpdate { dome, sun_irradiance: daylight.sun.map(|v| v as f32) })
        };
        new().map_err(|e| e.to_string())
    }

    fn save(&mut self, leaf: usize, edit: &LeafEdit) -> std::result::Result<String, String> {
        let Some(fitted) = &self.leaf(leaf).placed.fitted else { return Err("this leaf has no fit".into()) };
        let scale = [0, 1].map(|s| save::Change {
            scaling: self.scaling(leaf, s, edit),
            rho_s: f64::from(edit.sides[Side::ALL[s]].rho_s_scale),
            m: f64::from(edit.sides[Side::ALL[s]].m_scale),
        });
        save::edited(fitted, &scale, &self.out.join("fits")).map(|p| p.display().to_string()).map_err(|e| e.to_string())
    }

    fn reference(
        &mut self,
        scene: &viewer::Scene,
        camera: &viewer::Camera,
        width: u32,
        height: u32,
    ) -> std::result::Result<ReferencePicture, String> {
        let draw = || -> Result<transport::ReferencePicture> {
            let world = self.world(scene, camera.eye.as_dvec3())?;
            let camera = transport::Camera {
                eye: camera.eye.as_dvec3(),
                target: camera.target.as_dvec3(),
                up: camera.up.as_dvec3(),
                fov_y_deg: f64::from(camera.fov_y_deg),
            };
            let options = transport::Options {
                samples_per_pixel: self.scene.manifest.check.samples.min(16),
                sun_samples: if scene.shadow_samples > 0 { 4 } else { 1 },
                seed: self.scene.manifest.check.seed,
                ..transport::Options::default()
            };
            transport::render(&world, &camera, width as usize, height as usize, &options)
        };
        let picture = draw().map_err(|e| e.to_string())?;
        let shown = ReferencePicture { width, height, ldr: picture.ldr.clone() };
        self.judged = Some(picture);
        Ok(shown)
    }

    fn judge(&mut self, picture: &gpu::Picture, _: &ReferencePicture) -> Verdict {
        let Some(reference) = &self.judged else {
            return Verdict { note: "no reference yet".into(), ..Verdict::default() };
        };
        let seen = match compare::compare(reference, &picture.ldr) {
            Ok(seen) => seen,
            Err(e) => return Verdict { note: e.to_string(), ..Verdict::default() },
        };
        let view = self.scene.manifest.views.iter().find(|v| v.kind == ViewKind::Perspective);
        let limit = |f: fn(&View) -> Option<f64>| view.and_then(f).unwrap_or(0.0);
        let mut measures =
            vec![Measure { name: "FLIP, 99 %".into(), value: seen.flip_p99, threshold: limit(|v| v.flip_p99) }];
        let mut note = String::new();
        match seen.max_error {
            Some(value) => measures.push(Measure {
                name: "largest error inside leaves".into(),
                value,
                threshold: limit(|v| v.max_error),
            }),
            None => note = "no pixel lies wholly inside a leaf: the largest error was not measured".into(),
        }
        let passed = note.is_empty() && measures.iter().all(|m| m.value <= m.threshold);
        Verdict { passed, measures, note }
    }

    fn probe(&self, leaf: usize, side: Side, texel: [u32; 2]) -> Vec<(String, String)> {
        let Some(maps) = self.maps.get(leaf).and_then(|sides| sides[side as usize].as_ref()) else {
            return vec![("fit".into(), "this side was not measured".into())];
        };
        let k = texel[1] as usize * maps.width + texel[0] as usize;
        if texel[0] as usize >= maps.width || texel[1] as usize >= maps.height {
            return Vec::new();
        }
        let one = |name: &str| maps.get(name).map(|p| p[k]);
        let mut rows = Vec::new();
        // Short numbers: the panel is narrow.
        let number = |v: f32| if v.is_finite() { format!("{v:.3}") } else { "undetermined".into() };
        for (label, name) in [
            ("ρd", "rho_d"),
            ("ρt", "rho_t"),
            ("ρs", "rho_s"),
            ("σa /mm", "sigma_a"),
            ("σs /mm", "sigma_s"),
            ("γ", "gamma"),
        ] {
            let all: Vec<String> =
                ["R", "G", "B"].iter().filter_map(|c| one(&format!("{name}.{c}"))).map(number).collect();
            if !all.is_empty() {
                rows.push((label.to_string(), all.join(" ")));
            }
        }
        for (label, name, unit) in
            [("m", "m.Y", ""), ("thickness", "thickness.Y", " mm"), ("reduced χ²", "reduced_chi2.Y", "")]
        {
            if let Some(v) = one(name) {
                rows.push((label.to_string(), format!("{}{unit}", number(v))));
            }
        }
        if let Some(code) = one("mask.Y") {
            let defects = self.leaf(leaf).placed.fitted.as_ref().map(|f| &f.record.defects);
            let name = defects.and_then(|d| d.get(&format!("{code:.0}"))).cloned();
            let word = if code > 0.0 {
                "good".into()
            } else {
                name.unwrap_or_else(|| if code == 0.0 { "outside".into() } else { format!("defect {code}") })
            };
            rows.push(("texel".into(), word));
        }
        rows
    }
}
