//! The library's part of the window: an edit of h, σa, σs or the gloss becomes a new slab, so that a thicker leaf
//! really becomes darker. There are also a reference picture, a verdict, a saved fit, and the numbers of a texel.

use super::plants::WindowPlants;
use crate::Result;
use crate::draw::reference;
use crate::draw::scene_reference::{ReferenceSampling, SceneReference};
use crate::draw::sunlight::relight_where;
use crate::draw::{handover, leaf_maps, stands};
use crate::loaded::{LoadedLeaf, LoadedScene};
use crate::manifest::{InteriorSource, PerspectiveView};
use crate::placed::daylight::{self, Daylight};
use crate::placed::fits::reader;
use crate::placed::ledger::Ledger;
use crate::placed::placement::LeafPlacement;
use crate::plan::leaf::curve_name;
use crate::world::{WorldLights, WorldSky};
use glam::DVec3;
use mesophyll_files::image::ChannelMaps;
use mesophyll_files::quantity::Quantity;
use mesophyll_fits::leaf_folder::LeafFit;
use mesophyll_fits::leaf_folder::edit::{self, LeafSideEdit};
use mesophyll_fits::transfer::FreeSun;
use mesophyll_optics::side::{Side, Sides};
use mesophyll_transport::{self as transport, comparison};
use mesophyll_viewer as gpu;
use mesophyll_viewer::scene as viewer;
use mesophyll_window::edit::{EditQuantity, EditTarget, Edits};
use mesophyll_window::editor::{ComparisonVerdict, DisplayPicture, Editor, PlantInfo, SkyUpdate, VerdictMeasure};
use std::path::PathBuf;

/// The editor behind a window on one scene.
pub struct SceneEditor {
    scene: LoadedScene,
    ledger: Ledger,
    /// The scene's leaves, by the renderer's index.
    shown: Vec<usize>,
    starts: Vec<Edits>,
    /// The fits before any edit. `scene` holds them with the present edits.
    fits: Vec<Option<LeafFit>>,
    /// Folder of edited fits.
    out: PathBuf,
    judged: Option<transport::ReferencePicture>,
    plants: WindowPlants,
    /// The shares of the sun that vertices see for a sun that is moved, where they are known.
    live: Option<FreeSun>,
}

impl SceneEditor {
    /// `scene` must be one for a window ([`crate::placed::leaf::LeafSearch::free`]), and every leaf must be fitted.
    ///
    /// # Errors
    /// [`crate::Error::Input`] for a map or a plant that cannot be read.
    pub fn new(scene: LoadedScene, out: PathBuf) -> Result<SceneEditor> {
        let ledger = Ledger::new();
        let shown: Vec<usize> = scene.drawn().map(|l| l.placed.index).collect();
        let (mut starts, mut fits) = (Vec::new(), Vec::new());
        for &index in &shown {
            let mut start = Edits::default();
            let fitted = scene.placed.leaves[index].fitted.clone();
            if let Some(fitted) = &fitted {
                let mut sigmas = Sides::of(|_| [[0.0; 3]; 2]);
                for side in fitted.sides() {
                    let maps = reader::maps(fitted, side, &ledger)?;
                    let of = |quantity| match scene.leaf(index).placed.interior(&scene.manifest.leaves[index]) {
                        InteriorSource::Scalars => Ok(fitted.rgb(side, quantity)?),
                        InteriorSource::Maps => Ok::<_, crate::Error>(mean(maps, quantity)),
                    };
                    sigmas[side] = [of(Quantity::SigmaA)?, of(Quantity::SigmaS)?];
                }
                if sigmas.iter().any(|(_, [_, sigma_s])| sigma_s.iter().any(|v| *v > 0.0)) {
                    start = Edits::tissue(starts.len(), fitted.thickness(fitted.lead())?, sigmas);
                }
            }
            starts.push(start);
            fits.push(fitted);
        }
        let known = scene.transfer.as_ref().and_then(|t| Some((t.sun.as_ref()?, t.world.clone())));
        // The direction has the precision of later calls of `shares`: the renderer's suns have single precision.
        let at = daylight::sun_direction(&scene.manifest).map(|at| at.as_vec3().as_dvec3());
        let live = known.zip(at).map(|((sun, world), at)| sun.live(world, at));
        let plants = WindowPlants::new(&scene.manifest, &scene.placed, &ledger)?;
        Ok(SceneEditor { scene, ledger, shown, starts, fits, out, judged: None, plants, live })
    }

