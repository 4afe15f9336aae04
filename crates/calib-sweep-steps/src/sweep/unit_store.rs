//! Where the finished units of a sweep are.

use std::path::Path;

use calib_sweep::UnitStore;

/// Returns the store of a sweep's finished units. Each arithmetic other than calib's own has its own store.
pub fn unit_store(directory: &Path, arithmetic: Option<&str>) -> UnitStore {
    let apart = arithmetic.map_or_else(String::new, |class| format!("-{class}"));
    UnitStore::new(directory.join(format!("units{apart}")))
}
