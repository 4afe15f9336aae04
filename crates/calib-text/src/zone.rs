//! Converts local wall-clock times to instants.
//!
//! When clocks are set back, one hour of wall-clock times occurs twice. The time of a row alone does not show which of
//! the two it is, but the rows around it may. [`LocalTimes`] holds the rows of such an hour back until they do.

use std::collections::{HashSet, VecDeque};

use calib_core::Timestamp;
use jiff::tz::{AmbiguousOffset, Offset, TimeZone};

use crate::{NO_TIME, ParsedTime, format_time};

/// The time zone of a place.
#[derive(Clone, Debug)]
pub struct Zone(TimeZone);

/// The possible instants of a wall-clock time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Meaning {
    Once(i64),
    /// Clocks showed it before and after they were set back.
    Twice(Fold),
    /// Clocks skipped it when they were set forward. Holds the instant by the clock before that.
    Never(i64),
}

/// The two instants of a wall-clock time that occurred twice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Fold {
    first: i64,
    second: i64,
}

/// Returns the instant of a wall-clock time by a clock with this offset.
fn instant_of(wall: i64, offset: Offset) -> i64 {
    wall - i64::from(offset.seconds()) * 1_000_000
}

impl Zone {
    /// Returns the zone called `name`, such as `Europe/Paris` or `UTC`; `None` if it does not exist.
    pub fn new(name: &str) -> Option<Self> {
        TimeZone::get(name).ok().map(Self)
    }

    fn meaning(&self, wall: i64) -> Option<Meaning> {
        let clock = jiff::Timestamp::from_microsecond(wall).ok()?;
        let ambiguous = self.0.to_ambiguous_timestamp(TimeZone::UTC.to_datetime(clock));
        Some(match ambiguous.offset() {
            AmbiguousOffset::Unambiguous { offset } => Meaning::Once(instant_of(wall, offset)),
            AmbiguousOffset::Gap { before, .. } => Meaning::Never(instant_of(wall, before)),
            AmbiguousOffset::Fold { before, after } => Meaning::Twice(Fold {
                first: instant_of(wall, before),
                second: instant_of(wall, after),
            }),
        })
    }

    /// Returns the instant of a wall-clock time in a study. If there are two, it returns the first. A time that clocks
    /// skipped is read by the clock before the change.
    pub fn moment(&self, wall: i64) -> Option<i64> {
        self.meaning(wall).map(|meaning| match meaning {
            Meaning::Once(instant) | Meaning::Never(instant) => instant,
            Meaning::Twice(fold) => fold.first,
        })
    }

    /// Returns the wall-clock time at `instant`, in microseconds, as if it were UTC. Beyond the supported years it
    /// returns the instant itself.
    pub fn wall(&self, instant: Timestamp) -> i64 {
        let micros = instant.as_micros();
        jiff::Timestamp::from_microsecond(micros)
            .map_or(micros, |at| micros + i64::from(self.0.to_offset(at).seconds()) * 1_000_000)
    }

    /// Formats `instant` for a study: `2022-11-01T06:00:00` on the local clock. It adds an offset where
    /// [`Self::moment`] would read another instant from the text.
    pub fn written(&self, instant: Timestamp) -> String {
        let micros = instant.as_micros();
        let wall = self.wall(instant);
        match jiff::Timestamp::from_microsecond(micros) {
            Ok(at) if self.moment(wall) != Some(micros) => {
                at.display_with_offset(self.0.to_offset(at)).to_string()
            }
            _ => format_time(Timestamp::from_micros(wall)).replace(' ', "T"),
        }
    }
}

/// Numbers of steps that are needed and kept to find the sampling interval before an hour that occurs twice. The
/// interval is the shortest of the last steps.
const FEWEST_STEPS: usize = 8;
const MOST_STEPS: usize = 30;
/// A step of more than this many sampling intervals is a gap.
const GAP: f64 = 1.25;

/// Rows of a file or of a tag in recorded order, with times on a local clock.
#[derive(Debug)]
pub struct LocalTimes<Row> {
    zone: Zone,
    last: Option<i64>,
    /// Steps forward minus steps back: negative if the newest rows come first. A few rows out of order do not matter.
    forward: i64,
    /// The last steps between rows.
    steps: VecDeque<i64>,
    /// Rows of an hour that occurs twice, and rows without a time among them.
    waiting: Vec<(Row, Option<Fold>)>,
    /// Number of rows whose time names no instant, or two that the other rows cannot tell apart.
    pub undecided: u64,
}

