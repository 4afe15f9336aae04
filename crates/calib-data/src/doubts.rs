//! Warnings about parts of a log that are probably not as intended, in sentences.

use calib_core::{Timestamp, number, numbers_apart};
use calib_text::format_time;

use crate::{
    BridgedStops, ChannelProfile, DropReason, FarOut, Profile, Sentinel, Shape, ShownClock, Sketch,
    clock_changes::was_left_out, first_few::first_few,
};

/// A value this many widths of the training range beyond it is not a state of a plant. Our choice.
const ABSURD: f64 = 1_000.0;
/// So many widths of the training range beyond it, in so large a share of the held-out period, an input says nothing that agents
/// know. Our choice.
pub(crate) const ELSEWHERE: f64 = 20.0;
const MUCH: f64 = 0.1;
/// A longer gap is reported.
const YEAR_SECS: f64 = 365.0 * 86_400.0;

/// Returns the warning for a gap of years, of `micros` microseconds after `from`.
pub fn long_gap(from: Timestamp, micros: i64) -> String {
    let years = micros as f64 / 1e6 / YEAR_SECS;
    let to = Timestamp::from_micros(from.as_micros().saturating_add(micros));
    format!(
        "nothing was recorded for {years:.1} years, from {} to {}: if one of these times is wrong, correct or delete its rows; else data.train and data.held_out \
         say which part is meant",
        format_time(from),
        format_time(to)
    )
}

/// Returns the warning for a log in which more than a tenth of the steps are gaps: its period is probably wrong.
/// `devices` names a column by which one of several devices can be chosen.
pub fn many_gaps(
    gaps: u64,
    steps: u64,
    period_secs: f64,
    remedy: &str,
    devices: &str,
) -> Option<String> {
    (10 * gaps > steps).then(|| {
        format!(
            "{gaps} of {steps} steps in time are longer than the sample period of {period_secs} s, and there is no transition across them: \
             if several devices write in turn, keep one with data.where{devices}; else {remedy} data.period_secs"
        )
    })
}

/// Returns the warning for a log whose sampling interval differs from the period in the study.
pub fn contradicted_period(period_secs: f64, recorded_secs: f64) -> String {
    format!(
        "the rows are recorded every {recorded_secs} s, and data.period_secs asks for one every {period_secs} s: \
         set data.period_secs = {recorded_secs}, or set data.resample to put them on the other clock"
    )
}

/// Returns the warning for `tags` tags if most rows have a value of only one of them.
fn own_times(tags: usize, resampled: bool) -> String {
    if resampled {
        return format!(
            "most rows have a value of only one of {tags} tags, although data.resample puts all on one clock: raise data.max_age_secs above the longest \
             time between two values of a tag, or raise data.period_secs"
        );
    }
    format!(
        "most rows have a value of only one of {tags} tags: if each has times of its own, put them on one clock with data.resample, data.period_secs and \
         data.max_age_secs, such as --set data.resample=last --set data.period_secs=60 --set data.max_age_secs=600"
    )
}

/// Returns the number of tags, if most of `rows` rows have a value of only one of them. `present` is the number of rows
/// with a value, per tag. Every row has at least one value.
fn with_own_times(present: impl Iterator<Item = f64>, rows: f64) -> Option<usize> {
    let (mut tags, mut values) = (0, 0.0);
    for present in present.filter(|present| *present > 0.0) {
        tags += 1;
        values += present;
    }
    (tags > 1 && 2.0 * values < 3.0 * rows).then_some(tags)
}

/// Channels with a value in a smaller share of the rows are recorded less often than others. Our choice.
const SELDOM: f64 = 0.5;
/// A channel is on a slower clock than its log if its own period is so many times that of the log. Our choice.
const SLOWER: f64 = 1.5;

