use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The form of the loss: two published forms exist.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
pub enum LossForm {
    /// β weighs the whole repulsion: β · mean [(ψᵢ·ψⱼ)² − ζ‖ψᵢ‖² − ζ‖ψⱼ‖²].
    #[default]
    A,
    /// β weighs the squared product only: mean [β(ψᵢ·ψⱼ)² − ζ‖ψᵢ‖² − ζ‖ψⱼ‖²].
    B,
}

/// The loss of a Laplacian representation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct LossConfig {
    /// Form of the loss. Default `A`.
    pub form: LossForm,
    /// Weight c of the attraction of successive states, > 0. Default 1; the lab's code has 0.5.
    pub attraction: f64,
    /// Weight β of the repulsion, > 0. Default 5 (paper).
    pub beta: f64,
    /// Target ζ of the second moments, which the repulsion drives them to, > 0. Default 0.05 (paper).
    pub zeta: f64,
}

impl Default for LossConfig {
    fn default() -> Self {
        Self { form: LossForm::A, attraction: 1.0, beta: 5.0, zeta: 0.05 }
    }
}

impl LossConfig {
    /// Returns the weights of Σ (ψᵢ·ψⱼ)² and of Σ (‖ψᵢ‖² + ‖ψⱼ‖²) in the mean over pairs.
    pub fn repulsion(&self) -> (f64, f64) {
        match self.form {
            LossForm::A => (self.beta, self.beta * self.zeta),
            LossForm::B => (self.beta, self.zeta),
        }
    }
}

/// Hyperparameters of one representation. Every field is a scalar and has a default.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct LaplacianConfig {
    /// The loss.
    #[serde(flatten)]
    pub loss: LossConfig,
    /// Decay κ of the time between the states of a pair, in (0, 1]. Default 0.95 (paper).
    pub kappa: f64,
    /// Number of states T of a sub-trajectory: pairs are 1 to T − 1 steps apart; at least 2. Default
    /// 20 (paper).
    pub trajectory: usize,
    /// Dimensions d of ψ. Default 64 (paper).
    pub dimension: usize,
    /// Hidden layers of the encoder, 1 to 16. Default 2 (paper).
    pub hidden_layers: usize,
    /// Units of each hidden layer. Default 256 (paper).
    pub hidden_units: usize,
    /// Step size of Adam, > 0. Default 3e-4 (paper, one week of data).
    pub learning_rate: f64,
    /// Pairs of a mini-batch, and states that repel each other; at least 2. Default 256 (paper).
    pub batch_size: usize,
    /// Number of updates. Default 100,000 (paper, one week of data).
    pub steps: usize,
}

impl Default for LaplacianConfig {
    fn default() -> Self {
        Self {
            loss: LossConfig::default(),
            kappa: 0.95,
            trajectory: 20,
            dimension: 64,
            hidden_layers: 2,
            hidden_units: 256,
            learning_rate: 3e-4,
            batch_size: 256,
            steps: 100_000,
        }
    }
}

/// A hyperparameter outside its range.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{field}`: expected {expected}, got {got}")]
pub struct RepresentConfigError {
    /// Name of the field, as in a study.
    pub field: &'static str,
    /// The valid values.
    pub expected: &'static str,
    /// The value that was given.
    pub got: String,
}

impl LaplacianConfig {
    /// Checks that every field is inside its range.
    ///
    /// # Errors
    /// The first field that is outside.
    pub fn check(&self) -> Result<(), RepresentConfigError> {
        let positive = "a number above 0";
        check_real("attraction", self.loss.attraction, f64::MAX, positive)?;
        check_real("beta", self.loss.beta, f64::MAX, positive)?;
        check_real("zeta", self.loss.zeta, f64::MAX, positive)?;
        check_real("kappa", self.kappa, 1.0, "above 0, at most 1")?;
        check_real("learning_rate", self.learning_rate, 1e38, positive)?;
        check_whole("trajectory", self.trajectory, 2, 1_000_000, "from 2 to 1000000")?;
        check_whole("dimension", self.dimension, 1, 1024, "from 1 to 1024")?;
        check_whole("hidden_layers", self.hidden_layers, 1, 16, "from 1 to 16")?;
        check_whole("hidden_units", self.hidden_units, 1, 16_384, "from 1 to 16384")?;
        check_whole("batch_size", self.batch_size, 2, 65_536, "from 2 to 65536")?;
        check_whole("steps", self.steps, 1, 100_000_000, "from 1 to 100000000")
    }

    /// Returns the layer sizes of the encoder for states of `columns` values, input first.
    pub fn sizes(&self, columns: usize) -> Vec<usize> {
        let mut sizes = vec![self.hidden_units; self.hidden_layers + 2];
        sizes[0] = columns;
        sizes[self.hidden_layers + 1] = self.dimension;
        sizes
    }
}

/// Returns an error unless `got` is above 0 and at most `most`.
fn check_real(
    field: &'static str,
    got: f64,
    most: f64,
    expected: &'static str,
) -> Result<(), RepresentConfigError> {
    let ok = got > 0.0 && got.is_finite() && got <= most;
    if ok { Ok(()) } else { Err(RepresentConfigError { field, expected, got: format!("{got:?}") }) }
}

/// Returns an error unless `got` is from `least` to `most`.
fn check_whole(
    field: &'static str,
    got: usize,
    least: usize,
    most: usize,
    expected: &'static str,
) -> Result<(), RepresentConfigError> {
    let ok = (least..=most).contains(&got);
    if ok { Ok(()) } else { Err(RepresentConfigError { field, expected, got: got.to_string() }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn come_back_from_a_manifest() {
        let loss = LossConfig { zeta: 0.1, form: LossForm::B, ..LossConfig::default() };
        let config = LaplacianConfig { loss, kappa: 0.5, steps: 7, ..LaplacianConfig::default() };
        let text = serde_json::to_string(&config).expect("JSON");
        assert_eq!(serde_json::from_str::<LaplacianConfig>(&text).expect("JSON"), config);
    }

    fn refused_field(config: LaplacianConfig) -> &'static str {
        config.check().expect_err("outside").field
    }

    #[test]
    fn fields_outside_their_range_are_named() {
        let base = LaplacianConfig::default();
        base.check().expect("defaults are valid");
        assert_eq!(refused_field(LaplacianConfig { kappa: 1.5, ..base }), "kappa");
        assert_eq!(
            refused_field(LaplacianConfig { learning_rate: f64::NAN, ..base }),
            "learning_rate"
        );
        assert_eq!(refused_field(LaplacianConfig { batch_size: 1, ..base }), "batch_size");
        let loss = LossConfig { zeta: 0.0, ..base.loss };
        assert_eq!(refused_field(LaplacianConfig { loss, ..base }), "zeta");
    }
}
