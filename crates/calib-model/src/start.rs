use calib_core::{Monitor, RowIndex, Seed, Silent, States, TransitionIndex};
use calib_files::ScratchPlace;
use calib_knn::{KnnModel, Member, Neighbor};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{
    Absent, RequestedStart, RolloutError, StartSource,
    requested_start::{deployment_rows, draw, recorded_rows},
};

/// The start state of a rollout. At transition `i` it is the next state `s'_i`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Start {
    /// The next state of a transition of the ensemble member.
    At(TransitionIndex),
    /// A recorded row that no transition of the ensemble member ends in: the first row of a segment, or a row outside
    /// the ensemble member. The first step is drawn from the nearest sources of the row in the ensemble member.
    External {
        /// The recorded row.
        row: RowIndex,
        /// Its nearest sources in the ensemble member, nearest first.
        neighbors: Vec<Neighbor>,
    },
}

/// The start state of a rollout, and the requested one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StartState {
    /// The start state.
    pub start: Start,
    /// The requested state.
    pub wanted: RequestedStart,
    /// The distance from the requested state to the recorded state that replaces it, if one does.
    pub replaced: Option<f32>,
}

/// The place of the large arrays of a search for nearest states, and its monitor.
type Search<'a> = (&'a ScratchPlace, &'a dyn Monitor);

/// Returns `count` start states for rollouts of `member`: a pure function of its arguments. It searches in memory.
///
/// Start state `r` depends only on `seed` and `r`, so asking for more start states keeps the first ones. All sources
/// but [`Random`](StartSource::Random), which draws from the member's own rows, choose states without regard to the
/// member: with one `seed` these are the same for every member, and for every model of the same data. A state that a
/// member lacks (it is in the block that is left out) is replaced by its nearest state there, in the metric of the
/// model. Listed rows are replaced only with [`Absent::Replace`].
///
/// # Errors
/// If the source has no rows, names rows that do not exist, or finds nothing in the member.
pub fn start_states(
    member: &Member<'_>,
    source: StartSource<'_>,
    count: usize,
    seed: Seed,
) -> Result<Vec<StartState>, RolloutError> {
    check_members(std::iter::once(*member))?;
    let search: Search<'_> = (&ScratchPlace::Memory, &Silent);
    if let StartSource::Nearest { states } = source {
        let (rows, drawn) = drawn(states, count, seed)?;
        let nearest = member.nearest_sources(&drawn, 1, &Silent)?;
        return replaced_by(
            member,
            &nearest,
            rows.into_iter().map(RequestedStart::Deployment),
            search,
        );
    }
    recorded(member, source, count, seed, search)
}

/// Returns `count` start states for rollouts of each member, as [`start_states`] with [`StartSource::seed_of`] the
/// member.
///
/// States of a deployment are searched for once for all members. Recorded rows are searched for in each member that
/// lacks them, because each lacks others. The large arrays of searches are in `place`.
///
/// # Errors
/// As [`start_states`]; if there is no place for the arrays, or the monitor interrupts a search.
pub fn start_states_of_all(
    model: &KnnModel,
    source: StartSource<'_>,
    count: usize,
    seed: Seed,
    place: &ScratchPlace,
    monitor: &dyn Monitor,
) -> Result<Vec<Vec<StartState>>, RolloutError> {
    let members = (0..model.members()).map(|number| model.member(number));
    check_members(members.clone())?;
    let search: Search<'_> = (place, monitor);
    if let StartSource::Nearest { states } = source {
        let (rows, drawn) = drawn(states, count, seed)?;
        let nearest = model.nearest_sources(&drawn, 1, place, monitor)?;
        return members
            .zip(nearest)
            .map(|(member, nearest)| {
                let wanted = rows.iter().copied().map(RequestedStart::Deployment);
                replaced_by(&member, &nearest, wanted, search)
            })
            .collect();
    }
    members
        .map(|member| {
            recorded(&member, source, count, source.seed_of(seed, member.number()), search)
        })
        .collect()
}

/// Checks that every member has transitions, and so states to start from.
fn check_members<'a>(mut members: impl Iterator<Item = Member<'a>>) -> Result<(), RolloutError> {
    if members.any(|member| member.is_empty()) { Err(RolloutError::NoTransitions) } else { Ok(()) }
}

