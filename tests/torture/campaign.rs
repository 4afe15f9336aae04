//! Tools of all campaigns: numbers from the environment, seeded random draws, work on all cores, and a study that is as
//! small as possible.

use std::{
    sync::{
        Mutex,
        atomic::{AtomicUsize, Ordering},
    },
    thread,
};

use crate::harness::Place;

/// Reads a number from the environment.
pub(crate) fn number(name: &str, otherwise: u64) -> u64 {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(otherwise)
}

/// `SplitMix64`: the sequence depends only on the seed.
pub(crate) struct Draws(pub(crate) u64);

impl Draws {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    pub(crate) fn below(&mut self, limit: usize) -> usize {
        (self.next() % limit.max(1) as u64) as usize
    }

    pub(crate) fn of<'a, T>(&mut self, all: &'a [T]) -> &'a T {
        &all[self.below(all.len())]
    }
}

/// Runs `work` for every number below `count` on all cores, and returns the results in order.
pub(crate) fn on_all_cores<T: Send>(count: usize, work: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let next = AtomicUsize::new(0);
    let done = Mutex::new(Vec::with_capacity(count));
    let cores = thread::available_parallelism().map_or(1, usize::from);
    thread::scope(|scope| {
        for _ in 0..cores {
            scope.spawn(|| {
                loop {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    if number >= count {
                        return;
                    }
                    let result = work(number);
                    tell(number, count);
                    done.lock().expect("no worker panicked").push((number, result));
                }
            });
        }
    });
    let mut done = done.into_inner().expect("no worker panicked");
    done.sort_by_key(|(number, _)| *number);
    done.into_iter().map(|(_, result)| result).collect()
}

/// Reports the progress of a long campaign from time to time.
#[expect(clippy::print_stderr, reason = "a campaign by hand takes long")]
fn tell(number: usize, count: usize) {
    if count >= 500 && number % 100 == 99 {
        eprintln!("{} of {count}", number + 1);
    }
}

/// A study of one day of a tiny plant; it runs in a fraction of a second.
pub(crate) const STUDY: &str = r#"
seed = 3

[simulate]
days = 1
channels = 4
period_secs = 240
gaps_per_day = 1

[data]
path = "data"
train_fraction = 0.6

[preprocess]
fill_limit = 5

[model]
members = 2
exclude_self = true

[rollout]
steps = 40
rollouts = 1

[agent]
value_function = "linear"
gamma = 0.8
batch_size = 8
learning_rate = 1e-3

[sweep]
sensors = ["PIT300"]
steps = 60
online_runs = 1
member_runs = 1
log_replay_runs = 1

[sweep.grid]
learning_rate = [1e-3, 1e-2]
"#;

/// Sections to append to this study: pre-trained agents, a representation, and two models.
const FURTHER: &str = r#"
[pretrain]
epochs = 2

[representation]
kind = "laplacian"
steps = 40
dimension = 2
hidden_units = 8
batch_size = 16

[dynamics]
hidden_units = 8
epochs = 2

[models.near]
[models.net.model]
kind = "nn"
"#;

/// Returns a folder with only `study.toml`: one model of neighbours.
pub(crate) fn neighbours() -> Place {
    let place = Place::new();
    place.write("study.toml", STUDY);
    place
}

/// Returns a folder with only `study.toml`: neighbours and a network, a representation, pre-trained agents.
pub(crate) fn everything() -> Place {
    let place = Place::new();
    place.write("study.toml", &format!("{STUDY}{FURTHER}"));
    place
}
