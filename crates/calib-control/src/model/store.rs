//! Stores a model with actions in a folder: arrays that are mapped, and a record of the rest.

use std::{path::Path, sync::Arc};

use calib_core::{Segments, States, Transitions};
use calib_files::{FileError, MappedNpy, NpyElement, map_npy, write_npy};
use calib_knn::{Blocks, Weights};
use serde::{Deserialize, Serialize};

use super::{ActionModel, ActionModelConfig, ActionTable, Rules, Starts};
use crate::{ControlError, Decisions, Ending, Settings};

/// The data of a stored model that are not arrays.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ActionModelRecord {
    /// The configuration of the build.
    pub config: ActionModelConfig,
    /// Number of rows of each episode.
    pub episodes: Vec<usize>,
    /// Number of possible actions.
    pub levels: usize,
    /// Distance up to which a recorded transition covers a state; `None` if it is infinite, because no transition has a neighbour.
    pub radius: Option<f32>,
    /// The return with which an episode ends where the log does not cover a step.
    pub worst_return: f64,
    /// Whether distances are those of a representation instead of the states.
    pub has_metric: bool,
    /// Whether actions are continuous.
    pub has_settings: bool,
}

/// Writes the arrays of a model into a folder. Returns the names of the files, and the record to store beside them.
///
/// The files are `states.npy` `f32 [rows, d]`; `metric.npy` `f32`, one row per state, if distances are those of a representation;
/// `actions.npy` `u32 [t, 1]`, `rewards.npy` `f32 [t, 1]`, `terminals.npy` `u32 [t, 1]`; `starts.npy` and `starts-metric.npy` `f32 [s, d]`;
/// `set.npy` `f32 [rows, a]` and `levels.npy` `f32 [levels, a]`, if actions are continuous; for each ensemble member `neighbors-M.npy`
/// `u32 [t × levels, k]` and `distances-M.npy` `f32 [t × levels, k]`, and the same for starts.
///
/// # Errors
/// If a file cannot be written.
pub fn write_action_model(
    directory: &Path,
    model: &ActionModel,
    config: &ActionModelConfig,
) -> Result<(Vec<String>, ActionModelRecord), FileError> {
    let log = &model.log;
    let mut folder = Folder { directory, names: Vec::new() };
    folder.states("states.npy", log.states())?;
    let has_metric = model.metric.as_slice().as_ptr() != log.states().as_slice().as_ptr();
    if has_metric {
        folder.states("metric.npy", &model.metric)?;
        folder.states("starts-metric.npy", &model.starts.metric)?;
    }
    folder.states("starts.npy", &model.starts.observed)?;
    let actions: Vec<u32> = log.actions().iter().map(|&action| u32::from(action)).collect();
    folder.write("actions.npy", &actions, 1)?;
    folder.write("rewards.npy", log.rewards(), 1)?;
    let terminals: Vec<u32> =
        log.endings().iter().map(|&ending| u32::from(ending == Ending::Terminal)).collect();
    folder.write("terminals.npy", &terminals, 1)?;
    if let Some(settings) = log.settings() {
        folder.write("set.npy", settings.of_rows(), settings.columns())?;
        folder.write("levels.npy", settings.of_levels(), settings.columns())?;
    }
    for (kind, tables) in [("", &model.tables), ("starts-", &model.start_tables)] {
        for (member, table) in tables.iter().enumerate() {
            folder.write(&format!("{kind}neighbors-{member}.npy"), table.neighbors(), table.k())?;
            folder.write(&format!("{kind}distances-{member}.npy"), table.distances(), table.k())?;
        }
    }
    let record = ActionModelRecord {
        config: *config,
        episodes: log.transitions().segments().iter().map(calib_core::Segment::len).collect(),
        levels: log.levels(),
        radius: model.radius.is_finite().then_some(model.radius),
        worst_return: model.worst_return(),
        has_metric,
        has_settings: log.settings().is_some(),
    };
    Ok((folder.names, record))
}

