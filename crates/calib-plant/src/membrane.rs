use calib_core::Rng;

use crate::{Membranes, Mode};

/// Pressure over the membrane and the fouling that builds it up.
///
/// Darcy's law with the viscosity of water: `P = μ(T) · J · (R₀ + R_cake + R_pore)`, with the flow J in L/s, μ in
/// mPa·s and resistances in kPa per (L/s · mPa·s). The cake grows in production, faster in turbid water, and a
/// back-pulse removes most of it. The pores clog slowly, and only a chemical clean opens them. The shape is textbook
/// filtration; the constants are our choice.
#[derive(Clone, Debug)]
pub(crate) struct Membrane {
    cake: f64,
    pores: f64,
    /// The cake that remains after the running back-pulse.
    residue: f64,
    fitted: Membranes,
    step_secs: f64,
}

/// Resistance of a clean membrane.
const CLEAN: f64 = 32.0;
/// Limits that cake and clogging approach.
const CAKE_LIMIT: f64 = 70.0;
const PORE_LIMIT: f64 = 45.0;
/// Growth at production flow in clear water.
const CAKE_PER_SECOND: f64 = 0.014;
const PORES_PER_SECOND: f64 = 1.6 / 86_400.0;
const PRODUCTION_FLOW: f64 = 0.28;

impl Membrane {
    pub(crate) fn new(step_secs: f64) -> Self {
        let fitted = Membranes { resistance: 1.0, fouling: 1.0 };
        Self { cake: 4.0, pores: 5.0, residue: 0.0, fitted, step_secs }
    }

    /// Replaces the membranes by new ones, which are clean.
    pub(crate) fn fit(&mut self, membranes: Membranes) {
        *self = Self { cake: 0.0, pores: 0.0, residue: 0.0, fitted: membranes, ..*self };
    }

    /// Sets the fouling to this state.
    pub(crate) fn foul(&mut self, cake: f64, pores: f64) {
        *self = Self { cake, pores, ..*self };
    }

    pub(crate) fn enter(&mut self, mode: Mode, rng: &mut Rng) {
        if mode == Mode::BackPulse {
            self.residue = self.cake * rng.uniform(0.08, 0.3);
        }
    }

    /// Makes one step in `mode` at permeate flow `flow` (L/s, negative in a back-pulse), in water of `turbidity`
    /// (NTU) with `organics` times the usual organic matter.
    pub(crate) fn step(&mut self, mode: Mode, flow: f64, turbidity: f64, organics: f64) {
        let h = self.step_secs;
        match mode {
            Mode::Production => {
                let load = flow.max(0.0) / PRODUCTION_FLOW
                    * (1.0 + 1.5 * turbidity)
                    * (self.fitted.fouling * organics);
                self.cake += h * CAKE_PER_SECOND * load * (1.0 - self.cake / CAKE_LIMIT);
                self.pores += h * PORES_PER_SECOND * load * (1.0 - self.pores / PORE_LIMIT);
                self.cake = self.cake.min(CAKE_LIMIT);
                self.pores = self.pores.min(PORE_LIMIT);
            }
            Mode::BackPulse => relax(&mut self.cake, self.residue, 25.0, h),
            // The cake loosens a little when there is no pressure on it.
            Mode::Standby | Mode::Stopped | Mode::Restart => {
                let rest = 0.6 * self.cake;
                relax(&mut self.cake, rest, 3600.0, h);
            }
            Mode::DrainAndRefill | Mode::IntegrityTest => {}
            Mode::ChemicalClean => {
                relax(&mut self.cake, 0.0, 1800.0, h);
                relax(&mut self.pores, 2.0, 5400.0, h);
            }
        }
    }

    /// Returns the total resistance of membrane, cake and pores.
    pub(crate) fn resistance(&self) -> f64 {
        CLEAN * self.fitted.resistance + self.cake + self.pores
    }

    /// Returns the pressure (kPa) at flow `flow` (L/s) and `celsius`; negative when the flow is.
    pub(crate) fn pressure(&self, flow: f64, celsius: f64) -> f64 {
        // A back-pulse lifts the cake instead of pressing on it.
        let resistance =
            if flow < 0.0 { 0.6 * CLEAN * self.fitted.resistance } else { self.resistance() };
        viscosity(celsius) * flow * resistance
    }
}

