//! A leaf or a scene as every exporter of materials takes it: sheets with a colour for each texel, their places, the
//! light and one camera. Lengths are in mm, z is up.

use super::blade::{ExportMesh, THICKNESS_MM, thickness_mm};
use super::side::ExportSideMaps;
use crate::foreign::texel::{ExportTexel, ExportTexelSide};
use crate::{Error, Result};
use glam::{DMat4, DVec3};
use mesophyll_files::mesh::{self, LeafMesh};
use mesophyll_files::quantity::Quantity;
use mesophyll_fits::leaf_folder::{BLADE, LeafFit, LeafFitFile, filling};
use mesophyll_optics::gloss::Lobe;
use mesophyll_optics::side::{Side, Sides, mirror};
use mesophyll_sky::panorama;
use mesophyll_transport::world::{NormalFrame, ReferenceInterior, ReferenceLeaf, ReferenceSide};
use mesophyll_transport::{ReferenceCamera, ReferencePlacement, ReferenceSun, ReferenceWorld};
use std::path::Path;

/// Everything that is exported.
#[derive(Debug, Clone)]
pub struct ExportScene {
    /// Its name, for readers.
    pub name: String,
    /// The sheets, each once.
    pub sheets: Vec<ExportSheet>,
    /// Places of the sheets: an index and a transform to the world (mm).
    pub places: Vec<(usize, DMat4)>,
    /// Plants that stand in many places: the places of their sheets, in the frame of each plant.
    pub groups: Vec<Vec<(usize, DMat4)>>,
    /// Where these stand: an index and a transform to the world (mm).
    pub stands: Vec<(usize, DMat4)>,
    /// The sun.
    pub sun: Option<ReferenceSun>,
    /// The light from all around.
    pub sky: ExportSky,
    /// The camera.
    pub camera: ReferenceCamera,
    /// Pixels across and down.
    pub size: [usize; 2],
    /// Camera paths for each pixel.
    pub samples: u32,
    /// What radiance is multiplied by before it is shown.
    pub exposure: f64,
    /// What is in the scene and in no export, a sentence each.
    pub left_out: Vec<String>,
}

/// Light from all around.
#[derive(Debug, Clone)]
pub enum ExportSky {
    /// There is none.
    None,
    /// The same radiance from everywhere.
    Even([f64; 3]),
    /// Radiance by zenith and azimuth.
    Map(SkyMap),
}

/// Radiance from all around, as a panorama ([`panorama`]).
#[derive(Debug, Clone)]
pub struct SkyMap {
    /// Columns and rows.
    pub size: [usize; 2],
    /// Row by row.
    pub texels: Vec<[f32; 3]>,
}

/// A leaf, or another surface, with its shape.
#[derive(Debug, Clone)]
pub struct ExportSheet {
    /// Its name: letters, digits and `_`.
    pub name: String,
    /// Its shape (mm).
    pub mesh: ExportMesh,
    /// How far the back of a leaf stands behind this shape (mm) in formats that have a surface for each side.
    pub thickness_mm: f64,
    /// Columns and rows of its texels.
    pub size: [usize; 2],
    /// The texels in the front's columns.
    pub texels: Vec<ExportTexel>,
    /// Mapped normals in the front's columns: x along +u, y up in the picture, z out of the side.
    pub normals: Sides<Option<Vec<[f32; 3]>>>,
    /// Whether a texel is on the leaf; `None` where all are.
    pub mask: Option<Vec<bool>>,
    /// Texels at which losses are measured.
    pub good: Vec<usize>,
}

/// Number of texels of a leaf at which losses are measured.
const MEASURED: usize = 48;
/// Columns and rows of a sky's picture.
const SKY: [usize; 2] = [1024, 512];

/// Letters, digits and `_` of a name, with which every format can call a thing.
pub fn plain_name(name: &str) -> String {
    let plain: String = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    if plain.starts_with(|c: char| c.is_ascii_alphabetic()) { plain } else { format!("n{plain}") }
}

