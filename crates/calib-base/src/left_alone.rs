//! What of a folder of logs is not read.

use calib_data::DataConfig;

use crate::{
    StepError,
    output::{Printer, counted},
};

/// Files that are named.
const NAMED: usize = 3;

/// Say which text files are left alone because Parquet lies beside them: they may be lists of tags, or a part of the log.
///
/// # Errors
/// If a folder cannot be read.
pub fn text_left_alone(data: &DataConfig, printer: &Printer) -> Result<(), StepError> {
    let left = calib_data::text_left_alone(data)?;
    if left.is_empty() {
        return Ok(());
    }
    let names: Vec<String> =
        left.iter().take(NAMED).map(|path| path.display().to_string()).collect();
    let more = if left.len() > NAMED { " …" } else { "" };
    printer.say(&format!(
        "{} of text beside Parquet left alone: {}{more}; if they are of the log, name its files with data.path",
        counted(left.len(), "file"),
        names.join(", ")
    ));
    Ok(())
}
