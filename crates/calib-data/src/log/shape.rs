//! Recognises the shape of a log: a row is a time with all channels, one sample of one tag, or one of the file's only
//! tag.
//!
//! Column names decide if they can, and otherwise the first rows do. Ambiguous files are rejected: a log that is read
//! in the wrong shape loses most of its values silently.

use std::collections::BTreeSet;

use super::{
    column_aliases::{
        FOREIGN_VALUES, MODES, ORIGINS, QUALITIES, REMARKS, TAGS, TIMES, VALUES, plain,
    },
    file::FieldKind,
    filename_tag::tag_of_path,
    head::{Head, HeadColumn},
    side_labels::{SideColumn, side_columns},
    tag_words::{Course, have_levels_of_their_own},
};
use crate::{DataConfig, DataError, Shape, text::Quality};

/// The roles of the columns in a file of samples.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Roles {
    pub(crate) time: usize,
    pub(crate) tag: TagOf,
    /// Columns of the value; in each row the first one with a value counts.
    pub(crate) values: Vec<usize>,
    pub(crate) quality: Option<(usize, Quality)>,
    /// Columns that may name devices.
    pub(crate) sides: Vec<SideColumn>,
    /// The name of the column of tags, if nothing but its words tells that it has them.
    pub(crate) by_words: Option<String>,
}

/// What is said of columns of which nothing but the words tells that they are tags.
pub(crate) fn told_by_words(roles: &[Roles]) -> Vec<String> {
    let columns: BTreeSet<&str> =
        roles.iter().filter_map(|roles| roles.by_words.as_deref()).collect();
    let told = columns.into_iter().map(|column| {
        format!(
            "words in {column:?} change from row to row and are read as tags: if they are states of the plant, set data.shape = \"wide\"; if not, \
             data.shape = \"long\" ends this warning"
        )
    });
    told.collect()
}

/// The source of a tag name.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum TagOf {
    Column(usize),
    File(String),
}

/// A log by its shape.
#[derive(Debug)]
pub(crate) enum Recognised {
    Wide,
    /// The roles for each file.
    Samples(Shape, Vec<Roles>),
    /// Files of one column of values each, all of the same name. They are of a tag each, with these roles [and their
    /// quality](with_quality), if they were recorded at the same time and differ. Otherwise they are wide tables.
    OneColumn(Vec<Roles>),
    Annotated,
}

/// Returns the position of the time column of a file.
pub(crate) fn time_column(head: &Head, columns: &[HeadColumn], data: &DataConfig) -> Option<usize> {
    let named = columns.iter().position(|column| column.name == data.timestamp);
    if named.is_some() {
        return named;
    }
    if data.timestamp != DataConfig::default().timestamp {
        return None;
    }
    let known: Vec<usize> = (0..columns.len())
        .filter(|&column| {
            TIMES.contains(&plain(&columns[column].name).as_str())
                && columns[column].kind != FieldKind::Other
        })
        .collect();
    let times: Vec<usize> =
        (0..columns.len()).filter(|&column| columns[column].kind == FieldKind::Time).collect();
    let both: Vec<usize> = known.iter().copied().filter(|column| times.contains(column)).collect();
    match (&both[..], &known[..], &times[..]) {
        ([one], _, _) | ([], [one], _) => Some(*one),
        // A text column under another name that holds only times. For Parquet, such a column must be named in the
        // study.
        ([], [], [one]) if matches!(head, Head::Text(_)) => Some(*one),
        _ => None,
    }
}

pub(crate) fn recognise(
    heads: &[Head],
    times: &[usize],
    data: &DataConfig,
) -> Result<Recognised, DataError> {
    let mut recognised = recognise_apart(heads, times, data)?;
    if let Recognised::Samples(_, roles) = &mut recognised {
        agree_on_quality(roles)?;
    }
    Ok(recognised)
}

/// Let all files of a log tell what the words and numbers of quality mean.
fn agree_on_quality(roles: &mut [Roles]) -> Result<(), DataError> {
    let qualities = roles.iter_mut().filter_map(|roles| roles.quality.as_mut());
    Quality::agree(qualities.map(|(_, quality)| quality))
        .map_err(|reason| DataError::Shape { reason })
}

/// The roles of the columns of files of a tag each, with the columns of quality of those that have one.
pub(crate) fn with_quality(
    heads: &[Head],
    roles: Vec<Roles>,
    data: &DataConfig,
) -> Result<Vec<Roles>, DataError> {
    let files = heads.iter().zip(roles);
    let known = files.map(|(head, roles)| {
        let column = quality_column(head, &head.columns(), roles.time, data)?;
        Ok(Roles { quality: quality_of(head, column, data)?, ..roles })
    });
    let mut known = known.collect::<Result<Vec<Roles>, DataError>>()?;
    agree_on_quality(&mut known)?;
    Ok(known)
}

