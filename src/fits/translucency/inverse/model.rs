//! Cost, gradient and Gauss–Newton matrix of the photographs' misfit to the convolution, in ln σa and ln σs′ (a channel
//! each) and ln of the scale.

use super::{BeamIncidence, Options, TissueCoefficients, TissueImage, TissueMeasurement};
use crate::translucency::Result;
use mesophyll_base::solvers::lbfgs::{DifferentiableCost, NormalEquations};
use mesophyll_base::statistics::median_of;
use mesophyll_files::progress;
use mesophyll_optics::dipole::{DipoleForm, Tissue};
use mesophyll_optics::translucency::convolution::support;
use mesophyll_optics::translucency::levels::ThicknessLevels;
use mesophyll_optics::translucency::tangent::{PARTIALS, SourceImage, TangentStage, TransportTangent};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Range of the search: ln σ (σ in 1/mm) and ln scale. Beyond it, the cost rises with the square of the distance.
pub const SIGMA: [f64; 2] = [-11.5, 6.9];
pub const SCALE: [f64; 2] = [-2.3, 2.3];

/// Share of the light that leaves beyond the kernels' reach and is given to the outermost texels.
const TAIL: f64 = 1e-6;

pub struct TissueFitModel<'a> {
    pub measured: &'a TissueMeasurement,
    options: Options,
    stage: TangentStage,
    scale: f64,
    /// Cosines of incidence, each listed once.
    incidences: Vec<f64>,
    /// 1/sd for each channel, image and texel; 0 where the texel does not count.
    inverse: Vec<Vec<Vec<f64>>>,
    /// Number of texels that count, over all images and channels.
    pub count: usize,
}

/// The misfit to the photographs.
pub struct TissueScore {
    /// Residuals divided by their sd, for each channel, image and texel.
    pub residuals: Vec<Vec<Vec<f64>>>,
    /// The gradient of half the sum of their squares.
    pub gradient: Vec<f64>,
}

/// Logarithms of the parameters that are searched for.
pub fn logarithms(tissues: &TissueCoefficients, options: &Options) -> Vec<f64> {
    let pairs = tissues.sigma_a.iter().zip(&tissues.reduced).flat_map(|(a, s)| [a.ln(), s.ln()]);
    pairs.chain((!options.fix_scale).then(|| tissues.scale.ln())).collect()
}

/// The tissues of logarithms `p`. `scale` is used where the scale is not searched for.
pub fn tissues(p: &[f64], options: &Options, scale: f64) -> TissueCoefficients {
    let (pairs, last) = if options.fix_scale { (p, scale) } else { (&p[..p.len() - 1], p[p.len() - 1].exp()) };
    TissueCoefficients {
        sigma_a: pairs.iter().step_by(2).map(|v| v.exp()).collect(),
        reduced: pairs.iter().skip(1).step_by(2).map(|v| v.exp()).collect(),
        scale: last,
    }
}

fn reach_mm(measured: &TissueMeasurement, at: &TissueCoefficients, tail: f64) -> f64 {
    let thickest = measured.thickness.iter().flatten().fold(0.0, |m: f64, d| m.max(*d));
    let each = measured.channels.iter().zip(at.sigma_a.iter().zip(&at.reduced)).map(|(c, (sigma_a, reduced))| {
        support(
            &Tissue { sigma_a: *sigma_a, sigma_s: *reduced, g: 0.0, a: c.a },
            DipoleForm::Thin,
            at.scale * thickest,
            tail,
        )
    });
    each.fold(0.0, f64::max)
}

