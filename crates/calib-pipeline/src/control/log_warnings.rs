//! Warnings about a log of decisions that loses transitions, or whose values may mean something else.

use calib_base::output::{Printer, count, counted, percent, span};
use calib_control::{
    ChangedDecisions, ColumnFindings, ControlConfig, DecisionRows, Ending, LaggedDecisions,
    RewardRow, RowsWithoutReward, TerminalCells, UnendedGaps,
};
use calib_core::{Period, Timestamp, abridged_list};
use calib_data::{ChannelProfile, DropReason, Profile, Resample, Sentinel, ShownClock};

/// Up to one decision in this many may count as the action of a terminal's row without a warning. Our choice: with a
/// lag of two rows this affects one decision per episode.
const LAGGED_TO_ONE: usize = 20;

/// The warnings that a command gives while it reads a log. Each is printed as soon as it is found, because an error may
/// follow that it explains. The verdict keeps all of them.
pub(super) struct LogWarnings<'a> {
    printer: &'a Printer,
    given: Vec<String>,
}

impl<'a> LogWarnings<'a> {
    /// Returns a list that prints on `printer`.
    pub(super) fn new(printer: &'a Printer) -> Self {
        Self { printer, given: Vec::new() }
    }

    /// Prints these warnings, and keeps them.
    pub(super) fn give(&mut self, warnings: impl IntoIterator<Item = String>) {
        for warning in warnings {
            self.printer.warn(&warning);
            self.given.push(warning);
        }
    }

    /// Returns the warnings that were given, in order.
    pub(super) fn into_given(self) -> Vec<String> {
        self.given
    }
}

/// The times of the rows of a log, on the clock of its study.
#[derive(Clone, Copy)]
pub(super) struct RowTimes<'a> {
    clock: &'a ShownClock,
    times: &'a [Timestamp],
}

impl<'a> RowTimes<'a> {
    /// Returns the `times` of all rows on `clock`.
    pub(super) fn new(clock: &'a ShownClock, times: &'a [Timestamp]) -> Self {
        Self { clock, times }
    }

    /// Formats the time of a row.
    pub(super) fn shown(&self, row: usize) -> String {
        self.clock.shown(self.times[row])
    }
}

/// Returns warnings about missing actions, an odd column of terminals, and a lag that is longer than many episodes.
pub(super) fn odd_columns(
    config: &ControlConfig,
    resample: Option<Resample>,
    times: RowTimes<'_>,
    found: &ColumnFindings,
) -> Vec<String> {
    let mut told = Vec::new();
    if let Some(&first) = found.without_action.first() {
        let rows = found.without_action.len();
        told.push(missing_actions(rows, &times.shown(first), resample));
    }
    if let Some(name) = &config.terminal {
        let first_empty = found.terminal.first_empty.map(|row| times.shown(row));
        told.extend(odd_terminals(name, &found.terminal, first_empty.as_deref()));
    }
    told.extend(long_lag(config.lag, found.lagged));
    told
}

/// Returns sentences on columns that agents do not see or that the study fails to leave out, rows with a repeated or missing time, steps over
/// gaps, sensors whose unit changed, frozen sensors, and numbers that may stand for a missing value, in the state or, as `codes_beside`, beside
/// it. `calib inspect` reports these in its own words.
pub(super) fn doubts(
    profile: &Profile,
    codes_beside: &[Sentinel],
    resample: Option<Resample>,
    times: RowTimes<'_>,
    gaps: &UnendedGaps,
) -> Vec<String> {
    let mut told: Vec<String> = dropped_columns(&profile.channels).into_iter().collect();
    let repeated = profile.duplicates.identical + profile.duplicates.conflicting;
    if let Some(first) = profile.duplicates.examples.first().filter(|_| repeated > 0) {
        told.push(repeated_times(repeated as usize, &times.clock.shown(*first)));
    }
    told.extend(rows_without_time(profile.null_timestamps, profile.undecided_times));
    if let Some(first) = gaps.first.filter(|_| gaps.are_many()) {
        let first = times.shown(first);
        told.push(many_gaps(gaps, &first, profile.sampled_period_secs, resample));
    }
    told.extend(profile.reading_doubts());
    // Agents that act predict no sensor, so each sensor is only an input.
    told.extend(profile.unit_doubts(&[], times.clock));
    told.extend(profile.frozen_doubt());
    let mut codes = profile.sentinels.clone();
    for code in codes_beside {
        add(&mut codes, code.clone());
    }
    told.extend(Sentinel::doubt(&codes));
    told
}

