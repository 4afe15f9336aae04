use std::ops::Range;

use calib_core::abridged_list;

use crate::{
    Cut, Horizon, LogDraft, ProposedAgent, ProposedModel, Sensors, Size,
    axes::other_axes,
    given::with_given,
    horizon,
    lines::{Lines, list, number},
    sensors::{explained, stays},
    size::LEAST_STEPS,
    written::{key, quoted},
};

/// Most steps of a rollout: enough to look at.
const ROLLOUT_STEPS: usize = 3_000;
/// Values of a predicted sensor are filled over at most this share of the horizon.
const FILLED: f64 = 0.2;
/// The share of missing values is known only roughly, so this limit is below the default of `preprocess.max_missing`, 0.1.
const NEARLY_TOO_MUCH: f64 = 0.08;
/// Number of sensors that a comment names.
const NAMED: usize = 12;
/// A comment gives a sensor's own horizon if it is at least this many times longer or shorter than that of the study. (Our choice.)
const OTHER_HORIZON: f64 = 5.0;

/// A study file whose comments give the reason for each choice.
#[derive(Clone, Debug)]
pub struct Draft<'a> {
    /// The log.
    pub log: LogDraft<'a>,
    /// Training range and held-out period.
    pub cut: &'a Cut,
    /// `preprocess.subsample` and its reason.
    pub spacing: (usize, &'a str),
    /// Sensors to predict.
    pub sensors: &'a Sensors,
    /// Effective horizon of the predictions.
    pub horizon: Horizon,
    /// Size of the sweep.
    pub size: &'a Size,
    /// Number of states in the held-out period.
    pub held_out_states: usize,
    /// Number of held-out windows of the sweep.
    pub windows: usize,
    /// Reason for this agent.
    pub agent_reason: &'a str,
    /// Simple predictor that agents start from, in words; empty while it is unknown.
    pub baseline: &'a str,
    /// Reason for this size.
    pub size_reason: &'a str,
    /// Choices that the user made.
    pub asked: Asked,
    /// Keys that the user gave as `section.key=value`. They decide which other hyperparameters the grid offers, and
    /// [`with_given`] writes them into the text.
    pub given: &'a [String],
}

/// Choices that the user made.
#[derive(Clone, Copy, Debug, Default)]
pub struct Asked {
    /// Whether the user named the sensors.
    pub sensors: bool,
    /// The horizon in seconds, if the user gave one.
    pub horizon: Option<f64>,
}

