use std::{collections::BTreeMap, path::Path};

use calib_core::{Monitor, Rng, States, TransitionIndex, Transitions};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{
    Blocks, Ends, Exclusion, IndexChoice, KdTree, KnnError, LeftOut, NeighborTable, PrototypeKind,
    Recurrence, Weights, Workplace,
    bits::Bits,
    candidates::Candidates,
    components::leading_components,
    index::Sources,
    open_table,
    prototypes::covering,
    recurrence::TableSearch,
    store::{open_left_out, write_left_out},
    table::{check_candidates, find_tables, finished},
    write_table,
};

/// A neighbour of a state, with its distance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Neighbor {
    /// The transition whose source is near the state.
    pub transition: TransitionIndex,
    /// Euclidean distance between source and state, in the metric of the model.
    pub distance: f32,
}

/// The ensemble of neighbour models, with one table per member.
#[derive(Clone, Debug)]
pub struct KnnModel {
    states: States,
    transitions: Transitions,
    blocks: Blocks,
    tables: Vec<NeighborTable>,
    left_out: Vec<LeftOut>,
    exclusion: Exclusion,
}

/// Information about how a model was built.
#[derive(Clone, Debug)]
pub struct Built {
    /// The search structure, and why it was chosen.
    pub choice: IndexChoice,
    /// For each member: the traps, and how they were removed.
    pub recurrence: Vec<Recurrence>,
    /// For each member: where rollouts end.
    pub ends: Vec<Ends>,
}

impl KnnModel {
    /// Builds the model: splits into blocks, searches, and stores the tables.
    ///
    /// Distances are measured in `states`: the normalised states, or their representation.
    ///
    /// # Errors
    /// As [`build_in`](Self::build_in).
    pub fn build(
        states: States,
        transitions: Transitions,
        config: &crate::ModelConfig,
        monitor: &dyn Monitor,
    ) -> Result<Self, KnnError> {
        Self::build_in(states, transitions, config, &Workplace::default(), monitor)
            .map(|(model, _)| model)
    }

    /// Builds the model as [`build`](Self::build), in `workplace`. Also returns how it was built.
    ///
    /// # Errors
    /// As [`Blocks::new`] and [`build_tables`](crate::build_tables), or if a file cannot be written.
    pub fn build_in(
        states: States,
        transitions: Transitions,
        config: &crate::ModelConfig,
        workplace: &Workplace,
        monitor: &dyn Monitor,
    ) -> Result<(Self, Built), KnnError> {
        Self::check(Some(states.columns()), &transitions, config)?;
        let blocks = Blocks::new(&transitions, config.members)?;
        let exclusion = config.exclusion();
        let shortcuts = config.shortcuts();
        let reduced = (shortcuts.components > 0)
            .then(|| leading_components(&states, shortcuts.components, monitor))
            .transpose()?;
        let sources = Sources::new(reduced.as_ref().unwrap_or(&states), &transitions, &blocks)?;
        let sources = Sources { measured: reduced.as_ref().map(|_| &states), ..sources };
        let chosen = match shortcuts.prototype_kind {
            PrototypeKind::KCentre if shortcuts.prototypes > 1 => {
                Some(covering(&sources, shortcuts.prototypes, monitor)?)
            }
            _ => None,
        };
        let candidates =
            chosen.as_deref().map_or(Candidates::Every(shortcuts.prototypes), Candidates::Chosen);
        let sources = Sources { candidates, leaf_budget: shortcuts.leaf_budget, ..sources };
        let k = config.neighbors;
        let weights = config.weights()?;
        let (mut tables, planned) =
            find_tables(&sources, k, exclusion, config.index, workplace, monitor)?;
        let place = &workplace.scratch;
        let planned_by = &planned;
        let sources = &sources;
        let search =
            TableSearch { planned: planned_by, sources, k, exclusion, weights, place, monitor };
        let members = if config.remove_traps {
            search.without_traps(&mut tables)
        } else {
            search.as_found(&tables)
        };
        let mut built = Built { choice: planned.choice, recurrence: Vec::new(), ends: Vec::new() };
        let mut left_out = Vec::new();
        for member in members? {
            left_out.push(member.left_out);
            built.recurrence.push(member.recurrence);
            built.ends.push(member.ends);
        }
        drop(planned);
        let tables = finished(tables, k);
        Ok((Self { states, transitions, blocks, tables, left_out, exclusion }, built))
    }

