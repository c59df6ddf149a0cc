//! Mesophyll: measurements of plants and skies → fitted parameters → pictures that prove the fit.
//!
//! Rooms, from the ground up. Each is a package in a folder of its own; it names the rooms it uses in its `Cargo.toml`,
//! and the compiler refuses any other. All of them stand on floors below its own:
//!
//! ```text
//! 7  main
//! 6  cli
//! 5  report
//! 4  proof       scene       export
//! 3  fit
//! 2  capture     transport
//! 1  viewer      optics      sky      plant      solve      files
//! 0  error       quadrature  fourier
//! ```

pub use mesophyll_capture as capture;
pub use mesophyll_error as error;
pub use mesophyll_export as export;
pub use mesophyll_files as files;
pub use mesophyll_fit as fit;
pub use mesophyll_optics as optics;
pub use mesophyll_plant as plant;
pub use mesophyll_proof as proof;
pub use mesophyll_quadrature as quadrature;
pub use mesophyll_report as report;
pub use mesophyll_scene as scene;
pub use mesophyll_sky as sky;
pub use mesophyll_solve as solve;
pub use mesophyll_transport as transport;

pub use error::{Error, Result};
