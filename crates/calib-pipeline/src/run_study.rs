//! Runs a study from its log to the verdict.

use std::time::Duration;

use calib_base::{
    Context as _, StepError, bail,
    clock::Stopwatch,
    ensure,
    log::{
        context::RunContext,
        plant_of_study::PlantOfStudy,
        simulate::{PlantLogState, sentence},
        stand_in::StandInLog,
    },
    options::{BuildOptions, Device},
    outcome::{NoPlan, Outcome, StepResult, Told as _},
    output::{Announced, Printer, duration},
};
use calib_data::DataError;
use calib_model::ModelFamily;
use calib_model_steps::{model::build_model, represent, rollouts::rollout};
use calib_plant::Plant;
use calib_study::{Job, StepKind, Study};
use calib_sweep_steps::{
    agents::pretrain,
    sweep::{self, candidates::candidates_of, groups, plan::DryRunTally},
    verdict::{
        evaluation::{self, Evaluation},
        report,
    },
};

use crate::{
    each::{each_part, for_all_deployments},
    plan::Plan,
    run_disk,
    run_progress::RunProgress,
};

/// The last step of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum RunUntil {
    /// To the report, including rollouts.
    Report,
    /// To the end of the sweep, with only the steps that a choice needs.
    Choice,
}

/// Whether a study needs the step to reach `extent`.
fn is_wanted(step: StepKind, study: &Study, extent: RunUntil) -> bool {
    study.needs(step) && (step != StepKind::Rollout || extent == RunUntil::Report)
}

/// Runs one of the steps that each model has.
fn run_step(step: StepKind, job: &Job, whole: &WholeRun<'_>) -> Result<Outcome, StepError> {
    let &WholeRun { plan, progress, tally, device, talk } = whole;
    match step {
        StepKind::Represent => {
            for_all_deployments(job, talk, |job| represent::run(job, device, talk))
        }
        StepKind::BuildModel => {
            let device = device.filter(|_| job.study().model.kind.family() == ModelFamily::Network);
            let options = BuildOptions { device, ..BuildOptions::default() };
            for_all_deployments(job, talk, |job| build_model::run(job, &options, talk))
        }
        StepKind::Rollout => each_part(step, job, talk, |job| rollout::run(job, talk)),
        StepKind::Sweep => each_part(step, job, talk, |job| {
            progress.sweep(plan, job);
            sweep::run(job, tally, device, talk)
        }),
        StepKind::Simulate
        | StepKind::Prepare
        | StepKind::Pretrain
        | StepKind::Evaluate
        | StepKind::Control => bail!("{} is no step of one model", step.label()),
    }
}

/// The parts of a run that every step needs.
struct WholeRun<'a> {
    plan: &'a Plan,
    progress: &'a RunProgress<'a>,
    tally: &'a DryRunTally,
    /// The device that trains networks and agents, if they are not trained natively.
    device: Option<Device>,
    talk: &'a RunContext,
}

impl WholeRun<'_> {
    /// Begins a step under its `title`, and returns its context. A step that is up to date does not count as a stage,
    /// and reports only details.
    fn begin(&self, step: StepKind, title: &str, job: &Job) -> RunContext {
        if !self.plan.has_to_do(step, job) {
            return self.talk.in_detail();
        }
        self.progress.stage(title);
        self.talk.clone()
    }
}

/// One of the models that a study compares, or its only model.
struct Model {
    /// The name. `None` for an only model.
    name: Option<String>,
    job: Job,
    /// The reason why the model was dropped, if it was.
    left_out: Option<String>,
}

/// The results of all steps of a study.
#[derive(Debug)]
pub struct StudyRun {
    /// The verdicts. `None` in a dry run.
    pub evaluation: Option<Evaluation>,
    /// The reasons for models that are missing from them, because this build cannot train them.
    pub left_out: Vec<String>,
    outcome: Outcome,
}

impl StudyRun {
    /// Returns the outcome. A negative answer of one step is one of the whole run.
    pub fn outcome(&self) -> Outcome {
        self.outcome
    }
}

