//! What was measured of a scene, and which of its numbers are unknown: the tables that `fit scene` reads.

use crate::manifest::{LeafOrigin, Result, SceneManifest, StatedLeaf};
use mesophyll_base::error::{Error, Fault};
use mesophyll_optics::foliar::pigments::SUBSTANCES;
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

/// A picture that a camera of the scene took.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StatedPhotograph {
    /// The perspective view whose camera took it.
    pub view: String,
    /// Linear radiance in the scene's units: OpenEXR with R, G, B, and the standard errors error.R, error.G, error.B
    /// where there are any.
    pub file: PathBuf,
    /// Relative standard deviation of a pixel, for a file without errors; beside errors both add as squares.
    pub noise: Option<f64>,
    /// Standard deviation of a pixel where it is dark, in the scene's units; it adds as squares too.
    pub noise_floor: Option<f64>,
    /// A picture of the same size; pixels where its channel Y (or R) is at least ½ count. All count when absent.
    pub mask: Option<PathBuf>,
    /// Name of an unknown factor that all pictures with this name share: the picture shows the factor times the
    /// radiance. Without it the picture is in the scene's units.
    pub exposure: Option<String>,
    /// Zenith angle and azimuth of the sun when it was taken (degrees), where that is not the scene's.
    pub sun_deg: Option<[f64; 2]>,
    /// Whether the picture is kept from the fit and only predicted.
    #[serde(default)]
    pub held_out: bool,
}

/// Reflectance factors of a scene that repeats, as `eval canopy` computes them.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StatedFactors {
    /// A table: view_zenith_deg, view_azimuth_deg (in the sun's plane without it), and brf_r, brf_g, brf_b, with their
    /// standard errors brf_r_err, brf_g_err, brf_b_err where there are any.
    pub file: PathBuf,
    /// Relative standard deviation of a factor; beside errors both add as squares.
    pub noise: Option<f64>,
    /// Whether the table is kept from the fit and only predicted.
    #[serde(default)]
    pub held_out: bool,
}

/// The numbers of the scene that are unknown. The scene's own values are where the fit starts.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StatedUnknowns {
    /// For each leaf, by its name, numbers that its kind of leaf has: `rho_d`, `rho_t`, `rho_s`, `m`, `sigma_a`,
    /// `sigma_s`, `thickness_mm`, or the contents of a leaf of layers; and `area` of discs.
    pub leaves: BTreeMap<String, Vec<String>>,
    /// `albedo`.
    pub ground: Vec<String>,
    /// `scale`, `turbidity`.
    pub sky: Vec<String>,
    /// `irradiance`.
    pub sun: Vec<String>,
}

/// Numbers of a leaf whose reflectances are stated, or pictures of them.
const OF_LEAVES: &[&str] = &["rho_d", "rho_t", "rho_s", "m"];
/// Numbers of a uniform leaf that is a slab.
const OF_SLABS: &[&str] = &["sigma_a", "sigma_s", "thickness_mm", "rho_s", "m"];
/// Numbers of a fitted leaf: those of its slab, and of its maps.
const OF_FITS: &[&str] = &["sigma_a", "sigma_s", "thickness_mm", "rho_d", "rho_t", "rho_s", "m"];

/// The area of all discs of a leaf, as a factor on what the scene states.
pub const AREA: &str = "area";

impl StatedLeaf {
    /// The numbers of the leaf that may be unknown, and in words what kind of leaf has these.
    pub(crate) fn unknowable(&self) -> (&'static [&'static str], &'static str) {
        match &self.origin {
            LeafOrigin::Uniform(uniform) if uniform.slab.is_some() => (OF_SLABS, "a uniform leaf that is a slab"),
            LeafOrigin::Layered(layered) if layered.stated.pigments.is_some() => {
                (&SUBSTANCES, "a leaf of layers with a table of pigments")
            }
            LeafOrigin::Layered(_) => (&["absorption"], "a leaf of layers without a table of pigments"),
            LeafOrigin::Fitted(_) => (OF_FITS, "a fitted leaf"),
            LeafOrigin::Uniform(_) => (OF_LEAVES, "a uniform leaf with reflectances"),
            LeafOrigin::Look(_) | LeafOrigin::Other => (OF_LEAVES, "a leaf with pictures of its reflectances"),
        }
    }
}

