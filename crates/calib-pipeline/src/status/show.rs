//! Prints the status of a study as lines and tables.

use calib_base::{
    StepError,
    clock::unix_secs,
    output::{Printer, count, counted, duration_of_secs, number, percent, table},
    progress::CommandState,
};

use super::{
    ranking::{DecidedBy, Ranking},
    standing::{
        ClusterStanding, Command, Overall, StandingOf, StepStanding, StepState, StudyStanding,
    },
};
use crate::control::{ControlRanking, FAILED};

/// Number of settings shown per sensor, unless all are requested.
const SHOWN: usize = 8;

impl StandingOf {
    /// Prints the status: lines and tables for people, JSON for machines.
    ///
    /// # Errors
    /// Returns an error if it cannot be printed.
    pub fn tell(&self, printer: &Printer) -> Result<(), StepError> {
        if printer.is_json() {
            return printer.json(self);
        }
        match self {
            Self::Study(study) => tell_study(study, printer),
            Self::Cluster(cluster) => tell_cluster(cluster, printer),
        }
    }
}

fn tell_study(study: &StudyStanding, printer: &Printer) -> Result<(), StepError> {
    let state = match study.state {
        Overall::Done => "every step is done",
        Overall::Running => "running",
        Overall::Killed => "stopped: a command was killed before its end; run it again to go on",
        Overall::Waiting if study.next.is_some() => "all runs are made",
        Overall::Waiting => "nothing runs, and some steps are to do",
    };
    let next = study.next.as_ref().map(|command| format!("; next: `{command}`"));
    printer.result(&format!("{}: {state}{}", study.study.display(), next.unwrap_or_default()))?;
    for command in &study.commands {
        printer.result(&format!("  {}", command_line(command)))?;
    }
    if let Some(left) = study.secs_left {
        printer.result(&format!("  about {} left", duration_of_secs(left)))?;
    }
    let rows: Vec<Vec<String>> = study.steps.iter().map(step_row).collect();
    printer.lines(&table(&["step", "", "state"], &rows))?;
    for reason in study.steps.iter().filter_map(|step| step.stale.as_ref()) {
        printer.result(&format!("  {reason}"))?;
    }
    tell_rankings(&study.rankings, printer)?;
    if let Some(ranking) = &study.control {
        tell_control(ranking, printer)?;
    }
    match &study.report {
        Some(report) => printer.result(&format!("report: {}", report.display())),
        None => Ok(()),
    }
}

fn command_line(Command { standing, note }: &Command) -> String {
    let since = duration_of_secs(unix_secs() - note.began);
    let place = format!("calib {} (process {} on {})", note.command, note.process, note.host);
    if *standing == CommandState::Killed {
        return format!("{place} was killed; it had begun {since} ago");
    }
    let names = [note.doing.as_deref(), note.part.as_deref()];
    let doing: Vec<&str> = names.into_iter().flatten().collect();
    let task = note.task.as_ref().map(|task| {
        let share = percent(task.done as f64 / task.total.max(1) as f64);
        let left = task.secs_left.map(|left| format!(", {} left of it", duration_of_secs(left)));
        format!("{}: {share}{}", task.name, left.unwrap_or_default())
    });
    let said: Vec<String> = doing.into_iter().map(str::to_owned).chain(task).collect();
    format!("{place} runs since {since}: {}", said.join("; "))
}

fn step_row(step: &StepStanding) -> Vec<String> {
    let names = [step.model.as_deref(), step.deployment.as_deref()];
    let part: Vec<&str> = names.into_iter().flatten().collect();
    let state = match step.state {
        StepState::Done => "done",
        StepState::Running => "running",
        StepState::ToDo => "to do",
    };
    vec![step.step.to_owned(), part.join(", "), state.to_owned()]
}

fn tell_cluster(standing: &ClusterStanding, printer: &Printer) -> Result<(), StepError> {
    standing.cluster.tell(&standing.directory, printer)?;
    tell_rankings(&standing.rankings, printer)
}

