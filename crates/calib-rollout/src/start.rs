use calib_core::{RowIndex, Seed, States, Timestamp, TransitionIndex};
use calib_knn::{Member, Neighbor};

use crate::{Absent, RolloutError, month::month_of};

/// Where a rollout starts. A start is a state: from transition `i` the current state is `s'_i`.
#[derive(Clone, Debug, PartialEq)]
pub enum Start {
    /// At the next state of a transition of the member.
    At(TransitionIndex),
    /// At a recorded row that no transition of the member ends in: the first row of a segment, or a row
    /// outside the member. The first step is drawn from the row's nearest sources in the member.
    External {
        /// The row.
        row: RowIndex,
        /// Its nearest sources in the member, nearest first.
        neighbors: Vec<Neighbor>,
    },
}

/// A start, and whether it is what was asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct StartState {
    /// Where the rollout starts.
    pub start: Start,
    /// The distance from the state asked for to the recorded state that replaces it, if one does.
    pub replaced: Option<f32>,
}

/// Where start states come from.
#[derive(Clone, Copy, Debug)]
pub enum StartSource<'a> {
    /// Uniform over the member's transitions.
    Random,
    /// Listed rows; start `r` takes row `r` modulo their number.
    Rows {
        /// The rows.
        rows: &'a [RowIndex],
        /// What happens to a row that the member lacks.
        absent: Absent,
    },
    /// The member's latest rows: start `r` is the `r`-th last (modulo the member's size).
    Recent,
    /// Uniform over the member's rows in one month of the year, before the deployment.
    CalendarMonth {
        /// Time of each row of the data.
        timestamps: &'a [Timestamp],
        /// The month, 1 to 12.
        month: u8,
        /// Begin of the deployment: only rows of earlier years are used.
        before: Option<Timestamp>,
    },
    /// States of the deployment period, drawn uniformly, replaced by their nearest sources in the member.
    Nearest {
        /// States of the deployment period in the metric of the model.
        states: &'a States,
    },
}

/// `count` start states for rollouts of `member`: a pure function of its arguments.
///
/// Start `r` depends on `seed` and `r` only, so asking for more starts keeps the first ones.
///
/// # Errors
/// If the source has no rows, names rows that do not exist, or finds nothing in the member.
pub fn start_states(
    member: &Member<'_>,
    source: StartSource<'_>,
    count: usize,
    seed: Seed,
) -> Result<Vec<StartState>, RolloutError> {
    let draw = |number: usize, below: usize| draw(seed, number, below);
    let at = |transition| StartState { start: Start::At(transition), replaced: None };
    match source {
        StartSource::Random => {
            Ok((0..count).map(|r| at(member.nth(draw(r, member.len())))).collect())
        }
        StartSource::Recent => {
            let last = |r: usize| member.len() - 1 - r % member.len();
            Ok((0..count).map(|r| at(member.nth(last(r)))).collect())
        }
        StartSource::CalendarMonth { timestamps, month, before } => {
            let pool = month_pool(member, timestamps, month, before)?;
            Ok((0..count).map(|r| at(pool[draw(r, pool.len())])).collect())
        }
        StartSource::Rows { rows, absent } => {
            if rows.is_empty() {
                return Err(RolloutError::NoRows);
            }
            let rows: Vec<RowIndex> = (0..count).map(|r| rows[r % rows.len()]).collect();
            at_rows(member, &rows, absent)
        }
        StartSource::Nearest { states } => {
            if states.rows() == 0 {
                return Err(RolloutError::NoStates);
            }
            let sampled: Vec<f32> =
                (0..count).flat_map(|r| states.row(draw(r, states.rows()))).copied().collect();
            let sampled = States::new(sampled, count, states.columns())
                .unwrap_or_else(|_| unreachable!("rows of states are finite"));
            let nearest = member.nearest_sources(&sampled, 1)?;
            replaced_by(member, nearest.iter().map(|found| found[0]))
        }
    }
}

/// A row of the deployment's month that is older than this belongs to an earlier year.
const EARLIER_YEAR_MICROS: i64 = 300 * 86_400_000_000;

