//! The held-out periods of a study of agents that act. Nothing is trained on them.

use calib_base::{Context as _, StepError, artefact, bail, memory, output::Printer};
use calib_control::{ActionModel, ControlConfig, ControlError, DecisionRows, Distance, Ending};
use calib_data::{DataConfig, Dataset, entry_of};
use calib_files::ScratchPlace;
use calib_model_steps::represent::decisions;
use calib_study::Job;

use super::{
    evaluation::ControlEvaluation,
    files::{self, KeptVerdict},
    held_out_period::{HeldOutLog, HeldOutPeriod, HeldOutRows, period_name},
    log::{self, ActionLog},
    model, page,
    section::support,
};

/// Reads the held-out periods of a study, in the order of time. A share of a sweep judges nothing, and has none. `log`
/// is the training range, and `rest` are the rows after it that nobody named.
///
/// # Errors
/// Returns an error if the log has no rows of a period that the study names, no decision in it, or other state columns
/// than the training range.
pub(super) fn read(
    job: &Job,
    config: &ControlConfig,
    log: &ActionLog,
    rest: Option<HeldOutRows>,
    printer: &Printer,
) -> Result<Vec<HeldOutLog>, StepError> {
    if job.policy().share.is_some() {
        return Ok(Vec::new());
    }
    if let Some(rest) = rest {
        return Ok(decisions_of_rest(config, rest, printer)?.into_iter().collect());
    }
    let study = job.study();
    let data = log::data_of_states(job, config)?;
    let mut periods = Vec::new();
    for name in study.deployment_names() {
        let data = DataConfig { held_out: study.deployments.get(&name).cloned(), ..data.clone() };
        let period = read_period(job, config, log, data, Some(&name), printer);
        periods.push(period.with_context(|| format!("[deployments.{name}]"))?);
    }
    if periods.is_empty() && data.held_out.is_some() {
        periods.push(read_period(job, config, log, data, None, printer)?);
    }
    Ok(periods)
}

/// Reads the periods as [`read`] does, if the kept verdict may be on others. Returns `None` if it is on the periods of
/// the study.
///
/// # Errors
/// As [`read`].
pub(super) fn read_others(
    job: &Job,
    config: &ControlConfig,
    log: &ActionLog,
    rest: Option<HeldOutRows>,
    kept: &KeptVerdict,
    printer: &Printer,
) -> Result<Option<Vec<HeldOutLog>>, StepError> {
    if kept.is_current || job.policy().share.is_some() {
        return Ok(None);
    }
    let periods = read(job, config, log, rest, printer)?;
    Ok((!kept.evaluation.is_on(&periods)).then_some(periods))
}

/// Reads the held-out period of `data`, which names one.
fn read_period(
    job: &Job,
    config: &ControlConfig,
    log: &ActionLog,
    data: DataConfig,
    deployment: Option<&str>,
    printer: &Printer,
) -> Result<HeldOutLog, StepError> {
    memory::check_log(&data)?;
    let period = period_name(deployment);
    printer.say(&format!("reading the {period}"));
    let progress = printer.progress();
    // With the rows of the period, more columns might look like sensors. The entries are names, not patterns.
    let include = log.sensors.iter().map(|name| entry_of(name, |_| false)).collect();
    let data = DataConfig { include, ..data };
    let surveyed = calib_data::survey(&data, &job.study().preprocess, &progress)?;
    let recorded = surveyed.recorded(&config.columns(), &progress)?.held_out;
    log::require_memory(&surveyed)?;
    let dataset = surveyed.load(&ScratchPlace::Memory, &progress)?;
    require_columns(&dataset, log, &period)?;
    let rows = dataset.held_out.zip(dataset.held_out_fingerprint);
    let (frames, states) = rows.with_context(|| format!("the log has no row of the {period}"))?;
    let rows = HeldOutRows { frames, states, recorded };
    decisions_of(config, rows, deployment).map_err(|error| {
        let context = if is_of_no_decision(&error) {
            format!(
                "the {period} has no decision to judge; move it (data.held_out or [deployments]), or leave it out"
            )
        } else {
            format!("the {period} cannot be compared with the training range")
        };
        StepError::InContext { context, source: Box::new(error.into()) }
    })
}

