//! Networks in files, so that they are trained once.

use std::path::{Path, PathBuf};

use calib_core::Seed;
use calib_files::{CheckpointFile, FileError, Tensors};
use calib_nn::{Mlp, Naming};

use super::NetworkConfig;

/// Version of the training. A change of what it returns needs another one.
const VERSION: u32 = 1;
/// Beginning and end of the names of the files.
const NAME: [&str; 2] = ["network-", ".safetensors"];

/// The folder with the networks of a model, `network-M.safetensors` for each ensemble member M.
///
/// A file has a fingerprint of itself and the key of its training. A missing, damaged or other file counts as no network, and is
/// replaced after training. Processes that train at the same time write the same bytes.
#[derive(Clone, Debug)]
pub struct NetworkFiles {
    directory: PathBuf,
    key: String,
}

impl NetworkFiles {
    /// Returns the files in `directory`. `key` identifies the log.
    pub fn new(directory: &Path, key: &str) -> Self {
        Self { directory: directory.to_owned(), key: key.to_owned() }
    }

    /// Whether a file of this name is that of a network.
    pub fn is_name(name: &str) -> bool {
        name.starts_with(NAME[0]) && name.ends_with(NAME[1])
    }

    /// Returns the file of an ensemble member. `seed` is that of all members.
    pub(super) fn of_member(
        &self,
        member: usize,
        config: &NetworkConfig,
        seed: Seed,
    ) -> NetworkFile {
        let path = self.directory.join(format!("{}{member}{}", NAME[0], NAME[1]));
        // `{config:?}` has every field, also one that is added later, and all digits.
        let key = format!("{VERSION} {} {member} {config:?} {}", self.key, seed.get());
        NetworkFile(CheckpointFile::new(path, key))
    }
}

/// The file of one network.
pub(super) struct NetworkFile(CheckpointFile);

impl NetworkFile {
    /// Returns the network, if it was trained in the same way and is not damaged.
    pub(super) fn read(&self) -> Option<Mlp> {
        Mlp::from_tensors(&self.0.read()?, "", Naming::Sequential).ok()
    }

    /// Writes the network. Where nothing may be written, it is left out: each process then trains the same one.
    ///
    /// # Errors
    /// If it cannot be written for another reason.
    pub(super) fn write(&self, network: &Mlp) -> Result<(), FileError> {
        let tensors = network.to_tensors(Naming::Sequential);
        match self.0.write(Tensors { tensors, ..Tensors::default() }) {
            Err(error) if error.is_refusal() => Ok(()),
            written => written,
        }
    }
}
