//! Notes: small files that report the state of work, and that no result depends on.

use std::{
    fs,
    io::{self, Write as _},
    path::Path,
};

use crate::{
    atomic::temporary_in,
    disk::directory_of,
    writer::{is_abandoned, is_temporary},
};

/// Writes a note in place of the previous one, as a whole. Unlike a result it is not synced: a crash of the machine may
/// lose it. Fault injection does not apply either, because the time of the write depends on the clock.
///
/// # Errors
/// If the folder cannot be created or written.
pub fn write_note(path: &Path, text: &[u8]) -> io::Result<()> {
    let directory = directory_of(path);
    fs::create_dir_all(directory)?;
    let mut temporary = temporary_in(directory)?;
    temporary.write_all(text)?;
    temporary.persist(path).map_err(|failed| failed.error)?;
    Ok(())
}

/// Removes a note, and the enclosing folders that become empty, up to `root`. Files that cannot be removed are kept.
pub fn remove_note(path: &Path, root: &Path) {
    let _ = fs::remove_file(path);
    for folder in path.ancestors().skip(1) {
        if !folder.starts_with(root) || fs::remove_dir(folder).is_err() {
            return;
        }
    }
}

/// Removes the half-written notes of killed processes from a folder of notes. Files that cannot be removed are kept.
pub fn remove_half_written_notes(folder: &Path) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if is_temporary(&path) && is_abandoned(&path).is_ok_and(|abandoned| abandoned) {
            let _ = fs::remove_file(&path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::writer::tests::{half_written_by_a_dead_process, half_written_by_this_process};

    #[test]
    fn half_written_notes_of_killed_processes_go() {
        let place = tempfile::tempdir().expect("a directory");
        let own = half_written_by_this_process(place.path());
        let dead = half_written_by_a_dead_process(place.path());
        write_note(&place.path().join("one.json"), b"1").expect("written");
        remove_half_written_notes(place.path());
        assert!(own.exists() && place.path().join("one.json").exists());
        assert!(dead.is_none_or(|dead| !dead.exists()));
        remove_half_written_notes(&place.path().join("missing"));
    }

    #[test]
    fn a_note_goes_with_the_folders_that_were_made_for_it() {
        let place = tempfile::tempdir().expect("a directory");
        let root = place.path().join("results");
        let note = root.join(".progress/one.json");
        write_note(&note, b"1").expect("written");
        write_note(&note, b"2").expect("written again");
        assert_eq!(fs::read(&note).expect("readable"), b"2");
        fs::write(root.join("theirs"), b"").expect("written");
        remove_note(&note, &root);
        assert!(!root.join(".progress").exists() && root.join("theirs").exists());
        fs::remove_file(root.join("theirs")).expect("removed");
        write_note(&note, b"3").expect("written");
        remove_note(&note, &root);
        assert!(!root.exists() && place.path().exists());
    }
}
