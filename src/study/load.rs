use std::{
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context as _, anyhow, bail, ensure};
use serde::{Deserialize as _, de::DeserializeOwned};
use toml::{Table, Value};

use calib_data::DataConfig;
use calib_files::{FileError, ScratchPlace, require_regular};

use super::{
    Study, StudyPaths,
    message::friendly,
    models,
    profiles::{self, Results},
    protocol,
};

/// What is looked at, of a study that has several.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Chosen<'a> {
    /// The `NAME` of `[profiles.NAME]`.
    pub(crate) profile: Option<&'a str>,
    /// The `NAME` of `[models.NAME]`.
    pub(crate) model: Option<&'a str>,
    /// The `NAME` of `[deployments.NAME]`.
    pub(crate) deployment: Option<&'a str>,
}

impl Study {
    /// Read the study file `path`, apply `overrides` (`section.key=value`) and what it says of what is `chosen`, check
    /// every section, and resolve relative paths against the file's directory.
    ///
    /// # Errors
    /// A file that cannot be read, a key that does not exist, a value that is not valid:
    /// each named with file, line and key.
    pub(crate) fn load(
        path: &Path,
        overrides: &[String],
        chosen: Chosen<'_>,
    ) -> anyhow::Result<(Self, StudyPaths)> {
        let (mut table, results) = read(path, overrides, chosen.profile)?;
        models::check(&table).with_context(|| path.display().to_string())?;
        models::choose(&mut table, chosen.model).with_context(|| path.display().to_string())?;
        let with = || with_overrides(path, overrides, chosen);
        let mut study = typed(table).with_context(with)?;
        // Empty for a bare file name, so that paths below it stay as short as they were written.
        let directory = path.parent().map(PathBuf::from).unwrap_or_default();
        study.check().with_context(with)?;
        study.choose_deployment(chosen.deployment).with_context(|| path.display().to_string())?;
        let stem = path.file_stem().map_or_else(|| "study".into(), |stem| stem.to_string_lossy());
        let output = study.output.clone().unwrap_or_else(|| format!("{stem}-results").into());
        let root = directory.join(output);
        let root = match (chosen.profile, results) {
            (Some(name), Results::InOwnFolder) => root.join(name),
            _ => root,
        };
        Ok((study, StudyPaths::new(path.to_owned(), root).of_profile(chosen.profile)))
    }

    /// Names of the models that the study compares, in alphabetical order; none if it has no `[models]`.
    ///
    /// # Errors
    /// As [`Study::load`].
    pub(crate) fn model_names(
        path: &Path,
        overrides: &[String],
        profile: Option<&str>,
    ) -> anyhow::Result<Vec<String>> {
        Ok(models::names(&read(path, overrides, profile)?.0))
    }

    /// The study that `table` is, with all its models, to be written to `path`.
    ///
    /// # Errors
    /// A key that does not exist, or a value that is not valid.
    pub(crate) fn of_table(path: &Path, table: Table) -> anyhow::Result<(Self, StudyPaths)> {
        models::check(&table)?;
        let study = typed(table)?;
        study.check()?;
        let root = path.with_extension("").display().to_string() + "-results";
        Ok((study, StudyPaths::new(path.to_owned(), root.into())))
    }

    /// A study of the log at `path` alone, with every other key at its default or as `overrides` say.
    ///
    /// # Errors
    /// A key that does not exist, or a value that is not valid.
    pub fn of_data(path: &Path, overrides: &[String]) -> anyhow::Result<Self> {
        let mut table = Table::new();
        for text in overrides {
            apply(&mut table, text)?;
        }
        let mut study =
            typed(table).with_context(|| format!("--set {}", overrides.join(" --set ")))?;
        study.data.path = path.to_owned().into();
        study.data.scratch = working_files();
        study.check()?;
        Ok(study)
    }

