use std::collections::{BTreeMap, BTreeSet};

use calib_agent::Part;
use calib_stats::{Summary, cluster_means, summarise};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{Candidate, EnvironmentId, ErrorScale, RunRow, SweepError, UnitResult};

/// Errors of all candidates in one environment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct EnvironmentScores {
    /// Which environment.
    pub environment: EnvironmentId,
    /// Different streams: rollouts, windows of the log, or windows of the held-out range.
    pub streams: usize,
    /// Groups of streams that share no rows: windows of the log that overlap are one, everything else is alone.
    pub independent: usize,
    /// Runs over them.
    pub runs: usize,
    /// NRMSE, one a candidate: over independent groups of streams, each the mean of its streams, which are the means of their runs;
    /// where there is one stream, over runs.
    pub candidates: Vec<Summary>,
    /// Skill, one a candidate: 1 − (mean RMSE) / (mean standard deviation of the returns); 0 is the error of predicting the mean
    /// of each run's returns. None if a run diverged, or the returns are constant.
    pub skill: Vec<Option<f64>>,
}

/// Runs over one stream.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Stream {
    /// Row that it begins at.
    pub(super) start_row: u32,
    /// Steps that are scored.
    pub(super) scored_steps: usize,
    /// Number of the group of streams with which it shares rows.
    group: usize,
    /// NRMSE `[run][candidate]`; +∞ where a value diverged, none where it was dropped before the run.
    pub(super) runs: Vec<Vec<Option<f64>>>,
}

impl Stream {
    /// Mean error of each candidate over the runs that it made: +∞ if one diverged, or if it made none.
    pub(super) fn means(&self) -> Vec<f64> {
        let candidates = self.runs.first().map_or(0, Vec::len);
        (0..candidates).map(|candidate| self.mean(candidate)).collect()
    }

    fn mean(&self, candidate: usize) -> f64 {
        let made = self.runs.iter().filter_map(|run| run[candidate]);
        let (sum, count) = made.fold((0.0, 0_usize), |(sum, count), x| (sum + x, count + 1));
        if count == 0 { f64::INFINITY } else { sum / count as f64 }
    }
}

/// What was measured in one environment, stream by stream.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Errors {
    pub(super) environment: EnvironmentId,
    pub(super) streams: Vec<Stream>,
    /// Σ RMSE and Σ standard deviation of the returns over all runs, one pair a candidate.
    totals: Vec<(f64, f64)>,
}

impl Errors {
    /// Of the results in one environment, in the order of their runs.
    ///
    /// Runs share a stream if they begin at the same row of recorded data; every rollout is a stream of its own.
    pub(super) fn new(
        environment: EnvironmentId,
        results: &[&UnitResult],
        (part, scales): (Part, &[ErrorScale]),
        candidates: &[Candidate],
    ) -> Result<Self, SweepError> {
        let own = results.iter().filter(|result| result.unit.environment == environment);
        let (mut streams, mut totals) = (Vec::<Stream>::new(), vec![(0.0, 0.0); candidates.len()]);
        let mut steps = 0;
        for result in own {
            let mut run = vec![None; candidates.len()];
            let mut scored_steps = 0;
            for row in &result.rows {
                let candidate =
                    candidates.get(row.candidate).ok_or_else(|| SweepError::UnknownCandidate {
                        unit: result.unit.clone(),
                        candidate: row.candidate,
                        candidates: candidates.len(),
                    })?;
                let scale = ErrorScale::find(scales, &result.unit.sensor, candidate);
                let rmse = rmse(result, row, part)?;
                run[row.candidate] = Some(rmse / scale);
                let score = row.scores.of(part);
                scored_steps = scored_steps.max(score.map_or(0, |score| score.scored_steps));
                totals[row.candidate].0 += rmse;
                totals[row.candidate].1 += score.map_or(0.0, |score| score.return_std);
            }
            let place = streams.iter().position(|stream| {
                is_recorded(environment) && stream.start_row == result.start_row
            });
            match place {
                Some(place) => streams[place].runs.push(run),
                None => streams.push(Stream {
                    start_row: result.start_row,
                    scored_steps,
                    group: streams.len(),
                    runs: vec![run],
                }),
            }
            steps = steps.max(result.rows.iter().map(|row| row.steps).max().unwrap_or(0));
        }
        match environment {
            EnvironmentId::Online => streams.sort_by_key(|stream| stream.start_row),
            EnvironmentId::LogReplay => group(&mut streams, steps),
            EnvironmentId::Member(_) => {}
        }
        Ok(Self { environment, streams, totals })
    }

