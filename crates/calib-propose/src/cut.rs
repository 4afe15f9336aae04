use std::ops::Range;

use calib_core::Timestamp;
use calib_data::{Sketch, Zone, format_time};

use crate::{ProposeError, Scope, scope::LEAST};

/// Share of the rows in the held-out period: enough for several windows, and two thirds are left for training.
pub const HELD_OUT: f64 = 1.0 / 3.0;
/// Distance, as a share of the rows, within which a better place for the cut may lie.
const NEARBY: f64 = 0.08;
/// A step of more than this many periods is a gap, and a good place to cut.
const GAP_PERIODS: f64 = 10.0;

/// The cut of the log into a training range and a held-out period.
#[derive(Clone, Debug, PartialEq)]
pub struct Cut {
    /// The training range: its first moment, and the moment after its last.
    pub train: [Timestamp; 2],
    /// The held-out period: its first moment, and the moment after its last.
    pub held_out: [Timestamp; 2],
    /// Numbers of rows of the training range and of the held-out period.
    pub rows: [usize; 2],
    /// Reason for this place.
    pub reason: String,
}

impl Cut {
    /// Holds out the last third of the rows. It counts rows and not time, because sessions may lie months apart.
    /// The held-out period starts after a gap if one is near, otherwise at midnight, otherwise at a full hour.
    ///
    /// # Errors
    /// If there are too few rows.
    pub fn of(sketch: &Sketch, scope: &Scope) -> Result<Self, ProposeError> {
        let times = &sketch.timestamps[scope.rows.clone()];
        let rows = times.len();
        if rows < LEAST {
            let have_own_times = sketch.needs_resampling();
            return Err(ProposeError::TooShort { rows, least: LEAST, have_own_times });
        }
        let shares = [1.0 - HELD_OUT - NEARBY, 1.0 - HELD_OUT, 1.0 - HELD_OUT + NEARBY];
        let [first, aim, last] = shares.map(|share| (share * rows as f64) as usize);
        let near = first..last.min(rows - 1);
        let calendar = Calendar(sketch.clock.zone());
        let Place { cut, start, said } = calendar.place(times, near, aim, sketch.period_secs);
        let end = Timestamp::from_micros(
            times[rows - 1].as_micros() + (1e6 * sketch.period_secs).ceil() as i64,
        );
        Ok(Self {
            train: [times[0], start],
            held_out: [start, end],
            rows: [cut, rows - cut],
            reason: format!(
                "{:.0} % of the rows are held out{said}",
                100.0 * (rows - cut) as f64 / rows as f64
            ),
        })
    }

    /// Keeps the last `rows` rows of the training range, for a log with these `timestamps`.
    #[must_use]
    pub fn shortened(&self, timestamps: &[Timestamp], rows: usize) -> Self {
        let end = timestamps.partition_point(|time| *time < self.train[1]);
        let start = end.saturating_sub(rows.min(self.rows[0]));
        let mut shortened = self.clone();
        if start > 0 && end - start < self.rows[0] {
            let share = 100.0 * (end - start) as f64 / self.rows[0] as f64;
            shortened.reason = format!(
                "{}; of the {} rows before, calib learns from the last {share:.0} %, because more would take longer than you allow",
                self.reason, self.rows[0]
            );
        }
        shortened.train[0] = timestamps[start];
        shortened.rows[0] = end - start;
        shortened
    }

    /// Cuts the training range in the same way. Trials use this cut, because they must not see the held-out period.
    #[must_use]
    pub fn inside(&self, timestamps: &[Timestamp]) -> Self {
        let [start, end] =
            self.train.map(|moment| timestamps.partition_point(|time| *time < moment));
        let held_out = (HELD_OUT * (end - start) as f64) as usize;
        let cut = end - held_out;
        Self {
            train: [self.train[0], timestamps[cut]],
            held_out: [timestamps[cut], self.train[1]],
            rows: [cut - start, held_out],
            reason: String::new(),
        }
    }

