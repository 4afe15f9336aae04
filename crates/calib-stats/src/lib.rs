//! Ranks, intervals, correlations, regret and errors as pure functions.
