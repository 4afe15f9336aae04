use anyhow::{Context as _, ensure};
use calib_data::{ChannelProfile, DataConfig, PartProfile, PreprocessConfig, Profile, format_time};
use calib_study::{Job, Request};

use super::plant_of_study;
use crate::{
    cli::InspectArgs,
    exit::ExitStatus,
    memory,
    output::{Printer, bytes, count, percent, significant, table},
};

/// Channels that are listed without `--all`.
const LISTED: usize = 60;

/// Show what is in a log, and what preprocessing would make of it.
pub(super) fn run(args: &InspectArgs, printer: &Printer) -> anyhow::Result<ExitStatus> {
    let Settings { data, preprocess, deployments } = settings(args)?;
    printer.say(&format!("inspect: reading {}", data.path.0.join(", ")));
    memory::check_log(&data)?;
    let profile = calib_data::inspect(&data, &preprocess, &printer.progress())?;
    if printer.is_for_machines() {
        printer.json(&profile)?;
    } else {
        show_log(&profile, printer)?;
        show_channels(&profile, args, printer)?;
        let of = |(name, data): (String, DataConfig)| {
            let profile = calib_data::inspect(&data, &preprocess, &printer.progress())
                .with_context(|| format!("[deployments.{name}]"))?;
            Ok(profile.held_out.map(|held_out| (name, held_out)))
        };
        let deployments: Vec<_> = deployments.into_iter().map(of).collect::<anyhow::Result<_>>()?;
        let deployments: Vec<(String, PartProfile)> = deployments.into_iter().flatten().collect();
        show_parts(&profile, &deployments, printer)?;
    }
    let usable = profile.train.transitions > 0 && profile.kept().next().is_some();
    if !usable {
        printer.warn(
            "no channel or no transition is left: nothing could be built from this log as it is",
        );
    }
    Ok(if usable { ExitStatus::Done } else { ExitStatus::Negative })
}

/// A study's own sections, or the defaults for data alone.
fn settings(args: &InspectArgs) -> anyhow::Result<Settings> {
    let study = if args.data.extension().is_some_and(|extension| extension == "toml") {
        let job = Job::resolve(Request {
            set: args.set.clone(),
            profile: args.profile.clone(),
            ..Request::new(&args.data)
        })?;
        let (study, data) = (job.study(), plant_of_study::data(&job)?);
        let of = |name: String| {
            let held_out = study.deployments.get(&name).cloned();
            (name, DataConfig { held_out, ..data.clone() })
        };
        let deployments = study.deployment_names().into_iter().map(of).collect();
        return Ok(Settings { data, preprocess: study.preprocess.clone(), deployments });
    } else {
        ensure!(
            args.profile.is_none(),
            "--profile is of a study, and {} is none; leave it out",
            args.data.display()
        );
        calib_study::of_data(&args.data, &args.set)?
    };
    Ok(Settings { data: study.data, preprocess: study.preprocess, deployments: Vec::new() })
}

/// What to look at.
struct Settings {
    data: DataConfig,
    preprocess: PreprocessConfig,
    /// The deployments of a study, each as what is held out.
    deployments: Vec<(String, DataConfig)>,
}

fn show_log(profile: &Profile, printer: &Printer) -> anyhow::Result<()> {
    let period = if profile.period_was_detected { "detected" } else { "given" };
    printer.result(&format!(
        "{} rows in {} files ({}), {} to {}",
        count(profile.file_rows as usize),
        count(profile.files),
        bytes(profile.bytes),
        format_time(profile.start),
        format_time(profile.end),
    ))?;
    printer.result(&format!(
        "sample period {} s ({period}); one state every {} s",
        significant(profile.period_secs),
        significant(profile.sampled_period_secs),
    ))?;
    let gaps = &profile.gaps;
    let longest = if gaps.count == 0 {
        String::new()
    } else {
        format!(
            " (longest {} s, {} s in all)",
            significant(gaps.longest_secs),
            significant(gaps.total_secs)
        )
    };
    printer.result(&format!("gaps: {}{longest}", count(gaps.count as usize)))?;
    for (from, to) in &gaps.examples {
        printer.result(&format!("    {} to {}", format_time(*from), format_time(*to)))?;
    }
    let oddities = [
        (profile.duplicates.identical, "duplicate rows (dropped)"),
        (
            profile.duplicates.conflicting,
            "rows that contradict another of the same time (the first is kept)",
        ),
        (profile.backward_steps.count, "steps back in time (rows are put in order)"),
        (profile.null_timestamps, "rows without a timestamp of the years 1 to 9998 (dropped)"),
        (profile.short_steps, "steps shorter than the period (tolerated)"),
        (profile.overlapping_files, "files that overlap another (merged by time)"),
        (profile.rows_outside, "rows outside the training and held-out ranges"),
        (profile.unseen_modes, "held-out rows in a mode that training does not have"),
    ];
    for (number, what) in oddities.iter().filter(|(number, _)| *number > 0) {
        printer.result(&format!("{}: {what}", count(*number as usize)))?;
    }
    profile.clock_doubts().iter().for_each(|doubt| printer.warn(doubt));
    for pattern in &profile.unused_excludes {
        printer.warn(&format!("data.exclude = \"{pattern}\" matches no channel"));
    }
    Ok(())
}

