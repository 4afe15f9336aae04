use std::collections::BTreeMap;

use calib_base::{
    Context as _, StepError, ensure,
    log::plant_of_study::data_of,
    memory::{self, NoRoom},
    output::{Printer, count, counted, number},
};
use calib_control::{
    ActionModel, ColumnFindings, Columns, ControlConfig, ControlError, DecisionRows, Decisions,
    Ending, Levels, OutlyingActions, RewardRow, Settings, StartRows, Starts, Term,
};
use calib_core::{Bounds, Column, ColumnKind, Period, RowIndex, States};
use calib_data::{
    DataConfig, DataError, Dataset, Resample, Sentinel, ShownClock, Surveyed, TextFound, entry_of,
};
use calib_files::{Fingerprint, Fingerprinter, ScratchPlace};
use calib_model_steps::represent::Material;
use calib_stats::SortedValues;
use calib_study::Job;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    counting,
    held_out_period::HeldOutRows,
    log_warnings::{
        LogWarnings, RowTimes, changed_decisions, codes_beside_states, constant_reward,
        decisions_line, doubts, missing_rewards, odd_columns,
    },
    rare,
    reward_words::rewarded_deviations,
};

/// A log of decisions, read from the files of a study.
pub(crate) struct ActionLog {
    pub(crate) decisions: Decisions,
    pub(crate) names: Names,
    /// Fingerprint of all inputs of the model.
    pub(super) fingerprint: Fingerprint,
    /// Time of every row of the decisions, in microseconds.
    pub(super) times: Vec<i64>,
    /// Time from one decision to the next.
    pub(crate) period: Period,
    /// Sentences on outlying action values that count as missing.
    pub(crate) outlying: Vec<String>,
    /// Warnings that were printed when the log was read, those of `outlying` among them.
    given: Vec<String>,
    /// Warnings that `calib inspect` reports in its own words.
    doubts: Vec<String>,
    /// The warning about numbers that may stand for a missing value in the columns beside the state, alone as `calib inspect` gives it.
    codes_beside: Option<String>,
    /// The state columns that are channels of the log, and no features.
    pub(super) sensors: Vec<String>,
}

/// A continuous action column in the log.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub(super) struct SettingTold {
    pub(super) column: String,
    /// Quantiles of the recorded values: minimum, 5 %, 50 %, 95 % and maximum.
    pub(super) quantiles: [f64; 5],
}

/// Names and units.
pub(crate) struct Names {
    /// Names of the actions.
    pub(crate) actions: Vec<String>,
    /// The recorded values of continuous actions.
    pub(super) settings: Vec<SettingTold>,
    /// State columns.
    pub(crate) columns: Vec<String>,
    pub(super) bounds: Vec<Bounds>,
    /// The values that each action sets, `[levels][action columns]`.
    pub(super) levels: Vec<Vec<f64>>,
    /// Smallest and largest recorded value of each action column.
    pub(super) ranges: Vec<[f64; 2]>,
    /// Columns of `[control]` that have one value in the whole log, with this value. They are not part of the state.
    pub(super) constants: BTreeMap<String, f64>,
    /// Set-points of the reward that are neither state columns nor actions, `[rows]`; NaN where they are missing.
    pub(super) set_points: BTreeMap<String, Vec<f64>>,
}

impl Names {
    /// Converts a value of a state column to the unit of the log.
    pub(super) fn physical(&self, column: usize, value: f64) -> f64 {
        let Bounds { offset, scale } = self.bounds[column];
        value * scale + offset
    }
}

/// Reads the training range of the study's log with its actions, rewards and terminals.
pub(crate) fn read(
    job: &Job,
    config: &ControlConfig,
    printer: &Printer,
) -> Result<ActionLog, StepError> {
    read_with_rest(job, config, printer).map(|(log, _)| log)
}

