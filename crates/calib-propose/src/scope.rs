use std::{fmt, ops::Range};

use calib_data::{ChannelSketch, Sketch, is_same};

use crate::ProposeError;

/// Fewest rows of a log for a study.
pub(crate) const LEAST: usize = 300;
/// A part of the log has a channel if at least this share of the rows has a value: the default of `preprocess.max_missing`.
const PRESENT: f64 = 0.9;
/// A channel is a total if this share of its changes goes in one direction.
const ONE_WAY: f64 = 0.999;

/// The part of the log that a study uses, and its channels.
#[derive(Clone, Debug, PartialEq)]
pub struct Scope {
    /// Range of rows of the sketch.
    pub rows: Range<usize>,
    /// Positions of the used channels.
    pub channels: Vec<usize>,
    /// The unused channels.
    pub left_out: Vec<LeftOut>,
    /// Whether the log has rows outside this part.
    pub is_part: bool,
}

/// A channel that is not used.
#[derive(Clone, Debug, PartialEq)]
pub struct LeftOut {
    /// Name of the channel.
    pub name: String,
    /// The reason.
    pub why: LeftOutReason,
}

/// Reason why a channel is left out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LeftOutReason {
    /// It has no value in this part.
    Empty,
    /// It never changes in this part.
    Constant,
    /// It moves in one direction.
    Total,
    /// It moves in one direction, by equal steps.
    Clock,
    /// It moves in one direction, and restarts from time to time.
    Restarting,
    /// It is an angle.
    Angle,
    /// It misses too many values; holds the share that is missing.
    Missing(f64),
}

impl fmt::Display for LeftOutReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Empty => write!(f, "has no numbers: it is empty, or text"),
            Self::Constant => write!(f, "never changes"),
            Self::Total => write!(
                f,
                "a total: nearly all of its changes go one way, so it tells the time rather than the state of the plant"
            ),
            Self::Clock => write!(f, "a clock: it counts on evenly"),
            Self::Restarting => write!(
                f,
                "a total that starts again now and then: until it does, it tells the time rather than the state of the plant"
            ),
            Self::Angle => write!(
                f,
                "an angle: from 359 to 1 degree is a small step and looks like a large one; an entry of data.angles reads its sine and its cosine"
            ),
            Self::Missing(share) => write!(f, "misses {:.0} % of the rows", 100.0 * share),
        }
    }
}

impl Scope {
    /// Chooses the part of the log, in whole bins, that contains most information. A part has the channels with values in nine of
    /// ten of its rows. Its worth is `rows x share of rows with all of them x √channels`.
    ///
    /// Each further channel adds less, because a plant of a hundred sensors has far
    /// fewer degrees of freedom. The square root is our choice.
    ///
    /// # Errors
    /// If no channel is left.
    pub fn of(sketch: &Sketch) -> Result<Self, ProposeError> {
        Self::with(sketch, &[])
    }

    /// Chooses as [`Scope::of`] does, among the parts in which all channels at the positions `wanted` have values and move.
    ///
    /// # Errors
    /// If no channel is left, a wanted channel is unusable, or the wanted channels never have values together.
    pub fn with(sketch: &Sketch, wanted: &[usize]) -> Result<Self, ProposeError> {
        for &channel in wanted {
            let sketched = &sketch.channels[channel];
            if let Some(why) = unusable(sketched) {
                return Err(ProposeError::OfNoUse {
                    name: sketched.name.clone(),
                    why: why.to_string(),
                });
            }
        }
        let bins = sketch.bins.len();
        let usable: Vec<usize> = (0..sketch.channels.len())
            .filter(|&channel| unusable(&sketch.channels[channel]).is_none())
            .collect();
        let mut best: Option<(f64, Range<usize>, Vec<usize>)> = None;
        // Narrow parts come first, so that rows without a benefit are not added.
        for width in 1..=bins {
            for start in 0..=bins - width {
                let part = start..start + width;
                if let Some((worth, channels)) = worth(sketch, &usable, part.clone())
                    && wanted.iter().all(|channel| channels.binary_search(channel).is_ok())
                    && best.as_ref().is_none_or(|(so_far, ..)| worth > so_far * 1.000_1)
                {
                    best = Some((worth, part, channels));
                }
            }
        }
        let Some((_, part, channels)) = best else {
            let names = wanted.iter().map(|&channel| sketch.channels[channel].name.clone());
            return Err(match wanted {
                [] => nothing(sketch),
                _ => ProposeError::NeverTogether { names: names.collect() },
            });
        };
        let left_out = (0..sketch.channels.len())
            .filter(|channel| channels.binary_search(channel).is_err())
            .map(|channel| {
                let sketched = &sketch.channels[channel];
                let why = unusable(sketched)
                    .unwrap_or_else(|| LeftOutReason::Missing(1.0 - share(sketched, &part)));
                LeftOut { name: sketched.name.clone(), why }
            });
        Ok(Self {
            rows: sketch.bins[part.start].start..sketch.bins[part.end - 1].end,
            left_out: left_out.collect(),
            is_part: part.len() < bins,
            channels,
        })
    }
}

