//! A and B: a state is kept as A, the live picture is B, and a line that can be moved parts them. A is drawn again when
//! the camera moves, so both always show the same view.

use super::ViewerUi;
use crate::edit::Edits;
use egui::{Color32, ColorImage, Rect, Slider, Stroke, TextureHandle, TextureId, TextureOptions, pos2, vec2};
use mesophyll_viewer::Picture;
use mesophyll_viewer::scene::Camera;

/// The edits that were kept, and its picture where it is drawn.
pub(crate) struct Kept {
    pub edits: Edits,
    /// The picture, with the camera and the size that it was drawn for.
    shown: Option<(TextureHandle, Camera, [u32; 2])>,
}

/// Paints the part of a picture on the left of the line (`left`) or the other one, into its share of `rect`.
pub(super) fn part(painter: &egui::Painter, picture: TextureId, rect: Rect, wipe: f32, left: bool) {
    let (from, to) = if left { (0.0, wipe) } else { (wipe, 1.0) };
    let at = |share: f32| rect.left() + share * rect.width();
    let area = Rect::from_min_max(pos2(at(from), rect.top()), pos2(at(to), rect.bottom()));
    painter.image(picture, area, Rect::from_min_max(pos2(from, 0.0), pos2(to, 1.0)), Color32::WHITE);
    if left {
        let line = [pos2(at(wipe), rect.top()), pos2(at(wipe), rect.bottom())];
        painter.line_segment(line, Stroke::new(3.0, Color32::BLACK));
        painter.line_segment(line, Stroke::new(1.0, Color32::WHITE));
    }
}

impl ViewerUi {
    /// Keeps the present state as A. Its picture is drawn with the next frame.
    pub fn keep(&mut self) {
        self.kept = Some(Kept { edits: self.edits.clone(), shown: None });
    }

    /// Makes A the present state, and the present state A.
    pub fn swap(&mut self) {
        let now = self.edits.clone();
        if let Some(kept) = self.kept.take() {
            self.restore(&kept.edits);
            self.kept = Some(Kept { edits: now, shown: None });
        }
    }

    /// The edits that were kept as A.
    pub(crate) fn kept_edits(&self) -> Option<Edits> {
        self.kept.as_ref().map(|k| k.edits.clone())
    }

    /// Takes over the picture of A.
    pub(crate) fn finish_kept(&mut self, context: &egui::Context, picture: &Picture) {
        let (camera, size) = (self.live_camera(), [picture.width, picture.height]);
        let Some(kept) = &mut self.kept else { return };
        let image = ColorImage::from_rgba_unmultiplied(size.map(|s| s as usize), picture.ldr.as_flattened());
        kept.shown = Some((context.load_texture("A", image, TextureOptions::LINEAR), camera, size));
    }

    pub(super) fn compare_controls(&mut self, ui: &mut egui::Ui) {
        let keep =
            ui.button("Keep as A").on_hover_text("keeps these parameters and lights, to compare others with them");
        self.landmark("keep", &keep);
        if keep.clicked() {
            self.keep();
        }
        if self.kept.is_none() {
            return;
        }
        ui.spacing_mut().slider_width = 140.0;
        // A slider with its words is about 180 points wide, and does not begin a new row by itself.
        if ui.available_size_before_wrap().x < 200.0 {
            ui.end_row();
        }
        let wipe = Slider::new(&mut self.view.wipe, 0.0..=1.0).show_value(false).text("A | B");
        let wipe = ui.add(wipe).on_hover_text("left of the line is A, right of it the present state");
        self.landmark("wipe", &wipe);
        let swap = ui.button("Swap").on_hover_text("makes A the present state, and the present state A");
        self.landmark("swap", &swap);
        if swap.clicked() {
            self.swap();
        }
        let drop = ui.button("Drop A");
        self.landmark("drop", &drop);
        if drop.clicked() {
            self.kept = None;
        }
    }

    /// Shows A on the left of the line, and asks for its picture where that is not of the present view.
    pub(super) fn show_kept(&mut self, painter: &egui::Painter, rect: Rect) {
        let (camera, size) = (self.live_camera(), self.view.picture_size);
        let Some(kept) = &self.kept else { return };
        match &kept.shown {
            Some((texture, drawn, pixels)) if (*drawn, *pixels) == (camera, size) => {
                part(painter, texture.id(), rect, self.view.wipe, true);
                let font = egui::FontId::proportional(15.0);
                for (name, side, align) in [("A", -8.0, egui::Align2::RIGHT_TOP), ("B", 8.0, egui::Align2::LEFT_TOP)] {
                    let at = pos2(rect.left() + self.view.wipe * rect.width(), rect.top()) + vec2(side, 6.0);
                    let at = pos2(at.x.clamp(rect.left() + 14.0, rect.right() - 14.0), at.y);
                    painter.text(at + vec2(1.0, 1.0), align, name, font.clone(), Color32::BLACK);
                    painter.text(at, align, name, font.clone(), Color32::WHITE);
                }
            }
            _ if !self.view.moving && !self.continuous() && self.job.is_none() => {
                self.job = Some(super::Job::Kept);
            }
            _ => {}
        }
    }
}
