//! With the feature `torch`: where the programs find libtorch when they run.

use std::env;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    // Told by calib-torch, which is told by what builds the bindings.
    if let Ok(directory) = env::var("DEP_CALIB_TORCH_LIBTORCH_LIB")
        && env::var("CARGO_CFG_TARGET_OS").is_ok_and(|system| system != "windows")
    {
        println!("cargo::rustc-link-arg-bins=-Wl,-rpath,{directory}");
        println!("cargo::rustc-link-arg-tests=-Wl,-rpath,{directory}");
        println!("cargo::rustc-link-arg-benches=-Wl,-rpath,{directory}");
    }
}
