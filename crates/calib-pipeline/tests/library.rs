//! Running a study through the library gives the same study as the command line.

use std::{
    io,
    path::Path,
    sync::{Arc, Mutex},
};

use calib_core::{Monitor, Timestamp};
use calib_data::table::write_log;
use calib_pipeline::{
    BuildOptions, Calibration, ClusterPlanOptions, ClusterStatusOptions, Evaluation, ExistingFile,
    Freshness, Job, Leftovers, Logs, Observer, Outcome, Printer, ProposeOptions, Remark, Request,
    Shown, StandingOf, StatusRequest, StepResult, output::ResultPart,
};

const STUDY: &str = "\
[simulate]\ndays = 3\nchannels = 8\nperiod_secs = 60\n\
[data]\npath = \"plant\"\ntrain_fraction = 0.7\n\
[agent]\nvalue_function = \"linear\"\ngamma = 0.9\nbatch_size = 16\n\
[rollout]\nsteps = 200\n\
[sweep]\nsensors = [\"PIT300\"]\nsteps = 600\nonline_runs = 2\nmember_runs = 1\nlog_replay_runs = 2\n\
[sweep.grid]\nlearning_rate = [1e-4, 1e-2]\n";

/// Resolves a study with this text, in a file of `folder`.
fn resolved(folder: &Path, text: &str) -> Job {
    let file = folder.join("study.toml");
    std::fs::write(&file, text).expect("writable");
    Job::resolve(Request::new(&file)).expect("a study")
}

/// An observer that keeps all messages.
#[derive(Default)]
struct Kept {
    results: Mutex<Vec<String>>,
    remarks: Mutex<Vec<String>>,
    /// Text after which the observer asks to stop.
    until: Option<&'static str>,
    stop: Arc<Mutex<bool>>,
}

struct Watching(Arc<Mutex<bool>>);

impl Monitor for Watching {
    fn interrupted(&self) -> bool {
        *self.0.lock().expect("no panic")
    }
}

impl Observer for Kept {
    fn remark(&self, remark: Remark<'_>) {
        let text = format!("{remark:?}");
        if self.until.is_some_and(|until| text.contains(until)) {
            *self.stop.lock().expect("no panic") = true;
        }
        self.remarks.lock().expect("no panic").push(text);
    }

    fn result(&self, result: ResultPart<'_>) -> io::Result<()> {
        self.results.lock().expect("no panic").push(format!("{result:?}"));
        Ok(())
    }

    fn progress(&self, _shown: Shown) -> Box<dyn Monitor> {
        Box::new(Watching(Arc::clone(&self.stop)))
    }
}

#[test]
fn a_study_is_run_stopped_and_gone_on_with() {
    let folder = tempfile::tempdir().expect("a folder");
    let job = resolved(folder.path(), STUDY);
    let stopping = Kept { until: Some("] sweep\")"), ..Kept::default() };
    let stopped = calib_pipeline::run(&job, None, &Printer::new(Arc::new(stopping)));
    assert!(stopped.expect_err("it is asked to stop").was_cancelled());
    assert!(folder.path().join("study-results/model/manifest.json").exists());
    assert!(!folder.path().join("study-results/sweep/manifest.json").exists());
    let going_on = Arc::new(Kept::default());
    let ended = calib_pipeline::run(&job, None, &Printer::new(Arc::<Kept>::clone(&going_on)));
    let ended = ended.expect("it goes on");
    assert!(matches!(ended.outcome(), Outcome::Done | Outcome::Negative), "{ended:?}");
    let remarks = going_on.remarks.lock().expect("no panic").join("\n");
    assert!(remarks.contains("up to date: "), "the model is there: {remarks}");
    let results = going_on.results.lock().expect("no panic").join("\n");
    // The results name the sensor and the path of the report.
    assert!(results.contains("PIT300") && results.contains("report: "), "{results}");
}

#[test]
fn what_steps_come_to_are_values() {
    let folder = tempfile::tempdir().expect("a folder");
    let job = resolved(folder.path(), STUDY);
    let printer = Printer::nobody();
    let ended = calib_pipeline::run(&job, None, &printer).expect("a run");
    let evaluation = ended.evaluation.expect("it is judged");
    let verdict = evaluation.verdicts()[0];
    assert_eq!(verdict.sensor, "PIT300");
    let swept = calib_pipeline::sweep(&job, None, &printer).expect("it is there");
    let swept = swept.only().and_then(StepResult::made).expect("of one model and deployment");
    // Two settings of the grid, and the default.
    assert_eq!((swept.ran(), swept.candidates().len()), (0, 3));
    // The verdict numbers settings as the sweep does.
    assert!(swept.candidates()[verdict.chosen].agent.learning_rate > 0.0);
    let built = calib_pipeline::build_model(&job, &BuildOptions::default(), &printer);
    let built = built.expect("it is there").only().and_then(StepResult::made).expect("one model");
    assert_eq!(built.freshness(), Freshness::Kept);
    assert!(built.transitions().iter().all(|member| *member < built.rows()));
    let rollouts = calib_pipeline::rollout(&job, &printer).expect("they are there");
    let rollouts = rollouts.only().and_then(StepResult::made).expect("of one model");
    assert_eq!((rollouts.sensors(), rollouts.members()), (&["PIT300".to_owned()][..], 5));
    // As JSON the value equals the written file.
    let Evaluation::Judged(judged) = &evaluation else { panic!("it has one model") };
    let place = judged.report().and_then(|page| page.parent()).expect("a report");
    let text = std::fs::read_to_string(place.join("evaluate/summary.json")).expect("written");
    let written: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(serde_json::to_value(&evaluation).expect("JSON"), written);
}

