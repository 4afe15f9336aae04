//! The requested start states of rollouts: chosen once, for every member and every model.

use calib_core::{RowIndex, Seed, States, Timestamp, TransitionIndex, Transitions};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{
    RolloutError, StartSource,
    month::{month_of, year_of},
};

/// A requested start state of a rollout. The model may lack it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RequestedStart {
    /// A row of the model's data.
    Recorded(RowIndex),
    /// A row of the deployment period.
    Deployment(RowIndex),
}

/// By default, recent rows are the last tenth of all rows (our choice). Adjacent rows are nearly the same state, so
/// rollouts from them have practically the same start state.
const RECENT: usize = 10;

/// Returns place `number` of a sequence that spreads more and more evenly over `window` places, from the first: 0, 1/2,
/// 1/4, 3/4, 1/8, … of the window (van der Corput's sequence).
fn spread(number: usize, window: usize) -> usize {
    let share = (number as u64).reverse_bits();
    (u128::from(share) * window as u128 / (1 << 64)) as usize
}

/// Draws start state `number`, uniform below a limit.
pub(crate) fn draw(seed: Seed, number: usize, below: usize) -> usize {
    seed.child("start").number(number as u64).rng().below(below)
}

/// Draws rows of the deployment period uniformly. Start state `r` depends only on `seed` and `r`.
pub(crate) fn deployment_rows(
    states: &States,
    count: usize,
    seed: Seed,
) -> Result<Vec<RowIndex>, RolloutError> {
    if states.rows() == 0 {
        return Err(RolloutError::NoStates);
    }
    Ok((0..count).map(|r| RowIndex::new(draw(seed, r, states.rows()))).collect())
}

/// Returns the rows of the model's data that `source` names, for any member. `None` for sources that are not rows of
/// the data, or that are drawn from a member's own rows.
pub(crate) fn recorded_rows(
    source: StartSource<'_>,
    transitions: &Transitions,
    rows: usize,
    count: usize,
    seed: Seed,
) -> Result<Option<Vec<RowIndex>>, RolloutError> {
    let chosen = match source {
        StartSource::Random | StartSource::Nearest { .. } => return Ok(None),
        StartSource::Rows { rows: listed, .. } => {
            if listed.is_empty() {
                return Err(RolloutError::NoRows);
            }
            if let Some(&row) = listed.iter().find(|row| row.get() >= rows) {
                return Err(RolloutError::UnknownRow { row, rows });
            }
            (0..count).map(|r| listed[r % listed.len()]).collect()
        }
        StartSource::Recent { timestamps, before, window } => {
            check_timestamps(timestamps, rows)?;
            let pool: Vec<RowIndex> = ends(transitions)
                .filter(|row| before.is_none_or(|before| timestamps[row.get()] < before))
                .collect();
            if pool.is_empty() {
                return Err(RolloutError::NothingBefore);
            }
            let window = window.unwrap_or(pool.len().div_ceil(RECENT)).clamp(1, pool.len());
            (0..count).map(|r| pool[pool.len() - 1 - spread(r, window)]).collect()
        }
        StartSource::CalendarMonth { timestamps, month, before } => {
            if !(1..=12).contains(&month) {
                return Err(RolloutError::Month { got: month });
            }
            check_timestamps(timestamps, rows)?;
            let pool: Vec<RowIndex> = ends(transitions)
                .filter(|row| is_in_earlier_year(timestamps[row.get()], month, before))
                .collect();
            if pool.is_empty() {
                return Err(RolloutError::EmptyMonth { month, before: before.map(year_of) });
            }
            (0..count).map(|r| pool[draw(seed, r, pool.len())]).collect()
        }
    };
    Ok(Some(chosen))
}

/// Whether a time is in the month, in a calendar year before that of the deployment's start.
fn is_in_earlier_year(time: Timestamp, month: u8, before: Option<Timestamp>) -> bool {
    month_of(time) == month && before.is_none_or(|before| year_of(time) < year_of(before))
}

