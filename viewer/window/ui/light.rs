//! The lights panel: the sun's direction, the brightness of sun and sky, exposure, and the scene's own views.

use super::{ViewerUi, WindowView};
use egui::{RichText, Slider, SliderClamping};
use glam::Vec3;
use mesophyll_viewer::OrbitCamera;
use std::sync::Arc;

/// Sliders change a value only when they are moved, because the scene's own sun has more digits than a slider shows.
const EDITS: SliderClamping = SliderClamping::Edits;

/// Azimuth from +x towards +y, and elevation above the horizon, of a direction (degrees).
pub(crate) fn angles(direction: Vec3) -> (f32, f32) {
    (direction.y.atan2(direction.x).to_degrees(), direction.z.clamp(-1.0, 1.0).asin().to_degrees())
}

/// The direction with an azimuth and an elevation (degrees).
pub(crate) fn direction(azimuth: f32, elevation: f32) -> Vec3 {
    let ((sin_a, cos_a), (sin_e, cos_e)) = (azimuth.to_radians().sin_cos(), elevation.to_radians().sin_cos());
    Vec3::new(cos_e * cos_a, cos_e * sin_a, sin_e)
}

/// The lights as a user sets them.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Light {
    /// Direction to the sun, where the scene has one. The scene's own has more digits than the angles.
    pub direction: Option<Vec3>,
    /// Azimuth and elevation of the sun (degrees).
    pub azimuth: f32,
    pub elevation: f32,
    pub sun_factor: f32,
    pub sky_factor: f32,
    pub turbidity: f32,
    pub exposure: f32,
}

impl ViewerUi {
    /// The lights as the sliders show them.
    pub(super) fn light(&self) -> Light {
        Light {
            direction: self.scene.sun.map(|s| s.direction),
            azimuth: self.sun_angles.0,
            elevation: self.sun_angles.1,
            sun_factor: self.sun_factor,
            sky_factor: self.sky_factor,
            turbidity: self.turbidity,
            exposure: self.scene.exposure,
        }
    }

    /// Changes the lights, and asks for another sky where the sun or the air has changed.
    pub(super) fn set_light(&mut self, to: Light) {
        let before = self.light();
        if to == before {
            return;
        }
        self.sun_angles = (to.azimuth, to.elevation);
        (self.sun_factor, self.sky_factor, self.turbidity) = (to.sun_factor, to.sky_factor, to.turbidity);
        self.scene.exposure = to.exposure;
        if let (Some(sun), Some(direction)) = (&mut self.scene.sun, to.direction) {
            sun.direction = direction;
        }
        if (before.direction, before.turbidity) != (to.direction, to.turbidity) {
            self.renew_sky();
        }
        if let (Some(sun), Some(own)) = (&mut self.scene.sun, self.own_sun) {
            sun.irradiance = own.map(|v| v * self.sun_factor);
        }
        self.scene.sky = self.own_sky.map(|sky| sky.map(|v| v * self.sky_factor));
        if let Some(dome) = &mut self.scene.dome {
            dome.strength = self.sky_factor;
        }
        self.lights_changed = true;
        self.make_stale();
    }

    pub(super) fn lights(&mut self, ui: &mut egui::Ui) {
        ui.heading("Light");
        self.light_presets(ui);
        ui.spacing_mut().slider_width = 110.0;
        let mut light = self.light();
        let model = self.scene.dome.as_ref().is_some_and(|dome| dome.is_model());
        if light.direction.is_some() {
            // The angles are stored besides the direction, because a direction at the zenith has no azimuth.
            let azimuth = Slider::new(&mut light.azimuth, -180.0..=180.0);
            let azimuth = ui.add(azimuth.suffix("°").max_decimals(1).clamping(EDITS).text("azimuth"));
            self.landmark("azimuth", &azimuth);
            // Under the model of a sky the sun cannot go below the horizon.
            let lowest = if model { 0.0 } else { -90.0 };
            let elevation = Slider::new(&mut light.elevation, lowest..=90.0);
            let elevation = ui.add(elevation.suffix("°").max_decimals(1).clamping(EDITS).text("elevation"));
            self.landmark("elevation", &elevation);
            if azimuth.changed() || elevation.changed() {
                light.direction = Some(direction(light.azimuth, light.elevation));
            }
            azimuth.on_hover_text("the sun's azimuth, in degrees from +x towards +y");
            elevation.on_hover_text("the sun's height above the horizon, in degrees");
            let factor = ui.add(Slider::new(&mut light.sun_factor, 0.0..=4.0).text("sun ×"));
            factor.on_hover_text("factor on the sun's irradiance; 1 is the scene's");
        } else {
            ui.label(RichText::new("This scene has no sun.").weak());
        }
        if model {
            let slider = Slider::new(&mut light.turbidity, 1.7..=10.0);
            let turbidity = ui.add(slider.max_decimals(2).clamping(EDITS).text("turbidity"));
            self.landmark("turbidity", &turbidity);
            turbidity.on_hover_text("haze in the air, without a unit: 2 is very clear, 6 is hazy");
        }
        if self.scene.sky.is_some() || self.scene.dome.is_some() {
            let factor = ui.add(Slider::new(&mut light.sky_factor, 0.0..=4.0).text("sky ×"));
            factor.on_hover_text("factor on the sky's radiance; 1 is the scene's");
        } else {
            ui.label(RichText::new("This scene has no sky.").weak());
        }
        let exposure = ui.add(Slider::new(&mut light.exposure, 1e-3..=1e3).logarithmic(true).text("exposure"));
        self.landmark("exposure", &exposure);
        exposure.on_hover_text("factor on radiance before it is shown as x / (1 + x)");
        self.set_light(light);
        if self.scene.backdrop.is_some() {
            let shown = ui.checkbox(&mut self.backdrop_shown, "environment map behind");
            self.landmark("backdrop", &shown);
            self.dirty |= shown.changed();
            shown.on_hover_text("the picture of --background; it lights nothing, and checks leave it out");
        }
        if !self.views.is_empty() {
            ui.horizontal_wrapped(|ui| {
                ui.label("view");
                for WindowView { name, camera, time_s } in self.views.clone() {
                    let button = ui.button(&name);
                    self.landmark(&format!("view {name}"), &button);
                    if button.clicked() {
                        self.orbit = OrbitCamera::new(camera, self.radius);
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
        let (Some(old), Some(sun)) = (&self.sun_shares, self.scene.sun) else { return false };
        let (new, more) = match self.editor.shares(sun.direction) {
            Ok(found) => found,
            Err(reason) => {
                self.message = reason;
                // The panel of this frame has been made already.
                return true;
            }
        };
        if let Some(new) = new.filter(|new| new.len() == old.len()) {
            self.sun_shares = Some(Arc::new(new));
            if !self.alone {
                self.scene.sun_shares = self.sun_shares.clone();
                self.lights_changed = true;
                self.make_stale();
            }
        }
        more
    }

    /// Requests the sky for the present sun and turbidity. A refusal is shown, and the sky stays unchanged.
    fn renew_sky(&mut self) {
        let (Some(dome), Some(sun)) = (&self.scene.dome, self.scene.sun) else { return };
        if !dome.is_model() {
            return;
        }
        match self.editor.sky(sun.direction, self.turbidity) {
            Ok(update) => {
                self.message.clear();
                self.scene.dome = Some(update.dome);
                self.own_sun = Some(update.sun_irradiance);
            }
            Err(reason) => self.message = reason,
        }
    }
}
