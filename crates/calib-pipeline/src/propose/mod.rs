//! Proposes a study for an unknown log. It examines the log, and tries what cannot be seen.

mod alternatives;
mod control;
mod deadline;
mod drafting;
mod evidence;
mod given;
mod look;
mod prediction;
mod show;
mod trial;

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    time::Duration,
};

use calib_base::{
    Context as _, StepError,
    clock::Stopwatch,
    ensure,
    log::context::RunContext,
    options::ProposeOptions,
    output::{Printer, span},
};
use calib_core::Timestamp;
use calib_data::Sketch;
use calib_files::{TemporaryFolder, check_output, write_output};
use calib_propose::{
    Cleaning, Cut, Horizon, Lacking, ProposedAgent, ProposedModel, Scope, Sensors, Size,
    spacing_by_log, spacings,
};
use calib_study::{Job, Request};
use schemars::JsonSchema;
use serde::Serialize;

pub use self::control::ProposedControlStudy;
pub(crate) use self::control::{ChosenControl, run as run_control};
use self::{
    alternatives::{Alternatives, OtherTrials},
    deadline::TimeLimit,
    drafting::{Drafting, unmeasured},
    evidence::Evidence,
    given::{given, gives},
    look::{ExaminedLog, bridged},
    trial::{HeldOut, MeasuredCosts, StateSpacing, Trials},
};

/// Share of the requested time for comparing agents. The rest is for the study. Our choice.
const COMPARED: f64 = 0.5;

/// The proposed study, for `--json`.
#[derive(Debug, Serialize, JsonSchema)]
pub(crate) struct Chosen {
    /// The study file that was written.
    study: PathBuf,
    /// Number of channels that are used.
    channels: usize,
    /// Channels that are not used, each with the reason.
    left_out: Vec<[String; 2]>,
    /// Channels that are angles, each with a full turn in its unit. Their sines and cosines are used. Default: none.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    angles: BTreeMap<String, f64>,
    /// Start of the training range, and its end, which is not included.
    train: [Timestamp; 2],
    /// Start of the held-out range, and its end, which is not included.
    held_out: [Timestamp; 2],
    /// Number of rows of the training range and of the held-out range.
    rows: [usize; 2],
    /// Time from one state to the next, in seconds.
    state_secs: f64,
    sensors: Vec<String>,
    /// Why this agent is proposed.
    agent_reason: String,
    /// Trials with another horizon, other sensors or another spacing, if no agent is ahead of the simple predictors. Default: none.
    #[serde(skip_serializing_if = "Option::is_none")]
    other_trials: Option<OtherTrials>,
    gamma: f64,
    horizon_secs: f64,
    /// Number of steps of every run.
    steps: usize,
    /// Estimated duration of `calib run` on this machine, in seconds, under the load that the machine has while `calib init` measures. None
    /// if the time limit was reached before it was measured.
    expected_secs: Option<f64>,
    /// Estimated processor time of `calib run`, in seconds, which does not depend on the load of the machine. None if the system does not
    /// report it, or it was not measured.
    expected_processor_secs: Option<f64>,
}

/// A proposed study of a log.
#[derive(Debug)]
pub struct ProposedStudy {
    chosen: Chosen,
    /// Number of channels in the log.
    of_channels: usize,
    /// Missing data in the training range and in the held-out range.
    lacking: [Option<Lacking>; 2],
    /// Number of learning rates in the study.
    learning_rates: usize,
    /// The requested time, in seconds.
    within: f64,
    /// Duration of the proposal: examining the log, and trying agents and models.
    took: Duration,
}

impl ProposedStudy {
    /// Returns the path of the written study.
    pub fn study(&self) -> &Path {
        &self.chosen.study
    }

    /// Returns the sensors that agents predict.
    pub fn sensors(&self) -> &[String] {
        &self.chosen.sensors
    }

    /// Returns the horizon of the agents, in seconds.
    pub fn horizon_secs(&self) -> f64 {
        self.chosen.horizon_secs
    }

    /// Returns the estimated time of `calib run` on this machine, in seconds. `None` if the time was over before it was
    /// measured.
    pub fn expected_secs(&self) -> Option<f64> {
        self.chosen.expected_secs
    }
}

