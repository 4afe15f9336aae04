//! Trials of other horizons, sensors and spacings, if no agent is ahead of the simple predictors as the study stands.

use calib_agent::SimplePredictor;
use calib_base::{
    StepError,
    clock::Stopwatch,
    options::ProposeOptions,
    output::{duration_of_secs, rounded, span},
};
use calib_propose::{Horizon, ProposedAgent, Scope, Sensors, spacing_by_log, spacings};
use calib_report::{joined, listed};
use calib_stats::Estimate;
use calib_study::shell_words;
use schemars::JsonSchema;
use serde::Serialize;

use super::{
    deadline::TimeLimit,
    drafting::Drafting,
    given::gives,
    look::ExaminedLog,
    prediction::{Lead, TrialPrediction},
    trial::Trials,
};

/// Most seconds for these trials. Our choice.
const MOST_SECS: f64 = 20.0;
/// Share of the requested time for these trials. Our choice.
const SHARE: f64 = 0.2;
/// Horizons to try, as multiples of that of the study. Our choice.
const HORIZONS: [f64; 3] = [0.5, 0.25, 2.0];
/// Number of other sensors, which are tried together. Our choice.
const SENSORS: usize = 3;
/// Fewest states in a horizon of states that are further apart. Our choice.
const LEAST_AHEAD: f64 = 2.0;
/// The key for the rows from one state to the next.
const SPACING: &str = "preprocess.subsample";

/// The proposed study with one change.
#[derive(Clone, Debug, PartialEq)]
struct Alternative {
    /// The change, such as `a horizon of 5 min`.
    change: String,
    /// The beginning of a sentence about it, such as `At a horizon of 5 min`.
    there: String,
    /// The horizon in seconds.
    horizon_secs: f64,
    /// Positions of the predicted channels, if they are others.
    sensors: Option<Vec<usize>>,
    /// Rows from one state to the next, if it is this that changes.
    spacing: Option<usize>,
}

impl Alternative {
    /// Returns the options that propose it, with the best of its sensors, in place of those that were `asked`. `chosen`
    /// is the spacing that these options alone would not determine.
    fn asked(&self, asked: &ProposeOptions, chosen: Option<usize>, sensor: &str) -> ProposeOptions {
        let mut asked = asked.clone();
        asked.horizon = Some(self.horizon_secs);
        let spacing = self.spacing.or(chosen);
        asked.set.extend(spacing.map(|rows| format!("{SPACING}={rows}")));
        if self.sensors.is_some() {
            asked.sensors = vec![sensor.to_owned()];
        }
        asked
    }
}

/// The result of a trial.
enum Tried {
    /// An agent is ahead.
    Ahead(AheadAgent),
    /// No agent is ahead.
    Behind,
    /// The log does not allow the trial. For example, no step can be scored.
    Impossible,
    /// The time was over before.
    Late,
}

/// An agent that is ahead of the simple predictors.
struct AheadAgent {
    agent: ProposedAgent,
    /// Position of the sensor among those of the trial.
    place: usize,
    lead: Lead,
}

/// Trials with one change each, until an agent is ahead of the simple predictors.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub(super) struct OtherTrials {
    /// The changes with which no agent is ahead, in words.
    without: Vec<String>,
    /// The first change with which an agent is ahead. Default: there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    found: Option<Found>,
    /// Whether the time was over before all changes were tried.
    is_cut_short: bool,
    /// Duration of the trials in seconds.
    secs: f64,
}

/// A change with which an agent is ahead of the simple predictors.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
struct Found {
    /// The beginning of a sentence about the change.
    there: String,
    /// The agent, in words.
    agent: String,
    sensor: String,
    /// The best simple predictor.
    predictor: SimplePredictor,
    /// Error of the agent divided by that of the predictor, with its interval over windows.
    ratio: Estimate,
    /// The command that proposes the changed study.
    command: String,
}

/// The study whose alternatives are tried.
pub(super) struct Alternatives<'a> {
    pub(super) trials: &'a Trials<'a>,
    pub(super) drafting: &'a Drafting<'a>,
    /// Rows from one state of the study to the next.
    pub(super) spacing: usize,
    /// The horizon of the study.
    pub(super) horizon: Horizon,
}