/// Returns the warning for `channels` without a value in most rows of a log of several files or tags; `None` for no
/// channels.
fn recorded_less_often(channels: &[String]) -> Option<String> {
    let named = first_few(channels)?;
    let have = if channels.len() == 1 { "has" } else { "have" };
    Some(format!(
        "{named} {have} no value in most rows: if other times or fewer were recorded of them, put all channels on one clock with data.resample, data.period_secs and \
         data.max_age_secs, such as --set data.resample=last --set data.period_secs=60 --set data.max_age_secs=600"
    ))
}

impl Sketch {
    /// What is said of channels that most rows have no value of because they are on a slower clock, where several files or tags are not on one. A
    /// sensor that was installed late has the period of the others.
    pub fn seldom_doubt(&self) -> Option<String> {
        if self.resampled || self.shape == Shape::Wide && self.files < 2 {
            return None;
        }
        let rows = self.timestamps.len() as f64;
        let seldom = self.channels.iter().filter(|channel| {
            let bins = self.bins.iter().zip(&channel.present);
            let present = bins.map(|(bin, present)| bin.len() as f64 * present).sum::<f64>() / rows;
            let is_slower =
                channel.own_period_secs.is_some_and(|secs| secs > SLOWER * self.period_secs);
            is_slower && present < SELDOM
        });
        recorded_less_often(&seldom.map(|channel| channel.name.clone()).collect::<Vec<String>>())
    }

    /// Whether each tag was recorded at its own times, and the tags are not on one clock yet.
    pub fn needs_resampling(&self) -> bool {
        !self.resampled && self.tags_with_own_times().is_some()
    }

    /// Returns the warning if most rows have a value of only one of several tags.
    pub fn own_times_doubt(&self) -> Option<String> {
        Some(own_times(self.tags_with_own_times()?, self.resampled))
    }

    /// Returns the number of tags, if most rows have a value of only one of them.
    fn tags_with_own_times(&self) -> Option<usize> {
        if self.shape == Shape::Wide {
            return None;
        }
        let present = self.channels.iter().map(|channel| {
            let bins = self.bins.iter().zip(&channel.present);
            bins.map(|(bin, present)| bin.len() as f64 * present).sum::<f64>()
        });
        with_own_times(present, self.timestamps.len() as f64)
    }
}

/// Returns the warning for a log without times.
pub fn without_times(period_secs: f64, files: usize) -> String {
    let between = if files > 1 { ", with a gap before each further file" } else { "" };
    format!(
        "THE LOG HAS NO COLUMN OF TIMES: its rows are taken to be {period_secs} s apart, from 1970-01-01 00:00:00 on{between}, as data.period_secs has it. \
         If a column has the times, name it with data.timestamp"
    )
}

/// Returns the warning for an entry of `data.exclude` that matches no channel, so that it leaves nothing out.
pub fn unused_exclude(entry: &str) -> String {
    format!("data.exclude = \"{entry}\" matches no channel")
}

impl Profile {
    /// What is said of channels that are dropped because most rows have no value of them, where several files at the same time or tags are not on
    /// one clock. Files that follow each other are of one clock.
    fn seldom_doubt(&self) -> Option<String> {
        if self.resampled || self.shape == Shape::Wide && !self.has_files_at_once() {
            return None;
        }
        let seldom = self.channels.iter().filter(|channel| {
            matches!(channel.dropped, Some(DropReason::Missing { fraction, .. }) if fraction > 1.0 - SELDOM)
        });
        recorded_less_often(&seldom.map(|channel| channel.name.clone()).collect::<Vec<String>>())
    }

    /// Whether files are of the same times. Files of a day each may only share a row at midnight.
    fn has_files_at_once(&self) -> bool {
        let shared = self.duplicates.identical + self.duplicates.conflicting + self.merged_rows;
        self.overlapping_files > 0 && shared != self.overlapping_files
    }

