//! Start states as a study asks for them.

use anyhow::{Context as _, bail};
use calib_core::{Frames, RowIndex, Seed, States, Timestamp, Transitions};
use calib_data::Moment;
use calib_knn::Member;
use calib_rollout::{
    RolloutConfig, StartKind, StartRow, StartSource, StartState, month_of, start_states,
};

use super::model_files::OpenModel;
use crate::study::Study;

/// Whether start states depend on the held-out range.
pub(super) fn starts_from_held_out(study: &Study) -> bool {
    matches!(study.rollout.start, StartKind::Nearest | StartKind::CalendarMonth)
}

/// `count` start states for `member`.
pub(super) fn starts(
    member: &Member<'_>,
    config: &RolloutConfig,
    model: &OpenModel,
    held_out: Option<&Frames>,
    count: usize,
    seed: Seed,
) -> anyhow::Result<Vec<StartState>> {
    let seed = seed.child("member").number(member.number() as u64);
    let given = Given::new(config, model, held_out)?;
    start_states(member, given.source(config, model, held_out)?, count, seed).context("[rollout]")
}

/// `count` start rows for a network.
pub(super) fn start_rows(
    config: &RolloutConfig,
    model: &OpenModel,
    held_out: Option<&Frames>,
    count: usize,
    seed: Seed,
) -> anyhow::Result<Vec<StartRow>> {
    let seed = seed.child("member").number(0);
    let given = Given::new(config, model, held_out)?;
    let source = given.source(config, model, held_out)?;
    let transitions = Transitions::new(model.frames.segments().clone());
    calib_rollout::start_rows(model.frames.states(), &transitions, source, count, seed)
        .context("[rollout]")
}

/// What a source of start states refers to.
struct Given {
    /// Rows that the study lists.
    listed: Vec<RowIndex>,
    /// States of the deployment, as the model compares them.
    metric: Option<States>,
}

impl Given {
    fn new(
        config: &RolloutConfig,
        model: &OpenModel,
        held_out: Option<&Frames>,
    ) -> anyhow::Result<Self> {
        let listed = match config.start {
            StartKind::Rows => listed_rows(config, &model.frames)?,
            _ => Vec::new(),
        };
        let metric = match config.start {
            StartKind::Nearest => held_out.map(|held_out| model.in_metric(held_out.states())),
            _ => None,
        };
        Ok(Self { listed, metric: metric.transpose()? })
    }

    fn source<'a>(
        &'a self,
        config: &RolloutConfig,
        model: &'a OpenModel,
        held_out: Option<&Frames>,
    ) -> anyhow::Result<StartSource<'a>> {
        let Self { listed, metric } = self;
        let frames = &model.frames;
        Ok(match config.start {
            StartKind::Random => StartSource::Random,
            StartKind::Recent => StartSource::Recent,
            StartKind::Rows => StartSource::Rows { rows: listed, absent: config.absent },
            StartKind::Nearest => StartSource::Nearest {
                states: metric.as_ref().context(
                    "rollout.start = \"nearest\" wants a held-out range; set data.held_out",
                )?,
            },
            StartKind::CalendarMonth => {
                let deployment =
                    held_out.and_then(|held_out| held_out.timestamps().first().copied());
                let month = config.month.or_else(|| deployment.map(month_of)).context(
                    "rollout.start = \"calendar_month\" wants rollout.month, or a held-out range",
                )?;
                StartSource::CalendarMonth {
                    timestamps: frames.timestamps(),
                    month,
                    before: deployment,
                }
            }
        })
    }
}

/// The rows that the study lists, by number or by time.
fn listed_rows(config: &RolloutConfig, frames: &Frames) -> anyhow::Result<Vec<RowIndex>> {
    let mut rows = config.rows.clone();
    for text in &config.timestamps {
        let moment =
            Moment::new(text).map_err(|reason| anyhow::anyhow!("rollout.timestamps: {reason}"))?;
        rows.push(row_at(frames, moment.instant(), text)?);
    }
    Ok(rows)
}

/// The row that is nearest in time, if it lies within two seconds or two rows.
fn row_at(frames: &Frames, instant: Timestamp, text: &str) -> anyhow::Result<RowIndex> {
    let timestamps = frames.timestamps();
    let after = timestamps.partition_point(|&time| time < instant);
    let candidates = [after.checked_sub(1), Some(after).filter(|&row| row < timestamps.len())];
    let distance = |row: usize| timestamps[row].micros_since(instant).abs();
    let Some(row) = candidates.into_iter().flatten().min_by_key(|&row| distance(row)) else {
        bail!("rollout.timestamps: the training range has no rows");
    };
    let neighbour = if row + 1 < timestamps.len() { row + 1 } else { row.saturating_sub(1) };
    let spacing = timestamps[neighbour].micros_since(timestamps[row]).abs();
    if distance(row) > 2 * spacing.max(1_000_000) {
        bail!(
            "rollout.timestamps: no row of the training range is near {text}; \
             the nearest is {:.0} s away",
            distance(row) as f64 / 1e6
        );
    }
    Ok(RowIndex::new(row))
}