impl<Row> LocalTimes<Row> {
    /// Creates an empty queue for the clock of `zone`.
    pub fn new(zone: Zone) -> Self {
        Self {
            zone,
            last: None,
            forward: 0,
            steps: VecDeque::new(),
            waiting: Vec::new(),
            undecided: 0,
        }
    }

    /// Adds the next row. `out` receives the rows in the same order, each with its instant or [`NO_TIME`], as soon as
    /// that is known.
    ///
    /// # Errors
    /// If `out` fails.
    pub fn push<E>(
        &mut self,
        stamp: Option<ParsedTime>,
        row: Row,
        out: &mut impl FnMut(Row, i64) -> Result<(), E>,
    ) -> Result<(), E> {
        let meaning = match stamp {
            Some(ParsedTime::Instant(instant)) => Some(Meaning::Once(instant)),
            Some(ParsedTime::Wall(wall)) => self.zone.meaning(wall),
            None => None,
        };
        match meaning {
            Some(Meaning::Twice(fold)) => {
                if self.waiting.iter().find_map(|(_, fold)| *fold).is_some_and(|known| {
                    known.first.abs_diff(fold.first) >= known.first.abs_diff(known.second)
                }) {
                    self.settle(Some(fold.first), out)?;
                }
                self.waiting.push((row, Some(fold)));
                Ok(())
            }
            Some(Meaning::Once(instant)) => {
                self.settle(Some(instant), out)?;
                self.place(instant);
                out(row, instant)
            }
            without @ (Some(Meaning::Never(_)) | None) => {
                self.undecided += u64::from(without.is_some());
                if self.waiting.is_empty() {
                    return out(row, NO_TIME);
                }
                self.waiting.push((row, None));
                Ok(())
            }
        }
    }

    /// Decides about the remaining rows: no more rows follow.
    ///
    /// # Errors
    /// If `out` fails.
    pub fn finish<E>(&mut self, out: &mut impl FnMut(Row, i64) -> Result<(), E>) -> Result<(), E> {
        self.settle(None, out)
    }

    /// Decides about the waiting rows; `next` is the instant of the next row.
    fn settle<E>(
        &mut self,
        next: Option<i64>,
        out: &mut impl FnMut(Row, i64) -> Result<(), E>,
    ) -> Result<(), E> {
        if self.waiting.is_empty() {
            return Ok(());
        }
        let waiting = std::mem::take(&mut self.waiting);
        let folds: Vec<Fold> = waiting.iter().filter_map(|(_, fold)| *fold).collect();
        let is_first = self.first_pass(folds, next);
        let mut seen = 0;
        for (row, fold) in waiting {
            let Some(fold) = fold else {
                out(row, NO_TIME)?;
                continue;
            };
            let Some(is_first) = &is_first else {
                self.undecided += 1;
                out(row, NO_TIME)?;
                continue;
            };
            let instant = if is_first[seen] { fold.first } else { fold.second };
            seen += 1;
            self.place(instant);
            out(row, instant)?;
        }
        Ok(())
    }

    fn place(&mut self, instant: i64) {
        if let Some(last) = self.last {
            self.forward += instant.cmp(&last) as i64;
            if instant != last {
                if self.steps.len() == MOST_STEPS {
                    self.steps.pop_front();
                }
                self.steps.push_back(instant.saturating_sub(last).saturating_abs());
            }
        }
        self.last = Some(instant);
    }

    /// Returns for each row whether it belongs to the hour before clocks were set back; `None` if the rows do not show
    /// it.
    fn first_pass(&self, mut folds: Vec<Fold>, next: Option<i64>) -> Option<Vec<bool>> {
        // Clocks go back once, in whichever direction most rows are sorted.
        let forward = Some(self.forward).filter(|forward| *forward != 0);
        let forward = forward.unwrap_or_else(|| {
            folds.windows(2).map(|pair| pair[1].first.cmp(&pair[0].first) as i64).sum()
        });
        let is_backward =
            forward < 0 || forward == 0 && next.is_some_and(|next| next < folds[0].first);
        let mut before = self.last;
        let mut after = next;
        if is_backward {
            folds.reverse();
            std::mem::swap(&mut before, &mut after);
        }
        let passes = Passes { step: self.step(), folds: &folds, before, after };
        let split = passes.split()?;
        let mut is_first: Vec<bool> = (0..folds.len()).map(|row| row < split).collect();
        if is_backward {
            is_first.reverse();
        }
        Some(is_first)
    }

    /// Returns the sampling interval, if there are enough steps to know it.
    fn step(&self) -> Option<i64> {
        if self.steps.len() < FEWEST_STEPS { None } else { self.steps.iter().copied().min() }
    }
}

