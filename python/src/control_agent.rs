//! calib's own agents that act, as objects: they choose actions, learn, and can be stored in a file.

use std::{
    borrow::Cow,
    path::{Path, PathBuf},
    sync::Arc,
};

use calib_control::{
    Actor, Agent, AgentConfig, Ending, Ensemble as _, Outcome, RunLength, run_agent,
};
use calib_core::{Bounds, Monitor, Normalised, Physical, Rng, Seed};
use calib_files::{read_tensors, write_tensors};
use calib_pipeline::{ActingAgent, ControlEvaluation};
use calib_study::setting_error;
use pyo3::{exceptions::PyValueError, prelude::*};
use serde::{Deserialize, Serialize};

use crate::{
    acting::PyActionModel,
    array::copied,
    errors,
    model::require_member,
    observer::WatchMonitor,
    study::PyJob,
    work::{Needs, watched},
};

/// The key of a file's metadata that describes the agent, and the version of the format.
const DESCRIBED: &str = "agent";
const FORMAT: u32 = 1;
const DIVERGED: &str =
    "the agent has diverged: its values are no numbers any more; use a smaller step_size";
const NOT_WRITTEN: &str = "the agent has diverged: what it learned holds values that are no numbers, so it was not written; train a new one with a \
     smaller step_size";

/// The observations and actions of an agent, and its settings, without what it learned.
#[derive(Clone, Serialize, Deserialize)]
struct Described {
    format: u32,
    settings: AgentConfig,
    /// Name, offset and scale of the columns of an observation.
    columns: Vec<(String, f64, f64)>,
    /// Names of the actions, and the values that each sets.
    actions: Vec<(String, Vec<f64>)>,
    seed: u64,
}

/// Lists the names of columns.
fn listed(columns: &[(String, f64, f64)]) -> String {
    columns.iter().map(|(name, ..)| name.as_str()).collect::<Vec<_>>().join(", ")
}

/// Returns the error that a stored agent cannot be used.
fn refused(py: Python<'_>, path: &Path, reason: &str) -> PyErr {
    errors::of_text(py, &format!("{}: {reason}", path.display()))
}

/// An agent that acts.
#[pyclass(module = "calib_rl._calib")]
pub(crate) struct ControlAgent {
    agent: Agent,
    described: Described,
    rng: Rng,
    /// The last action, if an episode is unfinished.
    last: Option<usize>,
    /// Whether its values were ever not finite. Weights can be finite all the same, for instance those of a network with infinite
    /// outputs.
    has_diverged: bool,
}

impl ControlAgent {
    fn new_of(described: Described) -> Self {
        let seed = Seed::new(described.seed);
        let (columns, actions) = (described.columns.len(), described.actions.len());
        let agent = Agent::seeded(described.settings, columns, actions, seed.child("agent"));
        let rng = seed.child("actions").rng();
        Self { agent, rng, described, last: None, has_diverged: false }
    }

    /// Converts an observation in the sensors' units to a normalised state.
    fn state(&self, observation: &Bound<'_, PyAny>) -> PyResult<Vec<f32>> {
        let (values, _) = copied::<f64>(observation, "observation", &[1])?;
        let columns = &self.described.columns;
        if values.len() != columns.len() {
            return Err(PyValueError::new_err(format!(
                "the observation has {} numbers, expected {}, one for each of `columns`",
                values.len(),
                columns.len()
            )));
        }
        let mapped = values.iter().zip(columns).map(|(&value, (name, offset, scale))| {
            if !value.is_finite() {
                return Err(PyValueError::new_err(format!("{name} is {value} in the observation")));
            }
            let bounds = Bounds { offset: *offset, scale: *scale };
            Ok(bounds.normalise(Physical(value)).0)
        });
        mapped.collect()
    }

    /// Returns how the columns of a model are rescaled for the agent. Empty if both have the same ranges.
    fn rescaled(&self, model: &PyActionModel) -> PyResult<Vec<RescaledColumn>> {
        let Described { columns, actions, .. } = &self.described;
        let of_model = model.columns();
        let same_names = of_model.len() == columns.len()
            && of_model.iter().zip(columns).all(|(model, own)| model.0 == own.0);
        if !same_names {
            return Err(PyValueError::new_err(format!(
                "the columns of the model are {}, and those of the agent {}; build a model of the same columns, or make an agent for \
                 this one",
                listed(&of_model),
                listed(columns)
            )));
        }
        if model.described_actions() != *actions {
            return Err(PyValueError::new_err(
                "the model has other actions than the agent; build a model of the same actions, or make an agent for this one",
            ));
        }
        if of_model == *columns {
            return Ok(Vec::new());
        }
        let pairs = of_model.iter().zip(columns);
        let rescaled = pairs.map(|(model, own)| RescaledColumn {
            model: Bounds { offset: model.1, scale: model.2 },
            agent: Bounds { offset: own.1, scale: own.2 },
        });
        Ok(rescaled.collect())
    }

