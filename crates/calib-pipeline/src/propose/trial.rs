//! Small trial models of a log, and their costs.

use calib_base::{
    Context as _, StepError,
    clock::{Stopwatch, TimeTaken},
    log::{
        context::RunContext,
        partition::{self, Parts},
    },
    options::{BuildOptions, ProposeOptions},
    output::span,
};
use calib_core::Segments;
use calib_files::TemporaryFolder;
use calib_model_steps::{
    model::{build_model, jumps, model_files::sensor_columns},
    rollouts::rollout,
};
use calib_propose::{Costs, Horizon, MOST_RUNS, ProposedModel, Size};
use calib_study::{Job, Request};
use calib_sweep::{Baselines, FittingRows};
use calib_sweep_steps::{
    sweep::{self, groups, plan::DryRunTally, simple::SimpleErrors},
    verdict::evaluate,
};

use super::{deadline::TimeLimit, given::gives, prediction::TrialPrediction};

/// Largest number of states of a trial model.
pub(super) const ROWS: usize = 20_000;
/// Largest number of trial models.
const TRIALS: usize = 6;
/// Share of the requested time for building a model, or for fitting the predictors that agents on the replayed log
/// start from.
const BUILD: f64 = 0.2;
/// Steps of the shortest runs for measuring costs.
const SHORT: usize = 150;
/// Factor from one length of runs to the next.
const LONGER: usize = 4;
/// If a sweep takes less than this share of the requested time, its runs are too short to measure the time per step.
const WORTH: f64 = 0.01;
/// Keys of trials on a part of the log. They keep the channels that the study keeps, even if these are mostly missing
/// in that part. The study drops channels by its own training range.
const KEPT_CHANNELS: &[&str] = &["preprocess.max_missing=1"];
/// Keys of such trials for a study whose model is not used.
const SMALLEST_MODEL: &[&str] =
    &["preprocess.max_missing=1", "model.members=2", "sweep.member_runs=1"];
/// The folder for measuring costs, on the ranges of the study.
const COSTS: &str = "costs";
/// The folder for comparing agents.
const COMPARED: &str = "compared";
/// How often a horizon is halved to find a step that can be scored.
const HALVED: usize = 6;

/// A cost that grows with the states of the training range, in seconds for at most [`ROWS`] states.
#[derive(Clone, Copy, Debug)]
pub(super) enum GrowingCosts {
    /// Building a model. At worst, exact search grows with the square of the states.
    Model(f64),
    /// Fitting the predictors that agents start from, for the largest number of runs on the replayed log.
    Fits(f64),
}

/// Returns the number of training states for which this cost stays within its share of `within` seconds.
pub(super) fn rows_within(within: f64, cost: GrowingCosts, rows: usize) -> usize {
    let measured = rows.min(ROWS);
    let factor = match cost {
        GrowingCosts::Model(secs) => (BUILD * within / secs.max(1e-3)).sqrt(),
        GrowingCosts::Fits(secs) => BUILD * within / secs.max(1e-3),
    };
    if measured == rows {
        rows
    } else {
        ((measured as f64 * factor) as usize).clamp(measured, rows)
    }
}

pub(super) struct MeasuredCosts {
    /// Wall-clock time.
    pub(super) time: Costs,
    /// Processor time of all threads together, if the system reports it.
    pub(super) processors: Option<Costs>,
    /// The simple predictor that agents start from, in words.
    pub(super) best: String,
}

impl MeasuredCosts {
    /// Adds the time to read the log, which all trials share.
    pub(super) fn with_reading(mut self, read: TimeTaken) -> Self {
        self.time.fixed_secs += read.secs;
        if let Some(processors) = &mut self.processors {
            processors.fixed_secs += read.processor_secs;
        }
        self
    }
}

/// The held-out states of a study.
pub(super) struct HeldOut {
    /// Unbroken pieces of states.
    pub(super) segments: Segments,
    /// Time to read the log.
    pub(super) read: TimeTaken,
}

/// The measured sweep of one length.
struct MeasuredSweep {
    agent_steps: f64,
    taken: TimeTaken,
}