pub(crate) fn run(args: &ProposeOptions, context: &RunContext) -> Result<ProposedStudy, StepError> {
    check_arguments(
        args,
        &[
            ("data.train_fraction", "it chooses data.train and data.held_out; give these"),
            ("agent.gamma", "it follows from the horizon; give --horizon"),
            (
                "sweep.steps",
                "it plans the length of runs for --within; change it in the study afterwards",
            ),
            ("sweep.sensors", "it sizes the study for the sensors of --sensor; name them there"),
        ],
    )?;
    let clock = Stopwatch::start();
    let path = path_in_study(&args.logs, &args.study)?;
    let look = ExaminedLog::at(args, context)?;
    let asked = args;
    let args = &with_exclusions(asked, &look.scope, &look.sketch)?;
    warn_of_cleaning(args, &look.sketch, &look.scope, &look.cleaning, context);
    let drafting = Drafting { args, asked, path: &path, look: &look, held_out: None };
    let proposal = Proposal::of(&drafting, clock, context)?;
    write_output(&args.study, args.existing, |file| {
        std::io::Write::write_all(file, proposal.text.as_bytes())
    })?;
    Ok(proposal.written(args, &look, clock.elapsed()))
}

/// Refuses an output that cannot be written, before the trials begin. Also refuses keys without an effect, and names
/// the alternative.
fn check_arguments(
    args: &ProposeOptions,
    without_effect: &[(&str, &str)],
) -> Result<(), StepError> {
    ensure!(
        args.study.extension().is_some_and(|extension| extension == "toml"),
        "{}: expected the name of a study file, which ends in .toml",
        args.study.display()
    );
    for (key, instead) in without_effect {
        ensure!(!gives(args, key), "--set {key} has no effect on `calib init`: {instead}");
    }
    Ok(check_output(&args.study, args.existing)?)
}

/// Warns about rows of the log that are left out, and about values that replace missing ones.
fn warn_of_cleaning(
    args: &ProposeOptions,
    sketch: &Sketch,
    scope: &Scope,
    cleaning: &Cleaning,
    printer: &Printer,
) {
    let contradictions = cleaning.contradictions.as_ref();
    if let Some(why) = contradictions.filter(|_| !gives(args, "data.contradictions")) {
        printer.warn(&format!(
            "{why}: the first of them is kept; data.time_zone may tell the hours apart, data.contradictions which is kept"
        ));
    }
    if let Some(bridged) = bridged(sketch, scope) {
        printer.warn(&bridged);
    }
}

/// Returns the options with calib's exclusions added to a given `data.exclude`. Otherwise the given list would replace
/// them.
fn with_exclusions(
    args: &ProposeOptions,
    scope: &Scope,
    sketch: &Sketch,
) -> Result<ProposeOptions, StepError> {
    let mut args = args.clone();
    if !gives(&args, EXCLUDE) {
        return Ok(args);
    }
    let given = calib_study::of_data(&args.logs, &args.set)?.data.exclude;
    let all = calib_propose::exclusions(&given, scope, sketch);
    args.set.push(format!("{EXCLUDE}={all}"));
    Ok(args)
}

const EXCLUDE: &str = "data.exclude";

/// Parses a given number of rows per state, for a training range of `rows` rows.
fn given_spacing(value: &str, rows: usize) -> Result<usize, StepError> {
    let spacing = value.parse().ok().filter(|spacing| (1..rows).contains(spacing));
    spacing.with_context(|| {
        format!("preprocess.subsample is {value}; expected a whole number from 1 to {}, the rows to learn from", rows - 1)
    })
}

/// Returns the path of the log for the study file. It stays as it was typed if it has the same meaning there.
fn path_in_study(logs: &Path, study: &Path) -> Result<String, StepError> {
    let beside = study.parent().is_none_or(|folder| folder.as_os_str().is_empty());
    let path = if beside || logs.is_absolute() {
        logs.to_owned()
    } else {
        std::env::current_dir().context("cannot tell the current folder")?.join(logs)
    };
    let path = path.to_str().with_context(|| format!("{}: not Unicode", path.display()))?;
    Ok(path.to_owned())
}

/// A proposed study, and the findings that led to it.
struct Proposal {
    text: String,
    spacing: usize,
    cut: Cut,
    /// Channels that are predicted, followed by further candidates.
    sensors: Sensors,
    agent: Evidence,
    horizon: Horizon,
    sized: SizedStudy,
}

