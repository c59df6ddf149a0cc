//! What does not change with the tissue: levels, weights and transforms; and the transport of a tissue on it.

use super::series::ChebyshevSeries;
use super::totals::{SlantTotals, logarithms};
use super::{PARTIALS, TransportTangent};
use crate::dipole::{DipoleForm, Tissue, scalar::TissueDual};
use crate::translucency::convolution::TotalsSource;
use crate::translucency::fourier::Grid;
use crate::translucency::kernel::Kernel;
use crate::translucency::levels::{Nodes, ThicknessLevels};
use mesophyll_base::error::{Error, Result};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Maps and levels of a leaf, in which the tissue may change.
#[derive(Debug)]
pub struct TangentStage {
    pub(super) grid: Grid,
    pub(super) texel_mm: f64,
    pub(super) reach: usize,
    pub(super) closed: bool,
    pub(super) nodes: Nodes,
    pub(super) range: [f64; 2],
    /// Thickness maps in mm, row by row, each in the columns of its own side.
    pub(super) thickness: Vec<Vec<f64>>,
    /// For each thickness map: the weights of each level, texel by texel.
    pub(super) weights: Vec<Vec<f64>>,
    /// Cosines of the angles between light and blade normal for which totals are computed; 1 is along the normal.
    pub(super) incidences: Vec<f64>,
}

impl TangentStage {
    /// For maps of `width` × n texels of `texel_mm`. `thickness` (mm) is given for each lit side in its own columns; it
    /// is 0 or NaN where there is no tissue. Kernels end at `reach_mm` (at least one texel, at most the map), where the
    /// outermost texels take the remaining light. `incidences` are cosines (0 to 1) of the lights to the blade's
    /// normal. With [`TotalsSource::Transport`] the total is that of a beam with this incidence, but the light spreads
    /// like that of a beam along the normal.
    ///
    /// # Errors
    /// Maps of unequal size, no texel with a thickness, no level, a texel that is not positive, a cosine out of range.
    pub fn new(
        width: usize,
        texel_mm: f64,
        thickness: Vec<Vec<f64>>,
        incidences: &[f64],
        levels: ThicknessLevels,
        reach_mm: f64,
    ) -> Result<TangentStage> {
        if incidences.is_empty() || !incidences.iter().all(|mu| *mu > 0.0 && *mu <= 1.0) {
            return Err(Error::Usage(format!(
                "cosines of incidence {incidences:?}; expected some above 0 and at most 1"
            )));
        }
        let texels = thickness.first().map_or(0, Vec::len);
        if width == 0 || texels == 0 || !texels.is_multiple_of(width) || thickness.iter().any(|t| t.len() != texels) {
            return Err(Error::Usage(format!(
                "thickness maps of {texels} texels in rows of {width}; expected maps of one size"
            )));
        }
        if !(texel_mm > 0.0 && texel_mm.is_finite() && reach_mm > 0.0) || levels.count == 0 {
            let count = levels.count;
            return Err(Error::Usage(format!(
                "texels of {texel_mm} mm, reach {reach_mm} mm, {count} levels; expected numbers above 0"
            )));
        }
        let mut distinct: Vec<f64> = Vec::new();
        let mut range = [f64::INFINITY, 0.0f64];
        for &d in thickness.iter().flatten().filter(|&&d| d > 0.0 && d.is_finite()) {
            range = [range[0].min(d), range[1].max(d)];
            if distinct.len() <= levels.count && !distinct.contains(&d) {
                distinct.push(d);
            }
        }
        let nodes = match distinct.len() {
            0 => return Err(Error::Usage("no texel of the leaf has a thickness".into())),
            n if n <= levels.count => {
                distinct.sort_by(f64::total_cmp);
                Nodes::exact(distinct)
            }
            _ => Nodes::new(levels.kind, levels.count, range[0], range[1]),
        };
        let height = texels / width;
        let most = width.max(height) - 1;
        let wanted = (reach_mm / texel_mm).ceil().max(1.0);
        let (reach, closed) = if wanted > most as f64 { (most, false) } else { (wanted as usize, true) };
        let count = nodes.thickness.len();
        let weights = thickness.iter().map(|map| {
            let mut weights = vec![0.0; texels * count];
            weights
                .par_chunks_mut(count)
                .zip(map.par_iter())
                .filter(|(_, d)| **d > 0.0)
                .for_each(|(w, d)| nodes.weights(*d, w));
            weights
        });
        Ok(TangentStage {
            weights: weights.collect(),
            grid: Grid::new(width, height, reach),
            texel_mm,
            reach,
            closed,
            nodes,
            range,
            thickness,
            incidences: incidences.to_vec(),
        })
    }

