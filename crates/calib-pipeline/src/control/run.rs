use std::path::Path;

use calib_base::{
    StepError, artefact,
    clock::Stopwatch,
    log::{plant_of_study::data_of, sources::Sources},
    memory,
    outcome::{Outcome, StepResult},
    output::{Printer, count, counted, duration},
};
use calib_control::{
    ActingAgents, ActionModel, ActionModelKind, AgentConfig, Algorithm, ConstantReturns,
    ControlConfig, ControlError, Doubt, Ensemble, IncrementModel, Increments, NetworkFiles,
    NetworkModel, OffPolicyValues, PAIRED_COLUMNS, Question, Run, RunBudget, RunId,
    constant_returns, judge, off_policy_values, runs_here, sweep_keeping, trajectory,
};
use calib_core::{Monitor, Seed};
use calib_files::Fingerprint;
use calib_report::listed;
use calib_study::{Job, Share, StepKind};

use super::{
    agents::{ComparedAgents, ProgramAgents},
    beside_returns::beyond_returns,
    conduct::{conduct, recorded_rows},
    described::described,
    evaluation::ControlEvaluation,
    files::{self, KeptVerdict},
    held_out,
    held_out_period::HeldOutLog,
    log::{self, ActionLog},
    model, page,
    plan::{self, ControlPlan},
    rare,
    section::{no_section, support},
    show,
    units::{self, RunCounts, RunFiles, RunOrigin},
    work_left::members_of,
};

/// Runs `calib control`: from the log of decisions to the verdict.
pub(crate) fn run(
    job: &Job,
    printer: &Printer,
) -> Result<StepResult<ControlEvaluation, ControlPlan>, StepError> {
    let clock = Stopwatch::start();
    job.refuse_deployment()?;
    let study = job.study();
    let Some(config) = &study.control else { return Err(no_section(job)) };
    let agents = ComparedAgents::of_study(job, config)?;
    let sources = Sources::of(&data_of(job)?)?;
    let (log, rest) = log::read_with_rest(job, config, printer)?;
    log.tell_doubts(printer);
    rare::check_actions(&log.names.actions, &log.decisions.counts(), config, printer)?;
    let directory = job.layout().control();
    let key = files::key(study, &log.fingerprint, agents.program_identity())?;
    let origin = RunOrigin { key: key.clone(), log: log.fingerprint.clone() };
    if let Some(kept) = KeptVerdict::to_use(job, &key, &sources, printer) {
        let others = held_out::read_others(job, config, &log, rest, &kept, printer)?;
        if job.policy().is_dry() {
            printer.say(&match others {
                None => up_to_date(&directory),
                Some(_) => format!("{}, and would be judged", held_out::ONLY_HELD_OUT),
            });
            let units = RunFiles::seen(&job.layout().control_units(), origin, job.policy().share);
            let plan = ControlPlan::of_nothing(config, agents.count(), &units)?;
            return Ok(StepResult::Planned(plan));
        }
        model::mend(job, config, &log, printer)?;
        if job.policy().share.is_some() {
            printer.say(&up_to_date(&directory));
            return Ok(StepResult::Nothing(Outcome::Done));
        }
        let evaluation = held_out::brought_up_to_date(job, config, &log, kept, others, printer)?;
        files::note_study(&directory, study, &sources, printer)?;
        let folder = job.layout().control_units();
        artefact::or_read_only(units::remove_left(&folder, &key), &folder, printer)?;
        printer.say(&up_to_date(&directory));
        return Ok(StepResult::Made(evaluation));
    }
    let held_out = held_out::read(job, config, &log, rest, printer)?;
    announce(config, &log, agents.count(), printer);
    if let ComparedAgents::Own(candidates) = &agents {
        fits(config, candidates, &log, printer)?;
    }
    log::require_model(&log.decisions, config)?;
    if job.policy().is_dry() {
        let units = RunFiles::seen(&job.layout().control_units(), origin, job.policy().share);
        let plan = plan::planned(job, config, &log, &agents, &units, printer)?;
        plan.announce(job, printer);
        printer.say(&format!("dry run: nothing written to {}", directory.display()));
        return Ok(StepResult::Planned(plan));
    }
    if let Some(share) = job.policy().share {
        let units = RunFiles::of_share(&job.layout().control_units(), origin, share)?;
        run_share(job, config, &log, &agents, share, &units, printer)?;
        return Ok(StepResult::Nothing(Outcome::Done));
    }
    plan::require_room(job, config, &log.decisions, agents.count())?;
    let units = RunFiles::open(&job.layout().control_units(), origin)?;
    if job.policy().redoes() {
        units.remove()?;
    }
    let JudgedSettings { log, evaluation, runs } =
        judged(job, config, log, &held_out, &agents, &units, printer)?;
    files::write(&directory, study, key, &log, &evaluation, &runs, || {
        page::write(&directory, job, &evaluation)
    })?;
    files::note_sources(&directory, &sources, printer)?;
    // The next command tries failed settings again, and reuses the runs of the others.
    if !evaluation.lacks_settings() {
        units.remove()?;
    }
    let took = duration(clock.elapsed());
    printer.say(&format!("written to {} in {took}", directory.display()));
    printer.say(&format!("the report is {}", page::path(&directory).display()));
    Ok(StepResult::Made(evaluation))
}