    /// Check what the types alone do not.
    fn check(&self) -> anyhow::Result<()> {
        self.data.check()?;
        self.check_simulate()?;
        self.check_deployments()?;
        self.preprocess.check()?;
        self.representation.check().context("[representation]")?;
        self.model.check().context("[model]")?;
        self.dynamics.check().context("[dynamics]")?;
        self.agent.check().context("[agent]")?;
        self.pretrain.check()?;
        // The upper ends are far beyond use; they turn a slip of the finger into a message.
        let counts = [
            ("sweep.steps", self.sweep.steps, 2, MANY_STEPS),
            ("sweep.member_runs", self.sweep.member_runs, 1, MANY_RUNS),
            ("sweep.network_runs", self.sweep.runs_of_network(), 1, MANY_RUNS),
            ("sweep.online_runs", self.sweep.online_runs, 1, MANY_RUNS),
            ("sweep.online_windows", self.sweep.online_windows, 1, MANY_RUNS),
            ("sweep.log_replay_runs", self.sweep.log_replay_runs, 0, MANY_RUNS),
            ("sweep.curve_points", self.sweep.curve_points, 0, MANY_RUNS),
            ("pretrain.epochs", self.pretrain.epochs, 0, MANY_RUNS),
            ("rollout.steps", self.rollout.steps, 1, MANY_STEPS),
            ("rollout.rollouts", self.rollout.rollouts, 1, MANY_RUNS),
            ("rollout.recent_window", self.rollout.recent_window.unwrap_or(1), 1, usize::MAX),
            ("evaluate.top_k", self.evaluate.top_k, 1, MANY_RUNS),
            ("evaluate.resamples", self.evaluate.resamples, 0, MANY_RUNS),
        ];
        for (key, got, least, most) in counts {
            ensure!(
                (least..=most).contains(&got),
                "{key} must be from {least} to {most}, got {got}"
            );
        }
        ensure!(
            self.rollout.steps.saturating_mul(self.rollout.rollouts) <= MANY_STEPS,
            "rollout.steps x rollout.rollouts must be at most {MANY_STEPS}, got {} x {}",
            self.rollout.steps,
            self.rollout.rollouts
        );
        let sensors = &self.sweep.sensors;
        if let Some(twice) =
            (1..sensors.len()).find(|&place| sensors[..place].contains(&sensors[place]))
        {
            bail!("sweep.sensors names {} twice; remove one", sensors[twice]);
        }
        Ok(())
    }

    /// The `[data]` section to read with: `${NAME}` is replaced by the environment variable's value, and
    /// relative paths start from the study file. The study itself keeps what was written, so that results
    /// do not depend on where it is run from.
    pub(crate) fn data_to_read(&self, paths: &StudyPaths) -> anyhow::Result<DataConfig> {
        let mut data = self.data.clone();
        for path in &mut data.path.0 {
            ensure!(!path.is_empty(), "{}: data.path is empty", paths.study().display());
            *path = expand(path).with_context(|| paths.study().display().to_string())?;
        }
        data.resolve(paths.study().parent().unwrap_or(Path::new("")));
        data.scratch = working_files();
        Ok(data)
    }
}

/// Where text files are kept, column by column, while they are read: the system's folder for temporary files.
pub(crate) fn working_files() -> ScratchPlace {
    ScratchPlace::Disk(std::env::temp_dir())
}

/// More runs or rollouts than anybody asks for.
const MANY_RUNS: usize = 100_000;

/// More steps than anybody asks for: three years at 1 Hz.
const MANY_STEPS: usize = 100_000_000;

/// The study file `path` as a table, with all its models and without its profiles.
pub(super) fn table_of(path: &Path) -> anyhow::Result<Table> {
    Ok(read(path, &[], None)?.0)
}

/// The study file as a table, with a profile and overrides, all models in it; and where its results go.
fn read(
    path: &Path,
    overrides: &[String],
    profile: Option<&str>,
) -> anyhow::Result<(Table, Results)> {
    let text = match require_regular(path) {
        Err(FileError::Io { source, .. }) => Err(source),
        _ => fs::read_to_string(path),
    };
    let text = text.with_context(|| {
        format!(
            "cannot read the study {}; expected a TOML file such as configs/quickstart.toml",
            path.display()
        )
    })?;
    // The text is read for its own sake first, because only then a mistake has a line number.
    let mut table = parse(path, &text)?;
    profiles::check(&table, is_study).with_context(|| path.display().to_string())?;
    let results =
        profiles::choose(&mut table, profile).with_context(|| path.display().to_string())?;
    for text in overrides {
        apply(&mut table, text)?;
    }
    finite(&table, "").with_context(|| path.display().to_string())?;
    // Whoever names other data means these, and not a plant to write there.
    let names_data = |text: &&String| {
        let key = text.split('=').next().unwrap_or_default();
        matches!(key.trim(), "data" | "data.path")
    };
    if overrides.iter().any(|text| names_data(&text)) {
        table.remove("simulate");
    }
    Ok((table, results))
}

