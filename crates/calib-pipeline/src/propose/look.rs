//! Examination of a log before any trial.

use calib_base::{
    Context as _, StepError,
    clock::{self, TimeTaken},
    left_alone::text_left_alone,
    memory,
    options::ProposeOptions,
    output::{Printer, count, span},
};
use calib_data::{
    BackwardSteps, ChannelSketch, ContradictionCause, DataConfig, DataError, FEW_CONTRADICT,
    MaxAge, Resample, Sentinel, Sketch, sketch, unused_exclude,
};
use calib_propose::{Angle, Cleaning, Clock, Cut, Scope, Sensors, many_left_out};

use super::given::{gives, gives_any};

/// A log with the results of a first scan.
pub(super) struct SketchedLog {
    pub(super) sketch: Sketch,
    /// Numbers that appear to stand for missing values.
    pub(super) sentinels: Vec<Sentinel>,
    /// Channels that appear to be angles.
    pub(super) angles: Vec<Angle>,
    pub(super) clock: Option<Clock>,
    /// Time to read the log.
    pub(super) read: TimeTaken,
}

/// The findings about a log.
pub(super) struct ExaminedLog {
    pub(super) sketch: Sketch,
    /// Numbers that appear to stand for missing values.
    pub(super) sentinels: Vec<Sentinel>,
    /// Channels that appear to be angles.
    pub(super) angles: Vec<Angle>,
    pub(super) clock: Option<Clock>,
    pub(super) scope: Scope,
    pub(super) cut: Cut,
    pub(super) cleaning: Cleaning,
    pub(super) sensors: Sensors,
    /// Time to read the log.
    pub(super) read: TimeTaken,
}

impl SketchedLog {
    /// Scans the log. Only columns for which `is_sensor` holds are examined for angles and for numbers that mean
    /// missing values.
    pub(super) fn at(
        args: &ProposeOptions,
        is_sensor: impl Fn(&str) -> bool,
        printer: &Printer,
    ) -> Result<Self, StepError> {
        let study = calib_study::of_data(&args.logs, &args.set)?;
        let mut data = memory::on_this_machine(study.data);
        memory::check_log(&data)?;
        printer.say(&format!("init: looking at {}", data.path.0.join(", ")));
        text_left_alone(&data, printer)?;
        let (sketched, mut read) = TimeTaken::by(|| sketch(&data, &printer.progress()));
        let mut sketch = sketched.map_err(contradicting)?;
        warn_of_reading(&sketch, printer);
        let mut sentinels = if gives(args, "data.missing_values") {
            Vec::new()
        } else {
            std::mem::take(&mut sketch.sentinels)
        };
        sentinels.retain(|sentinel| sentinel.channels.iter().any(|channel| is_sensor(channel)));
        if !sentinels.is_empty() {
            let told: Vec<String> = sentinels.iter().map(Sentinel::told).collect();
            printer.warn(&format!(
                "{}: taken for missing values, and the log is looked at again; --set data.missing_values=[] keeps them",
                told.join("; ")
            ));
            data.missing_values = sentinels.iter().map(|sentinel| sentinel.value).collect();
            sketch = calib_data::sketch(&data, &printer.progress())?;
        }
        if let Some(doubt) = sketch.frozen_doubt(&is_sensor) {
            printer.warn(&doubt);
        }
        let angles = if gives_any(args, "data.angles") {
            Vec::new()
        } else {
            angles(&data, &sketch, &is_sensor, printer)?
        };
        if !angles.is_empty() {
            let turns = angles.iter().map(|angle| (angle.channel.clone(), angle.turn));
            data.angles = turns.collect();
            let (sketched, taken) =
                TimeTaken::by(|| calib_data::sketch(&data, &printer.progress()));
            (sketch, read) = (sketched?, taken);
        }
        let clock = if data.resample.is_none() { Clock::of(&sketch) } else { None };
        if let Some(clock) = clock {
            printer
                .say("channels have clocks of their own: they are put on one, and looked at again");
            data.resample = Some(Resample::Last);
            data.period_secs = Some(data.period_secs.unwrap_or(clock.period_secs));
            data.max_age_secs = Some(MaxAge::All(clock.max_age_secs));
            sketch = calib_data::sketch(&data, &printer.progress())?;
        }
        sketch.require_period(data.gap_tolerance)?;
        if gives(args, "data.contradictions")
            && let Some(left_out) = many_left_out(&sketch)
        {
            printer.warn(&left_out);
        }
        for doubt in doubts(&sketch) {
            printer.warn(&doubt);
        }
        Ok(Self { sketch, sentinels, angles, clock, read })
    }
}

