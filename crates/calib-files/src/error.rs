use std::{
    io,
    path::{Path, PathBuf},
};

/// What went wrong with a file, and where.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// The operating system refused.
    #[error("cannot {action} {}", path.display())]
    Io {
        /// "read", "write", "create" …
        action: &'static str,
        /// The file or directory.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// A file that is there, and is to stay.
    #[error("{} is there already; --force replaces it", path.display())]
    Occupied {
        /// The file.
        path: PathBuf,
    },
    /// A file that is to be written, and that is read for it.
    #[error("{} is what is read; write to another file", path.display())]
    Input {
        /// The file.
        path: PathBuf,
    },
    /// A file that is to be written, and that somebody else wrote.
    #[error("{} is in the way: calib did not write it; move it, or choose another folder", path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
    },
    /// A folder that calib would have to itself, and that has something else in it.
    #[error(
        "{} holds {example}, which calib did not write; choose another folder, or move what is in it",
        folder.display()
    )]
    ForeignFolder {
        /// The folder.
        folder: PathBuf,
        /// One of the names in it.
        example: String,
    },
    /// A NumPy file that is not what calib writes or reads.
    #[error("{} is not a usable NumPy array: {reason}; write it with numpy.save", path.display())]
    Npy {
        /// The file.
        path: PathBuf,
        /// What was expected and what was found.
        reason: String,
    },
    /// A CSV file whose records are not equally long, or that holds none.
    #[error("{} is not a usable CSV file: {reason}", path.display())]
    Csv {
        /// The file.
        path: PathBuf,
        /// What was expected and what was found.
        reason: String,
    },
    /// A safetensors file that is none, or that holds what calib cannot use.
    #[error("{} is not a usable safetensors file: {reason}", path.display())]
    Tensors {
        /// The file.
        path: PathBuf,
        /// What was expected and what was found.
        reason: String,
    },
    /// A file that is not what was written.
    #[error("{} is damaged: {reason}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// How that is known.
        reason: &'static str,
    },
    /// A JSON file that does not have the expected form.
    #[error("{} is not valid", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// Line, column and reason.
        source: serde_json::Error,
    },
}

impl FileError {
    /// The system's refusal to do `action` with `path`.
    pub fn io(action: &'static str, path: &Path, source: io::Error) -> Self {
        Self::Io { action, path: path.to_owned(), source }
    }

    /// Whether the file simply does not exist.
    pub fn is_not_found(&self) -> bool {
        matches!(self, Self::Io { source, .. } if source.kind() == io::ErrorKind::NotFound)
    }
}