/// Computes costs from the numbers of steps and times of two sweeps. All other work takes `other_secs`.
pub(super) fn costs([(less, quick), (more, slow)]: [(f64, f64); 2], other_secs: f64) -> Costs {
    // If runs cannot be longer, only an upper bound on the time per step is known.
    let agent_step_secs =
        if more > less { ((slow - quick) / (more - less)).max(1e-9) } else { slow / more };
    let begin = (quick - less * agent_step_secs).max(0.0);
    Costs { fixed_secs: other_secs + begin, agent_step_secs, replay_run_secs: 0.0 }
}

/// A model of part of the log.
struct TrialModel {
    /// Time to build it, in seconds.
    secs: f64,
    warnings: Vec<String>,
    /// The movement of its rollouts, in words.
    moves: String,
}

/// The time between states.
pub(super) struct StateSpacing {
    /// Rows from one state to the next.
    pub(super) spacing: usize,
    pub(super) why: String,
    /// The cost that limits the number of such states.
    pub(super) cost: GrowingCosts,
}

/// Measures the time to fit all predictors that one run on the replayed log needs: those that agents start from, and
/// those for comparison.
fn fitting_time(job: &Job, context: &RunContext) -> Result<TimeTaken, StepError> {
    let Parts { dataset, .. } = partition::load(job, context)?;
    let study = job.study();
    let sensors = sensor_columns(study, &dataset.normaliser, &dataset.profile)?;
    let baselines = Baselines::new(&dataset.train);
    let progress = context.progress();
    // Once for agents and once for simple predictors, each without the rows that the run replays.
    let (fitted, taken) = TimeTaken::by(|| {
        (0..2).try_for_each(|row| {
            let rows = FittingRows::AllBut(std::iter::once(row..row + 1).collect());
            baselines.simple(&sensors, study.agent.gamma, &rows, &*progress).map(drop)
        })
    });
    fitted?;
    Ok(taken)
}

/// The inputs that all trials share.
pub(super) struct Trials<'a> {
    pub(super) args: &'a ProposeOptions,
    pub(super) place: &'a TemporaryFolder,
    /// Whether the study has a model.
    pub(super) model: ProposedModel,
    pub(super) context: &'a RunContext,
    /// The time limit for comparing agents and models.
    pub(super) comparing: TimeLimit,
    /// The time limit for measuring the cost of a study.
    pub(super) measuring: TimeLimit,
}