impl Alternatives<'_> {
    /// Tries one change after the other with these agents, until one is ahead or the time is over.
    ///
    /// # Errors
    /// Returns an error if the user interrupts the command, or the disk refuses a trial.
    pub(super) fn try_out(&self, agents: &[ProposedAgent]) -> Result<OtherTrials, StepError> {
        let clock = Stopwatch::start();
        let trials = self.trials;
        let secs = MOST_SECS.min(SHARE * trials.args.within).min(trials.comparing.left_secs());
        let limit = TimeLimit::new(clock, secs, trials.context);
        trials.context.say("no agent is shown to do better: trying other horizons and sensors");
        let mut others =
            OtherTrials { without: Vec::new(), found: None, is_cut_short: false, secs: 0.0 };
        for alternative in self.all() {
            match self.trial(&alternative, agents, &limit)? {
                Tried::Ahead(ahead) => {
                    others.found = Some(self.found(alternative, &ahead));
                    break;
                }
                Tried::Behind => others.without.push(alternative.change),
                Tried::Impossible => {}
                Tried::Late => {
                    others.is_cut_short = true;
                    break;
                }
            }
        }
        others.secs = clock.elapsed().as_secs_f64();
        Ok(others)
    }

    /// Returns the alternatives, in the order in which they are tried.
    fn all(&self) -> Vec<Alternative> {
        let ExaminedLog { sketch, cut, .. } = self.drafting.look;
        let [start, end] = cut.held_out;
        let held_out_secs = end.micros_since(start) as f64 / 1e6;
        let rows = if self.keeps_spacing() { self.spacing } else { 1 };
        let limits = [sketch.period_secs * rows as f64, held_out_secs];
        let mut all: Vec<Alternative> =
            horizons(self.horizon.secs, limits).into_iter().map(with_horizon).collect();
        let same = Alternative {
            change: String::new(),
            there: String::new(),
            horizon_secs: self.horizon_secs(),
            sensors: None,
            spacing: None,
        };
        let sensors = self.other_sensors();
        if !sensors.is_empty() {
            let names = sensors.iter().map(|&channel| sketch.channels[channel].name.clone());
            let noun = if sensors.len() == 1 { "sensor" } else { "sensors" };
            all.push(Alternative {
                change: format!("the {noun} {}", listed(&names.collect::<Vec<_>>())),
                there: "At the same horizon".to_owned(),
                sensors: Some(sensors),
                ..same.clone()
            });
        }
        if let Some(spacing) = self.coarser_spacing() {
            let change = format!("states {} apart", span(sketch.period_secs * spacing as f64));
            let there = format!("With {change}");
            all.push(Alternative { change, there, spacing: Some(spacing), ..same });
        }
        all
    }

    fn is_spacing_given(&self) -> bool {
        gives(self.trials.args, SPACING)
    }

    /// Whether alternatives keep the spacing of the study, unless it is what they change. It was given, or trial models
    /// chose it. Otherwise it follows from the log and the horizon.
    fn keeps_spacing(&self) -> bool {
        self.is_spacing_given() || self.trials.choose_spacing()
    }

    /// Returns the next larger number of rows from one state to the next. `None` if it was given, or the horizon would
    /// have too few states.
    fn coarser_spacing(&self) -> Option<usize> {
        let ExaminedLog { sketch, scope, cut, .. } = self.drafting.look;
        if self.is_spacing_given() {
            return None;
        }
        let all = spacings(sketch, scope, cut.rows[0]);
        let spacing = all.into_iter().find(|spacing| *spacing > self.spacing)?;
        let states = self.horizon_secs() / (sketch.period_secs * spacing as f64);
        (states >= LEAST_AHEAD).then_some(spacing)
    }

    /// Returns other sensors that `calib init` could predict. It leaves out sensors for which it would choose another part
    /// of the log.
    fn other_sensors(&self) -> Vec<usize> {
        let ExaminedLog { sketch, scope, sensors, .. } = self.drafting.look;
        let Ok(all) = Sensors::of(sketch, scope) else { return Vec::new() };
        all.proposed
            .into_iter()
            .chain(all.others)
            .filter(|channel| !sensors.proposed.contains(channel))
            .filter(|&channel| {
                Scope::with(sketch, &[channel]).is_ok_and(|other| other.rows == scope.rows)
            })
            .take(SENSORS)
            .collect()
    }

    /// Returns the horizon of alternatives that keep it, in seconds. It has few digits, because a command shows it.
    fn horizon_secs(&self) -> f64 {
        let asked = self.drafting.asked.horizon;
        let kept = asked.filter(|secs| !self.horizon.is_shorter_than(*secs));
        kept.unwrap_or_else(|| rounded(self.horizon.secs, 2))
    }

    /// Tries the agents, the simplest first, until one is ahead.
    fn trial(
        &self,
        alternative: &Alternative,
        agents: &[ProposedAgent],
        limit: &TimeLimit,
    ) -> Result<Tried, StepError> {
        let ExaminedLog { sketch, scope, cut, sensors, .. } = self.drafting.look;
        let secs = alternative.horizon_secs;
        // The same spacing as that of the command for this alternative.
        let spacing = match alternative.spacing {
            Some(spacing) => spacing,
            None if self.keeps_spacing() => self.spacing,
            None => spacing_by_log(sketch, scope, cut.rows, Some(secs)).0,
        };
        let proposed = alternative.sensors.as_ref().unwrap_or(&sensors.proposed).clone();
        let sensors = Sensors { proposed, others: Vec::new() };
        let horizon = Horizon::new(secs, sketch.period_secs * spacing as f64);
        for &agent in agents {
            let mut scored = horizon;
            let compared = self.trials.compare(limit, &mut scored, |at| {
                self.drafting.trial_text(self.trials.model, agent, spacing, &sensors, at)
            });
            let predicted = match compared {
                Ok(Some(predicted)) if scored == horizon => predicted,
                Ok(None) => return Ok(Tried::Late),
                Ok(Some(_)) => return Ok(Tried::Impossible),
                Err(reason) if is_impossible(&reason) => return Ok(Tried::Impossible),
                Err(reason) => return Err(reason),
            };
            if let Some((place, lead)) = largest_lead(&predicted) {
                return Ok(Tried::Ahead(AheadAgent { agent, place, lead }));
            }
        }
        Ok(Tried::Behind)
    }

    /// Describes an alternative with which an agent is ahead.
    fn found(&self, alternative: Alternative, ahead: &AheadAgent) -> Found {
        let ExaminedLog { sketch, sensors, .. } = self.drafting.look;
        let AheadAgent { agent, place, lead } = *ahead;
        let channel = alternative.sensors.as_ref().unwrap_or(&sensors.proposed)[place];
        let sensor = sketch.channels[channel].name.clone();
        // The command would build trial models again, with another horizon or sensor, and might choose another spacing.
        let chosen = self.trials.choose_spacing().then_some(self.spacing);
        let asked = alternative.asked(self.drafting.asked, chosen, &sensor);
        Found {
            there: alternative.there,
            agent: agent.label().to_owned(),
            sensor,
            predictor: lead.predictor,
            ratio: Estimate { value: lead.ratio, interval: Some(lead.interval) },
            command: command(&asked),
        }
    }
}

