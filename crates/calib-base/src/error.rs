//! Errors of steps.

use std::{error::Error, fmt, io, num::ParseIntError, string::FromUtf8Error};

use calib_agent::AgentError;
use calib_control::ControlError;
use calib_core::{Cancelled, FramesError, SegmentError, StatesError};
use calib_data::{DataError, NotANumber, table::TableError};
use calib_dtw::{DtwError, NoPath, ParsePatternError};
use calib_dynamics::DynamicsError;
use calib_files::FileError;
use calib_knn::KnnError;
use calib_model::{ModelError, RolloutError};
use calib_nn::{LayoutError, ParameterCountError};
use calib_plant::OptionsError;
use calib_report::ReportError;
use calib_represent::RepresentError;
use calib_stats::StatsError;
use calib_study::{Place, StudyError};
use calib_sweep::SweepError;
use rayon::ThreadPoolBuildError;

/// The error of a step: the study or the data is wrong, the machine refuses, or the user asked it to stop.
///
/// It is shown from the outermost context to the innermost cause. Some errors of other crates include their cause in
/// their text; it is then shown once.
#[derive(Debug)]
pub enum StepError {
    /// The observer asked to stop.
    Cancelled,
    /// Something is missing that another attempt may provide, here or elsewhere. Existing files are kept.
    Incomplete(String),
    /// The result of an earlier step, or one of its files, does not exist.
    Missing(String),
    /// A result was made from other inputs, in another format, or was changed after it was written.
    Stale(String),
    /// The study is wrong.
    Study(Box<StudyError>),
    /// The log cannot be used.
    Data(Box<DataError>),
    /// No step of the held-out range can be scored, so a choice cannot be judged there.
    Unscorable(String),
    /// The step needs libtorch, and this calib was built without it.
    Unavailable(String),
    /// A log of decisions, its model or its agents cannot be used.
    Control(Box<ControlError>),
    /// A file could not be read or written, or has unexpected content.
    Storage(Box<FileError>),
    /// Any other error.
    Other(Box<dyn Error + Send + Sync>),
    /// An error with the context in which it occurred.
    InContext {
        /// The action or object at the time of the error.
        context: String,
        /// The error itself.
        source: Box<StepError>,
    },
}

impl StepError {
    /// Returns an error that consists only of a text.
    pub fn message(text: impl Into<String>) -> Self {
        Self::Other(text.into().into())
    }

    /// Returns an error of a crate that this one does not know, so that a change there recompiles only its users.
    pub fn other(error: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self::Other(error.into())
    }

    /// Returns the error without its contexts.
    pub fn root(&self) -> &Self {
        match self {
            Self::InContext { source, .. } => source.root(),
            root => root,
        }
    }

    /// Returns the exit code of a command that ends with this error.
    pub fn exit_code(&self) -> u8 {
        match self.root() {
            Self::Cancelled => 130,
            Self::Incomplete(_) => 4,
            _ => 2,
        }
    }

    /// Whether the user cancelled the work, so that it is no error.
    pub fn was_cancelled(&self) -> bool {
        matches!(self.root(), Self::Cancelled)
    }

    /// Whether an earlier step has to run, because its result is missing or stale.
    pub fn lacks_result(&self) -> bool {
        matches!(self.root(), Self::Missing(_) | Self::Stale(_))
    }

    /// Whether a file or a disk is the cause, also below an error of another crate.
    pub fn is_of_storage(&self) -> bool {
        let error: &(dyn Error + 'static) = match self.root() {
            Self::Storage(_) => return true,
            Self::Data(error) => error.as_ref(),
            Self::Control(error) => error.as_ref(),
            Self::Other(error) => error.as_ref(),
            _ => return false,
        };
        std::iter::successors(Some(error), |&error| error.source())
            .any(|error| error.is::<io::Error>() || error.is::<FileError>())
    }

    /// Returns the position of the cause in the study file, if it is there.
    pub fn place(&self) -> Option<&Place> {
        match self.root() {
            Self::Study(error) => error.place(),
            _ => None,
        }
    }

