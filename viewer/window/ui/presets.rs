//! Presets: lights and changes of a leaf that people often ask for. They are edits like any other: sliders show them,
//! and undo takes them back.

use super::ViewerUi;
use super::light::{Light, direction};
use crate::editor::LeafEdit;
use mesophyll_viewer::scene::Side;

/// Lights: name, and what they do.
const LIGHTS: [(&str, &str); 6] = [
    ("as opened", "the lights of the scene"),
    ("high sun", "the sun 60° above the horizon"),
    ("low sun", "the sun 10° above the horizon"),
    ("against the light", "the sun behind the leaf as it is seen now, 25° above the horizon"),
    ("sun alone", "no light of the sky"),
    ("sky alone", "no light of the sun"),
];

/// Changes of the fitted leaf: name, and what they do.
const LEAVES: [(&str, &str); 6] = [
    ("as fitted", "the leaf of the fit"),
    ("half as thick", "half the thickness h"),
    ("twice as thick", "twice the thickness h"),
    ("little pigment", "σa times 0.3 on both sides"),
    ("matte", "no gloss: ρs times 0 on both sides"),
    ("polished", "a sharper gloss: m times 0.5 on both sides"),
];

/// Changes of a leaf whose reflection is stated.
const STATED: [(&str, &str); 3] = [("as stated", "the leaf as it is stated"), LEAVES[4], LEAVES[5]];

impl ViewerUi {
    /// The light of a preset.
    fn preset_light(&self, name: &str) -> Light {
        let own = self.own_light;
        let sun = |azimuth: f32, elevation: f32| {
            let direction = own.direction.map(|_| direction(azimuth, elevation));
            Light { azimuth, elevation, direction, ..own }
        };
        match name {
            "high sun" => sun(own.azimuth, 60.0),
            "low sun" => sun(own.azimuth, 10.0),
            "against the light" => {
                let ahead = self.orbit.camera.target - self.orbit.camera.eye;
                sun(ahead.y.atan2(ahead.x).to_degrees(), 25.0)
            }
            "sun alone" => Light { sky_factor: 0.0, ..own },
            "sky alone" => Light { sun_factor: 0.0, ..own },
            _ => own,
        }
    }

    /// The leaf of a preset.
    fn preset_leaf(&self, leaf: usize, name: &str) -> LeafEdit {
        let mut edit = self.starts[&leaf];
        match name {
            "half as thick" => edit.thickness_mm *= 0.5,
            "twice as thick" => edit.thickness_mm *= 2.0,
            _ => {}
        }
        for side in Side::ALL {
            let side = &mut edit.sides[side];
            match name {
                "little pigment" => side.sigma_a = side.sigma_a.map(|v| 0.3 * v),
                "matte" => side.rho_s_scale = 0.0,
                "polished" => side.m_scale = 0.5,
                _ => {}
            }
        }
        edit
    }

    /// Applies a preset of lights. A name that is no preset changes nothing.
    pub fn preset_lights(&mut self, name: &str) {
        if LIGHTS.iter().any(|p| p.0 == name) {
            self.set_light(self.preset_light(name));
        }
    }

    /// Applies a preset of a leaf to leaf `leaf`. A name that is no preset changes nothing.
    pub fn preset_leaf_edit(&mut self, leaf: usize, name: &str) {
        if !LEAVES.iter().chain(&STATED).any(|p| p.0 == name) || !self.starts.contains_key(&leaf) {
            return;
        }
        let edit = self.preset_leaf(leaf, name);
        if edit == self.starts[&leaf] {
            self.reset(leaf);
        } else {
            self.set_edit(leaf, edit);
        }
    }

    pub(super) fn light_presets(&mut self, ui: &mut egui::Ui) {
        let now = self.light();
        let usable: Vec<(&str, &str)> = LIGHTS
            .into_iter()
            .filter(|p| p.0 == "as opened" || self.preset_light(p.0) != self.own_light)
            .filter(|p| now.direction.is_some() || p.0 != "sky alone")
            .collect();
        let chosen = usable.iter().find(|p| self.preset_light(p.0) == now).map_or("own", |p| p.0);
        if let Some(name) = self.presets(ui, "light preset", chosen, &usable) {
            self.preset_lights(name);
        }
    }

    pub(super) fn leaf_presets(&mut self, ui: &mut egui::Ui) {
        let leaf = self.leaf;
        let all: &[(&str, &str)] = if self.has_tissue(leaf) { &LEAVES } else { &STATED };
        let chosen = all.iter().find(|p| self.preset_leaf(leaf, p.0) == self.edits[&leaf]).map_or("own", |p| p.0);
        if let Some(name) = self.presets(ui, "leaf preset", chosen, all) {
            self.preset_leaf_edit(leaf, name);
        }
    }

    /// A list of presets; the one that was chosen in this frame.
    fn presets(
        &mut self,
        ui: &mut egui::Ui,
        what: &str,
        chosen: &str,
        all: &[(&'static str, &'static str)],
    ) -> Option<&'static str> {
        let mut picked = None;
        let shown = egui::ComboBox::from_id_salt(what).selected_text(chosen).width(150.0).show_ui(ui, |ui| {
            for (name, hint) in all {
                let row = ui.selectable_label(*name == chosen, *name).on_hover_text(*hint);
                self.landmark(&format!("{what} {name}"), &row);
                if row.clicked() {
                    picked = Some(*name);
                }
            }
        });
        self.landmark(what, &shown.response);
        shown.response.on_hover_text("presets; undo takes them back");
        picked
    }
}
