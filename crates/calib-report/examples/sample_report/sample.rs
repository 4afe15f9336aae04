//! Made-up numbers that look like those of a study.

use calib_report::{
    Alternative, Best, Cell, Channel, ChannelStatus, ChoiceBaseline, DataProfile, ErrorCurve,
    ErrorSource, Grade, HeldOutResult, JumpStatistics, LearningCurve, LearningCurves,
    LearningEnvironment, PeriodUse, RankCurve, Reason, RecordedFigure, RecordedPeriod, Report,
    Reproduction, RolloutFigure, RolloutGrid, RolloutRow, Samples, Score, Sensitivity, Separation,
    Setting, Table, TopK, Trajectory, Verdict,
};
use calib_stats::{
    Direction, Estimate, Losses, Selection, Summary, kendall_tau_b, select, spearman, summarise,
    top_k_hit,
};

const MEMBERS: usize = 5;
/// The value one would use without calib: 1e-3.
const DEFAULT: usize = 6;

const RATES: [f64; 9] = [1e-6, 3e-6, 1e-5, 3e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2];

/// Noise without a generator: the fractional part of a large sine, from −1 to 1.
fn noise(index: usize) -> f64 {
    let value = ((index as f64 + 1.0) * 12.9898).sin() * 43_758.547;
    2.0 * (value - value.floor()) - 1.0
}

/// A valley around `best`, as learning-rate curves have; the largest rates may diverge.
fn error_at(rate: f64, best: f64, floor: f64) -> f64 {
    let away = (rate / best).log10();
    floor + if away < 0.0 { 0.05 * away * away } else { 0.11 * away * away }
}

fn runs(rate: f64, best: f64, floor: f64, seed: usize, diverges: bool) -> Summary {
    let runs: Vec<f64> = (0..30)
        .map(|run| {
            if diverges && rate >= 9e-3 && run % 3 == 0 {
                return f64::INFINITY;
            }
            error_at(rate, best, floor) * (1.0 + 0.08 * noise(seed * 1000 + run))
        })
        .collect();
    summarise(&runs).expect("runs are numbers")
}

fn selection(best: f64, seed: usize) -> Selection {
    let members: Vec<Vec<f64>> = (0..MEMBERS)
        .map(|member| {
            let shift = best * 10f64.powf(0.35 * noise(seed + member));
            RATES.iter().map(|&rate| error_at(rate, shift, 0.1)).collect()
        })
        .collect();
    select(&members, Direction::LowerIsBetter).expect("errors are numbers")
}

/// One sensor: where its best learning rate lies, its smallest error, and whether large rates diverge.
struct Sensor {
    name: &'static str,
    best: f64,
    floor: f64,
    diverges: bool,
    seed: usize,
}

fn sensors() -> Vec<Sensor> {
    [("PIT300", 1.6e-4, 0.12, false), ("TIT101", 4e-5, 0.04, false), ("TUIT101", 6e-4, 0.3, true)]
        .into_iter()
        .enumerate()
        .map(|(seed, (name, best, floor, diverges))| Sensor { name, best, floor, diverges, seed })
        .collect()
}

impl Sensor {
    fn curve(&self, label: &str, source: ErrorSource, best: f64) -> ErrorCurve {
        let seed = 10 * self.seed + if source == ErrorSource::Online { 0 } else { 500 };
        ErrorCurve {
            label: label.to_owned(),
            source,
            over: Samples::Runs,
            summaries: RATES
                .iter()
                .enumerate()
                .map(|(place, &rate)| {
                    Some(runs(rate, best, self.floor, seed + place, self.diverges))
                })
                .collect(),
        }
    }

    fn online(&self) -> ErrorCurve {
        self.curve("Online", ErrorSource::Online, self.best)
    }

    fn log_replay(&self) -> ErrorCurve {
        self.curve("Log replay", ErrorSource::LogReplay, self.best / 5.0)
    }

