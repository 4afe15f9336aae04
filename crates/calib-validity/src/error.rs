use calib_stats::StatsError;

/// Results that cannot be judged together.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ValidityError {
    /// There is no pair to judge.
    #[error(
        "there is no plant and sensor to judge; expected at least one study with held-out data in which some setting did not diverge"
    )]
    NoPairs,
    /// A pair has another number of values than the others.
    #[error(
        "{sensor} of {plant} has errors of {got} settings on held-out data, expected {expected}"
    )]
    Values {
        /// The plant.
        plant: String,
        /// The sensor.
        sensor: String,
        /// Values of the grid.
        expected: usize,
        /// Actual number of values.
        got: usize,
    },
    /// A regret is invalid.
    #[error(
        "{sensor} of {plant} has a regret of {got}; expected a number of at least 0, or infinity for a setting that diverged"
    )]
    Regret {
        /// The plant.
        plant: String,
        /// The sensor.
        sensor: String,
        /// The invalid regret.
        got: f64,
    },
    /// A choice is not one of the values.
    #[error("{sensor} of {plant}: the choice of {whose} is setting {got}, but there are {values}")]
    Choice {
        /// The plant.
        plant: String,
        /// The sensor.
        sensor: String,
        /// The model or method that made the choice.
        whose: String,
        /// The choice.
        got: usize,
        /// Values of the grid.
        values: usize,
    },
    /// Numbers that no statistic can be computed from.
    #[error(transparent)]
    Stats(#[from] StatsError),
}
