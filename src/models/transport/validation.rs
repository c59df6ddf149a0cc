//! Whether a world is whole: every map, mesh and index fits the others.

use super::world::{NormalFrame, ReferenceInterior, ReferenceLeaf, ReferenceWorld, SunlitMaps};
use crate::{Error, Result};
use glam::DMat4;
use std::path::Path;

/// The largest number of instances in a scene that repeats, including those that reach over from its neighbours.
const MOST_COPIES: f64 = 1e7;

impl ReferenceWorld {
    /// Checks that everything is there and has the right size. The error names the leaf and the field.
    pub fn validate(&self) -> Result<()> {
        let bad = |what: String| Err(Error::input(Path::new("reference scene"), what));
        for (k, leaf) in self.leaves.iter().enumerate() {
            if let Err(what) = leaf.validate() {
                return bad(format!("leaf {k}: {what}"));
            }
        }
        let one_way = |transform: &DMat4| {
            let det = transform.determinant();
            (!transform.is_finite() || !det.is_normal())
                .then(|| format!("the transform cannot be inverted (determinant {det})"))
        };
        for (k, placed) in self.numbered().enumerate() {
            if placed.leaf >= self.leaves.len() {
                return bad(format!("instance {k}: leaf {} wanted, the scene has {}", placed.leaf, self.leaves.len()));
            }
            if let Some(what) = one_way(&placed.transform) {
                return bad(format!("instance {k}: {what}"));
            }
        }
        for (k, place) in self.places.iter().enumerate() {
            if place.group >= self.groups.len() {
                return bad(format!("place {k}: group {} wanted, the scene has {}", place.group, self.groups.len()));
            }
            if let Some(what) = one_way(&place.transform) {
                return bad(format!("place {k}: {what}"));
            }
        }
        for (k, (through, placed)) in self.through.iter().zip(&self.instances).enumerate() {
            let texels = self.leaves[placed.leaf].width * self.leaves[placed.leaf].height;
            let sizes = through.entering.iter().flatten().flat_map(|s| match s {
                SunlitMaps::Factor(map) => vec![map.len()],
                SunlitMaps::Colour(maps) => maps.iter().map(Vec::len).collect(),
            });
            if let Some(found) = sizes.into_iter().find(|n| *n != texels) {
                return bad(format!("instance {k}: light through it has {found} texels, expected {texels}"));
            }
        }
        let skies = [self.sky.is_some(), self.dome.is_some(), self.environment.is_some()];
        if skies.into_iter().filter(|given| *given).count() > 1 {
            return bad("sky: expected one of a constant one, a dome and an environment map".into());
        }
        if let Some(sun) = &self.sun {
            if !(sun.direction.length() > 0.0 && sun.direction.is_finite()) {
                return bad("sun direction: expected a vector that is finite and not zero".into());
            }
            if !(0.0..1.5).contains(&sun.radius) {
                return bad(format!("sun radius: found {} rad, expected 0 to 1.5", sun.radius));
            }
        }
        if let Some(ground) = self.ground.filter(|g| *g >= self.instances.len()) {
            return bad(format!("ground: instance {ground}, the scene has {}", self.instances.len()));
        }
        if let Some(size) = self.periodic {
            let copies = super::repetition::copies(self, size);
            if !(size.iter().all(|s| *s > 0.0 && s.is_finite()) && copies <= MOST_COPIES) {
                return bad(format!(
                    "periodic: a period of {} × {} mm needs {copies:.0} copies of what stands there, expected at most \
                     {MOST_COPIES:.0}",
                    size[0], size[1]
                ));
            }
        }
        if !(self.exposure.is_finite() && self.exposure >= 0.0) {
            return bad(format!("exposure: found {}, expected a number ≥ 0", self.exposure));
        }
        Ok(())
    }
}

impl ReferenceLeaf {
    fn validate(&self) -> std::result::Result<(), String> {
        let texels = self.width * self.height;
        if texels == 0 {
            return Err(format!("maps of {}×{} texels, expected at least 1×1", self.width, self.height));
        }
        let mesh = &self.mesh;
        let vertices = mesh.positions.len();
        if mesh.normals.len() != vertices || mesh.uvs.len() != vertices {
            return Err(format!(
                "mesh: {vertices} positions, {} normals, {} uvs; expected as many of each",
                mesh.normals.len(),
                mesh.uvs.len()
            ));
        }
        if !mesh.indices.len().is_multiple_of(3) || mesh.indices.iter().any(|&i| i as usize >= vertices) {
            return Err(format!("mesh: indices must come in threes and stay below {vertices}"));
        }
        if !(mesh.positions.iter().chain(&mesh.normals).all(|p| p.is_finite())
            && mesh.uvs.iter().all(|p| p.is_finite()))
        {
            return Err("mesh: positions, normals and uvs must be finite".into());
        }
        let mut maps: Vec<(String, usize)> = Vec::new();
        for (name, side) in [("front", &self.front), ("back", &self.back)] {
            let mut channels = |what: &str, c: &[Vec<f32>; 3]| {
                maps.extend(c.iter().zip(["R", "G", "B"]).map(|(m, ch)| (format!("{name} {what}.{ch}"), m.len())));
            };
            match &side.interior {
                ReferenceInterior::Maps { rho_d, rho_t } => {
                    channels("rho_d", rho_d);
                    channels("rho_t", rho_t);
                }
                ReferenceInterior::Scalars { gamma, thickness, .. } => {
                    channels("gamma", gamma);
                    maps.push((format!("{name} thickness"), thickness.len()));
                }
            }
            if let Some(gloss) = &side.gloss {
                maps.extend(gloss.rho_s.iter().map(|m| (format!("{name} rho_s"), m.len())));
                maps.push((format!("{name} m"), gloss.m.len()));
            }
            if let Some(normal) = &side.normal {
                maps.push((format!("{name} normal"), normal.values.len()));
                if normal.frame == NormalFrame::Tangent && mesh.tangents.len() != vertices {
                    return Err(format!(
                        "{name} normals need tangents: found {}, expected {vertices}",
                        mesh.tangents.len()
                    ));
                }
            }
        }
        if let Some(mask) = &self.mask {
            maps.push(("mask".into(), mask.len()));
        }
        match maps.iter().find(|(_, found)| *found != texels) {
            Some((name, found)) => {
                Err(format!("{name}: {found} texels, expected {}×{} = {texels}", self.width, self.height))
            }
            None => Ok(()),
        }
    }
}
