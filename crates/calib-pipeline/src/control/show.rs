use calib_base::{
    StepError,
    outcome::{Outcome, Told},
    output::{Printer, count, counted, percent, significant, table},
};
use calib_control::{BestConstant, Doubt, Importance};
use calib_report::{Decision, Support, listed};
use calib_stats::{Difference, Interval, RankRule};
use calib_study::Job;

use super::{
    described::{ActionLogSummary, ActionTold, SettingTold},
    files::{ControlEvaluation, ControlSummary},
};

/// Candidates that are shown.
const SHOWN: usize = 8;

impl Told for ControlEvaluation {
    fn outcome(&self) -> Outcome {
        if self.verdict.is_supported() { Outcome::Done } else { Outcome::Negative }
    }

    fn tell(&self, _job: &Job, printer: &Printer) -> Result<(), StepError> {
        if printer.is_json() {
            printer.json(&ControlSummary::from(self))?;
        } else {
            let decision = decision(self);
            printer.result(&decision.headline)?;
            for sentence in std::iter::once(decision.plain).chain(sentences(self)) {
                printer.result(&format!("    {sentence}"))?;
            }
            printer.lines(&candidates(self))?;
            printer.lines(&actions(&self.log))?;
        }
        for doubt in &self.verdict.doubts {
            printer.warn(&reason(doubt, self));
        }
        Ok(())
    }
}

/// "2,000 transitions in 50 episodes, 1 of which ends in a terminal".
pub(super) fn held(transitions: usize, episodes: usize, terminals: usize) -> String {
    let verb = if terminals == 1 { "ends" } else { "end" };
    format!(
        "{} in {}, {} of which {verb} in a terminal",
        counted(transitions, "transition"),
        counted(episodes, "episode"),
        count(terminals)
    )
}

/// What the log holds.
pub(super) fn line(log: &ActionLogSummary) -> String {
    held(log.transitions, log.episodes, log.terminals)
}

/// What the log did, and where it says what an action does.
pub(super) fn actions(log: &ActionLogSummary) -> String {
    let row = |action: &ActionTold| {
        let share = action.transitions as f64 / log.transitions as f64;
        vec![
            action.name.clone(),
            count(action.transitions),
            percent(share),
            percent(action.covered),
        ]
    };
    let rows: Vec<_> = log.actions.iter().map(row).collect();
    let first = if log.settings.is_empty() { "action" } else { "nearest level" };
    let levels = table(&[first, "taken", "of the log", "known in states"], &rows);
    if log.settings.is_empty() { levels } else { format!("{}\n{levels}", settings(log)) }
}

/// The ranges of continuous actions.
fn settings(log: &ActionLogSummary) -> String {
    let row = |of: &SettingTold| {
        let quantiles = of.quantiles.iter().map(|&value| significant(value));
        std::iter::once(of.column.clone()).chain(quantiles).collect::<Vec<_>>()
    };
    let rows: Vec<_> = log.settings.iter().map(row).collect();
    table(&["set", "least", "5 %", "median", "95 %", "largest"], &rows)
}

/// Columns of which it is said in which states an action was taken.
const COLUMNS: usize = 6;

/// In which states each action was taken: the middle of each column, and where nine of ten of its values lie.
pub(super) fn states(log: &ActionLogSummary) -> String {
    let row = |action: &ActionTold| {
        let own = action.states.iter().take(COLUMNS).map(|[low, middle, high]| {
            format!("{} ({} to {})", significant(*middle), significant(*low), significant(*high))
        });
        std::iter::once(action.name.clone()).chain(own).collect::<Vec<_>>()
    };
    let rows: Vec<_> = log.actions.iter().map(row).collect();
    let mut header = vec!["taken where"];
    header.extend(log.columns.iter().take(COLUMNS).map(String::as_str));
    table(&header, &rows)
}

