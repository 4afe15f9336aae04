//! Start states as requested in a study.

use calib_base::{Context as _, StepError, bail, output::number};
use calib_core::{Frames, RowIndex, Seed, States, Timestamp, Transitions};
use calib_data::{DataConfig, Moment};
use calib_files::Fingerprint;
use calib_model::{
    ModelStart, RequestedStart, RolloutConfig, Search, StartKind, StartSource, month_of,
    start_rows, year_of,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::model::model_files::OpenModel;

/// The inputs of start states, besides the model and `[rollout]`. Deployments with the same inputs share streams.
#[derive(Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Origin {
    /// A month, in calendar years before `before`.
    Month {
        /// From 1, January.
        month: u8,
        /// The year of the deployment, if there is one.
        before: Option<i64>,
    },
    /// Number of rows of the model's data before the deployment.
    Rows(usize),
    /// The states of a deployment.
    States(Option<Fingerprint>),
}

/// The request for start states, with what is known of it without a model.
struct StartRequest<'a> {
    config: &'a RolloutConfig,
    /// Time of each row of the model's data.
    timestamps: &'a [Timestamp],
    /// Begin of the deployment.
    deployed: Option<Timestamp>,
    /// Rows that the study lists.
    listed: Vec<RowIndex>,
}

impl<'a> StartRequest<'a> {
    /// Returns the request of `config` for a model that is built from `frames`, and the deployment `held_out`.
    ///
    /// # Errors
    /// If a time that the study lists is not in the data.
    fn new(
        config: &'a RolloutConfig,
        data: &DataConfig,
        frames: &'a Frames,
        held_out: Option<&Frames>,
    ) -> Result<Self, StepError> {
        let listed = match config.start {
            StartKind::Rows => listed_rows(config, data, frames)?,
            _ => Vec::new(),
        };
        let deployed = held_out.and_then(|held_out| held_out.timestamps().first().copied());
        Ok(Self { config, timestamps: frames.timestamps(), deployed, listed })
    }

    fn month(&self) -> Result<u8, StepError> {
        self.config
            .month
            .or_else(|| self.deployed.map(month_of))
            .context("rollout.start = \"calendar_month\" needs rollout.month, or a held-out period")
    }

    /// Returns the source of the start states. `deployment` has the states of the deployment.
    fn source<'s>(&'s self, deployment: Option<&'s States>) -> Result<StartSource<'s>, StepError> {
        let timestamps = self.timestamps;
        let before = self.deployed;
        Ok(match self.config.start {
            StartKind::Random => StartSource::Random,
            StartKind::Recent => {
                let window = self.config.recent_window;
                StartSource::Recent { timestamps, before, window }
            }
            StartKind::Rows => {
                StartSource::Rows { rows: &self.listed, absent: self.config.absent }
            }
            StartKind::Nearest => StartSource::Nearest {
                states: deployment.context(
                    "rollout.start = \"nearest\" needs a held-out period; set data.held_out, or [deployments]",
                )?,
            },
            StartKind::CalendarMonth => {
                StartSource::CalendarMonth { timestamps, month: self.month()?, before }
            }
        })
    }
}

/// Checks the start states that `config` requests before the model is built from `train`, as far as they follow from
/// the log. Times of listed rows are read on the clock of `data`.
///
/// # Errors
/// If the data has no such row, or no row in the month or before the deployment; if the study asks for start states of
/// a deployment and has none.
pub fn check(
    config: &RolloutConfig,
    data: &DataConfig,
    train: &Frames,
    held_out: Option<&Frames>,
) -> Result<(), StepError> {
    let request = StartRequest::new(config, data, train, held_out)?;
    match request.source(held_out.map(Frames::states))? {
        StartSource::Random | StartSource::Nearest { .. } => Ok(()),
        recorded => {
            let transitions = Transitions::new(train.segments().clone());
            // One start state is enough: a source is checked as a whole, whichever rows are drawn.
            start_rows(train.states(), &transitions, recorded, 1, Seed::new(0))
                .context("[rollout]")?;
            Ok(())
        }
    }
}

/// The start states of the rollouts of a study.
pub struct Starts<'a> {
    request: StartRequest<'a>,
    model: &'a OpenModel,
    seed: Seed,
    /// States of the deployment, in the metric of the model.
    metric: Option<States>,
}

impl<'a> Starts<'a> {
    /// Returns the start states that `config` requests, for the deployment `held_out`. Times of listed rows are read on the
    /// clock of `data`.
    ///
    /// # Errors
    /// If a row that the study lists is not in the data, or states of the deployment cannot be compared with the
    /// model's.
    pub fn new(
        config: &'a RolloutConfig,
        data: &DataConfig,
        model: &'a OpenModel,
        held_out: Option<&Frames>,
        seed: Seed,
    ) -> Result<Self, StepError> {
        let request = StartRequest::new(config, data, &model.frames, held_out)?;
        let metric = match config.start {
            StartKind::Nearest => held_out.map(|held_out| model.in_metric(held_out.states())),
            _ => None,
        };
        Ok(Self { request, model, seed, metric: metric.transpose()? })
    }

