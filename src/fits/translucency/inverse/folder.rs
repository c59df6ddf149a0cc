//! What a fit of the tissue writes into `fit.toml` and `times.toml`. There is one section, `all`, and there are no
//! maps.

use super::comparison::{SlabDifference, SlabReference, explain};
use super::run::{Options, TissueFitTruth};
use super::{BeamIncidence, TissueCoefficients, TissueFit, TissueMeasurement};
use crate::record::{FitParameter, FitRecord, FitTimes, RecordSection, TruthError};
use mesophyll_base::statistics::quantile;
use mesophyll_optics::translucency::convolution::TotalsSource;

/// Writes the result into the record.
pub fn describe(
    record: &mut FitRecord,
    measured: &TissueMeasurement,
    fitted: &TissueFit,
    options: &Options,
    slab: &SlabReference,
    differences: &[SlabDifference],
    truth: Option<&TissueFitTruth>,
) {
    record.termination = Some(fitted.termination);
    let names: Vec<&str> = measured.channels.iter().map(|c| c.name.as_str()).collect();
    let mut say = |name: &str, text: String| record.options.insert(name.into(), text);
    say("channels", names.join(" "));
    say("entry", options.entry.name().into());
    say("form", "thin".into());
    say("totals", if options.fit.totals == TotalsSource::Transport { "transport" } else { "form" }.into());
    say(
        "incidence",
        if options.fit.incidence == BeamIncidence::Slant { "each beam's own" } else { "along the normal" }.into(),
    );
    say("levels", options.fit.levels.to_string());
    say("thickness_scale", if options.fit.fix_scale { "fixed" } else { "fitted" }.into());
    say("g", format!("{:?}", options.g));
    say("start", format!("{:?}", options.start).to_lowercase());
    let scale_err = if options.fit.fix_scale { 0.0 } else { fitted.certainty.stderr.last().copied().unwrap_or(0.0) };
    say("comparison", explain(&names, differences, &fitted.tissues, scale_err));
    for (k, weak) in fitted.certainty.weak.iter().enumerate() {
        let freely =
            if weak.stderr.is_finite() { format!("to {:.0} %", 100.0 * weak.stderr) } else { "not at all".into() };
        say(&format!("weak_{}", k + 1), format!("determined {freely}: {}", weak.text));
    }
    let all = section(measured, fitted, options, slab, differences, truth);
    record.sections.insert("all".into(), all);
}

