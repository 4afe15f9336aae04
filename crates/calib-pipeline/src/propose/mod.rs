//! A study of a log that nobody has looked at: everything that can be seen is looked at, and what cannot is tried.

mod trial;

use std::path::{Path, PathBuf};

use calib_core::Timestamp;
use calib_data::{ChannelSketch, Sentinel, Sketch, format_time, sketch};
use calib_files::{TemporaryFolder, check_output, write_output};
use calib_propose::{
    Asked, Cleaning, Clock, Cut, Draft, Horizon, ProposedAgent, Scope, Sensors, Size, Trial,
    choose_agent, horizon, spacings,
};
use calib_study::{Job, Request};
use schemars::JsonSchema;
use serde::Serialize;

use self::trial::{Predicted, Trials, halved};
use crate::{
    Context as _, StepError,
    base::{
        clock::{self, Stopwatch},
        left_alone::text_left_alone,
        memory,
        options::ProposeOptions,
        outcome::Outcome,
    },
    ensure,
    output::{Printer, count, duration, span},
};

/// What was chosen, for `--json`.
#[derive(Debug, Serialize, JsonSchema)]
pub(crate) struct Chosen {
    /// The file that was written.
    study: PathBuf,
    /// Channels that are used.
    channels: usize,
    /// Those that are not, with the reason.
    left_out: Vec<[String; 2]>,
    /// First moment of the training range, and the first after it.
    train: [Timestamp; 2],
    /// Of what is held out.
    held_out: [Timestamp; 2],
    /// Rows of the two.
    rows: [usize; 2],
    /// Time from one state to the next, in seconds.
    state_secs: f64,
    sensors: Vec<String>,
    /// Why this agent is proposed.
    agent_reason: String,
    gamma: f64,
    horizon_secs: f64,
    /// Steps of every run.
    steps: usize,
    /// How long `calib run` takes on this machine, in seconds, as far as could be told: with what else it does while `calib init` measures.
    expected_secs: f64,
    /// Processor time that it takes, in seconds, whatever else the machine does; none where the system does not say.
    expected_processor_secs: Option<f64>,
}

/// Look at a log, and write a study of it.
pub(crate) fn run(args: &ProposeOptions, printer: &Printer) -> Result<Outcome, StepError> {
    let file = args.study.display();
    ensure!(
        args.study.extension().is_some_and(|extension| extension == "toml"),
        "{file}: expected the name of a study file, which ends in .toml"
    );
    for (key, instead) in [
        ("data.train_fraction", "it chooses data.train and data.held_out; give these"),
        ("sweep.sensors", "it sizes the study for the sensors of --sensor; name them there"),
    ] {
        ensure!(!gives(args, key), "--set {key} has no effect on `calib init`: {instead}");
    }
    // Before the trials, and not after them.
    check_output(&args.study, args.standing)?;
    let clock = Stopwatch::start();
    let path = path_in_study(&args.logs, &args.study)?;
    let look = Look::at(args, printer)?;
    let contradictions = look.cleaning.contradictions.as_ref();
    if let Some((keep, why)) = contradictions.filter(|_| !gives(args, "data.contradictions")) {
        printer.warn(&format!(
            "{why}: the {keep} of them is kept; data.time_zone may tell the hours apart, data.contradictions which is kept"
        ));
    }
    if let Some(bridged) = bridged(&look) {
        printer.warn(&bridged);
    }
    let chosen = Proposal::of(args, &path, &look, clock, printer)?;
    write_output(&args.study, args.standing, |file| {
        std::io::Write::write_all(file, chosen.text.as_bytes())
    })?;
    show(args, &look, &chosen, printer)?;
    printer.say(&format!("looked and tried for {}", duration(clock.elapsed())));
    printer.next(&[format!(
        "calib run {}",
        calib_study::shell_words([args.study.display().to_string()])
    )]);
    Ok(Outcome::Done)
}

/// Whether `key` was given with `--set`.
fn gives(args: &ProposeOptions, key: &str) -> bool {
    args.set.iter().any(|one| one.split_once('=').is_some_and(|(given, _)| given.trim() == key))
}

