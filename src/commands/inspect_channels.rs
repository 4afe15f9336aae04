//! Output of `calib inspect` about each channel.

use calib_data::{AngleOf, ChannelProfile, DropReason, Profile};

use calib_pipeline::{
    Descriptions, Printer, StepError,
    output::{count, counted, number, percent, span, table},
};

use crate::cli::InspectArgs;

/// Most channels that are listed without `--all`.
const LISTED: usize = 60;

/// Tells how many of `total` channels are left after `shown` ones.
fn show_more(shown: usize, total: usize, printer: &Printer) -> Result<(), StepError> {
    match total.saturating_sub(shown) {
        0 => Ok(()),
        left => printer.result(&format!("… and {} more; --all shows them", count(left))),
    }
}

/// Shows the dropped channels with their reasons, and the kept channels. Channels `beside` the states, such as actions, are read even if
/// they miss many values, so they do not count as dropped.
pub(super) fn show_channels(
    profile: &Profile,
    descriptions: &Descriptions,
    beside: &[String],
    args: &InspectArgs,
    printer: &Printer,
) -> Result<(), StepError> {
    let limit = if args.all { profile.channels.len() } else { LISTED };
    let without_column = profile
        .channels
        .iter()
        .filter(|channel| channel.dropped.is_some() && !beside.contains(&channel.name));
    let (modes, dropped): (Vec<&ChannelProfile>, Vec<&ChannelProfile>) = without_column
        .partition(|channel| matches!(channel.dropped, Some(DropReason::OneHot { .. })));
    if !dropped.is_empty() {
        printer.result("")?;
        printer.result(&format!("dropped: {}", counted(dropped.len(), "channel")))?;
        for channel in dropped.iter().take(limit) {
            printer.result(&format!("    {}", without_own_column(channel)))?;
        }
        show_more(limit, dropped.len(), printer)?;
    }
    for channel in modes {
        printer.result("")?;
        printer.result(&without_own_column(channel))?;
    }
    let kept: Vec<&ChannelProfile> = profile.kept().collect();
    if !kept.is_empty() {
        let header = [
            "kept",
            "min",
            "max",
            "mean",
            "missing",
            "constant for up to",
            "smallest change",
            "different values",
            "unit",
        ];
        let described = kept.iter().any(|channel| descriptions.words(&channel.name).is_some());
        let columns = if described { header.len() } else { header.len() - 1 };
        let listed = &kept[..kept.len().min(limit)];
        let rows: Vec<Vec<String>> = listed
            .iter()
            .map(|channel| {
                let mut row = channel_row(channel, profile.rows);
                row.push(descriptions.words(&channel.name).unwrap_or_default());
                row.truncate(columns);
                row
            })
            .collect();
        printer.result("")?;
        printer.lines(&table(&header[..columns], &rows))?;
        show_more(limit, kept.len(), printer)?;
        for channel in listed {
            let notes = notes(channel);
            if let Some(notes) = notes.strip_prefix("; ") {
                printer.result(&format!("{}: {notes}", channel.name))?;
            }
        }
    }
    Ok(())
}

/// Returns notes on a channel: its angle, and the values that are not numbers.
fn notes(channel: &ChannelProfile) -> String {
    let mut notes: Vec<String> = channel.angle.iter().map(AngleOf::told).collect();
    if !channel.words.is_empty() {
        let words = channel.words.iter().map(|(word, times)| format!("\"{word}\" x{times}"));
        notes.push(words.collect::<Vec<_>>().join(", "));
        let recur = channel.words.len() > 1 && channel.words.iter().all(|(_, times)| *times > 1);
        if recur && matches!(channel.dropped, Some(DropReason::Text)) {
            notes.push(format!("preprocess.one_hot = {:?} makes a column of each", channel.name));
        }
    }
    if channel.non_finite > 0 {
        notes.push(format!("{} not finite", count(channel.non_finite as usize)));
    }
    if channel.stood_for_missing > 0 {
        let values = counted(channel.stood_for_missing as usize, "value");
        notes.push(format!("{values} of data.missing_values"));
    }
    if channel.far_out.spikes > 0 {
        notes.push(counted(channel.far_out.spikes as usize, "spike"));
    }
    if notes.is_empty() { String::new() } else { format!("; {}", notes.join("; ")) }
}

/// Returns the name of a channel without a column in the states, and the reason.
fn without_own_column(channel: &ChannelProfile) -> String {
    let why = channel.dropped.as_ref().map(ToString::to_string).unwrap_or_default();
    format!("{}: {why}{}", channel.name, notes(channel))
}

/// Returns the row of a channel in the table; the log has `rows` rows.
fn channel_row(channel: &ChannelProfile, rows: u64) -> Vec<String> {
    let values = channel.values.as_ref();
    let distinct = values.map_or_else(
        || "0".to_owned(),
        |values| values.distinct.map_or_else(|| ">256".to_owned(), |distinct| distinct.to_string()),
    );
    vec![
        channel.name.clone(),
        readable(values.map(|values| values.min)),
        readable(values.map(|values| values.max)),
        readable(values.map(|values| values.mean)),
        percent(channel.missing as f64 / rows as f64),
        values.map_or_else(|| "–".to_owned(), |values| span(values.longest_stuck_secs)),
        readable(values.and_then(|values| values.smallest_change)),
        distinct,
    ]
}

/// Formats the number; a dash stands for a missing one.
fn readable(value: Option<f64>) -> String {
    value.map_or_else(|| "–".to_owned(), number)
}
