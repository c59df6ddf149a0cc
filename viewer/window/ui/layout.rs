//! The layout of the window.

use super::ViewerUi;
use egui::{Rect, TextureId};

impl ViewerUi {
    /// Lays everything out. The picture is drawn into the texture `picture`.
    pub(crate) fn show(&mut self, ui: &mut egui::Ui, picture: TextureId) {
        self.history_keys(ui.ctx());
        if self.made.scene.leaf(self.view.leaf).is_some() {
            egui::Panel::left("appearance").exact_size(290.0).resizable(false).show(ui, |ui| {
                egui::ScrollArea::vertical().show(ui, |ui| self.appearance(ui));
            });
        }
        egui::Panel::right("lights").exact_size(275.0).resizable(false).show(ui, |ui| {
            let room = ui.available_width();
            let shown = egui::ScrollArea::vertical().show(ui, |ui| {
                self.lights(ui);
                ui.separator();
                self.wind(ui);
                self.plants(ui);
                self.check_panel(ui);
                ui.separator();
                self.readout(ui);
                ui.separator();
                self.analysis_panel(ui);
                ui.separator();
                self.frame_times(ui);
            });
            self.landmarks.insert(
                "right panel".into(),
                Rect::from_min_size(shown.inner_rect.min, egui::vec2(room, shown.inner_rect.height())),
            );
            self.landmarks
                .insert("right panel's content".into(), Rect::from_min_size(shown.inner_rect.min, shown.content_size));
        });
        egui::Panel::bottom("words").show(ui, |ui| {
            ui.horizontal_wrapped(|ui| {
                self.history_buttons(ui);
                ui.separator();
                self.compare_controls(ui);
            });
            ui.horizontal(|ui| {
                let shot = ui.button("Screenshot").on_hover_text("writes the picture as PNG, without the panels");
                self.landmark("screenshot", &shot);
                let name =
                    egui::TextEdit::singleline(&mut self.view.shot_name).hint_text("its name").desired_width(110.0);
                let name =
                    ui.add(name).on_hover_text(format!("a file in {}", self.opened.window.screenshots.display()));
                self.landmark("screenshot name", &name);
                if shot.clicked() {
                    self.request_screenshot();
                }
                let hint = "drag: turn   right drag: pan   wheel: zoom   click: choose the leaf";
                let text = if self.message.is_empty() { hint } else { &self.message };
                ui.add(egui::Label::new(text).truncate()).on_hover_text(text);
            });
        });
        egui::CentralPanel::no_frame().show(ui, |ui| match self.view.show_check {
            Some(layout) if self.made.check.is_some() => self.check_view(ui, layout),
            _ => self.live_view(ui, picture),
        });
        self.remember(ui.ctx());
    }
}
