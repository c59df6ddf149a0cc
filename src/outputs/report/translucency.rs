//! A translucency fit in pictures and words: the transmitted light under three lights, the coefficients, the thickness,
//! the light that enters, and how the fit was made.

use crate::chart::{self, AxisTitles};
use crate::colour;
use crate::maps::{BINS, ReportSideMaps, colour_bar_of};
use crate::model::{CaptionedPicture, ChannelPictures, ChartTile, MapPictures, SidePictures};
use crate::number::{plain, significant};
use crate::quantity::channel_word;
use crate::stats::{MapHistogram, quantile, sorted, widen};
use mesophyll_optics::translucency::basis::{FLAT, HALF_LIFE_2, HemisphereBasis};
use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

type Options = BTreeMap<String, String>;

/// The lights that the maps are shown under: elevation over the blade (rad), from the right of the picture.
const LIGHTS: [(&str, f64); 3] = [
    ("light straight on the blade (π/2)", FRAC_PI_2),
    ("light at π/4, from the right", FRAC_PI_4),
    ("grazing light at π/8, from the right", PI / 8.0),
];

/// The images of one wavelength: one for each coefficient, or the single value of a fixed light.
struct Stack<'a> {
    /// `R`, `G`, `B`, or empty.
    letter: &'static str,
    planes: Vec<&'a [f32]>,
}

/// `translucency.1` …, `.R1` …, `.Y` or `.R` …, in order.
fn stacks(side: &ReportSideMaps) -> Vec<Stack<'_>> {
    let get = |name: String| side.fit.get(&name);
    let mut out = Vec::new();
    for letter in ["", "R", "G", "B"] {
        let mut planes: Vec<&[f32]> = (1..).map_while(|i| get(format!("translucency.{letter}{i}"))).collect();
        if planes.is_empty() {
            planes.extend(get(format!("translucency.{}", if letter.is_empty() { "Y" } else { letter })));
        }
        if !planes.is_empty() {
            out.push(Stack { letter, planes });
        }
    }
    out
}

/// Everything that is drawn of a side.
pub fn pictures(side: &ReportSideMaps, options: &Options) -> SidePictures {
    let stacks = stacks(side);
    let count = stacks.first().map_or(0, |s| s.planes.len());
    let basis = options.get("basis").and_then(|name| HemisphereBasis::named(name)).filter(|b| b.count() == count);
    let mut maps: Vec<MapPictures> = coefficients(side, &stacks, basis, options).into_iter().collect();
    maps.extend(single(side, "thickness", "Thickness", "mm", "as the kernels take it"));
    let sky = "An even sky's light that enters, over what enters a flat open texel: relief and its own shadows";
    maps.extend(single(side, "entering", sky, "", "1 is flat and open"));
    let looks = basis.map_or_else(Vec::new, |b| looks(side, &stacks, b));
    SidePictures { section: side.section.clone(), looks, maps, ..SidePictures::default() }
}

/// Values of the good texels; the others are not drawn.
fn good(side: &ReportSideMaps, plane: &[f32], k: usize) -> f32 {
    if side.good[k] { plane[k] } else { f32::NAN }
}

/// Smallest width of a scale relative to its level: a map that is constant except for rounding shows nothing.
const LEAST: f64 = 0.01;

/// The range from the 1 % to the 99 % quantile of all planes.
fn range(side: &ReportSideMaps, planes: &[&[f32]]) -> (f64, f64) {
    let ends = planes.iter().map(|p| sorted(side.good_values(p))).filter(|v| !v.is_empty());
    let (low, high) = ends
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(quantile(&v, 0.01)), b.max(quantile(&v, 0.99))));
    let lacking = (LEAST * high.abs().max(low.abs()) - (high - low)).max(0.0);
    widen(low - 0.5 * lacking, high + 0.5 * lacking)
}

pub(crate) fn tile(
    side: &ReportSideMaps,
    plane: &[f32],
    range: (f64, f64),
    signed: bool,
    unit: &str,
    caption: String,
) -> Option<CaptionedPicture> {
    let alt = format!("{}: {caption}", side.section);
    let picture = colour::false_colour(side.map(side.detail.fit), signed, range, unit, |k| good(side, plane, k), alt)?;
    Some(CaptionedPicture { picture, caption, bar: colour_bar_of(signed, range, unit) })
}

/// Three planes as a colour picture, brightened by `gain`.
pub(crate) fn photograph(
    side: &ReportSideMaps,
    rgb: [&[f32]; 3],
    gain: f64,
    mut caption: String,
) -> Option<CaptionedPicture> {
    if (gain - 1.0).abs() > 0.005 {
        caption.push_str(&format!(", brightened {} times", significant(gain, 2)));
    }
    let alt = format!("{}: {caption}", side.section);
    let picture = colour::photograph(side.frame(side.detail.aside), rgb, gain as f32, |k| side.good[k], alt)?;
    Some(CaptionedPicture { picture, caption, bar: String::new() })
}

