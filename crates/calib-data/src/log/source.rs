//! Finds the files that make up the log.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
};

use calib_core::abridged_list;
use calib_files::FileError;

use super::{file::LogFile, partitioned_file::PartitionedFile};
use crate::{DataConfig, DataError, text};

/// Returns the files that `data.path` and `data.partitions` select, each once, in order of their names.
pub(crate) fn find_files(data: &DataConfig) -> Result<Vec<PartitionedFile>, DataError> {
    if data.path.0.is_empty() {
        return Err(DataError::NoPath);
    }
    let mut paths = BTreeSet::new();
    for pattern in &data.path.0 {
        let found = expand(pattern)?;
        if found.is_empty() {
            return Err(DataError::NoFile {
                pattern: pattern.clone(),
                reason: format!(
                    "nothing matches whose name ends in .parquet, .parq, .pq, .csv, .tsv or .txt (.gz, .zst){}",
                    workbook_in(Path::new(pattern))
                ),
            });
        }
        paths.extend(found);
    }
    let mut sources: Vec<PartitionedFile> = paths.into_iter().map(PartitionedFile::of).collect();
    for (key, value) in &data.partitions {
        let available: BTreeSet<String> = sources
            .iter()
            .flat_map(|source| &source.partitions)
            .map(|(key, value)| format!("{key}={value}"))
            .collect();
        sources.retain(|source| source.partitions.get(key) == Some(value));
        if sources.is_empty() {
            let available = if available.is_empty() {
                "no key=value folders".to_owned()
            } else {
                available.into_iter().collect::<Vec<_>>().join(", ")
            };
            return Err(DataError::NoPartition {
                key: key.clone(),
                value: value.clone(),
                available,
            });
        }
    }
    Ok(sources)
}

/// Returns the non-empty files, and a message about the others: a logger that was off writes an empty file. If all
/// files are empty, all are returned.
pub(super) fn without_empty(
    sources: Vec<PartitionedFile>,
) -> Result<(Vec<PartitionedFile>, Option<String>), DataError> {
    let mut empty = Vec::with_capacity(sources.len());
    for source in &sources {
        empty.push(is_text(&source.path) && text::is_empty(&source.path)?);
    }
    let count = empty.iter().filter(|is| **is).count();
    if count == 0 || count == sources.len() {
        return Ok((sources, None));
    }
    let mut flags = empty.iter();
    let (left_out, kept): (Vec<PartitionedFile>, Vec<PartitionedFile>) =
        sources.into_iter().partition(|_| flags.next().is_some_and(|is| *is));
    let names = named(&left_out);
    let told = if count == 1 {
        format!("an empty file is left out: {names}")
    } else {
        format!("{count} empty files are left out: {names}")
    };
    Ok((kept, Some(told)))
}

/// Lists the first of some files.
fn named(files: &[PartitionedFile]) -> String {
    const NAMED: usize = 3;
    abridged_list(files.iter().map(|file| file.path.display()), NAMED)
}

fn expand(pattern: &str) -> Result<Vec<PathBuf>, DataError> {
    let path = Path::new(pattern);
    // A name that exists is literal, even if it has brackets.
    if path.is_file() {
        return Ok(vec![path.to_owned()]);
    }
    if path.is_dir() {
        return logs_in(path);
    }
    if !pattern.contains(['*', '?', '[']) {
        let reason = "there is no such file or folder".to_owned();
        return Err(DataError::NoFile { pattern: pattern.to_owned(), reason });
    }
    let matches = glob::glob(pattern).map_err(|error| DataError::NoFile {
        pattern: pattern.to_owned(),
        reason: format!("the glob pattern is malformed: {error}"),
    })?;
    let mut found = Vec::new();
    for matched in matches {
        let matched = matched.map_err(|error| {
            let path = error.path().to_owned();
            FileError::io("read", &path, error.into())
        })?;
        if matched.is_dir() {
            found.extend(logs_in(&matched)?);
        } else if is_parquet(&matched) || is_text(&matched) {
            found.push(matched);
        }
    }
    Ok(found)
}