fn tell_control(ranking: &ControlRanking, printer: &Printer) -> Result<(), StepError> {
    let [runs, all] = ranking.runs;
    let by = format!("{} of {} runs", count(runs), count(all));
    if ranking.other_runs > 0 {
        printer.result(&format!(
            "not counted: {} of another study, such as one with --set",
            counted(ranking.other_runs, "run")
        ))?;
    }
    if ranking.settings.is_empty() {
        return printer.result(&format!(
            "settings: no ranking yet: {by} are done, and no model has one of every setting"
        ));
    }
    let provisional = if runs < all { "provisional, " } else { "" };
    printer.result(&format!(
        "settings: {provisional}by {by}, in {}",
        counted(ranking.members, "model")
    ))?;
    let settings = ranking.settings.iter().map(|setting| {
        let none = if setting.has_failed { FAILED } else { "diverged" };
        let mean = setting.mean_return.map_or_else(|| none.to_owned(), number);
        SettingRow {
            name: &setting.setting,
            is_default: setting.is_default,
            cells: vec![format!("{:.1}", setting.mean_rank), mean],
        }
    });
    tell_settings(&["setting", "mean rank", "model return"], settings, printer)
}

/// A setting in a ranking, with the cells after its name.
struct SettingRow<'a> {
    name: &'a str,
    is_default: bool,
    cells: Vec<String>,
}

/// Prints a table of the first settings of a ranking and the default, and how many more there are.
fn tell_settings<'a>(
    header: &[&str],
    settings: impl ExactSizeIterator<Item = SettingRow<'a>>,
    printer: &Printer,
) -> Result<(), StepError> {
    let all = settings.len();
    let rows = first_and_default(settings);
    printer.lines(&table(header, &rows))?;
    let more = all - rows.len();
    if more > 0 {
        printer.result(&format!("  and {} more: --json has all", count(more)))?;
    }
    Ok(())
}

/// Returns the rows of the first settings, and of the default at any rank.
fn first_and_default<'a>(settings: impl Iterator<Item = SettingRow<'a>>) -> Vec<Vec<String>> {
    settings
        .enumerate()
        .filter(|(place, setting)| *place < SHOWN || setting.is_default)
        .map(|(_, SettingRow { name, is_default, cells })| {
            let default = if is_default { " (the default)" } else { "" };
            std::iter::once(format!("{name}{default}")).chain(cells).collect()
        })
        .collect()
}

/// Returns " (laplacian, april)", or nothing for a sweep without names.
pub(super) fn in_brackets(model: Option<&str>, deployment: Option<&str>) -> String {
    let names: Vec<&str> = model.into_iter().chain(deployment).collect();
    if names.is_empty() { String::new() } else { format!(" ({})", names.join(", ")) }
}

fn tell_rankings(rankings: &[Ranking], printer: &Printer) -> Result<(), StepError> {
    for ranking in rankings.iter().filter(|ranking| !ranking.settings.is_empty()) {
        let part = in_brackets(ranking.model.as_deref(), ranking.deployment.as_deref());
        let [runs, all] = ranking.runs;
        let provisional = if runs < all { "provisional, " } else { "" };
        let by = format!("{} of {} training runs", count(runs), count(all));
        if !ranking.by_rule {
            printer.result(&format!(
                "{}{part}: no ranking yet: {by} are done, and none of those that decide",
                ranking.sensor
            ))?;
            continue;
        }
        let decide = match ranking.decided_by {
            DecidedBy::Log => "on the log",
            DecidedBy::Models => "in the models",
            DecidedBy::Both => "on the log and in the models",
        };
        printer.result(&format!(
            "{}{part}: {provisional}{by} are made; those {decide} count",
            ranking.sensor
        ))?;
        let settings = ranking.settings.iter().map(|setting| {
            let ratio =
                setting.ratio.map_or_else(|| "diverged".to_owned(), |ratio| format!("{ratio:.3}"));
            let interval = setting.interval.filter(|[low, high]| low < high);
            let interval = interval.map(|[low, high]| format!("{low:.3} to {high:.3}"));
            let diverged =
                if setting.diverged > 0 { count(setting.diverged) } else { String::new() };
            SettingRow {
                name: &setting.setting,
                is_default: setting.is_default,
                cells: vec![ratio, interval.unwrap_or_default(), count(setting.runs), diverged],
            }
        });
        tell_settings(
            &["setting", "error relative to the best", "95 %", "runs that count", "diverged"],
            settings,
            printer,
        )?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ranking_shows_its_first_settings_and_the_default() {
        let names: Vec<String> = (0..12).map(|place| format!("rate={place}")).collect();
        let settings = names.iter().enumerate().map(|(place, name)| SettingRow {
            name,
            is_default: place == 10,
            cells: vec![place.to_string()],
        });
        let rows = first_and_default(settings);
        assert_eq!(rows.len(), SHOWN + 1);
        assert_eq!(rows[0], ["rate=0", "0"]);
        assert_eq!(rows[SHOWN], ["rate=10 (the default)", "10"]);
    }
}
