//! The pictures of a side's maps: the fit, the truth where it is known, the difference, and charts of the errors.

use super::{BINS, Channel, ReportSideMaps, colour_bar_of};
use crate::chart::{self, AxisTitles};
use crate::colour::{self, MapFrame};
use crate::model::{CaptionedPicture, ChannelPictures, ChartTile, LegendItem, MapPictures, SidePictures};
use crate::number::{percent, plain};
use crate::quantity::{self, channel_word, known};
use crate::stats::{MapHistogram, MapSummary, quantile, sorted, widen};
use mesophyll_files::quantity::{Quantity, split};
use rayon::prelude::*;
use std::collections::BTreeMap;

impl ReportSideMaps {
    /// Everything that is drawn of the side.
    pub fn pictures(&self, defects: &BTreeMap<String, String>) -> SidePictures {
        let (fate, legend) = self.fate(defects);
        let (residual, residual_histogram) = self.residual();
        let channels = self.channels();
        let drawn: Vec<Option<ChannelPictures>> = channels.par_iter().map(|c| self.channel_pictures(c)).collect();
        let mut maps: Vec<MapPictures> = Vec::new();
        for (c, drawn) in channels.iter().zip(drawn) {
            let (name, _) = split(c.name);
            let Some(drawn) = drawn else { continue };
            match maps.iter_mut().find(|m| m.quantity == name) {
                Some(m) => m.channels.push(drawn),
                None => maps.push(MapPictures {
                    quantity: name.into(),
                    title: quantity::title(name),
                    note: self.notes.get(name).cloned().unwrap_or_default(),
                    section: self.section.clone(),
                    channels: vec![drawn],
                }),
            }
        }
        SidePictures {
            section: self.section.clone(),
            looks: self.looks(),
            fate,
            legend,
            residual,
            residual_histogram,
            maps,
        }
    }

    /// ρd and ρt as colours, brightened to fill the range.
    fn looks(&self) -> Vec<CaptionedPicture> {
        let mut out = Vec::new();
        let both = [(Quantity::RhoD, "reflected light (ρd)"), (Quantity::RhoT, "transmitted light (ρt)")];
        for (quantity, words) in both {
            let Some([r, g, b]) = self.fit.three(quantity) else { continue };
            let brightest = [r, g, b].iter().map(|p| quantile(&sorted(self.good_values(p)), 0.99)).fold(0.0, f64::max);
            if brightest <= 0.0 {
                continue;
            }
            let gain = (0.8 / brightest).max(1.0) as f32;
            let mut caption = format!("{}: {words}", self.section);
            if gain > 1.005 {
                caption.push_str(&format!(", brightened {gain:.1} times"));
            }
            if let Some(picture) =
                colour::photograph(self.frame(self.detail.aside), [r, g, b], gain, |i| self.good[i], caption.clone())
            {
                out.push(CaptionedPicture { picture, caption, bar: String::new() });
            }
        }
        out
    }

    /// Which texels are good, outside the leaf, or defective, and in which way.
    fn fate(&self, defects: &BTreeMap<String, String>) -> (Option<CaptionedPicture>, Vec<LegendItem>) {
        const GOOD: [u8; 3] = [0x9f, 0xb8, 0xa4];
        const HUES: [[u8; 3]; 7] = [
            [0xd1, 0x49, 0x3f],
            [0xe0, 0x92, 0x2e],
            [0x7a, 0x5f, 0xc0],
            [0x2f, 0x80, 0xc2],
            [0xc2, 0x4f, 0x9a],
            [0x8a, 0x6d, 0x3b],
            [0x1f, 0x9e, 0x98],
        ];
        let Some(mask) = self.fit.scalar(Quantity::Mask) else { return (None, Vec::new()) };
        let mut codes: Vec<i32> = mask.iter().filter(|m| **m < -0.5).map(|m| m.round() as i32).collect();
        codes.sort_unstable_by(|a, b| b.cmp(a));
        codes.dedup();
        let name_of = |code: i32| {
            let own = [code.to_string(), code.abs().to_string()];
            own.iter()
                .find_map(|k| defects.get(k))
                .map_or_else(|| format!("defect {code}, not named in fit.toml"), |n| n.replace('_', " "))
        };
        let count = |want: i32| mask.iter().filter(|m| m.round() as i32 == want).count();
        let hex = |c: [u8; 3]| format!("#{:02x}{:02x}{:02x}", c[0], c[1], c[2]);
        let mut colours = vec![GOOD];
        let mut legend = vec![LegendItem { colour: hex(GOOD), name: "good".into(), texels: count(1) }];
        for (k, code) in codes.iter().enumerate() {
            let hue = HUES[k % HUES.len()];
            colours.push(hue);
            legend.push(LegendItem { colour: hex(hue), name: name_of(*code), texels: count(*code) });
        }
        let code = |i: usize| match mask[i].round() as i32 {
            0 => None,
            c if c < 0 => codes.iter().position(|k| *k == c).map(|k| k + 1),
            _ => Some(0),
        };
        let alt = format!("{}: the fate of every texel", self.section);
        let picture = colour::categories(self.frame(1), &colours, code, alt);
        let caption =
            "Which texels are good, and what was wrong with the others. Outside the leaf the picture is empty."
                .to_string();
        (picture.map(|picture| CaptionedPicture { picture, caption, bar: String::new() }), legend)
    }

