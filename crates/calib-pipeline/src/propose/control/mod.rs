//! Proposes a study of agents that act. It reads the decisions of a log as the study will read them, and times short
//! runs.

mod columns;
mod costs;
mod decisions_draft;
mod show;

use std::{
    io::Write as _,
    path::{Path, PathBuf},
    time::Duration,
};

use calib_base::{
    Context as _, StepError,
    clock::Stopwatch,
    options::ProposeOptions,
    output::{Printer, counted, span},
};
use calib_control::{Algorithm, ControlConfig, StartRows};
use calib_files::{TemporaryFolder, write_output};
use calib_propose::{Costs, DecisionColumns, GivenControl, ProposedControl, control_steps};
use calib_study::{Job, Request};
use schemars::JsonSchema;
use serde::Serialize;

use self::decisions_draft::{ControlDrafting, ExaminedDecisions, section};
use super::{
    check_arguments,
    drafting::{unmeasured, warn_of_time},
    given::gives,
    path_in_study, warn_of_cleaning, with_exclusions,
};
use crate::control::{self, ActionLog};

/// Keys without an effect here, with the alternative.
const WITHOUT_EFFECT: [(&str, &str); 6] = [
    ("control", "it would replace the columns that were named; give each key by itself"),
    ("control.actions", "name the columns with --action"),
    ("control.terminal", "name the column with --terminal"),
    ("control.probability", "name the column with --probability"),
    (
        "control.steps",
        "it plans the length of runs for --within; change it in the study afterwards",
    ),
    ("sweep.sensors", "agents that act predict no sensor; leave --action out for those that do"),
];

/// The proposed study of agents that act, for `--json`.
#[derive(Debug, Serialize, JsonSchema)]
pub(crate) struct ChosenControl {
    /// The study file that was written.
    study: PathBuf,
    /// Columns of the states.
    columns: Vec<String>,
    /// Channels that are not used, each with the reason.
    left_out: Vec<[String; 2]>,
    /// Number of steps of the log from which agents learn.
    transitions: usize,
    episodes: usize,
    /// Number of episodes that end in a terminal.
    terminals: usize,
    actions: Vec<TakenAction>,
    /// Levels of each column of continuous actions. Default: every combination of values is an action.
    #[serde(skip_serializing_if = "Option::is_none")]
    levels: Option<usize>,
    /// Mean return of recorded episodes.
    mean_return: f64,
    /// Standard deviation of recorded returns, in units of reward.
    return_spread: f64,
    /// Steps after which an episode is cut.
    timeout: usize,
    start: StartRows,
    gamma: f64,
    /// Learning algorithm of the default.
    algorithm: Algorithm,
    /// Step size of the default.
    step_size: f64,
    /// Temperature of the default; for `expected_sarsa` only.
    temperature: f64,
    /// Number of settings that are compared.
    settings: usize,
    /// Number of steps of every run.
    steps: usize,
    /// Estimated duration of `calib run` on this machine, in seconds. None if the time limit was reached before it was measured.
    expected_secs: Option<f64>,
    /// The part of it that does not depend on `steps`: reading, models, evaluations by the log alone, and storing runs.
    fixed_secs: Option<f64>,
}

/// An action of the log.
#[derive(Debug, Serialize, JsonSchema)]
struct TakenAction {
    name: String,
    /// Number of transitions with the action.
    transitions: usize,
}

/// A proposed study of agents that act.
#[derive(Debug)]
pub struct ProposedControlStudy {
    chosen: ChosenControl,
    timeout_reason: String,
    gamma_reason: String,
    /// Runs of each setting, in all models together.
    runs: usize,
    /// The requested time, in seconds.
    within: f64,
    /// The time that does not depend on the steps, in seconds, if it alone is more than was left of the requested time.
    fixed_beyond: Option<f64>,
    /// Duration of the proposal: examining the log and timing runs.
    took: Duration,
}

impl ProposedControlStudy {
    /// Returns the path of the written study.
    pub fn study(&self) -> &Path {
        &self.chosen.study
    }

    /// Returns the steps of every run.
    pub fn steps(&self) -> usize {
        self.chosen.steps
    }

    /// Returns the estimated time of `calib run` on this machine, in seconds. `None` if the time was over before it was
    /// measured.
    pub fn expected_secs(&self) -> Option<f64> {
        self.chosen.expected_secs
    }
}

