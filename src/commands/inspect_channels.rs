//! What `calib inspect` shows of each channel.

use calib_data::{AngleOf, ChannelProfile, Profile};

use calib_pipeline::{
    Descriptions, Printer, StepError,
    output::{count, counted, percent, significant, span, table},
};

use crate::cli::InspectArgs;

/// Channels that are listed without `--all`.
const LISTED: usize = 60;

/// The channels: what is dropped and why, and what is kept. Channels `beside` the states, such as actions, are read whatever they miss, so that
/// they are not dropped.
pub(super) fn show_channels(
    profile: &Profile,
    descriptions: &Descriptions,
    beside: &[String],
    args: &InspectArgs,
    printer: &Printer,
) -> Result<(), StepError> {
    let limit = if args.all { profile.channels.len() } else { LISTED };
    let dropped: Vec<&ChannelProfile> = profile
        .channels
        .iter()
        .filter(|channel| channel.dropped.is_some() && !beside.contains(&channel.name))
        .collect();
    let more = |shown: usize, total: usize| match total.saturating_sub(shown) {
        0 => Ok(()),
        left => printer.result(&format!("… and {} more; --all shows them", count(left))),
    };
    if !dropped.is_empty() {
        printer.result("")?;
        printer.result(&format!("dropped: {}", counted(dropped.len(), "channel")))?;
        for channel in dropped.iter().take(limit) {
            let why = channel.dropped.as_ref().map(ToString::to_string).unwrap_or_default();
            printer.result(&format!("    {}: {why}{}", channel.name, notes(channel)))?;
        }
        more(limit, dropped.len())?;
    }
    let kept: Vec<&ChannelProfile> = profile.kept().collect();
    if !kept.is_empty() {
        let header = ["kept", "min", "max", "mean", "missing", "stuck", "step", "distinct", "unit"];
        let described = kept.iter().any(|channel| descriptions.words(&channel.name).is_some());
        let columns = if described { header.len() } else { header.len() - 1 };
        let rows: Vec<Vec<String>> = kept
            .iter()
            .take(limit)
            .map(|channel| {
                let mut row = channel_row(channel, profile.rows);
                row.push(descriptions.words(&channel.name).unwrap_or_default());
                row.truncate(columns);
                row
            })
            .collect();
        printer.result("")?;
        printer.lines(&table(&header[..columns], &rows))?;
        more(limit, kept.len())?;
        for channel in kept.iter().take(limit) {
            let notes = notes(channel);
            if let Some(notes) = notes.strip_prefix("; ") {
                printer.result(&format!("{}: {notes}", channel.name))?;
            }
        }
    }
    Ok(())
}

/// Of which angle a channel is, and what in it was no number.
fn notes(channel: &ChannelProfile) -> String {
    let mut notes: Vec<String> = channel.angle.iter().map(AngleOf::told).collect();
    if !channel.words.is_empty() {
        let words = channel.words.iter().map(|(word, times)| format!("\"{word}\" x{times}"));
        notes.push(words.collect::<Vec<_>>().join(", "));
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

/// What a channel is like in all `rows` of the log.
fn channel_row(channel: &ChannelProfile, rows: u64) -> Vec<String> {
    let values = channel.values.as_ref();
    let distinct = values.map_or_else(
        || "0".to_owned(),
        |values| values.distinct.map_or_else(|| ">256".to_owned(), |distinct| distinct.to_string()),
    );
    vec![
        channel.name.clone(),
        number_text(values.map(|values| values.min)),
        number_text(values.map(|values| values.max)),
        number_text(values.map(|values| values.mean)),
        percent(channel.missing as f64 / rows as f64),
        values.map_or_else(|| "–".to_owned(), |values| span(values.longest_stuck_secs)),
        number_text(values.and_then(|values| values.smallest_change)),
        distinct,
    ]
}

/// The number, or a dash.
fn number_text(value: Option<f64>) -> String {
    value.map_or_else(|| "–".to_owned(), significant)
}