    fn act(&mut self, py: Python<'_>) -> PyResult<usize> {
        let action = self.agent.act(&mut self.rng);
        self.has_diverged |= action.is_none();
        let action = action.ok_or_else(|| errors::of_text(py, DIVERGED))?;
        self.last = Some(action);
        Ok(action)
    }
}

/// A column for which a model and an agent have different ranges.
struct RescaledColumn {
    model: Bounds,
    agent: Bounds,
}

/// An agent in a model. If the user asks to stop, its run ends as if it had diverged.
struct WatchedAgent<'a> {
    agent: &'a mut Agent,
    /// The columns of a state; empty if the model and the agent have the same ranges.
    rescaled: Vec<RescaledColumn>,
    monitor: &'a dyn Monitor,
}

impl WatchedAgent<'_> {
    /// Converts a state of the model to the ranges of the agent.
    fn seen<'s>(&self, state: &'s [f32]) -> Cow<'s, [f32]> {
        if self.rescaled.is_empty() {
            return Cow::Borrowed(state);
        }
        let columns = state.iter().zip(&self.rescaled);
        let seen = columns.map(|(&value, RescaledColumn { model, agent })| {
            agent.normalise(model.physical(Normalised(value))).0
        });
        Cow::Owned(seen.collect())
    }
}

impl Actor for WatchedAgent<'_> {
    fn look(&mut self, state: &[f32]) {
        let state = self.seen(state);
        self.agent.look(&state);
    }

    fn act(&mut self, rng: &mut Rng) -> Option<usize> {
        if self.monitor.interrupted() { None } else { self.agent.act(rng) }
    }

    fn learn(&mut self, action: usize, outcome: Outcome, next: &[f32]) {
        let next = self.seen(next);
        self.agent.learn(action, outcome, &next);
    }
}

#[pymethods]
impl ControlAgent {
    /// Creates an agent for the states and actions of a model, with settings as JSON.
    #[new]
    fn new(model: &PyActionModel, settings: &str, seed: u64) -> PyResult<Self> {
        let settings: AgentConfig =
            serde_json::from_str(settings).map_err(|error| errors::value(setting_error(&error)))?;
        settings.check().map_err(errors::unusable)?;
        let columns = model.columns();
        let actions = model.described_actions();
        settings.bytes(columns.len(), actions.len()).map_err(errors::unusable)?;
        Ok(Self::new_of(Described { format: FORMAT, settings, columns, actions, seed }))
    }

    /// Returns the settings that `calib control` chose for a study, as JSON.
    #[staticmethod]
    fn chosen(py: Python<'_>, job: &Bound<'_, PyJob>) -> PyResult<String> {
        let job = &job.get().job;
        let found = watched(py, Needs::Threads, None, |_| ControlEvaluation::of_job(job))?;
        let evaluation = found.map_err(|error| errors::of_step(py, &error))?;
        match &evaluation.agents()[evaluation.verdict().chosen] {
            ActingAgent::Own(settings) => serde_json::to_string(settings).map_err(errors::unusable),
            // Verdicts on agents of a program were refused before.
            ActingAgent::Program { .. } => {
                Err(errors::of_text(py, "the agents are those of a program"))
            }
        }
    }

