//! The rollouts of several deployments, taken together.

use calib_stats::{Summary, pooled};

use super::{Comparison, MeasureSummary, PatternSummary, SensorComparison};

/// As if all rollouts had been compared at once; nothing where there are none.
pub(in crate::commands) fn pool(all: &[Comparison]) -> Option<Comparison> {
    let first = all.iter().find(|of| !of.sensors.is_empty())?;
    let known = || all.iter().filter(|of| !of.sensors.is_empty());
    let sum = |of: fn(&Comparison) -> usize| all.iter().map(of).sum();
    let sensors = first.sensors.iter().map(|sensor| {
        let own = known().filter_map(|of| of.sensors.iter().find(|of| of.sensor == sensor.sensor));
        sensor_of(sensor, &own.collect::<Vec<_>>())
    });
    Some(Comparison {
        rollouts: sum(|of| of.rollouts),
        left_out: sum(|of| of.left_out),
        ended_early: sum(|of| of.ended_early),
        fewest_steps: known().map(|of| of.fewest_steps).min()?,
        most_steps: known().map(|of| of.most_steps).max()?,
        against: first.against,
        sensors: sensors.collect::<Option<_>>()?,
    })
}

fn sensor_of(first: &SensorComparison, all: &[&SensorComparison]) -> Option<SensorComparison> {
    let dtw = first.dtw.iter().enumerate().map(|(place, pattern)| {
        let own = |of: fn(&PatternSummary) -> Option<Summary>| -> Option<Vec<Summary>> {
            all.iter().map(|sensor| of(sensor.dtw.get(place)?)).collect()
        };
        Some(PatternSummary {
            step_pattern: pattern.step_pattern.clone(),
            distance: pooled(&own(|of| Some(of.distance))?)?,
            normalized_distance: own(|of| of.normalized_distance).and_then(|all| pooled(&all)),
        })
    });
    let measures = first.measures.iter().enumerate().map(|(place, measure)| {
        let own: Vec<Summary> =
            all.iter().filter_map(|sensor| sensor.measures.get(place)?.value).collect();
        MeasureSummary { measure: measure.measure.clone(), value: pooled(&own) }
    });
    Some(SensorComparison {
        sensor: first.sensor.clone(),
        dtw: dtw.collect::<Option<_>>()?,
        measures: measures.collect(),
    })
}