/// Maps a model that [`write_action_model`] wrote. The files must be unchanged. Probabilities of actions are not stored.
///
/// # Errors
/// If a file cannot be read, or cannot belong to such a model.
pub fn open_action_model(
    directory: &Path,
    record: &ActionModelRecord,
) -> Result<ActionModel, ControlError> {
    record.config.check()?;
    let folder = Folder { directory, names: Vec::new() };
    let states = folder.mapped_states("states.npy")?;
    let transitions = Transitions::new(Segments::from_lengths(record.episodes.iter().copied())?);
    if transitions.segments().rows() != states.rows() {
        return Err(folder.damaged("states.npy"));
    }
    let count = transitions.len();
    let actions: MappedNpy<u32> = folder.map("actions.npy", count)?;
    let rewards: MappedNpy<f32> = folder.map("rewards.npy", count)?;
    let terminals: MappedNpy<u32> = folder.map("terminals.npy", count)?;
    if actions.as_slice().iter().any(|&action| action as usize >= record.levels) {
        return Err(folder.damaged("actions.npy"));
    }
    let endings = terminals.as_slice().iter().map(|&flag| Ending::terminal_if(flag != 0)).collect();
    let settings = if record.has_settings {
        let set: MappedNpy<f32> = folder.map("set.npy", states.rows())?;
        let levels: MappedNpy<f32> = folder.map("levels.npy", record.levels)?;
        if set.columns() != levels.columns() {
            return Err(folder.damaged("levels.npy"));
        }
        let set = set.as_slice().to_vec();
        let levels = levels.as_slice().to_vec();
        Some(Settings::from_parts(set, levels, record.levels))
    } else {
        None
    };
    let observed = folder.mapped_states("starts.npy")?;
    let (metric, metric_of_starts) = if record.has_metric {
        (folder.mapped_states("metric.npy")?, folder.mapped_states("starts-metric.npy")?)
    } else {
        (states.clone(), observed.clone())
    };
    if metric.rows() != states.rows()
        || metric_of_starts.rows() != observed.rows()
        || observed.rows() == 0
    {
        return Err(folder.damaged("starts.npy"));
    }
    let blocks = Blocks::new(&transitions, record.config.members)?;
    let log = Decisions::from_parts(
        states,
        transitions,
        actions.as_slice().iter().map(|&action| action as u16).collect(),
        rewards.as_slice().to_vec(),
        endings,
        settings,
        record.levels,
    );
    Ok(ActionModel {
        tables: folder.tables("", record, count, count)?,
        start_tables: folder.tables("starts-", record, observed.rows(), count)?,
        starts: Starts { observed, metric: metric_of_starts },
        metric,
        log,
        blocks,
        weights: Weights::Linear,
        action_weight: record.config.action_weight,
        rules: Rules { pessimism: record.config.pessimism, worst_return: record.worst_return },
        radius: record.radius.unwrap_or(f32::INFINITY),
    })
}

/// A folder for writing or reading arrays.
struct Folder<'a> {
    directory: &'a Path,
    /// Names of the written files.
    names: Vec<String>,
}

impl Folder<'_> {
    fn states(&mut self, name: &str, states: &States) -> Result<(), FileError> {
        self.write(name, states.as_slice(), states.columns())
    }

    fn write<T: NpyElement>(
        &mut self,
        name: &str,
        values: &[T],
        columns: usize,
    ) -> Result<(), FileError> {
        let rows = values.len().checked_div(columns).unwrap_or(0);
        write_npy(&self.directory.join(name), values, rows, columns)?;
        self.names.push(name.to_owned());
        Ok(())
    }

    fn map<T: NpyElement>(&self, name: &str, rows: usize) -> Result<MappedNpy<T>, ControlError> {
        let mapped = map_npy(&self.directory.join(name))?;
        if mapped.rows() == rows { Ok(mapped) } else { Err(self.damaged(name)) }
    }

    fn mapped_states(&self, name: &str) -> Result<States, ControlError> {
        let mapped = map_npy::<f32>(&self.directory.join(name))?;
        let rows = mapped.rows();
        let columns = mapped.columns();
        Ok(States::from_shared(Arc::new(mapped), rows, columns)?)
    }

    /// Returns the table of each ensemble member for `rows` states, in a model of `transitions` transitions.
    fn tables(
        &self,
        kind: &str,
        record: &ActionModelRecord,
        rows: usize,
        transitions: usize,
    ) -> Result<Vec<ActionTable>, ControlError> {
        (0..record.config.members)
            .map(|member| self.table(kind, member, rows, record.levels, transitions))
            .collect()
    }

    fn table(
        &self,
        kind: &str,
        member: usize,
        rows: usize,
        levels: usize,
        transitions: usize,
    ) -> Result<ActionTable, ControlError> {
        let name = format!("{kind}neighbors-{member}.npy");
        let neighbors: MappedNpy<u32> = self.map(&name, rows * levels)?;
        let far = format!("{kind}distances-{member}.npy");
        let distances: MappedNpy<f32> = self.map(&far, rows * levels)?;
        let k = neighbors.columns();
        let mut each = neighbors.as_slice().iter();
        if k == 0
            || !each.all(|&neighbor| neighbor == u32::MAX || (neighbor as usize) < transitions)
        {
            return Err(self.damaged(&name));
        }
        if distances.columns() != k {
            return Err(self.damaged(&far));
        }
        Ok(ActionTable::from_shared(levels, k, Arc::new(neighbors), Arc::new(distances)))
    }

    fn damaged(&self, name: &str) -> ControlError {
        ControlError::Damaged { path: self.directory.join(name) }
    }
}