/// Checks that the states of `dataset`, which were read with a held-out period, have the columns of the training range.
fn require_columns(dataset: &Dataset, log: &ActionLog, period: &str) -> Result<(), StepError> {
    let columns = dataset.normaliser.columns();
    let found = columns.iter().map(|column| (&column.name, &column.bounds));
    let expected = log.names.columns.iter().zip(&log.names.bounds);
    if found.clone().eq(expected.clone()) {
        return Ok(());
    }
    let lost = expected.clone().find(|own| found.clone().all(|other| other != *own));
    let further = found.clone().find(|own| expected.clone().all(|other| other != *own));
    let Some((name, _)) = lost.or(further) else {
        bail!(
            "the {period} has the state columns of the training range in another order; write the columns of its files in the same order"
        );
    };
    let channel = dataset.profile.channels.iter().find(|channel| channel.name == *name);
    let reason = channel.and_then(|channel| channel.dropped.as_ref());
    let reason = reason.map_or_else(|| "of other values".to_owned(), ToString::to_string);
    Err(StepError::message(format!(
        "{name} is not the same state column when the {period} is read with the training range: it is then {reason}. Write its values in the \
         same way in the whole log, or leave it out with data.exclude = [{name:?}], which trains the agents again"
    )))
}

/// Returns the decisions of the rows after `data.train_fraction`; `None` if they have none, because nobody asked for
/// them.
fn decisions_of_rest(
    config: &ControlConfig,
    rest: HeldOutRows,
    printer: &Printer,
) -> Result<Option<HeldOutLog>, StepError> {
    match decisions_of(config, rest, None) {
        Err(error) if is_of_no_decision(&error) => {
            printer.warn(
                "the period after data.train_fraction has no decision to judge, so it is left out: name another one with data.train and \
                 data.held_out, or hold nothing out with data.train_fraction = 1.0",
            );
            Ok(None)
        }
        found => found.map(Some).context(
            "the period after data.train_fraction cannot be compared with the training range; data.train_fraction = 1.0 holds nothing out",
        ),
    }
}

/// Returns the decisions in the rows of a period.
fn decisions_of(
    config: &ControlConfig,
    period: HeldOutRows,
    deployment: Option<&str>,
) -> Result<HeldOutLog, ControlError> {
    let HeldOutRows { frames, states, recorded } = period;
    let rows = DecisionRows::new(config, recorded, frames.segments())?;
    let decisions = rows.with_one_action(frames.states())?;
    let rewards = decisions.rewards().iter().copied().map(f64::from);
    let endings = decisions.endings().iter().map(|&ending| match ending {
        Ending::Terminal => 1.0,
        Ending::Continues => 0.0,
    });
    let sources = decisions.transitions().sources().iter().copied().map(f64::from);
    let numbers = rewards.chain(endings).chain(sources);
    let fingerprint = log::with_numbers(&states, b"held out 1", numbers);
    Ok(HeldOutLog { deployment: deployment.map(str::to_owned), decisions, fingerprint })
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
        let period = HeldOutPeriod {
            deployment: deployment.clone(),
            log: fingerprint.clone(),
            decisions: recorded.len(),
            uncovered: model.uncovered_share(&metric, &printer.progress())?,
            behaviour: recorded.recorded_return(config.longest_episode())?,
            mean_reward: recorded.mean_reward(),
        };
        if let Some(warning) = period.warning() {
            printer.warn(&warning);
        }
        judged.push(period);
    }
    Ok(judged)
}

/// What a command says if the held-out periods of a kept verdict are others.
pub(super) const ONLY_HELD_OUT: &str = "only the held-out periods have changed";

/// Brings a kept verdict up to date: judges the held-out periods again if there are others, takes over the warnings about
/// the log if these are others, and writes the report again if files are damaged. No agent depends on either, so the runs
/// stay.
///
/// # Errors
/// As [`judged`], or if the verdict cannot be written.
pub(super) fn brought_up_to_date(
    job: &Job,
    config: &ControlConfig,
    log: &ActionLog,
    kept: KeptVerdict,
    others: Option<Vec<HeldOutLog>>,
    printer: &Printer,
) -> Result<ControlEvaluation, StepError> {
    let KeptVerdict { mut evaluation, is_listed, .. } = kept;
    // For example, an entry of data.exclude that matches no column changes no state.
    let log_warnings = log.warnings(config);
    if is_listed && others.is_none() && evaluation.log_warnings == log_warnings {
        return Ok(evaluation);
    }
    evaluation = evaluation.with_log_warnings(log_warnings);
    if let Some(others) = others {
        printer.say(&format!("{ONLY_HELD_OUT}: no agent is trained again"));
        let model = model::open_or_build(job, config, log, printer)?;
        let periods = judged(job, config, log, &model, &others, printer)?;
        evaluation = evaluation.with_held_out(periods, support(config));
    }
    let directory = &job.layout().control();
    let written = files::replace(directory, job.study(), &evaluation, || {
        page::write(directory, job, &evaluation)
    });
    artefact::or_read_only(written, directory, printer)?;
    Ok(evaluation)
}
