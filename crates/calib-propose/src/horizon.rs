use calib_data::Sketch;

/// The horizon ends where the autocorrelation of the sensor falls below this value.
const LEFT: f64 = 0.5;
/// Shortest and longest horizon in states.
const STATES: (f64, f64) = (5.0, 50.0);
/// Longest horizon as a share of a run: an agent that starts from scratch then sees about 100 returns.
const SHARE: f64 = 1.0 / 100.0;

/// Effective horizon of the predictions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Horizon {
    /// Length in seconds.
    pub secs: f64,
    /// Length in states.
    pub states: f64,
    /// `agent.gamma`, which is `1 - 1 / states`.
    pub gamma: f64,
}

impl Horizon {
    /// Creates a horizon of `secs` seconds, for states `spacing_secs` apart. Rounds gamma.
    pub fn new(secs: f64, spacing_secs: f64) -> Self {
        let states = (secs / spacing_secs).max(1.0);
        // Further digits of `1 - gamma` have no practical effect.
        let rest = 1.0 / states;
        let digits = (1.0 - rest.log10().floor()).max(2.0);
        let scale = 10_f64.powf(digits);
        let gamma = ((1.0 - rest) * scale).round() / scale;
        Self { secs: spacing_secs / (1.0 - gamma).max(1e-9), states: 1.0 / (1.0 - gamma), gamma }
    }

    /// Whether it is shorter than `secs` by more than rounding can explain.
    pub fn is_shorter_than(&self, secs: f64) -> bool {
        self.secs < 0.8 * secs
    }

    /// Returns the fewest steps of a run for which this horizon is proposed.
    pub(crate) fn least_steps(&self) -> usize {
        (self.states / SHARE).round() as usize
    }
}

/// Proposes the median, over the sensors, of the time at which the autocorrelation falls below a half, within the limits for
/// runs of `steps` states. (Our choice: at a shorter horizon a sensor predicts itself; at a longer one nothing predicts it.)
pub fn horizon(sketch: &Sketch, sensors: &[usize], spacing: usize, steps: usize) -> Horizon {
    let mut all: Vec<f64> = sensors
        .iter()
        .map(|&sensor| {
            let lags = &sketch.channels[sensor].autocorrelation;
            let first = lags.iter().find(|(_, value)| *value < LEFT);
            first.or(lags.last()).map_or(1.0, |(lag, _)| *lag as f64)
        })
        .collect();
    all.sort_by(f64::total_cmp);
    let rows = all.get(all.len() / 2).copied().unwrap_or(1.0);
    let most = STATES.1.min(SHARE * steps as f64).max(STATES.0);
    let states = (rows / spacing as f64).clamp(STATES.0, most);
    let spacing_secs = sketch.period_secs * spacing as f64;
    Horizon::new(states * spacing_secs, spacing_secs)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{sketch, wave};

    fn gamma(secs: f64, spacing_secs: f64) -> f64 {
        Horizon::new(secs, spacing_secs).gamma
    }

    #[test]
    fn gamma_is_a_horizon_in_seconds() {
        assert_eq!(
            [gamma(100.0, 1.0), gamma(100.0, 10.0), gamma(6_000.0, 60.0)],
            [0.99, 0.9, 0.99]
        );
        assert_eq!(gamma(1_000.0, 30.0), 0.97);
        assert_eq!(gamma(1_000.0, 1.0), 0.999);
        assert_eq!(gamma(5.0, 10.0), 0.0, "less than a state ahead is the next state");
        let horizon = Horizon::new(1_000.0, 30.0);
        assert!((horizon.states - 33.3).abs() < 0.1 && (horizon.secs - 1_000.0).abs() < 1.0);
    }

    #[test]
    fn slow_sensors_are_predicted_further_ahead_within_what_runs_allow() {
        let log = sketch(20_000, &[("fast", wave(60.0)), ("slow", wave(3_000.0))]);
        assert_eq!(
            horizon(&log, &[0], 1, 3_000).states.round(),
            15.0,
            "the first distance looked at beyond a sixth of the wave"
        );
        assert_eq!(horizon(&log, &[1], 1, 6_000).states.round(), 50.0, "no more");
        assert_eq!(horizon(&log, &[1], 1, 3_000).states.round(), 30.0, "a hundredth of the run");
        assert_eq!(horizon(&log, &[1], 1, 6_000).least_steps(), 5_000);
        assert_eq!(horizon(&log, &[0], 10, 3_000).states.round(), 5.0, "no less");
    }
}
