use std::ops::Range;

use calib_core::{States, TransitionIndex, Transitions};

use crate::DynamicsError;

/// The transitions of a training range, split in time: the first part is learnt from, the last validates.
#[derive(Clone, Copy, Debug)]
pub struct Transitioning<'a> {
    states: &'a States,
    transitions: &'a Transitions,
    learnt: usize,
}

impl<'a> Transitioning<'a> {
    /// The last `validation_fraction` of the transitions, in time order, are held back.
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

    /// Values in a state.
    pub fn columns(&self) -> usize {
        self.states.columns()
    }

    /// The states.
    pub fn states(&self) -> &'a States {
        self.states
    }

    /// All transitions.
    pub fn transitions(&self) -> &'a Transitions {
        self.transitions
    }

    /// Transitions that are learnt from.
    pub fn training(&self) -> Range<usize> {
        0..self.learnt
    }

    /// Transitions that validate.
    pub fn validation(&self) -> Range<usize> {
        self.learnt..self.transitions.len()
    }

    /// The validation loss of predicting that nothing changes: what a model has to beat.
    pub fn persistence_loss(&self) -> f64 {
        let mut squares = 0.0;
        for transition in self.validation() {
            let source = self.transitions.source(TransitionIndex::new(transition)).get();
            let pairs = self.states.row(source).iter().zip(self.states.row(source + 1));
            squares += pairs.map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2)).sum::<f64>();
        }
        squares / (self.validation().len() * self.columns()) as f64
    }

    /// Copy the source states of `transitions` to `inputs` and their next states to `targets`.
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

/// First transitions of all sequences of `length` successive transitions of one segment inside `part`, from each
/// segment's first one on every `stride`-th.
pub fn sequences(
    transitions: &Transitions,
    part: Range<usize>,
    length: usize,
    stride: usize,
) -> Vec<u32> {
    let mut starts = Vec::new();
    let sources = &transitions.sources()[part.clone()];
    let mut first = part.start;
    // Within a segment sources are successive rows; between segments a row is left out.
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
        // Transitions 0..6 of the first segment, 6 of the second, 7..11 of the third.
        assert_eq!(sequences(&transitions, 0..11, 3, 1), [0, 1, 2, 3, 7, 8]);
        assert_eq!(sequences(&transitions, 0..11, 3, 2), [0, 2, 7]);
        assert_eq!(sequences(&transitions, 4..9, 2, 1), [4, 7]);
        assert!(sequences(&transitions, 0..11, 7, 1).is_empty());
    }
}
