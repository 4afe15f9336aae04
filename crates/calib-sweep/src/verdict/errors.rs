use calib_agent::Part;
use calib_stats::{Nested, StatsError, Summary, summarise, summarise_overlapping};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Judging;
use crate::{Candidate, EnvironmentId, ErrorScale, RunRow, SweepError, UnitResult};

/// Errors of all settings in one environment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct EnvironmentScores {
    /// The environment.
    pub environment: EnvironmentId,
    /// Number of distinct streams: rollouts, windows of the log, or windows of the held-out range.
    pub streams: usize,
    /// Number of independent streams. Overlapping windows of the log count as the number of windows that would fit side by side into the
    /// rows that they cover. Any other stream counts once.
    pub independent: usize,
    /// Number of runs over these streams.
    pub runs: usize,
    /// NRMSE of each setting: over streams, where each stream is the mean of its runs. The size of the sample is the number of
    /// independent streams. If there is only one stream, the NRMSE is over runs.
    pub candidates: Vec<Summary>,
    /// Skill of each setting: 1 − (mean RMSE) / (mean standard deviation of the returns). 0 is the error of predicting the mean of each
    /// run's returns. None if a run diverged, or the returns are constant.
    pub skill: Vec<Option<f64>>,
}

/// The runs over one stream.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Stream {
    pub(super) start_row: u32,
    pub(super) scored_steps: usize,
    /// NRMSE `[run][setting]`: +∞ where the setting diverged, `None` where it was dropped before the run.
    pub(super) runs: Vec<Vec<Option<f64>>>,
}

impl Stream {
    /// Returns the mean error of each setting over its runs: +∞ if one diverged, or if there are no runs.
    pub(super) fn means(&self) -> Vec<f64> {
        let candidates = self.runs.first().map_or(0, Vec::len);
        (0..candidates).map(|candidate| self.mean(candidate)).collect()
    }

    /// Returns the errors as `[run][setting]`, with +∞ for missing runs.
    fn errors_of_runs(&self) -> Vec<Vec<f64>> {
        let runs = self.runs.iter();
        runs.map(|run| run.iter().map(|error| error.unwrap_or(f64::INFINITY)).collect()).collect()
    }

    /// Returns the mean error of one setting, as [`means`](Self::means) does.
    pub(super) fn mean(&self, candidate: usize) -> f64 {
        let made = self.runs.iter().filter_map(|run| run[candidate]);
        let (sum, count) = made.fold((0.0, 0_usize), |(sum, count), x| (sum + x, count + 1));
        if count == 0 { f64::INFINITY } else { sum / count as f64 }
    }
}

/// The measured errors in one environment, by stream.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Errors {
    pub(super) environment: EnvironmentId,
    pub(super) streams: Vec<Stream>,
    /// Steps of the longest run.
    steps: usize,
    /// Σ RMSE and Σ standard deviation of the returns over all runs, one pair per setting.
    totals: Vec<(f64, f64)>,
}

