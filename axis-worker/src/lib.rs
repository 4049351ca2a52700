//! One SUPERSIGMA axis card: the pure machine (8253, ramp, firmware, mechanism) and the process round it.

pub mod pit8253;
