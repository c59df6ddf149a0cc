//! Mesophyll: measurements of plants and skies → fitted parameters → pictures that prove the fit.
//!
//! Rooms, from the ground up; a room uses only rooms on floors below its own:
//!
//! ```text
//! 6  main
//! 5  cli
//! 4  scene            report            export
//! 3  fit              transport
//! 2  capture
//! 1  viewer      optics      sky      plant      solve
//! 0  error       files       quadrature
//! ```

pub mod capture;
pub mod cli;
pub mod error;
pub mod export;
pub mod files;
pub mod fit;
pub mod optics;
pub mod plant;
pub mod quadrature;
pub mod report;
pub mod scene;
pub mod sky;
pub mod solve;
pub mod transport;

#[cfg(test)]
#[path = "../tests/common/skips.rs"]
mod skips;

pub use error::{Error, Result};
