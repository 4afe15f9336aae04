//! How a step ended.

/// How a step ended that did what it should.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Done.
    Done,
    /// Done, but the answer is negative or partial.
    Negative,
    /// A check found what no correct calib writes.
    Faulty,
    /// Parts that others are to make are missing.
    Incomplete,
}
