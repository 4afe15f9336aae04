//! `control/`: the verdict about agents that act, and its runs.

use std::path::Path;

use calib_base::{
    Context as _, StepError,
    artefact::{self, Artefact, Below, DirectoryLock, Facts, Files, MANIFEST, TOOL},
    bail, ensure,
    log::{plant_of_study::data_of, sources::Sources},
    output::Printer,
    stale::StoredArtefact,
};
use calib_control::{Distance, Run};
use calib_data::table::Table;
use calib_files::{FileError, Fingerprint, read_sealed_json, write_sealed_json};
use calib_study::{Job, StepKind, Study};
use serde::{Deserialize, Serialize};

use super::{
    agents::{ComparedAgents, ProgramIdentity},
    evaluation::ControlEvaluation,
    section::no_section,
};

pub(super) use calib_base::artefact::CONTROL_VERDICT as VERDICT;
pub(super) const RUNS: &str = "runs.parquet";

/// `manifest.json` of the verdict.
type ControlManifest = Artefact<ControlFacts>;

/// The inputs of the verdict, and the files that show it.
#[derive(Serialize, Deserialize)]
struct ControlFacts {
    /// Fingerprint of the inputs.
    key: String,
    study: Study,
    /// Fingerprint of the log.
    log: Fingerprint,
    /// The report and its figures, which follow from the other files.
    shown: Files,
}

impl Facts for ControlFacts {
    const FORMAT: u32 = 16;
    const STEP: StepKind = StepKind::Control;

    fn key(&self) -> &str {
        &self.key
    }

    /// Other held-out periods change the verdict. The inputs in the key, and the runs, stay the same.
    fn lasts(name: &str) -> bool {
        name != VERDICT
    }

    fn has_all_parts(&self, directory: &Path) -> bool {
        let verdict = read_sealed_json::<VerdictKey>(&directory.join(VERDICT));
        verdict.is_ok_and(|verdict| verdict.key == self.key)
    }
}

/// The key in `verdict.json`. It says to which runs the verdict belongs, also if a killed command has replaced the
/// verdict and not yet the manifest.
#[derive(Deserialize)]
struct VerdictKey {
    key: String,
}

/// `verdict.json` with its key.
#[derive(Serialize)]
struct StoredVerdict<'a> {
    key: &'a str,
    #[serde(flatten)]
    evaluation: &'a ControlEvaluation,
}

impl ControlEvaluation {
    /// Reads the results of `calib control` for a study with calib's own agents.
    ///
    /// # Errors
    /// Returns an error if it was not run, or for another study. Also fails if its results were damaged, or the agents
    /// belong to a program.
    pub fn of_job(job: &Job) -> Result<Self, StepError> {
        let directory = job.layout().control();
        let command = job.command(StepKind::Control);
        let Some(config) = &job.study().control else { return Err(no_section(job)) };
        if let ComparedAgents::Program { .. } = ComparedAgents::of_study(job, config)? {
            bail!("the agents of this study are those of a program, and not calib's own");
        }
        let manifest: ControlManifest = artefact::require(&directory, &command)?;
        artefact::check_files(&directory, &manifest.files, &command)?;
        ensure!(
            manifest.key == key(job.study(), &manifest.log, None)?,
            "{} follows from other values than the study has now, such as those of --set: open the study with the same \
             (Study(…, set=…)), or run `{command}` first",
            directory.display()
        );
        Ok(read_sealed_json(&directory.join(VERDICT))?)
    }
}

/// Returns the fingerprint of a verdict's inputs.
pub(super) fn key(
    study: &Study,
    log: &Fingerprint,
    program: Option<ProgramIdentity<'_>>,
) -> Result<String, StepError> {
    let resamples = study.evaluate.resamples;
    let control = study.control.as_ref();
    let represented = control
        .filter(|control| control.model.distance == Distance::Laplacian)
        .map(|_| study.representation.candidates());
    let model = (&study.control, represented);
    let own = (ControlFacts::FORMAT, TOOL, log, model, study.seed, resamples);
    // The study describes calib's own agents completely.
    match program {
        None => artefact::key(&own),
        Some(program) => artefact::key(&(own, program)),
    }
}

/// A stored verdict that has the same inputs and is intact. Its held-out periods may be others.
pub(super) struct KeptVerdict {
    pub(super) evaluation: ControlEvaluation,
    /// Whether the verdict and its report are those that the manifest names.
    pub(super) is_listed: bool,
    /// Whether the study and the log files are unchanged too, and so the held-out periods.
    pub(super) is_current: bool,
}

