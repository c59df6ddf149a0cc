//! Pictures by the real-time renderer, of the same views and in the same sizes as those of the path tracer.

use crate::draw::handover;
use crate::loaded::LoadedScene;
use crate::path_tracing::{Options, RECORD, views};
use crate::placed::ledger::Ledger;
use crate::{Error, Result};
use mesophyll_files::image::{self, ChannelMaps, Packing};
use mesophyll_files::{atomic, memory, progress};
use mesophyll_transport::comparison;
use mesophyll_viewer as viewer;
use serde::Serialize;
use std::path::Path;

/// The result for one view.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RealTimeView {
    /// The view's name.
    pub view: String,
    /// Pixels across and down.
    pub size: [u32; 2],
    /// The adapter that drew it.
    pub adapter: String,
    /// Mean FLIP and the FLIP that 99 % of the pixels stay below, from the picture that it is compared with.
    pub flip: Option<[f64; 2]>,
}

/// Draws the views of a scene, and compares each with the PNG of the same name in the folder `against`. `tell` is
/// called for each view that is finished. Of the options, those of paths are not used.
///
/// # Errors
/// [`Error::Usage`] for a view that the scene does not have; [`Error::Missed`] without an adapter, or where it fails;
/// [`Error::Input`] for a damaged input; [`Error::Interrupted`] after Ctrl-C.
pub fn render(
    scene: &LoadedScene,
    options: &Options,
    against: Option<&Path>,
    ledger: &Ledger,
    mut tell: impl FnMut(&RealTimeView) -> Result<()>,
) -> Result<()> {
    let drawn_by = |e: viewer::Error| {
        let hint = if matches!(e, viewer::Error::NoAdapter) { memory::hint() } else { String::new() };
        Error::Missed(format!("the renderer failed: {e}{hint}"))
    };
    let views = views(scene, options.view.as_deref())?;
    let mut renderer = viewer::Renderer::headless(&viewer::Options::default()).map_err(drawn_by)?;
    let adapter = renderer.adapter().clone();
    let display = scene.manifest.display_by(options.tone);
    let mut drawn = handover::shown(scene, display, ledger)?;
    renderer.set_scene(&drawn).map_err(drawn_by)?;
    let [width, height] = [scene.manifest.check.width, scene.manifest.check.height];
    let mut all = Vec::new();
    for view in views {
        progress::go_on()?;
        if let Some(wind) = &mut drawn.wind {
            wind.time_s = scene.manifest.time_of(view);
            renderer.set_time(wind);
        }
        let picture = renderer.render(&handover::camera(&view.camera), width, height).map_err(drawn_by)?;
        // A picture that cannot be compared with leaves what is there as it is.
        let flip = against.map(|folder| flip(&folder.join(format!("{}.png", view.name)), &picture)).transpose()?;
        let file = |ending: &str| options.out.join(format!("{}.{ending}", view.name));
        let channel = |c: usize| picture.hdr.iter().map(|pixel| pixel[c]).collect::<Vec<f32>>();
        let channels = [("R", 0), ("G", 1), ("B", 2), ("A", 3)].map(|(name, c)| (name.to_string(), channel(c)));
        let maps = ChannelMaps { width: width as usize, height: height as usize, channels: channels.into() };
        image::write_exr(&file("exr"), &maps, Packing::Zip)?;
        image::write_png(&file("png"), width as usize, height as usize, picture.ldr.as_flattened())?;
        all.push(RealTimeView {
            flip,
            view: view.name.clone(),
            size: [width, height],
            adapter: format!("{} ({}, {})", adapter.name, adapter.backend, adapter.driver),
        });
        // The record has none of the path tracer's pictures, so that none of these is continued as one.
        let record = serde_json::json!({ "pictures": {}, "real_time": all });
        atomic::write_bytes(&options.out.join(RECORD), record.to_string().as_bytes())?;
        tell(&all[all.len() - 1])?;
    }
    Ok(())
}

/// Mean FLIP, and the FLIP that 99 % of the pixels stay below.
fn flip(path: &Path, picture: &viewer::Picture) -> Result<[f64; 2]> {
    let (width, height, other) = image::read_png(path)?;
    let own = [picture.width as usize, picture.height as usize];
    if [width, height] != own {
        let (found, expected) = (format!("{width}x{height} pixels"), format!("{}x{}, as drawn here", own[0], own[1]));
        return Err(Error::unexpected(path, "size", found, expected));
    }
    Ok(comparison::flip_figures(&comparison::flip_map(&other, &picture.ldr, width, height)))
}
