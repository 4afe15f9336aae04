use std::f64::consts::PI;

use calib_core::Rng;

use super::Task;
use crate::{Ending, Outcome};

/// A pendulum that a torque swings up and holds there. Episodes have no terminal.
///
/// The reward is −(θ² + 0.1 ω² + 0.001 u²) for the angle θ from upright in ±π, the speed ω in rad/s and the torque u in N m. Numbers,
/// and the step of 0.05 s, are those of Gymnasium's `Pendulum-v1`. The torque is continuous there; here it has five levels from −2 to 2
/// as actions.
#[derive(Clone, Debug, Default)]
pub struct Pendulum {
    pub(crate) state: [f64; 2],
    /// Largest difference between the torque and its level, in N m.
    play: f64,
    /// The last torque, in N m.
    torque: f64,
}

const STEP: f64 = 0.05;
const FASTEST: f64 = 8.0;
const STRONGEST: f64 = 2.0;
const LEVELS: [f64; 5] = [-2.0, -1.0, 0.0, 1.0, 2.0];

impl Pendulum {
    /// Returns the task with a torque that is uniform within half a level of the action's: a continuous action, as in a log.
    pub fn continuous() -> Self {
        Self { play: 0.5, ..Self::default() }
    }

    /// Applies `torque`, cut at ±2 N m, for a step. Returns the reward.
    pub fn push(&mut self, torque: f64) -> f64 {
        let [angle, speed] = self.state;
        let torque = torque.clamp(-STRONGEST, STRONGEST);
        let from_upright = (angle + PI).rem_euclid(2.0 * PI) - PI;
        let cost = from_upright.powi(2) + 0.1 * speed.powi(2) + 0.001 * torque.powi(2);
        // Length and mass are 1, and gravity is 10 m/s².
        let speed = speed + (3.0 * 10.0 / 2.0 * angle.sin() + 3.0 * torque) * STEP;
        let speed = speed.clamp(-FASTEST, FASTEST);
        self.state = [angle + speed * STEP, speed];
        -cost
    }
}

impl Task for Pendulum {
    fn columns() -> &'static [(&'static str, f64, f64)] {
        &[("cos", -1.0, 1.0), ("sin", -1.0, 1.0), ("speed", -FASTEST, FASTEST)]
    }

    fn actions() -> &'static [&'static str] {
        &["-2", "-1", "0", "1", "2"]
    }

    fn start(&mut self, rng: &mut Rng) {
        self.state = [PI, 1.0].map(|most| rng.uniform(-most, most));
    }

    fn start_anywhere(&mut self, rng: &mut Rng) {
        self.state = [PI, FASTEST].map(|most| rng.uniform(-most, most));
    }

    fn observe(&self, observed: &mut Vec<f64>) {
        let [angle, speed] = self.state;
        observed.clear();
        observed.extend([angle.cos(), angle.sin(), speed]);
    }

    fn continuous() -> Option<&'static str> {
        Some("torque")
    }

    fn log(&self, logged: &mut Vec<f64>) {
        logged.push(self.torque);
    }

    fn step(&mut self, action: usize, rng: &mut Rng) -> Outcome {
        let off = if self.play > 0.0 { rng.uniform(-self.play, self.play) } else { 0.0 };
        self.torque = (LEVELS[action] + off).clamp(-STRONGEST, STRONGEST);
        Outcome { reward: self.push(self.torque), ending: Ending::Continues }
    }
}