impl<'a> TissueFitModel<'a> {
    /// A model whose kernels have the reach that tissues about `at` need; each reading's sd is computed from the
    /// reading itself.
    pub fn new(
        measured: &'a TissueMeasurement,
        options: &Options,
        at: &TissueCoefficients,
    ) -> Result<TissueFitModel<'a>> {
        let levels = ThicknessLevels { count: options.levels, ..ThicknessLevels::default() };
        let reach = (1.3 * reach_mm(measured, at, 0.1 * TAIL)).max(4.0 * measured.texel_mm);
        let mut incidences = Vec::new();
        for cosine in measured
            .channels
            .iter()
            .flat_map(|c| &c.images)
            .map(|i| if options.incidence == BeamIncidence::Slant { i.cosine } else { 1.0 })
        {
            if !incidences.contains(&cosine) {
                incidences.push(cosine);
            }
        }
        let stage = TangentStage::new(
            measured.width,
            measured.texel_mm,
            measured.thickness.clone(),
            &incidences,
            levels,
            reach,
        )?;
        let count =
            measured.channels.iter().flat_map(|c| &c.images).map(|i| i.used.iter().filter(|u| **u).count()).sum();
        let mut model = TissueFitModel {
            measured,
            options: *options,
            stage,
            scale: at.scale,
            incidences,
            inverse: Vec::new(),
            count,
        };
        model.weigh(
            &measured.channels.iter().map(|c| c.images.iter().map(|i| i.seen.clone()).collect()).collect::<Vec<_>>(),
        );
        Ok(model)
    }

    /// Whether the kernels reach as far as light goes in these tissues.
    pub fn reaches(&self, at: &TissueCoefficients) -> bool {
        let (reach, closed) = self.stage.reach_mm();
        !closed || reach >= reach_mm(self.measured, at, TAIL)
    }

    /// Gives each reading the sd of the corresponding value in `levels`, which is taken as at least a fiftieth of their
    /// median.
    fn weigh(&mut self, levels: &[Vec<Vec<f64>>]) {
        let noise = self.measured.noise;
        let each = self.measured.channels.iter().zip(levels).map(|(channel, levels)| {
            let one = channel.images.iter().zip(levels).map(|(image, level)| {
                let used = level.iter().zip(&image.used).filter(|(_, u)| **u).map(|(v, _)| *v);
                let least = 0.02 * median_of(used).unwrap_or(0.0).max(0.0);
                let sd = |v: f64| (noise.relative * v.max(least)).hypot(noise.floor).max(1e-12);
                level.iter().zip(&image.used).map(|(v, u)| if *u { 1.0 / sd(*v) } else { 0.0 }).collect()
            });
            one.collect()
        });
        self.inverse = each.collect();
    }

    /// Gives each reading the sd of the model's value at `p`.
    ///
    /// # Errors
    /// As [`TissueFitModel::images`].
    pub fn reweigh(&mut self, p: &[f64]) -> Result<()> {
        let levels = self.images(p)?;
        self.weigh(&levels);
        Ok(())
    }

    pub fn tissues(&self, p: &[f64]) -> TissueCoefficients {
        tissues(p, &self.options, self.scale)
    }

    /// The same weights with other thickness maps.
    ///
    /// # Errors
    /// As [`TissueFitModel::new`].
    pub fn on<'b>(&self, measured: &'b TissueMeasurement, p: &[f64]) -> Result<TissueFitModel<'b>> {
        let mut model = TissueFitModel::new(measured, &self.options, &self.tissues(p))?;
        model.scale = self.scale;
        model.inverse.clone_from(&self.inverse);
        Ok(model)
    }

    /// Whether the thickness maps are assumed to have the right mean.
    pub fn scale_is_fixed(&self) -> bool {
        self.options.fix_scale
    }

    fn tangent(&self, at: &TissueCoefficients, c: usize) -> Result<TransportTangent<'_>> {
        let tissue = Tissue { sigma_a: at.sigma_a[c], sigma_s: at.reduced[c], g: 0.0, a: self.measured.channels[c].a };
        self.stage.at(&tissue, self.options.totals, at.scale)
    }

    fn sources(&self, c: usize) -> Vec<SourceImage<'_>> {
        let place = |i: &TissueImage| self.incidences.iter().position(|mu| *mu == i.cosine).unwrap_or(0);
        self.measured.channels[c]
            .images
            .iter()
            .map(|i| SourceImage { map: i.map, incidence: place(i), light: &i.light })
            .collect()
    }

    /// The values that the photographs should show at `p`, for each channel and image.
    ///
    /// # Errors
    /// Tissues that no kernel can be made of.
    pub fn images(&self, p: &[f64]) -> Result<Vec<Vec<Vec<f64>>>> {
        let at = self.tissues(p);
        let one = |c: usize| -> Result<Vec<Vec<f64>>> {
            let mut made = self.tangent(&at, c)?.run(&self.sources(c));
            for (made, image) in made.iter_mut().zip(&self.measured.channels[c].images) {
                made.iter_mut().zip(&image.exit).for_each(|(m, e)| *m *= e);
            }
            Ok(made)
        };
        (0..self.measured.channels.len()).into_par_iter().map(one).collect()
    }

    /// (model − seen)/sd of a channel's images, and the same times exit/sd, which the gradient is computed from.
    fn weighted(&self, c: usize, made: &[Vec<f64>]) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
        let images = &self.measured.channels[c].images;
        let one = |(k, made): (usize, &Vec<f64>)| -> (Vec<f64>, Vec<f64>) {
            let (image, inverse) = (&images[k], &self.inverse[c][k]);
            (0..made.len())
                .map(|t| {
                    if inverse[t] == 0.0 {
                        return (0.0, 0.0);
                    }
                    let r = (image.exit[t] * made[t] - image.seen[t]) * inverse[t];
                    (r, r * inverse[t] * image.exit[t])
                })
                .unzip()
        };
        made.iter().enumerate().map(one).unzip()
    }

    /// Residuals divided by their sd, for each channel, image and texel.
    ///
    /// # Errors
    /// As [`TissueFitModel::images`].
    pub fn residuals(&self, p: &[f64]) -> Result<Vec<Vec<Vec<f64>>>> {
        let at = self.tissues(p);
        let one = |c: usize| Ok(self.weighted(c, &self.tangent(&at, c)?.run(&self.sources(c))).0);
        (0..self.measured.channels.len()).into_par_iter().map(one).collect()
    }

    /// The residuals, and how half the sum of their squares changes.
    ///
    /// # Errors
    /// As [`TissueFitModel::images`].
    pub fn score(&self, p: &[f64]) -> Result<TissueScore> {
        let at = self.tissues(p);
        let one = |c: usize| {
            let (tangent, sources) = (self.tangent(&at, c)?, self.sources(c));
            let (residuals, views) = self.weighted(c, &tangent.run(&sources));
            Ok((residuals, tangent.gradient(&sources, &views)))
        };
        let parts: Vec<_> = (0..self.measured.channels.len()).into_par_iter().map(one).collect::<Result<_>>()?;
        let mut gradient = vec![0.0; p.len()];
        let mut residuals = Vec::new();
        for (c, (part, by)) in parts.into_iter().enumerate() {
            residuals.push(part);
            self.places(c).iter().zip(by).filter(|(i, _)| **i < p.len()).for_each(|(i, by)| gradient[*i] += by);
        }
        Ok(TissueScore { residuals, gradient })
    }

    /// How the gradient changes with ln of every texel's thickness, for each parameter, thickness map and texel. The
    /// part that comes from the residuals is left out, as in [`TissueFitModel::normal`].
    ///
    /// # Errors
    /// As [`TissueFitModel::images`].
    pub fn pulls(&self, p: &[f64]) -> Result<Vec<Vec<Vec<f64>>>> {
        let at = self.tissues(p);
        let free = if self.options.fix_scale { PARTIALS - 1 } else { PARTIALS };
        let one = |c: usize| -> Result<Vec<Vec<Vec<f64>>>> {
            let (tangent, sources) = (self.tangent(&at, c)?, self.sources(c));
            let pull = |k: usize| {
                let mut views = tangent.derivative(k, &sources);
                for ((view, image), inverse) in
                    views.iter_mut().zip(&self.measured.channels[c].images).zip(&self.inverse[c])
                {
                    view.iter_mut().zip(&image.exit).zip(inverse).for_each(|((v, e), w)| *v *= (w * e).powi(2));
                }
                tangent.by_thickness(&sources, &views)
            };
            Ok((0..free).map(pull).collect())
        };
        let parts: Vec<_> = (0..self.measured.channels.len()).into_par_iter().map(one).collect::<Result<_>>()?;
        let empty: Vec<Vec<f64>> = self.measured.thickness.iter().map(|map| vec![0.0; map.len()]).collect();
        let mut pulls = vec![empty; p.len()];
        for (c, part) in parts.iter().enumerate() {
            for (i, maps) in self.places(c).into_iter().zip(part) {
                pulls[i].iter_mut().flatten().zip(maps.iter().flatten()).for_each(|(sum, v)| *sum += v);
            }
        }
        Ok(pulls)
    }

    /// 1/sd, in the order of [`TissueFitModel::residuals`].
    pub fn inverse_sd(&self) -> &[Vec<Vec<f64>>] {
        &self.inverse
    }

    /// The places of a channel's three partial derivatives. The last is past the end where the scale is fixed.
    fn places(&self, c: usize) -> [usize; PARTIALS] {
        [2 * c, 2 * c + 1, 2 * self.measured.channels.len()]
    }

    /// ½χ², its gradient and JᵀWJ, by forward derivatives.
    ///
    /// # Errors
    /// As [`TissueFitModel::images`].
    pub fn normal(&self, p: &[f64]) -> Result<NormalEquations> {
        let at = self.tissues(p);
        let one = |c: usize| -> Result<(f64, [f64; 3], [[f64; 3]; 3])> {
            let (tangent, sources) = (self.tangent(&at, c)?, self.sources(c));
            let (residuals, views) = self.weighted(c, &tangent.run(&sources));
            let free = if self.options.fix_scale { PARTIALS - 1 } else { PARTIALS };
            let columns: Vec<Vec<Vec<f64>>> = (0..free).map(|k| tangent.derivative(k, &sources)).collect();
            let (mut gradient, mut matrix) = ([0.0; 3], [[0.0; 3]; 3]);
            for (i, image) in self.measured.channels[c].images.iter().enumerate() {
                for t in 0..image.exit.len() {
                    let w = self.inverse[c][i][t] * image.exit[t];
                    if w == 0.0 {
                        continue;
                    }
                    for a in 0..free {
                        gradient[a] += views[i][t] * columns[a][i][t];
                        (0..=a).for_each(|b| matrix[a][b] += w * w * columns[a][i][t] * columns[b][i][t]);
                    }
                }
            }
            Ok((0.5 * residuals.iter().flatten().map(|r| r * r).sum::<f64>(), gradient, matrix))
        };
        let parts: Vec<_> = (0..self.measured.channels.len()).into_par_iter().map(one).collect::<Result<_>>()?;
        let n = p.len();
        let mut normal = NormalEquations { cost: 0.0, gradient: DVector::zeros(n), matrix: DMatrix::zeros(n, n) };
        for (c, (cost, gradient, matrix)) in parts.into_iter().enumerate() {
            normal.cost += cost;
            for (a, &i) in self.places(c).iter().enumerate().filter(|(_, i)| **i < n) {
                normal.gradient[i] += gradient[a];
                for (b, &j) in self.places(c).iter().enumerate().filter(|(_, j)| **j < n) {
                    normal.matrix[(i, j)] += matrix[a.max(b)][a.min(b)];
                }
            }
        }
        Ok(normal)
    }

    /// The nearest point within the range of the search, and the distance of each coordinate to it.
    fn within(&self, p: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let sigmas = 2 * self.measured.channels.len();
        let limit = |k: usize| if k < sigmas { SIGMA } else { SCALE };
        let inside: Vec<f64> = p.iter().enumerate().map(|(k, v)| v.clamp(limit(k)[0], limit(k)[1])).collect();
        let off = p.iter().zip(&inside).map(|(p, q)| p - q).collect();
        (inside, off)
    }

    /// Which coordinates are at or beyond their limits.
    pub fn at_limit(&self, p: &[f64]) -> Vec<bool> {
        self.within(p).1.iter().map(|off| *off != 0.0).collect()
    }
}

impl DifferentiableCost for TissueFitModel<'_> {
    fn parameters(&self) -> usize {
        2 * self.measured.channels.len() + usize::from(!self.options.fix_scale)
    }

    fn evaluate(&self, params: &[f64], gradient: &mut [f64]) -> f64 {
        // A point without a value ends the search at once; the rounds say why.
        if params.iter().any(|p| p.is_nan()) || progress::stop_requested() {
            return f64::NAN;
        }
        let (inside, off) = self.within(params);
        let Ok(TissueScore { residuals, gradient: by }) = self.score(&inside) else { return f64::NAN };
        gradient.copy_from_slice(&by);
        let mut cost: f64 = residuals.iter().map(|c| 0.5 * c.iter().flatten().map(|r| r * r).sum::<f64>()).sum();
        let stiffness = self.count as f64;
        for (k, off) in off.iter().enumerate().filter(|(_, off)| **off != 0.0) {
            cost += 0.5 * stiffness * off * off;
            gradient[k] = stiffness * off;
        }
        cost
    }
}
