//! The held-out periods of a study of agents that act. Nothing is trained on them.

use calib_base::{Context as _, StepError, artefact, memory, output::Printer};
use calib_control::{ActionModel, ControlConfig, ControlError, DecisionRows, Distance, Ending};
use calib_data::DataConfig;
use calib_files::ScratchPlace;
use calib_model_steps::represent::decisions;
use calib_study::Job;

use super::{
    counting,
    evaluation::ControlEvaluation,
    files,
    held_out_period::{HeldOutLog, HeldOutPeriod, period_name},
    log::{self, ActionLog},
    model, page,
    section::support,
};

/// Reads the held-out periods of a study, in the order of time. A share of a sweep judges nothing, and has none. The training
/// range must have been read before.
///
/// # Errors
/// Returns an error if the log has no rows of a period that the study names, or no decision in it.
pub(super) fn read(
    job: &Job,
    config: &ControlConfig,
    printer: &Printer,
) -> Result<Vec<HeldOutLog>, StepError> {
    if job.policy().share.is_some() {
        return Ok(Vec::new());
    }
    let study = job.study();
    let data = log::data_of_states(job, config)?;
    let mut periods = Vec::new();
    for name in study.deployment_names() {
        let data = DataConfig { held_out: study.deployments.get(&name).cloned(), ..data.clone() };
        let read = read_period(job, config, data, Some(name.clone()), printer);
        periods.extend(read.with_context(|| format!("[deployments.{name}]"))?);
    }
    if periods.is_empty() && data.holds_out() {
        periods.extend(read_period(job, config, data, None, printer)?);
    }
    Ok(periods)
}

/// Reads the held-out period of `data`. Returns `None` if it holds nothing out, or if the period is only the rest after the
/// training range and has no decision. Nobody asked for that one.
fn read_period(
    job: &Job,
    config: &ControlConfig,
    data: DataConfig,
    deployment: Option<String>,
    printer: &Printer,
) -> Result<Option<HeldOutLog>, StepError> {
    memory::check_log(&data)?;
    let is_named = deployment.is_some() || data.held_out.is_some();
    printer.say(&format!("reading the {}", period_name(deployment.as_deref())));
    let progress = printer.progress();
    // The warnings about the log came with the training range.
    let surveyed = counting::survey(data, &job.study().preprocess, &printer.silent(), &progress)?;
    let recorded = surveyed.recorded_held_out(&config.columns(), &progress)?;
    log::require_memory(&surveyed)?;
    let dataset = surveyed.load(&ScratchPlace::Memory, &progress)?;
    let (Some(frames), Some(states)) = (dataset.held_out, dataset.held_out_fingerprint) else {
        return Ok(None);
    };
    let rows = DecisionRows::new(config, recorded.values, frames.segments());
    let found = rows.and_then(|rows| rows.with_one_action(frames.states()));
    if !is_named && found.as_ref().is_err_and(is_of_no_decision) {
        printer.warn(
            "the period after data.train_fraction has no decision to judge, so it is left out: name another one with data.train and data.held_out, \
             or hold nothing out with data.train_fraction = 1.0",
        );
        return Ok(None);
    }
    let decisions = found.context(
        "the held-out period has no decision to judge; move it (data.held_out, data.train_fraction or [deployments]), or leave it out",
    )?;
    let rewards = decisions.rewards().iter().copied().map(f64::from);
    let endings = decisions.endings().iter().map(|&ending| match ending {
        Ending::Terminal => 1.0,
        Ending::Continues => 0.0,
    });
    let sources = decisions.transitions().sources().iter().copied().map(f64::from);
    let numbers = rewards.chain(endings).chain(sources);
    let fingerprint = log::with_numbers(&states, b"held out 1", numbers);
    Ok(Some(HeldOutLog { deployment, decisions, fingerprint }))
}

/// Whether an error says that a log has no decision.
fn is_of_no_decision(error: &ControlError) -> bool {
    matches!(
        error,
        ControlError::NoTransitions
            | ControlError::OnlyTerminals
            | ControlError::NoDecisions { .. }
    )
}

/// Compares held-out periods with the log of `model`, which is the model of `log`.
///
/// # Errors
/// Returns an error if the representation of the model is missing and cannot be trained, or the observer asks to stop.
pub(super) fn judged(
    job: &Job,
    config: &ControlConfig,
    log: &ActionLog,
    model: &ActionModel,
    periods: &[HeldOutLog],
    printer: &Printer,
) -> Result<Vec<HeldOutPeriod>, StepError> {
    let mut judged = Vec::new();
    for HeldOutLog { deployment, decisions: recorded, fingerprint } in periods {
        let states = recorded.source_states()?;
        let metric = match config.model.distance {
            Distance::Euclidean => states,
            Distance::Laplacian => decisions::encode_others(job, log.material(), &states, printer)?,
        };
        judged.push(HeldOutPeriod {
            deployment: deployment.clone(),
            log: fingerprint.clone(),
            decisions: recorded.len(),
            uncovered: model.uncovered_share(&metric, &printer.progress())?,
            behaviour: recorded.recorded_return(config.timeout.min(config.steps))?,
            mean_reward: recorded.mean_reward(),
        });
    }
    Ok(judged)
}

/// Judges the held-out periods of a finished verdict again. No agent depends on them, so the runs stay.
///
/// # Errors
/// As [`judged`], or if the verdict cannot be written.
pub(super) fn judged_again(
    job: &Job,
    config: &ControlConfig,
    log: &ActionLog,
    evaluation: ControlEvaluation,
    held_out: &[HeldOutLog],
    printer: &Printer,
) -> Result<ControlEvaluation, StepError> {
    printer.say("only the held-out periods have changed: no agent is trained again");
    let model = model::open_or_build(job, config, log, printer)?;
    let periods = judged(job, config, log, &model, held_out, printer)?;
    let evaluation = evaluation.with_held_out(periods, support(config));
    let directory = &job.layout().control();
    let written = files::replace(directory, job.study(), &evaluation, || {
        page::write(directory, job, &evaluation)
    });
    artefact::or_read_only(written, directory, printer)?;
    Ok(evaluation)
}
