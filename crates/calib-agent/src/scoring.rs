use std::ops::Range;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{AgentError, truncation_horizon};

/// A part of a run over which an error is computed. Every run is scored over all parts, because they answer
/// different questions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Part {
    /// Every step, including the learning phase: the error that the paper defines.
    WholeRun,
    /// The last three quarters, for runs of many effective horizons.
    AfterFirstQuarter,
    /// The last quarter: performance after learning has settled. The paper scores fine-tuning in this way.
    FinalQuarter,
}

impl Part {
    /// All parts, the longest first.
    pub const ALL: [Self; 3] = [Self::WholeRun, Self::AfterFirstQuarter, Self::FinalQuarter];

    /// Returns the name in studies and files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::WholeRun => "whole_run",
            Self::AfterFirstQuarter => "after_first_quarter",
            Self::FinalQuarter => "final_quarter",
        }
    }

    /// Returns the first step of this part in a run of `steps` steps.
    pub fn first_step(self, steps: usize) -> usize {
        let before = match self {
            Self::WholeRun => 0.0,
            Self::AfterFirstQuarter => 0.25,
            Self::FinalQuarter => 0.75,
        };
        (steps as f64 * before).round() as usize
    }

    /// Returns the number of scored steps in a run of `steps` over a stream of these unbroken `pieces`: the steps of
    /// the part with known returns.
    pub fn scored_steps(self, pieces: &[Range<usize>], gamma: f64, steps: usize) -> usize {
        scored(pieces, gamma, self.first_step(steps)..steps).map(|range| range.len()).sum()
    }
}

/// The error of a run over one of its parts. Errors and returns are in normalised units of the sensor.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PartScore {
    /// Number of steps that count for the error.
    pub scored_steps: usize,
    /// Root of the mean squared difference between recorded predictions and Monte-Carlo returns over these steps; +∞
    /// for a diverged run.
    #[serde(with = "infinite")]
    #[schemars(with = "Option<f64>")]
    pub rmse: f64,
    /// Mean of the returns over these steps. It is the same for all agents of one stream and γ.
    pub mean_return: f64,
    /// Standard deviation (divided by n) of the returns over these steps: the error of predicting their mean.
    pub return_std: f64,
}

/// Serialisation of errors that may be infinite. JSON has no infinity, so the error of a diverged run is `null`.
pub(crate) mod infinite {
    use serde::{Deserialize as _, Deserializer, Serialize as _, Serializer};

    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde prescribes the signature")]
    pub(crate) fn serialize<S: Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
        value.is_finite().then_some(*value).serialize(serializer)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
        Ok(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::INFINITY))
    }
}

/// The error of a run over each part that has steps to score.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Scores {
    /// Over every step.
    pub whole_run: Option<PartScore>,
    /// Over the last three quarters.
    pub after_first_quarter: Option<PartScore>,
    /// Over the last quarter.
    pub final_quarter: Option<PartScore>,
}

impl Scores {
    /// Returns the score of one part, or `None` if no step of it has a known return.
    pub fn of(&self, part: Part) -> Option<PartScore> {
        match part {
            Part::WholeRun => self.whole_run,
            Part::AfterFirstQuarter => self.after_first_quarter,
            Part::FinalQuarter => self.final_quarter,
        }
    }

    /// Returns the scores that `score` gives for each part.
    pub(crate) fn each(mut score: impl FnMut(Part) -> Option<PartScore>) -> Self {
        let [whole_run, after_first_quarter, final_quarter] = Part::ALL.map(&mut score);
        Self { whole_run, after_first_quarter, final_quarter }
    }
}

/// Returns the steps of `piece` with known returns: all but the last H, and never the very last step, which has no
/// successor.
pub(crate) fn known_returns(piece: &Range<usize>, gamma: f64) -> Range<usize> {
    let unknown = truncation_horizon(gamma).max(1);
    piece.start..piece.end.saturating_sub(unknown).max(piece.start)
}

/// Returns the steps of each piece that lie in `part` and have known returns.
fn scored(
    pieces: &[Range<usize>],
    gamma: f64,
    part: Range<usize>,
) -> impl Iterator<Item = Range<usize>> + Clone {
    pieces.iter().map(move |piece| {
        let known = known_returns(piece, gamma);
        let end = known.end.min(part.end);
        known.start.max(part.start).min(end)..end
    })
}

/// Count, mean and standard deviation (divided by n) of the scored returns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ScoredReturns {
    pub(crate) steps: usize,
    pub(crate) mean: f64,
    pub(crate) std: f64,
}

