//! A protocol: the plants and tasks of several studies, drawn from one seed, named before any of them is run.

mod template;

use std::{
    collections::{BTreeMap, BTreeSet},
    fmt::Write as _,
    path::{Path, PathBuf},
};

use calib_core::Seed;
use calib_sweep::Axis;
use serde::Deserialize;
use toml::{Table, Value};

use crate::{
    Job, Request, SimulateConfig, Study, StudyError,
    error::{Problem, refuse, require},
    source::StudyText,
    toml_json::to_json,
    written,
};
use template::Template;

/// The section that makes a file a protocol.
pub(crate) const KEY: &str = "validity";

/// The `[validity]` section of a protocol.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Protocol {
    /// Root of all that is drawn (default 0).
    pub seed: u64,
    /// Whether rollouts are made and compared with what was recorded, and a report is written for every plant, beside the sweep
    /// that a choice needs (default: yes).
    pub rollouts: bool,
    /// The fewest held-out windows by which a plant is judged (default 2: one does not show how much windows differ).
    pub least_windows: usize,
    /// The plants.
    plants: Vec<Plants>,
    /// What is drawn for every plant.
    task: Draws,
}

impl Default for Protocol {
    fn default() -> Self {
        Self {
            seed: 0,
            rollouts: true,
            least_windows: 2,
            plants: Vec::new(),
            task: Draws::default(),
        }
    }
}

/// A `[[validity.plants]]`: plants that one study stands for.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Plants {
    /// The study, from the folder of the protocol.
    study: PathBuf,
    /// So many plants, each simulated anew (default: one, and its name has no number).
    repeat: Option<usize>,
    /// What is drawn for each of them, instead of what is drawn of the same key for every plant.
    #[serde(default)]
    draw: Table,
}

/// What is drawn.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Draws {
    /// Key of the study → list or range.
    draw: Table,
}

/// A study that a protocol draws.
#[derive(Clone, Debug, PartialEq)]
pub struct DrawnStudy {
    /// What the plant is called, and the file without `.toml`.
    pub plant: String,
    /// The study as it is to be written, with a comment of what was drawn.
    pub text: String,
}

/// More plants than anybody runs.
const MANY_PLANTS: usize = 10_000;

impl Protocol {
    /// The protocol that the file `path` is; none if it is something else.
    ///
    /// # Errors
    /// A key that does not exist or a value that is not valid, with its line.
    pub fn find(path: &Path) -> Result<Option<Self>, StudyError> {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct File {
            validity: Protocol,
        }
        // What cannot be read, or is no TOML, is told of when it is read as a study.
        let Ok(text) = written::text_of(path) else { return Ok(None) };
        if !toml::from_str::<Table>(&text).is_ok_and(|table| table.contains_key(KEY)) {
            return Ok(None);
        }
        let File { validity } = written::of_text(&StudyText::new(path, text))?;
        validity.check().map_err(|problem| given(path, &problem))?;
        Ok(Some(validity))
    }

    fn check(&self) -> Result<(), Problem> {
        require!(
            !self.plants.is_empty(),
            "a protocol wants plants; add [[validity.plants]] with study = \"FILE.toml\""
        );
        require!(self.least_windows > 0, "validity.least_windows must be at least 1, got 0");
        let repeats = self.plants.iter().filter_map(|repeat| repeat.repeat);
        if let Some(got) = repeats.into_iter().find(|repeat| !(1..=MANY_PLANTS).contains(repeat)) {
            refuse!("validity.plants.repeat must be from 1 to {MANY_PLANTS}, got {got}");
        }
        Ok(())
    }

    /// The studies that this protocol, the file `path`, stands for, to be written to `folder`, with `overrides` over what is drawn.
    /// Every value follows from the protocol's seed, the name and number of the plant, and the key alone.
    ///
    /// # Errors
    /// A study that cannot be read, a key that cannot be drawn, plants of one name.
    pub fn draw(
        &self,
        path: &Path,
        folder: &Path,
        overrides: &[String],
    ) -> Result<Vec<DrawnStudy>, StudyError> {
        self.drawn(path, folder, overrides).map_err(|problem| given(path, &problem))
    }

