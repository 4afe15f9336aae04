use calib_core::{Monitor, States};
use calib_files::ScratchPlace;
use calib_knn::{Blocks, Found, IndexKind, Queries, Sources, Weights};

use super::{ActionModel, ActionModelConfig, ActionTable, Starts, radius};
use crate::{ControlError, Decisions};

impl ActionModel {
    /// Build the model of `log`, whose distances are those of `metric`, `[rows, d]`: the states, or their representation.
    ///
    /// The search is the one of models without actions, once an action, among the transitions that have it; a table is
    /// `[transitions, actions, k]`, and a step does not search. Episodes begin in one of `starts`, each as likely.
    ///
    /// # Errors
    /// If a field cannot be what it is, there are no starts, the numbers of rows or columns disagree, or the monitor interrupts.
    pub fn build(
        log: Decisions,
        metric: &States,
        starts: Starts,
        config: &ActionModelConfig,
        worst_return: f64,
        monitor: &dyn Monitor,
    ) -> Result<Self, ControlError> {
        config.check()?;
        if starts.observed.rows() == 0 || starts.observed.rows() != starts.metric.rows() {
            return Err(ControlError::NoStarts);
        }
        let blocks = Blocks::new(log.transitions(), config.members)?;
        let sources = Sources::new(metric, log.transitions(), &blocks)?;
        let k = config.neighbors;
        let (mut tables, mut start_tables) = (Vec::new(), Vec::new());
        for _ in 0..config.members {
            tables.push(ActionTable::new(log.len(), log.levels(), k));
            start_tables.push(ActionTable::new(starts.metric.rows(), log.levels(), k));
        }
        for action in 0..log.levels() {
            let chosen = log.with_action(action);
            if chosen.is_empty() {
                continue;
            }
            let among = sources.among(&chosen);
            let next = Queries::next_states(&among, calib_knn::Exclusion::default());
            fill(&among, &next, k, action, &mut tables, monitor)?;
            let from_start = Queries::external(&among, &starts.metric, None)?;
            fill(&among, &from_start, k, action, &mut start_tables, monitor)?;
        }
        let radius = radius::radius(&sources, &log, config.coverage, monitor)?;
        let (weights, pessimism) = (Weights::Linear, config.pessimism);
        let starts = starts.observed;
        Ok(Self {
            log,
            blocks,
            starts,
            tables,
            start_tables,
            weights,
            pessimism,
            radius,
            worst_return,
        })
    }

    /// Which transitions each member has.
    pub fn blocks(&self) -> &Blocks {
        &self.blocks
    }
}

/// Find the lists of all queries for one action and put them in the tables of the members.
fn fill(
    sources: &Sources<'_>,
    queries: &Queries<'_>,
    k: usize,
    action: usize,
    tables: &mut [ActionTable],
    monitor: &dyn Monitor,
) -> Result<(), ControlError> {
    let place = ScratchPlace::Memory;
    let planned = sources.index(IndexKind::Auto, queries, k, &place, monitor)?;
    let mut found = Found::new(planned.order.len(), tables.len(), k);
    monitor.begin("neighbours of an action", planned.order.len() as u64);
    planned.index.search(queries, &planned.order, &mut found, monitor)?;
    for (at, &query) in planned.order.iter().enumerate() {
        for (member, table) in tables.iter_mut().enumerate() {
            table.put(query as usize, action, found.list(at, member));
        }
    }
    Ok(())
}