impl ScoredReturns {
    /// Returns statistics of `returns` over the steps of `part`, or `None` if no step of it has a known return.
    pub(crate) fn new(
        returns: &[f64],
        pieces: &[Range<usize>],
        gamma: f64,
        part: Range<usize>,
    ) -> Option<Self> {
        let ranges = scored(pieces, gamma, part);
        let steps: usize = ranges.clone().map(|range| range.len()).sum();
        let scored = || ranges.clone().flat_map(|range| &returns[range]);
        let mean = scored().sum::<f64>() / steps as f64;
        let variance = scored().map(|g| (g - mean).powi(2)).sum::<f64>() / steps as f64;
        (steps > 0).then_some(Self { steps, mean, std: variance.sqrt() })
    }
}

/// Returns the error that a run of `steps` over these pieces cannot be scored from `first` on.
pub(crate) fn nothing_to_score(
    pieces: &[Range<usize>],
    gamma: f64,
    first: usize,
    steps: usize,
) -> AgentError {
    AgentError::NothingToScore {
        gamma,
        horizon: truncation_horizon(gamma).max(1),
        pieces: pieces.len(),
        longest: pieces.iter().map(Range::len).max().unwrap_or(0),
        first,
        steps,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns how many of the first `steps` steps of a stream without gaps are scored, for γ = 0.99.
    fn steps_of_unbroken(part: Part, states: usize, steps: usize) -> usize {
        let unbroken = 0..states;
        part.scored_steps(std::slice::from_ref(&unbroken), 0.99, steps)
    }

    #[test]
    fn streams_that_are_too_short_are_known_beforehand() {
        // H = 459 for γ = 0.99: the last quarter must be longer, or the stream must continue after the run.
        assert_eq!(steps_of_unbroken(Part::FinalQuarter, 4 * 459, 4 * 459), 0);
        assert_eq!(steps_of_unbroken(Part::FinalQuarter, 4 * 459 + 4, 4 * 459 + 4), 1);
        assert_eq!(steps_of_unbroken(Part::WholeRun, 459, 459), 0);
        assert_eq!(steps_of_unbroken(Part::WholeRun, 460, 460), 1);
        assert_eq!(steps_of_unbroken(Part::WholeRun, 1459, 1000), 1000, "all steps of the run");
        assert_eq!(steps_of_unbroken(Part::FinalQuarter, 1459, 1000), 250);
        assert_eq!(steps_of_unbroken(Part::AfterFirstQuarter, 1459, 1000), 750);
    }

    /// Returns the first step of each part of a run of `steps` steps.
    fn first_steps(steps: usize) -> [usize; 3] {
        Part::ALL.map(|part| part.first_step(steps))
    }

    #[test]
    fn parts_begin_where_they_say() {
        assert_eq!(first_steps(100), [0, 25, 75]);
        assert_eq!(first_steps(3), [0, 1, 2]);
    }

    #[test]
    fn truncated_returns_never_count() {
        assert_eq!(known_returns(&(10..30), 0.5), 10..23);
        assert_eq!(known_returns(&(10..30), 0.0), 10..29);
        assert_eq!(known_returns(&(10..12), 0.5), 10..10);
        let returns: Vec<f64> = (0..30).map(f64::from).collect();
        // In 0..10 the returns of 0..3 are known, in 10..30 those of 10..23. Scoring begins at 20: 20, 21, 22.
        let pieces = [0..10, 10..30];
        let scored = ScoredReturns::new(&returns, &pieces, 0.5, 20..30).expect("some");
        assert_eq!((scored.steps, scored.mean), (3, 21.0));
        assert!((scored.std - (2.0_f64 / 3.0).sqrt()).abs() < 1e-12);
        let steps =
            |part| ScoredReturns::new(&returns, &pieces, 0.5, part).map(|scored| scored.steps);
        assert_eq!(steps(0..30), Some(16));
        assert_eq!(steps(0..12), Some(5), "the run ends, the stream goes on");
        assert_eq!(steps(3..10), None);
    }

    #[test]
    fn nothing_to_score_says_what_to_do() {
        assert_eq!(
            nothing_to_score(&[0..5, 5..10], 0.9, 8, 10).to_string(),
            "no step can be scored: with gamma = 0.9, scoring a prediction needs the 44 states after it, \
             the longest of 2 stretches without a gap has 5 steps, and scoring begins at step 8 of 10; \
             use longer runs, a smaller gamma, or score the whole run"
        );
    }

    #[test]
    fn a_diverged_score_is_null_in_json() {
        let score =
            PartScore { scored_steps: 3, rmse: f64::INFINITY, mean_return: 1.0, return_std: 0.5 };
        let text = serde_json::to_string(&score).expect("serialises");
        assert!(text.contains("\"rmse\":null"), "{text}");
        assert_eq!(serde_json::from_str::<PartScore>(&text).expect("reads"), score);
    }
}