    /// Checks, before any search, that a model can be built of states with `columns` columns. If `columns` is unknown, the checks
    /// that depend on it are skipped.
    ///
    /// # Errors
    /// As [`ModelConfig::check`](crate::ModelConfig::check) and [`Blocks::new`]; if there are not fewer components than columns, the
    /// k-d tree is asked for more columns than it supports, or some query has too few candidates. The number of prototypes that
    /// cover the states is estimated.
    pub fn check(
        columns: Option<usize>,
        transitions: &Transitions,
        config: &crate::ModelConfig,
    ) -> Result<(), KnnError> {
        config.check()?;
        let components = config.components;
        if let Some(columns) = columns.filter(|&columns| components > 0 && components >= columns) {
            return Err(KnnError::Components { components, columns });
        }
        let searched = if components > 0 { Some(components) } else { columns };
        if let Some(columns) = searched.filter(|&columns| !config.index.supports(columns)) {
            return Err(KnnError::Dimensions { columns, max: KdTree::MAX_COLUMNS });
        }
        let blocks = Blocks::new(transitions, config.members)?;
        let candidates = Candidates::Every(config.prototypes);
        check_candidates(transitions, &blocks, candidates, config.neighbors, config.exclusion())
    }

    /// Writes `members/0/neighbors.npy`, `members/0/distances.npy`, `members/0/left_out.npy` and so on in `directory`.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn write_members(&self, directory: &Path) -> Result<(), KnnError> {
        for (member, table) in self.tables.iter().enumerate() {
            let directory = member_directory(directory, member);
            write_table(&directory, table)?;
            write_left_out(&directory, &self.left_out[member])?;
        }
        Ok(())
    }

    /// Opens the members that [`write_members`](Self::write_members) wrote. Tables are mapped and checked.
    ///
    /// # Errors
    /// If the blocks cannot be made, or a table is missing, damaged or of another model.
    pub fn open(
        directory: &Path,
        states: States,
        transitions: Transitions,
        members: usize,
        exclusion: Exclusion,
    ) -> Result<Self, KnnError> {
        let all: Vec<usize> = (0..members).collect();
        Self::open_some(directory, states, transitions, members, exclusion, &all)
    }

    /// Opens only the members in `opened`, as [`open`](Self::open). The others may be missing, and have empty tables.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    ///
    /// # Panics
    /// If `opened` is empty.
    pub fn open_some(
        directory: &Path,
        states: States,
        transitions: Transitions,
        members: usize,
        exclusion: Exclusion,
        opened: &[usize],
    ) -> Result<Self, KnnError> {
        let blocks = Blocks::new(&transitions, members)?;
        Sources::new(&states, &transitions, &blocks)?;
        let mut found: BTreeMap<usize, NeighborTable> = BTreeMap::new();
        for &member in opened {
            let table = open_table(&member_directory(directory, member), &blocks, member)?;
            found.insert(member, table);
        }
        let (first, k) = found
            .first_key_value()
            .map(|(member, table)| (*member, table.k()))
            .expect("at least one member is opened");
        if let Some((&member, table)) = found.iter().find(|(_, table)| table.k() != k) {
            let reason = format!("it has {} neighbours a row, member {first} has {k}", table.k());
            return Err(KnnError::Table { member, reason });
        }
        let tables: Vec<NeighborTable> = (0..members)
            .map(|member| found.remove(&member).unwrap_or_else(|| NeighborTable::empty(k)))
            .collect();
        let left_out = (0..members)
            .map(|member: usize| {
                if !opened.contains(&member) {
                    return Ok(LeftOut::default());
                }
                let directory = member_directory(directory, member);
                open_left_out(&directory, &blocks, member, &tables[member])
            })
            .collect::<Result<_, _>>()?;
        Ok(Self { states, transitions, blocks, tables, left_out, exclusion })
    }

    /// Returns the states that distances are measured in.
    pub fn states(&self) -> &States {
        &self.states
    }

    /// Returns the transitions of the data.
    pub fn transitions(&self) -> &Transitions {
        &self.transitions
    }

    /// Returns the blocks: which member contains which transition.
    pub fn blocks(&self) -> &Blocks {
        &self.blocks
    }

    /// Returns the number of members.
    pub fn members(&self) -> usize {
        self.tables.len()
    }

    /// Returns the number of neighbours of each transition.
    pub fn k(&self) -> usize {
        self.tables[0].k()
    }

    /// Returns which sources may not be neighbours.
    pub fn exclusion(&self) -> Exclusion {
        self.exclusion
    }

    /// Returns the table of member `member`.
    pub fn table(&self, member: usize) -> &NeighborTable {
        &self.tables[member]
    }

    /// Returns the candidates that queries of member `member` do not find, so that no rollout is trapped.
    pub fn left_out(&self, member: usize) -> &LeftOut {
        &self.left_out[member]
    }

    /// Returns the candidates that are left out for all queries of each member.
    pub(crate) fn left_out_for_all(&self) -> Vec<Bits> {
        self.left_out.iter().map(|excluded| excluded.for_all().clone()).collect()
    }

    /// Returns member `member`.
    ///
    /// # Panics
    /// If there are not more than `member` members.
    pub fn member(&self, member: usize) -> Member<'_> {
        Member {
            model: self,
            number: member,
            k: self.k(),
            neighbors: self.tables[member].neighbors(),
            distances: self.tables[member].distances(),
        }
    }

    pub(crate) fn sources(&self) -> Sources<'_> {
        Sources::new(&self.states, &self.transitions, &self.blocks)
            .unwrap_or_else(|_| unreachable!("checked when the model was made"))
    }
}

