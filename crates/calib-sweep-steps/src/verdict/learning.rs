//! Learning curves of a sweep, summarised over runs.

use std::collections::BTreeMap;

use calib_base::StepError;
use calib_report::{LearningCurve, LearningCurves, LearningEnvironment};
use calib_stats::{Summary, summarise};
use calib_study::Job;
use calib_sweep::{Candidate, EnvironmentId, RunRow, UnitResult};

use crate::verdict::verdict_rows::{field, setting};

/// Returns one figure per sensor and environment: Online first, then the members.
pub(crate) fn curves(
    job: &Job,
    candidates: &[Candidate],
    results: &[UnitResult],
) -> Result<Vec<LearningCurves>, StepError> {
    let mut environments: Vec<EnvironmentId> =
        results.iter().map(|result| result.unit.environment).collect();
    environments
        .sort_unstable_by_key(|&environment| (environment != EnvironmentId::Online, environment));
    environments.dedup();
    let mut figures = Vec::new();
    for sensor in &job.study().sweep.sensors {
        for &environment in &environments {
            let rows: Vec<&RunRow> = results
                .iter()
                .filter(|result| {
                    result.unit.sensor == *sensor && result.unit.environment == environment
                })
                .flat_map(|result| &result.rows)
                .collect();
            let mut curves = Vec::new();
            for candidate in candidates {
                let runs: Vec<&RunRow> =
                    rows.iter().copied().filter(|row| row.candidate == candidate.index).collect();
                curves.push(LearningCurve {
                    value: setting(candidate),
                    points: points(&runs, &rows)?,
                });
            }
            let figure = LearningCurves {
                sensor: sensor.clone(),
                field: field(candidates),
                environment: shown(environment, job.model()),
                steps: rows.iter().map(|row| row.steps).max().unwrap_or(0),
                curves,
            };
            if figure.curves.iter().any(|curve| !curve.points.is_empty()) {
                figures.push(figure);
            }
        }
    }
    Ok(figures)
}

/// Returns an environment as the report shows it. `model` is the name of the model, if there are several.
fn shown(environment: EnvironmentId, model: Option<&str>) -> LearningEnvironment {
    match environment {
        EnvironmentId::Online => LearningEnvironment::Online,
        EnvironmentId::Member(number) => {
            LearningEnvironment::Member { number, model: model.map(str::to_owned) }
        }
        EnvironmentId::LogReplay => LearningEnvironment::LogReplay,
    }
}

/// Returns the points of one setting over its `runs`. A diverged run has an infinite error at all later steps. The
/// curves of `all` runs in the same environment show at which steps.
fn points(runs: &[&RunRow], all: &[&RunRow]) -> Result<Vec<(usize, Summary)>, StepError> {
    let mut steps: Vec<usize> =
        all.iter().flat_map(|row| &row.curve).map(|point| point.step).collect();
    steps.sort_unstable();
    steps.dedup();
    let errors: Vec<(BTreeMap<usize, f64>, usize)> = runs
        .iter()
        .map(|row| {
            let curve = row.curve.iter().map(|point| (point.step, point.rmse)).collect();
            (curve, row.diverged_at.unwrap_or(usize::MAX))
        })
        .collect();
    let mut points = Vec::with_capacity(steps.len());
    for step in steps {
        let known: Vec<f64> = errors
            .iter()
            .filter_map(|(curve, diverged): &(BTreeMap<usize, f64>, usize)| {
                curve.get(&step).copied().or((step > *diverged).then_some(f64::INFINITY))
            })
            .collect();
        if !known.is_empty() {
            points.push((step, summarise(&known)?));
        }
    }
    Ok(points)
}

#[cfg(test)]
mod tests {
    use calib_agent::Scores;
    use calib_sweep::CurvePoint;

    use super::*;

    fn run(curve: &[(usize, f64)], diverged_at: Option<usize>) -> RunRow {
        RunRow {
            candidate: 0,
            steps: 30,
            updates: 1,
            scores: Scores::default(),
            diverged_at,
            curve: curve.iter().map(|&(step, rmse)| CurvePoint { step, rmse }).collect(),
        }
    }

    #[test]
    fn runs_are_averaged_step_by_step_and_one_that_diverges_makes_the_rest_infinite() {
        let first = run(&[(10, 3.0), (20, 1.0), (30, 1.0)], None);
        let second = run(&[(10, 5.0)], Some(14));
        let other = run(&[(10, 1.0), (20, 1.0), (30, 1.0)], None);
        let all = [&first, &second, &other];
        let points = points(&[&first, &second], &all).expect("summarised");
        let told: Vec<_> = points
            .iter()
            .map(|(step, point)| (*step, point.mean, point.runs, point.diverged))
            .collect();
        let infinite = f64::INFINITY;
        assert_eq!(told, [(10, 4.0, 2, 0), (20, infinite, 2, 1), (30, infinite, 2, 1)]);
        let lost = super::points(&[&second], &all).expect("summarised");
        assert_eq!(lost.len(), 3, "the curve goes on where others do");
        assert!(super::points(&[], &all).expect("none").is_empty());
    }
}