    /// Returns the rows of the training range and of the held-out period, for a log with these `timestamps`.
    pub fn ranges(&self, timestamps: &[Timestamp]) -> [Range<usize>; 2] {
        [self.train, self.held_out].map(|ends| {
            let [start, end] = ends.map(|moment| timestamps.partition_point(|time| *time < moment));
            start..end
        })
    }

    /// Writes a range as TOML, on the clock of `zone` if `data.time_zone` gives one.
    pub(crate) fn toml(range: &[Timestamp; 2], zone: Option<&Zone>) -> String {
        let [start, end] = range.map(|time| match zone {
            Some(zone) => zone.written(time),
            None => format_time(time).replace(' ', "T"),
        });
        format!("{{ start = {start}, end = {end} }}")
    }
}

/// Returns the mean step between rows of the scope in seconds; a gap counts as one period. Where rows come at random, it is
/// longer than the period, which is the median.
pub fn mean_step_secs(sketch: &Sketch, scope: &Scope) -> f64 {
    let times = &sketch.timestamps[scope.rows.clone()];
    let steps = times.windows(2).map(|pair| {
        let secs = pair[1].micros_since(pair[0]) as f64 / 1e6;
        if secs > GAP_PERIODS * sketch.period_secs { sketch.period_secs } else { secs }
    });
    steps.sum::<f64>() / times.len().saturating_sub(1).max(1) as f64
}

/// Start of the held-out period.
struct Place {
    /// Its first row.
    cut: usize,
    /// Its first moment: the exact midnight or full hour if the cut is at one.
    start: Timestamp,
    /// Words that describe the place in the reason.
    said: &'static str,
}

/// Days and hours of a log, in `data.time_zone` or in its own times.
struct Calendar<'a>(Option<&'a Zone>);

impl Calendar<'_> {
    /// Finds the best row to cut before.
    fn place(
        &self,
        times: &[Timestamp],
        near: Range<usize>,
        aim: usize,
        period_secs: f64,
    ) -> Place {
        let steps = near.clone().skip(1).map(|row| (times[row].micros_since(times[row - 1]), row));
        if let Some((micros, cut)) = steps.max()
            && micros as f64 / 1e6 > GAP_PERIODS * period_secs
        {
            return Place { cut, start: times[cut], said: ", from a gap on" };
        }
        for (secs, said) in [(86_400, ", from midnight on"), (3_600, ", from a full hour on")] {
            let starts = (near.clone().skip(1))
                .filter(|&row| self.unit(times[row], secs) != self.unit(times[row - 1], secs));
            if let Some(cut) = starts.min_by_key(|row| row.abs_diff(aim)) {
                let round = self.start_of_unit(times[cut], secs);
                // When clocks go back, an hour occurs twice and may start before the previous row.
                let start = round.filter(|start| *start > times[cut - 1]).unwrap_or(times[cut]);
                return Place { cut, start, said };
            }
        }
        Place { cut: aim, start: times[aim], said: "" }
    }

    /// Counts days or hours since 1970.
    fn unit(&self, time: Timestamp, secs: i64) -> i64 {
        let wall = self.0.map_or(time.as_micros(), |zone| zone.wall(time));
        wall.div_euclid(secs * 1_000_000)
    }

    /// Returns the moment at which the day or hour of `time` starts.
    fn start_of_unit(&self, time: Timestamp, secs: i64) -> Option<Timestamp> {
        let wall = self.unit(time, secs) * secs * 1_000_000;
        self.0.map_or(Some(wall), |zone| zone.moment(wall)).map(Timestamp::from_micros)
    }
}

#[cfg(test)]
mod tests {
    use calib_data::{DataConfig, ShownClock};

    use super::*;
    use crate::testing::{sketch, wave};

    fn scope(rows: usize) -> Scope {
        Scope { rows: 0..rows, channels: vec![0], left_out: Vec::new(), is_part: false }
    }

