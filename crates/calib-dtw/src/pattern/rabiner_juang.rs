//! The local constraints of Rabiner and Juang, *Fundamentals of Speech Recognition* (1993),
//! chapter 4: seven types of branches, four slope weightings, smoothing.

use super::{Branch, Normalisation, Step, StepPattern};

/// The seven types of local constraints.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RabinerJuangType {
    /// Type I: (1,0), (1,1), (0,1); any slope.
    I,
    /// Type II: slopes 1/2 to 2 through single steps.
    II,
    /// Type III: slopes 1/2 to 2 by skipping samples.
    III,
    /// Type IV: slopes 1/2 to 2, no two steps without advance of the reference.
    IV,
    /// Type V: slopes 1/3 to 3 through single steps.
    V,
    /// Type VI: slopes 2/3 to 3/2.
    VI,
    /// Type VII: slopes 1/3 to 3, nine branches.
    VII,
}

impl RabinerJuangType {
    /// All seven, in order.
    pub const ALL: [Self; 7] =
        [Self::I, Self::II, Self::III, Self::IV, Self::V, Self::VI, Self::VII];

    /// Returns the number of the type, 1 to 7.
    pub fn number(self) -> usize {
        self as usize + 1
    }

    fn branches(self) -> &'static [&'static [(usize, usize)]] {
        match self {
            Self::I => &[&[(1, 0)], &[(1, 1)], &[(0, 1)]],
            Self::II => &[&[(1, 1), (1, 0)], &[(1, 1)], &[(1, 1), (0, 1)]],
            Self::III => &[&[(2, 1)], &[(1, 1)], &[(1, 2)]],
            Self::IV => &[&[(1, 1), (1, 0)], &[(1, 2), (1, 0)], &[(1, 1)], &[(1, 2)]],
            Self::V => &[
                &[(1, 1), (1, 0), (1, 0)],
                &[(1, 1), (1, 0)],
                &[(1, 1)],
                &[(1, 1), (0, 1)],
                &[(1, 1), (0, 1), (0, 1)],
            ],
            Self::VI => &[&[(1, 1), (1, 1), (1, 0)], &[(1, 1)], &[(1, 1), (1, 1), (0, 1)]],
            Self::VII => &[
                &[(1, 1), (1, 0), (1, 0)],
                &[(1, 2), (1, 0), (1, 0)],
                &[(1, 3), (1, 0), (1, 0)],
                &[(1, 1), (1, 0)],
                &[(1, 2), (1, 0)],
                &[(1, 3), (1, 0)],
                &[(1, 1)],
                &[(1, 2)],
                &[(1, 3)],
            ],
        }
    }
}

/// The weight of a step (dx, dy), dx along the query and dy along the reference.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SlopeWeighting {
    /// min(dx, dy). Not normalisable.
    A,
    /// max(dx, dy). Not normalisable.
    B,
    /// dx; normalised by N.
    C,
    /// dx + dy; normalised by N + M.
    D,
}

impl SlopeWeighting {
    /// All four, in order.
    pub const ALL: [Self; 4] = [Self::A, Self::B, Self::C, Self::D];

    /// Returns the letter of the weighting: `a`, `b`, `c` or `d`.
    pub fn letter(self) -> char {
        match self {
            Self::A => 'a',
            Self::B => 'b',
            Self::C => 'c',
            Self::D => 'd',
        }
    }

    fn weight(self, query: usize, reference: usize) -> usize {
        match self {
            Self::A => query.min(reference),
            Self::B => query.max(reference),
            Self::C => query,
            Self::D => query + reference,
        }
    }

    fn normalisation(self) -> Normalisation {
        match self {
            Self::A | Self::B => Normalisation::None,
            Self::C => Normalisation::Query,
            Self::D => Normalisation::Sum,
        }
    }
}

/// Whether the weights of a branch are replaced by their mean.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Smoothing {
    /// Each step has its own weight.
    #[default]
    Plain,
    /// Each step of a branch has the mean weight of the branch.
    Smoothed,
}

impl StepPattern {
    /// Returns the Rabiner–Juang pattern of a type, a slope weighting and a smoothing, e.g.
    /// `rabinerJuang:6c` or `rabinerJuang:3d:smoothed`.
    pub fn rabiner_juang(
        kind: RabinerJuangType,
        weighting: SlopeWeighting,
        smoothing: Smoothing,
    ) -> Self {
        let suffix = match smoothing {
            Smoothing::Plain => "",
            Smoothing::Smoothed => ":smoothed",
        };
        Self {
            name: format!("rabinerJuang:{}{}{suffix}", kind.number(), weighting.letter()),
            branches: kind
                .branches()
                .iter()
                .map(|steps: &&[(usize, usize)]| {
                    let weights: Vec<f64> = steps
                        .iter()
                        .map(|&(query, reference)| weighting.weight(query, reference) as f64)
                        .collect();
                    let mean = weights.iter().sum::<f64>() / weights.len() as f64;
                    let steps = steps.iter().zip(weights);
                    Branch::new(
                        steps
                            .map(|(&(query, reference), weight)| match smoothing {
                                Smoothing::Plain => Step::new(query, reference, weight),
                                Smoothing::Smoothed => Step::new(query, reference, mean),
                            })
                            .collect::<Vec<_>>(),
                    )
                })
                .collect(),
            normalisation: weighting.normalisation(),
        }
    }
}
