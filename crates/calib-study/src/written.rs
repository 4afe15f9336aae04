//! The text of a study file, which each command reads once.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use calib_files::{FileError, read_regular};
use serde::de::DeserializeOwned;
use toml::{Table, Value};

use crate::{
    Request, Study, StudyError,
    error::{Problem, refuse, require},
    message::friendly,
    models, overrides,
    profiles::{self, ChosenProfile, Results},
    shell::shell_words,
    source::StudyText,
    typed::typed,
    without_model,
};

/// Content of a study file with the profile and the overrides applied. It still has all models and deployments.
#[derive(Clone, Debug)]
pub(crate) struct WrittenStudy {
    pub(crate) request: Request,
    pub(crate) table: Table,
    /// Place of the results of the profile.
    pub(crate) results: Results,
    pub(crate) source: StudyText,
}

impl WrittenStudy {
    /// Reads the file that `request` names.
    pub(crate) fn read(request: Request) -> Result<Self, StudyError> {
        refuse_log(&request.study)?;
        let text = text_of(&request.study)?;
        Self::of_text(request, text)
    }

    /// Uses `text` as the content of the file that `request` names.
    pub(crate) fn of_text(request: Request, text: String) -> Result<Self, StudyError> {
        let source = StudyText::new(&request.study, text);
        // The text is parsed before anything is applied to it, because only then a mistake has a position.
        let table = parse(&source)?;
        let profile = request.profile.clone();
        let mut written = Self { request, table, results: Results::AsWritten, source };
        let checked = profiles::check(&written.table, is_study);
        checked.map_err(|problem| written.locate(&problem))?;
        let file = written.table.clone();
        let chosen = profiles::choose(&mut written.table, profile.as_deref());
        let ChosenProfile { results, laid_over } =
            chosen.map_err(|problem| written.locate(&problem))?;
        written.results = results;
        let given = written.lay_over()?;
        finite(&written.table, "")
            .and_then(|()| models::check(&written.table))
            .and_then(|()| without_model::check(&written.table, &[file, laid_over, given]))
            .map_err(|problem| written.locate(&problem))?;
        Ok(written)
    }

    /// Applies the overrides to the table, and returns them as a table.
    fn lay_over(&mut self) -> Result<Table, Problem> {
        let mut all = Table::new();
        for text in &self.request.set {
            overrides::apply(&mut self.table, text)?;
            overrides::apply(&mut all, text)?;
        }
        let given: Vec<&str> = self.request.set.iter().map(|text| overrides::key(text)).collect();
        // A log given by override already exists, so no plant must be simulated in its folder.
        if given.contains(&"data") || given.contains(&"data.path") {
            self.table.remove("simulate");
        }
        let has_train = self.table.get("data").is_some_and(|data| data.get("train").is_some());
        if given.contains(&"data.train_fraction") && has_train {
            refuse!(
                "--set data.train_fraction has no effect, because data.train says which rows are for training; \
                 give data.train and data.held_out instead"
            );
        }
        Ok(all)
    }

    /// Returns the study of one model and one deployment, or of all.
    pub(crate) fn study(
        &self,
        model: Option<&str>,
        deployment: Option<&str>,
    ) -> Result<Study, StudyError> {
        let mut table = self.table.clone();
        let study = models::choose(&mut table, model).and_then(|()| {
            let mut study = typed(table)?;
            study.check()?;
            study.choose_deployment(deployment)?;
            Ok(study)
        });
        study.map_err(|problem| self.locate_in(&problem, model, deployment))
    }

    /// The text of the file.
    pub(crate) fn text(&self) -> &str {
        self.source.text()
    }

    /// Adds the position to a problem, if it has one.
    pub(crate) fn locate(&self, problem: &Problem) -> StudyError {
        self.locate_in(problem, None, None)
    }

    fn locate_in(
        &self,
        problem: &Problem,
        model: Option<&str>,
        deployment: Option<&str>,
    ) -> StudyError {
        let message = problem.to_string();
        for key in problem.keys() {
            // The override may be at fault then, and not the section of the file around it.
            if self.is_overridden(&key) {
                break;
            }
            if let Some(place) = self.place_of(&key, model) {
                return StudyError::Written { place: Box::new(place), message };
            }
        }
        // A message that begins with an option names it already.
        let study = if message.starts_with("--") {
            self.request.study.display().to_string()
        } else {
            self.with_what_was_given(model, deployment)
        };
        StudyError::Given { study, message }
    }

    /// Whether an override sets the key, a section around it, or a part of it.
    fn is_overridden(&self, key: &str) -> bool {
        let mut given = self.request.set.iter().map(|text| overrides::key(text));
        given.any(|given| overrides::is_inside(key, given) || overrides::is_inside(given, key))
    }

    /// Returns the position of a key: in the profile, in the chosen model, or in the rest of the file.
    fn place_of(&self, key: &str, model: Option<&str>) -> Option<crate::Place> {
        let model = model.map(|name| format!("models.{name}.{key}"));
        let keys: Vec<String> = model.into_iter().chain([key.to_owned()]).collect();
        let of_profile = self
            .request
            .profile
            .iter()
            .flat_map(|name| keys.iter().map(move |key| format!("profiles.{name}.{key}")));
        of_profile.chain(keys.iter().cloned()).find_map(|key| self.source.place_of(&key))
    }