/// Refuse numbers that TOML has and nothing here can work with, nor JSON keep.
fn finite(table: &Table, section: &str) -> anyhow::Result<()> {
    fn check(key: &str, value: &Value) -> anyhow::Result<()> {
        match value {
            Value::Float(number) => {
                ensure!(number.is_finite(), "{key} = {number}: expected a finite number");
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

/// Whether a table has the keys and types of a study.
fn is_study(table: Table) -> anyhow::Result<()> {
    models::check(&table)?;
    typed(table)?;
    Ok(())
}

fn typed(table: Table) -> anyhow::Result<Study> {
    Study::deserialize(Value::Table(table)).map_err(|error| anyhow!("{}", located(&error)))
}

fn parse(path: &Path, text: &str) -> anyhow::Result<Table> {
    let table: Table = of_text(path, text)?;
    if table.contains_key(protocol::KEY) {
        bail!(
            "{} is a protocol of several studies; run it with `calib validity {}`",
            path.display(),
            path.display()
        );
    }
    // The typed reading finds unknown keys and wrong types, with their place in the text.
    of_text::<Study>(path, text)?;
    Ok(table)
}

/// What the TOML `text` of the file `path` says; a mistake is named with its line.
pub(super) fn of_text<T: DeserializeOwned>(path: &Path, text: &str) -> anyhow::Result<T> {
    let place = |span: Option<std::ops::Range<usize>>| {
        let before = &text[..span.map_or(0, |span| span.start.min(text.len()))];
        let line = before.matches('\n').count() + 1;
        let column = before.chars().rev().take_while(|&character| character != '\n').count() + 1;
        format!("{}:{line}:{column}", path.display())
    };
    toml::from_str(text)
        .map_err(|error| anyhow!("{}: {}", place(error.span()), friendly(error.message())))
}

/// Apply one `section.key=value`; the value is TOML, or else plain text.
pub(super) fn apply(table: &mut Table, text: &str) -> anyhow::Result<()> {
    let expected = "expected section.key=value, such as agent.gamma=0.9";
    let (keys, value) =
        text.split_once('=').with_context(|| format!("--set {text}: {expected}"))?;
    let value = value.trim();
    let parsed = toml::from_str::<Table>(&format!("value = {value}"))
        .ok()
        .and_then(|mut parsed| parsed.remove("value"))
        .map_or_else(|| plain_text(text, value), Ok)?;
    let keys: Vec<&str> = keys.trim().split('.').map(str::trim).collect();
    let (last, sections) =
        keys.split_last().with_context(|| format!("--set {text}: {expected}"))?;
    if keys.iter().any(|key| key.is_empty()) {
        bail!("--set {text}: {expected}");
    }
    let mut place = table;
    for section in sections {
        let entry = place.entry(*section).or_insert_with(|| Value::Table(Table::new()));
        place = entry
            .as_table_mut()
            .with_context(|| format!("--set {text}: `{section}` is a value, not a section"))?;
    }
    place.insert((*last).to_owned(), parsed);
    Ok(())
}

/// A value that is not TOML is plain text, unless it was clearly meant to be TOML.
fn plain_text(text: &str, value: &str) -> anyhow::Result<Value> {
    ensure!(
        !value.starts_with(['[', '{', '"', '\''])
            && !value.starts_with(|first: char| first.is_ascii_digit()),
        "--set {text}: `{value}` is not a TOML value: a number, \"text\", [list], {{ table }} or date"
    );
    Ok(Value::String(value.to_owned()))
}

fn with_overrides(path: &Path, overrides: &[String], chosen: Chosen<'_>) -> String {
    let profile = chosen.profile.map(|name| format!("--profile {name}"));
    let model = chosen.model.map(|name| format!("--model {name}"));
    let deployment = chosen.deployment.map(|name| format!("--deployment {name}"));
    let set = overrides.iter().map(|text| format!("--set {text}"));
    let set = profile.into_iter().chain(set).chain(model).chain(deployment);
    let set: Vec<String> = set.collect();
    match set.as_slice() {
        [] => path.display().to_string(),
        set => format!("{} with {}", path.display(), set.join(" ")),
    }
}

/// The message of an error in a table, with the key that it is about.
fn located(error: &toml::de::Error) -> String {
    let text = error.to_string();
    let key = text.lines().find_map(|line| line.trim().strip_prefix("in `"));
    let message = friendly(error.message());
    match key {
        Some(key) => format!("{}: {message}", key.trim_end_matches('`')),
        None => message,
    }
}

/// A variable of the environment that a path names, and that is not set.
#[derive(Debug, thiserror::Error)]
#[error(
    "data.path = \"{path}\": the environment variable {name} is not set; \
     set it to the folder of the data, or say --set data.path=FOLDER"
)]
pub(crate) struct UnsetVariable {
    path: String,
    /// Its name.
    pub(crate) name: String,
}

fn expand(text: &str) -> anyhow::Result<String> {
    let Some(start) = text.find("${") else { return Ok(text.to_owned()) };
    let Some(length) = text[start..].find('}') else {
        bail!("data.path = \"{text}\": `${{` without `}}`");
    };
    let name = &text[start + 2..start + length];
    let value = std::env::var(name)
        .map_err(|_| UnsetVariable { path: text.to_owned(), name: name.to_owned() })?;
    Ok(format!("{}{value}{}", &text[..start], expand(&text[start + length + 1..])?))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn load(text: &str, overrides: &[&str]) -> anyhow::Result<(Study, StudyPaths)> {
        let directory = tempfile::tempdir()?;
        let path = directory.path().join("study.toml");
        fs::write(&path, text)?;
        let overrides: Vec<String> = overrides.iter().map(|&text| text.to_owned()).collect();
        Study::load(&path, &overrides, Chosen::default())
    }

    #[test]
    fn overrides_win_and_may_be_any_toml_or_text() {
        let text = "seed = 1\n[data]\npath = \"logs\"\n[agent]\ngamma = 0.5\n";
        let set = ["agent.gamma=0.9", "sweep.sensors=[\"A\"]", "agent.optimiser=sgd", "seed=7"];
        let (study, paths) = load(text, &set).expect("valid");
        assert_eq!(study.seed, 7);
        assert!((study.agent.gamma - 0.9).abs() < 1e-12);
        assert_eq!(study.sweep.sensors, ["A"]);
        assert!(paths.root().ends_with("study-results"));
    }

    #[test]
    fn data_is_found_from_the_study_file_and_the_environment() {
        let (study, paths) = load("[data]\npath = \"logs\"\n", &[]).expect("valid");
        assert_eq!(study.data.path.0, ["logs"], "the study keeps what was written");
        let data = study.data_to_read(&paths).expect("no variable");
        let directory = paths.study().parent().expect("absolute");
        assert_eq!(Path::new(&data.path.0[0]), directory.join("logs"));
        let (study, paths) = load("[data]\npath = \"${CALIB_NO_SUCH}/x\"\n", &[]).expect("valid");
        let error = format!("{:#}", study.data_to_read(&paths).expect_err("not set"));
        assert!(error.contains("CALIB_NO_SUCH is not set"), "{error}");
    }

    #[test]
    fn mistakes_name_file_line_and_nearest_key() {
        let of = |text: &str, set: &[&str]| format!("{:#}", load(text, set).expect_err("invalid"));
        let key = of("[agent]\nlearning_rat = 0.1\n", &[]);
        assert!(
            key.contains("study.toml:2:1") && key.contains("did you mean `learning_rate`"),
            "{key}"
        );
        let section = of("[agnt]\n", &[]);
        assert!(section.contains("did you mean `agent`"), "{section}");
        let set = of("", &["agent.gama=0.9"]);
        assert!(
            set.contains("--set agent.gama=0.9") && set.contains("did you mean `gamma`"),
            "{set}"
        );
        let form = of("", &["gamma"]);
        assert!(form.contains("expected section.key=value"), "{form}");
        let syntax = of("[agent\n", &[]);
        assert!(syntax.contains("study.toml:1:"), "{syntax}");
        let infinite = of("", &["model.temperature=inf"]);
        assert!(
            infinite.contains("model.temperature = inf: expected a finite number"),
            "{infinite}"
        );
        let list = of("[sweep.grid]\ngamma = [0.5, nan]\n", &[]);
        assert!(list.contains("sweep.grid.gamma = NaN"), "{list}");
        let range = of("[agent]\ngamma = 2.0\n", &[]);
        assert!(range.contains("gamma"), "{range}");
    }
}
