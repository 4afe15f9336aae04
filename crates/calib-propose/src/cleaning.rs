use calib_data::{ChannelSketch, FEW_CONTRADICT, Shape, Sketch};

use crate::Scope;

/// Longest run of missing values, in rows, that is filled.
const MOST_FILLED: usize = 120;
/// Default of `preprocess.fill_limit`, in rows.
const LEAST_FILLED: usize = 10;
/// Number of channels that a reason names.
const NAMED: usize = 3;
/// Channels with values in a smaller share of the rows than this have clocks of their own.
const SPARSE: f64 = 0.5;

/// Proposed gap tolerance, fill limit and treatment of contradictory rows.
#[derive(Clone, Debug, PartialEq)]
pub struct Cleaning {
    /// `data.gap_tolerance` and its reason.
    pub gap_tolerance: (f64, String),
    /// `preprocess.fill_limit` and its reason.
    pub fill_limit: (usize, String),
    /// Reason for `data.contradictions = "first"`; `None` where the default stays.
    pub contradictions: Option<String>,
}

impl Cleaning {
    /// Proposes how to clean the log. Gaps of one or two rows do not count as gaps if most gaps are that short.
    /// The fill limit rises above ten rows if runs of missing values are longer, up to the limit of `MOST_FILLED`.
    pub fn of(sketch: &Sketch, scope: &Scope) -> Self {
        let times = &sketch.timestamps[scope.rows.clone()];
        let steps = times.windows(2).map(|pair| pair[1].micros_since(pair[0]) as f64 / 1e6);
        let gaps: Vec<f64> =
            steps.map(|secs| secs / sketch.period_secs).filter(|periods| *periods > 1.5).collect();
        let [single, short] =
            [2.5, 3.5].map(|periods| gaps.iter().filter(|gap| **gap <= periods).count());
        let gap_tolerance = if 2 * single > gaps.len() {
            (
                2.5,
                format!(
                    "{single} of {} gaps are single missing rows: they do not count as gaps",
                    gaps.len()
                ),
            )
        } else if 2 * short > gaps.len() {
            (
                3.5,
                format!(
                    "{short} of {} gaps are one or two missing rows: they do not count as gaps",
                    gaps.len()
                ),
            )
        } else {
            (
                1.5,
                match gaps.len() {
                    0 => "no gap is longer".to_owned(),
                    1 => "1 gap is longer".to_owned(),
                    many => format!("{many} gaps are longer"),
                },
            )
        };
        let runs = scope.channels.iter().map(|&channel| sketch.channels[channel].missing_run);
        let longest = runs.max().unwrap_or(0);
        let fill_limit = match longest {
            0 => (LEAST_FILLED, "hardly a value is missing".to_owned()),
            1..=LEAST_FILLED => {
                (LEAST_FILLED, format!("most runs of missing values are of at most {longest} rows"))
            }
            more if more <= MOST_FILLED => {
                (more, format!("most runs of missing values are of at most {more} rows"))
            }
            more => (
                MOST_FILLED,
                format!(
                    "runs of missing values reach {more} rows: the longest of them end a segment"
                ),
            ),
        };
        Self { gap_tolerance, fill_limit, contradictions: contradictions(sketch, scope) }
    }
}

/// Rows with equal times and different values.
struct Contradicting {
    /// Number of such rows in the channel that has most of them.
    rows: u64,
    /// Their share of all rows.
    share: f64,
    /// Names of the channels that have such rows.
    names: String,
}

impl Contradicting {
    fn of<'a>(sketch: &Sketch, channels: impl Iterator<Item = &'a ChannelSketch>) -> Option<Self> {
        let mut found: Vec<&ChannelSketch> =
            channels.filter(|channel| channel.contradicting > 0).collect();
        found.sort_by_key(|channel| std::cmp::Reverse(channel.contradicting));
        let rows = found.first()?.contradicting;
        let more = if found.len() > NAMED { " …" } else { "" };
        let names: Vec<&str> =
            found.iter().take(NAMED).map(|channel| channel.name.as_str()).collect();
        // The sketch no longer contains the rows that were left out.
        let share = rows as f64 / (sketch.timestamps.len() as u64 + rows) as f64;
        Some(Self { rows, share, names: format!("{}{more}", names.join(", ")) })
    }

    /// Says how many rows there are, and in which channels.
    fn told(&self) -> String {
        let Self { rows, share, names } = self;
        let percent = 100.0 * share;
        format!("{rows} rows contradict another of the same time ({percent:.2} %) in {names}")
    }
}

/// Returns the reason to accept a few rows that contradict another row of the same time; they should not prevent a study.
/// `None` if there are many: the log was probably read wrongly, and calib still refuses it.
fn contradictions(sketch: &Sketch, scope: &Scope) -> Option<String> {
    let channels = scope.channels.iter().map(|&channel| &sketch.channels[channel]);
    let found =
        Contradicting::of(sketch, channels).filter(|found| found.share <= FEW_CONTRADICT)?;
    Some(format!(
        "{}, as where a clock was set back, recordings overlap, or two devices share a name (data.where chooses one)",
        found.told()
    ))
}

/// Returns a warning if `data.contradictions` left out too many rows for a mistake of the logger.
pub fn many_left_out(sketch: &Sketch) -> Option<String> {
    let found = Contradicting::of(sketch, sketch.channels.iter());
    let found = found.filter(|found| found.share > FEW_CONTRADICT)?;
    Some(format!(
        "{}, and data.contradictions leaves them out: they may be of several machines, of which data.where chooses one, or of an export that cut its times, which data.contradictions = \"spread\" mends",
        found.told()
    ))
}

