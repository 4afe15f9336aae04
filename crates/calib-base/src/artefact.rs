//! Cached results: a directory counts as a result only with a manifest that names its inputs.

use std::{
    collections::BTreeMap,
    ops::{Deref, DerefMut},
    path::{Path, PathBuf},
    sync::{Mutex, MutexGuard},
};

use calib_core::locked;
use calib_data::table::{RESULTS_KEY, Table};
pub use calib_files::Below;
use calib_files::{
    FileError, FileStat, Fingerprint, Fingerprinter, FolderRecord, LOCK, Lock, fingerprint_file,
    link_or_copy, lock, read_sealed_json, remove_file, remove_temporaries, write_sealed_json,
};
use calib_study::{Job, Scope, StepKind};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize, de::DeserializeOwned};

use crate::{Context as _, StepError, output::Printer};

/// The version of calib that wrote a file.
pub const TOOL: &str = concat!("calib ", env!("CARGO_PKG_VERSION"));

/// The file that completes a directory. It is written last and removed first.
pub const MANIFEST: &str = "manifest.json";

/// The file of a verdict about control agents, which belongs to no model.
pub const CONTROL_VERDICT: &str = "verdict.json";

/// The inputs of a directory, as its manifest records them.
pub trait Manifest: Serialize + DeserializeOwned {
    /// Version of the directory's format. Another version is another artefact.
    const FORMAT: u32;

    /// Returns the version in the manifest.
    fn format(&self) -> u32;
}

/// The output of a step, as the `manifest.json` of its directory describes it.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Artefact<T> {
    format: u32,
    /// The version of calib that wrote it.
    pub tool: String,
    /// The facts that the step records about its output.
    #[serde(flatten)]
    pub facts: T,
    /// Fingerprint of every other file in the directory.
    pub files: Files,
}

/// The part of a manifest that is specific to one kind of artefact.
pub trait Facts: Serialize + DeserializeOwned {
    /// Version of the directory's format. Another version is another artefact.
    const FORMAT: u32;
    /// The step that makes the artefact.
    const STEP: StepKind;

    /// Returns the fingerprint of all inputs; empty where the parts have their own keys.
    fn key(&self) -> &str;

    /// Whether a file stays the same as long as the result does.
    fn lasts(_name: &str) -> bool {
        true
    }

    /// Whether everything beside the lasting files is complete and undamaged, such as subdirectories, which have no
    /// fingerprint in the manifest.
    fn has_all_parts(&self, _directory: &Path) -> bool {
        true
    }
}

impl<T: Facts> Manifest for Artefact<T> {
    const FORMAT: u32 = T::FORMAT;

    fn format(&self) -> u32 {
        self.format
    }
}

impl<T> Deref for Artefact<T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.facts
    }
}

impl<T> DerefMut for Artefact<T> {
    fn deref_mut(&mut self) -> &mut T {
        &mut self.facts
    }
}

impl<T: Facts> Artefact<T> {
    /// Returns an artefact without files.
    pub fn new(facts: T) -> Self {
        Self { format: T::FORMAT, tool: TOOL.to_owned(), facts, files: Files::new() }
    }

    /// Returns the artefact with the key `key`, if it is in `directory` and undamaged.
    pub fn find(directory: &Path, key: &str) -> Option<Self> {
        read::<Self>(directory).filter(|found| found.key() == key && found.is_whole(directory))
    }

