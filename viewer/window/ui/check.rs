//! The check view: picture, reference and their difference, side by side, in turns or parted by a line, with the
//! verdict and its thresholds.

use super::ViewerUi;
use super::comparison::part;
use crate::editor::{ComparisonVerdict, DisplayPicture};
use egui::{Color32, ColorImage, Rect, RichText, TextureHandle, TextureOptions, pos2, vec2};
use mesophyll_viewer::Picture;

/// The factor that the difference is multiplied by before it is shown.
const GAIN: u16 = 8;

/// A finished check.
pub(crate) struct Check {
    pub verdict: ComparisonVerdict,
    /// Picture, reference, difference.
    textures: [TextureHandle; 3],
    size: [u32; 2],
    /// The version of scene and camera that was checked.
    version: u64,
}

/// How a check is laid out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CheckLayout {
    /// Picture, reference and difference side by side.
    SideBySide,
    /// Picture and reference in turns, so that the eye sees differences as movement.
    Flipped,
    /// The picture on the left of a line that can be moved, the reference on its right.
    Wiped,
}

const NAMES: [&str; 3] = ["picture", "reference", "difference × 8"];

/// The amplified difference of each channel.
pub(crate) fn difference(a: &[[u8; 4]], b: &[[u8; 4]]) -> Vec<[u8; 4]> {
    let channel = |x: u8, y: u8| (u16::from(x.abs_diff(y)) * GAIN).min(255) as u8;
    a.iter().zip(b).map(|(p, q)| [channel(p[0], q[0]), channel(p[1], q[1]), channel(p[2], q[2]), 255]).collect()
}

/// The areas of picture, reference and difference. The first two are always side by side. The third is beside or below
/// them, whichever is larger.
pub(crate) fn cells(area: Rect, aspect: f32, caption: f32) -> [Rect; 3] {
    let cell = |x: f32, y: f32, size: egui::Vec2| Rect::from_min_size(area.min + vec2(x * size.x, y * size.y), size);
    let (row, square) = (vec2(area.width() / 3.0, area.height()), 0.5 * area.size());
    let shown = |size: egui::Vec2| size.x.min((size.y - caption) * aspect);
    if shown(row) >= shown(square) {
        [cell(0.0, 0.0, row), cell(1.0, 0.0, row), cell(2.0, 0.0, row)]
    } else {
        [cell(0.0, 0.0, square), cell(1.0, 0.0, square), cell(0.5, 1.0, square)]
    }
}

impl Check {
    pub(crate) fn new(
        context: &egui::Context,
        picture: &Picture,
        reference: &DisplayPicture,
        verdict: ComparisonVerdict,
        version: u64,
    ) -> Check {
        let size = [picture.width as usize, picture.height as usize];
        let load = |name: &str, pixels: &[[u8; 4]]| {
            let image = ColorImage::from_rgba_unmultiplied(size, pixels.as_flattened());
            context.load_texture(name, image, TextureOptions::LINEAR)
        };
        let textures = [
            load(NAMES[0], &picture.ldr),
            load(NAMES[1], &reference.ldr),
            load(NAMES[2], &difference(&picture.ldr, &reference.ldr)),
        ];
        Check { verdict, textures, size: [picture.width, picture.height], version }
    }
}

impl ViewerUi {
    /// The panel with which the user starts a check and reads its verdict.
    pub(super) fn check_panel(&mut self, ui: &mut egui::Ui) {
        ui.heading("Check");
        ui.horizontal(|ui| {
            let button = ui.button("Check against the reference");
            self.landmark("check", &button);
            if button.clicked() {
                self.request_check();
            }
        });
        let Some(check) = &self.made.check else {
            ui.label(RichText::new("Not checked yet.").weak());
            return;
        };
        let (word, colour) = if check.verdict.passed {
            ("passed", Color32::from_rgb(90, 190, 90))
        } else {
            ("failed", Color32::from_rgb(230, 90, 80))
        };
        ui.label(RichText::new(word).strong().size(18.0).color(colour));
        if check.version != self.made.versions.now {
            ui.label(RichText::new("The scene or the view has changed since.").color(Color32::from_rgb(220, 170, 60)));
        }
        // A name may be longer than the panel is wide, so the numbers stand below it.
        for m in &check.verdict.measures {
            ui.label(&m.name);
            let colour =
                if m.value <= m.threshold { ui.visuals().text_color() } else { Color32::from_rgb(230, 90, 80) };
            ui.horizontal(|ui| {
                ui.label(RichText::new(format!("{:.4}", m.value)).monospace().color(colour));
                ui.monospace(format!("≤ {:.4}", m.threshold));
            });
        }
        if !check.verdict.note.is_empty() {
            ui.label(RichText::new(&check.verdict.note).small());
        }
        let mut show = self.view.show_check;
        ui.horizontal_wrapped(|ui| {
            for (choice, name) in [
                (None, "live"),
                (Some(CheckLayout::SideBySide), "side by side"),
                (Some(CheckLayout::Flipped), "flipped"),
                (Some(CheckLayout::Wiped), "wiped"),
            ] {
                let response = ui.selectable_value(&mut show, choice, name);
                self.landmark(name, &response);
            }
        });
        self.view.show_check = show;
        if show == Some(CheckLayout::Wiped) {
            ui.spacing_mut().slider_width = 110.0;
            let line = ui.add(egui::Slider::new(&mut self.view.wipe, 0.0..=1.0).show_value(false).text("line"));
            self.landmark("check wipe", &line);
            line.on_hover_text("left of the line is the picture, right of it the reference");
        }
    }

