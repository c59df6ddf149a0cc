//! Lawns: the blades of a meadow for the path tracer, and the slices that represent them in real time.

use super::lawn_lean::{LawnGusts, LawnLean};
use crate::manifest::{SceneManifest, StatedLawn as Config};
use crate::placed::ledger::Ledger;
use crate::placed::{Error, Result};
use glam::{DMat4, DVec2, DVec3};
use mesophyll_fits::grass::blades::LawnMeadow;
use mesophyll_fits::grass::hill::Hill;
use mesophyll_fits::grass::irregularity::{SHIFTS, shifted};
use mesophyll_fits::grass::march::LawnSlices;
use mesophyll_fits::grass::optics::{self, LawnMaterials};
use mesophyll_fits::grass::{Options, baked, counted, fits_memory, folder, plant, weights};
use mesophyll_plants::form::{Leaf, Plant};
use std::path::PathBuf;
use std::sync::{Arc, OnceLock};

/// Settings for slices that are made at the start, which take seconds: rays along each side of a texel, and points of
/// entry along each side of the rectangle for the weights.
const RAYS: usize = 3;
const ENTRIES: usize = 24;
/// Texels of a slice where the scene file does not state them.
const TEXELS: [usize; 2] = [128, 32];
/// The largest distance of a lawn from the origin along x or y (mm). Single precision has steps of 1/16 mm there.
const FARTHEST: f64 = 1e6;
/// The largest relative difference between a fit's figures and those of its meadow. A glTF file has single precision.
const SAME: f64 = 1e-3;

/// A lawn of the scene.
#[derive(Debug)]
pub struct PlacedLawn {
    /// Index into the manifest's lawns.
    pub index: usize,
    /// Name of the lawn.
    pub name: String,
    /// The blades of one rectangle.
    pub plant: Plant,
    /// Their reflectance and transmittance.
    pub leaves: LawnMaterials,
    /// Size of the rectangle (mm).
    pub period: [f64; 2],
    /// How many rectangles are laid along x and along y.
    pub tiles: [usize; 2],
    /// The middle of the first rectangle (least x, least y), on the ground.
    pub origin: DVec3,
    /// Height of the highest tip over the ground (mm).
    pub height: f64,
    /// The seed by which the meadow is moved in each rectangle of an irregular lawn.
    pub irregular: Option<u32>,
    /// The hill that the lawn is on, in the world.
    pub hill: Option<Hill>,
    /// How the wind leans the lawn, if it does.
    pub leaning: Option<LawnLean>,
    /// Path of the meadow's file.
    path: PathBuf,
    slices: OnceLock<Arc<LawnSlices>>,
}

/// Every lawn of the scene.
///
/// # Errors
/// [`Error::Input`] for a meadow or a table that cannot be read, a meadow that does not repeat, a material that the
/// table lacks, a fit that does not exist, slices with more texels than a fit may have, and a lawn that reaches too
/// far.
pub fn lawns(manifest: &SceneManifest, ledger: &Ledger) -> Result<Vec<PlacedLawn>> {
    let all = manifest.grass.iter().enumerate().map(|(index, config)| lawn(manifest, index, config, ledger));
    let mut lawns = all.collect::<Result<Vec<PlacedLawn>>>()?;
    lean(manifest, &mut lawns, ledger)?;
    Ok(lawns)
}

/// Leans the lawns on which the wind has an effect.
fn lean(manifest: &SceneManifest, lawns: &mut [PlacedLawn], ledger: &Ledger) -> Result<()> {
    let leans = |lawn: &PlacedLawn| manifest.grass[lawn.index].lean_per_m_s;
    let tallest = lawns.iter().filter(|lawn| leans(lawn) > 0.0).map(|lawn| lawn.height).fold(0.0, f64::max);
    let gusts = if tallest > 0.0 { LawnGusts::new(manifest, tallest, ledger)? } else { None };
    let Some(gusts) = gusts else { return Ok(()) };
    for lawn in lawns {
        let (config, lean_per_m_s) = (&manifest.grass[lawn.index], leans(lawn));
        let farthest = lean_per_m_s * gusts.strongest();
        if farthest > 1.0 {
            let told = format!(
                "found {lean_per_m_s}, with which tips go by {farthest:.2} of their height in strong gusts; expected \
                 at most 1"
            );
            return Err(field(manifest, config, "lean_per_m_s", told));
        }
        lawn.leaning = (lean_per_m_s > 0.0).then(|| LawnLean { gusts: Arc::clone(&gusts), lean_per_m_s });
    }
    Ok(())
}

