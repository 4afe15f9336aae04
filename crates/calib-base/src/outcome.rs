//! The outcome and the result of a step.

use std::{path::Path, time::Duration};

use calib_study::Job;

use crate::{
    StepError,
    output::{Printer, duration},
};

/// The outcome of a step that ended without an error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Done.
    Done,
    /// Done, but the answer is negative or partial.
    Negative,
    /// A check found an output that no correct calib writes.
    Faulty,
    /// Parts are missing that other processes must make.
    Incomplete,
}

/// A result that can be printed. `S` is the subject that printing needs: a [`Job`], or nothing, `()`.
pub trait Told<S = Job> {
    /// Returns the outcome of the step with this result.
    fn outcome(&self) -> Outcome {
        Outcome::Done
    }

    /// Prints the result: lines and tables for people, JSON for machines. Then it prints the next command for its
    /// `subject`.
    ///
    /// # Errors
    /// If the observer cannot take it.
    fn tell(&self, subject: &S, printer: &Printer) -> Result<(), StepError>;
}

/// Prints a `result`, and returns it.
///
/// # Errors
/// If the observer cannot take it.
pub fn told<S, T: Told<S>>(result: T, subject: &S, printer: &Printer) -> Result<T, StepError> {
    result.tell(subject, printer)?;
    Ok(result)
}

/// The result of a step. `T` is its product, `P` the plan of a dry run.
#[derive(Debug)]
pub enum StepResult<T, P = NoPlan> {
    /// The product, made now or found up to date.
    Made(T),
    /// The plan of a dry run, which makes nothing.
    Planned(P),
    /// No product, without an error, for a reason that was reported: a deployment that cannot be scored, or a share of
    /// work that others finish.
    Nothing(Outcome),
}

/// The plan of a step that knows no more than was already reported.
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
    /// Converts the product into another type.
    pub fn map<U>(self, into: impl FnOnce(T) -> U) -> StepResult<U, P> {
        match self {
            Self::Made(result) => StepResult::Made(into(result)),
            Self::Planned(plan) => StepResult::Planned(plan),
            Self::Nothing(outcome) => StepResult::Nothing(outcome),
        }
    }

    /// Returns the product, if there is one.
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

/// Whether a result existed already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Freshness {
    /// It existed and is up to date.
    Kept,
    /// It was made just now.
    Made,
}

impl Freshness {
    /// Returns a line on the place of a result, and the time it took.
    pub fn line(self, directory: &Path, took: Duration) -> String {
        let verb = match self {
            Self::Kept => "up to date:",
            Self::Made => "wrote",
        };
        format!("{verb} {} in {}", directory.display(), duration(took))
    }
}
