//! The comparison on the terminal.

use calib_base::{
    StepError,
    output::{Printer, count, number, table},
};
use calib_stats::{ClusterSummary, Interval};

use super::{Against, Comparison, PairedModels, SensorComparison};
use crate::STEP_PATTERNS;

/// Maximum number of sensors that the terminal shows.
const LISTED: usize = 12;

/// Prints means over rollouts: warping distances, then the other measures.
pub(crate) fn show(comparison: &Comparison, printer: &Printer) -> Result<(), StepError> {
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
    list(
        comparison,
        &header,
        |sensor: &SensorComparison| {
            let normalised = sensor
                .dtw
                .iter()
                .map(|pattern| pattern.normalized_distance.as_ref().or(Some(&pattern.distance)));
            normalised.map(summary_text).collect::<Vec<_>>()
        },
        printer,
    )?;
    printer.result("other distances")?;
    let header = ["sensor", "values", "changes", "autocorr.", "spectrum (dB)", "edit"];
    list(
        comparison,
        &header,
        |sensor: &SensorComparison| {
            let values = sensor.measures.iter().map(|measure| measure.value.as_ref());
            values.map(summary_text).collect::<Vec<_>>()
        },
        printer,
    )
}

/// Returns how many rollouts were left out, for each reason that occurs.
pub(super) fn left_out(comparison: &Comparison) -> impl Iterator<Item = (usize, &'static str)> {
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
) -> Result<(), StepError> {
    let rows: Vec<Vec<String>> = comparison
        .sensors
        .iter()
        .take(LISTED)
        .map(|sensor| [vec![sensor.sensor.clone()], cells(sensor)].concat())
        .collect();
    printer.lines(&table(header, &rows))?;
    let more = comparison.sensors.len().saturating_sub(LISTED);
    if more > 0 {
        printer.result(&format!("… and {} more in the files", count(more)))?;
    }
    Ok(())
}

/// Returns a text on the data over which means are taken.
pub(super) fn basis(comparison: &Comparison) -> String {
    let Comparison { rollouts, start_states, fewest_steps: fewest, most_steps: most, .. } =
        comparison;
    let against = match comparison.against {
        Against::Model => "",
        Against::Deployment => ", against the deployment",
    };
    let steps = if fewest == most {
        count(*most)
    } else {
        format!("{} to {}", count(*fewest), count(*most))
    };
    let starts = match start_states {
        1 => "1 start state, too few for an interval".to_owned(),
        many => format!("{} start states", count(*many)),
    };
    let overlapping = match comparison.overlapping {
        0 => String::new(),
        number => format!(
            " ({} of which share recorded steps with others, so that the interval may be too narrow)",
            count(number)
        ),
    };
    format!(
        "mean ± 95 % interval over {rollouts} rollouts of {steps} steps from {starts}{overlapping}{against}"
    )
}

/// Formats half the width of an interval around a mean.
pub(super) fn plus_minus(interval: Interval) -> String {
    format!("± {}", number((interval.high - interval.low) / 2.0))
}

/// Formats a mean, with half the width of its interval if there is one.
pub(super) fn mean_and_half(mean: f64, interval: Option<Interval>) -> String {
    let half = interval.map(|interval| format!(" {}", plus_minus(interval)));
    format!("{}{}", number(mean), half.unwrap_or_default())
}

fn summary_text(summary: Option<&ClusterSummary>) -> String {
    summary.map_or_else(|| "–".to_owned(), |told| mean_and_half(told.mean, told.interval))
}

/// Prints every two models by their warping distance with the first step pattern, sensor by sensor; nothing without two
/// models.
///
/// # Errors
/// If they cannot be passed on.
pub fn show_pairs(pairs: &[&PairedModels], printer: &Printer) -> Result<(), StepError> {
    let mut rows = Vec::new();
    for place in 0..LISTED {
        for PairedModels { models: [one, other], sensors } in pairs {
            let Some(sensor) = sensors.get(place) else { continue };
            let pattern = sensor.dtw.first();
            let known =
                pattern.and_then(|pattern| pattern.normalized_distance.or(pattern.distance));
            let Some(difference) = known else { continue };
            let mean = mean_and_half(difference.mean, difference.interval);
            let nearer = difference.smaller.map(|[one, other]| format!("{one} : {other}"));
            let nearer = nearer.unwrap_or_else(|| "–".to_owned());
            rows.push(vec![sensor.sensor.clone(), format!("{one} − {other}"), mean, nearer]);
        }
    }
    if rows.is_empty() {
        return Ok(());
    }
    printer.result(
        "models two by two: warping distance of the first minus that of the second, by start state",
    )?;
    printer.lines(&table(&["sensor", "models", "mean ± 95 %", "starts nearer"], &rows))
}