/// What is said of channels that stop for longer than they usually do, where the age at which values are forgotten is that of
/// the slowest channel.
fn bridged(look: &Look) -> Option<String> {
    let Look { sketch, scope, .. } = look;
    let mut stopped: Vec<&ChannelSketch> =
        scope.channels.iter().map(|&of| &sketch.channels[of]).collect();
    stopped.retain(|of| !of.bridged.is_none());
    stopped.sort_by(|left, right| right.bridged.longest_secs.total_cmp(&left.bridged.longest_secs));
    let longest = span(stopped.first()?.bridged.longest_secs);
    let names: Vec<&str> = stopped.iter().take(NAMED).map(|of| of.name.as_str()).collect();
    let more = if stopped.len() > NAMED { " …" } else { "" };
    Some(format!(
        "{} not recorded for up to {longest}, far longer than usual, and the last value stands in ({}{more}): lower data.max_age_secs, \
         which is one for all channels, if that is not what the plant did",
        if stopped.len() == 1 {
            "1 channel is".to_owned()
        } else {
            format!("{} channels are", count(stopped.len()))
        },
        names.join(", ")
    ))
}

/// Channels that are named.
const NAMED: usize = 3;

/// The path of the log as it is written into a study: as it was typed, where that means the same from there.
fn path_in_study(logs: &Path, study: &Path) -> Result<String, StepError> {
    let beside = study.parent().is_none_or(|folder| folder.as_os_str().is_empty());
    let path = if beside || logs.is_absolute() {
        logs.to_owned()
    } else {
        std::env::current_dir().context("cannot tell the current folder")?.join(logs)
    };
    let path = path.to_str().with_context(|| format!("{}: not Unicode", path.display()))?;
    Ok(path.to_owned())
}

/// What the log is like.
struct Look {
    sketch: Sketch,
    /// Numbers that were found to stand for a missing value.
    sentinels: Vec<Sentinel>,
    clock: Option<Clock>,
    scope: Scope,
    cut: Cut,
    cleaning: Cleaning,
    sensors: Sensors,
}

impl Look {
    fn at(args: &ProposeOptions, printer: &Printer) -> Result<Self, StepError> {
        let study = calib_study::of_data(&args.logs, &args.set)?;
        let mut data = memory::on_this_machine(study.data);
        memory::check_log(&data)?;
        printer.say(&format!("init: looking at {}", data.path.0.join(", ")));
        text_left_alone(&data, printer)?;
        let mut sketch = sketch(&data, &printer.progress())?;
        if sketch.without_times {
            printer.warn(&calib_data::without_times(sketch.period_secs, sketch.files));
        }
        if let Some(example) = sketch.bad_rows.examples.first() {
            let lines = count(sketch.bad_rows.count as usize);
            printer
                .warn(&format!("{lines} lines cannot be read and are left out, such as {example}"));
        }
        let sentinels = if gives(args, "data.missing_values") {
            Vec::new()
        } else {
            std::mem::take(&mut sketch.sentinels)
        };
        if !sentinels.is_empty() {
            let told: Vec<String> = sentinels.iter().map(Sentinel::told).collect();
            printer.warn(&format!(
                "{}: taken for missing values, and the log is looked at again; --set data.missing_values=[] keeps them",
                told.join("; ")
            ));
            data.missing_values = sentinels.iter().map(|of| of.value).collect();
            sketch = calib_data::sketch(&data, &printer.progress())?;
        }
        let clock = if data.resample.is_none() { Clock::of(&sketch) } else { None };
        if let Some(clock) = clock {
            printer
                .say("channels have clocks of their own: they are put on one, and looked at again");
            data.resample = Some(calib_data::Resample::Last);
            data.period_secs = Some(data.period_secs.unwrap_or(clock.period_secs));
            data.max_age_secs = Some(clock.max_age_secs);
            sketch = calib_data::sketch(&data, &printer.progress())?;
        }
        let wanted = named(&args.sensors, &sketch)?;
        let scope = Scope::with(&sketch, &wanted)?;
        let sensors = if wanted.is_empty() {
            Sensors::of(&sketch, &scope)?
        } else {
            Sensors { proposed: wanted, others: Vec::new() }
        };
        let cut = Cut::of(&sketch, &scope)?;
        if !args.sensors.is_empty() && scope.is_part {
            let rows = &sketch.timestamps[scope.rows.clone()];
            printer.say(&format!(
                "{} complete from {} to {}: data.train and data.held_out take this stretch",
                args.sensors.join(" and "),
                format_time(rows[0]),
                format_time(rows[rows.len() - 1])
            ));
        }
        for doubt in doubts(&sketch) {
            printer.warn(&doubt);
        }
        let cleaning = Cleaning::of(&sketch, &scope);
        Ok(Self { sketch, sentinels, clock, scope, cut, cleaning, sensors })
    }
}

