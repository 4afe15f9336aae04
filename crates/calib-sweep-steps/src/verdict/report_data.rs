//! Facts about the data in the report.

use std::collections::BTreeSet;

use calib_data::ChannelProfile;
use calib_report::{Channel, ChannelStatus, DataProfile};

use crate::verdict::{judged::Judged, learned::Learned};

/// Returns a line on the training data and the held-out data.
pub(crate) fn subtitle(learned: &Learned, judged: &Judged) -> String {
    let clock = &judged.clock;
    let period = format!("Learned from {}", clock.range(learned.times()));
    match &judged.manifest.held_out {
        Some(held_out) => {
            let judged_on = clock.range(held_out.times);
            let name = judged.job.deployment();
            let name = name.map_or_else(String::new, |name| format!("{name}, "));
            let windows = windows(judged, held_out.rows);
            format!(
                "{period}; judged on {windows} of {name}{judged_on}, which nothing had learned from."
            )
        }
        None => format!("{period}; no data was held out."),
    }
}

/// Returns how much of the held-out rows was replayed. There may be fewer windows than fit, and the rest is not used.
fn windows(judged: &Judged, held_out_rows: u64) -> String {
    let steps = judged.manifest.span.steps;
    // Sensors with a longer horizon may have fewer windows.
    let sensors = judged.study().sweep.sensors.iter();
    let counts: BTreeSet<usize> =
        sensors.map(|sensor| judged.manifest.windows_of(sensor).len()).collect();
    let shares = counts
        .iter()
        .map(|count| calib_core::percent((count * steps) as f64 / held_out_rows as f64));
    let unit = if counts.iter().all(|&count| count == 1) { "window" } else { "windows" };
    let beside_gaps = share_beside_gaps(judged)
        .filter(|share| *share < 1.0 - LOST_TO_GAPS)
        .map(|share| format!("; gaps leave {} of them to score", calib_core::percent(share)));
    format!(
        "{} {unit} of {} steps ({} of the states{})",
        counts.iter().map(ToString::to_string).collect::<Vec<String>>().join(" or "),
        calib_core::count(steps as u64),
        shares.collect::<Vec<String>>().join(" or "),
        beside_gaps.unwrap_or_default()
    )
}

/// Gaps that take a larger share of the steps are reported. Our choice.
const LOST_TO_GAPS: f64 = 0.1;

/// Returns the share of the windows' steps that are scored, relative to windows without gaps.
fn share_beside_gaps(judged: &Judged) -> Option<f64> {
    let study = judged.job.study();
    let mut verdicts = judged.summary.verdicts.iter();
    let (sensor, truth) =
        verdicts.find_map(|verdict| Some((&verdict.sensor, verdict.truth.as_ref()?)))?;
    let span = judged.manifest.span_of(sensor);
    let unbroken = 0..span.states();
    let gamma = study.agent.gamma_for(sensor);
    let whole = study.part().scored_steps(std::slice::from_ref(&unbroken), gamma, span.steps);
    let scored: usize = truth.windows.iter().map(|window| window.scored_steps).sum();
    let all = whole * truth.windows.len();
    (all > 0).then(|| scored as f64 / all as f64)
}

/// Returns the profile of the data, and of the parts that were kept.
pub(crate) fn data_profile(learned: &Learned, judged: &Judged) -> DataProfile {
    let profile = &learned.profile;
    let train = &profile.train;
    let mut facts = vec![
        fact("rows of the log", profile.rows),
        fact("files", profile.files as u64),
        fact("gaps", profile.gaps.count),
        fact(
            "duplicate rows dropped",
            profile.duplicates.identical + profile.duplicates.conflicting,
        ),
        fact("steps back in time", profile.backward_steps.count),
        fact("rows dropped for missing values", train.dropped_rows),
        fact("missing values filled", profile.channels.iter().map(|channel| channel.imputed).sum()),
    ];
    facts.extend(deployment_facts(judged));
    let [first, last] = learned.times();
    DataProfile {
        rows: learned.rows as u64,
        segments: learned.segments as u64,
        period_secs: learned.period.as_secs(),
        first: judged.clock.shown(first),
        last: judged.clock.named(last),
        facts,
        channels: profile.channels.iter().map(channel).collect(),
    }
}

fn fact(name: &str, number: u64) -> (String, String) {
    (name.to_owned(), calib_core::count(number))
}

const HELD_OUT: [&str; 2] = ["held-out states", "held-out range"];

/// Returns facts about the deployment that was used for judging.
pub(crate) fn deployment_facts(judged: &Judged) -> Vec<(String, String)> {
    let Some(held_out) = &judged.manifest.held_out else { return Vec::new() };
    let values = [calib_core::count(held_out.rows), judged.clock.range(held_out.times)];
    HELD_OUT.map(str::to_owned).into_iter().zip(values).collect()
}

/// Whether a fact is one of those.
pub(crate) fn is_of_deployment(fact: &str) -> bool {
    HELD_OUT.contains(&fact)
}

fn channel(channel: &ChannelProfile) -> Channel {
    Channel {
        name: channel.name.clone(),
        unit: None,
        min: channel.values.as_ref().map(|values| values.min),
        max: channel.values.as_ref().map(|values| values.max),
        missing: channel.missing_fraction,
        status: channel
            .dropped
            .as_ref()
            .map_or(ChannelStatus::Kept, |reason| ChannelStatus::Dropped(reason.to_string())),
    }
}