impl OtherTrials {
    /// Returns what was found, in a line.
    pub(super) fn told(&self) -> String {
        let took = duration_of_secs(self.secs);
        if let Some(found) = &self.found {
            return format!("{} (tried for {took})", found.told());
        }
        if self.without.is_empty() {
            let told = if self.is_cut_short {
                "no time was left to try other horizons and sensors: a longer --within allows it"
            } else {
                "no other horizon, sensor or spacing could be tried on this log"
            };
            return told.to_owned();
        }
        let late = if self.is_cut_short { "; then the time for trials was over" } else { "" };
        format!(
            "no agent is shown to do better with {} either{late} (tried for {took})",
            joined(&self.without, "or")
        )
    }
}

impl Found {
    fn told(&self) -> String {
        let Self { there, agent, sensor, predictor, ratio, command } = self;
        let interval = ratio
            .interval
            .map(|interval| format!(" ({:.2} to {:.2})", interval.low, interval.high))
            .unwrap_or_default();
        format!(
            "{there} {agent} has {:.2}{interval} of the error of {} for {sensor}: `{command}`",
            ratio.value,
            predictor.label()
        )
    }
}

/// Returns the alternative with a horizon of `secs` seconds.
fn with_horizon(secs: f64) -> Alternative {
    let change = format!("a horizon of {}", span(secs));
    let there = format!("At {change}");
    Alternative { change, there, horizon_secs: secs, sensors: None, spacing: None }
}

