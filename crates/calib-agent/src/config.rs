use std::{collections::BTreeMap, fmt::Display};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::SimplePredictor;

mod baseline;
mod external;
mod kind;

pub use kind::AgentKind;
use kind::{STATES_PER_MESSAGE, TIMEOUT_SECS};

/// How the value of a state is computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ValueFunction {
    /// Multilayer perceptron with `ReLU` between layers.
    #[default]
    Mlp,
    /// A linear function: weights and a bias.
    Linear,
}

/// The numbers that an MLP multiplies. Sums and all stored numbers are in single precision in either case.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Precision {
    /// Single precision.
    #[default]
    F32,
    /// bfloat16: weights, states, activations and errors are rounded to eight significant bits before multiplication.
    Bf16,
}

/// How an update changes the parameters along the semi-gradient.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum OptimiserKind {
    /// Adam with bias correction.
    #[default]
    Adam,
    /// Gradient descent.
    Sgd,
    /// True online TD(λ) of a linear agent, updated at every step.
    TrueOnlineTd,
    /// True online TD(λ) with an adaptive step size for each weight and a bound on the learning rate (`SwiftTD`).
    SwiftTd,
}

impl OptimiserKind {
    /// Returns the name in a study.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Adam => "adam",
            Self::Sgd => "sgd",
            Self::TrueOnlineTd => "true_online_td",
            Self::SwiftTd => "swift_td",
        }
    }

    /// Whether the optimiser learns from each transition once, in time order, with eligibility traces.
    pub(crate) fn has_traces(self) -> bool {
        matches!(self, Self::TrueOnlineTd | Self::SwiftTd)
    }
}

/// The transitions that an update learns from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ReplayKind {
    /// A mini-batch drawn uniformly, with replacement, from the latest `replay_capacity` transitions.
    #[default]
    Uniform,
    /// The current transition only.
    None,
}

