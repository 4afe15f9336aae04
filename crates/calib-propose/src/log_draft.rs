use std::collections::HashSet;

use calib_data::{AnglePart, Sentinel, Sketch, entry_of};

use crate::{
    Angle, Cleaning, Clock, Scope,
    lines::{Lines, list, number, numbers},
    written::{key, quoted},
};

/// Returns the entries of `data.exclude` for the channels that are left out.
fn entries(scope: &Scope, sketch: &Sketch) -> Vec<String> {
    let channels: HashSet<&str> =
        sketch.channels.iter().map(|channel| channel.name.as_str()).collect();
    let names = scope.left_out.iter().map(|left_out| &left_out.name);
    names.map(|name| entry_of(name, |name| channels.contains(name))).collect()
}

/// Returns `data.exclude` as TOML: the given entries, then the channels that are left out.
pub fn exclusions(given: &[String], scope: &Scope, sketch: &Sketch) -> String {
    let entries = entries(scope, sketch);
    let all: Vec<String> = given.iter().chain(&entries).map(|entry| quoted(entry)).collect();
    list(&all)
}

/// The `[data]` section of a proposed study with the reasons, except for its ranges.
#[derive(Clone, Copy, Debug)]
pub struct LogDraft<'a> {
    /// Measurements of the log.
    pub sketch: &'a Sketch,
    /// `data.path` in the study.
    pub path: &'a str,
    /// The part of the log, and its channels.
    pub scope: &'a Scope,
    /// Gap tolerance, fill limit and contradictory rows.
    pub cleaning: &'a Cleaning,
    /// Numbers that stand for a missing value; empty if the user named them.
    pub missing_values: &'a [Sentinel],
    /// Channels that are angles; empty if the user named them.
    pub angles: &'a [Angle],
    /// The common clock, if channels have clocks of their own.
    pub clock: Option<Clock>,
}

impl LogDraft<'_> {
    /// Writes the section; `ranges` writes the keys of the ranges.
    pub(crate) fn write(&self, text: &mut Lines, ranges: impl FnOnce(&mut Lines)) {
        let Self { sketch, scope, .. } = self;
        text.section("data");
        text.key("path", &quoted(self.path), "");
        if let Some(clock) = self.clock {
            text.key(
                "resample",
                "\"last\"",
                "channels were recorded at times of their own: each is put on one clock",
            );
            text.key(
                "period_secs",
                &number(clock.period_secs),
                "about as often as half of them were recorded",
            );
            text.key(
                "max_age_secs",
                &number(clock.max_age_secs),
                "what is older counts as missing",
            );
        }
        if !self.missing_values.is_empty() {
            let told: Vec<String> = self.missing_values.iter().map(Sentinel::told).collect();
            let values = numbers(self.missing_values.iter().map(|missing| missing.value));
            text.key("missing_values", &values, &told.join("; "));
        }
        if scope.is_part {
            let share = scope.rows.len() as f64 / sketch.timestamps.len() as f64;
            text.comment(&format!(
                "{:.0} % of the rows are of the part where most channels are there together, {} of {}",
                100.0 * share,
                scope.channels.len(),
                sketch.channels.len()
            ));
        }
        ranges(text);
        let (tolerance, why) = &self.cleaning.gap_tolerance;
        text.key("gap_tolerance", &number(*tolerance), why);
        if let Some(why) = &self.cleaning.contradictions {
            text.key("contradictions", "\"first\"", why);
        }
        if !scope.left_out.is_empty() {
            text.line("exclude = [");
            for (left_out, entry) in scope.left_out.iter().zip(entries(scope, sketch)) {
                text.comment_after(&format!("    {},", quoted(&entry)), &left_out.why.to_string());
            }
            text.line("]");
        }
        self.write_angles(text);
    }

    /// Writes the angles as a table of their own, each with its reason.
    fn write_angles(&self, text: &mut Lines) {
        if self.angles.is_empty() {
            return;
        }
        text.section("data.angles");
        let channels = self.sketch.channels.iter();
        let names: HashSet<&str> = channels
            .map(|channel| channel.angle.as_ref().map_or(&channel.name, |angle| &angle.channel))
            .map(String::as_str)
            .collect();
        for Angle { channel, turn } in self.angles {
            let entry = entry_of(channel, |name| names.contains(name));
            let why = format!(
                "an angle: it fills a turn and goes on at the other end; {} and {} are channels in its place",
                AnglePart::Sine.channel_of(channel),
                AnglePart::Cosine.channel_of(channel)
            );
            text.key(&key(&entry), &number(*turn), &why);
        }
    }
}
