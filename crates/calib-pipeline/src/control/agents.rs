//! The agents that a study compares: calib's own, or those of a program.

use std::{
    collections::BTreeMap,
    sync::{Mutex, PoisonError},
};

use calib_base::StepError;
use calib_control::{
    ActingAgents, Actor, AgentConfig, AgentRun, ControlConfig, ControlError, Ending, Environment,
    Outcome, RunLength, run_agent,
};
use calib_core::{Monitor, Rng, Seed, locked};
use calib_files::Fingerprint;
use calib_study::Job;
use calib_sweep::{Candidate, ProgramStopped, candidates, written};
use calib_sweep_steps::program::{Answer, PROTOCOL_VERSION, Process, ProgramCommand, Ready, line};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::{
    advice::{PROGRAM, STUDY, Vocabulary},
    log::Names,
};

/// An agent that was compared.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum ActingAgent {
    /// An agent of calib.
    Own(AgentConfig),
    /// An agent of a program.
    Program {
        /// The parameters that the program was given: `[agent.parameters]`, with the values of the
        /// grid.
        parameters: BTreeMap<String, Value>,
    },
}

impl ActingAgent {
    /// Whether a swept field has an effect.
    pub(super) fn uses(&self, field: &str) -> bool {
        match self {
            Self::Own(agent) => agent.algorithm.uses(field),
            Self::Program { .. } => true,
        }
    }

    /// Returns the user's names for a verdict on such agents.
    pub(super) fn vocabulary(&self) -> Vocabulary {
        match self {
            Self::Own(_) => STUDY,
            Self::Program { .. } => PROGRAM,
        }
    }
}

/// A setting with which the program failed in at least one run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub(super) struct SettingFailure {
    /// Index of the setting.
    pub(super) candidate: usize,
    /// Description of the setting, by its swept parameters.
    pub(super) setting: String,
}

impl SettingFailure {
    /// Returns the warning about the failure, with the remedy.
    pub(super) fn warning(&self) -> String {
        format!(
            "the program failed with {}, which is therefore last in every ranking; run the same command again to see why, mend the \
             program, or take the value out of [sweep.grid]",
            self.setting
        )
    }
}

/// The agents of a study, in the order of the verdict.
pub(super) enum ComparedAgents {
    /// calib's own agents: `[control.agent]` and `[control.grid]`.
    Own(Vec<AgentConfig>),
    /// Agents of a program: `[agent.parameters]` and `[sweep.grid]`.
    Program { command: ProgramCommand, candidates: Vec<Candidate> },
}

/// The inputs of a verdict that identify the agents of a program.
#[derive(Serialize)]
pub(super) struct ProgramIdentity<'a> {
    program: &'a Fingerprint,
    gamma: f64,
    parameters: Vec<&'a BTreeMap<String, Value>>,
}

impl ComparedAgents {
    /// Returns the agents of a study.
    ///
    /// # Errors
    /// Returns an error if the grid is invalid, or a file of the program cannot be read.
    pub(super) fn of_study(job: &Job, config: &ControlConfig) -> Result<Self, StepError> {
        let study = job.study();
        // With predicted sensors the program makes predictions, and calib's own agents act.
        let command =
            if study.is_of_acting_agents() { ProgramCommand::of_study(job)? } else { None };
        let Some(command) = command else {
            return Ok(Self::Own(config.grid.candidates(config.agent)?));
        };
        let seed = Seed::new(study.seed).child("sweep");
        Ok(Self::Program { command, candidates: candidates(&study.sweep, &study.agent, seed)? })
    }

    /// Returns calib's own agents. Empty for agents of a program.
    pub(super) fn own(&self) -> &[AgentConfig] {
        match self {
            Self::Own(agents) => agents,
            Self::Program { .. } => &[],
        }
    }

    /// Returns the agents of the program, if there is one, with the `names` of their states.
    pub(super) fn of_program<'a>(&'a self, names: &'a Names) -> Option<ProgramAgents<'a>> {
        match self {
            Self::Own(_) => None,
            Self::Program { command, candidates } => {
                Some(ProgramAgents::new(command, candidates, names))
            }
        }
    }

