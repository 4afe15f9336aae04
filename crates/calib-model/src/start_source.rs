//! From where the start states of rollouts are taken.

use calib_core::{RowIndex, Seed, States, Timestamp};

use crate::Absent;

/// The source of start states.
#[derive(Clone, Copy, Debug)]
pub enum StartSource<'a> {
    /// Uniform over the transitions of the ensemble member.
    Random,
    /// Listed rows; start state `r` takes row `r` modulo their number.
    Rows {
        /// The rows.
        rows: &'a [RowIndex],
        /// The treatment of a row that the member lacks.
        absent: Absent,
    },
    /// The latest rows before the deployment, spread over a window that ends with the last: start state `r` is the row
    /// that is 0, 1/2, 1/4, 3/4, 1/8, … of the window before it.
    Recent {
        /// Time of each row of the data.
        timestamps: &'a [Timestamp],
        /// Begin of the deployment: only earlier rows are used. `None` uses all rows.
        before: Option<Timestamp>,
        /// Number of rows of the window. `None` is the last tenth of the rows.
        window: Option<usize>,
    },
    /// Uniform over the rows in one month of the year, in years before the deployment.
    CalendarMonth {
        /// Time of each row of the data.
        timestamps: &'a [Timestamp],
        /// The month, 1 to 12.
        month: u8,
        /// Begin of the deployment: only rows of earlier calendar years are used. `None` uses all rows.
        before: Option<Timestamp>,
    },
    /// Rows of the deployment period, drawn uniformly, then replaced by their nearest sources in the member.
    Nearest {
        /// States of the deployment period in the metric of the model.
        states: &'a States,
    },
}

impl StartSource<'_> {
    /// Returns the seed of member `member`'s start states. Each member has its own random start states; all others are
    /// shared.
    pub fn seed_of(&self, seed: Seed, member: usize) -> Seed {
        match self {
            Self::Random => seed.child("member").number(member as u64),
            _ => seed,
        }
    }
}
