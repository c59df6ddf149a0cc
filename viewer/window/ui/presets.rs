//! Presets: lights and changes of a leaf that people often ask for. They are edits like any other: sliders show them,
//! and undo takes them back.

use super::ViewerUi;
use crate::edit::{Edit, EditGroup, EditQuantity, EditTarget, Edits};
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
    /// The edits of a preset, as far as the scene has such values.
    fn preset(&self, target: EditTarget, values: &[(EditQuantity, f64)]) -> Edits {
        let edits = values.iter().map(|&(quantity, value)| Edit { target, quantity, value });
        let start = |e: &Edit| self.start(e.target, e.quantity);
        Edits::default().with(edits.filter(|e| start(e).is_some()), start)
    }

    /// The light of a preset.
    fn preset_light(&self, name: &str) -> Edits {
        let values: &[(EditQuantity, f64)] = match name {
            "high sun" => &[(EditQuantity::Elevation, 60.0)],
            "low sun" => &[(EditQuantity::Elevation, 10.0)],
            "against the light" => {
                let ahead = self.view.orbit.camera.target - self.view.orbit.camera.eye;
                let azimuth = f64::from(ahead.y).atan2(f64::from(ahead.x)).to_degrees();
                &[(EditQuantity::Azimuth, azimuth), (EditQuantity::Elevation, 25.0)]
            }
            "sun alone" => &[(EditQuantity::Sky, 0.0)],
            "sky alone" => &[(EditQuantity::Sun, 0.0)],
            _ => &[],
        };
        self.preset(EditTarget::Light, values)
    }

    /// The leaf of a preset.
    fn preset_leaf(&self, leaf: usize, name: &str) -> Edits {
        let times = |target, quantity, factor| (quantity, factor * self.start(target, quantity).unwrap_or_default());
        let whole = EditTarget::Leaf(leaf);
        let thickness = match name {
            "half as thick" => self.preset(whole, &[times(whole, EditQuantity::Thickness, 0.5)]),
            "twice as thick" => self.preset(whole, &[times(whole, EditQuantity::Thickness, 2.0)]),
            _ => Edits::default(),
        };
        let of_side = |side: Side| {
            let target = EditTarget::LeafSide(leaf, side);
            match name {
                "little pigment" => {
                    self.preset(target, &[0, 1, 2].map(|c| times(target, EditQuantity::SigmaA(c), 0.3)))
                }
                "matte" => self.preset(target, &[(EditQuantity::RhoS, 0.0)]),
                "polished" => self.preset(target, &[(EditQuantity::M, 0.5)]),
                _ => Edits::default(),
            }
        };
        let [front, back] = Side::ALL.map(of_side);
        thickness.iter().chain(front.iter()).chain(back.iter()).collect()
    }

    /// Applies a preset of lights. A name that is no preset changes nothing.
    pub fn preset_lights(&mut self, name: &str) {
        if LIGHTS.iter().any(|p| p.0 == name) {
            self.restore(&self.edits.replaced(EditGroup::Light, &self.preset_light(name)));
        }
    }

    /// Applies a preset of a leaf to leaf `leaf`. A name that is no preset changes nothing.
    pub fn preset_leaf_edit(&mut self, leaf: usize, name: &str) {
        if LEAVES.iter().chain(&STATED).any(|p| p.0 == name) {
            self.restore(&self.edits.replaced(EditGroup::Leaf(leaf), &self.preset_leaf(leaf, name)));
        }
    }

    pub(super) fn light_presets(&mut self, ui: &mut egui::Ui) {
        let usable: Vec<(&str, &str)> = LIGHTS
            .into_iter()
            .filter(|p| p.0 == "as opened" || !self.preset_light(p.0).is_empty())
            .filter(|p| self.made.scene.sun.is_some() || p.0 != "sky alone")
            .collect();
        let now = self.edits.of(EditGroup::Light);
        let chosen = usable.iter().find(|p| self.preset_light(p.0) == now).map_or("own", |p| p.0);
        if let Some(name) = self.presets(ui, "light preset", chosen, &usable) {
            self.preset_lights(name);
        }
    }

    pub(super) fn leaf_presets(&mut self, ui: &mut egui::Ui) {
        let leaf = self.view.leaf;
        let all: &[(&str, &str)] = if self.has_tissue(leaf) { &LEAVES } else { &STATED };
        let now = self.edits.of(EditGroup::Leaf(leaf));
        let chosen = all.iter().find(|p| self.preset_leaf(leaf, p.0) == now).map_or("own", |p| p.0);
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
