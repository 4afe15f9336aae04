use calib_agent::{Keeper, RunState, StateFile};
use calib_files::Fingerprinter;

use crate::{UnitStore, plan::Job};

/// Work between two states of a long run that are kept: about a minute of one core, some megabytes.
///
/// In multiplications, as [`calib_agent::Keeper`] counts them.
pub const WORK_BETWEEN: u64 = 5_000_000_000_000;

/// The state of one unfinished pass, in a file beside the finished units.
pub(crate) struct KeptRun {
    file: StateFile,
    work_between: u64,
}

impl KeptRun {
    /// Where the pass of these jobs keeps its state.
    pub(crate) fn new(store: &UnitStore, jobs: &[&Job<'_>], work_between: u64) -> Self {
        let mut key = Fingerprinter::default();
        for job in jobs {
            key.add(job.key.as_bytes());
        }
        let path = store.unfinished(&jobs[0].unit);
        Self { file: StateFile::new(path, key.finish().to_string()), work_between }
    }

    /// The pass is finished.
    pub(crate) fn forget(&self) {
        self.file.remove();
    }
}

impl Keeper for KeptRun {
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
