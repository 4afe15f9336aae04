//! Names that writers of logs give to columns.

pub(crate) const TAGS: [&str; 27] = [
    "tag",
    "tagname",
    "tagid",
    "tagpath",
    "point",
    "pointname",
    "pointid",
    "sensor",
    "sensorname",
    "sensorid",
    "channel",
    "channelname",
    "channelid",
    "signal",
    "signalname",
    "signalid",
    "variable",
    "variablename",
    "name",
    "item",
    "itemname",
    "itemid",
    "metric",
    "metricname",
    "parameter",
    "field",
    "series",
];
pub(super) const VALUES: [&str; 15] = [
    "value",
    "val",
    "values",
    "pv",
    "reading",
    "data",
    "floatvalue",
    "intvalue",
    "doublevalue",
    "numericvalue",
    "numvalue",
    "valuedouble",
    "valuenum",
    "stringvalue",
    "vvalue",
];
/// The same in other languages, which count beside a column of tags only.
pub(super) const FOREIGN_VALUES: [&str; 6] =
    ["wert", "messwert", "valeur", "valor", "valore", "waarde"];
/// Of several, the first here tells best.
pub(super) const QUALITIES: [&str; 12] = [
    "opcquality",
    "qualitydetail",
    "dataintegrity",
    "qualitycode",
    "quality",
    "qual",
    "statuscode",
    "isgood",
    "good",
    "status",
    "goodquality",
    "valuequality",
];
/// Columns beside a sample that are no channels: what is remarked of it.
pub(super) const REMARKS: [&str; 16] = [
    "unit",
    "units",
    "uom",
    "engunits",
    "engineeringunits",
    "description",
    "desc",
    "label",
    "comment",
    "comments",
    "annotated",
    "questionable",
    "substituted",
    "datestring",
    "datevalue",
    "timezone",
];
/// Columns beside a sample that are no channels: where it comes from.
pub(super) const ORIGINS: [&str; 7] =
    ["server", "source", "id", "webid", "path", "wwretrievalmode", "resolution"];
pub(super) const TIMES: [&str; 15] = [
    "timestamp",
    "time",
    "datetime",
    "ts",
    "tstamp",
    "date",
    "timestamputc",
    "timeutc",
    "utctime",
    "datetimeutc",
    "localtime",
    "timestamplocal",
    "sampletime",
    "eventtime",
    "zeit",
];
/// Parts of a time that stand in columns of their own, in their order.
pub(super) const TIME_FIELDS: [&[&str]; 6] = [
    &["year", "yr", "yyyy"],
    &["month", "mon", "mo"],
    &["day", "dd", "dayofmonth"],
    &["hour", "hr", "hh"],
    &["minute", "min", "mins"],
    &["second", "sec", "secs"],
];
/// Columns of words beside one channel that make no long table.
pub(super) const MODES: [&str; 8] =
    ["mode", "state", "phase", "step", "batch", "alarm", "event", "shift"];

/// A name without what writers decorate it with: `_value`, `Tag Name` and `t_stamp` are value, tagname and tstamp.
pub(crate) fn plain(name: &str) -> String {
    name.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect()
}
