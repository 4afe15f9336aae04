/// Why no study can be proposed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ProposeError {
    /// No channel can be used.
    #[error(
        "no channel of the log can be used: {0}; `calib inspect` shows every channel, and data.include chooses some"
    )]
    NoChannel(String),
    /// No channel moves enough.
    #[error(
        "no channel moves throughout the log, so there is nothing to predict; name sensors with --sensor, or choose another part of the log \
         with data.path"
    )]
    NothingMoves,
    /// There is too little.
    #[error(
        "the log has {rows} rows that could be used, and a study wants {least} at least; export a longer stretch, or at a shorter period"
    )]
    TooShort {
        /// Usable rows.
        rows: usize,
        /// The fewest.
        least: usize,
    },
}