    /// Returns the artefact with the key `key`, if the job has it and need not make it again. If another model of the
    /// study has it, its files are copied to the job: the difference between the two models does not affect this
    /// artefact.
    ///
    /// # Errors
    /// If another model has it, and the copy cannot be written.
    pub fn of_job(job: &Job, key: &str, printer: &Printer) -> Result<Option<Self>, StepError> {
        if job.policy().redoes() {
            return Ok(None);
        }
        let directory = job.layout().directory(T::STEP);
        if let Some(found) = Self::find(&directory, key) {
            return Ok(Some(found));
        }
        if T::STEP.scope() != Scope::Model {
            return Ok(None);
        }
        for other in job.layout().of_other_models(T::STEP) {
            let Some(found) = Self::find(&other, key) else { continue };
            let result = T::STEP.result();
            let place = other.display();
            printer.say(&format!("the {result} is that in {place}, and is copied"));
            let claim = DirectoryLock::begun(&directory)?;
            for name in found.files.keys() {
                link_or_copy(&other.join(name), &directory.join(name))?;
            }
            claim.complete(&found)?;
            return Ok(Some(found));
        }
        Ok(None)
    }

    /// Whether every lasting file is as it was written.
    pub fn is_whole(&self, directory: &Path) -> bool {
        are_whole(directory, &self.lasting_files()) && self.has_all_parts(directory)
    }

    /// Whether every file exists, without reading any.
    pub fn has_files(&self, directory: &Path) -> bool {
        self.files.keys().all(|name| directory.join(name).exists())
    }

    /// Returns the files that do not change as long as the result is the same.
    pub fn lasting_files(&self) -> Files {
        let lasting = self.files.iter().filter(|(name, _)| T::lasts(name));
        lasting.map(|(name, written)| (name.clone(), written.clone())).collect()
    }
}

/// Reads the manifest of `directory`, if it is complete and of this format.
pub fn read<M: Manifest>(directory: &Path) -> Option<M> {
    let manifest: M = read_sealed_json(&directory.join(MANIFEST)).ok()?;
    (manifest.format() == M::FORMAT).then_some(manifest)
}

/// The files of a directory by name, each with its fingerprint when it was written.
pub type Files = BTreeMap<String, Fingerprint>;

/// Returns the fingerprints of files that were just written.
///
/// # Errors
/// If one cannot be read.
pub fn fingerprints<'a>(
    directory: &Path,
    names: impl IntoIterator<Item = &'a str>,
) -> Result<Files, StepError> {
    let mut files = Files::new();
    for name in names {
        files.insert(name.to_owned(), fingerprint_file(&directory.join(name))?);
    }
    Ok(files)
}

/// Returns the fingerprint of a file. This process reads an unchanged file only once.
///
/// # Errors
/// If it cannot be read.
pub fn fingerprint_once(path: &Path) -> Result<Fingerprint, FileError> {
    let Some(stamp) = FileStat::of(path)? else { return fingerprint_file(path) };
    if let Some(found) = known_fingerprints().get(&stamp) {
        return Ok(found.clone());
    }
    let found = fingerprint_file(path)?;
    known_fingerprints().insert(stamp, found.clone());
    Ok(found)
}

/// Locks the fingerprints of the files that this process has read.
fn known_fingerprints() -> MutexGuard<'static, BTreeMap<FileStat, Fingerprint>> {
    static READ: Mutex<BTreeMap<FileStat, Fingerprint>> = Mutex::new(BTreeMap::new());
    locked(&READ)
}

/// Whether all files of a complete directory are as they were written.
pub fn are_whole(directory: &Path, files: &Files) -> bool {
    files.iter().all(|(name, written)| {
        fingerprint_once(&directory.join(name)).is_ok_and(|found| found == *written)
    })
}

/// Checks before first use that the files of a complete directory are as they were written. `command` makes them again.
///
/// # Errors
/// If one cannot be read; [`StepError::Missing`] if one does not exist, [`StepError::Stale`] if one has changed.
pub fn check_files(directory: &Path, files: &Files, command: &str) -> Result<(), StepError> {
    for (name, written) in files {
        let path = directory.join(name);
        let found = match fingerprint_once(&path) {
            Err(reason) if reason.is_not_found() => {
                let reason = StepError::from(reason);
                return Err(StepError::Missing(format!("run `{command}` again: {reason}")));
            }
            found => found.with_context(|| format!("run `{command}` again"))?,
        };
        if found != *written {
            return Err(StepError::Stale(format!(
                "{} is not what was written: it was damaged or replaced; run `{command}` to make it again",
                path.display()
            )));
        }
    }
    Ok(())
}

