//! Finds numbers that loggers write for a missing value, such as -200, -999.9 or 9999.

use calib_core::abridged_list;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Number of distinct values that are kept at each end of a channel: two sentinels, and the next value behind them.
const KEPT: usize = 3;
/// Channels with fewer distinct values are modes, so a far value is one of the modes.
const DISTINCT: usize = 20;
/// A number is frequent if it occurs at least this many times, and in one of this many values.
const OFTEN: (u64, u64) = (3, 50_000);
/// Minimum distance of a number that looks like a sentinel, in widths of the other values of its channel.
const NEAR: f64 = 0.1;

/// A number that probably means a missing value.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Sentinel {
    /// The number.
    pub value: f64,
    /// Number of occurrences, in all channels together.
    pub count: u64,
    /// Its share of the values of these channels.
    pub share: f64,
    /// The channels whose smallest or largest value it is.
    pub channels: Vec<String>,
}

impl Sentinel {
    /// Returns the number in a column of actions or rewards that probably stands for a missing value; `None` without
    /// one.
    ///
    /// It is at least as far from all other values as these are wide, and occurs three times or more, and in one of
    /// 50,000 values. Unlike in a sensor, -99 and a negative hundred do not count, because they are usual penalties,
    /// and the column may have few distinct values, because actions and rewards often have. (Our choice.)
    pub fn of_decisions(column: &str, values: &[f64]) -> Option<Self> {
        let finite: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
        let extremes = Extremes::of(&finite);
        let far = extremes.far().into_iter().map(|(value, away)| (decimal(value), away));
        let (value, _) = far.into_iter().find(|&(value, away)| away >= 1.0 && is_code(value))?;
        let count = values.iter().filter(|&&other| stands_for_missing(other, &[value])).count();
        Some(Self {
            value,
            count: count as u64,
            share: count as f64 / extremes.count as f64,
            channels: vec![column.to_owned()],
        })
    }

    /// Adds the occurrences of the same number in other channels.
    pub fn merge(&mut self, other: Self) {
        let values = self.count as f64 / self.share + other.count as f64 / other.share;
        self.count += other.count;
        self.share = self.count as f64 / values;
        self.channels.extend(other.channels);
    }

    /// Whether this value is the number, possibly rounded to 32 bits.
    pub fn is(&self, value: f64) -> bool {
        stands_for_missing(value, &[self.value])
    }

    /// Returns the warning for `sentinels`; `None` if there are none.
    pub fn doubt(sentinels: &[Self]) -> Option<String> {
        let values: Vec<String> =
            sentinels.iter().map(|sentinel| sentinel.value.to_string()).collect();
        let told: Vec<String> = sentinels.iter().map(Self::told).collect();
        (!told.is_empty()).then(|| {
            format!(
                "{}: if that stands for a missing value, as loggers write it, set data.missing_values = [{}] (on the command line, --set data.missing_values=[{}])",
                told.join("; "),
                values.join(", "),
                values.join(",")
            )
        })
    }

    /// Describes the finding in words.
    pub fn told(&self) -> String {
        const NAMED: usize = 3;
        let channels = if self.channels.len() == 1 { "channel" } else { "channels" };
        format!(
            "{} stands {} times ({:.2} %) far away from all other values of {} {channels} ({})",
            self.value,
            self.count,
            100.0 * self.share,
            self.channels.len(),
            abridged_list(&self.channels, NAMED)
        )
    }
}

/// The smallest and the largest values of a channel, with their frequencies.
#[derive(Clone, Debug, Default)]
pub(crate) struct Extremes {
    /// The smallest values, in ascending order.
    low: Vec<(f64, u64)>,
    /// The largest values, in descending order.
    high: Vec<(f64, u64)>,
    /// Number of values that are not missing.
    count: u64,
    /// Some of the distinct values.
    distinct: Vec<u64>,
}