    /// Returns the warning for the hour that clocks in Europe skip in spring; `None` if no gap of a log without a zone
    /// is this hour.
    fn left_out_hour(&self) -> Option<String> {
        let mut gaps = self.gaps.examples.iter().filter(|_| !self.utc);
        let hour = gaps.find_map(|&(from, to)| was_left_out(from, to, self.period_secs))?;
        Some(format!(
            "the hour from {hour} is missing: on the last Sunday of March clocks in Europe are set forward. If the log has such times, set data.time_zone, such as \
             \"Europe/Berlin\", \"Europe/London\" or \"Europe/Helsinki\" (on the command line, --set data.time_zone=Europe/Berlin)"
        ))
    }

    /// Returns the number of tags, if most rows have a value of only one of them.
    fn tags_with_own_times(&self) -> Option<usize> {
        if self.shape == Shape::Wide {
            return None;
        }
        let known = self.channels.iter().filter(|channel| channel.values.is_some());
        let present = known.map(|channel| self.rows.saturating_sub(channel.missing) as f64);
        with_own_times(present, self.rows as f64)
    }

    /// Returns warnings about the log's clock, in sentences; empty for a good log.
    ///
    /// If most steps contradict a given period, segments have one row or rows run together. If a numeric sensor is
    /// taken for the timestamp, it lies in the first weeks of 1970. Both are possible readings of a log, so they are
    /// not errors.
    pub fn clock_doubts(&self) -> Vec<String> {
        /// 1990-01-01, before plants logged to Parquet.
        const EARLY: Timestamp = Timestamp::from_micros(631_152_000_000_000);
        let steps = self.rows.saturating_sub(1);
        let mut doubts = self.read_as.clone();
        let remedy = if self.period_was_detected { "set" } else { "correct or remove" };
        let tags = self.tags_with_own_times();
        doubts.extend(match (tags, self.recorded_period_secs) {
            (Some(tags), _) => Some(own_times(tags, self.resampled)),
            (None, Some(recorded)) => Some(contradicted_period(self.period_secs, recorded)),
            (None, None) => many_gaps(self.gaps.count, steps, self.period_secs, remedy, ""),
        });
        doubts.extend(self.seldom_doubt().filter(|_| tags.is_none()));
        let is_told = tags.is_some() || self.recorded_period_secs.is_some();
        if !is_told && self.short_steps * 2 > steps {
            doubts.push(format!(
                "{} of {steps} steps in time are shorter than the sample period of {} s, and they count as whole samples: {remedy} data.period_secs",
                self.short_steps, self.period_secs,
            ));
        }
        if let Some((from, to)) = self.gaps.examples.first()
            && self.gaps.longest_secs > YEAR_SECS
        {
            doubts.push(long_gap(*from, to.micros_since(*from)));
        }
        doubts.extend(self.left_out_hour());
        if self.without_times {
            doubts.push(without_times(self.period_secs, self.files));
        } else if self.start < EARLY {
            doubts.push(format!(
                "the log starts at {}: is data.timestamp the column of the time, and data.timestamp_unit its unit?",
                format_time(self.start)
            ));
        }
        doubts
    }

    /// Returns warnings that matter to everything that is made of the log: times that are only numbered, entries of
    /// `data.exclude` that match nothing, and lines that could not be read.
    pub fn reading_doubts(&self) -> Vec<String> {
        let mut told = Vec::new();
        if self.without_times {
            told.push(without_times(self.period_secs, self.files));
        }
        told.extend(self.unused_excludes.iter().map(|entry| unused_exclude(entry)));
        told.extend(self.bad_rows.doubt());
        told
    }

    /// Returns the warning for numbers that probably stand for a missing value; `None` if there are no such numbers.
    pub fn sentinel_doubt(&self) -> Option<String> {
        Sentinel::doubt(&self.sentinels)
    }

    /// Whether an input of the agent of `sensor` is far from its training range in much of the held-out period, for
    /// example because its unit changed.
    pub fn has_inputs_elsewhere(&self, sensor: &str) -> bool {
        let Some(held_out) = &self.held_out else { return false };
        let mut inputs = self.kept().filter(|channel| channel.name != sensor);
        inputs.any(|channel| channel.far_out.elsewhere as f64 > MUCH * held_out.log_rows as f64)
    }

