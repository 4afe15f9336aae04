use std::{
    io,
    path::{Path, PathBuf},
};

/// An error of a file, with its path.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// The operating system refused.
    #[error("cannot {action} {}", path.display())]
    Io {
        /// The action: "read", "write", "create" …
        action: &'static str,
        /// The file or directory.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// The file exists, and must be kept.
    #[error("{} is there already; --force replaces it", path.display())]
    Occupied {
        /// The file.
        path: PathBuf,
    },
    /// The output file is also an input.
    #[error("{} is what is read; write to another file", path.display())]
    Input {
        /// The file.
        path: PathBuf,
    },
    /// The file to write exists, and calib did not write it.
    #[error("{} is in the way: calib did not write it; move it, or choose another folder", path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
    },
    /// A folder that calib needs for itself contains other files.
    #[error(
        "{} holds {example}, which calib did not write; choose another folder, or move what is in it",
        folder.display()
    )]
    ForeignFolder {
        /// The folder.
        folder: PathBuf,
        /// One of these files.
        example: String,
    },
    /// A NumPy file has an unexpected format.
    #[error("{} is not a usable NumPy array: {reason}; write it with numpy.save", path.display())]
    Npy {
        /// The file.
        path: PathBuf,
        /// Expected and actual format.
        reason: String,
    },
    /// A file is not a safetensors file, or has content that calib cannot use.
    #[error("{} is not a usable safetensors file: {reason}", path.display())]
    Tensors {
        /// The file.
        path: PathBuf,
        /// Expected and actual format.
        reason: String,
    },
    /// A file has changed since it was written.
    #[error("{} is damaged: {reason}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The evidence.
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
    /// Returns the error that the system refused `action` on `path`.
    pub fn io(action: &'static str, path: &Path, source: io::Error) -> Self {
        Self::Io { action, path: path.to_owned(), source }
    }

    /// Returns the error that the entries of a folder cannot be read.
    pub fn unreadable_folder(folder: &Path, source: io::Error) -> Self {
        Self::io("read the folder", folder, source)
    }

    pub(crate) fn npy(path: &Path, reason: String) -> Self {
        Self::Npy { path: path.to_owned(), reason }
    }

    pub(crate) fn tensors(path: &Path, reason: String) -> Self {
        Self::Tensors { path: path.to_owned(), reason }
    }

    /// Whether the error means that nothing may be written there.
    pub fn is_refusal(&self) -> bool {
        let Self::Io { source, .. } = self else { return false };
        matches!(source.kind(), io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem)
    }

    /// Whether the file does not exist.
    pub fn is_not_found(&self) -> bool {
        matches!(self, Self::Io { source, .. } if source.kind() == io::ErrorKind::NotFound)
    }

    /// Whether the file was read, and its content is not usable.
    pub fn is_of_content(&self) -> bool {
        matches!(
            self,
            Self::Npy { .. } | Self::Tensors { .. } | Self::Damaged { .. } | Self::Json { .. }
        )
    }
}