/// Iterates over the rows in which transitions end.
fn ends(transitions: &Transitions) -> impl Iterator<Item = RowIndex> {
    (0..transitions.len()).map(|position| transitions.next(TransitionIndex::new(position)))
}

fn check_timestamps(timestamps: &[Timestamp], rows: usize) -> Result<(), RolloutError> {
    if timestamps.len() == rows {
        return Ok(());
    }
    Err(RolloutError::Timestamps { timestamps: timestamps.len(), rows })
}

#[cfg(test)]
mod tests {
    use calib_core::Segments;

    use super::*;

    /// Returns the beginning of a day, counted from 1970-01-01.
    fn day(number: i64) -> Timestamp {
        Timestamp::from_micros(number * 86_400_000_000)
    }

    #[test]
    fn the_same_month_of_an_earlier_calendar_year() {
        // 1971-01-10; 1970-12-30; 1970-01-05; 1971-12-30.
        let january = day(374);
        let december = day(363);
        let first = day(4);
        let later = day(728);
        assert!(is_in_earlier_year(first, 1, Some(january)));
        assert!(!is_in_earlier_year(first, 12, Some(january)));
        assert!(
            is_in_earlier_year(december, 12, Some(january)),
            "eleven days before, a year earlier"
        );
        assert!(!is_in_earlier_year(january, 1, Some(later)), "the deployment's own year");
        assert!(!is_in_earlier_year(first, 2, Some(january)), "another month");
        assert!(is_in_earlier_year(later, 12, None));
    }

    #[test]
    fn places_are_spread_over_the_window_and_differ() {
        assert_eq!((0..5).map(|r| spread(r, 1000)).collect::<Vec<_>>(), [0, 500, 250, 750, 125]);
        let mut places: Vec<usize> = (0..64).map(|r| spread(r, 1000)).collect();
        places.sort_unstable();
        assert!(places.windows(2).all(|pair| (15..17).contains(&(pair[1] - pair[0]))));
        assert_eq!(spread(usize::MAX, usize::MAX), usize::MAX - 1);
    }

    /// Returns three recent rows of a log of two segments.
    fn recent(
        timestamps: &[Timestamp],
        before: Option<Timestamp>,
        window: Option<usize>,
    ) -> Result<Vec<u32>, RolloutError> {
        let transitions = Transitions::new(Segments::from_lengths([4, 3]).expect("valid"));
        let source = StartSource::Recent { timestamps, before, window };
        let rows = recorded_rows(source, &transitions, timestamps.len(), 3, Seed::new(0))?;
        Ok(rows.expect("rows").iter().map(|row| row.0).collect())
    }

    #[test]
    fn recent_rows_are_those_before_the_deployment() {
        let timestamps: Vec<Timestamp> = (0..7).map(Timestamp::from_micros).collect();
        // A tenth of five rows, rounded up, is one; a window is no longer than there are rows.
        assert_eq!(recent(&timestamps, None, None).expect("rows"), [6, 6, 6]);
        assert_eq!(recent(&timestamps, None, Some(4)).expect("rows"), [6, 3, 5]);
        assert_eq!(recent(&timestamps, None, Some(99)).expect("rows"), [6, 3, 5]);
        assert_eq!(recent(&timestamps, Some(timestamps[3]), Some(2)).expect("rows"), [2, 1, 2]);
        assert_eq!(recent(&timestamps, None, Some(0)).expect("rows"), [6, 6, 6]);
        assert!(matches!(
            recent(&timestamps, Some(timestamps[1]), None),
            Err(RolloutError::NothingBefore)
        ));
        let none = Transitions::new(Segments::from_lengths([1]).expect("valid"));
        let source =
            StartSource::Recent { timestamps: &timestamps[..1], before: None, window: None };
        let nothing = recorded_rows(source, &none, 1, 3, Seed::new(0));
        assert!(matches!(nothing, Err(RolloutError::NothingBefore)));
    }
}
