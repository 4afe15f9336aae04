//! How a step ended, and what it came to.

use std::{path::Path, time::Duration};

use calib_study::Job;

use crate::{
    StepError,
    output::{Printer, duration},
};

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

/// A result that can be told; `S` is what it is the result of, as far as telling it needs that: a [`Job`], or nothing, `()`.
pub trait Told<S = Job> {
    /// How the step ended that has it.
    fn outcome(&self) -> Outcome {
        Outcome::Done
    }

    /// Tell it: lines and tables for people, JSON for machines; then what to type next on its `subject`.
    ///
    /// # Errors
    /// If it cannot be passed on.
    fn tell(&self, subject: &S, printer: &Printer) -> Result<(), StepError>;
}

/// Tell a `result`, and hand it on.
///
/// # Errors
/// If it cannot be passed on.
pub fn told<S, T: Told<S>>(result: T, subject: &S, printer: &Printer) -> Result<T, StepError> {
    result.tell(subject, printer)?;
    Ok(result)
}

/// What a step came to: `T` is what it makes, `P` what it knows of that in a dry run.
#[derive(Debug)]
pub enum StepResult<T, P = NoPlan> {
    /// What it made, or found as it would make it.
    Made(T),
    /// What it would make: in a dry run nothing is.
    Planned(P),
    /// Nothing, which is no error, and why was said: a deployment that cannot be scored, a share of work that others finish.
    Nothing(Outcome),
}

/// Nothing is known of what would be made but what was said.
#[derive(Clone, Copy, Debug)]
pub struct NoPlan;

impl<S> Told<S> for NoPlan {
    fn tell(&self, _of: &S, _printer: &Printer) -> Result<(), StepError> {
        Ok(())
    }
}

impl<S, P: Told<S>> Told<S> for Option<P> {
    fn tell(&self, subject: &S, printer: &Printer) -> Result<(), StepError> {
        self.as_ref().map_or(Ok(()), |plan| plan.tell(subject, printer))
    }
}

impl<T, P> StepResult<T, P> {
    /// The same with what was made as another type.
    pub fn map<U>(self, into: impl FnOnce(T) -> U) -> StepResult<U, P> {
        match self {
            Self::Made(result) => StepResult::Made(into(result)),
            Self::Planned(plan) => StepResult::Planned(plan),
            Self::Nothing(outcome) => StepResult::Nothing(outcome),
        }
    }

    /// What was made or found, if anything was.
    pub fn made(self) -> Option<T> {
        match self {
            Self::Made(result) => Some(result),
            Self::Planned(_) | Self::Nothing(_) => None,
        }
    }
}

impl<S, T: Told<S>, P: Told<S>> Told<S> for StepResult<T, P> {
    fn outcome(&self) -> Outcome {
        match self {
            Self::Made(result) => result.outcome(),
            Self::Planned(plan) => plan.outcome(),
            Self::Nothing(outcome) => *outcome,
        }
    }

    fn tell(&self, subject: &S, printer: &Printer) -> Result<(), StepError> {
        match self {
            Self::Made(result) => result.tell(subject, printer),
            Self::Planned(plan) => plan.tell(subject, printer),
            Self::Nothing(_) => Ok(()),
        }
    }
}

/// Whether a result was there already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Freshness {
    /// It was, and is what would be made now.
    Kept,
    /// It was made just now.
    Made,
}

impl Freshness {
    /// Where a result is, and what it took.
    pub fn line(self, directory: &Path, took: Duration) -> String {
        let verb = match self {
            Self::Kept => "up to date:",
            Self::Made => "wrote",
        };
        format!("{verb} {} in {}", directory.display(), duration(took))
    }
}
