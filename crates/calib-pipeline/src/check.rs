//! Checks stored results for damage, without their study.

use std::{
    collections::HashSet,
    fs, mem,
    path::{Path, PathBuf},
};

use calib_base::{
    Context as _, StepError,
    artefact::{self, Files, MANIFEST},
    ensure, memory,
    options::Logs,
    output::Printer,
};
use calib_control::NetworkFiles;
use calib_core::Monitor as _;
use calib_data::{DataConfig, PreprocessConfig, table::read_parquet};
use calib_files::{fingerprint_file, is_temporary, read_sealed_json, read_sealed_tensors};
use calib_study::{Request, StepKind, with_variables};
use calib_sweep_steps::sweep::SweepManifest;
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value;

use crate::status::study_unless_folder;

/// Result of checking a folder of results.
#[derive(Debug, Default, Serialize, JsonSchema)]
pub struct CheckedResults {
    /// The folder that was checked.
    #[serde(skip)]
    pub root: PathBuf,
    /// Number of files that were compared with their fingerprints.
    pub files: usize,
    /// Folders without a manifest: the command that writes them was interrupted or is still running.
    pub unfinished: Vec<PathBuf>,
    /// Files that are missing or differ from what was written.
    pub damages: Vec<Damage>,
    /// Logs that were read again, with `--read-data`.
    pub logs: Vec<String>,
    /// Logs that `--read-data` could not read.
    pub unreadable_logs: Vec<UnreadableLog>,
}

impl CheckedResults {
    /// Whether all files are as they were written, and all logs could be read.
    pub fn is_whole(&self) -> bool {
        self.damages.is_empty() && self.unreadable_logs.is_empty()
    }
}

/// A log that cannot be read.
#[derive(Debug, Serialize, JsonSchema)]
pub struct UnreadableLog {
    /// `data.path` of the study.
    pub path: String,
    /// The reason.
    pub reason: String,
}

/// A file that is missing or differs from what was written.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Damage {
    /// Path of the file.
    pub path: PathBuf,
    /// The damage.
    pub reason: String,
    /// The command that makes the file again.
    pub made_by: String,
}

/// Reads all results of a study, or everything below a folder of results, and lists damaged files.
pub(crate) fn run(path: &Path, logs: Logs, printer: &Printer) -> Result<CheckedResults, StepError> {
    let root = match study_unless_folder(Request::new(path))? {
        Some(job) => job.layout().root().to_owned(),
        None => path.to_owned(),
    };
    ensure!(
        root.is_dir(),
        "{} has no results in {}; run it first, or give the folder of its results if it was run with --output",
        path.display(),
        root.display()
    );
    let checked = CheckedResults { root: root.clone(), ..CheckedResults::default() };
    let mut check = Check { checked, counted: HashSet::new(), read: Vec::new(), printer };
    check.folder(&root)?;
    ensure!(
        check.checked.files > 0,
        "{} holds no results of calib; give the folder that a study writes to, such as study-results",
        root.display()
    );
    if logs == Logs::Read {
        check.logs(&root);
    }
    Ok(check.checked)
}

fn unread(folder: &Path) -> String {
    format!("cannot read {}", folder.display())
}

struct Check<'a> {
    checked: CheckedResults,
    /// The files counted so far. A manifest may name a file that also has its own checksum.
    counted: HashSet<PathBuf>,
    /// The logs that manifests name, in the order of their folders.
    read: Vec<(DataConfig, PreprocessConfig)>,
    printer: &'a Printer,
}

