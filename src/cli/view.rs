//! `mesophyll view`.

use super::CommonArgs;
use crate::cli::Result;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  mesophyll view data/scenes/glossy-sky.toml\n  mesophyll view data/scenes/demo.toml \
     --out out/demo    with the fits of that run\n\nThe window changes leaves, branches and lights, with undo (Ctrl+Z) \
     and \
     redo (Ctrl+Shift+Z), presets and\ntyped numbers; compares a kept state (A) with the present one (B) and a picture \
     with its\nreference; and shows a histogram and false colours. docs/window.md says more."
)]
pub struct Args {
    /// Scene to open; or the folder of a leaf's fit, which is shown over a ground, in sun and sky
    #[arg(value_name = "SCENE.toml|FIT")]
    scene: PathBuf,
    /// Folder of a run, whose fits are shown; screenshots and edited fits go there (default: out/view/SCENE)
    #[arg(short, long, alias = "output", value_name = "DIR", value_parser = super::destination::folder())]
    out: Option<PathBuf>,
    /// Environment map that is seen behind the scene and lights nothing: OpenEXR or Radiance, 2:1, zenith on top
    #[arg(long, value_name = "FILE")]
    background: Option<PathBuf>,
    /// Close after this many frames
    #[arg(long, value_name = "N")]
    frames: Option<u32>,
    /// With --frames: write the window's contents here
    #[arg(long, value_name = "FILE.png", requires = "frames")]
    screenshot: Option<PathBuf>,
}

#[cfg(feature = "window")]
pub fn run(args: &Args, _common: &CommonArgs) -> Result<u8> {
    use crate::cli::Error;
    use mesophyll_check as check;
    use mesophyll_files::{claim, progress};
    use mesophyll_scene::manifest::SceneManifest;
    use mesophyll_scene::placed::{PlacedScene, leaf::LeafSearch, ledger::Ledger};
    use mesophyll_scene::{
        draw::handover,
        loaded::LoadedScene,
        window::{backdrop, edit::SceneEditor},
    };
    use mesophyll_transport::environment::Environment;
    use mesophyll_viewer::scene::Backdrop;
    use mesophyll_window::{WindowOptions, WindowScene, WindowView, open_window};

    let manifest = SceneManifest::of(&args.scene)?;
    let ledger = Ledger::new();
    let search = LeafSearch { out: args.out.as_deref(), compared: true, free: true };
    let mut placed = PlacedScene::new(&manifest, search, &ledger)?;
    let out = args.out.clone().unwrap_or_else(|| PathBuf::from("out/view").join(&manifest.name));
    placed.make_looks(&manifest, &out, search, &ledger)?;
    if let Some(missing) = placed.unfitted().first() {
        let name = &manifest.leaves[*missing].name;
        return Err(Error::field(
            &manifest.path,
            &format!("leaf \"{name}\""),
            "not fitted yet; `mesophyll run` fits it, then give its folder by --out",
        ));
    }
    // A window may be open for hours. A run or a check of the same scene need not wait for it: what the window writes
    // (screenshots, edited fits) are whole files of their own.
    drop(claim::scene(&out, &args.scene)?);
    if let Some(file) = &args.screenshot {
        claim::file(file, &["png"], &[&args.scene])?;
    }
    placed.make_translucency(&manifest, &out, search, &ledger)?;
    placed.out = Some(out.clone());
    let mut planned = LoadedScene::new(manifest, placed, &ledger)?;
    planned.find_transfer(&out, &ledger)?;
    let manifest = &planned.manifest;
    for warning in &planned.plan.warnings {
        progress::say(format!("warning: {warning}"));
    }
    check::verify(&planned, &ledger)?.require()?;
    let views: Vec<WindowView> = manifest
        .perspectives()
        .map(|v| WindowView {
            name: v.name.clone(),
            camera: handover::camera(&v.camera),
            time_s: Some(manifest.time_of(v)),
        })
        .collect();
    let Some(first) = views.first().cloned() else {
        return Err(Error::unexpected(&manifest.path, "view", "only cards", "a perspective view to open"));
    };
    let mut scene = handover::shown(&planned, manifest.display(), &ledger)?;
    if let (Some(wind), Some(time_s)) = (&mut scene.wind, first.time_s) {
        wind.time_s = time_s;
    }
    if let Some(file) = &args.background {
        let map = Environment::read(file)?;
        let (width, height, texels) = map.texels();
        let texels = std::sync::Arc::new(texels.to_vec());
        scene.backdrop = Some(Backdrop { width: width as u32, height: height as u32, texels, turn: 0.0 });
    } else if let Some(wall) = backdrop::behind(&scene) {
        scene.backdrop = Some(wall);
    }
    let window = WindowScene {
        title: manifest.name.clone(),
        scene,
        camera: first.camera,
        views,
        check_size: [manifest.check.width, manifest.check.height],
        screenshots: out.clone(),
    };
    let options =
        WindowOptions { frames: args.frames, screenshot: args.screenshot.clone(), ..WindowOptions::default() };
    let editor = SceneEditor::new(planned, out)?;
    progress::pause();
    open_window(window, Box::new(editor), &options).map_err(check::told)?;
    Ok(0)
}

#[cfg(not(feature = "window"))]
pub fn run(_args: &Args, _common: &CommonArgs) -> Result<u8> {
    Err(crate::cli::Error::Missed("nothing to open: this build has no window (feature `window`)".into()))
}
