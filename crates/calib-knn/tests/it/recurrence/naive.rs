//! The results by definition, without any of the crate's searches.

use std::collections::{BTreeMap, BTreeSet};

use calib_core::{RowIndex, States, TransitionIndex, Transitions};
use calib_knn::{Blocks, KnnError, KnnModel, ModelConfig, Weights};

/// Transitions, and those that a rollout may draw after each.
pub(crate) struct Drawn {
    nodes: Vec<u32>,
    /// Successors by transition.
    edges: Vec<Vec<u32>>,
}

impl Drawn {
    /// Each row is a transition, its neighbours and their distances.
    fn new(rows: impl Iterator<Item = (u32, Vec<u32>, Vec<f32>)>, weights: Weights) -> Self {
        let mut drawn = Self { nodes: Vec::new(), edges: Vec::new() };
        for (node, neighbors, distances) in rows {
            let neighbors = neighbors.into_iter().zip(weights.probabilities(&distances));
            drawn.nodes.push(node);
            drawn.edges.resize(drawn.edges.len().max(node as usize + 1), Vec::new());
            drawn.edges[node as usize] =
                neighbors.filter(|(_, p)| *p > 0.0).map(|(to, _)| to).collect();
        }
        drawn
    }

    pub(crate) fn by(model: &KnnModel, member: usize, weights: Weights) -> Self {
        let member = model.member(member);
        let rows = (0..member.len()).map(|position| {
            let node = member.nth(position);
            let (neighbors, distances) = member.neighbors(node);
            (node.0, neighbors.to_vec(), distances.to_vec())
        });
        Self::new(rows, weights)
    }

    /// Returns the transitions that can be reached from `start` in any number of steps, including it.
    fn reached(&self, start: u32) -> Vec<u32> {
        let mut known = vec![false; self.edges.len()];
        known[start as usize] = true;
        let mut reached = vec![start];
        let mut next = 0;
        while let Some(&node) = reached.get(next) {
            let edges = self.edges[node as usize].iter();
            reached.extend(edges.filter(|&&to| !std::mem::replace(&mut known[to as usize], true)));
            next += 1;
        }
        reached
    }

    /// Returns the closed classes, the largest first: sets that are reached from each of their transitions and lead to
    /// nothing else.
    fn closed(&self) -> Vec<BTreeSet<u32>> {
        let mut counts = vec![0; self.edges.len()];
        for &node in &self.nodes {
            counts[node as usize] = self.reached(node).len();
        }
        let mut classes: Vec<BTreeSet<u32>> = (self.nodes.iter())
            .map(|&node| (node, self.reached(node)))
            .filter(|(node, reached)| {
                // A transition that reaches as many is reached from all of these.
                reached.iter().all(|to| to >= node && counts[*to as usize] == reached.len())
            })
            .map(|(_, reached)| reached.into_iter().collect())
            .collect();
        classes.sort_by_key(|class| std::cmp::Reverse(class.len()));
        classes
    }

    pub(crate) fn sizes(&self) -> Vec<usize> {
        self.closed().iter().map(BTreeSet::len).collect()
    }
}

/// The expected results for one member.
#[derive(Debug, PartialEq)]
pub(crate) struct Expected {
    /// Lists of the member's transitions.
    pub(crate) rows: BTreeMap<u32, Vec<u32>>,
    pub(crate) left_out: BTreeSet<u32>,
    pub(crate) exits: BTreeMap<u32, BTreeSet<u32>>,
    /// Sizes of the closed classes before and after, the largest first.
    pub(crate) before: Vec<usize>,
    pub(crate) after: Vec<usize>,
}

impl Expected {
    pub(crate) fn of(
        states: &States,
        transitions: &Transitions,
        config: &ModelConfig,
        member: usize,
    ) -> Result<Self, KnnError> {
        let blocks = Blocks::new(transitions, config.members)?;
        let naive = Naive {
            states,
            transitions,
            inside: blocks.transitions_of(member).map(|node| node.0).collect(),
            config,
            left_out: BTreeSet::new(),
            exits: BTreeMap::new(),
        };
        naive.expected()
    }
}