    fn drawn(
        &self,
        path: &Path,
        folder: &Path,
        overrides: &[String],
    ) -> Result<Vec<DrawnStudy>, Problem> {
        let defaults = defaults()?;
        let task = axes(&self.task.draw).map_err(|problem| problem.within("validity.task.draw"))?;
        let mut all: Vec<DrawnStudy> = Vec::new();
        for plants in &self.plants {
            let template = Template::read(path, plants, folder)?;
            let mut own = task.clone();
            let of_plants =
                axes(&plants.draw).map_err(|problem| problem.within("validity.plants.draw"))?;
            let from_plants: BTreeSet<String> = of_plants.keys().cloned().collect();
            own.extend(of_plants);
            for number in 1..=plants.repeat.unwrap_or(1) {
                let seed = Seed::new(self.seed).child("validity").child(&template.name);
                let seed = seed.number(number as u64);
                let values = template.values(&own, seed, &defaults, |key| {
                    let own = if from_plants.contains(key) { "plants" } else { "task" };
                    format!("[validity.{own}.draw] of {}", template.name)
                })?;
                let plant = match plants.repeat {
                    Some(_) => format!("{}-{number:02}", template.name),
                    None => template.name.clone(),
                };
                require!(
                    all.iter().all(|other| other.plant != plant),
                    "two plants are called {plant}; rename one of the studies, or give repeat to one entry"
                );
                let table = template.with(&plant, &values, overrides)?;
                let text = text(path, self.seed, &template, &values, &table)?;
                all.push(DrawnStudy { plant, text });
            }
        }
        Ok(all)
    }
}

/// What is wrong with a protocol.
fn given(path: &Path, problem: &Problem) -> StudyError {
    StudyError::Given { study: path.display().to_string(), message: problem.to_string() }
}

impl DrawnStudy {
    /// The study, as it will be in `folder`.
    ///
    /// # Errors
    /// A key that does not exist, or a value that is not valid.
    pub fn job(&self, folder: &Path) -> Result<Job, StudyError> {
        let request = Request::new(folder.join(format!("{}.toml", self.plant)));
        Job::of_text(request, self.text.clone()).map_err(|source| StudyError::Drawn {
            plant: self.plant.clone(),
            source: Box::new(source),
        })
    }
}

/// Every key of a study with its default, as far as it has one.
fn defaults() -> Result<serde_json::Value, Problem> {
    let simulate = Some(SimulateConfig::default());
    Ok(serde_json::to_value(Study { simulate, ..Study::default() })?)
}

/// The lists and ranges of a section, by the keys of the study: `"agent.gamma" = …` and `[… .agent] gamma = …` mean the same.
fn axes(draws: &Table) -> Result<BTreeMap<String, Axis>, Problem> {
    let mut axes = BTreeMap::new();
    let mut pending: Vec<(String, &Table)> = vec![(String::new(), draws)];
    while let Some((section, draws)) = pending.pop() {
        for (key, value) in draws {
            let key = if section.is_empty() { key.clone() } else { format!("{section}.{key}") };
            match value {
                Value::Table(inner) if !inner.contains_key("from") && !inner.is_empty() => {
                    pending.push((key, inner));
                }
                value => {
                    let axis = Axis::deserialize(to_json(value));
                    let axis = axis.map_err(|error| Problem::from(error).after(&key))?;
                    axes.insert(key, axis);
                }
            }
        }
    }
    Ok(axes)
}

/// The file of a drawn study.
fn text(
    protocol: &Path,
    seed: u64,
    template: &Template,
    values: &BTreeMap<String, Value>,
    table: &Table,
) -> Result<String, Problem> {
    let name = protocol.file_name().unwrap_or_default().to_string_lossy();
    let mut text = format!(
        "# Drawn from {} by `calib validity {name}` with the seed {seed}:\n#\n",
        template.file.display()
    );
    for (key, value) in values {
        writeln!(text, "#     {key} = {value}")?;
    }
    text += "#\n# Written anew where the protocol draws otherwise: change that, or a copy of this file.\n\n";
    Ok(text + &toml::to_string(table)?)
}

#[cfg(test)]
mod tests;
