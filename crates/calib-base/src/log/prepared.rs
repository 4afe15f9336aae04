//! The log of a study, read and prepared once. Every later step, of this command or another, maps the prepared files.

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
};

use calib_core::{Frames, Normaliser, Period};
use calib_data::{DataConfig, Dataset, Paths, PreprocessConfig, Profile, Surveyed};
use calib_files::{FileStat, Fingerprint, LOCK, ScratchPlace, remove_empty_folder, remove_file};
use calib_study::{Job, Scope, StepKind};
use serde::{Deserialize, Serialize};

use crate::{
    StepError,
    artefact::{self, Artefact, Below, DirectoryLock, Facts, MANIFEST, TOOL},
    bail, clock, frames,
    log::{
        context::RunContext,
        plant_of_study,
        prepared_log::Prepared,
        sources::{SOURCES, SourceFile, Sources},
        stand_in,
    },
    memory,
    output::{Printer, bytes, count},
};

/// `manifest.json` of a prepared log.
type LogManifest = Artefact<LogFacts>;

/// The contents of the manifest of a prepared log.
#[derive(Serialize, Deserialize)]
struct LogFacts {
    /// Fingerprint of all inputs except the content of the log.
    key: String,
    data: DataConfig,
    preprocess: PreprocessConfig,
    normaliser: Normaliser,
    period: Period,
    profile: Profile,
    /// Fingerprint of the training states.
    train: Fingerprint,
    /// Fingerprint of the held-out states.
    held_out: Option<Fingerprint>,
}

impl Facts for LogFacts {
    const FORMAT: u32 = 2;
    const STEP: StepKind = StepKind::Prepare;

    fn key(&self) -> &str {
        &self.key
    }
}

const TRAIN: &str = "train";
const HELD_OUT: &str = "held-out";
/// Number of digits of a key in the name of a folder.
const KEY_DIGITS: usize = 12;

/// The state of a log before its states are made.
pub enum Known {
    /// Its states exist.
    Prepared(Box<Prepared>),
    /// It was surveyed, and its states do not exist. Making them takes this much memory, in bytes.
    Surveyed(Box<Surveyed>, u64),
}

/// Returns the states of a log: previously prepared ones, or otherwise made from its files. `data` is the section of
/// the study, or a part of it. `memory` is the available memory in bytes, if the user gives it.
///
/// # Errors
/// If the log cannot be read or does not fit into memory, is not what `[simulate]` wrote, or the observer asks to stop.
pub fn open(
    job: &Job,
    data: &DataConfig,
    memory: Option<u64>,
    context: &RunContext,
) -> Result<Prepared, StepError> {
    let place = Place::of(job, data)?;
    if let Some(known) = place.opened(context) {
        return Ok(known);
    }
    let prepared = if let Some(rows_each) = context.stands_in() {
        let Prepared { dataset, .. } = place.prepare(job, data, memory, &context.silent())?;
        Prepared { dataset: stand_in::repeated(dataset, rows_each)?, states: None }
    } else if let Some(kept) = place.kept(job) {
        kept
    } else {
        place.prepare(job, data, memory, context)?
    };
    place.remember(context, &prepared);
    Ok(prepared)
}

/// Whether the states of a log exist, and the log has not changed since.
pub fn is_there(job: &Job, data: &DataConfig, context: &RunContext) -> bool {
    let Ok(place) = Place::of(job, data) else { return false };
    if place.opened(context).is_some() {
        return true;
    }
    let kept = place.kept(job);
    if let Some(kept) = &kept {
        place.remember(context, kept);
    }
    kept.is_some()
}

/// Returns a file of the log that has another name, size or date than when the log was read. `None` if there is no such file, or the log
/// was not read for these sections of the study.
///
/// # Errors
/// If the log has no files, or the key of what was read cannot be computed.
pub fn changed_file(job: &Job, data: &DataConfig) -> Result<Option<PathBuf>, StepError> {
    let place = Place::of(job, data)?;
    let noted = Sources::noted_in(&place.directory);
    Ok(noted.and_then(|noted| noted.changed_file(&place.sources).map(Path::to_owned)))
}

/// Returns the state of a log as [`open`] does, but without making states: for a plan of the work that needs them.
///
/// # Errors
/// As [`open`].
pub fn look(
    job: &Job,
    data: &DataConfig,
    memory: Option<u64>,
    context: &RunContext,
) -> Result<Known, StepError> {
    if context.stands_in().is_some() {
        return Ok(Known::Prepared(Box::new(open(job, data, memory, context)?)));
    }
    let place = Place::of(job, data)?;
    if let Some(known) = place.opened(context).or_else(|| place.kept(job)) {
        return Ok(Known::Prepared(Box::new(known)));
    }
    plant_of_study::check_days(job)?;
    memory::check_log(data)?;
    let there = memory.or_else(memory::available);
    tell(data, context);
    let surveyed = calib_data::survey(data, &job.study().preprocess, &context.progress())?;
    warn(surveyed.profile(), context);
    let (_, needed) = place.scratch(&surveyed, there, Writable::Yes)?;
    Ok(Known::Surveyed(Box::new(surveyed), needed))
}

