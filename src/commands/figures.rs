//! Figures of a study, as files.

use std::{io::Write as _, path::Path};

use calib_data::table::Table;
use calib_files::{file_name, write_atomically};
use calib_report::{Figure, RolloutFigure, Trajectory};

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