/// Reads the manifest of `directory`. The error names the `command` that makes it.
///
/// # Errors
/// [`StepError::Missing`] if there is no manifest; [`StepError::Stale`] if it is damaged, of other results or has
/// another format; or if it cannot be read.
pub fn require<M: Manifest>(directory: &Path, command: &str) -> Result<M, StepError> {
    let path = directory.join(MANIFEST);
    if !path.exists() {
        let path = path.display();
        return Err(StepError::Missing(format!("{path} does not exist; run `{command}` first")));
    }
    let manifest: M = match read_sealed_json(&path) {
        // The file is undamaged, but describes something else.
        Err(FileError::Json { .. }) if read_sealed_json::<serde_json::Value>(&path).is_ok() => {
            return Err(StepError::Stale(format!(
                "{} has other results than those of `{command}`, or those of another calib; give the folder of these",
                directory.display()
            )));
        }
        Err(reason @ (FileError::Damaged { .. } | FileError::Json { .. })) => {
            let reason = StepError::from(reason);
            return Err(StepError::Stale(format!("run `{command}` to make it again: {reason}")));
        }
        manifest => manifest.with_context(|| format!("run `{command}` to make it again"))?,
    };
    if manifest.format() == M::FORMAT {
        return Ok(manifest);
    }
    Err(other_format(&path, manifest.format(), M::FORMAT, command))
}

/// Returns the error for a manifest with another `format` than the one that is `read` here, with the remedy.
fn other_format(path: &Path, format: u32, read: u32, command: &str) -> StepError {
    let path = path.display();
    StepError::Stale(if format > read {
        format!(
            "{path} has format {format}, which a newer calib wrote, and this calib reads format {read}; update calib, or run \
             `{command}` to make it again with this one"
        )
    } else {
        format!("{path} has format {format}, this calib reads format {read}; run `{command}`")
    })
}

/// The exclusive claim of this process to write a directory, where the file system has locks. The claim ends with the
/// process, however it ends.
///
/// It saves work and avoids confusion, but no result depends on it. Without locks, two processes may write one
/// directory: both then write the same bytes, file by file as a whole.
pub struct DirectoryLock {
    directory: PathBuf,
    record: FolderRecord,
    /// The lock, held while the file is open.
    _lock: Lock,
}

impl DirectoryLock {
    /// Claims `directory`, and removes the half-written files of a killed process.
    ///
    /// # Errors
    /// If it cannot be written, another process has claimed it, or it holds other files although everything below must
    /// be calib's.
    pub fn new(directory: &Path, below: Below) -> Result<Self, StepError> {
        Self::try_new(directory, below)?.with_context(|| taken(directory))
    }

    /// Claims a directory as [`DirectoryLock::new`] does, or returns `None` if another process has claimed it.
    ///
    /// # Errors
    /// As [`DirectoryLock::new`].
    pub fn try_new(directory: &Path, below: Below) -> Result<Option<Self>, StepError> {
        let record = match below {
            Below::Ours => own(directory)?,
            Below::Unknown => FolderRecord::open(directory)?,
        };
        Self::with(directory, record, below)
    }

    /// Claims a directory as [`DirectoryLock::new`] does. It may contain only the files that calib's record of it
    /// names.
    ///
    /// # Errors
    /// As [`DirectoryLock::new`].
    pub fn new_named(directory: &Path) -> Result<Self, StepError> {
        let record = FolderRecord::open_own(directory)?;
        Self::with(directory, record, Below::Unknown)?.with_context(|| taken(directory))
    }

    fn with(
        directory: &Path,
        record: FolderRecord,
        below: Below,
    ) -> Result<Option<Self>, StepError> {
        let lock = lock(&directory.join(LOCK)).with_context(|| not_writable(directory))?;
        if matches!(lock, Lock::Taken) {
            return Ok(None);
        }
        remove_temporaries(directory, below).with_context(|| not_writable(directory))?;
        Ok(Some(Self { directory: directory.to_owned(), record, _lock: lock }))
    }

