//! The appearance panel: the choice of leaf and side, the maps, and the sliders of Wang et al. 2005, Fig. 6, for
//! thickness, σa and σs of each channel, and gloss. A change is sent to `Editor::recompute`, and the next picture shows
//! the result.

use super::ViewerUi;
use super::thumbnails::{MapKind, thumbnail};
use crate::editor::{LeafEdit, SideEdit};
use egui::{Color32, RichText, Slider, TextureHandle, TextureOptions};
use mesophyll_viewer::scene::{LeafMaterial, Side, Sides};
use std::collections::HashMap;

/// A thumbnail and its range of values; `None` where the side has no such map.
type Thumbnail = Option<(TextureHandle, [f32; 2])>;

/// The thumbnails that were made so far, by leaf, side and map.
#[derive(Default)]
pub(crate) struct Thumbnails(HashMap<(usize, Side, MapKind), Thumbnail>);

impl Thumbnails {
    /// Forgets a leaf's thumbnails, after its maps have changed.
    pub(crate) fn forget(&mut self, leaf: usize) {
        self.0.retain(|(l, _, _), _| *l != leaf);
    }
}

const CHANNELS: [(&str, Color32); 3] = [
    ("R", Color32::from_rgb(230, 90, 80)),
    ("G", Color32::from_rgb(90, 190, 90)),
    ("B", Color32::from_rgb(100, 140, 240)),
];

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
                let response = ui.selectable_value(&mut self.side, side, side.name());
                self.landmark(side.name(), &response);
            }
        });
        self.maps(ui);
        self.translucency(ui);
        ui.separator();
        self.leaf_presets(ui);
        let mut edit = self.edits[&self.leaf];
        self.sliders(ui, &mut edit);
        if edit != self.edits[&self.leaf] {
            self.set_edit(self.leaf, edit);
        }
        ui.separator();
        ui.horizontal(|ui| {
            let changed = self.edits[&self.leaf] != self.starts[&self.leaf];
            let reset = ui.add_enabled(changed, egui::Button::new("Reset"));
            self.landmark("reset", &reset);
            if reset.clicked() {
                self.reset(self.leaf);
            }
            let save = ui.add_enabled(changed, egui::Button::new("Save as new fit"));
            self.landmark("save", &save);
            if save.clicked() {
                self.save();
            }
        });
    }

    fn choose_leaf(&mut self, ui: &mut egui::Ui) {
        let mut chosen = self.leaf;
        let name = self.scene.materials[self.leaf].name().to_string();
        egui::ComboBox::from_id_salt("leaf").selected_text(name).width(170.0).show_ui(ui, |ui| {
            for (i, leaf) in self.scene.materials.iter().enumerate().filter_map(|(i, m)| Some((i, m.leaf()?))) {
                ui.selectable_value(&mut chosen, i, &leaf.name);
            }
        });
        if chosen != self.leaf {
            self.choose(chosen);
        }
        let mut alone = self.alone;
        ui.checkbox(&mut alone, "show it alone");
        if alone != self.alone {
            self.show_alone(alone);
        }
    }

    fn maps(&mut self, ui: &mut egui::Ui) {
        let (leaf, side) = (self.leaf, self.side);
        let Some(maps) = self.scene.leaf(leaf) else { return };
        let mesh = self.instances.iter().find(|i| i.material == leaf).map(|i| &self.scene.meshes[i.mesh]);
        let tall = 84.0;
        let wide = (tall * maps.width as f32 / maps.height as f32).clamp(40.0, 84.0);
        let mut shown = Vec::new();
        for kind in MapKind::ALL {
            let entry = self.thumbnails.0.entry((leaf, side, kind)).or_insert_with(|| {
                let (image, range) = thumbnail(maps, mesh, side, kind)?;
                Some((ui.ctx().load_texture(format!("{leaf} {side} {kind:?}"), image, TextureOptions::LINEAR), range))
            });
            shown.extend(entry.as_ref().map(|(texture, range)| (kind, texture.id(), *range)));
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
        let laid_by = self.laid_by.contains_key(&self.leaf);
        let has = |leaf: &LeafMaterial| leaf.sides.iter().any(|(_, s)| s.translucency.is_some());
        if !laid_by && !self.scene.leaf(self.leaf).is_some_and(has) {
            return;
        }
        let mut shown = !laid_by;
        let response = ui.checkbox(&mut shown, "translucency maps");
        self.landmark("translucency", &response);
        if response.changed() {
            self.show_translucency(self.leaf, shown);
        }
    }

    /// Chooses whether a leaf is drawn with its translucency maps.
    pub fn show_translucency(&mut self, leaf: usize, shown: bool) {
        let Some(target) = self.scene.leaf_mut(leaf) else { return };
        let (front, back) = (&mut target.sides.front.translucency, &mut target.sides.back.translucency);
        if shown {
            let Some(maps) = self.laid_by.remove(&leaf) else { return };
            (*front, *back) = (maps.front, maps.back);
        } else if front.is_some() || back.is_some() {
            self.laid_by.insert(leaf, Sides { front: front.take(), back: back.take() });
        }
        self.leaves_changed.insert(leaf);
        self.make_stale();
        self.dirty = true;
    }

    /// Whether leaf `leaf` has an inside to edit. One whose reflection is stated has none.
    pub(super) fn has_tissue(&self, leaf: usize) -> bool {
        let scatters = |edit: &SideEdit| edit.sigma_s.iter().any(|v| *v > 0.0);
        self.starts.get(&leaf).is_some_and(|start| Side::ALL.into_iter().any(|side| scatters(&start.sides[side])))
    }

    fn tissue_sliders(&mut self, ui: &mut egui::Ui, edit: &mut LeafEdit) {
        if !self.has_tissue(self.leaf) {
            ui.label(RichText::new("Its ρd and ρt are stated: there is no σa, σs or h to change.").weak());
            return;
        }
        let thickness =
            ui.add(Slider::new(&mut edit.thickness_mm, 0.02..=1.0).logarithmic(true).suffix(" mm").text("h"));
        self.landmark("thickness", &thickness);
        thickness.on_hover_text("mean thickness of the leaf, in mm; click the number to type one");
        let side = &mut edit.sides[self.side];
        for (name, range, values) in [("σa", 1e-3..=100.0, &mut side.sigma_a), ("σs", 1e-2..=300.0, &mut side.sigma_s)]
        {
            for (value, (channel, colour)) in values.iter_mut().zip(CHANNELS) {
                let text = RichText::new(format!("{name} {channel}")).color(colour);
                let response = ui.add(Slider::new(value, range.clone()).logarithmic(true).suffix("/mm").text(text));
                self.landmark(&format!("{name} {channel}"), &response);
                response.on_hover_text(match name {
                    "σa" => {
                        "absorption coefficient of this side, in 1/mm: the share of light that is absorbed on a mm"
                    }
                    _ => "scattering coefficient of this side, in 1/mm: the share of light that is scattered on a mm",
                });
            }
        }
    }

    fn sliders(&mut self, ui: &mut egui::Ui, edit: &mut LeafEdit) {
        ui.spacing_mut().slider_width = 110.0;
        self.tissue_sliders(ui, edit);
        let shining = self.scene.leaf(self.leaf).is_some_and(|l| l.sides[self.side].gloss.is_some());
        let side = &mut edit.sides[self.side];
        if shining {
            let rho_s = ui.add(Slider::new(&mut side.rho_s_scale, 0.0..=3.0).text("ρs ×"));
            self.landmark("ρs", &rho_s);
            rho_s.on_hover_text("factor on the fitted strength of the gloss, ρs; it has no unit");
            let m = ui.add(Slider::new(&mut side.m_scale, 0.2..=3.0).logarithmic(true).text("m ×"));
            self.landmark("m", &m);
            m.on_hover_text("factor on the fitted roughness m, an RMS slope; below 1 is sharper");
        } else {
            ui.label(RichText::new("This side is matte.").weak());
        }
    }
}