/// One member by definition, without any of the crate's searches.
struct Naive<'a> {
    states: &'a States,
    transitions: &'a Transitions,
    inside: Vec<u32>,
    config: &'a ModelConfig,
    left_out: BTreeSet<u32>,
    exits: BTreeMap<u32, BTreeSet<u32>>,
}

impl Naive<'_> {
    fn distance(&self, a: RowIndex, b: RowIndex) -> f64 {
        let pairs = self.states.row(a.get()).iter().zip(self.states.row(b.get()));
        pairs.map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2)).sum()
    }

    /// Returns the sources that `row` may find, nearest first, without those in `barred`.
    fn list(&self, row: RowIndex, barred: &BTreeSet<u32>) -> Vec<(f64, u32)> {
        let forbidden = self.config.exclusion().forbidden(self.transitions, row);
        let mut list: Vec<(f64, u32)> = (self.inside.iter().copied())
            .filter(|j| !forbidden.contains(j) && !self.left_out.contains(j) && !barred.contains(j))
            .filter(|j| j.is_multiple_of(self.config.prototypes))
            .map(|j| (self.distance(row, self.transitions.source(TransitionIndex(j))), j))
            .collect();
        list.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        list
    }

    fn next(&self, node: u32) -> RowIndex {
        self.transitions.next(TransitionIndex(node))
    }

    /// Returns the row of the table, or the number of candidates if there are too few.
    fn row(&self, node: u32) -> Result<Vec<(f64, u32)>, usize> {
        let none = BTreeSet::new();
        let barred = self.exits.get(&node).unwrap_or(&none);
        let mut list = self.list(self.next(node), barred);
        if list.len() < self.config.neighbors {
            return Err(list.len());
        }
        list.truncate(self.config.neighbors);
        Ok(list)
    }

    fn table(&self) -> Result<BTreeMap<u32, Vec<(f64, u32)>>, usize> {
        self.inside.iter().map(|&node| Ok((node, self.row(node)?))).collect()
    }

    fn drawn(&self, table: &BTreeMap<u32, Vec<(f64, u32)>>) -> Drawn {
        let rows = table.iter().map(|(&node, row)| {
            let (squares, neighbors): (Vec<f64>, Vec<u32>) = row.iter().copied().unzip();
            (node, neighbors, squares.into_iter().map(|s| s.sqrt() as f32).collect())
        });
        Drawn::new(rows, self.config.weights().expect("valid"))
    }

    /// Returns how many of these are not followed by the same state.
    fn lost<'t>(&self, nodes: impl IntoIterator<Item = &'t u32>) -> usize {
        nodes.into_iter().filter(|node| !self.is_still(**node)).count()
    }

    /// Whether `node` leads to the state that it starts from, and a candidate follows.
    fn is_still(&self, node: u32) -> bool {
        let source = self.transitions.source(TransitionIndex(node));
        let next = self.next(node);
        self.distance(source, next) == 0.0
            && self.transitions.starting_at(next).is_some_and(|next| {
                self.inside.contains(&next.0) && next.0.is_multiple_of(self.config.prototypes)
            })
    }

    fn expected(mut self) -> Result<Expected, KnnError> {
        let candidates =
            self.inside.iter().filter(|j| j.is_multiple_of(self.config.prototypes)).count();
        let first = self.table().map_err(|candidates| KnnError::TooFewCandidates {
            member: 9,
            candidates,
            k: 0,
        })?;
        let before = self.drawn(&first).sizes();
        // All traps at once, repeatedly.
        let returns = 100 * self.loops(&first) >= candidates;
        let outcome = loop {
            if !returns {
                break None;
            }
            let Ok(table) = self.table() else { break None };
            let closed = self.drawn(&table).closed().into_iter();
            let traps: Vec<_> = closed.filter(|class| is_trap(class, candidates)).collect();
            if traps.is_empty() {
                break Some(table);
            }
            self.left_out.extend(traps.into_iter().flatten());
        };
        let table = match outcome {
            Some(table) if self.lost(&self.left_out) <= candidates / 10 => table,
            _ => self.led_out(candidates).unwrap_or_else(|| {
                self.left_out.clear();
                self.exits.clear();
                first
            }),
        };
        let after = self.drawn(&table).sizes();
        let rows = (table.into_iter())
            .map(|(node, row)| (node, row.into_iter().map(|(_, to)| to).collect()))
            .collect();
        Ok(Expected { rows, left_out: self.left_out, exits: self.exits, before, after })
    }

    /// Returns the size of the largest component that contains one of sixteen probes.
    fn loops(&self, table: &BTreeMap<u32, Vec<(f64, u32)>>) -> usize {
        let drawn = self.drawn(table);
        let reached: BTreeMap<u32, BTreeSet<u32>> = (self.inside.iter())
            .map(|&node| (node, drawn.reached(node).into_iter().collect()))
            .collect();
        let shares =
            [8, 4, 12, 2, 10, 6, 14, 1, 9, 5, 13, 3, 11, 7, 15].map(|n| f64::from(n) / 16.0);
        let shares = shares.into_iter().chain([1.0 / 32.0]);
        shares
            .map(|share: f64| {
                let probe = table[&self.inside[(share * self.inside.len() as f64) as usize]][0].1;
                reached[&probe].iter().filter(|&to| reached[to].contains(&probe)).count()
            })
            .max()
            .expect("some")
    }

    /// Applies the second method: leaves out standstills and gives exits to the other traps. Returns `None` if that
    /// does not help.
    fn led_out(&mut self, candidates: usize) -> Option<BTreeMap<u32, Vec<(f64, u32)>>> {
        self.left_out.clear();
        loop {
            let classes = self.drawn(&self.table().ok()?).closed().into_iter();
            let free: Vec<_> = classes
                .filter(|class| is_trap(class, candidates) && self.lost(class) == 0)
                .collect();
            if free.is_empty() {
                break;
            }
            self.left_out.extend(free.into_iter().flatten());
        }
        for _ in 0..=(candidates / (16 * self.config.neighbors)).clamp(16, 1000) {
            let table = self.table().ok()?;
            // Any one of them is correct, because the order does not matter.
            let mut classes = self.drawn(&table).closed().into_iter();
            match classes.rfind(|class| is_trap(class, candidates)) {
                Some(trap) => self.lead_out(&trap).ok()?,
                None => return Some(table),
            }
        }
        None
    }

    fn lead_out(&mut self, class: &BTreeSet<u32>) -> Result<(), usize> {
        let mut among: Vec<u32> = class
            .iter()
            .filter(|node| {
                let next = self.transitions.starting_at(self.next(**node));
                next.is_none_or(|next| {
                    !self.inside.contains(&next.0)
                        || self.left_out.contains(&next.0)
                        || !next.0.is_multiple_of(self.config.prototypes)
                })
            })
            .copied()
            .collect();
        if among.is_empty() {
            among = class.iter().copied().collect();
        }
        let best = among
            .into_iter()
            .filter_map(|node: u32| {
                let barred = self.exits.get(&node).into_iter().flatten().chain(class).copied();
                let list = self.list(self.next(node), &barred.collect());
                list.first().map(|&(squared, _)| (squared.sqrt() as f32, node))
            })
            .reduce(|a, b| if b < a { b } else { a });
        let (_, node) = best.ok_or(0_usize)?;
        self.exits.entry(node).or_default().extend(class);
        self.row(node).map(|_| ())
    }
}

/// Whether a closed class has fewer than a tenth of the candidates.
fn is_trap(class: &BTreeSet<u32>, candidates: usize) -> bool {
    10 * class.len() < candidates
}