/// Examines a log of decisions, and writes a study of agents that act.
pub(crate) fn run(
    args: &ProposeOptions,
    columns: &DecisionColumns,
    printer: &Printer,
) -> Result<ProposedControlStudy, StepError> {
    check_arguments(args, &WITHOUT_EFFECT)?;
    columns::refuse_repeated(columns)?;
    columns::require_reward(columns, args)?;
    let begun = Stopwatch::start();
    let path = path_in_study(&args.logs, &args.study)?;
    let args = &with_columns(args, columns);
    let given = given(args, columns)?;
    let look = ExaminedDecisions::at(args, columns, printer)?;
    let args = &with_exclusions(args, &look.scope, &look.sketch)?;
    warn_of_cleaning(args, &look.sketch, &look.scope, &look.cleaning, printer);
    let place = TemporaryFolder::new()?;
    let drafting = ControlDrafting { args, path: &path, columns, look: &look, place: &place };
    let read = drafting.decisions(printer)?;
    let decisions = &read.log.decisions;
    let proposed = ProposedControl::for_log(decisions, read.log.period.as_secs(), given)
        .map_err(StepError::other)
        .with_context(|| match &columns.reward {
            Some(name) => format!("--reward {name}"),
            None => format!("--set {}", columns::REWARD),
        })?;
    let costs = drafting.costs(&read, &proposed, begun, printer)?;
    // Examining and timing count towards the requested time.
    let tried = begun.elapsed().as_secs_f64();
    let steps = control_steps(args.within - tried, costs);
    let expected = costs.map(|costs| ExpectedTime::of(costs, steps));
    let why = steps_reason(args.within, tried, expected, printer);
    let text = drafting.text(read.levels.as_ref(), Some(&proposed), steps, &why);
    // Given keys are written into the study, so that it is the same without `--set`.
    let text = calib_propose::with_given(&text, &args.set);
    let job = Job::of_text(Request::new(&args.study), text.clone())?;
    let config = section(&job)?;
    let unnamed = columns::unnamed(&read.log.names.columns);
    for doubt in unnamed.into_iter().chain(doubts(&read.log, config)) {
        printer.warn(&doubt);
    }
    let chosen = chosen(&job, &look, &read.log, &proposed, expected)?;
    write_output(&args.study, args.existing, |file| file.write_all(text.as_bytes()))?;
    Ok(ProposedControlStudy {
        chosen,
        timeout_reason: proposed.timeout.1,
        gamma_reason: proposed.gamma.1,
        runs: config.runs_of_a_setting(),
        within: args.within,
        fixed_beyond: expected.and_then(|time| time.fixed_beyond(args.within, tried)),
        took: begun.elapsed(),
    })
}

/// Returns the options with the columns as `--set` keys, so that they are read together with other keys of `[control]`.
fn with_columns(args: &ProposeOptions, columns: &DecisionColumns) -> ProposeOptions {
    let keys = columns.keys().into_iter().map(|(key, value)| format!("control.{key}={value}"));
    ProposeOptions { set: keys.chain(args.set.iter().cloned()).collect(), ..args.clone() }
}

/// Returns the values given with `--set`, which are not proposed. Refuses a reward that is no list of terms.
fn given(args: &ProposeOptions, columns: &DecisionColumns) -> Result<GivenControl, StepError> {
    let study = calib_study::of_data(&args.logs, &args.set)?;
    let control = study.control.unwrap_or_default();
    columns::require_terms(columns, &control)?;
    let agent = control.agent;
    Ok(GivenControl {
        timeout: gives(args, "control.timeout").then_some(control.timeout),
        gamma: gives_to_agent(args, "gamma").then_some(agent.gamma),
        algorithm: agent.algorithm,
        pairs: gives_to_agent(args, "pairs").then_some(agent.pairs),
    })
}

/// Whether a field of the agent was given, either alone or as part of the whole table.
fn gives_to_agent(args: &ProposeOptions, field: &str) -> bool {
    gives(args, "control.agent") || gives(args, &format!("control.agent.{field}"))
}

/// The expected time of a study on this machine.
#[derive(Clone, Copy, Debug)]
struct ExpectedTime {
    /// The whole time, in seconds.
    secs: f64,
    /// The part of it that does not depend on the steps, in seconds.
    fixed_secs: f64,
}

impl ExpectedTime {
    /// Returns the time of a study with these costs and runs of this many steps.
    fn of(costs: Costs, steps: usize) -> Self {
        let Costs { fixed_secs, agent_step_secs, .. } = costs;
        Self { secs: fixed_secs + steps as f64 * agent_step_secs, fixed_secs }
    }

    /// Returns the time that does not depend on the steps, in whole seconds, if it alone is more than what trials have left of
    /// `within`. If they have left nothing, it must be more than the whole.
    fn fixed_beyond(self, within: f64, tried_secs: f64) -> Option<f64> {
        let fixed_secs = self.fixed_secs.round();
        let left_secs = within - tried_secs;
        let limit = if left_secs > 0.0 { left_secs } else { within };
        (fixed_secs > limit).then_some(fixed_secs)
    }
}