fn lawn(manifest: &SceneManifest, index: usize, config: &Config, ledger: &Ledger) -> Result<PlacedLawn> {
    let path = manifest.resolve(&config.meadow);
    let bytes = std::fs::metadata(&path).map_or(0, |m| m.len());
    let plant = ledger.note("read", format!("{} blades", config.name), bytes, || plant(&path))?;
    let leaves = optics::read(config.leaves.as_ref().map(|l| manifest.resolve(l)).as_deref())?;
    let Some(period) = plant.period else {
        let told = format!("{} does not repeat; expected what `mesophyll grow` makes of a [[sward]]", path.display());
        return Err(field(manifest, config, "meadow", told));
    };
    for blade in &plant.blades {
        if !leaves.contains_key(&blade.material) {
            let known: Vec<&str> = leaves.keys().map(String::as_str).collect();
            let told = format!("has no \"{}\", a material of the meadow, only {}", blade.material, known.join(", "));
            return Err(field(manifest, config, "leaves", told));
        }
    }
    if let Some(fit) = config.fit.as_ref().map(|f| manifest.resolve(f))
        && !fit.join("fit.toml").is_file()
    {
        let (meadow, fit) = (path.display(), fit.display());
        let told = format!("there is no fit at {fit}; `mesophyll fit grass {meadow} -o {fit}` makes it");
        return Err(field(manifest, config, "fit", told));
    }
    if config.fit.is_none() {
        let options = options(config);
        let ([w, h], n) = (options.texels, options.slices);
        counted(&options, period).map_err(|told| {
            field(manifest, config, "texels", format!("found [{w}, {h}], which with slices = {n} makes {told}"))
        })?;
    }
    let reach = |k: usize| config.position_mm[k].abs() + 0.5 * config.tiles[k] as f64 * period[k];
    let farthest = reach(0).max(reach(1));
    if farthest > FARTHEST {
        let told = format!(
            "found {:?} rectangles of {} x {} mm, with which the lawn reaches {farthest:.0} mm from the origin; \
             expected at most {FARTHEST:.0} mm",
            config.tiles, period[0], period[1]
        );
        return Err(field(manifest, config, "tiles", told));
    }
    let first = |k: usize| config.position_mm[k] - 0.5 * (config.tiles[k] - 1) as f64 * period[k];
    let ground = manifest.ground.as_ref().map_or(0.0, |g| g.height_mm);
    let tips = plant.leaves.iter().flat_map(|leaf| {
        let points = plant.blades.get(leaf.blade).map_or(&[][..], |b| &b.mesh.positions);
        points.iter().map(|p| leaf.transform.transform_point3(*p).z)
    });
    let height = tips.fold(0.0, f64::max);
    Ok(PlacedLawn {
        height,
        irregular: config.irregular_seed,
        hill: hill(manifest),
        leaning: None,
        index,
        name: config.name.clone(),
        plant,
        leaves,
        period,
        tiles: config.tiles,
        origin: DVec3::new(first(0), first(1), ground),
        path,
        slices: OnceLock::new(),
    })
}

/// The hill of the scene's ground.
pub fn hill(manifest: &SceneManifest) -> Option<Hill> {
    let said = manifest.ground.as_ref()?.hill.as_ref()?;
    Some(Hill { middle: said.position_mm.into(), height: said.height_mm, radius: said.radius_mm })
}

/// The options for making slices where there is no fit.
fn options(config: &Config) -> Options {
    Options {
        slices: config.slices.unwrap_or(Options::default().slices),
        texels: config.texels.unwrap_or(TEXELS),
        rays: RAYS,
        entries: ENTRIES,
        ..Options::default()
    }
}

fn field(manifest: &SceneManifest, config: &Config, key: &str, told: String) -> Error {
    Error::field(&manifest.path, &format!("grass \"{}\": {key}", config.name), told)
}