/// Rows of a range that lack values of a channel for a long time, and are therefore left out.
#[derive(Clone, Debug, PartialEq)]
pub struct Lacking {
    /// Approximate number of rows.
    pub rows: usize,
    /// The channel that lacks most rows.
    pub channel: String,
}

/// Bins that miss a smaller share of a channel's values have short runs of missing values, which are filled.
const LEAST_LEFT_OUT: f64 = 0.1;
/// A smaller share of a range is not reported.
const LEAST_LACKING: f64 = 0.05;

impl Lacking {
    /// Measures the rows `range` of a sketch; `None` if hardly any row lacks a value.
    pub fn of(sketch: &Sketch, scope: &Scope, range: &Range<usize>) -> Option<Self> {
        let channels = scope.channels.iter();
        let most = channels.map(|&channel| (missing_rows(sketch, channel, range), channel));
        let (rows, channel) = most.max_by(|left, right| left.0.total_cmp(&right.0))?;
        (rows >= LEAST_LACKING * range.len() as f64).then(|| Self {
            rows: rows.round() as usize,
            channel: sketch.channels[channel].name.clone(),
        })
    }
}

/// Estimates the rows of `range` that lack a value of a channel, without those that are filled.
fn missing_rows(sketch: &Sketch, channel: usize, range: &Range<usize>) -> f64 {
    let present = sketch.bins.iter().zip(&sketch.channels[channel].present);
    present
        .filter(|(_, present)| 1.0 - **present >= LEAST_LEFT_OUT)
        .map(|(bin, present)| {
            let inside = bin.end.min(range.end).saturating_sub(bin.start.max(range.start));
            (1.0 - present) * inside as f64
        })
        .sum()
}

/// Returns the error for a log of which no channel can be used in any part.
fn nothing(sketch: &Sketch) -> ProposeError {
    let rows = sketch.timestamps.len();
    let of_no_use = sketch
        .channels
        .iter()
        .find_map(|channel| unusable(channel).map(|why| format!("{} {why}", channel.name)));
    let said = match (sketch.channels.first(), of_no_use) {
        (None, _) => "there is none".to_owned(),
        (Some(_), _) if rows < LEAST => {
            let have_own_times = sketch.needs_resampling();
            return ProposeError::TooShort { rows, least: LEAST, have_own_times };
        }
        (Some(_), Some(said)) => said,
        (Some(channel), None) => {
            let missing = 1.0 - share(channel, &(0..sketch.bins.len()));
            let clocks = if sketch.seldom_doubt().is_some() {
                ", and others have times of their own: put all on one clock with data.resample, data.period_secs and data.max_age_secs"
            } else {
                ""
            };
            format!("{} {}{clocks}", channel.name, LeftOutReason::Missing(missing))
        }
    };
    ProposeError::NoChannel(said)
}

/// Returns the reason why a channel cannot be used in any part.
fn unusable(channel: &ChannelSketch) -> Option<LeftOutReason> {
    let Some([low, high]) = channel.range else { return Some(LeftOutReason::Empty) };
    if is_same(low, high) {
        return Some(LeftOutReason::Constant);
    }
    if channel.wraps.is_some() {
        return Some(LeftOutReason::Angle);
    }
    let one_way = channel.rises >= ONE_WAY || channel.rises <= 1.0 - ONE_WAY;
    // A clock that restarts at midnight goes back once a day.
    match (channel.counts_on_evenly(), one_way, channel.restarts) {
        _ if !channel.has_many_values() => None,
        (true, ..) => Some(LeftOutReason::Clock),
        (false, _, true) => Some(LeftOutReason::Restarting),
        (false, true, false) => Some(LeftOutReason::Total),
        (false, false, false) => None,
    }
}

