use std::{
    fs,
    io::{Read as _, Write as _},
    path::{Path, PathBuf},
};

use calib_files::{
    FileError, Fingerprint, Fingerprinter, create_directory, is_temporary, open_regular,
    read_regular, remove_file, remove_known, write_atomically,
};

use crate::index::NeighborLists;

/// Length of a fingerprint in digits.
const DIGITS: usize = 64;

/// Version of the search. It belongs in the key of parts, and in the key of every model with approximate tables.
///
/// Increase it with every change after which a search can find other lists from the same inputs: a corrected search,
/// other prototypes, another meaning of a leaf budget. A build that was interrupted before the change then does not
/// resume from its old parts. Complete approximate tables count as those of another model. Exact tables are the same in
/// every version. If complete ones are wrong, increase the format of the model's manifest as well.
pub const SEARCH_VERSION: u32 = 2;

/// The partial results of a build, so that an interrupted build can resume.
///
/// The queries are searched in an order that follows from the states and the search structure. Each file contains the
/// lists of [`PART_QUERIES`] consecutive queries: the key of the parts, the fingerprint of the rest, neighbours
/// `u32 [query, member, k]` and distances `f32 [query, member, k]`, little-endian. A file is used only if its key is
/// that of the present build.
#[derive(Clone, Debug)]
pub struct Parts {
    directory: PathBuf,
    inputs: String,
    queries: usize,
}

/// Number of queries in a part.
pub const PART_QUERIES: usize = 1 << 16;

impl Parts {
    /// Creates the store of parts in `directory`, which is reserved for them. `inputs` is a fingerprint of states,
    /// segments and settings, from which the model follows.
    pub fn new(directory: PathBuf, inputs: &str) -> Self {
        Self { directory, inputs: inputs.to_owned(), queries: PART_QUERIES }
    }

    /// Sets another part size than [`PART_QUERIES`], for tests.
    #[must_use]
    pub fn of_queries(self, queries: usize) -> Self {
        Self { queries: queries.max(1), ..self }
    }

    pub(crate) fn queries(&self) -> usize {
        self.queries
    }

    /// Removes all parts.
    ///
    /// # Errors
    /// If the directory exists and cannot be removed.
    pub fn remove(&self) -> Result<(), FileError> {
        remove_known(&self.directory, &mut |path| is_part(path) || is_temporary(path))
    }

    /// Opens the parts of a search in this order, and removes those of other searches.
    pub(crate) fn open(&self, order: &[u32], members: usize, k: usize) -> Result<Open, FileError> {
        self.open_of(SEARCH_VERSION, order, members, k)
    }

    /// Opens the parts as [`open`](Self::open), for a search of the given version.
    fn open_of(
        &self,
        search: u32,
        order: &[u32],
        members: usize,
        k: usize,
    ) -> Result<Open, FileError> {
        let numbers = [members as u64, k as u64, self.queries as u64];
        let key = Fingerprinter::default()
            .add(b"parts 2")
            .add(&search.to_le_bytes())
            .add(self.inputs.as_bytes())
            .add(bytemuck::cast_slice(&numbers))
            .add(bytemuck::cast_slice(order))
            .finish();
        let open = Open { directory: self.directory.clone(), key, members, k };
        create_directory(&self.directory)?;
        let listed = fs::read_dir(&self.directory)
            .map_err(|source| FileError::io("read", &self.directory, source))?;
        for entry in listed.flatten() {
            if is_part(&entry.path()) && !open.owns(&entry.path()) {
                remove_file(&entry.path())?;
            }
        }
        Ok(open)
    }
}

/// Whether a file has the name of a part. Files with other names are not touched.
fn is_part(path: &Path) -> bool {
    let number = path.file_name().and_then(|name| name.to_str()?.strip_suffix(".part"));
    number.is_some_and(|number| {
        number.len() >= 8 && number.bytes().all(|digit| digit.is_ascii_digit())
    })
}

/// The parts of one search.
#[derive(Debug)]
pub(crate) struct Open {
    directory: PathBuf,
    key: Fingerprint,
    members: usize,
    k: usize,
}

