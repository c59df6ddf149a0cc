//! The plants panel: factors on taper, load and sway of a level of branches or of one branch (Habel 2009, Table 4.2 and
//! Fig. 4.17). A change is sent to `Editor::bend`, and the next picture shows the result.

use super::ViewerUi;
use crate::edit::{EditQuantity, EditTarget, Edits};
use crate::editor::{PlantInfo, PlantPart};
use egui::RichText;
use mesophyll_viewer::scene::Material;

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
        let Some(info) = self.opened.plants.get(self.view.part.0).cloned() else { return };
        ui.heading("Branches");
        self.choose_part(ui, &info);
        let (plant, part) = self.view.part;
        EditQuantity::PLANT.into_iter().for_each(|q| self.slider(ui, EditTarget::Plant(plant, part), q));
        ui.horizontal(|ui| {
            let others = self.edits.iter().filter(|e| !matches!(e.target, EditTarget::Plant(p, _) if p == plant));
            let others: Edits = others.collect();
            let changed = others != self.edits;
            let reset = ui.add_enabled(changed, egui::Button::new("Reset plant"));
            self.landmark("reset plant", &reset);
            let save = ui.add_enabled(changed, egui::Button::new("Save as new plant"));
            self.landmark("save plant", &save);
            if reset.clicked() {
                self.restore(&others);
            }
            if save.clicked() {
                self.message = match self.editor.save_plant(plant) {
                    Ok(place) => format!("saved: {place}"),
                    Err(reason) => format!("not saved: {reason}"),
                };
            }
        });
        ui.separator();
    }

    fn choose_part(&mut self, ui: &mut egui::Ui, plant: &PlantInfo) {
        let (mut chosen, mut part) = self.view.part;
        if self.opened.plants.len() > 1 {
            egui::ComboBox::from_id_salt("plant").selected_text(&plant.name).width(170.0).show_ui(ui, |ui| {
                for (k, other) in self.opened.plants.iter().enumerate() {
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
            let field = ui.add(egui::TextEdit::singleline(&mut self.view.branch_name).hint_text("its name"));
            self.landmark("branch name", &field);
            if field.lost_focus() && !self.view.branch_name.is_empty() {
                match plant.branches.iter().position(|b| b.0 == self.view.branch_name) {
                    Some(index) => {
                        part = PlantPart::Branch(index);
                        self.message.clear();
                    }
                    None => self.message = format!("the plant has no branch \"{}\"", self.view.branch_name),
                }
            }
        });
        self.view.part = (chosen, if chosen == self.view.part.0 { part } else { PlantPart::Level(0) });
        if self.made.scene.wind.is_none() {
            ui.label(RichText::new("Nothing sways in this scene.").weak());
        }
    }

    /// The editor poses the plants again.
    pub(super) fn bend(&mut self, edits: &Edits) -> Result<(), String> {
        let new = self.editor.bend(edits)?;
        // Leaves come first among the materials. They keep their edits.
        let leaves = new.materials.iter().take_while(|m| matches!(m, Material::Leaf(_))).count();
        let scene = &mut self.made.scene;
        scene.materials.truncate(leaves);
        scene.materials.extend(new.materials.into_iter().skip(leaves));
        (scene.meshes, scene.sections) = (new.meshes, new.sections);
        self.made.instances = new.instances;
        self.show_alone(self.view.alone);
        Ok(())
    }
}
