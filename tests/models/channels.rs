//! The map from the bands of 650, 550 and 450 nm to linear sRGB (`tone::SRGB_OF_BANDS`): it is fitted here to made-up
//! leaves, and judged by them and by measured ones. The figures of `docs/evidence/colours.md` must be those found here;
//! `MESOPHYLL_WRITE_DOCS=1` writes them again.

use crate::skips::{Need, skip};
use flate2::read::GzDecoder;
use mesophyll::base::statistics::upper_quantile;
use mesophyll::base::tone::{PictureChannels, SRGB_OF_BANDS};
use mesophyll::optics::plates::PlateIndex;
use mesophyll::sky::colour::xyz_from_rgb;
use mesophyll::sky::response::ObserverResponse;
use std::io::Read;
use std::path::Path;

/// A band of absorption (1 for each µg/cm²): its height, where it is, and its standard deviation (nm).
type Band = [f64; 3];

/// Chlorophyll in leaves, as a sum of bands near the coefficients of Féret et al. 2017 (PROSPECT-D): 1.3e-3 off at
/// most.
const CHLOROPHYLL: [Band; 9] = [
    [0.0686, 406.3, 17.4],
    [0.0547, 439.2, 13.0],
    [0.0375, 475.8, 20.6],
    [0.0048, 546.6, 12.1],
    [0.0192, 593.1, 25.7],
    [0.0149, 625.0, 12.9],
    [0.0353, 654.9, 14.0],
    [0.0619, 677.8, 10.2],
    [0.0067, 703.0, 9.1],
];
/// Carotenoids, likewise: 3e-3 off at most.
const CAROTENOID: [Band; 3] = [[0.167, 404.5, 44.6], [0.033, 446.2, 13.3], [0.094, 487.7, 26.9]];

const LEAVES: u32 = 400;
const BEGIN: &str = "<!-- figures: begin -->\n";
const END: &str = "<!-- figures: end -->\n";

fn wavelengths() -> Vec<f64> {
    (80..=140).map(|k| 5.0 * f64::from(k)).collect()
}

fn absorbed(bands: &[Band], nm: f64) -> f64 {
    bands.iter().map(|[high, at, wide]| high * (-0.5 * ((nm - at) / wide).powi(2)).exp()).sum()
}

/// The number `k` of a sequence that fills 0 to 1 evenly (van der Corput), in this base.
fn even(mut k: u32, base: u32) -> f64 {
    let (mut value, mut step) = (0.0, 1.0);
    while k > 0 {
        step /= f64::from(base);
        value += step * f64::from(k % base);
        k /= base;
    }
    value
}

/// A leaf's three bands and its linear sRGB.
type Seen = ([f64; 3], [f64; 3]);

fn seen(spectrum: &[f64], weights: &[[f64; 3]]) -> Seen {
    let at = |nm: f64| spectrum[wavelengths().iter().position(|w| *w == nm).unwrap()];
    let sum = |c: usize| spectrum.iter().zip(weights).map(|(v, w)| v * w[c]).sum();
    ([650.0, 550.0, 450.0].map(at), [0, 1, 2].map(sum))
}

/// What made-up leaves reflect and let through: from 5 to 100 µg/cm² of chlorophyll, with carotenoids, a brown pigment,
/// and gloss.
fn made_up() -> Vec<Seen> {
    let weights = ObserverResponse::Srgb.weights(&wavelengths()).unwrap();
    let plate = PlateIndex::new(1.47);
    let mut out = Vec::new();
    for k in 20..20 + LEAVES {
        let [a, b, c, d, e] = [2, 3, 5, 7, 11].map(|base| even(k, base));
        let chlorophyll = 5.0 * 20f64.powf(a);
        let carotenoid = chlorophyll * (0.12 + 0.18 * b) + 1.0;
        let brown = 0.13 * d * d;
        let depth = |nm: f64| {
            chlorophyll * absorbed(&CHLOROPHYLL, nm)
                + carotenoid * absorbed(&CAROTENOID, nm)
                + brown * ((400.0 - nm) / 220.0).exp()
                + 0.02
        };
        let leaf: Vec<[f64; 2]> =
            wavelengths().iter().map(|nm| plate.values(depth(*nm), 1.1 + 1.4 * c, 1.2 * e)).collect();
        out.extend([0, 1].map(|which| seen(&leaf.iter().map(|v| v[which]).collect::<Vec<_>>(), &weights)));
    }
    out
}

