//! Converts a column of modes to one 0/1 column per mode.

use std::{cmp::Ordering, collections::HashMap};

use calib_core::Monitor;

use crate::{
    DataError, Missing, PreprocessConfig, angle_hint,
    impute::impute,
    log::{Codes, Log},
    similar_names::hint,
};

/// Maximum number of distinct values that count as modes.
const MODES: usize = 64;

/// The mode of every row of the log.
pub(crate) struct Modes {
    pub(crate) channel: usize,
    /// The modes of the training range: first numbers in order, then text in order.
    pub(crate) labels: Vec<String>,
    /// Position in `labels` of every row's mode. Modes that do not occur in the training range are
    /// past the end; NaN is a missing mode.
    pub(crate) positions: Vec<f64>,
    /// Number of missing modes that were filled.
    pub(crate) imputed: u64,
    /// Rows whose mode is still missing.
    pub(crate) left: Vec<usize>,
}

impl Modes {
    /// Reads the channel that `preprocess.one_hot` names.
    pub(crate) fn read(
        log: &Log,
        preprocess: &PreprocessConfig,
        monitor: &dyn Monitor,
    ) -> Result<Option<Self>, DataError> {
        let Some(name) = &preprocess.one_hot else {
            return Ok(None);
        };
        let channel = log.channels.iter().position(|channel| channel.name == *name);
        let channel = channel.ok_or_else(|| {
            let names = log.channels.iter().map(|channel| channel.name.as_str());
            let angles = log.channels.iter().filter_map(|channel| channel.angle.as_ref());
            let hint = angle_hint(name, angles).unwrap_or_else(|| hint(name, names));
            DataError::one_hot(name, format!("it is not a channel of the log{hint}"))
        })?;
        if let Some(angle) = &log.channels[channel].angle {
            let angle = &angle.channel;
            let reason = format!(
                "it is of the angle {angle}, which has no modes; take {angle} out of data.angles, or name another channel"
            );
            return Err(DataError::one_hot(name, reason));
        }
        if !log.channels[channel].readable {
            let got = &log.channels[channel].type_name;
            let reason = format!("it is of type {got}, expected numbers or text");
            return Err(DataError::one_hot(name, reason));
        }
        let Codes { codes, labels } = log.read_codes(channel, monitor)?;
        let mut occurs = vec![false; labels.len()];
        for code in codes[log.train.clone()].iter().filter(|code| !code.is_nan()) {
            occurs[*code as usize] = true;
        }
        let mut modes: Vec<usize> = (0..labels.len()).filter(|&code| occurs[code]).collect();
        if modes.is_empty() || modes.len() > MODES {
            let reason = format!(
                "it has {} values in the training range, expected modes: 1 to {MODES}",
                modes.len()
            );
            return Err(DataError::one_hot(name, reason));
        }
        modes.sort_by(|&left, &right| by_value(&labels[left], &labels[right]));
        let positions: HashMap<usize, usize> =
            modes.iter().enumerate().map(|(position, &code)| (code, position)).collect();
        let mut positions: Vec<f64> = codes
            .into_iter()
            .map(|code| {
                if code.is_nan() {
                    code
                } else {
                    positions.get(&(code as usize)).map_or(modes.len(), |&position| position) as f64
                }
            })
            .collect();
        // Modes cannot be interpolated.
        let missing = match preprocess.missing {
            Missing::DropRow => Missing::DropRow,
            Missing::ForwardFill | Missing::Linear => Missing::ForwardFill,
        };
        let mut left = Vec::new();
        let imputed = impute(
            &mut positions,
            &log.rows.timestamps,
            &log.stretches(),
            missing,
            preprocess.fill_limit,
            |row| left.push(row),
        );
        Ok(Some(Self {
            channel,
            labels: modes.into_iter().map(|code| labels[code].clone()).collect(),
            positions,
            imputed,
            left,
        }))
    }

    /// Returns the names of the columns for the channel called `name`.
    pub(crate) fn columns(&self, name: &str) -> impl Iterator<Item = String> {
        self.labels.iter().map(move |label| format!("{name}={label}"))
    }

    /// Returns 1 for rows with mode number `mode`, and 0 for other rows.
    pub(crate) fn one_hot(&self, mode: usize) -> Vec<f64> {
        let positions = self.positions.iter();
        positions.map(|&position| f64::from(u8::from(position == mode as f64))).collect()
    }

    /// Whether the mode of `row` does not occur in the training range.
    pub(crate) fn is_unseen(&self, row: usize) -> bool {
        self.positions[row] >= self.labels.len() as f64
    }
}

fn by_value(left: &str, right: &str) -> Ordering {
    match (left.parse::<f64>(), right.parse::<f64>()) {
        (Ok(left), Ok(right)) => left.total_cmp(&right),
        (Ok(_), Err(_)) => Ordering::Less,
        (Err(_), Ok(_)) => Ordering::Greater,
        (Err(_), Err(_)) => left.cmp(right),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modes_are_in_order_of_value() {
        let mut labels = ["standby", "31", "4", "backwash", "13"];
        labels.sort_by(|left, right| by_value(left, right));
        assert_eq!(labels, ["4", "13", "31", "backwash", "standby"]);
    }
}