/// Hyperparameters of a TD(0) agent, or of the agent of another program. Every field has a default. All fields are scalars except `traces`
/// and the fields of programs. Fields of programs are omitted where they have their defaults.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct AgentConfig {
    /// `"td"` (default): calib's own agents. `"external"`: agents of a program, which reads states and answers with predictions. With
    /// `"external"`, the only other keys with an effect are `gamma`, `command`, `parameters`, `states_per_message` and `timeout_secs`.
    #[serde(skip_serializing_if = "is_default")]
    #[schemars(extend("default" = "td"))]
    pub kind: AgentKind,
    /// With `kind = "external"`: the program and its arguments, such as `["python3", "agent.py"]`. calib starts it in the folder of the
    /// study, once for each run and sensor.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    #[schemars(extend("default" = []))]
    pub command: Vec<String>,
    /// With `kind = "external"`: hyperparameters by name, with their defaults. `[sweep.grid]` varies them.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    #[schemars(extend("default" = {}))]
    pub parameters: BTreeMap<String, Value>,
    /// With `kind = "external"`: the maximum number of states in a message, from 1 to 1048576. Default 1024. With 1, calib sends a state
    /// only after the prediction at the state before it has arrived.
    #[serde(skip_serializing_if = "AgentConfig::is_default_message")]
    #[schemars(extend("default" = 1024))]
    pub states_per_message: usize,
    /// With `kind = "external"`: seconds that calib waits for an answer, above 0 and at most 1e6. Default 60. Results do not depend on it.
    #[serde(skip_serializing_if = "AgentConfig::is_default_timeout")]
    #[schemars(extend("default" = 60.0))]
    pub timeout_secs: f64,
    /// Decay rates β in [0, 1), at most 16, each once (default: none). For each β and each state `s_t`, the agent also sees a trace `e_t =
    /// β e_{t−1} + (1 − β) s_t` of all columns. A trace restarts at `e = s` after each gap.
    pub traces: Vec<f64>,
    /// The predictions of the agent before it learns: `"none"` (default) for those of its random initial weights, or a simple predictor
    /// that is fitted on the log: `"mean"`, `"persistence"`, `"line"`, `"autoregression"`, `"ridge"` or `"least_squares_td"`. The agent
    /// learns a correction to this predictor, which starts at 0. Omitted where it is the default.
    #[serde(with = "baseline", skip_serializing_if = "Option::is_none")]
    #[schemars(with = "baseline::Names", extend("default" = "none"))]
    pub baseline: Option<SimplePredictor>,
    /// `"mlp"` (default) or `"linear"`.
    pub value_function: ValueFunction,
    /// Hidden layers of the MLP, 1 to 16. Default 2 (the paper uses 2 × 256).
    pub hidden_layers: usize,
    /// Units of each hidden layer, 1 to 16384. Default 256.
    pub hidden_units: usize,
    /// `"f32"` (default) or `"bf16"`, for MLPs only. Omitted where it is the default, so that agents of versions without this key keep
    /// their fingerprints.
    #[serde(skip_serializing_if = "is_default")]
    #[schemars(extend("default" = "f32"))]
    pub precision: Precision,
    /// `"adam"` (default) or `"sgd"`. For linear agents without replay also `"true_online_td"` or `"swift_td"`, which need hardly any
    /// tuning: with `"swift_td"`, `learning_rate` is only the initial step size.
    pub optimiser: OptimiserKind,
    /// Step size, ≥ 0. Default 1e-3. The paper sweeps it. With 0 the agent predicts and does not learn.
    pub learning_rate: f64,
    /// Updates after which the step size is half of `learning_rate`. After n updates it is `learning_rate / (1 + n / halve_after)`. With 0
    /// (default) it is constant. Omitted where it is the default.
    #[serde(skip_serializing_if = "is_default")]
    #[schemars(extend("default" = 0))]
    pub halve_after: u64,
    /// Decay of the eligibility traces of `"true_online_td"` and `"swift_td"`, in [0, 1]. Default 0.9. Omitted where it is the default, as
    /// are the next three.
    #[serde(skip_serializing_if = "AgentConfig::is_default_lambda")]
    #[schemars(extend("default" = 0.9))]
    pub lambda: f64,
    /// Rate at which `"swift_td"` adapts its step sizes, ≥ 0. Default 1e-3.
    #[serde(skip_serializing_if = "AgentConfig::is_default_meta")]
    #[schemars(extend("default" = 1e-3))]
    pub meta_step_size: f64,
    /// The largest share of the error at a state that one update of `"swift_td"` may correct, in (0, 1]. Default 0.1.
    #[serde(skip_serializing_if = "AgentConfig::is_default_bound")]
    #[schemars(extend("default" = 0.1))]
    pub rate_bound: f64,
    /// Factor on the step sizes of `"swift_td"` where an update exceeds `rate_bound`, in (0, 1). Default 0.999.
    #[serde(skip_serializing_if = "AgentConfig::is_default_decay")]
    #[schemars(extend("default" = 0.999))]
    pub rate_decay: f64,
    /// Adam's decay of the mean of gradients, in [0, 1). Default 0.9.
    pub beta1: f64,
    /// Adam's decay of the mean of squared gradients, in [0, 1). Default 0.999.
    pub beta2: f64,
    /// Added to Adam's denominator, at least 1e-30. Default 1e-8.
    pub epsilon: f64,
    /// Decoupled weight decay of Adam and SGD, ≥ 0. Default 0.
    pub weight_decay: f64,
    /// Discount factor, in [0, 1). Default 0.99.
    pub gamma: f64,
    /// Discount factors of single sensors by name, each in [0, 1). Sensors without an entry use `gamma`. Default: none. Omitted where it is
    /// empty.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    #[schemars(extend("default" = {}))]
    pub gammas: BTreeMap<String, f64>,
    /// `"uniform"` (default) or `"none"`.
    pub replay: ReplayKind,
    /// Transitions that the replay buffer holds, `batch_size` to 2³². Default 1,000,000.
    pub replay_capacity: usize,
    /// Transitions of a mini-batch, ≥ 1. Default 256. Updates begin when the buffer holds this many. Without replay it has no effect on
    /// learning along a stream; pre-training always learns from mini-batches.
    pub batch_size: usize,
    /// Updates after each step, ≥ 1. Default 1.
    pub updates_per_step: usize,
    /// Updates between copies to the target network; 0 (default) bootstraps from the network itself.
    pub target_network_period: usize,
}

