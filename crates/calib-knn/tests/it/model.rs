//! Tests the public interface of a model: members, external queries, files, verification.

use std::collections::BTreeSet;

use calib_core::{RowIndex, Seed, Segments, Silent, States, TransitionIndex, Transitions};
use calib_files::ScratchPlace;
use calib_knn::{
    IndexKind, KnnError, KnnModel, Member, MemoryNeed, ModelConfig, PrototypeKind, recall, verify,
};

fn walk(lengths: &[usize], columns: usize, seed: u64) -> (States, Transitions) {
    let rows = lengths.iter().sum();
    let mut rng = Seed::new(seed).rng();
    let mut state = vec![0.5_f64; columns];
    let mut values = Vec::new();
    for _ in 0..rows {
        for value in &mut state {
            *value = 0.95 * *value + 0.05 * rng.unit();
            values.push(*value as f32);
        }
    }
    let states = States::new(values, rows, columns).expect("valid");
    (states, Transitions::new(Segments::from_lengths(lengths.iter().copied()).expect("valid")))
}

fn model(config: &ModelConfig) -> KnnModel {
    let (states, transitions) = walk(&[150, 1, 90, 200], 5, 7);
    KnnModel::build(states, transitions, config, &Silent).expect("built")
}

/// Returns the `count` sources of a member that are nearest to `query`, by the definition.
fn nearest_by_definition(member: Member<'_>, query: &[f32], count: usize) -> Vec<(f64, u32)> {
    let model = member.model();
    let mut all: Vec<(f64, u32)> = (0..member.len())
        .map(|position| member.nth(position))
        .filter(|j| !model.left_out(0).contains(j.0))
        .map(|j| {
            let source = model.states().row(model.transitions().source(j).get());
            let pairs = query.iter().zip(source);
            (pairs.map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2)).sum(), j.0)
        })
        .collect();
    all.sort_by(|a, b| a.partial_cmp(b).expect("finite"));
    all.truncate(count);
    all
}

/// Returns the rows that a transition leads from and to.
fn ends(model: &KnnModel, transition: u32) -> [RowIndex; 2] {
    let transition = TransitionIndex(transition);
    [model.transitions().source(transition), model.transitions().next(transition)]
}

#[test]
fn no_row_of_the_block_is_reachable_in_its_member() {
    let model = model(&ModelConfig::default());
    for number in 0..5 {
        let block: BTreeSet<RowIndex> =
            model.blocks().own(number).flat_map(|i| ends(&model, i)).collect();
        let member = model.member(number);
        for position in 0..member.len() {
            let (neighbors, _) = member.neighbors(member.nth(position));
            for &j in neighbors {
                assert!(ends(&model, j).iter().all(|row| !block.contains(row)));
            }
        }
    }
}

#[test]
fn the_tables_verify_and_damage_does_not() {
    let config = ModelConfig { theiler: 3, ..ModelConfig::default() };
    let model = model(&config);
    let sampled = verify(&model, 40, Seed::new(1), &Silent).expect("not interrupted");
    assert!(sampled.agrees());
    assert_eq!((sampled.rows, sampled.identical), (200, 200));
    let all = verify(&model, 10_000, Seed::new(1), &Silent).expect("not interrupted");
    let rows: usize = (0..5).map(|m| model.member(m).len()).sum();
    assert_eq!((all.rows, all.identical), (rows, rows));

    // The same tables fail verification against other states.
    let directory = tempfile::tempdir().expect("a directory");
    model.write_members(directory.path()).expect("written");
    let (states, transitions) = walk(&[150, 1, 90, 200], 5, 8);
    let other = KnnModel::open(directory.path(), states, transitions, 5, config.exclusion())
        .expect("same shape");
    let different = verify(&other, 40, Seed::new(1), &Silent).expect("not interrupted");
    assert!(!different.agrees() && different.identical < different.rows);
}

