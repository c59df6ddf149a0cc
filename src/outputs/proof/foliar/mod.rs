//! The layers of a leaf: comparisons of rays with the exact method, their run times, and extreme leaves.

pub mod bench;
pub mod charts;
mod faults;
pub mod figures;
pub mod leaves;
pub mod peers;
pub mod pictures;
pub mod stress;
