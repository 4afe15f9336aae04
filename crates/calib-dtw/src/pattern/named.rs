//! The patterns of Sakoe and Chiba (1978) and the common unconstrained ones.

use super::{Branch, Normalisation, Step, StepPattern};

type Steps = &'static [(usize, usize, f64)];

fn named(name: &str, branches: &[Steps], normalisation: Normalisation) -> StepPattern {
    let branches = branches
        .iter()
        .map(|steps| {
            Branch::new(
                steps
                    .iter()
                    .map(|&(query, reference, weight)| Step::new(query, reference, weight))
                    .collect::<Vec<_>>(),
            )
        })
        .collect();
    StepPattern { name: name.to_owned(), branches, normalisation }
}

impl StepPattern {
    /// Returns `symmetric1`: every step costs the distance of the cell that it reaches. It prefers
    /// diagonals, and so cannot be normalised.
    pub fn symmetric1() -> Self {
        let branches: [Steps; 3] = [&[(1, 1, 1.0)], &[(0, 1, 1.0)], &[(1, 0, 1.0)]];
        named("symmetric1", &branches, Normalisation::None)
    }

    /// Returns `symmetric2`: a diagonal step counts twice, so that every path has the total weight
    /// N + M. It is the usual choice without slope limits.
    pub fn symmetric2() -> Self {
        let branches: [Steps; 3] = [&[(1, 1, 2.0)], &[(0, 1, 1.0)], &[(1, 0, 1.0)]];
        named("symmetric2", &branches, Normalisation::Sum)
    }

    /// Returns `asymmetric`: every query sample is matched exactly once, at a slope of 0 to 2.
    pub fn asymmetric() -> Self {
        let branches: [Steps; 3] = [&[(1, 0, 1.0)], &[(1, 1, 1.0)], &[(1, 2, 1.0)]];
        named("asymmetric", &branches, Normalisation::Query)
    }

    /// Returns `symmetricP0`: Sakoe–Chiba symmetric, slope constraint P = 0 (the same as
    /// `symmetric2`).
    pub fn symmetric_p0() -> Self {
        Self { name: "symmetricP0".to_owned(), ..Self::symmetric2() }
    }

    /// Returns `symmetricP05`: Sakoe–Chiba symmetric, P = 1/2, slopes 1/3 to 3.
    pub fn symmetric_p05() -> Self {
        let branches: [Steps; 5] = [
            &[(1, 1, 2.0), (0, 1, 1.0), (0, 1, 1.0)],
            &[(1, 1, 2.0), (0, 1, 1.0)],
            &[(1, 1, 2.0)],
            &[(1, 1, 2.0), (1, 0, 1.0)],
            &[(1, 1, 2.0), (1, 0, 1.0), (1, 0, 1.0)],
        ];
        named("symmetricP05", &branches, Normalisation::Sum)
    }

    /// Returns `symmetricP1`: Sakoe–Chiba symmetric, P = 1, slopes 1/2 to 2.
    pub fn symmetric_p1() -> Self {
        let branches: [Steps; 3] =
            [&[(1, 1, 2.0), (0, 1, 1.0)], &[(1, 1, 2.0)], &[(1, 1, 2.0), (1, 0, 1.0)]];
        named("symmetricP1", &branches, Normalisation::Sum)
    }

    /// Returns `symmetricP2`: Sakoe–Chiba symmetric, P = 2, slopes 2/3 to 3/2.
    pub fn symmetric_p2() -> Self {
        let branches: [Steps; 3] = [
            &[(1, 1, 2.0), (1, 1, 2.0), (0, 1, 1.0)],
            &[(1, 1, 2.0)],
            &[(1, 1, 2.0), (1, 1, 2.0), (1, 0, 1.0)],
        ];
        named("symmetricP2", &branches, Normalisation::Sum)
    }

    /// Returns `asymmetricP0`: Sakoe–Chiba asymmetric, P = 0. Steps along the reference alone cost
    /// nothing.
    pub fn asymmetric_p0() -> Self {
        let branches: [Steps; 3] = [&[(0, 1, 0.0)], &[(1, 1, 1.0)], &[(1, 0, 1.0)]];
        named("asymmetricP0", &branches, Normalisation::Query)
    }

    /// Returns `asymmetricP05`: Sakoe–Chiba asymmetric, P = 1/2, slopes 1/3 to 3.
    pub fn asymmetric_p05() -> Self {
        const THIRD: f64 = 1.0 / 3.0;
        let branches: [Steps; 5] = [
            &[(1, 1, THIRD), (0, 1, THIRD), (0, 1, THIRD)],
            &[(1, 1, 0.5), (0, 1, 0.5)],
            &[(1, 1, 1.0)],
            &[(1, 1, 1.0), (1, 0, 1.0)],
            &[(1, 1, 1.0), (1, 0, 1.0), (1, 0, 1.0)],
        ];
        named("asymmetricP05", &branches, Normalisation::Query)
    }

    /// Returns `asymmetricP1`: Sakoe–Chiba asymmetric, P = 1, slopes 1/2 to 2.
    pub fn asymmetric_p1() -> Self {
        let branches: [Steps; 3] =
            [&[(1, 1, 0.5), (0, 1, 0.5)], &[(1, 1, 1.0)], &[(1, 1, 1.0), (1, 0, 1.0)]];
        named("asymmetricP1", &branches, Normalisation::Query)
    }

    /// Returns `asymmetricP2`: Sakoe–Chiba asymmetric, P = 2, slopes 2/3 to 3/2.
    pub fn asymmetric_p2() -> Self {
        const TWO_THIRDS: f64 = 2.0 / 3.0;
        let branches: [Steps; 3] = [
            &[(1, 1, TWO_THIRDS), (1, 1, TWO_THIRDS), (0, 1, TWO_THIRDS)],
            &[(1, 1, 1.0)],
            &[(1, 1, 1.0), (1, 1, 1.0), (1, 0, 1.0)],
        ];
        named("asymmetricP2", &branches, Normalisation::Query)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A normalisable pattern gives every path between two cells the same total weight.
    #[test]
    fn total_weight_of_a_branch_is_what_the_normalisation_counts() {
        for pattern in StepPattern::all() {
            for branch in pattern.branches() {
                let (query, reference) = branch.origin();
                let expected = match pattern.normalisation() {
                    Normalisation::Query => query,
                    Normalisation::Reference => reference,
                    Normalisation::Sum => query + reference,
                    Normalisation::None => continue,
                };
                let total: f64 = branch.steps().iter().map(|step| step.weight).sum();
                assert!((total - expected as f64).abs() < 1e-12, "{pattern}");
            }
        }
    }
}