/// Whether every step of a study is done.
fn is_done(study: &Path) -> bool {
    let request = StatusRequest { path: study.to_owned(), ..StatusRequest::default() };
    match calib_pipeline::status(&request, &Printer::nobody()).expect("a study") {
        StandingOf::Study(standing) => standing.is_done(),
        StandingOf::Cluster(_) => panic!("it is no plan for a cluster"),
    }
}

#[test]
fn a_log_is_taken_to_a_verdict_by_values_alone() {
    let folder = tempfile::tempdir().expect("a folder");
    let printer = Printer::nobody();
    let plant = resolved(folder.path(), STUDY);
    calib_pipeline::simulate(&plant, &printer).expect("written").expect("it describes a plant");
    let options = ProposeOptions {
        logs: folder.path().join("plant"),
        study: folder.path().join("proposed.toml"),
        within: 5.0,
        sensors: vec!["PIT300".to_owned()],
        horizon: Some(600.0),
        set: Vec::new(),
        existing: ExistingFile::Kept,
    };
    let proposed = calib_pipeline::propose(&options, &printer).expect("a study");
    assert_eq!(proposed.sensors(), options.sensors);
    assert!((proposed.horizon_secs() - 600.0).abs() <= 60.0, "{proposed:?}");
    assert!(proposed.expected_secs().is_none_or(|secs| secs > 0.0), "{proposed:?}");

    let job = Job::resolve(Request::new(proposed.study())).expect("a study");
    assert!(!is_done(&options.study));
    let ended = calib_pipeline::run(&job, None, &printer).expect("a run");
    let evaluation = ended.evaluation.expect("it is judged");
    assert_eq!(evaluation.verdicts()[0].sensor, "PIT300");
    assert!(is_done(&options.study));

    let results = folder.path().join("proposed-results");
    let checked = calib_pipeline::check(&results, Logs::Read, &printer).expect("results");
    assert!(checked.files > 5 && checked.damages.is_empty(), "{checked:?}");
    std::fs::write(results.join("sweep/manifest.json"), "{}").expect("writable");
    let damaged = calib_pipeline::check(&results, Logs::Leave, &printer).expect("results");
    assert!(!damaged.damages.is_empty(), "{damaged:?}");
}

/// Returns the shards without results of a plan of two.
fn missing(plan: &Path) -> Vec<usize> {
    let all = ClusterStatusOptions { missing: None, leftovers: Leftovers::Kept };
    let status = calib_pipeline::cluster_status(plan, all, &Printer::nobody()).expect("a plan");
    assert_eq!(status.shards(), 2);
    status.missing()
}

#[test]
fn a_plan_for_a_cluster_tells_its_shards() {
    let folder = tempfile::tempdir().expect("a folder");
    let job = resolved(folder.path(), STUDY);
    let printer = Printer::nobody();
    calib_pipeline::simulate(&job, &printer).expect("written").expect("it describes a plant");
    calib_pipeline::build_model(&job, &BuildOptions::default(), &printer).expect("built");
    let options = ClusterPlanOptions {
        directory: folder.path().join("plan"),
        task_minutes: 1.0,
        max_tasks: 100,
        shards: Some(2),
    };
    let planned = calib_pipeline::cluster_plan(&job, &options, &printer).expect("a plan");
    let plan = planned.made().expect("it is written");
    assert_eq!((plan.directory(), plan.shards()), (options.directory.as_path(), 2));
    assert!(plan.secs() > 0.0, "{plan:?}");
    assert_eq!(missing(plan.directory()), [0, 1]);
    calib_pipeline::cluster_run(plan.directory(), 0, &printer).expect("made");
    assert_eq!(missing(plan.directory()), [1]);
}

#[test]
fn a_mistake_has_its_place() {
    let folder = tempfile::tempdir().expect("a folder");
    let job = resolved(folder.path(), &STUDY.replace("PIT300", "PIT301"));
    let error = calib_pipeline::run(&job, None, &Printer::new(Arc::new(Kept::default())))
        .expect_err("no such sensor");
    assert!(!error.was_cancelled());
    assert!(error.to_string().contains("PIT301"), "{error}");
}

#[test]
fn a_log_that_changed_between_two_steps_is_read_again() {
    let folder = tempfile::tempdir().expect("a folder");
    let text = STUDY.split_once("[data]").map(|(_, rest)| format!("[data]{rest}")).expect("data");
    let job = resolved(folder.path(), &text);
    let [more, fewer] = [3000_i64, 2000].map(|rows| {
        let times: Vec<Timestamp> =
            (0..rows).map(|row| Timestamp::from_micros(60_000_000 * row)).collect();
        let values = (0..rows).map(|row| (row as f32 / 9.0).sin()).collect();
        std::fs::create_dir_all(folder.path().join("plant")).expect("made");
        let path = folder.path().join("plant/log.parquet");
        write_log(&path, &times, &[("PIT300", values)]).expect("written");
        let printer = Printer::new(Arc::new(Kept::default()));
        calib_pipeline::build_model(&job, &BuildOptions::default(), &printer).expect("built");
        Calibration::of_job(&job).expect("there").frames().rows()
    });
    assert!(fewer < more, "{fewer} and {more} rows");
}