impl SceneManifest {
    /// Checks the tables of what was measured and of what is unknown, for a fit from pictures.
    ///
    /// # Errors
    /// [`Error::Input`] for the first table that says something impossible, and where there is nothing to fit or
    /// nothing that was measured.
    pub fn require_pictures(&self) -> Result<()> {
        let fitted = self.taken.iter().any(|p| !p.held_out) || self.factors.iter().any(|f| !f.held_out);
        if !fitted {
            let what = "missing; expected at least one [[picture]] or [[brf]] that is not held out";
            return Err(Error::field(&self.path, "picture", what));
        }
        self.require_unknown()
    }

    /// The same, for a plan of pictures: there may be none yet.
    ///
    /// # Errors
    /// As [`SceneManifest::require_pictures`].
    pub fn require_unknown(&self) -> Result<()> {
        let bad = |field: &str, what: String| {
            Err(Error::Input {
                file: self.path.display().to_string(),
                line: None,
                field: Some(field.into()),
                fault: Fault::Other(what),
            })
        };
        let Some(unknown) = self.unknown.as_ref().filter(|u| u.count() > 0) else {
            return bad("unknown", "missing; expected an [unknown] with at least one number".into());
        };
        for (k, picture) in self.taken.iter().enumerate() {
            let field = |key: &str| format!("picture[{k}].{key}");
            let cameras = || {
                let names = self.perspectives().map(|v| v.name.as_str());
                format!("one of the scene's perspective views ({})", names.collect::<Vec<_>>().join(", "))
            };
            if !self.perspectives().any(|view| view.name == picture.view) {
                return bad(&field("view"), format!("found \"{}\", expected {}", picture.view, cameras()));
            }
            if let Some(twin) = self.taken[..k].iter().position(|other| other.file == picture.file) {
                let what = format!("{} is that of picture[{twin}] too, expected each once", picture.file.display());
                return bad(&field("file"), what);
            }
            if let Some(floor) = picture.noise_floor.filter(|n| !(*n >= 0.0 && n.is_finite())) {
                return bad(&field("noise_floor"), format!("found {floor}, expected a radiance of at least 0"));
            }
            if let Some(noise) = picture.noise.filter(|n| !(*n > 0.0 && *n < 1.0)) {
                return bad(&field("noise"), format!("found {noise}, expected a share above 0 and below 1"));
            }
            if let Some(sun) = picture.sun_deg {
                self.movable_sun(sun).or_else(|what| bad(&field("sun_deg"), what))?;
            }
        }
        for (k, factors) in self.factors.iter().enumerate() {
            if let Some(noise) = factors.noise.filter(|n| !(*n > 0.0 && *n < 1.0)) {
                return bad(&format!("brf[{k}].noise"), format!("found {noise}, expected a share above 0 and below 1"));
            }
        }
        if let (false, Some((name, _))) = (
            self.factors.is_empty(),
            [("sun", &unknown.sun), ("sky", &unknown.sky)].into_iter().find(|(_, list)| !list.is_empty()),
        ) {
            let what =
                "given beside a [[brf]]; reflectance factors are of the sun's light alone, whatever its irradiance";
            return bad(&format!("unknown.{name}"), what.into());
        }
        for (name, numbers) in &unknown.leaves {
            let field = format!("unknown.leaves.{name}");
            let Some(leaf) = self.leaves.iter().find(|leaf| leaf.name == *name) else {
                let names: Vec<&str> = self.leaves.iter().map(|leaf| leaf.name.as_str()).collect();
                return bad(&field, format!("found no leaf of this name, expected one of {}", names.join(", ")));
            };
            let twin = self.leaves.iter().find(|other| other.like.as_ref() == Some(name));
            if let Some(other) = leaf.like.as_ref().or(twin.map(|twin| &twin.name)) {
                let what = format!("found a leaf that shares its numbers with \"{other}\" (like), expected one alone");
                return bad(&field, what);
            }
            let (known, kind) = leaf.unknowable();
            if let Some(number) = numbers.iter().find(|n| *n != AREA && !known.contains(&n.as_str())) {
                let more = leaf.discs.as_ref().map(|_| AREA);
                let all: Vec<&str> = known.iter().copied().chain(more).collect();
                let expected = format!("expected some of {}, the numbers of {kind}", all.join(", "));
                return bad(&field, format!("found \"{number}\", {expected}"));
            }
            if numbers.iter().any(|n| n == AREA) && leaf.discs.is_none() {
                let what = "of a leaf with a mesh, expected one with `discs`, of which there can be fewer or more";
                return bad(&field, format!("found \"{AREA}\" {what}"));
            }
            if leaf.translucency.is_some() {
                let what = "found a leaf through which the sun shines by translucency maps, which belong to its \
                            present numbers; expected one without `translucency`";
                return bad(&field, what.into());
            }
            if leaf.layered().is_some_and(|layered| layered.stated.fades_to.is_some()) {
                return bad(&field, "found a leaf that fades with time, expected one without `fades_to`".into());
            }
            let named = |list: &[&str]| numbers.iter().find(|n| list.contains(&n.as_str()));
            if let (true, Some(of_slab), Some(own)) =
                (leaf.fit().is_some(), named(&OF_SLABS[..3]), named(&["rho_d", "rho_t"]))
            {
                let what = format!(
                    "found \"{own}\" beside \"{of_slab}\", whose slab gives it; expected numbers of the slab, or \
                     reflectances"
                );
                return bad(&field, what);
            }
        }
        let lists = [
            ("ground", &unknown.ground, &["albedo"][..], self.ground.is_some(), "[ground]"),
            ("sky", &unknown.sky, &["scale", "turbidity"], self.sky.is_some(), "[sky]"),
            ("sun", &unknown.sun, &["irradiance"], self.sun.is_some(), "[sun]"),
        ];
        for (name, asked, known, there, table) in lists {
            let field = format!("unknown.{name}");
            if let Some(number) = asked.iter().find(|n| !known.contains(&n.as_str())) {
                return bad(&field, format!("found \"{number}\", expected some of {}", known.join(", ")));
            }
            if !asked.is_empty() && !there {
                return bad(&field, format!("given, but the scene has no {table}"));
            }
        }
        let turbidity = unknown.sky.iter().any(|n| n == "turbidity");
        if turbidity && self.physical_sky().is_none() {
            return bad("unknown.sky", "found \"turbidity\", but the sky has none; expected one with a `model`".into());
        }
        if self.ground.as_ref().is_some_and(|g| g.grain_mm.is_some()) && !unknown.ground.is_empty() {
            return bad("unknown.ground", "given, but the ground has a grain; expected an even ground".into());
        }
        let mut seen = BTreeSet::new();
        let twice = unknown.all().find(|name| !seen.insert(name.clone()));
        twice.map_or(Ok(()), |name| bad("unknown", format!("{name} is given twice, expected each once")))
    }
}