    pub(super) fn count(&self) -> usize {
        match self {
            Self::Own(agents) => agents.len(),
            Self::Program { candidates, .. } => candidates.len(),
        }
    }

    /// Returns the swept fields of each agent with their values.
    pub(super) fn fields(&self, config: &ControlConfig) -> Vec<Vec<(String, String)>> {
        match self {
            Self::Own(agents) => {
                let told = agents.iter().map(|agent| config.grid.told(agent).into_iter());
                told.map(|fields| fields.map(|(field, value)| (field.to_owned(), value)).collect())
                    .collect()
            }
            Self::Program { candidates, .. } => {
                let values = candidates.iter().map(|candidate| candidate.values.iter());
                values
                    .map(|fields| {
                        fields.map(|(field, value)| (field.clone(), written(value))).collect()
                    })
                    .collect()
            }
        }
    }

    /// Returns the default setting, if it is among the agents.
    pub(super) fn default(&self, config: &ControlConfig) -> Option<usize> {
        match self {
            Self::Own(agents) => agents.iter().position(|agent| *agent == config.agent),
            Self::Program { candidates, .. } => {
                candidates.iter().position(|candidate| candidate.is_default)
            }
        }
    }

    /// Returns each agent as files store it.
    pub(super) fn stored(&self) -> Vec<ActingAgent> {
        match self {
            Self::Own(agents) => agents.iter().copied().map(ActingAgent::Own).collect(),
            Self::Program { candidates, .. } => {
                let parameters = candidates.iter().map(|one| one.agent.parameters.clone());
                parameters.map(|parameters| ActingAgent::Program { parameters }).collect()
            }
        }
    }

    /// Returns the inputs of results besides `[control]` in the study. `None` for calib's own
    /// agents.
    pub(super) fn program_identity(&self) -> Option<ProgramIdentity<'_>> {
        match self {
            Self::Own(_) => None,
            Self::Program { command, candidates } => Some(ProgramIdentity {
                program: command.fingerprint(),
                gamma: candidates.first().map_or(0.0, |candidate| candidate.agent.gamma),
                parameters: candidates.iter().map(|one| &one.agent.parameters).collect(),
            }),
        }
    }
}

/// Agents of a program that act. Each thread has one process, which trains one agent after the
/// other.
pub(super) struct ProgramAgents<'a> {
    command: &'a ProgramCommand,
    candidates: &'a [Candidate],
    names: &'a Names,
    /// Processes that wait for the next agent.
    idle: Mutex<Vec<Process<'a>>>,
    /// The failure of each failed setting, by its number. Failed settings are not tried again.
    failures: Mutex<BTreeMap<usize, String>>,
}

impl<'a> ProgramAgents<'a> {
    fn new(command: &'a ProgramCommand, candidates: &'a [Candidate], names: &'a Names) -> Self {
        let idle = Mutex::default();
        Self { command, candidates, names, idle, failures: Mutex::default() }
    }

    /// Returns the settings that failed. The reasons are left out, because they may differ between
    /// runs.
    pub(super) fn failures(&self) -> Vec<SettingFailure> {
        let failures = locked(&self.failures);
        let failed = failures.keys().map(|&candidate| SettingFailure {
            candidate,
            setting: self.candidates[candidate].label(),
        });
        failed.collect()
    }

    /// Returns the reasons why settings failed, each from its first failed run.
    pub(super) fn reasons(&self) -> Vec<String> {
        locked(&self.failures).values().cloned().collect()
    }

    /// Records a failed setting, and continues as long as others are left.
    fn go_on_without(&self, candidate: usize, reason: &str) -> Result<AgentRun, ControlError> {
        // If the program was changed meanwhile, the failure says nothing about the setting.
        self.command.check_unchanged().map_err(failed)?;
        let mut failures = locked(&self.failures);
        failures.entry(candidate).or_insert_with(|| reason.to_owned());
        if failures.len() < self.candidates.len() {
            return Ok(could_not_act());
        }
        Err(ControlError::Program(
            format!("the program failed with every setting; in the end {reason}").into(),
        ))
    }

