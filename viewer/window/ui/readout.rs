//! The texel under the pointer and the frame times.

use super::ViewerUi;
use egui::{Color32, RichText, Sense, Stroke, StrokeKind};
use mesophyll_viewer::FrameTiming;

/// Number of frames that the graph shows.
pub(crate) const FRAMES: usize = 120;

impl ViewerUi {
    pub(super) fn readout(&mut self, ui: &mut egui::Ui) {
        ui.heading("Under the pointer");
        let Some((hit, rows)) = &self.made.hover else {
            ui.label(RichText::new("Point at a leaf to read its texel.").weak());
            return;
        };
        let name = self.made.scene.materials[hit.material].name();
        ui.label(format!("{name}, {}, texel {}, {}", hit.side, hit.texel[0], hit.texel[1]));
        egui::Grid::new("texel").num_columns(2).spacing([12.0, 2.0]).show(ui, |ui| {
            for (name, value) in rows {
                ui.label(name);
                ui.monospace(value);
                ui.end_row();
            }
        });
    }

    pub(super) fn frame_times(&mut self, ui: &mut egui::Ui) {
        ui.heading("Frame times");
        let timing = FrameTiming { frame_ms: self.made.times.iter().copied().collect(), ..FrameTiming::default() };
        match (timing.quantile(0.5), timing.quantile(0.95)) {
            (Some(median), Some(p95)) => ui.label(format!("median {median:.1} ms, 95 % below {p95:.1} ms")),
            _ => ui.label("none yet"),
        };
        let (response, painter) =
            ui.allocate_painter(egui::vec2(ui.available_width().min(250.0), 56.0), Sense::hover());
        let rect = response.rect.shrink(1.0);
        let visuals = ui.visuals();
        painter.rect(
            rect,
            2.0,
            visuals.extreme_bg_color,
            Stroke::new(1.0, visuals.widgets.noninteractive.bg_stroke.color),
            StrokeKind::Inside,
        );
        let highest = timing.quantile(1.0).unwrap_or(1.0).max(1.0) * 1.1;
        let point = |i: usize, ms: f64| {
            let x = rect.right() - (self.made.times.len() - 1 - i) as f32 * rect.width() / (FRAMES - 1) as f32;
            egui::pos2(x, rect.bottom() - (ms / highest) as f32 * rect.height())
        };
        let line: Vec<egui::Pos2> = self.made.times.iter().enumerate().map(|(i, ms)| point(i, *ms)).collect();
        if line.len() > 1 {
            painter.line(line, Stroke::new(1.5, Color32::from_rgb(110, 190, 110)));
        }
        let font = egui::FontId::proportional(10.0);
        let top = format!("{highest:.0} ms");
        painter.text(
            rect.left_top() + egui::vec2(3.0, 1.0),
            egui::Align2::LEFT_TOP,
            top,
            font,
            visuals.weak_text_color(),
        );
        ui.checkbox(&mut self.view.continuous, "draw all the time");
        let kind = if self.opened.adapter.is_software { "software" } else { "GPU" };
        ui.label(
            RichText::new(format!("{} ({}, {kind})", self.opened.adapter.name, self.opened.adapter.backend))
                .small()
                .weak(),
        );
    }
}
