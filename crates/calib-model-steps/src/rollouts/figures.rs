//! Figures of a study, as files.

use std::{cmp::Reverse, io::Write as _, path::Path};

use calib_base::StepError;
use calib_core::Timestamp;
use calib_data::table::Table;
use calib_files::{file_name, write_atomically};
use calib_report::{Figure, RolloutFigure, RolloutGrid, RolloutRow, Trajectory};

use crate::rollouts::trajectory_columns::Columns;

/// Writes a figure as `NAME.svg` and `NAME.png`, and returns the names of the two files.
///
/// # Errors
/// If it cannot be drawn or written.
pub fn write(directory: &Path, name: &str, figure: &Figure) -> Result<[String; 2], StepError> {
    let svg = figure.svg();
    let png = figure.png()?;
    let names = names(name);
    write_atomically(&directory.join(&names[0]), |file| file.write_all(svg.as_bytes()))?;
    write_atomically(&directory.join(&names[1]), |file| file.write_all(&png))?;
    Ok(names)
}

/// Returns the names of the files of a figure.
pub fn names(name: &str) -> [String; 2] {
    ["svg", "png"].map(|kind| format!("{}.{kind}", file_name(name)))
}

/// Returns sensor names as parts of file names: "T inlet (°C)" is `T-inlet-C`. If two results would be equal, both
/// sensors keep their names, in which [`file_name`] writes such characters as numbers.
pub fn placed<'a>(sensors: impl Iterator<Item = &'a str>) -> Vec<String> {
    let sensors: Vec<&str> = sensors.collect();
    sensors
        .iter()
        .map(|&sensor| {
            let name = readable(sensor);
            let mut others = sensors.iter().filter(|other| **other != sensor);
            let is_taken = others.any(|other| readable(other) == name || *other == name);
            if name.is_empty() || is_taken { sensor.to_owned() } else { name }
        })
        .collect()
}

/// Replaces all characters of `name` that are neither letters nor digits by hyphens.
fn readable(name: &str) -> String {
    let mut readable = String::new();
    for letter in name.chars() {
        match letter {
            'ä' => readable.push_str("ae"),
            'ö' => readable.push_str("oe"),
            'ü' => readable.push_str("ue"),
            'Ä' => readable.push_str("Ae"),
            'Ö' => readable.push_str("Oe"),
            'Ü' => readable.push_str("Ue"),
            'ß' => readable.push_str("ss"),
            letter if letter.is_alphanumeric() || matches!(letter, '_' | '.') => {
                readable.push(letter);
            }
            _ if readable.ends_with('-') => {}
            _ => readable.push('-'),
        }
    }
    readable.trim_matches(['-', '.']).to_owned()
}

/// Returns one figure per sensor: rollouts over the recorded trajectory from the same start state, in physical units.
///
/// Rollouts from other start states cannot be drawn over the same record. Shown is the start state that most members
/// share (they start there, or from its replacement); among equals the one whose recorded trajectory is longest. Every
/// member's first rollout from it is drawn.
///
/// # Errors
/// If the table lacks a column.
pub fn rollouts(
    trajectories: &Table,
    sensors: &[String],
    period_secs: f64,
) -> Result<Vec<RolloutFigure>, StepError> {
    let groups = groups(trajectories)?;
    let mut figures = Vec::with_capacity(sensors.len());
    for (sensor, named) in sensors.iter().zip(Columns::of(sensors)) {
        let values = trajectories.column::<f64>(&named.physical)?;
        let recorded = trajectories.optional::<f64>(&named.recorded)?;
        // The first of equally long ones, so that the figure does not depend on anything else.
        let best = groups.iter().rev().max_by_key(|group| {
            let known = recorded[group.rows.clone()].iter().flatten().count();
            (members_from(&groups, group.wanted), known)
        });
        let Some(shown) = best else { continue };
        let truth = recorded[shown.rows.clone()].iter().flatten().copied().collect();
        let mut members: Vec<u32> = Vec::new();
        let mut lines = Vec::new();
        for group in groups.iter().filter(|group| group.wanted == shown.wanted) {
            if !members.contains(&group.member) {
                members.push(group.member);
                lines.push(Trajectory {
                    label: format!("member {}", group.member),
                    period_secs,
                    values: values[group.rows.clone()].to_vec(),
                });
            }
        }
        figures.push(RolloutFigure {
            sensor: sensor.clone(),
            unit: None,
            truth: Some(Trajectory { label: "recorded".to_owned(), period_secs, values: truth }),
            rollouts: lines,
        });
    }
    Ok(figures)
}