/// Reads the training range as [`read`] does. The second value has the rows after `data.train_fraction`, if that key
/// ends the training range and the study names no held-out period.
pub(super) fn read_with_rest(
    job: &Job,
    config: &ControlConfig,
    printer: &Printer,
) -> Result<(ActionLog, Option<HeldOutRows>), StepError> {
    let study = job.study();
    let data = DataConfig { held_out: None, ..data_of_states(job, config)? };
    ensure!(
        !matches!(data.resample, Some(Resample::Mean | Resample::Linear)),
        "data.resample makes actions of what was set before and after, which nobody took; set data.resample = \"last\""
    );
    memory::check_log(&data)?;
    printer.say(&format!("reading {}", data.path.0.join(", ")));
    let progress = printer.progress();
    let resample = data.resample;
    let mut warnings = LogWarnings::new(printer);
    let surveyed = counting::survey(data, &study.preprocess, &mut warnings, &progress)?;
    let names = config.columns();
    let mut recorded =
        surveyed.recorded(&names, &progress).map_err(|error| named(config, error))?;
    refuse_empty(config, &names, &recorded.values)?;
    require_memory(&surveyed)?;
    let dataset = surveyed.load(&ScratchPlace::Memory, &progress)?;
    let frames = &dataset.train;
    let clock = ShownClock::of(&study.data, dataset.profile.utc);
    let times = RowTimes::new(&clock, frames.timestamps());
    warnings.give(texts_among_numbers(config, &recorded.texts));
    let found = ColumnFindings::new(config, &recorded.values, frames.segments());
    warnings.give(odd_columns(config, resample, times, &found));
    let outlying = without_outlying(config, times, &mut recorded.values);
    warnings.give(outlying.iter().cloned());
    let codes_beside = codes_beside_states(config, &recorded.values);
    let constants = constants(&names, &recorded.values);
    let set_points = set_points(config, &names, &recorded.values);
    let rows = DecisionRows::new(config, recorded.values, frames.segments())?;
    warnings.give(rewarded_deviations(&config.reward));
    warnings.give(missing_rewards(config, times, &rows).into_iter().chain(constant_reward(&rows)));
    let period = decision_period(config, dataset.period);
    if let Some(line) = decisions_line(config, &rows, period) {
        printer.say(&line);
    }
    warnings.give(changed_decisions(times, &rows));
    let (levels, settings) = levels_of(&rows.acted, config)?;
    let (decisions, fingerprint) = decided(config, &dataset, &rows, &levels, settings)
        .map_err(|error| of_probability(config, times, &rows, error))?;
    let actions =
        (0..levels.values.len()).map(|level| levels.name(level, &config.actions)).collect();
    let columns = dataset.normaliser.columns();
    let set_points = beside_states(set_points, columns, &rows.rows);
    let names = Names {
        actions,
        settings: settings_told(config, &rows.acted)?,
        columns: columns.iter().map(|column| column.name.clone()).collect(),
        bounds: columns.iter().map(|column| column.bounds).collect(),
        levels: levels.values,
        ranges: rows.acted.iter().map(|values| range(values)).collect(),
        constants,
        set_points,
    };
    let doubts = doubts(&dataset.profile, &codes_beside, resample, times, &found.gaps);
    let times = rows.rows.iter().map(|&row| frames.timestamps()[row].as_micros()).collect();
    let sensors = columns.iter().filter(|column| column.kind == ColumnKind::Sensor);
    let sensors = sensors.map(|column| column.name.clone()).collect();
    let log = ActionLog {
        decisions,
        names,
        fingerprint,
        times,
        period,
        outlying,
        given: warnings.into_given(),
        doubts,
        codes_beside: Sentinel::doubt(&codes_beside),
        sensors,
    };
    let rest = dataset.held_out.zip(dataset.held_out_fingerprint);
    let recorded = recorded.held_out;
    Ok((log, rest.map(|(frames, states)| HeldOutRows { frames, states, recorded })))
}

