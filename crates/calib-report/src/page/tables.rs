//! Tables, the data profile, and the instructions to reproduce the report.

use calib_core::count;
use maud::{Markup, html};

use super::document::{Section, SectionEntry};
use super::text::prose;
use crate::duration::duration;
use crate::{
    Cell, Channel, ChannelStatus, DataProfile, JumpStatistics, Report, Reproduction, Setting, Table,
};

/// Longest text, in bytes, that stays on one line.
const SHORT: usize = 24;
/// Longest heading, in bytes, that stays on one line on a narrow screen.
const SHORT_HEAD: usize = 32;

/// Returns a table with a title, a caption and a copy button.
pub(super) fn table(table: &Table, id: &str) -> Markup {
    html! {
        div.table id=(id) {
            div.table-head {
                h3 { (table.title) }
                button.copy type="button" { "Copy table" }
            }
            @if !table.caption.is_empty() { p.caption { (prose(&table.caption)) } }
            (rows(table))
        }
    }
}

/// Returns the table alone, in a box that scrolls sideways.
pub(super) fn rows(table: &Table) -> Markup {
    html! {
        div.scroll tabindex="0" role="region" aria-label=(table.title) {
            table {
                caption.hidden { (table.title) }
                thead { tr { @for column in &table.columns {
                    th.short[column.len() <= SHORT_HEAD] scope="col" { (column) }
                } } }
                tbody {
                    @for (row, cells) in table.rows.iter().enumerate() {
                        tr { @for column in 0..table.columns.len() { (cell(table, cells, row, column)) } }
                    }
                }
            }
        }
    }
}

fn cell(table: &Table, cells: &[Cell], row: usize, column: usize) -> Markup {
    let cell = cells.get(column).unwrap_or(&Cell::Missing);
    let text = cell.to_string();
    let class = match cell {
        Cell::Text(_) | Cell::Setting(Setting::Name(_)) if text.len() > SHORT => "text",
        Cell::Text(_) => "short",
        _ => "number",
    };
    html! {
        @if column == 0 {
            th scope="row" class=(class) { (prose(&text)) }
        } @else if table.is_best(row, column) {
            td class=(class) { strong { (prose(&text)) } }
        } @else {
            td class=(class) { (prose(&text)) }
        }
    }
}

/// Returns the section of jump statistics and of the report's further tables.
pub(super) fn statistics(report: &Report) -> Section {
    let jumps = (!report.jumps.is_empty()).then(|| jumps(&report.jumps));
    let mut body = Vec::new();
    let mut parts = Vec::new();
    for (index, shown) in report.tables.iter().chain(&jumps).enumerate() {
        let id = format!("table-{index}");
        body.push(table(shown, &id));
        parts.push(SectionEntry { id, title: shown.title.clone() });
    }
    let body = html! { @for table in body { (table) } };
    Section { id: "tables", title: "The models in numbers", parts, body }
}

fn jumps(jumps: &[JumpStatistics]) -> Table {
    let columns =
        ["Model", "Member", "Steps", "Jump rate", "Departures", "Mean run length (steps)", "Note"];
    Table {
        title: "Jump statistics".to_owned(),
        caption: "Jump rate: share of rollout steps that did not simply go to the next row of the log. Departures: share that went to \
                  another time of the log. A model that hardly ever departs (below 1 %) replays the log and tells nothing new."
            .to_owned(),
        columns: columns.map(ToOwned::to_owned).to_vec(),
        rows: jumps.iter().map(|jump| {
        vec![
            Cell::Text(jump.model.clone()),
            Cell::Text(jump.member.to_string()),
            Cell::Count(jump.steps),
            Cell::Percent(jump.jump_rate),
            Cell::Percent(jump.departure_rate),
            Cell::Number(jump.mean_run_length),
            jump.note.clone().map_or(Cell::Missing, Cell::Text),
        ]
    }).collect(),
        best: None,
    }
}

/// Returns the section of the data profile.
pub(super) fn data(data: &DataProfile) -> Section {
    let kept = data.channels.iter().filter(|channel| channel.status == ChannelStatus::Kept).count();
    let body = html! {
        dl.facts {
            (fact("Rows", &count(data.rows)))
            (fact("Segments", &count(data.segments)))
            (fact("Sample period", &duration(data.period_secs)))
            (fact("From", &data.first))
            (fact("To", &data.last))
            @if !data.channels.is_empty() {
                (fact("Channels", &format!("{kept} of {} kept", data.channels.len())))
            }
            @for (name, value) in &data.facts { (fact(name, value)) }
        }
        @if !data.channels.is_empty() { (table(&channels(&data.channels), "channels")) }
    };
    Section { id: "data", title: "Data", parts: Vec::new(), body }
}

fn fact(name: &str, value: &str) -> Markup {
    html! { div { dt { (name) } dd { (value) } } }
}

fn channels(channels: &[Channel]) -> Table {
    let columns = ["Channel", "Unit", "Smallest", "Largest", "Missing", "Use"];
    Table {
        title: "Channels".to_owned(),
        caption: "Ranges are in physical units, over all rows from the start of the training range to the end of the held-out period. Missing is a \
                  share of the training rows.".to_owned(),
        columns: columns.map(ToOwned::to_owned).to_vec(),
        rows: channels.iter().map(channel_row).collect(),
        best: None,
    }
}

fn channel_row(channel: &Channel) -> Vec<Cell> {
    vec![
        Cell::Text(channel.name.clone()),
        channel.unit.clone().map_or(Cell::Missing, Cell::Text),
        channel.min.into(),
        channel.max.into(),
        Cell::Percent(channel.missing),
        Cell::Text(match &channel.status {
            ChannelStatus::Kept => "kept".to_owned(),
            ChannelStatus::Dropped(reason) => format!("dropped: {reason}"),
        }),
    ]
}

/// Returns the section with command, study file, versions, seeds and fingerprint.
pub(super) fn reproduction(reproduction: &Reproduction) -> Section {
    let body = html! {
        p { "The same command on the same data with the same versions gives the same numbers, to the byte." }
        (block("Command", &reproduction.command))
        dl.facts {
            (fact("Data fingerprint", &reproduction.fingerprint))
            @for (name, version) in &reproduction.versions { (fact(name, version)) }
            @for (name, seed) in &reproduction.seeds { (fact(&format!("Seed, {name}"), &seed.to_string())) }
        }
        (block("Study file, resolved", &reproduction.study_toml))
    };
    Section { id: "reproduce", title: "Reproduce", parts: Vec::new(), body }
}

fn block(title: &str, text: &str) -> Markup {
    html! {
        div.block {
            div.table-head { h3 { (title) } button.copy type="button" { "Copy" } }
            pre tabindex="0" { code { (text) } }
        }
    }
}