impl PlacedLawn {
    /// The transforms of all rectangles to the world.
    pub fn places(&self) -> impl Iterator<Item = DMat4> + '_ {
        let [nx, ny] = self.tiles;
        (0..nx * ny).map(move |k| {
            let [x, y] = [(k % nx) as f64 * self.period[0], (k / nx) as f64 * self.period[1]];
            DMat4::from_translation(self.origin + DVec3::new(x, y, 0.0))
        })
    }

    /// The parts that rectangles are made of: in an irregular lawn [`SHIFTS`] along each side, and otherwise one, which
    /// has no number.
    pub fn parts(&self) -> Vec<Option<[usize; 2]>> {
        match self.irregular {
            None => vec![None],
            Some(_) => (0..SHIFTS * SHIFTS).map(|k| Some([k % SHIFTS, k / SHIFTS])).collect(),
        }
    }

    /// Where a blade stands in the meadow, if it belongs to this part. A blade whose middle hangs over the edge belongs
    /// to the part that it hangs into from the other side.
    pub fn in_part(&self, leaf: &Leaf, part: Option<[usize; 2]>) -> Option<DMat4> {
        let Some(part) = part else { return Some(leaf.transform) };
        let (at, back) = self.part_of(leaf);
        (at == part).then(|| DMat4::from_translation(-back) * leaf.transform)
    }

    /// The part of a blade, and how far its rectangle is from that of the origin.
    fn part_of(&self, leaf: &Leaf) -> ([usize; 2], DVec3) {
        let period = DVec2::from(self.period);
        let share = leaf.transform.w_axis.truncate().truncate() / period + 0.5;
        let part = ((share - share.floor()) * SHIFTS as f64).to_array().map(|s| (s as usize).min(SHIFTS - 1));
        (part, (share.floor() * period).extend(0.0))
    }

    /// How far a part is moved within the rectangle number `k` of [`PlacedLawn::places`].
    pub fn moved(&self, part: Option<[usize; 2]>, k: usize) -> DVec3 {
        let (Some(seed), Some(part)) = (self.irregular, part) else { return DVec3::ZERO };
        let by = shifted(seed, [k % self.tiles[0], k / self.tiles[0]].map(|n| n as i64));
        let axis = |n: usize| {
            let to = (part[n] + SHIFTS - by[n]) % SHIFTS;
            (to as f64 - part[n] as f64) / SHIFTS as f64 * self.period[n]
        };
        DVec3::new(axis(0), axis(1), 0.0)
    }

    /// Whether every rectangle has blades of its own, because the wind leans them or a hill lifts them.
    pub fn is_own(&self) -> bool {
        self.leaning.is_some() || self.hill.is_some()
    }

    /// Where a blade stands in the rectangle number `k` of [`PlacedLawn::places`], relative to the rectangle's middle.
    /// A hill lifts it, upright as it is, by its height at the blade's first point, which is at its foot.
    pub fn place_in(&self, leaf: &Leaf, k: usize) -> DMat4 {
        let mut place = leaf.transform;
        if self.irregular.is_some() {
            let (part, back) = self.part_of(leaf);
            place = DMat4::from_translation(self.moved(Some(part), k) - back) * place;
        }
        let foot = self.plant.blades.get(leaf.blade).and_then(|blade| blade.mesh.positions.first());
        if let Some((hill, foot)) = self.hill.as_ref().zip(foot) {
            let [x, y] = [k % self.tiles[0], k / self.tiles[0]].map(|n| n as f64);
            let middle = self.origin.truncate() + DVec2::new(x, y) * DVec2::from(self.period);
            let rise = hill.rise(middle + place.transform_point3(*foot).truncate());
            place = DMat4::from_translation(DVec3::Z * rise) * place;
        }
        place
    }

    /// The options for making slices where there is no fit.
    pub fn options(&self, manifest: &SceneManifest) -> Options {
        options(&manifest.grass[self.index])
    }

    /// The slices, which are opened or made when they are needed for the first time.
    ///
    /// # Errors
    /// [`Error::Input`] for a damaged fit, or one of another meadow or with another table of leaves, and where there is
    /// not enough memory to make slices.
    pub fn slices(&self, manifest: &SceneManifest, ledger: &Ledger) -> Result<Arc<LawnSlices>> {
        if let Some(known) = self.slices.get() {
            return Ok(Arc::clone(known));
        }
        let config = &manifest.grass[self.index];
        let meadow = LawnMeadow::new(&self.path, &self.plant, &self.leaves)?;
        let slices = match config.fit.as_ref().map(|f| manifest.resolve(f)) {
            Some(fit) => {
                let slices = ledger.note("read", format!("{} slices", self.name), 0, || folder::open(&fit))?;
                let table = config.leaves.as_ref().map(|l| manifest.resolve(l));
                if let Some(told) = folder::differs(&fit, &meadow, table.as_deref(), SAME)? {
                    let meadow = self.path.display();
                    let how = format!("{told}; `mesophyll fit grass {meadow} -o {}` fits it again", fit.display());
                    return Err(field(manifest, config, "fit", how));
                }
                slices
            }
            None => {
                let options = self.options(manifest);
                let texels = |told: String| field(manifest, config, "texels", told);
                let count = counted(&options, self.period).map_err(texels)?;
                fits_memory(count, "making slices").map_err(|e| texels(e.to_string()))?;
                ledger.note("make", format!("{} slices", self.name), 0, || {
                    let mut slices = baked(&meadow, &options);
                    weights::fit(&meadow, &mut slices, options.entries).map(|_| slices)
                })?
            }
        };
        if self.irregular.is_some() && !slices.count.is_multiple_of(SHIFTS) {
            let told = format!("found {} slices, expected a multiple of {SHIFTS} beside irregular_seed", slices.count);
            return Err(field(manifest, config, "fit", told));
        }
        let slices = LawnSlices { irregular: self.irregular, ..slices };
        Ok(Arc::clone(self.slices.get_or_init(|| Arc::new(slices))))
    }
}
