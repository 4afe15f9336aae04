use calib_core::{Monitor, States, TransitionIndex};
use calib_files::ScratchPlace;
use calib_knn::{Blocks, Exclusion, IndexKind, NeighborLists, Planned, Queries, Sources, Weights};

use super::{
    ActionModel, ActionModelConfig, ActionTable, FillingTable, Rules, Starts,
    radius::{ActionLists, Outside},
};
use crate::{ControlError, Decisions};

/// Queries per thread that one search for all actions has at least: two bands of the join.
const QUERIES_PER_THREAD: usize = 2_048;

/// Returns the neighbours per state: at most one per transition.
fn neighbors(log: &Decisions, config: &ActionModelConfig) -> usize {
    config.neighbors.min(log.len())
}

impl ActionModel {
    /// Returns the memory of a model's tables in bytes. `starts` is the number of start states.
    pub fn bytes(log: &Decisions, starts: usize, config: &ActionModelConfig) -> u64 {
        let lists = log.len().saturating_add(starts).saturating_mul(log.levels());
        lists_bytes(lists, log, config)
    }

    /// Returns the memory of a build in bytes: the tables, and the lists that one search finds on the threads of this pool.
    pub fn build_bytes(log: &Decisions, starts: usize, config: &ActionModelConfig) -> u64 {
        let queries = log.len().max(starts);
        let lists = if log.settings().is_some() {
            queries
        } else {
            let most = searched_together(queries, log.levels()).min(queries);
            most.saturating_mul(log.levels())
        };
        Self::bytes(log, starts, config).saturating_add(lists_bytes(lists, log, config))
    }

    /// Builds the model of `log`. Distances are those of `metric`, `[rows, d]`: the states, or their representation.
    ///
    /// A table is `[transitions, actions, k]`, so a step needs no search. One search finds the neighbours among the transitions with each
    /// action. For continuous actions, one search per level finds the neighbours of a state with that level. Episodes begin in one of
    /// `starts`, chosen uniformly.
    ///
    /// # Errors
    /// If a field is not valid, there are no starts, the numbers of rows or columns disagree, or the monitor interrupts.
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
        let k = neighbors(&log, config);
        let mut tables = Vec::new();
        let mut start_tables = Vec::new();
        for _ in 0..config.members {
            tables.push(FillingTable::new(log.len(), log.levels(), k));
            start_tables.push(FillingTable::new(starts.metric.rows(), log.levels(), k));
        }
        let mut filling = FillingTables { k, tables: &mut tables, start_tables: &mut start_tables };
        let radius = match log.settings() {
            None => {
                let sources = Sources::new(metric, log.transitions(), &blocks)?;
                let outside = filling.of_actions(&sources, &log, &starts.metric, monitor)?;
                outside.radius(config.coverage)?
            }
            Some(settings) => {
                let weight = config.action_weight;
                let taken = settings.taken(metric, weight)?;
                let sources = Sources::new(&taken, log.transitions(), &blocks)?;
                let next = log.next_states(metric)?;
                for level in 0..log.levels() {
                    let [next, starts] = [&next, &starts.metric]
                        .map(|metric| settings.at_level(metric, level, weight));
                    filling.of_level(&sources, level, [&next?, &starts?], monitor)?;
                }
                Outside::all(sources, None, monitor)?.radius(config.coverage)?
            }
        };
        Ok(Self {
            log,
            blocks,
            metric: metric.clone(),
            starts,
            tables: finished(tables),
            start_tables: finished(start_tables),
            weights: Weights::Linear,
            action_weight: config.action_weight,
            rules: Rules { pessimism: config.pessimism, worst_return },
            radius,
        })
    }

    /// Returns the blocks of the log, and so the transitions of each ensemble member.
    pub fn blocks(&self) -> &Blocks {
        &self.blocks
    }
}

/// Returns the bytes of this many lists in every ensemble member.
fn lists_bytes(lists: usize, log: &Decisions, config: &ActionModelConfig) -> u64 {
    let entry = size_of::<u32>() + size_of::<f32>();
    [lists, neighbors(log, config), config.members, entry]
        .into_iter()
        .fold(1, |product, factor| product.saturating_mul(factor as u64))
}

/// Returns how many of `queries` are searched together for all actions. Their lists take no more memory than those of one action for all
/// queries, unless some threads would then have nothing to search.
fn searched_together(queries: usize, actions: usize) -> usize {
    let busy = rayon::current_num_threads().saturating_mul(QUERIES_PER_THREAD);
    queries.div_ceil(actions).max(busy)
}

