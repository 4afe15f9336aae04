use std::cmp::Ordering;

use calib_data::{ChannelSketch, Sketch};

use crate::{ProposeError, Scope};

/// Number of proposed sensors.
const PROPOSED: usize = 3;
/// A sensor that is unchanged in more than this share of steps gives little to predict.
const MOST_RESTING: f64 = 0.95;
/// Smallest share of bins in which a sensor must move.
const LEAST_MOVING: f64 = 0.9;
/// A sensor with less autocorrelation from row to row is mostly noise.
const LEAST_AUTOCORRELATION: f64 = 0.3;

/// Factor on the worth of a sensor that no other channel explains, such as the weather.
const UNEXPLAINED: f64 = 0.4;
/// Factor on the worth of a sensor whose unit changed: it is proposed only if there is no other.
const OTHER_UNIT: f64 = 0.01;
/// Smallest share of the last third in which a sensor must stay within its earlier range.
const STAYING: f64 = 0.9;
/// Number of channels that are compared with each other.
const COMPARED: usize = 64;
/// Largest number of channels that explain another channel.
const EXPLAINING: usize = 4;

/// The sensors to predict.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensors {
    /// Positions of the proposed channels.
    pub proposed: Vec<usize>,
    /// Positions of other possible channels, the best first.
    pub others: Vec<usize>,
}

impl Sensors {
    /// Chooses up to three sensors. The sine or the cosine of an angle is never chosen.
    /// Every sensor must move throughout. Better sensors rest less, are more than noise from row to row, stay in the held-out third
    /// within their earlier range, and are explained by other channels of the log.
    /// The first sensor is the best one. Each further one also has a small correlation with those chosen before.
    ///
    /// # Errors
    /// If no channel moves throughout.
    pub fn of(sketch: &Sketch, scope: &Scope) -> Result<Self, ProposeError> {
        let bins: Vec<usize> = (0..sketch.bins.len())
            .filter(|&bin| {
                let rows = &sketch.bins[bin];
                rows.start >= scope.rows.start && rows.end <= scope.rows.end
            })
            .collect();
        // The last third is held out. A sensor that is constant there gives no evidence.
        let held_out = &bins[bins.len() * 2 / 3..];
        let mut worth: Vec<(usize, f64)> = scope
            .channels
            .iter()
            .filter_map(|&channel| {
                let sketched = &sketch.channels[channel];
                // The sine or cosine of an angle is useful as an input, but not as a prediction.
                let is_sensor = sketched.angle.is_none()
                    // A channel with few values is a mode, not a measurement.
                    && sketched.has_many_values()
                    && sketched.unchanged <= MOST_RESTING
                    && moves_throughout(sketched, &bins)
                    && moves_throughout(sketched, held_out);
                is_sensor.then(|| {
                    let unit = if sketched.unit_change.is_some() { OTHER_UNIT } else { 1.0 };
                    (channel, moving_share(sketched) * known_share(sketch, scope, sketched) * unit)
                })
            })
            .collect();
        worth.sort_by(by_worth);
        worth.truncate(COMPARED);
        let others = &scope.channels[..scope.channels.len().min(COMPARED)];
        for (channel, worth) in &mut worth {
            *worth *= UNEXPLAINED + (1.0 - UNEXPLAINED) * explained(sketch, *channel, others);
        }
        worth.sort_by(by_worth);
        let mut proposed: Vec<usize> = Vec::new();
        while proposed.len() < PROPOSED.min(worth.len()) {
            let next = worth
                .iter()
                .filter(|(channel, _)| !proposed.contains(channel))
                .map(|&(channel, worth)| {
                    let most = proposed
                        .iter()
                        .map(|&other| {
                            correlation(
                                &sketch.channels[channel].thinned,
                                &sketch.channels[other].thinned,
                            )
                            .abs()
                        })
                        .fold(0.0, f64::max);
                    (channel, worth * (1.0 - most))
                })
                .reduce(|best, next| if best.1 >= next.1 { best } else { next });
            let Some((channel, _)) = next else { break };
            proposed.push(channel);
        }
        if proposed.is_empty() {
            return Err(ProposeError::NothingMoves);
        }
        let others = worth.into_iter().map(|(channel, _)| channel);
        Ok(Self {
            others: others.filter(|channel| !proposed.contains(channel)).collect(),
            proposed,
        })
    }
}