impl Trials<'_> {
    /// Creates a job with its own folder of results, and with the keys `set` of the study changed. The log is prepared
    /// once per folder, and other results there are replaced.
    fn job(&self, text: String, folder: &str, set: &[&str]) -> Result<Job, StepError> {
        let changed = set.iter().map(|&key| key.to_owned());
        let request = Request {
            output: Some(self.place.path().join(folder)),
            set: self.args.set.iter().cloned().chain(changed).collect(),
            ..Request::new(&self.args.study)
        };
        Ok(Job::of_text(request, text)?)
    }

    /// Whether trial models decide between spacings. They do only if the study chooses by its models, which the user has
    /// to request.
    pub(super) fn choose_spacing(&self) -> bool {
        let is_open = !gives(self.args, "preprocess.subsample");
        self.model == ProposedModel::Ensemble && is_open && gives(self.args, "evaluate.rule")
    }

    /// Measures the cost of states that are `spacing` rows apart. The training range has `states` of them.
    pub(super) fn cost_of_states(
        &self,
        spacing: usize,
        states: usize,
        text: String,
    ) -> Result<GrowingCosts, StepError> {
        // A training range that fits into a trial is used whole, whatever the cost. Without time, the study uses no
        // more states than a trial.
        if states <= ROWS {
            return Ok(GrowingCosts::Fits(0.0));
        }
        let cost = self.comparing.done(|context| {
            if self.model == ProposedModel::Ensemble {
                return Ok(GrowingCosts::Model(self.built(spacing, text, context)?.secs));
            }
            let job = self.job(text, &format!("spacing-{spacing}"), KEPT_CHANNELS)?;
            let fitting = on_all_threads(fitting_time(&job, context)?);
            Ok(GrowingCosts::Fits(MOST_RUNS as f64 * fitting.secs))
        })?;
        Ok(cost.unwrap_or(GrowingCosts::Fits(f64::INFINITY)))
    }

    fn built(
        &self,
        spacing: usize,
        text: String,
        context: &RunContext,
    ) -> Result<TrialModel, StepError> {
        let job = self.job(text, &format!("spacing-{spacing}"), KEPT_CHANNELS)?;
        let clock = Stopwatch::start();
        let built = build_model::run(&job, &BuildOptions::default(), context)?;
        let built = built.made().context("a trial is no dry run")?;
        let jumps = built.manifest.members.first().and_then(|member| member.jumps.as_ref());
        Ok(TrialModel {
            secs: clock.elapsed().as_secs_f64(),
            warnings: built.warnings(),
            moves: jumps.map(jumps::line).unwrap_or_default(),
        })
    }

    /// Returns the first of `candidates` whose model has rollouts that neither circle nor replay the log, or else the
    /// one with the fewest warnings. Used for studies that choose by their models.
    pub(super) fn spacing(
        &self,
        candidates: &[usize],
        text: impl Fn(usize) -> String,
        period_secs: f64,
    ) -> Result<StateSpacing, StepError> {
        let mut best: Option<(usize, usize, String, f64)> = None;
        let mut before = None;
        for &spacing in candidates.iter().take(TRIALS) {
            let apart = span(period_secs * spacing as f64);
            let built = self.comparing.done(|context| self.built(spacing, text(spacing), context));
            let Some(TrialModel { secs, warnings, moves }) = built? else { break };
            let said = warnings.first().map_or(&moves, |first| first);
            self.context.say(&format!("states {apart} apart: {said}"));
            let why = match &before {
                None => format!("states {apart} apart; in a trial model {moves}"),
                Some(before) => {
                    format!(
                        "states {apart} apart; with {before}, trial models circle or replay the log; here {moves}"
                    )
                }
            };
            if best.as_ref().is_none_or(|(so_far, ..)| warnings.len() < *so_far) {
                best = Some((warnings.len(), spacing, why, secs));
            }
            if warnings.is_empty() {
                break;
            }
            before = Some(apart);
        }
        let Some((warnings, spacing, why, secs)) = best else {
            let spacing = candidates.first().copied().unwrap_or(1);
            let apart = span(period_secs * spacing as f64);
            return Ok(StateSpacing {
                spacing,
                why: format!(
                    "states {apart} apart; half of the time of --within was over before a model was tried"
                ),
                cost: GrowingCosts::Fits(f64::INFINITY),
            });
        };
        let why = if warnings == 0 {
            why
        } else {
            format!("{why}; no spacing that was tried is without a warning")
        };
        Ok(StateSpacing { spacing, why, cost: GrowingCosts::Model(secs) })
    }

    /// Returns the held-out states of a study, of which the log may lack some. The `horizon` is halved until some step
    /// can be scored.
    pub(super) fn held_out(
        &self,
        most_steps: usize,
        horizon: &mut Horizon,
        text: impl Fn(usize, Horizon) -> (String, Size),
    ) -> Result<HeldOut, StepError> {
        let short = short_steps(most_steps, *horizon);
        let silent = &self.context.silent();
        // Done even without time left: a study without a step that can be scored would end without a result.
        let (checked, read) = TimeTaken::by(|| {
            scorable(horizon, |horizon| {
                let job = self.job(text(short, horizon).0, COSTS, &[])?;
                groups::check(&job, silent)?;
                Ok(job)
            })
        });
        let Parts { dataset, .. } = partition::load(&checked?, silent)?;
        let held_out = dataset.held_out.context("a proposed study has a held-out period")?;
        Ok(HeldOut { segments: held_out.segments().clone(), read })
    }

    /// Returns the costs of a study, or `None` if the time is over before they are measured. `read` is the time to read
    /// its log. The `horizon` is halved until some step can be scored.
    pub(super) fn costs(
        &self,
        most_steps: usize,
        horizon: &mut Horizon,
        read: TimeTaken,
        text: impl Fn(usize, Horizon) -> (String, Size),
    ) -> Result<Option<MeasuredCosts>, StepError> {
        let short = short_steps(most_steps, *horizon);
        self.measuring.done(|context| {
            self.context.say("measuring how long a study takes");
            self.measured([short, most_steps], horizon, &text, read, context)
        })
    }

    /// Measures the costs of a study. `read` is the time to read its log. It times `short` runs, and then longer ones
    /// until they take a measurable share of `within`.
    fn measured(
        &self,
        [short, most_steps]: [usize; 2],
        horizon: &mut Horizon,
        text: &impl Fn(usize, Horizon) -> (String, Size),
        read: TimeTaken,
        context: &RunContext,
    ) -> Result<MeasuredCosts, StepError> {
        let (made, before) = TimeTaken::by(|| {
            let job = self.job(text(short, *horizon).0, COSTS, &[])?;
            self.made_before(&job, context)
        });
        made?;
        let sweep = |steps: usize, horizon: &mut Horizon| -> Result<MeasuredSweep, StepError> {
            let taken = self.sweep(steps, horizon, text, context)?;
            Ok(MeasuredSweep { agent_steps: text(steps, *horizon).1.agent_steps(), taken })
        };
        let less = sweep(short, horizon)?;
        let mut length = (LONGER * short).min(most_steps);
        let mut more = sweep(length, horizon)?;
        let is_worth =
            |more: &MeasuredSweep| more.taken.secs - less.taken.secs >= WORTH * self.args.within;
        while !is_worth(&more) && length < most_steps && !self.comparing.is_over() {
            length = (LONGER * length).min(most_steps);
            more = sweep(length, horizon)?;
        }
        let job = self.job(text(length, *horizon).0, COSTS, &[])?;
        let (judged, verdict) = TimeTaken::by(|| evaluate::run(&job, context));
        judged?;
        let fitting = match self.model {
            ProposedModel::None => on_all_threads(fitting_time(&job, context)?),
            // A model takes longer than fitting the predictors that agents start from, because its log has few rows.
            ProposedModel::Ensemble => TimeTaken::default(),
        };
        let costs = |measure: fn(TimeTaken) -> f64| {
            let swept = [&less, &more].map(|swept| (swept.agent_steps, measure(swept.taken)));
            Costs {
                replay_run_secs: measure(fitting),
                ..costs(swept, measure(read) + measure(before) + measure(verdict))
            }
        };
        let has_processors = [read, before, more.taken].iter().any(|one| one.processor_secs > 0.0);
        Ok(MeasuredCosts {
            best: SimpleErrors::read(&job.layout().sweep())?.best_told(),
            time: costs(|taken| taken.secs),
            processors: has_processors.then(|| costs(|taken| taken.processor_secs)),
        })
    }

    /// Makes everything that a study needs before its sweep: states of the log, and its model with rollouts, if it has
    /// one.
    fn made_before(&self, job: &Job, context: &RunContext) -> Result<(), StepError> {
        match self.model {
            ProposedModel::None => partition::load(job, context).map(drop),
            ProposedModel::Ensemble => {
                build_model::run(job, &BuildOptions::default(), context)?;
                rollout::run(job, context).map(drop)
            }
        }
    }

    /// Compares an agent with the simple predictors within the training range. The `horizon` is halved until some step
    /// can be scored. Returns `None` if the time of `limit` is over before.
    pub(super) fn compare(
        &self,
        limit: &TimeLimit,
        horizon: &mut Horizon,
        text: impl Fn(Horizon) -> String,
    ) -> Result<Option<Vec<TrialPrediction>>, StepError> {
        limit.done(|context| self.compared(horizon, text, context))
    }

    fn compared(
        &self,
        horizon: &mut Horizon,
        text: impl Fn(Horizon) -> String,
        context: &RunContext,
    ) -> Result<Vec<TrialPrediction>, StepError> {
        let set = match self.model {
            ProposedModel::None => KEPT_CHANNELS,
            ProposedModel::Ensemble => SMALLEST_MODEL,
        };
        let study = |horizon: Horizon| self.job(text(horizon), COMPARED, set);
        if self.model == ProposedModel::Ensemble {
            build_model::run(&study(*horizon)?, &BuildOptions::default(), context)?;
        }
        scorable(horizon, |horizon| {
            sweep::run(&study(horizon)?, &DryRunTally::default(), None, context)
        })?;
        let judged = evaluate::judge(&study(*horizon)?, context, &*context.progress())?;
        Ok(judged.summary.verdicts.iter().map(TrialPrediction::of).collect())
    }

    fn sweep(
        &self,
        steps: usize,
        horizon: &mut Horizon,
        text: &impl Fn(usize, Horizon) -> (String, Size),
        context: &RunContext,
    ) -> Result<TimeTaken, StepError> {
        scorable(horizon, |horizon| {
            let job = self.job(text(steps, horizon).0, COSTS, &[])?;
            let (swept, taken) =
                TimeTaken::by(|| sweep::run(&job, &DryRunTally::default(), None, context));
            swept.map(|_| taken)
        })
    }
}