/// Returns the decisions of these rows, and the fingerprint of all inputs of a model of them.
fn decided(
    config: &ControlConfig,
    dataset: &Dataset,
    rows: &DecisionRows,
    levels: &Levels,
    settings: Option<Settings>,
) -> Result<(Decisions, Fingerprint), ControlError> {
    let columns =
        Columns { actions: &levels.of_rows, rewards: &rows.rewards, endings: &rows.endings };
    let states = rows.states(dataset.train.states())?;
    let mut decisions = Decisions::new(states, &rows.segments, columns, levels.values.len())?;
    let mut fingerprint = fingerprint(&dataset.fingerprint, levels, &rows.rewards, &rows.endings);
    if config.every > 1 || config.reward_row == RewardRow::Same {
        let numbers = rows.rows.iter().map(|&row| row as f64);
        fingerprint = with_numbers(&fingerprint, b"rows 1", numbers);
    }
    if let Some(settings) = settings {
        decisions = decisions.with_settings(settings)?;
        let numbers = rows.acted.iter().flatten().copied();
        fingerprint = with_numbers(&fingerprint, b"settings 1", numbers);
    }
    if let Some(probabilities) = &rows.probabilities {
        decisions = decisions.with_probabilities(probabilities)?;
        let own = decisions.probabilities().unwrap_or_default().iter().copied();
        fingerprint = with_numbers(&fingerprint, b"probabilities 1", own);
    }
    Ok((decisions, fingerprint))
}

/// Returns the log files of a study without the columns that are no part of the state.
pub(super) fn data_of_states(job: &Job, config: &ControlConfig) -> Result<DataConfig, StepError> {
    let mut data = data_of(job)?;
    // The entries are names, and must not be read as patterns.
    data.exclude.extend(config.beside_the_state().iter().map(|name| entry_of(name, |_| false)));
    Ok(data)
}

/// Returns the time from one decision to the next, if no terminal comes before.
fn decision_period(config: &ControlConfig, period: Period) -> Period {
    let micros = period.as_micros().saturating_mul(config.every as i64);
    Period::from_micros(micros).unwrap_or(period)
}

/// Adds the time to an error about a probability.
fn of_probability(
    config: &ControlConfig,
    times: RowTimes<'_>,
    rows: &DecisionRows,
    error: ControlError,
) -> StepError {
    match error {
        ControlError::NoProbability { row, got } => StepError::message(format!(
            "control.probability = \"{}\": at {} the probability of the action that was taken is {got}, expected above 0, up to 1",
            config.probability.as_deref().unwrap_or_default(),
            times.shown(rows.rows[row])
        )),
        error => error.into(),
    }
}

/// Returns the actions that agents choose from, and the recorded values of continuous ones.
fn levels_of(
    acted: &[Vec<f64>],
    config: &ControlConfig,
) -> Result<(Levels, Option<Settings>), ControlError> {
    let Some(levels) = config.levels else {
        return Ok((Levels::new(acted, config.most_actions)?, None));
    };
    let (levels, settings) = Levels::of_range(acted, levels, config.most_actions)?;
    Ok((levels, Some(settings)))
}

/// Returns warnings about columns that hold text, such as the mode of a controller instead of its output.
fn texts_among_numbers(config: &ControlConfig, texts: &[TextFound]) -> Vec<String> {
    let told = texts.iter().map(|TextFound { column, example, rows }| {
        format!(
            "{column} (control.{}) holds text in {} of the log, such as {example:?}: text counts as missing. Write it as a number in the log \
             if it is a value",
            config.key_of(column),
            counted(*rows as usize, "row")
        )
    });
    told.collect()
}

/// Marks outlying values of continuous actions as missing, and returns warnings about them. Levels up to such values
/// would be actions that were never taken. The action columns are the first of `recorded`.
fn without_outlying(
    config: &ControlConfig,
    times: RowTimes<'_>,
    recorded: &mut [Vec<f64>],
) -> Vec<String> {
    let Some(levels) = config.levels else { return Vec::new() };
    let columns = config.actions.iter().zip(recorded);
    let told = columns.filter_map(|(name, values)| {
        let found = OutlyingActions::of_column(values, levels)?;
        let told = outlying_told(name, &found, &times.shown(found.rows[0]));
        found.rows.iter().for_each(|&row| values[row] = f64::NAN);
        Some(told)
    });
    told.collect()
}