/// The factor that brings the 99th percentile of the brightest plane to 0.8.
pub(crate) fn gain(side: &ReportSideMaps, planes: &[&[f32]]) -> f64 {
    let (_, high) = range(side, planes);
    if high > 0.0 { 0.8 / high } else { 1.0 }
}

/// The transmitted light under [`LIGHTS`], on one scale: f, or M as a colour with three wavelengths.
fn looks(side: &ReportSideMaps, stacks: &[Stack], basis: HemisphereBasis) -> Vec<CaptionedPicture> {
    let lit = |stack: &Stack, elevation: f64| -> Vec<f32> {
        let weights: Vec<f64> =
            (0..basis.count()).map(|i| basis.value(i, [elevation.cos(), 0.0, elevation.sin()])).collect();
        (0..side.good.len())
            .map(|k| weights.iter().zip(&stack.planes).map(|(w, p)| w * f64::from(p[k])).sum::<f64>() as f32)
            .collect()
    };
    let images: Vec<Vec<Vec<f32>>> = LIGHTS.iter().map(|(_, e)| stacks.iter().map(|s| lit(s, *e)).collect()).collect();
    let all: Vec<&[f32]> = images.iter().flatten().map(Vec::as_slice).collect();
    let common = gain(side, &all);
    let (low, high) = range(side, &all);
    let pairs = LIGHTS.iter().zip(&images);
    let drawn = pairs.map(|((name, _), image)| match image.as_slice() {
        [r, g, b] => photograph(side, [r, g, b], common, format!("{}, {name}", side.section)),
        [one] => tile(side, one, (low.min(0.0), high), false, "", format!("{}, {name}", side.section)),
        _ => None,
    });
    drawn.flatten().collect()
}

/// All coefficients in one place, so that they can be compared by eye.
fn coefficients(
    side: &ReportSideMaps,
    stacks: &[Stack],
    basis: Option<HemisphereBasis>,
    options: &Options,
) -> Option<MapPictures> {
    let first = stacks.first()?;
    let what = if stacks.len() == 3 { "M (light that comes through over light that falls on the blade)" } else { "f" };
    let say = |name: &str| options.get(name).map_or("", String::as_str);
    let title = match basis {
        Some(basis) if basis.drawn().is_some() && stacks.len() == 1 => {
            format!(
                "Coefficients of {what} on {}; no unit, {} each on a flat uniform leaf",
                say("basis"),
                significant(FLAT, 3)
            )
        }
        Some(_) => format!("Coefficients of {what} on {}; no unit", say("basis")),
        None if first.planes.len() == 1 && options.contains_key("sun_elevation_deg") => {
            format!("{what} under {}; no unit", sun(options))
        }
        None => format!("Coefficients of {what}; no unit"),
    };
    let mut channels: Vec<ChannelPictures> = Vec::new();
    if let [r, g, b] = stacks {
        let all: Vec<&[f32]> = stacks.iter().flat_map(|s| s.planes.iter().copied()).collect();
        let common = gain(side, &all);
        let colours = (0..first.planes.len()).filter_map(|i| {
            photograph(side, [r.planes.get(i)?, g.planes.get(i)?, b.planes.get(i)?], common, function(basis, i))
        });
        channels.push(ChannelPictures {
            channel: "as colours".into(),
            pictures: colours.collect(),
            charts: Vec::new(),
        });
    }
    channels.extend(stacks.iter().map(|s| stack(side, s, basis)));
    Some(MapPictures {
        quantity: "translucency".into(),
        title,
        note: String::new(),
        section: side.section.clone(),
        channels,
    })
}

/// The single light of a fit without a basis. Its angles were stored in radians, so they are rounded to what was asked
/// for.
fn sun(options: &Options) -> String {
    let angle = |name: &str| match options.get(name).map(|v| v.parse::<f64>()) {
        Some(Ok(v)) => plain((v * 1e6).round() / 1e6),
        _ => "an unknown ".into(),
    };
    format!("light {}° over the blade, azimuth {}°", angle("sun_elevation_deg"), angle("sun_azimuth_deg"))
}

fn function(basis: Option<HemisphereBasis>, i: usize) -> String {
    match basis {
        Some(basis) if basis.drawn().is_some() => {
            let [x, y, z] = HALF_LIFE_2[i];
            let [azimuth, elevation] = [y.atan2(x), z.asin()].map(|a| plain(a.to_degrees().round()));
            format!("{}: of light around azimuth {azimuth}°, {elevation}° over the blade", i + 1)
        }
        Some(_) => format!("function {}", i + 1),
        None => String::new(),
    }
}