    /// Starts a process, and begins an agent in it.
    fn started<'m>(
        &self,
        actor: impl FnOnce(Process<'a>) -> ProgramActor<'m, 'a>,
        begin: &BeginActing<'_>,
    ) -> Result<ProgramActor<'m, 'a>, ProgramStopped> {
        let mut actor = actor(Process::start(self.command, 0)?);
        actor.begin(begin)?;
        Ok(actor)
    }

    /// Trains one agent in a process. The process then waits for the next agent.
    fn run_in_process(
        &self,
        candidate: usize,
        environment: &mut dyn Environment,
        span: RunLength,
        seed: Seed,
        monitor: &dyn Monitor,
    ) -> Result<AgentRun, ProgramStopped> {
        let agent = &self.candidates[candidate].agent;
        let begin = BeginActing {
            columns: environment.columns(),
            column_names: &self.names.columns,
            actions: environment.actions(),
            action_names: &self.names.actions,
            gamma: agent.gamma,
            seed: seed.child("agent").get(),
            steps: span.steps,
            timeout: span.timeout,
            parameters: &agent.parameters,
        };
        let new_actor = |process: Process<'a>| ProgramActor {
            process,
            setting: self.candidates[candidate].label(),
            command: self.command,
            actions: begin.actions,
            message: None,
            stopped: None,
            monitor,
        };
        let idle = locked(&self.idle).pop();
        let mut actor = match idle.map(new_actor) {
            // If an agent fails as soon as it begins, the previous agent may have broken the
            // process. It gets a new process.
            Some(mut actor) => match actor.begin(&begin) {
                Err(ProgramStopped::CannotAnswer(_)) => self.started(new_actor, &begin)?,
                began => began.map(|()| actor)?,
            },
            None => self.started(new_actor, &begin)?,
        };
        let run = run_agent(&mut actor, environment, span, seed);
        if let Some(stopped) = actor.stopped {
            return Err(stopped);
        }
        locked(&self.idle).push(actor.process);
        Ok(run)
    }

    /// Ends the processes after the last agent.
    ///
    /// # Errors
    /// Returns an error if a process fails at its end, or the program was changed meanwhile.
    pub(super) fn finish(self) -> Result<(), StepError> {
        for process in self.idle.into_inner().unwrap_or_else(PoisonError::into_inner) {
            process.finish().map_err(failed)?;
        }
        Ok(self.command.check_unchanged().map_err(failed)?)
    }
}

impl ActingAgents for ProgramAgents<'_> {
    fn count(&self) -> usize {
        self.candidates.len()
    }

    fn run(
        &self,
        candidate: usize,
        environment: &mut dyn Environment,
        span: RunLength,
        seed: Seed,
        monitor: &dyn Monitor,
    ) -> Result<AgentRun, ControlError> {
        if self.has_failed(candidate) {
            return Ok(could_not_act());
        }
        match self.run_in_process(candidate, environment, span, seed, monitor) {
            Ok(run) => {
                // The run is stored under the program's fingerprint.
                self.command.check_unchanged().map_err(failed)?;
                Ok(run)
            }
            Err(ProgramStopped::CannotAnswer(reason)) => {
                self.go_on_without(candidate, &reason.to_string())
            }
            Err(stopped) => Err(failed(stopped)),
        }
    }

    fn has_failed(&self, candidate: usize) -> bool {
        locked(&self.failures).contains_key(&candidate)
    }
}

/// Returns the run of an agent that could not take a step.
fn could_not_act() -> AgentRun {
    AgentRun { diverged: true, ..AgentRun::default() }
}

fn failed(stopped: ProgramStopped) -> ControlError {
    match stopped {
        ProgramStopped::Cancelled(cancelled) => cancelled.into(),
        ProgramStopped::Failed(source) | ProgramStopped::CannotAnswer(source) => {
            ControlError::Program(source)
        }
    }
}

/// The message that begins a run: the environment and the agent.
#[derive(Serialize)]
struct BeginActing<'a> {
    columns: usize,
    column_names: &'a [String],
    actions: usize,
    action_names: &'a [String],
    gamma: f64,
    seed: u64,
    steps: usize,
    timeout: usize,
    parameters: &'a BTreeMap<String, Value>,
}

