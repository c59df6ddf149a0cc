//! The camera's noise, as it is in the mean of a square of pixels.
//!
//! A camera's sensor has one colour a pixel; what a file holds between is made from the pixels around it. So neighbours
//! share their noise: their difference shows less of it than each has, and a mean over many pixels keeps more of it
//! than so many independent readings would. Noise is therefore never taken from neighbouring pixels. It is measured on
//! the card, on the means of squares as large as those that texels are made of. Three squares in a line are compared as
//! the first, less twice the second, and the third, so that an even slope of the light does not count. Between them
//! lies a gap that is wider than what a converter mixes.
//!
//! Numbers of 8 bits are rounded. Neighbours that show the same light are rounded alike, so that a mean over them is no
//! better: this error is added to every mean.

use super::encoding::TonalSteps;
use super::manifest::PhotoManifest;
use super::picture::LinearPhotograph;
use mesophyll_base::rgb::Rgb;

/// Pixels between two squares, at least. Converters of sensors with a colour filter mix pixels over up to five.
const GAP: usize = 6;
/// Pixels a side of the largest square that is measured, at least.
const LARGEST_AT_LEAST: f64 = 4.0;
/// Fewest triples of squares that give a variance: a standard deviation is then known to about 12 %.
const FEWEST: usize = 40;

/// The camera's noise: the mean of n pixels that show the linear reading v has the variance (photon · v + read²)/n.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorNoise {
    /// Variance over reading of many pixels, times their number; a channel.
    pub photon: Rgb,
    /// Standard deviation without light.
    pub read: f64,
    /// Whether it is stated; otherwise it was measured on the card.
    pub stated: bool,
    /// The same as `photon` for squares of so many pixels a side, ascending; empty where noise is stated.
    measured: Vec<(f64, Rgb)>,
    /// The steps of the pictures' numbers, where they have 8 bits.
    steps: Option<TonalSteps>,
}

impl SensorNoise {
    /// Independent noise of every pixel: a reading v has the variance photon · v + read².
    pub fn stated(photon: f64, read: f64) -> SensorNoise {
        SensorNoise { photon: Rgb::splat(photon), read, stated: true, measured: Vec::new(), steps: None }
    }

    /// The stated noise, or what the card shows: pixels of the rectangle left, top, width, height, which lies inside
    /// the picture. All of what is measured is taken as the photons', in proportion to light.
    pub(super) fn of(m: &PhotoManifest, picture: &LinearPhotograph, card: [usize; 4]) -> SensorNoise {
        if m.noise_photon.is_some() || m.noise_read.is_some() {
            let stated = SensorNoise::stated(m.noise_photon.unwrap_or(0.0), m.noise_read.unwrap_or(0.0));
            return SensorNoise { steps: picture.steps.clone(), ..stated };
        }
        let sides = (0..).map(|k| 1usize << k).take_while(|s| 3 * s + 2 * GAP.max(*s) <= card[2].max(card[3]));
        let measured: Vec<(f64, Rgb)> =
            sides.filter_map(|side| Some((side as f64, of_squares(picture, card, side)?))).collect();
        let photon = measured.last().map_or(Rgb::default(), |m| m.1);
        SensorNoise { photon, read: 0.0, stated: false, measured, steps: picture.steps.clone() }
    }

    /// Whether the noise is known: stated, or measured on squares large enough to show what neighbours share.
    pub(super) fn is_known(&self) -> bool {
        self.stated || self.measured.last().is_some_and(|m| m.0 >= LARGEST_AT_LEAST)
    }

    /// The variance of the mean of a square of `side` pixels a side (1 or more) that show the linear reading `v`, in
    /// channel `c`.
    pub(super) fn of_mean(&self, c: usize, v: f64, side: f64) -> f64 {
        let after = self.measured.partition_point(|m| m.0 < side);
        let photon = match (after.checked_sub(1).map(|k| &self.measured[k]), self.measured.get(after)) {
            (Some(low), Some(high)) => {
                let share = (side / low.0).ln() / (high.0 / low.0).ln();
                low.1[c] * (1.0 - share) + high.1[c] * share
            }
            (_, Some(only)) => only.1[c],
            // Beyond what mixes pixels, larger squares have no more noise for their size.
            _ => self.photon[c],
        };
        let rounded = self.steps.as_ref().map_or(0.0, |steps| steps.error(v).powi(2));
        (photon * v.max(0.0) + self.read * self.read) / (side * side) + rounded
    }
}