/// Reports how a log was read, and warnings that matter to every later step.
fn warn(profile: &Profile, context: &RunContext) {
    profile.read_as.iter().for_each(|read_as| context.say_once(read_as));
    profile.reading_doubts().iter().for_each(|doubt| context.warn_once(doubt));
}

fn tell(data: &DataConfig, printer: &Printer) {
    printer.say(&format!("reading {}", data.path.0.join(", ")));
}

/// Whether the results of the study can be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Writable {
    Yes,
    No,
}

/// The place where a prepared log is stored.
struct Place {
    /// Folder of all logs of the study.
    root: PathBuf,
    directory: PathBuf,
    key: String,
    sources: Sources,
}

impl Place {
    fn of(job: &Job, data: &DataConfig) -> Result<Self, StepError> {
        let root = job.layout().dataset();
        let key = key(data, &job.study().preprocess)?;
        let directory = root.join(folder(&key));
        Ok(Self { directory, root, key, sources: Sources::of(data)? })
    }

    fn opened(&self, context: &RunContext) -> Option<Prepared> {
        context.opened(&self.root, &self.directory)
    }

    fn remember(&self, context: &RunContext, prepared: &Prepared) {
        context.remember(&self.root, &self.directory, prepared);
    }

    /// Returns the previously prepared log, if the log has not changed and no file is damaged.
    fn kept(&self, job: &Job) -> Option<Prepared> {
        if job.policy().redoes() {
            return None;
        }
        let directory = &self.directory;
        let manifest = LogManifest::find(directory, &self.key)?;
        let sources = Sources::noted_in(directory)?;
        let written = FileStat::of(&directory.join(MANIFEST)).ok()??;
        let is_same = sources == self.sources
            && sources.files.iter().all(|source| source.was_older_than(&written));
        if is_same { self.map(manifest.facts).ok() } else { None }
    }

    fn map(&self, facts: LogFacts) -> Result<Prepared, StepError> {
        let dataset = Dataset {
            normaliser: facts.normaliser,
            train: self.open_frames(TRAIN)?,
            held_out: facts.held_out.as_ref().map(|_| self.open_frames(HELD_OUT)).transpose()?,
            period: facts.period,
            profile: facts.profile,
            fingerprint: facts.train,
            held_out_fingerprint: facts.held_out,
        };
        Ok(Prepared { dataset, states: Some(self.states(TRAIN)) })
    }

    fn open_frames(&self, name: &str) -> Result<Frames, StepError> {
        let states = frames::map_states(&self.states(name))?;
        frames::open(&self.rows(name), states)
    }

    fn states(&self, name: &str) -> PathBuf {
        self.directory.join(format!("{name}.npy"))
    }

    fn rows(&self, name: &str) -> PathBuf {
        self.directory.join(format!("{name}.parquet"))
    }

    /// Reads the log, and stores the prepared log if that can be written.
    fn prepare(
        &self,
        job: &Job,
        data: &DataConfig,
        memory: Option<u64>,
        context: &RunContext,
    ) -> Result<Prepared, StepError> {
        plant_of_study::check_days(job)?;
        memory::check_log(data)?;
        // A log that was simulated just now must not change unnoticed while it is read; it must also be recognised next
        // time.
        clock::settle(self.sources.files.iter().filter_map(|source| source.stamp));
        // Measured before anything is read, because the log that is held by then is a part of the need.
        let there = memory.or_else(memory::available);
        let study = job.study();
        tell(data, context);
        let surveyed = calib_data::survey(data, &study.preprocess, &context.progress())?;
        warn(surveyed.profile(), context);
        // Refuse before anything is written.
        self.scratch(&surveyed, there, Writable::Yes)?;
        let claim = if job.policy().is_dry() { None } else { self.claim()? };
        let writable = if claim.is_some() { Writable::Yes } else { Writable::No };
        let (place, _) = self.scratch(&surveyed, there, writable)?;
        let dataset = surveyed.load(&place, &context.progress())?;
        let Some(claim) = claim else { return Ok(Prepared { dataset, states: None }) };
        self.keep(&claim, job, dataset)
    }

    /// Claims the folder. `None` if nothing can be written, or if another calib is preparing the same log: this one
    /// then reads for itself.
    fn claim(&self) -> Result<Option<DirectoryLock>, StepError> {
        match DirectoryLock::try_new(&self.directory, Below::Ours) {
            Err(error) if artefact::is_refusal(&error) => Ok(None),
            claim => claim,
        }
    }

    /// Returns where states are held while they are made, and the memory for that, in bytes. They are in memory if they
    /// take no more than half of what is available.
    fn scratch(
        &self,
        surveyed: &Surveyed,
        there: Option<u64>,
        writable: Writable,
    ) -> Result<(ScratchPlace, u64), StepError> {
        let states = surveyed.state_bytes();
        let working = surveyed.working_bytes();
        let fits = there.is_none_or(|there| states <= there / 2);
        let (place, taken) = if fits || writable == Writable::No {
            (ScratchPlace::Memory, states + working)
        } else {
            (ScratchPlace::Disk(self.directory.clone()), working)
        };
        if let Some(there) = there.filter(|there| taken > *there) {
            bail!(
                "reading {} states of {} columns takes {} of memory, and {} is there; raise `preprocess.subsample`, shorten \
                 `data.train`, leave channels out with `data.exclude`, or say with `calib build-model … --memory SIZE` that there is more",
                count(surveyed.rows() + surveyed.held_out_rows()),
                surveyed.columns(),
                bytes(taken),
                bytes(there),
            );
        }
        Ok((place, taken))
    }