/// What of the times of a log is probably not as meant, in sentences.
fn doubts(sketch: &Sketch) -> Vec<String> {
    let mut doubts = Vec::new();
    let steps = sketch.timestamps.windows(2).map(|pair| (pair[1].micros_since(pair[0]), pair[0]));
    if let Some((step, from)) = steps.max()
        && step > YEAR_MICROS
    {
        doubts.push(calib_data::long_gap(from, step));
    }
    doubts.extend(sketch.timestamps.last().and_then(|last| clock::in_future(*last)));
    doubts
}

/// A gap that is longer is said.
const YEAR_MICROS: i64 = 365 * 86_400 * 1_000_000;

/// The positions of the sensors that were asked for.
fn named(names: &[String], sketch: &Sketch) -> Result<Vec<usize>, StepError> {
    let find = |name: &String| {
        let channel = sketch.channels.iter().position(|of| of.name == *name);
        channel.with_context(|| {
            format!("--sensor {name}: the log has no such channel; `calib inspect` shows all")
        })
    };
    names.iter().map(find).collect()
}

/// A study, and what was found on the way to it.
struct Proposal {
    text: String,
    spacing: usize,
    cut: Cut,
    /// Channels that are predicted, then those that could be.
    sensors: Sensors,
    agent: Evidence,
    horizon: Horizon,
    size: Size,
    expected_secs: f64,
    expected_processor_secs: Option<f64>,
}

impl Proposal {
    fn of(
        args: &ProposeOptions,
        path: &str,
        look: &Look,
        begun: Stopwatch,
        printer: &Printer,
    ) -> Result<Self, StepError> {
        let left = || (args.within - begun.elapsed().as_secs_f64()).max(0.0);
        let Look { sketch, scope, .. } = look;
        let place = TemporaryFolder::new()?;
        let trials = Trials { args, place: &place, printer };
        let candidates = spacings(sketch, scope, look.cut.rows[0]);
        let mut sensors = look.sensors.clone();
        let drafting = Drafting { args, path, look };
        // Models of the last rows of the training range, because it is theirs to be judged on what follows.
        let small = |spacing: usize| {
            let rows = trial::ROWS * spacing;
            let size = Size::trial(
                ProposedAgent::Linear,
                drafting.most_steps(spacing),
                sensors.proposed.len(),
            );
            let cut = look.cut.shortened(&sketch.timestamps, rows);
            drafting.text(
                spacing,
                &cut,
                &sensors,
                drafting.ahead(spacing, size.steps),
                &size,
                [""; 3],
            )
        };
        let (spacing, why, build_secs) = trials.spacing(&candidates, small, sketch.period_secs)?;
        let latest = look.cut.shortened(&sketch.timestamps, trial::ROWS * spacing);
        let inside = latest.inside(&sketch.timestamps);
        let mut horizon = drafting.ahead(spacing, drafting.most_steps(spacing));
        let agent = Evidence::gather(&trials, &mut horizon, |agent, horizon| {
            let steps = Size::most_steps(inside.rows[1] / spacing);
            let size = Size::comparison(agent, steps, look.sensors.proposed.len());
            drafting.text(spacing, &inside, &look.sensors, horizon, &size, [""; 3])
        })?;
        agent.reorder(&mut sensors, !args.sensors.is_empty());
        let rows = trial::rows_within(left(), build_secs, look.cut.rows[0] / spacing);
        let cut = if rows < look.cut.rows[0] / spacing {
            look.cut.shortened(&sketch.timestamps, rows.saturating_mul(spacing))
        } else {
            look.cut.clone()
        };
        let steps = drafting.most_steps(spacing);
        let trial = |steps: usize, horizon: Horizon| {
            let size = Size::trial(agent.agent, steps, sensors.proposed.len());
            (drafting.text(spacing, &cut, &sensors, horizon, &size, [""; 3]), size)
        };
        let measured = trials.costs(steps, &mut horizon, trial)?;
        let costs = measured.time;
        // Looking and trying are of the time that was asked for.
        let tried = begun.elapsed().as_secs_f64();
        let size = Size::within(agent.agent, left(), costs, steps, sensors.proposed.len());
        let expected_secs = size.secs(costs);
        let expected_processor_secs = measured.processors.map(|costs| size.secs(costs));
        let reason =
            drafting.size_reason(expected_secs, expected_secs - costs.fixed_secs, tried, printer);
        let text =
            drafting.text(spacing, &cut, &sensors, horizon, &size, [&why, &agent.reason, &reason]);
        // What was given holds for the study: it is read with it, and must say the same without.
        let text = calib_propose::with_given(&text, &args.set);
        Job::of_text(Request::new(&args.study), text.clone())?;
        Ok(Self {
            text,
            spacing,
            cut,
            sensors,
            agent,
            horizon,
            size,
            expected_secs,
            expected_processor_secs,
        })
    }
}

