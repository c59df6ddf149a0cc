//! A leaf as other programs' materials can hold it, and what is lost on the way.
//!
//! Every target's material is written here in f64, as its specification or its source states it.
//! [`target::ExportTarget`] finds the parameters with which it comes nearest to a texel of ours, and [`loss`] says what
//! remains, as numbers.
//!
//! Our own leaf is the one that the path tracer draws, seen from one side: f_r = ρd/π + ρs f_s with the bounded lobe
//! f_s, and f_t = ρt/π for light that enters the other side. Angles are given by unit vectors, z is the mapped normal
//! of the viewed side. Limits: normal maps are no part of the comparison, and every target is isotropic.

#![warn(missing_docs)]

pub mod gloss;
pub mod loss;
pub mod micro;
pub mod nodes;
pub mod target;
pub mod texel;