    /// Shows the pictures in place of the live one.
    pub(super) fn check_view(&self, ui: &mut egui::Ui, layout: CheckLayout) {
        let Some(check) = &self.made.check else { return };
        let area = ui.available_rect_before_wrap();
        let aspect = check.size[0] as f32 / check.size[1] as f32;
        let caption = 20.0;
        // The largest picture in an area, below its name.
        let fitted = |area: Rect| {
            let room = vec2(area.width(), area.height() - caption);
            let size =
                if room.x / room.y > aspect { vec2(room.y * aspect, room.y) } else { vec2(room.x, room.x / aspect) };
            Rect::from_center_size(area.center() + vec2(0.0, 0.5 * caption), size)
        };
        let show = |which: usize, cell: Rect| {
            let rect = fitted(cell);
            let painter = ui.painter();
            let whole = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
            painter.image(check.textures[which].id(), rect, whole, Color32::WHITE);
            let font = egui::FontId::proportional(14.0);
            painter.text(
                rect.center_top() - vec2(0.0, 3.0),
                egui::Align2::CENTER_BOTTOM,
                NAMES[which],
                font,
                ui.visuals().text_color(),
            );
        };
        match layout {
            CheckLayout::SideBySide => {
                for (which, cell) in cells(area, aspect, caption).into_iter().enumerate() {
                    show(which, cell.shrink(3.0));
                }
            }
            CheckLayout::Wiped => {
                // Names of both stand above their sides.
                let rect = fitted(area);
                part(ui.painter(), check.textures[1].id(), rect, self.view.wipe, false);
                part(ui.painter(), check.textures[0].id(), rect, self.view.wipe, true);
                let font = egui::FontId::proportional(14.0);
                let sides =
                    [(rect.left_top(), egui::Align2::LEFT_BOTTOM), (rect.right_top(), egui::Align2::RIGHT_BOTTOM)];
                for ((at, align), name) in sides.into_iter().zip(NAMES) {
                    ui.painter().text(at - vec2(0.0, 3.0), align, name, font.clone(), ui.visuals().text_color());
                }
            }
            CheckLayout::Flipped => {
                let which = (ui.input(|i| i.time) / 0.7) as usize % 2;
                show(which, area);
                ui.ctx().request_repaint_after(std::time::Duration::from_millis(100));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn side_by_side_is_side_by_side_and_large() {
        // The middle of the default window, of a wide one and of a tall one.
        for (width, height, least) in [(795.0f32, 770.0f32, 380.0), (1800.0, 500.0, 590.0), (500.0, 900.0, 240.0)] {
            let area = Rect::from_min_size(pos2(290.0, 0.0), vec2(width, height));
            let [picture, reference, difference] = cells(area, 4.0 / 3.0, 20.0);
            assert!(picture.top() == reference.top() && (picture.right() - reference.left()).abs() < 0.01);
            assert!([picture, reference, difference].iter().all(|r| area.expand(0.01).contains_rect(*r)));
            assert!(
                picture.width().min((picture.height() - 20.0) * 4.0 / 3.0) >= least,
                "{width} {height}: {picture:?}"
            );
            assert!(difference.intersect(picture).area() < 0.01 || !difference.intersects(picture.shrink(0.01)));
        }
    }
}