fn up_to_date(directory: &Path) -> String {
    format!("{} is up to date", directory.display())
}

/// The model that agents are trained in.
struct TrainingModel {
    model: ActionModel,
    /// The files of its networks, if it is stored.
    networks: Option<NetworkFiles>,
    /// The seed of all random numbers for agents in it.
    seed: Seed,
}

impl TrainingModel {
    /// Opens the model of the study, or builds it.
    fn open_or_build(
        job: &Job,
        config: &ControlConfig,
        log: &ActionLog,
        printer: &Printer,
    ) -> Result<Self, StepError> {
        Ok(Self {
            model: model::open_or_build(job, config, log, printer)?,
            networks: model::network_files(job, config, log)?,
            seed: model::seed(job.study().seed),
        })
    }
}

/// Makes the runs of a share, which a later command without a share judges. That command tries failed settings again,
/// so failures here are only warnings.
fn run_share(
    job: &Job,
    config: &ControlConfig,
    log: &ActionLog,
    agents: &ComparedAgents,
    share: Share,
    units: &RunFiles,
    printer: &Printer,
) -> Result<(), StepError> {
    let opened = TrainingModel::open_or_build(job, config, log, printer)?;
    let own = agents.own();
    let program = agents.of_program(&log.names);
    let acting: &dyn ActingAgents = program.as_ref().map_or(&own, |program| program);
    let runs = swept(config, &opened, acting, units, printer)?.runs;
    let mut failures = Vec::new();
    if let Some(program) = program {
        printer.say_all(&program.reasons());
        failures = program.failures();
        // As without a share: a process that fails at its end may have given wrong answers before. Runs of other shares
        // are kept.
        if let Err(reason) = program.finish() {
            units.forget(&runs)?;
            return Err(reason);
        }
    }
    for failure in &failures {
        printer.warn(&failure.warning());
    }
    let all = config.runs_of_a_setting() * agents.count();
    let RunCounts { made, found } = units.counts();
    printer.result(&format!(
        "share {share}: {} made, {found} there before, of {all} in all",
        counted(made, "run")
    ))?;
    printer.next(&[job.command(StepKind::Control)]);
    Ok(())
}

/// Prints the size of the log and of the sweep.
fn announce(config: &ControlConfig, log: &ActionLog, candidates: usize, printer: &Printer) {
    let decisions = &log.decisions;
    let episodes = decisions.starts().len();
    let terminals = decisions.terminals();
    printer.say(&format!(
        "{}; {}; states of {}",
        show::held(decisions.len(), episodes, terminals),
        counted(decisions.levels(), "action"),
        counted(log.names.columns.len(), "column"),
    ));
    let members = config.model.members;
    let kinds: Vec<String> = config.models.iter().map(|kind| kind.name().to_owned()).collect();
    printer.say(&format!(
        "{} x {members} ensemble members of {} x {} of {}",
        counted(candidates, "setting"),
        listed(&kinds),
        counted(config.runs, "run"),
        counted(config.steps, "step"),
    ));
}