    /// Loads a stored agent.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let tensors = read_tensors(&path).map_err(|error| errors::of_any(py, &error))?;
        let text = tensors.metadata.get(DESCRIBED).map_or("", String::as_str);
        let described: Described = serde_json::from_str(text).map_err(|error| {
            errors::of_text(py, &format!("{} is no agent of calib: {error}", path.display()))
        })?;
        let Described { format, settings, ref columns, ref actions, seed } = described;
        if format != FORMAT {
            return Err(refused(
                py,
                &path,
                &format!(
                    "its format is {format}, and this calib reads {FORMAT}; save the agent again"
                ),
            ));
        }
        let has_scales = columns.iter().all(|&(_, _, scale)| scale.is_finite() && scale > 0.0);
        if actions.is_empty() || !has_scales {
            return Err(refused(py, &path, "it has no actions, or a column without a scale"));
        }
        let seed = Seed::new(seed).child("loaded");
        let own = seed.child("agent");
        let agent = Agent::from_tensors(settings, columns.len(), actions.len(), own, &tensors);
        let agent = agent.map_err(|error| refused(py, &path, &error.to_string()))?;
        let rng = seed.child("actions").rng();
        Ok(Self { agent, rng, described, last: None, has_diverged: false })
    }

    /// Writes the learned arrays and the description to a file.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let mut tensors = self.agent.to_tensors();
        let mut weights = tensors.tensors.iter().flat_map(|tensor| &tensor.values);
        let is_finite = weights.all(|weight| weight.is_finite())
            && self.agent.values().iter().all(|value| value.is_finite());
        if self.has_diverged || !is_finite {
            return Err(errors::of_text(py, NOT_WRITTEN));
        }
        let text = serde_json::to_string(&self.described).map_err(errors::unusable)?;
        tensors.metadata.insert(DESCRIBED.to_owned(), text);
        write_tensors(&path, &tensors).map_err(|error| errors::of_any(py, &error))
    }

    /// Returns the settings, as JSON.
    #[getter]
    fn settings(&self) -> PyResult<String> {
        serde_json::to_string(&self.described.settings).map_err(errors::unusable)
    }

    #[getter]
    fn columns(&self) -> Vec<String> {
        self.described.columns.iter().map(|(name, ..)| name.clone()).collect()
    }

    /// Returns the name of each action, and the values that it sets.
    #[getter]
    fn actions(&self) -> Vec<(String, Vec<f64>)> {
        self.described.actions.clone()
    }

    /// Begins an episode with this observation. Returns the action to take.
    fn begin(&mut self, py: Python<'_>, observation: &Bound<'_, PyAny>) -> PyResult<usize> {
        let state = self.state(observation)?;
        self.agent.look(&state);
        self.act(py)
    }

    /// Takes the outcome of the last action. Returns the next action, or `None` after a terminal.
    fn step(
        &mut self,
        py: Python<'_>,
        reward: f64,
        observation: &Bound<'_, PyAny>,
        terminal: bool,
        learn: bool,
    ) -> PyResult<Option<usize>> {
        let Some(last) = self.last else {
            return Err(PyValueError::new_err("no episode goes on; call begin(observation) first"));
        };
        if !reward.is_finite() {
            return Err(PyValueError::new_err(format!(
                "reward is {reward}, expected a finite number"
            )));
        }
        let state = self.state(observation)?;
        let ending = if terminal { Ending::Terminal } else { Ending::Continues };
        if learn {
            self.agent.learn(last, Outcome { reward, ending }, &state);
        } else {
            self.agent.go_on(&state);
        }
        if terminal {
            self.last = None;
            return Ok(None);
        }
        self.act(py).map(Some)
    }

    /// Returns the value of each action for an observation.
    fn values(&self, observation: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
        let state = self.state(observation)?;
        Ok(self.agent.values_in(&state))
    }

    /// Lets the agent act and learn in an ensemble member of a model. Returns the mean return per episode, and
    /// the number of episodes.
    #[pyo3(signature = (model, member, steps, timeout, seed))]
    fn train(
        &mut self,
        py: Python<'_>,
        model: &PyActionModel,
        member: usize,
        steps: usize,
        timeout: usize,
        seed: u64,
    ) -> PyResult<(f64, usize)> {
        let opened = model.model();
        require_member(member, opened.members())?;
        let rescaled = self.rescaled(model)?;
        // An unfinished episode elsewhere does not continue here.
        self.last = None;
        let agent = &mut self.agent;
        let span = RunLength { steps, timeout };
        let run = watched(py, Needs::Threads, None, |watch| {
            let monitor = WatchMonitor(Arc::clone(watch));
            let mut watched = WatchedAgent { agent, rescaled, monitor: &monitor };
            run_agent(&mut watched, &mut opened.rollout(member), span, Seed::new(seed))
        })?;
        if run.diverged {
            self.has_diverged = true;
            return Err(errors::of_text(py, DIVERGED));
        }
        Ok((run.mean_return(), run.returns.len()))
    }
}
