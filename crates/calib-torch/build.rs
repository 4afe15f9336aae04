//! Tells the linker for this crate's tests, and the crates that use this one, where libtorch is.

use std::env;

fn main() {
    // torch-sys sets this variable when the feature is on.
    if let Ok(directory) = env::var("DEP_TCH_LIBTORCH_LIB") {
        println!("cargo::metadata=LIBTORCH_LIB={directory}");
        if env::var("CARGO_CFG_TARGET_OS").is_ok_and(|system| system != "windows") {
            println!("cargo::rustc-link-arg=-Wl,-rpath,{directory}");
        }
    }
}