/// Checks that agents that learn in parallel fit into memory. Warns if pairs of columns would take most of the time, or
/// if values of agents do not fit the returns of the log.
fn fits(
    config: &ControlConfig,
    candidates: &[AgentConfig],
    log: &ActionLog,
    printer: &Printer,
) -> Result<(), StepError> {
    let columns = log.names.columns.len();
    let actions = log.decisions.levels();
    let mut largest = 0;
    for candidate in candidates {
        largest = largest.max(candidate.bytes(columns, actions)?);
    }
    let threads = rayon::current_num_threads();
    memory::require(
        largest * threads as u64,
        &format!(
            "an agent of {columns} columns and {actions} actions for each of {}",
            counted(threads, "thread")
        ),
        "set control.agent.pairs = false, keep fewer columns with data.include, or use fewer threads (--threads)",
    )?;
    if columns > PAIRED_COLUMNS
        && candidates.iter().any(|agent| agent.pairs && agent.algorithm != Algorithm::DeepQLearning)
    {
        let times = (columns - 1) / 2 + 1;
        printer.warn(&format!(
            "agents tile the {} pairs of {columns} columns, which takes some {times} times as long as the columns alone; \
             consider control.agent.pairs = false, or fewer columns",
            count(columns * (columns - 1) / 2),
        ));
    }
    for doubt in beyond_returns(config, candidates, &log.decisions) {
        printer.warn(&doubt);
    }
    Ok(())
}

/// Largest number of counted steps of the chosen agent.
const MOST_TOLD_STEPS: usize = 5_000;

/// The judged settings, with their runs.
struct JudgedSettings {
    /// Fingerprint of the log.
    log: Fingerprint,
    evaluation: ControlEvaluation,
    runs: Vec<Run>,
}

/// Builds the model, trains the agent of every setting in it, and judges the settings.
fn judged(
    job: &Job,
    config: &ControlConfig,
    log: ActionLog,
    held_out: &[HeldOutLog],
    agents: &ComparedAgents,
    units: &RunFiles,
    printer: &Printer,
) -> Result<JudgedSettings, StepError> {
    let study = job.study();
    let progress = printer.progress();
    let opened = TrainingModel::open_or_build(job, config, &log, printer)?;
    let (model, seed) = (&opened.model, opened.seed);
    let held_out = held_out::judged(job, config, &log, model, held_out, printer)?;
    let log_warnings = log.warnings(config);
    let ActionLog { names, fingerprint, period, .. } = log;
    let observed = model.starts().clone();
    let own = agents.own();
    let program = agents.of_program(&names);
    let acting: &dyn ActingAgents = program.as_ref().map_or(&own, |program| program);
    let SweptSettings { runs, constants } = swept(config, &opened, acting, units, printer)?;
    printer.say_all(&program.as_ref().map_or_else(Vec::new, ProgramAgents::reasons));
    let decisions = model.log();
    let default = agents.default(config);
    let question = Question {
        log: decisions,
        timeout: config.longest_episode(),
        candidates: agents.count(),
        default: default.filter(|&default| !acting.has_failed(default)),
        rule: config.rule,
        support: support(config),
        resamples: study.evaluate.resamples,
        constants: &constants,
    };
    let mut verdict = judge(&runs, &question, seed)?;
    if default.is_some() && question.default.is_none() {
        verdict.doubts.push(Doubt::DefaultFailed);
    }
    let failures = program.as_ref().map_or_else(Vec::new, ProgramAgents::failures);
    let described = described(model, config.model.distance, &names)?;
    // The last quarter of a run, in which the agent has learned what it will.
    let kept = config.steps.div_ceil(4).min(MOST_TOLD_STEPS);
    let span = config.run_length();
    let last = trajectory(model, acting, verdict.chosen, span, kept, seed, &progress)?;
    let rows = recorded_rows(&last, model, config.start);
    let conduct = (!last.run.diverged).then(|| conduct(&last, &rows, &names, &described, config));
    if let Some(program) = program
        && let Err(reason) = program.finish()
    {
        // A process that fails at its end may have given wrong answers before.
        units.remove()?;
        return Err(reason);
    }
    // All three need the probabilities of an agent's actions, which a program does not report.
    let OffPolicyValues { fitted_q, importance, doubly_robust } =
        off_policy_values(decisions, &observed, own, config.steps, config.timeout, &progress)?;
    let evaluation = ControlEvaluation {
        log: described,
        log_warnings,
        decision_secs: period.as_secs(),
        mean_reward: decisions.mean_reward(),
        held_out: Vec::new(),
        worst_return: model.worst_return(),
        fields: agents.fields(config),
        learning: learning(&runs, agents.count()),
        verdict,
        fitted_q_evaluation: fitted_q,
        importance_sampling: importance,
        doubly_robust,
        conduct,
        failures,
        candidates: agents.stored(),
    };
    let evaluation = evaluation.with_held_out(held_out, support(config));
    Ok(JudgedSettings { log: fingerprint, evaluation, runs })
}

