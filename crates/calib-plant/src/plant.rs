use calib_core::{Seed, Timestamp};
use rayon::prelude::*;

use crate::{
    Change, ChannelInfo, OptionsError, PlantOptions, catalogue,
    change::{Changes, Sensors},
    channel::Channel,
    faults::{DayGrid, arrivals},
    process::Process,
    signal::{Frame, Signals},
    synthesis,
};

/// Length of the history that filters and lags need, s.
const HISTORY_SECS: f64 = 3600.0;

/// One day of the log.
#[derive(Clone, Debug)]
pub struct DayLog {
    /// Number of the day, from 0.
    pub day: u32,
    /// Start of the day: the plant's start plus whole days.
    pub start: Timestamp,
    /// Time of each row, in order. A repeated time is a row written twice.
    pub timestamps: Vec<Timestamp>,
    /// `columns[channel][row]`, in the order of [`Plant::schema`]. NaN is a missing value.
    pub columns: Vec<Vec<f32>>,
}

/// A simulated plant that writes its log day by day.
///
/// It is an iterator of [`DayLog`]s. Only one day is held at a time (4 bytes per value and a tenth more). A day follows
/// from the options and from the state at its beginning. [`Plant::skip_day`] advances the state without making the log;
/// the following days are then the same to the bit. Columns are generated in parallel and do not depend on the number
/// of threads.
///
/// ```
/// use calib_plant::{Fate, Plant, PlantOptions};
/// use calib_core::Period;
///
/// let options = PlantOptions {
///     period: Period::from_secs(60.0).expect("positive"),
///     ..PlantOptions::default()
/// };
/// let mut plant = Plant::new(options)?;
/// assert_eq!(plant.schema()[0].name, "PIT300");
/// plant.skip_day();
/// let second = plant.next().expect("two days");
/// assert_eq!((second.day, second.columns.len()), (1, plant.schema().len()));
/// assert!(plant.next().is_none());
/// # Ok::<(), calib_plant::OptionsError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Plant {
    options: PlantOptions,
    channels: Vec<Channel>,
    schema: Vec<ChannelInfo>,
    changes: Changes,
    process: Process,
    sensors: Sensors,
    signals: Signals,
    day: u32,
}

impl Plant {
    /// Returns the plant at the beginning of its first day.
    ///
    /// # Errors
    /// If an option is outside its range.
    pub fn new(options: PlantOptions) -> Result<Self, OptionsError> {
        options.validate()?;
        let channels = catalogue::channels(options.channels);
        let period_secs = options.period.as_secs();
        let history = (HISTORY_SECS / period_secs).ceil() as usize;
        let changes = Changes::of(&options);
        Ok(Self {
            schema: channels.iter().map(|channel| channel.info.clone()).collect(),
            channels,
            process: Process::new(&options, &changes),
            sensors: Sensors::new(&changes, period_secs),
            changes,
            signals: Signals::new(history),
            day: 0,
            options,
        })
    }

    /// Returns the options of the plant.
    pub fn options(&self) -> &PlantOptions {
        &self.options
    }

    /// Returns the ground truth about every channel, in the order of the columns.
    pub fn schema(&self) -> &[ChannelInfo] {
        &self.schema
    }

    /// Returns the changes during the log, in time order. Changes of a sensor are listed if a channel is made from it.
    pub fn changes(&self) -> Vec<Change> {
        self.changes
            .told(&self.options, |signal| self.channels.iter().any(|channel| channel.shows(signal)))
    }

    /// Returns the number of the next day.
    pub fn day(&self) -> u32 {
        self.day
    }

    /// Returns the number of days of the whole log. The last may be a part of one.
    pub fn days(&self) -> u32 {
        self.options.days.ceil() as u32
    }

    /// Returns the number of instants of the whole log: its rows without gaps and duplicates.
    pub fn instants(&self) -> u64 {
        self.options.instants() as u64
    }

    /// Skips the next day without making its log. Returns its number, or `None` after the last.
    pub fn skip_day(&mut self) -> Option<u32> {
        self.pass_day().map(|grid| grid.day)
    }

    /// Runs the process through the next day.
    fn pass_day(&mut self) -> Option<DayGrid> {
        let first = self.options.first_instant(self.day);
        let rows = (self.options.first_instant(self.day + 1) - first) as usize;
        if rows == 0 {
            return None;
        }
        let grid =
            DayGrid { day: self.day, first, rows, period_secs: self.options.period.as_secs() };
        self.signals.begin_day();
        let mut frame = Frame::zero();
        for row in 0..rows {
            self.process.next_row(&mut frame);
            self.sensors.read(grid.secs(row), &mut frame);
            self.signals.push(&frame);
        }
        self.day += 1;
        Some(grid)
    }

    /// Returns the instants of the day that were written, in order, with repeats.
    fn written(&self, grid: &DayGrid) -> Vec<usize> {
        let mut rows: Vec<usize> = (0..grid.rows).collect();
        for gap in synthesis::gaps(&self.options, grid).into_iter().rev() {
            rows.drain(gap);
        }
        let seed: Seed = self.options.seed.child("duplicates");
        let mut rng = seed.number(u64::from(grid.day)).rng();
        for at in arrivals(self.options.duplicates_per_day, &mut rng).iter().rev() {
            let position = ((at * rows.len() as f64) as usize).min(rows.len() - 1);
            rows.insert(position, rows[position]);
        }
        rows
    }
}

impl Iterator for Plant {
    type Item = DayLog;

    fn next(&mut self) -> Option<DayLog> {
        let grid = self.pass_day()?;
        let written = self.written(&grid);
        let whole = written.len() == grid.rows && written.is_sorted_by(|a, b| a < b);
        let columns = self
            .channels
            .par_iter()
            .map(|channel| {
                let sensor = self.changes.of_recipe(channel.recipe);
                let values =
                    synthesis::column(channel, sensor, &self.options, &self.signals, &grid);
                if whole { values } else { written.iter().map(|&row| values[row]).collect() }
            })
            .collect();
        let start = self.options.start;
        let period = self.options.period;
        Some(DayLog {
            day: grid.day,
            start: Timestamp::from_micros(start.as_micros() + i64::from(grid.day) * 86_400_000_000),
            timestamps: written
                .iter()
                .map(|&row| start.plus(period, grid.first + row as i64))
                .collect(),
            columns,
        })
    }
}
