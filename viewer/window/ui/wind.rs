//! The wind panel: the scene's time, set by hand or running.

use super::{Change, ViewerUi};
use egui::Slider;

/// Length of the time slider (s).
const SPAN: f64 = 60.0;

impl ViewerUi {
    /// The panel, which is shown where branches sway.
    pub(super) fn wind(&mut self, ui: &mut egui::Ui) {
        let Some(wind) = &mut self.made.scene.wind else { return };
        ui.heading("Wind");
        ui.spacing_mut().slider_width = 110.0;
        let before = wind.time_s;
        if self.view.playing {
            // A frame that comes late must not make the branches jump.
            wind.time_s += f64::from(ui.input(|i| i.stable_dt).min(0.1));
        }
        let most = SPAN.max(wind.time_s);
        let time = ui.add(Slider::new(&mut wind.time_s, 0.0..=most).suffix(" s").max_decimals(2).text("time"));
        let changed = wind.time_s != before;
        self.landmark("time", &time);
        time.on_hover_text("time at which the scene is seen, in seconds");
        let play = ui.button(if self.view.playing { "Stop" } else { "Play" });
        self.landmark("play", &play);
        if play.clicked() {
            self.view.playing = !self.view.playing;
        }
        if changed {
            self.moved();
        }
        ui.separator();
    }

    /// Shows the scene at a time (s), and stops the clock there.
    pub(super) fn set_time(&mut self, time_s: f64) {
        let Some(wind) = &mut self.made.scene.wind else { return };
        wind.time_s = time_s;
        self.view.playing = false;
        self.moved();
    }

    fn moved(&mut self) {
        self.made.versions.change(Change::Time);
    }
}
