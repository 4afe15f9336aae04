//! A protocol: the plants and tasks of several studies, drawn from one seed and named before any study runs.

mod plants;
mod template;

use std::{
    collections::{BTreeMap, BTreeSet},
    fmt::Write as _,
    path::Path,
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
    written::{self, PROTOCOL_KEY},
};
use plants::Plants;
use template::Template;

/// The `[validity]` section of a protocol.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Protocol {
    /// Root seed of all draws (default 0).
    pub seed: u64,
    /// Whether each plant also gets rollouts, compared with the record, and a report (default: yes).
    /// The choice itself needs only the sweep.
    pub rollouts: bool,
    /// Fewest held-out windows for judging a plant (default 2: one window does not show how much windows differ).
    pub least_windows: usize,
    /// The plants.
    plants: Vec<Plants>,
    /// Keys that are drawn for every plant.
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

/// Keys to draw.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Draws {
    /// Maps a key of the study to its list or range.
    draw: Table,
}

/// A study drawn from a protocol.
#[derive(Clone, Debug, PartialEq)]
pub struct DrawnStudy {
    /// Name of the plant, and of the file without `.toml`.
    pub plant: String,
    /// Text of the study, with a comment that lists the drawn values.
    pub text: String,
}

/// Upper limit for the number of plants, far above any practical use.
const MANY_PLANTS: usize = 10_000;

impl Protocol {
    /// Reads the protocol in the file `path`; `None` if the file is not a protocol.
    ///
    /// # Errors
    /// If a key does not exist or a value is not valid. The error gives the line.
    pub fn find(path: &Path) -> Result<Option<Self>, StudyError> {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct File {
            validity: Protocol,
        }
        // Reading the file as a study reports files that cannot be read or are not TOML.
        let Ok(text) = written::text_of(path) else { return Ok(None) };
        if !toml::from_str::<Table>(&text).is_ok_and(|table| table.contains_key(PROTOCOL_KEY)) {
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

    /// Returns the studies of this protocol, which is the file `path`, for the folder `folder`. `overrides` replace drawn values.
    /// A value depends only on the protocol's seed, the name and number of the plant, and the key.
    ///
    /// # Errors
    /// If a study cannot be read, a key cannot be drawn, or two plants have the same name.
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

/// Returns the error for a problem in a protocol.
fn given(path: &Path, problem: &Problem) -> StudyError {
    StudyError::Given { study: path.display().to_string(), message: problem.to_string() }
}

impl DrawnStudy {
    /// Resolves the study as a file in `folder`.
    ///
    /// # Errors
    /// If a key does not exist, or a value is not valid.
    pub fn job(&self, folder: &Path) -> Result<Job, StudyError> {
        let request = Request::new(folder.join(format!("{}.toml", self.plant)));
        Job::of_text(request, self.text.clone()).map_err(|source| StudyError::Drawn {
            plant: self.plant.clone(),
            source: Box::new(source),
        })
    }
}

/// Returns the defaults of all keys of a study that have one.
fn defaults() -> Result<serde_json::Value, Problem> {
    let simulate = Some(SimulateConfig::default());
    Ok(serde_json::to_value(Study { simulate, ..Study::default() })?)
}

/// Returns the lists and ranges of a section by study key. `"agent.gamma" = …` and `[… .agent] gamma = …` mean the same.
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

/// Returns the text of the file of a drawn study.
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
