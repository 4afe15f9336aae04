use std::{
    fs::{self, File},
    io::{self, BufWriter, Write},
    path::Path,
};

use crate::FileError;

const PREFIX: &str = ".calib-";
const SUFFIX: &str = ".tmp";

/// Whether `path` has the name of a temporary file of [`write_atomically`]:
/// one that no process writes any more is left over from a kill and may be removed.
pub fn is_temporary(path: &Path) -> bool {
    let name = path.file_name().and_then(|name| name.to_str());
    name.is_some_and(|name| name.starts_with(PREFIX) && name.ends_with(SUFFIX))
}

/// Create `path` and its parents, if they do not exist.
///
/// # Errors
/// If the system refuses.
pub fn create_directory(path: &Path) -> Result<(), FileError> {
    fs::create_dir_all(path).map_err(|source| FileError::io("create the directory", path, source))
}

/// Write `path` as a whole: `fill` writes to a temporary file in the same directory,
/// which is synced and then renamed. After a crash `path` holds the old content or the new.
///
/// # Errors
/// If the directory cannot be written, or `fill` fails; `path` is then untouched.
pub fn write_atomically(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<&mut File>) -> io::Result<()>,
) -> Result<(), FileError> {
    let directory = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    create_directory(directory)?;
    let refused = |source| FileError::io("write", path, source);
    let mut temporary = tempfile::Builder::new()
        .prefix(PREFIX)
        .suffix(SUFFIX)
        .permissions(default_permissions())
        .tempfile_in(directory)
        .map_err(refused)?;
    let mut writer = BufWriter::with_capacity(1 << 20, temporary.as_file_mut());
    fill(&mut writer).and_then(|()| writer.flush()).map_err(refused)?;
    drop(writer);
    temporary.as_file().sync_all().map_err(refused)?;
    temporary.persist(path).map_err(|failed| refused(failed.error))?;
    Ok(())
}

/// Temporary files are private by default; results should be readable like any other file.
#[cfg(unix)]
fn default_permissions() -> fs::Permissions {
    use std::os::unix::fs::PermissionsExt as _;
    fs::Permissions::from_mode(0o666)
}

#[cfg(not(unix))]
fn default_permissions() -> fs::Permissions {
    fs::metadata(".")
        .map_or_else(|_| unreachable!("the working directory exists"), |m| m.permissions())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_content() {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("new/file.txt");
        write_atomically(&path, |file| file.write_all(b"old")).expect("written");
        let failed = write_atomically(&path, |file| {
            file.write_all(b"half of the n")?;
            let mut entries = fs::read_dir(path.parent().expect("has one")).expect("readable");
            assert!(entries.any(|entry| is_temporary(&entry.expect("an entry").path())));
            assert!(!is_temporary(&path));
            Err(io::Error::other("interrupted"))
        });
        assert!(failed.is_err());
        assert_eq!(fs::read(&path).expect("readable"), b"old");
        let left = fs::read_dir(path.parent().expect("has one")).expect("readable").count();
        assert_eq!(left, 1, "no temporary file is left behind");
    }
}