/// The size of a study.
struct SizedStudy {
    size: Size,
    reason: String,
    /// The simple predictor that agents start from, in words. Empty if it is not known.
    best: String,
    /// Time of the study in seconds, if it was measured.
    expected_secs: Option<f64>,
    expected_processor_secs: Option<f64>,
}

impl Proposal {
    fn of(
        drafting: &Drafting<'_>,
        begun: Stopwatch,
        context: &RunContext,
    ) -> Result<Self, StepError> {
        let Drafting { args, look, .. } = *drafting;
        let sketch = &look.sketch;
        let place = TemporaryFolder::new()?;
        let model = ProposedModel::for_given(&args.set);
        let trials = Trials {
            args,
            place: &place,
            model,
            context,
            comparing: TimeLimit::new(begun, COMPARED * args.within, context),
            measuring: TimeLimit::new(begun, args.within, context),
        };
        let mut sensors = look.sensors.clone();
        drafting.refuse_beyond_held_out()?;
        let StateSpacing { spacing, why, cost } = chosen_spacing(&trials, drafting)?;
        if let Some(too_near) = drafting.too_near(spacing) {
            context.warn(&too_near);
        }
        let mut horizon = drafting.ahead(spacing);
        let agent = tried_agents(&trials, drafting, spacing, &mut horizon)?;
        agent.reorder(&mut sensors, !args.sensors.is_empty());
        let all = look.cut.rows[0] / spacing;
        let rows = trial::rows_within(trials.measuring.left_secs(), cost, all);
        let cut = if rows < all {
            look.cut.shortened(&sketch.timestamps, rows.saturating_mul(spacing))
        } else {
            look.cut.clone()
        };
        // Without time left, the study is the smallest one, which has one sensor.
        let measured_sensors = if trials.measuring.is_over() { 1 } else { sensors.proposed.len() };
        let text = |steps: usize, horizon: Horizon| {
            let size = Size::trial(agent.agent, model, steps, measured_sensors);
            (drafting.text(spacing, &cut, &sensors, horizon, &size, [""; 4]), size)
        };
        let steps = drafting.most_steps(spacing, horizon);
        let HeldOut { segments, read } = trials.held_out(steps, &mut horizon, text)?;
        let drafting = &Drafting { held_out: Some(segments), ..*drafting };
        let steps = drafting.most_steps(spacing, horizon);
        let measured = trials.costs(steps, &mut horizon, read, text)?;
        // A shorter horizon than proposed may leave room for four windows.
        let steps = steps.min(drafting.most_steps(spacing, horizon));
        let sized = SizedStudy::of(&trials, drafting, agent.agent, steps, measured, begun);
        let text = drafting.text(
            spacing,
            &cut,
            &sensors,
            horizon,
            &sized.size,
            [&why, &agent.reason, &sized.reason, &sized.best],
        );
        // Given keys are written into the study, so that it is the same without `--set`.
        let text = calib_propose::with_given(&text, &args.set);
        let doubts =
            [drafting.too_far(horizon), drafting.few_windows(spacing, horizon, &sized.size)];
        for doubt in doubts.iter().flatten() {
            context.warn(doubt);
        }
        Job::of_text(Request::new(&args.study), text.clone())?;
        Ok(Self { text, spacing, cut, sensors, agent, horizon, sized })
    }

    /// Summarises the study after it is written.
    fn written(self, args: &ProposeOptions, look: &ExaminedLog, took: Duration) -> ProposedStudy {
        let ExaminedLog { sketch, scope, .. } = look;
        let predicted = self
            .sensors
            .proposed
            .iter()
            .take(self.sized.size.sensors)
            .map(|&channel| sketch.channels[channel].name.clone())
            .collect();
        let left_out =
            scope.left_out.iter().map(|channel| [channel.name.clone(), channel.why.to_string()]);
        let angles = look.angles.iter().map(|angle| (angle.channel.clone(), angle.turn));
        let ranges = self.cut.ranges(&sketch.timestamps);
        let chosen = Chosen {
            study: args.study.clone(),
            channels: scope.channels.len(),
            left_out: left_out.collect(),
            angles: angles.collect(),
            train: self.cut.train,
            held_out: self.cut.held_out,
            rows: self.cut.rows,
            state_secs: sketch.period_secs * self.spacing as f64,
            sensors: predicted,
            agent_reason: self.agent.reason,
            other_trials: self.agent.others,
            gamma: self.horizon.gamma,
            horizon_secs: self.horizon.secs,
            steps: self.sized.size.steps,
            expected_secs: self.sized.expected_secs,
            expected_processor_secs: self.sized.expected_processor_secs,
        };
        ProposedStudy {
            chosen,
            of_channels: sketch.channels.len(),
            lacking: ranges.map(|range| Lacking::of(sketch, scope, &range)),
            learning_rates: self.sized.size.values(),
            within: args.within,
            took,
        }
    }
}

