//! Whether rollouts of a member return to rows that they have visited: the text about it.

use calib_base::output::{about, count, percent, rounded};
use calib_core::abridged_list;
use calib_data::format_time;
use calib_knn::{ClosedClasses, Recurrence};
use calib_report::{Cell, Table};

use super::{
    manifest::{MemberSummary, ModelManifest},
    member_recurrence::MemberRecurrence,
};

/// A larger share of removed candidates deserves a warning (our choice).
const MUCH: f64 = 0.05;
/// Closed classes with a smaller share of a member's transitions deserve a warning (our choice).
const MOST: f64 = 0.5;
/// Rollouts that are spread over a smaller share of the rows deserve one, too (our choice; members of the studies in
/// `configs/` have 0.03 to 0.5).
const LITTLE: f64 = 0.02;

/// Members with fewer transitions offer few rows for rollouts anyway.
const MANY: usize = 1000;

/// Returns lines about the removal of traps, and about how far rollouts get.
pub(crate) fn lines(member: &MemberRecurrence, transitions: usize) -> [String; 2] {
    let MemberRecurrence { classes, rollouts, .. } = member;
    let spread = match member.covered(transitions) {
        None => "an unknown share of the rows".to_owned(),
        // How many rollouts end in which class is random: twice or half as many are as likely.
        Some(share) if classes.after.count > 1 => {
            format!("roughly {} of the rows", percent(rounded(share, 1)))
        }
        Some(share) => format!("{} of the rows", percent(share)),
    };
    let mix = match rollouts.mixing_steps {
        // Rollouts in a trap soon reach any row of it.
        _ if classes.after.traps > 0 => String::new(),
        Some(steps) => format!(", and forget their start after about {} steps", count(steps)),
        None => ", and do not forget their start in a million steps".to_owned(),
    };
    let end = match rollouts.steps_to_end {
        Some(steps) if classes.after.traps > 0 => {
            format!(", are trapped after about {} steps", about(steps))
        }
        // Nearly every start state is in it.
        Some(steps) if steps < 1.0 => String::new(),
        Some(steps) => {
            format!(", and settle there after about {} steps", about(steps))
        }
        None => ", and settle nowhere in 30,000 steps".to_owned(),
    };
    [
        format!("{}{}", closed(&classes.after), done(member)),
        format!("rollouts are spread over {spread}{mix}{end}"),
    ]
}

fn closed(classes: &ClosedClasses) -> String {
    let sizes = abridged_list(classes.largest.iter().map(|&size| count(size)), 3);
    let noun = if classes.count == 1 { "part of the log" } else { "separate parts of the log" };
    format!("rollouts end in {} {noun} ({sizes} transitions)", classes.count)
}

fn done(member: &MemberRecurrence) -> String {
    let Recurrence { candidates, before, after, left_out, exits, .. } = &member.classes;
    if before.traps == 0 {
        return String::new();
    }
    let traps = if before.traps == 1 { "trap" } else { "traps" };
    if after.traps > 0 {
        return format!(", with {} {traps}", after.traps);
    }
    let share = *left_out as f64 / (*candidates).max(1) as f64;
    let most = member.left_out_times.iter().max_by_key(|stretch| stretch.candidates);
    let times = most.map_or_else(String::new, |most| {
        let [first, last] = most.times.map(format_time);
        format!(", most of them from {first} to {last}")
    });
    let exits = match exits {
        0 => String::new(),
        1 => "; 1 exit added".to_owned(),
        many => format!("; {} exits added", count(*many)),
    };
    let traps_before = before.traps;
    let left_out = count(*left_out);
    format!(
        "; {traps_before} {traps} removed: {left_out} neighbours left out ({}){times}{exits}",
        percent(share)
    )
}

/// Whether a warning applies to a member with this number of transitions.
type Concerns = dyn Fn(&MemberRecurrence, usize) -> bool;

/// Returns warnings about members in which rollouts cannot get far.
pub(crate) fn warnings(members: &[MemberSummary], remove_traps: bool) -> Vec<String> {
    let warnings: [(&Concerns, String); 7] = [
        (
            &|recurrence, _| recurrence.classes.after.traps > 0,
            format!(
                "rollouts of MEMBERS end in a few rows that they never leave{}",
                if remove_traps {
                    ": the plant drifts, and much of the log is unlike any other part. Use a larger preprocess.subsample or more model.neighbors, and leave drifting channels out with data.exclude"
                } else {
                    "; set model.remove_traps = true"
                }
            ),
        ),
        (
            &|recurrence, all| recurrence.classes.after.traps == 0 && recurrence.rollouts.trapped > 0 && all >= MANY,
            "some rollouts of MEMBERS stay among fewer than 100 rows for 10,000 steps before they leave them; try a larger preprocess.subsample (`trapped` in the model's manifest.json counts them)"
                .to_owned(),
        ),
        (
            &|recurrence, _| recurrence.classes.lost as f64 > MUCH * recurrence.classes.candidates as f64,
            format!(
                "MEMBERS: the plant drifts, and more than {} of the log is unlike any other part, so a model can only repeat it. Use a larger preprocess.subsample, or leave drifting channels out with data.exclude",
                percent(MUCH)
            ),
        ),
        (
            &|recurrence, _| recurrence.classes.exits > 0,
            "rollouts of MEMBERS jump to distant states: the plant drifts, and much of the log is unlike any other part, so a model can only repeat it. Use a larger preprocess.subsample, or leave drifting channels out with data.exclude"
                .to_owned(),
        ),
        (
            &|recurrence, _| recurrence.classes.after.count > 1 && recurrence.classes.after.traps == 0,
            "rollouts of MEMBERS never move between separate parts of the log, each a tenth of it or more; let rollouts start in all of them (rollout.start = \"random\"), or try a larger preprocess.subsample"
                .to_owned(),
        ),
        (
            &|recurrence, all| {
                recurrence.classes.after.traps == 0
                    && (recurrence.classes.after.transitions as f64) < MOST * all as f64
            },
            format!(
                "rollouts of MEMBERS end up in less than {} of the rows and stay there, so agents hardly see the others; try a larger preprocess.subsample, and leave totals and counters out with data.exclude",
                percent(MOST)
            ),
        ),
        (
            &|recurrence, all| {
                recurrence.classes.after.traps == 0 && recurrence.covered(all).is_some_and(|share| share < LITTLE)
            },
            format!("rollouts of MEMBERS are spread over less than {} of the rows; try a larger preprocess.subsample, or fewer channels (data.exclude)", percent(LITTLE)),
        ),
    ];
    warnings
        .into_iter()
        .filter_map(|(which, text)| Some(text.replace("MEMBERS", &concerned(members, which)?)))
        .collect()
}