/// Relaxes `value` towards `target` with time constant `tau_secs`.
fn relax(value: &mut f64, target: f64, tau_secs: f64, step_secs: f64) {
    *value += (1.0 - (-step_secs / tau_secs).exp()) * (target - *value);
}

/// Returns the dynamic viscosity of water in mPa·s between 0 and 30 °C (the cubic fit used for membrane plants).
pub(crate) fn viscosity(celsius: f64) -> f64 {
    1.784 - 0.0575 * celsius + 0.0011 * celsius * celsius - 1e-5 * celsius.powi(3)
}

#[cfg(test)]
mod tests {
    use calib_core::Seed;

    use super::*;

    fn run(membrane: &mut Membrane, mode: Mode, flow: f64, secs: u32) {
        membrane.enter(mode, &mut Seed::new(1).rng());
        for _ in 0..secs {
            membrane.step(mode, flow, 0.1, 1.0);
        }
    }

    #[test]
    fn production_fouls_and_a_back_pulse_relieves_in_part() {
        let mut membrane = Membrane::new(1.0);
        let fresh = membrane.pressure(0.28, 5.0);
        run(&mut membrane, Mode::Production, 0.28, 1200);
        let fouled = membrane.pressure(0.28, 5.0);
        assert!(fouled > fresh + 3.0, "{fresh} {fouled}");
        run(&mut membrane, Mode::BackPulse, -1.1, 101);
        let relieved = membrane.pressure(0.28, 5.0);
        assert!(relieved < fouled - 3.0 && relieved > 0.9 * fresh, "{relieved}");
    }

    #[test]
    fn only_a_clean_opens_the_pores() {
        let mut membrane = Membrane::new(5.0);
        for _ in 0..50 {
            run(&mut membrane, Mode::Production, 0.28, 240);
            run(&mut membrane, Mode::BackPulse, -1.1, 20);
        }
        let clogged = membrane.pores;
        assert!(clogged > 5.5);
        run(&mut membrane, Mode::ChemicalClean, 0.0, 3600);
        assert!(membrane.pores < 0.6 * clogged && membrane.cake < 0.5);
    }

    /// Returns the cake of new membranes after one second.
    fn cake_grown(organics: f64, fouling: f64) -> f64 {
        let mut membrane = Membrane::new(1.0);
        membrane.fit(Membranes { resistance: 1.0, fouling });
        membrane.step(Mode::Production, 0.28, 0.1, organics);
        membrane.cake
    }

    #[test]
    fn new_membranes_are_clean_and_foul_in_their_own_way() {
        let mut membrane = Membrane::new(1.0);
        run(&mut membrane, Mode::Production, 0.28, 3600);
        membrane.fit(Membranes { resistance: 1.25, fouling: 2.0 });
        assert!((membrane.resistance() - 1.25 * CLEAN).abs() < 1e-12);
        assert!((cake_grown(1.0, 2.0) / cake_grown(1.0, 1.0) - 2.0).abs() < 1e-12);
        assert!((cake_grown(2.0, 1.0) / cake_grown(1.0, 1.0) - 2.0).abs() < 1e-12);
    }

    fn resistance_after(step_secs: f64, steps: u32) -> f64 {
        let mut membrane = Membrane::new(step_secs);
        run(&mut membrane, Mode::Production, 0.28, steps);
        membrane.resistance()
    }

    #[test]
    fn fouling_does_not_depend_on_the_step() {
        assert!((resistance_after(1.0, 3600) / resistance_after(5.0, 720) - 1.0).abs() < 1e-3);
    }

    #[test]
    fn water_is_thicker_in_winter() {
        // 1.519 mPa·s at 5 °C and 1.002 at 20 °C in the usual tables.
        assert!((viscosity(5.0) - 1.519).abs() < 0.02);
        assert!((viscosity(20.0) - 1.002).abs() < 0.02);
    }
}