/// Recognises the shape of the files, each by its own first rows.
fn recognise_apart(
    heads: &[Head],
    times: &[usize],
    data: &DataConfig,
) -> Result<Recognised, DataError> {
    let annotated = heads.iter().filter(|head| matches!(head, Head::Annotated(..))).count();
    if annotated > 0 {
        return if annotated == heads.len() {
            Ok(Recognised::Annotated)
        } else {
            refuse("some files are annotated CSV of InfluxDB and others are not; name those of one kind with data.path".to_owned())
        };
    }
    if data.shape == Some(Shape::Wide) {
        return Ok(Recognised::Wide);
    }
    let mut long = Vec::with_capacity(heads.len());
    for (head, &time) in heads.iter().zip(times) {
        long.push(long_roles(head, time, data)?);
    }
    if let Some(first) = long.iter().position(Option::is_some) {
        let Some(roles) = long.iter().cloned().collect::<Option<Vec<Roles>>>() else {
            let other = long.iter().position(Option::is_none).unwrap_or(0);
            return refuse(format!(
                "{} is a long table, a row for each sample of a tag, and {} is not; name files of one kind with data.path, or say what all are with data.shape = \"wide\" or \"long\"",
                heads[first].path().display(),
                heads[other].path().display()
            ));
        };
        return Ok(Recognised::Samples(Shape::Long, roles));
    }
    if data.shape == Some(Shape::Long) {
        return refuse(format!(
            "{} has no column that is known to name tags, or none of values; say which they are with data.tag and data.value",
            heads[0].path().display()
        ));
    }
    file_per_tag(heads, times, data)
}

fn refuse<T>(reason: String) -> Result<T, DataError> {
    Err(DataError::Shape { reason })
}

/// Returns the column that `data.{key}` names.
fn named(head: &Head, columns: &[HeadColumn], key: &str, name: &str) -> Result<usize, DataError> {
    match columns.iter().position(|column| column.name == name) {
        Some(column) => Ok(column),
        None => refuse(format!(
            "{} has no column {name:?}, which data.{key} names; give one of its columns",
            head.path().display()
        )),
    }
}

/// Returns the roles of the columns, if the file is a long table.
fn long_roles(head: &Head, time: usize, data: &DataConfig) -> Result<Option<Roles>, DataError> {
    let columns = head.columns();
    let others = (0..columns.len()).filter(|&column| column != time);
    let values: Vec<usize> = if let Some(name) = &data.value {
        vec![named(head, &columns, "value", name)?]
    } else {
        let known = [&VALUES[..], &FOREIGN_VALUES].concat();
        others.clone().filter(|&column| is_called(&columns[column], &known)).collect()
    };
    let tag = match &data.tag {
        Some(name) => Some(named(head, &columns, "tag", name)?),
        None => others
            .clone()
            .filter(|column| !values.contains(column))
            .find(|&column| names_tags(&columns[column])),
    };
    if let (Some(tag), false) = (tag, values.is_empty()) {
        let rest: Vec<&str> = others
            .filter(|&column| column != tag && !values.contains(&column))
            .filter(|&column| {
                columns[column].kind == FieldKind::Number && !is_aside(&columns[column].name)
            })
            .map(|column| columns[column].name.as_str())
            .collect();
        if data.tag.is_none() && data.shape.is_none() && !rest.is_empty() {
            return refuse(format!(
                "{} may be a long table, with tags in {:?}, or a wide one, with channels such as {:?}; say which with data.shape = \"long\" or \"wide\". \
                 If its rows are of several plants, it is wide, and data.where chooses one of them",
                head.path().display(),
                columns[tag].name,
                rest[0]
            ));
        }
        let quality = quality_of(head, quality_column(head, &columns, time, data)?, data)?;
        let mut known = vec![time, tag];
        known.extend(&values);
        known.extend(quality.iter().map(|(column, _)| *column));
        let sides = side_columns(head, &columns, &known, data)?;
        let tag = TagOf::Column(tag);
        return Ok(Some(Roles { time, tag, values, quality, sides, by_words: None }));
    }
    if let Some(tag) = tag.filter(|_| data.tag.is_some()) {
        return refuse(format!(
            "{} has tags in {:?}, and no column is known to hold their values; name it with data.value. If every other column is a channel, the rows are of several plants: \
             data.where chooses one of them, without data.tag",
            head.path().display(),
            columns[tag].name
        ));
    }
    unnamed_roles(head, &columns, time, data)
}

