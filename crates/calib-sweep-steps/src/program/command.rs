use std::{
    path::{Path, PathBuf, absolute},
    time::Duration,
};

use calib_agent::AgentConfig;
use calib_base::{Context as _, StepError};
use calib_files::{Fingerprint, Fingerprinter, fingerprint_file};
use calib_study::Job;
use calib_sweep::ProgramStopped;

use super::error::{ProgramError, failed};

/// The program of a study: `agent.command`.
#[derive(Debug)]
pub struct ProgramCommand {
    pub(super) words: Vec<String>,
    /// The working directory of the program: the folder of the study.
    pub(super) folder: PathBuf,
    /// Time limit for an answer.
    pub(super) timeout: Duration,
    pub(super) fingerprint: Fingerprint,
}

impl ProgramCommand {
    /// Returns the program of a study, if its agents belong to a program.
    ///
    /// # Errors
    /// Returns an error if a file that the command names cannot be read.
    pub fn of_study(job: &Job) -> Result<Option<Self>, StepError> {
        let AgentConfig { command, timeout_secs, .. } = &job.study().agent;
        if !job.study().agent.is_external() {
            return Ok(None);
        }
        let folder = job.layout().study().parent().unwrap_or(Path::new(""));
        let folder = absolute(folder.join("."))
            .with_context(|| format!("the folder of {}", job.layout().study().display()))?;
        Ok(Some(Self {
            words: command.clone(),
            fingerprint: fingerprint(command, &folder)?,
            folder,
            timeout: Duration::from_secs_f64(*timeout_secs),
        }))
    }

    /// Returns the fingerprint of the command and of each file that it names.
    pub fn fingerprint(&self) -> &Fingerprint {
        &self.fingerprint
    }

    /// Returns the command as one would type it.
    pub fn shown(&self) -> String {
        calib_study::shell_words(self.words.iter().cloned())
    }

    /// Checks that the files have not changed since the fingerprint. Results of several processes must come from the
    /// same program.
    ///
    /// # Errors
    /// Returns an error if a file was changed since, or is missing.
    pub fn check_unchanged(&self) -> Result<(), ProgramStopped> {
        let is_same =
            fingerprint(&self.words, &self.folder).is_ok_and(|now| now == self.fingerprint);
        if is_same { Ok(()) } else { Err(failed(ProgramError::Changed { command: self.shown() })) }
    }
}

/// Whether the first word of a command is a path. Otherwise the system looks the name up.
pub(super) fn is_path(program: &str) -> bool {
    Path::new(program).components().count() > 1
}

/// Returns the fingerprint of a command and of each file that it names.
pub(super) fn fingerprint(command: &[String], folder: &Path) -> Result<Fingerprint, StepError> {
    let mut all = Fingerprinter::default();
    for (place, word) in command.iter().enumerate() {
        all.add(word.as_bytes());
        let path = folder.join(word);
        if (place > 0 || is_path(word)) && path.is_file() {
            all.add(fingerprint_file(&path)?.as_str().as_bytes());
        }
    }
    Ok(all.finish())
}
