//! Learning curves of several models and deployments.

use calib_report::{LearningCurves, LearningEnvironment};
use calib_study::Study;

use crate::verdict::judged_model::JudgedModel;

/// Returns the curves of several models. Runs that all models share come from the first model. With several
/// deployments the report shows Online only, and each deployment's own report shows the curves of members.
pub(crate) fn of_several(
    study: &Study,
    parts: &[JudgedModel],
    deployments: &[Vec<&JudgedModel>],
) -> Vec<LearningCurves> {
    study
        .sweep
        .sensors
        .iter()
        .flat_map(|sensor| -> Vec<LearningCurves> {
            if deployments.len() == 1 {
                let all = parts.iter().enumerate().flat_map(|(number, part)| {
                    let own = part.report.learning.iter();
                    own.filter(move |curves| number == 0 || !curves.environment.is_shared())
                });
                return all.filter(|curves| curves.sensor == *sensor).cloned().collect();
            }
            let online = deployments.iter().flat_map(|group| {
                let own = group[0].report.learning.iter();
                let own = own.filter(|curves| {
                    curves.sensor == *sensor && curves.environment == LearningEnvironment::Online
                });
                own.map(|curves| LearningCurves {
                    sensor: group[0].in_deployment(sensor),
                    ..curves.clone()
                })
                .collect::<Vec<_>>()
            });
            online.collect()
        })
        .collect()
}