/// The best candidates by the rule, in its order, and the default.
pub(super) fn best(evaluation: &ControlEvaluation, count: usize) -> Vec<usize> {
    let (verdict, selection) = (&evaluation.verdict, &evaluation.verdict.selection);
    let mut order: Vec<usize> = (0..evaluation.candidates.len()).collect();
    order.sort_by(|&a, &b| {
        let is_behind = |of: usize| of != verdict.chosen;
        let by_mean = selection.mean_ranks[a].total_cmp(&selection.mean_ranks[b]);
        let by_rule = match verdict.rule {
            RankRule::MeanRank => by_mean,
            RankRule::WorstRank => {
                selection.worst_ranks[a].cmp(&selection.worst_ranks[b]).then(by_mean)
            }
        };
        by_rule.then(is_behind(a).cmp(&is_behind(b))).then(a.cmp(&b))
    });
    order.truncate(count);
    order.extend(verdict.default.filter(|of| !order.contains(of)));
    order
}

/// The best candidates by the rule, and what is compared with them.
fn candidates(evaluation: &ControlEvaluation) -> String {
    let (verdict, selection) = (&evaluation.verdict, &evaluation.verdict.selection);
    let order = best(evaluation, SHOWN);
    let resamples = verdict.chosen_of_resamples.iter().sum::<usize>().max(1) as f64;
    let row = |&candidate: &usize| {
        let mark = match candidate {
            of if of == verdict.chosen => "chosen",
            of if Some(of) == verdict.default => "default",
            _ => "",
        };
        let fitted = evaluation.fitted_q_evaluation[candidate];
        let mut row = vec![
            name(evaluation, candidate),
            mark.to_owned(),
            rank(evaluation, candidate),
            significant(selection.mean_errors[candidate]),
            percent(verdict.coverage[candidate].uncovered()),
            percent(verdict.chosen_of_resamples[candidate] as f64 / resamples),
            if fitted.is_finite() { significant(fitted) } else { "diverged".to_owned() },
        ];
        row.extend(evaluation.importance_sampling.iter().flat_map(|of| importance(of[candidate])));
        row
    };
    let rows: Vec<_> = order.iter().map(row).collect();
    let mut header = vec![
        "setting",
        "",
        rank_name(evaluation),
        "model return",
        "not covered",
        "chosen again",
        "fitted Q",
    ];
    if evaluation.importance_sampling.is_some() {
        header.extend(["importance", "of episodes"]);
    }
    table(&header, &rows)
}

/// The rank that the rule goes by.
pub(super) fn rank(evaluation: &ControlEvaluation, candidate: usize) -> String {
    let selection = &evaluation.verdict.selection;
    match evaluation.verdict.rule {
        RankRule::MeanRank => format!("{:.1}", selection.mean_ranks[candidate]),
        RankRule::WorstRank => selection.worst_ranks[candidate].to_string(),
    }
}

/// What it is called.
pub(super) fn rank_name(evaluation: &ControlEvaluation) -> &'static str {
    match evaluation.verdict.rule {
        RankRule::MeanRank => "mean rank",
        RankRule::WorstRank => "worst rank",
    }
}

/// A value by importance sampling, and on how many episodes it rests.
fn importance(of: Importance) -> [String; 2] {
    let value = of.value.map_or_else(|| "none".to_owned(), significant);
    [value, format!("{:.1}", of.effective_episodes)]
}

/// What distinguishes a candidate.
pub(super) fn name(evaluation: &ControlEvaluation, candidate: usize) -> String {
    let fields = &evaluation.fields[candidate];
    if fields.is_empty() {
        return "the agent".to_owned();
    }
    let one = |(field, value): &(String, String)| format!("{field}={value}");
    fields.iter().map(one).collect::<Vec<_>>().join(" ")
}

