//! Derives the tag of a file from its name.

use std::path::Path;

use super::column_aliases::{TAGS, plain};

/// Returns the tag of a file: its name without compression suffix and without a date at the end; empty if it is only
/// a date. A folder `tag=NAME` takes precedence.
pub(super) fn tag_of_path(path: &Path) -> String {
    let folder = path.parent().into_iter().flat_map(Path::components).find_map(|component| {
        let (key, value) = component.as_os_str().to_str()?.split_once('=')?;
        TAGS.contains(&plain(key).as_str()).then(|| value.to_owned())
    });
    folder.unwrap_or_else(|| {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let endings = [".gz", ".zst", ".zstd", ".csv", ".tsv", ".txt", ".parquet", ".parq", ".pq"];
        let mut stem = name.as_str();
        for ending in endings {
            let cut = stem.len().saturating_sub(ending.len());
            if stem.get(cut..).is_some_and(|end| end.eq_ignore_ascii_case(ending)) {
                stem = &stem[..cut];
            }
        }
        without_date(stem).to_owned()
    })
}

/// Returns the prefix for the channels of each file, with a space: the file name, or the folder if all files have the
/// same name.
pub(super) fn prefixes(paths: &[&Path]) -> Vec<String> {
    let stems: Vec<String> = paths.iter().map(|path| tag_of_path(path)).collect();
    let tell =
        stems.iter().all(|stem| !stem.is_empty()) && stems.iter().any(|stem| *stem != stems[0]);
    let names =
        paths.iter().zip(stems).map(|(path, stem)| if tell { stem } else { folder_of(path) });
    names.map(|name| format!("{name} ")).collect()
}

/// Returns the name of the folder of a file; for a folder `key=value` the value.
fn folder_of(path: &Path) -> String {
    let folder = path.parent().and_then(Path::file_name).unwrap_or_default();
    let folder = folder.to_string_lossy();
    folder.split_once('=').map_or(folder.as_ref(), |(_, value)| value).to_owned()
}

/// Removes a date from the end of a name, from `2024-03` to `2024-03-01T06-00-00`: eight digits or more, or a year
/// and a month with a separator. A single number stays, because it belongs to the tag.
fn without_date(stem: &str) -> &str {
    let mut from =
        stem.trim_end_matches(|c: char| c.is_ascii_digit() || "-_.: T".contains(c)).len();
    // The rest must not end in the middle of a word such as PIT: the T belongs to it.
    while from < stem.len()
        && !stem[from..].starts_with(|c: char| c.is_ascii_digit() || "-_. ".contains(c))
    {
        from += 1;
    }
    let end = &stem[from..];
    let fields: Vec<&str> =
        end.split(|c: char| !c.is_ascii_digit()).filter(|field| !field.is_empty()).collect();
    // Numbers of the tag itself may precede the date: PIT_300_2024-03-01.
    for skipped in 0..fields.len() {
        let date = &fields[skipped..];
        let is_date = match date {
            // 20240001 is a serial number.
            [first, ..] if (8..=14).contains(&first.len()) => {
                is_year(&first[..4]) && is_month(&first[4..6]) && is_day(&first[6..8])
            }
            [first, second, ..] => is_year(first) && is_month(second),
            _ => false,
        };
        if is_date {
            // The field itself, not the first place with the same digits: PI_32023_2023-05.
            let starts = date[0].as_ptr().addr() - stem.as_ptr().addr();
            return stem[..starts].trim_end_matches(['-', '_', '.', ' ']);
        }
    }
    stem
}

fn is_year(field: &str) -> bool {
    field.len() == 4 && ("1970".."2100").contains(&field)
}

fn is_month(field: &str) -> bool {
    field.len() == 2 && ("01"..="12").contains(&field)
}

fn is_day(field: &str) -> bool {
    ("01"..="31").contains(&field)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tag(path: &str) -> String {
        tag_of_path(Path::new(path))
    }

    #[test]
    fn tags_are_told_from_dates_in_names_of_files() {
        assert_eq!(tag("logs/PIT300.csv.gz"), "PIT300");
        assert_eq!(tag("logs/PIT_300_2024-03-01.csv"), "PIT_300");
        assert_eq!(tag("PIT300_20240301T060000.parquet"), "PIT300");
        assert_eq!(tag("2024-03-01.csv"), "");
        assert_eq!(tag("20240301.csv"), "");
        assert_eq!(tag("FIC-2024.csv"), "FIC-2024", "a number of a tag");
        assert_eq!(tag("FIC-2001-45.csv"), "FIC-2001-45", "there is no such month");
        assert_eq!(tag("PI_32023_2023-05.csv"), "PI_32023", "its digits hold a year as well");
        assert_eq!(tag("sensor_20240001.csv"), "sensor_20240001", "a serial number");
        assert_eq!(tag("FIC-20011299.csv"), "FIC-20011299", "there is no such day");
        assert_eq!(tag("PIT300_202403010600.csv"), "PIT300");
        assert_eq!(tag("12.csv"), "12");
        assert_eq!(tag("UNIT 1 FIC.PV.csv"), "UNIT 1 FIC.PV");
        assert_eq!(tag("tag=T-1/part-0.parquet"), "T-1");
        assert_eq!(tag("T.csv"), "T");
    }
}
