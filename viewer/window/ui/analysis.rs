//! The picture in numbers, as image viewers have it: a histogram of what is shown, the luminance in false colours over
//! a logarithmic scale, and the radiance under the pointer. All of it is read from the picture at rest.

use super::{DrawnPicture, Job, ViewerUi};
use egui::{Color32, ColorImage, Rect, RichText, Sense, Stroke, StrokeKind, TextureHandle, TextureOptions, pos2, vec2};
use mesophyll_viewer::Picture;

/// Number of bins of the histogram, four of the 256 displayed values each.
const BINS: usize = 64;

/// Six evenly spaced colours of viridis (Smith and van der Walt 2015). Lightness rises evenly.
const SCALE: [[f32; 3]; 6] = [
    [68.0, 1.0, 84.0],
    [65.0, 68.0, 135.0],
    [42.0, 120.0, 142.0],
    [34.0, 168.0, 132.0],
    [122.0, 209.0, 81.0],
    [253.0, 231.0, 37.0],
];

/// The colour at a share of the scale, 0 to 1.
fn colour(share: f32) -> Color32 {
    let at = share.clamp(0.0, 1.0) * (SCALE.len() - 1) as f32;
    let low = (at as usize).min(SCALE.len() - 2);
    let part = at - low as f32;
    let [r, g, b] = [0, 1, 2].map(|c| (SCALE[low][c] + part * (SCALE[low + 1][c] - SCALE[low][c])).round() as u8);
    Color32::from_rgb(r, g, b)
}

/// Luminance of linear sRGB (IEC 61966-2-1).
fn luminance([r, g, b, _]: [f32; 4]) -> f32 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// What a picture holds.
struct Numbers {
    /// Shares of the pixels in each bin of displayed red, green and blue.
    bins: [[f32; BINS]; 3],
    /// Means of displayed red, green and blue, 0 to 255.
    means: [f32; 3],
    /// Luminance that 1 % and 99 % of the pixels with light are below.
    range: [f32; 2],
    picture: Picture,
}

impl Numbers {
    fn of(picture: Picture) -> Numbers {
        let each = 1.0 / picture.ldr.len().max(1) as f32;
        let (mut bins, mut means) = ([[0.0; BINS]; 3], [0.0; 3]);
        for pixel in &picture.ldr {
            for c in 0..3 {
                bins[c][usize::from(pixel[c]) * BINS / 256] += each;
                means[c] += f32::from(pixel[c]) * each;
            }
        }
        let mut all: Vec<f32> = picture.hdr.iter().map(|p| luminance(*p)).filter(|l| *l > 0.0).collect();
        all.sort_by(f32::total_cmp);
        let at = |share: f32| all.get((share * all.len() as f32) as usize).copied().unwrap_or(1.0);
        let low = at(0.01);
        let range = [low, at(0.99).max(1.01 * low)];
        Numbers { bins, means, range, picture }
    }

    /// Place of a luminance on the logarithmic scale, 0 to 1.
    fn share(&self, l: f32) -> f32 {
        let [low, high] = self.range;
        if l > 0.0 { (l / low).ln() / (high / low).ln() } else { 0.0 }
    }
}

/// What is shown of the picture, and what was read.
#[derive(Default)]
pub(crate) struct Analysis {
    histogram: bool,
    false_colour: bool,
    numbers: Option<Numbers>,
    texture: Option<TextureHandle>,
    /// The picture that `numbers` are of.
    of: Option<DrawnPicture>,
}

impl ViewerUi {
    /// Shows or hides the luminance in false colours.
    pub fn show_false_colour(&mut self, shown: bool) {
        self.made.analysis.false_colour = shown;
    }

    /// Means of red, green and blue as displayed (0 to 255), where the picture was read.
    pub fn means(&self) -> Option<[f32; 3]> {
        self.fresh_numbers().map(|n| n.means)
    }

    /// The numbers of the picture that is shown.
    fn fresh_numbers(&self) -> Option<&Numbers> {
        self.made.analysis.numbers.as_ref().filter(|_| self.made.analysis.of == Some(self.picture()))
    }

    /// Takes over the picture at rest.
    pub(crate) fn finish_analysis(&mut self, context: &egui::Context, picture: Picture) {
        let size = [picture.width as usize, picture.height as usize];
        let numbers = Numbers::of(picture);
        let pixels = numbers.picture.hdr.iter().map(|p| colour(numbers.share(luminance(*p)))).collect();
        let image = ColorImage::new(size, pixels);
        self.made.analysis.texture = Some(context.load_texture("false colours", image, TextureOptions::NEAREST));
        self.made.analysis.numbers = Some(numbers);
        self.made.analysis.of = Some(self.picture());
    }

    /// Shows the false colours in place of the picture, and asks for numbers where they are missing.
    pub(super) fn show_analysis(&mut self, painter: &egui::Painter, rect: Rect) {
        let asked = self.made.analysis.histogram || self.made.analysis.false_colour;
        let resting = !self.view.moving && !self.continuous() && self.is_drawn();
        let fresh = self.fresh_numbers().is_some();
        if asked && !fresh && resting && self.job.is_none() {
            self.job = Some(Job::Analyse);
        }
        let texture = self.made.analysis.texture.as_ref().filter(|_| self.made.analysis.false_colour && fresh);
        if let Some(texture) = texture {
            let whole = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
            painter.image(texture.id(), rect, whole, Color32::WHITE);
        }
    }