const LAMBDA: f64 = 0.9;
const META_STEP_SIZE: f64 = 1e-3;
const RATE_BOUND: f64 = 0.1;
const RATE_DECAY: f64 = 0.999;

impl Default for AgentConfig {
    fn default() -> Self {
        Self {
            kind: AgentKind::Td,
            command: Vec::new(),
            parameters: BTreeMap::new(),
            states_per_message: STATES_PER_MESSAGE,
            timeout_secs: TIMEOUT_SECS,
            traces: Vec::new(),
            baseline: None,
            value_function: ValueFunction::Mlp,
            hidden_layers: 2,
            hidden_units: 256,
            precision: Precision::F32,
            optimiser: OptimiserKind::Adam,
            learning_rate: 1e-3,
            halve_after: 0,
            lambda: LAMBDA,
            meta_step_size: META_STEP_SIZE,
            rate_bound: RATE_BOUND,
            rate_decay: RATE_DECAY,
            beta1: 0.9,
            beta2: 0.999,
            epsilon: 1e-8,
            weight_decay: 0.0,
            gamma: 0.99,
            gammas: BTreeMap::new(),
            replay: ReplayKind::Uniform,
            replay_capacity: 1_000_000,
            batch_size: 256,
            updates_per_step: 1,
            target_network_period: 0,
        }
    }
}

/// A hyperparameter outside its range.
#[derive(Clone, Debug, thiserror::Error, PartialEq, Eq)]
#[error("agent hyperparameter `{field}`: expected {expected}, got {got}")]
pub struct AgentConfigError {
    /// The field's name, as in a study.
    pub field: &'static str,
    /// The rejected value.
    pub got: String,
    /// The permitted values.
    pub expected: String,
}

impl AgentConfig {
    /// Returns the number of transitions per update. Without replay this is 1, the present transition.
    pub(crate) fn transitions_per_update(&self) -> usize {
        match self.replay {
            ReplayKind::Uniform => self.batch_size,
            ReplayKind::None => 1,
        }
    }

    /// Checks every field against its range.
    ///
    /// # Errors
    /// The first field that is outside its range.
    pub fn check(&self) -> Result<(), AgentConfigError> {
        self.check_kind()?;
        let mlp = self.value_function == ValueFunction::Mlp;
        let uniform = self.replay == ReplayKind::Uniform;
        self.check_traces()?;
        self.check_online()?;
        require(
            !mlp || (1..=16).contains(&self.hidden_layers),
            "hidden_layers",
            &self.hidden_layers,
            "1 to 16 (or value_function = \"linear\" for none)",
        )?;
        require(
            !mlp || (1..=16_384).contains(&self.hidden_units),
            "hidden_units",
            &self.hidden_units,
            "1 to 16384",
        )?;
        require(
            mlp || self.precision == Precision::F32,
            "precision",
            &"bf16",
            "f32 with value_function = \"linear\": its updates wait for memory, not for products",
        )?;
        require(
            self.learning_rate == 0.0 || fits_single_precision(self.learning_rate),
            "learning_rate",
            &self.learning_rate,
            "0 or a number from 1e-45 to 1e38 (parameters are in single precision)",
        )?;
        require(is_fraction(self.beta1), "beta1", &self.beta1, "a number in [0, 1)")?;
        require(is_fraction(self.beta2), "beta2", &self.beta2, "a number in [0, 1)")?;
        require(
            (1e-30..=1e38).contains(&self.epsilon),
            "epsilon",
            &self.epsilon,
            "a number from 1e-30 to 1e38 (parameters are in single precision)",
        )?;
        require(
            self.weight_decay == 0.0 || fits_single_precision(self.weight_decay),
            "weight_decay",
            &self.weight_decay,
            "0 or a number from 1e-45 to 1e38 (parameters are in single precision)",
        )?;
        self.check_gammas()?;
        require(self.batch_size >= 1, "batch_size", &self.batch_size, "1 or more")?;
        require(
            !uniform || (self.batch_size..=1 << 32).contains(&self.replay_capacity),
            "replay_capacity",
            &self.replay_capacity,
            &format!("batch_size ({}) to 4294967296", self.batch_size),
        )?;
        require(self.updates_per_step >= 1, "updates_per_step", &self.updates_per_step, "1 or more")
    }

