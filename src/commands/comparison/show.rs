//! The comparison for people: on the terminal and in the report.

use calib_report::{Best, Cell, Table};
use calib_stats::{Direction, Interval, Summary};

use super::{Against, Comparison, MEASURES, SensorComparison};
use crate::{
    cli::STEP_PATTERNS,
    output::{Printer, count, significant, table},
};

/// Sensors that the terminal shows.
const LISTED: usize = 12;

/// Print means over rollouts: warping distances, then the other measures.
pub(in crate::commands) fn show(comparison: &Comparison, printer: &Printer) -> anyhow::Result<()> {
    for (number, why) in left_out(comparison) {
        let all = comparison.rollouts + comparison.left_out + comparison.ended_early;
        printer.result(&format!("  {number} of {all} rollouts not compared: {why}"))?;
    }
    if comparison.sensors.is_empty() {
        return Ok(());
    }
    printer.result("")?;
    printer.result(&format!("rollouts against what was recorded, {}:", basis(comparison)))?;
    printer.result("normalised warping distance")?;
    let header = [&["sensor"], STEP_PATTERNS.as_slice()].concat();
    let warping = |sensor: &SensorComparison| {
        let of = sensor.dtw.iter().map(|of| of.normalized_distance.as_ref().or(Some(&of.distance)));
        of.map(mean_and_half).collect::<Vec<_>>()
    };
    list(comparison, &header, warping, printer)?;
    printer.result("other distances")?;
    let header = ["sensor", "values", "changes", "autocorr.", "spectrum (dB)", "edit"];
    let others = |sensor: &SensorComparison| {
        let of = sensor.measures.iter().map(|of| of.value.as_ref());
        of.map(mean_and_half).collect::<Vec<_>>()
    };
    list(comparison, &header, others, printer)
}

/// How many rollouts were left out for each reason there is.
fn left_out(comparison: &Comparison) -> impl Iterator<Item = (usize, &'static str)> {
    let reasons = [
        (comparison.left_out, "what was recorded after their start ends too soon"),
        (comparison.ended_early, "they ended before the steps to compare did"),
    ];
    reasons.into_iter().filter(|(number, _)| *number > 0)
}

fn list(
    comparison: &Comparison,
    header: &[&str],
    cells: impl Fn(&SensorComparison) -> Vec<String>,
    printer: &Printer,
) -> anyhow::Result<()> {
    let row = |sensor: &SensorComparison| [vec![sensor.sensor.clone()], cells(sensor)].concat();
    let rows: Vec<Vec<String>> = comparison.sensors.iter().take(LISTED).map(row).collect();
    printer.result(&table(header, &rows))?;
    let more = comparison.sensors.len().saturating_sub(LISTED);
    if more > 0 {
        printer.result(&format!("… and {} more in the files", count(more)))?;
    }
    Ok(())
}

/// What the means are over.
fn basis(comparison: &Comparison) -> String {
    let Comparison { rollouts, fewest_steps: fewest, most_steps: most, against, .. } = comparison;
    let against = match against {
        Against::Model => "",
        Against::Deployment => ", against the deployment",
    };
    let steps = if fewest == most {
        count(*most)
    } else {
        format!("{} to {}", count(*fewest), count(*most))
    };
    format!("mean ± 95 % interval over {rollouts} rollouts of {steps} steps{against}")
}

fn half_width(summary: &Summary) -> Option<f64> {
    summary.interval.map(|Interval { low, high }| (high - low) / 2.0)
}

fn mean_and_half(summary: Option<&Summary>) -> String {
    let Some(summary) = summary else { return "–".to_owned() };
    let half = half_width(summary).map(|half| format!(" ± {}", significant(half)));
    format!("{}{}", significant(summary.mean), half.unwrap_or_default())
}

