//! Tables in which each column of values has a column of times beside it, as trends of a spreadsheet are exported.

use super::{file::FieldKind, head::Head, shape::names_tags};
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
    let mut values = (0..columns.len()).filter(|&at| columns[at].kind == FieldKind::Number);
    // Another table has a further column of times somewhere, and values that are beside none.
    if !values.all(|at| at > 0 && is_time(at - 1)) {
        return None;
    }
    let mut paired =
        (1..columns.len()).filter(|&at| columns[at].kind == FieldKind::Number).map(|at| at - 1);
    let (first, next) = (paired.next()?, paired.next()?);
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