    fn residual(&self) -> (Option<CaptionedPicture>, Option<String>) {
        let Some(chi2) = self.fit.scalar(Quantity::ReducedChi2) else { return (None, None) };
        let values = sorted(self.good_values(chi2));
        let Some(s) = MapSummary::of(&values) else { return (None, None) };
        let range = (0.0, s.p99.max(2.0));
        let shown = |i: usize| if self.good[i] { chi2[i] } else { f32::NAN };
        let caption = format!(
            "Reduced χ² of each texel (about 1 where the model explains its readings): median {}, 99 % below {}, worst \
             {}.",
            plain(s.median),
            plain(s.p99),
            plain(s.max)
        );
        let frame = self.map(self.detail.fit);
        let picture = colour::false_colour(frame, false, range, "", shown, caption.clone());
        let bar = colour_bar_of(false, range, "");
        let histogram = MapHistogram::of(values.iter().copied(), range.0, range.1 * 1.1, BINS);
        let titles = AxisTitles {
            x: "reduced χ² of a texel",
            y: "share of texels",
            about: "Histogram of the reduced χ² of the texels",
        };
        let chart = chart::histogram(&[("", &histogram)], titles, &[(1.0, "1 = as noisy as stated")], false);
        (picture.map(|picture| CaptionedPicture { picture, caption, bar }), Some(chart))
    }

    fn channel_pictures(&self, c: &Channel) -> Option<ChannelPictures> {
        let (name, letter) = split(c.name);
        let signed = known(name).is_some_and(|q| q.signed);
        let unit = known(name).map_or("", |q| q.unit);
        let least = if matches!(letter, "R" | "B") { self.detail.colours } else { 1 };
        let (frame, beside) = (self.map(least.max(self.detail.fit)), self.map(least.max(self.detail.others)));
        let words =
            format!("{} {} {}", self.section, quantity::symbol(name), channel_word(letter)).trim_end().to_string();
        let good = |samples: &'_ [f32], i: usize| if self.good[i] { samples[i] } else { f32::NAN };

        let fit_summary = MapSummary::of(&sorted(self.good_values(c.fit)))?;
        let truth_summary = c.truth.and_then(|t| MapSummary::of(&sorted(self.good_values(t))));
        let (mut low, mut high) = (fit_summary.p01, fit_summary.p99);
        if let Some(t) = truth_summary {
            (low, high) = (low.min(t.p01), high.max(t.p99));
        }
        if signed {
            let most = low.abs().max(high.abs());
            (low, high) = (-most, most);
        }
        let range = widen(low, high);
        let draw = |samples: &[f32], frame: MapFrame, caption: String| {
            let picture =
                colour::false_colour(frame, signed, range, unit, |i| good(samples, i), format!("{words}: {caption}"))?;
            Some(CaptionedPicture { picture, caption, bar: colour_bar_of(signed, range, unit) })
        };
        let mut pictures: Vec<CaptionedPicture> = draw(c.fit, frame, "fit".into()).into_iter().collect();
        if let Some(truth) = c.truth.filter(|_| truth_summary.is_some()) {
            pictures.extend(draw(truth, beside, "truth".into()));
            let difference = |i: usize| if self.good[i] { c.fit[i] - truth[i] } else { f32::NAN };
            pictures.extend(difference_picture(beside, difference, unit, &words, "fit − truth"));
        }

        let symbol = quantity::symbol(name);
        let axis = if unit.is_empty() { symbol.clone() } else { format!("{symbol} ({unit})") };
        let mut charts = Vec::new();
        let room = 0.15 * (range.1 - range.0);
        let (from, to) = (if range.0 >= 0.0 { (range.0 - room).max(0.0) } else { range.0 - room }, range.1 + room);
        let fit_histogram = MapHistogram::of(self.good_values(c.fit), from, to, BINS);
        let titles = AxisTitles { x: &axis, y: "share of texels", about: &format!("Histogram of {words}") };
        let truth_histogram = c.truth.map(|t| MapHistogram::of(self.good_values(t), from, to, BINS));
        let mut parts = vec![(if truth_histogram.is_some() { "fit" } else { "" }, &fit_histogram)];
        parts.extend(truth_histogram.as_ref().map(|h| ("truth", h)));
        charts.push(ChartTile {
            svg: chart::histogram(&parts, titles, &[], false),
            caption: "Values over the good texels.".into(),
        });
        charts.extend(self.error_charts(c, &axis, &words));
        Some(ChannelPictures { channel: channel_word(letter).into(), pictures, charts })
    }

