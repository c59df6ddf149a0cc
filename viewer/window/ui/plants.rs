//! The plants panel: factors on taper, load and sway of a level of branches or of one branch (Habel 2009, Table 4.2 and
//! Fig. 4.17). A change is sent to `Editor::bend`, and the next picture shows the result.

use super::ViewerUi;
use crate::editor::{BranchEdit, PlantEdits, PlantInfo, PlantPart};
use egui::{RichText, Slider};
use mesophyll_viewer::scene::Material;
use std::rc::Rc;

/// What the panel shows and what was edited.
pub(crate) struct Plants {
    all: Vec<Rc<PlantInfo>>,
    plant: usize,
    part: PlantPart,
    /// The name in the text field.
    name: String,
    /// The factors on the sliders, which a drag changes before the scene takes them over.
    shown: BranchEdit,
    edits: PlantEdits,
}

impl Plants {
    pub(crate) fn new(all: Vec<PlantInfo>) -> Plants {
        let (part, shown) = (PlantPart::Level(0), BranchEdit::NONE);
        let all = all.into_iter().map(Rc::new).collect();
        Plants { all, plant: 0, part, name: String::new(), shown, edits: PlantEdits::new() }
    }

    fn edit(&self) -> BranchEdit {
        self.edits.get(&(self.plant, self.part)).copied().unwrap_or(BranchEdit::NONE)
    }

    /// Shows another part of a plant.
    fn choose(&mut self, plant: usize, part: PlantPart) {
        (self.plant, self.part) = (plant, part);
        self.shown = self.edit();
    }
}

/// Name of a part of a plant.
fn called(plant: &PlantInfo, part: PlantPart) -> String {
    match part {
        PlantPart::Level(level) => {
            let count = plant.branches.iter().filter(|b| b.1 == level).count();
            format!("level {level} ({count} branch{})", if count == 1 { "" } else { "es" })
        }
        PlantPart::Branch(index) => plant.branches.get(index).map_or_else(String::new, |b| format!("branch {}", b.0)),
    }
}

impl ViewerUi {
    /// The panel, which is shown where the scene has plants.
    pub(super) fn plants(&mut self, ui: &mut egui::Ui) {
        let Some(plant) = self.plants.all.get(self.plants.plant).cloned() else { return };
        ui.heading("Branches");
        self.choose_part(ui, &plant);
        let mut edit = self.plants.shown;
        let mut settled = false;
        let sways = self.scene.wind.is_some();
        for (name, value, range, hint, on) in [
            ("taper ×", &mut edit.taper, 0.1..=4.0, "factor on tip radius over root radius; no unit", true),
            (
                "load ×",
                &mut edit.load,
                0.0..=10.0,
                "factor on the weight that the branch carries; it bends by what is added",
                true,
            ),
            ("lean ×", &mut edit.lean, 0.0..=5.0, "factor on the way of the tip in a steady wind", sways),
            ("resonance ×", &mut edit.resonance, 0.2..=5.0, "factor on the branch's own frequency", sways),
            ("damping ×", &mut edit.damping, 0.1..=10.0, "factor on how fast it comes to rest", sways),
        ] {
            // Halves and doubles lie on both sides of the middle.
            let slider = Slider::new(value, range.clone()).logarithmic(*range.start() > 0.0);
            let slider =
                ui.add_enabled(on, slider.max_decimals(2).update_while_editing(false).text(name)).on_hover_text(hint);
            self.landmark(name, &slider);
            // A plant is posed anew when the pointer lets go, because that takes a while.
            settled |= slider.drag_stopped() || (slider.changed() && !slider.dragged());
        }
        self.plants.shown = edit;
        if settled && edit != self.plants.edit() {
            self.set_branches(self.plants.plant, self.plants.part, edit);
        }
        ui.horizontal(|ui| {
            let mine = |key: &(usize, PlantPart)| key.0 == self.plants.plant;
            let changed = self.plants.edits.keys().any(mine);
            let reset = ui.add_enabled(changed, egui::Button::new("Reset plant"));
            self.landmark("reset plant", &reset);
            let save = ui.add_enabled(changed, egui::Button::new("Save as new plant"));
            self.landmark("save plant", &save);
            if reset.clicked() {
                let mut edits = self.plants.edits.clone();
                edits.retain(|key, _| key.0 != self.plants.plant);
                self.bend(edits);
            }
            if save.clicked() {
                self.message = match self.editor.save_plant(self.plants.plant) {
                    Ok(place) => format!("saved: {place}"),
                    Err(reason) => format!("not saved: {reason}"),
                };
            }
        });
        ui.separator();
    }