/// What an export leaves out of a leaf whose look is stated: a measurement, which there is none of.
pub fn unmeasured(stated: &str) -> String {
    format!("a measurement of {stated}")
}

impl ExportSheet {
    /// Puts a sheet together; `good` says which texels count in the loss.
    fn new(
        name: &str,
        mesh: ExportMesh,
        size: [usize; 2],
        texels: Vec<ExportTexel>,
        normals: Sides<Option<Vec<[f32; 3]>>>,
        good: impl Fn(usize) -> bool,
    ) -> ExportSheet {
        let all: Vec<usize> = (0..texels.len()).filter(|k| good(*k)).collect();
        let good = (0..all.len().min(MEASURED)).map(|k| all[k * all.len() / all.len().min(MEASURED)]).collect();
        let (name, thickness_mm) = (plain_name(name), THICKNESS_MM);
        ExportSheet { name, mesh, thickness_mm, size, texels, normals, mask: None, good }
    }

    /// The lobe of its gloss.
    pub fn lobe(&self) -> Lobe {
        self.texels.first().map_or(Lobe::Beckmann, |t| t.lobe)
    }

    /// A leaf of a world.
    fn of(name: &str, leaf: &ReferenceLeaf) -> ExportSheet {
        let (width, height) = (leaf.width, leaf.height);
        let front = parts(&leaf.front, width * height);
        let back = mirror(&parts(&leaf.back, width * height), width);
        let texel = |(front, back)| ExportTexel { sides: Sides { front, back }, lobe: leaf.lobe };
        let texels = front.into_iter().zip(back).map(texel).collect();
        let normals = Sides::of(|side| {
            let own = if side == Side::Front { &leaf.front } else { &leaf.back };
            let map = own.normal.as_ref().filter(|n| n.frame == NormalFrame::Tangent)?;
            Some(in_front_columns(&map.values, side, width))
        });
        let (mesh, thickness_mm) = (ExportMesh::of(&leaf.mesh), thickness_mm(&leaf.front.interior));
        let mask: Option<Vec<bool>> = leaf.mask.as_ref().map(|m| m.iter().map(|on| *on != 0).collect());
        let on = |k: usize| mask.as_ref().is_none_or(|m| m[k]);
        let sheet = ExportSheet::new(name, mesh, [width, height], texels, normals, on);
        ExportSheet { mask: mask.clone(), thickness_mm, ..sheet }
    }

    /// The leaf of a fit folder under its name, and which of its texels, in the front's columns, are on the leaf.
    ///
    /// # Errors
    /// As [`ExportSheet::of_fit`], and for a fit of another kind.
    pub fn of_folder(folder: &Path) -> Result<(ExportSheet, Vec<bool>)> {
        let leaf = LeafFit::open(folder)?;
        let sides = ExportSideMaps::all(&leaf.record, folder)?;
        let on = match sides.first() {
            Some(first) if first.side == Side::Back => mirror(&first.mask, first.maps.width),
            first => first.map_or_else(Vec::new, |first| first.mask.clone()),
        };
        // 0 is outside; what is negative is a part of the leaf with a defect.
        Ok((ExportSheet::of_leaf(&leaf, folder, &sides)?, on.iter().map(|m| *m != 0.0).collect()))
    }

    /// An opened fit under its name.
    fn of_leaf(leaf: &LeafFit, folder: &Path, sides: &[ExportSideMaps]) -> Result<ExportSheet> {
        let blade = mesh::read(&folder.join(BLADE), None)?;
        let lobe = leaf.record.scan.as_ref().map_or(Lobe::Beckmann, |s| s.lobe());
        let thickness_mm = leaf.thickness(leaf.lead()).unwrap_or(THICKNESS_MM);
        let sheet = ExportSheet::of_fit(folder, sides, &blade, lobe)?;
        Ok(ExportSheet { name: plain_name(&leaf.name), thickness_mm, ..sheet })
    }

