//! The length of a sweep's streams, and the windows of the log that they replay.

use calib_agent::{Part, ReturnMoments};
use calib_base::{
    StepError,
    output::{count, counted},
};
use calib_core::{Frames, RowStream, Timestamp};
use calib_data::Dataset;
use calib_study::Study;
use calib_sweep::{Candidate, ErrorScale, ScoringDemand, Span, Windows};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The streams of a sweep, with notes where they differ from the study.
pub struct Streams {
    /// The span of a stream, and the part that counts.
    pub demand: ScoringDemand,
    /// Windows of the held-out range. `None` without a held-out range.
    pub(crate) online: Option<Windows>,
    /// Windows of the log.
    pub(crate) log: Windows,
    pub(crate) notes: Vec<String>,
}

impl Streams {
    /// Returns the streams for returns with this discount factor.
    ///
    /// # Errors
    /// Returns [`StepError::Unscorable`] if no step of the held-out range can be scored. This is better known before
    /// any training.
    pub(crate) fn of(study: &Study, dataset: &Dataset, gamma: f64) -> Result<Self, StepError> {
        let sweep = &study.sweep;
        let mut notes = Vec::new();
        let mut steps = sweep.steps;
        match &dataset.held_out {
            Some(held_out) if held_out.rows() <= steps => {
                steps = held_out.rows().saturating_sub(1);
                notes.push(format!(
                    "training runs have {} steps, not {}, because the held-out period has no more; hold out more, or lower sweep.steps",
                    count(steps),
                    count(sweep.steps)
                ));
            }
            Some(_) => {}
            None => notes
                .push("no held-out period, so the choice cannot be checked; set data.held_out or data.train_fraction".to_owned()),
        }
        let demand = ScoringDemand { span: Span::new(steps, [gamma]), gamma, part: study.part() };
        let online = match &dataset.held_out {
            Some(held_out) => Some(held_out_windows(study, held_out, demand, &mut notes)?),
            None => None,
        };
        let log = Windows::log(dataset.train.segments(), demand, sweep.log_replay_runs);
        if log.starts.is_empty() && !study.has_model() {
            return Err(nothing_decides(demand));
        }
        if log.left_out > 0 {
            notes.push(format!(
                "{} of {} windows of the log are not replayed, because gaps leave hardly a step to score in them",
                log.left_out, sweep.log_replay_runs
            ));
        }
        Ok(Self { demand, online, log, notes })
    }
}

/// Returns the error for a study without a model that has nothing to choose by.
fn nothing_decides(demand: ScoringDemand) -> StepError {
    let ScoringDemand { span, gamma, .. } = demand;
    StepError::Unscorable(format!(
        "no window of the training range can be replayed, and without a model (model.kind = \"none\") nothing else would decide: runs have \
         {} steps, and scoring a prediction at gamma = {gamma} needs the {} states after it, in stretches without a gap; use a longer \
         data.train, a smaller sweep.steps or gamma, or set model.kind = \"knn\"",
        count(span.steps),
        span.tail
    ))
}

fn held_out_windows(
    study: &Study,
    held_out: &Frames,
    demand: ScoringDemand,
    notes: &mut Vec<String>,
) -> Result<Windows, StepError> {
    let asked = study.sweep.online_windows.min(study.sweep.online_runs);
    let windows = Windows::held_out(held_out.segments(), demand, asked);
    if windows.starts.is_empty() {
        let longest = held_out.segments().iter().map(calib_core::Segment::len).max().unwrap_or(0);
        let range =
            study.data.held_out.as_ref().map_or_else(String::new, |range| format!(" ({range})"));
        let other = match demand.part {
            Part::WholeRun => "or a smaller gamma",
            _ => "a smaller gamma, or sweep.scored = \"whole_run\"",
        };
        return Err(StepError::Unscorable(format!(
            "the held-out period{range} is too short for gamma = {}: scoring a prediction needs the {} states after it, the longest stretch without a gap has {} states, and {} of runs of {} steps are scored; hold out a longer period, {other}",
            demand.gamma,
            demand.span.tail,
            count(longest),
            part_name(demand.part),
            count(demand.span.steps),
        )));
    }
    if windows.left_out > 0 {
        notes.push(format!(
            "{} of the held-out period {} left out, because gaps leave hardly a step to score there",
            counted(windows.left_out, "window"),
            if windows.left_out == 1 { "is" } else { "are" }
        ));
    }
    Ok(windows)
}

/// Returns the words for the scored part of a run.
pub(crate) const fn part_name(part: Part) -> &'static str {
    match part {
        Part::WholeRun => "all steps",
        Part::AfterFirstQuarter => "the last three quarters",
        Part::FinalQuarter => "the last quarter",
    }
}

/// A window of the held-out period that a sweep replays.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct OnlineWindow {
    /// First row of the window in the held-out range.
    pub(crate) start_row: usize,
    /// Times of the first and the last state.
    pub(crate) times: [Timestamp; 2],
}

/// Returns the windows of the held-out range, with their times.
pub(crate) fn online_windows(windows: &Windows, held_out: &Frames) -> Vec<OnlineWindow> {
    let all = held_out.timestamps();
    windows
        .starts
        .iter()
        .map(|&start| {
            let times = [all[start], all[start + windows.states - 1]];
            OnlineWindow { start_row: start, times }
        })
        .collect()
}

/// Returns the scale of every sensor's errors: the standard deviation of its return over the training range, for each
/// discount factor that a setting gives it.
pub(crate) fn error_scales(
    dataset: &Dataset,
    sensors: &[(String, usize)],
    candidates: &[Candidate],
) -> Vec<ErrorScale> {
    let train = &dataset.train;
    let replay = RowStream::replay(train.states().clone(), train.segments());
    sensors
        .iter()
        .flat_map(|(sensor, column): &(String, usize)| {
            let of_sensor = candidates.iter().map(|candidate| candidate.agent.gamma_for(sensor));
            let mut gammas: Vec<f64> = of_sensor.collect();
            gammas.sort_by(f64::total_cmp);
            gammas.dedup();
            gammas
                .into_iter()
                .map(|gamma| ErrorScale {
                    sensor: sensor.clone(),
                    gamma,
                    returns: ReturnMoments::of(&replay, *column, gamma),
                })
                .collect::<Vec<_>>()
        })
        .collect()
}