/// Returns the reason for the number of steps. Warns if the study takes longer than requested, and if no number of steps
/// could change that, or if its time is not known.
fn steps_reason(
    within: f64,
    tried_secs: f64,
    expected: Option<ExpectedTime>,
    printer: &Printer,
) -> String {
    let Some(time) = expected else {
        return format!("the least that says anything: {}", unmeasured(within, printer));
    };
    warn_of_time(within, tried_secs, time.secs, printer);
    let [expected, asked] = [time.secs.round(), within].map(span);
    if let Some(fixed_secs) = time.fixed_beyond(within, tried_secs) {
        let fixed = span(fixed_secs);
        printer.warn(&format!(
            "about {fixed} of the time of `calib run` do not depend on control.steps, and --within leaves less: list fewer kinds of models in \
             control.models, or sweep fewer settings in control.grid"
        ));
        return format!(
            "the least that says anything: about {expected} on this machine, of which {fixed} do not depend on the steps, more than the {asked} of \
             --within leave"
        );
    }
    let beside = if time.secs.round() > within { "more than the" } else { "of the" };
    format!("about {expected} on this machine, {beside} {asked} of --within")
}

/// Returns doubts about choices from this log that do not depend on the agents.
fn doubts(log: &ActionLog, config: &ControlConfig) -> Vec<String> {
    let decisions = &log.decisions;
    let mut doubts: Vec<String> =
        control::hardly_taken(&log.names.actions, &decisions.counts(), config)
            .into_iter()
            .collect();
    let terminals = decisions.terminals();
    if config.terminal.is_some() && terminals < config.fewest_terminals {
        doubts.push(format!(
            "the log has {}, and calib names no setting to deploy with fewer than {} (control.fewest_terminals): use a longer log",
            counted(terminals, "terminal"),
            config.fewest_terminals
        ));
    }
    doubts
}

/// Summarises the proposed study.
fn chosen(
    job: &Job,
    look: &ExaminedDecisions,
    log: &ActionLog,
    proposed: &ProposedControl,
    expected: Option<ExpectedTime>,
) -> Result<ChosenControl, StepError> {
    let config = section(job)?;
    let decisions = &log.decisions;
    let left_out = look.scope.left_out.iter();
    let actions = log.names.actions.iter().zip(decisions.counts());
    Ok(ChosenControl {
        study: job.layout().study().to_owned(),
        columns: log.names.columns.clone(),
        left_out: left_out.map(|one| [one.name.clone(), one.why.to_string()]).collect(),
        transitions: decisions.len(),
        episodes: decisions.starts().len(),
        terminals: decisions.terminals(),
        actions: actions
            .map(|(name, transitions)| TakenAction { name: name.clone(), transitions })
            .collect(),
        levels: config.levels,
        mean_return: decisions.recorded_return(config.timeout)?.mean,
        return_spread: proposed.spread,
        timeout: config.timeout,
        start: config.start,
        gamma: config.agent.gamma,
        algorithm: config.agent.algorithm,
        step_size: config.agent.step_size,
        temperature: config.agent.temperature,
        settings: config.grid.candidates(config.agent)?.len(),
        steps: config.steps,
        expected_secs: expected.map(|time| time.secs),
        fixed_secs: expected.map(|time| time.fixed_secs),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_have_a_reason_where_no_number_of_them_fits() {
        let costs = Costs { fixed_secs: 92.4, agent_step_secs: 0.021, replay_run_secs: 0.0 };
        let time = ExpectedTime::of(costs, 2_000);
        assert_eq!((time.secs.round(), time.fixed_beyond(60.0, 6.0)), (134.0, Some(92.0)));
        assert_eq!(time.fixed_beyond(106.0, 6.0), None);
        assert_eq!(time.fixed_beyond(60.0, 61.0), Some(92.0));
        assert_eq!(time.fixed_beyond(120.0, 121.0), None, "trials took the time");
        let reason = |within| steps_reason(within, 6.0, Some(time), &Printer::nobody());
        let fixed = "the least that says anything: about 2 min 14 s on this machine, of which 1 min 32 s do not";
        assert!(reason(60.0).starts_with(fixed), "{}", reason(60.0));
        assert_eq!(
            reason(120.0),
            "about 2 min 14 s on this machine, more than the 2 min of --within"
        );
        assert_eq!(
            reason(150.0),
            "about 2 min 14 s on this machine, of the 2 min 30 s of --within"
        );
    }
}
