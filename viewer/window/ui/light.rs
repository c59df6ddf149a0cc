//! The lights panel: the sun's direction, the brightness of sun and sky, exposure, and the scene's own views.

use super::{Change, ViewerUi, WindowView};
use crate::edit::{Edit, EditQuantity, EditTarget, Edits};
use egui::RichText;
use glam::Vec3;
use mesophyll_viewer::OrbitCamera;
use mesophyll_viewer::scene::Scene;
use std::sync::Arc;

/// Azimuth from +x towards +y, and elevation above the horizon, of a direction (degrees).
fn angles(direction: Vec3) -> (f32, f32) {
    (direction.y.atan2(direction.x).to_degrees(), direction.z.clamp(-1.0, 1.0).asin().to_degrees())
}

/// The direction with an azimuth and an elevation (degrees).
fn direction(azimuth: f32, elevation: f32) -> Vec3 {
    let ((sin_a, cos_a), (sin_e, cos_e)) = (azimuth.to_radians().sin_cos(), elevation.to_radians().sin_cos());
    Vec3::new(cos_e * cos_a, cos_e * sin_a, sin_e)
}

/// The lights of a scene as values.
pub(super) fn starts(scene: &Scene) -> Vec<Edit> {
    let angles = scene.sun.map(|s| angles(s.direction));
    let turbidity = scene.dome.as_ref().filter(|dome| dome.is_model()).map(|dome| dome.turbidity);
    let values = [
        (EditQuantity::Azimuth, angles.map(|a| a.0)),
        (EditQuantity::Elevation, angles.map(|a| a.1)),
        (EditQuantity::Turbidity, turbidity),
        (EditQuantity::Exposure, Some(scene.exposure)),
    ];
    let edit = |(quantity, value): (_, Option<f32>)| {
        Some(Edit { target: EditTarget::Light, quantity, value: f64::from(value?) })
    };
    values.into_iter().filter_map(edit).collect()
}

impl ViewerUi {
    /// Whether the sky is one of a model, which follows the sun.
    pub(super) fn has_model(&self) -> bool {
        self.made.scene.dome.as_ref().is_some_and(|dome| dome.is_model())
    }

    /// Direction to the sun with `edits`. A sun that nobody has moved keeps the digits of the scene's own.
    fn sun_direction(&self, edits: &Edits) -> Option<Vec3> {
        let own = self.opened.sun_direction?;
        let angles = [EditQuantity::Azimuth, EditQuantity::Elevation];
        if angles.iter().all(|q| edits.get(EditTarget::Light, *q).is_none()) {
            return Some(own);
        }
        let [azimuth, elevation] = angles.map(|q| self.with(edits, EditTarget::Light, q));
        Some(direction(azimuth? as f32, elevation? as f32))
    }

    /// Changes the lights, and asks for another sky where the sun or the air has changed.
    pub(super) fn relight(&mut self, edits: &Edits) -> Result<(), String> {
        let value = |edits: &Edits, q| self.with(edits, EditTarget::Light, q).map(|v| v as f32);
        let factor = |q| edits.factor(EditTarget::Light, q) as f32;
        let (sun_factor, sky_factor) = (factor(EditQuantity::Sun), factor(EditQuantity::Sky));
        let (direction, before) = (self.sun_direction(edits), self.sun_direction(&self.edits));
        let [turbidity, air] = [edits, &self.edits].map(|e| value(e, EditQuantity::Turbidity));
        let exposure = value(edits, EditQuantity::Exposure);
        let renewed = (direction, turbidity) != (before, air) && self.has_model();
        if let (true, Some(direction), Some(turbidity)) = (renewed, direction, turbidity) {
            let update = self.editor.sky(direction, turbidity)?;
            self.made.scene.dome = Some(update.dome);
            self.made.sun_irradiance = Some(update.sun_irradiance);
        }
        let scene = &mut self.made.scene;
        if let (Some(sun), Some(direction), Some(own)) = (&mut scene.sun, direction, self.made.sun_irradiance) {
            (sun.direction, sun.irradiance) = (direction, own.map(|v| v * sun_factor));
        }
        scene.sky = self.opened.sky.map(|sky| sky.map(|v| v * sky_factor));
        if let Some(dome) = &mut scene.dome {
            dome.strength = sky_factor;
        }
        scene.exposure = exposure.unwrap_or(scene.exposure);
        self.made.versions.change(Change::Lights);
        Ok(())
    }

    pub(super) fn lights(&mut self, ui: &mut egui::Ui) {
        ui.heading("Light");
        self.light_presets(ui);
        ui.spacing_mut().slider_width = 110.0;
        if self.made.scene.sun.is_some() {
            for quantity in [EditQuantity::Azimuth, EditQuantity::Elevation, EditQuantity::Sun] {
                self.slider(ui, EditTarget::Light, quantity);
            }
        } else {
            ui.label(RichText::new("This scene has no sun.").weak());
        }
        if self.has_model() {
            self.slider(ui, EditTarget::Light, EditQuantity::Turbidity);
        }
        if self.made.scene.sky.is_some() || self.made.scene.dome.is_some() {
            self.slider(ui, EditTarget::Light, EditQuantity::Sky);
        } else {
            ui.label(RichText::new("This scene has no sky.").weak());
        }
        self.slider(ui, EditTarget::Light, EditQuantity::Exposure);
        if self.made.scene.backdrop.is_some() {
            let shown = ui.checkbox(&mut self.view.backdrop_shown, "backdrop");
            self.landmark("backdrop", &shown);
            shown.on_hover_text("what is seen behind the scene; it lights nothing, and checks leave it out");
        }
        if !self.opened.window.views.is_empty() {
            ui.horizontal_wrapped(|ui| {
                ui.label("view");
                for WindowView { name, camera, time_s } in self.opened.window.views.clone() {
                    let button = ui.button(&name);
                    self.landmark(&format!("view {name}"), &button);
                    if button.clicked() {
                        self.view.orbit = OrbitCamera::new(camera, self.opened.radius);
                        self.camera_changed();
                        if let Some(time_s) = time_s {
                            self.set_time(time_s);
                        }
                    }
                }
            });
        }
    }

    /// Takes over the shares of the sun that vertices see, as soon as they are known for the sun's present direction.
    /// Until then the vertices keep their old shares. If the shares cannot be computed, a message says so once. Returns
    /// whether another frame must follow.
    pub(crate) fn follow_sun(&mut self) -> bool {
        let (Some(old), Some(sun)) = (&self.made.sun_shares, self.made.scene.sun) else { return false };
        let (new, more) = match self.editor.shares(sun.direction) {
            Ok(found) => found,
            Err(reason) => {
                self.message = reason;
                // The panel of this frame has been made already.
                return true;
            }
        };
        if let Some(new) = new.filter(|new| new.len() == old.len()) {
            self.made.sun_shares = Some(Arc::new(new));
            if !self.view.alone {
                self.made.scene.sun_shares = self.made.sun_shares.clone();
                self.made.versions.change(Change::Lights);
            }
        }
        more
    }
}
