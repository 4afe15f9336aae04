//! A whole sweep on a small plant: units, resuming, determinism, verdict.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::Path,
    sync::atomic::{AtomicU64, Ordering},
    time::SystemTime,
};

use calib_agent::{AgentConfig, Checkpoint, Part, ReturnMoments, ValueFunction};
use calib_core::{
    Frames, Monitor, RowIndex, Seed, Segments, Silent, States, Timestamp, Transitions,
};
use calib_dynamics::{Dynamics, DynamicsError, LANES, LaneRollouts};
use calib_files::Fingerprint;
use calib_knn::{KnnModel, ModelConfig, Weights};
use calib_model::{
    CalibrationModel as _, ModelStart, NeighborModel, NetworkModel, RequestedStart, StartRow,
    StartSource, start_states,
};
use calib_sweep::{
    Candidate, ChoiceBaseline, CompletedSweep, Environment, EnvironmentId, ErrorScale, Grade,
    Judging, MemberEnvironment, NotFinite, Plan, PlanOptions, PlannedSensor, PlannedUnit,
    ReplayEnvironment, RolloutOptions, Rule, ScoringDemand, SensorGroup, SensorVerdict, Span,
    Start, StoredUnits, SweepConfig, SweepError, Truth, Unit, UnitResult, UnitStore, Windows,
    candidates, raced, verdict,
};

/// Returns a wave with a period of 24 rows.
fn wave(row: usize, phase: f32) -> f32 {
    ((row as f32 / 24.0 + phase) * std::f32::consts::TAU).sin()
}

/// Returns two waves in two segments.
fn frames(rows: usize) -> Frames {
    let values =
        (0..rows).flat_map(|row| [0.5 + 0.4 * wave(row, 0.0), 0.5 + 0.4 * wave(row, 0.25)]);
    let timestamps = (0..rows as i64).map(|row| Timestamp::from_micros(row * 1_000_000)).collect();
    let segments = Segments::from_lengths([rows / 3, rows - rows / 3]).expect("valid");
    Frames::new(timestamps, segments, States::new(values.collect(), rows, 2).expect("valid"))
        .expect("valid")
}

/// Returns a span of 600 steps, with the states that complete returns of γ = 0.8.
fn span() -> Span {
    Span::new(600, [0.8])
}

fn demand(span: Span) -> ScoringDemand {
    ScoringDemand { span, gamma: 0.8, part: Part::WholeRun }
}

fn plan_options(span: Span, seed: Seed) -> PlanOptions {
    PlanOptions { part: Part::WholeRun, span, curve_points: 10, seed }
}

fn sensors() -> Vec<(String, usize)> {
    vec![("A".to_owned(), 0), ("B".to_owned(), 1)]
}

fn written_at(file: &Path) -> SystemTime {
    fs::metadata(file).and_then(|metadata| metadata.modified()).expect("there")
}

fn warns(verdict: &SensorVerdict, text: &str) -> bool {
    verdict.warnings.iter().any(|warning| warning.contains(text))
}

struct Study {
    train: Frames,
    held_out: Frames,
    model: NeighborModel,
    candidates: Vec<Candidate>,
}

impl Study {
    fn new() -> Self {
        // 1e38 leaves single precision within a few steps.
        Self::of(&[1e-5, 5e-2, 1e38])
    }

    /// Creates a study of these learning rates and the agent's own.
    fn of(rates: &[f64]) -> Self {
        let agent = AgentConfig {
            value_function: ValueFunction::Linear,
            gamma: 0.8,
            batch_size: 8,
            learning_rate: 3e-3,
            ..AgentConfig::default()
        };
        let grid: Vec<serde_json::Value> = rates.iter().copied().map(Into::into).collect();
        let config = SweepConfig {
            grid: BTreeMap::from([("learning_rate".to_owned(), grid.into())]),
            ..SweepConfig::default()
        };
        let train = frames(900);
        let model = KnnModel::build(
            train.states().clone(),
            Transitions::new(train.segments().clone()),
            &ModelConfig { members: 3, ..ModelConfig::default() },
            &Silent,
        )
        .expect("built");
        let candidates = candidates(&config, &agent, Seed::new(1)).expect("valid");
        let model = NeighborModel::new(model, train.states().clone());
        Self { train, held_out: frames(1300), model, candidates }
    }