impl Draft<'_> {
    /// Returns the text of the study file.
    pub fn text(&self) -> String {
        let mut text = Lines::default();
        text.comment("Proposed by `calib init`, which looked at the log and tried agents on it.");
        text.comment("Every value has its reason beside it, and every one may be changed: docs/study.md has all keys.");
        text.line("");
        text.key("seed", "0", "root of all randomness");
        self.data(&mut text);
        self.preprocess(&mut text);
        self.model(&mut text);
        self.agent(&mut text);
        self.sweep(&mut text);
        text.0
    }

    fn model(&self, text: &mut Lines) {
        let model = self.size.model;
        text.section("model");
        if model == ProposedModel::None {
            text.comment(
                "A prediction does not change the plant, so the replayed log shows how each setting would have done. No model has chosen better (docs/replay-or-model.md); kind = \"knn\" builds one of neighbours",
            );
            text.key("kind", "\"none\"", "no model: the log decides");
            return;
        }
        text.key("members", &model.members().to_string(), "leave-one-block-out ensemble");
        text.key("neighbors", "3", "k");
        text.section("rollout");
        let steps = ROLLOUT_STEPS.min((self.held_out_states / 2).max(LEAST_STEPS));
        text.key("steps", &steps.to_string(), "enough to look at");
        text.key(
            "dtw_steps",
            &steps.min(1_000).to_string(),
            "of these, compared with what was recorded",
        );
    }

    fn data(&self, text: &mut Lines) {
        let cut = self.cut;
        let zone = self.log.sketch.clock.zone();
        self.log.write(text, |text| {
            text.comment(&format!(
                "{}: {} rows to learn from, {} held out",
                cut.reason, cut.rows[0], cut.rows[1]
            ));
            text.key("train", &Cut::toml(&cut.train, zone), "");
            text.key("held_out", &Cut::toml(&cut.held_out, zone), "");
        });
    }

    fn preprocess(&self, text: &mut Lines) {
        let (limit, why) = self.fill_limit();
        text.section("preprocess");
        text.key("missing", "\"forward_fill\"", "values stand until the next");
        text.key("fill_limit", &limit.to_string(), &why);
        if let Some((limit, why)) = self.max_missing() {
            text.key("max_missing", &number(limit), &why);
        }
        let log = &self.log;
        let spikes: u64 =
            log.scope.channels.iter().map(|&channel| log.sketch.channels[channel].spikes).sum();
        if spikes > 0 {
            let why = format!("{spikes} single samples lie far outside of everything else");
            text.key("outliers", "\"missing\"", &why);
        }
        text.key("subsample", &self.spacing.0.to_string(), self.spacing.1);
    }

    /// Returns `preprocess.max_missing` and its reason, if a predicted sensor misses more of the training range than the default
    /// allows. Otherwise its channel would be dropped, and there would be no study.
    fn max_missing(&self) -> Option<(f64, String)> {
        let Self { log: LogDraft { sketch, .. }, cut, .. } = self;
        let start = sketch.timestamps.partition_point(|time| *time < cut.train[0]);
        let train = start..start + cut.rows[0];
        let predicted = self.sensors.proposed.iter().take(self.size.sensors);
        let all = predicted.map(|&channel| (self.missing(channel, &train), channel));
        let (share, channel) = all.max_by(|one, other| one.0.total_cmp(&other.0))?;
        (share > NEARLY_TOO_MUCH).then(|| {
            // The margin allows for spikes, which become missing, and for shares that are only known per bin.
            let limit = ((share + 0.03) * 20.0).ceil().min(20.0) / 20.0;
            let name = &sketch.channels[channel].name;
            (limit, format!("{name} misses {:.0} % of the training range", 100.0 * share))
        })
    }

    /// Returns the share of the rows `train` that have no value of a channel.
    fn missing(&self, channel: usize, train: &Range<usize>) -> f64 {
        let sketch = self.log.sketch;
        let bins = sketch.bins.iter().zip(&sketch.channels[channel].present);
        let missing = bins.map(|(bin, present)| {
            let inside = bin.start.max(train.start)..bin.end.min(train.end);
            inside.len() as f64 * (1.0 - present)
        });
        missing.sum::<f64>() / train.len().max(1) as f64
    }

    /// Returns the fill limit in rows and its reason. Values of a predicted sensor are filled only over a small part of the horizon.
    /// Otherwise the agent would predict filled values.
    fn fill_limit(&self) -> (usize, String) {
        let (limit, why) = &self.log.cleaning.fill_limit;
        let rows = (self.horizon.states * self.spacing.0 as f64 * FILLED) as usize;
        if rows.max(1) < *limit
            && self
                .sensors
                .proposed
                .iter()
                .any(|&channel| self.log.sketch.channels[channel].missing_run > 0)
        {
            let share = 100.0 * FILLED;
            return (
                rows.max(1),
                format!(
                    "{share:.0} % of the horizon, because a sensor that is predicted misses values"
                ),
            );
        }
        (*limit, why.clone())
    }

    fn agent(&self, text: &mut Lines) {
        let Horizon { secs, states, gamma } = self.horizon;
        text.section("agent");
        text.comment(self.agent_reason);
        match self.size.agent {
            ProposedAgent::Linear => {
                text.key("value_function", "\"linear\"", "");
                text.key("optimiser", "\"swift_td\"", "it finds the step size of each weight");
                text.key(
                    "replay",
                    "\"none\"",
                    "the agent learns from each step as it comes, and stores none",
                );
            }
            ProposedAgent::Network => {
                text.key("value_function", "\"mlp\"", "");
                text.key("hidden_layers", "2", "");
                text.key("hidden_units", &self.size.hidden_units.to_string(), "");
                text.key("batch_size", "32", "");
            }
        }
        let best = if self.baseline.is_empty() {
            String::new()
        } else {
            format!(", here {}", self.baseline)
        };
        text.key(
            "baseline",
            "\"best\"",
            &format!("the agent starts from the best simple predictor{best}, and adds what it learns; \"none\" starts from nothing"),
        );
        text.key(
            "gamma",
            &gamma.to_string(),
            &format!("a horizon of {states:.0} states, {}: {}", span(secs), match self.asked.horizon {
                Some(asked) if self.horizon.is_shorter_than(asked) => format!(
                    "{} was asked for with --horizon, and halved until held-out steps can be scored",
                    span(asked)
                ),
                Some(_) => "as asked for with --horizon".to_owned(),
                None => "the median time after which half of a sensor's autocorrelation is left, but no more than a hundredth of a run".to_owned(),
            }),
        );
        self.gammas(text);
        text.key(
            "learning_rate",
            "0",
            "the default that the verdict compares with: the agent stays as it is",
        );
    }

    /// Writes `agent.gammas` as a comment, if the autocorrelation of a sensor lasts much longer or shorter than the horizon.
    fn gammas(&self, text: &mut Lines) {
        let Self { log: LogDraft { sketch, .. }, sensors, size, .. } = self;
        // The horizon may have been proposed for longer runs, for which there was no time.
        let steps = size.steps.max(self.horizon.least_steps());
        let spacing = self.spacing.0;
        let ahead = horizon(sketch, &sensors.proposed, spacing, steps);
        // A horizon that the user gave, or that was halved, does not follow from the autocorrelation.
        let is_shorter = self.horizon.is_shorter_than(ahead.secs);
        if self.asked.horizon.is_some() || is_shorter {
            return;
        }
        let mut gammas = Vec::new();
        let mut told = Vec::new();
        for &sensor in sensors.proposed.iter().take(size.sensors) {
            let Horizon { states, gamma, .. } = horizon(sketch, &[sensor], spacing, steps);
            let times = states / self.horizon.states;
            if times.max(1.0 / times) >= OTHER_HORIZON {
                let name = &sketch.channels[sensor].name;
                gammas.push(format!("{} = {gamma}", key(name)));
                told.push(format!("{states:.0} states for {name}"));
            }
        }
        if gammas.is_empty() {
            return;
        }
        text.comment_after(
            &format!("# gammas = {{ {} }}", gammas.join(", ")),
            &format!("horizons by the autocorrelation of one sensor: {}", told.join(", ")),
        );
    }

    fn sweep(&self, text: &mut Lines) {
        let size = self.size;
        let LogDraft { sketch, scope, .. } = self.log;
        text.section("sweep");
        let proposed = self.sensors.proposed.iter().take(size.sensors);
        let proposed: Vec<String> =
            proposed.map(|&channel| quoted(&sketch.channels[channel].name)).collect();
        let why = if self.asked.sensors {
            "Named with --sensor".to_owned()
        } else {
            let explained = self.sensors.proposed.iter().take(size.sensors).map(|&channel| {
                let share = 100.0 * explained(sketch, channel, &scope.channels);
                format!("{} {share:.0} %", sketch.channels[channel].name)
            });
            let mut named = self.sensors.proposed.iter().take(size.sensors);
            let staying = if named.all(|&channel| stays(sketch, scope, channel)) {
                ", stay where they have been before,"
            } else {
                ""
            };
            format!(
                "They move throughout the log{staying} and are as unlike each other as can be. How much of each can be computed from the other channels: {}",
                explained.collect::<Vec<_>>().join(", ")
            )
        };
        text.comment(&why);
        text.key("sensors", &list(&proposed), "");
        let others: Vec<String> = self
            .sensors
            .proposed
            .iter()
            .skip(size.sensors)
            .chain(&self.sensors.others)
            .map(|&channel| quoted(&sketch.channels[channel].name))
            .collect();
        if !others.is_empty() {
            text.comment(&format!("could be as well: {}", abridged_list(&others, NAMED)));
        }
        let fit = match self.windows {
            0 | 1 => "one window of the held-out period".to_owned(),
            few @ 2..=3 => format!(
                "{few} windows fit beside each other in the held-out period: hardly any difference can be shown with so few"
            ),
            many => format!("{many} windows fit beside each other in the held-out period"),
        };
        text.comment(self.size_reason);
        text.key("steps", &size.steps.to_string(), &fit);
        text.key("online_runs", &size.online_runs.to_string(), "on the held-out period");
        if size.model == ProposedModel::Ensemble {
            text.key("member_runs", &size.member_runs.to_string(), "in each of the models");
        }
        text.key("log_replay_runs", &size.log_replay_runs.to_string(), "windows of the log");
        text.section("sweep.grid");
        text.key("learning_rate", &list(&size.learning_rates()), "");
        // Keys that are not TOML are told when the study is complete.
        let study: toml::Table =
            toml::from_str(&with_given(&text.0, self.given)).unwrap_or_default();
        other_axes(&study, text);
        text.section("evaluate");
        text.key(
            "rule",
            "\"log_replay\"",
            "agents that start from the log are chosen by the log; docs/metrics.md has the other rules",
        );
    }
}

