use calib_core::{RowIndex, Seed, States, Timestamp, TransitionIndex};
use calib_knn::{Member, Neighbor};

use crate::{
    Absent, RolloutError, Wanted,
    wanted::{deployment_rows, draw, recorded_rows},
};

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
    /// What was asked for.
    pub wanted: Wanted,
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
    /// The latest rows before the deployment: start `r` is the `r`-th last (modulo their number).
    Recent {
        /// Time of each row of the data.
        timestamps: &'a [Timestamp],
        /// Begin of the deployment: only rows before it are used; all, if there is none.
        before: Option<Timestamp>,
    },
    /// Uniform over the rows in one month of the year, in years before the deployment.
    CalendarMonth {
        /// Time of each row of the data.
        timestamps: &'a [Timestamp],
        /// The month, 1 to 12.
        month: u8,
        /// Begin of the deployment: only rows of calendar years before its own are used; all, if there is none.
        before: Option<Timestamp>,
    },
    /// Rows of the deployment period, drawn uniformly, replaced by their nearest sources in the member.
    Nearest {
        /// States of the deployment period in the metric of the model.
        states: &'a States,
    },
}

/// `count` start states for rollouts of `member`: a pure function of its arguments.
///
/// Start `r` depends on `seed` and `r` only, so asking for more starts keeps the first ones. All sources but
/// [`Random`](StartSource::Random), which draws from what the member has, choose states without regard to the
/// member: with one `seed` these are the same for every member, and for every model of the same data. What a member
/// lacks (it lies in the block that is left out) is replaced by its nearest state there, in the metric of the model;
/// listed rows are so with [`Absent::Replace`] only.
///
/// # Errors
/// If the source has no rows, names rows that do not exist, or finds nothing in the member.
pub fn start_states(
    member: &Member<'_>,
    source: StartSource<'_>,
    count: usize,
    seed: Seed,
) -> Result<Vec<StartState>, RolloutError> {
    if member.is_empty() {
        return Err(RolloutError::NoTransitions);
    }
    let (transitions, recorded) = (member.model().transitions(), member.model().states().rows());
    if let StartSource::Nearest { states } = source {
        let rows = deployment_rows(states, count, seed)?;
        let drawn: Vec<f32> = rows.iter().flat_map(|row| states.row(row.get())).copied().collect();
        let drawn = States::new(drawn, count, states.columns())
            .unwrap_or_else(|_| unreachable!("rows of states are finite"));
        let nearest = member.nearest_sources(&drawn, 1)?;
        let wanted = rows.into_iter().map(Wanted::Deployment);
        return replaced_by(member, nearest.iter().map(|found| found[0]).zip(wanted));
    }
    if let Some(rows) = recorded_rows(source, transitions, recorded, count, seed)? {
        let absent = match source {
            StartSource::Rows { absent, .. } => absent,
            _ => Absent::Replace,
        };
        return at_rows(member, &rows, absent);
    }
    Ok((0..count).map(|r| at(member, member.nth(draw(seed, r, member.len())))).collect())
}

/// The start at a transition of the member.
fn at(member: &Member<'_>, transition: TransitionIndex) -> StartState {
    let wanted = Wanted::Recorded(member.model().transitions().next(transition));
    StartState { start: Start::At(transition), wanted, replaced: None }
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
    let lacking: Vec<RowIndex> =
        rows.iter().copied().filter(|&row| ending_in(member, row).is_none()).collect();
    let substitutes = match absent {
        Absent::External => external(member, &lacking)?,
        Absent::Replace => {
            let nearest = found(member, &lacking, 1)?;
            let wanted = lacking.iter().copied().map(Wanted::Recorded);
            replaced_by(member, nearest.iter().map(|found| found[0]).zip(wanted))?
        }
    };
    let mut substitutes = substitutes.into_iter();
    Ok(rows
        .iter()
        .filter_map(|&row| match ending_in(member, row) {
            Some(transition) => Some(at(member, transition)),
            None => substitutes.next(),
        })
        .collect())
}

/// Starts at the source states of these neighbours, for what was wanted.
fn replaced_by(
    member: &Member<'_>,
    nearest: impl Iterator<Item = (Neighbor, Wanted)> + Clone,
) -> Result<Vec<StartState>, RolloutError> {
    let source = |neighbor: Neighbor| member.model().transitions().source(neighbor.transition);
    let rows: Vec<RowIndex> = nearest.clone().map(|(neighbor, _)| source(neighbor)).collect();
    let mut starts = at_rows(member, &rows, Absent::External)?;
    for (start, (neighbor, wanted)) in starts.iter_mut().zip(nearest) {
        start.wanted = wanted;
        start.replaced = Some(neighbor.distance);
    }
    Ok(starts)
}

/// Starts at rows that the member lacks.
fn external(member: &Member<'_>, rows: &[RowIndex]) -> Result<Vec<StartState>, RolloutError> {
    let found = found(member, rows, member.model().k())?;
    let starts = rows.iter().zip(found).map(|(&row, neighbors)| StartState {
        start: Start::External { row, neighbors },
        wanted: Wanted::Recorded(row),
        replaced: None,
    });
    Ok(starts.collect())
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