/// Returns the warning about outlying values of a column. The first is at time `at`.
fn outlying_told(name: &str, found: &OutlyingActions, at: &str) -> String {
    let OutlyingActions { rows, range: [least, largest], others: [low, high] } = found;
    let [low, high] = [*low, *high].map(number);
    let values = match rows.len() {
        1 => format!("{least} at {at} stands"),
        many if least == largest => {
            format!("{least} in {} rows, first at {at}, stands", count(many))
        }
        many if number(*least) == number(*largest) => {
            // The values look the same with three digits.
            format!("{} from {least} to {largest}, first at {at}, stand", counted(many, "value"))
        }
        many => format!(
            "{} from {} to {}, first at {at}, stand",
            counted(many, "value"),
            number(*least),
            number(*largest)
        ),
    };
    let remedy = match rows.len() {
        _ if !(least.is_finite() && largest.is_finite()) => String::new(),
        _ if least == largest => format!(" or add {least} to data.missing_values"),
        2 => format!(" or add {least} and {largest} to data.missing_values"),
        _ => " or add the values to data.missing_values".to_owned(),
    };
    format!(
        "{name} (control.actions): {values} out from all others, which lie from {low} to {high}. calib takes that for missing, because levels \
         (control.levels) that reach as far would be actions that were never taken. If it is a mistake of the log, correct it there{remedy}; if not, \
         round the column to the values that agents are to choose among, and leave control.levels out"
    )
}

/// Returns the columns whose values are all equal, with this value.
fn constants(names: &[String], recorded: &[Vec<f64>]) -> BTreeMap<String, f64> {
    let ranges = names.iter().zip(recorded.iter().map(|values| range(values)));
    ranges
        .filter(|(_, [low, high])| low == high)
        .map(|(name, [low, _])| (name.clone(), low))
        .collect()
}

/// Returns the recorded set-points of the reward that are columns, without those that an agent sets.
fn set_points(
    config: &ControlConfig,
    names: &[String],
    recorded: &[Vec<f64>],
) -> BTreeMap<String, Vec<f64>> {
    let terms = config.reward.terms();
    terms
        .iter()
        .filter_map(Term::set_point_column)
        .filter(|column| !config.actions.contains(column))
        .filter_map(|column| {
            let place = names.iter().position(|name| name == column)?;
            Some((column.clone(), recorded[place].clone()))
        })
        .collect()
}

/// Returns the set-points that are no column of the states, with their values in these rows of the log.
fn beside_states(
    mut set_points: BTreeMap<String, Vec<f64>>,
    columns: &[Column],
    rows: &[usize],
) -> BTreeMap<String, Vec<f64>> {
    set_points.retain(|name, _| columns.iter().all(|column| column.name != *name));
    for values in set_points.values_mut() {
        *values = rows.iter().map(|&row| values[row]).collect();
    }
    set_points
}

/// Returns the smallest and the largest value, or zeros if all are missing.
fn range(values: &[f64]) -> [f64; 2] {
    // Both leave out missing values, unless there are no others.
    let low = values.iter().copied().reduce(f64::min);
    let high = values.iter().copied().reduce(f64::max);
    [low, high].map(|end| end.filter(|end| !end.is_nan()).unwrap_or(0.0))
}

/// Adds the key that names the column to an error about it.
fn named(config: &ControlConfig, error: DataError) -> StepError {
    match &error {
        DataError::NoSuchColumn { name, .. } | DataError::NoNumbers { name, .. } => {
            let context = format!("control.{}", config.key_of(name));
            StepError::InContext { context, source: Box::new(error.into()) }
        }
        _ => error.into(),
    }
}

