use pulp::Arch;

/// Adam's decay of the second moment, and the term that keeps its division finite.
const BETA2: f32 = 0.999;
const EPSILON: f32 = 1e-8;
/// Smaller traces end: with γλ = 0.8 after 16 steps.
const SMALLEST_TRACE: f32 = 0.03;
/// The place of a weight without a trace.
const NOWHERE: u32 = u32::MAX;

/// Weights with replacing traces, learned by Adam.
///
/// Only weights with a trace change. They are kept contiguously, apart from the others, so that an update is one pass over plain arrays.
/// The update sums nothing, so the numbers do not depend on the width of the processor's vectors.
#[derive(Clone, Debug)]
pub(crate) struct Weights {
    /// The present values of all weights. The moments of those with a trace are in `traced`.
    values: Vec<f32>,
    moments: Vec<Moments>,
    traced: Traced,
}

#[derive(Clone, Copy, Debug)]
struct Moments {
    mean: f32,
    square: f32,
    /// Its place among the weights with a trace.
    place: u32,
}

#[derive(Clone, Debug, Default)]
struct Traced {
    number: Vec<u32>,
    value: Vec<f32>,
    mean: Vec<f32>,
    square: Vec<f32>,
    trace: Vec<f32>,
}

/// The change of the weights in one step: w ← w − `step` · m / (√(v · `unbias`) + 1e-8), with g = −`error` · e, m ← `beta1` m + (1 −
/// `beta1`) g and v ← 0.999 v + 0.001 g². Then e ← `decay` · e.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Change {
    pub(crate) error: f32,
    pub(crate) step: f32,
    pub(crate) beta1: f32,
    pub(crate) unbias: f32,
    pub(crate) decay: f32,
}

impl Change {
    /// The decay of the second moment, which `unbias` corrects for.
    pub(crate) const BETA2: f64 = BETA2 as f64;
}

impl Weights {
    pub(crate) fn new(count: usize, value: f32) -> Self {
        let none = Moments { mean: 0.0, square: 0.0, place: NOWHERE };
        Self { values: vec![value; count], moments: vec![none; count], traced: Traced::default() }
    }

    /// Returns weights with these values and moments, without traces.
    pub(crate) fn with_moments(values: &[f32], means: &[f32], squares: &[f32]) -> Self {
        let moments = means.iter().zip(squares);
        Self {
            values: values.to_vec(),
            moments: moments
                .map(|(&mean, &square)| Moments { mean, square, place: NOWHERE })
                .collect(),
            traced: Traced::default(),
        }
    }

    /// Ends all traces, and returns the values, means and squares of all weights.
    pub(crate) fn parts(mut self) -> [Vec<f32>; 3] {
        self.forget();
        let means = self.moments.iter().map(|moments| moments.mean).collect();
        let squares = self.moments.iter().map(|moments| moments.square).collect();
        [self.values, means, squares]
    }

    /// Returns the memory of this many weights, in bytes.
    pub(crate) fn bytes(count: usize) -> u64 {
        (count * (size_of::<f32>() + size_of::<Moments>())) as u64
    }

    /// Writes for each action the sum of its weights at `features`. Each action has `length` weights, one action after the other.
    pub(crate) fn sums(&self, length: usize, features: &[u32], sums: &mut [f64]) {
        sums.fill(0.0);
        // Four sums run side by side, because each sum waits for its last addition.
        let mut rest = &self.values[..];
        for sums in sums.chunks_mut(4) {
            let own = |action: usize| rest.get(action * length..).unwrap_or_default();
            match sums {
                [a] => add([own(0)], features, [a]),
                [a, b] => add([own(0), own(1)], features, [a, b]),
                [a, b, c] => add([own(0), own(1), own(2)], features, [a, b, c]),
                [a, b, c, d] => add([own(0), own(1), own(2), own(3)], features, [a, b, c, d]),
                _ => {}
            }
            rest = rest.get(4 * length..).unwrap_or_default();
        }
    }

    /// Sets the traces of `features`, each shifted by `base`, to 1.
    pub(crate) fn trace(&mut self, base: usize, features: &[u32]) {
        for &feature in features {
            let number = base + feature as usize;
            let moments = &mut self.moments[number];
            if moments.place == NOWHERE {
                moments.place = self.traced.number.len() as u32;
                self.traced.number.push(number as u32);
                self.traced.value.push(self.values[number]);
                self.traced.mean.push(moments.mean);
                self.traced.square.push(moments.square);
                self.traced.trace.push(1.0);
            } else {
                self.traced.trace[moments.place as usize] = 1.0;
            }
        }
    }