/// What all drafts of a study have in common.
struct Drafting<'a> {
    args: &'a ProposeOptions,
    /// `data.path`.
    path: &'a str,
    look: &'a Look,
}

impl Drafting<'_> {
    /// The study; `words` say why it has its spacing, agent and size.
    fn text(
        &self,
        spacing: usize,
        cut: &Cut,
        sensors: &Sensors,
        horizon: Horizon,
        size: &Size,
        words: [&str; 3],
    ) -> String {
        let Self { args, path, look } = self;
        Draft {
            sketch: &look.sketch,
            path,
            scope: &look.scope,
            cut,
            cleaning: &look.cleaning,
            missing_values: &look.sentinels,
            clock: look.clock,
            spacing: (spacing, words[0]),
            sensors,
            horizon,
            size,
            agent_reason: words[1],
            size_reason: words[2],
            asked: Asked { sensors: !args.sensors.is_empty(), horizon: args.horizon.is_some() },
        }
        .text()
    }

    /// How far ahead runs of so many steps predict.
    fn ahead(&self, spacing: usize, steps: usize) -> Horizon {
        let sketch = &self.look.sketch;
        match self.args.horizon {
            Some(secs) => Horizon::new(secs, sketch.period_secs * spacing as f64),
            None => horizon(sketch, &self.look.sensors.proposed, spacing, steps),
        }
    }

    /// Steps of a run at most.
    fn most_steps(&self, spacing: usize) -> usize {
        Size::most_steps(self.look.cut.rows[1] / spacing)
    }

    /// What is said of a size that takes `expected_secs`, `sweep_secs` of them for the sweep, where looking and trying took
    /// `tried_secs`.
    fn size_reason(
        &self,
        expected_secs: f64,
        sweep_secs: f64,
        tried_secs: f64,
        printer: &Printer,
    ) -> String {
        let within = self.args.within;
        let [asked, tried, expected] =
            [within, tried_secs.round(), expected_secs.round()].map(span);
        if expected_secs.round() > (within - tried_secs).max(0.0) {
            printer.warn(&format!(
                "{asked} are not enough for the smallest study that says anything: `calib init` took {tried}, and `calib run` will take about {expected}"
            ));
        }
        format!(
            "Sized to end within {asked}, of which `calib init` took {tried}: about {expected} on this machine, {} of them for the sweep",
            span(sweep_secs.round())
        )
    }
}

/// What was tried where only the training range is known, and what follows from it.
struct Evidence {
    agent: ProposedAgent,
    /// In words.
    reason: String,
    /// Of each proposed sensor.
    predicted: Vec<Predicted>,
}