/// Returns the names of the members to which a warning applies, or `None` if it applies to no member.
fn concerned(members: &[MemberSummary], which: &Concerns) -> Option<String> {
    let all = members.iter().enumerate().filter(|(_, member)| {
        let recurrence = member.recurrence.as_ref();
        recurrence.is_some_and(|recurrence| which(recurrence, member.transitions))
    });
    named(all.map(|(number, _)| number))
}

/// Formats "ensemble member 2", "ensemble members 0, 3"; `None` without members.
pub(crate) fn named(members: impl Iterator<Item = usize>) -> Option<String> {
    let numbers: Vec<String> = members.map(|number| number.to_string()).collect();
    let noun = if numbers.len() == 1 { "ensemble member" } else { "ensemble members" };
    (!numbers.is_empty()).then(|| format!("{noun} {}", numbers.join(", ")))
}

/// Returns the report's table about the rollouts of a model, or `None` for networks.
pub fn report_table(model: &ModelManifest) -> Option<Table> {
    let rows: Vec<Vec<Cell>> = model
        .members
        .iter()
        .enumerate()
        .filter_map(|(number, member)| {
            let recurrence = member.recurrence.as_ref()?;
            let Recurrence { candidates, before, after, left_out, exits, .. } = &recurrence.classes;
            Some(vec![
                Cell::Text(format!("ensemble member {number}")),
                sizes_cell(before),
                sizes_cell(after),
                Cell::Number(100.0 * *left_out as f64 / (*candidates).max(1) as f64),
                Cell::Count(*exits as u64),
                Cell::from(recurrence.covered(member.transitions).map(|share| match after.count {
                    0 | 1 => 100.0 * share,
                    _ => rounded(100.0 * share, 1),
                })),
                Cell::from(recurrence.rollouts.mixing_steps.map(|steps| steps as f64)),
                Cell::from(recurrence.rollouts.steps_to_end),
                Cell::Count(recurrence.rollouts.trapped as u64),
            ])
        })
        .collect();
    if rows.is_empty() {
        return None;
    }
    let columns = [
        "",
        "parts as found (transitions in each)",
        "parts (transitions in each)",
        "left out (%)",
        "exits",
        "rows that rollouts are spread over (%)",
        "mixing (steps)",
        "steps to the end",
        "trapped, of 32",
    ];
    Some(Table {
        title: "Where rollouts end".to_owned(),
        caption: format!(
            "{}: a part (a closed class) is a set of transitions that a rollout never leaves. The table has how many there are and, in brackets, how large the largest five are. A part with less than a tenth of the transitions is a trap: calib leaves it out, or gives it an exit. The other columns are from 32 rollouts of 30,000 steps from random states. With several parts, the rows that rollouts are spread over have one digit, and may be half as many, or twice.",
            model.study.model_name()
        ),
        columns: columns.map(str::to_owned).to_vec(),
        rows,
        best: None,
    })
}

/// Returns the number of closed classes, and the sizes of the largest five.
fn sizes_cell(classes: &ClosedClasses) -> Cell {
    let sizes: Vec<String> = classes.largest.iter().take(5).map(|&size| count(size)).collect();
    let more = if classes.count > 5 { ", …" } else { "" };
    Cell::Text(format!("{} ({}{more})", classes.count, sizes.join("; ")))
}

#[cfg(test)]
mod tests {
    use calib_model::RolloutStatistics;

    use super::*;

    #[test]
    fn one_member_is_no_plural() {
        assert_eq!(named([2].into_iter()).as_deref(), Some("ensemble member 2"));
        assert_eq!(named([0, 3].into_iter()).as_deref(), Some("ensemble members 0, 3"));
        assert_eq!(named([].into_iter()), None);
    }

    /// Returns the note about the rows over which rollouts of a member with `classes` closed classes are spread.
    fn spread_line(classes: usize) -> String {
        let after = ClosedClasses { count: classes, ..ClosedClasses::default() };
        let member = MemberRecurrence {
            classes: Recurrence { after, ..Recurrence::default() },
            left_out_times: Vec::new(),
            exit_times: Vec::new(),
            rollouts: RolloutStatistics {
                distinct_rows: 2000,
                trapped: 0,
                effective_rows: Some(2530.0),
                steps_to_end: Some(12_518.3),
                mixing_steps: None,
            },
        };
        lines(&member, 10_000)[1].clone()
    }

    #[test]
    fn what_several_closed_classes_say_is_told_to_one_digit() {
        let one = spread_line(1);
        assert!(one.starts_with("rollouts are spread over 25 % of the rows"), "{one}");
        assert!(one.ends_with("settle there after about 13,000 steps"), "{one}");
        let two = spread_line(2);
        assert!(two.contains("over roughly 30 % of the rows"), "{two}");
    }
}
