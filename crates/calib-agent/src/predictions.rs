//! Scores of predictions that an external agent made.

use calib_core::Stream;

use crate::{
    AgentError, CurveRule, Part, RunOutcome, discounted_returns,
    outcome::Tracker,
    scoring::{ScoredReturns, known_returns, nothing_to_score},
};

/// Scores `predictions` of the returns of state column `cumulant`, one for each step of a run over `stream`. Prediction
/// t was made at state t, before state t + 1 was seen. The scores are defined as in [`train`](crate::train). A run
/// diverged at its first prediction that is not finite.
///
/// `updates` is the number of updates that the agent reports.
///
/// # Errors
/// If the stream is not longer than the run, the cumulant is not one of its columns, or no step can be scored.
pub fn score_predictions(
    stream: &dyn Stream,
    cumulant: usize,
    gamma: f64,
    predictions: &[f32],
    updates: u64,
    curve: CurveRule,
) -> Result<RunOutcome, AgentError> {
    let steps = predictions.len();
    if steps >= stream.len() {
        return Err(AgentError::ShortStream { steps, states: stream.len() });
    }
    if cumulant >= stream.width() {
        return Err(AgentError::Cumulant { got: cumulant, width: stream.width() });
    }
    let returns = discounted_returns(stream, cumulant, gamma);
    let pieces = stream.pieces();
    let scored =
        |part: Part| ScoredReturns::new(&returns, pieces, gamma, part.first_step(steps)..steps);
    if scored(Part::WholeRun).is_none() {
        return Err(nothing_to_score(pieces, gamma, 0, steps));
    }
    let mut tracker = Tracker::new(curve, steps);
    tracker.updates = updates;
    tracker.diverged = predictions.iter().position(|prediction| !prediction.is_finite());
    let before = tracker.diverged.unwrap_or(steps);
    for piece in pieces {
        let known = known_returns(piece, gamma);
        for t in known.start..known.end.min(before) {
            tracker.record(t, predictions[t], returns[t]);
        }
    }
    Ok(tracker.outcome(scored))
}

#[cfg(test)]
mod tests {
    use calib_core::{RowStream, Seed, Segments, Silent, States};

    use super::*;
    use crate::{AgentConfig, Checkpoint, Learner, NoKeeper, Run, ValueFunction, train_learners};

    fn stream() -> RowStream {
        let values = (0..120).map(|t| (t as f32 * 0.7).sin()).collect();
        let states = States::new(values, 120, 1).expect("valid");
        RowStream::replay(states, &Segments::from_lengths([70, 50]).expect("valid"))
    }

    #[test]
    fn predictions_are_scored_as_those_of_training() {
        let stream = stream();
        let config = AgentConfig {
            value_function: ValueFunction::Linear,
            gamma: 0.5,
            batch_size: 4,
            learning_rate: 0.0,
            ..AgentConfig::default()
        };
        let curve = CurveRule { windows: 7 };
        // A linear agent without weights that never learns predicts 0.
        let nothing = Checkpoint { parameters: vec![0.0; 2], moments: None };
        let learner = Learner { start: Some(&nothing), ..Learner::new(&config, 0) };
        let run = Run { stream: &stream, steps: 119, curve, seed: Seed::new(1) };
        let trained = train_learners(run, &[learner], &NoKeeper, &Silent).expect("trained");
        let zeros = vec![0.0; 119];
        let scored = score_predictions(&stream, 0, 0.5, &zeros, 3, curve).expect("scored");
        assert_eq!((&scored.scores, &scored.curve), (&trained[0].scores, &trained[0].curve));
        assert_eq!((scored.updates, scored.steps, scored.diverged), (3, 119, None));
        let returns: Vec<f32> =
            discounted_returns(&stream, 0, 0.5)[..119].iter().map(|value| *value as f32).collect();
        let perfect = score_predictions(&stream, 0, 0.5, &returns, 0, curve).expect("scored");
        assert!(perfect.scores.of(Part::WholeRun).expect("steps").rmse < 1e-6);
    }

    #[test]
    fn what_is_not_finite_diverged() {
        let mut predictions = vec![0.0; 100];
        predictions[40] = f32::NAN;
        let run = score_predictions(&stream(), 0, 0.5, &predictions, 0, CurveRule { windows: 10 });
        let run = run.expect("scored");
        assert_eq!(run.diverged, Some(40));
        assert_eq!(run.scores.of(Part::WholeRun).expect("steps").rmse, f64::INFINITY);
        assert_eq!(run.curve.len(), 3, "windows before it");
    }

    /// Returns the scores of a prediction of 0 at every step of a run.
    fn scored_zeros(column: usize, gamma: f64, steps: usize) -> Result<RunOutcome, AgentError> {
        score_predictions(&stream(), column, gamma, &vec![0.0; steps], 0, CurveRule::default())
    }

    #[test]
    fn what_cannot_be_scored_is_refused() {
        assert!(matches!(scored_zeros(0, 0.5, 120), Err(AgentError::ShortStream { .. })));
        assert!(matches!(scored_zeros(1, 0.5, 100), Err(AgentError::Cumulant { .. })));
        assert!(matches!(scored_zeros(0, 0.999, 100), Err(AgentError::NothingToScore { .. })));
    }
}