impl KeptVerdict {
    /// Returns the verdict with this key, if there is one that the job need not make again. `sources` are the log files
    /// as they are now. Warns if there is one, and a file of it is damaged.
    pub(super) fn to_use(
        job: &Job,
        key: &str,
        sources: &Sources,
        printer: &Printer,
    ) -> Option<Self> {
        if job.policy().redoes() {
            return None;
        }
        let directory = &job.layout().control();
        let found = Self::find(directory, key, job.study(), sources);
        if found.is_none()
            && let Some(damage) = damage(directory, key)
        {
            printer.warn(&format!("{damage}; its runs have to be made again"));
        }
        found
    }

    /// Reads the verdict with this key, if there is one and no setting failed.
    fn find(directory: &Path, key: &str, study: &Study, sources: &Sources) -> Option<Self> {
        let manifest = ControlManifest::find(directory, key)?;
        let evaluation: ControlEvaluation = read_sealed_json(&directory.join(VERDICT)).ok()?;
        if evaluation.lacks_settings() {
            return None;
        }
        let is_listed = [&manifest.files, &manifest.shown]
            .into_iter()
            .all(|files| artefact::are_whole(directory, files));
        let noted = Sources::noted_in(directory);
        let is_current = is_listed
            && study.differences(StepKind::Control, &manifest.study).is_empty()
            && noted.is_some_and(|noted| sources.are_unchanged_since(&noted));
        Some(Self { evaluation, is_listed, is_current })
    }
}

/// Returns the damage of the verdict with this key, if there is any: a file that is not as it was written. A missing
/// file counts as no damage.
fn damage(directory: &Path, key: &str) -> Option<FileError> {
    let damage_of_json = |name: &str| {
        let read = read_sealed_json::<serde_json::Value>(&directory.join(name));
        read.err().filter(FileError::is_of_content)
    };
    // A damaged manifest does not say what the verdict belongs to.
    if let Some(damage) = damage_of_json(MANIFEST) {
        return Some(damage);
    }
    let manifest: ControlManifest = artefact::read(directory)?;
    if manifest.key != key {
        return None;
    }
    if let Some(damage) = damage_of_json(VERDICT) {
        return Some(damage);
    }
    for (name, written) in manifest.lasting_files() {
        let path = directory.join(name);
        if artefact::fingerprint_once(&path).is_ok_and(|found| found != written) {
            return Some(FileError::Damaged { path, reason: "it is not what was written" });
        }
    }
    None
}

/// Updates the stored study and log files of a verdict that also follows from the current ones, held-out periods
/// included. This happens for example if another `data.shape` reads the same log.
pub(super) fn note_study(
    directory: &Path,
    study: &Study,
    sources: &Sources,
    printer: &Printer,
) -> Result<(), StepError> {
    note_sources(directory, sources, printer)?;
    let Some(mut manifest) = artefact::read::<ControlManifest>(directory) else { return Ok(()) };
    if study.differences(StepKind::Control, &manifest.study).is_empty() {
        return Ok(());
    }
    manifest.study = study.clone();
    let written =
        DirectoryLock::new(directory, Below::Ours).and_then(|claim| claim.complete(&manifest));
    artefact::or_read_only(written, directory, printer)
}

/// Records the log files of a verdict, by which `calib status` detects changes.
pub(super) fn note_sources(
    directory: &Path,
    sources: &Sources,
    printer: &Printer,
) -> Result<(), StepError> {
    if Sources::noted_in(directory).as_ref() == Some(sources) {
        return Ok(());
    }
    let claim = DirectoryLock::try_new(directory, Below::Ours);
    let written = claim.and_then(|claim| match claim {
        Some(_claim) => sources.note_in(directory),
        // Another command is writing there, and records the files that it read.
        None => Ok(()),
    });
    artefact::or_read_only(written, directory, printer)
}

/// The state of the stored verdict, compared with the current study.
pub(crate) enum VerdictStanding {
    /// There is no verdict, or it is damaged.
    Missing,
    /// The verdict is up to date.
    Current,
    /// It belongs to another study or log. The text says what differs, and what to run.
    Stale(String),
}

impl VerdictStanding {
    /// Compares the verdict of a job with its study, and the log files with their recorded state. The log is not read.
    /// `calib control` finds out whether its content is the same.
    ///
    /// # Errors
    /// Returns an error if a file of the study's program cannot be read, or the settings are invalid.
    pub(crate) fn of(job: &Job) -> Result<Self, StepError> {
        let Some(config) = &job.study().control else { return Ok(Self::Missing) };
        let directory = &job.layout().control();
        let manifest = artefact::read::<ControlManifest>(directory);
        let Some(manifest) = manifest.filter(|manifest| manifest.is_whole(directory)) else {
            return Ok(Self::Missing);
        };
        let made = StoredArtefact { step: StepKind::Control, study: &manifest.study, directory };
        if let Some(reason) = made.stale_reason(job) {
            return Ok(Self::Stale(reason));
        }
        let agents = ComparedAgents::of_study(job, config)?;
        if manifest.key == key(job.study(), &manifest.log, agents.program_identity())? {
            return Ok(log_change(job, directory).map_or(Self::Current, Self::Stale));
        }
        let other = match agents {
            _ if manifest.tool != TOOL => manifest.tool.as_str(),
            ComparedAgents::Program { .. } => "another program",
            // For example one that was built from other sources.
            ComparedAgents::Own(_) => "another calib",
        };
        Ok(Self::Stale(format!(
            "the verdict in {} was made with {other}; run `{}` again",
            directory.display(),
            job.command(StepKind::Control)
        )))
    }
}