    fn keep(
        &self,
        claim: &DirectoryLock,
        job: &Job,
        dataset: Dataset,
    ) -> Result<Prepared, StepError> {
        let directory = &self.directory;
        claim.begin()?;
        remove_file(&directory.join(SOURCES))?;
        let held_out = dataset.held_out.as_ref().map(|frames| (HELD_OUT, frames));
        let parts = [(TRAIN, &dataset.train)].into_iter().chain(held_out);
        let mut written = Vec::new();
        for (name, frames) in parts {
            self.write_states(name, frames, &dataset)?;
            artefact::write_table(frames::rows_table(frames), &self.rows(name))?;
            written.extend(files_of(name));
        }
        let study = job.study();
        let facts = LogFacts {
            key: self.key.clone(),
            data: study.data.clone(),
            preprocess: study.preprocess.clone(),
            normaliser: dataset.normaliser,
            period: dataset.period,
            profile: dataset.profile,
            train: dataset.fingerprint,
            held_out: dataset.held_out_fingerprint,
        };
        // A log that was written to while it was read is read again next time.
        if self.sources.files.iter().all(SourceFile::is_same) {
            self.sources.note_in(directory)?;
        }
        let kept = claim.finish(facts, written.iter().map(String::as_str))?;
        self.remove_others(job)?;
        self.map(kept.facts)
    }

    /// Writes states, or links those of another log of the study, which may differ in its held-out period.
    fn write_states(
        &self,
        name: &str,
        frames: &Frames,
        dataset: &Dataset,
    ) -> Result<(), StepError> {
        let path = self.states(name);
        if name == TRAIN {
            for other in folders(&self.root).filter(|other| *other != self.directory) {
                let is_same = artefact::read::<LogManifest>(&other)
                    .is_some_and(|kept| kept.train == dataset.fingerprint && kept.is_whole(&other));
                if is_same {
                    return Ok(calib_files::link_or_copy(&other.join("train.npy"), &path)?);
                }
            }
        }
        frames::write_states(&path, frames)
    }

    /// Removes the logs that no part of the study reads any more.
    fn remove_others(&self, job: &Job) -> Result<(), StepError> {
        let mut read = BTreeSet::from([self.directory.clone()]);
        for model in job.choose(None, None)?.models()? {
            for part in model.parts(Scope::Deployment)?.iter().chain([&model]) {
                let study = part.study();
                let training = DataConfig { held_out: None, ..study.data.clone() };
                for data in [&study.data, &training] {
                    read.insert(self.root.join(folder(&key(data, &study.preprocess)?)));
                }
            }
        }
        for other in folders(&self.root).filter(|other| !read.contains(other)) {
            if let Ok(Some(claim)) = DirectoryLock::try_new(&other, Below::Ours) {
                claim.begin()?;
                forget(&other)?;
            }
        }
        Ok(())
    }
}

/// Returns the fingerprint of all inputs of a prepared log except the content of its files.
fn key(data: &DataConfig, preprocess: &PreprocessConfig) -> Result<String, StepError> {
    let data = DataConfig { path: Paths::default(), ..data.clone() };
    artefact::key(&(LogFacts::FORMAT, TOOL, data, preprocess))
}

/// Returns the name of the folder of a prepared log.
fn folder(key: &str) -> &str {
    &key[..key.len().min(KEY_DIGITS)]
}

/// Removes the files of a prepared log, and its folder if no other files are left in it.
fn forget(directory: &Path) -> Result<(), StepError> {
    let parts = [TRAIN, HELD_OUT].into_iter().flat_map(files_of);
    for name in [MANIFEST, SOURCES].map(str::to_owned).into_iter().chain(parts) {
        remove_file(&directory.join(name))?;
    }
    remove_file(&directory.join(LOCK))?;
    remove_empty_folder(directory);
    Ok(())
}

/// Returns the names of the files of states and rows of a part.
fn files_of(name: &str) -> [String; 2] {
    [format!("{name}.npy"), format!("{name}.parquet")]
}

fn folders(root: &Path) -> impl Iterator<Item = PathBuf> {
    let entries = fs::read_dir(root).into_iter().flatten().flatten();
    let mut found: Vec<PathBuf> = entries
        .filter(|entry| {
            let name = entry.file_name();
            let is_key = name.len() == KEY_DIGITS
                && name.to_string_lossy().bytes().all(|digit| digit.is_ascii_hexdigit());
            is_key && entry.file_type().is_ok_and(|kind| kind.is_dir())
        })
        .map(|entry| entry.path())
        .collect();
    found.sort();
    found.into_iter()
}
