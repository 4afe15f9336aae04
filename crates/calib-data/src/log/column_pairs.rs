//! Detects tables in which each column of values has its own column of times, as in trends exported from a
//! spreadsheet.

use super::{file::FieldKind, head::Head, shape::names_tags};
use crate::{DataConfig, DataError, names::Names};

/// Returns the names of the first two columns of times of a table of pairs. Columns in `data.exclude` do not
/// count.
fn paired_times(head: &Head, data: &DataConfig) -> Option<[String; 2]> {
    let columns = head.columns();
    let excluded = Names::new(&data.exclude);
    if columns.iter().any(names_tags) {
        return None;
    }
    let no_channels = match head {
        Head::Text(file) => &file.no_channels[..],
        Head::Parquet(_) | Head::Annotated(..) => &[],
    };
    let values = (0..columns.len()).filter(|&at| columns[at].kind == FieldKind::Number);
    // Other tables may have a second column of times, but then some values are not beside one.
    let times = values.map(|at| {
        at.checked_sub(1).filter(|&before| {
            columns[before].kind == FieldKind::Time
                && !no_channels.contains(&before)
                && excluded.matching(&columns[before].name).is_none()
        })
    });
    match times.collect::<Option<Vec<usize>>>()?[..] {
        [first, next, ..] => Some([first, next].map(|at| columns[at].name.clone())),
        _ => None,
    }
}

/// Rejects a table in which columns of values have their own times beside them.
///
/// # Errors
/// If it is such a table.
pub(crate) fn refuse_pairs(head: &Head, data: &DataConfig) -> Result<(), DataError> {
    let Some([first, next]) = paired_times(head, data) else { return Ok(()) };
    Err(DataError::Shape {
        reason: format!(
            "{} has times in {first:?} and, after a column of values, times again in {next:?}: if each column of values has its own times beside it, the \
             times of {first:?} are wrong for the others. Write a file for each pair of columns, with the name of the tag over its values \
             (docs/guides/exports.md, pairs of columns). If all values are of the times of one column, name it with data.timestamp and leave the others out with data.exclude",
            head.path().display()
        ),
    })
}