/// Whether a column has one of the known names.
fn is_called(column: &HeadColumn, known: &[&str]) -> bool {
    known.contains(&plain(&column.name).as_str())
}

pub(super) fn names_tags(column: &HeadColumn) -> bool {
    let name = plain(&column.name);
    let known = TAGS.contains(&name.as_str());
    known && (column.kind == FieldKind::Text || name.ends_with("id"))
}

/// Returns the columns of this kind that are neither the time nor about the values.
fn others_with_kind(columns: &[HeadColumn], time: usize, kind: FieldKind) -> Vec<usize> {
    let others = (0..columns.len()).filter(|&column| column != time);
    others
        .filter(|&column| columns[column].kind == kind && !is_aside(&columns[column].name))
        .collect()
}

/// Returns the roles in a table of one column of numbers and columns of words with unknown names: its first rows may
/// decide.
fn unnamed_roles(
    head: &Head,
    columns: &[HeadColumn],
    time: usize,
    data: &DataConfig,
) -> Result<Option<Roles>, DataError> {
    let numbers = others_with_kind(columns, time, FieldKind::Number);
    let [value] = numbers[..] else { return Ok(None) };
    let is_narrow = columns.len() <= 3;
    let (mut alternating, mut staying) = (Vec::new(), Vec::new());
    let mut has_states = false;
    for words in others_with_kind(columns, time, FieldKind::Text) {
        if MODES.contains(&plain(&columns[words].name).as_str()) {
            has_states = true;
            continue;
        }
        let sample = head.sample(words)?;
        // Text that contains numbers is another channel.
        if !is_narrow && sample.iter().any(|word| word.parse::<f64>().is_ok()) {
            return Ok(None);
        }
        match Course::of(&sample) {
            Course::Constant => {}
            Course::Switches => has_states = true,
            Course::Alternates => alternating.push(words),
            Course::Stays => staying.push(words),
        }
    }
    let called: Vec<usize> =
        alternating.iter().copied().filter(|&column| names_tags(&columns[column])).collect();
    let tag = match (&alternating[..], &called[..], &staying[..]) {
        ([tag], _, []) | (_, [tag], _) => *tag,
        ([tag, ..], ..) => return refuse(asked_for_tag(head, columns, *tag, value)),
        ([], _, [words]) if is_narrow => {
            return refuse(asked_for_tag(head, columns, *words, value));
        }
        ([], ..) => return Ok(None),
    };
    let is_told = data.shape == Some(Shape::Long) || data.value.is_some();
    let name = plain(&columns[value].name);
    let is_value = [&VALUES[..], &FOREIGN_VALUES].concat().contains(&name.as_str());
    let mut by_words = None;
    if !is_told && !names_tags(&columns[tag]) {
        if has_states || !is_value && !have_levels_of_their_own(head, time, tag, value)? {
            return refuse(asked_for_tag(head, columns, tag, value));
        }
        by_words = Some(columns[tag].name.clone());
    }
    let quality = quality_of(head, quality_column(head, columns, time, data)?, data)?;
    let mut known = vec![time, tag, value];
    known.extend(quality.iter().map(|(column, _)| *column));
    let sides = side_columns(head, columns, &known, data)?;
    let (tag, values) = (TagOf::Column(tag), vec![value]);
    Ok(Some(Roles { time, tag, values, quality, sides, by_words }))
}

/// Returns the message about words that may name what was measured.
fn asked_for_tag(head: &Head, columns: &[HeadColumn], words: usize, value: usize) -> String {
    format!(
        "{} has one column of numbers, {value:?}, and words in {words:?}: if the words name what was measured, set data.tag = {words:?} and data.value = {value:?}; \
         else data.shape = \"wide\"",
        head.path().display(),
        value = columns[value].name,
        words = columns[words].name
    )
}

fn quality_column(
    head: &Head,
    columns: &[HeadColumn],
    time: usize,
    data: &DataConfig,
) -> Result<Option<usize>, DataError> {
    let Some(name) = &data.quality else {
        return Ok(QUALITIES.iter().find_map(|known| {
            (0..columns.len())
                .find(|&column| column != time && plain(&columns[column].name) == *known)
        }));
    };
    named(head, columns, "quality", name).map(Some)
}

