//! The `calib` command. Everything that it does is in the library.

use std::process::ExitCode;

fn main() -> ExitCode {
    calib::run(std::env::args_os())
}