impl Extremes {
    pub(crate) fn of(values: &[f64]) -> Self {
        let mut extremes = Self::default();
        for &value in values.iter().filter(|value| !value.is_nan()) {
            extremes.count += 1;
            if extremes.distinct.len() < DISTINCT && !extremes.distinct.contains(&value.to_bits()) {
                extremes.distinct.push(value.to_bits());
            }
            note(&mut extremes.low, value, |one, other| one < other);
            note(&mut extremes.high, value, |one, other| one > other);
        }
        extremes
    }

    /// Returns the smallest and the largest value; `None` without values.
    pub(crate) fn range(&self) -> Option<[f64; 2]> {
        Some([self.low.first()?.0, self.high.first()?.0])
    }

    /// Returns the frequent numbers at the ends of the channel, with their distances from the other values, in widths
    /// of these.
    fn far(&self) -> Vec<(f64, f64)> {
        let often = OFTEN.0.max(self.count / OFTEN.1);
        let mut best = Vec::new();
        for low in 0..self.low.len() {
            for high in 0..self.high.len() {
                let bottom = self.low[low].0;
                let top = self.high[high].0;
                let width = top - bottom;
                let mut ends = self.low[..low].iter().chain(&self.high[..high]);
                let far: Vec<(f64, f64)> = ends
                    .clone()
                    .map(|end: &(f64, u64)| (end.0, (bottom - end.0).max(end.0 - top) / width))
                    .collect();
                if width > 0.0
                    && far.len() > best.len()
                    && ends.all(|end| end.1 >= often)
                    && far.iter().all(|(_, away)| *away >= NEAR)
                {
                    best = far;
                }
            }
        }
        best
    }

    /// Returns how often `value` occurs at an end of the channel.
    fn times(&self, value: f64) -> u64 {
        let ends = self.low.iter().chain(&self.high);
        ends.filter(|end| end.0.total_cmp(&value).is_eq()).map(|end| end.1).max().unwrap_or(0)
    }
}

/// Keeps `value` among the first few; `comes` is true if its first argument comes before the second.
fn note(ends: &mut Vec<(f64, u64)>, value: f64, comes: impl Fn(f64, f64) -> bool) {
    if ends.len() == KEPT && comes(ends[KEPT - 1].0, value) {
        return;
    }
    let place = ends.iter().take_while(|end| comes(end.0, value)).count();
    match ends.get_mut(place) {
        Some(end) if end.0 == value => end.1 += 1,
        _ => {
            ends.insert(place, (value, 1));
            ends.truncate(KEPT);
        }
    }
}

/// Returns the numbers that probably stand for a missing value in the log, the most frequent first.
///
/// Some numbers look like a sentinel: only nines, a limit of 16 or 32 bits, or a negative hundred. Such a number must
/// lie at the end of a channel, at least as far from the other values as these are wide. A negative number that does
/// not look like a sentinel must lie so at the ends of two channels without other negative values. 0 is never a
/// sentinel: pumps stop. (Our choice.)
pub(crate) fn sentinels(channels: &[(&str, &Extremes)]) -> Vec<Sentinel> {
    let mut candidates: Vec<(f64, [usize; 2])> = Vec::new();
    for (_, extremes) in channels {
        if extremes.distinct.len() < DISTINCT {
            continue;
        }
        for (value, away) in extremes.far() {
            let is_far = usize::from(away >= 1.0);
            let is_alone = usize::from(
                away >= 1.0
                    && value < 0.0
                    && extremes.low.iter().all(|end| end.0 >= 0.0 || end.0 == value),
            );
            match candidates.iter_mut().find(|candidate| candidate.0 == value) {
                Some((_, counts)) => {
                    counts[0] += is_far;
                    counts[1] += is_alone;
                }
                None => candidates.push((value, [is_far, is_alone])),
            }
        }
    }
    candidates
        .retain(|&(value, [far, alone])| far >= 1 && looks_missing(decimal(value)) || alone >= 2);
    let mut found: Vec<Sentinel> = candidates
        .into_iter()
        .map(|(value, _): (f64, [usize; 2])| {
            let having = channels.iter().filter(|(_, extremes)| extremes.times(value) > 0);
            let count = having.clone().map(|(_, extremes)| extremes.times(value)).sum();
            let all: u64 = having.clone().map(|(_, extremes)| extremes.count).sum();
            Sentinel {
                value: decimal(value),
                count,
                share: count as f64 / all.max(1) as f64,
                channels: having.map(|(name, _)| (*name).to_owned()).collect(),
            }
        })
        .collect();
    found.sort_by(|left, right| {
        right.count.cmp(&left.count).then(left.value.total_cmp(&right.value))
    });
    found
}