/// Tables for the report: for each model its means, the best of a row in bold where there are several.
pub(in crate::commands) fn report_tables(models: &[(&str, &Comparison)]) -> Vec<Table> {
    // A model of which nothing could be compared has empty columns beside those of others.
    let Some((_, first)) = models.iter().find(|(_, of)| !of.sensors.is_empty()) else {
        return Vec::new();
    };
    let several = models.len() > 1;
    let mut sentences = Vec::new();
    for (name, of) in models {
        let whose = if several { format!(" of {name}") } else { String::new() };
        for (number, why) in left_out(of) {
            sentences.push(format!(" {number} rollouts{whose} are left out: {why}."));
        }
    }
    let left_out = sentences.concat();
    let basis = if several {
        let of_each = models.iter().filter(|(_, of)| !of.sensors.is_empty());
        let of_each = of_each.map(|(name, of)| format!("{name}: {}", basis(of)));
        of_each.collect::<Vec<_>>().join("; ")
    } else {
        basis(first)
    };
    let columns = |leading: &[&str]| {
        let models = models.iter().flat_map(|(name, _)| [(*name).to_owned(), "95 %".to_owned()]);
        leading.iter().map(|&name| name.to_owned()).chain(models).collect::<Vec<String>>()
    };
    // A model that is held to its own past has an easier task than one that is held to a deployment.
    let alike = models.iter().all(|(_, of)| of.sensors.is_empty() || of.against == first.against);
    let best = (several && alike).then_some(Best::OfRow(Direction::LowerIsBetter));
    let unlike = if alike { "" } else { " Models are held to different records: none is best." };
    let unequal = if models.iter().all(|(_, of)| of.fewest_steps == of.most_steps) {
        ""
    } else {
        " Raw distances grow with the number of steps."
    };
    let of_models = |name: &str, of: &dyn Fn(&SensorComparison) -> Option<&Summary>| {
        let own = |of: &'_ &Comparison| of.sensors.iter().position(|of| of.sensor == name);
        let sensors = models.iter().map(|(_, of)| own(of).map(|place| &of.sensors[place]));
        sensors.flat_map(|sensor| cells(sensor.and_then(of))).collect::<Vec<Cell>>()
    };
    let (mut warping, mut others) = (Vec::new(), Vec::new());
    for sensor in &first.sensors {
        let name = Cell::Text(sensor.sensor.clone());
        for (position, pattern) in STEP_PATTERNS.iter().enumerate() {
            let row = |kind: &str, of: &dyn Fn(&SensorComparison) -> Option<&Summary>| {
                let leading =
                    [name.clone(), Cell::Text((*pattern).to_owned()), Cell::Text(kind.to_owned())];
                [leading.to_vec(), of_models(&sensor.sensor, of)].concat()
            };
            warping.push(row("normalised", &|sensor| {
                sensor.dtw.get(position)?.normalized_distance.as_ref()
            }));
            warping.push(row("raw", &|sensor| Some(&sensor.dtw.get(position)?.distance)));
        }
        for (position, measure) in MEASURES.iter().enumerate() {
            let leading = vec![name.clone(), Cell::Text(measure.label.to_owned())];
            let values =
                of_models(&sensor.sensor, &|sensor| sensor.measures.get(position)?.value.as_ref());
            others.push([leading, values].concat());
        }
    }
    let caption = |how: &str| {
        format!(
            "Rollouts against what was recorded after the same start (or the state of the deployment that it stands \
             for), on the normalised sensor: {basis}. {how}{unlike}{unequal}{left_out}"
        )
    };
    vec![
        Table {
            title: "Dynamic time warping".to_owned(),
            caption: caption(
                "Lower is better. Compare models within a row, not step patterns with each other.",
            ),
            columns: columns(&["sensor", "step pattern", "distance"]),
            rows: warping,
            best,
        },
        Table {
            title: "Other distances of trajectories".to_owned(),
            caption: caption(
                "Lower is better. They compare distributions, memory and frequencies, so a rollout may be out of step and still score well.",
            ),
            columns: columns(&["sensor", "distance"]),
            rows: others,
            best,
        },
    ]
}

fn cells(summary: Option<&Summary>) -> [Cell; 2] {
    let Some(summary) = summary else { return [Cell::Missing, Cell::Missing] };
    let half = half_width(summary);
    let half = half.map_or(Cell::Missing, |half| Cell::Text(format!("± {}", significant(half))));
    [Cell::Number(summary.mean), half]
}
