//! The part of a profile that describes rows, not channels.

use calib_core::Timestamp;

use crate::{
    ContradictionsFound, Duplicates, Gaps, PartProfile, Profile,
    log::{EXAMPLES, Log},
};

/// Returns the profile of the rows; its parts about channels and ranges are empty.
pub(crate) fn describe_rows(log: &Log, conflicting: u64) -> Profile {
    let rows = &log.rows;
    let merged_rows = log.merged_rows();
    let recorded = log.recorded();
    let irregular = &recorded.irregularities;
    let mut times: Vec<Timestamp> = recorded
        .duplicates
        .iter()
        .map(|duplicate| recorded.timestamps[duplicate.row as usize])
        .collect();
    times.sort_unstable();
    times.dedup();
    times.truncate(EXAMPLES);
    let start = rows.timestamps[0];
    let end = rows.timestamps[rows.timestamps.len() - 1];
    Profile {
        shape: log.shape,
        utc: log.utc,
        bad_quality: log.bad_quality,
        bad_rows: log.bad_rows.clone(),
        without_times: log.without_times,
        read_as: log.read_as.clone(),
        sentinels: Vec::new(),
        contradictions: ContradictionsFound::default(),
        files: log.files.len(),
        bytes: log.files.iter().map(|file| file.bytes).sum(),
        file_rows: log.files.iter().map(|file| file.rows as u64).sum(),
        rows: rows.timestamps.len() as u64,
        resampled: log.is_resampled(),
        rows_outside: irregular.outside,
        start,
        end,
        period_secs: log.period.as_secs(),
        period_was_detected: log.period_was_detected,
        recorded_period_secs: log.recorded_period_secs(),
        sampled_period_secs: log.period.as_secs(),
        null_timestamps: irregular.null_timestamps,
        undecided_times: log.undecided,
        duplicates: Duplicates {
            identical: (recorded.duplicates.len() as u64 - conflicting).saturating_sub(merged_rows),
            conflicting,
            examples: times,
        },
        merged_rows,
        backward_steps: log.backward_steps(),
        overlapping_files: irregular.overlaps.len() as u64,
        short_steps: log.steps.short,
        gaps: Gaps {
            count: log.steps.gaps,
            longest_secs: log.steps.longest_gap as f64 / 1e6,
            total_secs: log.steps.total_gap as f64 / 1e6,
            examples: log.steps.longest_gaps.clone(),
        },
        channels: Vec::new(),
        unused_excludes: Vec::new(),
        columns: 0,
        train: PartProfile::empty(start),
        held_out: None,
        unseen_modes: 0,
        state_bytes: 0,
    }
}
