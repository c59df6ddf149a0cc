//! Mesophyll: measurements of plants and skies → fitted parameters → pictures that prove the fit.
//!
//! Lengths of leaves are in mm, σ in 1/mm, angles in radians; reflectances and transmittances are shares of the light.
//!
//! What a leaf is made of, from what it reflects and lets through:
//!
//! ```
//! use mesophyll::optics::slab::inverse::invert;
//!
//! // ρd, ρt, thickness in mm, and the standard errors of ρd and ρt.
//! let leaf = invert(0.38, 0.51, 0.15, 0.002, 0.002);
//! println!("σa = {:.3} ± {:.3} 1/mm, σs = {:.1} ± {:.1} 1/mm: {}", leaf.sigma_a, leaf.sigma_a_err, leaf.sigma_s,
//!     leaf.sigma_s_err, leaf.status);
//! assert!(leaf.status.is_ok());
//! // The slab gives back what was measured.
//! let seen = mesophyll::optics::slab::response(leaf.sigma_a, leaf.sigma_s, 0.15);
//! assert!((seen.rho_d - 0.38).abs() < 1e-6 && (seen.rho_t - 0.51).abs() < 1e-6);
//! ```
//!
//! Reflectance, gloss and normal of one texel, from the light of a tube that travels over it:
//!
//! ```
//! use mesophyll::fits::gloss::{GlossTexelFitter, synthetic::{GaussianDeviates, GlossFitTruth, device, pass_x, trace}};
//! use mesophyll::optics::{gloss::Lobe, tube::Travel};
//!
//! let (device, positions) = (device(Lobe::Beckmann, 0.005), pass_x(100));
//! let truth = GlossFitTruth { rho_d: [0.1, 0.2, 0.05], rho_s: [0.04; 3], m: 0.2, tilt: [0.1, 0.0] };
//! // Readings (red, green, blue) a frame; here those of a known texel with noise.
//! let readings = trace(&device, Travel::X, &positions, [0.0, 0.0], &truth, Some(&mut GaussianDeviates::new(1)));
//!
//! let fitter = GlossTexelFitter::new(&device, &positions, None);
//! let texel = fitter.fit(&mut fitter.workspace(), [0.0, 0.0], &readings, None);
//! assert!(texel.defect.is_none() && (texel.m - truth.m).abs() < 4.0 * texel.m_err);
//! ```
//!
//! The light of a clear sky, as a shader takes it:
//!
//! ```
//! use mesophyll::sky::{Preetham, SkyFamily, irradiance::irradiance, projection};
//!
//! let sky = Preetham.sky(40f64.to_radians(), 3.0)?;
//! // 49 numbers a channel; the sun stands at azimuth 0, which is +x, and z is up.
//! let harmonics = projection::direct(sky.as_ref(), 7);
//! let on_the_ground = irradiance(&harmonics, [0.0, 0.0, 1.0]);
//! assert!(on_the_ground[2] > on_the_ground[0]); // a blue sky
//! # Ok::<(), mesophyll::sky::SkyRefusal>(())
//! ```
//!
//! Rooms, from the ground up. Each is a package in a folder of its own; it names the rooms it uses in its `Cargo.toml`,
//! and the compiler refuses any other. A room stands one floor above the highest one that it uses:
//!
//! ```text
//! 9  python
//! 8  mesophyll (the command line)
//! 7  proof
//! 6  check       fit-scene   report
//! 5  export      scene
//! 4  fits
//! 3  synth
//! 2  capture     plants      transport   web         window
//! 1  files       optics      sky         viewer
//! 0  base
//! ```

pub use mesophyll_base as base;
pub use mesophyll_capture as capture;
#[cfg(feature = "render")]
pub use mesophyll_check as check;
pub use mesophyll_export as export;
pub use mesophyll_files as files;
pub use mesophyll_fit_scene as fit_scene;
pub use mesophyll_fits as fits;
pub use mesophyll_optics as optics;
pub use mesophyll_plants as plants;
pub use mesophyll_proof as proof;
pub use mesophyll_report as report;
pub use mesophyll_scene as scene;
pub use mesophyll_sky as sky;
pub use mesophyll_synth as synth;
pub use mesophyll_transport as transport;

pub mod cli;

pub use base::error::{Error, Result};