    /// Returns the discount factor for a sensor's return: its entry in `gammas`, or `gamma`.
    pub fn gamma_for(&self, sensor: &str) -> f64 {
        self.gammas.get(sensor).copied().unwrap_or(self.gamma)
    }

    /// Returns the agent that predicts `sensor`. Its single discount factor is in `gamma`.
    #[must_use]
    pub fn for_sensor(&self, sensor: &str) -> Self {
        Self { gamma: self.gamma_for(sensor), gammas: BTreeMap::new(), ..self.clone() }
    }

    /// Returns the property that an agent needs for the hyperparameter `field` to have an effect, if this agent lacks
    /// it.
    pub fn lacks(&self, field: &str) -> Option<&'static str> {
        let (other, needed) = match field {
            "hidden_layers" | "hidden_units" | "precision" => {
                (self.value_function == ValueFunction::Linear, "value_function = \"mlp\"")
            }
            "beta1" | "beta2" | "epsilon" => {
                (self.optimiser == OptimiserKind::Sgd, "optimiser = \"adam\"")
            }
            "replay_capacity" | "batch_size" => {
                (self.replay == ReplayKind::None, "replay = \"uniform\"")
            }
            _ => return None,
        };
        (other && !self.is_external()).then_some(needed)
    }

    /// Returns every hyperparameter by its name in a study, including those that a study omits at their default. For an
    /// external program these are `gamma` and the program's own. `gammas` is not included, because it is not a
    /// hyperparameter of a single agent.
    pub fn fields(&self) -> Map<String, Value> {
        if self.is_external() {
            let gamma = [("gamma".to_owned(), Value::from(self.gamma))];
            return self.parameters.clone().into_iter().chain(gamma).collect();
        }
        let own = Self { gammas: BTreeMap::new(), ..self.clone() };
        match (serde_json::to_value(own), serde_json::to_value(self.precision)) {
            (Ok(Value::Object(mut fields)), Ok(precision)) => {
                fields.insert("precision".to_owned(), precision);
                fields.insert("baseline".to_owned(), baseline::name(self.baseline).into());
                fields.insert("halve_after".to_owned(), self.halve_after.into());
                let of_traces = [
                    ("lambda", self.lambda),
                    ("meta_step_size", self.meta_step_size),
                    ("rate_bound", self.rate_bound),
                    ("rate_decay", self.rate_decay),
                ];
                fields.extend(of_traces.map(|(name, value)| (name.to_owned(), value.into())));
                fields
            }
            _ => unreachable!("an agent's configuration is a table"),
        }
    }

    /// Returns the step size after `updates` updates.
    pub(crate) fn rate_after(&self, updates: usize) -> f64 {
        match self.halve_after {
            0 => self.learning_rate,
            half => self.learning_rate / (1.0 + updates as f64 / half as f64),
        }
    }

    /// Checks the ranges of all discount factors.
    fn check_gammas(&self) -> Result<(), AgentConfigError> {
        let expected =
            "a number in [0, 1): returns with a discount factor of 1 or more do not converge";
        require(is_fraction(self.gamma), "gamma", &self.gamma, expected)?;
        for (sensor, &gamma) in &self.gammas {
            require(is_fraction(gamma), "gammas", &format!("{gamma} for {sensor}"), expected)?;
        }
        Ok(())
    }

    /// Checks the settings that eligibility traces require, and their ranges.
    fn check_online(&self) -> Result<(), AgentConfigError> {
        require((0.0..=1.0).contains(&self.lambda), "lambda", &self.lambda, "a number in [0, 1]")?;
        require(
            (0.0..=1e3).contains(&self.meta_step_size),
            "meta_step_size",
            &self.meta_step_size,
            "a number from 0 to 1000",
        )?;
        require(
            self.rate_bound > 0.0 && self.rate_bound <= 1e6,
            "rate_bound",
            &self.rate_bound,
            "a number above 0",
        )?;
        require(
            self.rate_decay > 0.0 && self.rate_decay < 1.0,
            "rate_decay",
            &self.rate_decay,
            "a number between 0 and 1",
        )?;
        if !self.optimiser.has_traces() {
            return Ok(());
        }
        let fits = self.value_function == ValueFunction::Linear
            && self.replay == ReplayKind::None
            && self.updates_per_step == 1
            && self.target_network_period == 0
            && self.weight_decay == 0.0
            && self.halve_after == 0;
        require(
            fits,
            "optimiser",
            &self.optimiser.name(),
            "adam or sgd, or value_function = \"linear\" and replay = \"none\" with one update a step, no target network, no weight \
             decay and no halve_after: it learns from each transition once, in the order of time",
        )
    }

    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands fields over so")]
    fn is_default_lambda(value: &f64) -> bool {
        *value == LAMBDA
    }

    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands fields over so")]
    fn is_default_meta(value: &f64) -> bool {
        *value == META_STEP_SIZE
    }

    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands fields over so")]
    fn is_default_bound(value: &f64) -> bool {
        *value == RATE_BOUND
    }

    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands fields over so")]
    fn is_default_decay(value: &f64) -> bool {
        *value == RATE_DECAY
    }

    /// Returns the width of the agent's input for a state of `width` values: the state and its traces.
    pub fn seen_width(&self, width: usize) -> usize {
        width * (1 + self.traces.len())
    }

    fn check_traces(&self) -> Result<(), AgentConfigError> {
        let decays = &self.traces;
        require(
            decays.len() <= 16
                && decays.iter().enumerate().all(|(place, decay)| {
                    (0.0..1.0).contains(decay) && !decays[..place].contains(decay)
                }),
            "traces",
            &format!("{decays:?}"),
            "at most 16 different numbers in [0, 1), such as [0.9, 0.99]",
        )
    }
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

/// Whether `value` is positive, and neither 0 nor infinite in single precision.
fn fits_single_precision(value: f64) -> bool {
    (1e-45..=1e38).contains(&value)
}

/// Whether `value` is a number in [0, 1).
fn is_fraction(value: f64) -> bool {
    (0.0..1.0).contains(&value)
}

/// Formats with an exponent where plain digits would be hundreds of characters.
fn in_short(value: &dyn Display) -> String {
    let text = value.to_string();
    match text.parse::<f64>() {
        Ok(number) if text.len() > 20 => format!("{number:e}"),
        _ => text,
    }
}

fn require(
    holds: bool,
    field: &'static str,
    got: &dyn Display,
    expected: &str,
) -> Result<(), AgentConfigError> {
    if holds {
        Ok(())
    } else {
        Err(AgentConfigError { field, got: in_short(got), expected: expected.to_owned() })
    }
}

#[cfg(test)]
mod tests;
