//! Available memory. It is used to refuse work that would not fit, never for results.

use std::{
    fs,
    path::{Path, PathBuf},
    str::FromStr,
};

use calib_data::{DataConfig, table::declared_bytes};
use calib_files::ScratchPlace;

use crate::{
    StepError, ensure,
    output::{bytes, count},
};

/// Returns the configuration for reading a log on this machine. While text files are read, their columns are stored in
/// the system's folder for temporary files. A log that would not fit into memory is refused.
#[must_use]
pub fn on_this_machine(data: DataConfig) -> DataConfig {
    let scratch = ScratchPlace::Disk(std::env::temp_dir());
    DataConfig { scratch, memory: available(), ..data }
}

/// A size as people type it: `16GiB`, `500M`, `2.5 GB`; without a unit, bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MemorySize(pub u64);

impl FromStr for MemorySize {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let unit = text.trim_start_matches(|c: char| c.is_ascii_digit() || c == '.').trim();
        let number = text[..text.len() - unit.len()].trim();
        let number: f64 = number.parse().map_err(|_| no_size(text))?;
        let factor = match unit.to_ascii_lowercase().as_str() {
            "" | "b" => 1.0,
            "k" | "kib" => 1024.0,
            "m" | "mib" => 1024.0 * 1024.0,
            "g" | "gib" => 1024.0 * 1024.0 * 1024.0,
            "t" | "tib" => 1024.0 * 1024.0 * 1024.0 * 1024.0,
            "kb" => 1e3,
            "mb" => 1e6,
            "gb" => 1e9,
            "tb" => 1e12,
            _ => return Err(no_size(text)),
        };
        let bytes = number * factor;
        if bytes >= 1.0 { Ok(Self(bytes as u64)) } else { Err(no_size(text)) }
    }
}

fn no_size(text: &str) -> String {
    format!("expected a size such as 16GiB or 500M, got '{text}'")
}

/// Whether so many bytes are [`available`], or the system does not report it.
pub fn fits(needed: u64) -> bool {
    available().is_none_or(|available| needed <= available)
}

/// Returns the bytes that this process may still take: the memory that the system has available, or less where a
/// control group (a container, a batch job) allows less. `None` where the system does not report it.
pub fn available() -> Option<u64> {
    let system = fs::read_to_string("/proc/meminfo").ok();
    // This includes the memory that the system would free if asked.
    let system = system.and_then(|text| kib_line(&text, "MemAvailable:"));
    let groups = read_proc_self("cgroup").unwrap_or_default();
    let allowed = limits(Path::new("/sys/fs/cgroup"), &groups);
    let addresses = read_proc_self("limits").and_then(|text| {
        let mapped = read_proc_self("status")?;
        addresses_left(&text, &mapped)
    });
    system.into_iter().chain(allowed).chain(addresses).min()
}

/// Reads a file of `/proc/self`, or returns `None` on systems other than Linux.
pub(super) fn read_proc_self(file: &str) -> Option<String> {
    fs::read_to_string(Path::new("/proc/self").join(file)).ok()
}

/// Reads `/proc/PID/stat` of another process, or returns `None` if it has ended or the system is not Linux.
pub(super) fn read_proc_stat(process: u32) -> Option<String> {
    fs::read_to_string(format!("/proc/{process}/stat")).ok()
}

/// Returns the rest of the limit on address space (`ulimit -v`), from `/proc/self/limits` and `/proc/self/status`, or
/// `None` without a limit.
fn addresses_left(limits: &str, status: &str) -> Option<u64> {
    let line = limits.lines().find_map(|line| line.strip_prefix("Max address space"))?;
    let limit: u64 = line.split_whitespace().next()?.parse().ok()?;
    Some(limit.saturating_sub(kib_line(status, "VmSize:")?))
}

/// Returns the line of a plan on memory: the upper bound `total` in bytes, its `parts` in words, and the available
/// memory, where the system reports it. Both numbers exclude calib itself, its code and its threads, which are loaded
/// before anything is planned.
pub fn plan_line(total: u64, parts: &str, available: Option<u64>) -> String {
    let available =
        available.map_or_else(String::new, |there| format!("; {} are available", bytes(there)));
    format!("memory: up to {} beside calib itself ({parts}){available}", bytes(total))
}

/// Refuses work that would take more memory than is available. `what` would take `needed` bytes; `remedy` names a way
/// to take less.
///
/// # Errors
/// If it would.
pub fn require(needed: u64, what: &str, remedy: &str) -> Result<(), NoRoom> {
    match available() {
        Some(available) if needed > available => {
            Err(NoRoom { what: what.to_owned(), needed, available, remedy: remedy.to_owned() })
        }
        _ => Ok(()),
    }
}

/// The error for work that would take more memory than is available.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{what} may take {} of memory and {} are available; {remedy}", bytes(*needed), bytes(*available))]
pub struct NoRoom {
    /// The work.
    what: String,
    /// Needed bytes.
    needed: u64,
    /// Available bytes.
    available: u64,
    /// A way to take less.
    remedy: String,
}

impl From<NoRoom> for StepError {
    fn from(error: NoRoom) -> Self {
        Self::Other(error.into())
    }
}

/// Refuses a log that does not fit in memory, by its footers: a small file may declare any number of rows.
///
/// # Errors
/// If it does not fit, or a footer cannot be read.
pub fn check_log(data: &DataConfig) -> Result<(), StepError> {
    let calib_data::Declared { rows, least_bytes } = calib_data::Declared::of(data)?;
    if let Some(available) = available() {
        ensure!(
            least_bytes <= available,
            "the log in {} declares {} rows, which take {} of memory at least, and {} are available; \
             choose fewer files with data.path, or use a machine with more memory",
            data.path.0.join(", "),
            count(rows as usize),
            bytes(least_bytes),
            bytes(available)
        );
    }
    Ok(())
}