/// Returns warnings about rows that are left out because they have no time. Of `rows` such rows, `undecided` have one, of an
/// hour in which `data.time_zone` cannot place it.
fn rows_without_time(rows: u64, undecided: u64) -> Vec<String> {
    let are = |rows: u64| if rows == 1 { "is" } else { "are" };
    let mut told = Vec::new();
    let empty = rows.saturating_sub(undecided);
    if empty > 0 {
        told.push(format!(
            "{} no time and {} left out: write one into every row of the log",
            rows_have(empty as usize),
            are(empty)
        ));
    }
    if undecided > 0 {
        told.push(format!(
            "{} a time of an hour that clocks showed twice or never (data.time_zone), which no other row decides, and {} left out: write the \
             times of the log with their offset from UTC, or correct data.time_zone if it is not the clock of the log",
            rows_have(undecided as usize),
            are(undecided)
        ));
    }
    told
}

/// Number of dropped columns that a warning names.
const NAMED: usize = 3;

/// Returns the warning about columns that agents cannot see although the study does not exclude them. A constant column tells an agent
/// nothing, so it counts only if `data.include` has it.
fn dropped_columns(channels: &[ChannelProfile]) -> Option<String> {
    let includes =
        channels.iter().any(|channel| matches!(channel.dropped, Some(DropReason::NotIncluded)));
    let mut named = Vec::new();
    for channel in channels {
        match &channel.dropped {
            None
            | Some(
                DropReason::NotIncluded | DropReason::Excluded { .. } | DropReason::OneHot { .. },
            ) => {}
            Some(DropReason::Constant { .. }) if !includes => {}
            Some(reason) => named.push(format!("{} ({reason})", channel.name)),
        }
    }
    if named.is_empty() {
        return None;
    }
    let columns = counted(named.len(), "column");
    let are = if named.len() == 1 { "is" } else { "are" };
    Some(format!(
        "{columns} of the log {are} no part of the state, so that agents do not see them: {}. Put them into data.exclude if they need not, and otherwise \
         raise preprocess.max_missing for missing values, or name a column of text in preprocess.one_hot",
        abridged_list(&named, NAMED)
    ))
}

/// Returns the message about `rows` rows with the time of another row. `first` is the first such time.
fn repeated_times(rows: usize, first: &str) -> String {
    format!(
        "{} the time of another row and {} left out, the first at {first}: of each time the first row counts. If several machines or episodes \
         were logged with the same times, keep one with data.where, or give each times of its own",
        rows_have(rows),
        if rows == 1 { "is" } else { "are" }
    )
}

/// Returns the message about gaps that cost many steps. The first comes after the time `first`.
fn many_gaps(
    gaps: &UnendedGaps,
    first: &str,
    period_secs: f64,
    resample: Option<Resample>,
) -> String {
    let remedy = if resample.is_some() {
        "raise data.max_age_secs, or data.period_secs"
    } else {
        "put a log without an even clock on one with data.resample = \"last\", data.period_secs and data.max_age_secs"
    };
    format!(
        "{} of {} from row to row are no transitions, the first after {first}: the next row comes later than the sample period of {period_secs} s, \
         or rows between them lack values. If no episode ends there, {remedy}",
        count(gaps.count),
        counted(gaps.steps, "step")
    )
}

/// Returns the warning about `rows` rows without an action. The first is at the time `first`.
fn missing_actions(rows: usize, first: &str, resample: Option<Resample>) -> String {
    let remedy = if resample.is_some() {
        "raise data.max_age_secs to the longest time that an action holds"
    } else {
        "set data.resample = \"last\" with data.period_secs, and data.max_age_secs to the longest time that an action holds"
    };
    format!(
        "{} no action: an episode ends at each, the first at {first}. If the action is recorded only when it changes, {remedy}",
        rows_have(rows)
    )
}