/// Formats a time span in a suitable unit.
fn span(secs: f64) -> String {
    let (size, unit) = match secs {
        secs if secs >= 2.0 * 86_400.0 => (86_400.0, "days"),
        secs if secs >= 2.0 * 3_600.0 => (3_600.0, "h"),
        secs if secs >= 120.0 => (60.0, "min"),
        _ => (1.0, "s"),
    };
    let value = secs / size;
    if value >= 10.0 { format!("{value:.0} {unit}") } else { format!("{value:.1} {unit}") }
}

#[cfg(test)]
mod tests {
    use calib_data::Sketch;

    use super::*;
    use crate::{
        Angle, Cleaning, Scope,
        testing::{sketch, wave},
    };

    /// Returns the text of a study of `log` that predicts these sensors, with states `spacing` rows apart.
    fn drafted(log: &Sketch, sensors: &Sensors, spacing: usize) -> String {
        drafted_with(log, sensors, spacing, ProposedModel::None, 1_000, &[])
    }

    fn drafted_with(
        log: &Sketch,
        sensors: &Sensors,
        spacing: usize,
        model: ProposedModel,
        steps: usize,
        given: &[String],
    ) -> String {
        let scope = Scope::of(log).expect("channels");
        let draft = Draft {
            log: LogDraft {
                sketch: log,
                path: "logs",
                scope: &scope,
                cleaning: &Cleaning::of(log, &scope),
                missing_values: &[],
                angles: &[Angle { channel: "wind [°]".to_owned(), turn: 360.0 }],
                clock: None,
            },
            spacing: (spacing, "because"),
            horizon: horizon(log, &sensors.proposed, spacing, steps),
            cut: &Cut::of(log, &scope).expect("rows"),
            sensors,
            size: &Size::trial(ProposedAgent::Linear, model, steps, sensors.proposed.len()),
            held_out_states: 5_000,
            windows: 4,
            agent_reason: "tried",
            baseline: "ridge regression for B",
            asked: Asked::default(),
            given,
            size_reason: "sized to end within 10 min",
        };
        draft.text()
    }

