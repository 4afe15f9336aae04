//! How long the values of each channel stay valid, if `data.resample` puts them on one clock.

use calib_core::Period;

use super::{entries::Entries, plant_log::Channel};
use crate::{DataConfig, DataError, MaxAge};

/// Returns how long a recorded value of each channel stays valid, in microseconds.
///
/// # Errors
/// If an entry of `data.max_age_secs` names no channel, or two entries disagree about a channel.
pub(super) fn max_ages(
    channels: &[Channel],
    data: &DataConfig,
    period: Period,
) -> Result<Vec<i64>, DataError> {
    let given = data.max_age_secs.as_ref().map_or_else(Vec::new, MaxAge::entries);
    let entries = Entries::new(given);
    if let Some((entry, reason)) = entries.unused(channels.iter().flat_map(Channel::names)) {
        return Err(DataError::max_age(entry, reason));
    }
    let all = data.max_age(period);
    channels
        .iter()
        .map(|channel| -> Result<i64, DataError> {
            let secs = entries.number(&channel.names()).map_err(|[first, other]| {
                let name = &channel.name;
                let reason = format!(
                    "values of {name} hold for {} s by this entry and for {} s by {:?}; give {name} an entry of its own",
                    first.number, other.number, other.written
                );
                DataError::max_age(first.written, reason)
            })?;
            let own = secs.and_then(Period::from_secs);
            Ok(own.map_or(all, Period::as_micros))
        })
        .collect()
}