    /// Largest distance (mm) that kernels span, and whether it is less than the whole map.
    pub fn reach_mm(&self) -> (f64, bool) {
        (self.reach as f64 * self.texel_mm, self.closed)
    }

    /// The transport of `tissue`, with every thickness multiplied by `factor`, in the thin form.
    ///
    /// # Errors
    /// A tissue or factor out of range, or so opaque that no light is left to compute with.
    pub fn at(&self, tissue: &Tissue, totals: TotalsSource, factor: f64) -> Result<TransportTangent<'_>> {
        if let Some(fault) = tissue.fault() {
            return Err(Error::Usage(fault));
        }
        if !(tissue.sigma_a > 0.0 && tissue.sigma_s > 0.0 && factor > 0.0 && factor.is_finite()) {
            let Tissue { sigma_a, sigma_s, .. } = tissue;
            return Err(Error::Usage(format!(
                "sigma_a {sigma_a}, sigma_s {sigma_s}, thickness factor {factor}; expected above 0 for logarithms"
            )));
        }
        let opaque = || Error::Usage(format!("{tissue:?} lets no light through {} mm", factor * self.range[1]));
        let made: Option<Vec<[Kernel; PARTIALS + 1]>> =
            self.nodes.thickness.par_iter().map(|d| self.kernel(tissue, factor * d)).collect();
        let mut spectra = Vec::new();
        let mut partials = Vec::new();
        for kernels in &made.ok_or_else(opaque)? {
            let [value, by_a, by_s, by_d] = kernels;
            spectra.push(self.grid.spectrum(value));
            partials.push([by_a, by_s, by_d].map(|k| self.grid.spectrum(k)));
        }
        let mut curves = Vec::new();
        for mu in &self.incidences {
            let slant = (totals == TotalsSource::Transport && *mu != 1.0).then(|| SlantTotals::new(tissue, *mu));
            let curve = ChebyshevSeries::fit(
                |d| logarithms(tissue, totals, slant.as_ref(), factor * d),
                self.range[0],
                self.range[1],
                24,
            );
            if !curve.coefficients.iter().flatten().all(|v| v.is_finite()) {
                return Err(opaque());
            }
            curves.push(curve);
        }
        let texel = |curve: &ChebyshevSeries<{ 2 * (PARTIALS + 1) }>, d: f64| {
            let mut parts = [0.0; 2 * (PARTIALS + 1)];
            if d > 0.0 {
                let log = curve.at(d);
                for which in 0..2 {
                    parts[which] = log[which].exp();
                    (1..=PARTIALS).for_each(|p| parts[2 * p + which] = parts[which] * log[2 * p + which]);
                }
            }
            parts
        };
        let each = self.thickness.iter().flat_map(|map| curves.iter().map(move |curve| (map, curve)));
        let parts = each.map(|(map, curve)| map.par_iter().map(|d| texel(curve, *d)).collect()).collect();
        Ok(TransportTangent { stage: self, spectra, partials, parts })
    }

    /// The shape (sum 1) for one thickness, and its derivatives.
    fn kernel(&self, tissue: &Tissue, d: f64) -> Option<[Kernel; PARTIALS + 1]> {
        let whole = tissue.beyond_with_partials(0.0, d, DipoleForm::Thin);
        if !(whole.value > 0.0) {
            return None;
        }
        let by = |v: &TissueDual<f64>| [tissue.sigma_a * v.by[0], tissue.sigma_s * v.by[1], v.by[3]];
        let whole_by = by(&whole);
        let (low, high) = (0.499 * self.texel_mm, std::f64::consts::SQRT_2 * (self.reach as f64 + 1.0) * self.texel_mm);
        // ln of the share. Its nearest singularity is at r = ± i d, a quarter turn off the axis of ln r.
        let half = 0.5 * (high / low).ln();
        let height = 0.5 * PI / half;
        let count = (20.0 / (height + height.hypot(1.0)).ln()).ceil().clamp(12.0, 200.0) as usize;
        let share = |r: f64| {
            let g = tissue.beyond_with_partials(r, d, DipoleForm::Thin);
            // A value that has underflowed stays constant.
            if !(g.value > 1e-290 * whole.value) {
                return [-667.0, 0.0, 0.0, 0.0];
            }
            let g_by = by(&g);
            let change = |k: usize| g_by[k] / g.value - whole_by[k] / whole.value;
            [(g.value / whole.value).ln(), change(0), change(1), change(2)]
        };
        let curve = ChebyshevSeries::fit(share, low, high, count);
        if !curve.coefficients.iter().flatten().all(|v| v.is_finite()) {
            return None;
        }
        let flow = |r: f64| {
            let [log, a, s, d] = curve.at(r);
            let g = log.exp();
            [g, g * a, g * s, g * d]
        };
        Some(Kernel::build(flow, self.texel_mm, self.reach, self.closed))
    }
}