    /// What is said of columns that agents read, and that are not `predicted`, whose unit probably changed in the training range. Of those that
    /// are [`Self::value_doubts`] tells.
    pub fn unit_doubts(&self, predicted: &[String], clock: &ShownClock) -> Vec<String> {
        let inputs = self.kept().filter(|channel| !predicted.contains(&channel.name));
        let told = inputs.filter_map(|channel| {
            Some(format!("{} has {}", channel.name, channel.unit_doubt(clock)?))
        });
        told.collect()
    }

    /// Returns warnings about inputs of agents that make held-out errors meaningless, in sentences; empty for a good
    /// log. If only one sensor is `predicted`, [`Self::value_doubts`] covers it.
    pub fn held_out_doubts(&self, predicted: &[String]) -> Vec<String> {
        let far: Vec<&ChannelProfile> =
            self.kept().filter(|channel| *predicted != [channel.name.as_str()]).collect();
        let far = most_first(far, |channel| {
            let FarOut { held_out, furthest, .. } = channel.far_out;
            let side = if furthest < 0.0 { "below" } else { "above" };
            let values = if held_out == 1 { "value" } else { "values" };
            format!(
                "{} ({held_out} {values}, up to {:.0} widths {side} it)",
                channel.name,
                furthest.abs()
            )
        });
        let far = far.map(|told| {
            format!(
                "columns that agents read are far outside of their training range in the held-out period: {told}. Errors there may come from these \
                 columns alone: correct them if a unit changed or a sensor failed, or leave them out with data.exclude"
            )
        });
        far.into_iter().chain(self.late_changes()).collect()
    }

    /// Returns the warning for a held-out period without transitions, with the channels that cause it; `None` if it has
    /// some, or there is no held-out period.
    pub fn nothing_to_score(&self) -> Option<String> {
        let part = self.held_out.as_ref().filter(|part| part.transitions == 0)?;
        let mut channels: Vec<&ChannelProfile> =
            self.kept().filter(|channel| channel.unfilled > 0).collect();
        channels.sort_by_key(|channel| std::cmp::Reverse(channel.unfilled));
        let missing = channels
            .iter()
            .map(|channel| format!("{} misses {} values", channel.name, channel.unfilled));
        let missing: Vec<String> = missing.collect();
        let remedy = match first_few(&missing).filter(|_| part.dropped_rows > 0) {
            Some(missing) => {
                format!(
                    "{missing}: leave such channels out with data.exclude, raise preprocess.fill_limit"
                )
            }
            None => "Check data.period_secs and data.gap_tolerance".to_owned(),
        };
        Some(format!(
            "nothing can be scored: the held-out period has no two successive rows left ({} rows, {} of them dropped for missing values). {remedy}, \
             or hold out another period",
            part.log_rows, part.dropped_rows
        ))
    }

    /// Returns the warning for channels that are constant in the training range but not in the held-out period; `None`
    /// if there are no such channels.
    pub fn late_changes(&self) -> Option<String> {
        let constant = self
            .channels
            .iter()
            .filter(|channel| matches!(channel.dropped, Some(DropReason::Constant { .. })));
        let told = most_first(constant.collect(), |channel| {
            let differ =
                if channel.far_out.held_out == 1 { "value differs" } else { "values differ" };
            format!("{} ({} {differ})", channel.name, channel.far_out.held_out)
        });
        told.map(|told| {
            format!(
                "channels that are constant in the training range change in the held-out period: {told}. No agent reads them: if they matter, let \
                 data.train include a time in which they change"
            )
        })
    }

