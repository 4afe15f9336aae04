//! Tests of the whole page: complete, well formed, safe, and reproducible.

use calib_agent::SimplePredictor;
use calib_report::{
    ChoiceBaseline, LearningCurves, PartRow, Reason, Recommendation, RecordedFigure, Report,
    RolloutFigure, RolloutGrid, Sensitivity, Setting,
};
use calib_stats::{Estimate, Interval};

use crate::fixture::{self, HOSTILE, report};

/// Elements without an end tag.
const VOID: [&str; 4] = ["meta", "link", "br", "wbr"];

/// Calls `visit` with every tag of `html`, without its angle brackets. Skips the content of scripts and styles.
fn for_each_tag(html: &str, mut visit: impl FnMut(&str)) {
    let mut rest = html;
    while let Some(start) = rest.find('<') {
        rest = &rest[start + 1..];
        let end = rest.find('>').expect("a tag ends");
        let tag = &rest[..end];
        visit(tag);
        rest = &rest[end + 1..];
        for raw in ["script", "style"] {
            if tag.split_whitespace().next() == Some(raw) {
                rest = &rest[rest.find(&format!("</{raw}>")).expect("a raw element ends")..];
            }
        }
    }
}

#[track_caller]
fn assert_balanced(markup: &str) {
    let mut open: Vec<String> = Vec::new();
    for_each_tag(markup, |tag| {
        let name = tag.trim_start_matches('/').split([' ', '/', '\n']).next().unwrap().to_owned();
        if tag.starts_with('!') || tag.ends_with('/') || VOID.contains(&name.as_str()) {
            return;
        }
        if tag.starts_with('/') {
            assert_eq!(open.pop().as_deref(), Some(name.as_str()), "in </{name}>");
        } else {
            open.push(name);
        }
    });
    assert!(open.is_empty(), "still open: {open:?}");
}

#[test]
fn every_element_is_closed() {
    let report = report();
    assert_balanced(&report.html().unwrap());
    let sensitivities = report.sensitivities.iter().map(Sensitivity::figure);
    let learning = report.learning.iter().map(LearningCurves::figure);
    let recorded = report.recorded.iter().map(RecordedFigure::figure);
    let rollouts = report.rollouts.iter().map(RolloutFigure::figure);
    let grids = report.rollout_grids.iter().map(RolloutGrid::figure);
    let all = sensitivities.chain(learning).chain(recorded).chain(rollouts).chain(grids);
    for figure in all {
        assert_balanced(&figure.unwrap().svg());
    }
}

#[test]
fn nothing_is_loaded_from_anywhere() {
    let html = report().html().unwrap().replace("http://www.w3.org/2000/svg", "");
    for needle in ["http:", "https:", "@import", "url(http", " src=", "//cdn"] {
        assert!(!html.contains(needle), "{needle}");
    }
    assert!(html.contains("default-src 'none'"));
}

#[test]
fn hostile_names_stay_text() {
    let html = report().html().unwrap();
    assert!(!html.contains("<script>alert"));
    assert!(!html.contains(HOSTILE));
    assert!(html.contains("&lt;script&gt;alert"), "in text");
    assert!(html.contains("\\u003cscript>alert"), "in the data of the chart");
    let svg = report().sensitivities[0].figure().unwrap().svg();
    assert!(!svg.contains("<script"));
}

#[test]
fn identifiers_are_unique() {
    let html = report().html().unwrap();
    let mut seen = std::collections::BTreeSet::new();
    for part in html.split(" id=\"").skip(1) {
        let id = part.split('"').next().unwrap();
        assert!(seen.insert(id.to_owned()), "{id} occurs twice");
    }
    for part in html.split("href=\"#").skip(1) {
        assert!(seen.contains(part.split('"').next().unwrap()), "{part:.30}");
    }
}

#[test]
fn equal_reports_give_equal_bytes_whatever_was_drawn_before() {
    let first = report();
    let html = first.html().unwrap();
    let png = first.sensitivities[0].figure().unwrap().png().unwrap();
    let second = report();
    for figure in &second.rollouts {
        figure.figure().unwrap().png().unwrap();
    }
    assert_eq!(second.sensitivities[0].figure().unwrap().png().unwrap(), png);
    assert_eq!(second.html().unwrap(), html);
}

