//! The live picture. The pointer turns, pans and zooms the camera, reads texels and selects leaves.

use super::ViewerUi;
use egui::{Rect, Sense, TextureId};
use mesophyll_viewer::picking::pick;

impl ViewerUi {
    pub(super) fn live_view(&mut self, ui: &mut egui::Ui, picture: TextureId) {
        let (rect, response) = ui.allocate_exact_size(ui.available_size(), Sense::click_and_drag());
        self.landmark("picture", &response);
        let scale = ui.ctx().pixels_per_point();
        let size = [rect.width(), rect.height()].map(|s| (s * scale).round().max(1.0) as u32);
        self.view.picture_size = size;
        let whole = Rect::from_min_max(egui::pos2(0.0, 0.0), egui::pos2(1.0, 1.0));
        ui.painter().image(picture, rect, whole, egui::Color32::WHITE);
        self.show_analysis(ui.painter(), rect);
        self.show_kept(ui.painter(), rect);

        let moved = response.drag_delta();
        let panning = response.dragged_by(egui::PointerButton::Secondary)
            || response.dragged_by(egui::PointerButton::Middle)
            || ui.input(|i| i.modifiers.shift);
        if response.dragged() && moved != egui::Vec2::ZERO {
            if panning {
                // These are shares of the view in a check's picture. The live picture may show more.
                let wider = self.live_camera().half_height() / self.view.orbit.camera.half_height();
                self.view.orbit.pan(wider * moved.x / rect.height(), wider * moved.y / rect.height());
            } else {
                self.view.orbit.turn(moved.x * 0.008, moved.y * 0.008);
            }
            self.camera_changed();
        }
        self.view.moving = response.dragged();
        if response.hovered() {
            let (scroll, zoom) = ui.input(|i| (i.smooth_scroll_delta().y, i.zoom_delta()));
            if scroll != 0.0 || zoom != 1.0 {
                self.view.orbit.zoom((scroll * 0.0025).exp() * zoom);
                self.camera_changed();
            }
        }
        let pointer = response.hover_pos().filter(|_| !response.dragged());
        let aspect = rect.width() / rect.height();
        let pixel = |p: egui::Pos2| {
            let at = (p - rect.min) / rect.size();
            [at.x * size[0] as f32, at.y * size[1] as f32].map(|v| v as u32)
        };
        self.view.pointer_pixel = pointer.map(pixel);
        let hit = pointer.and_then(|p| {
            let at = (p - rect.min) / rect.size();
            pick(&self.made.scene, &self.live_camera(), aspect, at.x, at.y)
        });
        self.made.hover = hit.map(|hit| match self.made.hover.take() {
            Some((old, rows)) if (old.material, old.side, old.texel) == (hit.material, hit.side, hit.texel) => {
                (hit, rows)
            }
            _ if self.made.scene.leaf(hit.material).is_none() => (hit, Vec::new()),
            _ => (hit, self.editor.probe(hit.material, hit.side, hit.texel)),
        });
        if let (true, Some(hit)) = (response.clicked(), hit) {
            self.view.side = hit.side;
            if hit.material != self.view.leaf && self.made.scene.leaf(hit.material).is_some() {
                self.choose(hit.material);
            }
        }
    }
}