/// Runs every step that a study needs to reach `extent` and that is not done.
pub(crate) fn run(
    extent: RunUntil,
    job: &Job,
    device: Option<Device>,
    context: &RunContext,
) -> Result<StudyRun, StepError> {
    let clock = Stopwatch::start();
    let mut models = models(job)?;
    // Only the verdict is the result. Earlier steps report as remarks.
    let talk = &context.talking();
    let jobs: Vec<&Job> = models.iter().map(|model| &model.job).collect();
    // Unsupported devices are found before anything is made.
    let on_devices = jobs.iter().map(|job| sweep::on_device(device, job.study()));
    let on_devices = on_devices.collect::<Result<Vec<_>, StepError>>()?;
    let arithmetic = on_devices.iter().flatten().map(|device| device.class()).next();
    let plant = PlantOfStudy::of(job)?;
    let mut plan = Plan::of(job, &jobs, arithmetic, context)?;
    if plant.as_ref().is_some_and(|plant| is_made(plant, job)) {
        plan.simulate_first(job);
    }
    talk.say_all(&plan.lines());
    let stages = stages(&models, plant.as_ref(), extent, &plan, job);
    let progress = RunProgress::new(talk, stages, &plan, &jobs)?;
    let log = match plant {
        Some(plant) => simulate(plant, &models, job, &progress, talk)?,
        None => StudyLog::Whole,
    };
    let mut job = job.clone();
    let mut talk = talk.clone();
    match &log {
        StudyLog::Whole => {}
        StudyLog::StandIn(log) => {
            job = log.job().clone();
            models = self::models(&job)?;
            talk = log.context(&talk);
            talk.expect(StepKind::Simulate, &job, log.simulating());
        }
        StudyLog::None => return without_log(&models, &plan, &job, &talk, context),
    }
    let (job, talk) = (&job, &talk);
    groups::check(&models[0].job.before_deployment()?, talk)?;
    run_disk::require_room(job, models.iter().map(|model| &model.job), &plan, talk)?;
    let tally = DryRunTally::default();
    let whole = WholeRun { plan: &plan, progress: &progress, tally: &tally, device, talk };
    let mut outcomes = Vec::new();
    if is_pretrained(&models) {
        let talk = &whole.begin(StepKind::Pretrain, StepKind::Pretrain.label(), job);
        outcomes.push(for_all_deployments(job, talk, |job| pretrain::run(job, talk))?);
    }
    for step in StepKind::OF_MODELS {
        for model in &mut models {
            outcomes.push(model.run(step, extent, &whole)?);
        }
    }
    plan.expect(&tally.expected());
    plan.add_costs(&talk.expected());
    talk.say_all(&Vec::from_iter(tally.in_all()));
    tell(&plan, job, context)?;
    let left_out: Vec<String> = models.iter().filter_map(|model| model.left_out.clone()).collect();
    if !left_out.is_empty() {
        outcomes.push(Outcome::Negative);
    }
    let mut evaluation = None;
    if extent == RunUntil::Report {
        let judged = judge(job, &models, &left_out, &progress, talk, context)?;
        outcomes.push(judged.outcome());
        evaluation = judged.made();
        for reason in &left_out {
            context.error(reason);
        }
    }
    talk.say_all(plan.in_all().as_slice());
    say_done(clock.elapsed(), context);
    let outcome = outcomes.into_iter().find(|outcome| *outcome != Outcome::Done);
    Ok(StudyRun { evaluation, left_out, outcome: outcome.unwrap_or(Outcome::Done) })
}

/// Ends a dry run that cannot estimate the steps after the simulation.
fn without_log(
    models: &[Model],
    plan: &Plan,
    job: &Job,
    talk: &Printer,
    context: &RunContext,
) -> Result<StudyRun, StepError> {
    talk.say(&format!("then: {}", remaining(models).join(", ")));
    tell(plan, job, context)?;
    Ok(StudyRun { evaluation: None, left_out: Vec::new(), outcome: Outcome::Done })
}

/// Reports the duration of a run next to its estimate. After a long run the estimate is always shown, otherwise only in
/// verbose output.
fn say_done(took: Duration, printer: &Printer) {
    let done = format!("done in {}", duration(took));
    let Some(Announced { whole, after }) = printer.announced() else { return printer.say(&done) };
    let announced = format!("announced after {}: {}", duration(after), duration(whole));
    if took >= LONG {
        printer.say(&format!("{done}; {announced}"));
    } else {
        printer.detail(&announced);
        printer.say(&done);
    }
}

/// Duration from which a run's estimate is always shown.
const LONG: Duration = Duration::from_mins(1);

/// Whether agents are pre-trained, which happens once for all models.
fn is_pretrained(models: &[Model]) -> bool {
    models[0].job.study().needs(StepKind::Pretrain)
}