    /// All runs for resampling, `[unit][run][candidate]`: streams and their runs Online, windows of the log that overlap as one unit, and one
    /// unit with all rollouts for a member. What a dropped value did not make is +∞: it cannot be chosen.
    pub(super) fn units(&self) -> Vec<Vec<Vec<f64>>> {
        let run = |run: &Vec<Option<f64>>| -> Vec<f64> {
            run.iter().map(|error| error.unwrap_or(f64::INFINITY)).collect()
        };
        let runs = |stream: &Stream| stream.runs.iter().map(run).collect::<Vec<_>>();
        match self.environment {
            EnvironmentId::Member(_) => vec![self.streams.iter().flat_map(runs).collect()],
            EnvironmentId::Online => self.streams.iter().map(runs).collect(),
            EnvironmentId::LogReplay => {
                let mut units: BTreeMap<usize, Vec<Vec<f64>>> = BTreeMap::new();
                for stream in &self.streams {
                    units.entry(stream.group).or_default().extend(runs(stream));
                }
                units.into_values().collect()
            }
        }
    }

    /// Mean error of a candidate over the streams that it was trained on, group by group.
    fn of_groups(&self, candidate: usize) -> Result<Vec<f64>, SweepError> {
        let of = |stream: &Stream| {
            let made = stream.runs.iter().any(|run| run[candidate].is_some());
            made.then(|| (stream.group, stream.mean(candidate)))
        };
        let (groups, errors): (Vec<usize>, Vec<f64>) = self.streams.iter().filter_map(of).unzip();
        if groups.is_empty() {
            return Ok(Vec::new());
        }
        let means = cluster_means(&groups, &errors)?;
        Ok(means.into_iter().map(|(_, mean)| mean).collect())
    }

    /// Mean error of each candidate over independent groups of the streams that it was trained on; +∞ if it was dropped before the first.
    pub(super) fn means(&self) -> Result<Vec<f64>, SweepError> {
        let mean = |candidate: usize| match &self.of_groups(candidate)?[..] {
            [] => Ok(f64::INFINITY),
            errors => Ok(calib_stats::mean(errors)?),
        };
        (0..self.totals.len()).map(mean).collect()
    }

    /// Groups of streams that share no rows.
    fn groups(&self) -> usize {
        self.streams.iter().map(|stream| stream.group).collect::<BTreeSet<_>>().len()
    }

    /// What is shown of them.
    pub(super) fn scores(&self) -> Result<EnvironmentScores, SweepError> {
        let summary = |candidate: usize| -> Result<Summary, SweepError> {
            let each = match &self.streams[..] {
                [one] => one.runs.iter().filter_map(|run| run[candidate]).collect(),
                _ => self.of_groups(candidate)?,
            };
            Ok(if each.is_empty() { Summary::NONE } else { summarise(&each)? })
        };
        let skill =
            |&(rmse, std): &(f64, f64)| (rmse.is_finite() && std > 0.0).then_some(1.0 - rmse / std);
        Ok(EnvironmentScores {
            environment: self.environment,
            streams: self.streams.len(),
            independent: self.groups(),
            runs: self.streams.iter().map(|stream| stream.runs.len()).sum(),
            candidates: (0..self.totals.len()).map(summary).collect::<Result<_, _>>()?,
            skill: self.totals.iter().map(skill).collect(),
        })
    }
}

/// Whether streams are rows of recorded data one after the other, so that two which begin at the same row are the same.
const fn is_recorded(environment: EnvironmentId) -> bool {
    matches!(environment, EnvironmentId::Online | EnvironmentId::LogReplay)
}

/// Put windows of the log into groups: in the order of rows, one that begins less than `steps` rows after the first of a group belongs to
/// it. The last of a group may reach into the next one by less than a window.
fn group(streams: &mut [Stream], steps: usize) {
    let mut order: Vec<usize> = (0..streams.len()).collect();
    order.sort_by_key(|&stream| streams[stream].start_row);
    let mut begin: Option<(usize, usize)> = None;
    for stream in order {
        let start = streams[stream].start_row as usize;
        begin = match begin {
            Some((first, number)) if start < first + steps => Some((first, number)),
            Some((_, number)) => Some((start, number + 1)),
            None => Some((start, 0)),
        };
        streams[stream].group = begin.map_or(0, |(_, number)| number);
    }
}

/// RMSE of a run over a part.
fn rmse(result: &UnitResult, row: &RunRow, part: Part) -> Result<f64, SweepError> {
    row.rmse(part).ok_or_else(|| SweepError::NothingScored { unit: result.unit.clone() })
}