/// Returns the number as it was written before rounding to 32 bits: -999.9 rather than -999.900024.
fn decimal(value: f64) -> f64 {
    let single = value as f32;
    if f64::from(single).total_cmp(&value).is_eq() {
        single.to_string().parse().unwrap_or(value)
    } else {
        value
    }
}

/// Whether people and programs usually write this number for a missing value of a sensor.
fn looks_missing(value: f64) -> bool {
    is_code(value) || value < 0.0 && (value % 100.0 == 0.0 || value == -99.0)
}

/// Whether this number has only nines, three or more, or is a limit of a number format.
fn is_code(value: f64) -> bool {
    const LIMITS: [f64; 8] = [
        32_767.0,
        -32_768.0,
        65_535.0,
        2_147_483_647.0,
        -2_147_483_648.0,
        4_294_967_295.0,
        // Well logs.
        -999.25,
        999.25,
    ];
    let digits: String = value.abs().to_string().chars().filter(char::is_ascii_digit).collect();
    digits.len() >= 3 && digits.bytes().all(|digit| digit == b'9')
        || LIMITS.contains(&value)
        || value.abs() >= 1e9
}

/// Replaces the `declared` values by NaN, and returns their number.
pub(crate) fn make_missing(values: &mut [f64], declared: &[f64]) -> u64 {
    if declared.is_empty() {
        return 0;
    }
    let mut count = 0;
    for value in values.iter_mut().filter(|value| stands_for_missing(**value, declared)) {
        *value = f64::NAN;
        count += 1;
    }
    count
}

