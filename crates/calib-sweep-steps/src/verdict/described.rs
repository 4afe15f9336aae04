//! Labels and units of sensors.

use std::collections::BTreeMap;

use calib_base::{Context as _, StepError};
use calib_data::{Description, Profile, read_tags};
use calib_report::Report;
use calib_study::Job;

/// The description of each channel: from `[sensors]` in the study, then from the list of tags, then from the header of
/// the log.
#[derive(Clone, Debug, Default)]
pub struct Descriptions(BTreeMap<String, Description>);

impl Descriptions {
    /// Returns the descriptions of a log's channels.
    ///
    /// # Errors
    /// Returns an error if the list of tags cannot be read.
    pub fn of(job: &Job, profile: &Profile) -> Result<Self, StepError> {
        let study = job.study();
        let tags = match &study.evaluate.tags {
            Some(path) => {
                let path = job.beside(path);
                read_tags(&path).with_context(|| format!("evaluate.tags = {}", path.display()))?
            }
            None => BTreeMap::new(),
        };
        let nothing = Description::default();
        let described = profile.channels.iter().map(|channel| {
            let given = study.sensors.get(&channel.name).cloned().unwrap_or_default();
            // A list of tags has the angle, but not the two channels that are made of it.
            let tag = tags.get(&channel.name).cloned().or_else(|| {
                let angle = channel.angle.as_ref()?;
                Some(angle.described(tags.get(&angle.channel)?))
            });
            let given = given.or(tag.as_ref().unwrap_or(&nothing));
            (channel.name.clone(), given.or(&channel.description))
        });
        Ok(Self(described.filter(|(_, description)| !description.is_empty()).collect()))
    }

    /// Returns the descriptions in the header of a log.
    pub fn of_log(profile: &Profile) -> Self {
        let all = profile
            .channels
            .iter()
            .map(|channel| (channel.name.clone(), channel.description.clone()));
        Self(all.filter(|(_, description)| !description.is_empty()).collect())
    }

    /// Returns the words in brackets after the name of a sensor: its label and its unit.
    pub fn words(&self, sensor: &str) -> Option<String> {
        let Description { unit, label } = self.0.get(sensor)?;
        match (label, unit) {
            (Some(label), Some(unit)) => Some(format!("{label}, {unit}")),
            (one, other) => one.clone().or_else(|| other.clone()),
        }
    }

    /// Adds the descriptions to the figures and the table of channels in a report on one model and deployment.
    pub(crate) fn put_into(&self, report: &mut Report) {
        for figure in &mut report.recorded {
            figure.unit = self.words(&figure.sensor);
        }
        for figure in &mut report.rollouts {
            figure.unit = self.words(&figure.sensor);
        }
        for channel in report.data.iter_mut().flat_map(|data| &mut data.channels) {
            channel.unit = self.words(&channel.name);
        }
    }
}

/// Returns the names in `[sensors]` that the log does not have.
pub fn unknown<'a>(sensors: &'a BTreeMap<String, Description>, profile: &Profile) -> Vec<&'a str> {
    let names = sensors.keys().map(String::as_str);
    names.filter(|name| profile.channels.iter().all(|channel| channel.name != *name)).collect()
}
