use calib_core::{Rng, Seed};
use calib_plant::{OperatedPlant, RECIPES, Recipe, TRIP_KPA, operators_rule};

use super::{Rule, Task};
use crate::{Ending, Outcome};

/// A membrane plant whose recipe is chosen every half hour. An episode ends when the plant trips and must be cleaned.
///
/// The reward is in cents, [`Membrane::reward`]: permeate at 12 ct/m³, less energy at 20 ct/kWh, coagulant at 0.8 ct/g, 0.1 ct for each kPa
/// above 35 kPa, and 200 ct for a clean after a trip. Prices are our choice.
#[derive(Clone, Debug)]
pub struct Membrane {
    plant: OperatedPlant,
}

/// Weights of the values that are logged beside the state: permeate (m³), energy (kWh), coagulant (g), and whether a clean was needed.
const PRICES: [f64; 4] = [12.0, -20.0, -0.8, -200.0];
/// Weight of each kPa above the limit, and the limit.
const STRAIN: f64 = -0.1;
const STRAIN_ABOVE_KPA: f64 = 35.0;

impl Membrane {
    /// Returns the plant of this seed.
    pub fn new(seed: Seed) -> Self {
        Self { plant: OperatedPlant::new(seed) }
    }

    /// Returns the reward as a study writes it, from the logged columns.
    pub fn reward() -> String {
        let mut terms = vec![format!(
            "{{ column = \"PRESSURE_KPA\", weight = {STRAIN:?}, high = {STRAIN_ABOVE_KPA:?} }}"
        )];
        let priced = Self::logged().iter().zip(PRICES);
        terms.extend(
            priced
                .map(|(column, price)| format!("{{ column = \"{column}\", weight = {price:?} }}")),
        );
        format!("[\n    {},\n]", terms.join(",\n    "))
    }
}

/// Returns one property of each recipe.
fn of_recipes(setting: fn(&Recipe) -> f64) -> Vec<f64> {
    RECIPES.iter().map(setting).collect()
}

impl Task for Membrane {
    fn columns() -> &'static [(&'static str, f64, f64)] {
        &[
            ("PRESSURE_KPA", 0.0, TRIP_KPA),
            ("RESISTANCE", 20.0, 100.0),
            ("TEMPERATURE_C", 0.0, 15.0),
            ("TURBIDITY_NTU", 0.0, 2.0),
        ]
    }

    fn actions() -> &'static [&'static str] {
        &["relief", "normal", "long", "dosed", "careful", "high", "high dosed", "high careful"]
    }

    fn settings() -> Vec<(&'static str, Vec<f64>)> {
        vec![
            ("PULSE_INTERVAL_S", of_recipes(|recipe| recipe.interval_secs)),
            ("PULSE_LENGTH_S", of_recipes(|recipe| recipe.pulse_secs)),
            ("DOSE_MG_L", of_recipes(|recipe| recipe.dose_mg_per_litre)),
            ("FLOW_SETPOINT_L_S", of_recipes(|recipe| recipe.flow_litres_per_second)),
        ]
    }

    fn logged() -> &'static [&'static str] {
        &["PERMEATE_M3", "ENERGY_KWH", "COAGULANT_G", "CLEANED"]
    }

    fn log(&self, logged: &mut Vec<f64>) {
        let account = self.plant.account();
        let cleaned = f64::from(u8::from(account.tripped));
        logged.extend([account.permeate_m3, account.energy_kwh, account.chemicals_g, cleaned]);
    }

    fn rule() -> Option<Rule> {
        Some(|observed| operators_rule(observed[0], observed[3]))
    }

    fn start(&mut self, rng: &mut Rng) {
        self.plant.start_clean(rng);
    }

    fn start_anywhere(&mut self, rng: &mut Rng) {
        self.plant.start_anywhere(rng);
    }

    fn observe(&self, observed: &mut Vec<f64>) {
        let reading = self.plant.reading();
        observed.clear();
        observed.extend([
            reading.pressure_kpa,
            reading.resistance,
            reading.temperature_celsius,
            reading.turbidity_ntu,
        ]);
    }

    fn step(&mut self, action: usize, rng: &mut Rng) -> Outcome {
        let account = self.plant.operate(&RECIPES[action], rng);
        let mut logged = Vec::with_capacity(PRICES.len());
        self.log(&mut logged);
        let priced: f64 = logged.iter().zip(PRICES).map(|(amount, price)| amount * price).sum();
        let strain = (self.plant.reading().pressure_kpa - STRAIN_ABOVE_KPA).max(0.0);
        Outcome { reward: priced + STRAIN * strain, ending: Ending::terminal_if(account.tripped) }
    }
}