    /// Returns the name of the file, followed by the given options.
    fn with_what_was_given(&self, model: Option<&str>, deployment: Option<&str>) -> String {
        let Request { study, set, profile, .. } = &self.request;
        let given: Vec<String> = profile
            .iter()
            .map(|name| format!("--profile {name}"))
            .chain(set.iter().map(|text| format!("--set {text}")))
            .chain(model.map(|name| format!("--model {name}")))
            .chain(deployment.map(|name| format!("--deployment {name}")))
            .collect();
        match given.as_slice() {
            [] => study.display().to_string(),
            given => format!("{} with {}", study.display(), given.join(" ")),
        }
    }
}

/// Section that makes a file a protocol of several studies.
pub(crate) const PROTOCOL_KEY: &str = "validity";

/// Suffix that turns the name of a study into the name of its result folder.
pub(crate) const RESULTS: &str = "-results";

/// Refuses a log or a folder in place of a study file.
fn refuse_log(path: &Path) -> Result<(), StudyError> {
    if path.is_dir() {
        let message = format!("this is a folder, and a study is expected, {}", study_beside(path));
        return Err(StudyError::Given { study: path.display().to_string(), message });
    }
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    let name = [".gz", ".zst"].iter().find_map(|packed| name.strip_suffix(packed)).unwrap_or(&name);
    let is_log = [".csv", ".tsv", ".txt", ".parquet", ".xlsx"]
        .iter()
        .any(|extension| name.ends_with(extension));
    if is_log {
        let message = format!(
            "this is a log, and a study is expected, a TOML file: {} writes one",
            init_command(path)
        );
        return Err(StudyError::Given { study: path.display().to_string(), message });
    }
    Ok(())
}

/// Says which file to give instead of a folder: the study of these results, a study
/// in the folder, or the file that `calib init` writes.
fn study_beside(folder: &Path) -> String {
    let name = folder.file_name().unwrap_or_default().to_string_lossy();
    let of_results =
        name.strip_suffix(RESULTS).map(|stem| folder.with_file_name(format!("{stem}.toml")));
    if let Some(study) = of_results.filter(|study| study.is_file()) {
        return format!("a TOML file: give {}, which these results are of", study.display());
    }
    match study_files(folder).unwrap_or_default().first() {
        Some(study) => format!("a TOML file, such as {}", study.display()),
        None => format!("a TOML file: if it holds a log, {} writes one", init_command(folder)),
    }
}

/// Returns the files in a folder that may be studies, sorted by name.
///
/// # Errors
/// If the folder cannot be read.
pub fn study_files(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let paths = fs::read_dir(folder)?.flatten().map(|entry| entry.path());
    let mut studies: Vec<PathBuf> = paths
        .filter(|path| {
            path.is_file() && path.extension().is_some_and(|extension| extension == "toml")
        })
        .collect();
    studies.sort();
    Ok(studies)
}

fn init_command(log: &Path) -> String {
    let words = ["calib".to_owned(), "init".to_owned(), log.display().to_string()];
    format!("`{}`", shell_words(words))
}

/// Reads the text of a file.
pub(crate) fn text_of(path: &Path) -> Result<String, StudyError> {
    let text = match read_regular(path) {
        Ok(bytes) => String::from_utf8(bytes)
            .map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error)),
        Err(FileError::Io { source, .. }) => Err(source),
        Err(other) => Err(io::Error::other(other)),
    };
    text.map_err(|source| StudyError::Unreadable { path: path.to_owned(), source })
}

/// Reads the study file `path` as a table, with all its models and without its profiles.
pub(crate) fn table_of(path: &Path) -> Result<Table, StudyError> {
    Ok(WrittenStudy::read(Request::new(path))?.table)
}

/// Refuses infinite numbers and NaN: TOML allows them, but no key accepts them and JSON cannot store them.
fn finite(table: &Table, section: &str) -> Result<(), Problem> {
    fn check(key: &str, value: &Value) -> Result<(), Problem> {
        match value {
            Value::Float(number) => {
                require!(number.is_finite(), "{key} = {number}: expected a finite number");
                Ok(())
            }
            Value::Array(values) => values.iter().try_for_each(|value| check(key, value)),
            Value::Table(table) => finite(table, key),
            _ => Ok(()),
        }
    }
    table.iter().try_for_each(|(name, value)| {
        let key = if section.is_empty() { name.clone() } else { format!("{section}.{name}") };
        check(&key, value)
    })
}

/// Checks that a table has the keys and types of a study.
fn is_study(table: Table) -> Result<(), Problem> {
    models::check(&table)?;
    typed(table)?;
    Ok(())
}

fn parse(source: &StudyText) -> Result<Table, StudyError> {
    let table: Table = of_text(source)?;
    if table.contains_key(PROTOCOL_KEY) {
        let path = source.path().display();
        return Err(StudyError::Value(format!(
            "{path} is a protocol of several studies; run it with `calib validity {path}`"
        )));
    }
    // Typed parsing finds unknown keys and wrong types, with their positions in the text.
    of_text::<Study>(source)?;
    Ok(table)
}

/// Parses a text; an error gives the position of the mistake.
pub(crate) fn of_text<T: DeserializeOwned>(source: &StudyText) -> Result<T, StudyError> {
    toml::from_str(source.text()).map_err(|error| StudyError::Written {
        place: Box::new(source.place(error.span().unwrap_or(0..0))),
        message: friendly(error.message()),
    })
}