/// Orders by descending worth; equals in the order of the channels.
fn by_worth(left: &(usize, f64), right: &(usize, f64)) -> Ordering {
    right.1.total_cmp(&left.1).then(left.0.cmp(&right.0))
}

/// Whether a channel moves in nearly all of these bins.
fn moves_throughout(channel: &ChannelSketch, bins: &[usize]) -> bool {
    let moving = bins.iter().filter(|&&bin| channel.moves[bin]).count();
    moving as f64 / bins.len().max(1) as f64 >= LEAST_MOVING
}

/// Returns the share of steps in which a sensor moves, times 0.2 if that is noise.
fn moving_share(channel: &ChannelSketch) -> f64 {
    let near = channel.autocorrelation.first().map_or(0.0, |(_, value)| *value);
    (1.0 - channel.unchanged) * if near < LEAST_AUTOCORRELATION { 0.2 } else { 1.0 }
}

/// Returns the share of the last third of the values that lies within the range of the earlier ones. The behaviour of a sensor
/// outside its earlier range is unknown.
fn known_share(sketch: &Sketch, scope: &Scope, channel: &ChannelSketch) -> f64 {
    let step = sketch.timestamps.len().div_ceil(channel.thinned.len().max(1)).max(1);
    let inside =
        scope.rows.start.div_ceil(step)..(scope.rows.end / step).min(channel.thinned.len());
    let cut = inside.start + inside.len() * 2 / 3;
    let [before, after] = [inside.start..cut, cut..inside.end].map(|rows| {
        channel.thinned[rows].iter().copied().filter(|value| !value.is_nan()).collect::<Vec<f64>>()
    });
    let low = before.iter().copied().fold(f64::INFINITY, f64::min);
    let high = before.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let known = after.iter().filter(|value| (low..=high).contains(*value)).count();
    known as f64 / after.len().max(1) as f64
}

/// Whether a channel stays within its earlier range in the last third, and keeps its unit.
pub(crate) fn stays(sketch: &Sketch, scope: &Scope, channel: usize) -> bool {
    let channel = &sketch.channels[channel];
    channel.unit_change.is_none() && known_share(sketch, scope, channel) >= STAYING
}

/// Returns the share of a channel's variance that other channels explain at the same time. The channel that explains most of the
/// residual is subtracted repeatedly (matching pursuit, Mallat and Zhang 1993).
pub(crate) fn explained(sketch: &Sketch, channel: usize, others: &[usize]) -> f64 {
    let mut left = centred(&sketch.channels[channel].thinned);
    let others: Vec<Vec<f64>> = others
        .iter()
        .filter(|&&other| other != channel)
        .map(|&other| centred(&sketch.channels[other].thinned))
        .collect();
    let squares: Vec<f64> = others.iter().map(|other| dot(other, other)).collect();
    let whole = dot(&left, &left);
    if whole <= 0.0 {
        return 0.0;
    }
    for _ in 0..EXPLAINING {
        let slopes = others.iter().zip(&squares).filter(|(_, square)| **square > 0.0);
        let slopes = slopes.map(|(other, square)| {
            let slope = dot(&left, other) / square;
            let taken = slope * slope * square;
            (other, slope, taken)
        });
        let best = slopes.max_by(|one, other| one.2.total_cmp(&other.2));
        let Some((other, slope, _)) = best else { break };
        left.iter_mut().zip(other).for_each(|(left, other)| *left -= slope * other);
    }
    (1.0 - dot(&left, &left) / whole).clamp(0.0, 1.0)
}

fn dot(one: &[f64], other: &[f64]) -> f64 {
    one.iter().zip(other).map(|(one, other)| one * other).sum()
}