/// Returns how many members start from row `wanted`, or from its replacement.
fn members_from(groups: &[RolloutRows], wanted: u32) -> usize {
    let all = groups.iter().filter(|group| group.wanted == wanted);
    let mut members: Vec<u32> = all.map(|group| group.member).collect();
    members.dedup();
    members.len()
}

/// Number of start states in a grid of small plots.
const GRID_STARTS: usize = 4;

/// The first rollout from each start state, for one sensor, with the record.
pub struct FirstRollouts {
    /// The sensor.
    pub sensor: String,
    /// The text in brackets after the sensor's name.
    pub unit: Option<String>,
    period_secs: f64,
    pairs: Vec<FirstRollout>,
}

struct FirstRollout {
    /// Time of the start state. Models that were built from other rows number them differently.
    time: Option<Timestamp>,
    recorded: Vec<f64>,
    values: Vec<f64>,
}

/// Returns all start states of `trajectories`, sensor by sensor, in the order of their rollouts.
///
/// # Errors
/// If the table lacks a column.
pub fn starts(
    trajectories: &Table,
    sensors: &[String],
    period_secs: f64,
) -> Result<Vec<FirstRollouts>, StepError> {
    let groups = groups(trajectories)?;
    let mut all = Vec::with_capacity(sensors.len());
    for (sensor, named) in sensors.iter().zip(Columns::of(sensors)) {
        let values = trajectories.column::<f64>(&named.physical)?;
        let recorded = trajectories.optional::<f64>(&named.recorded)?;
        let mut seen: Vec<u32> = Vec::new();
        let mut pairs = Vec::new();
        for RolloutRows { wanted, time, rows, .. } in &groups {
            if !seen.contains(wanted) {
                seen.push(*wanted);
                pairs.push(FirstRollout {
                    time: *time,
                    recorded: recorded[rows.clone()].iter().flatten().copied().collect(),
                    values: values[rows.clone()].to_vec(),
                });
            }
        }
        all.push(FirstRollouts { sensor: sensor.clone(), unit: None, period_secs, pairs });
    }
    Ok(all)
}

impl FirstRollouts {
    /// Returns the rollout from the same start state.
    fn from(&self, start: &FirstRollout) -> Option<&[f64]> {
        self.pairs
            .iter()
            .find(|pair| pair.time.is_some() && pair.time == start.time)
            .map(|pair| pair.values.as_slice())
    }

    fn trajectory(&self, label: &str, values: &[f64]) -> Trajectory {
        let label = label.to_owned();
        Trajectory { label, period_secs: self.period_secs, values: values.to_vec() }
    }
}

/// Returns small plots of one sensor: the start states that most models share, among equals those with the longest
/// recorded trajectories, and each model's rollout from there. A model that shares no start state with the first has
/// its own figure, named after it.
pub fn grids(models: &[(&str, &FirstRollouts)]) -> Vec<RolloutGrid> {
    let mut grids: Vec<RolloutGrid> = Vec::new();
    let mut left = models.to_vec();
    while let Some(&(_, first)) = left.first() {
        let usable: Vec<&FirstRollout> =
            first.pairs.iter().filter(|pair| pair.recorded.len() > 1).collect();
        let (together, apart): (Vec<_>, Vec<_>) = (left.iter())
            .partition(|(_, starts)| usable.iter().any(|start| starts.from(start).is_some()));
        if together.is_empty() {
            // There is no record after any start state of this model.
            left.remove(0);
            continue;
        }
        let mut shown: Vec<(usize, &FirstRollout)> = usable.into_iter().enumerate().collect();
        shown.sort_by_key(|(_, start)| {
            let sharing = together.iter().filter(|(_, starts)| starts.from(start).is_some());
            Reverse((sharing.count(), start.recorded.len()))
        });
        shown.truncate(GRID_STARTS);
        shown.sort_unstable_by_key(|(place, _)| *place);
        let shown: Vec<&FirstRollout> = shown.into_iter().map(|(_, start)| start).collect();
        let mut next = grid(first, &together, &shown);
        if !grids.is_empty() {
            next.sensor = format!("{}, {}", next.sensor, next.models.join(", "));
        }
        grids.push(next);
        left = apart;
    }
    grids
}

