//! What in a log is probably not as meant, in sentences.

use calib_core::Timestamp;
use calib_text::format_time;

use crate::{
    BridgedStops, ChannelProfile, DropReason, FarOut, Profile, Sentinel, Shape, ShownClock, Sketch,
    clock_changes::was_left_out,
};

/// So many widths of the training range beyond it are no state of a plant. Our choice.
const ABSURD: f64 = 1_000.0;
/// So many widths of the training range beyond it, in so large a share of the held-out period, an input says nothing that agents
/// know. Our choice.
pub(crate) const ELSEWHERE: f64 = 20.0;
const MUCH: f64 = 0.1;
/// Channels that a sentence about several names.
const NAMED: usize = 5;
/// A gap that is longer is said.
const YEAR_SECS: f64 = 365.0 * 86_400.0;

/// What is said of a gap of years, of so many microseconds from `from` on.
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

/// What is said of a log in which more than a tenth of the steps in time are gaps: its period is not what it seems. `devices` names a
/// column by which one of several devices may be kept.
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

/// What is said of a log whose rows are not as far apart as the period that the study gives.
pub fn contradicted_period(period_secs: f64, recorded_secs: f64) -> String {
    format!(
        "the rows are recorded every {recorded_secs} s, and data.period_secs asks for one every {period_secs} s: \
         set data.period_secs = {recorded_secs}, or set data.resample to put them on the other clock"
    )
}

/// What is said of so many tags of which most rows have one alone.
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

/// How many tags there are, if most of so many rows have a value of only one of them. `present` is how many rows each has a value in; every row has
/// one at least.
fn with_own_times(present: impl Iterator<Item = f64>, rows: f64) -> Option<usize> {
    let (mut tags, mut values) = (0, 0.0);
    for present in present.filter(|present| *present > 0.0) {
        tags += 1;
        values += present;
    }
    (tags > 1 && 2.0 * values < 3.0 * rows).then_some(tags)
}

/// Channels with a value in fewer rows than this are recorded less often than others. Our choice.
const SELDOM: f64 = 0.5;
/// A channel is on a slower clock than its log if its own period is so many times that of the log. Our choice.
const SLOWER: f64 = 1.5;

/// What is said of `channels` that most rows of a log of several files or tags have no value of; none of none.
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

    /// Whether each tag was recorded at times of its own, and they are not on one clock yet.
    pub fn needs_resampling(&self) -> bool {
        !self.resampled && self.tags_with_own_times().is_some()
    }

    /// What is said where most rows have a value of only one of several tags; none where they have more.
    pub fn own_times_doubt(&self) -> Option<String> {
        Some(own_times(self.tags_with_own_times()?, self.resampled))
    }

    /// How many tags there are, if most rows have a value of only one of them; `None` if not.
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

/// What is said of a log without times.
pub fn without_times(period_secs: f64, files: usize) -> String {
    let between = if files > 1 { ", with a gap before each further file" } else { "" };
    format!(
        "THE LOG HAS NO COLUMN OF TIMES: its rows are taken to be {period_secs} s apart, from 1970-01-01 00:00:00 on{between}, as data.period_secs has it. \
         If a column has the times, name it with data.timestamp"
    )
}

impl Profile {
    /// What is said of channels that are dropped because most rows have no value of them, where several files at the same time or tags are not on
    /// one clock. Files that follow each other are of one clock.
    fn seldom_doubt(&self) -> Option<String> {
        if self.resampled || self.shape == Shape::Wide && self.overlapping_files == 0 {
            return None;
        }
        let seldom = self.channels.iter().filter(|channel| {
            matches!(channel.dropped, Some(DropReason::Missing { fraction, .. }) if fraction > 1.0 - SELDOM)
        });
        recorded_less_often(&seldom.map(|channel| channel.name.clone()).collect::<Vec<String>>())
    }

    /// What is said of the hour that clocks in Europe leave out in spring; none where no gap of a log without a zone is that.
    fn left_out_hour(&self) -> Option<String> {
        let mut gaps = self.gaps.examples.iter().filter(|_| !self.utc);
        let date = gaps.find_map(|&(from, to)| was_left_out(from, to, self.period_secs))?;
        Some(format!(
            "the hour from 02:00 on {date} is missing: on the last Sunday of March clocks in Europe are set forward. If the log has such times, set data.time_zone, such as \
             \"Europe/Berlin\" (on the command line, --set data.time_zone=Europe/Berlin)"
        ))
    }

