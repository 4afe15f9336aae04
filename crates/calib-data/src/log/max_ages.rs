//! How long the values of each channel hold, where `data.resample` puts them on one clock.

use std::slice::from_ref;

use calib_core::Period;

use super::Channel;
use crate::{
    DataConfig, DataError, MaxAge,
    names::{Names, hint},
};

/// An entry of `data.max_age_secs`.
struct Entry<'a> {
    written: &'a String,
    names: Names<'a>,
    secs: f64,
}

/// How long a recorded value of each channel stands for what follows it, in microseconds.
///
/// # Errors
/// If an entry of `data.max_age_secs` names no channel, or two of them disagree about one.
pub(super) fn max_ages(
    channels: &[Channel],
    data: &DataConfig,
    period: Period,
) -> Result<Vec<i64>, DataError> {
    let given = data.max_age_secs.as_ref().map_or_else(Vec::new, MaxAge::entries);
    let (written, secs): (Vec<String>, Vec<f64>) =
        given.into_iter().map(|(entry, secs)| (entry.to_owned(), secs)).unzip();
    let names = channels.iter().flat_map(Channel::names);
    if let Some(&entry) = Names::new(&written).unused(&names).first() {
        let reason = format!("it names no channel{}", hint(entry, names));
        return Err(DataError::max_age(entry, reason));
    }
    let entries: Vec<Entry<'_>> = written
        .iter()
        .zip(secs)
        .map(|(written, secs)| Entry { written, names: Names::new(from_ref(written)), secs })
        .collect();
    let all = data.max_age(period);
    channels
        .iter()
        .map(|channel| -> Result<i64, DataError> {
            let secs = own_secs(channel, &entries)?;
            let own = secs.and_then(Period::from_secs);
            Ok(own.map_or(all, Period::as_micros))
        })
        .collect()
}

/// What the entries say of a channel, if one names it. An entry that is its name decides; else all patterns that match it have to agree.
fn own_secs(channel: &Channel, entries: &[Entry<'_>]) -> Result<Option<f64>, DataError> {
    let mut names = channel.names();
    if let Some(own) = names.find_map(|name| entries.iter().find(|entry| entry.written == name)) {
        return Ok(Some(own.secs));
    }
    let mut matching =
        entries.iter().filter(|entry| entry.names.matching_any(channel.names()).is_some());
    let Some(first) = matching.next() else { return Ok(None) };
    if let Some(other) = matching.find(|other| other.secs != first.secs) {
        let name = &channel.name;
        let reason = format!(
            "values of {name} hold for {} s by this entry and for {} s by {:?}; give {name} an entry of its own",
            first.secs, other.secs, other.written
        );
        return Err(DataError::max_age(first.written, reason));
    }
    Ok(Some(first.secs))
}