fn member_directory(directory: &Path, member: usize) -> std::path::PathBuf {
    directory.join("members").join(member.to_string())
}

/// One member of the ensemble.
#[derive(Clone, Copy, Debug)]
pub struct Member<'a> {
    model: &'a KnnModel,
    number: usize,
    k: usize,
    neighbors: &'a [u32],
    distances: &'a [f32],
}

impl<'a> Member<'a> {
    /// Returns the model that contains this member.
    pub fn model(&self) -> &'a KnnModel {
        self.model
    }

    /// Returns the position of the member in the model.
    pub fn number(&self) -> usize {
        self.number
    }

    /// Returns the number of transitions of the member.
    pub fn len(&self) -> usize {
        self.model.blocks.member_len(self.number)
    }

    /// Whether the member has no transitions. Never true for a model that was built.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Whether the member contains `transition`.
    pub fn contains(&self, transition: TransitionIndex) -> bool {
        self.model.blocks.contains(self.number, transition)
    }

    /// Returns the `position`-th transition of the member in time order.
    ///
    /// # Panics
    /// If the member has no more than `position` transitions.
    pub fn nth(&self, position: usize) -> TransitionIndex {
        self.model.blocks.nth(self.number, position)
    }

    /// Returns the neighbours of the next state of `transition`, nearest first, and their distances.
    ///
    /// A transition outside the member has `u32::MAX` and `+∞` here.
    ///
    /// # Panics
    /// If the data has no more than `transition` transitions.
    pub fn neighbors(&self, transition: TransitionIndex) -> (&'a [u32], &'a [f32]) {
        let start = transition.get() * self.k;
        (&self.neighbors[start..start + self.k], &self.distances[start..start + self.k])
    }

    /// Draws a neighbour of the next state of `transition`: one step. Reads one row of the table.
    ///
    /// # Panics
    /// If `transition` is not in the member. Neighbours always are.
    pub fn draw(
        &self,
        transition: TransitionIndex,
        weights: Weights,
        rng: &mut Rng,
    ) -> TransitionIndex {
        let (neighbors, distances) = self.neighbors(transition);
        let drawn = neighbors[weights.draw(distances, rng)];
        assert!(drawn != u32::MAX, "transition {} is not in member {}", transition.0, self.number);
        TransitionIndex(drawn)
    }
}