#[test]
fn a_model_comes_back_from_its_files() {
    let config =
        ModelConfig { members: 3, neighbors: 4, exclude_self: true, ..ModelConfig::default() };
    let model = model(&config);
    let directory = tempfile::tempdir().expect("a directory");
    model.write_members(directory.path()).expect("written");
    let [opened, refused] = [3, 4].map(|members| {
        KnnModel::open(
            directory.path(),
            model.states().clone(),
            model.transitions().clone(),
            members,
            config.exclusion(),
        )
    });
    let opened = opened.expect("valid");
    assert_eq!((opened.members(), opened.k()), (3, 4));
    for member in 0..3 {
        assert_eq!(opened.table(member).neighbors(), model.table(member).neighbors());
        assert_eq!(opened.table(member).distances(), model.table(member).distances());
    }
    assert!(refused.is_err());
}

#[test]
fn external_states_find_their_nearest_sources() {
    let model = model(&ModelConfig::default());
    let (queries, _) = walk(&[700], 5, 99);
    let member = model.member(2);
    // 700 queries use a built index and 5 use the scan. Both must give the answers of the
    // definition.
    let many = member.nearest_sources(&queries, 3, &Silent).expect("same columns");
    let few = States::new(queries.as_slice()[..25].to_vec(), 5, 5).expect("valid");
    assert_eq!(member.nearest_sources(&few, 3, &Silent).expect("same columns"), many[..5]);
    for (query, found) in many.iter().enumerate().step_by(50) {
        let expected = nearest_by_definition(member, queries.row(query), 3).into_iter();
        let expected: Vec<(f32, u32)> =
            expected.map(|(squared, j)| (squared.sqrt() as f32, j)).collect();
        let got: Vec<(f32, u32)> = found.iter().map(|n| (n.distance, n.transition.0)).collect();
        assert_eq!(got, expected);
    }
    let narrow = States::new(vec![0.0; 4], 1, 4).expect("valid");
    let error = member.nearest_sources(&narrow, 3, &Silent).expect_err("four columns");
    assert!(matches!(error, KnnError::Columns { expected: 5, got: 4 }));
}

#[test]
fn recorded_rows_are_searched_as_the_tables_were() {
    let config = ModelConfig { theiler: 2, ..ModelConfig::default() };
    let model = model(&config);
    let member = model.member(1);
    let transitions: Vec<TransitionIndex> =
        (0..member.len()).step_by(9).map(|p| member.nth(p)).collect();
    let rows: Vec<RowIndex> = transitions.iter().map(|&i| model.transitions().next(i)).collect();
    let found = member.nearest_to_rows(&rows, 3, &ScratchPlace::Memory, &Silent).expect("found");
    for (transition, found) in transitions.iter().zip(found) {
        let (neighbors, distances) = member.neighbors(*transition);
        let got: Vec<(u32, f32)> = found.iter().map(|n| (n.transition.0, n.distance)).collect();
        let table: Vec<(u32, f32)> =
            neighbors.iter().copied().zip(distances.iter().copied()).collect();
        assert_eq!(got, table);
    }
}

#[test]
fn states_far_outside_the_data_find_their_nearest_sources_too() {
    let model = model(&ModelConfig::default());
    let member = model.member(0);
    let mut rng = Seed::new(5).rng();
    // 400 queries use the join, whose f32 images overflow at the larger of these scales.
    let values: Vec<f32> = (0..400 * 5)
        .map(|i| (rng.normal() * [1.0, 1e6, 1e17, 1e30, 1e37][i / 5 % 5]) as f32)
        .collect();
    let queries = States::new(values, 400, 5).expect("finite");
    let found = member.nearest_sources(&queries, 2, &Silent).expect("same columns");
    for (query, found) in found.iter().enumerate() {
        let expected = nearest_by_definition(member, queries.row(query), 2);
        let expected: Vec<u32> = expected.into_iter().map(|(_, j)| j).collect();
        let got: Vec<u32> = found.iter().map(|near| near.transition.0).collect();
        assert_eq!(got, expected, "query {query}");
    }
}

