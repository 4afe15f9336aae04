//! Files that are complete or absent.
//!
//! Every file of calib is written to a temporary name beside its place, synced and renamed ([`write_atomically`]),
//! so that an interrupted command leaves no half-written file. Arrays are NumPy files ([`write_npy`], [`map_npy`])
//! that Python reads in one line and calib maps. Working arrays that may exceed the memory are nameless mapped
//! files ([`Scratch`]). Data that are only appended and read back are in nameless files ([`Spill`]). Series from
//! elsewhere are read as `f64` from NumPy files of any number type ([`read_array`]).
//! Weights are safetensors files ([`read_tensors`], [`write_tensors`]). Files without another checksum carry their
//! own fingerprint ([`write_sealed_json`], [`read_sealed_tensors`]). Inputs must be files, never pipes
//! ([`open_regular`]). Work that may be killed stores the state from which it resumes in a [`CheckpointFile`]. A
//! record in each folder names the files that calib wrote ([`FolderRecord`]): no others are replaced or removed.
//! Only this crate changes a disk, and every such operation can be made to fail ([`faults`]).
//!
//! ```
//! use calib_files::{read_sealed_json, write_sealed_json};
//!
//! let directory = tempfile::tempdir()?;
//! let path = directory.path().join("manifest.json");
//! write_sealed_json(&path, &[("k", 3)].into_iter().collect::<std::collections::BTreeMap<_, _>>())?;
//! // A byte that differs is found.
//! let edited = std::fs::read_to_string(&path)?.replace('3', "4");
//! std::fs::write(&path, edited)?;
//! assert!(read_sealed_json::<serde_json::Value>(&path).is_err());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod array;
mod atomic;
mod checkpoint_file;
mod disk;
mod error;
pub mod faults;
mod file_stat;
mod fingerprint;
mod json;
mod lock;
mod mapped;
mod name;
mod note;
mod npy;
mod npy_header;
mod open;
mod record;
mod room;
mod scratch;
mod sealed;
mod shared_file;
mod spill;
mod tensors;
mod writer;

pub use array::{Array, array_bytes, read_array};
pub use atomic::{
    Below, ExistingFile, check_output, link_or_copy, remove_temporaries, write_atomically,
    write_new, write_output,
};
pub use checkpoint_file::{CheckpointFile, is_writing_checkpoint};
pub use disk::{
    Announced, Output, TemporaryFolder, create_directory, remove_empty_folder, remove_file,
    remove_known,
};
pub use error::FileError;
pub use file_stat::FileStat;
pub use fingerprint::{Fingerprint, Fingerprinter, fingerprint_file};
pub use json::{read_json, write_json};
pub use lock::{Lock, lock};
pub use mapped::is_mapped;
pub use name::file_name;
pub use note::{remove_note, write_note};
pub use npy::{MappedNpy, NpyElement, map_npy, write_npy};
pub use open::{
    is_same_file, open_regular, open_to_append, read_regular, regular_bytes, require_regular,
};
pub use record::{FolderRecord, LOCK};
pub use room::{free_bytes, taken_bytes};
pub use scratch::{Scratch, ScratchFile, ScratchPlace};
pub use sealed::{read_sealed_json, write_new_sealed_json, write_sealed_json};
pub use shared_file::{HeldFile, HeldReader};
pub use spill::Spill;
pub use tensors::{Tensor, Tensors, read_sealed_tensors, read_tensors, write_tensors};
pub use writer::{host_name, is_temporary};
