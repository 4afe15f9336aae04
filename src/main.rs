//! The `calib` command. Its code is in the library.

use std::process::ExitCode;

fn main() -> ExitCode {
    calib::run(std::env::args_os())
}