/// One wavelength's images. The three functions of a half-life basis are alike and share a scale; other functions have
/// their own.
fn stack(side: &ReportSideMaps, stack: &Stack, basis: Option<HemisphereBasis>) -> ChannelPictures {
    let alike = basis.is_some_and(|b| b.drawn().is_some());
    let common = range(side, &stack.planes);
    let pictures = stack.planes.iter().enumerate().filter_map(|(i, plane)| {
        let (low, high) = if alike { common } else { range(side, &[plane]) };
        // A function with both signs has zero in the middle of its scale.
        let signed = !alike && low < 0.0 && high > 0.0;
        let most = high.max(-low);
        tile(side, plane, if signed { (-most, most) } else { (low, high) }, signed, "", function(basis, i))
    });
    let pictures = pictures.collect();
    let histograms: Vec<MapHistogram> =
        stack.planes.iter().map(|p| MapHistogram::of(side.good_values(p), common.0, common.1, BINS)).collect();
    let names: Vec<String> =
        (1..=histograms.len()).map(|i| if histograms.len() > 1 { i.to_string() } else { String::new() }).collect();
    // The page has six colours.
    let charts = if (alike || histograms.len() == 1) && common.0 < common.1 {
        let parts: Vec<(&str, &MapHistogram)> = names.iter().map(String::as_str).zip(&histograms).collect();
        let about = format!("Histogram of the {}'s coefficients {}", side.section, channel_word(stack.letter));
        let titles = AxisTitles { x: "value", y: "share of texels", about: about.trim_end() };
        vec![ChartTile {
            svg: chart::histogram(&parts, titles, &[], false),
            caption: "Values over the texels that light comes through.".into(),
        }]
    } else {
        Vec::new()
    };
    ChannelPictures { channel: channel_word(stack.letter).into(), pictures, charts }
}

/// One map with its values.
fn single(side: &ReportSideMaps, name: &str, title: &str, unit: &str, caption: &str) -> Option<MapPictures> {
    let plane = side.fit.get(&format!("{name}.Y"))?;
    let (low, high) = range(side, &[plane]);
    let picture = tile(side, plane, (low, high), false, unit, caption.into())?;
    let histogram = MapHistogram::of(side.good_values(plane), low, high, BINS);
    let axis = if unit.is_empty() { "value".to_string() } else { format!("{name} ({unit})") };
    let about = format!("Histogram of the {}'s {name}", side.section);
    let svg =
        chart::histogram(&[("", &histogram)], AxisTitles { x: &axis, y: "share of texels", about: &about }, &[], false);
    let values = sorted(side.good_values(plane));
    let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
    let caption = format!("Values over the good texels: median {}{unit}.", plain(quantile(&values, 0.5)));
    let channel =
        ChannelPictures { channel: String::new(), pictures: vec![picture], charts: vec![ChartTile { svg, caption }] };
    Some(MapPictures {
        quantity: name.into(),
        title: title.into(),
        note: String::new(),
        section: side.section.clone(),
        channels: vec![channel],
    })
}

/// How the fit was made: pairs of a label and a sentence.
pub fn how(options: &Options) -> Vec<(&'static str, String)> {
    let say = |name: &str| options.get(name).map_or("", String::as_str);
    let channels = say("channel").split(' ').map(channel_word).collect::<Vec<_>>().join(", ");
    let mut out = Vec::new();
    let mut add = |label: &'static str, text: String| {
        if !text.is_empty() {
            out.push((label, text));
        }
    };
    add(
        "colour",
        match say("colour") {
            "substituted" => format!("as measured (ρt), times what the {channels} channel says of directions"),
            "product" => format!(
                "ρt times the light that comes through in {channels}, as the sources print it: dark veins count twice"
            ),
            "three-wavelengths" => format!("{channels}, each through the tissue"),
            other => other.into(),
        },
    );
    add(
        "tissue",
        match say("tissue") {
            "fit" => "the slab that the leaf fit found".into(),
            "table" => "the sources' table for 510 nm".into(),
            "given" => "coefficients given by hand".into(),
            other => other.into(),
        },
    );
    add(
        "light that enters",
        match say("entry") {
            "matched" => "all of it".into(),
            "albedo" => "1 − ρd of the texel".into(),
            other => other.into(),
        },
    );
    add(
        "area it is counted over",
        match say("area") {
            "facet" => "the texel's facet, 1/n_z of the texel".into(),
            "texel" => "the texel, as the sources have it".into(),
            other => other.into(),
        },
    );
    let levels = say("levels");
    add(
        "kernel",
        if levels.is_empty() { say("form").into() } else { format!("{}, {levels} thickness levels", say("form")) },
    );
    add("directions of light", say("lights").into());
    let basis =
        if options.contains_key("sun_elevation_deg") { format!("one {}", sun(options)) } else { say("basis").into() };
    add("stored", basis);
    add(
        "maps",
        if say("texel_mm").is_empty() {
            say("size").into()
        } else {
            format!("{} texels of {} mm", say("size"), say("texel_mm"))
        },
    );
    add("frame", say("frame").into());
    add("doubt", say("doubt").into());
    add("leaf fit (content hash)", say("leaf").into());
    out
}
