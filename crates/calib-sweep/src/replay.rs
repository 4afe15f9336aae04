use calib_core::{Frames, RowIndex, RowStream};
use calib_files::Fingerprint;

use crate::{Environment, EnvironmentId, FittingRows, RunStream, SweepError, Windows};

/// Recorded rows in time order, across segments but never through a gap.
#[derive(Debug)]
pub struct ReplayEnvironment<'a> {
    id: EnvironmentId,
    frames: &'a Frames,
    windows: Windows,
    runs: usize,
    inputs: Fingerprint,
}

impl<'a> ReplayEnvironment<'a> {
    /// Replays `windows` of the held-out `frames` in `runs` runs (Online), which take the windows in turn. Runs of one
    /// window differ only in the agents' seeds. `inputs` is the fingerprint of the data.
    pub fn online(
        held_out: &'a Frames,
        windows: Windows,
        runs: usize,
        inputs: Fingerprint,
    ) -> Self {
        Self { id: EnvironmentId::Online, frames: held_out, windows, runs, inputs }
    }

    /// Replays each of `windows` of the training `frames` in one run (log replay).
    pub fn log_replay(train: &'a Frames, windows: Windows, inputs: Fingerprint) -> Self {
        let runs = windows.starts.len();
        Self { id: EnvironmentId::LogReplay, frames: train, windows, runs, inputs }
    }

    fn start(&self, run: usize) -> usize {
        self.windows.starts[self.windows.of_run(run)]
    }
}

impl Environment for ReplayEnvironment<'_> {
    fn id(&self) -> EnvironmentId {
        self.id
    }

    fn runs(&self) -> usize {
        if self.windows.starts.is_empty() { 0 } else { self.runs }
    }

    fn inputs(&self, run: usize) -> Fingerprint {
        self.windows.inputs(&self.inputs, run)
    }

    fn fitting_rows(&self, run: usize) -> FittingRows {
        if self.id == EnvironmentId::Online {
            return FittingRows::All;
        }
        let rows = self.frames.rows();
        let start = self.start(run);
        let end = start + self.windows.states;
        // A window that is longer than the rest of the log continues with its first rows.
        let wrapped = 0..end.saturating_sub(rows).min(start);
        let replayed = [start..end.min(rows), wrapped];
        FittingRows::AllBut(replayed.into_iter().filter(|range| !range.is_empty()).collect())
    }

    fn stream(&self, run: usize) -> Result<RunStream, SweepError> {
        if self.windows.states < 2 {
            return Err(SweepError::TooShort { steps: self.windows.states.saturating_sub(1) });
        }
        let start = self.start(run);
        let states = self.frames.states().clone();
        let segments = self.frames.segments();
        let stream = RowStream::looped(states, segments, start, self.windows.states);
        Ok(RunStream::complete(stream, RowIndex::new(start)))
    }
}
