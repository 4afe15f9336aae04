//! The recipes by which a plant can be operated.

/// The settings of the plant until the next decision.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Recipe {
    /// Name that operators use.
    pub name: &'static str,
    /// Production time from one back-pulse to the next, s.
    pub interval_secs: f64,
    /// Length of a back-pulse, s.
    pub pulse_secs: f64,
    /// Coagulant in the feed, mg/L.
    pub dose_mg_per_litre: f64,
    /// Permeate drawn in production, L/s.
    pub flow_litres_per_second: f64,
}

const fn recipe(name: &'static str, settings: [f64; 4]) -> Recipe {
    let [interval_secs, pulse_secs, dose_mg_per_litre, flow_litres_per_second] = settings;
    Recipe { name, interval_secs, pulse_secs, dose_mg_per_litre, flow_litres_per_second }
}

/// All recipes of a plant: back-pulse interval (s) and length (s), dose (mg/L), flow (L/s).
pub const RECIPES: [Recipe; 8] = [
    recipe("relief", [900.0, 90.0, 2.0, 0.20]),
    recipe("normal", [1800.0, 60.0, 0.0, 0.28]),
    recipe("long", [3600.0, 60.0, 0.0, 0.28]),
    recipe("dosed", [1800.0, 60.0, 2.0, 0.28]),
    recipe("careful", [900.0, 60.0, 2.0, 0.28]),
    recipe("high", [1800.0, 60.0, 0.0, 0.36]),
    recipe("high dosed", [1800.0, 60.0, 2.0, 0.36]),
    recipe("high careful", [900.0, 60.0, 2.0, 0.36]),
];

/// Returns the recipe that a cautious operator chooses: relief at high pressure, care in turbid water or at raised
/// pressure, and normal otherwise. The highest flows are never used.
pub fn operators_rule(pressure_kpa: f64, turbidity_ntu: f64) -> usize {
    match (pressure_kpa, turbidity_ntu) {
        (pressure, _) if pressure > 45.0 => 0,
        (pressure, turbidity) if pressure > 33.0 || turbidity > 0.5 => 4,
        _ => 1,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chosen(pressure: f64, turbidity: f64) -> &'static str {
        RECIPES[operators_rule(pressure, turbidity)].name
    }

    #[test]
    fn the_rule_is_cautious() {
        assert_eq!(
            [chosen(20.0, 0.1), chosen(20.0, 0.9), chosen(50.0, 0.1)],
            ["normal", "careful", "relief"]
        );
    }
}