impl SizedStudy {
    /// Returns the largest study that fits into the remaining time, with runs of at most `most_steps` steps. If the
    /// costs are not known, it returns the smallest study.
    fn of(
        trials: &Trials<'_>,
        drafting: &Drafting<'_>,
        agent: ProposedAgent,
        most_steps: usize,
        measured: Option<MeasuredCosts>,
        begun: Stopwatch,
    ) -> Self {
        let look = drafting.look;
        let sensors = look.sensors.proposed.len();
        let Some(measured) = measured else {
            return Self {
                size: Size::smallest(agent, trials.model, most_steps, sensors),
                reason: format!(
                    "The smallest study that says anything: {}",
                    unmeasured(trials.args.within, trials.context)
                ),
                best: String::new(),
                expected_secs: None,
                expected_processor_secs: None,
            };
        };
        let MeasuredCosts { time, processors, best } = measured.with_reading(look.read);
        // Examining and trials count towards the requested time.
        let tried = begun.elapsed().as_secs_f64();
        let left = trials.measuring.left_secs();
        let size = Size::within(agent, trials.model, left, time, most_steps, sensors);
        let secs = size.secs(time);
        Self {
            reason: drafting.size_reason(secs, secs - time.fixed_secs, tried, trials.context),
            best,
            expected_secs: Some(secs),
            expected_processor_secs: processors.map(|costs| size.secs(costs)),
            size,
        }
    }
}

/// Chooses the time between states.
fn chosen_spacing(trials: &Trials<'_>, drafting: &Drafting<'_>) -> Result<StateSpacing, StepError> {
    let ExaminedLog { sketch, scope, cut, sensors, .. } = drafting.look;
    // Takes the last rows of the training range, because they come just before the data that the study is judged on.
    let small = |spacing: usize| {
        let horizon = drafting.ahead(spacing);
        let steps = drafting.most_steps(spacing, horizon);
        let size = Size::trial(ProposedAgent::Linear, trials.model, steps, sensors.proposed.len());
        let cut = cut.shortened(&sketch.timestamps, trial::ROWS * spacing);
        drafting.text(spacing, &cut, sensors, horizon, &size, [""; 4])
    };
    if trials.choose_spacing() {
        let candidates = spacings(sketch, scope, cut.rows[0]);
        return trials.spacing(&candidates, small, sketch.period_secs);
    }
    let (spacing, why) = match given(trials.args, "preprocess.subsample") {
        Some(value) => (given_spacing(value, cut.rows[0])?, "as it was given"),
        None => spacing_by_log(sketch, scope, cut.rows, trials.args.horizon),
    };
    let why = format!("states {} apart: {why}", span(sketch.period_secs * spacing as f64));
    trials.context.say(&why);
    let cost = trials.cost_of_states(spacing, cut.rows[0] / spacing, small(spacing))?;
    Ok(StateSpacing { spacing, why, cost })
}

/// Tries agents on the last third of the training range. The `horizon` is shortened until something is predicted. If no
/// agent is ahead of the simple predictors, other horizons and sensors are tried too.
fn tried_agents(
    trials: &Trials<'_>,
    drafting: &Drafting<'_>,
    spacing: usize,
    horizon: &mut Horizon,
) -> Result<Evidence, StepError> {
    let sensors = &drafting.look.sensors;
    let mut nearer = *horizon;
    let gathered = Evidence::gather(trials, &mut nearer, |agent, horizon| {
        drafting.trial_text(trials.model, agent, spacing, sensors, horizon)
    });
    let mut evidence = match gathered {
        Err(reason) if !reason.was_cancelled() => {
            // The full study may succeed where a part of its training range is too small.
            return Ok(Evidence::untried(&reason, trials.context));
        }
        gathered => gathered?,
    };
    *horizon = nearer;
    if !evidence.is_ahead {
        let alternatives = Alternatives { trials, drafting, spacing, horizon: *horizon };
        evidence.others = Some(alternatives.try_out(&evidence.tried)?);
    }
    Ok(evidence)
}
