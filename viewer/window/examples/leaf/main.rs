//! Draws a made-up leaf without any measurement.
//!
//! ```text
//! cargo run -p mesophyll-window --example leaf -- out.png                  a picture, with times and what was uploaded
//! cargo run -p mesophyll-window --example leaf -- --window                 the window
//! cargo run -p mesophyll-window --example leaf -- --window shot.png 3      the window for three frames, drawn
//! ```

mod example_leaf;

use mesophyll_viewer::scene::{Camera, Interior, Scene, Side, Sides};
use mesophyll_viewer::{Options, Picture, Renderer};
use mesophyll_window::edit::{EditQuantity, EditTarget, Edits};
use mesophyll_window::editor::{ComparisonVerdict, DisplayPicture, Editor, VerdictMeasure};
use mesophyll_window::{WindowOptions, WindowScene, WindowView, open_window};

/// Replaces the program around the window. Its slab is a two-stream model, and its reference is the renderer without
/// shadows.
struct StandIn;

impl Editor for StandIn {
    fn start(&self, leaf: usize) -> Edits {
        Edits::tissue(leaf, 0.2, Sides::of(example_leaf::start))
    }

    fn recompute(&mut self, leaf: usize, edits: &Edits) -> Result<Sides<Interior>, String> {
        let now = self.start(leaf).with(edits.iter(), |_| None);
        let interior = |side| {
            let of = |quantity| now.factor(EditTarget::LeafSide(leaf, side), quantity);
            let sigmas: [fn(usize) -> EditQuantity; 2] = [EditQuantity::SigmaA, EditQuantity::SigmaS];
            Interior::Scalars(example_leaf::curve(sigmas.map(|sigma| [0, 1, 2].map(|c| of(sigma(c))))))
        };
        Ok(Sides::of(interior))
    }

    fn save(&mut self, _: usize, _: &Edits) -> Result<String, String> {
        Err("a made-up leaf has no fit to save".into())
    }

    fn reference(&mut self, scene: &Scene, camera: &Camera, width: u32, height: u32) -> Result<DisplayPicture, String> {
        let mut renderer = Renderer::headless(&Options::default()).map_err(|e| e.to_string())?;
        let bare = Scene { shadow_samples: 0, ..scene.clone() };
        renderer.set_scene(&bare).map_err(|e| e.to_string())?;
        let picture = renderer.render(camera, width, height).map_err(|e| e.to_string())?;
        Ok(DisplayPicture { width, height, ldr: picture.ldr })
    }

    fn judge(&mut self, picture: &Picture, reference: &DisplayPicture) -> ComparisonVerdict {
        let worst = picture.ldr.iter().zip(&reference.ldr).map(|(a, b)| a[1].abs_diff(b[1])).max().unwrap_or(0);
        let measure = VerdictMeasure { name: "largest error".into(), value: f64::from(worst) / 255.0, threshold: 0.05 };
        let note = "This stand-in reference casts no shadows.".into();
        ComparisonVerdict { passed: measure.value <= measure.threshold, measures: vec![measure], note }
    }

    fn probe(&self, _: usize, side: Side, texel: [u32; 2]) -> Vec<(String, String)> {
        let t = example_leaf::side(side).gamma_delta[(texel[1] * example_leaf::WIDTH + texel[0]) as usize];
        vec![
            ("γ".into(), format!("{:.3} {:.3} {:.3}", t[0], t[1], t[2])),
            ("δ".into(), format!("{:+.3} mm", t[3])),
            ("h + δ".into(), format!("{:.3} mm", 0.2 + t[3])),
        ]
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    if words.first().is_some_and(|w| w == "--window") {
        let scene = WindowScene {
            title: "made-up leaf".into(),
            scene: example_leaf::scene(true),
            camera: example_leaf::camera(),
            views: vec![WindowView { name: "above".into(), camera: example_leaf::camera(), time_s: None }],
            check_size: [400, 300],
            screenshots: ".".into(),
        };
        let frames = words.get(2).map(|n| n.parse()).transpose()?;
        let options = WindowOptions { screenshot: words.get(1).map(Into::into), frames, ..Default::default() };
        return Ok(open_window(scene, Box::new(StandIn), &options)?);
    }
    let path = words.first().map_or("leaf.png", String::as_str);
    let mut renderer = Renderer::headless(&Options::default())?;
    renderer.set_scene(&example_leaf::scene(true))?;
    renderer.render(&example_leaf::camera(), 800, 600)?.save_png(path.as_ref())?;
    let timing = renderer.time(&example_leaf::camera(), 800, 600, 5)?;
    println!("{:?}: median {:.1?} ms, {:.1?}", renderer.adapter(), timing.quantile(0.5), timing.passes);
    println!("{:#?}", renderer.stats());
    Ok(())
}