impl ExaminedLog {
    pub(super) fn at(args: &ProposeOptions, printer: &Printer) -> Result<Self, StepError> {
        let SketchedLog { sketch, sentinels, angles, clock, read } =
            SketchedLog::at(args, |_| true, printer)?;
        let clocks = sketch.own_times_doubt().or_else(|| sketch.seldom_doubt());
        if let Some(doubt) = clocks.or_else(|| interleaved(&sketch)) {
            printer.warn(&doubt);
        }
        let wanted = named(&args.sensors, &sketch)?;
        let scope = Scope::with(&sketch, &wanted).map_err(StepError::other)?;
        let sensors = if wanted.is_empty() {
            Sensors::of(&sketch, &scope).map_err(StepError::other)?
        } else {
            Sensors { proposed: wanted, others: Vec::new() }
        };
        let cut = Cut::of(&sketch, &scope).map_err(StepError::other)?;
        if !args.sensors.is_empty() && scope.is_part {
            let rows = &sketch.timestamps[scope.rows.clone()];
            printer.say(&format!(
                "{} complete from {} to {}: data.train and data.held_out take this stretch",
                args.sensors.join(" and "),
                sketch.clock.shown(rows[0]),
                sketch.clock.shown(rows[rows.len() - 1])
            ));
        }
        let cleaning = Cleaning::of(&sketch, &scope);
        Ok(Self { sketch, sentinels, angles, clock, scope, cut, cleaning, sensors, read })
    }
}

/// Warns about uncertain ways of reading the log, and about lines that could not be read.
fn warn_of_reading(sketch: &Sketch, printer: &Printer) {
    if sketch.without_times {
        printer.warn(&calib_data::without_times(sketch.period_secs, sketch.files));
    }
    sketch.read_as.iter().for_each(|read_as| printer.warn(read_as));
    sketch.unused_excludes.iter().for_each(|entry| printer.warn(&unused_exclude(entry)));
    if let Some(doubt) = sketch.bad_rows.doubt() {
        printer.warn(&doubt);
    }
}

/// Returns the angles of a scanned log, and reports them.
fn angles(
    data: &DataConfig,
    sketched: &Sketch,
    is_sensor: impl Fn(&str) -> bool,
    printer: &Printer,
) -> Result<Vec<Angle>, StepError> {
    let mut angles = match data.resample {
        // The mean of 359 and 1 is 180, so resampled rows no longer wrap around.
        Some(Resample::Mean | Resample::Linear) => {
            let recorded = DataConfig { resample: Some(Resample::Last), ..data.clone() };
            Angle::all(&sketch(&recorded, &printer.progress())?)
        }
        Some(Resample::Last) | None => Angle::all(sketched),
    };
    angles.retain(|angle| is_sensor(&angle.channel));
    if !angles.is_empty() {
        let told =
            angles.iter().map(|angle| format!("{} (a turn is {})", angle.channel, angle.turn));
        printer.say(&format!(
            "angles: {}; their sines and cosines are channels in their place, and the log is looked at again; --set data.angles={{}} leaves angles out",
            told.collect::<Vec<_>>().join(", ")
        ));
    }
    Ok(angles)
}

/// Adds the reason for refusing a log with contradictions in more than a few rows.
fn contradicting(error: DataError) -> StepError {
    if !matches!(&error, DataError::Contradictions { cause, .. } if !matches!(cause, Some(ContradictionCause::Column { .. })))
    {
        return error.into();
    }
    let percent = 100.0 * FEW_CONTRADICT;
    let context = format!(
        "`calib init` keeps the first of several rows of one time where at most {percent:.0} % of the rows contradict another; here there are more"
    );
    StepError::InContext { context, source: Box::new(error.into()) }
}

/// Returns sentences on times and units of the log that are probably wrong.
fn doubts(sketch: &Sketch) -> Vec<String> {
    let mut doubts = Vec::new();
    let recorded = sketch.recorded_period_secs;
    doubts.extend(recorded.map(|secs| calib_data::contradicted_period(sketch.period_secs, secs)));
    let steps = sketch.timestamps.windows(2).map(|pair| (pair[1].micros_since(pair[0]), pair[0]));
    if let Some((step, from)) = steps.max()
        && step > YEAR_MICROS
    {
        doubts.push(calib_data::long_gap(from, step));
    }
    doubts.extend(sketch.timestamps.last().and_then(|last| clock::in_future(*last)));
    doubts.extend(backward(sketch));
    doubts.extend(sketch.unit_doubts());
    doubts
}