    /// Returns the record of the files in the directory, and beside it, that belong to calib.
    pub fn record(&mut self) -> &mut FolderRecord {
        &mut self.record
    }

    /// Marks the directory as incomplete: until [`complete`](Self::complete) it does not count as a result.
    ///
    /// # Errors
    /// If the existing manifest cannot be removed.
    pub fn begin(&self) -> Result<(), StepError> {
        remove_file(&self.directory.join(MANIFEST)).with_context(|| not_writable(&self.directory))
    }

    /// Claims a directory, which does not count as a result until [`finish`](Self::finish) completes it.
    ///
    /// # Errors
    /// As [`DirectoryLock::new`].
    pub fn begun(directory: &Path) -> Result<Self, StepError> {
        let claim = Self::new(directory, Below::Ours)?;
        claim.begin()?;
        Ok(claim)
    }

    /// Completes the directory, of which `names` were written, with a manifest of these facts.
    ///
    /// # Errors
    /// If a file cannot be read, or the manifest cannot be written.
    pub fn finish<'a, T: Facts>(
        &self,
        facts: T,
        names: impl IntoIterator<Item = &'a str>,
    ) -> Result<Artefact<T>, StepError> {
        let files = fingerprints(&self.directory, names)?;
        let artefact = Artefact { files, ..Artefact::new(facts) };
        self.complete(&artefact)?;
        Ok(artefact)
    }

    /// Completes the directory with its manifest. It stays claimed as long as the claim is held.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn complete<M: Manifest>(&self, manifest: &M) -> Result<(), StepError> {
        Ok(write_sealed_json(&self.directory.join(MANIFEST), manifest)?)
    }
}

fn not_writable(directory: &Path) -> String {
    format!("cannot write to {}", directory.display())
}

fn taken(directory: &Path) -> String {
    format!(
        "another calib is writing to {}; wait for it, or choose another folder",
        directory.display()
    )
}

/// Makes a whole directory calib's own. Results of a calib that kept no record are recognised by their manifest.
///
/// # Errors
/// If it holds something that calib did not write, or cannot be written.
pub fn own(directory: &Path) -> Result<FolderRecord, FileError> {
    FolderRecord::take(directory, || has_manifest(directory))
}

/// Checks whether a directory can be made calib's own, without writing.
///
/// # Errors
/// As [`own`].
pub fn check_own(directory: &Path) -> Result<(), FileError> {
    FolderRecord::check(directory, || has_manifest(directory)).map(drop)
}

fn has_manifest(directory: &Path) -> bool {
    let manifest = read_sealed_json::<serde_json::Value>(&directory.join(MANIFEST));
    let tool = manifest.map(|manifest| manifest["tool"].as_str().map(str::to_owned));
    matches!(tool, Ok(Some(tool)) if tool.starts_with("calib "))
}

/// Continues with a warning if the disk is read-only, so that finished results can still be shown. Other errors remain.
///
/// # Errors
/// The error of `written`, unless it means that nothing may be written there.
pub fn or_read_only(
    written: Result<(), StepError>,
    place: &Path,
    printer: &Printer,
) -> Result<(), StepError> {
    match written {
        Err(error) if is_refusal(&error) => {
            let place = place.display();
            printer.warn(&format!("{place} was not written: {error}; results are only shown"));
            Ok(())
        }
        other => other,
    }
}

/// Whether the error means that nothing may be written there.
pub(crate) fn is_refusal(error: &StepError) -> bool {
    matches!(error.root(), StepError::Storage(error) if error.is_refusal())
}

/// Writes a table of results, marked as one, so that a search for logs excludes it.
///
/// # Errors
/// If it cannot be written.
pub fn write_table(table: Table, path: &Path) -> Result<(), StepError> {
    Ok(marked(table).write_parquet(path)?)
}

