use std::{
    path::{Path, PathBuf},
    sync::atomic::{AtomicUsize, Ordering},
};

use crate::{FileError, Tensors, read_sealed_tensors, remove_file, write_tensors};

/// Number of checkpoints that are being written.
static WRITING: AtomicUsize = AtomicUsize::new(0);

/// Whether a checkpoint is being written. Code that has to end this process may wait for it.
pub fn is_writing_checkpoint() -> bool {
    WRITING.load(Ordering::Acquire) > 0
}

/// Name of the metadata text that identifies the work.
const KEY: &str = "key";

/// The file from which interrupted work resumes: arrays, and texts beside them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CheckpointFile {
    path: PathBuf,
    key: String,
}

impl CheckpointFile {
    /// Returns the safetensors file at `path`, which need not exist. `key` identifies everything that the work depends
    /// on.
    pub fn new(path: PathBuf, key: String) -> Self {
        Self { path, key }
    }

    /// Returns the path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Reads the last checkpoint. `None` if the file is missing, damaged or of other work: the work then starts again,
    /// and replaces it.
    pub fn read(&self) -> Option<Tensors> {
        let mut content = read_sealed_tensors(&self.path).ok()?;
        (content.metadata.remove(KEY)? == self.key).then_some(content)
    }

    /// Writes a checkpoint in place of the previous one.
    ///
    /// # Errors
    /// If the file cannot be written, or has a text that is named "key".
    pub fn write(&self, mut content: Tensors) -> Result<(), FileError> {
        if content.metadata.insert(KEY.to_owned(), self.key.clone()).is_some() {
            let reason = format!("the text '{KEY}' names the work");
            return Err(FileError::tensors(&self.path, reason));
        }
        WRITING.fetch_add(1, Ordering::AcqRel);
        let written = write_tensors(&self.path, &content);
        WRITING.fetch_sub(1, Ordering::AcqRel);
        written
    }

    /// Removes the file after the work is finished and its results are stored elsewhere.
    ///
    /// # Errors
    /// If the system refuses.
    pub fn remove(&self) -> Result<(), FileError> {
        remove_file(&self.path)
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::Tensor;

    #[test]
    fn what_was_put_aside_comes_back_and_only_to_the_same_work() {
        let directory = tempfile::tempdir().expect("a directory");
        let checkpoint =
            |key: &str| CheckpointFile::new(directory.path().join("a/state"), key.to_owned());
        let mut content = Tensors {
            tensors: vec![Tensor::flat("weights", vec![0.5, -0.0])],
            ..Tensors::default()
        };
        content.metadata.insert("done".to_owned(), "7".to_owned());
        assert_eq!(checkpoint("a").read(), None);
        checkpoint("a").write(content.clone()).expect("written");
        assert_eq!(checkpoint("a").read(), Some(content.clone()));
        assert_eq!(checkpoint("b").read(), None);
        // A damaged file is ignored, and is replaced.
        let mut bytes = fs::read(checkpoint("a").path()).expect("there");
        *bytes.last_mut().expect("not empty") ^= 1;
        fs::write(checkpoint("a").path(), bytes).expect("written");
        assert_eq!(checkpoint("a").read(), None);
        checkpoint("a").write(content.clone()).expect("replaced");
        assert_eq!(checkpoint("a").read(), Some(content.clone()));
        content.metadata.insert(KEY.to_owned(), "c".to_owned());
        assert!(checkpoint("a").write(content).is_err());
        checkpoint("a").remove().expect("removed");
        checkpoint("a").remove().expect("nothing is left to remove");
        assert_eq!(checkpoint("a").read(), None);
    }
}
