//! Injected failures for tests: `CALIB_FAULT=fail:17` makes the 17th disk operation fail.
//!
//! Every build contains this code, so that the tested program is the shipped one. It adds no risk: the user who
//! sets calib's environment could do the same harm in other ways.

use std::{env, fs::File};

use calib_files::faults::{self, Fault};
use calib_pipeline::{Context as _, StepError, bail};

/// Variable that names the failing operation and the kind of failure.
const VARIABLE: &str = "CALIB_FAULT";

/// Arms the failure that the environment asks for; usually there is none.
pub(crate) fn arm() -> Result<(), StepError> {
    let Some(text) = env::var_os(VARIABLE).filter(|text| !text.is_empty()) else { return Ok(()) };
    let text = text.to_string_lossy();
    let expected = format!(
        "{VARIABLE} is for tests: expected fail:N, full:N, kill:N, free:BYTES, list:FILE or lockless, got '{text}'; \
         remove it from the environment"
    );
    if text == "lockless" {
        faults::arm(Fault::Lockless);
        return Ok(());
    }
    let (kind, what) = text.split_once(':').context(&expected)?;
    let number = what.parse::<u64>().context(&expected);
    faults::arm(match kind {
        "fail" => Fault::Fail(number?),
        "full" => Fault::Full(number?),
        "kill" => Fault::Kill(number?),
        "free" => Fault::Free(number?),
        "list" => Fault::List(File::create(what).with_context(|| format!("cannot write {what}"))?),
        _ => bail!(expected),
    });
    Ok(())
}
