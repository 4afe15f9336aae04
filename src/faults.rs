//! Failures on purpose, for tests: `CALIB_FAULT=fail:17` lets the 17th operation on the disk fail.
//!
//! It is part of every build, so that what is tested is what is shipped. It can do no harm that whoever sets the
//! environment of calib could not do anyway.

use calib_pipeline::{Context as _, StepError, bail};
use std::{env, fs::File};

use calib_files::faults::{self, Fault};

/// Which operation goes wrong, and how.
const VARIABLE: &str = "CALIB_FAULT";

/// Arm what the environment asks for; usually nothing.
pub(crate) fn arm() -> Result<(), StepError> {
    let Some(text) = env::var_os(VARIABLE).filter(|text| !text.is_empty()) else { return Ok(()) };
    let text = text.to_string_lossy();
    let expected = || {
        format!(
            "{VARIABLE} is for tests: expected fail:N, full:N, kill:N, free:BYTES, list:FILE or lockless, got '{text}'; \
             remove it from the environment"
        )
    };
    if text == "lockless" {
        faults::arm(Fault::Lockless);
        return Ok(());
    }
    let (kind, what) = text.split_once(':').with_context(expected)?;
    let number = || what.parse().with_context(expected);
    faults::arm(match kind {
        "fail" => Fault::Fail(number()?),
        "full" => Fault::Full(number()?),
        "kill" => Fault::Kill(number()?),
        "free" => Fault::Free(number()?),
        "list" => Fault::List(File::create(what).with_context(|| format!("cannot write {what}"))?),
        _ => bail!(expected()),
    });
    Ok(())
}
