use calib_agent::{Checkpointer, RunState, StateFile};
use calib_files::Fingerprinter;

use crate::{UnitSink, plan::UnitJob, store::environment_name};

/// Work between two states of a long run that are kept: about a minute of one core, some megabytes.
///
/// In multiplications, as [`calib_agent::Checkpointer`] counts them.
pub const WORK_BETWEEN: u64 = 5_000_000_000_000;

/// The state of one unfinished pass, in a file beside the finished units.
pub(crate) struct RunCheckpoint {
    file: StateFile,
    work_between: u64,
}

impl RunCheckpoint {
    /// Where the pass of these jobs keeps its state. The name tells passes of other sensors, settings and inputs apart, which
    /// may run beside it.
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

    /// The pass is finished.
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