/// Returns the number of stages of a run to `extent`. Steps that are up to date do not count.
fn stages(
    models: &[Model],
    plant: Option<&PlantOfStudy>,
    extent: RunUntil,
    plan: &Plan,
    job: &Job,
) -> usize {
    let steps = models.iter().flat_map(|model| {
        StepKind::OF_MODELS.into_iter().filter(move |step| {
            is_wanted(*step, model.job.study(), extent) && plan.has_to_do(*step, &model.job)
        })
    });
    let once = [
        plant.is_some_and(|plant| is_made(plant, job)),
        is_pretrained(models) && plan.has_to_do(StepKind::Pretrain, job),
        extent == RunUntil::Report,
    ];
    steps.count() + once.into_iter().filter(|wanted| *wanted).count()
}

/// Whether the log of a simulated plant has to be made.
fn is_made(plant: &PlantOfStudy, job: &Job) -> bool {
    match plant.found {
        PlantLogState::NotSimulated => false,
        PlantLogState::Whole => job.policy().redoes(),
        PlantLogState::Unfinished | PlantLogState::Another => true,
    }
}

/// Prints the plan of a dry run as JSON, if that was requested.
fn tell(plan: &Plan, job: &Job, printer: &Printer) -> Result<(), StepError> {
    if job.policy().is_dry() && printer.is_json() { printer.json(plan) } else { Ok(()) }
}

/// Evaluates the models that were not dropped.
fn judge(
    job: &Job,
    models: &[Model],
    left_out: &[String],
    progress: &RunProgress<'_>,
    talk: &RunContext,
    context: &RunContext,
) -> Result<StepResult<Evaluation>, StepError> {
    progress.stage(StepKind::Evaluate.label());
    if talk.stands_in().is_some() {
        not_yet(StepKind::Evaluate, None, talk);
        return Ok(StepResult::Planned(NoPlan));
    }
    let remaining = models.iter().filter(|model| model.left_out.is_none());
    let all = remaining.map(|model| model.job.parts(StepKind::Evaluate.scope()));
    let all: Vec<Job> = all.collect::<Result<Vec<_>, _>>()?.into_iter().flatten().collect();
    ensure!(!all.is_empty(), "no model is left: {}", left_out.join("; "));
    match evaluation::run(job, &all, left_out, context) {
        Err(reason) if job.policy().is_dry() && reason.lacks_result() => {
            not_yet(StepKind::Evaluate, Some(&reason), context);
            Ok(StepResult::Planned(NoPlan))
        }
        judged => {
            let judged = judged?;
            judged.tell(job, context)?;
            Ok(judged)
        }
    }
}

/// Returns the models of a study. All are checked before the first step begins.
fn models(job: &Job) -> Result<Vec<Model>, StepError> {
    let several = job.model().is_none();
    job.models()?
        .into_iter()
        .map(|job| {
            let name = job.model().filter(|_| several).map(str::to_owned);
            candidates_of(job.study())?;
            Ok(Model { name, job, left_out: None })
        })
        .collect()
}

/// The log that the steps of a run read.
enum StudyLog {
    Whole,
    /// A substitute in a dry run, because the log is not simulated yet.
    StandIn(Box<StandInLog>),
    /// No log, because a dry run has no substitute for it.
    None,
}

/// Makes the log, unless it exists.
fn simulate(
    plant: PlantOfStudy,
    models: &[Model],
    job: &Job,
    progress: &RunProgress<'_>,
    talk: &RunContext,
) -> Result<StudyLog, StepError> {
    let shown = plant.directory.display().to_string();
    if plant.found == PlantLogState::NotSimulated {
        talk.say(&format!(
            "{shown} holds logs that calib did not simulate: [simulate] is not used"
        ));
    }
    if !is_made(&plant, job) {
        return Ok(StudyLog::Whole);
    }
    for model in models {
        plant.check_sensors(&model.job)?;
    }
    progress.stage(StepKind::Simulate.label());
    if job.policy().is_dry() {
        let takes = sentence(&Plant::new(plant.options.clone())?);
        talk.say(&format!("dry run: would write {takes}, to {shown}"));
        if plant.found == PlantLogState::Whole {
            return Ok(StudyLog::Whole);
        }
        return stand_in(&plant, job, talk);
    }
    let simulated = plant.make(job.policy().redoes(), talk).context("[simulate]")?;
    talk.result(&simulated.line())?;
    simulated.changes_line().map_or(Ok(()), |line| talk.result(&line))?;
    Ok(StudyLog::Whole)
}

