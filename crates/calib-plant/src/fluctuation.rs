use calib_core::Rng;

/// A stationary Ornstein–Uhlenbeck process, sampled exactly:
/// x(t + h) = a x(t) + σ √(1 − a²) ε with a = exp(−h/τ) and ε standard normal.
#[derive(Clone, Debug)]
pub(crate) struct Fluctuation {
    keep: f64,
    kick: f64,
    value: f64,
}

impl Fluctuation {
    /// Returns a process of standard deviation `deviation` and time constant `tau_secs`, started
    /// from its stationary distribution and sampled every `step_secs`.
    pub(crate) fn new(deviation: f64, tau_secs: f64, step_secs: f64, rng: &mut Rng) -> Self {
        let keep = (-step_secs / tau_secs).exp();
        Self { keep, kick: deviation * (1.0 - keep * keep).sqrt(), value: deviation * rng.normal() }
    }

    /// Returns the value one step later.
    pub(crate) fn step(&mut self, rng: &mut Rng) -> f64 {
        self.value = self.keep * self.value + self.kick * rng.normal();
        self.value
    }

    pub(crate) fn value(&self) -> f64 {
        self.value
    }
}

/// A quantity that follows its target with a first-order lag, exact for a target held over a step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Follower {
    gain: f64,
    pub(crate) value: f64,
}

impl Follower {
    /// Returns a follower that starts at `value` and has the time constant `tau_secs`.
    pub(crate) fn new(value: f64, tau_secs: f64, step_secs: f64) -> Self {
        Self { gain: 1.0 - (-step_secs / tau_secs).exp(), value }
    }

    /// Returns a follower with the same value and another time constant.
    #[must_use]
    pub(crate) fn with_time_constant(self, tau_secs: f64, step_secs: f64) -> Self {
        Self::new(self.value, tau_secs, step_secs)
    }

    /// Makes one step towards `target`, and returns the new value.
    pub(crate) fn step(&mut self, target: f64) -> f64 {
        self.value += self.gain * (target - self.value);
        self.value
    }
}

#[cfg(test)]
mod tests {
    use calib_core::Seed;

    use super::*;

    /// Returns standard deviation, and correlation over 600 s, of a process with deviation 2 and τ =
    /// 600 s.
    fn moments(step_secs: f64) -> (f64, f64) {
        let mut rng = Seed::new(5).rng();
        let mut process = Fluctuation::new(2.0, 600.0, step_secs, &mut rng);
        let n = 200_000;
        let values: Vec<f64> = (0..n).map(|_| process.step(&mut rng)).collect();
        let lag = (600.0 / step_secs) as usize;
        let square = values.iter().map(|x| x * x).sum::<f64>() / n as f64;
        let cross = values.iter().zip(&values[lag..]).map(|(x, y)| x * y).sum::<f64>();
        (square.sqrt(), cross / (n - lag) as f64 / square)
    }

    #[test]
    fn fluctuations_are_the_same_at_any_step() {
        for step_secs in [60.0, 200.0] {
            let (deviation, correlation) = moments(step_secs);
            assert!((deviation - 2.0).abs() < 0.1, "{step_secs}: {deviation}");
            assert!((correlation - (-1.0_f64).exp()).abs() < 0.05, "{step_secs}: {correlation}");
        }
    }

    #[test]
    fn followers_do_not_depend_on_the_step() {
        let mut fine = Follower::new(0.0, 30.0, 1.0);
        let mut coarse = Follower::new(0.0, 30.0, 10.0);
        for _ in 0..10 {
            fine.step(5.0);
        }
        coarse.step(5.0);
        assert!((fine.value - coarse.value).abs() < 1e-12);
    }
}