fn finished(tables: Vec<FillingTable>) -> Vec<ActionTable> {
    tables.into_iter().map(FillingTable::finished).collect()
}

/// The tables of a model during the build, one per ensemble member.
struct FillingTables<'a> {
    k: usize,
    tables: &'a mut [FillingTable],
    start_tables: &'a mut [FillingTable],
}

impl FillingTables<'_> {
    /// Fills the lists of every action from the transitions with that action. Returns the distances for the radius of coverage.
    fn of_actions<'a>(
        &mut self,
        sources: &Sources<'a>,
        log: &'a Decisions,
        starts: &States,
        monitor: &dyn Monitor,
    ) -> Result<Outside<'a>, ControlError> {
        let sources = sources.by_class(log.actions(), log.levels());
        let next =
            Queries::next_states(&sources, Exclusion::default()).with_nearest_outside_block();
        let place = ScratchPlace::Memory;
        let planned = sources.index(IndexKind::Auto, &next, self.k, &place, monitor)?;
        let mut outside = Outside::new(sources, log);
        let members = sources.blocks().members();
        let search =
            Search { planned: &planned, k: self.k, actions: log.levels(), members, monitor };
        let blocks = sources.blocks();
        search.each(&next, &planned.order, |query, lists| {
            let transition = TransitionIndex(query);
            outside.add_next_of(transition, lists);
            for (member, table) in self.tables.iter_mut().enumerate() {
                if blocks.contains(member, transition) {
                    table.put_all(query as usize, |action| lists.list(action, member));
                }
            }
        })?;
        let starts = Queries::external(&sources, starts, None)?;
        search.each(&starts, &planned.index.order(&starts), |query, lists| {
            for (member, table) in self.start_tables.iter_mut().enumerate() {
                table.put_all(query as usize, |action| lists.list(action, member));
            }
        })?;
        outside.add_others(&*planned.index, monitor)?;
        Ok(outside)
    }

    /// Fills the lists of one level from all transitions. `sources` and both queries have the action as further columns.
    fn of_level(
        &mut self,
        sources: &Sources<'_>,
        level: usize,
        [next, starts]: [&States; 2],
        monitor: &dyn Monitor,
    ) -> Result<(), ControlError> {
        let next = Queries::external(sources, next, None)?;
        fill_level(sources, &next, self.k, level, self.tables, monitor)?;
        let starts = Queries::external(sources, starts, None)?;
        fill_level(sources, &starts, self.k, level, self.start_tables, monitor)
    }
}

/// A search for the lists of all actions.
struct Search<'a> {
    planned: &'a Planned<'a>,
    k: usize,
    actions: usize,
    members: usize,
    monitor: &'a dyn Monitor,
}

impl Search<'_> {
    /// Calls `each` with every query of `order` and its lists.
    fn each(
        &self,
        queries: &Queries<'_>,
        order: &[u32],
        mut each: impl FnMut(u32, ActionLists<'_>),
    ) -> Result<(), ControlError> {
        let Self { k, actions, members, monitor, .. } = *self;
        monitor.begin("neighbours of all actions", order.len() as u64);
        for order in order.chunks(searched_together(order.len(), actions)) {
            let mut found = NeighborLists::new(order.len(), actions * members, k);
            self.planned.index.search(queries, order, &mut found, monitor)?;
            for (at, &query) in order.iter().enumerate() {
                each(query, ActionLists { found: &found, at, members });
            }
        }
        Ok(())
    }
}

/// Finds the lists of all queries for one level, and writes them to the tables of the ensemble members.
fn fill_level(
    sources: &Sources<'_>,
    queries: &Queries<'_>,
    k: usize,
    action: usize,
    tables: &mut [FillingTable],
    monitor: &dyn Monitor,
) -> Result<(), ControlError> {
    let place = ScratchPlace::Memory;
    let planned = sources.index(IndexKind::Auto, queries, k, &place, monitor)?;
    let mut found = NeighborLists::new(planned.order.len(), tables.len(), k);
    monitor.begin("neighbours of an action", planned.order.len() as u64);
    planned.index.search(queries, &planned.order, &mut found, monitor)?;
    for (at, &query) in planned.order.iter().enumerate() {
        for (member, table) in tables.iter_mut().enumerate() {
            table.put(query as usize, action, found.list(at, member));
        }
    }
    Ok(())
}
