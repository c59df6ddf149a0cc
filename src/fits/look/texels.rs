//! From pictures to texels: the outline by the opacity, means over blocks of pixels, and what sends back more light
//! than falls on it.

use super::{GreenConvention, Look, TEXELS};
use crate::leaf_folder::filling;
use crate::{Error, Result};
use mesophyll_base::image::ImageSize;
use mesophyll_capture::lightbox::pieces;
use mesophyll_capture::photo::colours::{ColourPicture, PictureEncoding, read as picture};
use mesophyll_capture::photo::manifest::TransferCurve;
use mesophyll_files::progress;
use rayon::prelude::*;
use std::path::Path;

/// Share of the leaf's texels that may send back more light than falls on them; they are scaled and counted.
const MOST_BEYOND: f64 = 0.01;
/// Rounding that a sum of three shares may have.
const ROUNDING: f64 = 1e-6;
/// Fewest texels of a leaf.
const FEWEST: usize = 100;
/// A picture without a region shows several leaves where a second piece is as large as this share of the largest.
const SEVERAL: f64 = 0.1;
/// Lengths of coded normals, and the share of them that must be such.
const LENGTHS: std::ops::RangeInclusive<f32> = 0.9..=1.1;
const OF_LENGTH: f64 = 0.95;

/// The leaf's texels, in the columns of the front.
#[derive(Debug)]
pub(super) struct Texels {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Size of a texel (mm).
    pub texel_mm: f64,
    /// How much of each texel the leaf covers, with one half at the stated cutoff.
    pub cover: Vec<f32>,
    /// Whether a texel is on the leaf.
    pub on: Vec<bool>,
    /// ρd of front and back.
    pub rho_d: [Vec<[f32; 3]>; 2],
    /// ρt, the same from both sides.
    pub rho_t: Vec<[f32; 3]>,
    /// Normals of the front: x right, y up, z out.
    pub normal: Vec<[f32; 3]>,
    /// The curve of the albedo.
    pub transfer: TransferCurve,
    /// Texels that were scaled, because they would have sent back more light than falls on them.
    pub scaled: usize,
    /// What is unusual, a sentence each.
    pub warnings: Vec<String>,
}

/// The rectangle of the pictures that is the leaf, and the grid of its texels.
#[derive(Debug, Clone, Copy)]
struct Part {
    /// Left, top, width and height (pixels).
    region: [usize; 4],
    /// Whether that is all of the picture.
    whole: bool,
    width: usize,
    height: usize,
}

impl Part {
    fn new(look: &Look, picture: &ColourPicture) -> Result<Part> {
        let (w, h) = (picture.width, picture.height);
        let region = look.region.unwrap_or([0, 0, w, h]);
        let [left, top, width, height] = region;
        let inside =
            |at: usize, length: usize, all: usize| length > 0 && at.checked_add(length).is_some_and(|e| e <= all);
        if !inside(left, width, w) || !inside(top, height, h) {
            let expected = format!("left, top, width and height inside the picture of {w}x{h} pixels");
            return Err(Error::unexpected(&look.albedo, "region", format!("{region:?}"), expected));
        }
        // The maps cover the region and nothing else, so that texture coordinates over it hold for them too.
        let block = width.max(height).div_ceil(look.texels.unwrap_or(TEXELS));
        let [columns, rows] = [width, height].map(|n| n.div_ceil(block));
        Ok(Part { region, whole: region == [0, 0, w, h], width: columns, height: rows })
    }

    /// The pixels of the region in the `at`-th of `count` parts of `length` pixels.
    fn range(at: usize, count: usize, length: usize) -> std::ops::Range<usize> {
        at * length / count..(at + 1) * length / count
    }

    /// The pixels of texel `k`, by their index in a picture of `columns` columns.
    fn pixels(&self, k: usize, columns: usize) -> impl Iterator<Item = usize> + use<> {
        let [left, top, width, height] = self.region;
        let across = Part::range(k % self.width, self.width, width);
        let down = Part::range(k / self.width, self.height, height);
        down.flat_map(move |j| across.clone().map(move |i| (top + j) * columns + left + i))
    }

    /// A value for each texel.
    fn each<T: Send>(&self, of: impl Fn(usize) -> T + Send + Sync) -> Vec<T> {
        (0..self.width * self.height).into_par_iter().map(of).collect()
    }

    /// The first three numbers of a picture, averaged over each texel with `weight`; NaN where nothing has a weight.
    fn means(&self, of: &ColourPicture, weight: &[f32]) -> Vec<[f32; 3]> {
        self.each(|k| {
            let (mut sum, mut all) = ([0.0f64; 3], 0.0);
            for p in self.pixels(k, of.width).filter(|p| weight[*p] > 0.0) {
                let w = f64::from(weight[p]);
                all += w;
                (0..3).for_each(|c| sum[c] += w * f64::from(of.pixels[p][c]));
            }
            sum.map(|v| if all > 0.0 { (v / all) as f32 } else { f32::NAN })
        })
    }
}

