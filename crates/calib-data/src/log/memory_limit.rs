//! What of a log has to be in memory, told before it is.

use crate::{DataConfig, DataError};

/// Per row: the timestamp, two channels at least that are read together, and flags. Channels that are put on another clock are
/// held as they were recorded, and as they are on it.
const BYTES_PER_ROW: u64 = 8 + 2 * 8 + 2;
const BYTES_PER_RESAMPLED_ROW: u64 = BYTES_PER_ROW + 2 * 8;
/// Per sample of a channel that is read: its time and its cell, in order and as they were found, and its value.
const BYTES_PER_SAMPLE: u64 = 2 * (8 + 8) + 8;
/// Per channel: its name and key, what waits to be written, and what is told of it.
const BYTES_PER_CHANNEL: u64 = 2 << 10;

/// Memory that there is, in bytes; `None` where nobody knows.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct MemoryLimit(Option<u64>);

impl MemoryLimit {
    pub(crate) fn of(data: &DataConfig) -> Self {
        Self(data.memory)
    }

    /// Refuse what takes more memory than there is: `what` takes `needed` bytes at least, and `remedy` says what takes less.
    pub(crate) fn require(
        self,
        needed: u64,
        what: impl FnOnce() -> String,
        remedy: &'static str,
    ) -> Result<(), DataError> {
        match self.0 {
            Some(available) if needed > available => {
                Err(DataError::TooLarge { what: what(), needed, available, remedy })
            }
            _ => Ok(()),
        }
    }

    /// Refuse a log of more rows than can be indexed, or held. `every_secs` is how far apart they are if the study says.
    pub(crate) fn require_rows(self, rows: u64, every_secs: Option<f64>) -> Result<(), DataError> {
        let (each, remedy) = match every_secs {
            Some(_) => {
                (BYTES_PER_RESAMPLED_ROW, "raise data.period_secs, or lower data.max_age_secs")
            }
            None => (
                BYTES_PER_ROW,
                "choose fewer files with data.path, or fewer rows with data.train and data.held_out",
            ),
        };
        self.require(
            rows.saturating_mul(each),
            || match every_secs {
                Some(secs) => {
                    format!("a log of {rows} rows, one every {secs} s (data.period_secs),")
                }
                None => format!("a log of {rows} rows"),
            },
            remedy,
        )?;
        match u32::try_from(rows) {
            Ok(_) => Ok(()),
            Err(_) => Err(DataError::TooManyRows { rows, resampled: every_secs.is_some() }),
        }
    }

    /// Refuse a channel whose samples cannot be held.
    pub(crate) fn require_samples(self, samples: u64, channel: &str) -> Result<(), DataError> {
        self.require(
            samples.saturating_mul(BYTES_PER_SAMPLE),
            || format!("reading the {samples} samples of channel {channel}"),
            "choose fewer files with data.path",
        )
    }

    /// Refuse a log of more channels than can be held.
    pub(crate) fn require_channels(self, channels: usize) -> Result<(), DataError> {
        self.require(
            (channels as u64).saturating_mul(BYTES_PER_CHANNEL),
            || format!("a log of {channels} channels and more"),
            "choose fewer files with data.path",
        )
    }
}