/// Returns warnings about the column `name` of terminals. Its first empty cell is at the time `first_empty`.
fn odd_terminals(name: &str, cells: &TerminalCells, first_empty: Option<&str>) -> Vec<String> {
    let TerminalCells { rows, terminals, empty, .. } = *cells;
    let mut odd = Vec::new();
    if let Some(first) = first_empty.filter(|_| cells.are_unclear()) {
        odd.push(format!(
            "{name} (control.terminal) has 0 in some rows and no number in {} of {}, the first at {first}: these count as 0 too, so that ends of \
             episodes may be missing. Write 0 or 1 in every row, or 1 at the ends and nothing elsewhere",
            count(empty),
            counted(rows, "row")
        ));
    }
    if cells.are_mostly_terminals() {
        odd.push(format!(
            "{name} (control.terminal) is another number than 0 in {} of {}, and an episode ends in each: if it says that the plant runs, invert \
             it, to 1 where an episode ends and 0 elsewhere",
            count(terminals),
            counted(rows, "row")
        ));
    }
    odd
}

/// Returns the warning about a lag if many decisions have none. `None` if they are few.
fn long_lag(lag: usize, lagged: LaggedDecisions) -> Option<String> {
    let LaggedDecisions { count: beyond, decisions } = lagged;
    (beyond * LAGGED_TO_ONE >= decisions && beyond > 0).then(|| {
        format!(
            "with control.lag = {} the action of {} of the decisions ({} of {}) would be shown after the terminal of their episode: the one in the \
             row of the terminal counts. Set control.lag to the number of rows after which the log shows an action",
            count(lag),
            percent(beyond as f64 / decisions as f64),
            count(beyond),
            count(decisions)
        )
    })
}

/// Returns numbers, such as -9999, that may stand for a missing value in the columns beside the state: actions, reward and
/// probability. `recorded` has the values of the columns [`ControlConfig::columns`].
pub(super) fn codes_beside_states(config: &ControlConfig, recorded: &[Vec<f64>]) -> Vec<Sentinel> {
    let mut found: Vec<Sentinel> = Vec::new();
    let beside = config.beside_the_state();
    let terminals = config.terminal_of(recorded);
    for (name, values) in config.columns().iter().zip(recorded) {
        if !beside.contains(name) || config.terminal.as_ref() == Some(name) {
            continue;
        }
        let Some(code) = Sentinel::of_decisions(name, values) else { continue };
        if !terminals.is_some_and(|terminals| is_penalty(&code, values, terminals)) {
            add(&mut found, code);
        }
    }
    found
}

/// Adds a number to a list that has each number once.
fn add(all: &mut Vec<Sentinel>, code: Sentinel) {
    match all.iter_mut().find(|same| same.is(code.value)) {
        Some(same) => same.merge(code),
        None => all.push(code),
    }
}

/// Whether all rows with this number are terminals, so that it is probably a penalty. A dropout may write the number as the terminal too.
fn is_penalty(code: &Sentinel, values: &[f64], terminals: &[f64]) -> bool {
    let mut ended = values.iter().zip(terminals).filter(|(value, _)| code.is(**value));
    ended.all(|(_, &ended)| !ended.is_nan() && ended != 0.0 && !code.is(ended))
}

/// Returns the warning about a reward that is the same for every decision in a log without terminals: all behaviour gets
/// the same return.
pub(super) fn constant_reward(rows: &DecisionRows) -> Option<String> {
    // No decision of a segment led to its first row.
    let mut rewards = rows
        .segments
        .iter()
        .flat_map(|segment| rows.rewards[segment.rows()].iter().skip(1))
        .filter(|reward| !reward.is_nan());
    let first = rewards.next()?;
    let is_constant = rewards.all(|reward| reward == first);
    (is_constant && !rows.endings.contains(&Ending::Terminal)).then(|| {
        format!(
            "the reward is {first} for every decision, and no episode ends in a terminal: all behaviour gets the same return, so that no setting can be \
             better. Name what the agent should achieve with control.reward, or the column of terminals with control.terminal"
        )
    })
}

