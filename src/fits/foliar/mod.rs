//! The pigments of a leaf and the oblateness of its epidermis, from the light that it reflects and lets through.
//!
//! The model is the layered leaf of [`mesophyll_optics::foliar`], solved exactly. Reflectance R and transmittance T
//! depend on contents per area, so the thickness of the mesophyll does not matter. The misfit may have several minima,
//! so the solver starts at several places.

mod adequacy;
pub mod surface;
mod surfaces;

pub use mesophyll_capture::pigments;

use crate::rivals::how_well;
use adequacy::Stated;
use mesophyll_base::solvers::{ClosureProblem, Options as Solver, Problem, ResidualNoise, multi_start};
use mesophyll_files::table::{OutputRow, Status};
use mesophyll_optics::foliar::pigments::{OpticalConstants, OpticalSpectrum, SUBSTANCES};
use mesophyll_optics::side::Side;
use std::cell::RefCell;
use std::collections::HashMap;
use std::rc::Rc;
use std::sync::{Arc, OnceLock};
use strum::{Display, EnumIter, EnumMessage, EnumString, IntoStaticStr};
use surface::{FoliarFitSetting, MOST_OBLATE, ResponseSurface};
use surfaces::ResponseSurfaceTable;

/// What can be fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, EnumString, EnumIter, EnumMessage, IntoStaticStr, Display)]
#[strum(serialize_all = "kebab-case")]
pub enum FoliarParameter {
    /// chlorophyll a and b per leaf area
    Chlorophyll,
    /// carotenoids per leaf area
    Carotenoid,
    /// protein per leaf area
    Protein,
    /// cellulose and lignin per leaf area
    CelluloseLignin,
    /// water per leaf area
    Water,
    /// oblateness of the epidermis
    Oblateness,
    /// thickness of the mesophyll, which no such measurement tells
    Thickness,
}

impl FoliarParameter {
    /// The name of the parameter's column in tables.
    pub fn column(self) -> &'static str {
        match self {
            FoliarParameter::Chlorophyll => "chlorophyll_ug_cm2",
            FoliarParameter::Carotenoid => "carotenoid_ug_cm2",
            FoliarParameter::Protein => "protein_ug_cm2",
            FoliarParameter::CelluloseLignin => "cellulose_lignin_ug_cm2",
            FoliarParameter::Water => "water_g_cm2",
            FoliarParameter::Oblateness => "oblateness_epidermis",
            FoliarParameter::Thickness => "mesophyll_thickness_mm",
        }
    }

    /// Its value where the solver's variable is `x`.
    fn shown(self, x: f64) -> f64 {
        if self == FoliarParameter::Oblateness { x.exp_m1() } else { x }
    }

    /// The parameter's place among the [`SUBSTANCES`].
    fn substance(self) -> Option<usize> {
        let k = self as usize;
        (k < SUBSTANCES.len()).then_some(k)
    }

    /// The largest value that the fit looks for, and the range that starting values are taken from. Both are ln(1 + x)
    /// for the oblateness x.
    fn range(self) -> (f64, [f64; 2]) {
        match self {
            FoliarParameter::Chlorophyll => (400.0, [3.0, 80.0]),
            FoliarParameter::Carotenoid => (150.0, [0.5, 20.0]),
            FoliarParameter::Protein => (20_000.0, [100.0, 2000.0]),
            FoliarParameter::CelluloseLignin => (50_000.0, [200.0, 5000.0]),
            FoliarParameter::Water => (0.5, [0.002, 0.03]),
            FoliarParameter::Oblateness => (surface::widest(), [0.2, 3.2]),
            FoliarParameter::Thickness => (1.0, [0.05, 0.2]),
        }
    }
}

/// One reading of a leaf.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FoliarReading {
    /// Which of the model's [`FoliarFitModel::lights`].
    pub light: usize,
    /// Whether the reading is a transmittance; otherwise it is a reflectance.
    pub through: bool,
    /// The share of light that was measured.
    pub value: f64,
    /// Its standard error; NaN where none is known.
    pub err: f64,
}

/// How leaves are fitted: everything that they share.
pub struct FoliarFitModel {
    /// Wavelengths (nm) and lit sides of the readings, with the optical constants there.
    pub lights: Vec<(f64, Side, OpticalConstants)>,
    /// Index of each light's surface. Lights of one side with the same refractive indices share a surface.
    places: Vec<usize>,
    surfaces: Arc<[OnceLock<ResponseSurface>]>,
    setting: FoliarFitSetting,
    free: Vec<FoliarParameter>,
    asked: Vec<FoliarParameter>,
    noise: Option<f64>,
}

