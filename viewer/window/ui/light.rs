//! The lights panel: the sun's direction, the brightness of sun and sky, exposure, and the scene's own views.

use super::{ViewerUi, WindowView};
use crate::ui::orbit::Orbit;
use egui::{RichText, Slider, SliderClamping};
use glam::Vec3;
use mesophyll_viewer::scene::Sun;
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

impl ViewerUi {
    pub(super) fn lights(&mut self, ui: &mut egui::Ui) {
        ui.heading("Light");
        ui.spacing_mut().slider_width = 110.0;
        let before = (
            self.scene.sun.map(|s| s.direction),
            self.sun_factor,
            self.sky_factor,
            self.scene.exposure,
            self.turbidity,
        );
        if let Some(sun) = self.scene.sun {
            // The angles are stored besides the direction, because a direction at the zenith has no azimuth.
            let azimuth = ui.add(
                Slider::new(&mut self.sun_angles.0, -180.0..=180.0)
                    .suffix("°")
                    .max_decimals(1)
                    .clamping(EDITS)
                    .text("azimuth"),
            );
            self.landmark("azimuth", &azimuth);
            // Under a dome the sun cannot go below the horizon.
            let lowest = if self.scene.dome.is_some() { 0.0 } else { -90.0 };
            let elevation = ui.add(
                Slider::new(&mut self.sun_angles.1, lowest..=90.0)
                    .suffix("°")
                    .max_decimals(1)
                    .clamping(EDITS)
                    .text("elevation"),
            );
            self.landmark("elevation", &elevation);
            ui.add(Slider::new(&mut self.sun_factor, 0.0..=4.0).text("sun ×"));
            if azimuth.changed() || elevation.changed() {
                self.scene.sun = Some(Sun { direction: direction(self.sun_angles.0, self.sun_angles.1), ..sun });
            }
        } else {
            ui.label(RichText::new("This scene has no sun.").weak());
        }
        if self.scene.dome.is_some() {
            let turbidity =
                ui.add(Slider::new(&mut self.turbidity, 1.7..=10.0).max_decimals(2).clamping(EDITS).text("turbidity"));
            self.landmark("turbidity", &turbidity);
        }
        if self.scene.sky.is_some() || self.scene.dome.is_some() {
            ui.add(Slider::new(&mut self.sky_factor, 0.0..=4.0).text("sky ×"));
        } else {
            ui.label(RichText::new("This scene has no sky.").weak());
        }
        let exposure = ui.add(Slider::new(&mut self.scene.exposure, 1e-3..=1e3).logarithmic(true).text("exposure"));
        self.landmark("exposure", &exposure);
        if before
            != (
                self.scene.sun.map(|s| s.direction),
                self.sun_factor,
                self.sky_factor,
                self.scene.exposure,
                self.turbidity,
            )
        {
            if before.0 != self.scene.sun.map(|s| s.direction) || before.4 != self.turbidity {
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
        if !self.views.is_empty() {
            ui.horizontal_wrapped(|ui| {
                ui.label("view");
                for WindowView { name, camera, time_s } in self.views.clone() {
                    let button = ui.button(&name);
                    self.landmark(&format!("view {name}"), &button);
                    if button.clicked() {
                        self.orbit = Orbit::new(camera, self.radius);
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
        let (Some(_), Some(sun)) = (&self.scene.dome, self.scene.sun) else { return };
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