/// Returns warnings about rows whose reward is missing or infinite: no agent can learn from it, and episodes end before such rows, or after
/// them if they are those of the actions.
pub(super) fn missing_rewards(
    config: &ControlConfig,
    times: RowTimes<'_>,
    rows: &DecisionRows,
) -> Vec<String> {
    let mut told = Vec::new();
    let (leads, side) = match config.reward_row {
        RewardRow::Next => ("leads", "before"),
        RewardRow::Same => ("is taken", "after"),
    };
    let RowsWithoutReward { missing, infinite, missing_terminals, terminals } =
        &rows.without_reward;
    if let Some(&first) = missing.first() {
        let lost = lost_terminals(*missing_terminals, *terminals);
        told.push(format!(
            "{} no reward though an action {leads} there, the first at {}: an episode ends {side} each. Rewards are never filled in{lost}",
            rows_have(missing.len()),
            times.shown(first)
        ));
    }
    if let Some(&first) = infinite.first() {
        let counted = match infinite.len() {
            1 => "1 reward is".to_owned(),
            many => format!("{} rewards are", count(many)),
        };
        told.push(format!(
            "{counted} infinite or too large for single precision (beyond 3.4e38), the first at {}: an episode ends {side} each. Correct the \
             log, or give the column a smaller weight in control.reward",
            times.shown(first)
        ));
    }
    told
}

/// Returns the part of the message on terminals in rows without a reward. Empty if there are none.
fn lost_terminals(lost: usize, terminals: usize) -> String {
    let are = match lost {
        0 => return String::new(),
        1 => "is in a row",
        _ => "are in rows",
    };
    format!(
        ". {} of the {} {are} without a reward, and so no end of an episode: write the reward of the last step into the row of the terminal",
        count(lost),
        counted(terminals, "terminal")
    )
}

/// Formats a number of rows with its verb, such as "3 rows have".
fn rows_have(rows: usize) -> String {
    format!("{} {}", counted(rows, "row"), if rows == 1 { "has" } else { "have" })
}

/// Returns a line on how often agents decide; `None` if they decide in every row.
pub(super) fn decisions_line(
    config: &ControlConfig,
    rows: &DecisionRows,
    period: Period,
) -> Option<String> {
    (config.every > 1).then(|| {
        format!(
            "{} of {} rows ({}): steps and timeouts count decisions",
            counted(rows.changed.decisions, "decision"),
            count(config.every),
            span(period.as_secs())
        )
    })
}

/// Returns the warning about decisions of several rows during which another action was set. `None` if there are none.
pub(super) fn changed_decisions(times: RowTimes<'_>, rows: &DecisionRows) -> Option<String> {
    let ChangedDecisions { count: changed, decisions, first } = rows.changed;
    let first = times.shown(first?);
    Some(format!(
        "in {} of the decisions ({} of {}) another action was set before the next one, first at {first}: the action of the first row counts. Set \
         control.every to the number of rows for which actions are held, or to 1",
        percent(changed as f64 / decisions as f64),
        count(changed),
        count(decisions)
    ))
}

#[cfg(test)]
mod tests {
    use calib_data::DataConfig;

    use super::*;

    #[test]
    fn missing_actions_lead_to_what_holds_them() {
        let told = missing_actions(2_388, "noon", None);
        assert!(
            told.starts_with(
                "2,388 rows have no action: an episode ends at each, the first at noon. "
            ),
            "{told}"
        );
        assert!(told.contains("set data.resample = \"last\" with data.period_secs"), "{told}");
        let held = missing_actions(1, "noon", Some(Resample::Last));
        assert!(held.starts_with("1 row has no action"), "{held}");
        assert!(
            held.ends_with("raise data.max_age_secs to the longest time that an action holds"),
            "{held}"
        );
    }

    #[test]
    fn columns_that_agents_cannot_see_are_named() {
        let channel = |name: &str, dropped: Option<DropReason>| ChannelProfile {
            name: name.to_owned(),
            dropped,
            ..ChannelProfile::default()
        };
        let constant = DropReason::Constant { value: 1.0, word: None };
        let seldom = DropReason::Missing { fraction: 0.54, limit: 0.1 };
        let level = channel("level", None);
        let still = channel("still", Some(constant));
        let excluded = channel("valve", Some(DropReason::Excluded { pattern: "valve".to_owned() }));
        let meant = [level.clone(), still.clone(), excluded];
        assert_eq!(dropped_columns(&meant), None);
        let lost =
            [level, still, channel("temp", Some(seldom)), channel("mode", Some(DropReason::Text))];
        let told = dropped_columns(&lost).expect("two");
        assert!(
            told.starts_with(
                "2 columns of the log are no part of the state, so that agents do not see them: temp (54.0 % missing in the training range, \
                 more than preprocess.max_missing = 0.1), mode (text, not numbers). "
            ),
            "{told}"
        );
        let included =
            [lost.to_vec(), vec![channel("note", Some(DropReason::NotIncluded))]].concat();
        assert!(dropped_columns(&included).expect("three").starts_with("3 columns of the log are"));
    }