    /// Returns the units of the plan and the keys of its settings.
    fn units(&self, seed: u64) -> (Vec<PlannedUnit>, Vec<String>) {
        self.with_plan(seed, |plan| {
            (plan.units(), plan.settings().iter().map(ToString::to_string).collect())
        })
    }

    fn with_plan<T>(&self, seed: u64, then: impl FnOnce(Plan<'_>) -> T) -> T {
        self.with_runs(seed, 2, then)
    }

    /// Runs `then` on a plan with `runs` runs of each member and as many windows of the log.
    fn with_runs<T>(&self, seed: u64, runs: usize, then: impl FnOnce(Plan<'_>) -> T) -> T {
        let seed = Seed::new(seed);
        let inputs = Fingerprint::of(b"data");
        let members: Vec<MemberEnvironment<'_>> = (0..self.model.members())
            .map(|number| {
                let member = self.model.knn().member(number);
                let starts = start_states(&member, StartSource::Random, runs, seed)
                    .expect("starts")
                    .into_iter()
                    .map(ModelStart::State)
                    .collect();
                let options = RolloutOptions {
                    span: span(),
                    weights: Weights::Linear,
                    seed,
                    inputs: inputs.clone(),
                };
                MemberEnvironment::new(&self.model, number, self.train.states(), starts, options)
            })
            .collect();
        let windows = Windows::held_out(self.held_out.segments(), demand(span()), 2);
        let online = ReplayEnvironment::online(&self.held_out, windows, 4, inputs.clone());
        let windows = Windows::log(self.train.segments(), demand(span()), runs);
        let replay = ReplayEnvironment::log_replay(&self.train, windows, inputs.clone());
        let mut environments: Vec<&dyn Environment> =
            members.iter().map(|member| member as &dyn Environment).collect();
        environments.extend([&online as &dyn Environment, &replay]);
        let options = plan_options(span(), seed);
        then(Plan::new(&self.candidates, environments, sensors(), options))
    }
}

fn in_pool<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool").install(work)
}

fn results_of(study: &Study, store: &UnitStore) -> Vec<UnitResult> {
    study.with_plan(1, |plan| plan.run(store, &Silent).expect("runs"))
}

#[test]
fn results_do_not_depend_on_threads_or_on_interruptions() {
    let study = Study::new();
    let directory = tempfile::tempdir().expect("a directory");
    let [one, four] = ["one", "four"].map(|name| UnitStore::new(directory.path().join(name)));
    let alone = in_pool(1, || results_of(&study, &one));
    let together = in_pool(4, || results_of(&study, &four));
    assert_eq!(alone, together);

    // One unit is lost and another damaged. Only these are run again, with the same result.
    let lost = directory.path().join("one/A/online/run-0001.json");
    let damaged = directory.path().join("one/B/member-2/run-0000.json");
    let kept = directory.path().join("one/A/member-0/run-0000.json");
    fs::remove_file(&lost).expect("was there");
    fs::write(&damaged, b"{").expect("writable");
    let before = written_at(&kept);
    let (units, settings) = study.units(1);
    assert!(matches!(
        one.collect(&units, &settings),
        Err(SweepError::Incomplete { missing: 2, .. })
    ));
    assert_eq!(results_of(&study, &one), alone);
    assert_eq!(written_at(&kept), before);
    assert_eq!(one.collect(&units, &settings).expect("complete"), alone);

    // A run of n + 1 states in one piece has n steps.
    assert!(
        alone
            .iter()
            .filter(|result| result.unit.environment == EnvironmentId::Member(0))
            .all(|result| result.rows.iter().all(|row| row.steps == 600))
    );

    // Another seed gives another sweep, which reuses no results.
    let (other, settings) = study.units(2);
    assert!(matches!(
        one.collect(&other, &settings),
        Err(SweepError::Incomplete { missing: 24, .. })
    ));
}

/// Completes a sweep or a race, and returns the number of runs that were left before.
fn completed(study: &Study, store: &UnitStore, is_race: bool) -> (usize, CompletedSweep) {
    study.with_runs(1, 4, |plan| {
        let plan = if is_race { plan.race() } else { plan };
        let stored = plan.stored(store);
        let left = plan.runs_left(&stored);
        (left, plan.complete(stored, store, &Silent).expect("runs"))
    })
}

#[test]
fn a_larger_grid_trains_its_new_settings_alone() {
    let small = Study::of(&[1e-5, 5e-2, 1e38]);
    let large = Study::of(&[1e-5, 1e-4, 5e-2, 1e38]);
    let directory = tempfile::tempdir().expect("a directory");
    for is_race in [false, true] {
        let [fresh_store, grown_store] = ["fresh", "grown"]
            .map(|name| UnitStore::new(directory.path().join(format!("{name}-{is_race}"))));
        let (_, fresh) = completed(&large, &fresh_store, is_race);
        let (_, before) = completed(&small, &grown_store, is_race);
        let (left, grown) = completed(&large, &grown_store, is_race);
        assert_eq!(grown.results, fresh.results, "race: {is_race}");
        if !is_race {
            // Two sensors, four runs in each of three members, on the log and online.
            assert_eq!((left, grown.runs, grown.ran), (40, 40, 40));
        }
        assert!(grown.runs < fresh.runs / 2, "{is_race}: {} of {}", grown.runs, fresh.runs);
        let (left, back) = completed(&small, &grown_store, is_race);
        assert_eq!((left, back.runs, back.ran), (0, 0, 0), "race: {is_race}");
        assert_eq!(back.results, before.results, "race: {is_race}");
    }
}

/// Returns the setting that a baseline chooses, and its regret.
fn cost(truth: &Truth, baseline: ChoiceBaseline) -> (Option<usize>, Option<f64>) {
    let own = truth.baselines.iter().find(|known| known.baseline == baseline).expect("there");
    (own.chosen, own.regret.map(|regret| regret.value))
}

#[test]
fn the_verdict_chooses_what_learns_and_prices_the_alternatives() {
    let study = Study::new();
    let directory = tempfile::tempdir().expect("a directory");
    let store = UnitStore::new(directory.path().to_owned());
    let results = study.with_plan(1, |plan| plan.run(&store, &Silent).expect("runs"));
    let verdict = judged(&study, &results);
    assert_eq!(verdict.members.len(), 3);
    let selection = verdict.selection.as_ref().expect("three members");
    assert_eq!(selection.chosen, 2, "{selection:?}");
    assert_eq!(verdict.chosen, 2);
    assert_eq!(selection.worst_ranks.len(), 4, "the default can be chosen as well");
    assert!(selection.mean_errors[3].is_infinite(), "1e38 diverges");
    let truth = verdict.truth.as_ref().expect("a held-out range");
    assert_eq!((truth.scores.streams, truth.scores.runs), (2, 4));
    assert_eq!(truth.scores.candidates[2].runs, 2, "a window is the unit");
    assert_eq!(
        truth.windows.iter().map(|window| window.scored_steps).collect::<Vec<_>>(),
        [579, 600]
    );
    assert_eq!((truth.best, truth.choice.chosen), (Some(2), 2));
    let regret = truth.choice.regret.expect("known");
    assert_eq!((regret.value, regret.upper), (0.0, None));
    assert!(truth.choice.spearman.expect("four values") > 0.9);
    assert!(truth.scores.skill[2].expect("learnt") > 0.0);
    assert_eq!(cost(truth, ChoiceBaseline::Hindsight), (Some(2), Some(0.0)));
    assert_eq!(cost(truth, ChoiceBaseline::AnotherWindow), (None, Some(0.0)));
    assert_eq!(
        cost(truth, ChoiceBaseline::Random),
        (None, Some(f64::INFINITY)),
        "one of four diverges"
    );
    let (default, default_regret) = cost(truth, ChoiceBaseline::Default);
    assert!(study.candidates[default.expect("one")].is_default);
    assert!(default_regret > Some(0.0));
    assert!(truth.choice.against_default.expect("another").value < 1.0);
    assert_eq!(verdict.grade, Grade::Good);
    assert_eq!((verdict.stability[0].candidate, verdict.stability[0].share), (2, 1.0));
    assert_eq!(verdict.stability_nearby, Some(1.0));
    assert!(warns(&verdict, "diverged"));
}

/// Returns the verdict by the paper's rule over the whole run.
fn judged(study: &Study, results: &[UnitResult]) -> SensorVerdict {
    let replay =
        calib_core::RowStream::replay(study.train.states().clone(), study.train.segments());
    let returns = ReturnMoments::of(&replay, 0, 0.8);
    let scales = [ErrorScale { sensor: "A".to_owned(), gamma: 0.8, returns }];
    let judging = Judging {
        part: Part::WholeRun,
        rule: Rule::WorstRank,
        top_k: 1,
        scales: &scales,
        simple: &[],
        best: None,
        stands_still: false,
        resamples: 200,
        seed: Seed::new(1),
    };
    verdict("A", &study.candidates, results, &judging).expect("judged")
}

fn start_row(environment: &ReplayEnvironment<'_>, run: usize) -> usize {
    environment.stream(run).expect("a stream").start_row.get()
}

#[test]
fn runs_are_dealt_to_windows() {
    let train = frames(900);
    let inputs = Fingerprint::of(b"data");
    let demand = demand(Span::new(300, [0.8]));
    let windows = Windows::log(train.segments(), demand, 3);
    let replay = ReplayEnvironment::log_replay(&train, windows, inputs.clone());
    assert_eq!([0, 1, 2].map(|run| start_row(&replay, run)), [579, 290, 0], "the latest first");
    assert_ne!(replay.inputs(0), replay.inputs(1), "another window is another input");
    let windows = Windows::held_out(train.segments(), demand, 8);
    let online = ReplayEnvironment::online(&train, windows, 5, inputs.clone());
    assert_eq!([0, 1, 2, 3, 4].map(|run| start_row(&online, run)), [0, 579, 0, 579, 0]);
    assert_eq!(online.inputs(0), online.inputs(2));
    // All rows form the window where none fits.
    let demand = self::demand(Span::new(5000, [0.8]));
    let windows = Windows::held_out(train.segments(), demand, 8);
    let online = ReplayEnvironment::online(&train, windows, 2, inputs);
    let stream = online.stream(0).expect("a stream").stream;
    assert_eq!((stream.len(), stream.pieces()), (900, &[0..300, 300..900][..]));
    assert_eq!(online.id(), EnvironmentId::Online);
}

/// A monitor that asks to stop after a number of checks.
struct Impatient {
    asked: AtomicU64,
    patience: u64,
}

impl Monitor for Impatient {
    fn interrupted(&self) -> bool {
        self.asked.fetch_add(1, Ordering::Relaxed) >= self.patience
    }
}

#[test]
fn long_runs_go_on_in_the_middle() {
    let study = Study::new();
    let directory = tempfile::tempdir().expect("a directory");
    let [whole, stopped] =
        ["whole", "stopped"].map(|name| UnitStore::new(directory.path().join(name)));
    let expected = results_of(&study, &whole);
    let unfinished = directory.path().join("stopped/.unfinished");
    // Six or eight agents with at least a million multiplications per step: one state every hundred steps.
    let mut resumed = 0;
    let results = loop {
        let monitor = Impatient { asked: AtomicU64::new(0), patience: 320 };
        match in_pool(1, || {
            study.with_plan(1, |plan| plan.keeping_after(800_000_000).run(&stopped, &monitor))
        }) {
            Err(SweepError::Cancelled(_)) => resumed += u32::from(unfinished.is_dir()),
            other => break other.expect("runs"),
        }
        assert!(resumed < 1_000, "it gets on");
    };
    assert!(resumed > 10, "{resumed}");
    assert_eq!(results, expected);
    assert!(!unfinished.exists(), "nothing is left behind");
}

#[test]
fn agents_start_from_checkpoints() {
    let study = Study::new();
    let directory = tempfile::tempdir().expect("a directory");
    let checkpoint = Checkpoint { parameters: vec![0.5, -0.5, 1.0], moments: None };
    let fingerprint = Fingerprint::of(b"checkpoint");
    let start = Start { checkpoint, baseline: None, fingerprint };
    let starts = BTreeMap::from([("B".to_owned(), start)]);
    let scratch = results_of(&study, &UnitStore::new(directory.path().join("scratch")));
    let store = UnitStore::new(directory.path().join("tuned"));
    let tuned =
        study.with_plan(1, |plan| plan.starting_from(starts).run(&store, &Silent).expect("runs"));
    for (scratch, tuned) in scratch.iter().zip(&tuned) {
        let of_b = scratch.unit.sensor == "B";
        assert_eq!(scratch.key == tuned.key, !of_b, "a checkpoint is an input of its sensor");
        assert_eq!(scratch.rows == tuned.rows, !of_b);
    }
}

/// Returns the complete sweep of four settings and the same sweep as a race. Checks that the race makes the same runs.
fn whole_and_raced(study: &Study, directory: &Path) -> (Vec<UnitResult>, Vec<UnitResult>) {
    let [whole, one, four] =
        ["whole", "one", "four"].map(|name| UnitStore::new(directory.join(name)));
    let whole = study.with_runs(1, 4, |plan| plan.run(&whole, &Silent).expect("runs"));
    let alone = in_pool(1, || race(study, &one));
    assert_eq!(alone, in_pool(4, || race(study, &four)));
    let expected = raced(&whole, 4, Part::WholeRun);
    assert_eq!(alone.len(), expected.len());
    for (made, expected) in alone.iter().zip(&expected) {
        assert_eq!((&made.unit, &made.rows), (&expected.unit, &expected.rows), "{}", made.unit);
    }
    (whole, alone)
}

fn race(study: &Study, store: &UnitStore) -> Vec<UnitResult> {
    study.with_runs(1, 4, |plan| {
        let plan = plan.race();
        let completed = plan.complete(plan.stored(store), store, &Silent).expect("runs");
        let stored = plan.stored(store);
        assert_eq!((plan.left(&stored), plan.passes(&stored)), (0, 0));
        completed.results
    })
}

fn rows(results: &[UnitResult]) -> usize {
    results.iter().map(|result| result.rows.len()).sum()
}

/// Whether a unit counts when a setting is chosen.
fn chooses(result: &UnitResult) -> bool {
    result.unit.environment != EnvironmentId::Online
}

fn rows_that_choose(results: &[UnitResult]) -> usize {
    let choosing = results.iter().filter(|result| chooses(result));
    choosing.map(|result| result.rows.len()).sum()
}

#[test]
fn a_halving_keeps_the_better_half_again_and_again() {
    let study = Study::new();
    let directory = tempfile::tempdir().expect("a directory");
    let (whole, made) = whole_and_raced(&study, directory.path());
    let in_race = rows_that_choose(&made);
    let in_sweep = rows_that_choose(&whole);
    assert!(in_race * 2 < in_sweep, "{in_race} {in_sweep}");
    let verdict = judged(&study, &made);
    assert_eq!(verdict.chosen, judged(&study, &whole).chosen);
    assert!(verdict.dropped.iter().any(|dropped| dropped.candidate == 3), "{:?}", verdict.dropped);
    let selection = verdict.selection.as_ref().expect("three members");
    assert!(selection.mean_errors[verdict.chosen].is_finite());
    let own = made.iter().filter(|result| result.unit.sensor == verdict.sensor && chooses(result));
    let left_out: BTreeSet<usize> = own
        .flat_map(|result| {
            (0..4).filter(|value| result.rows.iter().all(|row| row.candidate != *value))
        })
        .collect();
    let dropped: BTreeSet<usize> =
        verdict.dropped.iter().map(|dropped| dropped.candidate).collect();
    assert_eq!(dropped, left_out, "who made not all runs that were made");
    assert!(verdict.stability.is_empty(), "nothing is drawn anew");
}

#[test]
fn a_race_is_the_whole_sweep_with_runs_left_out() {
    let study = Study::new();
    let directory = tempfile::tempdir().expect("a directory");
    // The first round has three runs of members and a window of the log with four settings. The next has as many again
    // with two. The runs are the same as without a race.
    let (whole, alone) = whole_and_raced(&study, directory.path());
    assert!(rows(&alone) < rows(&whole) * 3 / 4, "{} of {}", rows(&alone), rows(&whole));
    let left = [0, 1, 2].map(|run: usize| {
        let environment = EnvironmentId::Member(1);
        let unit = Unit { sensor: "A".to_owned(), environment, run };
        alone.iter().find(|result| result.unit == unit).map(|result| result.rows.len())
    });
    assert_eq!(left, [Some(4), Some(2), None]);

    let judged_race = judged(&study, &alone);
    let of_whole = judged(&study, &whole);
    assert_eq!(judged_race.chosen, of_whole.chosen);
    let diverged = judged_race.dropped.iter().find(|dropped| dropped.candidate == 3);
    assert!(diverged.is_some_and(|dropped| dropped.runs < dropped.of_runs));
    assert!(warns(&judged_race, "the race dropped"));
    assert!(of_whole.dropped.is_empty());
    let scores = judged_race.truth.as_ref().map(|truth| &truth.scores);
    let scores_of_whole = of_whole.truth.as_ref().map(|truth| &truth.scores);
    assert_eq!(scores, scores_of_whole, "held-out data has judged all settings");

    // A unit of the first round is lost. Only this unit is run again.
    let one = UnitStore::new(directory.path().join("one"));
    let lost = directory.path().join("one/A/member-1/run-0000.json");
    let kept = ["one/A/member-2/run-0000.json", "one/A/member-1/run-0001.json"];
    let kept = kept.map(|name| directory.path().join(name));
    fs::remove_file(lost).expect("was there");
    let before = kept.each_ref().map(|file| written_at(file));
    assert_eq!(race(&study, &one), alone);
    assert_eq!(kept.each_ref().map(|file| written_at(file)), before);
}

/// A model that multiplies states by 10 where the first sensor is above one half, and keeps others.
#[derive(Debug)]
struct Tenfold;

impl Dynamics for Tenfold {
    fn columns(&self) -> usize {
        2
    }