/// The message with the state of an agent and the last step.
#[derive(Serialize)]
struct StateMessage {
    state: Vec<f32>,
    /// Reward of the last step. `None` in the first state of an episode.
    #[serde(skip_serializing_if = "Option::is_none")]
    reward: Option<f64>,
    /// How the episode ends here, if it does.
    #[serde(skip_serializing_if = "Option::is_none")]
    ends: Option<EpisodeEnd>,
}

/// The end of an episode.
#[derive(Clone, Copy, Serialize)]
#[serde(rename_all = "lowercase")]
enum EpisodeEnd {
    /// A terminal: nothing follows.
    Terminal,
    /// A cut at the timeout: the states that would have followed have a value.
    Timeout,
}

/// The answer of an agent: the number of an action, or null if the agent has diverged.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ActionAnswer {
    /// Null has to be explicit. An answer without the key is a mistake.
    #[serde(deserialize_with = "Option::deserialize")]
    action: Option<usize>,
}

impl Answer for ActionAnswer {
    const LIKE: &'static str = "{\"action\": 0} (null is an agent that has diverged)";

    fn is_valid(&self) -> bool {
        true
    }
}

/// An agent in a process.
struct ProgramActor<'a, 'p> {
    process: Process<'p>,
    command: &'p ProgramCommand,
    /// The name of the setting, for messages.
    setting: String,
    actions: usize,
    /// The message that is held back, because the episode may end there.
    message: Option<StateMessage>,
    /// The reason why the agent stopped.
    stopped: Option<ProgramStopped>,
    monitor: &'a dyn Monitor,
}

impl ProgramActor<'_, '_> {
    fn begin(&mut self, begin: &BeginActing<'_>) -> Result<(), ProgramStopped> {
        let message = line(&serde_json::json!({ "calib": PROTOCOL_VERSION, "begin": begin }));
        let asked = format!("the beginning of a run with {}", self.setting);
        self.process.ask::<Ready>(message, &asked, self.monitor).map(|_| ())
    }

    /// Sends the last state of an episode.
    fn end(&mut self, message: StateMessage, ends: EpisodeEnd) {
        let message = StateMessage { ends: Some(ends), ..message };
        let asked = format!("the end of an episode with {}", self.setting);
        self.stopped = self.process.ask::<Ready>(line(&message), &asked, self.monitor).err();
    }

    fn choose(&mut self, message: &StateMessage) -> Result<Option<usize>, ProgramStopped> {
        self.monitor.check().map_err(ProgramStopped::Cancelled)?;
        let asked = format!("a state of a run with {}", self.setting);
        let ActionAnswer { action } = self.process.ask(line(message), &asked, self.monitor)?;
        if let Some(action) = action.filter(|&action| action >= self.actions) {
            return Err(ProgramStopped::CannotAnswer(
                format!(
                    "`{}` answered {asked} with action {action}: expected a whole number below {}, which is how many actions \
                     there are",
                    self.command.shown(),
                    self.actions
                )
                .into(),
            ));
        }
        Ok(action)
    }
}

impl Actor for ProgramActor<'_, '_> {
    fn look(&mut self, state: &[f32]) {
        if let Some(message) = self.message.take() {
            self.end(message, EpisodeEnd::Timeout);
        }
        self.message = Some(StateMessage { state: state.to_vec(), reward: None, ends: None });
    }

    fn act(&mut self, _rng: &mut Rng) -> Option<usize> {
        if self.stopped.is_some() {
            return None;
        }
        let message = self.message.take()?;
        match self.choose(&message) {
            Ok(action) => action,
            Err(stopped) => {
                self.stopped = Some(stopped);
                None
            }
        }
    }

    fn learn(&mut self, _action: usize, outcome: Outcome, next: &[f32]) {
        let reward = Some(outcome.reward);
        let message = StateMessage { state: next.to_vec(), reward, ends: None };
        match outcome.ending {
            Ending::Continues => self.message = Some(message),
            Ending::Terminal => self.end(message, EpisodeEnd::Terminal),
        }
    }
}