    /// Returns the texts of the error and its causes.
    fn causes(&self) -> Vec<String> {
        let error: &dyn Error = match self {
            Self::Cancelled => return vec!["interrupted".to_owned()],
            Self::Incomplete(text)
            | Self::Missing(text)
            | Self::Stale(text)
            | Self::Unscorable(text) => return vec![text.clone()],
            Self::Unavailable(what) => {
                return vec![format!(
                    "{what} wants libtorch, and this calib was built without it; in the source tree run \
                     `bash scripts/libtorch.sh cargo build --release --features torch`"
                )];
            }
            Self::InContext { context, source } => {
                let mut causes = vec![context.clone()];
                causes.extend(source.causes());
                return causes;
            }
            Self::Study(error) => error.as_ref(),
            Self::Data(error) => error.as_ref(),
            Self::Control(error) => error.as_ref(),
            Self::Storage(error) => error.as_ref(),
            Self::Other(error) => error.as_ref(),
        };
        let mut causes = vec![error.to_string()];
        let mut source = error.source();
        while let Some(cause) = source {
            causes.push(cause.to_string());
            source = cause.source();
        }
        causes
    }
}

impl fmt::Display for StepError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // After a cancellation, the context does not matter.
        let told = if self.was_cancelled() { self.root() } else { self };
        let mut text = String::new();
        for cause in told.causes() {
            if text.is_empty() {
                text = cause;
            } else if !text.contains(&cause) {
                text = format!("{text}: {cause}");
            }
        }
        f.write_str(&text)
    }
}

// Its causes are shown with it.
impl Error for StepError {}

impl From<Cancelled> for StepError {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}

impl From<StudyError> for StepError {
    fn from(error: StudyError) -> Self {
        Self::Study(Box::new(error))
    }
}

impl From<FileError> for StepError {
    fn from(error: FileError) -> Self {
        Self::Storage(Box::new(error))
    }
}

impl From<DataError> for StepError {
    fn from(error: DataError) -> Self {
        match error {
            DataError::Cancelled(cancelled) => cancelled.into(),
            DataError::File(error) => error.into(),
            other => Self::Data(Box::new(other)),
        }
    }
}

impl From<ControlError> for StepError {
    fn from(error: ControlError) -> Self {
        match error {
            ControlError::Cancelled(cancelled) => cancelled.into(),
            other => Self::Control(Box::new(other)),
        }
    }
}

impl From<TableError> for StepError {
    fn from(error: TableError) -> Self {
        match error {
            TableError::File(error) => error.into(),
            other => Self::Other(other.into()),
        }
    }
}

/// Implements `From` for errors of crates that read and write files, and can be cancelled.
macro_rules! from_errors_with_files {
    ($($error:ident),*) => {$(
        impl From<$error> for StepError {
            fn from(error: $error) -> Self {
                match error {
                    $error::Cancelled(cancelled) => cancelled.into(),
                    $error::File(error) => error.into(),
                    other => Self::Other(other.into()),
                }
            }
        }
    )*};
}

/// Implements `From` for errors of crates that can be cancelled.
macro_rules! from_errors {
    ($($error:ident),*) => {$(
        impl From<$error> for StepError {
            fn from(error: $error) -> Self {
                match error {
                    $error::Cancelled(cancelled) => cancelled.into(),
                    other => Self::Other(other.into()),
                }
            }
        }
    )*};
}

/// Implements `From` for errors of which only the text matters.
macro_rules! from_others {
    ($($error:ty),*) => {$(
        impl From<$error> for StepError {
            fn from(error: $error) -> Self {
                Self::Other(error.into())
            }
        }
    )*};
}

from_errors_with_files!(DynamicsError, KnnError, RepresentError, SweepError);
from_errors!(AgentError, ModelError, RolloutError);
from_others!(
    io::Error,
    FromUtf8Error,
    ParseIntError,
    ThreadPoolBuildError,
    serde_json::Error,
    toml::de::Error,
    toml::ser::Error,
    DtwError,
    FramesError,
    LayoutError,
    NoPath,
    NotANumber,
    OptionsError,
    ParameterCountError,
    ParsePatternError,
    ReportError,
    SegmentError,
    StatesError,
    StatsError
);

#[cfg(feature = "torch")]
from_others!(calib_torch::TorchError);

/// Adds the context in which an error occurred.
pub trait Context<T> {
    /// Adds `context` before the error.
    ///
    /// # Errors
    /// The error in its context, or the context alone if the value was `None`.
    fn context(self, context: impl fmt::Display) -> Result<T, StepError>;

    /// Adds a context as [`context`](Self::context) does. It is computed only after an error.
    ///
    /// # Errors
    /// As [`context`](Self::context).
    fn with_context<C: fmt::Display>(self, context: impl FnOnce() -> C) -> Result<T, StepError>;
}