/// How many places the solver starts at.
const STARTS: usize = 8;
/// About this many of a leaf's readings are enough to tell its minima apart.
const FEW: usize = 48;
/// The status `ok` promises that each value's standard error is at most this part of the value.
const PROMISE: f64 = 0.1;

/// The asked parameters that can be fitted at all.
fn free(asked: &[FoliarParameter]) -> Vec<FoliarParameter> {
    asked.iter().copied().filter(|p| *p != FoliarParameter::Thickness).collect()
}

impl FoliarFitModel {
    /// `lights`: wavelengths (nm) within the spectrum, and sides. `asked`: what is fitted. `noise`: standard error of
    /// readings that have none of their own, 0 where they are exact.
    ///
    /// # Errors
    /// The sentence that says which wavelength is outside the table.
    pub fn new(
        spectrum: &OpticalSpectrum,
        lights: &[(f64, Side)],
        setting: FoliarFitSetting,
        asked: &[FoliarParameter],
        noise: Option<f64>,
    ) -> Result<FoliarFitModel, String> {
        let constants = |&(wavelength, side): &(f64, Side)| {
            let [low, high] = spectrum.range();
            let found = spectrum.at(wavelength);
            found
                .map(|c| (wavelength, side, c))
                .ok_or_else(|| format!("a reading is at {wavelength} nm; the table of pigments has {low} to {high} nm"))
        };
        let lights = lights.iter().map(constants).collect::<Result<Vec<_>, String>>()?;
        let mut kinds: HashMap<(bool, [u64; 3]), usize> = HashMap::new();
        let mut place = |(_, side, constants): &(f64, Side, OpticalConstants)| {
            let next = kinds.len();
            *kinds.entry((*side == Side::Back, constants.indices.map(f64::to_bits))).or_insert(next)
        };
        let places: Vec<usize> = lights.iter().map(&mut place).collect();
        let surfaces = kinds.iter().map(|_| OnceLock::new()).collect();
        Ok(FoliarFitModel { lights, places, surfaces, setting, free: free(asked), asked: asked.to_vec(), noise })
    }

    /// The same lights, asked for other parameters or with another noise. Everything computed for the lights is shared.
    pub fn asking(&self, asked: &[FoliarParameter], noise: Option<f64>) -> FoliarFitModel {
        FoliarFitModel {
            lights: self.lights.clone(),
            places: self.places.clone(),
            surfaces: self.surfaces.clone(),
            setting: self.setting,
            free: free(asked),
            asked: asked.to_vec(),
            noise,
        }
    }

    /// Columns of [`FoliarFitModel::fit`]'s answer.
    pub fn outputs(&self) -> Vec<String> {
        let names = || self.asked.iter().map(|p| p.column().to_string());
        names().chain(names().map(|n| n + "_err")).chain(["rms", "minima"].map(String::from)).collect()
    }

    /// Prepares what the lights of a side share, where there are so many lights that this is less work than computing
    /// one after the other. It uses all threads. Whatever is not prepared is computed when it is first needed.
    pub fn prepare(&self, side: Side) {
        let mut triples: Vec<[f64; 3]> = Vec::new();
        for (_, _, constants) in self.lights.iter().filter(|l| l.1 == side) {
            if !triples.contains(&constants.indices) {
                triples.push(constants.indices);
            }
        }
        triples.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let shared = ResponseSurfaceTable::both(&triples, &self.setting, side);
        for (place, light) in self.places.iter().zip(&self.lights).filter(|(_, l)| l.1 == side) {
            let found = || shared.iter().find_map(|table| table.at(light.2.indices));
            if let Some(of_light) = self.surfaces[*place].get().is_none().then(found).flatten() {
                self.surfaces[*place].get_or_init(|| of_light);
            }
        }
    }

    fn surface(&self, light: usize) -> &ResponseSurface {
        self.surfaces[self.places[light]].get_or_init(|| {
            let (_, side, constants) = &self.lights[light];
            ResponseSurface::new(constants.indices, &self.setting, *side)
        })
    }

