//! The leaf's interior: LEAFMOD's slab (Ganapol et al. 1998; Wang et al. 2005 §3).
