//! Light through a leaf that is given as maps: what enters, how it spreads, what leaves (H7; H9 §3.3).

pub mod convolve;
pub mod fourier;
pub mod kernel;
pub mod levels;
