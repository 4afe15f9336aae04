//! The causes of rows that contradict each other, and what to do about each.

use calib_core::abridged_list;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::column_aliases::{TAGS, plain};

/// Maximum number of values in a message.
const NAMED: usize = 4;

/// Why rows with the same time contradict each other.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ContradictionCause {
    /// They come from several plants, which a column distinguishes.
    Column {
        /// Name of the column.
        column: String,
        /// Values of the column, in order.
        values: Vec<String>,
    },
    /// They come from several files with the same columns.
    Files {
        /// Prefixes that the names of the channels would get, for the first files.
        prefixes: Vec<String>,
    },
    /// A clock was set back in autumn, so that an hour occurs twice.
    ClockSetBack {
        /// The day.
        date: String,
    },
    /// Most times are shared by an equal number of rows of one file: the export may have cut times to whole minutes
    /// or hours.
    SharedTimes {
        /// Rows per time.
        rows: u64,
        /// Seconds from one time to the next.
        step_secs: f64,
    },
}

impl ContradictionCause {
    /// Returns what to do about contradictions with this cause.
    pub(crate) fn remedy(cause: Option<&Self>) -> String {
        match cause {
            Some(Self::Column { column, values }) if TAGS.contains(&plain(column).as_str()) => format!(
                "They are of {} different {column:?} ({}): if these are tags, the log is a long table: set data.tag = {column:?}, data.value to the column of their \
                 values and, if there is one, data.quality to that of their quality. If they are of different plants, choose one with data.where",
                values.len(),
                named(values)
            ),
            Some(Self::Column { column, values }) => format!(
                "They are of {} different {column:?} ({}): choose one with data.where, on the command line as --set 'data.where={{ {column:?} = {:?} }}'. \
                 If each row is a sample of what {column:?} names, set data.tag = {column:?} and data.value instead",
                values.len(),
                named(values),
                values.first().map_or("", String::as_str)
            ),
            Some(Self::Files { prefixes }) => format!(
                "They are in files with the same columns ({}): if each file is of a room or a machine, data.file_as_prefix = true names channels after both (on the command line, --set data.file_as_prefix=true). \
                 If the files are exports of the same sensors, data.contradictions = \"first\" or \"last\" keeps one of the values",
                named(prefixes)
            ),
            Some(Self::ClockSetBack { date }) => format!(
                "The hour from 02:00 on {date} comes twice: on the last Sunday of October clocks in Europe are set back. Set data.time_zone to that of the log, such as \
                 \"Europe/Berlin\", and both hours are read (on the command line, --set data.time_zone=Europe/Berlin)"
            ),
            Some(Self::SharedTimes { rows, step_secs }) => {
                let spacing = (1e3 * step_secs / *rows as f64).round() / 1e3;
                format!(
                    "About {rows} rows share each time, and times are {step_secs} s apart. If the export cut the times, data.contradictions = \"spread\" puts these rows {spacing} s apart \
                     (on the command line, --set data.contradictions=spread). If the rows are of different machines, export the column that names them, and choose one with data.where"
                )
            }
            None => "If several rows of one time are of different sensors, the log is a long table: name the column that tells them apart with data.tag. \
                 If they are of different plants, choose one with data.where. If a clock was set back, data.time_zone may tell the two hours apart. \
                 Else data.contradictions = \"first\" or \"last\" keeps one of them"
                .to_owned(),
        }
    }
}

/// Lists the first of some values.
fn named(values: &[String]) -> String {
    abridged_list(values, NAMED)
}
