//! Columns as they were recorded, beside the states, such as actions and rewards.

use calib_core::Monitor;

use crate::{
    DataError, Surveyed, angle_hint,
    log::{Batch, Contradicting},
    similar_names::hint,
};

/// Maximum number of columns that an error lists.
const SHOWN: usize = 3;

/// Columns as they were recorded.
#[derive(Clone, Debug)]
pub struct RecordedColumns {
    /// Values in the training rows, `[names][rows]`, in the unit of the log; NaN where there is no number.
    pub values: Vec<Vec<f64>>,
    /// The same in the held-out rows. Without a held-out range there are no rows.
    pub held_out: Vec<Vec<f64>>,
    /// Text in the columns, one entry per column with text.
    pub texts: Vec<TextFound>,
}

/// Text in a column of numbers, which counts as missing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TextFound {
    /// Name of the column.
    pub column: String,
    /// The most frequent text.
    pub example: String,
    /// Number of rows with text in the whole log.
    pub rows: u64,
}

impl Surveyed {
    /// Returns the values of these channels as recorded, without treatment. The channels need not be columns of the
    /// states.
    ///
    /// # Errors
    /// If a channel does not exist or holds no numbers, or has two values at one time and the study does not select one
    /// of them. If rows are sub-sampled (an action belongs to one row), a file cannot be read, or the monitor
    /// interrupts.
    pub fn recorded(
        &self,
        names: &[String],
        monitor: &dyn Monitor,
    ) -> Result<RecordedColumns, DataError> {
        if self.preprocess.subsample != 1 {
            let got = self.preprocess.subsample.to_string();
            let expected = "1 where actions are read: an action belongs to its own row";
            return Err(DataError::config("preprocess.subsample".to_owned(), got, expected));
        }
        let log = &self.survey.log;
        let all = log.channels.iter().map(|channel| channel.name.as_str());
        let mut channels = Vec::with_capacity(names.len());
        for name in names {
            let found = log.channels.iter().position(|channel| channel.name == *name);
            let Some(channel) = found else {
                let angles = log.channels.iter().filter_map(|channel| channel.angle.as_ref());
                let mut hint = angle_hint(name, angles).unwrap_or_else(|| hint(name, all.clone()));
                if hint.is_empty() {
                    let some: Vec<&str> = all.clone().take(SHOWN).collect();
                    hint = format!("; give one of its columns, such as {}", some.join(", "));
                }
                return Err(DataError::NoSuchColumn { name: name.clone(), hint });
            };
            if !log.channels[channel].readable {
                let type_name = log.channels[channel].type_name.clone();
                return Err(DataError::NoNumbers { name: name.clone(), type_name });
            }
            channels.push(channel);
        }
        let train = &self.survey.train.samples.starts[..];
        let held_out = self.survey.held_out.as_ref();
        let held_out = held_out.map_or(&[][..], |part| &part.samples.starts[..]);
        let mut recorded =
            RecordedColumns { values: Vec::new(), held_out: Vec::new(), texts: Vec::new() };
        let mut batch = Batch::default();
        monitor.begin("reading actions and rewards", channels.len() as u64);
        let mut contradicting: Vec<(usize, Contradicting)> = Vec::new();
        for some in channels.chunks(log.batch_size()) {
            for (&number, channel) in some.iter().zip(log.read(some, &mut batch, monitor)?) {
                let name = &log.channels[number].name;
                if let Some(example) = channel.not_numbers.example() {
                    if channel.values.iter().all(|value| value.is_nan()) {
                        let type_name = format!("text, such as {example:?}");
                        return Err(DataError::NoNumbers { name: name.clone(), type_name });
                    }
                    let count = channel.not_numbers.words.values().sum();
                    recorded.texts.push(TextFound { column: name.clone(), example, rows: count });
                }
                contradicting.push((number, channel.contradictions.clone()));
                recorded.values.push(values_in(&channel.values, train));
                recorded.held_out.push(values_in(&channel.values, held_out));
            }
        }
        log.refuse_contradictions(&contradicting, monitor)?;
        Ok(recorded)
    }
}

/// Returns the values in these rows.
fn values_in(values: &[f64], rows: &[u32]) -> Vec<f64> {
    rows.iter().map(|&row| values[row as usize]).collect()
}
