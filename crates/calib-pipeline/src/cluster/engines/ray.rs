//! The driver for Ray: a Python program with `ray` from the package index.

/// The program; it is also a package of its own, in `python/calib_ray`.
pub(crate) const DRIVER: &str = include_str!("../../../../../python/calib_ray/calib_ray.py");
