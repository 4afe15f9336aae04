use std::{
    fs,
    path::{Path, PathBuf},
    sync::atomic::{AtomicUsize, Ordering},
};

use calib_core::{Segments, Silent};

use super::*;
use crate::Columns;

/// Returns a log of a place on a line. Action 0 goes back by 0.1, action 1 forth by 0.05. The reward is a thousand times the next place,
/// and above 0.9 an episode ends.
fn log() -> Decisions {
    let mut rng = Seed::new(1).rng();
    let mut states = Vec::new();
    let mut actions = Vec::new();
    let mut rewards = Vec::new();
    let mut endings = Vec::new();
    let mut lengths = Vec::new();
    for _ in 0..60 {
        let mut place = 0.9 * rng.unit() as f32;
        let mut length = 1;
        states.push(place);
        rewards.push(f32::NAN);
        endings.push(Ending::Continues);
        while length < 40 && place < 0.9 {
            let action = u16::from(rng.below(3) > 0);
            actions.push(Some(action));
            place = follows(place, usize::from(action));
            states.push(place);
            rewards.push(1000.0 * place);
            endings.push(Ending::terminal_if(place >= 0.9));
            length += 1;
        }
        actions.push(None);
        lengths.push(length);
    }
    let rows = states.len();
    let columns = Columns { actions: &actions, rewards: &rewards, endings: &endings };
    let states = States::new(states, rows, 1).expect("valid");
    let segments = Segments::from_lengths(lengths).expect("valid");
    Decisions::new(states, &segments, columns, 2).expect("a log")
}

fn follows(place: f32, action: usize) -> f32 {
    (place + if action == 1 { 0.05 } else { -0.1 }).max(0.0)
}

fn model(config: NetworkConfig) -> NetworkModel {
    let starts = States::new(vec![0.1, 0.3], 2, 1).expect("valid");
    NetworkModel::train(&log(), starts, &config, Seed::new(2), &Silent).expect("learned")
}

#[test]
fn a_step_is_what_follows_in_truth() {
    let model = model(NetworkConfig { updates: 4000, members: 3, ..NetworkConfig::default() });
    for member in 0..model.members() {
        let mut rollout = model.rollout(member);
        let mut rng = Seed::new(3).rng();
        for (place, action) in [(0.3, 0), (0.5, 1), (0.05, 0), (0.8, 1), (0.88, 1)] {
            let mut state = [place];
            let outcome = rollout.step(action, &mut rng, &mut state);
            let truth = follows(place, action);
            assert!((state[0] - truth).abs() < 0.02, "{place} {action}: {state:?}, not {truth}");
            assert!((outcome.reward - f64::from(1000.0 * truth)).abs() < 25.0, "{outcome:?}");
            assert_eq!(outcome.ending, Ending::terminal_if(truth >= 0.9), "{place} {action}");
        }
        assert_eq!(rollout.coverage(), Coverage { steps: 5, missing: 0, far: 0 });
    }
}

#[test]
fn nothing_leaves_the_range_of_the_log() {
    // The network learned so little that it is wrong everywhere.
    let model = model(NetworkConfig { updates: 1, learning_rate: 1.0, ..NetworkConfig::default() });
    let log = log();
    let highest = log.states().as_slice().iter().copied().fold(f32::MIN, f32::max);
    let mut rollout = model.rollout(0);
    let mut rng = Seed::new(3).rng();
    let mut state = [0.0];
    rollout.start(&mut rng, &mut state);
    assert!([0.1, 0.3].contains(&state[0]));
    for step in 0..200 {
        let outcome = rollout.step(step % 2, &mut rng, &mut state);
        assert!((0.0..=highest).contains(&state[0]), "{state:?}");
        assert!((0.0..=f64::from(1000.0 * highest)).contains(&outcome.reward), "{outcome:?}");
    }
}

#[test]
fn the_same_for_any_number_of_threads() {
    let config = NetworkConfig { updates: 30, ..NetworkConfig::default() };
    let [one, three] = [1, 3].map(|threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| model(config)).networks
    });
    assert_eq!(one, three);
    assert_ne!(one[0], one[1], "members differ");
}

#[test]
fn some_members_have_the_networks_that_they_have_among_all() {
    let config = NetworkConfig { updates: 30, members: 4, ..NetworkConfig::default() };
    let all = model(config).networks;
    for members in [&[2][..], &[0, 3]] {
        let starts = one_start();
        let seed = Seed::new(2);
        let some =
            NetworkModel::train_members(&log(), starts, &config, members, seed, None, &Silent);
        let some = some.expect("learned");
        assert_eq!(some.members(), 4, "runs have the numbers that they have among all");
        for (member, network) in some.networks.iter().enumerate() {
            let expected = if members.contains(&member) { all[member].as_ref() } else { None };
            assert_eq!(network.as_ref(), expected, "member {member} of {members:?}");
        }
        let mut state = [0.3];
        some.rollout(members[0]).step(1, &mut Seed::new(3).rng(), &mut state);
    }
}

/// Counts the updates of training, before each of which it is asked.
#[derive(Default)]
struct Updates(AtomicUsize);

impl Monitor for Updates {
    fn interrupted(&self) -> bool {
        self.0.fetch_add(1, Ordering::Relaxed);
        false
    }
}

/// Returns the file with the network of an ensemble member.
fn file_of(folder: &Path, member: usize) -> PathBuf {
    folder.join(format!("network-{member}.safetensors"))
}

