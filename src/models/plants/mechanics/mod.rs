//! Beams, branches and wind.
//!
//! A branch is a linearly tapered beam, clamped at its root, under a load that is spread evenly along it ([`beam`]);
//! under other loads ([`load`]) and bent strongly it is an [`elastica`].
//! For a renderer its deflection is four numbers in a coordinate that follows the taper ([`taper`]); [`length`] keeps a
//! bent branch as long as it was; [`branch`] moves vertices, tangents and normals with it; [`wind`] and [`motion`] make
//! it sway.
//!
//! Source throughout: R. Habel, "Real-time Rendering and Animation of Vegetation", dissertation, TU Wien 2009, chapter
//! 4 ("H9").

#![warn(missing_docs)]

pub mod beam;
pub mod branch;
pub mod elastica;
pub mod length;
pub mod load;
pub mod motion;
pub mod motion_spectrum;
pub mod quadrature;
pub mod taper;
pub mod wind;
