use calib_data::{
    DataConfig, FEW_CONTRADICT, PartProfile, PreprocessConfig, Profile, Sentinel, ShownClock,
    unused_exclude,
};
use calib_pipeline::{
    Descriptions, Inspection, Job, Outcome, Printer, Request, StepError, data_of, ensure,
    inspect_deployments, on_this_machine,
    output::{bytes, count, counted, span, table},
};

use super::{import::shape_name, inspect_channels::show_channels};
use crate::cli::InspectArgs;

/// Shows the content of a log, and the result of preprocessing.
pub(super) fn run(args: &InspectArgs, printer: &Printer) -> Result<Outcome, StepError> {
    let Settings { data, preprocess, deployments, job } = settings(args)?;
    let inspection = Inspection::of(&data, &preprocess, job.as_ref(), printer)?;
    let profile = &inspection.profile;
    if printer.is_json() {
        printer.json(&inspection)?;
    } else {
        let clock = ShownClock::of(&data, profile.utc);
        show_log(profile, &clock, printer)?;
        let descriptions = match &job {
            Some(job) => Descriptions::of(job, profile)?,
            None => Descriptions::of_log(profile),
        };
        let beside = match job.as_ref().and_then(|job| job.study().control.as_ref()) {
            Some(control) => control.beside_the_state(),
            None => Vec::new(),
        };
        // The actions and the reward have been told of, in which fewer numbers count.
        let is_of_states =
            |code: &&Sentinel| code.channels.iter().any(|channel| !beside.contains(channel));
        let codes: Vec<Sentinel> = profile.sentinels.iter().filter(is_of_states).cloned().collect();
        if let Some(doubt) = Sentinel::doubt(&codes) {
            printer.warn(&doubt);
        }
        show_channels(profile, &descriptions, &beside, args, printer)?;
        let deployments = inspect_deployments(deployments, &preprocess, printer)?;
        show_parts(profile, &deployments, &clock, printer)?;
        if let Some(acted) = &inspection.control {
            acted.show(printer)?;
        }
    }
    if let Some(job) = &job {
        for name in calib_pipeline::unknown_sensors(&job.study().sensors, profile) {
            let hint = profile.angle_hint(name).unwrap_or_default();
            printer.warn(&format!("[sensors.{name}] describes no channel of the log{hint}"));
        }
    }
    let refusal = inspection.refusal();
    let is_resolved = job.is_none() && profile.contradictions.are_few(profile.rows);
    if let Some(error) = &refusal {
        let percent = 100.0 * FEW_CONTRADICT;
        printer.warn(&if is_resolved {
            format!("{error}. `calib init` keeps the first, because they are at most {percent:.0} % of the rows")
        } else if job.is_none() {
            format!("a study of this log would be refused: {error}. `calib init` keeps the first of them up to {percent:.0} % of the rows")
        } else {
            format!("a study of this log would be refused: {error}")
        });
    }
    if profile.bad_quality > 0 && 2 * profile.bad_quality > profile.file_rows {
        printer.warn(
            "most samples are of bad quality; name the codes that are good with data.good_quality, such as [\"0\"] where 0 is good, as in PI",
        );
    }
    if refusal.is_some() && !is_resolved {
        return Ok(Outcome::Negative);
    }
    if !inspection.has_states() {
        printer.warn(
            "no channel or no transition is left: nothing could be built from this log as it is",
        );
        return Ok(Outcome::Negative);
    }
    Ok(Outcome::Done)
}

/// Returns the sections of a study, or the defaults if only data is given.
fn settings(args: &InspectArgs) -> Result<Settings, StepError> {
    if args.data.extension().is_some_and(|extension| extension == "toml") {
        let job = Job::resolve(Request {
            set: args.set.clone(),
            profile: args.profile.clone(),
            ..Request::new(&args.data)
        })?;
        let study = job.study();
        let data = data_of(&job)?;
        let deployments = study.deployment_names().into_iter().map(|name| {
            let held_out = study.deployments.get(&name).cloned();
            (name, DataConfig { held_out, ..data.clone() })
        });
        let deployments = deployments.collect();
        let preprocess = study.preprocess.clone();
        return Ok(Settings { data, preprocess, deployments, job: Some(job) });
    }
    ensure!(
        args.profile.is_none(),
        "--profile is of a study, and {} is not one; leave it out",
        args.data.display()
    );
    let study = calib_study::of_data(&args.data, &args.set)?;
    let data = on_this_machine(study.data);
    Ok(Settings { data, preprocess: study.preprocess, deployments: Vec::new(), job: None })
}

/// Settings of an inspection.
struct Settings {
    data: DataConfig,
    preprocess: PreprocessConfig,
    /// Deployments of a study, each as the held-out period.
    deployments: Vec<(String, DataConfig)>,
    /// The study, if there is one.
    job: Option<Job>,
}

