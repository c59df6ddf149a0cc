//! The appearance panel: the choice of leaf and side, the maps, and the sliders of Wang et al. 2005, Fig. 6, for
//! thickness, σa and σs of each channel, and gloss. A change is sent to `Editor::recompute`, and the next picture shows
//! the result.

use super::thumbnails::{MapKind, thumbnail};
use super::{Change, ViewerUi};
use crate::edit::{EditGroup, EditQuantity, EditTarget};
use egui::{RichText, TextureHandle, TextureOptions};
use mesophyll_viewer::scene::{LeafMaterial, Side, Sides};
use std::collections::HashMap;

/// A thumbnail and its range of values; `None` where the side has no such map.
type Thumbnail = Option<(TextureHandle, [f32; 2])>;

/// The thumbnails that were made so far, by leaf, side and map, with the version of the leaf.
pub(crate) type Thumbnails = HashMap<(usize, Side, MapKind), (Option<u64>, Thumbnail)>;

/// The value with two significant digits.
fn short(value: f32) -> String {
    let digits = if value == 0.0 { 0 } else { (1 - value.abs().log10().floor() as i32).clamp(0, 3) };
    format!("{value:.0$}", digits as usize)
}

impl ViewerUi {
    pub(super) fn appearance(&mut self, ui: &mut egui::Ui) {
        ui.heading("Appearance");
        self.choose_leaf(ui);
        ui.horizontal(|ui| {
            ui.label("side");
            for side in Side::ALL {
                let response = ui.selectable_value(&mut self.view.side, side, side.name());
                self.landmark(side.name(), &response);
            }
        });
        self.maps(ui);
        self.translucency(ui);
        ui.separator();
        self.leaf_presets(ui);
        self.sliders(ui);
        ui.separator();
        ui.horizontal(|ui| {
            let changed = !self.edits.of(EditGroup::Leaf(self.view.leaf)).is_empty();
            let reset = ui.add_enabled(changed, egui::Button::new("Reset"));
            self.landmark("reset", &reset);
            if reset.clicked() {
                self.reset(self.view.leaf);
            }
            let save = ui.add_enabled(changed, egui::Button::new("Save as new fit"));
            self.landmark("save", &save);
            if save.clicked() {
                self.save();
            }
        });
    }

    fn choose_leaf(&mut self, ui: &mut egui::Ui) {
        let mut chosen = self.view.leaf;
        let name = self.made.scene.materials[self.view.leaf].name().to_string();
        egui::ComboBox::from_id_salt("leaf").selected_text(name).width(170.0).show_ui(ui, |ui| {
            for (i, leaf) in self.made.scene.materials.iter().enumerate().filter_map(|(i, m)| Some((i, m.leaf()?))) {
                ui.selectable_value(&mut chosen, i, &leaf.name);
            }
        });
        if chosen != self.view.leaf {
            self.choose(chosen);
        }
        let mut alone = self.view.alone;
        ui.checkbox(&mut alone, "show it alone");
        if alone != self.view.alone {
            self.show_alone(alone);
        }
    }

    fn maps(&mut self, ui: &mut egui::Ui) {
        let (leaf, side) = (self.view.leaf, self.view.side);
        let version = self.made.versions.leaf(leaf);
        let Some(maps) = self.made.scene.leaf(leaf) else { return };
        let mesh = self.made.instances.iter().find(|i| i.material == leaf).map(|i| &self.made.scene.meshes[i.mesh]);
        let tall = 84.0;
        let wide = (tall * maps.width as f32 / maps.height as f32).clamp(40.0, 84.0);
        let mut shown = Vec::new();
        for kind in MapKind::ALL {
            let make = || {
                let (image, range) = thumbnail(maps, mesh, side, kind)?;
                Some((ui.ctx().load_texture(format!("{leaf} {side} {kind:?}"), image, TextureOptions::LINEAR), range))
            };
            let entry = self.made.thumbnails.entry((leaf, side, kind)).or_default();
            if entry.0 != Some(version) {
                *entry = (Some(version), make());
            }
            shown.extend(entry.1.as_ref().map(|(texture, range)| (kind, texture.id(), *range)));
        }
        egui::Grid::new("maps").spacing([6.0, 4.0]).show(ui, |ui| {
            for (i, (kind, id, [low, high])) in shown.into_iter().enumerate() {
                ui.vertical(|ui| {
                    ui.set_width(84.0);
                    ui.image((id, egui::vec2(wide, tall)));
                    let text = if kind == MapKind::Normal {
                        String::new()
                    } else {
                        format!(" {}…{}", short(low), short(high))
                    };
                    let text = RichText::new(format!("{}{text}", kind.label())).small();
                    ui.add(egui::Label::new(text).extend());
                });
                if i % 3 == 2 {
                    ui.end_row();
                }
            }
        });
    }

    /// The control that draws light from behind by the leaf's translucency maps, or by ρt and the mapped normal. It is
    /// not shown where the leaf has no such maps.
    fn translucency(&mut self, ui: &mut egui::Ui) {
        let laid_by = self.made.laid_by.contains_key(&self.view.leaf);
        let has = |leaf: &LeafMaterial| leaf.sides.iter().any(|(_, s)| s.translucency.is_some());
        if !laid_by && !self.made.scene.leaf(self.view.leaf).is_some_and(has) {
            return;
        }
        let mut shown = !laid_by;
        let response = ui.checkbox(&mut shown, "translucency maps");
        self.landmark("translucency", &response);
        if response.changed() {
            self.show_translucency(self.view.leaf, shown);
        }
    }

    /// Chooses whether a leaf is drawn with its translucency maps.
    pub fn show_translucency(&mut self, leaf: usize, shown: bool) {
        let Some(target) = self.made.scene.leaf_mut(leaf) else { return };
        let (front, back) = (&mut target.sides.front.translucency, &mut target.sides.back.translucency);
        if shown {
            let Some(maps) = self.made.laid_by.remove(&leaf) else { return };
            (*front, *back) = (maps.front, maps.back);
        } else if front.is_some() || back.is_some() {
            self.made.laid_by.insert(leaf, Sides { front: front.take(), back: back.take() });
        }
        self.made.versions.change(Change::Leaf(leaf));
    }

    /// Whether leaf `leaf` has an inside to edit. One whose reflection is stated has none.
    pub(super) fn has_tissue(&self, leaf: usize) -> bool {
        self.start(EditTarget::Leaf(leaf), EditQuantity::Thickness).is_some()
    }

    fn sliders(&mut self, ui: &mut egui::Ui) {
        ui.spacing_mut().slider_width = 90.0;
        let (leaf, side) = (self.view.leaf, EditTarget::LeafSide(self.view.leaf, self.view.side));
        if !self.has_tissue(leaf) {
            ui.label(RichText::new("Its ρd and ρt are stated: there is no σa, σs or h to change.").weak());
        }
        self.slider(ui, EditTarget::Leaf(leaf), EditQuantity::Thickness);
        for sigma in [EditQuantity::SigmaA, EditQuantity::SigmaS] {
            (0..3).for_each(|channel| self.slider(ui, side, sigma(channel)));
        }
        if self.made.scene.leaf(leaf).is_some_and(|l| l.sides[self.view.side].gloss.is_some()) {
            self.slider(ui, side, EditQuantity::RhoS);
            self.slider(ui, side, EditQuantity::M);
        } else {
            ui.label(RichText::new("This side is matte.").weak());
        }
    }
}
