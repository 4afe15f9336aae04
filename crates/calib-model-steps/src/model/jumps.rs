//! Jump statistics as text.

use calib_base::output::{count, percent};
use calib_knn::ModelConfig;
use calib_model::JumpStatistics;

use crate::model::recurrence::named;

/// Returns a line about how an ensemble member's rollouts move through the log.
pub fn line(jumps: &JumpStatistics) -> String {
    format!(
        "{} of steps jump, {} to another time of the log; mean run {:.1} steps, {} distinct rows",
        percent(jumps.jump_rate),
        percent(jumps.departure_rate),
        jumps.mean_run_length,
        count(jumps.distinct_rows),
    )
}

/// Returns the problem of a member's rollouts for runs of `run` steps, if there is one.
pub fn note(jumps: &JumpStatistics, transitions: usize, run: usize) -> Option<&'static str> {
    // A rollout that circles has no departures, so it would also count as a replay.
    if jumps.circling(transitions) {
        Some("circles within few rows")
    } else if jumps.near_verbatim(run) {
        Some("replays the log nearly verbatim")
    } else {
        None
    }
}

/// Returns warnings about members whose rollouts are unsuitable for runs of `run` steps, with
/// remedies.
pub(crate) fn warnings<'a>(
    members: impl Iterator<Item = (Option<&'a JumpStatistics>, usize)>,
    model: &ModelConfig,
    run: usize,
) -> Vec<String> {
    let mut circling = Vec::new();
    let mut verbatim = Vec::new();
    for (member, (jumps, transitions)) in members.enumerate() {
        let Some(jumps) = jumps else { continue };
        match note(jumps, transitions, run) {
            Some(_) if jumps.circling(transitions) => circling.push(member),
            Some(_) => verbatim.push(member),
            None => {}
        }
    }
    let advice = if model.exclude_self || model.theiler > 0 {
        "try model.exclude_self = false and model.theiler = 0"
    } else {
        "try a larger preprocess.subsample, and look for frozen sensors with `calib inspect`"
    };
    let circling = named(circling.into_iter()).map(|members| {
        format!(
            "rollouts of {members} circle within few rows, which is no model of the plant; {advice}"
        )
    });
    let verbatim = named(verbatim.into_iter()).map(|members| {
        format!(
            "rollouts of {members} replay the log nearly verbatim: a run of {} steps goes to another time of the log fewer than three times; try longer runs (sweep.steps), a larger preprocess.subsample, or more neighbors",
            count(run)
        )
    });
    circling.into_iter().chain(verbatim).collect()
}