/// The common clock for channels that were recorded at times of their own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clock {
    /// `data.period_secs`.
    pub period_secs: f64,
    /// `data.max_age_secs`.
    pub max_age_secs: f64,
}

impl Clock {
    /// Proposes a clock; `None` if rows have values of most channels. The period is the median recording interval of the channels,
    /// rounded to a usual period. Values expire after ten times the interval of the slowest channels.
    pub fn of(sketch: &Sketch) -> Option<Self> {
        let alive: Vec<&ChannelSketch> =
            sketch.channels.iter().filter(|channel| known(channel) > 0.0).collect();
        let sparse = alive.iter().filter(|channel| known(channel) < SPARSE).count();
        if alive.len() < 2 || 2 * sparse <= alive.len() {
            return None;
        }
        // A mostly empty wide table may hold plants that were recorded one after the other. Each channel then has a value in almost
        // every row of its own period, and needs no other clock.
        let mut own: Vec<f64> =
            alive.iter().filter_map(|channel| channel.own_period_secs).collect();
        own.sort_by(f64::total_cmp);
        let median = *own.get(own.len() / 2)?;
        if sketch.shape == Shape::Wide && median <= 2.0 * sketch.period_secs {
            return None;
        }
        let slowest = own.get(own.len() * 9 / 10).copied().unwrap_or(median);
        let period_secs = round(median);
        Some(Self { period_secs, max_age_secs: round((10.0 * slowest).max(10.0 * period_secs)) })
    }
}

/// Returns the share of the rows that have a value of a channel.
fn known(channel: &ChannelSketch) -> f64 {
    channel.present.iter().sum::<f64>() / channel.present.len().max(1) as f64
}

/// Rounds to the nearest usual period, on a logarithmic scale.
fn round(secs: f64) -> f64 {
    const NICE: [f64; 22] = [
        0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 60.0, 120.0, 300.0, 600.0, 900.0,
        1_200.0, 1_800.0, 3_600.0, 7_200.0, 21_600.0, 43_200.0, 86_400.0,
    ];
    let nearest = NICE.into_iter().min_by(|one, other| {
        let [one, other] = [one, other].map(|nice| (nice / secs).ln().abs());
        one.total_cmp(&other)
    });
    nearest.unwrap_or(secs)
}

#[cfg(test)]
mod tests {
    use calib_core::Timestamp;

    use super::*;
    use crate::testing::{Channel, sketch, wave};

    #[test]
    fn single_missing_rows_are_no_gaps() {
        let mut log = sketch(1_000, &[("A", wave(40.0))]);
        let scope = Scope::of(&log).expect("a channel");
        assert_eq!(Cleaning::of(&log, &scope).gap_tolerance.0, 1.5);
        for (row, time) in log.timestamps.iter_mut().enumerate() {
            let lost = (row / 100) as i64;
            *time = Timestamp::from_micros(time.as_micros() + lost * 60_000_000);
        }
        log.channels[0].missing_run = 500;
        let cleaning = Cleaning::of(&log, &scope);
        assert_eq!((cleaning.gap_tolerance.0, cleaning.fill_limit.0), (2.5, 120));
        assert!(cleaning.gap_tolerance.1.starts_with("9 of 9"), "{}", cleaning.gap_tolerance.1);
    }

    #[test]
    fn a_clock_that_was_set_back_is_no_reason_to_have_no_study() {
        let mut log = sketch(1_000, &[("A", wave(40.0)), ("B", wave(30.0))]);
        let scope = Scope::of(&log).expect("channels");
        assert_eq!(Cleaning::of(&log, &scope).contradictions, None);
        log.channels[1].contradicting = 10;
        let why = Cleaning::of(&log, &scope).contradictions.expect("a percent");
        assert!(
            why.starts_with("10 rows contradict another of the same time (0.99 %) in B,"),
            "{why}"
        );
        log.channels[0].contradicting = 11;
        let found = Cleaning::of(&log, &scope).contradictions;
        assert_eq!(found, None, "as many are a table that is read wrongly");
        let said = many_left_out(&log).expect("more than a percent");
        assert!(
            said.starts_with("11 rows contradict another of the same time (1.09 %) in A, B, and"),
            "{said}"
        );
        log.channels[0].contradicting = 10;
        assert_eq!(many_left_out(&log), None);
    }

    /// Returns a channel with a value in one of `rows` rows.
    fn every(rows: usize, offset: usize) -> Channel {
        Box::new(move |row| if row % rows == offset { (row as f64 / 50.0).sin() } else { f64::NAN })
    }

    #[test]
    fn channels_that_are_stored_on_change_get_a_clock() {
        let mut log = sketch(3_200, &[("A", every(3, 0)), ("B", every(7, 2)), ("C", every(4, 1))]);
        log.shape = Shape::Long;
        for (channel, secs) in log.channels.iter_mut().zip([180.0, 420.0, 240.0]) {
            channel.own_period_secs = Some(secs);
        }
        let clock = Clock::of(&log).expect("on change");
        assert_eq!((clock.period_secs, clock.max_age_secs), (300.0, 3_600.0));
        let whole = sketch(640, &[("A", wave(9.0)), ("B", wave(7.0))]);
        assert_eq!(Clock::of(&whole), None);
    }
}