    pub(super) fn analysis_panel(&mut self, ui: &mut egui::Ui) {
        ui.heading("Picture");
        let histogram = ui.checkbox(&mut self.made.analysis.histogram, "histogram");
        let histogram = histogram.on_hover_text("displayed red, green and blue (0 to 255), of the picture at rest");
        self.landmark("histogram", &histogram);
        let colours = ui.checkbox(&mut self.made.analysis.false_colour, "luminance in false colours");
        let colours =
            colours.on_hover_text("luminance before exposure, on a logarithmic scale, in the scene's unit of radiance");
        self.landmark("false colour", &colours);
        let Some(numbers) = self.fresh_numbers() else { return };
        if self.made.analysis.histogram {
            draw_histogram(ui, numbers);
            let [r, g, b] = numbers.means;
            ui.label(RichText::new(format!("mean {r:.1} {g:.1} {b:.1} of 255")).small());
        }
        if self.made.analysis.false_colour {
            let (response, painter) = ui.allocate_painter(vec2(ui.available_width().min(250.0), 12.0), Sense::hover());
            let rect = response.rect;
            let width = rect.width() / 64.0;
            for k in 0..64 {
                let from = pos2(rect.left() + k as f32 * width, rect.top());
                let cell = Rect::from_min_size(from, vec2(width + 0.5, rect.height()));
                painter.rect_filled(cell, 0.0, colour(k as f32 / 63.0));
            }
            let [low, high] = numbers.range;
            let text = format!("{low:.3e} … {:.3e} … {high:.3e}", (low * high).sqrt());
            ui.label(RichText::new(text).small())
                .on_hover_text("1 % and 99 % of the pixels with light are below the ends");
        }
        if let Some(at) = self.view.pointer_pixel {
            let picture = &numbers.picture;
            if at[0] < picture.width && at[1] < picture.height {
                let [r, g, b, _] = picture.radiance(at[0], at[1]);
                let shown = picture.ldr[(at[1] * picture.width + at[0]) as usize];
                ui.label(RichText::new(format!("radiance {r:.4} {g:.4} {b:.4}")).small());
                ui.label(RichText::new(format!("shown {} {} {} of 255", shown[0], shown[1], shown[2])).small());
            }
        }
    }
}

/// Three lines over the displayed values. Heights are square roots of the shares, so that small ones are seen.
fn draw_histogram(ui: &mut egui::Ui, numbers: &Numbers) {
    let (response, painter) = ui.allocate_painter(vec2(ui.available_width().min(250.0), 70.0), Sense::hover());
    let rect = response.rect.shrink(1.0);
    let visuals = ui.visuals();
    let edge = Stroke::new(1.0, visuals.widgets.noninteractive.bg_stroke.color);
    painter.rect(rect, 2.0, visuals.extreme_bg_color, edge, StrokeKind::Inside);
    let most = numbers.bins.iter().flatten().copied().fold(1e-6, f32::max).sqrt();
    let colours = [(230, 90, 80), (90, 190, 90), (100, 140, 240)];
    for (bins, (r, g, b)) in numbers.bins.iter().zip(colours) {
        let point = |(k, share): (usize, &f32)| {
            let x = rect.left() + (k as f32 + 0.5) / BINS as f32 * rect.width();
            pos2(x, rect.bottom() - share.sqrt() / most * (rect.height() - 3.0))
        };
        let line: Vec<egui::Pos2> = bins.iter().enumerate().map(point).collect();
        painter.line(line, Stroke::new(1.5, Color32::from_rgb(r, g, b)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pixels of two luminances, a thousand times apart.
    #[test]
    fn numbers_are_those_of_the_pixels() {
        let hdr: Vec<[f32; 4]> =
            (0..400).map(|k| if k % 4 == 0 { [10.0; 4] } else { [0.01, 0.01, 0.01, 1.0] }).collect();
        let ldr = (0..400).map(|k| if k % 4 == 0 { [255, 128, 4, 255] } else { [0, 128, 3, 255] }).collect();
        let numbers = Numbers::of(Picture { width: 20, height: 20, hdr, ldr });
        assert!((numbers.means[0] - 63.75).abs() < 1e-3 && (numbers.means[1] - 128.0).abs() < 1e-3);
        assert!((numbers.bins[0][63] - 0.25).abs() < 1e-5 && (numbers.bins[0][0] - 0.75).abs() < 1e-5);
        assert!((numbers.bins[2][1] - 0.25).abs() < 1e-5, "4 is in the second bin of four values");
        assert!((numbers.range[0] - 0.01).abs() < 1e-6 && (numbers.range[1] - 10.0).abs() < 1e-3);
        assert!((numbers.share(0.316_227_77) - 0.5).abs() < 1e-5, "a logarithmic scale");
        assert_eq!((colour(0.0), colour(1.0)), (Color32::from_rgb(68, 1, 84), Color32::from_rgb(253, 231, 37)));
    }
}
