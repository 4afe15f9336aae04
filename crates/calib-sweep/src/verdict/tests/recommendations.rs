//! No verdict recommends an agent that a simple predictor beats, whatever the scores.

use calib_agent::SimplePredictor;
use calib_core::Rng;
use calib_stats::{Interval, summarise};

use super::{simple_predictors::score, *};
use crate::SimpleScore;

/// Scores of three settings and of simple predictors, and how they are judged.
struct Drawn {
    candidates: Vec<Candidate>,
    results: Vec<UnitResult>,
    simple: Vec<SimpleScore>,
    rule: Rule,
    stands_still: bool,
}

/// Returns a positive number around 1 whose logarithm has this standard deviation.
fn factor(rng: &mut Rng, spread: f64) -> f64 {
    (spread * rng.normal()).exp()
}

/// Draws the scores on up to six windows of the log and of the held-out data, sometimes with a model.
fn drawn(seed: u64) -> Drawn {
    let mut rng = Seed::new(seed).rng();
    let has_model = rng.below(2) == 0;
    let log_windows = 1 + rng.below(6);
    let held_out_windows = rng.below(2) * (1 + rng.below(6));
    let stands_still = rng.below(8) == 0;
    let noise = [0.02, 0.1, 0.4][rng.below(3)];
    let diverges = rng.below(8) == 0;
    let mut candidates = candidates();
    if rng.below(3) == 0 {
        for candidate in &mut candidates {
            candidate.agent.baseline = Some(SimplePredictor::Ridge);
        }
        candidates[2].agent.learning_rate = 0.0;
    }
    let levels = [(); 3].map(|()| factor(&mut rng, 0.5));
    let predictors: Vec<(SimplePredictor, f64)> = SimplePredictor::ALL
        .into_iter()
        .map(|predictor| (predictor, factor(&mut rng, 0.5)))
        .collect();
    let mut results = Vec::new();
    let mut simple = Vec::new();
    let members = if has_model { 3 } else { 0 };
    for member in 0..members {
        let errors = levels.map(|level| level * factor(&mut rng, noise));
        results.push(run(EnvironmentId::Member(member), 0, 5, errors));
    }
    let replayed = (0..log_windows).map(|_| EnvironmentId::LogReplay);
    let held_out = (0..held_out_windows).map(|_| EnvironmentId::Online);
    for (window, environment) in (0_u32..).zip(replayed.chain(held_out)) {
        let start_row = 5000 * window;
        let errors = levels.map(|level| {
            let ran_away = diverges && rng.below(6) == 0;
            if ran_away { INF } else { level * factor(&mut rng, noise) }
        });
        results.push(run(environment, window as usize, start_row, errors));
        for &(predictor, level) in &predictors {
            let error = level * factor(&mut rng, noise);
            simple.push(score(predictor, environment, start_row, error));
        }
    }
    let rule = if has_model { Rule::ALL[rng.below(Rule::ALL.len())] } else { Rule::LogReplay };
    Drawn { candidates, results, simple, rule, stands_still }
}

impl Drawn {
    fn judged(&self) -> SensorVerdict {
        let judging = Judging {
            simple: &self.simple,
            stands_still: self.stands_still,
            resamples: 0,
            ..judging(self.rule)
        };
        verdict("A", &self.candidates, &self.results, &judging).expect("judged")
    }

    /// Returns the errors of a setting in the windows that decide, by their rows: those of the held-out data, if that
    /// varies, and of the log otherwise.
    fn errors(&self, setting: usize) -> Vec<(u32, f64)> {
        let online = self.errors_in(EnvironmentId::Online, setting);
        if online.is_empty() || self.stands_still {
            self.errors_in(EnvironmentId::LogReplay, setting)
        } else {
            online
        }
    }

    fn errors_in(&self, environment: EnvironmentId, setting: usize) -> Vec<(u32, f64)> {
        let own = self.results.iter().filter(|result| result.unit.environment == environment);
        own.map(|result| {
            let score = result.rows[setting].scores.whole_run.expect("scored");
            (result.start_row, score.rmse)
        })
        .collect()
    }

    /// Returns the errors of a simple predictor in the windows that begin at these rows.
    fn simple_errors(&self, predictor: SimplePredictor, rows: &[(u32, f64)]) -> Vec<f64> {
        let own = rows.iter().map(|&(row, _)| {
            let mut scores = self.simple.iter();
            let own = scores.find(|score| score.predictor == predictor && score.start_row == row);
            own.expect("scored").scores.whole_run.expect("scored").rmse
        });
        own.collect()
    }

    /// Returns the intervals of the logarithms of the ratios of these errors to those of each simple predictor, where they
    /// have one.
    fn ratios(&self, rows: &[(u32, f64)], errors: &[f64]) -> Vec<(SimplePredictor, Interval)> {
        let all = SimplePredictor::ALL.into_iter().filter_map(|predictor| {
            let others = self.simple_errors(predictor, rows);
            let ratios: Vec<f64> =
                errors.iter().zip(&others).map(|(error, other)| (error / other).ln()).collect();
            if ratios.iter().any(|ratio| ratio.is_infinite()) {
                return None;
            }
            Some((predictor, summarise(&ratios).expect("numbers").interval?))
        });
        all.collect()
    }

    /// Whether a simple predictor is better than a setting, with an interval that excludes equality.
    fn is_beaten(&self, setting: usize) -> bool {
        let rows = self.errors(setting);
        let errors: Vec<f64> = rows.iter().map(|&(_, error)| error).collect();
        self.ratios(&rows, &errors).iter().any(|(_, interval)| interval.low > 1e-9)
    }

    /// Whether a simple predictor is shown to have less error than the training mean, by two per cent or more.
    fn mean_is_beaten(&self) -> bool {
        let rows = self.errors(0);
        let mean = self.simple_errors(SimplePredictor::Mean, &rows);
        self.ratios(&rows, &mean).iter().any(|(_, interval)| {
            let middle = f64::midpoint(interval.low, interval.high);
            interval.low > 1e-9 && middle > 1.02_f64.ln() + 1e-9
        })
    }
}

#[test]
fn no_agent_is_recommended_that_a_simple_predictor_beats() {
    let mut beaten = [0; 2];
    let mut recommended = [0; 2];
    for seed in 0..1000 {
        let drawn = drawn(seed);
        let verdict = drawn.judged();
        let has_truth = usize::from(verdict.truth.is_some());
        let setting = match verdict.recommendation() {
            // Without held-out data, the headline is to use the choice.
            Recommendation::Deploy | Recommendation::NotChecked => Some(verdict.chosen),
            Recommendation::KeepDefault => Some(2),
            Recommendation::UseSimplePredictor | Recommendation::DoNotDeploy => None,
        };
        if let Some(setting) = setting {
            assert!(!drawn.is_beaten(setting), "seed {seed}: {verdict:?}");
            recommended[has_truth] += 1;
        }
        if drawn.is_beaten(verdict.chosen) {
            assert!(!matches!(verdict.grade, Grade::Good | Grade::Fair), "seed {seed}");
            beaten[has_truth] += 1;
        }
        if verdict.grade == Grade::NotLearnt {
            assert!(!drawn.mean_is_beaten(), "seed {seed}: {verdict:?}");
        }
    }
    assert!(
        beaten.iter().chain(&recommended).all(|&count| count > 30),
        "{beaten:?} {recommended:?}"
    );
}
