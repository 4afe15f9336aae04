use calib_core::{Monitor, RowIndex, Seed, Silent, States, Timestamp, TransitionIndex};
use calib_files::ScratchPlace;
use calib_knn::{KnnModel, Member, Neighbor};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{
    Absent, RequestedStart, RolloutError,
    requested_start::{deployment_rows, draw, recorded_rows},
};

/// Where a rollout starts. A start is a state: from transition `i` the current state is `s'_i`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
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
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StartState {
    /// Where the rollout starts.
    pub start: Start,
    /// What was asked for.
    pub wanted: RequestedStart,
    /// The distance from the state asked for to the recorded state that replaces it, if one does.
    pub replaced: Option<f32>,
}

/// Where start states come from.
#[derive(Clone, Copy, Debug)]
pub enum StartSource<'a> {
    /// Uniform over the transitions of the ensemble member.
    Random,
    /// Listed rows; start `r` takes row `r` modulo their number.
    Rows {
        /// The rows.
        rows: &'a [RowIndex],
        /// What happens to a row that the member lacks.
        absent: Absent,
    },
    /// The latest rows before the deployment, spread over a window that ends with the last: start `r` is the row that lies 0, 1/2, 1/4, 3/4,
    /// 1/8, … of the window before it.
    Recent {
        /// Time of each row of the data.
        timestamps: &'a [Timestamp],
        /// Begin of the deployment: only rows before it are used; all, if there is none.
        before: Option<Timestamp>,
        /// Rows of the window; without it the last tenth of the rows.
        window: Option<usize>,
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

impl StartSource<'_> {
    /// The seed of member `member`'s start states: members have random ones of their own, and share all others.
    pub fn seed_of(&self, seed: Seed, member: usize) -> Seed {
        match self {
            Self::Random => seed.child("member").number(member as u64),
            _ => seed,
        }
    }
}

/// Where a search for nearest states has its large arrays, and who watches it.
type Search<'a> = (&'a ScratchPlace, &'a dyn Monitor);

/// `count` start states for rollouts of `member`: a pure function of its arguments. Searches in memory.
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

/// `count` start states for rollouts of each member, as [`start_states`] with [`StartSource::seed_of`] the member.
///
/// States of a deployment are searched for once for all members; recorded rows in each member that lacks them, which are
/// others in each. The large arrays of searches are in `place`.
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

/// A member without transitions has no states to start from.
fn check_members<'a>(mut members: impl Iterator<Item = Member<'a>>) -> Result<(), RolloutError> {
    if members.any(|member| member.is_empty()) { Err(RolloutError::NoTransitions) } else { Ok(()) }
}

/// Drawn rows of the deployment period, and their states.
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

/// Starts from sources within the data of the model.
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

/// The start at a transition of the member.
fn at(member: &Member<'_>, transition: TransitionIndex) -> StartState {
    let wanted = RequestedStart::Recorded(member.model().transitions().next(transition));
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

/// Starts at the source states of the first of these neighbours, for what was wanted.
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

/// Starts at rows that the member lacks.
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

/// The nearest sources of each row; at least one.
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
