use crate::KnnError;

/// The reason why traps cannot be removed.
#[derive(Debug)]
pub(super) enum Halt {
    /// Too many candidates are lost, some query has too few left, or too many exits were needed.
    Lost,
    Error(KnnError),
}

impl<E: Into<KnnError>> From<E> for Halt {
    fn from(error: E) -> Self {
        Self::Error(error.into())
    }
}

impl Halt {
    /// Returns the error of a search in which nothing is left out.
    pub(super) fn into_error(self) -> KnnError {
        match self {
            Self::Error(error) => error,
            Self::Lost => unreachable!("nothing is left out"),
        }
    }
}