    /// The leaf of a fit.
    ///
    /// # Errors
    /// [`Error::Input`] for a map or a blade that is missing or damaged.
    pub fn of_fit(folder: &Path, sides: &[ExportSideMaps], blade: &LeafMesh, lobe: Lobe) -> Result<ExportSheet> {
        let Some(first) = sides.first() else { return Err(Error::input(folder, "no side was fitted")) };
        let (width, height) = (first.maps.width, first.maps.height);
        let mut both = Sides::of(|_| vec![ExportTexelSide::default(); width * height]);
        let mut normals = Sides::of(|_| None);
        let mut good = vec![true; width * height];
        for side in sides {
            side.maps.require_size(&LeafFitFile::Maps.path(folder, side.side), width, height)?;
            let mut parts = parts_of_fit(folder, side)?;
            let mut mask = side.mask.clone();
            if side.side == Side::Back {
                (parts, mask) = (mirror(&parts, width), mirror(&mask, width));
            }
            good.iter_mut().zip(&mask).for_each(|(g, m)| *g = *g && *m > 0.5);
            both[side.side] = parts;
            normals[side.side] = side.normals(blade, folder)?.map(|n| in_front_columns(&n, side.side, width));
        }
        let texel = |(front, back): (&ExportTexelSide, &ExportTexelSide)| ExportTexel {
            sides: Sides { front: *front, back: *back },
            lobe,
        };
        let texels = both.front.iter().zip(&both.back).map(texel).collect();
        Ok(ExportSheet::new("leaf", ExportMesh::of(blade), [width, height], texels, normals, |k| good[k]))
    }
}

/// Normals of a side's own camera in the front's columns. The back's camera sees x in the other direction.
fn in_front_columns(values: &[[f32; 3]], side: Side, width: usize) -> Vec<[f32; 3]> {
    match side {
        Side::Front => values.to_vec(),
        Side::Back => mirror(values, width).into_iter().map(|[x, y, z]| [-x, y, z]).collect(),
    }
}

/// The texels of a side, in its own columns.
fn parts(side: &ReferenceSide, texels: usize) -> Vec<ExportTexelSide> {
    let wide = |v: [f32; 3]| v.map(|x| f64::from(x).max(0.0));
    let at = |planes: &[Vec<f32>; 3], k: usize| wide([planes[0][k], planes[1][k], planes[2][k]]);
    let part = |k: usize| {
        let (rho_d, rho_t) = match &side.interior {
            ReferenceInterior::Maps { rho_d, rho_t } => (at(rho_d, k), at(rho_t, k)),
            ReferenceInterior::Scalars { gamma, thickness, curve } => {
                let ((d, t), g) = (curve(f64::from(thickness[k])), at(gamma, k));
                ([0, 1, 2].map(|c| (g[c] * d[c]).max(0.0)), t.map(|t| t.max(0.0)))
            }
        };
        let gloss = side.gloss.as_ref();
        let rho_s = gloss.map_or([0.0; 3], |g| at(&g.rho_s, k));
        ExportTexelSide { rho_d, rho_t, rho_s, m: gloss.map_or(0.0, |g| f64::from(g.m[k])) }
    };
    (0..texels).map(part).collect()
}

