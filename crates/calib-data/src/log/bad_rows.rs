//! Lines of text files that are not rows: cut off when the power failed, written into one another, or headers in the
//! middle.

use super::bad_rows_found::BadRowsFound;
use crate::{BadRows, DataConfig, DataError};

/// The largest share of the lines that `data.bad_rows = "skip"` skips. With more, the log is read wrongly.
const MOST: f64 = 0.01;

impl BadRowsFound {
    /// Rejects a log with such lines and `rows` good ones, unless the study skips them and they are few.
    pub(crate) fn refuse(&self, rows: u64, data: &DataConfig) -> Result<(), DataError> {
        let lines = rows + self.count;
        let are_few = self.count <= 1 || self.count as f64 <= MOST * lines as f64;
        if self.is_none() || data.bad_rows == BadRows::Skip && are_few {
            return Ok(());
        }
        Err(DataError::BadRows { found: self.clone(), lines, too_many_to_skip: !are_few })
    }
}
