//! What can be wrong with what is to be shown.

/// Rows that no figure can be drawn from.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ReportError {
    /// A figure has nothing to show.
    #[error("figure \"{figure}\" has no {missing}; expected at least one")]
    Empty {
        /// Title of the figure.
        figure: String,
        /// What is missing.
        missing: &'static str,
    },
    /// A curve has another number of points than the grid has values.
    #[error(
        "curve \"{curve}\" of figure \"{figure}\" has {got} points; expected {expected}, one for each setting"
    )]
    Points {
        /// Title of the figure.
        figure: String,
        /// Label of the curve.
        curve: String,
        /// Number of values in the grid.
        expected: usize,
        /// Number of points found.
        got: usize,
    },
    /// An index into the grid points past its end.
    #[error("{what} of figure \"{figure}\" is number {index}; expected less than {len}")]
    OutOfGrid {
        /// Title of the figure.
        figure: String,
        /// Which index.
        what: &'static str,
        /// The index.
        index: usize,
        /// Number of values in the grid.
        len: usize,
    },
    /// The sample period of a trajectory is not positive.
    #[error(
        "trajectory \"{trajectory}\" has a sample period of {got} s; expected a positive number"
    )]
    Period {
        /// Label of the trajectory.
        trajectory: String,
        /// The period as text.
        got: String,
    },
    /// The bitmap could not be encoded.
    #[error("figure could not be drawn as PNG: {reason}")]
    Png {
        /// What the drawing library said.
        reason: String,
    },
}
