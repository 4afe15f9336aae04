//! Tests that builds that are interrupted and continued, in memory and on disk, give the same bytes as
//! undisturbed ones.

use std::{
    path::{Path, PathBuf},
    sync::atomic::{AtomicU64, Ordering},
};

use calib_core::{Monitor, Seed, Segments, Silent, States, Transitions};
use calib_files::{Fingerprint, ScratchPlace};
use calib_knn::{IndexKind, KnnError, KnnModel, ModelConfig, Parts, Workplace};

const ROWS: usize = 3000;

fn data(columns: usize) -> (States, Transitions) {
    let mut rng = Seed::new(9).rng();
    let mut state = vec![0.0_f64; columns];
    let mut values = Vec::new();
    for _ in 0..ROWS {
        for value in &mut state {
            *value = 0.98 * *value + 0.1 * rng.normal();
            values.push(*value as f32);
        }
    }
    let states = States::new(values, ROWS, columns).expect("valid");
    (states, Transitions::new(Segments::from_lengths([1200, ROWS - 1200]).expect("valid")))
}

/// A monitor that interrupts once the search has reached this progress. It ignores the steps before the
/// search.
struct StopsAt {
    queries: u64,
    searching: AtomicU64,
    seen: AtomicU64,
}

impl StopsAt {
    fn new(queries: u64) -> Self {
        Self { queries, searching: 0.into(), seen: 0.into() }
    }
}

impl Monitor for StopsAt {
    fn begin(&self, task: &str, _total: u64) {
        self.searching.store(u64::from(task == "neighbour tables"), Ordering::SeqCst);
    }

    fn advance(&self, units: u64) {
        self.seen.fetch_add(units * self.searching.load(Ordering::SeqCst), Ordering::SeqCst);
    }

    fn interrupted(&self) -> bool {
        self.seen.load(Ordering::SeqCst) >= self.queries
    }
}

fn build(
    kind: IndexKind,
    columns: usize,
    workplace: &Workplace,
    monitor: &dyn Monitor,
) -> Result<KnnModel, KnnError> {
    let config = ModelConfig { index: kind, members: 3, theiler: 2, ..ModelConfig::default() };
    let (states, transitions) = data(columns);
    KnnModel::build_in(states, transitions, &config, workplace, monitor).map(|(model, _)| model)
}

fn bytes(model: &KnnModel) -> Vec<(Vec<u32>, Vec<u32>)> {
    (0..model.members())
        .map(|member| {
            let table = model.table(member);
            let distances = table.distances().iter().map(|distance| distance.to_bits()).collect();
            (table.neighbors().to_vec(), distances)
        })
        .collect()
}

/// Returns a workplace in memory, with parts of 300 queries in a folder.
fn in_parts(folder: &Path) -> Workplace {
    let parts = Parts::new(folder.to_owned(), "data").of_queries(300);
    Workplace { scratch: ScratchPlace::Memory, parts: Some(parts) }
}

#[test]
fn a_build_that_is_interrupted_again_and_again_goes_on() {
    for (kind, columns) in [
        (IndexKind::Join, 12),
        (IndexKind::Scan, 12),
        (IndexKind::KdTree, 3),
        (IndexKind::Auto, 40),
    ] {
        let whole = build(kind, columns, &Workplace::default(), &Silent).expect("built");
        let directory = tempfile::tempdir().expect("a directory");
        let parts = Parts::new(directory.path().join("partial"), "data").of_queries(300);
        let on_disk = ScratchPlace::Disk(directory.path().to_owned());
        let mut interrupted = 0;
        let mut round = 0;
        let built = loop {
            round += 1;
            // Alternates between memory and disk. Each round adds only a part or two.
            let scratch = if round % 2 == 0 { ScratchPlace::Memory } else { on_disk.clone() };
            let workplace = Workplace { scratch, parts: Some(parts.clone()) };
            let stops = StopsAt::new(300 * interrupted + 350);
            match build(kind, columns, &workplace, &stops) {
                Ok(model) => break model,
                Err(KnnError::Cancelled(_)) => interrupted += 1,
                Err(error) => panic!("{error}"),
            }
            assert!(round < 60, "the build never ends");
        };
        assert!(interrupted >= 3, "{kind:?} was interrupted {interrupted} times only");
        assert_eq!(bytes(&built), bytes(&whole), "{kind:?}");
    }
}

#[test]
fn what_was_kept_is_not_searched_again() {
    let directory = tempfile::tempdir().expect("a directory");
    let workplace = in_parts(&directory.path().join("partial"));
    let first = build(IndexKind::Join, 12, &workplace, &Silent).expect("built");
    let kept = std::fs::read_dir(directory.path().join("partial")).expect("readable").count();
    assert_eq!(kept, 10, "all of them, until the model is complete");
    let again = build(IndexKind::Join, 12, &workplace, &Silent).expect("built");
    assert_eq!(bytes(&again), bytes(&first));
    // Another structure searches in another order, so its parts are separate.
    let other = build(IndexKind::Scan, 12, &workplace, &Silent).expect("built");
    assert_eq!(bytes(&other), bytes(&first));
    // A damaged part is searched again.
    for entry in std::fs::read_dir(directory.path().join("partial")).expect("readable") {
        let path = entry.expect("an entry").path();
        let mut content = std::fs::read(&path).expect("readable");
        content[200] ^= 0x55;
        std::fs::write(&path, content).expect("writable");
    }
    let repaired = build(IndexKind::Scan, 12, &workplace, &Silent).expect("built");
    assert_eq!(bytes(&repaired), bytes(&first));
}

