use calib_core::Rng;

use super::Task;
use crate::{Ending, Outcome};

/// A pole on a cart that is pushed left or right. The reward is 1 per step until the pole leans more than 12° or the cart is 2.4 m away.
///
/// Source: Barto, Sutton & Anderson (1983). Numbers, and the Euler step of 0.02 s, are those of Gymnasium's `CartPole-v1`. The state
/// holds the place of the cart in m, its speed in m/s, the angle of the pole in rad, and its speed in rad/s. With probability `slip` a
/// push has a random direction; in Gymnasium it never has.
#[derive(Clone, Debug)]
pub struct CartPole {
    pub(crate) state: [f64; 4],
    slip: f64,
    /// Length of a step, in seconds.
    step: f64,
}

impl Default for CartPole {
    fn default() -> Self {
        Self { state: [0.0; 4], slip: 0.0, step: 0.02 }
    }
}

impl CartPole {
    /// Returns the task in which this share of the pushes has a random direction.
    pub fn with_slip(slip: f64) -> Self {
        Self { slip, ..Self::default() }
    }

    /// Returns the task with steps that are `times` as long.
    pub fn with_longer_steps(times: f64) -> Self {
        Self { step: 0.02 * times, ..Self::default() }
    }
}

const FORCE: f64 = 10.0;
const MASS_OF_POLE: f64 = 0.1;
const MASS: f64 = 1.0 + MASS_OF_POLE;
/// Half of the pole's length, in m.
const LENGTH: f64 = 0.5;
const FARTHEST: f64 = 2.4;
const STEEPEST: f64 = 12.0 * 2.0 * std::f64::consts::PI / 360.0;

impl Task for CartPole {
    fn columns() -> &'static [(&'static str, f64, f64)] {
        &[
            ("place", -FARTHEST, FARTHEST),
            ("speed", -3.0, 3.0),
            ("angle", -STEEPEST, STEEPEST),
            ("angular_speed", -3.5, 3.5),
        ]
    }

    fn actions() -> &'static [&'static str] {
        &["left", "right"]
    }

    fn start(&mut self, rng: &mut Rng) {
        self.state = [(); 4].map(|()| rng.uniform(-0.05, 0.05));
    }

    fn start_anywhere(&mut self, rng: &mut Rng) {
        self.state = [2.0, 1.0, 0.15, 1.0].map(|most| rng.uniform(-most, most));
    }

    fn observe(&self, observed: &mut Vec<f64>) {
        observed.clear();
        observed.extend(self.state);
    }

    fn step(&mut self, action: usize, rng: &mut Rng) -> Outcome {
        let slips = self.slip > 0.0 && rng.unit() < self.slip;
        let action = if slips { rng.below(2) } else { action };
        let force = [-FORCE, FORCE][action];
        let step = self.step;
        let [place, speed, angle, turn] = self.state;
        let (sin, cos) = angle.sin_cos();
        let pushed = (force + MASS_OF_POLE * LENGTH * turn * turn * sin) / MASS;
        let turned =
            (9.8 * sin - cos * pushed) / (LENGTH * (4.0 / 3.0 - MASS_OF_POLE * cos * cos / MASS));
        let moved = pushed - MASS_OF_POLE * LENGTH * turned * cos / MASS;
        self.state =
            [place + step * speed, speed + step * moved, angle + step * turn, turn + step * turned];
        let fell = self.state[0].abs() > FARTHEST || self.state[2].abs() > STEEPEST;
        Outcome { reward: 1.0, ending: Ending::terminal_if(fell) }
    }
}