impl SceneManifest {
    /// Whether the scene's sun can stand at this zenith angle and azimuth (degrees).
    ///
    /// # Errors
    /// Why it cannot, as what was found and what is expected.
    pub fn movable_sun(&self, [zenith, azimuth]: [f64; 2]) -> std::result::Result<(), String> {
        if self.sun.is_none() || self.panorama().is_some() {
            return Err(format!(
                "found {zenith} and {azimuth}, but the scene has no [sun] that could stand elsewhere; expected one, \
                 and no picture of the sky"
            ));
        }
        if !(0.0..90.0).contains(&zenith) || !azimuth.is_finite() {
            return Err(format!(
                "found {zenith} and {azimuth}, expected a zenith angle from 0 to below 90° and an azimuth"
            ));
        }
        Ok(())
    }

    /// The scene with its sun at this zenith angle and azimuth (degrees). A sun whose irradiance is stated keeps it;
    /// that of a physical sky follows from its model.
    pub fn with_sun(&self, sun_deg: Option<[f64; 2]>) -> SceneManifest {
        let mut out = self.clone();
        if let (Some(sun), Some([zenith, azimuth])) = (&mut out.sun, sun_deg) {
            (sun.zenith_deg, sun.azimuth_deg) = (zenith, azimuth);
        }
        out
    }
}

impl StatedUnknowns {
    fn all(&self) -> impl Iterator<Item = String> + '_ {
        let leaves = self.leaves.iter().flat_map(|(leaf, list)| list.iter().map(move |n| format!("leaves.{leaf}.{n}")));
        let [ground, sky, sun] = [("ground", &self.ground), ("sky", &self.sky), ("sun", &self.sun)]
            .map(|(name, list)| list.iter().map(move |n| format!("{name}.{n}")));
        leaves.chain(ground).chain(sky).chain(sun)
    }

    /// How many quantities are unknown; one of three channels counts once.
    pub fn count(&self) -> usize {
        self.all().count()
    }
}
