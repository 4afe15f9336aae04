use std::ops::Range;

use calib_core::{States, TransitionIndex, Transitions};

use crate::DynamicsError;

/// The transitions of a training range, split in time: the first part is for training, the last for validation.
#[derive(Clone, Copy, Debug)]
pub struct Transitioning<'a> {
    states: &'a States,
    transitions: &'a Transitions,
    learnt: usize,
}

impl<'a> Transitioning<'a> {
    /// Splits the transitions in time order. The last `validation_fraction` is the validation part.
    ///
    /// # Errors
    /// If one of the parts is empty.
    pub fn new(
        states: &'a States,
        transitions: &'a Transitions,
        validation_fraction: f64,
    ) -> Result<Self, DynamicsError> {
        let all = transitions.len();
        let held_back = ((all as f64 * validation_fraction).round() as usize).max(1);
        let learnt = all.saturating_sub(held_back);
        if learnt == 0 {
            let fraction = validation_fraction;
            return Err(DynamicsError::TooFewTransitions { transitions: all, fraction });
        }
        Ok(Self { states, transitions, learnt })
    }

    /// Returns the number of values in a state.
    pub fn columns(&self) -> usize {
        self.states.columns()
    }

    /// Returns the states.
    pub fn states(&self) -> &'a States {
        self.states
    }

    /// Returns all transitions.
    pub fn transitions(&self) -> &'a Transitions {
        self.transitions
    }

    /// Returns the transitions for training.
    pub fn training(&self) -> Range<usize> {
        0..self.learnt
    }

    /// Returns the transitions for validation.
    pub fn validation(&self) -> Range<usize> {
        self.learnt..self.transitions.len()
    }

    /// Returns the validation loss of predicting that nothing changes. A model has to be better than this.
    pub fn persistence_loss(&self) -> f64 {
        let mut squares = 0.0;
        for transition in self.validation() {
            let source = self.transitions.source(TransitionIndex::new(transition)).get();
            let pairs = self.states.row(source).iter().zip(self.states.row(source + 1));
            squares += pairs.map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2)).sum::<f64>();
        }
        squares / (self.validation().len() * self.columns()) as f64
    }

    /// Copies the source states of `transitions` to `inputs` and their next states to `targets`.
    pub fn gather(&self, transitions: &[u32], inputs: &mut Vec<f32>, targets: &mut Vec<f32>) {
        inputs.clear();
        targets.clear();
        for &transition in transitions {
            let source = self.transitions.source(TransitionIndex(transition)).get();
            inputs.extend_from_slice(self.states.row(source));
            targets.extend_from_slice(self.states.row(source + 1));
        }
    }
}

/// Returns the first transition of every sequence: `length` successive transitions of one segment inside `part`.
/// Each segment's sequences start at its first transition and then at every `stride`-th.
pub fn sequences(
    transitions: &Transitions,
    part: Range<usize>,
    length: usize,
    stride: usize,
) -> Vec<u32> {
    let mut starts = Vec::new();
    let sources = &transitions.sources()[part.clone()];
    let mut first = part.start;
    // Within a segment, sources are successive rows. Between segments a row is skipped.
    for run in sources.chunk_by(|now, then| *then == now + 1) {
        let last = (run.len() + 1).saturating_sub(length);
        starts.extend((0..last).step_by(stride).map(|offset| (first + offset) as u32));
        first += run.len();
    }
    starts
}

#[cfg(test)]
mod tests {
    use calib_core::Segments;

    use super::*;

    #[test]
    fn the_last_part_validates() {
        let states = States::new((0..12_u8).map(f32::from).collect(), 12, 1).expect("valid");
        let transitions = Transitions::new(Segments::from_lengths([7, 5]).expect("valid"));
        let data = Transitioning::new(&states, &transitions, 0.3).expect("ten transitions");
        assert_eq!((data.training(), data.validation()), (0..7, 7..10));
        let mut inputs = Vec::new();
        let mut targets = Vec::new();
        data.gather(&[5, 6], &mut inputs, &mut targets);
        assert_eq!((inputs, targets), (vec![5.0, 7.0], vec![6.0, 8.0]));
        assert_eq!(data.persistence_loss(), 1.0, "each step is one up");
        let few = Transitions::new(Segments::from_lengths([2]).expect("valid"));
        assert!(matches!(
            Transitioning::new(&states, &few, 0.5),
            Err(DynamicsError::TooFewTransitions { transitions: 1, .. })
        ));
    }

    #[test]
    fn sequences_stay_in_their_segment_and_part() {
        let transitions = Transitions::new(Segments::from_lengths([7, 2, 5]).expect("valid"));
        // Transitions 0..6 belong to the first segment, 6 to the second, and 7..11 to the third.
        assert_eq!(sequences(&transitions, 0..11, 3, 1), [0, 1, 2, 3, 7, 8]);
        assert_eq!(sequences(&transitions, 0..11, 3, 2), [0, 2, 7]);
        assert_eq!(sequences(&transitions, 4..9, 2, 1), [4, 7]);
        assert!(sequences(&transitions, 0..11, 7, 1).is_empty());
    }
}