    /// Returns `count` start states for each member.
    ///
    /// # Errors
    /// If there are too few, the study asks for those of a deployment and has none, or the monitor of the `search` asks
    /// to stop.
    pub fn of_members(
        &self,
        count: usize,
        search: Search<'_>,
    ) -> Result<Vec<Vec<ModelStart>>, StepError> {
        let source = self.request.source(self.metric.as_ref())?;
        self.model.model.starts(source, count, self.seed, search).context("[rollout]")
    }

    /// Returns the inputs of the start states, given the fingerprint of the deployment's states. `None` if they depend
    /// on the model alone.
    ///
    /// # Errors
    /// If the study asks for a calendar month, and neither names one nor has a held-out period.
    pub fn origin(&self, deployment: Option<&Fingerprint>) -> Result<Option<Origin>, StepError> {
        let StartRequest { config, timestamps, deployed, .. } = self.request;
        Ok(match config.start {
            StartKind::Random | StartKind::Rows => None,
            StartKind::Nearest => Some(Origin::States(deployment.cloned())),
            StartKind::CalendarMonth => {
                Some(Origin::Month { month: self.request.month()?, before: deployed.map(year_of) })
            }
            StartKind::Recent => Some(Origin::Rows(deployed.map_or(timestamps.len(), |before| {
                timestamps.partition_point(|&time| time < before)
            }))),
        })
    }
}

/// Number of an ensemble member's start states that are replaced, and their distances; in the manifest of rollouts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StartSummary {
    /// Number of start states.
    pub starts: usize,
    /// Start states that the ensemble member lacks, because they lie in its left-out block. Its nearest state replaces
    /// each.
    pub replaced: usize,
    /// Mean distance from a requested state to its replacement, in the metric of the model; none if none was replaced.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mean_distance: Option<f64>,
    /// The largest of these distances.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub largest_distance: Option<f64>,
}

/// Returns summaries of all members, from the requested start states and, where they were replaced, the distance of the
/// replacement. States of a deployment are in no member. A member lacks one if another member has a nearer replacement.
pub fn summaries(members: &[Vec<(RequestedStart, Option<f32>)>]) -> Vec<StartSummary> {
    members
        .iter()
        .map(|starts| {
            let lacking =
                starts.iter().enumerate().filter(|&(number, &(wanted, replaced))| match wanted {
                    RequestedStart::Recorded(_) => replaced.is_some(),
                    RequestedStart::Deployment(_) => {
                        replaced.is_some_and(|distance| distance > nearest(members, number))
                    }
                });
            let distances: Vec<f64> =
                starts.iter().filter_map(|(_, replaced)| replaced.map(f64::from)).collect();
            StartSummary {
                starts: starts.len(),
                replaced: lacking.count(),
                mean_distance: (!distances.is_empty())
                    .then(|| distances.iter().sum::<f64>() / distances.len() as f64),
                largest_distance: distances.iter().copied().reduce(f64::max),
            }
        })
        .collect()
}

/// Returns the smallest distance from start state `number` to its replacement in any member.
fn nearest(members: &[Vec<(RequestedStart, Option<f32>)>], number: usize) -> f32 {
    let distances = members.iter().filter_map(|starts| starts.get(number)?.1);
    distances.fold(f32::INFINITY, f32::min)
}

impl StartSummary {
    /// Returns a text for people, or `None` if no start state was replaced.
    pub fn text(&self) -> Option<String> {
        let Self { starts, replaced, mean_distance, largest_distance } = self;
        let (mean, largest) = mean_distance.zip(*largest_distance)?;
        let away = format!("{} away on average, {} at most", number(mean), number(largest));
        Some(match replaced {
            0 => format!(
                "all {starts} start states are the model's nearest to those asked for ({away})"
            ),
            replaced => format!(
                "{replaced} of {starts} start states lie in the block that it leaves out, and the nearest states replace them ({away})"
            ),
        })
    }
}

/// Returns the rows that the study lists, by number or by time.
fn listed_rows(
    config: &RolloutConfig,
    data: &DataConfig,
    frames: &Frames,
) -> Result<Vec<RowIndex>, StepError> {
    let mut rows = config.rows.clone();
    for text in &config.timestamps {
        let moment = Moment::new(text)
            .map_err(|reason| StepError::message(format!("rollout.timestamps: {reason}")))?;
        rows.push(row_at(frames, data.instant(&moment), text)?);
    }
    Ok(rows)
}

