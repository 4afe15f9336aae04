//! Reports files in a folder of logs that are not read.

use calib_data::DataConfig;

use crate::{
    StepError,
    output::{Printer, counted},
};

/// Maximum number of files that are named.
const NAMED: usize = 3;

/// Reports the text files that are ignored because there are Parquet files beside them. They may be lists of tags, or a
/// part of the log.
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