fn grid(
    first: &FirstRollouts,
    models: &[(&str, &FirstRollouts)],
    starts: &[&FirstRollout],
) -> RolloutGrid {
    let rows = starts.iter().enumerate().map(|(number, start)| RolloutRow {
        label: format!("start {}", number + 1),
        truth: first.trajectory("recorded", &start.recorded),
        rollouts: models
            .iter()
            .map(|(name, starts)| Some(first.trajectory(name, starts.from(start)?)))
            .collect(),
    });
    RolloutGrid {
        sensor: first.sensor.clone(),
        unit: first.unit.clone(),
        models: models.iter().map(|(name, _)| (*name).to_owned()).collect(),
        rows: rows.collect(),
    }
}

/// The rows of one rollout in the table of trajectories.
struct RolloutRows {
    member: u32,
    /// The row that was requested as the start, and its time.
    wanted: u32,
    time: Option<Timestamp>,
    rows: std::ops::Range<usize>,
}

fn groups(trajectories: &Table) -> Result<Vec<RolloutRows>, StepError> {
    let members = trajectories.column::<u32>("member")?;
    let numbers = trajectories.column::<u32>("rollout")?;
    let wanted = trajectories.column::<u32>("wanted_row")?;
    let times = trajectories.optional::<Timestamp>("wanted_timestamp")?;
    let mut groups = Vec::new();
    let mut first = 0;
    for next in 1..=members.len() {
        let ends = next == members.len()
            || (members[next], numbers[next]) != (members[first], numbers[first]);
        if ends {
            let member = members[first];
            let wanted = wanted[first];
            let time = times[first];
            groups.push(RolloutRows { member, wanted, time, rows: first..next });
            first = next;
        }
    }
    Ok(groups)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns start states of a constant sensor, which differ only in their times.
    fn starts(times: &[i64]) -> FirstRollouts {
        let pairs = times
            .iter()
            .map(|&time| FirstRollout {
                time: Some(Timestamp::from_micros(time)),
                recorded: vec![5.0; 3],
                values: vec![time as f64, 9.0],
            })
            .collect();
        FirstRollouts { sensor: "PIT300".to_owned(), unit: None, period_secs: 1.0, pairs }
    }

    #[test]
    fn models_stand_beside_each_other_where_they_start_alike() {
        let year = starts(&[1, 4]);
        let week = starts(&[4, 7]);
        let other = starts(&[0]);
        let grids = grids(&[("year", &year), ("network", &other), ("week", &week)]);
        let told: Vec<_> =
            grids.iter().map(|grid| (grid.sensor.as_str(), grid.rows.len())).collect();
        assert_eq!(told, [("PIT300", 2), ("PIT300, network", 1)]);
        assert_eq!(grids[0].models, ["year", "week"]);
        let shown = [0, 1].map(|row: usize| {
            grids[0].rows[row].rollouts.iter().map(Option::is_some).collect::<Vec<bool>>()
        });
        assert_eq!(shown, [vec![true, false], vec![true, true]]);
        let of_week = grids[0].rows[1].rollouts[1].as_ref().map(|trajectory| trajectory.values[0]);
        assert_eq!(
            of_week,
            Some(4.0),
            "the rollout from that start, not from one that looks like it"
        );
        assert!(super::grids(&[]).is_empty());
        let none = starts(&[]);
        assert!(super::grids(&[("year", &none), ("week", &none)]).is_empty());
    }

    fn named(sensors: &[&str]) -> Vec<String> {
        placed(sensors.iter().copied())
    }

    #[test]
    fn figures_of_sensors_have_readable_names_of_their_own() {
        assert_eq!(
            named(&["PIT300 (april)", "PIT300 (july)", "PIT300 (july, week)"]),
            ["PIT300-april", "PIT300-july", "PIT300-july-week"]
        );
        assert_eq!(named(&["T (degC)", "Zulauf Öl [ / °C]"]), ["T-degC", "Zulauf-Oel-C"]);
        assert_eq!(names(&named(&["T (degC)"])[0])[0], "T-degC.svg");
        let names = named(&["X (1)", "X-1", "X, 1", "X 1", "X (1"]);
        for (place, name) in names.iter().enumerate() {
            assert!(!names[..place].contains(name), "{names:?}");
        }
    }
}