/// Refuses a column of actions or of the reward without a value. A terminal may be empty: no episode ends in one.
fn refuse_empty(
    config: &ControlConfig,
    names: &[String],
    recorded: &[Vec<f64>],
) -> Result<(), StepError> {
    for (name, values) in names.iter().zip(recorded) {
        let key = config.key_of(name);
        ensure!(
            key == "terminal" || values.iter().any(|value| !value.is_nan()),
            "control.{key}: {name} is empty in the training range; name another column"
        );
    }
    Ok(())
}

/// Refuses states that do not fit into memory.
pub(super) fn require_memory(surveyed: &Surveyed) -> Result<(), NoRoom> {
    memory::require(
        surveyed.state_bytes().saturating_add(surveyed.working_bytes()),
        &format!(
            "reading {} states of {} columns",
            count(surveyed.rows() + surveyed.held_out_rows()),
            surveyed.columns()
        ),
        "raise data.period_secs where data.resample is set, shorten data.train, or leave channels out with data.exclude",
    )
}

fn fingerprint(
    states: &Fingerprint,
    levels: &Levels,
    rewards: &[f32],
    endings: &[Ending],
) -> Fingerprint {
    let mut all = Fingerprinter::default();
    all.add(b"decisions 1").add(states.to_string().as_bytes());
    for value in levels.values.iter().flatten() {
        all.add(&value.to_le_bytes());
    }
    for ((action, reward), ending) in levels.of_rows.iter().zip(rewards).zip(endings) {
        let action = action.map_or(u32::MAX, u32::from);
        // Every NaN counts as the same missing reward.
        let reward = if reward.is_nan() { f32::NAN } else { *reward };
        all.add(&action.to_le_bytes()).add(&reward.to_bits().to_le_bytes());
        all.add(&[u8::from(*ending == Ending::Terminal)]);
    }
    all.finish()
}

/// Combines a fingerprint with further numbers.
pub(super) fn with_numbers(
    log: &Fingerprint,
    what: &[u8],
    numbers: impl Iterator<Item = f64>,
) -> Fingerprint {
    let mut all = Fingerprinter::default();
    all.add(what).add(log.to_string().as_bytes());
    for number in numbers {
        // Every NaN counts as the same missing number.
        let number = if number.is_nan() { f64::NAN } else { number };
        all.add(&number.to_le_bytes());
    }
    all.finish()
}

/// Summarises the recorded values of every continuous action.
fn settings_told(
    config: &ControlConfig,
    acted: &[Vec<f64>],
) -> Result<Vec<SettingTold>, StepError> {
    if config.levels.is_none() {
        return Ok(Vec::new());
    }
    config
        .actions
        .iter()
        .zip(acted)
        .map(|(column, values)| {
            let own: Vec<f64> = values.iter().copied().filter(|value| !value.is_nan()).collect();
            ensure!(!own.is_empty(), "the log has no value of {column}");
            let sorted = SortedValues::new(own)?;
            let mut quantiles = [0.0; 5];
            for (value, share) in quantiles.iter_mut().zip([0.0, 0.05, 0.5, 0.95, 1.0]) {
                *value = sorted.quantile(share)?;
            }
            Ok(SettingTold { column: column.clone(), quantiles })
        })
        .collect()
}

impl ActionLog {
    /// Gives the warnings that `calib inspect` reports in its own words.
    pub(super) fn tell_doubts(&self, printer: &Printer) {
        for told in &self.doubts {
            printer.warn(told);
        }
    }

    /// Warns about numbers beside the state that may stand for a missing value.
    pub(super) fn tell_codes_beside(&self, printer: &Printer) {
        if let Some(told) = &self.codes_beside {
            printer.warn(told);
        }
    }

    /// Returns all warnings about the log, in the order in which they are printed.
    pub(super) fn warnings(&self, config: &ControlConfig) -> Vec<String> {
        let rare = rare::hardly_taken(&self.names.actions, &self.decisions.counts(), config);
        self.given.iter().chain(&self.doubts).cloned().chain(rare).collect()
    }