    fn history(&self) -> usize {
        0
    }

    fn begin_rollouts(&self) -> Result<Box<dyn LaneRollouts + '_>, DynamicsError> {
        Ok(Box::new(Self))
    }
}

impl LaneRollouts for Tenfold {
    fn step(&mut self, states: &[f32], next: &mut [f32]) -> Result<(), DynamicsError> {
        assert_eq!(states.len(), 2 * LANES);
        for (state, next) in states.chunks(2).zip(next.chunks_mut(2)) {
            let factor = if state[0] > 0.5 { 10.0 } else { 1.0 };
            next.copy_from_slice(&[factor * state[0], factor * state[1]]);
        }
        Ok(())
    }

    fn forget(&mut self, _lane: usize) {}
}

#[test]
fn a_rollout_that_is_not_finite_is_a_flagged_result() {
    let study = Study::new();
    // The wave is 0.9 at its peak and 0.1 at its trough.
    let starts = [6, 18].map(RowIndex::new).map(|row| {
        let wanted = RequestedStart::Recorded(row);
        ModelStart::Row(StartRow { row, wanted, replaced: None })
    });
    let model = NetworkModel::new(Box::new(Tenfold), &study.train).expect("fits");
    let options = RolloutOptions {
        span: span(),
        weights: Weights::Linear,
        seed: Seed::new(1),
        inputs: Fingerprint::of(b"model"),
    };
    let environment =
        MemberEnvironment::new(&model, 0, study.train.states(), starts.to_vec(), options);
    let options = plan_options(span(), Seed::new(1));
    let plan = Plan::new(&study.candidates, vec![&environment], sensors(), options);
    let directory = tempfile::tempdir().expect("a directory");
    let store = UnitStore::new(directory.path().to_owned());
    let results = plan.run(&store, &Silent).expect("the sweep goes on");
    assert_eq!(results.len(), 4, "two sensors, two runs");
    for result in &results {
        let failed = result.unit.run == 0;
        // The state is 9e37 at step 38.
        let expected = failed.then_some(NotFinite { step: 39, column: 0 });
        assert_eq!(result.not_finite, expected, "{}", result.unit);
        assert_eq!(result.rows.len(), 4, "all values");
        let diverged =
            result.rows.iter().filter(|row| row.rmse(Part::WholeRun) == Some(f64::INFINITY));
        // The third setting diverges by itself.
        assert_eq!(diverged.count(), if failed { 4 } else { 1 }, "{}", result.unit);
        assert!(result.rows.iter().all(|row| row.steps == if failed { 38 } else { 600 }));
    }
    assert_eq!(plan.run(&store, &Silent).expect("stored"), results, "the reason is kept");
    let verdict = judged(&study, &results);
    let selection = verdict.selection.as_ref().expect("three members");
    assert!(selection.mean_errors.iter().all(|error| error.is_infinite()));
    for text in ["diverged to infinity or NaN in 1 of 2 runs", "1 of 8 runs diverged"] {
        assert!(warns(&verdict, text), "{:?}", verdict.warnings);
    }
}