impl Evidence {
    /// Try agents at a `horizon` that is halved until something predicts at least one of the sensors better than its mean.
    fn gather(
        trials: &Trials<'_>,
        horizon: &mut Horizon,
        text: impl Fn(ProposedAgent, Horizon) -> String,
    ) -> Result<Self, StepError> {
        let say = |words: &str| trials.printer.say(words);
        say("comparing agents with simple predictors on the last third of the training range");
        let mut predicted = trials.compare(horizon, |at| text(ProposedAgent::Linear, at))?;
        let is_given = trials.args.horizon.is_some();
        let mut shorter = *horizon;
        while !predicted.iter().any(Predicted::is_predicted) && !is_given && shorter.states >= 4.0 {
            shorter = halved(shorter);
            let nearer = trials.compare(&mut shorter, |at| text(ProposedAgent::Linear, at))?;
            if nearer.iter().any(Predicted::is_predicted) {
                say(&format!(
                    "nothing predicts {} ahead better than the mean does",
                    span(horizon.secs)
                ));
                (predicted, *horizon) = (nearer, shorter);
            }
        }
        let network = trials.compare(horizon, |at| text(ProposedAgent::Network, at))?;
        let tried = [(ProposedAgent::Linear, &predicted), (ProposedAgent::Network, &network)];
        let tried = tried.map(|(agent, sensors)| Trial { agent, ratio: typical(sensors) });
        let chosen = choose_agent(&tried).unwrap_or(tried[0]);
        let said = |trial: &Trial| format!("{} {:.3}", trial.agent.label(), trial.ratio);
        let errors = tried.iter().map(said).collect::<Vec<_>>().join(", ");
        let mut reason = format!(
            "On the last third of the training range, errors by the best simple predictor's: {errors}"
        );
        if !predicted.iter().chain(&network).any(Predicted::is_predicted) {
            let warning = format!(
                "nothing that was tried predicts {} ahead better than the mean does; try a shorter --horizon, or other sensors with --sensor",
                span(horizon.secs)
            );
            trials.printer.warn(&warning);
            reason = format!("{reason}; {warning}");
        } else if chosen.ratio > 1.0 {
            reason.push_str("; no agent is better, and the study asks once more");
        }
        Ok(Self { agent: chosen.agent, reason, predicted })
    }

    /// Sensors that something predicts come first, unless the order `is_given`.
    fn reorder(&self, sensors: &mut Sensors, is_given: bool) {
        if is_given {
            return;
        }
        let all: Vec<(usize, bool)> = sensors
            .proposed
            .iter()
            .copied()
            .zip(self.predicted.iter().map(Predicted::is_predicted))
            .collect();
        let (first, last): (Vec<_>, Vec<_>) =
            all.into_iter().partition(|(_, predicted)| *predicted);
        sensors.proposed = first.into_iter().chain(last).map(|(channel, _)| channel).collect();
    }
}

/// The geometric mean of an agent's errors by the best simple predictors'.
fn typical(sensors: &[Predicted]) -> f64 {
    let sum: f64 = sensors.iter().map(|sensor| sensor.agent.ln()).sum();
    (sum / sensors.len() as f64).exp()
}

impl Proposal {
    /// What is said of the processor time.
    fn processors(&self) -> String {
        let said = |secs: f64| format!(" ({} of processor time)", span(secs.round()));
        self.expected_processor_secs.map(said).unwrap_or_default()
    }
}

fn show(
    args: &ProposeOptions,
    look: &Look,
    chosen: &Proposal,
    printer: &Printer,
) -> Result<(), StepError> {
    let Look { sketch, scope, .. } = look;
    let name = |&channel: &usize| sketch.channels[channel].name.clone();
    let predicted: Vec<String> =
        chosen.sensors.proposed.iter().take(chosen.size.sensors).map(name).collect();
    let state_secs = sketch.period_secs * chosen.spacing as f64;
    if printer.is_for_machines() {
        return printer.json(&Chosen {
            study: args.study.clone(),
            channels: scope.channels.len(),
            left_out: scope
                .left_out
                .iter()
                .map(|of| [of.name.clone(), of.why.to_string()])
                .collect(),
            train: chosen.cut.train,
            held_out: chosen.cut.held_out,
            rows: chosen.cut.rows,
            state_secs,
            sensors: predicted,
            agent_reason: chosen.agent.reason.clone(),
            gamma: chosen.horizon.gamma,
            horizon_secs: chosen.horizon.secs,
            steps: chosen.size.steps,
            expected_secs: chosen.expected_secs,
            expected_processor_secs: chosen.expected_processor_secs,
        });
    }
    let [train, held_out] = chosen.cut.rows.map(count);
    let lines = [
        format!(
            "{}: {} of {} channels, {train} rows to learn from, {held_out} held out",
            args.study.display(),
            scope.channels.len(),
            sketch.channels.len()
        ),
        format!(
            "a state every {}; {} predicted {} ahead (gamma {})",
            span(state_secs),
            predicted.join(", "),
            span(chosen.horizon.secs),
            chosen.horizon.gamma
        ),
        chosen.agent.reason.clone(),
        format!(
            "{} learning rates, runs of {} steps: about {} of the {} that were asked for{}",
            chosen.size.values(),
            count(chosen.size.steps),
            span(chosen.expected_secs.round()),
            span(args.within),
            chosen.processors()
        ),
    ];
    lines.iter().try_for_each(|line| printer.result(line))
}