/// What the decision rests on.
pub(super) fn sentences(evaluation: &ControlEvaluation) -> Vec<String> {
    let verdict = &evaluation.verdict;
    let mut lines = Vec::new();
    match &verdict.over_default {
        _ if verdict.default == Some(verdict.chosen) => {
            lines.push("That is the default.".to_owned());
        }
        Some(over) => lines.push(format!("Over the default: {}.", difference(over))),
        None if verdict.default.is_none() => {
            lines.push("The default is not in the grid.".to_owned());
        }
        None => lines.push("The default diverged in the model as well.".to_owned()),
    }
    let over_random = &verdict.over_random;
    lines.push(if over_random.mean.is_finite() {
        format!("Over a random setting: {}.", difference(over_random))
    } else {
        "A random setting may diverge in the model.".to_owned()
    });
    if let [_, _, ..] = &verdict.kinds[..] {
        let (agree, others): (Vec<_>, Vec<_>) =
            verdict.kinds.iter().partition(|own| own.chosen == verdict.chosen);
        let names: Vec<String> = agree.iter().map(|own| own.kind.name().to_owned()).collect();
        lines.push(match &names[..] {
            [] => "No kind of model alone would choose it.".to_owned(),
            names => format!("Alone, {} would choose the same.", listed(names)),
        });
        for other in others {
            lines.push(format!(
                "Alone, {} would choose {}.",
                other.kind.name(),
                name(evaluation, other.chosen)
            ));
        }
    }
    lines.extend(verdict.constant.as_ref().map(|constant| beside_constant(constant, evaluation)));
    let recorded = verdict.behaviour;
    lines.push(format!(
        "Recorded episodes: mean return {}{}{}.",
        significant(recorded.mean),
        recorded.interval.map_or_else(String::new, interval),
        recorded.best.map_or_else(String::new, |best| format!(", at most {}", significant(best)))
    ));
    lines.push(
        "Returns in the model rank settings. They do not say what the plant will give.".to_owned(),
    );
    lines
}

/// What always taking one action would get, which needs no agent.
fn beside_constant(constant: &BestConstant, evaluation: &ControlEvaluation) -> String {
    let BestConstant { action, mean_return, uncovered, over } = constant;
    let over = over.as_ref().map_or_else(String::new, |over| {
        format!(" The chosen setting: {} beside it.", difference(over))
    });
    format!(
        "Best constant action: always {} gets {} in the model, where {} of its steps are not covered.{over}",
        evaluation.log.actions[*action].name,
        significant(*mean_return),
        percent(*uncovered),
    )
}

/// What to do, as the card of the report.
pub(super) fn decision(evaluation: &ControlEvaluation) -> Decision {
    let verdict = &evaluation.verdict;
    let chosen = name(evaluation, verdict.chosen);
    let (support, badge, headline, plain) = match action(evaluation) {
        Action::Nothing => (
            Support::Unsupported,
            "Nothing to choose",
            "There is one setting, so nothing was chosen.".to_owned(),
            ADD_SETTINGS.to_owned(),
        ),
        Action::Deploy if verdict.default == Some(verdict.chosen) => (
            Support::Supported,
            "Supported by the log",
            format!("Keep the default: {chosen}."),
            format!("It has the best {}, and {DEFAULT}.", rank_name(evaluation)),
        ),
        Action::Deploy => (
            Support::Supported,
            "Supported by the log",
            format!("Deploy {chosen}."),
            format!(
                "It has the best {}.{}",
                rank_name(evaluation),
                verdict.over_default.as_ref().map_or_else(String::new, |over| format!(
                    " Its return beside that of the default: {}. Here {DEFAULT}.",
                    difference(over)
                ))
            ),
        ),
        Action::KeepDefault(default) => (
            Support::KeepDefault,
            "No clear difference",
            format!("Keep the default: {}.", name(evaluation, default)),
            format!(
                "{chosen} is first by {}, but may be no better. Here {DEFAULT}.",
                rank_name(evaluation)
            ),
        ),
        Action::Refuse => (
            Support::Unsupported,
            "Not supported by the log",
            "Deploy nothing on this evidence.".to_owned(),
            format!(
                "First by {} is {chosen}. What stands against it is listed below.",
                rank_name(evaluation)
            ),
        ),
    };
    Decision { support, badge: badge.to_owned(), headline, plain }
}

/// What the default is.
const DEFAULT: &str = "the default is the agent of [control.agent], not what runs on the plant";
/// What to do where there is one setting.
const ADD_SETTINGS: &str = "Add values to [control.grid], such as step_size = [0.003, 0.03, 0.3].";

/// What a verdict tells to do.
enum Action {
    /// There is nothing to choose among.
    Nothing,
    /// Deploy the choice.
    Deploy,
    /// Deploy the default: the choice may be no better.
    KeepDefault(usize),
    /// Deploy nothing.
    Refuse,
}