/// Returns the meaning of the codes in `column`. Only samples have such codes: in a wide log any column may have such a
/// name.
fn quality_of(
    head: &Head,
    column: Option<usize>,
    data: &DataConfig,
) -> Result<Option<(usize, Quality)>, DataError> {
    let Some(column) = column else { return Ok(None) };
    let sample = head.sample(column)?;
    let codes: Vec<&str> = sample.iter().map(String::as_str).collect();
    let columns = head.columns();
    let place = format!("{}, column {:?}", head.path().display(), columns[column].name);
    match Quality::of(&codes, &data.good_quality) {
        Ok(Quality::UnknownWords(reason)) => {
            let quality = Quality::UnknownWords(format!("{place}: {reason}"));
            Ok(Some((column, quality)))
        }
        Ok(quality) => Ok(Some((column, quality))),
        Err(reason) => refuse(format!("{place}: {reason}")),
    }
}

/// Recognises files that hold one tag each.
fn file_per_tag(
    heads: &[Head],
    times: &[usize],
    data: &DataConfig,
) -> Result<Recognised, DataError> {
    let mut single = Vec::with_capacity(heads.len());
    for (head, &time) in heads.iter().zip(times) {
        single.push(single_value(head, time, data)?);
    }
    let is_asked = data.shape == Some(Shape::FilePerTag);
    let Some(files) = single.into_iter().collect::<Option<Vec<Single>>>() else {
        if is_asked {
            return refuse("data.shape is \"file_per_tag\", and a file has several columns of values; name the one to take with data.value".to_owned());
        }
        return Ok(Recognised::Wide);
    };
    let columns: BTreeSet<&str> = files.iter().map(|file| file.name.as_str()).collect();
    let stems: Vec<String> = heads.iter().map(|head| tag_of_path(head.path())).collect();
    let have_one_name = columns.len() == 1;
    let says_nothing =
        |names: &[&str]| files.iter().all(|file| names.contains(&plain(&file.name).as_str()));
    let is_named = is_asked || data.value.is_some() && !data.file_as_prefix;
    let by_file = says_nothing(&VALUES)
        || have_one_name && files.len() > 1 && is_named && says_nothing(&FOREIGN_VALUES);
    let cut_by_date = (by_file || have_one_name) && stems.iter().all(String::is_empty);
    if !is_asked && (files.len() < 2 || cut_by_date) {
        return Ok(Recognised::Wide);
    }
    if have_one_name && !by_file && files.len() > 1 {
        return Ok(one_column(times, stems, &files, data));
    }
    let mut roles = Vec::with_capacity(files.len());
    for (((head, &time), stem), file) in heads.iter().zip(times).zip(stems).zip(files) {
        let tag = if by_file && !stem.is_empty() { stem } else { file.name };
        let quality = quality_of(head, file.quality, data)?;
        let (tag, values) = (TagOf::File(tag), vec![file.value]);
        roles.push(Roles { time, tag, values, quality, sides: Vec::new(), by_words: None });
    }
    Ok(Recognised::Samples(Shape::FilePerTag, roles))
}

/// Recognises files whose only columns of values have the same uninformative name: only their times can decide.
fn one_column(
    times: &[usize],
    stems: Vec<String>,
    files: &[Single],
    data: &DataConfig,
) -> Recognised {
    let differ = stems.iter().any(|stem| *stem != stems[0]);
    if data.file_as_prefix || !differ || stems.iter().any(String::is_empty) {
        return Recognised::Wide;
    }
    let mut roles = Vec::with_capacity(files.len());
    for ((&time, stem), file) in times.iter().zip(stems).zip(files) {
        let (tag, values) = (TagOf::File(stem), vec![file.value]);
        let sides = Vec::new();
        roles.push(Roles { time, tag, values, quality: None, sides, by_words: None });
    }
    Recognised::OneColumn(roles)
}

/// The only column of values in a file, besides the time, the quality and remarks.
struct Single {
    name: String,
    value: usize,
    quality: Option<usize>,
}

fn single_value(head: &Head, time: usize, data: &DataConfig) -> Result<Option<Single>, DataError> {
    let columns = head.columns();
    let quality = quality_column(head, &columns, time, data)?;
    let values: Vec<usize> = match &data.value {
        Some(name) => (0..columns.len()).filter(|&column| columns[column].name == *name).collect(),
        None => (0..columns.len())
            .filter(|&column| !matches!(columns[column].kind, FieldKind::Time | FieldKind::Other))
            .filter(|&column| column != time && Some(column) != quality)
            .filter(|&column| columns.len() <= 2 || !is_aside(&columns[column].name))
            .collect(),
    };
    let [value] = values[..] else { return Ok(None) };
    Ok(Some(Single { name: columns[value].name.clone(), value, quality }))
}

/// Whether a name is usual for columns that describe values.
fn is_aside(name: &str) -> bool {
    [&QUALITIES[..], &REMARKS, &ORIGINS].concat().contains(&plain(name).as_str())
}