fn show_log(profile: &Profile, clock: &ShownClock, printer: &Printer) -> Result<(), StepError> {
    printer.result(&format!("read as {}", shape_name(profile.shape)))?;
    let long = profile.end.micros_since(profile.start) as f64 / 1e6;
    printer.result(&format!(
        "{} in {} ({}), {} to {}: {}, times {}",
        counted(profile.file_rows as usize, "row"),
        counted(profile.files, "file"),
        bytes(profile.bytes),
        clock.shown(profile.start),
        clock.shown(profile.end),
        span(long),
        clock.told(),
    ))?;
    let period = if profile.period_was_detected { "detected" } else { "given" };
    printer.result(&format!(
        "sample period {} ({period}); one state every {}",
        span(profile.period_secs),
        span(profile.sampled_period_secs),
    ))?;
    show_gaps(profile, clock, printer)?;
    let closer = format!("rows closer together than {}", span(profile.period_secs));
    let oddities = [
        (profile.duplicates.identical, "duplicate rows (dropped)"),
        (profile.merged_rows, "rows merged by column with those of another file"),
        (profile.bad_rows.count, BAD_ROWS),
        (profile.duplicates.conflicting, "rows that contradict another of the same time"),
        (profile.bad_quality, "samples of bad quality (missing values)"),
        (profile.backward_steps.count, "steps back in time (rows are put in order)"),
        (profile.null_timestamps, "rows without a timestamp of the years 1 to 9998 (dropped)"),
        (
            profile.undecided_times,
            "of these of an hour that clocks showed twice or never (data.time_zone), which no other row decides",
        ),
        (profile.short_steps, closer.as_str()),
        (profile.overlapping_files, "files that overlap another (merged by time)"),
        (profile.rows_outside, "rows outside the training and held-out ranges"),
        (profile.unseen_modes, "held-out rows in a mode that training does not have"),
    ];
    for (number, what) in oddities.iter().filter(|(number, _)| *number > 0) {
        printer.result(&format!("{}: {what}", count(*number as usize)))?;
        if *what == BAD_ROWS {
            for example in &profile.bad_rows.examples {
                printer.result(&format!("    {example}"))?;
            }
        }
    }
    if let Some(doubt) = calib_pipeline::in_future(profile.end) {
        printer.warn(&doubt);
    }
    profile.clock_doubts().iter().for_each(|doubt| printer.warn(doubt));
    for (channel, doubt) in profile.value_doubts(clock).iter().take(DOUBTS) {
        printer.warn(&format!("{channel}: {doubt}"));
    }
    let doubts = [profile.frozen_doubt(), profile.late_changes(), profile.nothing_to_score()];
    doubts.iter().flatten().for_each(|doubt| printer.warn(doubt));
    profile.unused_excludes.iter().for_each(|entry| printer.warn(&unused_exclude(entry)));
    Ok(())
}

fn show_gaps(profile: &Profile, clock: &ShownClock, printer: &Printer) -> Result<(), StepError> {
    let gaps = &profile.gaps;
    if gaps.count == 0 {
        return printer.result("gaps: none");
    }
    printer.result(&format!(
        "gaps: {}, {} in all; the longest:",
        count(gaps.count as usize),
        span(gaps.total_secs)
    ))?;
    let shown = gaps.examples.iter().map(|(from, to)| {
        let long = span(to.micros_since(*from) as f64 / 1e6);
        vec![format!("    {long}"), clock.shown(*from), clock.shown(*to)]
    });
    printer.lines(&table(&["", "from", "to"], &shown.take(GAPS).collect::<Vec<_>>()))
}

/// Label above the first few damaged lines.
const BAD_ROWS: &str = "lines that cannot be read (left out), such as";

/// Most warnings about values that are shown. The notes below the channels list all.
const DOUBTS: usize = 8;

/// Most gaps that are shown.
const GAPS: usize = 5;

fn show_parts(
    profile: &Profile,
    deployments: &[(String, PartProfile)],
    clock: &ShownClock,
    printer: &Printer,
) -> Result<(), StepError> {
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
    printer.result(&part("training", &profile.train, clock))?;
    match &profile.held_out {
        Some(held_out) => printer.result(&part("held out", held_out, clock)),
        None if deployments.is_empty() => printer.result("held out: nothing"),
        None => deployments.iter().try_for_each(|(name, profile)| {
            printer.result(&part(&format!("deployment {name}"), profile, clock))
        }),
    }
}

fn part(name: &str, part: &PartProfile, clock: &ShownClock) -> String {
    format!(
        "{name}: {} to {}; {} of the log, {} dropped for missing values; {} in {}, {}",
        clock.shown(part.start),
        clock.shown(part.end),
        counted(part.log_rows as usize, "row"),
        count(part.dropped_rows as usize),
        counted(part.rows as usize, "state"),
        counted(part.segments as usize, "segment"),
        counted(part.transitions as usize, "transition"),
    )
}