/// Refuses a table that does not fit in memory, by its footer. `names` are the columns to be read, or all.
///
/// # Errors
/// If it does not fit, or the footer cannot be read.
pub fn check_table(path: &Path, names: Option<&[&str]>) -> Result<(), StepError> {
    let what = format!("reading {}", path.display());
    Ok(require(declared_bytes(path, names)?, &what, "take fewer rows of it, or fewer columns")?)
}

/// Returns the bytes of a line such as `VmSize:  1000 kB`, which begins with `name`.
fn kib_line(text: &str, name: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024)
}

/// Returns the rest of the limit of each group that contains the process, and of its parent groups, in both versions of
/// the interface. `groups` is the text of `/proc/self/cgroup`.
fn limits(root: &Path, groups: &str) -> Vec<u64> {
    let mut left = Vec::new();
    for line in groups.lines() {
        let mut fields = line.splitn(3, ':').skip(1);
        let (Some(controllers), Some(path)) = (fields.next(), fields.next()) else { continue };
        let (base, limit, usage) = match controllers {
            "" => (root.to_owned(), "memory.max", "memory.current"),
            memory if memory.split(',').any(|one| one == "memory") => {
                (root.join("memory"), "memory.limit_in_bytes", "memory.usage_in_bytes")
            }
            _ => continue,
        };
        let group: PathBuf = base.join(path.trim_start_matches('/'));
        // Inside a container the path may be the host's; the container's own group is then the root.
        for directory in group.ancestors().take_while(|directory| directory.starts_with(&base)) {
            let [limit, used] = [limit, usage].map(|name| -> Option<u64> {
                fs::read_to_string(directory.join(name)).ok()?.trim().parse().ok()
            });
            let (Some(limit), Some(used)) = (limit, used) else { continue };
            // Cached pages of files count as used, but can be freed, even recently used ones. A log that was just
            // prepared consists entirely of them.
            let told = fs::read_to_string(directory.join("memory.stat")).unwrap_or_default();
            let cached: u64 = told
                .lines()
                .filter_map(|line| -> Option<u64> {
                    let inactive = line.strip_prefix("inactive_file ");
                    inactive.or_else(|| line.strip_prefix("active_file "))?.trim().parse().ok()
                })
                .sum();
            left.push(limit.saturating_sub(used.saturating_sub(cached)));
        }
    }
    left
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Parses a size into bytes.
    fn bytes_of(text: &str) -> Result<u64, String> {
        text.parse::<MemorySize>().map(|size| size.0)
    }

    #[test]
    fn sizes_are_read_as_people_write_them() {
        assert_eq!(bytes_of("16GiB"), Ok(16 << 30));
        assert_eq!(bytes_of("1.5g"), Ok(3 << 29));
        assert_eq!(bytes_of("500 MB"), Ok(500_000_000));
        assert_eq!(bytes_of("4096"), Ok(4096));
        for bad in ["", "much", "12 apples", "-3G", "0", "nanG"] {
            assert!(bytes_of(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn the_systems_own_figure_is_read() {
        let text = "MemTotal:       16 kB\nMemAvailable:    1024 kB\n";
        assert_eq!(kib_line(text, "MemAvailable:"), Some(1 << 20));
        assert_eq!(kib_line("MemTotal: 16 kB\n", "MemAvailable:"), None);
    }

    #[test]
    fn a_plan_says_what_it_leaves_out() {
        let told = "memory: up to 3.0 MiB beside calib itself (2.0 MiB of data)";
        assert_eq!(plan_line(3 << 20, "2.0 MiB of data", None), told);
        let told = format!("{told}; 1.0 GiB are available");
        assert_eq!(plan_line(3 << 20, "2.0 MiB of data", Some(1 << 30)), told);
    }

    #[test]
    fn a_limit_on_addresses_counts_what_is_taken() {
        let limits =
            "Limit  Soft Limit  Hard Limit  Units\nMax address space  4096000  unlimited  bytes\n";
        let status = "Name:\tcalib\nVmSize:\t    1000 kB\n";
        assert_eq!(addresses_left(limits, status), Some(3_072_000));
        let none = "Max address space         unlimited            unlimited            bytes\n";
        assert_eq!(addresses_left(none, status), None);
    }

    fn write(root: &Path, name: &str, text: &str) {
        let path = root.join(name);
        fs::create_dir_all(path.parent().expect("below the root")).expect("writable");
        fs::write(path, text).expect("writable");
    }

    #[test]
    fn a_group_and_those_around_it_may_allow_less() {
        let root = tempfile::tempdir().expect("a directory");
        write(root.path(), "job/memory.max", "1000\n");
        write(root.path(), "job/memory.current", "600\n");
        write(root.path(), "job/memory.stat", "anon 300\ninactive_file 150\nactive_file 100\n");
        write(root.path(), "job/step/memory.max", "max\n");
        write(root.path(), "job/step/memory.current", "10\n");
        assert_eq!(limits(root.path(), "0::/job/step\n"), [650]);
        write(root.path(), "memory/old/memory.limit_in_bytes", "500");
        write(root.path(), "memory/old/memory.usage_in_bytes", "600");
        assert_eq!(limits(root.path(), "3:cpu:/x\n4:cpu,memory:/old\n"), [0]);
        assert!(limits(root.path(), "0::/elsewhere\n").is_empty());
    }
}
