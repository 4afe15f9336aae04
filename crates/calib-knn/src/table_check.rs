//! Checks that must hold for every list, also for approximate ones.

use calib_core::{Seed, TransitionIndex};
use rayon::prelude::*;

use crate::{
    KnnModel, PrototypeKind, Shortcuts,
    candidates::Candidates,
    definition::Cell,
    distance::{squared, stored},
    verify::sampled,
};

/// An error in a row of a table that no search can cause, not even an approximate one.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Fault {
    /// A neighbour is not a transition of the member.
    #[error("neighbour {neighbor} is not in the member")]
    NotInMember {
        /// The neighbour.
        neighbor: u32,
    },
    /// The exclusion forbids a neighbour.
    #[error("neighbour {neighbor} is forbidden by `exclude_self` or `theiler`")]
    Forbidden {
        /// The neighbour.
        neighbor: u32,
    },
    /// A neighbour is left out, so that no rollout is trapped.
    #[error("neighbour {neighbor} is left out, so that no rollout is trapped there")]
    LeftOut {
        /// The neighbour.
        neighbor: u32,
    },
    /// A neighbour is not a prototype.
    #[error("neighbour {neighbor} is not one of the prototypes, which are every {prototypes}-th")]
    NoPrototype {
        /// The neighbour.
        neighbor: u32,
        /// One source in this many can be a neighbour.
        prototypes: u32,
    },
    /// A distance differs from that of the states.
    #[error("neighbour {neighbor} is said to be {stored} away, and is {measured}")]
    Distance {
        /// The neighbour.
        neighbor: u32,
        /// The distance in the table.
        stored: f32,
        /// The distance by the definition.
        measured: f32,
    },
    /// Two neighbours are in the wrong order, or one occurs twice.
    #[error("neighbour {neighbor} is not nearer than {next}, which follows it")]
    Order {
        /// The neighbour.
        neighbor: u32,
        /// The neighbour that follows.
        next: u32,
    },
}

/// Returns the faults of `sample` random rows of every member, or of all rows if there are no more: the first fault of each row, as
/// (member, transition, fault).
///
/// Neighbours must be in the member, allowed by the exclusion, not left out, and prototypes if only these can be neighbours. Prototypes
/// that cover the states are known only while tables are built, and are not checked. Distances must be those of the states by the
/// definition. Lists must be in order, ties by row. All of this holds for exact and for approximate tables. [`recall`](crate::recall)
/// measures which true neighbours are missing. The rows are the same as those of [`verify`](crate::verify) with this seed.
pub fn faults(
    model: &KnnModel,
    shortcuts: Shortcuts,
    sample: usize,
    seed: Seed,
) -> Vec<(usize, TransitionIndex, Fault)> {
    let cells = sampled(model, sample, seed);
    cells
        .par_iter()
        .filter_map(|&cell| Some((cell.0, cell.1, fault(model, shortcuts, cell)?)))
        .collect()
}

fn fault(model: &KnnModel, shortcuts: Shortcuts, (member, transition): Cell) -> Option<Fault> {
    let transitions = model.transitions();
    let states = model.states();
    let query = transitions.next(transition);
    let forbidden = model.exclusion().forbidden(transitions, query);
    let prototypes = shortcuts.prototypes;
    let every = shortcuts.prototype_kind == PrototypeKind::Every;
    let (neighbors, distances) = model.member(member).neighbors(transition);
    let mut last: Option<(f64, u32)> = None;
    for (&neighbor, &distance) in neighbors.iter().zip(distances) {
        if !model.blocks().contains(member, TransitionIndex(neighbor)) {
            return Some(Fault::NotInMember { neighbor });
        }
        if forbidden.contains(&neighbor) {
            return Some(Fault::Forbidden { neighbor });
        }
        if model.left_out(member).bars(transition.0, neighbor) {
            return Some(Fault::LeftOut { neighbor });
        }
        if every && !Candidates::Every(prototypes).contains(neighbor) {
            return Some(Fault::NoPrototype { neighbor, prototypes });
        }
        let source = transitions.source(TransitionIndex(neighbor));
        let exact = squared(states.row(query.get()), states.row(source.get()));
        let measured = stored(exact);
        if distance.to_bits() != measured.to_bits() {
            return Some(Fault::Distance { neighbor, stored: distance, measured });
        }
        if let Some(before) = last
            && before.0.total_cmp(&exact).then(before.1.cmp(&neighbor)).is_ge()
        {
            return Some(Fault::Order { neighbor: before.1, next: neighbor });
        }
        last = Some((exact, neighbor));
    }
    None
}