    /// Returns warnings about the values of the kept channels that spoil a model or a verdict: each channel with a
    /// sentence that does not name it. Empty for a good log.
    pub fn value_doubts(&self, clock: &ShownClock) -> Vec<(&str, String)> {
        let mut doubts = Vec::new();
        let mut doubted: Vec<&str> = Vec::new();
        for channel in self.kept() {
            if let Some(angle) = &channel.angle
                && !doubted.contains(&angle.channel.as_str())
            {
                doubted.push(&angle.channel);
                doubts.extend(angle.doubt().map(|doubt| (channel.name.as_str(), doubt)));
            }
            let FarOut { spikes, held_out, furthest, .. } = channel.far_out;
            let name = channel.name.as_str();
            doubts.extend(channel.unit_doubt(clock).map(|doubt| (name, doubt)));
            let BridgedStops { count, longest_secs, usual_secs } = channel.bridged;
            if count > 0 {
                let times = if count == 1 { "once".to_owned() } else { format!("{count} times") };
                doubts.push((name, format!(
                    "not recorded {times}, for up to {longest_secs} s where it usually is every {usual_secs} s, and its last value stands in: \
                     lower its age, data.max_age_secs = {{ default = …, {name:?} = … }}, if it was not what the plant did"
                )));
            }
            if spikes > 0 {
                let example = channel.far_out.examples.first();
                let example = example.map_or_else(String::new, |(time, value)| {
                    format!(" (such as {value} at {})", clock.named(*time))
                });
                let spikes =
                    if spikes == 1 { "a spike".to_owned() } else { format!("{spikes} spikes") };
                doubts.push((
                    name,
                    format!("{spikes}{example}: preprocess.outliers says what becomes of them"),
                ));
            }
            if held_out > 0 {
                let lost_sign = if furthest.abs() > ABSURD {
                    ". Was the decimal sign of some values lost, or their unit changed?"
                } else {
                    ""
                };
                let values = if held_out == 1 {
                    "a held-out value is".to_owned()
                } else {
                    format!("{held_out} held-out values are")
                };
                let furthest = channel.far_out.furthest_value().unwrap_or_default();
                doubts.push((
                    name,
                    format!("{values} far outside of the training range{furthest}{lost_sign}"),
                ));
            }
        }
        doubts
    }
}

impl ChannelProfile {
    /// What is said where its unit probably changed, without its name.
    fn unit_doubt(&self, clock: &ShownClock) -> Option<String> {
        let change = self.unit_change.as_ref()?;
        Some(change.told(&clock.named(change.at)))
    }
}

impl FarOut {
    /// Compares the furthest held-out value with the end of the training range, as the end of a sentence; `None` if
    /// they are unknown.
    fn furthest_value(&self) -> Option<String> {
        let [low, high] = self.trained?;
        let (end, name) = if self.furthest < 0.0 { (low, "minimum") } else { (high, "maximum") };
        let value = end + self.furthest * (high - low);
        if value == end {
            return Some(format!(", which is {} throughout", number(end)));
        }
        let [value, end] = numbers_apart([value, end]);
        Some(format!(", up to {value}: the training {name} is {end}"))
    }
}

/// Lists the few of the `channels` with the most held-out values far out, each described by `told`, and the number of
/// further ones; `None` if there are none.
fn most_first(
    mut channels: Vec<&ChannelProfile>,
    told: impl Fn(&ChannelProfile) -> String,
) -> Option<String> {
    channels.retain(|channel| channel.far_out.held_out > 0);
    channels.sort_by_key(|channel| std::cmp::Reverse(channel.far_out.held_out));
    let all: Vec<String> = channels.into_iter().map(told).collect();
    first_few(&all)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(furthest: f64, trained: [f64; 2]) -> String {
        let far_out = FarOut { furthest, trained: Some(trained), ..FarOut::default() };
        far_out.furthest_value().expect("known")
    }

    #[test]
    fn the_furthest_value_looks_different_from_the_end_of_the_training_range() {
        assert_eq!(told(2.0, [499.8, 500.0]), ", up to 500.4: the training maximum is 500");
        assert_eq!(told(-3.0, [10.0, 20.0]), ", up to -20: the training minimum is 10");
        assert_eq!(told(0.0, [500.0, 500.0]), ", which is 500 throughout");
        assert_eq!(FarOut::default().furthest_value(), None);
    }
}
