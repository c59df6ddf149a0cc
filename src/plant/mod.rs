//! Beams, branches and wind.
