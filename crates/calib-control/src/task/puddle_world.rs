use calib_core::Rng;

use super::Task;
use crate::{Ending, Outcome};

/// A unit square to cross to its upper right corner, around two puddles. The reward is −1 per step, and −400 times the depth
/// in each puddle.
///
/// Source: Sutton (1996). Steps of 0.05 go up, down, right and left, with normal noise. A puddle is the area within 0.1 of a
/// segment. Episodes start within 0.05 of (0.2, 0.4), left of the puddles (our choice; Sutton's start anywhere).
#[derive(Clone, Debug)]
pub struct PuddleWorld {
    pub(crate) state: [f64; 2],
    /// Standard deviation of the noise of a step, on both axes; 0.01 as in Sutton's task.
    pub(crate) noise: f64,
    /// Length of a step.
    step: f64,
}

const RADIUS: f64 = 0.1;
const MOVES: [[f64; 2]; 4] = [[0.0, 1.0], [0.0, -1.0], [1.0, 0.0], [-1.0, 0.0]];

impl Default for PuddleWorld {
    fn default() -> Self {
        Self { state: [0.2, 0.4], noise: 0.01, step: 0.05 }
    }
}

impl PuddleWorld {
    /// Returns the task with steps that are `times` as long.
    pub fn with_longer_steps(times: f64) -> Self {
        Self { step: 0.05 * times, ..Self::default() }
    }

    fn depth(&self) -> f64 {
        let [x, y] = self.state;
        // The puddles lie along segments from (0.1, 0.75) to (0.45, 0.75), and from (0.45, 0.4) to (0.45, 0.8).
        let lying = (x - x.clamp(0.1, 0.45)).hypot(y - 0.75);
        let standing = (x - 0.45).hypot(y - y.clamp(0.4, 0.8));
        (RADIUS - lying).max(0.0) + (RADIUS - standing).max(0.0)
    }

    fn there(&self) -> bool {
        self.state[0] + self.state[1] >= 1.9
    }
}

impl Task for PuddleWorld {
    fn columns() -> &'static [(&'static str, f64, f64)] {
        &[("x", 0.0, 1.0), ("y", 0.0, 1.0)]
    }

    fn actions() -> &'static [&'static str] {
        &["up", "down", "right", "left"]
    }

    fn start(&mut self, rng: &mut Rng) {
        self.state = [0.2, 0.4].map(|at| at + rng.uniform(-0.05, 0.05));
    }

    fn start_anywhere(&mut self, rng: &mut Rng) {
        loop {
            self.state = [(); 2].map(|()| rng.unit());
            if !self.there() {
                return;
            }
        }
    }

    fn observe(&self, observed: &mut Vec<f64>) {
        observed.clear();
        observed.extend(self.state);
    }

    fn step(&mut self, action: usize, rng: &mut Rng) -> Outcome {
        for (at, by) in self.state.iter_mut().zip(MOVES[action]) {
            let noise = if self.noise > 0.0 { self.noise * rng.normal() } else { 0.0 };
            *at = (*at + self.step * by + noise).clamp(0.0, 1.0);
        }
        let reward = -1.0 - 400.0 * self.depth();
        Outcome { reward, ending: Ending::terminal_if(self.there()) }
    }
}