/// What the leaves of LOPEX93 reflect and let through.
fn measured() -> Option<Vec<Seen>> {
    let file = std::env::var_os("MESOPHYLL_DATA").map(|d| Path::new(&d).join("leaves/lopex93_spectra.csv.gz"));
    let file = file.filter(|f| f.exists())?;
    let mut table = String::new();
    GzDecoder::new(std::fs::File::open(file).unwrap()).read_to_string(&mut table).unwrap();
    let mut reader = csv::Reader::from_reader(table.as_bytes());
    let header = reader.headers().unwrap().clone();
    let weights = ObserverResponse::Srgb.weights(&wavelengths()).unwrap();
    let mut out = Vec::new();
    for row in reader.records().map(Result::unwrap) {
        for letter in ["R", "T"] {
            let cell = |nm: &f64| row[header.iter().position(|h| h == format!("{letter}{nm}")).unwrap()].parse().ok();
            let spectrum: Option<Vec<f64>> = wavelengths().iter().map(cell).collect();
            out.extend(spectrum.map(|s| seen(&s, &weights)));
        }
    }
    Some(out)
}

/// The least squares of a·(r − g) + b·(b − g) = want − g, so that the three weights sum to 1.
fn fitted(all: &[Seen]) -> [[f64; 3]; 3] {
    std::array::from_fn(|c| {
        let [mut aa, mut ab, mut bb, mut ay, mut by] = [0.0; 5];
        for ([r, g, b], want) in all {
            let (x, z, y) = (r - g, b - g, want[c] - g);
            (aa, ab, bb) = (aa + x * x, ab + x * z, bb + z * z);
            (ay, by) = (ay + x * y, by + z * y);
        }
        let determinant = aa * bb - ab * ab;
        let (first, last) = ((ay * bb - by * ab) / determinant, (by * aa - ay * ab) / determinant);
        [first, 1.0 - first - last, last]
    })
}

/// CIELAB under D65.
fn lab(rgb: [f64; 3]) -> [f64; 3] {
    let (xyz, white) = (xyz_from_rgb(rgb), xyz_from_rgb([1.0; 3]));
    let f = |t: f64| if t > (6f64 / 29.0).powi(3) { t.cbrt() } else { t * (29f64 / 6.0).powi(2) / 3.0 + 4.0 / 29.0 };
    let [x, y, z] = [0, 1, 2].map(|c| f(xyz[c] / white[c]));
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// Root mean square over leaves and channels in linear sRGB; mean and 95 % of ΔE*ab.
fn errors(all: &[Seen], map: [[f64; 3]; 3]) -> [f64; 3] {
    let mapped = |bands: &[f64; 3]| map.map(|row| (0..3).map(|k| row[k] * bands[k]).sum::<f64>());
    let (mut squares, mut apart) = (0.0, Vec::new());
    for (bands, want) in all {
        let found = mapped(bands);
        squares += (0..3).map(|c| (found[c] - want[c]).powi(2)).sum::<f64>();
        let (a, b) = (lab(found), lab(*want));
        apart.push((0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f64>().sqrt());
    }
    let n = all.len() as f64;
    let mean = apart.iter().sum::<f64>() / n;
    [(squares / (3.0 * n)).sqrt(), mean, upper_quantile(&mut apart, 95, 100).unwrap_or(f64::NAN)]
}

fn rows(name: &str, all: &[Seen]) -> String {
    let row = |how: &str, channels: PictureChannels| {
        let [rms, mean, most] = errors(all, channels.to_srgb());
        format!("| {name} | {how} | {rms:.4} | {mean:.1} | {most:.1} |\n")
    };
    row("as if they were sRGB", PictureChannels::Srgb) + &row("by the map", PictureChannels::Bands)
}

/// The map is the least squares over made-up leaves, and it is as good as the page says: also on measured leaves, which
/// it was not fitted to.
#[test]
fn the_map_is_the_fit_and_as_good_as_the_page_says() {
    let leaves = made_up();
    let fit = fitted(&leaves);
    println!("{fit:.4?}");
    for (found, stated) in fit.iter().flatten().zip(SRGB_OF_BANDS.iter().flatten()) {
        assert!((found - stated).abs() < 1e-4, "{fit:.5?}");
    }
    let mut lines = vec![rows("made-up leaves", &leaves)];
    match measured() {
        Some(real) => lines.push(rows("LOPEX93", &real)),
        None => skip(Need::Data, "MESOPHYLL_DATA has no leaves/lopex93_spectra.csv.gz"),
    }
    lines.iter().for_each(|l| print!("{l}"));
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/evidence/colours.md");
    let text = std::fs::read_to_string(&page).unwrap();
    let (before, rest) = text.split_once(BEGIN).unwrap();
    let (figures, after) = rest.split_once(END).unwrap();
    if std::env::var_os("MESOPHYLL_WRITE_DOCS").is_some() && lines.len() == 2 {
        let head = "| leaves | shown | RMS | mean ΔE | 95 % of ΔE |\n|---|---|---|---|---|\n";
        std::fs::write(page, [before, BEGIN, head, &lines.concat(), END, after].concat()).unwrap();
        return;
    }
    lines.iter().for_each(|l| assert!(figures.contains(l.as_str()), "the page has other figures than\n{l}"));
}