/// The texels of a fitted side, in its own columns. Texels that the fit left undetermined take their neighbours'
/// values.
fn parts_of_fit(folder: &Path, side: &ExportSideMaps) -> Result<Vec<ExportTexelSide>> {
    let path = LeafFitFile::Maps.path(folder, side.side);
    let gloss = side.rgb(Quantity::RhoS, folder).ok().zip(side.one(Quantity::M, folder).ok());
    let mut wanted = vec![Quantity::RhoD, Quantity::RhoT];
    if gloss.is_some() {
        wanted.extend([Quantity::RhoS, Quantity::M]);
    }
    let mut planes = side.maps.require_planes(&path, &wanted)?;
    let (width, height) = (side.maps.width, side.maps.height);
    let good: Vec<bool> = (0..width * height).map(|k| planes.iter().all(|p| p[k].is_finite())).collect();
    filling::require(&path, &mut planes, &good, width, height)?;
    let at =
        |first: usize, k: usize| [0, 1, 2].map(|c| planes.get(first + c).map_or(0.0, |p| f64::from(p[k]).max(0.0)));
    let m = |k: usize| planes.get(9).map_or(0.0, |p| f64::from(p[k]));
    Ok((0..width * height)
        .map(|k| ExportTexelSide { rho_d: at(0, k), rho_t: at(3, k), rho_s: at(6, k), m: m(k) })
        .collect())
}

impl ExportScene {
    /// The number of [`ExportScene::each_place`].
    pub fn place_count(&self) -> usize {
        let of_stand = |(group, _): &(usize, DMat4)| self.groups[*group].len();
        self.stands.iter().map(of_stand).fold(self.places.len(), usize::saturating_add)
    }

    /// Every place of every sheet, those of plants in many places too.
    pub fn each_place(&self) -> impl Iterator<Item = (usize, DMat4)> {
        let of_stand = |(group, stand): &(usize, DMat4)| {
            let stand = *stand;
            self.groups[*group].iter().map(move |(sheet, place)| (*sheet, stand * *place))
        };
        self.places.iter().copied().chain(self.stands.iter().flat_map(of_stand))
    }

    /// The places of each group that stands somewhere, with the group.
    pub fn standing(&self) -> impl Iterator<Item = (&[(usize, DMat4)], Vec<DMat4>)> {
        let mut places = vec![Vec::new(); self.groups.len()];
        self.stands.iter().for_each(|(group, stand)| places[*group].push(*stand));
        let each = self.groups.iter().map(Vec::as_slice).zip(places);
        each.filter(|(group, places)| !group.is_empty() && !places.is_empty())
    }

    /// The exposure in stops: powers of two that multiply radiance.
    pub fn stops(&self) -> f64 {
        self.exposure.log2()
    }

    /// What is said of the exposure where a format has no place for it; nothing where it is 1.
    pub fn unsaid_exposure(&self) -> Option<String> {
        (self.exposure != 1.0).then(|| {
            format!(
                "the exposure: the scene is shown {} times as bright as its light ({:+.2} stops); set it in the reader",
                self.exposure,
                self.stops()
            )
        })
    }

    /// A fitted leaf on its own: seen from above at a slant, under a sun and an even sky.
    ///
    /// # Errors
    /// As [`ExportSheet::of_fit`].
    pub fn of_fit(folder: &Path, sides: &[ExportSideMaps]) -> Result<ExportScene> {
        let leaf = LeafFit::open(folder)?;
        let sheet = ExportSheet::of_leaf(&leaf, folder, sides)?;
        let reach = sheet.mesh.positions.iter().flatten().fold(1.0f32, |m, v| m.max(v.abs()));
        let far = 3.2 * f64::from(reach);
        let stated = leaf.record.stated_in_one();
        let direction = DVec3::new(-0.2, 0.6, 0.77).normalize();
        Ok(ExportScene {
            name: leaf.name,
            sheets: vec![sheet],
            places: vec![(0, DMat4::IDENTITY)],
            groups: Vec::new(),
            stands: Vec::new(),
            sun: Some(ReferenceSun { direction, irradiance: [3.0, 2.95, 2.8], radius: 0.2666f64.to_radians() }),
            sky: ExportSky::Even([0.3; 3]),
            camera: ReferenceCamera {
                eye: DVec3::new(0.0, -0.6 * far, 0.8 * far),
                target: DVec3::ZERO,
                up: DVec3::Z,
                fov_y_deg: 36.0,
            },
            size: [800, 600],
            samples: 64,
            exposure: 1.0,
            left_out: stated.iter().map(|said| unmeasured(said)).collect(),
        })
    }

