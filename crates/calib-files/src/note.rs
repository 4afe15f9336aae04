//! Notes: small files that report the state of work, and that no result depends on.

use std::{
    fs,
    io::{self, Write as _},
    path::Path,
};

use crate::{atomic::temporary_in, disk::directory_of};

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

#[cfg(test)]
mod tests {
    use super::*;

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