/// Reads the pictures of a look.
///
/// # Errors
/// [`Error::Input`] for a picture that cannot be read, has another size than the albedo, or contradicts what is stated.
pub(super) fn read(look: &Look) -> Result<Texels> {
    let albedo = picture(&look.albedo, PictureEncoding::Light(look.transfer))?;
    let same = |path: &Path, meaning: PictureEncoding| -> Result<ColourPicture> {
        let found = picture(path, meaning)?;
        if (found.width, found.height) != (albedo.width, albedo.height) {
            let expected = format!("{}x{} as the albedo has", albedo.width, albedo.height);
            return Err(Error::input(
                path,
                format!("found {}x{} pixels, expected {expected}", found.width, found.height),
            ));
        }
        Ok(found)
    };
    let part = Part::new(look, &albedo)?;
    let opacity: Vec<f32> = match &look.opacity {
        Some(path) => same(path, PictureEncoding::Numbers)?.pixels.iter().map(|p| (p[0] + p[1] + p[2]) / 3.0).collect(),
        None if albedo.has_opacity => albedo.pixels.iter().map(|p| p[3]).collect(),
        None => {
            let what = "the file holds no opacity, and no picture of it is stated: nothing says where the leaf ends; \
                        expected opacity = a picture, or a file with alpha";
            return Err(Error::field(&look.albedo, "opacity", what));
        }
    };
    let mut warnings = Vec::new();
    let (cover, on) = outline(look, &part, &opacity, albedo.width, &mut warnings)?;
    let weight: Vec<f32> = opacity.iter().map(|o| o.max(0.0)).collect();
    // Texels beside the leaf take the values of the nearest one on it, so that interpolation at the rim stays there.
    let means = |of: &ColourPicture| -> Vec<[f32; 3]> {
        let mut planes = [part.means(of, &weight)];
        filling::nearest(&mut planes, &on, part.width, part.height);
        let [plane] = planes;
        plane
    };
    let front = means(&albedo);
    let back = look.back.as_ref().map(|path| same(path, PictureEncoding::Light(look.transfer))).transpose()?;
    let back = back.map_or_else(|| front.clone(), |back| means(&back));
    let rho_t = through(look, &front, same, means)?;
    let normal = match &look.normal {
        None => vec![[0.0, 0.0, 1.0]; on.len()],
        Some(path) => normals(look, path, &part, &same(path, PictureEncoding::Numbers)?, &weight, &on, &mut warnings)?,
    };
    let texel_mm = look.width_mm.unwrap_or(f64::NAN) / part.width as f64;
    let mut out = Texels {
        width: part.width,
        height: part.height,
        texel_mm,
        cover,
        on,
        rho_d: [front, back],
        rho_t,
        normal,
        transfer: albedo.transfer,
        scaled: 0,
        warnings,
    };
    out.conserve(look)?;
    out.warnings.iter().for_each(|what| progress::say(format_args!("warning: {}: {what}", look.albedo.display())));
    Ok(out)
}

