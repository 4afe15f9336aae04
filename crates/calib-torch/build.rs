//! Says where libtorch is: to the linker for this crate's tests, and to the crates that use this one.

use std::env;

fn main() {
    // Set by torch-sys when the feature is on.
    if let Ok(directory) = env::var("DEP_TCH_LIBTORCH_LIB") {
        println!("cargo::metadata=LIBTORCH_LIB={directory}");
        if env::var("CARGO_CFG_TARGET_OS").is_ok_and(|system| system != "windows") {
            println!("cargo::rustc-link-arg=-Wl,-rpath,{directory}");
        }
    }
}
