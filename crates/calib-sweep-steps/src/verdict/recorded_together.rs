//! Recorded values of a sensor, over all models and deployments of a study.

use calib_report::{PeriodUse, RecordedFigure, RecordedPeriod};

use crate::verdict::judged_model::JudgedModel;

/// Returns one figure per sensor for all parts of a study: the training periods of all models, and every deployment.
pub(crate) fn of_parts(
    sensors: &[String],
    deployments: &[Vec<&JudgedModel>],
) -> Vec<RecordedFigure> {
    fn own<'a>(part: &'a JudgedModel, sensor: &str) -> Option<&'a RecordedFigure> {
        part.report.recorded.iter().find(|figure| figure.sensor == sensor)
    }
    sensors
        .iter()
        .filter_map(|sensor| {
            let models = deployments.first()?.iter();
            let models = models.filter_map(|part| Some((part.model_name(), own(part, sensor)?)));
            let windows = deployments.iter().filter_map(|group| own(group[0], sensor));
            together(&models.collect::<Vec<_>>(), &windows.collect::<Vec<_>>())
        })
        .collect()
}

/// Merges figures of the same sensor in several models and deployments. Each training period of a model appears once,
/// in time order, followed by each deployment. A period that not all `models` share is named after those that do.
/// `deployments` are in time order.
fn together(
    models: &[(&str, &RecordedFigure)],
    deployments: &[&RecordedFigure],
) -> Option<RecordedFigure> {
    let (_, first) = models.first()?;
    let mut periods: Vec<(Vec<&str>, RecordedPeriod)> = Vec::new();
    for (model, figure) in models {
        for period in figure.periods.iter().filter(|period| is_learned(period)) {
            match periods.iter_mut().find(|(_, known)| known == period) {
                Some((names, _)) => names.push(model),
                None => periods.push((vec![model], period.clone())),
            }
        }
    }
    periods.sort_by(|(_, a), (_, b)| start(a).total_cmp(&start(b)));
    let learned = periods.into_iter().map(|(names, mut period)| {
        if names.len() != models.len() {
            period.name = format!("{} of {}", period.name, names.join(", "));
        }
        period
    });
    let held_out = deployments
        .iter()
        .flat_map(|figure| figure.periods.iter().filter(|period| !is_learned(period)));
    let periods = learned.chain(held_out.cloned()).collect();
    Some(RecordedFigure { periods, ..(*first).clone() })
}

fn is_learned(period: &RecordedPeriod) -> bool {
    period.used_for == PeriodUse::Learning
}

fn start(period: &RecordedPeriod) -> f64 {
    period.points.first().map_or(f64::NAN, |point| point.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figure(periods: &[(&str, PeriodUse, f64)]) -> RecordedFigure {
        let periods = periods
            .iter()
            .map(|&(name, used_for, first): &(&str, PeriodUse, f64)| RecordedPeriod {
                name: name.to_owned(),
                used_for,
                times: [first.to_string(), (first + 1.0).to_string()],
                points: vec![(first, 5.0), (first + 1.0, 6.0)],
            })
            .collect();
        RecordedFigure { sensor: "PIT300".to_owned(), unit: None, periods }
    }

    fn names(models: &[(&str, &RecordedFigure)], deployments: &[&RecordedFigure]) -> Vec<String> {
        let whole = together(models, deployments).expect("there are models");
        whole.periods.into_iter().map(|period| period.name).collect()
    }

    #[test]
    fn models_and_deployments_have_one_figure_together() {
        use PeriodUse::{Deployment, Learning};
        let year = figure(&[("training", Learning, 0.0), ("april", Deployment, 400.0)]);
        let week = figure(&[("training", Learning, 358.0), ("april", Deployment, 400.0)]);
        let july = figure(&[("training", Learning, 0.0), ("july", Deployment, 480.0)]);
        let both = [&year, &july];
        assert_eq!(
            names(&[("week", &week), ("year", &year)], &both),
            ["training of year", "training of week", "april", "july"]
        );
        assert_eq!(names(&[("knn", &year), ("nn", &year)], &both), ["training", "april", "july"]);
        assert_eq!(
            names(&[("a", &year), ("b", &year), ("c", &week)], &both)[..2],
            ["training of a, b", "training of c"]
        );
        assert_eq!(together(&[], &[]), None);
    }
}