#[test]
fn all_members_are_searched_at_once_as_each_is() {
    let model = model(&ModelConfig::default());
    // The scan and the join, each in memory and on disk.
    let directory = tempfile::tempdir().expect("a directory");
    let on_disk = ScratchPlace::Disk(directory.path().to_owned());
    for (count, place) in [(10, ScratchPlace::Memory), (700, ScratchPlace::Memory), (700, on_disk)]
    {
        let (queries, _) = walk(&[count], 5, 99);
        let all = model.nearest_sources(&queries, 4, &place, &Silent).expect("same columns");
        assert_eq!(all.len(), 5);
        for (number, lists) in all.iter().enumerate() {
            let one =
                model.member(number).nearest_sources(&queries, 4, &Silent).expect("same columns");
            assert_eq!(*lists, one, "member {number}");
        }
    }
}

#[test]
fn a_search_for_other_states_takes_the_same_however_the_tables_were_found() {
    let built = ModelConfig { neighbors: 4, ..ModelConfig::default() };
    let others = [
        ModelConfig { index: IndexKind::Scan, ..built },
        ModelConfig { components: 2, ..built },
        ModelConfig { prototypes: 5, prototype_kind: PrototypeKind::KCentre, ..built },
    ];
    let exact = model(&built);
    let need = exact.search_need(4, 2);
    let states = exact.states();
    assert_eq!(need, MemoryNeed::predict(states.rows(), states.columns(), &built, 2));
    for config in others {
        assert_eq!(model(&config).search_need(4, 2), need, "{config:?}");
    }
    let own = MemoryNeed::predict(states.rows(), states.columns(), &others[0], 2);
    assert!(own.working < need.working, "a scan has no images, and these states are not scanned");
}

/// A monitor that always interrupts.
struct Stopped;

impl calib_core::Monitor for Stopped {
    fn begin(&self, _task: &str, _total: u64) {}

    fn advance(&self, _units: u64) {}

    fn interrupted(&self) -> bool {
        true
    }
}

#[test]
fn searches_and_comparisons_end_when_they_are_told_to() {
    let model = model(&ModelConfig::default());
    let (queries, _) = walk(&[700], 5, 99);
    let searched = model.nearest_sources(&queries, 4, &ScratchPlace::Memory, &Stopped);
    assert!(matches!(searched, Err(KnnError::Cancelled(_))));
    assert!(matches!(verify(&model, 5, Seed::new(1), &Stopped), Err(KnnError::Cancelled(_))));
    assert!(matches!(recall(&model, 5, Seed::new(1), &Stopped), Err(KnnError::Cancelled(_))));
}

#[test]
fn an_empty_member_is_told_as_such() {
    // Two transitions share a row: the member that leaves one out also lacks the other.
    let states = States::new(vec![0.0, 1.0, 2.0], 3, 1).expect("valid");
    let transitions = Transitions::new(Segments::from_lengths([3]).expect("valid"));
    let directory = tempfile::tempdir().expect("a directory");
    for member in 0..2 {
        let at = directory.path().join(format!("members/{member}"));
        std::fs::create_dir_all(&at).expect("writable");
        calib_files::write_npy(&at.join("neighbors.npy"), &[u32::MAX; 2], 2, 1).expect("written");
        let none = [f32::INFINITY; 2];
        calib_files::write_npy(&at.join("distances.npy"), &none, 2, 1).expect("written");
        calib_files::write_npy::<u32>(&at.join("left_out.npy"), &[], 0, 3).expect("written");
    }
    let exclusion = ModelConfig::default().exclusion();
    let model = KnnModel::open(directory.path(), states.clone(), transitions, 2, exclusion);
    let model = model.expect("nothing but fillers");
    assert!(model.member(1).is_empty());
    let error = model.member(1).nearest_sources(&states, 1, &Silent).expect_err("nothing to find");
    assert!(matches!(error, KnnError::EmptyMember { member: 1 }), "{error}");
    let error = model.nearest_sources(&states, 1, &ScratchPlace::Memory, &Silent);
    assert!(matches!(error, Err(KnnError::EmptyMember { member: 0 })));
}