    fn leaf(&self, leaf: usize) -> LoadedLeaf<'_> {
        self.scene.leaf(self.shown[leaf])
    }

    /// Reflectance and transmittance of a leaf's side with the present edits.
    fn side(&self, leaf: usize, side: Side) -> Result<viewer::Interior> {
        let of = self.leaf(leaf);
        let Some(fitted) = of.placed.fitted.as_ref().filter(|f| f.has(side) && of.plan.needs(side).interior()) else {
            return Ok(viewer::Interior::Scalars(viewer::SlabCurve::default()));
        };
        if of.placed.interior(of.config) == InteriorSource::Maps {
            let [rho_d, rho_t] = leaf_maps::pigment(of, side, &self.ledger)?;
            return Ok(viewer::Interior::Maps { rho_d, rho_t });
        }
        let h = fitted.thickness(side)?;
        let texels = of.loaded.textures[side].gamma_delta.as_deref().unwrap_or_default();
        let what = curve_name(fitted, side);
        let (sigma_a, sigma_s) = (fitted.rgb(side, Quantity::SigmaA)?, fitted.rgb(side, Quantity::SigmaS)?);
        let made = self.ledger.note("curve", what, 0, || mesophyll_web::bundle::slab(sigma_a, sigma_s, h, texels));
        Ok(viewer::Interior::Scalars(mesophyll_web::bundle::slab_curve(&made)))
    }

    /// What the edits change of a fit: σ and the gloss are multiplied, and thickness is added. A value that nobody has
    /// edited stays the same to the last bit.
    fn edits(&self, leaf: usize, edits: &Edits) -> Sides<LeafSideEdit> {
        let of = |target, quantity| Some((edits.get(target, quantity)?, self.starts[leaf].get(target, quantity)?));
        Sides::of(|side| {
            let target = EditTarget::LeafSide(leaf, side);
            let ratio = |quantity| of(target, quantity).filter(|v| v.1 > 0.0).map_or(1.0, |(now, start)| now / start);
            LeafSideEdit {
                sigma_a: [0, 1, 2].map(|c| ratio(EditQuantity::SigmaA(c))),
                sigma_s: [0, 1, 2].map(|c| ratio(EditQuantity::SigmaS(c))),
                thickness_mm: of(EditTarget::Leaf(leaf), EditQuantity::Thickness).map_or(0.0, |(h, start)| h - start),
                rho_s: edits.factor(target, EditQuantity::RhoS),
                m: edits.factor(target, EditQuantity::M),
                ..LeafSideEdit::default()
            }
        })
    }

    /// The lights that the window shows now.
    fn lights(&self, scene: &viewer::Scene) -> Result<WorldLights<'_>> {
        let manifest = &self.scene.manifest;
        let sun = scene.sun.map(|s| transport::ReferenceSun {
            direction: s.direction.as_dvec3(),
            irradiance: s.irradiance.map(f64::from),
            radius: f64::from(s.radius),
        });
        let sky = match (&scene.dome, scene.sky) {
            (Some(dome), _) if dome.is_model() => {
                let (zenith, azimuth) = angles(dome.sun);
                let daylight = Daylight::at(manifest, zenith, azimuth, f64::from(dome.turbidity))?;
                WorldSky::Physical(Box::new(daylight))
            }
            (Some(_), _) => manifest.pictured().map_or(WorldSky::Dark, WorldSky::Picture),
            (None, Some(radiance)) => WorldSky::Even(radiance.map(f64::from)),
            (None, None) => WorldSky::Dark,
        };
        Ok(WorldLights { sun, sky })
    }

    /// The reference's world with the edits and with the window's lights.
    fn world(&self, scene: &viewer::Scene, eye: DVec3) -> Result<transport::ReferenceWorld> {
        let mut world = reference::world(&self.scene, &self.ledger)?;
        let time = scene.wind.as_ref().map_or_else(|| self.scene.manifest.rest_time(), |w| w.time_s);
        let place = |i: &viewer::Instance| {
            let rest = i.transform.as_dmat4();
            let section = i.carried.filter(|c| c.vertices.is_none()).map(|c| c.first as usize);
            let at_rest = LeafPlacement { leaf: i.material, transform: rest, section, frame: 0 };
            let transform = self.scene.placed.at_time(&at_rest, time).transform;
            transport::ReferencePlacement { leaf: i.material, transform }
        };
        let [_, more] = stands::traced(&self.scene.placed);
        let in_stands = world.instances.split_off(world.instances.len() - more);
        world.instances = scene.instances.iter().filter(|i| i.stand.is_none()).map(place).collect();
        if world.ground.is_some_and(|g| g >= world.instances.len()) {
            world.ground = None;
        }
        reference::grain(&mut world, &self.scene);
        world.instances.extend(in_stands);
        reference::move_wood(&mut world, &self.scene.placed, time);
        stands::move_to(&mut world, &self.scene.placed, time);
        let strength = scene.dome.as_ref().map_or(1.0, |dome| f64::from(dome.strength));
        reference::shine(&mut world, &self.scene.manifest, &self.lights(scene)?, strength);
        (world.background, world.exposure) = (scene.background.map(f64::from), f64::from(scene.exposure));
        let has = |leaf: usize, side: Side| scene.leaf(leaf).is_some_and(|l| l.sides[side].translucency.is_some());
        // The path tracer also follows light through leaves that nobody sees.
        let eyes = if scene.transfer.is_some() { None } else { Some([eye]) };
        relight_where(&mut world, &self.scene, eyes.as_ref().map(|e| e.as_slice()), has)?;
        Ok(world)
    }
}

