//! The results of a shard in one file of JSON lines. The file is always rewritten as a whole, and ends with its
//! fingerprint.

use std::{
    collections::{BTreeMap, btree_map::Entry},
    io::Write as _,
    path::Path,
};

use calib_files::{FileError, Fingerprint, read_regular, write_atomically};
use calib_sweep::{Unit, UnitRuns};
use serde::{Deserialize, Serialize};

use crate::cluster::maker::Maker;

/// The first line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Header {
    pub(crate) format: u32,
    /// The fingerprint of the plan.
    pub(crate) plan: String,
    pub(crate) shard: usize,
    pub(crate) maker: Maker,
}

const FORMAT: u32 = 2;

impl Header {
    pub(crate) fn new(plan: String, shard: usize, maker: &Maker) -> Self {
        Self { format: FORMAT, plan, shard, maker: maker.clone() }
    }
}

/// Whether a shard has all its results.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Completeness {
    Partial,
    Whole,
}

/// The last line.
#[derive(Serialize, Deserialize)]
struct Trailer {
    extent: Completeness,
    units: usize,
    /// Fingerprint of all lines before the last, and of the other fields of the last line.
    fingerprint: Fingerprint,
}

/// Results in order of unit and key. Models and deployments may have units of the same name, made from other
/// inputs.
pub(crate) type UnitsInOrder = BTreeMap<(Unit, String), UnitRuns>;

/// Adds runs to the existing ones.
pub(crate) fn add(units: &mut UnitsInOrder, more: impl IntoIterator<Item = UnitRuns>) {
    for runs in more {
        match units.entry((runs.unit.clone(), runs.key.clone())) {
            Entry::Occupied(mut own) => own.get_mut().merge(runs),
            Entry::Vacant(place) => drop(place.insert(runs)),
        }
    }
}

/// Returns the number of training runs: one for each setting of a unit.
pub(crate) fn training_runs(units: &UnitsInOrder) -> usize {
    units.values().map(|unit| unit.runs.len()).sum()
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ShardResults {
    pub(crate) header: Header,
    pub(crate) units: UnitsInOrder,
    pub(crate) completeness: Completeness,
}

impl ShardResults {
    /// Writes the results, and replaces an existing file.
    ///
    /// # Errors
    /// Returns an error if the file cannot be written.
    pub(crate) fn write(&self, path: &Path) -> Result<(), FileError> {
        let mut text = serde_json::to_vec(&self.header).map_err(|error| unwritten(path, error))?;
        text.push(b'\n');
        for result in self.units.values() {
            serde_json::to_writer(&mut text, result).map_err(|error| unwritten(path, error))?;
            text.push(b'\n');
        }
        let fingerprint = seal(&text, self.completeness, self.units.len());
        let trailer = Trailer { extent: self.completeness, units: self.units.len(), fingerprint };
        serde_json::to_writer(&mut text, &trailer).map_err(|error| unwritten(path, error))?;
        text.push(b'\n');
        write_atomically(path, |file| file.write_all(&text))
    }

    /// Reads the file that [`write`](Self::write) wrote.
    ///
    /// # Errors
    /// Returns an error if the file cannot be read, if a byte differs from what was written, or if it does not have
    /// the form of results.
    pub(crate) fn read(path: &Path) -> Result<Self, FileError> {
        let bytes = read_regular(path)?;
        let lines = bytes.strip_suffix(b"\n").ok_or_else(|| damaged(path, "it is cut off"))?;
        let place = lines.iter().rposition(|byte| *byte == b'\n');
        let (body, last) = bytes.split_at(place.ok_or_else(|| damaged(path, "it is cut off"))? + 1);
        let trailer: Trailer = serde_json::from_slice(last)
            .map_err(|_| damaged(path, "it does not end with its fingerprint"))?;
        let whole = serde_json::to_vec(&trailer).map_err(|source| not_json(path, source))?
            == last[..last.len() - 1];
        if !whole || seal(body, trailer.extent, trailer.units) != trailer.fingerprint {
            return Err(damaged(path, "its content does not have the fingerprint at its end"));
        }
        let mut lines = body.split(|byte| *byte == b'\n').filter(|line| !line.is_empty());
        let header = lines.next().ok_or_else(|| damaged(path, "it is empty"))?;
        let header: Header =
            serde_json::from_slice(header).map_err(|source| not_json(path, source))?;
        let mut units = UnitsInOrder::new();
        for line in lines {
            let result: UnitRuns =
                serde_json::from_slice(line).map_err(|source| not_json(path, source))?;
            units.insert((result.unit.clone(), result.key.clone()), result);
        }
        Ok(Self { header, units, completeness: trailer.extent })
    }
}

fn damaged(path: &Path, reason: &'static str) -> FileError {
    FileError::Damaged { path: path.to_owned(), reason }
}

fn not_json(path: &Path, source: serde_json::Error) -> FileError {
    FileError::Json { path: path.to_owned(), source }
}

fn unwritten(path: &Path, error: serde_json::Error) -> FileError {
    FileError::io("write", path, error.into())
}

fn seal(body: &[u8], completeness: Completeness, units: usize) -> Fingerprint {
    let mut fingerprint = calib_files::Fingerprinter::default();
    fingerprint
        .add(body)
        .add(&[u8::from(completeness == Completeness::Whole)])
        .add(&(units as u64).to_le_bytes());
    fingerprint.finish()
}

#[cfg(test)]
mod tests {
    use std::fs;

    use calib_sweep::EnvironmentId;

    use super::*;

    fn results() -> ShardResults {
        let units = [2, 0, 1].map(|run| {
            let unit = Unit { sensor: "P 1".to_owned(), environment: EnvironmentId::Online, run };
            let key = format!("key {run}");
            let result = UnitRuns {
                key: key.clone(),
                unit: unit.clone(),
                seed: 1,
                start_row: 2,
                not_finite: None,
                runs: BTreeMap::new(),
            };
            ((unit, key), result)
        });
        let maker = Maker {
            tool: "calib".to_owned(),
            commit: None,
            results: 1,
            arithmetic: "a".to_owned(),
        };
        ShardResults {
            header: Header::new("plan".to_owned(), 3, &maker),
            units: units.into(),
            completeness: Completeness::Partial,
        }
    }

    #[test]
    fn come_back_and_no_byte_can_change() {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("0003.units");
        for results in [
            results(),
            ShardResults {
                units: UnitsInOrder::new(),
                completeness: Completeness::Whole,
                ..results()
            },
        ] {
            results.write(&path).expect("written");
            assert_eq!(ShardResults::read(&path).expect("whole"), results);
            let whole = fs::read(&path).expect("readable");
            for place in 0..whole.len() {
                let mut other = whole.clone();
                other[place] ^= 1 << (place % 8);
                fs::write(&path, &other).expect("written");
                assert!(ShardResults::read(&path).is_err(), "byte {place}");
                fs::write(&path, &whole[..place]).expect("written");
                assert!(ShardResults::read(&path).is_err(), "cut at {place}");
            }
            fs::write(&path, [&whole[..], b"\n"].concat()).expect("written");
            assert!(ShardResults::read(&path).is_err(), "longer");
        }
    }
}