    /// Standard errors, and how they compare with the true errors where the truth is known.
    fn error_charts(&self, c: &Channel, axis: &str, words: &str) -> Vec<ChartTile> {
        let mut charts = Vec::new();
        let z: Vec<f32> = self.scores(c).collect();
        if !z.is_empty() {
            let inside = z.iter().filter(|z| z.abs() <= 1.96).count() as f64 / z.len() as f64;
            let h = MapHistogram::of(z.iter().copied(), -4.5, 4.5, BINS);
            let about = format!("Histogram of the errors of {words} in standard errors");
            let titles = AxisTitles { x: "(fit − truth) / standard error", y: "density", about: &about };
            let mut caption = format!(
                "Errors in units of the stated standard errors: {} of the truths lie within 95 % intervals.",
                percent(inside)
            );
            if let Some(why) = self.unjudged.as_ref().filter(|_| self.is_unjudged(c)) {
                caption.push_str(&format!(" The share is not judged: {why}."));
            }
            charts.push(ChartTile { svg: chart::histogram(&[("texels", &h)], titles, &[], true), caption });
        }
        if let Some(error) = c.error {
            let values = sorted(self.good_values(error));
            if let Some(s) = MapSummary::of(&values).filter(|s| s.max > 0.0) {
                let (_, top) = widen(0.0, s.p99 * 1.05);
                let h = MapHistogram::of(values.iter().copied(), 0.0, top, BINS);
                let x = format!("standard error of {axis}");
                let titles = AxisTitles {
                    x: &x,
                    y: "share of texels",
                    about: &format!("Histogram of the standard errors of {words}"),
                };
                charts.push(ChartTile {
                    svg: chart::histogram(&[("", &h)], titles, &[], false),
                    caption: format!("Standard errors: median {}, 99 % below {}.", plain(s.median), plain(s.p99)),
                });
            }
        }
        charts
    }
}

/// A difference on the diverging scale, symmetric about zero.
pub fn difference_picture(
    frame: MapFrame,
    value: impl Fn(usize) -> f32,
    unit: &str,
    words: &str,
    caption: &str,
) -> Option<CaptionedPicture> {
    let sizes = sorted((0..frame.width * frame.height).map(&value).map(f32::abs));
    let (_, most) = widen(0.0, quantile(&sizes, 0.99));
    let range = if sizes.is_empty() { return None } else { (-most, most) };
    let picture = colour::false_colour(frame, true, range, unit, value, format!("{words}: {caption}"))?;
    Some(CaptionedPicture { picture, caption: caption.into(), bar: colour_bar_of(true, range, unit) })
}