/// If log replay decided alone, the page has its content except for models.
#[test]
fn a_page_without_a_model_never_speaks_of_one() {
    let mut report = report();
    for verdict in &mut report.verdicts {
        verdict.model = "log replay".to_owned();
        verdict.reason = Reason::LogReplay { streams: 9 };
        (verdict.members, verdict.worst_rank) = (0, 0);
        verdict.tie_set.clear();
        verdict.alternatives.retain(|other| other.baseline != ChoiceBaseline::LogReplay);
        verdict.notes.clear();
    }
    for sensitivity in &mut report.sensitivities {
        sensitivity.worst_ranks.clear();
    }
    report.learning.retain(|curves| curves.environment.is_shared());
    report.rollouts.clear();
    report.rollout_grids.clear();
    report.jumps.clear();
    report.tables.clear();
    report.warnings.clear();
    let html = report.html().unwrap();
    assert_balanced(&html);
    let body = &html[html.find("<main").unwrap()..html.find("id=\"reproduce\"").unwrap()];
    let body = body.to_lowercase();
    for word in ["model", "member", "rollout", "jump", "worst rank", "ensemble"] {
        let at = body.find(word);
        assert!(at.is_none(), "{word}: {:?}", at.map(|at| &body[at.saturating_sub(80)..at + 40]));
    }
    assert!(body.contains("windows of the replayed log"), "the log decided");
}

#[test]
fn infinities_are_called_by_their_name() {
    let html = report().html().unwrap();
    let body = &html[html.find("<body").unwrap()..html.rfind("<script>").unwrap()];
    assert!(body.contains("diverged"));
    for needle in [">inf<", ">NaN<", "Infinity", ">-inf<", "null regret"] {
        assert!(!body.contains(needle), "{needle}");
    }
}

#[test]
fn intervals_that_leave_a_plot_are_said_to_be_cut() {
    let cut = "Intervals that leave a plot are cut off at its edge";
    let mut report = report();
    assert!(!report.html().unwrap().contains(cut));
    let wild = report.sensitivities[0].errors[0].summaries[0].as_mut().unwrap();
    wild.interval.as_mut().unwrap().high *= 100.0;
    assert!(report.html().unwrap().contains(cut));
}

/// Returns the page without the markup that keeps numbers on one line.
fn flowing(report: &Report) -> String {
    let html = report.html().unwrap().replace('\u{a0}', " ");
    html.replace("<span class=\"nowrap\">", "").replace("</span>", "")
}