    /// Returns the training data of a representation: the states, along the episodes.
    pub(super) fn material(&self) -> Material<'_> {
        let states = self.decisions.states();
        let segments = self.decisions.transitions().segments();
        Material { states, segments, fingerprint: &self.fingerprint }
    }
}

/// Returns the rows in which episodes begin.
pub(super) fn start_rows(log: &Decisions, start: StartRows) -> Vec<u32> {
    match start {
        StartRows::Episodes => log.starts().into_iter().map(|RowIndex(row)| row).collect(),
        StartRows::Anywhere => log.transitions().sources().to_vec(),
    }
}

/// Refuses a model that does not fit into memory.
pub(super) fn require_model(log: &Decisions, config: &ControlConfig) -> Result<(), StepError> {
    let starts = start_rows(log, config.start).len();
    Ok(memory::require(
        ActionModel::build_bytes(log, starts, &config.model),
        &format!(
            "a model of {} ensemble members with {} neighbours for each of {} actions",
            config.model.members,
            count(config.model.neighbors),
            log.levels()
        ),
        "lower control.model.neighbors or control.model.members",
    )?)
}

/// Returns the states in which episodes begin, with their representation by `metric`.
pub(super) fn starts(
    log: &Decisions,
    metric: &States,
    start: StartRows,
) -> Result<Starts, StepError> {
    let rows = start_rows(log, start);
    ensure!(!rows.is_empty(), "the log has no episode");
    Ok(Starts {
        observed: first_states(log.states(), &rows)?,
        metric: first_states(metric, &rows)?,
    })
}

/// Returns the states in these rows, in which episodes begin.
fn first_states(states: &States, rows: &[u32]) -> Result<States, StepError> {
    let values: Vec<f32> = rows.iter().flat_map(|&row| states.row(row as usize)).copied().collect();
    States::new(values, rows.len(), states.columns()).context("the first states of episodes")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn set_points_are_columns_that_no_agent_sets() {
        let config: ControlConfig = toml::from_str(
            r#"
            actions = ["valve"]
            reward = [
                { column = "level", set_point = "target" },
                { column = "flow", set_point = "valve" },
                { column = "heat", set_point = 5.0 },
            ]
            "#,
        )
        .expect("valid");
        let names = config.columns();
        let recorded: Vec<Vec<f64>> = (0..names.len()).map(|place| vec![place as f64]).collect();
        let place = names.iter().position(|name| name == "target").expect("a column");
        let expected = BTreeMap::from([("target".to_owned(), vec![place as f64])]);
        assert_eq!(set_points(&config, &names, &recorded), expected);
    }

    /// Returns the warning about a number of values in this range.
    fn told_of(rows: usize, range: [f64; 2]) -> String {
        let found = OutlyingActions { rows: (0..rows).collect(), range, others: [-2.0, 2.0] };
        outlying_told("dose", &found, "noon")
    }

    #[test]
    fn values_that_stand_out_are_told_apart() {
        let alike = told_of(8, [50.0; 2]);
        assert!(alike.contains("50 in 8 rows, first at noon, stands out"), "{alike}");
        assert!(alike.contains("correct it there or add 50 to data.missing_values"), "{alike}");
        let near = told_of(8, [50.001, 50.002]);
        assert!(near.contains("8 values from 50.001 to 50.002, first at noon, stand"), "{near}");
        assert!(near.contains("or add the values to data.missing_values"), "{near}");
        let two = told_of(2, [50.0, 52.0]);
        assert!(two.contains("2 values from 50 to 52"), "{two}");
        assert!(two.contains("or add 50 and 52 to data.missing_values"), "{two}");
        let infinite = told_of(1, [f64::INFINITY; 2]);
        assert!(!infinite.contains("data.missing_values"), "{infinite}");
    }
}