/// The results of the settings, and of actions without an agent.
struct SweptSettings {
    runs: Vec<Run>,
    constants: Vec<ConstantReturns>,
}

impl SweptSettings {
    /// Adds the results of these runs in one kind of model.
    fn add<M: Ensemble>(
        &mut self,
        model: &M,
        ids: Vec<RunId>,
        question: &SweepInputs<'_>,
    ) -> Result<(), StepError> {
        let SweepInputs { actions, agents, budget, seed, units, monitor } = *question;
        self.runs.extend(sweep_keeping(model, agents, ids, budget.span, seed, units, monitor)?);
        if units.are_all() {
            self.constants.push(constant_returns(model, actions, budget, seed, monitor)?);
        }
        Ok(())
    }
}

/// The inputs that all kinds of models share.
struct SweepInputs<'a> {
    actions: usize,
    agents: &'a dyn ActingAgents,
    budget: RunBudget,
    seed: Seed,
    units: &'a RunFiles,
    monitor: &'a dyn Monitor,
}

/// Runs every setting and every constant action in every member of every kind of model. A share makes only its own
/// runs.
fn swept(
    config: &ControlConfig,
    opened: &TrainingModel,
    agents: &dyn ActingAgents,
    units: &RunFiles,
    printer: &Printer,
) -> Result<SweptSettings, StepError> {
    let TrainingModel { model, networks, seed } = opened;
    let (networks, seed) = (networks.as_ref(), *seed);
    let progress = printer.progress();
    let budget = RunBudget { runs: config.runs, span: config.run_length() };
    let question = SweepInputs {
        actions: model.log().levels(),
        agents,
        budget,
        seed,
        units,
        monitor: &progress,
    };
    let mut swept = SweptSettings { runs: Vec::new(), constants: Vec::new() };
    for &kind in &config.models {
        let mut ids = runs_here(kind, model.members(), config.runs, agents.count(), units);
        if !units.are_all() {
            // A share skips models in which it has no run left. Networks take the longest.
            let (kept, left) = units.split(ids);
            swept.runs.extend(kept);
            if left.is_empty() {
                continue;
            }
            ids = left;
        }
        match kind {
            ActionModelKind::Neighbors => {
                swept.add(model, ids, &question)?;
            }
            ActionModelKind::Increments => {
                let increments = Increments::new(model, config.model.coverage, &progress)?;
                let model = IncrementModel::new(model, &increments);
                swept.add(&model, ids, &question)?;
            }
            ActionModelKind::Network => {
                let members = members_of(&ids);
                if members.len() < model.members() {
                    printer.say(&share_of_networks(&members));
                }
                match NetworkModel::for_members(model, &members, seed, networks, &progress) {
                    Ok(model) => {
                        if let Some(warning) = model::unstored_networks(&model) {
                            printer.warn(&warning);
                        }
                        swept.add(&model, ids, &question)?;
                    }
                    Err(error @ ControlError::NetworkDiverged { .. })
                        if config.models.len() > 1 =>
                    {
                        printer.warn(&format!("{error}; now the other kinds of models decide"));
                    }
                    Err(error) => return Err(error.into()),
                }
            }
        }
    }
    // All runs of a failed setting count as failed. Otherwise the result would depend on the order of the threads.
    for run in &mut swept.runs {
        if agents.has_failed(run.candidate) {
            *run = run.clone().failed();
        }
    }
    Ok(swept)
}

/// Returns a line on the networks that a share needs.
fn share_of_networks(members: &[usize]) -> String {
    let names: Vec<String> = members.iter().map(usize::to_string).collect();
    let noun = if members.len() == 1 {
        "the network of ensemble member"
    } else {
        "the networks of ensemble members"
    };
    format!("this share has runs in {noun} {}", listed(&names))
}

/// Returns the mean learning curve of each setting over the runs that have one.
fn learning(runs: &[Run], candidates: usize) -> Vec<Vec<f64>> {
    (0..candidates)
        .map(|candidate: usize| -> Vec<f64> {
            let own = runs.iter().filter(|run| run.candidate == candidate);
            let curves: Vec<&[f64]> =
                own.map(|run| &run.curve[..]).filter(|curve| !curve.is_empty()).collect();
            let length = curves.first().map_or(0, |curve| curve.len());
            (0..length)
                .map(|tenth: usize| {
                    curves.iter().map(|curve| curve[tenth]).sum::<f64>() / curves.len() as f64
                })
                .collect()
        })
        .collect()
}