/// Returns the row that is nearest in time, if it is within two seconds or two rows.
fn row_at(frames: &Frames, instant: Timestamp, text: &str) -> Result<RowIndex, StepError> {
    let timestamps = frames.timestamps();
    let after = timestamps.partition_point(|&time| time < instant);
    let candidates = [after.checked_sub(1), Some(after).filter(|&row| row < timestamps.len())];
    let nearest = candidates
        .into_iter()
        .flatten()
        .map(|row| (timestamps[row].micros_since(instant).abs(), row))
        .min_by_key(|(distance, _)| *distance);
    let Some((distance, row)) = nearest else {
        bail!("rollout.timestamps: the training range has no rows");
    };
    let neighbour = if row + 1 < timestamps.len() { row + 1 } else { row.saturating_sub(1) };
    let spacing = timestamps[neighbour].micros_since(timestamps[row]).abs();
    if distance > 2 * spacing.max(1_000_000) {
        bail!(
            "rollout.timestamps: no row of the training range is near {text}; \
             the nearest is {:.0} s away",
            distance as f64 / 1e6
        );
    }
    Ok(RowIndex::new(row))
}

#[cfg(test)]
mod tests {
    use calib_core::Segments;

    use super::*;

    fn recorded(replaced: Option<f32>) -> (RequestedStart, Option<f32>) {
        (RequestedStart::Recorded(RowIndex(1)), replaced)
    }

    fn deployed(distance: f32) -> (RequestedStart, Option<f32>) {
        (RequestedStart::Deployment(RowIndex(1)), Some(distance))
    }

    fn told(summary: &StartSummary) -> (usize, Option<f64>, Option<f64>) {
        (summary.replaced, summary.mean_distance, summary.largest_distance)
    }

    /// Returns hourly states from 1970-01-01 on.
    fn hourly(rows: std::ops::Range<i64>) -> Frames {
        let count = rows.end - rows.start;
        let times = rows.map(|hour| Timestamp::from_micros(hour * 3_600_000_000)).collect();
        let states = States::new(vec![0.0; count as usize], count as usize, 1).expect("finite");
        let segments = Segments::from_lengths([count as usize]).expect("valid");
        Frames::new(times, segments, states).expect("valid")
    }

    /// Returns why start states of five hourly rows from 1970-01-01 are refused. Two more rows are held out.
    fn refusal(config: &RolloutConfig) -> Option<String> {
        let (train, held_out) = (hourly(0..5), hourly(5..7));
        let checked = check(config, &DataConfig::default(), &train, Some(&held_out));
        checked.err().map(|reason| reason.to_string())
    }

    fn refusal_of_rows(rows: [u32; 2]) -> Option<String> {
        let rows = rows.map(RowIndex).to_vec();
        refusal(&RolloutConfig { start: StartKind::Rows, rows, ..RolloutConfig::default() })
    }

    fn refusal_of_month(month: u8) -> Option<String> {
        let start = StartKind::CalendarMonth;
        refusal(&RolloutConfig { start, month: Some(month), ..RolloutConfig::default() })
    }

    #[test]
    fn start_states_that_the_log_lacks_are_refused_without_a_model() {
        assert_eq!(refusal_of_rows([0, 4]), None);
        let told = refusal_of_rows([0, 5]).expect("row 5 is held out");
        let expected = "[rollout]: start row 5 does not exist: the data has rows 0 to 4";
        assert_eq!(told, expected);
        let told = refusal_of_month(1).expect("the deployment is in the same year");
        assert!(told.contains("no rows in month 1 of a year before 1970"), "{told}");
        assert!(refusal_of_month(3).expect("no such month").contains("no rows in month 3"));
        for start in [StartKind::Random, StartKind::Nearest, StartKind::Recent] {
            let config = RolloutConfig { start, ..RolloutConfig::default() };
            assert_eq!(refusal(&config), None, "{start:?}");
        }
    }

    #[test]
    fn a_member_lacks_what_others_have() {
        let all = summaries(&[vec![recorded(None), recorded(Some(0.5))], vec![recorded(None); 2]]);
        let first = StartSummary {
            starts: 2,
            replaced: 1,
            mean_distance: Some(0.5),
            largest_distance: Some(0.5),
        };
        assert_eq!(all, [first, StartSummary { starts: 2, ..StartSummary::default() }]);
        assert!(
            first.text().expect("replaced").starts_with("1 of 2 start states lie in the block")
        );
        assert_eq!(all[1].text(), None);
        // States of the deployment are in no member, so the nearest replacement in any member counts.
        let all =
            summaries(&[vec![deployed(0.5), deployed(0.25)], vec![deployed(0.5), deployed(1.0)]]);
        assert_eq!(told(&all[0]), (0, Some(0.375), Some(0.5)));
        assert_eq!(told(&all[1]), (1, Some(0.75), Some(1.0)));
    }
}