/// Zenith angle and azimuth (rad) of a direction.
fn angles(towards: glam::Vec3) -> (f64, f64) {
    let d = towards.as_dvec3().normalize();
    (d.truncate().length().atan2(d.z), d.y.atan2(d.x))
}

/// The means of three channels over the good texels.
fn mean(maps: &ChannelMaps, quantity: Quantity) -> [f64; 3] {
    let mask = maps.scalar(Quantity::Mask);
    [0, 1, 2].map(|c| {
        let plane = maps.plane(quantity, c).unwrap_or_default();
        let good = plane.iter().enumerate().filter(|(k, v)| v.is_finite() && mask.is_none_or(|m| m[*k] > 0.0));
        let (sum, n) = good.fold((0.0, 0u32), |(s, n), (_, v)| (s + f64::from(*v), n + 1));
        sum / f64::from(n.max(1))
    })
}

impl Editor for SceneEditor {
    fn start(&self, leaf: usize) -> Edits {
        self.starts[leaf].clone()
    }

    fn recompute(&mut self, leaf: usize, edits: &Edits) -> std::result::Result<Sides<viewer::Interior>, String> {
        let thickness = edits.get(EditTarget::Leaf(leaf), EditQuantity::Thickness);
        if let Some(found) = thickness.filter(|h| !(*h > 0.0 && h.is_finite())) {
            return Err(format!("h: found {found} mm, expected a positive thickness"));
        }
        let index = self.shown[leaf];
        let edited = self.fits[leaf].as_ref().map(|fit| match edits.is_empty() {
            true => fit.clone(),
            false => fit.edited(self.edits(leaf, edits)),
        });
        let before = std::mem::replace(&mut self.scene.placed.leaves[index].fitted, edited);
        Sides::try_of(|side| self.side(leaf, side)).map_err(|e| {
            self.scene.placed.leaves[index].fitted = before;
            e.to_string()
        })
    }

    fn sky(&mut self, sun: glam::Vec3, turbidity: f32) -> std::result::Result<SkyUpdate, String> {
        let (zenith, azimuth) = angles(sun);
        let new = || -> Result<SkyUpdate> {
            let daylight = Daylight::at(&self.scene.manifest, zenith, azimuth, f64::from(turbidity))?;
            let [low, high] = mesophyll_sky::preetham::TRUSTED;
            let (manifest, light) = (&self.scene.manifest, &self.scene.plan.light);
            let fitted = (low..=high)
                .contains(&daylight.turbidity)
                .then(|| daylight::polynomials(manifest, light.sun_moves, &self.ledger))
                .transpose()?;
            let dome = handover::dome(&daylight, light.sky_bands, fitted.flatten())?;
            Ok(SkyUpdate { dome, sun_irradiance: daylight.sun.map(|v| v as f32) })
        };
        new().map_err(|e| e.to_string())
    }

    fn shares(&mut self, sun: glam::Vec3) -> std::result::Result<(Option<Vec<u8>>, bool), String> {
        let Some(live) = &mut self.live else { return Ok((None, false)) };
        let found = live.follow(sun.as_dvec3()).map_err(|e| e.to_string())?;
        Ok((found, live.is_waiting()))
    }

    fn plants(&self) -> Vec<PlantInfo> {
        self.plants.listed()
    }

    fn bend(&mut self, edits: &Edits) -> std::result::Result<viewer::Scene, String> {
        if self.scene.transfer.is_some() {
            return Err("branches cannot be edited here: the light between leaves is that of the plants at rest".into());
        }
        let before = self.plants.applied();
        let LoadedScene { manifest, placed, .. } = &mut self.scene;
        self.plants.apply(edits, manifest, placed, &self.ledger).map_err(|e| e.to_string())?;
        handover::shown(&self.scene, self.scene.manifest.display(), &self.ledger).map_err(|e| {
            // The window still shows the plants as they were.
            let LoadedScene { manifest, placed, .. } = &mut self.scene;
            let restored = self.plants.apply(&before, manifest, placed, &self.ledger);
            restored.err().unwrap_or(e).to_string()
        })
    }

    fn save_plant(&mut self, plant: usize) -> std::result::Result<String, String> {
        let saved = self.plants.save(plant, &self.out.join("plants"));
        saved.map(|path| path.display().to_string()).map_err(|e| e.to_string())
    }

