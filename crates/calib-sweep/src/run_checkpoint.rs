use calib_agent::{Checkpointer, RunState, StateFile};
use calib_files::Fingerprinter;

use crate::{UnitSink, plan::UnitJob, store::environment_name};

/// Work between two saved states of a long run, in multiplications as [`calib_agent::Checkpointer`] counts them. It is
/// about a minute of one core. A state has some megabytes.
pub const WORK_BETWEEN: u64 = 5_000_000_000_000;

/// The saved state of one unfinished pass, in a file beside the finished units.
pub(crate) struct RunCheckpoint {
    file: StateFile,
    work_between: u64,
}

impl RunCheckpoint {
    /// Creates the checkpoint of the pass that trains these jobs. Passes of other sensors, settings and inputs may run
    /// at the same time, so the file name depends on all of these.
    pub(crate) fn new(sink: &dyn UnitSink, jobs: &[&UnitJob<'_>], work_between: u64) -> Self {
        let mut key = Fingerprinter::default();
        for job in jobs {
            key.add(job.key.as_bytes());
            for setting in &job.settings {
                key.add(setting.as_bytes());
            }
        }
        let key = key.finish();
        let unit = &jobs[0].unit;
        let name =
            format!("{}-run-{:04}-{}.safetensors", environment_name(unit), unit.run, key.short());
        Self { file: StateFile::new(sink.state(&name), key.to_string()), work_between }
    }

    /// Removes the state of a finished pass.
    pub(crate) fn forget(&self) {
        self.file.remove();
    }
}

impl Checkpointer for RunCheckpoint {
    fn work_between(&self) -> u64 {
        self.work_between
    }

    fn load(&self) -> Option<RunState> {
        self.file.read().map(|(progress, values)| RunState { progress, values })
    }

    fn keep(&self, state: RunState) -> Result<(), String> {
        self.file.write(&state.progress, state.values).map_err(|error| error.to_string())
    }
}