/// Returns the horizons to try beside one of `secs` seconds, in seconds, with few digits. They are at least `shortest`
/// and at most `longest`.
fn horizons(secs: f64, [shortest, longest]: [f64; 2]) -> Vec<f64> {
    let all = HORIZONS.iter().map(|factor| rounded(factor * secs, 2));
    all.filter(|secs| (shortest..=longest).contains(secs)).collect()
}

/// Whether an error of a trial means that the log or its model does not allow the trial.
fn is_impossible(reason: &StepError) -> bool {
    let is_of_log = matches!(
        reason.root(),
        StepError::Unscorable(_) | StepError::Data(_) | StepError::Other(_)
    );
    is_of_log && !reason.is_of_storage()
}

/// Returns the position and the lead of the sensor whose agent is furthest ahead.
fn largest_lead(predicted: &[TrialPrediction]) -> Option<(usize, Lead)> {
    let leads = predicted.iter().enumerate();
    leads
        .filter_map(|(place, sensor)| Some((place, sensor.lead?)))
        .min_by(|one, other| one.1.ratio.total_cmp(&other.1.ratio))
}

/// Returns the command line that proposes a study with these options, in place of the one that is being written.
fn command(asked: &ProposeOptions) -> String {
    let ProposeOptions { logs, study, within, sensors, horizon, set, existing: _ } = asked;
    let mut words = vec!["calib".to_owned(), "init".to_owned()];
    words.extend([logs, study].map(|path| path.display().to_string()));
    words.extend(["--within".to_owned(), argument(*within)]);
    words.extend(sensors.iter().map(|sensor| format!("--sensor={sensor}")));
    if let Some(secs) = horizon {
        words.extend(["--horizon".to_owned(), argument(*secs)]);
    }
    words.extend(set.iter().map(|one| format!("--set={one}")));
    words.push("--force".to_owned());
    shell_words(words)
}

/// Formats a time as an argument, such as `90s` or `10m`.
fn argument(secs: f64) -> String {
    let units = [(86_400.0, "d"), (3_600.0, "h"), (60.0, "m")];
    let whole = units.into_iter().find(|(size, _)| secs % size == 0.0);
    let (size, unit) = whole.unwrap_or((1.0, "s"));
    format!("{}{unit}", secs / size)
}

#[cfg(test)]
mod tests {
    use calib_base::options::ExistingFile;
    use calib_stats::Interval;

    use super::*;

    fn lead(ratio: f64) -> Lead {
        let interval = Interval { low: ratio - 0.05, high: ratio + 0.05 };
        Lead { predictor: SimplePredictor::Persistence, ratio, interval }
    }

    fn predicted(lead: Option<Lead>) -> TrialPrediction {
        TrialPrediction { simple: 0.5, agent: 1.0, lead }
    }

    #[test]
    fn horizons_are_halved_and_doubled_within_what_the_log_allows() {
        assert_eq!(horizons(1_200.0, [60.0, 1e6]), [600.0, 300.0, 2_400.0]);
        assert_eq!(horizons(15.0, [5.0, 20.0]), [7.5]);
        assert_eq!(horizons(3_529.0, [60.0, 1e6]), [1_800.0, 880.0, 7_100.0], "few digits");
    }

