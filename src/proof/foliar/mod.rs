//! The layers of a leaf: rays and the exact method against each other and against the clock, and extreme leaves.

pub mod bench;
pub mod figures;
pub mod peers;
pub mod pictures;
pub mod stress;
