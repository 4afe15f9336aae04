//! Whether two processors compute the same numbers: a class is what this one makes of a few problems that are always the
//! same. It is computed and not looked up, so that it need not be known what processors, systems and libraries differ in.

use calib_agent::{AgentConfig, CurveRule, OptimiserKind, Part, Precision, ValueFunction, train};
use calib_base::StepError;
use calib_core::{RowIndex, RowStream, Seed, Silent, States};
use calib_files::Fingerprinter;

/// Arguments of each elementary function.
const ARGUMENTS: usize = 2048;
/// Columns and steps of what agents learn from.
const COLUMNS: usize = 20;
const STEPS: usize = 160;

/// Some digits that stand for the numbers that this processor, its system and its libraries compute. Where they are equal, so
/// are results.
pub(crate) fn class() -> Result<String, StepError> {
    let mut fingerprint = Fingerprinter::default();
    for bits in elementary().chain(trained()?) {
        fingerprint.add(&bits.to_le_bytes());
    }
    Ok(fingerprint.finish().short().to_owned())
}

/// What the functions of the system's library give that results are computed with.
fn elementary() -> impl Iterator<Item = u64> {
    let arguments = (0..ARGUMENTS).map(|number| 0.003_7 * number as f64 - 3.7);
    arguments.flat_map(|x| {
        let positive = x.abs() + 1e-3;
        [x.exp(), positive.ln(), x.tanh(), positive.powf(0.37), positive.sqrt(), x.sin(), x.cos()]
            .map(f64::to_bits)
    })
}

/// The errors of agents of every kind.
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