    fn choose_part(&mut self, ui: &mut egui::Ui, plant: &PlantInfo) {
        let (mut chosen, mut part) = (self.plants.plant, self.plants.part);
        if self.plants.all.len() > 1 {
            egui::ComboBox::from_id_salt("plant").selected_text(&plant.name).width(170.0).show_ui(ui, |ui| {
                for (k, other) in self.plants.all.iter().enumerate() {
                    ui.selectable_value(&mut chosen, k, &other.name);
                }
            });
        }
        let levels = plant.branches.iter().map(|b| b.1).max().unwrap_or(0);
        let part_box = egui::ComboBox::from_id_salt("part").selected_text(called(plant, part)).width(170.0);
        let shown = part_box.show_ui(ui, |ui| {
            for level in 0..=levels {
                ui.selectable_value(&mut part, PlantPart::Level(level), called(plant, PlantPart::Level(level)));
            }
        });
        self.landmark("part", &shown.response);
        ui.horizontal(|ui| {
            ui.label("one branch");
            let field = ui.add(egui::TextEdit::singleline(&mut self.plants.name).hint_text("its name"));
            self.landmark("branch name", &field);
            if field.lost_focus() && !self.plants.name.is_empty() {
                match plant.branches.iter().position(|b| b.0 == self.plants.name) {
                    Some(index) => {
                        part = PlantPart::Branch(index);
                        self.message.clear();
                    }
                    None => self.message = format!("the plant has no branch \"{}\"", self.plants.name),
                }
            }
        });
        if (chosen, part) != (self.plants.plant, self.plants.part) {
            let part = if chosen == self.plants.plant { part } else { PlantPart::Level(0) };
            self.plants.choose(chosen, part);
        }
        if self.scene.wind.is_none() {
            ui.label(RichText::new("Nothing sways in this scene.").weak());
        }
    }

    /// Applies factors to a part of a plant: the editor poses the plants again, and the picture shows the result. A
    /// refusal is shown, and the plants stay unchanged.
    pub fn set_branches(&mut self, plant: usize, part: PlantPart, edit: BranchEdit) {
        let mut edits = self.plants.edits.clone();
        match edit == BranchEdit::NONE {
            true => edits.remove(&(plant, part)),
            false => edits.insert((plant, part), edit),
        };
        self.bend(edits);
    }

    /// The edits of branches that the picture shows.
    pub fn branch_edits(&self) -> &PlantEdits {
        &self.plants.edits
    }

    pub(super) fn bend(&mut self, edits: PlantEdits) {
        match self.editor.bend(&edits) {
            Ok(new) => {
                // Leaves come first among the materials. They keep their edits.
                let leaves = new.materials.iter().take_while(|m| matches!(m, Material::Leaf(_))).count();
                self.scene.materials.truncate(leaves);
                self.scene.materials.extend(new.materials.into_iter().skip(leaves));
                (self.scene.meshes, self.scene.sections) = (new.meshes, new.sections);
                self.instances = new.instances;
                self.plants.edits = edits;
                self.message.clear();
                self.show_alone(self.alone);
            }
            Err(reason) => self.message = reason,
        }
        self.plants.shown = self.plants.edit();
    }
}