/// Returns the message about a workbook in a folder without logs.
fn workbook_in(folder: &Path) -> String {
    let files = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    files
        .filter(|path| {
            let extension =
                path.extension().map(|extension| extension.to_string_lossy().to_lowercase());
            extension.is_some_and(|extension| ["xlsx", "xls", "ods"].contains(&extension.as_str()))
        })
        .min()
        .map_or_else(String::new, |path| {
            format!("; {} is a workbook: save each sheet as CSV", path.display())
        })
}

/// Returns the logs in a folder: Parquet files, or otherwise `.csv` and `.tsv`, or otherwise `.txt`. Text beside
/// Parquet usually describes the log: lists of tags, notes, results of other programs. The same holds for `.txt` beside
/// `.csv`.
fn logs_in(folder: &Path) -> Result<Vec<PathBuf>, DataError> {
    let mut found = Vec::new();
    walk(folder, &mut found)?;
    if has_parquet_logs(&mut found) {
        found.retain(|path| is_parquet(path));
    } else if found.iter().any(|path| !is_plain(path)) {
        found.retain(|path| !is_plain(path));
    } else {
        found.retain(|path| !is_note(path));
    }
    Ok(found)
}

/// Whether some of the files are Parquet logs. If there are text files, results of calib are removed first: a study
/// that lies beside its log writes them there.
fn has_parquet_logs(found: &mut Vec<PathBuf>) -> bool {
    if found.iter().any(|path| !is_parquet(path)) {
        found.retain(|path| !(is_parquet(path) && is_result(path)));
    }
    found.iter().any(|path| is_parquet(path))
}

/// Whether calib wrote a Parquet file as a result. A damaged file does not count as a result: reading it reports the
/// damage.
fn is_result(path: &Path) -> bool {
    let source = PartitionedFile { path: path.to_owned(), partitions: BTreeMap::new() };
    LogFile::open(source).is_ok_and(|file| file.is_result)
}

/// Returns the text files in folders of `data` that are ignored because Parquet lies beside them, in order of their
/// names. They are not read. They may be lists of tags or notes, or a part of the log that must be named explicitly.
///
/// # Errors
/// If a folder cannot be read.
pub fn text_left_alone(data: &DataConfig) -> Result<Vec<PathBuf>, DataError> {
    let named: BTreeSet<PathBuf> = data.path.0.iter().map(PathBuf::from).collect();
    let mut left = BTreeSet::new();
    for folder in data.path.0.iter().map(Path::new).filter(|path| path.is_dir()) {
        let mut found = Vec::new();
        walk(folder, &mut found)?;
        if has_parquet_logs(&mut found) {
            left.extend(
                found
                    .into_iter()
                    .filter(|path| !is_parquet(path) && !is_note(path) && !named.contains(path)),
            );
        }
    }
    Ok(left.into_iter().collect())
}

fn walk(folder: &Path, found: &mut Vec<PathBuf>) -> Result<(), DataError> {
    let entries =
        fs::read_dir(folder).map_err(|source| FileError::unreadable_folder(folder, source))?;
    for entry in entries {
        let entry = entry.map_err(|source| FileError::unreadable_folder(folder, source))?;
        // Hidden files and names with an underscore are temporary and administrative files of other programs.
        let name = entry.file_name();
        if name.to_string_lossy().starts_with(['.', '_']) {
            continue;
        }
        let path = entry.path();
        let kind =
            entry.file_type().map_err(|source| FileError::unreadable_folder(folder, source))?;
        // Linked folders are not followed: they could lead back here.
        if kind.is_dir() {
            walk(&path, found)?;
        } else if path.is_file() && (is_parquet(&path) || is_text(&path)) {
            found.push(path);
        }
    }
    Ok(())
}

pub(super) fn is_parquet(path: &Path) -> bool {
    path.extension().is_some_and(|extension| {
        ["parquet", "parq", "pq"].iter().any(|known| extension.eq_ignore_ascii_case(known))
    })
}

/// Returns the name of a file without compression suffix, in lower case.
fn unpacked(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    let packed = [".gz", ".zst", ".zstd"].iter().find_map(|packed| name.strip_suffix(packed));
    packed.unwrap_or(&name).to_owned()
}