    /// How many tags there are, if most rows have a value of only one of them; `None` if not.
    fn tags_with_own_times(&self) -> Option<usize> {
        if self.shape == Shape::Wide {
            return None;
        }
        let known = self.channels.iter().filter(|channel| channel.values.is_some());
        let present = known.map(|channel| self.rows.saturating_sub(channel.missing) as f64);
        with_own_times(present, self.rows as f64)
    }

    /// What in the log's clock is probably not as meant, in sentences; empty for a good log.
    ///
    /// A given period that most steps contradict makes segments of one row or runs rows together,
    /// and a numeric sensor taken for the timestamp lies in the first weeks of 1970. Both are
    /// possible readings of a log, so they are no errors.
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

    /// What is said of numbers that probably stand for a missing value; none where there are none.
    pub fn sentinel_doubt(&self) -> Option<String> {
        let values: Vec<String> =
            self.sentinels.iter().map(|sentinel| sentinel.value.to_string()).collect();
        let told: Vec<String> = self.sentinels.iter().map(Sentinel::told).collect();
        (!told.is_empty()).then(|| {
            format!(
                "{}: if that stands for a missing value, as loggers write it, set data.missing_values = [{}] (on the command line, --set data.missing_values=[{}])",
                told.join("; "),
                values.join(", "),
                values.join(",")
            )
        })
    }

    /// Whether a column that the agent of a sensor reads beside it is far from its training range in much of the held-out period, as where
    /// its unit changed.
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

    /// What of the columns that agents read makes their held-out errors worth little, in sentences; empty for a good log. Where one
    /// sensor alone is `predicted`, [`Self::value_doubts`] tells of it.
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

    /// What is said where the held-out period has no transition, with the channels to blame; none where it has some, or nothing is held
    /// out.
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

    /// What is said of channels that are constant in the training range and not in the held-out period; none where there are none.
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

    /// What in the values of the kept channels spoils a model or a verdict: channels, each with sentences that do not name it; empty for
    /// a good log.
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
    /// The furthest held-out value beside the end of the training range, as the end of a sentence; `None` if they are not known.
    fn furthest_value(&self) -> Option<String> {
        let [low, high] = self.trained?;
        let (end, name) = if self.furthest < 0.0 { (low, "minimum") } else { (high, "maximum") };
        let value = end + self.furthest * (high - low);
        Some(format!(", up to {}: the training {name} is {}", short(value), short(end)))
    }
}

/// Four digits of a value, without an exponent where it needs none.
fn short(value: f64) -> String {
    let rounded: f64 = format!("{value:.3e}").parse().unwrap_or(value);
    if rounded != 0.0 && !(1e-4..1e9).contains(&rounded.abs()) {
        format!("{rounded:e}")
    } else {
        rounded.to_string()
    }
}

/// What is said of channels that are pairs of words, each [with them](crate::switches::Switch::told); none of none.
pub(crate) fn read_as_switches(channels: &[String]) -> Option<String> {
    let named = first_few(channels)?;
    Some(format!(
        "words are read as 1 and 0: {named}; preprocess.one_hot makes columns of the words of a channel instead"
    ))
}

/// The few of the `channels` with most held-out values far out, as `told` has each, and how many more have any; none where none has.
fn most_first(
    mut channels: Vec<&ChannelProfile>,
    told: impl Fn(&ChannelProfile) -> String,
) -> Option<String> {
    channels.retain(|channel| channel.far_out.held_out > 0);
    channels.sort_by_key(|channel| std::cmp::Reverse(channel.far_out.held_out));
    let all: Vec<String> = channels.into_iter().map(told).collect();
    first_few(&all)
}

/// The first few of `all`, and how many more there are; none of nothing.
pub(crate) fn first_few(all: &[String]) -> Option<String> {
    let (named, more) = all.split_at(all.len().min(NAMED));
    let more = if more.is_empty() { String::new() } else { format!(" and {} more", more.len()) };
    (!named.is_empty()).then(|| format!("{}{more}", named.join(", ")))
}