#[test]
fn a_sensor_of_another_discount_factor_leaves_the_others_as_they_are() {
    let study = Study::new();
    let far: Vec<Candidate> = study
        .candidates
        .iter()
        .map(|candidate| {
            let agent = AgentConfig { gamma: 0.9, ..candidate.agent.clone() };
            Candidate { agent, ..candidate.clone() }
        })
        .collect();
    let longer = Span::new(600, [0.9]);
    let [of_near, of_far] = [span(), longer].map(|span: Span| {
        let windows = Windows::log(study.train.segments(), demand(span), 2);
        ReplayEnvironment::log_replay(&study.train, windows, Fingerprint::of(b"data"))
    });
    let near_options = plan_options(span(), Seed::new(1));
    let far_options = plan_options(longer, Seed::new(1));
    let near_plan = Plan::new(&study.candidates, vec![&of_near], sensors(), near_options);
    let far_plan = Plan::new(&far, vec![&of_far], sensors(), far_options);
    let near_group =
        SensorGroup { candidates: &study.candidates, environments: vec![&of_near], span: span() };
    let far_group = SensorGroup { candidates: &far, environments: vec![&of_far], span: longer };
    let planned = sensors().into_iter().enumerate();
    let planned: Vec<PlannedSensor> =
        planned.map(|(group, (name, column))| PlannedSensor { name, column, group }).collect();
    let groups = vec![near_group, far_group];
    let plan = Plan::of_groups(&study.candidates, groups, planned, far_options);
    assert_eq!((plan.count(), plan.passes(&StoredUnits::default())), (4, 4));
    assert_eq!(near_plan.passes(&StoredUnits::default()), 2, "the sensors of a group share them");
    let directory = tempfile::tempdir().expect("a directory");
    let stores = ["both", "near", "far"].map(|name| UnitStore::new(directory.path().join(name)));
    let both = plan.run(&stores[0], &Silent).expect("runs");
    let near = near_plan.run(&stores[1], &Silent).expect("runs");
    assert_eq!(both[..2], near[..2], "also by its key");
    let far = far_plan.run(&stores[2], &Silent).expect("runs");
    for (got, alone) in both[2..].iter().zip(&far[2..]) {
        assert_eq!((&got.unit, &got.rows), (&alone.unit, &alone.rows));
        assert_ne!(got.key, alone.key, "settings are those of the other discount factor");
    }
}
