//! Errors in data for figures and pages.

/// Data that no figure can be drawn from, or a failure to draw.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ReportError {
    /// A figure has nothing to show.
    #[error("figure \"{figure}\" has no {missing}; expected at least one")]
    Empty {
        /// Title of the figure.
        figure: String,
        /// The missing content.
        missing: &'static str,
    },
    /// The number of points of a curve differs from the number of settings in the grid.
    #[error(
        "curve \"{curve}\" of figure \"{figure}\" has {got} points; expected {expected}, one for each setting"
    )]
    Points {
        /// Title of the figure.
        figure: String,
        /// Label of the curve.
        curve: String,
        /// Number of settings in the grid.
        expected: usize,
        /// Number of points found.
        got: usize,
    },
    /// An index points past the end of the grid.
    #[error("{what} of figure \"{figure}\" is number {index}; expected less than {len}")]
    OutOfGrid {
        /// Title of the figure.
        figure: String,
        /// Name of the index.
        what: &'static str,
        /// The index.
        index: usize,
        /// Number of settings in the grid.
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
        /// Message of the drawing library.
        reason: String,
    },
}