    /// The content of a world. `names` are those of its first leaves.
    pub fn of_world(
        world: &ReferenceWorld,
        names: &[String],
        camera: ReferenceCamera,
        size: [usize; 2],
        name: &str,
    ) -> ExportScene {
        let mut left_out = Vec::new();
        let mut say = |so: bool, what: &str| left_out.extend(so.then(|| what.to_string()));
        say(world.leaves.iter().any(|l| l.mesh.discs), "round leaves (discs) become triangles around their circles");
        say(
            world.foliar.iter().any(Option::is_some),
            "leaves by layers of tissue are drawn as the matte and glossy leaves that stand for them in real time",
        );
        say(world.periodic.is_some(), "the scene repeats without end; one period is exported");
        let sky = match (&world.dome, &world.environment, world.sky) {
            (None, None, None) => ExportSky::None,
            (None, None, Some(radiance)) => ExportSky::Even(radiance),
            _ => ExportSky::Map(SkyMap::of(world)),
        };
        let even = matches!(&sky, ExportSky::Even(radiance) if *radiance != world.background);
        let dark = matches!(sky, ExportSky::None) && world.background != [0.0; 3];
        say(
            even || dark,
            "where nothing stands, the camera sees the sky's light and not the scene's background colour",
        );
        say(
            world.dome.as_ref().and_then(|d| Some(d.seen_below? != (d.radiance)(-DVec3::Z))).unwrap_or_default(),
            "below the horizon the camera sees the ground's light and not the scene's background colour",
        );
        let mut used = vec![false; world.leaves.len()];
        world.numbered().for_each(|i| used[i.leaf] = true);
        let mut index = vec![0; world.leaves.len()];
        let mut sheets: Vec<ExportSheet> = Vec::new();
        for (k, leaf) in world.leaves.iter().enumerate().filter(|(k, _)| used[*k]) {
            index[k] = sheets.len();
            let own = names.get(k).cloned().unwrap_or_else(|| format!("part_{k}"));
            let taken = sheets.iter().any(|s: &ExportSheet| s.name == plain_name(&own));
            sheets.push(ExportSheet::of(&if taken { format!("{own}_{k}") } else { own }, leaf));
        }
        let at = |i: &ReferencePlacement| (index[i.leaf], i.transform);
        ExportScene {
            name: name.to_string(),
            sheets,
            places: world.instances.iter().map(at).collect(),
            groups: world.groups.iter().map(|group| group.iter().map(at).collect()).collect(),
            stands: world.places.iter().map(|p| (p.group, p.transform)).collect(),
            sun: world.sun,
            sky,
            camera,
            size,
            samples: 64,
            exposure: world.exposure,
            left_out,
        }
    }
}

impl SkyMap {
    /// Texel `k` of the same picture turned to the left, so that column `first` becomes its first one.
    pub fn from_column(&self, first: usize, k: usize) -> [f32; 3] {
        let [columns, _] = self.size;
        self.texels[k / columns * columns + (first + k % columns) % columns]
    }

    /// Radiance from a unit direction, that of the nearest texel.
    pub fn at(&self, d: DVec3) -> [f32; 3] {
        let [columns, rows] = self.size;
        let [u, v] = panorama::place(d.to_array());
        let [column, row] = [(u * columns as f64) as usize, (v * rows as f64) as usize];
        self.texels[row.min(rows - 1) * columns + column.min(columns - 1)]
    }

    /// The sky of a world in equal steps of angle.
    fn of(world: &ReferenceWorld) -> SkyMap {
        let [columns, rows] = SKY;
        let seen = |d: [f64; 3]| world.sky_radiance(DVec3::from(d)).map(|v| v.max(0.0) as f32);
        SkyMap { size: SKY, texels: panorama::centres(columns, rows).map(seen).collect() }
    }
}