    #[test]
    fn every_choice_stands_in_the_file_with_its_reason() {
        let log = sketch(
            20_000,
            &[
                ("A \"1\"", wave(40.0)),
                ("B", wave(70.0)),
                ("total", Box::new(|row| (row as f64).powf(1.1))),
            ],
        );
        let sensors = Sensors::of(&log, &Scope::of(&log).expect("channels")).expect("sensors");
        let text = drafted(&log, &sensors, 2);
        let read: toml::Table = toml::from_str(&text).expect("TOML");
        assert_eq!(read["data"]["path"].as_str(), Some("logs"));
        assert_eq!(read["data"]["exclude"][0].as_str(), Some("total"));
        assert_eq!(read["data"]["angles"]["wind [[]°]"].as_integer(), Some(360));
        assert!(text.contains("; wind [°]_sin and wind [°]_cos are channels"), "{text}");
        assert_eq!(read["sweep"]["sensors"].as_array().map(Vec::len), Some(2));
        assert_eq!(read["preprocess"]["subsample"].as_integer(), Some(2));
        assert_eq!(read["model"]["kind"].as_str(), Some("none"));
        assert!(read.get("rollout").is_none() && read["sweep"].get("member_runs").is_none());
        assert!(text.contains("kind = \"knn\" builds one of neighbours"), "{text}");
        assert!(text.contains("\n# lambda = [0, 0.9] "), "{text}");
        let given = ["sweep.grid.lambda=[0.5]".to_owned()];
        let modelled = drafted_with(&log, &sensors, 2, ProposedModel::Ensemble, 1_000, &given);
        assert!(!modelled.contains("lambda"), "the given key is written later");
        let modelled: toml::Table = toml::from_str(&modelled).expect("TOML");
        assert_eq!(modelled["model"]["members"].as_integer(), Some(5));
        assert_eq!(modelled["sweep"]["member_runs"].as_integer(), Some(1));
        assert!(modelled["model"].get("kind").is_none() && modelled.contains_key("rollout"));
        assert!(text.contains("# a total: nearly all of its changes go one way"), "{text}");
        assert!(text.contains("# because"), "{text}");
        assert!(
            text.contains("best simple predictor, here ridge regression for B, and adds"),
            "{text}"
        );
        for line in text.lines().filter(|line| line.contains(" = ")) {
            assert!(!line.ends_with("# "), "{line}");
        }
    }

