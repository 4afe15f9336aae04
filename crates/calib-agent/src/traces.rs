use std::ops::Range;

use calib_core::Stream;

/// A stream whose states are extended by their exponential traces: (s, e(β₁), e(β₂), …). The traces of all
/// columns with one decay rate precede those with the next.
///
/// `e_t = β e_{t−1} + (1 − β) s_t`, and `e = s` at the first state of each unbroken piece. A trace holds
/// neither what was before a gap nor, at the start of a rollout, how the log came to the start state. It is
/// therefore the same function of the agent's past input whether states are replayed or generated.
pub(crate) struct TracedStream {
    width: usize,
    states: Vec<f32>,
    pieces: Vec<Range<usize>>,
}

impl TracedStream {
    /// Extends all of `stream` by a trace for each of `decays`.
    pub(crate) fn new(stream: &dyn Stream, decays: &[f64]) -> Self {
        let sensors = stream.width();
        let width = sensors * (1 + decays.len());
        let mut states = Vec::with_capacity(stream.len() * width);
        // In f64: a trace of many steps must not accumulate the rounding of each step.
        let mut traces = vec![0.0_f64; sensors * decays.len()];
        for piece in stream.pieces() {
            for t in piece.clone() {
                let state = stream.state(t);
                states.extend_from_slice(state);
                for (traces, &decay) in traces.chunks_exact_mut(sensors.max(1)).zip(decays) {
                    for (trace, &value) in traces.iter_mut().zip(state) {
                        let value = f64::from(value);
                        let decay = if t == piece.start { 0.0 } else { decay };
                        *trace = decay * *trace + (1.0 - decay) * value;
                    }
                }
                states.extend(traces.iter().map(|&trace| trace as f32));
            }
        }
        Self { width, states, pieces: stream.pieces().to_vec() }
    }
}

/// Returns the input of an agent with traces of these decay rates: the stream itself if there are no decay
/// rates.
pub fn with_traces<'a>(stream: &'a dyn Stream, decays: &[f64]) -> Box<dyn Stream + 'a> {
    if decays.is_empty() {
        Box::new(Untraced(stream))
    } else {
        Box::new(TracedStream::new(stream, decays))
    }
}

struct Untraced<'a>(&'a dyn Stream);

impl Stream for Untraced<'_> {
    fn len(&self) -> usize {
        self.0.len()
    }

    fn width(&self) -> usize {
        self.0.width()
    }

    fn state(&self, t: usize) -> &[f32] {
        self.0.state(t)
    }

    fn pieces(&self) -> &[Range<usize>] {
        self.0.pieces()
    }
}

impl Stream for TracedStream {
    fn len(&self) -> usize {
        self.states.len().checked_div(self.width).unwrap_or(0)
    }

    fn width(&self) -> usize {
        self.width
    }

    fn state(&self, t: usize) -> &[f32] {
        &self.states[t * self.width..][..self.width]
    }

    fn pieces(&self) -> &[Range<usize>] {
        &self.pieces
    }
}

#[cfg(test)]
mod tests {
    use calib_core::{RowIndex, RowStream, Segments, States};

    use super::*;

    fn states() -> States {
        States::new(vec![1.0, 10.0, 3.0, 30.0, 5.0, 50.0, 5.0, 70.0], 4, 2).expect("valid")
    }

    #[test]
    fn traces_follow_their_formula_and_begin_again_with_each_piece() {
        let segments = Segments::from_lengths([3, 1]).expect("valid");
        let replay = RowStream::replay(states(), &segments);
        let traced = TracedStream::new(&replay, &[0.5, 0.0]);
        assert_eq!((traced.len(), traced.width()), (4, 6));
        assert_eq!(traced.pieces(), [0..3, 3..4]);
        assert_eq!(traced.state(0), [1.0, 10.0, 1.0, 10.0, 1.0, 10.0]);
        assert_eq!(traced.state(1), [3.0, 30.0, 2.0, 20.0, 3.0, 30.0]);
        assert_eq!(traced.state(2), [5.0, 50.0, 3.5, 35.0, 5.0, 50.0]);
        assert_eq!(traced.state(3), [5.0, 70.0, 5.0, 70.0, 5.0, 70.0]);
    }

    #[test]
    fn a_rollout_through_the_same_rows_has_the_same_traces() {
        let segments = Segments::from_lengths([4]).expect("valid");
        let replay = TracedStream::new(&RowStream::replay(states(), &segments), &[0.9]);
        let rollout = RowStream::unbroken(states(), (0..4).map(RowIndex::new).collect());
        let rollout = TracedStream::new(&rollout, &[0.9]);
        assert!((0..4).all(|t| replay.state(t) == rollout.state(t)));
        // A stream that jumps there has traces only of its own path.
        let jump = RowStream::unbroken(states(), [2, 0].map(RowIndex::new).to_vec());
        let jump = TracedStream::new(&jump, &[0.5]);
        assert_eq!(jump.state(1), [1.0, 10.0, 3.0, 30.0]);
    }
}