/// How much of each texel is covered, with one half at the cutoff, and which texels are the leaf's.
fn outline(
    look: &Look,
    part: &Part,
    opacity: &[f32],
    columns: usize,
    warnings: &mut Vec<String>,
) -> Result<(Vec<f32>, Vec<bool>)> {
    let path = look.opacity.as_ref().unwrap_or(&look.albedo);
    let cutoff = look.cutoff() as f32;
    let mut cover = part.each(|k| {
        let (sum, count) = part.pixels(k, columns).fold((0.0f32, 0.0), |(s, n), p| (s + opacity[p], n + 1.0));
        let mean = (sum / count).clamp(0.0, 1.0);
        if mean < cutoff { 0.5 * mean / cutoff } else { 0.5 + 0.5 * (mean - cutoff) / (1.0 - cutoff) }
    });
    let (w, h) = (part.width, part.height);
    let inside: Vec<bool> = cover.iter().map(|c| *c >= 0.5).collect();
    let texels = w * h;
    let count = inside.iter().filter(|on| **on).count();
    if count < FEWEST || count == texels {
        let found = if count < FEWEST { format!("only {count}") } else { "every one".into() };
        let what =
            format!("{found} of {texels} texels is opaque at a cutoff of {cutoff}; expected the shape of a leaf");
        return Err(Error::field(path, "opacity", what));
    }
    let size = ImageSize::new(w, h);
    let (label, sizes) = pieces(&inside, size);
    let mut order: Vec<usize> = (1..sizes.len()).collect();
    order.sort_unstable_by_key(|&p| (usize::MAX - sizes[p], p));
    let largest = order[0];
    let touches: Vec<bool> = {
        let mut touches = vec![false; sizes.len()];
        let rim = |k: usize| size.position(k).iter().zip([w, h]).any(|(at, n)| *at == 0 || *at + 1 == n);
        (0..w * h).filter(|k| inside[*k] && rim(*k)).for_each(|k| touches[label[k] as usize] = true);
        touches
    };
    let several = order.iter().take_while(|&&p| sizes[p] as f64 >= SEVERAL * sizes[largest] as f64).count();
    if look.region.is_none() && several > 1 {
        let boxes: Vec<String> =
            order.iter().take(several.min(8)).map(|p| format!("{:?}", part.around(&label, *p as u32))).collect();
        let what = format!(
            "missing; the picture shows {several} pieces of about one size: expected region = [left, top, width, \
             height] in pixels, such as {}",
            boxes.join(", ")
        );
        return Err(Error::field(&look.albedo, "region", what));
    }
    // In an atlas, rectangles around leaves cut their neighbours.
    let kept = |p: usize| p > 0 && (p == largest || part.whole || !touches[p]);
    let on: Vec<bool> = label.iter().map(|l| kept(*l as usize)).collect();
    let cut = (1..sizes.len()).filter(|p| !kept(*p)).count();
    if cut > 0 {
        cover.iter_mut().zip(&label).filter(|(_, l)| **l > 0 && !kept(**l as usize)).for_each(|(c, _)| *c = 0.0);
        warnings.push(format!("{cut} other pieces that the region's border cuts are left out"));
    }
    if touches[largest] {
        warnings.push("the leaf touches the border of the picture or of the region, which cuts it there".into());
    }
    Ok((cover, on))
}

impl Part {
    /// The rectangle of pixels around the piece with this label, with a texel on every side.
    fn around(&self, label: &[u32], piece: u32) -> [usize; 4] {
        let [_, _, width, height] = self.region;
        let (mut low, mut high) = ([usize::MAX; 2], [0; 2]);
        for k in (0..label.len()).filter(|k| label[*k] == piece) {
            for (c, at) in [k % self.width, k / self.width].into_iter().enumerate() {
                (low[c], high[c]) = (low[c].min(at), high[c].max(at));
            }
        }
        let [from, to] = [0, 1].map(|end: usize| {
            [(0, self.width, width), (1, self.height, height)].map(|(c, count, length)| match end {
                0 => Part::range(low[c].max(1) - 1, count, length).start,
                _ => Part::range((high[c] + 1).min(count - 1), count, length).end,
            })
        });
        [from[0], from[1], to[0] - from[0], to[1] - from[1]]
    }
}

/// ρt of each texel.
fn through(
    look: &Look,
    albedo: &[[f32; 3]],
    same: impl Fn(&Path, PictureEncoding) -> Result<ColourPicture>,
    means: impl Fn(&ColourPicture) -> Vec<[f32; 3]>,
) -> Result<Vec<[f32; 3]>> {
    let factor = look.rho_t_factor.unwrap_or(1.0) as f32;
    let Some(path) = &look.translucency else {
        return Ok(albedo.iter().map(|c| c.map(|v| factor * v)).collect());
    };
    // A share is no light, so that it has no curve. Whether the file holds one is known only when it is read.
    let shares = same(path, PictureEncoding::Numbers)?;
    if shares.grey {
        return Ok(albedo.iter().zip(means(&shares)).map(|(c, share)| c.map(|v| factor * share[0] * v)).collect());
    }
    let colours = means(&same(path, PictureEncoding::Light(look.transfer))?);
    Ok(colours.into_iter().map(|c| c.map(|v| factor * v)).collect())
}