/// Subtracts the mean; missing values become 0.
fn centred(values: &[f64]) -> Vec<f64> {
    let there = values.iter().filter(|value| !value.is_nan());
    let mean = there.clone().sum::<f64>() / there.count().max(1) as f64;
    values.iter().map(|value| if value.is_nan() { 0.0 } else { value - mean }).collect()
}

/// Returns Pearson's correlation over the rows with both values; 1 if undefined, so that such pairs do not count as unlike.
fn correlation(left: &[f64], right: &[f64]) -> f64 {
    let both: Vec<(f64, f64)> = left
        .iter()
        .zip(right)
        .filter(|(left, right)| !left.is_nan() && !right.is_nan())
        .map(|(left, right)| (*left, *right))
        .collect();
    let count = both.len() as f64;
    let x = both.iter().map(|(left, _)| left).sum::<f64>() / count;
    let y = both.iter().map(|(_, right)| right).sum::<f64>() / count;
    let mut xx = 0.0;
    let mut yy = 0.0;
    let mut xy = 0.0;
    for (left, right) in &both {
        xx += (left - x).powi(2);
        yy += (right - y).powi(2);
        xy += (left - x) * (right - y);
    }
    let correlation = xy / (xx * yy).sqrt();
    if correlation.is_finite() { correlation } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use calib_data::UnitChange;

    use super::*;
    use crate::testing::{Channel, sketch, wave};

    fn names(channels: &[(&str, Channel)]) -> Result<Vec<String>, ProposeError> {
        let log = sketch(6_400, channels);
        let sensors = Sensors::of(&log, &Scope::of(&log).expect("channels"))?;
        Ok(sensors.proposed.iter().map(|&channel| log.channels[channel].name.clone()).collect())
    }

    #[test]
    fn sensors_that_move_and_are_unlike_are_taken() {
        let found = names(&[
            ("mode", Box::new(|row| (row / 10 % 2) as f64)),
            ("A", wave(40.0)),
            ("twice A", Box::new(|row| 2.0 * (std::f64::consts::TAU * row as f64 / 40.0).sin())),
            ("B", wave(70.0)),
            ("C", wave(90.0)),
            ("noise", Box::new(|row| ((row * 7_919 + row * row * 104_729) % 1_009) as f64)),
        ]);
        assert_eq!(found.expect("some"), ["A", "B", "C"]);
    }

    #[test]
    fn what_goes_where_it_has_never_been_comes_last() {
        let leaves: Channel = Box::new(|row| {
            let away = if row > 4_300 { 100.0 } else { 0.0 };
            away + (std::f64::consts::TAU * row as f64 / 40.0).sin()
        });
        let found =
            names(&[("leaves", leaves), ("B", wave(70.0)), ("C", wave(90.0)), ("D", wave(50.0))]);
        assert!(!found.expect("some").contains(&"leaves".to_owned()));
    }

    #[test]
    fn what_changed_its_unit_is_proposed_last() {
        let mut log = sketch(
            6_400,
            &[("A", wave(40.0)), ("B", wave(70.0)), ("C", wave(90.0)), ("D", wave(50.0))],
        );
        let at = log.timestamps[2_000];
        let change = UnitChange { at, before: [-1.0, 1.0], after: [-100.0, 100.0] };
        log.channels[0].unit_change = Some(change);
        let scope = Scope::of(&log).expect("channels");
        let sensors = Sensors::of(&log, &scope).expect("some");
        assert!(!sensors.proposed.contains(&0), "{:?}", sensors.proposed);
        assert_eq!(sensors.others, [0]);
        assert!(!stays(&log, &scope, 0) && stays(&log, &scope, 1));
    }

    #[test]
    fn what_stands_still_where_it_would_be_judged_is_not_taken() {
        let stops: Channel =
            Box::new(|row| if row < 4_000 { (row as f64 / 7.0).sin() } else { 0.3 });
        assert_eq!(names(&[("stops", stops), ("B", wave(70.0))]).expect("one"), ["B"]);
        let still: Channel =
            Box::new(|row| if row < 4_000 { (row as f64 / 7.0).sin() } else { 0.3 });
        assert_eq!(names(&[("stops", still)]), Err(ProposeError::NothingMoves));
    }
}