    /// The calibration models by name, with what they select.
    fn models(&self) -> [(&'static str, Selection); 2] {
        [
            ("kNN, Euclidean", selection(self.best * 0.8, self.seed)),
            ("kNN, Laplacian", selection(self.best * 2.5, self.seed + 50)),
        ]
    }

    fn sensitivity(&self) -> Sensitivity {
        let models = self.models();
        Sensitivity {
            sensor: self.name.to_owned(),
            field: "learning_rate".to_owned(),
            score: Score::nrmse(),
            values: RATES.into_iter().map(Setting::from).collect(),
            errors: vec![self.online(), self.log_replay()],
            chosen: Some(models[0].1.chosen),
            worst_ranks: models
                .map(|(label, selection)| RankCurve {
                    label: label.to_owned(),
                    worst_ranks: selection.worst_ranks,
                })
                .into(),
            default: Some(DEFAULT),
            dimensions: vec![],
        }
    }

    fn verdicts(&self) -> Vec<Verdict> {
        let direction = Direction::LowerIsBetter;
        let online = means(&self.online());
        let losses = Losses::new(&[&online]).expect("online errors are numbers");
        let argmin =
            |scores: &[f64]| select(&[scores], direction).expect("scores are numbers").chosen;
        let (best, replayed) = (argmin(&online), argmin(&means(&self.log_replay())));
        let estimate = |index: usize| losses.regret(index);
        let alternative = |baseline, index: usize| Alternative {
            baseline,
            value: Some(RATES[index].into()),
            regret: estimate(index),
        };
        self.models()
            .into_iter()
            .map(|(model, selection)| {
                let ranks: Vec<f64> =
                    selection.worst_ranks.iter().map(|&rank| rank as f64).collect();
                let chosen = selection.chosen;
                Verdict {
                    sensor: self.name.to_owned(),
                    field: "learning_rate".to_owned(),
                    model: model.to_owned(),
                    chosen: RATES[chosen].into(),
                    grade: Grade::Fair,
                    reason: Reason::WorstRank,
                    evidence: Separation::Apart,
                    outside_training: None,
                    tie_set: selection.tie_set.iter().map(|&index| RATES[index].into()).collect(),
                    worst_rank: selection.worst_ranks[chosen],
                    values: RATES.len(),
                    members: MEMBERS,
                    stability: vec![(RATES[chosen].into(), 0.9), (RATES[best].into(), 0.1)],
                    stability_nearby: Some(1.0),
                    online: Some(HeldOutResult {
                        part: "whole runs".to_owned(),
                        windows: 1,
                        runs: 5,
                        values: Separation::Apart,
                        stands_still: false,
                        chosen_error: online[chosen],
                        chosen_skill: Some(1.0 - online[chosen]),
                        best: RATES[best].into(),
                        best_error: online[best],
                        best_skill: Some(1.0 - online[best]),
                        regret: estimate(chosen),
                        against_default: Some(Estimate {
                            value: online[chosen] / online[DEFAULT],
                            interval: None,
                        }),
                        spearman: spearman(&ranks, &online).expect("equally long"),
                        kendall: kendall_tau_b(&ranks, &online).expect("equally long"),
                        top_k: Some(TopK {
                            k: 3,
                            hit: top_k_hit(&online, chosen, 3, direction)
                                .expect("chosen is in the grid"),
                        }),
                    }),
                    alternatives: vec![
                        alternative(ChoiceBaseline::Default, DEFAULT),
                        alternative(ChoiceBaseline::LogReplay, replayed),
                        alternative(ChoiceBaseline::Hindsight, best),
                    ],
                    simple: vec![],
                    simpler: None,
                    matched: None,
                    frozen: None,
                    parts: vec![],
                    start_up_share: None,
                    notes: vec![],
                }
            })
            .collect()
    }
}

/// The mean error of each rate of a curve.
fn means(curve: &ErrorCurve) -> Vec<f64> {
    curve.summaries.iter().flatten().map(|summary| summary.mean).collect()
}

/// A sensitivity figure for each sensor.
pub(crate) fn sensitivities() -> Vec<Sensitivity> {
    sensors().iter().map(Sensor::sensitivity).collect()
}

fn trajectory(label: &str, steps: usize, level: f64, size: f64, seed: usize) -> Trajectory {
    let mut wander = 0.0;
    let values = (0..steps)
        .map(|step| {
            wander = 0.999 * wander + 0.02 * noise(seed * 100_000 + step);
            let phase = (step + 337 * seed) % 1800;
            // A filtration cycle with a short backwash.
            let cycle = if phase > 1710 { -2.0 } else { phase as f64 / 1800.0 };
            if seed == 0 && (12_000..12_600).contains(&step) {
                return f64::NAN;
            }
            level + size * (cycle + wander + 0.08 * noise(step + seed))
        })
        .collect();
    Trajectory { label: label.to_owned(), period_secs: 1.0, values }
}

/// The rollouts as small plots, with a row of the first third.
pub(crate) fn grids() -> Vec<RolloutGrid> {
    rollouts()
        .into_iter()
        .filter_map(|figure| {
            let truth = figure.truth?;
            let rows = vec![
                RolloutRow {
                    label: "start 1".to_owned(),
                    truth: first_third(&truth),
                    rollouts: figure
                        .rollouts
                        .iter()
                        .map(|rollout| Some(first_third(rollout)))
                        .collect(),
                },
                RolloutRow {
                    label: "start 2".to_owned(),
                    truth,
                    rollouts: figure.rollouts.iter().cloned().map(Some).collect(),
                },
            ];
            let models = figure.rollouts.iter().map(|rollout| rollout.label.clone()).collect();
            Some(RolloutGrid { sensor: figure.sensor, unit: figure.unit, models, rows })
        })
        .collect()
}

/// The beginning of a trajectory.
fn first_third(trajectory: &Trajectory) -> Trajectory {
    let values = trajectory.values[..trajectory.values.len() / 3].to_vec();
    Trajectory { values, ..trajectory.clone() }
}

/// The sensors in training, and a week later.
pub(crate) fn recorded() -> Vec<RecordedFigure> {
    [("PIT300", "kPa", -18.0, 6.0), ("TIT101", "°C", 14.2, 0.4)]
        .into_iter()
        .map(|(sensor, unit, level, size): (&str, &str, f64, f64)| {
            let training = trajectory("training", 1_200, level, size, 0);
            let held_out = trajectory("held out", 600, level + size, size, 1);
            RecordedFigure {
                sensor: sensor.to_owned(),
                unit: Some(unit.to_owned()),
                periods: vec![
                    recorded_period(&training, PeriodUse::Learning, 1.667_26e9),
                    recorded_period(&held_out, PeriodUse::Deployment, 1.668_2e9),
                ],
            }
        })
        .collect()
}

/// A value every five minutes, from `first` on.
fn recorded_period(trajectory: &Trajectory, used_for: PeriodUse, first: f64) -> RecordedPeriod {
    let points = trajectory.values.iter().enumerate();
    RecordedPeriod {
        name: trajectory.label.clone(),
        used_for,
        times: ["first value", "last value"].map(str::to_owned),
        points: points.map(|(at, &y)| (first + 300.0 * at as f64, y)).collect(),
    }
}

/// A rollout figure for each sensor.
pub(crate) fn rollouts() -> Vec<RolloutFigure> {
    [("PIT300", "kPa", -18.0, 6.0), ("TIT101", "°C", 14.2, 0.4)]
        .into_iter()
        .map(|(sensor, unit, level, size)| RolloutFigure {
            sensor: sensor.to_owned(),
            unit: Some(unit.to_owned()),
            truth: Some(trajectory("True trajectory", 30_000, level, size, 0)),
            rollouts: vec![
                trajectory("kNN, Euclidean (member 0)", 30_000, level, size, 1),
                trajectory("kNN, Laplacian (member 0)", 30_000, level, size * 0.9, 2),
                trajectory("kNN, Euclidean (member 1)", 30_000, level, size * 1.1, 3),
            ],
        })
        .collect()
}

/// Learning curves of nine rates Online and in two members; the largest diverges.
pub(crate) fn learning() -> Vec<LearningCurves> {
    [LearningEnvironment::Online, learning_member(0), learning_member(1)]
        .map(|environment| LearningCurves {
            sensor: "PIT300".to_owned(),
            field: "learning_rate".to_owned(),
            environment,
            steps: 30_000,
            curves: RATES
                .map(|rate: f64| LearningCurve {
                    value: Setting::from(rate),
                    points: (1..=50)
                        .filter_map(|window: usize| {
                            let step = 600 * window;
                            let runs: Vec<f64> =
                                (0..5).map(|run| learning_error(rate, step, run)).collect();
                            summarise(&runs).ok().map(|summary| (step, summary))
                        })
                        .collect(),
                })
                .to_vec(),
        })
        .to_vec()
}

/// An ensemble member of a model that needs no name.
fn learning_member(number: usize) -> LearningEnvironment {
    LearningEnvironment::Member { number, model: None }
}

/// The error of a run up to a step: it falls faster with a larger rate, and the largest rate diverges.
fn learning_error(rate: f64, step: usize, run: usize) -> f64 {
    if rate > 5e-3 && step > 9_000 + 1_000 * run {
        return f64::INFINITY;
    }
    let time = step as f64 * rate.sqrt() / 30.0;
    let noise = (step as f64 * 0.013 + run as f64 * 2.1).sin() * (0.02 + rate.sqrt());
    (0.15 + 0.6 / (1.0 + time) + rate.sqrt()) * (1.0 + noise)
}

/// The whole report.
pub(crate) fn report() -> Report {
    Report {
        title: "Learning rates for the filtration pilot".to_owned(),
        subtitle: Some("Made-up sample data · one week, 1 Hz · TD(0) nexting of three sensors".to_owned()),
        predicts: None,
        score: Score::nrmse(),
        verdicts: sensors().iter().flat_map(Sensor::verdicts).collect(),
        warnings: vec![
            "TUIT101: the mean return is small beside its spread, so NRMSE is hard to read; compare RMSE/std as well."
                .to_owned(),
        ],
        sensitivities: sensitivities(),
        learning: learning(),
        decision: None,
        recorded: recorded(),
        rollouts: rollouts(),
        rollout_grids: grids(),
        jumps: jumps(),
        tables: vec![dtw()],
        data: Some(data()),
        reproduction: Reproduction {
            command: "calib evaluate study.toml --out report".to_owned(),
            study_toml: "[data]\nfiles = \"logs/*.parquet\"\ntime = \"timestamp\"\n\n[model]\nmembers = 5\nneighbors = 3\n\n\
                         [sweep]\nfield = \"learning_rate\"\nvalues = [1e-6, 3e-6, 1e-5, 3e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2]\n"
                .to_owned(),
            versions: vec![("calib".to_owned(), "0.1.0".to_owned())],
            seeds: vec![("study".to_owned(), 7)],
            fingerprint: "b3:5d41402abc4b2a76b9719d911017c592".to_owned(),
        },
    }
}

/// What the report looks like when no data was held out.
pub(crate) fn without_online(report: &mut Report) {
    for verdict in &mut report.verdicts {
        verdict.online = None;
        verdict.grade = Grade::Unchecked;
        for alternative in &mut verdict.alternatives {
            alternative.regret = None;
        }
    }
    for sensitivity in &mut report.sensitivities {
        sensitivity.errors.clear();
    }
}

fn jumps() -> Vec<JumpStatistics> {
    (0..MEMBERS)
        .map(|member: usize| JumpStatistics {
            model: "kNN, Euclidean".to_owned(),
            member,
            steps: 30_000,
            jump_rate: if member == 3 { 0.002 } else { 0.08 + 0.01 * noise(member) },
            departure_rate: if member == 3 { 0.001 } else { 0.04 },
            mean_run_length: if member == 3 { 480.0 } else { 12.3 + noise(member) },
            note: (member == 3).then(|| "nearly a verbatim replay of the log".to_owned()),
        })
        .collect()
}

fn dtw() -> Table {
    Table {
        title: "DTW distance to the true trajectory, PIT300".to_owned(),
        caption: "Normalised distance, by step pattern; lower is better and the best of each row is bold.".to_owned(),
        columns: ["Step pattern", "kNN, Euclidean", "kNN, Laplacian", "NN"].map(ToOwned::to_owned).to_vec(),
        rows: vec![
            dtw_row("symmetric2", [0.0213, 0.0187, 0.0941]),
            dtw_row("asymmetric", [0.0302, 0.0311, 0.128]),
            dtw_row("symmetricP1", [0.0267, 0.0251, f64::INFINITY]),
            dtw_row("Rabiner–Juang VI c", [0.0284, 0.0284, 0.117]),
        ],
        best: Some(Best::OfRow(Direction::LowerIsBetter)),
    }
}

/// A step pattern, and the distance of each model by it.
fn dtw_row(pattern: &str, distances: [f64; 3]) -> Vec<Cell> {
    let mut cells = vec![Cell::Text(pattern.to_owned())];
    cells.extend(distances.map(Cell::Number));
    cells
}

fn data() -> DataProfile {
    DataProfile {
        rows: 604_800,
        segments: 14,
        period_secs: 1.0,
        first: "2022-10-03 00:00:00".to_owned(),
        last: "2022-10-09 23:59:59".to_owned(),
        facts: vec![("Held-out rows".to_owned(), "30,000".to_owned())],
        channels: vec![
            channel("PIT300", "kPa", Some(-36.2), Some(-4.1), 0.0003, ChannelStatus::Kept),
            channel("TIT101", "°C", Some(11.8), Some(16.4), 0.0, ChannelStatus::Kept),
            channel("TUIT101", "NTU", Some(0.02), Some(412.0), 0.011, ChannelStatus::Kept),
            channel("FIT402 <spare>", "m³/h", Some(0.0), Some(0.0), 0.0, dropped("constant")),
            channel("AIT900", "", None, None, 1.0, dropped("missing in 100 % of rows, limit 50 %")),
        ],
    }
}

/// A channel of the log, with its smallest and its largest value.
fn channel(
    name: &str,
    unit: &str,
    min: Option<f64>,
    max: Option<f64>,
    missing: f64,
    status: ChannelStatus,
) -> Channel {
    Channel {
        name: name.to_owned(),
        unit: (!unit.is_empty()).then(|| unit.to_owned()),
        min,
        max,
        missing,
        status,
    }
}

fn dropped(reason: &str) -> ChannelStatus {
    ChannelStatus::Dropped(reason.to_owned())
}