/// Returns the log that a dry run reads in place of one that is not simulated yet.
fn stand_in(plant: &PlantOfStudy, job: &Job, talk: &RunContext) -> Result<StudyLog, StepError> {
    match StandInLog::of(&plant.options, job, talk) {
        Ok(log) => {
            talk.say("a sample of that log stands in for it in what follows");
            talk.say(&log.simulating().line());
            Ok(StudyLog::StandIn(Box::new(log)))
        }
        Err(reason) if reason.was_cancelled() || is_of_study(&reason) => Err(reason),
        Err(reason) => {
            talk.say(&format!(
                "what the other steps take can be said once the log is there: {reason}"
            ));
            Ok(StudyLog::None)
        }
    }
}

/// Whether an error comes from the study, whichever sample of its log is read.
fn is_of_study(reason: &StepError) -> bool {
    match reason.root() {
        StepError::Study(_) => true,
        StepError::Data(reason) => matches!(
            reason.as_ref(),
            DataError::Angle { .. }
                | DataError::Config { .. }
                | DataError::HeldOutWithoutTrain
                | DataError::NoSuchPattern { .. }
                | DataError::OneHot { .. }
                | DataError::Overlap { .. }
        ),
        _ => false,
    }
}

/// Returns the steps that a dry run without a log cannot estimate.
fn remaining(models: &[Model]) -> Vec<&'static str> {
    let studies: Vec<&Study> = models.iter().map(|model| model.job.study()).collect();
    report::steps(&studies).into_iter().map(StepKind::label).collect()
}

impl Model {
    /// Runs one step. If this build lacks libtorch for it, the model is dropped and the others continue.
    fn run(
        &mut self,
        step: StepKind,
        extent: RunUntil,
        whole: &WholeRun<'_>,
    ) -> Result<Outcome, StepError> {
        let WholeRun { plan, progress, .. } = *whole;
        if !is_wanted(step, self.job.study(), extent) {
            return Ok(Outcome::Done);
        }
        if self.left_out.is_some() {
            progress.skip(usize::from(plan.has_to_do(step, &self.job)));
            return Ok(Outcome::Done);
        }
        let of_model =
            self.name.as_ref().map_or_else(String::new, |name| format!(", model {name}"));
        let title = format!("{}{of_model}", step.label());
        let talk = &whole.begin(step, &title, &self.job);
        match run_step(step, &self.job, &WholeRun { talk, ..*whole }) {
            Err(reason)
                if matches!(reason.root(), StepError::Unavailable(_)) && self.name.is_some() =>
            {
                let name = self.name.as_deref().unwrap_or_default();
                let told = format!("model {name} is left out: {reason}");
                talk.warn(&told);
                self.left_out = Some(told);
                Ok(Outcome::Done)
            }
            // In a dry run, a step may lack the results that earlier steps did not write.
            Err(reason)
                if self.job.policy().is_dry()
                    && matches!(step, StepKind::Rollout | StepKind::Sweep)
                    && waits(&reason, talk) =>
            {
                // The reason may only be a property of the substitute log, so it is not shown.
                not_yet(step, talk.stands_in().is_none().then_some(&reason), talk);
                self.look_ahead(step, &WholeRun { talk, ..*whole })?;
                Ok(Outcome::Done)
            }
            other => other,
        }
    }

    /// Checks and estimates a step whose earlier steps are still to do, as far as it follows from the study and the log.
    fn look_ahead(&self, step: StepKind, whole: &WholeRun<'_>) -> Result<(), StepError> {
        let WholeRun { tally, talk, .. } = *whole;
        let parts = self.job.parts(step.scope())?;
        for part in &parts {
            if parts.len() > 1 {
                talk.heading(&part.name());
            }
            match step {
                StepKind::Rollout => rollout::before_model(part, talk)?,
                // The time of another arithmetic is not known.
                StepKind::Sweep if whole.device.is_none() => {
                    sweep::before_model(part, tally, talk)?;
                }
                _ => {}
            }
        }
        Ok(())
    }
}

/// Whether a step of a dry run waits for results that earlier steps do not write in a dry run.
fn waits(reason: &StepError, talk: &RunContext) -> bool {
    let may_be_of_stand_in =
        talk.stands_in().is_some() && !reason.was_cancelled() && !is_of_study(reason);
    reason.lacks_result() || may_be_of_stand_in
}

fn not_yet(step: StepKind, reason: Option<&StepError>, talk: &Printer) {
    let step = step.label();
    let reason = reason.map_or_else(String::new, |reason| format!(" ({reason})"));
    talk.say(&format!("dry run: {step} waits for the steps before it{reason}"));
}