    #[test]
    fn a_sensor_that_misses_much_of_the_training_range_is_kept() {
        let hole: crate::testing::Channel = Box::new(|row| {
            let value = (std::f64::consts::TAU * row as f64 / 40.0).sin();
            if (1_000..2_000).contains(&row) { f64::NAN } else { value }
        });
        let log = sketch(12_000, &[("A", hole), ("B", wave(70.0))]);
        let [a, b] = [0, 1].map(|sensor| {
            let sensors = Sensors { proposed: vec![sensor], others: Vec::new() };
            drafted(&log, &sensors, 1)
        });
        assert!(a.contains("max_missing = 0.15 "), "{a}");
        assert!(a.contains("A misses 12 % of the training range"), "{a}");
        assert!(!b.contains("max_missing"), "the default will do for B");
    }

    #[test]
    fn a_sensor_that_changes_much_more_slowly_has_a_horizon_in_a_comment() {
        let log =
            sketch(20_000, &[("A", wave(60.0)), ("B", wave(70.0)), ("slow \"1\"", wave(3_000.0))]);
        let text = |proposed: &[usize], steps| {
            let sensors = Sensors { proposed: proposed.to_vec(), others: Vec::new() };
            drafted_with(&log, &sensors, 2, ProposedModel::None, steps, &[])
        };
        let all = text(&[0, 1, 2], 6_000);
        let line = all.lines().find(|line| line.contains("gammas")).expect(&all);
        let (table, why) = line.split_once("  # ").expect(line);
        assert_eq!(table.trim_end(), "# gammas = { \"slow \\\"1\\\"\" = 0.98 }");
        assert!(why.ends_with("of one sensor: 50 states for slow \"1\""), "{why}");
        let read: toml::Table = toml::from_str(&table[2..]).expect("TOML");
        assert_eq!(read["gammas"]["slow \"1\""].as_float(), Some(0.98));
        let without: [(&[usize], usize); 3] =
            [(&[0, 1], 6_000), (&[2], 6_000), (&[0, 1, 2], 1_000)];
        for (proposed, steps) in without {
            assert!(!text(proposed, steps).contains("gammas"), "{proposed:?} {steps}");
        }
    }

    #[test]
    fn spans_are_read_in_their_unit() {
        let spans = [5.0, 90.0, 600.0, 9_000.0, 400_000.0].map(span);
        assert_eq!(spans, ["5.0 s", "90 s", "10 min", "2.5 h", "4.6 days"]);
    }
}
