//! Checks the memory that a log needs before it is read.

use crate::{DataConfig, DataError};

/// Per row: the timestamp, at least two channels that are read together, and flags. Resampled channels are held both as
/// recorded and on the new clock.
const BYTES_PER_ROW: u64 = 8 + 2 * 8 + 2;
const BYTES_PER_RESAMPLED_ROW: u64 = BYTES_PER_ROW + 2 * 8;
/// Per sample of a channel that is read: its time and its cell, both as found and in order, and its value.
const BYTES_PER_SAMPLE: u64 = 2 * (8 + 8) + 8;
/// Per channel: its name and key, samples that wait to be written, and its description.
const BYTES_PER_CHANNEL: u64 = 2 << 10;

/// Available memory, in bytes; `None` if it is unknown.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct MemoryLimit(Option<u64>);

impl MemoryLimit {
    pub(crate) fn of(data: &DataConfig) -> Self {
        Self(data.memory)
    }

    /// Returns an error if `what` needs more memory than is available: it needs at least `needed` bytes, and `remedy`
    /// reduces the need.
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

    /// Rejects a log of more rows than can be indexed or held. `every_secs` is their distance, if the study sets it.
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

    /// Rejects a channel whose samples do not fit into memory.
    pub(crate) fn require_samples(self, samples: u64, channel: &str) -> Result<(), DataError> {
        self.require(
            samples.saturating_mul(BYTES_PER_SAMPLE),
            || format!("reading the {samples} samples of channel {channel}"),
            "choose fewer files with data.path",
        )
    }

    /// Rejects a log whose channels do not fit into memory.
    pub(crate) fn require_channels(self, channels: usize) -> Result<(), DataError> {
        self.require(
            (channels as u64).saturating_mul(BYTES_PER_CHANNEL),
            || format!("a log of {channels} channels and more"),
            "choose fewer files with data.path",
        )
    }
}
