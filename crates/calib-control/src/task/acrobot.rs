use std::f64::consts::PI;

use calib_core::Rng;

use super::Task;
use crate::{Ending, Outcome};

/// Two links with torque on the joint between them. The reward is −1 per step until the tip is one link above the bar, and 0 for the
/// step that gets there.
///
/// Source: Sutton & Barto (2018, section 11.2 of the first edition). Numbers, and the fourth-order Runge–Kutta step of 0.2 s,
/// are those of Gymnasium's `Acrobot-v1`. The state holds the angles of both links in rad, wrapped to ±π, and their speeds in
/// rad/s, cut at ±4π and ±9π.
#[derive(Clone, Debug)]
pub struct Acrobot {
    pub(crate) state: [f64; 4],
    /// Length of a step, in seconds.
    step: f64,
}

impl Default for Acrobot {
    fn default() -> Self {
        Self { state: [0.0; 4], step: 0.2 }
    }
}

const SPEEDS: [f64; 2] = [4.0 * PI, 9.0 * PI];

impl Acrobot {
    /// Returns the task with steps that are `times` as long.
    pub fn with_longer_steps(times: f64) -> Self {
        Self { step: 0.2 * times, ..Self::default() }
    }

    /// Returns the change of the state per second under `torque`.
    fn change([first, second, speed, second_speed]: [f64; 4], torque: f64) -> [f64; 4] {
        // Masses, lengths and moments of inertia are 1; centres of mass are half-way.
        let centre = 0.5;
        let gravity = 9.8;
        let d1 = centre * centre + (1.0 + centre * centre + 2.0 * centre * second.cos()) + 2.0;
        let d2 = centre * centre + centre * second.cos() + 1.0;
        let phi2 = centre * gravity * (first + second - PI / 2.0).cos();
        let phi1 = -centre * second_speed.powi(2) * second.sin()
            - 2.0 * centre * second_speed * speed * second.sin()
            + (centre + 1.0) * gravity * (first - PI / 2.0).cos()
            + phi2;
        let second_change =
            (torque + d2 / d1 * phi1 - centre * speed.powi(2) * second.sin() - phi2)
                / (centre * centre + 1.0 - d2 * d2 / d1);
        let first_change = -(d2 * second_change + phi1) / d1;
        [speed, second_speed, first_change, second_change]
    }

    fn above_the_bar(&self) -> bool {
        let [first, second, ..] = self.state;
        -first.cos() - (first + second).cos() > 1.0
    }
}

/// Returns the state after `secs` seconds of this change per second.
#[inline]
fn moved(state: [f64; 4], change: [f64; 4], secs: f64) -> [f64; 4] {
    std::array::from_fn(|part| state[part] + secs * change[part])
}

/// Returns the angle plus or minus full turns, in ±π.
pub(super) fn wrapped(mut angle: f64) -> f64 {
    while angle > PI {
        angle -= 2.0 * PI;
    }
    while angle < -PI {
        angle += 2.0 * PI;
    }
    angle
}

impl Task for Acrobot {
    fn columns() -> &'static [(&'static str, f64, f64)] {
        &[
            ("cos_first", -1.0, 1.0),
            ("sin_first", -1.0, 1.0),
            ("cos_second", -1.0, 1.0),
            ("sin_second", -1.0, 1.0),
            ("speed_first", -SPEEDS[0], SPEEDS[0]),
            ("speed_second", -SPEEDS[1], SPEEDS[1]),
        ]
    }

    fn actions() -> &'static [&'static str] {
        &["minus", "none", "plus"]
    }

    fn start(&mut self, rng: &mut Rng) {
        self.state = [(); 4].map(|()| rng.uniform(-0.1, 0.1));
    }

    fn start_anywhere(&mut self, rng: &mut Rng) {
        loop {
            self.state = [PI, PI, 2.0, 4.0].map(|most| rng.uniform(-most, most));
            if !self.above_the_bar() {
                return;
            }
        }
    }

    fn observe(&self, observed: &mut Vec<f64>) {
        let [first, second, speed, second_speed] = self.state;
        observed.clear();
        observed.extend([
            first.cos(),
            first.sin(),
            second.cos(),
            second.sin(),
            speed,
            second_speed,
        ]);
    }

    fn step(&mut self, action: usize, _rng: &mut Rng) -> Outcome {
        let torque = [-1.0, 0.0, 1.0][action];
        let Self { state: from, step } = *self;
        let k1 = Self::change(from, torque);
        let k2 = Self::change(moved(from, k1, step / 2.0), torque);
        let k3 = Self::change(moved(from, k2, step / 2.0), torque);
        let k4 = Self::change(moved(from, k3, step), torque);
        let mut next: [f64; 4] = std::array::from_fn(|part| {
            from[part] + step / 6.0 * (k1[part] + 2.0 * k2[part] + 2.0 * k3[part] + k4[part])
        });
        for angle in &mut next[..2] {
            *angle = wrapped(*angle);
        }
        for (speed, most) in next[2..].iter_mut().zip(SPEEDS) {
            *speed = speed.clamp(-most, most);
        }
        self.state = next;
        let ending = Ending::terminal_if(self.above_the_bar());
        Outcome { reward: if ending == Ending::Terminal { 0.0 } else { -1.0 }, ending }
    }
}