impl Errors {
    /// Collects the errors of the results in one environment, in the order of their runs.
    ///
    /// Runs share a stream if they begin at the same row of recorded data. Every rollout is a stream of its own.
    pub(super) fn new(
        environment: EnvironmentId,
        results: &[&UnitResult],
        judging: &Judging<'_>,
        candidates: &[Candidate],
    ) -> Result<Self, SweepError> {
        let Judging { part, scales, .. } = *judging;
        let own = results.iter().filter(|result| result.unit.environment == environment);
        let mut streams = Vec::<Stream>::new();
        let mut totals = vec![(0.0, 0.0); candidates.len()];
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
                    runs: vec![run],
                }),
            }
            steps = steps.max(result.rows.iter().map(|row| row.steps).max().unwrap_or(0));
        }
        if environment == EnvironmentId::Online {
            streams.sort_by_key(|stream| stream.start_row);
        }
        Ok(Self { environment, streams, steps, totals })
    }

    /// Returns all runs for resampling as `[unit][run][setting]`. For Online and log replay a unit is a stream with its
    /// runs. An ensemble member is one unit with all its rollouts. Missing runs of dropped settings are +∞, so that
    /// these settings cannot be chosen.
    pub(super) fn units(&self) -> Vec<Vec<Vec<f64>>> {
        match self.environment {
            EnvironmentId::Member(_) => {
                vec![self.streams.iter().flat_map(Stream::errors_of_runs).collect()]
            }
            EnvironmentId::Online | EnvironmentId::LogReplay => {
                self.streams.iter().map(Stream::errors_of_runs).collect()
            }
        }
    }

    /// Returns the same runs, set up so that a resample draws as many units as are independent.
    pub(super) fn nested(&self) -> Result<Nested, StatsError> {
        Ok(Nested::new(self.units())?.with_independent(self.independent()))
    }

    /// Returns the mean error of a setting over each stream that it was trained on.
    fn of_streams(&self, candidate: usize) -> Vec<f64> {
        let own = self.streams.iter();
        let own = own.filter(|stream| stream.runs.iter().any(|run| run[candidate].is_some()));
        own.map(|stream| stream.mean(candidate)).collect()
    }

    /// Returns the mean error of each setting over the streams that it was trained on: +∞ if it was dropped before the
    /// first.
    pub(super) fn means(&self) -> Result<Vec<f64>, SweepError> {
        (0..self.totals.len())
            .map(|candidate: usize| match &self.of_streams(candidate)[..] {
                [] => Ok(f64::INFINITY),
                errors => Ok(calib_stats::mean(errors)?),
            })
            .collect()
    }

    /// Returns the number of independent streams.
    pub(super) fn independent(&self) -> usize {
        match self.environment {
            EnvironmentId::LogReplay => fitting(&self.streams, self.steps),
            EnvironmentId::Online | EnvironmentId::Member(_) => self.streams.len(),
        }
    }

    /// Whether the returns vary in some run.
    pub(super) fn varies(&self) -> bool {
        self.totals.iter().any(|&(_, std): &(f64, f64)| std > 0.0)
    }

    pub(super) fn scores(&self) -> Result<EnvironmentScores, SweepError> {
        Ok(EnvironmentScores {
            environment: self.environment,
            streams: self.streams.len(),
            independent: self.independent(),
            runs: self.streams.iter().map(|stream| stream.runs.len()).sum(),
            candidates: (0..self.totals.len())
                .map(|candidate: usize| -> Result<Summary, SweepError> {
                    let summary = match &self.streams[..] {
                        [one] => {
                            let runs: Vec<f64> =
                                one.runs.iter().filter_map(|run| run[candidate]).collect();
                            if runs.is_empty() { Summary::NONE } else { summarise(&runs)? }
                        }
                        _ => match &self.of_streams(candidate)[..] {
                            [] => Summary::NONE,
                            means => summarise_overlapping(means, self.independent())?,
                        },
                    };
                    Ok(summary)
                })
                .collect::<Result<_, _>>()?,
            skill: self
                .totals
                .iter()
                .map(|&(rmse, std): &(f64, f64)| {
                    (rmse.is_finite() && std > 0.0).then_some(1.0 - rmse / std)
                })
                .collect(),
        })
    }
}

/// Whether the streams are consecutive recorded rows. Two such streams that begin at the same row are equal.
const fn is_recorded(environment: EnvironmentId) -> bool {
    matches!(environment, EnvironmentId::Online | EnvironmentId::LogReplay)
}

/// Returns how many windows of `steps` rows fit side by side into the rows that `windows` cover. Each unbroken part
/// counts by itself. A chain of overlapping windows therefore counts as fewer than it has windows.
fn fitting(windows: &[Stream], steps: usize) -> usize {
    let mut starts: Vec<usize> = windows.iter().map(|window| window.start_row as usize).collect();
    starts.sort_unstable();
    let parts = starts.chunk_by(|one, next| *next < one + steps);
    parts.map(|part| (part[part.len() - 1] - part[0]) / steps.max(1) + 1).sum()
}

fn rmse(result: &UnitResult, row: &RunRow, part: Part) -> Result<f64, SweepError> {
    row.rmse(part).ok_or_else(|| SweepError::NothingScored { unit: result.unit.clone() })
}
