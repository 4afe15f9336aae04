use calib_core::Seed;

use crate::{AgentConfig, ReplayKind};

/// A replay buffer of transitions, identified by the step they start from.
///
/// The draw of an update depends only on the seed, the step, the number of the update in that step and
/// the number of transitions in the buffer. Agents with the same buffer therefore see the same
/// mini-batches.
#[derive(Clone, Debug)]
pub(crate) struct Replay {
    seed: Seed,
    capacity: usize,
    /// All transitions so far. The buffer is the last `capacity` of them.
    starts: Vec<u32>,
}

impl Replay {
    pub(crate) fn new(seed: Seed, capacity: usize, steps: usize) -> Self {
        assert!(u32::try_from(steps).is_ok(), "steps are numbered in 32 bits");
        Self { seed, capacity, starts: Vec::with_capacity(steps) }
    }

    /// Returns the buffer of an agent with replay, for a run of `steps` steps with seed `run`.
    pub(crate) fn of_agent(config: &AgentConfig, run: Seed, steps: usize) -> Option<Self> {
        (config.replay == ReplayKind::Uniform)
            .then(|| Self::new(run.child("replay"), config.replay_capacity, steps))
    }

    /// Adds the transition from step `t` to the next.
    pub(crate) fn push(&mut self, t: usize) {
        self.starts.push(t as u32);
    }

    pub(crate) fn len(&self) -> usize {
        self.starts.len().min(self.capacity)
    }

    /// Fills `batch` with transitions drawn uniformly with replacement, for update `update` of step
    /// `t`.
    pub(crate) fn draw(&self, t: usize, update: usize, batch: &mut [usize]) {
        let mut rng = self.seed.number(t as u64).number(update as u64).rng();
        let held = &self.starts[self.starts.len() - self.len()..];
        for start in batch {
            *start = held[rng.below(held.len())] as usize;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filled(steps: usize, capacity: usize) -> Replay {
        let mut replay = Replay::new(Seed::new(3), capacity, steps);
        (0..steps).for_each(|t| replay.push(t));
        replay
    }

    #[test]
    fn draws_are_uniform_over_the_latest_transitions() {
        let replay = filled(50, 20);
        assert_eq!(replay.len(), 20);
        let mut counts = [0_u32; 20];
        let mut batch = [0; 64];
        for t in 0..500 {
            replay.draw(t, 0, &mut batch);
            for start in batch {
                counts[start - 30] += 1;
            }
        }
        let expected = 64.0 * 500.0 / 20.0;
        let chi_square: f64 =
            counts.iter().map(|&count| (f64::from(count) - expected).powi(2) / expected).sum();
        assert!(chi_square < 43.8, "chi-square {chi_square} with 19 degrees of freedom");
    }

    /// Returns the eight transitions that an update draws.
    fn drawn(replay: &Replay, t: usize, update: usize) -> [usize; 8] {
        let mut batch = [0; 8];
        replay.draw(t, update, &mut batch);
        batch
    }

    #[test]
    fn a_draw_depends_on_seed_step_and_update_only() {
        let replay = filled(1000, 5000);
        let once = drawn(&replay, 7, 0);
        assert_eq!(once, drawn(&filled(1000, 1000), 7, 0));
        assert_ne!(once, drawn(&replay, 8, 0));
        assert_ne!(once, drawn(&replay, 7, 1));
        assert_ne!(drawn(&replay, 1, 0), drawn(&replay, 0, 1));
    }
}