    fn save(&mut self, leaf: usize, edits: &Edits) -> std::result::Result<String, String> {
        if leaf >= self.shown.len() {
            return Err("a branch is no fit of a leaf".into());
        }
        let Some(fitted) = &self.fits[leaf] else { return Err("this leaf has no fit".into()) };
        let edited = fitted.edited(self.edits(leaf, edits));
        edit::save(&edited, &self.out.join("fits")).map(|p| p.display().to_string()).map_err(|e| e.to_string())
    }

    fn reference(
        &mut self,
        scene: &viewer::Scene,
        camera: &viewer::Camera,
        width: u32,
        height: u32,
    ) -> std::result::Result<DisplayPicture, String> {
        let draw = || -> Result<transport::ReferencePicture> {
            let world = self.world(scene, camera.eye.as_dvec3())?;
            let camera = transport::ReferenceCamera {
                eye: camera.eye.as_dvec3(),
                target: camera.target.as_dvec3(),
                up: camera.up.as_dvec3(),
                fov_y_deg: f64::from(camera.fov_y_deg),
            };
            let between = scene.transfer.is_some();
            let sampling = ReferenceSampling {
                size: [width as usize, height as usize],
                // A person waits for the result.
                samples: self.scene.manifest.check.samples.min(if between { 64 } else { 16 }),
                sun_samples: if scene.shadow_samples > 0 { 4 } else { 1 },
                seed: self.scene.manifest.check.seed,
            };
            SceneReference::new(&world, between)?.draw(&camera, "reference", sampling)
        };
        let picture = draw().map_err(|e| e.to_string())?;
        let shown = DisplayPicture { width, height, ldr: picture.ldr.clone() };
        self.judged = Some(picture);
        Ok(shown)
    }

    fn judge(&mut self, picture: &gpu::Picture, _: &DisplayPicture) -> ComparisonVerdict {
        let Some(reference) = &self.judged else {
            return ComparisonVerdict { note: "no reference yet".into(), ..ComparisonVerdict::default() };
        };
        let seen = match comparison::compare(reference, &picture.ldr) {
            Ok(seen) => seen,
            Err(e) => return ComparisonVerdict { note: e.to_string(), ..ComparisonVerdict::default() },
        };
        let view = self.scene.manifest.perspectives().next();
        let limit = |f: fn(&PerspectiveView) -> Option<f64>| view.and_then(f).unwrap_or(0.0);
        let mut measures =
            vec![VerdictMeasure { name: "FLIP, 99 %".into(), value: seen.flip_p99, threshold: limit(|v| v.flip_p99) }];
        let mut note = String::new();
        match seen.max_error {
            Some(value) => measures.push(VerdictMeasure {
                name: "largest error inside leaves".into(),
                value,
                threshold: limit(|v| v.max_error),
            }),
            None => note = "no pixel lies wholly inside a leaf: the largest error was not measured".into(),
        }
        let passed = note.is_empty() && measures.iter().all(|m| m.value <= m.threshold);
        ComparisonVerdict { passed, measures, note }
    }

    fn probe(&self, leaf: usize, side: Side, texel: [u32; 2]) -> Vec<(String, String)> {
        let fitted = self.fits.get(leaf).and_then(Option::as_ref).filter(|f| f.has(side));
        let Some(maps) = fitted.and_then(|f| f.maps(side).ok()) else {
            return vec![("fit".into(), "this side was not measured".into())];
        };
        let k = texel[1] as usize * maps.width + texel[0] as usize;
        if texel[0] as usize >= maps.width || texel[1] as usize >= maps.height {
            return Vec::new();
        }
        // Numbers are short, because the panel is narrow.
        let number = |v: f32| if v.is_finite() { format!("{v:.3}") } else { "undetermined".into() };
        let mut rows = Vec::new();
        for (label, quantity, unit) in [
            ("ρd", Quantity::RhoD, ""),
            ("ρt", Quantity::RhoT, ""),
            ("ρs", Quantity::RhoS, ""),
            ("σa /mm", Quantity::SigmaA, ""),
            ("σs /mm", Quantity::SigmaS, ""),
            ("γ", Quantity::Gamma, ""),
            ("m", Quantity::M, ""),
            ("thickness", Quantity::Thickness, " mm"),
            ("reduced χ²", Quantity::ReducedChi2, ""),
        ] {
            let channels = 0..quantity.letters().len();
            let all: Vec<String> = channels.filter_map(|c| maps.plane(quantity, c)).map(|p| number(p[k])).collect();
            if !all.is_empty() {
                rows.push((label.to_string(), all.join(" ") + unit));
            }
        }
        if let Some(code) = maps.scalar(Quantity::Mask).map(|p| p[k]) {
            let defects = fitted.map(|f| &f.record.defects);
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
