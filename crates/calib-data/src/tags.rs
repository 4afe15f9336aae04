//! Reads lists of tags: readable names of channels, and their units.

use std::{collections::BTreeMap, path::Path};

use calib_files::read_regular;

use crate::{
    DataError, Description,
    log::{TAGS, plain},
    text::{Marks, RecordReader, decode, unbracketed},
};

const UNITS: [&str; 7] = ["unit", "units", "uom", "engunits", "engunit", "engineeringunits", "eu"];
const LABELS: [&str; 8] =
    ["description", "desc", "label", "descriptor", "comment", "longname", "text", "displayname"];

/// Reads a list of tags: text with a header and one row per tag. It has a column of names (`tag`, `name`, `point` …),
/// and one of units (`unit`, `uom`, `engunits` …), or of descriptions (`description`, `descriptor`, `label` …), or
/// both. Cells are separated by tabs, semicolons or commas.
///
/// # Errors
/// If the file cannot be read, or no columns have such names.
pub fn read_tags(path: &Path) -> Result<BTreeMap<String, Description>, DataError> {
    let text = read_regular(path)?;
    let text = text.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(&text);
    let first = text.split(|&byte| byte == b'\n').next().unwrap_or_default();
    let separator = b"\t;,".iter().copied().max_by_key(|separator| {
        (memchr::memchr_iter(*separator, first).count(), *separator == b'\t')
    });
    let marks = Marks { separator: separator.unwrap_or(b','), quote: b'"' };
    let mut records = RecordReader::new(text, marks);
    let mut header: Vec<String> = Vec::new();
    if records.advance() {
        header = (0..records.count()).map(|at| plain(&decode(records.cell(at)))).collect();
    }
    let [tag, unit, label] = [&TAGS[..], &UNITS, &LABELS]
        .map(|known| header.iter().position(|name| known.contains(&name.as_str())));
    let (Some(tag), true) = (tag, unit.is_some() || label.is_some()) else {
        let reason = "expected a header with the names of tags (tag, name or point) and units (unit, uom) or descriptions (description, label)";
        return Err(DataError::NotText { path: path.to_owned(), reason: reason.to_owned() });
    };
    let mut tags = BTreeMap::new();
    while records.advance() {
        if let Some(name) = cell(&records, Some(tag)) {
            let unit = cell(&records, unit).map(|unit| unbracketed(&unit).to_owned());
            let unit = unit.filter(|unit| !unit.is_empty());
            tags.insert(name, Description { unit, label: cell(&records, label) });
        }
    }
    Ok(tags)
}

/// Returns a cell of the record; `None` if it is empty or not there.
fn cell(records: &RecordReader<'_>, at: Option<usize>) -> Option<String> {
    let at = at.filter(|&at| at < records.count())?;
    let text = decode(records.cell(at)).trim().to_owned();
    (!text.is_empty()).then_some(text)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn read(text: &str) -> Result<BTreeMap<String, Description>, String> {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("tags.csv");
        fs::write(&path, text).expect("written");
        read_tags(&path).map_err(|error| error.to_string())
    }

    fn described(unit: &str, label: Option<&str>) -> Description {
        Description { unit: Some(unit.to_owned()), label: label.map(str::to_owned) }
    }

    #[test]
    fn units_and_descriptions_are_read() {
        let tags = read(
            "Tag Name;Descriptor;EngUnits\nPIT300;\"pressure; membrane\";kPa\nFIT100;;m3/h\n;x;y\n",
        );
        let tags = tags.expect("a list");
        assert_eq!(tags.len(), 2);
        assert_eq!(tags["PIT300"], described("kPa", Some("pressure; membrane")));
        assert_eq!(tags["FIT100"], described("m3/h", None));
        assert_eq!(read("point,uom\nA,bar\n").expect("a list")["A"], described("bar", None));
    }

    #[test]
    fn what_is_no_list_of_tags_says_what_one_is() {
        for text in ["", "tag,value\nA,1\n", "unit,label\nbar,x\n"] {
            let error = read(text).expect_err("no list");
            assert!(error.contains("names of tags"), "{error}");
        }
    }
}