/// Returns the networks of `members` with the files in `folder`, and the number of updates for them.
fn stored(folder: &Path, key: &str, members: &[usize], seed: u64) -> (Vec<Option<Mlp>>, usize) {
    let config = NetworkConfig { updates: 30, members: 3, ..NetworkConfig::default() };
    let files = &NetworkFiles::new(folder, key);
    let updates = Updates::default();
    let starts = one_start();
    let seed = Seed::new(seed);
    let trained =
        NetworkModel::train_members(&log(), starts, &config, members, seed, Some(files), &updates);
    (trained.expect("learned").networks, updates.0.into_inner())
}

#[test]
fn stored_networks_are_trained_once() {
    let folder = tempfile::tempdir().expect("a folder");
    let all = model(NetworkConfig { updates: 30, members: 3, ..NetworkConfig::default() }).networks;
    let (two, updates) = stored(folder.path(), "log", &[0, 2], 2);
    assert_eq!(updates, 60);
    assert_eq!(two, [all[0].clone(), None, all[2].clone()]);
    assert!(
        file_of(folder.path(), 0).exists()
            && !file_of(folder.path(), 1).exists()
            && file_of(folder.path(), 2).exists()
    );
    // The missing one alone is trained.
    assert_eq!(stored(folder.path(), "log", &[0, 1, 2], 2), (all.clone(), 30));
    assert_eq!(stored(folder.path(), "log", &[0, 1, 2], 2), (all.clone(), 0));
    // A damaged one, or that of another member, is trained again.
    let whole = fs::read(file_of(folder.path(), 1)).expect("there");
    let mut damaged = whole.clone();
    *damaged.last_mut().expect("not empty") ^= 1;
    fs::write(file_of(folder.path(), 1), damaged).expect("writable");
    fs::copy(file_of(folder.path(), 0), file_of(folder.path(), 2)).expect("writable");
    assert_eq!(stored(folder.path(), "log", &[0, 1, 2], 2), (all, 60));
    assert_eq!(fs::read(file_of(folder.path(), 1)).expect("there"), whole, "the same bytes");
    // Another log and another seed need other networks.
    assert_eq!(stored(folder.path(), "another log", &[0, 1, 2], 2).1, 90);
    assert_eq!(stored(folder.path(), "another log", &[0, 1, 2], 3).1, 90);
}

#[test]
fn networks_without_a_valid_file_are_counted() {
    let folder = tempfile::tempdir().expect("a folder");
    let log = log();
    let metric = log.states().clone();
    let starts = crate::Starts { observed: one_start(), metric: one_start() };
    let config = crate::ActionModelConfig { members: 3, ..crate::ActionModelConfig::default() };
    let model = ActionModel::build(log, &metric, starts, &config, 0.0, &Silent).expect("built");
    let files = NetworkFiles::new(folder.path(), "log");
    let seed = Seed::new(2);
    assert_eq!(NetworkModel::count_untrained(&model, &[0, 1, 2], seed, &files), 3);
    NetworkModel::for_members(&model, &[1], seed, Some(&files), &Silent).expect("trained");
    assert_eq!(NetworkModel::count_untrained(&model, &[0, 1, 2], seed, &files), 2);
    assert_eq!(NetworkModel::count_untrained(&model, &[1], seed, &files), 0);
    fs::write(folder.path().join("network-1.safetensors"), "damaged").expect("writable");
    assert_eq!(NetworkModel::count_untrained(&model, &[1], seed, &files), 1);
}

/// Trains the networks of `members`, and stores them in `folder`.
fn trained_in(folder: &Path, config: &NetworkConfig, members: &[usize]) -> NetworkModel {
    let files = NetworkFiles::new(folder, "log");
    let seed = Seed::new(2);
    NetworkModel::train_members(&log(), one_start(), config, members, seed, Some(&files), &Silent)
        .expect("learned")
}

#[test]
fn networks_that_cannot_be_stored_are_used() {
    let folder = tempfile::tempdir().expect("a folder");
    // No file can be put in the place of a folder.
    fs::create_dir_all(file_of(folder.path(), 1).join("in the way")).expect("writable");
    let config = NetworkConfig { updates: 30, members: 3, ..NetworkConfig::default() };
    let all = trained_in(folder.path(), &config, &[0, 1, 2]);
    assert_eq!(all.networks, model(config).networks);
    let told = all.unstored().expect("not stored").to_string();
    assert!(told.contains("network-1.safetensors"), "{told}");
    assert!(file_of(folder.path(), 0).is_file() && file_of(folder.path(), 2).is_file());
    assert!(trained_in(folder.path(), &config, &[0, 2]).unstored().is_none());
}

#[test]
fn parameters_are_counted_before_training() {
    let config = NetworkConfig { updates: 1, members: 2, hidden_layers: 3, ..Default::default() };
    let network = model(config).networks[1].clone().expect("trained");
    assert_eq!(network.parameter_count(), config.parameters(1, 2));
}

fn one_start() -> States {
    States::new(vec![0.1], 1, 1).expect("valid")
}

#[test]
fn impossible_networks_are_refused() {
    let none = NetworkConfig { batch: 0, ..NetworkConfig::default() };
    let told = NetworkModel::train(&log(), one_start(), &none, Seed::new(2), &Silent);
    assert!(told.expect_err("none").to_string().contains("batch"));
    let nowhere = one_start().slice(0..0);
    let config = NetworkConfig::default();
    let told = NetworkModel::train(&log(), nowhere, &config, Seed::new(2), &Silent);
    assert!(matches!(told, Err(ControlError::NoStarts)));
}