impl Check<'_> {
    fn folder(&mut self, folder: &Path) -> Result<(), StepError> {
        self.printer.progress().check()?;
        let mut entries = fs::read_dir(folder)
            .and_then(Iterator::collect::<Result<Vec<_>, _>>)
            .with_context(|| unread(folder))?;
        entries.sort_by_key(fs::DirEntry::file_name);
        if folder.join(MANIFEST).exists() {
            self.manifest(folder);
        } else if made_by(folder).is_some_and(|made| made.needs_manifest) {
            self.checked.unfinished.push(folder.to_owned());
        }
        for entry in entries {
            let path = entry.path();
            let kind = entry.file_type().with_context(|| unread(folder))?;
            // Targets of links do not belong to the results.
            if kind.is_dir() {
                self.folder(&path)?;
            } else if kind.is_file() && !is_temporary(&path) {
                self.file(folder, &path);
            }
        }
        Ok(())
    }

    /// Checks a manifest and the files that it names.
    fn manifest(&mut self, folder: &Path) {
        let path = folder.join(MANIFEST);
        let manifest = match read_sealed_json::<Value>(&path) {
            Ok(manifest) => manifest,
            Err(error) => {
                return self.note(folder, &path, Some(StepError::from(error).to_string()));
            }
        };
        self.note(folder, &path, None);
        let study = &manifest["study"];
        let data = serde_json::from_value::<DataConfig>(study["data"].clone());
        let preprocess = serde_json::from_value(study["preprocess"].clone());
        if let (Ok(data), Ok(preprocess)) = (data, preprocess)
            && !self.read.iter().any(|(known, _)| known.path == data.path)
        {
            self.read.push((data, preprocess));
        }
        let agents = manifest["agents"].as_array().into_iter().flatten();
        for holder in [&manifest].into_iter().chain(agents) {
            // The files that show a verdict follow from it, and have their own list.
            let lists = ["files", "shown"].map(|list| holder[list].clone());
            let lists = lists.into_iter().filter_map(|list| serde_json::from_value(list).ok());
            for (name, written) in lists.flat_map(|list: Files| list) {
                let path = beside_or_in(folder, &name);
                let damage = match fingerprint_file(&path) {
                    Ok(found) if found == written => None,
                    Ok(_) => Some("it is not what was written".to_owned()),
                    Err(_) if !path.exists() => Some("it is missing".to_owned()),
                    Err(error) => Some(StepError::from(error).to_string()),
                };
                self.note(folder, &path, damage);
            }
        }
        if let Some(swept) = artefact::read::<SweepManifest>(folder) {
            for path in swept.missing_runs(folder) {
                self.note(folder, &path, Some("it is missing".to_owned()));
            }
        }
    }

    /// Checks a file that contains its own checksum.
    fn file(&mut self, folder: &Path, path: &Path) {
        let name = path.file_name().map(|name| name.to_string_lossy()).unwrap_or_default();
        let is_unit = name.starts_with("run-") && name.ends_with(".json");
        let read = if name == "one_step.json" {
            beside(path, "steps", "one_step.parquet")
        } else if name == "training.json" && sealed(path) {
            beside(path, "encoder", "encoder.safetensors")
        } else if is_unit {
            read_sealed_json::<Value>(path).map(drop).map_err(StepError::from)
        } else if name == "checkpoint.safetensors"
            || name == ".unfinished.safetensors"
            || NetworkFiles::is_name(&name)
        {
            read_sealed_tensors(path).map(drop).map_err(StepError::from)
        } else if name.ends_with(".parquet") {
            table(path)
        } else {
            return;
        };
        self.note(folder, path, read.err().map(|error| error.to_string()));
    }

    /// Counts a file once, and records its damage.
    fn note(&mut self, folder: &Path, path: &Path, damage: Option<String>) {
        self.checked.files += usize::from(self.counted.insert(path.to_owned()));
        let Some(reason) = damage else { return };
        if self.checked.damages.iter().any(|known| known.path == path) {
            return;
        }
        let made_by = folder.ancestors().find_map(made_by);
        let made_by = made_by.map_or_else(|| "calib run STUDY".to_owned(), |made| made.command);
        self.checked.damages.push(Damage { path: path.to_owned(), reason, made_by });
    }

    /// Reads the logs that the results were made from, which their manifests name.
    fn logs(&mut self, root: &Path) {
        for (data, preprocess) in mem::take(&mut self.read) {
            let mut data = memory::on_this_machine(data);
            let found = found_from(&mut data, root);
            let shown = data.path.0.join(", ");
            let read = found.and_then(|()| {
                memory::check_log(&data)?;
                Ok(calib_data::inspect(&data, &preprocess, &self.printer.progress())?)
            });
            match read {
                Ok(_) => self.checked.logs.push(shown),
                Err(error) => {
                    let log = UnreadableLog { path: shown, reason: error.to_string() };
                    self.checked.unreadable_logs.push(log);
                }
            }
        }
    }
}

/// Resolves the paths of the log. Results lie beside their study, and relative paths start from there.
fn found_from(data: &mut DataConfig, root: &Path) -> Result<(), StepError> {
    for path in &mut data.path.0 {
        *path =
            with_variables(path, |name| std::env::var(name).ok()).map_err(StepError::message)?;
    }
    data.resolve(root.parent().unwrap_or(Path::new("")));
    Ok(())
}

/// Returns the path of a manifest entry. A report of verdicts lies beside `folder`, and its entry is
/// `../report.html`.
fn beside_or_in(folder: &Path, name: &str) -> PathBuf {
    match name.strip_prefix("../") {
        Some(name) if folder.file_name().is_some() => folder.with_file_name(name),
        _ => folder.join(name),
    }
}

/// Checks a table, whose pages have checksums.
fn table(path: &Path) -> Result<(), StepError> {
    memory::check_table(path, None)?;
    read_parquet(path).map(drop).map_err(StepError::from)
}

/// Checks a record that holds the fingerprint of the file `name` beside it.
fn beside(path: &Path, key: &str, name: &str) -> Result<(), StepError> {
    let record: Value = read_sealed_json(path)?;
    let found = fingerprint_file(&path.with_file_name(name))?;
    ensure!(record[key] == found.as_str(), "{name} beside it is not what was written");
    Ok(())
}

/// Whether `training.json` is sealed. Those of representations are. Networks in `model` use the same name
/// unsealed.
fn sealed(path: &Path) -> bool {
    path.parent().and_then(Path::file_name).is_none_or(|folder| folder != "model")
}

/// The command that makes a folder of results.
struct MadeBy {
    command: String,
    needs_manifest: bool,
}

impl MadeBy {
    /// Describes a folder that the command of `step` makes.
    fn of_step(step: StepKind, needs_manifest: bool) -> Self {
        Self { command: format!("calib {} STUDY", step.command()), needs_manifest }
    }
}

fn made_by(folder: &Path) -> Option<MadeBy> {
    let name = folder.file_name()?.to_str()?;
    match name {
        "control-model" | "control-representation" => {
            Some(MadeBy::of_step(StepKind::Control, true))
        }
        "control-units" => Some(MadeBy::of_step(StepKind::Control, false)),
        "validity-results" => {
            Some(MadeBy { command: "calib validity STUDY …".to_owned(), needs_manifest: false })
        }
        name => {
            let step = StepKind::of_folder(name)?;
            // Prepared logs lie in subfolders, so their folder needs no manifest.
            Some(MadeBy::of_step(step, step != StepKind::Prepare))
        }
    }
}