/// Bytes before the neighbours and distances of a part: its key and the fingerprint of the rest, 64 digits
/// each.
const HEAD: usize = 128;

#[test]
fn what_was_kept_is_what_the_tables_hold() {
    let directory = tempfile::tempdir().expect("a directory");
    let partial = directory.path().join("partial");
    let workplace = in_parts(&partial);
    let stopped = build(IndexKind::Join, 12, &workplace, &StopsAt::new(1500));
    assert!(matches!(stopped, Err(KnnError::Cancelled(_))));
    // A forged part whose fingerprint is valid. If the build uses it, the tables show it. If the build
    // searches its queries again, they do not.
    let path = partial.join("00000000.part");
    let mut content = std::fs::read(&path).expect("the first part was kept");
    let distances = HEAD + (content.len() - HEAD) / 2;
    for cell in content[distances..].chunks_exact_mut(4) {
        if f32::from_le_bytes(cell.try_into().expect("four bytes")).is_finite() {
            cell.copy_from_slice(&7777.5_f32.to_le_bytes());
        }
    }
    let sum = Fingerprint::of(&content[HEAD..]);
    content[HEAD / 2..HEAD].copy_from_slice(sum.as_str().as_bytes());
    std::fs::write(&path, content).expect("writable");
    let built = build(IndexKind::Join, 12, &workplace, &Silent).expect("built");
    let whole = build(IndexKind::Join, 12, &Workplace::default(), &Silent).expect("built");
    let mut marked = 0;
    for member in 0..whole.members() {
        let built = built.table(member);
        let whole = whole.table(member);
        assert_eq!(built.neighbors(), whole.neighbors());
        for (&from_part, &searched) in built.distances().iter().zip(whole.distances()) {
            marked += usize::from(from_part == 7777.5);
            assert!(from_part == 7777.5 || from_part.to_bits() == searched.to_bits());
        }
    }
    // 300 queries, each in two of three members except those beside a block, with three neighbours.
    assert!((1750..=1800).contains(&marked), "{marked} cells come from the part");
}

#[test]
fn a_disk_without_room_is_an_error_and_no_panic() {
    let directory = tempfile::tempdir().expect("a directory");
    let file = directory.path().join("a file");
    std::fs::write(&file, "in the way").expect("writable");
    let workplace = in_parts(&file.join("partial"));
    let error = build(IndexKind::Join, 12, &workplace, &Silent).expect_err("no directory");
    assert!(matches!(error, KnnError::File(_)), "{error}");
    let workplace = Workplace { scratch: ScratchPlace::Disk(file.join("scratch")), parts: None };
    let error = build(IndexKind::Join, 12, &workplace, &Silent).expect_err("no directory");
    assert!(matches!(error, KnnError::File(_)), "{error}");
}

/// A monitor that creates a directory at the path of the next part once the search begins, and counts the
/// queries.
struct Obstacle {
    path: PathBuf,
    queries: AtomicU64,
}

impl Monitor for Obstacle {
    fn begin(&self, task: &str, _total: u64) {
        if task == "neighbour tables" {
            std::fs::create_dir(&self.path).expect("nothing is there yet");
            self.queries.store(0, Ordering::SeqCst);
        }
    }

    fn advance(&self, units: u64) {
        self.queries.fetch_add(units, Ordering::SeqCst);
    }
}

#[test]
fn a_part_that_cannot_be_written_ends_the_build() {
    let directory = tempfile::tempdir().expect("a directory");
    let partial = directory.path().join("partial");
    let workplace = in_parts(&partial);
    let obstacle = Obstacle { path: partial.join("00000001.part"), queries: 0.into() };
    let error = build(IndexKind::Join, 12, &workplace, &obstacle).expect_err("no room");
    assert!(matches!(error, KnnError::File(_)), "{error}");
    assert!(error.to_string().contains("00000001.part"), "{error}");
    // Writing the second part fails. Meanwhile one part may wait and one be searched, and then the search
    // ends.
    let searched = obstacle.queries.into_inner();
    assert!((600..=1800).contains(&searched), "{searched} queries of 2998");
    assert!(partial.join("00000000.part").is_file(), "what was kept before stays");
    std::fs::remove_dir(&obstacle.path).expect("it is empty");
    let built = build(IndexKind::Join, 12, &workplace, &Silent).expect("there is room again");
    let whole = build(IndexKind::Join, 12, &Workplace::default(), &Silent).expect("built");
    assert_eq!(bytes(&built), bytes(&whole));
}