/// Returns the share of the rows of some bins that have a value of a channel.
fn share(channel: &ChannelSketch, part: &Range<usize>) -> f64 {
    channel.present[part.clone()].iter().sum::<f64>() / part.len() as f64
}

/// Returns the worth of a part of the log, and its channels.
fn worth(sketch: &Sketch, usable: &[usize], part: Range<usize>) -> Option<(f64, Vec<usize>)> {
    let rows: usize = sketch.bins[part.clone()].iter().map(Range::len).sum();
    let moving = usable.iter().copied().filter(|&channel| {
        let sketched = &sketch.channels[channel];
        part.clone().any(|bin| sketched.moves[bin]) && share(sketched, &part) >= PRESENT
    });
    let mut channels: Vec<usize> = moving.collect();
    if channels.is_empty() {
        return None;
    }
    // A row counts if it has all channels. The rarest channel of a bin gives an upper limit for such rows.
    let complete: f64 = part
        .clone()
        .map(|bin| {
            let present = channels.iter().map(|&channel| sketch.channels[channel].present[bin]);
            present.fold(1.0, f64::min) * sketch.bins[bin].len() as f64
        })
        .sum();
    channels.sort_unstable();
    Some((rows.min(complete as usize) as f64 * (channels.len() as f64).sqrt(), channels))
}

#[cfg(test)]
mod tests {
    use calib_data::{AngleOf, AnglePart};

    use super::*;
    use crate::{
        Sensors,
        testing::{Channel, sketch, wave},
    };

    #[test]
    fn a_whole_log_is_taken_whole() {
        let log = sketch(6_400, &[("A", wave(40.0)), ("B", wave(90.0))]);
        let scope = Scope::of(&log).expect("two channels");
        assert_eq!((scope.rows, scope.channels, scope.is_part), (0..6_400, vec![0, 1], false));
    }

    /// Returns the error for a log of one channel.
    fn refused(rows: usize, name: &str, values: Channel) -> ProposeError {
        Scope::of(&sketch(rows, &[(name, values)])).expect_err("nothing can be used")
    }

    #[test]
    fn why_nothing_can_be_used_is_told_of_the_right_channel() {
        let short = refused(2, "A", wave(40.0));
        let expected = ProposeError::TooShort { rows: 2, least: LEAST, have_own_times: false };
        assert_eq!(short, expected);
        // Two tags on the same rows that never have values together.
        let alternately: [(&str, Channel); 2] = [
            ("A", Box::new(|row| if row % 3 == 0 { f64::NAN } else { row as f64 % 7.0 })),
            ("B", Box::new(|row| if row % 3 == 0 { row as f64 % 5.0 } else { f64::NAN })),
        ];
        let mut log = sketch(200, &alternately);
        log.shape = calib_data::Shape::Long;
        let told = Scope::of(&log).expect_err("too short").to_string();
        assert!(
            told.ends_with("with data.resample, data.period_secs and data.max_age_secs"),
            "{told}"
        );
        let mut wide = sketch(640, &alternately);
        wide.files = 2;
        wide.channels[1].own_period_secs = Some(180.0);
        let told = Scope::of(&wide).expect_err("of two periods").to_string();
        assert!(
            told.contains("times of their own: put all on one clock with data.resample"),
            "{told}"
        );
        let empty = refused(640, "holes", Box::new(|_| f64::NAN));
        assert!(empty.to_string().contains("used: holes has no numbers"), "{empty}");
        let seldom = refused(640, "A", Box::new(|row| [f64::NAN, 1.0, 2.0][row % 3]));
        assert!(seldom.to_string().contains("used: A misses 33 % of the rows"), "{seldom}");
    }

    #[test]
    fn totals_clocks_and_constants_are_left_out() {
        let mut log = sketch(
            6_400,
            &[
                ("A", wave(40.0)),
                ("clock", Box::new(|row| row as f64)),
                ("total", Box::new(|row| (row as f64).powf(1.2) + (row % 3) as f64)),
                ("still", Box::new(|_| 5.0)),
                ("dead", Box::new(|_| f64::NAN)),
                ("switch", Box::new(|row| if row > 3_000 { 1.0 } else { 0.0 })),
                // The counter wraps rarely, so that nearly all changes are positive.
                ("counter", Box::new(|row| (17.0 * row as f64 + (row % 3) as f64) % 65_536.0)),
            ],
        );
        log.channels[6].restarts = true;
        let scope = Scope::of(&log).expect("one channel");
        assert_eq!(scope.channels, [0, 5], "a switch that is thrown once is no total");
        let why: Vec<(&str, LeftOutReason)> =
            scope.left_out.iter().map(|channel| (channel.name.as_str(), channel.why)).collect();
        let expected = [
            ("clock", LeftOutReason::Clock),
            ("total", LeftOutReason::Total),
            ("still", LeftOutReason::Constant),
            ("dead", LeftOutReason::Empty),
            ("counter", LeftOutReason::Restarting),
        ];
        assert_eq!(why, expected);
    }