/// Returns a message if the log files of the verdict in `directory` changed in size or time. `None` for verdicts of
/// earlier versions, which have no record, and if the log is not available.
fn log_change(job: &Job, directory: &Path) -> Option<String> {
    let noted = Sources::noted_in(directory)?;
    let now = data_of(job).and_then(|data| Sources::of(&data)).ok()?;
    now.differ_from(&noted).then(|| {
        format!(
            "the log has changed since the verdict in {} was made, by the size or the time of its files; run `{}` again",
            directory.display(),
            job.command(StepKind::Control)
        )
    })
}

/// Writes the verdict, the runs, and the files that `show` writes. Damaged files of `show` are written again.
pub(super) fn write(
    directory: &Path,
    study: &Study,
    key: String,
    log: &Fingerprint,
    evaluation: &ControlEvaluation,
    runs: &[Run],
    show: impl FnOnce() -> Result<Vec<String>, StepError>,
) -> Result<(), StepError> {
    let claim = DirectoryLock::begun(directory)?;
    artefact::write_table(table(runs, evaluation), &directory.join(RUNS))?;
    write_verdict(directory, &key, evaluation)?;
    let shown = show()?;
    let shown = artefact::fingerprints(directory, shown.iter().map(String::as_str))?;
    let facts = ControlFacts { key, study: study.clone(), log: log.clone(), shown };
    claim.finish(facts, [RUNS, VERDICT]).map(drop)
}

fn write_verdict(
    directory: &Path,
    key: &str,
    evaluation: &ControlEvaluation,
) -> Result<(), StepError> {
    Ok(write_sealed_json(&directory.join(VERDICT), &StoredVerdict { key, evaluation })?)
}

/// Replaces a verdict by the same one on other held-out periods, and writes the files that `show` writes. The runs
/// stay. If this is interrupted, the verdict is still valid, the old one or the new one, and the manifest does not name
/// what was written. The next command then calls this again.
pub(super) fn replace(
    directory: &Path,
    study: &Study,
    evaluation: &ControlEvaluation,
    show: impl FnOnce() -> Result<Vec<String>, StepError>,
) -> Result<(), StepError> {
    let claim = DirectoryLock::new(directory, Below::Ours)?;
    let manifest: ControlManifest = artefact::read(directory)
        .with_context(|| format!("{} has no verdict to replace", directory.display()))?;
    let shown = show()?;
    write_verdict(directory, &manifest.key, evaluation)?;
    let shown = artefact::fingerprints(directory, shown.iter().map(String::as_str))?;
    let facts = ControlFacts { shown, study: study.clone(), ..manifest.facts };
    claim.finish(facts, [RUNS, VERDICT]).map(drop)
}

/// Returns a table with one row per run and all estimates of each setting, so that other selection rules can be tried
/// on it.
fn table(runs: &[Run], evaluation: &ControlEvaluation) -> Table {
    Table::new()
        .with("model", runs.iter().map(|run| run.kind.name().to_owned()).collect::<Vec<_>>())
        .with("member", counts(runs, |run| run.member as u64))
        .with("run", counts(runs, |run| run.run as u64))
        .with("candidate", counts(runs, |run| run.candidate as u64))
        .with(
            "label",
            runs.iter().map(|run| evaluation.setting_name(run.candidate)).collect::<Vec<String>>(),
        )
        .with("mean_return", runs.iter().map(|run| run.mean_return).collect::<Vec<f64>>())
        .with("episodes", counts(runs, |run| run.episodes as u64))
        .with("terminals", counts(runs, |run| run.terminals as u64))
        .with("steps", counts(runs, |run| run.coverage.steps))
        .with("missing", counts(runs, |run| run.coverage.missing))
        .with("far", counts(runs, |run| run.coverage.far))
}

fn counts(runs: &[Run], value: fn(&Run) -> u64) -> Vec<i64> {
    runs.iter().map(|run| i64::try_from(value(run)).unwrap_or(i64::MAX)).collect()
}