    #[test]
    fn a_third_of_the_rows_is_held_out_from_a_round_time_on() {
        let log = sketch(30 * 1_440, &[("A", wave(40.0))]);
        let cut = Cut::of(&log, &scope(30 * 1_440)).expect("enough");
        assert_eq!(
            Cut::toml(&cut.train, None),
            "{ start = 1970-01-01T00:00:00, end = 1970-01-21T00:00:00 }"
        );
        assert_eq!(
            Cut::toml(&cut.held_out, None),
            "{ start = 1970-01-21T00:00:00, end = 1970-01-31T00:00:00 }"
        );
        assert_eq!(cut.rows, [20 * 1_440, 10 * 1_440]);
        assert!(cut.reason.ends_with("from midnight on"), "{}", cut.reason);
        let short = Cut::of(&log, &scope(600)).expect("enough");
        assert_eq!(
            Cut::toml(&short.held_out, None),
            "{ start = 1970-01-01T07:00:00, end = 1970-01-01T10:00:00 }"
        );
    }

    #[test]
    fn a_day_starts_at_midnight_of_the_time_zone() {
        let mut log = sketch(30 * 1_440, &[("A", wave(40.0))]);
        for (name, train) in [
            ("America/Los_Angeles", "{ start = 1969-12-31T16:00:00, end = 1970-01-21T00:00:00 }"),
            ("Asia/Kolkata", "{ start = 1970-01-01T05:30:00, end = 1970-01-21T00:00:00 }"),
        ] {
            let data = DataConfig { time_zone: Some(name.to_owned()), ..DataConfig::default() };
            log.clock = ShownClock::of(&data, true);
            let cut = Cut::of(&log, &scope(30 * 1_440)).expect("enough");
            assert_eq!(Cut::toml(&cut.train, log.clock.zone()), train, "{name}");
            let [train, held_out] = cut.ranges(&log.timestamps);
            assert_eq!(cut.rows, [train.len(), held_out.len()], "{name}");
        }
    }

    #[test]
    fn sessions_are_not_cut_in_two_if_that_can_be_helped() {
        let mut log = sketch(3_000, &[("A", wave(40.0))]);
        for (row, time) in log.timestamps.iter_mut().enumerate() {
            let session = row as i64 / 950;
            *time = Timestamp::from_micros(time.as_micros() + session * 30 * 86_400_000_000);
        }
        let cut = Cut::of(&log, &scope(3_000)).expect("enough");
        assert_eq!(cut.rows, [1_900, 1_100], "by rows, not by the months between");
        assert_eq!(cut.held_out[0], log.timestamps[1_900]);
        let [train, held_out] = cut.ranges(&log.timestamps);
        assert_eq!((train.start, train.end, held_out.end), (0, held_out.start, 3_000));
        let latest = cut.shortened(&log.timestamps, 500);
        assert_eq!((latest.rows, latest.train[0]), ([500, 1_100], log.timestamps[1_400]));
        let inside = latest.inside(&log.timestamps);
        assert_eq!(inside.rows, [334, 166]);
        assert_eq!(inside.train, [log.timestamps[1_400], log.timestamps[1_734]]);
        assert_eq!(inside.held_out, [log.timestamps[1_734], log.timestamps[1_900]]);
        let said = "of the 1900 rows before, calib learns from the last 26 %";
        assert!(latest.reason.contains(said), "{}", latest.reason);
    }

    #[test]
    fn the_mean_step_is_that_of_irregular_rows_and_of_no_gaps() {
        let mut log = sketch(3_000, &[("A", wave(40.0))]);
        assert_eq!(mean_step_secs(&log, &scope(3_000)), 60.0);
        let mut at = 0;
        for (row, time) in log.timestamps.iter_mut().enumerate() {
            *time = Timestamp::from_micros(at);
            at += if row % 3 == 0 { 240_000_000 } else { 60_000_000 };
        }
        let mean = mean_step_secs(&log, &scope(3_000));
        assert!((mean - 120.0).abs() < 0.1, "{mean}");
        for time in &mut log.timestamps[1_500..] {
            *time = Timestamp::from_micros(time.as_micros() + 86_400_000_000);
        }
        let mean = mean_step_secs(&log, &scope(3_000));
        assert!((mean - 120.0).abs() < 0.1, "a gap is no step: {mean}");
    }

    #[test]
    fn too_few_rows_are_refused() {
        let log = sketch(299, &[("A", wave(40.0))]);
        assert!(Cut::of(&log, &scope(299)).is_err());
    }
}