/// Whether `declared` contains this value, possibly rounded to 32 bits.
pub(crate) fn stands_for_missing(value: f64, declared: &[f64]) -> bool {
    declared.iter().any(|&sentinel| value == sentinel || value == f64::from(sentinel as f32))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(channels: &[&[f64]]) -> Vec<(f64, u64, usize)> {
        let extremes: Vec<Extremes> = channels.iter().map(|values| Extremes::of(values)).collect();
        let named: Vec<(&str, &Extremes)> =
            extremes.iter().map(|of_channel| ("a", of_channel)).collect();
        sentinels(&named)
            .iter()
            .map(|sentinel| (sentinel.value, sentinel.count, sentinel.channels.len()))
            .collect()
    }

    /// Returns values from `low` to `high`, followed by `others`.
    fn wave(low: f64, high: f64, others: &[f64]) -> Vec<f64> {
        let middle = f64::midpoint(low, high);
        let wave = (0..600).map(|row| middle + (high - low) / 2.0 * (f64::from(row) / 9.0).sin());
        wave.chain(others.iter().copied()).collect()
    }

    #[test]
    fn numbers_for_no_value_are_told() {
        let co = wave(0.1, 11.9, &[-200.0; 40]);
        let sensor = wave(647.0, 2_040.0, &[-200.0; 9]);
        assert_eq!(found(&[&co, &sensor]), [(-200.0, 49, 2)], "also where it is not that far");
        assert_eq!(found(&[&wave(1.0, 9.0, &[9_999.0; 5])]), [(9_999.0, 5, 1)]);
        let both = wave(1.0, 9.0, &[-999.9, -999.9, -999.9, 9_999.0, 9_999.0, 9_999.0, 9_999.0]);
        assert_eq!(found(&[&both]), [(9_999.0, 4, 1), (-999.9, 3, 1)]);
        let single = wave(1.0, 9.0, &[f64::from(-999.9_f32); 3]);
        assert_eq!(found(&[&single]), [(-999.9, 3, 1)], "as it was written");
        let odd = wave(20.0, 40.0, &[-40.0; 6]);
        assert_eq!(found(&[&odd, &odd]), [(-40.0, 12, 2)]);
        assert_eq!(found(&[&wave(20.0, 40.0, &[-200.0; 3]), &[-200.0; 10]])[0].1, 13);
    }

    #[test]
    fn what_a_plant_does_is_none() {
        assert!(found(&[&wave(80.0, 90.0, &[0.0; 99])]).is_empty(), "a pump that stands still");
        assert!(found(&[&wave(0.0, 10.0, &[100.0; 9]), &wave(0.0, 10.0, &[100.0; 9])]).is_empty());
        assert!(found(&[&wave(1.0, 9.0, &[9_999.0; 2])]).is_empty(), "seldom: spikes");
        assert!(found(&[&[0.0, 1.0, 2.0, 9_999.0].repeat(9)]).is_empty(), "modes");
        assert!(found(&[&wave(-300.0, 9_000.0, &[-200.0; 9])]).is_empty(), "among the others");
        assert!(found(&[&wave(20.0, 40.0, &[-40.0; 6])]).is_empty(), "in one channel alone");
    }

    #[test]
    fn codes_among_actions_and_rewards_are_told_and_penalties_are_not() {
        let code = |values: &[f64]| {
            let found = Sentinel::of_decisions("reward", values)?;
            Some((found.value, found.count))
        };
        assert_eq!(code(&wave(-5.0, 0.0, &[-9_999.0; 4])), Some((-9_999.0, 4)));
        assert_eq!(code(&[0.0, 50.0, 100.0, -999.0].repeat(9)), Some((-999.0, 9)), "a few levels");
        assert_eq!(code(&wave(-5.0, 0.0, &[-9_999.0; 2])), None, "seldom");
        for penalty in [-99.0, -100.0] {
            assert_eq!(code(&wave(-5.0, 0.0, &[penalty; 9])), None, "a penalty");
        }
        assert_eq!(code(&[0.0, 999.0].repeat(9)), None, "nothing to compare with");
        assert_eq!(code(&wave(-5.0, 0.0, &[f64::NEG_INFINITY; 9])), None, "told elsewhere");
        assert_eq!(code(&[]), None);
        let told =
            Sentinel::doubt(&[
                Sentinel::of_decisions("reward", &[0.0, 1.0, 9_999.0].repeat(3)).expect("a code")
            ]);
        let told = told.expect("a warning");
        assert!(
            told.contains("channel (reward)") && told.contains("--set data.missing_values=[9999]"),
            "{told}"
        );
        assert_eq!(Sentinel::doubt(&[]), None);
        let mut both =
            Sentinel::of_decisions("reward", &[0.0, 1.0, 9_999.0].repeat(3)).expect("a code");
        both.merge(
            Sentinel::of_decisions("valve", &[0.0, 1.0, 0.5, 9_999.0, 9_999.0, 9_999.0])
                .expect("a code"),
        );
        let told = both.told();
        assert_eq!(
            told,
            "9999 stands 6 times (40.00 %) far away from all other values of 2 channels (reward, valve)"
        );
    }

    #[test]
    fn declared_values_become_missing() {
        let mut values = [1.0, -200.0, f64::from(-999.9_f32), -999.9];
        assert_eq!(make_missing(&mut values, &[-200.0, -999.9]), 3);
        assert!(values[0] == 1.0 && values[1..].iter().all(|value| value.is_nan()));
    }
}
