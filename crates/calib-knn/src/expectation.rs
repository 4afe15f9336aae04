//! The expected next state of a step.

use calib_core::{Monitor, States, TransitionIndex};
use calib_files::ScratchPlace;

use crate::{KnnError, KnnModel, Neighbor, Weights};

impl KnnModel {
    /// Returns an iterator over the members, in order, that yields the expected next state after each of `queries`:
    /// `[queries, columns]` row by row. Each item is computed when it is requested.
    ///
    /// ŝ' = Σⱼ pⱼ s'ⱼ over the k nearest sources of the query in the member. One exact search in the model's metric finds
    /// them for all members. p are the probabilities with which a step would draw them. s'ⱼ are their next states in
    /// `recorded`, the states of the model's data as they were recorded. Of all predictions that a draw allows, this one
    /// has the smallest squared error (derived).
    ///
    /// # Errors
    /// As [`nearest_sources`](Self::nearest_sources).
    ///
    /// # Panics
    /// If `recorded` has another number of rows than the model's states.
    pub fn expected_next<'a>(
        &'a self,
        queries: &States,
        recorded: &'a States,
        weights: Weights,
        place: &ScratchPlace,
        monitor: &dyn Monitor,
    ) -> Result<impl Iterator<Item = Vec<f64>> + use<'a>, KnnError> {
        assert_eq!(recorded.rows(), self.states().rows(), "the same rows were recorded");
        let members = self.nearest_sources(queries, self.k(), place, monitor)?;
        Ok(members.into_iter().map(move |lists| self.mean_after(&lists, recorded, weights)))
    }

    /// Returns the weighted mean of the states in `recorded` that follow the neighbours of each list, `[lists, columns]`
    /// row by row.
    fn mean_after(&self, lists: &[Vec<Neighbor>], recorded: &States, weights: Weights) -> Vec<f64> {
        let columns = recorded.columns();
        let mut expected = vec![0.0; lists.len() * columns];
        for (list, out) in lists.iter().zip(expected.chunks_exact_mut(columns)) {
            let distances: Vec<f32> = list.iter().map(|neighbour| neighbour.distance).collect();
            for (Neighbor { transition, .. }, p) in
                list.iter().zip(weights.probabilities(&distances))
            {
                let next = self.transitions().next(TransitionIndex(transition.0));
                for (out, &value) in out.iter_mut().zip(recorded.row(next.get())) {
                    *out += p * f64::from(value);
                }
            }
        }
        expected
    }
}

#[cfg(test)]
mod tests {
    use calib_core::{Segments, Silent, Transitions};

    use super::*;
    use crate::ModelConfig;

    /// Returns the expected next states of the queries in the first of two members.
    fn expected(
        model: &KnnModel,
        recorded: &States,
        queries: &States,
        weights: Weights,
    ) -> Result<Vec<f64>, KnnError> {
        let place = ScratchPlace::Memory;
        let all = model.expected_next(queries, recorded, weights, &place, &Silent)?;
        let mut all: Vec<Vec<f64>> = all.collect();
        assert_eq!(all.len(), 2, "one of each member");
        Ok(all.swap_remove(0))
    }

    #[test]
    fn it_is_the_mean_over_the_draws_of_the_nearest_sources() {
        // Twelve rows at 0, 1, 2, …; the recorded values are their squares.
        let metric = States::new((0..12_u8).map(f32::from).collect(), 12, 1).expect("finite");
        let recorded = (0..12_u8).map(|row| f32::from(row).powi(2)).collect();
        let recorded = States::new(recorded, 12, 1).expect("finite");
        let transitions = Transitions::new(Segments::from_lengths([12]).expect("one"));
        let config = ModelConfig { members: 2, neighbors: 3, ..ModelConfig::default() };
        let model = KnnModel::build(metric, transitions, &config, &Silent).expect("it is built");
        // Member 0 leaves the first block out.
        let sources: Vec<usize> =
            model.blocks().transitions_of(0).map(|t| model.transitions().source(t).get()).collect();
        assert_eq!(sources, [6, 7, 8, 9, 10]);
        let query = States::new(vec![8.25, 100.0], 2, 1).expect("finite");
        // The distances are 0.25, 0.75 and 1.25 to rows 8, 9 and 7. Their next states are 81, 100 and 64.
        let linear = expected(&model, &recorded, &query, Weights::Linear).expect("it runs");
        let p = [0.25, 0.75, 1.25].map(|d| (1.0 - d / 2.25) / 2.0);
        assert!((linear[0] - (p[0] * 81.0 + p[1] * 100.0 + p[2] * 64.0)).abs() < 1e-5);
        let uniform = expected(&model, &recorded, &query, Weights::Uniform).expect("it runs");
        assert!((uniform[0] - 245.0 / 3.0).abs() < 1e-9);
        // Beyond the data the neighbours are the last rows, which are followed by 121, 100 and 81.
        assert!((uniform[1] - 302.0 / 3.0).abs() < 1e-9);
        let wide = States::new(vec![0.0, 1.0], 1, 2).expect("finite");
        assert!(expected(&model, &recorded, &wide, Weights::Linear).is_err());
    }
}