    #[test]
    fn the_agent_that_is_furthest_ahead_is_named() {
        let all = [predicted(Some(lead(0.93))), predicted(None), predicted(Some(lead(0.8)))];
        assert_eq!(largest_lead(&all), Some((2, lead(0.8))));
        assert_eq!(largest_lead(&[predicted(None)]), None);
    }

    #[test]
    fn times_are_written_as_arguments_are_read() {
        let written = [0.5, 7.5, 90.0, 600.0, 5_400.0, 172_800.0].map(argument);
        assert_eq!(written, ["0.5s", "7.5s", "90s", "10m", "90m", "2d"]);
    }

    fn asked() -> ProposeOptions {
        ProposeOptions {
            logs: "my logs".into(),
            study: "plant.toml".into(),
            within: 120.0,
            sensors: vec!["PIT300".to_owned()],
            horizon: Some(300.0),
            set: vec!["data.time_zone=Europe/Paris".to_owned()],
            existing: ExistingFile::Kept,
        }
    }

    #[test]
    fn options_keep_a_spacing_that_trial_models_chose() {
        let nearer = with_horizon(60.0);
        let open = nearer.asked(&asked(), None, "PIT300");
        assert_eq!((open.horizon, open.set), (Some(60.0), asked().set));
        let chosen = nearer.asked(&asked(), Some(4), "PIT300").set;
        assert_eq!(chosen[1..], ["preprocess.subsample=4"]);
        let other = Alternative { spacing: Some(8), sensors: Some(vec![1]), ..nearer };
        let changed = other.asked(&asked(), Some(4), "TIT101");
        assert_eq!(changed.set[1..], ["preprocess.subsample=8"]);
        assert_eq!(changed.sensors, ["TIT101"]);
    }

    #[test]
    fn only_logs_and_models_make_a_trial_impossible() {
        let impossible = [
            StepError::Unscorable("too few rows".to_owned()),
            StepError::message("no transitions"),
        ];
        assert!(impossible.iter().all(is_impossible));
        let full = std::io::Error::other("the disk is full");
        let others = [StepError::Cancelled, full.into(), StepError::Missing("a file".to_owned())];
        assert!(!others.iter().any(is_impossible));
    }

    #[test]
    fn the_command_has_what_was_given() {
        assert_eq!(
            command(&asked()),
            shell_words([
                "calib",
                "init",
                "my logs",
                "plant.toml",
                "--within",
                "2m",
                "--sensor=PIT300",
                "--horizon",
                "5m",
                "--set=data.time_zone=Europe/Paris",
                "--force"
            ])
        );
    }

    #[test]
    fn what_was_tried_is_told_in_a_line() {
        let mut others = OtherTrials {
            without: ["a horizon of 10 min", "a horizon of 5 min", "states 2 min apart"]
                .map(str::to_owned)
                .to_vec(),
            found: None,
            is_cut_short: false,
            secs: 2.0,
        };
        assert_eq!(
            others.told(),
            "no agent is shown to do better with a horizon of 10 min, a horizon of 5 min or states 2 min apart either (tried for 2.0 s)"
        );
        others.is_cut_short = true;
        assert!(others.told().contains("either; then the time for trials was over"));
        others.without.clear();
        assert!(others.told().starts_with("no time was left to try other horizons"));
        others.is_cut_short = false;
        assert!(others.told().starts_with("no other horizon, sensor or spacing could be tried"));
        others.found = Some(Found {
            there: "At a horizon of 5 min".to_owned(),
            agent: "a network".to_owned(),
            sensor: "A".to_owned(),
            predictor: SimplePredictor::Persistence,
            ratio: Estimate { value: 0.93, interval: Some(Interval { low: 0.9, high: 0.97 }) },
            command: "calib init log.csv --horizon 5m".to_owned(),
        });
        assert_eq!(
            others.told(),
            "At a horizon of 5 min a network has 0.93 (0.90 to 0.97) of the error of persistence for A: `calib init log.csv --horizon 5m` (tried for 2.0 s)"
        );
    }
}