    /// R and T of all lights that `readings` name, one after the other, for values of the free parameters. Each comes
    /// with its derivatives by absorption and by the lobe of the epidermis.
    fn values(
        &self,
        readings: &[FoliarReading],
        known: &FoliarFitConstants,
        params: &[f64],
    ) -> Vec<[surface::FoliarSensitivity; 2]> {
        let mut contents = known.contents;
        let mut lobe = known.oblateness.ln_1p();
        for (&p, &x) in self.free.iter().zip(params) {
            match p.substance() {
                Some(k) => contents[k] = x,
                None => lobe = x,
            }
        }
        let mut values: Vec<[surface::FoliarSensitivity; 2]> = Vec::new();
        let mut last = None;
        for reading in readings {
            if last != Some(reading.light) {
                last = Some(reading.light);
                let per = self.lights[reading.light].2.per_content();
                let depth: f64 = per.iter().zip(&contents).map(|(x, c)| x * c).sum();
                values.push(self.surface(reading.light).at(depth, lobe));
            }
        }
        values
    }

    /// The residuals (measured − computed)/error and their derivatives. The solver asks for both at the same
    /// parameters; they are computed once.
    fn problem<'a>(
        &'a self,
        readings: &'a [FoliarReading],
        sigma: &'a [f64],
        known: &'a FoliarFitConstants,
    ) -> impl Problem + 'a {
        // Parameters, and what was computed for them.
        type Computed = (Vec<f64>, Vec<[surface::FoliarSensitivity; 2]>);
        let (n, m) = (self.free.len(), readings.len());
        // For each reading, which of the computed values belongs to it.
        let mut place = Vec::with_capacity(m);
        for (k, r) in readings.iter().enumerate() {
            let before = place.last().copied().unwrap_or(0);
            place.push(before + usize::from(k > 0 && readings[k - 1].light != r.light));
        }
        let place = Rc::new(place);
        let last: Rc<RefCell<Computed>> = Rc::default();
        let (places, recent) = (place.clone(), last.clone());
        let update = move |params: &[f64]| {
            let mut recent = recent.borrow_mut();
            if recent.0 != params {
                *recent = (params.to_vec(), self.values(readings, known, params));
            }
        };
        let again = update.clone();
        let seen = last.clone();
        ClosureProblem::new(n, m, move |params: &[f64], out: &mut [f64]| {
            update(params);
            let recent = last.borrow();
            for (k, r) in readings.iter().enumerate() {
                out[k] = (recent.1[place[k]][usize::from(r.through)].value - r.value) / sigma[k];
            }
        })
        .with_jacobian(move |params: &[f64], out: &mut [f64]| {
            again(params);
            let recent = seen.borrow();
            for (k, r) in readings.iter().enumerate() {
                let value = recent.1[places[k]][usize::from(r.through)];
                let per = self.lights[r.light].2.per_content();
                for (j, p) in self.free.iter().enumerate() {
                    let slope = p.substance().map_or(value.by_lobe, |s| value.by_depth * per[s]);
                    out[j * m + k] = slope / sigma[k];
                }
            }
        })
    }

    /// R or T of every reading for the values of a fit's answer. The values are in the order of the asked parameters.
    pub fn computed(&self, readings: &[FoliarReading], known: &FoliarFitConstants, values: &[f64]) -> Vec<f64> {
        let of = |p: &FoliarParameter| {
            let x = self.asked.iter().position(|a| a == p).and_then(|k| values.get(k)).copied().unwrap_or(0.0);
            if *p == FoliarParameter::Oblateness { x.ln_1p() } else { x }
        };
        let params: Vec<f64> = self.free.iter().map(of).collect();
        let each =
            |r: &FoliarReading| self.values(std::slice::from_ref(r), known, &params)[0][usize::from(r.through)].value;
        readings.iter().map(each).collect()
    }

    /// Fits one leaf and says what was found as the row of a batch. `known` holds what is not fitted.
    pub fn fit(&self, readings: &[FoliarReading], known: &FoliarFitConstants) -> OutputRow {
        if readings.is_empty() {
            return OutputRow::refused("no reading");
        }
        if let Some(r) = readings.iter().find(|r| !(-0.1..=1.1).contains(&r.value)) {
            let name = if r.through { "transmittance" } else { "reflectance" };
            let at = self.lights[r.light].0;
            return OutputRow::refused(format!("the {name} at {at} nm is {}; expected 0 to 1", r.value));
        }
        let stated = self.noise.is_some() || readings.iter().all(|r| r.err > 0.0);
        // Exact readings all have the same weight.
        let sigma: Vec<f64> = readings
            .iter()
            .map(|r| if r.err > 0.0 { r.err } else { self.noise.filter(|n| *n > 0.0).unwrap_or(1.0) })
            .collect();
        let known_noise = stated && (self.noise.is_none_or(|n| n > 0.0) || readings.iter().all(|r| r.err > 0.0));
        let exact = stated && !known_noise;
        let (n, m) = (self.free.len(), readings.len());
        let ranges: Vec<(f64, [f64; 2])> = self.free.iter().map(|p| p.range()).collect();
        let options = Solver {
            lower: vec![0.0; n],
            upper: ranges.iter().map(|r| r.0).collect(),
            noise: if known_noise { ResidualNoise::Known } else { ResidualNoise::Estimated },
            gradient_tolerance: 1e-10,
            max_iterations: 200,
            rank_tolerance: Some(1e-9),
            ..Solver::default()
        };
        let [low, high] = [0, 1].map(|k| ranges.iter().map(|r| r.1[k]).collect::<Vec<_>>());
        let mut starts = multi_start::starts_in_box(&low, &high, STARTS, 1).unwrap_or_default();
        // Where there are many readings, a few of them tell the minima apart, and all of them refine each minimum. An
        // odd step takes R and T in turn.
        let stride = (m / FEW) | 1;
        if stride > 1 {
            let some: Vec<usize> = (0..m).step_by(stride).collect();
            let few: Vec<FoliarReading> = some.iter().map(|&k| readings[k]).collect();
            let few_sigma: Vec<f64> = some.iter().map(|&k| sigma[k]).collect();
            let found = multi_start::multi_start(&self.problem(&few, &few_sigma, known), &starts, &options);
            let minima = found.map(|f| f.minima.into_iter().map(|m| m.params).collect::<Vec<_>>()).unwrap_or_default();
            if !minima.is_empty() {
                starts = minima;
            }
        }
        let problem = self.problem(readings, &sigma, known);
        let found = multi_start::multi_start(&problem, &starts, &options);
        let Some(found) = found.filter(|f| f.best.params.iter().all(|p| p.is_finite())) else {
            return OutputRow::refused("the fit did not converge");
        };
        let fit = &found.best;
        let squares: f64 = fit.residuals.iter().zip(&sigma).map(|(r, s)| (r * s).powi(2)).sum();
        let rms = (squares / m as f64).sqrt();
        let mut jacobian = vec![0.0; n * m];
        problem.jacobian(&fit.params, &mut jacobian);
        let noise = match (known_noise, exact) {
            (true, _) => Stated::Errors,
            (_, true) => Stated::Exact,
            _ => Stated::Nothing,
        };
        let judged = adequacy::of_fit(self, readings, &sigma, &fit.residuals, &jacobian, noise);
        let (mut values, mut errors, mut open) = (Vec::new(), Vec::new(), Vec::new());
        for p in &self.asked {
            let Some(k) = self.free.iter().position(|f| f == p) else {
                values.push(f64::NAN);
                errors.push(if stated { f64::INFINITY } else { f64::NAN });
                open.push(format!("{} (R and T tell contents per area only)", p.column()));
                continue;
            };
            let (x, s) = (fit.params[k], fit.uncertainty.stderr[k]);
            let (value, error) = match p {
                FoliarParameter::Oblateness => (p.shown(x).min(MOST_OBLATE), s * x.exp()),
                _ => (x, s),
            };
            let error = if exact && s.is_finite() { 0.0 } else { error * judged.widening[k] };
            let lost = !fit.converged() || fit.uncertainty.undetermined.contains(&k) || !s.is_finite() && known_noise;
            let bound = adequacy::bound(*p, x, s).filter(|_| known_noise);
            if let (Some(bound), false) = (&bound, lost) {
                open.push(bound.clone());
            } else if let Some(why) = adequacy::no_leaf_has(*p, value) {
                open.push(why);
            } else if let Some((x, odds)) = adequacy::rival(&found, k, s * judged.widening[k], noise).filter(|_| !lost)
            {
                open.push(format!("{} ({:.3} explains the leaf {})", p.column(), p.shown(x), how_well(odds)));
            } else if lost || fit.at_bound.contains(&k) || known_noise && error > PROMISE * value {
                open.push(p.column().to_string());
            }
            values.push(value);
            errors.push(if stated { error } else { f64::NAN });
        }
        values.extend(errors);
        values.extend([rms, found.minima.len() as f64]);
        let status = match adequacy::why(&judged, readings, self, rms) {
            Some(why) => Status::undetermined(self.asked.iter().map(|p| p.column()), &why),
            None => Status::undetermined(open, ""),
        };
        OutputRow { values, status }
    }
}

/// What is not fitted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FoliarFitConstants {
    /// Contents per area, in the order of [`SUBSTANCES`] (µg/cm², water in g/cm²).
    pub contents: [f64; 5],
    /// Oblateness of the epidermis.
    pub oblateness: f64,
}

#[cfg(test)]
mod tests;