/// Draws rows of the deployment period, and returns them with their states.
fn drawn(
    states: &States,
    count: usize,
    seed: Seed,
) -> Result<(Vec<RowIndex>, States), RolloutError> {
    let rows = deployment_rows(states, count, seed)?;
    let values: Vec<f32> = rows.iter().flat_map(|row| states.row(row.get())).copied().collect();
    let drawn = States::new(values, count, states.columns())
        .unwrap_or_else(|_| unreachable!("rows of states are finite"));
    Ok((rows, drawn))
}

/// Returns start states from sources within the data of the model.
fn recorded(
    member: &Member<'_>,
    source: StartSource<'_>,
    count: usize,
    seed: Seed,
    search: Search<'_>,
) -> Result<Vec<StartState>, RolloutError> {
    let transitions = member.model().transitions();
    let rows = member.model().states().rows();
    if let Some(rows) = recorded_rows(source, transitions, rows, count, seed)? {
        let absent = match source {
            StartSource::Rows { absent, .. } => absent,
            _ => Absent::Replace,
        };
        return at_rows(member, &rows, absent, search);
    }
    Ok((0..count).map(|r| at(member, member.nth(draw(seed, r, member.len())))).collect())
}

/// Returns the start state at a transition of the member.
fn at(member: &Member<'_>, transition: TransitionIndex) -> StartState {
    let wanted = RequestedStart::Recorded(member.model().transitions().next(transition));
    StartState { start: Start::At(transition), wanted, replaced: None }
}

/// Returns the transition of the member that ends in `row`.
fn ending_in(member: &Member<'_>, row: RowIndex) -> Option<TransitionIndex> {
    let transition = member.model().transitions().ending_in(row)?;
    member.contains(transition).then_some(transition)
}

/// Returns the start states at these rows.
fn at_rows(
    member: &Member<'_>,
    rows: &[RowIndex],
    absent: Absent,
    search: Search<'_>,
) -> Result<Vec<StartState>, RolloutError> {
    let lacking: Vec<RowIndex> =
        rows.iter().copied().filter(|&row| ending_in(member, row).is_none()).collect();
    let substitutes = match absent {
        Absent::External => external(member, &lacking, search)?,
        Absent::Replace => {
            let nearest = found(member, &lacking, 1, search)?;
            let wanted = lacking.iter().copied().map(RequestedStart::Recorded);
            replaced_by(member, &nearest, wanted, search)?
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

/// Returns start states at the source states of the first of these neighbours, as replacements for the requested ones.
fn replaced_by(
    member: &Member<'_>,
    nearest: &[Vec<Neighbor>],
    wanted: impl Iterator<Item = RequestedStart>,
    search: Search<'_>,
) -> Result<Vec<StartState>, RolloutError> {
    let rows: Vec<RowIndex> = nearest
        .iter()
        .map(|near| member.model().transitions().source(near[0].transition))
        .collect();
    let mut starts = at_rows(member, &rows, Absent::External, search)?;
    for ((start, near), wanted) in starts.iter_mut().zip(nearest).zip(wanted) {
        start.wanted = wanted;
        start.replaced = Some(near[0].distance);
    }
    Ok(starts)
}

/// Returns start states for rows that the member lacks.
fn external(
    member: &Member<'_>,
    rows: &[RowIndex],
    search: Search<'_>,
) -> Result<Vec<StartState>, RolloutError> {
    let found = found(member, rows, member.model().k(), search)?;
    let starts = rows.iter().zip(found).map(|(&row, neighbors)| StartState {
        start: Start::External { row, neighbors },
        wanted: RequestedStart::Recorded(row),
        replaced: None,
    });
    Ok(starts.collect())
}

/// Returns the nearest sources of each row, at least one.
fn found(
    member: &Member<'_>,
    rows: &[RowIndex],
    k: usize,
    (place, monitor): Search<'_>,
) -> Result<Vec<Vec<Neighbor>>, RolloutError> {
    if rows.is_empty() {
        return Ok(Vec::new());
    }
    let found = member.nearest_to_rows(rows, k, place, monitor)?;
    match found.iter().position(Vec::is_empty) {
        Some(position) => {
            Err(RolloutError::NoNeighbor { row: rows[position], member: member.number() })
        }
        None => Ok(found),
    }
}