/// Whether a time lies in the month, in a year before the deployment.
pub(crate) fn is_in_earlier_year(time: Timestamp, month: u8, before: Option<Timestamp>) -> bool {
    before.is_none_or(|before| before.micros_since(time) > EARLIER_YEAR_MICROS)
        && month_of(time) == month
}

/// The draw of start `number`, uniform below a limit.
pub(crate) fn draw(seed: Seed, number: usize, below: usize) -> usize {
    seed.child("start").number(number as u64).rng().below(below)
}

/// The member's transitions that end in the month, in years before the deployment.
fn month_pool(
    member: &Member<'_>,
    timestamps: &[Timestamp],
    month: u8,
    before: Option<Timestamp>,
) -> Result<Vec<TransitionIndex>, RolloutError> {
    if !(1..=12).contains(&month) {
        return Err(RolloutError::Month { got: month });
    }
    let rows = member.model().states().rows();
    if timestamps.len() != rows {
        return Err(RolloutError::Timestamps { timestamps: timestamps.len(), rows });
    }
    let pool: Vec<TransitionIndex> = (0..member.len())
        .map(|position| member.nth(position))
        .filter(|&transition| {
            let row = member.model().transitions().next(transition);
            is_in_earlier_year(timestamps[row.get()], month, before)
        })
        .collect();
    if pool.is_empty() {
        return Err(RolloutError::EmptyMonth { member: member.number(), month });
    }
    Ok(pool)
}

/// The transition of the member that ends in `row`.
fn ending_in(member: &Member<'_>, row: RowIndex) -> Option<TransitionIndex> {
    let transition = member.model().transitions().ending_in(row)?;
    member.contains(transition).then_some(transition)
}

/// Starts at these rows.
fn at_rows(
    member: &Member<'_>,
    rows: &[RowIndex],
    absent: Absent,
) -> Result<Vec<StartState>, RolloutError> {
    let recorded = member.model().states().rows();
    if let Some(&row) = rows.iter().find(|row| row.get() >= recorded) {
        return Err(RolloutError::UnknownRow { row, rows: recorded });
    }
    let lacking: Vec<RowIndex> =
        rows.iter().copied().filter(|&row| ending_in(member, row).is_none()).collect();
    let substitutes = match absent {
        Absent::External => external(member, &lacking)?
            .into_iter()
            .map(|start| StartState { start, replaced: None })
            .collect(),
        Absent::Replace => {
            let nearest = found(member, &lacking, 1)?;
            replaced_by(member, nearest.iter().map(|found| found[0]))?
        }
    };
    let mut substitutes = substitutes.into_iter();
    Ok(rows
        .iter()
        .filter_map(|&row| match ending_in(member, row) {
            Some(transition) => Some(StartState { start: Start::At(transition), replaced: None }),
            None => substitutes.next(),
        })
        .collect())
}

/// Starts at the source states of these neighbours.
fn replaced_by(
    member: &Member<'_>,
    nearest: impl Iterator<Item = Neighbor> + Clone,
) -> Result<Vec<StartState>, RolloutError> {
    let source = |neighbor: Neighbor| member.model().transitions().source(neighbor.transition);
    let rows: Vec<RowIndex> = nearest.clone().map(source).collect();
    let mut starts = at_rows(member, &rows, Absent::External)?;
    for (start, neighbor) in starts.iter_mut().zip(nearest) {
        start.replaced = Some(neighbor.distance);
    }
    Ok(starts)
}

fn external(member: &Member<'_>, rows: &[RowIndex]) -> Result<Vec<Start>, RolloutError> {
    let found = found(member, rows, member.model().k())?;
    Ok(rows.iter().zip(found).map(|(&row, neighbors)| Start::External { row, neighbors }).collect())
}

/// The nearest sources of each row; at least one.
fn found(
    member: &Member<'_>,
    rows: &[RowIndex],
    k: usize,
) -> Result<Vec<Vec<Neighbor>>, RolloutError> {
    if rows.is_empty() {
        return Ok(Vec::new());
    }
    let found = member.nearest_to_rows(rows, k)?;
    match found.iter().position(Vec::is_empty) {
        Some(position) => {
            Err(RolloutError::NoNeighbor { row: rows[position], member: member.number() })
        }
        None => Ok(found),
    }
}