fn section(
    measured: &TissueMeasurement,
    fitted: &TissueFit,
    options: &Options,
    slab: &SlabReference,
    differences: &[SlabDifference],
    truth: Option<&TissueFitTruth>,
) -> RecordSection {
    let (t, certainty) = (&fitted.tissues, &fitted.certainty);
    let mut s = RecordSection {
        condition: Some(certainty.condition).filter(|c| c.is_finite()),
        rank: Some(certainty.rank),
        ..RecordSection::default()
    };
    let channels = t.sigma_a.len();
    let place = |c: usize, q: usize| 2 * c + q;
    let mut put = |name: &str, unit: &str, q: usize, value: Vec<f64>, factor: f64, shown: &str| {
        let undetermined = (0..channels).filter_map(|c| {
            certainty
                .undetermined(place(c, q), value[c])
                .map(|why| why.replacen("sigma_s.", &format!("{shown}."), usize::from(q == 1)))
        });
        let param = FitParameter {
            stderr: (0..channels).map(|c| value[c] * certainty.stderr[place(c, q)]).collect(),
            undetermined: undetermined.collect(),
            unit: unit.into(),
            value: value.iter().map(|v| v * factor).collect(),
            ..FitParameter::default()
        };
        let stderr = param.stderr.iter().map(|e| e * factor).collect();
        s.params.insert(name.into(), FitParameter { stderr, ..param });
    };
    put("sigma_a", "1/mm", 0, t.sigma_a.clone(), 1.0, "sigma_a");
    put("sigma_s_reduced", "1/mm", 1, t.reduced.clone(), 1.0, "sigma_s_reduced");
    put("sigma_s", "1/mm", 1, t.reduced.clone(), 1.0 / (1.0 - options.g), "sigma_s");
    let g = FitParameter {
        value: vec![f64::NAN],
        stderr: vec![f64::INFINITY],
        unit: String::new(),
        undetermined: vec![format!(
            "g: only (1 - g) sigma_s is in the model, in its unscattered light too; sigma_s is for g = {}",
            options.g
        )],
        ..FitParameter::default()
    };
    s.params.insert("g".into(), g);
    let scale = match options.fit.fix_scale {
        true => FitParameter { value: vec![t.scale], stderr: vec![0.0], ..FitParameter::default() },
        false => FitParameter {
            value: vec![t.scale],
            stderr: vec![t.scale * certainty.stderr[2 * channels]],
            unit: String::new(),
            undetermined: certainty.undetermined(2 * channels, t.scale).into_iter().collect(),
            ..FitParameter::default()
        },
    };
    s.params.insert("thickness_scale".into(), scale);
    s.correlation_names.clone_from(&certainty.names);
    s.correlation.clone_from(&certainty.correlation);
    for (c, r) in measured.channels.iter().zip(&fitted.residuals) {
        s.residuals.insert(c.name.clone(), *r);
    }
    s.counts.insert("readings".into(), fitted.residuals.iter().map(|r| r.samples).sum());
    s.counts.insert("photographs".into(), measured.channels.first().map_or(0, |c| c.images.len()));
    let mut figure = |name: String, value: f64| {
        if value.is_finite() {
            s.figures.insert(name, value);
        }
    };
    figure("reduced_chi2".into(), fitted.reduced_chi2);
    figure("expected_reduced_chi2".into(), fitted.expected_chi2);
    figure("error_factor_beyond_noise".into(), certainty.misfit);
    figure("noise_relative".into(), measured.noise.relative);
    figure("evaluations".into(), fitted.evaluations as f64);
    for (c, (d, channel)) in differences.iter().zip(&measured.channels).enumerate() {
        let n = &channel.name;
        let l = 1.0 / (t.sigma_a[c] + t.reduced[c]);
        figure(format!("texel_over_mean_free_path_{n}"), measured.texel_mm / l);
        figure(format!("slab_sigma_a_{n}"), slab.sigma_a[c]);
        figure(format!("slab_sigma_s_{n}"), slab.sigma_s[c]);
        figure(format!("sigma_a_off_slab_in_errors_{n}"), d.sigma_a[0] / d.sigma_a[1]);
        figure(format!("sigma_s_off_slab_in_errors_{n}"), d.sigma_s[0] / d.sigma_s[1]);
        figure(format!("rho_t_slab_{n}"), d.rho_t[0]);
        figure(format!("rho_t_{n}"), d.rho_t[1]);
    }
    if let Some(truth) = truth {
        let error = |found: &[f64], want: &[f64], stderr: &[f64]| {
            let mut off: Vec<f64> = found.iter().zip(want).map(|(a, b)| (a / b - 1.0).abs()).collect();
            let inside =
                found.iter().zip(want).zip(stderr).filter(|((a, b), e)| (*a / *b).ln().abs() <= 1.96 * **e).count();
            let coverage95 = Some(inside as f64 / found.len() as f64);
            TruthError {
                median_relative: quantile(&mut off, 0.5).unwrap_or(f64::NAN),
                p99_relative: quantile(&mut off, 1.0).unwrap_or(f64::NAN),
                coverage95,
                judged: Some(found.len()),
            }
        };
        let errors = |q: usize| (0..channels).map(|c| certainty.stderr[place(c, q)]).collect::<Vec<_>>();
        s.truth.insert("sigma_a".into(), error(&t.sigma_a, &truth.0.sigma_a, &errors(0)));
        s.truth.insert("sigma_s_reduced".into(), error(&t.reduced, &truth.0.reduced, &errors(1)));
        if !options.fit.fix_scale {
            s.truth.insert(
                "thickness_scale".into(),
                error(&[t.scale], &[truth.0.scale], &certainty.stderr[2 * channels..]),
            );
        }
    }
    s
}

/// Largest relative error of any parameter.
pub fn off(found: &TissueCoefficients, truth: &TissueCoefficients) -> f64 {
    let pairs = found.sigma_a.iter().zip(&truth.sigma_a).chain(found.reduced.iter().zip(&truth.reduced));
    pairs.map(|(a, b)| (a / b - 1.0).abs()).fold((found.scale / truth.scale - 1.0).abs(), f64::max)
}

/// The trace, with errors to the truth where it is known.
pub fn times(times: &mut FitTimes, fitted: &TissueFit, truth: Option<&TissueFitTruth>) {
    let row = |(row, point): (&mesophyll_base::solvers::TraceRow, &TissueCoefficients)| {
        let mut row = *row;
        row.truth_error = truth.map(|t| off(point, &t.0));
        row
    };
    times.traces.insert("tissue".into(), fitted.trace.iter().zip(&fitted.points).map(row).collect());
}