/// Normals of each texel, of unit length.
fn normals(
    look: &Look,
    path: &Path,
    part: &Part,
    coded: &ColourPicture,
    weight: &[f32],
    on: &[bool],
    warnings: &mut Vec<String>,
) -> Result<Vec<[f32; 3]>> {
    let decoded = ColourPicture {
        pixels: coded
            .pixels
            .iter()
            .map(|p| [0, 1, 2, 3].map(|c| if c < 3 { 2.0 * p[c] - 1.0 } else { p[c] }))
            .collect(),
        ..*coded
    };
    let length = |n: &[f32]| n[..3].iter().map(|v| v * v).sum::<f32>().sqrt();
    let on_leaf = || (0..on.len()).filter(|k| on[*k]).flat_map(|k| part.pixels(k, coded.width));
    let unit = |p: usize| LENGTHS.contains(&length(&decoded.pixels[p])) && decoded.pixels[p][2] > 0.0;
    let (good, all) = on_leaf().fold((0usize, 0usize), |(good, all), p| (good + usize::from(unit(p)), all + 1));
    if (good as f64) < OF_LENGTH * all as f64 {
        let what = format!(
            "{good} of {all} pixels on the leaf hold a normal of length 1 that looks out of the leaf, each coded as \
             (n + 1)/2; expected nearly all: a map that was changed as a colour (from sRGB to linear or back) or that \
             holds something else is none"
        );
        return Err(Error::input(path, what));
    }
    let mut planes = [part.means(&decoded, weight)];
    filling::nearest(&mut planes, on, part.width, part.height);
    let [mut out] = planes;
    let up = if look.green == Some(GreenConvention::Directx) { -1.0 } else { 1.0 };
    for n in &mut out {
        let l = length(n);
        *n = if l > 0.1 { [n[0] / l, up * n[1] / l, n[2] / l] } else { [0.0, 0.0, 1.0] };
    }
    let [stated, other] = curls(&out, on, part.width);
    if stated > 2.0 * other {
        let name = if look.green == Some(GreenConvention::Directx) { "opengl" } else { "directx" };
        warnings.push(format!(
            "normal: its slopes make a surface better with green = \"{name}\" (their curl is {:.1} times as large as \
             stated)",
            (stated / other.max(1e-12)).sqrt()
        ));
    }
    Ok(out)
}

/// Sums of the squared curl of the slopes: as they are, and with the vertical one turned round. A surface has none.
fn curls(normals: &[[f32; 3]], on: &[bool], width: usize) -> [f64; 2] {
    let slope = |k: usize, c: usize| -f64::from(normals[k][c]) / f64::from(normals[k][2].max(0.05));
    let mut sums = [0.0; 2];
    for k in (0..normals.len()).filter(|&k| k % width > 0 && k >= width && on[k] && on[k - 1] && on[k - width]) {
        // y points up, and rows go down.
        let across = slope(k - width, 0) - slope(k, 0);
        let along = slope(k, 1) - slope(k - 1, 1);
        sums[0] += (across - along).powi(2);
        sums[1] += (across + along).powi(2);
    }
    sums
}

impl Texels {
    /// Scales the texels that would send back more light than falls on them, the same on both sides, and counts them.
    ///
    /// # Errors
    /// [`Error::Input`] where they are many, and for a negative reflectance.
    fn conserve(&mut self, look: &Look) -> Result<()> {
        let (rho_s, mut most) = (look.rho_s(), 0.0f64);
        for k in (0..self.on.len()).filter(|k| self.on[*k]) {
            let mut beyond = false;
            for c in 0..3 {
                let [front, back, t] = [self.rho_d[0][k][c], self.rho_d[1][k][c], self.rho_t[k][c]].map(f64::from);
                if !(front >= 0.0 && back >= 0.0 && t >= 0.0) {
                    let at = format!("column {}, row {} of the maps", k % self.width, k / self.width);
                    let what = format!("{at}: found ρd {front} and {back} and ρt {t}, expected no negative number");
                    return Err(Error::input(&look.albedo, what));
                }
                let scattered = front.max(back) + t;
                most = most.max(scattered + rho_s[c]);
                if scattered + rho_s[c] > 1.0 + ROUNDING {
                    beyond = true;
                    let factor = ((1.0 - rho_s[c]) / scattered) as f32;
                    let Texels { rho_d: [front, back], rho_t, .. } = self;
                    [front, back, rho_t].into_iter().for_each(|plane| plane[k][c] *= factor);
                }
            }
            self.scaled += usize::from(beyond);
        }
        let all = self.on.iter().filter(|on| **on).count();
        if self.scaled as f64 > MOST_BEYOND * all as f64 {
            let what = format!(
                "{} of {all} texels would send back more light than falls on them: ρd + ρt + ρs is {most:.3} at most, \
                 expected 1; the picture is brighter than a leaf, by another curve than the stated one, or \
                 rho_t_factor is too large",
                self.scaled
            );
            return Err(Error::input(&look.albedo, what));
        }
        if self.scaled > 0 {
            let what =
                format!("{} of {all} texels had ρd + ρt + ρs above 1, {most:.3} at most, and were scaled", self.scaled);
            self.warnings.push(what);
        }
        // What was scaled on the leaf goes on beside it.
        let (w, h) = (self.width, self.height);
        let [front, back] = &mut self.rho_d;
        let mut planes = [std::mem::take(front), std::mem::take(back), std::mem::take(&mut self.rho_t)];
        filling::nearest(&mut planes, &self.on, w, h);
        [self.rho_d[0], self.rho_d[1], self.rho_t] = planes;
        Ok(())
    }
}