/// The variance of the mean of squares of `side` pixels a side, over the reading, times their number of pixels; `None`
/// where the card holds too few of them.
fn of_squares(picture: &LinearPhotograph, [left, top, width, height]: [usize; 4], side: usize) -> Option<Rgb> {
    let apart = side + GAP.max(side);
    // Squares overlap by half. Single pixels are all looked at, so that each kind of a colour filter's pixels counts.
    let step = (side / 2).max(1);
    let mean = |x: usize, y: usize| {
        let mut sum = [0.0; 3];
        for k in (y..y + side).flat_map(|j| (x..x + side).map(move |i| j * picture.width + i)) {
            (0..3).for_each(|c| sum[c] += f64::from(picture.pixels[k][c]));
        }
        sum.map(|s| s / (side * side) as f64)
    };
    let (mut squares, mut level, mut count) = ([0.0; 3], [0.0; 3], 0usize);
    let mut add = |at: [[usize; 2]; 3]| {
        let [a, b, d] = at.map(|[x, y]| mean(x, y));
        if [a, b, d].iter().flatten().all(|v| v.is_finite()) {
            for c in 0..3 {
                squares[c] += (a[c] - 2.0 * b[c] + d[c]).powi(2) / 6.0;
                level[c] += (a[c] + b[c] + d[c]) / 3.0;
            }
            count += 1;
        }
    };
    let reach = 2 * apart + side;
    for y in (top..(top + height + 1).saturating_sub(side)).step_by(step) {
        for x in (left..(left + width + 1).saturating_sub(reach)).step_by(step) {
            add([0, 1, 2].map(|k| [x + k * apart, y]));
        }
    }
    for y in (top..(top + height + 1).saturating_sub(reach)).step_by(step) {
        for x in (left..(left + width + 1).saturating_sub(side)).step_by(step) {
            add([0, 1, 2].map(|k| [x, y + k * apart]));
        }
    }
    let enough = count >= FEWEST && level.iter().all(|l| *l > 0.0);
    enough.then(|| Rgb::of(|c| squares[c] / level[c] * (side * side) as f64))
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesophyll_base::random::RandomStream;

    const W: usize = 480;
    const H: usize = 360;
    const LEVEL: f64 = 0.2;
    const SD: f64 = 0.01;

    /// A grey card behind a Bayer filter (R G / G B), with white noise and an even slope of the light, and the colours
    /// between made from their nearest neighbours of that colour.
    fn bayer(seed: u64) -> LinearPhotograph {
        let raw: Vec<f64> = (0..H)
            .flat_map(|j| {
                let mut stream = RandomStream::new(seed, &[j as u64]);
                (0..W).map(|i| LEVEL * (1.0 + 1e-4 * i as f64) + SD * stream.normal_pair()[0]).collect::<Vec<_>>()
            })
            .collect();
        let colour = |i: i64, j: i64| match (i.rem_euclid(2), j.rem_euclid(2)) {
            (0, 0) => 0,
            (1, 1) => 2,
            _ => 1,
        };
        // The nearest pixels of a colour are those at the smallest distance.
        let between = |i: i64, j: i64, c: usize| {
            let around = (-1..2).flat_map(|y| (-1..2).map(move |x| (x, y)));
            let of: Vec<(i64, f64)> = around
                .filter(|(x, y)| colour(i + x, j + y) == c)
                .map(|(x, y)| {
                    // Mirrored at the border, which keeps the filter's period.
                    let back = |v: i64, n: usize| {
                        if v < 0 {
                            -v
                        } else if v >= n as i64 {
                            2 * n as i64 - 2 - v
                        } else {
                            v
                        }
                    };
                    (x * x + y * y, raw[(back(j + y, H) * W as i64 + back(i + x, W)) as usize])
                })
                .collect();
            let nearest = of.iter().map(|v| v.0).min().unwrap();
            let of: Vec<f64> = of.into_iter().filter(|v| v.0 == nearest).map(|v| v.1).collect();
            (of.iter().sum::<f64>() / of.len() as f64) as f32
        };
        let pixels = (0..W * H).map(|k| Rgb::of(|c| between((k % W) as i64, (k / W) as i64, c))).collect();
        LinearPhotograph { path: "card.exr".into(), width: W, height: H, pixels, highest: (1.0, 1), steps: None }
    }

    fn unstated() -> PhotoManifest {
        toml::from_str(
            r#"
            schema = 1
            kind = "photo"
            name = "x"
            thickness_mm = 0.2
            thickness_err_mm = 0.01
            card = { reflectance = 0.18, reflectance_err = 0.0 }
            background = { reflectance = 0.04, reflectance_err = 0.0 }
            ruler = { marks_px = [[0.0, 0.0], [90.0, 0.0]], length_mm = 50.0 }
            front = { file = "a.exr", card = [0, 0, 9, 9] }
            back = { file = "b.exr", card = [0, 0, 9, 9] }
            light_table = { leaf = "c.exr", bare = "d.exr", reflectance = 0.3, reflectance_err = 0.1 }
            "#,
        )
        .unwrap()
    }

    /// The mean of a large square of red pixels is that of a quarter as many readings, of green ones of half as many.
    /// The noise found on a card of 160 by 120 pixels is that, and for small squares what their means scatter by in
    /// many other pictures. Differences of neighbouring pixels would give a fourth of it in red.
    #[test]
    fn noise_that_neighbours_share_is_found_in_full() {
        let noise = SensorNoise::of(&unstated(), &bayer(1), [100, 80, 160, 120]);
        let white = SD * SD;
        for (c, share) in [(0, 4.0), (1, 2.0), (2, 4.0)] {
            let far = noise.of_mean(c, LEVEL, 16.0) * 256.0 / white;
            assert!((far / share - 1.0).abs() < 0.35, "channel {c}: {far} of {share}");
        }
        // Means of the square at one place, over pictures.
        let pictures: Vec<LinearPhotograph> = (10..14).map(bayer).collect();
        for side in [1usize, 2, 4, 8] {
            let mut sums = [[0.0f64; 2]; 3];
            let mut n = 0.0;
            for picture in &pictures {
                for (y, x) in (4..H - 16).step_by(19).flat_map(|y| (4..W - 16).step_by(23).map(move |x| (y, x))) {
                    let slope = 1.0 + 1e-4 * (x as f64 + 0.5 * (side as f64 - 1.0));
                    n += 1.0;
                    for (c, sum) in sums.iter_mut().enumerate() {
                        let of = (y..y + side).flat_map(|j| (x..x + side).map(move |i| j * W + i));
                        let mean = of.map(|k| f64::from(picture.pixels[k][c])).sum::<f64>() / (side * side) as f64;
                        let off = mean / (LEVEL * slope) - 1.0;
                        *sum = [sum[0] + off, sum[1] + off * off];
                    }
                }
            }
            for (c, sum) in sums.iter().enumerate() {
                let (found, truth) = (noise.of_mean(c, LEVEL, side as f64).sqrt() / LEVEL, (sum[1] / n).sqrt());
                println!("side {side} channel {c}: {found:.5}, truth {truth:.5}");
                assert!((found / truth - 1.0).abs() < 0.15, "side {side}, channel {c}: {found} {truth}");
            }
        }
        // What neighbours say, as it was taken before.
        let picture = &pictures[0];
        let neighbours = |c: usize| {
            let d = (0..W * H - 1).filter(|k| k % W != W - 1).map(|k| picture.pixels[k][c] - picture.pixels[k + 1][c]);
            (d.map(|d| 0.5 * f64::from(d).powi(2)).sum::<f64>() / (W * H) as f64).sqrt()
        };
        let short = Rgb::of(|c| noise.of_mean(c, LEVEL, 8.0).sqrt() * 8.0 / neighbours(c));
        println!("neighbours say too little by {short:?}");
        assert!(short[0] > 3.0 && short[1] > 2.0 && short[2] > 3.0, "{short:?}");
    }

    /// Stated noise is that of independent pixels, and a card that is too small shows none.
    #[test]
    fn stated_noise_and_small_cards() {
        let mut m = unstated();
        let picture = bayer(2);
        assert!(!SensorNoise::of(&m, &picture, [10, 10, 20, 14]).is_known());
        assert!(SensorNoise::of(&m, &picture, [10, 10, 32, 24]).is_known());
        m.noise_photon = Some(4e-4);
        m.noise_read = Some(1e-3);
        let noise = SensorNoise::of(&m, &picture, [10, 10, 5, 5]);
        assert!(noise.is_known() && (noise.of_mean(0, 0.25, 4.0) - (1e-4 + 1e-6) / 16.0).abs() < 1e-15);
    }
}