#[cfg(test)]
mod tests {
    use calib_core::{Segments, Silent, States, Transitions};

    use super::*;
    use crate::ModelConfig;

    const SHORTCUTS: Shortcuts = Shortcuts {
        prototypes: 3,
        prototype_kind: PrototypeKind::Every,
        components: 0,
        leaf_budget: 0,
    };

    fn model() -> KnnModel {
        let values = (0..120_u16).map(|row| f32::from(row * row % 47)).collect();
        let states = States::new(values, 120, 1).expect("finite");
        let transitions = Transitions::new(Segments::from_lengths([120]).expect("one"));
        let config =
            ModelConfig { prototypes: 3, exclude_self: true, members: 2, ..ModelConfig::default() };
        KnnModel::build(states, transitions, &config, &Silent).expect("built")
    }

    /// Returns the faults of a model after `change` has modified one row in the table of member 0.
    fn after(change: impl Fn(&mut [u32], &mut [f32], &KnnModel)) -> Vec<Fault> {
        let model = model();
        let directory = tempfile::tempdir().expect("a directory");
        model.write_members(directory.path()).expect("written");
        let table = model.table(0);
        let row = 3 * model.member(0).nth(20).get();
        let mut neighbors = table.neighbors().to_vec();
        let mut distances = table.distances().to_vec();
        change(&mut neighbors[row..row + 3], &mut distances[row..row + 3], &model);
        let at = directory.path().join("members/0");
        calib_files::write_npy(&at.join("neighbors.npy"), &neighbors, table.len(), 3).expect("ok");
        calib_files::write_npy(&at.join("distances.npy"), &distances, table.len(), 3).expect("ok");
        let states = model.states().clone();
        let transitions = model.transitions().clone();
        let exclusion = model.exclusion();
        let changed = KnnModel::open(directory.path(), states, transitions, 2, exclusion);
        let changed = changed.expect("nothing that opening sees");
        faults(&changed, SHORTCUTS, 1000, Seed::new(1)).into_iter().map(|fault| fault.2).collect()
    }

    #[test]
    fn each_fault_is_found() {
        assert_eq!(after(|_, _, _| {}), []);
        let moved = after(|_, distances, _| distances[2] += 0.5);
        assert!(matches!(moved[..], [Fault::Distance { .. }]), "{moved:?}");
        let twice = after(|neighbors, distances, _| {
            (neighbors[2], distances[2]) = (neighbors[1], distances[1]);
        });
        assert!(matches!(twice[..], [Fault::Order { .. }]), "{twice:?}");
        let other = after(|neighbors, _, _| neighbors[0] += 1);
        assert!(matches!(other[..], [Fault::NoPrototype { prototypes: 3, .. }]), "{other:?}");
        let own = after(|neighbors, distances, model| {
            // The transition that starts where this one ends.
            neighbors[0] = model.member(0).nth(20).0 + 1;
            distances[0] = 0.0;
        });
        assert!(matches!(own[..], [Fault::Forbidden { .. }]), "{own:?}");
    }

    #[test]
    fn tables_of_other_prototypes_are_not_these() {
        let strict = Shortcuts { prototypes: 6, ..SHORTCUTS };
        let found = faults(&model(), strict, 10, Seed::new(2));
        assert!(!found.is_empty());
        assert!(
            found.iter().all(|fault| matches!(fault.2, Fault::NoPrototype { prototypes: 6, .. }))
        );
    }
}
