//! Figures of a study, as files.

use std::{io::Write as _, path::Path};

use calib_data::table::Table;
use calib_files::{file_name, write_atomically};
use calib_report::{Figure, RolloutFigure, RolloutGrid, RolloutRow, Trajectory};

/// Write a figure as `NAME.svg` and `NAME.png`.
pub(super) fn write(directory: &Path, name: &str, figure: &Figure) -> anyhow::Result<()> {
    let (svg, png) = (figure.svg(), figure.png()?);
    let name = file_name(name);
    write_atomically(&directory.join(format!("{name}.svg")), |file| {
        file.write_all(svg.as_bytes())
    })?;
    write_atomically(&directory.join(format!("{name}.png")), |file| file.write_all(&png))?;
    Ok(())
}

/// One figure a sensor: rollouts over the recorded trajectory from the same start, in physical units.
///
/// Rollouts that start elsewhere cannot be laid over the same truth. Shown is the start that most members share (they
/// start there, or from what stands for it), of these the one whose recorded trajectory is longest, with every
/// member's first rollout from it.
pub(super) fn rollouts(
    trajectories: &Table,
    sensors: &[String],
    period_secs: f64,
) -> anyhow::Result<Vec<RolloutFigure>> {
    let groups = groups(trajectories)?;
    let mut figures = Vec::with_capacity(sensors.len());
    for sensor in sensors {
        let values = trajectories.column::<f64>(sensor)?;
        let recorded = trajectories.optional::<f64>(&format!("{sensor}.recorded"))?;
        let known = |group: &Group| recorded[group.rows.clone()].iter().flatten().count();
        let sharing = |group: &Group| {
            let all = groups.iter().filter(|of| of.wanted == group.wanted);
            let mut members: Vec<u32> = all.map(|of| of.member).collect();
            members.dedup();
            members.len()
        };
        // Of equally long ones the first, so that the figure does not depend on anything else.
        let best = |group: &&Group| (sharing(group), known(group));
        let Some(shown) = groups.iter().rev().max_by_key(best) else { continue };
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

/// Starts that a grid of small plots shows.
const GRID_STARTS: usize = 4;

/// The first rollout from each start, for one sensor: what was recorded, and what the model did.
pub(super) struct Starts {
    pub(super) sensor: String,
    period_secs: f64,
    pairs: Vec<(Vec<f64>, Vec<f64>)>,
}

/// All starts of `trajectories`, sensor by sensor, in the order in which they were rolled out.
pub(super) fn starts(
    trajectories: &Table,
    sensors: &[String],
    period_secs: f64,
) -> anyhow::Result<Vec<Starts>> {
    let groups = groups(trajectories)?;
    let mut all = Vec::with_capacity(sensors.len());
    for sensor in sensors {
        let values = trajectories.column::<f64>(sensor)?;
        let recorded = trajectories.optional::<f64>(&format!("{sensor}.recorded"))?;
        let mut seen: Vec<u32> = Vec::new();
        let mut pairs = Vec::new();
        for Group { wanted, rows, .. } in &groups {
            if !seen.contains(wanted) {
                seen.push(*wanted);
                let truth: Vec<f64> = recorded[rows.clone()].iter().flatten().copied().collect();
                pairs.push((truth, values[rows.clone()].to_vec()));
            }
        }
        all.push(Starts { sensor: sensor.clone(), period_secs, pairs });
    }
    Ok(all)
}

/// Small plots of one sensor: the longest recorded trajectories of the first model's starts, and each model's rollout
/// from there. Models that learned from other rows number them otherwise, so a start is known by what was recorded
/// after it.
pub(super) fn grid(models: &[(&str, &Starts)]) -> Option<RolloutGrid> {
    let (_, first) = models.first()?;
    let mut order: Vec<usize> =
        (0..first.pairs.len()).filter(|&place| first.pairs[place].0.len() > 1).collect();
    order.sort_by_key(|&place| std::cmp::Reverse(first.pairs[place].0.len()));
    order.truncate(GRID_STARTS);
    order.sort_unstable();
    let rows: Vec<RolloutRow> = order
        .iter()
        .enumerate()
        .map(|(number, &place)| {
            let truth = &first.pairs[place].0;
            let trajectory = |label: &str, values: &[f64]| Trajectory {
                label: label.to_owned(),
                period_secs: first.period_secs,
                values: values.to_vec(),
            };
            let rollout = |(name, of): &(&str, &Starts)| {
                let same = |(recorded, _): &&(Vec<f64>, Vec<f64>)| {
                    let known = recorded.len().min(truth.len());
                    known > 1 && recorded[..known] == truth[..known]
                };
                let (_, values) = of.pairs.iter().find(same)?;
                Some(trajectory(name, values))
            };
            RolloutRow {
                label: format!("start {}", number + 1),
                truth: trajectory("recorded", truth),
                rollouts: models.iter().map(rollout).collect(),
            }
        })
        .collect();
    (!rows.is_empty()).then(|| RolloutGrid {
        sensor: first.sensor.clone(),
        unit: None,
        models: models.iter().map(|(name, _)| (*name).to_owned()).collect(),
        rows,
    })
}

/// The rows of one rollout in the table of trajectories.
struct Group {
    member: u32,
    /// The row that was asked for as the start.
    wanted: u32,
    rows: std::ops::Range<usize>,
}

fn groups(trajectories: &Table) -> anyhow::Result<Vec<Group>> {
    let members = trajectories.column::<u32>("member")?;
    let numbers = trajectories.column::<u32>("rollout")?;
    let wanted = trajectories.column::<u32>("wanted_row")?;
    let mut groups = Vec::new();
    let mut first = 0;
    for next in 1..=members.len() {
        let ends = next == members.len()
            || (members[next], numbers[next]) != (members[first], numbers[first]);
        if ends {
            let (member, wanted) = (members[first], wanted[first]);
            groups.push(Group { member, wanted, rows: first..next });
            first = next;
        }
    }
    Ok(groups)
}