/// Marks a table as a result.
pub fn marked(table: Table) -> Table {
    table.with_metadata(RESULTS_KEY, "1")
}

/// Returns the fingerprint of some inputs.
///
/// # Errors
/// If they cannot be written as JSON.
pub fn key(inputs: &impl Serialize) -> Result<String, StepError> {
    let text = serde_json::to_vec(inputs)?;
    let fingerprint: Fingerprint = Fingerprinter::default().add(&text).finish();
    Ok(fingerprint.to_string())
}

#[cfg(test)]
mod tests {
    use std::fs;

    use serde::Deserialize;

    use super::*;

    #[derive(Serialize, Deserialize)]
    struct TestManifest {
        format: u32,
    }

    impl Manifest for TestManifest {
        const FORMAT: u32 = 1;

        fn format(&self) -> u32 {
            self.format
        }
    }

    #[test]
    fn files_are_whole_as_long_as_no_byte_differs() {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("a");
        fs::write(&path, b"content").expect("written");
        let files = fingerprints(directory.path(), ["a"]).expect("readable");
        check_files(directory.path(), &files, "calib make").expect("whole");
        fs::write(&path, b"Content").expect("written");
        assert!(!are_whole(directory.path(), &files));
        let error = check_files(directory.path(), &files, "calib make").expect_err("damaged");
        assert!(error.to_string().contains("run `calib make`"), "{error}");
        assert!(matches!(error, StepError::Stale(_)), "{error:?}");
        fs::remove_file(&path).expect("removed");
        assert!(!are_whole(directory.path(), &files));
        let error = check_files(directory.path(), &files, "calib make").expect_err("missing");
        assert!(error.to_string().starts_with("run `calib make` again: cannot read "), "{error}");
        assert!(matches!(error, StepError::Missing(_)), "{error:?}");
    }

    fn refused(directory: &Path) -> StepError {
        require::<TestManifest>(directory, "calib make").err().expect("no manifest of this calib")
    }

    #[test]
    fn manifests_that_cannot_be_used_are_missing_or_stale() {
        let directory = tempfile::tempdir().expect("a directory");
        let error = refused(directory.path());
        assert!(error.to_string().ends_with("does not exist; run `calib make` first"), "{error}");
        assert!(matches!(error, StepError::Missing(_)), "{error:?}");
        fs::write(directory.path().join(MANIFEST), "{").expect("written");
        let error = refused(directory.path());
        assert!(error.to_string().starts_with("run `calib make` to make it again: "), "{error}");
        assert!(matches!(error, StepError::Stale(_)), "{error:?}");
    }

    #[test]
    fn results_of_another_calib_say_what_to_do() {
        let directory = tempfile::tempdir().expect("a directory");
        let [newer, older] = [3, 0].map(|format| {
            let claim = DirectoryLock::begun(directory.path()).expect("nobody has it");
            claim.complete(&TestManifest { format }).expect("writable");
            refused(directory.path()).to_string()
        });
        let part = "has format 3, which a newer calib wrote, and this calib reads format 1; update calib, or run `";
        assert!(newer.contains(part) && newer.contains("or run `calib make`"), "{newer}");
        assert!(
            older.ends_with("has format 0, this calib reads format 1; run `calib make`"),
            "{older}"
        );
    }

    #[test]
    fn a_directory_stays_claimed_when_it_is_complete() {
        let directory = tempfile::tempdir().expect("a directory");
        let claim = DirectoryLock::new(directory.path(), Below::Ours).expect("nobody has it");
        claim.begin().expect("writable");
        claim.complete(&TestManifest { format: 1 }).expect("writable");
        assert!(read::<TestManifest>(directory.path()).is_some());
        let other = DirectoryLock::new(directory.path(), Below::Ours).err().expect("it is claimed");
        assert!(other.to_string().contains("another calib is writing"), "{other}");
        drop(claim);
        assert!(DirectoryLock::new(directory.path(), Below::Ours).is_ok(), "it was given up");
    }
}