    #[test]
    fn what_is_left_out_is_told_with_a_remedy() {
        let repeated = repeated_times(600, "noon");
        assert!(
            repeated.starts_with(
                "600 rows have the time of another row and are left out, the first at noon: "
            ),
            "{repeated}"
        );
        assert!(repeated_times(1, "noon").starts_with("1 row has the time of another row and is"));
        let gaps = UnendedGaps { count: 202, steps: 599, first: Some(3) };
        let told = many_gaps(&gaps, "noon", 60.0, None);
        assert!(told.starts_with("202 of 599 steps from row to row are no transitions"), "{told}");
        assert!(told.contains("the sample period of 60 s"), "{told}");
        assert!(told.contains("with data.resample = \"last\""), "{told}");
        let clocked = many_gaps(&gaps, "noon", 60.0, Some(Resample::Last));
        assert!(clocked.ends_with("raise data.max_age_secs, or data.period_secs"), "{clocked}");
    }

    #[test]
    fn rows_of_an_hour_that_came_twice_have_a_time() {
        assert!(rows_without_time(0, 0).is_empty());
        let empty = rows_without_time(3, 0);
        assert_eq!(
            empty,
            ["3 rows have no time and are left out: write one into every row of the log"]
        );
        let undecided = rows_without_time(2, 2);
        assert_eq!(undecided.len(), 1, "every row has a time: {undecided:?}");
        let start = "2 rows have a time of an hour that clocks showed twice or never (data.time_zone), which no other row decides, and are left out: ";
        assert!(undecided[0].starts_with(start), "{undecided:?}");
        let both = rows_without_time(3, 2);
        assert!(both[0].starts_with("1 row has no time and is left out"), "{both:?}");
        assert!(both[1].starts_with(start), "{both:?}");
    }

    #[test]
    fn times_are_shown_on_the_clock_of_the_study() {
        let time_zone = Some("Europe/Berlin".to_owned());
        let data = DataConfig { time_zone, ..DataConfig::default() };
        let clock = ShownClock::of(&data, true);
        let noon = [Timestamp::from_micros(1_709_294_400_000_000)];
        let times = RowTimes::new(&clock, &noon);
        assert_eq!(times.shown(0), "2024-03-01 13:00:00");
    }

    #[test]
    fn terminals_in_most_rows_and_empty_ones_are_told() {
        let plain =
            TerminalCells { rows: 3_000, terminals: 56, zeros: 2_944, ..TerminalCells::default() };
        assert!(odd_terminals("trip", &plain, None).is_empty());
        let unclear = TerminalCells { zeros: 2_331, empty: 613, first_empty: Some(4), ..plain };
        let told = odd_terminals("trip", &unclear, Some("noon"));
        assert!(told[0].contains("no number in 613 of 3,000 rows, the first at noon"), "{told:?}");
        assert_eq!(told.len(), 1);
        let inverted = TerminalCells { terminals: 2_944, zeros: 56, ..plain };
        let told = odd_terminals("trip", &inverted, None);
        assert!(told[0].contains("another number than 0 in 2,944 of 3,000 rows"), "{told:?}");
        assert_eq!(told.len(), 1);
    }

    fn lagged(count: usize) -> LaggedDecisions {
        LaggedDecisions { count, decisions: 2_944 }
    }

    #[test]
    fn a_lag_of_two_rows_is_no_long_one() {
        assert_eq!(long_lag(20, lagged(0)), None);
        assert_eq!(long_lag(20, lagged(56)), None);
        let long = long_lag(20, lagged(1_037)).expect("a third");
        assert!(
            long.starts_with(
                "with control.lag = 20 the action of 35 % of the decisions (1,037 of 2,944) "
            ),
            "{long}"
        );
    }

    #[test]
    fn terminals_without_a_reward_are_told() {
        assert_eq!(lost_terminals(0, 56), "");
        assert!(
            lost_terminals(56, 56)
                .starts_with(". 56 of the 56 terminals are in rows without a reward")
        );
        assert!(lost_terminals(1, 2).starts_with(". 1 of the 2 terminals is in a row without"));
    }
}
