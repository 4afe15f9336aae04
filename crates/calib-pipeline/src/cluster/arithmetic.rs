//! Detects whether two processors compute the same numbers. The class of a processor is a fingerprint of its results
//! for a few fixed problems. It is computed, so that nothing has to be known about differences in processors, systems
//! and libraries.

use calib_agent::{AgentConfig, CurveRule, OptimiserKind, Part, Precision, ValueFunction, train};
use calib_base::StepError;
use calib_core::{RowIndex, RowStream, Seed, Silent, States};
use calib_files::Fingerprinter;

/// Number of arguments per elementary function.
const ARGUMENTS: usize = 2048;
/// Columns and steps of the training data.
const COLUMNS: usize = 20;
const STEPS: usize = 160;

/// Returns a short fingerprint of the numbers that this processor, its system and its libraries compute. Processors
/// with the same fingerprint give the same results.
pub(crate) fn class() -> Result<String, StepError> {
    let mut fingerprint = Fingerprinter::default();
    for bits in elementary().chain(trained()?) {
        fingerprint.add(&bits.to_le_bytes());
    }
    Ok(fingerprint.finish().short().to_owned())
}

/// Returns the results of the system library's functions that calib uses.
fn elementary() -> impl Iterator<Item = u64> {
    let arguments = (0..ARGUMENTS).map(|number| 0.003_7 * number as f64 - 3.7);
    arguments.flat_map(|x| {
        let positive = x.abs() + 1e-3;
        [x.exp(), positive.ln(), x.tanh(), positive.powf(0.37), positive.sqrt(), x.sin(), x.cos()]
            .map(f64::to_bits)
    })
}

/// Returns the errors of agents of every kind.
fn trained() -> Result<Vec<u64>, StepError> {
    let mut random = Seed::new(5).rng();
    let values = (0..STEPS * COLUMNS).map(|_| random.unit() as f32).collect();
    let rows = (0..STEPS).map(RowIndex::new).collect();
    let stream = RowStream::unbroken(States::new(values, STEPS, COLUMNS)?, rows);
    let network = AgentConfig {
        hidden_units: 40,
        gamma: 0.5,
        batch_size: 24,
        learning_rate: 1e-2,
        ..AgentConfig::default()
    };
    let agents = [
        AgentConfig { precision: Precision::Bf16, ..network.clone() },
        AgentConfig { optimiser: OptimiserKind::Sgd, hidden_layers: 1, ..network.clone() },
        AgentConfig { value_function: ValueFunction::Linear, ..network.clone() },
        network,
    ];
    let outcomes = train(&stream, 0, &agents, CurveRule::default(), Seed::new(1), &Silent)?;
    let errors = (outcomes.iter())
        .map(|outcome| outcome.scores.of(Part::WholeRun).map_or(0.0, |score| score.rmse));
    Ok(errors.map(f64::to_bits).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_processor_is_always_of_the_same_class() {
        let first = class().expect("computed");
        assert_eq!(first, class().expect("computed"));
        assert!(trained().expect("computed").iter().all(|bits| f64::from_bits(*bits) > 0.0));
    }
}