/// Returns the number of steps of the shortest runs of a study with runs of at most `most_steps` steps.
fn short_steps(most_steps: usize, horizon: Horizon) -> usize {
    most_steps.min(SHORT.max(2 * horizon.states as usize))
}

/// Converts the time of one thread to the wall-clock time if the work is divided evenly between all threads.
fn on_all_threads(taken: TimeTaken) -> TimeTaken {
    // On a busy machine the wall clock also counts other work.
    let secs = taken.secs.max(taken.processor_secs) / rayon::current_num_threads() as f64;
    TimeTaken { secs, ..taken }
}

/// Returns the result of `sweep` at a horizon that is halved until some step can be scored.
fn scorable<T>(
    horizon: &mut Horizon,
    sweep: impl Fn(Horizon) -> Result<T, StepError>,
) -> Result<T, StepError> {
    for _ in 0..HALVED {
        match sweep(*horizon) {
            Err(reason)
                if matches!(reason.root(), StepError::Unscorable(_)) && horizon.states > 2.0 =>
            {
                *horizon = halved(*horizon);
            }
            swept => return swept,
        }
    }
    Err(StepError::Unscorable(
        "no horizon was found at which held-out data can be scored: its unbroken pieces are too short".to_owned(),
    ))
}

/// Returns half the horizon.
pub(super) fn halved(horizon: Horizon) -> Horizon {
    Horizon::new(horizon.secs / 2.0, horizon.secs / horizon.states)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_model_that_would_take_too_long_learns_from_less() {
        use GrowingCosts::{Fits, Model};
        assert_eq!(rows_within(600.0, Model(3.0), 15_000), 15_000, "it was measured whole");
        assert_eq!(
            rows_within(600.0, Model(30.0), 1_000_000),
            40_000,
            "twice the rows, four times as long"
        );
        assert_eq!(rows_within(600.0, Model(1.0), 50_000), 50_000);
        assert_eq!(rows_within(10.0, Model(30.0), 1_000_000), ROWS, "what was tried is there");
        assert_eq!(rows_within(600.0, Fits(30.0), 1_000_000), 80_000, "in proportion");
        assert_eq!(rows_within(600.0, Fits(0.0), 1_000_000), 1_000_000);
        assert_eq!(rows_within(600.0, Fits(f64::INFINITY), 1_000_000), ROWS, "no time to measure");
    }

    #[test]
    fn what_does_not_grow_with_the_steps_is_told_from_what_does() {
        let told = costs([(1_000.0, 3.0), (5_000.0, 7.0)], 10.0);
        assert_eq!(told, Costs { fixed_secs: 12.0, agent_step_secs: 1e-3, replay_run_secs: 0.0 });
        let short = costs([(1_000.0, 3.0), (1_000.0, 2.0)], 10.0);
        assert_eq!((short.fixed_secs, short.agent_step_secs), (11.0, 2e-3), "no longer runs");
        let noisy = costs([(1_000.0, 3.0), (5_000.0, 2.0)], 0.0);
        assert!(noisy.agent_step_secs > 0.0 && noisy.fixed_secs > 2.9, "{noisy:?}");
    }

    #[test]
    fn the_workplace_leaves_nothing() {
        let place = TemporaryFolder::new().expect("a folder");
        let folder = place.path().to_owned();
        assert!(folder.is_dir());
        drop(place);
        assert!(!folder.exists());
    }
}