    /// Changes every weight that has a trace, and ends traces that have become small.
    pub(crate) fn change(&mut self, change: Change) {
        let traced = &mut self.traced;
        let value = &mut traced.value[..];
        let mean = &mut traced.mean[..];
        let square = &mut traced.square[..];
        let trace = &mut traced.trace[..];
        Arch::new().dispatch(
            #[inline(always)]
            || {
                for (((value, mean), square), trace) in
                    value.iter_mut().zip(mean).zip(square).zip(trace)
                {
                    let gradient = -change.error * *trace;
                    *mean = change.beta1 * *mean + (1.0 - change.beta1) * gradient;
                    *square = BETA2 * *square + (1.0 - BETA2) * gradient * gradient;
                    *value -= change.step * *mean / ((*square * change.unbias).sqrt() + EPSILON);
                    *trace *= change.decay;
                }
            },
        );
        for (&number, &value) in self.traced.number.iter().zip(&self.traced.value) {
            self.values[number as usize] = value;
        }
        let mut place = 0;
        while place < self.traced.trace.len() {
            if self.traced.trace[place] < SMALLEST_TRACE {
                self.end(place);
            } else {
                place += 1;
            }
        }
    }

    /// Ends all traces, as at the end of an episode.
    pub(crate) fn forget(&mut self) {
        while !self.traced.number.is_empty() {
            self.end(self.traced.number.len() - 1);
        }
    }

    /// Ends the trace in `place`. The last trace moves there.
    fn end(&mut self, place: usize) {
        let traced = &mut self.traced;
        traced.value.swap_remove(place);
        self.moments[traced.number.swap_remove(place) as usize] = Moments {
            mean: traced.mean.swap_remove(place),
            square: traced.square.swap_remove(place),
            place: NOWHERE,
        };
        traced.trace.swap_remove(place);
        if let Some(&moved) = traced.number.get(place) {
            self.moments[moved as usize].place = place as u32;
        }
    }
}

/// Sums the weights of `features` for each action, and writes the sums.
fn add<const N: usize>(values: [&[f32]; N], features: &[u32], sums: [&mut f64; N]) {
    let mut own = [0.0; N];
    for &feature in features {
        for (sum, values) in own.iter_mut().zip(values) {
            *sum += f64::from(values[feature as usize]);
        }
    }
    for (sum, own) in sums.into_iter().zip(own) {
        *sum = own;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Computes the same change by the formula, one weight after the other.
    fn plain(
        weights: &mut [[f32; 4]],
        features: &[u32],
        Change { error, step, beta1, unbias, decay }: Change,
    ) {
        for &feature in features {
            weights[feature as usize][3] = 1.0;
        }
        for [value, mean, square, trace] in weights {
            if *trace == 0.0 {
                continue;
            }
            let gradient = -error * *trace;
            *mean = beta1 * *mean + (1.0 - beta1) * gradient;
            *square = BETA2 * *square + (1.0 - BETA2) * gradient * gradient;
            *value -= step * *mean / ((*square * unbias).sqrt() + EPSILON);
            *trace *= decay;
            if *trace < SMALLEST_TRACE {
                *trace = 0.0;
            }
        }
    }

    proptest! {
        #[test]
        fn weights_change_by_the_formula(
            steps in proptest::collection::vec(
                (proptest::collection::vec(0_u32..40, 1..8), -5.0_f32..5.0, any::<bool>()), 1..60),
            beta1 in 0.0_f32..0.95,
            decay in 0.0_f32..1.0,
        ) {
            let mut weights = Weights::new(40, 0.5);
            let mut expected = vec![[0.5, 0.0, 0.0, 0.0]; 40];
            for (features, error, forget) in steps {
                let change = Change { error, step: 0.1, beta1, unbias: 1.5, decay };
                weights.trace(0, &features);
                weights.change(change);
                plain(&mut expected, &features, change);
                if forget {
                    weights.forget();
                    for weight in &mut expected {
                        weight[3] = 0.0;
                    }
                }
                // Reads the 40 weights as 40 actions with one weight each.
                let mut got = [0.0; 40];
                weights.sums(1, &[0], &mut got);
                for (number, weight) in expected.iter().enumerate() {
                    prop_assert_eq!(got[number], f64::from(weight[0]), "weight {}", number);
                }
            }
        }
    }
}