/// Rows of an hour that occurs twice, the oldest first.
struct Passes<'a> {
    folds: &'a [Fold],
    before: Option<i64>,
    after: Option<i64>,
    step: Option<i64>,
}

impl Passes<'_> {
    /// Returns how many of the rows belong to the first of the two hours; `None` if it is unknown.
    ///
    /// If times go back, the clocks were set back there, unless a single row is out of order. If they do not, the split
    /// is the only position that leaves no gap in rows that otherwise have no gap.
    fn split(&self) -> Option<usize> {
        let hour = self.folds[0].second - self.folds[0].first;
        let falls: Vec<usize> =
            (1..self.folds.len()).filter(|&row| self.step_back(row) > 0).collect();
        let Some(deepest) = falls.iter().copied().max_by_key(|&row| self.step_back(row)) else {
            // At the end of a log any row may be missing.
            self.before.zip(self.after)?;
            // A repeated time belongs to the second hour and is not a copy of a row. Otherwise the split is unknown.
            let mut again = (1..self.folds.len()).filter(|&row| self.step_back(row) == 0);
            let splits = match (again.next(), again.next()) {
                (None, _) => 0..=self.folds.len(),
                (Some(row), None) => row..=row,
                (Some(_), Some(_)) => return None,
            };
            let mut gapless = splits.filter(|&split| self.is_gapless(split));
            return gapless.next().filter(|_| gapless.next().is_none());
        };
        if falls.iter().filter(|&&row| 2 * self.step_back(row) >= hour).count() > 1 {
            return None;
        }
        let is_told = 2 * self.step_back(deepest) >= hour
            || self.is_gapless(deepest)
            || falls.len() == 1 && self.repeats(deepest);
        is_told.then_some(deepest)
    }

    /// Returns by how much the clock of a row is behind that of the row before it.
    fn step_back(&self, row: usize) -> i64 {
        self.folds[row - 1].first - self.folds[row].first
    }

    /// Whether a row from `split` on repeats the time of a row before `split`.
    fn repeats(&self, split: usize) -> bool {
        let passed: HashSet<i64> = self.folds[..split].iter().map(|fold| fold.first).collect();
        self.folds[split..].iter().any(|fold| passed.contains(&fold.first))
    }

    /// Whether the rows have no gap if `split` of them belong to the first hour.
    fn is_gapless(&self, split: usize) -> bool {
        let Some(step) = self.step else { return false };
        let rows = self.folds.len();
        let pairs = [
            self.before.map(|before| (before, self.instant(0, split))),
            self.after.map(|after| (self.instant(rows - 1, split), after)),
            (1..rows)
                .contains(&split)
                .then(|| (self.folds[split - 1].first, self.folds[split].second)),
        ];
        pairs.into_iter().flatten().all(|(from, to)| (to - from) as f64 <= GAP * step as f64)
    }

    /// Returns the instant of a row if `split` of the rows belong to the first hour.
    fn instant(&self, row: usize, split: usize) -> i64 {
        let fold = self.folds[row];
        if row < split { fold.first } else { fold.second }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::parse_stamp;

    const MINUTE: i64 = 60_000_000;

    fn wall(text: &str) -> i64 {
        match parse_stamp(text) {
            Some(ParsedTime::Wall(micros)) => micros,
            other => panic!("{other:?}"),
        }
    }

    fn instants(zone: &str, walls: &[i64]) -> (Vec<i64>, u64) {
        let mut rows = LocalTimes::new(Zone::new(zone).expect("a zone"));
        let mut all = Vec::new();
        let mut out = |row: usize, instant: i64| {
            all.push((row, instant));
            Ok::<(), ()>(())
        };
        for (row, &wall) in walls.iter().enumerate() {
            rows.push(Some(ParsedTime::Wall(wall)), row, &mut out).expect("taken");
        }
        rows.finish(&mut out).expect("taken");
        assert!(all.iter().map(|(row, _)| *row).eq(0..walls.len()), "rows keep their order");
        (all.into_iter().map(|(_, instant)| instant).collect(), rows.undecided)
    }

    /// Returns minutes from midnight UTC of `day` for wall-clock times of that day, or of another day that a time
    /// names. Many rows at intervals of `period` minutes precede them.
    fn after(zone: &str, day: &str, period: i64, shown: &[&str]) -> Vec<Option<i64>> {
        let first = wall(&format!("{day}T{}:00", shown[0]));
        let earlier = (1..=9).rev().map(|row| first - row * period * MINUTE);
        let walls: Vec<String> = earlier
            .map(|wall| {
                format_time(Timestamp::from_micros(wall)).replace(' ', "T")[..16].to_owned()
            })
            .collect();
        let all: Vec<&str> =
            walls.iter().map(String::as_str).chain(shown.iter().copied()).collect();
        minutes(zone, day, &all).split_off(9)
    }

    /// Returns minutes from midnight UTC of `day` for wall-clock times of that day, or of another day that a time
    /// names.
    fn minutes(zone: &str, day: &str, shown: &[&str]) -> Vec<Option<i64>> {
        let midnight = wall(&format!("{day}T00:00:00"));
        let walls: Vec<i64> = shown
            .iter()
            .map(|time| {
                if time.contains('T') {
                    wall(&format!("{time}:00"))
                } else {
                    wall(&format!("{day}T{time}:00"))
                }
            })
            .collect();
        let (instants, _) = instants(zone, &walls);
        instants
            .iter()
            .map(|instant| (*instant != NO_TIME).then(|| (instant - midnight) / MINUTE))
            .collect()
    }

    fn some(minutes: &[i64]) -> Vec<Option<i64>> {
        minutes.iter().map(|&minute| Some(minute)).collect()
    }

    /// Calls [`minutes`] for a day when clocks in Paris go back.
    fn paris(shown: &[&str]) -> Vec<Option<i64>> {
        minutes("Europe/Paris", "2024-10-27", shown)
    }

    /// Calls [`after`] for the same day.
    fn paris_every(period: i64, shown: &[&str]) -> Vec<Option<i64>> {
        after("Europe/Paris", "2024-10-27", period, shown)
    }

    #[test]
    fn the_hour_that_comes_twice_is_told_by_the_rows_around_it() {
        // 2024-10-27: clocks in Paris go from 3:00 back to 2:00, at 1:00 UTC.
        let oldest_first = ["01:30", "02:00", "02:30", "02:00", "02:30", "03:00"];
        assert_eq!(paris(&oldest_first), some(&[-30, 0, 30, 60, 90, 120]));
        let newest_first = ["03:00", "02:30", "02:00", "02:30", "02:00", "01:30"];
        assert_eq!(paris(&newest_first), some(&[120, 90, 60, 30, 0, -30]));
        // Rows that are not at full hours: the same time twice is an hour apart.
        let half_past = ["00:30", "01:30", "02:30", "02:30", "03:30"];
        assert_eq!(paris_every(60, &half_past), some(&[-90, -30, 30, 90, 150]));
        assert_eq!(
            paris_every(30, &half_past)[2..],
            [None, None, Some(150)],
            "or a row and its copy"
        );
        let half_past = ["00:30", "01:30", "01:30", "02:30"];
        let moscow = after("Europe/Moscow", "2014-10-26", 60, &half_past);
        assert_eq!(moscow, some(&[-210, -150, -90, -30]));
        // Two hours after the last row, and two before the next.
        assert_eq!(
            paris_every(120, &["00:30", "02:30", "03:30", "05:30"]),
            some(&[-90, 30, 150, 270])
        );
        // Every row of the first hour, and two of the second.
        let some_are_missing =
            ["01:45", "02:00", "02:15", "02:30", "02:45", "02:15", "02:30", "03:30"];
        assert_eq!(paris(&some_are_missing), some(&[-15, 0, 15, 30, 45, 75, 90, 150]));
    }

    #[test]
    fn a_file_may_begin_and_end_in_such_an_hour() {
        let ends = after("Europe/Paris", "2024-10-27", 15, &["01:45", "02:00", "02:15"]);
        assert_eq!(ends, [Some(-15), None, None]);
        assert_eq!(paris(&["02:30", "02:45", "03:00"]), [None, None, Some(120)]);
        assert_eq!(paris(&["02:30", "02:45"]), [None, None]);
        assert_eq!(paris(&["02:40", "02:50", "02:00", "02:10"]), some(&[40, 50, 60, 70]));
        assert_eq!(paris(&["02:10", "02:00", "02:50", "02:40"]), some(&[70, 60, 50, 40]));
    }

    #[test]
    fn rows_that_could_be_of_either_hour_have_no_time() {
        let once = paris(&["01:30", "01:45", "02:00", "02:15", "02:30", "02:45", "03:00"]);
        assert_eq!(once, [Some(-30), Some(-15), None, None, None, None, Some(120)]);
        // 2018-02-18: clocks in São Paulo go from midnight back to 23:00.
        let day = "2018-02-17";
        let once = minutes("America/Sao_Paulo", day, &["22:30", "22:45", "23:30", "23:45"]);
        assert_eq!(once[..2], some(&[24 * 60 + 30, 24 * 60 + 45]));
        assert_eq!(once[2..], [None, None]);
        assert_eq!(paris(&["02:30"]), [None]);
        // A row out of order is not a second pass.
        let disorder = paris(&["01:45", "02:00", "02:30", "02:20", "02:45", "03:00"]);
        assert_eq!(disorder[1..5], [None; 4]);
        // 2024-03-31: clocks go from 2:00 to 3:00.
        let spring = minutes("Europe/Paris", "2024-03-31", &["01:45", "02:00", "03:00"]);
        assert_eq!(spring, [Some(45), None, Some(60)]);
        let (_, undecided) = instants("Europe/Paris", &[wall("2024-03-31T02:00:00")]);
        assert_eq!(undecided, 1);
    }

    #[test]
    fn a_moment_of_a_study_is_the_first_of_two() {
        let paris = Zone::new("Europe/Paris").expect("a zone");
        let midnight = wall("2024-10-27T00:00:00");
        let moment = paris.moment(wall("2024-10-27T02:30:00")).expect("in range");
        assert_eq!((moment - midnight) / MINUTE, 30);
        assert!(Zone::new("Europe/Atlantis").is_none());
    }

    fn written(zone: &str, time: &str) -> String {
        let Some(ParsedTime::Instant(instant)) = parse_stamp(time) else { panic!("{time}") };
        Zone::new(zone).expect("a zone").written(Timestamp::from_micros(instant))
    }

    #[test]
    fn moments_of_a_study_are_written_on_the_clock_of_the_place() {
        let west = "America/Los_Angeles";
        assert_eq!(written(west, "2024-03-11T07:00:00Z"), "2024-03-11T00:00:00");
        assert_eq!(written("Asia/Kolkata", "2024-03-10T18:30:00.5Z"), "2024-03-11T00:00:00.5");
        // 2024-11-03: clocks in Los Angeles go from 2:00 back to 1:00, at 9:00 UTC.
        assert_eq!(written(west, "2024-11-03T08:30:00Z"), "2024-11-03T01:30:00");
        assert_eq!(written(west, "2024-11-03T09:30:00Z"), "2024-11-03T01:30:00-08:00");
    }

    proptest! {
        /// Checks on rows with known instants that every decided row gets the right instant.
        #[test]
        fn no_row_is_placed_an_hour_off(
            zone in prop::sample::select(vec![
                ("Europe/Paris", "2024-10-27T00:00:00Z"),
                ("Europe/Moscow", "2014-10-25T21:00:00Z"),
                ("America/Sao_Paulo", "2018-02-18T00:00:00Z"),
                ("Australia/Lord_Howe", "2024-04-06T14:00:00Z"),
            ]),
            period in prop::sample::select(vec![1_i64, 5, 10, 15, 20, 30, 60, 120]),
            offset in 0_i64..60,
            missing in prop::collection::vec(prop::bool::weighted(0.3), 100),
            newest_first in any::<bool>(),
            before in 0_i64..60,
        ) {
            let (name, start) = zone;
            let Some(ParsedTime::Instant(start)) = parse_stamp(start) else { panic!("an instant") };
            let rules = TimeZone::get(name).expect("a zone");
            let rows = (0..100).map(|row| start + (offset + (row - before) * period) * MINUTE);
            let mut truth: Vec<i64> =
                rows.zip(&missing).filter(|(_, missing)| !**missing).map(|(row, _)| row).collect();
            if newest_first {
                truth.reverse();
            }
            let walls: Vec<i64> = truth.iter().map(|&instant| {
                let at = jiff::Timestamp::from_microsecond(instant).expect("in range");
                instant + i64::from(rules.to_offset(at).seconds()) * 1_000_000
            }).collect();
            let zone = Zone::new(name).expect("a zone");
            for &instant in &truth {
                let read = match parse_stamp(&zone.written(Timestamp::from_micros(instant))) {
                    Some(ParsedTime::Instant(read)) => Some(read),
                    Some(ParsedTime::Wall(wall)) => zone.moment(wall),
                    None => None,
                };
                prop_assert_eq!(read, Some(instant));
            }
            let (placed, undecided) = instants(name, &walls);
            prop_assert_eq!(placed.iter().filter(|&&time| time == NO_TIME).count() as u64, undecided);
            for (placed, truth) in placed.iter().zip(&truth) {
                prop_assert!(*placed == NO_TIME || placed == truth, "{} for {}", placed, truth);
            }
            if missing.iter().all(|missing| !missing) && before > 40 && (100 - before) * period > 180 {
                prop_assert_eq!(undecided, 0);
            }
        }
    }
}