impl<T, E: Into<StepError>> Context<T> for Result<T, E> {
    fn context(self, context: impl fmt::Display) -> Result<T, StepError> {
        self.with_context(|| context)
    }

    fn with_context<C: fmt::Display>(self, context: impl FnOnce() -> C) -> Result<T, StepError> {
        self.map_err(|error| StepError::InContext {
            context: context().to_string(),
            source: Box::new(error.into()),
        })
    }
}

impl<T> Context<T> for Option<T> {
    fn context(self, context: impl fmt::Display) -> Result<T, StepError> {
        self.with_context(|| context)
    }

    fn with_context<C: fmt::Display>(self, context: impl FnOnce() -> C) -> Result<T, StepError> {
        self.ok_or_else(|| StepError::message(context().to_string()))
    }
}

/// Returns with a [`StepError`] that consists only of a text, given as a format or an expression.
#[macro_export]
macro_rules! bail {
    ($format:literal $($arguments:tt)*) => {
        return Err($crate::StepError::message(format!($format $($arguments)*)))
    };
    ($text:expr) => { return Err($crate::StepError::message($text)) };
}

/// Returns with an error as [`bail!`], unless a condition holds.
#[macro_export]
macro_rules! ensure {
    ($holds:expr, $($text:tt)*) => {
        let holds: bool = $holds;
        if !holds {
            $crate::bail!($($text)*);
        }
    };
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    #[test]
    fn causes_are_shown_from_the_outside_and_once() {
        let inner = io::Error::other("the disk is full");
        let error = FileError::Io { action: "write", path: "a".into(), source: inner };
        let error = Err::<(), _>(error).context("the sweep").context("model 2");
        let shown = error.expect_err("an error").to_string();
        assert_eq!(shown, "model 2: the sweep: cannot write a: the disk is full");
        let repeated = Err::<(), _>(StepError::message("no b: c")).context("no b");
        assert_eq!(repeated.expect_err("an error").to_string(), "no b: no b: c");
    }

    #[test]
    fn cancellation_is_known_by_its_type_in_any_context() {
        let cancelled: [StepError; 6] = [
            DataError::from(Cancelled).into(),
            KnnError::from(Cancelled).into(),
            ModelError::from(KnnError::from(Cancelled)).into(),
            RepresentError::from(Cancelled).into(),
            SweepError::from(Cancelled).into(),
            ControlError::from(KnnError::from(Cancelled)).into(),
        ];
        for error in cancelled {
            let error = Err::<(), _>(error).context("a model").expect_err("an error");
            assert_eq!((error.was_cancelled(), error.exit_code()), (true, 130));
            assert_eq!(error.to_string(), "interrupted");
        }
        let incomplete = Err::<(), _>(StepError::Incomplete("a shard".to_owned())).context("plan");
        assert_eq!(incomplete.expect_err("an error").exit_code(), 4);
        assert_eq!(StepError::message("no such sensor").exit_code(), 2);
    }

    fn full() -> FileError {
        FileError::io("write", Path::new("a"), io::Error::other("the disk is full"))
    }

    #[test]
    fn disks_are_the_cause_of_errors_of_other_crates_too() {
        let model = ModelError::Search(KnnError::File(full()));
        let of_storage: [StepError; 4] = [
            full().into(),
            DataError::File(full()).into(),
            model.into(),
            io::Error::other("").into(),
        ];
        for error in of_storage {
            let error = Err::<(), _>(error).context("a model").expect_err("an error");
            assert!(error.is_of_storage(), "{error}");
        }
        let month = RolloutError::Month { got: 13 };
        for error in [StepError::Cancelled, StepError::message("no rows"), month.into()] {
            assert!(!error.is_of_storage(), "{error}");
        }
    }

    #[test]
    fn only_results_that_are_missing_or_stale_are_lacking() {
        let text = "run `calib sweep` first".to_owned();
        let in_context =
            |error: StepError| Err::<(), _>(error).context("the sweep").expect_err("an error");
        for error in [StepError::Missing(text.clone()), StepError::Stale(text.clone())] {
            assert!(error.lacks_result());
            let error = in_context(error);
            assert!(error.lacks_result());
            assert_eq!(error.to_string(), "the sweep: run `calib sweep` first");
            assert_eq!(error.exit_code(), 2);
        }
        let month = RolloutError::Month { got: 13 };
        for error in [StepError::Cancelled, StepError::message(text), month.into()] {
            assert!(!in_context(error).lacks_result());
        }
    }
}