impl Open {
    fn path(&self, number: usize) -> PathBuf {
        self.directory.join(format!("{number:08}.part"))
    }

    fn owns(&self, path: &Path) -> bool {
        let mut key = [0; DIGITS];
        let read = open_regular(path).ok().and_then(|mut file| file.read_exact(&mut key).ok());
        read.is_some() && key == self.key.as_str().as_bytes()
    }

    /// Reads part `number` of `queries` queries, if this search wrote it and it is intact.
    pub(crate) fn read(&self, number: usize, queries: usize) -> Option<NeighborLists> {
        let bytes = read_regular(&self.path(number)).ok()?;
        let (key, rest) = bytes.split_at_checked(DIGITS)?;
        let (sum, payload) = rest.split_at_checked(DIGITS)?;
        let whole = key == self.key.as_str().as_bytes()
            && sum == Fingerprint::of(payload).as_str().as_bytes();
        let cells = queries * self.members * self.k;
        if !whole || payload.len() != 8 * cells {
            return None;
        }
        let (neighbors, distances) = payload.split_at(4 * cells);
        NeighborLists::from_cells(
            queries,
            self.members,
            self.k,
            numbers(neighbors),
            numbers(distances),
        )
    }

    pub(crate) fn write(&self, number: usize, found: &NeighborLists) -> Result<(), FileError> {
        let (neighbors, distances) = found.cells();
        let neighbors: &[u8] = bytemuck::cast_slice(neighbors);
        let payload = [neighbors, bytemuck::cast_slice(distances)].concat();
        let sum = Fingerprint::of(&payload);
        write_atomically(&self.path(number), |file| {
            file.write_all(self.key.as_str().as_bytes())?;
            file.write_all(sum.as_str().as_bytes())?;
            file.write_all(&payload)
        })
    }
}

/// Reads numbers from bytes that need not be aligned.
fn numbers<T: bytemuck::Pod>(bytes: &[u8]) -> Vec<T> {
    let mut numbers = vec![T::zeroed(); bytes.len() / size_of::<T>()];
    bytemuck::cast_slice_mut(&mut numbers).copy_from_slice(bytes);
    numbers
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_whole_parts_of_the_same_search_count() {
        let directory = tempfile::tempdir().expect("a directory");
        let at = directory.path().join("partial");
        let parts = Parts::new(at.clone(), "inputs");
        let found = NeighborLists::from_cells(2, 1, 2, vec![1, 2, 3, 4], vec![0.5, 1.0, 1.5, 2.0]);
        let found = found.expect("four cells");
        let open = parts.open(&[1, 0, 2], 1, 2).expect("writable");
        assert!(open.read(0, 2).is_none());
        open.write(0, &found).expect("written");
        assert_eq!(open.read(0, 2), Some(found.clone()));
        assert_eq!(open.read(0, 1), None, "another length");

        let mut bytes = fs::read(open.path(0)).expect("readable");
        let last = bytes.len() - 1;
        bytes[last] ^= 1;
        fs::write(open.path(0), &bytes).expect("writable");
        assert_eq!(open.read(0, 2), None, "damaged");
        open.write(0, &found).expect("written");

        assert_eq!(parts.open(&[1, 0, 2], 1, 2).expect("same").read(0, 2), Some(found.clone()));
        for (order, inputs) in [([0, 1, 2], "inputs"), ([1, 0, 2], "others")] {
            open.write(0, &found).expect("written");
            let other = Parts::new(at.clone(), inputs).open(&order, 1, 2).expect("writable");
            assert!(other.read(0, 2).is_none());
            assert_eq!(fs::read_dir(&at).expect("readable").count(), 0, "stale parts are removed");
        }
        open.write(0, &found).expect("written");
        let later = parts.open_of(SEARCH_VERSION + 1, &[1, 0, 2], 1, 2).expect("writable");
        assert!(later.read(0, 2).is_none(), "another version of the search");
        assert_eq!(fs::read_dir(&at).expect("readable").count(), 0);
        parts.remove().expect("removed");
        parts.remove().expect("nothing left to remove");
        assert!(!at.exists());
    }
}