/// Returns a warning about a log with many gaps, such as one in which several devices write in turn.
fn interleaved(sketch: &Sketch) -> Option<String> {
    // In this case the sampling interval itself is reported as doubtful.
    if sketch.recorded_period_secs.is_some() {
        return None;
    }
    let longest = (GAP_PERIODS * sketch.period_secs * 1e6) as i64;
    let steps = sketch.timestamps.windows(2).map(|pair| pair[1].micros_since(pair[0]));
    let gaps = steps.filter(|step| *step > longest).count();
    // A number or name of a device has few values, and changes from row to row.
    let device = sketch.channels.iter().find_map(|channel| {
        let values = channel.distinct.filter(|values| (2..=MOST_DEVICES).contains(values))?;
        (channel.unchanged < 0.5)
            .then(|| format!(", for example by {}, which has {values} values", channel.name))
    });
    calib_data::many_gaps(
        gaps as u64,
        sketch.timestamps.len() as u64 - 1,
        sketch.period_secs,
        "set",
        &device.unwrap_or_default(),
    )
}

/// Steps longer than this many sampling intervals are gaps here. A few missing rows are normal.
const GAP_PERIODS: f64 = 3.0;

/// Largest number of values of a column that names devices.
const MOST_DEVICES: u32 = 64;

/// Returns a warning about rows that repeatedly step back in time. This happens for example if midnight has the date of
/// the ending day. A clock that is set back steps back only once a year. If most rows step back, the newest come first.
fn backward(sketch: &Sketch) -> Option<String> {
    let BackwardSteps { count: steps, examples } = &sketch.backward_steps;
    let first = examples.first()?;
    let is_order = 2 * *steps >= sketch.timestamps.len() as u64;
    (*steps >= BACKWARD && !is_order).then(|| {
        format!(
            "times go back {} times, first in {} from {} to {}: rows are put in order of time. If they were recorded in the order of the file, \
             the times of some are wrong: correct these, or the states around them mix",
            count(*steps as usize),
            first.file,
            sketch.clock.shown(first.from),
            sketch.clock.shown(first.to)
        )
    })
}

/// With fewer steps back, the cause is a clock that was set back.
const BACKWARD: u64 = 5;

/// Longer gaps are reported.
const YEAR_MICROS: i64 = 365 * 86_400 * 1_000_000;

/// Returns the positions of the requested sensors.
fn named(names: &[String], sketch: &Sketch) -> Result<Vec<usize>, StepError> {
    names
        .iter()
        .map(|name| {
            let channel = sketch.channels.iter().position(|channel| channel.name == *name);
            channel.with_context(|| {
                let names = sketch.channels.iter().map(|channel| channel.name.as_str());
                let angles = sketch.channels.iter().filter_map(|channel| channel.angle.as_ref());
                if let Some(hint) = calib_data::angle_hint(name, angles) {
                    return format!("--sensor {name}: it is an angle{hint}");
                }
                format!(
                    "--sensor {name}: the log has no such channel{} `calib inspect` shows all channels",
                    similar(name, names)
                )
            })
        })
        .collect()
}

/// Returns `; did you mean A or B?`, or a semicolon. The caller adds a sentence on where all names are listed.
pub(super) fn similar<'a>(name: &str, names: impl Iterator<Item = &'a str>) -> String {
    let hint = calib_data::hint(name, names);
    if hint.is_empty() { ";".to_owned() } else { hint }
}

/// Returns a warning about channels that stop for longer than usual. Their last value is kept up to the maximum age of
/// the slowest channel.
pub(super) fn bridged(sketch: &Sketch, scope: &Scope) -> Option<String> {
    let mut stopped: Vec<&ChannelSketch> =
        scope.channels.iter().map(|&channel| &sketch.channels[channel]).collect();
    stopped.retain(|channel| !channel.bridged.is_none());
    stopped.sort_by(|left, right| right.bridged.longest_secs.total_cmp(&left.bridged.longest_secs));
    let longest = span(stopped.first()?.bridged.longest_secs);
    let names: Vec<&str> =
        stopped.iter().take(NAMED).map(|channel| channel.name.as_str()).collect();
    let more = if stopped.len() > NAMED { " …" } else { "" };
    Some(format!(
        "{} not recorded for up to {longest}, far longer than usual, and the last value stands in ({}{more}): lower data.max_age_secs, \
         for these channels or for all, if that is not what the plant did",
        if stopped.len() == 1 {
            "1 channel is".to_owned()
        } else {
            format!("{} channels are", count(stopped.len()))
        },
        names.join(", ")
    ))
}

/// Number of channels that are named.
const NAMED: usize = 3;