    #[test]
    fn an_angle_is_left_out_and_its_sine_and_cosine_are_not() {
        let mut log = sketch(
            640,
            &[
                ("yaw", wave(40.0)),
                ("wind_sin", wave(50.0)),
                ("wind_cos", wave(60.0)),
                ("T", wave(9.0)),
            ],
        );
        log.channels[0].wraps = Some(360.0);
        for (channel, part) in
            log.channels[1..].iter_mut().zip([AnglePart::Sine, AnglePart::Cosine])
        {
            assert_eq!(channel.name, part.channel_of("wind"));
            let wind = AngleOf { channel: "wind".to_owned(), turn: 360.0, part, recorded: None };
            channel.angle = Some(wind);
        }
        let scope = Scope::of(&log).expect("three channels");
        assert_eq!(
            (scope.channels.clone(), scope.left_out[0].why),
            (vec![1, 2, 3], LeftOutReason::Angle)
        );
        let sensors = Sensors::of(&log, &scope).expect("one sensor");
        assert_eq!((sensors.proposed, sensors.others), (vec![3], vec![]), "inputs alone");
        assert!(Scope::with(&log, &[1]).is_ok(), "unless one is asked for");
    }

    #[test]
    fn clocks_that_start_anew_are_left_out() {
        let log = sketch(
            6_400,
            &[("A", wave(40.0)), ("NSM", Box::new(|row| (row % 1_440) as f64 * 60.0))],
        );
        let scope = Scope::of(&log).expect("one channel");
        assert_eq!((scope.channels, scope.left_out[0].why), (vec![0], LeftOutReason::Clock));
        let refused = Scope::with(&log, &[1]).expect_err("a clock").to_string();
        assert!(refused.contains("NSM") && refused.contains("counts on evenly"), "{refused}");
    }

    #[test]
    fn the_part_where_a_wanted_channel_is_there_is_taken() {
        let seldom: Channel =
            Box::new(|row| if row >= 4_800 { (row as f64 / 9.0).sin() } else { f64::NAN });
        let first: Channel =
            Box::new(|row| if row < 3_200 { (row as f64 / 9.0).sin() } else { f64::NAN });
        let log = sketch(6_400, &[("A", wave(40.0)), ("seldom", seldom), ("first", first)]);
        assert_eq!(Scope::of(&log).expect("a part").rows, 0..6_400);
        let scope = Scope::with(&log, &[1]).expect("a part");
        assert!(scope.rows.start >= 4_700 && scope.is_part, "{:?}", scope.rows);
        let never = Scope::with(&log, &[1, 2]).expect_err("never together").to_string();
        assert!(never.contains("seldom and first"), "{never}");
    }

    /// Returns a wave that has values in these rows only.
    fn between(start: usize, end: usize, length: f64) -> Channel {
        Box::new(
            move |row| {
                if (start..end).contains(&row) { (row as f64 / length).sin() } else { f64::NAN }
            },
        )
    }

    #[test]
    fn where_wells_come_and_go_the_dense_part_is_taken() {
        let log = sketch(
            6_400,
            &[
                ("1a", between(3_200, 6_400, 9.0)),
                ("1b", between(3_200, 6_400, 8.0)),
                ("2a", between(2_000, 6_400, 7.0)),
                ("3a", between(0, 640, 7.0)),
            ],
        );
        let scope = Scope::of(&log).expect("a part");
        assert_eq!((scope.rows, scope.channels), (3_200..6_400, vec![0, 1, 2]));
        assert!(scope.is_part);
        assert_eq!(scope.left_out[0].why, LeftOutReason::Missing(1.0));
    }

    #[test]
    fn a_log_without_values_is_an_error() {
        let log = sketch(640, &[("A", Box::new(|_| f64::NAN))]);
        let error = Scope::of(&log).expect_err("nothing").to_string();
        assert!(error.contains("A has no numbers"), "{error}");
    }
}