fn show_channels(profile: &Profile, args: &InspectArgs, printer: &Printer) -> anyhow::Result<()> {
    let header = ["channel", "min", "max", "mean", "missing", "stuck", "step", "distinct", "use"];
    let shown = if args.all { profile.channels.len() } else { LISTED };
    let rows: Vec<Vec<String>> = profile.channels.iter().take(shown).map(channel_row).collect();
    printer.result("")?;
    printer.lines(&table(&header, &rows))?;
    if profile.channels.len() > shown {
        let more = profile.channels.len() - shown;
        printer.result(&format!("… and {} more; --all shows them", count(more)))?;
    }
    Ok(())
}

fn channel_row(channel: &ChannelProfile) -> Vec<String> {
    let number = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), significant);
    let values = channel.values.as_ref();
    let fate =
        channel.dropped.as_ref().map_or_else(|| "kept".to_owned(), |why| format!("dropped: {why}"));
    let mut notes = Vec::new();
    if !channel.words.is_empty() {
        let words = channel.words.iter().map(|(word, times)| format!("\"{word}\" x{times}"));
        notes.push(words.collect::<Vec<_>>().join(", "));
    }
    if channel.non_finite > 0 {
        notes.push(format!("{} not finite", count(channel.non_finite as usize)));
    }
    let notes = if notes.is_empty() { String::new() } else { format!("; {}", notes.join("; ")) };
    vec![
        channel.name.clone(),
        number(values.map(|of| of.min)),
        number(values.map(|of| of.max)),
        number(values.map(|of| of.mean)),
        percent(channel.missing_fraction),
        values.map_or_else(
            || "–".to_owned(),
            |of| format!("{} s", significant(of.longest_stuck_secs)),
        ),
        number(values.and_then(|of| of.smallest_change)),
        values
            .and_then(|of| of.distinct)
            .map_or_else(|| ">256".to_owned(), |distinct| distinct.to_string()),
        format!("{fate}{notes}"),
    ]
}

fn show_parts(
    profile: &Profile,
    deployments: &[(String, PartProfile)],
    printer: &Printer,
) -> anyhow::Result<()> {
    printer.result("")?;
    let imputed: u64 = profile.channels.iter().map(|channel| channel.imputed).sum();
    printer.result(&format!(
        "{} of {} channels kept; {} columns of the states, {}; {} missing values filled",
        count(profile.kept().count()),
        count(profile.channels.len()),
        count(profile.columns),
        bytes(profile.state_bytes),
        count(imputed as usize),
    ))?;
    printer.result(&part("training", &profile.train))?;
    match &profile.held_out {
        Some(held_out) => printer.result(&part("held out", held_out)),
        None if deployments.is_empty() => printer.result("held out: nothing"),
        None => deployments
            .iter()
            .try_for_each(|(name, of)| printer.result(&part(&format!("deployment {name}"), of))),
    }
}

fn part(name: &str, part: &PartProfile) -> String {
    format!(
        "{name}: {} to {}; {} rows of the log, {} dropped for missing values; {} states in {} segments, {} transitions",
        format_time(part.start),
        format_time(part.end),
        count(part.log_rows as usize),
        count(part.dropped_rows as usize),
        count(part.rows as usize),
        count(part.segments as usize),
        count(part.transitions as usize),
    )
}