fn action(evaluation: &ControlEvaluation) -> Action {
    let verdict = &evaluation.verdict;
    let is_about_the_default =
        |doubt: &Doubt| matches!(doubt, Doubt::NotBetterThanDefault | Doubt::NotToldApart);
    let about_the_default = verdict.doubts.iter().all(is_about_the_default);
    match verdict.default.filter(|&default| default != verdict.chosen) {
        _ if evaluation.candidates.len() < 2 => Action::Nothing,
        _ if verdict.is_supported() => Action::Deploy,
        Some(default) if about_the_default => Action::KeepDefault(default),
        _ => Action::Refuse,
    }
}

fn difference(of: &Difference) -> String {
    let sign = if of.mean >= 0.0 { "+" } else { "" };
    let interval = of.interval.map_or_else(String::new, interval);
    format!("{sign}{} in the model, over blocks of the log{interval}", significant(of.mean))
}

fn interval(of: Interval) -> String {
    format!(" (95 %: {} to {})", significant(of.low), significant(of.high))
}

/// Why the log does not support the choice, and what to do.
pub(super) fn reason(doubt: &Doubt, evaluation: &ControlEvaluation) -> String {
    let actions: Vec<String> = evaluation.log.actions.iter().map(|of| of.name.clone()).collect();
    doubt_text(doubt, &actions, &evaluation.log.columns)
}

/// Why the log does not support a choice, and what to do, where actions and columns of the states are called so.
pub fn doubt_text(doubt: &Doubt, actions: &[String], columns: &[String]) -> String {
    match doubt {
        Doubt::ActionNeverTaken { action } => {
            let name = actions.get(*action).map_or("?", String::as_str);
            format!("{name} was never taken: no model knows what it does; record some steps with it")
        }
        Doubt::Uncovered { share } => format!(
            "{} of the chosen setting's steps lie where the log has no such action; record more varied actions, or allow more with control.most_uncovered",
            percent(*share)
        ),
        Doubt::FewTerminals { terminals } => format!(
            "only {} {} in a terminal, and choices depend on what leads there; record more, or allow fewer \
             with control.fewest_terminals",
            counted(*terminals, "episode"),
            if *terminals == 1 { "ends" } else { "end" }
        ),
        Doubt::NotToldApart => {
            "the models together show no clear difference between the settings; sweep settings that differ more, or longer (control.steps)"
                .to_owned()
        }
        Doubt::NotBetterThanDefault => {
            "over blocks of the log there is no clear difference between the chosen setting and the default: keep the default, or sweep with more runs (control.runs) or longer (control.steps)"
                .to_owned()
        }
        Doubt::BelowRecorded { promised, recorded } => format!(
            "the chosen setting gets {} per episode in the model, learning included, and the recorded behaviour got {}: keep that, or let \
             agents learn for longer (control.steps)",
            significant(*promised),
            significant(*recorded)
        ),
        Doubt::AboveRecorded { promised, best } => format!(
            "the model promises {} per episode, and no recorded episode got more than {}: nothing in the record shows that so much is possible; record better episodes, or try the choice where it can do no harm",
            significant(*promised),
            significant(*best)
        ),
        Doubt::WorseThanConstant { action, constant, promised } => format!(
            "always taking {} gets {} per episode in the model, and the chosen setting gets {}, learning included: take that action, or let agents \
             learn for longer (control.steps)",
            actions.get(*action).map_or("?", String::as_str),
            significant(*constant),
            significant(*promised)
        ),
        Doubt::RareTerminals { in_model, in_log } => format!(
            "{} of the chosen setting's steps in the model end an episode in a terminal, and {} of the recorded ones: its agents go where the log hardly shows what ends an episode; record steps there",
            percent(*in_model),
            percent(*in_log)
        ),
        Doubt::Displaced { column, mean, error } => format!(
            "jumps between recorded rows move {} by {} times its recorded range in an episode of the chosen setting in the model (standard error {}), always to the \
             same side: together they undo what its actions do, for example if an actuator was never recorded beyond some level; record steps there, or take the change of \
             the column for the action",
            columns.get(*column).map_or("?", String::as_str),
            significant(*mean),
            significant(*error)
        ),
        Doubt::Diverged => "the chosen setting diverged in a model; sweep smaller step sizes".to_owned(),
    }
}
