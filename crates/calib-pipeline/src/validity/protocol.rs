//! The protocol that the command line names.

use std::path::{Path, PathBuf};

use calib_base::{Context as _, StepError, bail, ensure, options::ValidityOptions};
use calib_study::{DrawnStudy, Protocol, study_files};

use crate::run_study::RunUntil;

/// A protocol, its file, and the folder for its results.
pub(super) struct ProtocolFile {
    pub(super) file: PathBuf,
    protocol: Protocol,
    /// The folder of this draw.
    pub(super) directory: PathBuf,
}

impl ProtocolFile {
    /// Finds the protocol among the arguments: a file, or the protocol in a folder. In a folder, the other files are
    /// the studies to draw from.
    pub(super) fn find(args: &ValidityOptions) -> Result<Option<Self>, StepError> {
        let mut found = Vec::new();
        for argument in &args.studies {
            for path in files(argument)? {
                if let Some(protocol) = Protocol::find(&path)? {
                    found.push((path, protocol));
                }
            }
        }
        if found.len() > 1 || (found.len() == 1 && args.studies.len() > 1) {
            let names: Vec<String> =
                found.iter().map(|(path, _)| path.display().to_string()).collect();
            bail!(
                "{} is a protocol, which draws its own studies: name nothing beside it (a protocol is a file with [validity])",
                names.join(" and ")
            );
        }
        let Some((file, mut protocol)) = found.pop() else {
            ensure!(args.draw.is_none(), "--draw is for protocols, and none is named");
            return Ok(None);
        };
        protocol.seed = args.draw.unwrap_or(protocol.seed);
        let results = args
            .output
            .clone()
            .unwrap_or_else(|| file.parent().unwrap_or(Path::new("")).join("validity-results"));
        let directory = results.join(format!("draw-{}", protocol.seed));
        Ok(Some(Self { file, protocol, directory }))
    }

    /// Returns the folder of the drawn studies.
    pub(super) fn studies(&self) -> PathBuf {
        self.directory.join("studies")
    }

    /// Returns the seed of the draw.
    pub(super) fn seed(&self) -> u64 {
        self.protocol.seed
    }

    /// Returns the smallest number of windows that a plant is judged by.
    pub(super) fn least_windows(&self) -> usize {
        self.protocol.least_windows
    }

    /// Returns how far each study is run.
    pub(super) fn extent(&self) -> RunUntil {
        if self.protocol.rollouts { RunUntil::Report } else { RunUntil::Choice }
    }

    /// Draws all studies, and applies `overrides`.
    pub(super) fn draw(&self, overrides: &[String]) -> Result<Vec<DrawnStudy>, StepError> {
        Ok(self.protocol.draw(&self.file, &self.studies(), overrides)?)
    }
}

/// Returns the file, or all `*.toml` files of a folder.
pub(super) fn files(path: &Path) -> Result<Vec<PathBuf>, StepError> {
    if !path.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    let files = study_files(path).with_context(|| format!("cannot read {}", path.display()))?;
    ensure!(!files.is_empty(), "{} has no study (*.toml)", path.display());
    Ok(files)
}
