//! Tables in which each column of values has a column of times beside it, as trends of a spreadsheet are exported.

use super::{
    file::FieldKind,
    head::{Head, HeadColumn},
    shape::names_tags,
};
use crate::{DataConfig, DataError, names::Names};

/// Names of the columns of times of a table of pairs: the first, and the next one.
struct PairedTimes {
    first: String,
    next: String,
}

impl PairedTimes {
    /// What is wrong with such a table, and what to do.
    fn told(&self, head: &Head) -> DataError {
        let Self { first, next } = self;
        DataError::Shape {
            reason: format!(
                "{} has times in {first:?} and, after a column of values, times again in {next:?}: if each column of values has its own times beside it, the \
                 times of {first:?} are wrong for the others. Write a file for each pair of columns, with the name of the tag over its values \
                 (docs/guides/exports.md, pairs of columns). If all values are of the times of one column, name it with data.timestamp and leave the others out with data.exclude",
                head.path().display()
            ),
        }
    }
}

/// The columns of times of a table of pairs; those that `data.exclude` names are none.
fn paired_times(head: &Head, data: &DataConfig) -> Option<PairedTimes> {
    let columns = head.columns();
    let excluded = Names::new(&data.exclude);
    if columns.iter().any(names_tags) {
        return None;
    }
    let beside = match head {
        Head::Text(file) => &file.beside[..],
        Head::Parquet(_) | Head::Annotated(..) => &[],
    };
    let is_time = |at: usize| {
        columns[at].kind == FieldKind::Time
            && !beside.contains(&at)
            && excluded.matching(&columns[at].name).is_none()
    };
    let is_value = |column: Option<&HeadColumn>| {
        column.is_some_and(|column| matches!(column.kind, FieldKind::Number | FieldKind::Text))
    };
    let first = (0..columns.len()).find(|&at| is_time(at))?;
    let next = (first + 2..columns.len()).find(|&at| {
        is_time(at) && is_value(columns.get(at - 1)) && is_value(columns.get(at + 1))
    })?;
    let [first, next] = [first, next].map(|at| columns[at].name.clone());
    Some(PairedTimes { first, next })
}

/// Refuse a table in which columns of values have times of their own beside them.
///
/// # Errors
/// If it is one.
pub(crate) fn refuse_pairs(head: &Head, data: &DataConfig) -> Result<(), DataError> {
    paired_times(head, data).map_or(Ok(()), |times| Err(times.told(head)))
}