#[test]
fn the_page_opens_with_the_verdict() {
    let report = Report { decision: None, ..report() };
    let html = flowing(&report);
    let main = &html[html.find("<main>").unwrap()..];
    let first_text = main
        .split('>')
        .map(|part| part.split('<').next().unwrap())
        .filter(|text| !text.trim().is_empty());
    let opening: Vec<&str> = first_text.take(4).collect();
    insta::assert_snapshot!(opening.join("\n"), @"
    Verdict
    Use learning_rate = 1e-4 for PIT300. Do not deploy learning_rate = 0.01 for TIT101: held-out data contradicts it. On held-out data at least one choice diverged; the default would have cost up to 60 % and choosing by log replay would have cost up to 40 %.
    Good: at most 5 % from the best setting
    Use learning_rate = 1e-4 for PIT300.
    ");
}

#[test]
fn every_part_of_a_run_has_its_advice() {
    let mut report = report();
    assert!(!report.html().unwrap().contains("id=\"parts\""), "no part is known");
    let row = |part, recommendation, value| PartRow {
        part,
        chosen: Setting::from(1e-4),
        error: Some(0.4),
        recommendation,
        simple: Some(SimplePredictor::Persistence),
        compared: Some(SimplePredictor::Persistence),
        ratio: Some(Estimate { value, interval: Some(Interval { low: value / 2.0, high: 2.5 }) }),
    };
    report.verdicts[0].parts = vec![
        row("whole run", Recommendation::Deploy, 0.5),
        row("final quarter", Recommendation::UseSimplePredictor, 2.0),
    ];
    let html = flowing(&report);
    let table = &html[place(&html, "id=\"parts\"")..];
    let table = &table[..table.find("</table>").unwrap()];
    let last = &table[table.rfind("<tr>").unwrap()..];
    for text in ["final quarter", "use persistence", ">2<", ">1<", ">2.5<"] {
        assert!(last.contains(text), "{text}: {last}");
    }
    assert!(table.contains("deploy the choice"), "{table}");
    assert!(
        html.contains("an agent over the whole run, and persistence over the final quarter"),
        "the box of caveats"
    );
}

fn place(html: &str, needle: &str) -> usize {
    html.find(needle).unwrap_or_else(|| panic!("{needle}"))
}

#[test]
fn what_to_deploy_comes_before_the_cards_and_many_cards_wait_behind_the_table() {
    let mut report = report();
    report.decision.as_mut().unwrap().title = "What to deploy".to_owned();
    let html = report.html().unwrap();
    assert!(place(&html, "id=\"decision\"") < place(&html, "class=\"cards\""));
    assert!(place(&html, "class=\"cards\"") < place(&html, "id=\"verdicts\""));
    report.verdicts = report.verdicts.iter().cycle().take(12).cloned().collect();
    let html = report.html().unwrap();
    assert!(place(&html, "id=\"verdicts\"") < place(&html, "class=\"cards\""));
    assert_balanced(&html);
}

#[test]
fn a_report_without_held_out_data_says_so_and_shows_ranks() {
    let mut report = report();
    for verdict in &mut report.verdicts {
        (verdict.online, verdict.grade) = (None, calib_report::Grade::Unchecked);
    }
    for sensitivity in &mut report.sensitivities {
        sensitivity.errors.clear();
    }
    let html = report.html().unwrap();
    assert!(html.contains("Not checked on held-out data"));
    assert!(html.contains("No data was held out"));
    assert!(html.contains("worst rank (1 = best)"));
    assert!(!html.contains("right axis"));
    assert_balanced(&html);
}

#[test]
fn an_empty_report_is_still_a_page() {
    let report = Report {
        title: "Nothing".to_owned(),
        reproduction: report().reproduction,
        ..Report::default()
    };
    let html = report.html().unwrap();
    assert!(html.contains("There is no verdict"));
    assert_balanced(&html);
}

#[test]
fn a_report_with_many_rollouts_stays_small() {
    let mut report = report();
    let mut rollout = fixture::long_rollout();
    rollout.rollouts = vec![rollout.rollouts[0].clone(); 20];
    report.rollouts = vec![rollout; 4];
    let bytes = report.html().unwrap().len();
    assert!(bytes < 2_000_000, "{bytes} bytes");
}

#[test]
fn a_report_of_a_papers_size_holds_every_step_and_stays_small() {
    // Three sensors, five ensemble members and the truth, 30,000 steps each.
    let mut report = report();
    let mut long = fixture::long_rollout();
    long.rollouts = vec![long.rollouts[0].clone(); 5];
    report.rollouts = vec![long; 3];
    report.recorded = vec![fixture::recorded("PIT300", 1200); 3];
    let html = report.html().unwrap();
    assert_eq!(html.matches("\"packed\":").count(), 18);
    assert!(html.len() < 2_500_000, "{} bytes", html.len());
}

#[test]
fn several_models_stand_beside_each_other() {
    let mut report = report();
    let mut other = report.verdicts[0].clone();
    other.model = "other".to_owned();
    other.online.as_mut().unwrap().regret = Some(calib_stats::Bounded { value: 0.9, upper: None });
    other.chosen = 1e-3.into();
    // The order of models is not a preference.
    report.verdicts.insert(0, other);
    let html = flowing(&report);
    assert!(html.contains("<h3>other: "), "each model has its card");
    let better = html.split("The smallest regret on held-out data is that of ").nth(1).unwrap();
    assert!(!better.starts_with("other"), "the other one's is larger");
    assert_balanced(&report.html().unwrap());
    report.verdicts[0].chosen = report.verdicts[1].chosen.clone();
    let html = flowing(&report);
    assert!(html.contains("PIT300: all models choose learning_rate = 1e-4 ("), "told once");
}

#[test]
fn no_element_has_two_classes_attributes_and_no_backtick_is_left_in_text() {
    let mut report = report();
    report.warnings.push("make it longer with `sweep.steps`".to_owned());
    let html = report.html().unwrap();
    for_each_tag(&html, |tag| {
        assert!(tag.matches(" class=").count() <= 1, "{tag}");
    });
    assert!(html.contains("longer with <code>sweep.steps</code>"));
    for paragraph in html.split("<p").filter(|rest| rest.starts_with(['>', ' '])) {
        let text = paragraph.split("</p>").next().unwrap();
        assert!(!text.contains('`'), "{text}");
    }
}

#[test]
fn captions_that_are_the_same_are_said_once() {
    let html = report().html().unwrap();
    for caption in ["Of each short stretch of time", "The first of each start"] {
        assert!(html.matches(caption).count() <= 1, "{caption}");
    }
}

#[test]
fn every_chart_has_a_picture_for_wide_and_one_for_narrow_screens() {
    let html = report().html().unwrap();
    let plots = html.matches("<div class=\"plot\"").count();
    assert!(plots > 0);
    assert_eq!(html.matches("viewBox=\"0 0 960 ").count(), plots);
    assert_eq!(html.matches("viewBox=\"0 0 340 ").count(), plots);
}
