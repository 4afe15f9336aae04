//! Replaces each channel in `data.angles` by a channel of its sine and one of its cosine.

use std::{collections::HashSet, iter::once};

use super::{entries::Entries, plant_log::Channel};
use crate::{AngleOf, DataConfig, DataError, angle::AnglePart, names::Chosen};

/// Returns the channels of a log, in which each angle is two channels.
///
/// # Errors
/// If an entry of `data.angles` names no channel, two entries disagree about a channel, a new name is taken, or a
/// chosen angle is not numeric.
pub(super) fn with_angles(
    channels: Vec<Channel>,
    data: &DataConfig,
) -> Result<Vec<Channel>, DataError> {
    if data.angles.is_empty() {
        return Ok(channels);
    }
    let turns = Entries::new(data.angles.iter().map(|(entry, turn)| (entry, *turn)));
    let names = channels.iter().map(|channel| channel.name.as_str());
    if let Some((entry, reason)) = turns.unused(names) {
        return Err(DataError::angle(entry, reason));
    }
    let chosen = Chosen::of(data);
    let mut all: Vec<Channel> = Vec::with_capacity(channels.len());
    for channel in &channels {
        let name = channel.name.as_str();
        let turn = turns.number(&once(name)).map_err(|[first, other]| {
            let reason = format!(
                "{name} has a turn of {} by this entry and of {} by {:?}; give {name} an entry of its own",
                first.number, other.number, other.written
            );
            DataError::angle(first.written, reason)
        })?;
        let Some(turn) = turn else {
            all.push(channel.clone());
            continue;
        };
        let parts = channel.parts(turn);
        if !channel.readable && parts.iter().any(|part| chosen.has(&part.names())) {
            let reason = format!(
                "it is of type {}, expected numbers; write its angles as numbers, or leave the entry out",
                channel.type_name
            );
            return Err(DataError::angle(&channel.name, reason));
        }
        all.extend(parts);
    }
    refuse_taken(&all)?;
    Ok(all)
}

/// Rejects names that two channels would have.
fn refuse_taken(channels: &[Channel]) -> Result<(), DataError> {
    let recorded = channels.iter().filter(|channel| channel.angle.is_none());
    let mut taken: HashSet<&str> = recorded.map(|channel| channel.name.as_str()).collect();
    for channel in channels {
        if let Some(angle) = &channel.angle
            && !taken.insert(&channel.name)
        {
            let reason = format!(
                "its columns are called {} and {}, and the log has a channel {} already; leave the entry out if the log has them, or rename that channel",
                AnglePart::Sine.channel_of(&angle.channel),
                AnglePart::Cosine.channel_of(&angle.channel),
                channel.name
            );
            return Err(DataError::angle(&angle.channel, reason));
        }
    }
    Ok(())
}

impl Channel {
    /// Returns the sine and the cosine of the channel.
    fn parts(&self, turn: f64) -> [Self; 2] {
        AnglePart::ALL.map(|part| {
            let angle = AngleOf { channel: self.name.clone(), turn, part, recorded: None };
            Self {
                name: part.channel_of(&self.name),
                description: angle.described(&self.description),
                angle: Some(angle),
                ..self.clone()
            }
        })
    }

    /// Iterates over the names that entries of `data.include` and `data.exclude` may use for the channel: its own name,
    /// and the name of its angle in the files.
    pub(crate) fn names(&self) -> impl Iterator<Item = &str> + Clone {
        let angle = self.angle.as_ref().map(|angle| angle.channel.as_str());
        once(self.name.as_str()).chain(angle)
    }

    pub(crate) fn recorded_name(&self) -> &str {
        self.angle.as_ref().map_or(&self.name, |angle| &angle.channel)
    }
}