/// Whether the name of a file is usual for text in columns, compressed or not.
pub(super) fn is_text(path: &Path) -> bool {
    let name = unpacked(path);
    [".csv", ".tsv", ".txt"].iter().any(|known| name.ends_with(known))
}

/// Whether the name of a file is usual for text of any kind.
fn is_plain(path: &Path) -> bool {
    let name = unpacked(path);
    Path::new(&name).extension().is_some_and(|extension| extension == "txt")
}

/// Whether the name of a file is usual for notes about a log.
fn is_note(path: &Path) -> bool {
    let name = unpacked(path);
    let notes =
        ["readme", "read_me", "license", "licence", "copying", "changelog", "notes", "citation"];
    is_plain(path) && notes.iter().any(|known| name.starts_with(known))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Paths;

    fn folder(files: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().expect("a folder");
        for file in files {
            let path = folder.path().join(file);
            fs::create_dir_all(path.parent().expect("has one")).expect("created");
            fs::write(path, b"").expect("written");
        }
        folder
    }

    fn names(folder: &Path, patterns: &[&str]) -> Result<Vec<String>, DataError> {
        let mut data = DataConfig {
            path: Paths(patterns.iter().map(|&pattern| pattern.to_owned()).collect()),
            ..DataConfig::default()
        };
        data.resolve(folder);
        let sources = find_files(&data)?;
        Ok(sources
            .iter()
            .map(|source| {
                let path = source.path.strip_prefix(folder).expect("inside");
                path.to_string_lossy().into_owned()
            })
            .collect())
    }

    #[test]
    fn files_folders_and_patterns_are_found_once() {
        let folder = folder(&[
            "a.parquet",
            "b.PQ",
            "c.csv",
            "day/d.parquet",
            "day/.tmp.parquet",
            "_log/e.parquet",
            "x[1].parquet",
        ]);
        let data = DataConfig::at(folder.path().to_owned());
        assert_eq!(text_left_alone(&data).expect("readable"), [folder.path().join("c.csv")]);
        let cases: [(&[&str], &[&str]); 5] = [
            (&["."], &["a.parquet", "b.PQ", "day/d.parquet", "x[1].parquet"]),
            (&["*.parquet", "a.parquet"], &["a.parquet", "x[1].parquet"]),
            (&["d*"], &["day/d.parquet"]),
            (&["x[1].parquet"], &["x[1].parquet"]),
            // A named file is taken whatever its name.
            (&["c.csv"], &["c.csv"]),
        ];
        for (patterns, expected) in cases {
            assert_eq!(names(folder.path(), patterns).expect("found"), expected, "{patterns:?}");
        }
    }

    #[test]
    fn the_pattern_that_finds_nothing_is_named() {
        let folder = folder(&["a.parquet", "c.csv"]);
        for (pattern, part) in [
            ("z.parquet", "z.parquet: there is no such file or folder"),
            ("q*", "q*: nothing matches"),
            ("[", "malformed"),
        ] {
            let error = names(folder.path(), &["a.parquet", pattern]).expect_err("nothing there");
            assert!(error.to_string().contains(part), "{error}");
        }
        let none = find_files(&DataConfig::default()).expect_err("no path");
        assert!(none.to_string().contains("data.path is empty"));
    }

    #[test]
    fn partitions_are_a_filter() {
        let folder = folder(&["well=1/year=2022/a.parquet", "well=2/b.parquet"]);
        let mut data = DataConfig::at(folder.path());
        data.partitions.insert("well".to_owned(), "1".to_owned());
        let sources = find_files(&data).expect("found");
        assert_eq!(sources.len(), 1);
        assert_eq!(sources[0].partitions["year"], "2022");
        data.partitions.insert("well".to_owned(), "3".to_owned());
        let error = find_files(&data).expect_err("no such well").to_string();
        assert_eq!(
            error,
            "data.partitions: no file lies in a folder well=3; there are: well=1, well=2, year=2022"
        );
    }
}
