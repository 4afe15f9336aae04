//! Tests of start states through the public interface.

use std::collections::BTreeSet;

use calib_core::{Monitor, RowIndex, Seed, Silent, States, Timestamp, TransitionIndex};
use calib_files::ScratchPlace;
use calib_knn::{Member, ModelConfig, Neighbor, Weights};
use calib_model::{
    Absent, RequestedStart, RolloutError, Start, StartSource, StartState, rollout, start_states,
    start_states_of_all,
};

use super::{model, rows_of_member};

fn starts_of(member: &Member<'_>, source: StartSource<'_>, count: usize) -> Vec<StartState> {
    start_states(member, source, count, Seed::new(0)).expect("starts")
}

fn nearest_to(member: &Member<'_>, row: RowIndex, k: usize) -> Vec<Neighbor> {
    let found = member.nearest_to_rows(&[row], k, &ScratchPlace::Memory, &Silent);
    found.expect("found").remove(0)
}

#[test]
fn recent_starts_are_spread_over_the_latest_rows_or_are_the_nearest_to_them() {
    let model = model(&ModelConfig::default());
    let timestamps: Vec<Timestamp> = (0..441).map(Timestamp::from_micros).collect();
    let cases = [(0, None), (4, None), (0, Some(timestamps[300]))];
    let [first, without_last_block, before] = cases.map(|(member, before)| {
        let source = StartSource::Recent { timestamps: &timestamps, before, window: Some(40) };
        starts_of(&model.member(member), source, 3)
    });
    let rows = first.iter().map(|start| (start.wanted, start.replaced));
    let last = [440, 420, 430].map(|row| (RequestedStart::Recorded(RowIndex(row)), None));
    assert_eq!(rows.collect::<Vec<_>>(), last);
    // The member that leaves the last block out has no rows of it.
    for (start, wanted) in without_last_block.iter().zip(last) {
        assert_eq!(start.wanted, wanted.0);
        assert!(start.replaced.expect("it is replaced") > 0.0);
        let trajectory = rollout(&model.member(4), start, 0, Weights::Linear, Seed::new(0));
        let RequestedStart::Recorded(row) = start.wanted else { panic!("{start:?}") };
        let near = nearest_to(&model.member(4), row, 1)[0];
        assert_eq!(trajectory.rows()[0], model.transitions().source(near.transition));
    }
    assert_eq!(before[0].wanted, RequestedStart::Recorded(RowIndex(299)));
}

#[test]
fn rows_that_the_member_lacks_are_searched_or_replaced() {
    let model = model(&ModelConfig::default());
    let member = model.member(2);
    let inside = RowIndex(5);
    let segment_start = RowIndex(0);
    let excluded = model.transitions().next(TransitionIndex(model.blocks().own(2).start + 3));
    let rows = [inside, segment_start, excluded];
    let [external, replaced] = [Absent::External, Absent::Replace]
        .map(|absent| starts_of(&member, StartSource::Rows { rows: &rows, absent }, 4));
    let wanted = RequestedStart::Recorded(inside);
    let there = StartState { start: Start::At(TransitionIndex(4)), wanted, replaced: None };
    assert_eq!(external[0], there);
    assert_eq!(external[3], external[0]);
    for (start, row) in external[1..3].iter().zip(&rows[1..]) {
        let Start::External { row: at, neighbors } = &start.start else { panic!("{start:?}") };
        assert_eq!((at, neighbors), (row, &nearest_to(&member, *row, 3)));
        let trajectory = rollout(&member, start, 20, Weights::Linear, Seed::new(2));
        assert_eq!(trajectory.rows()[0], *row);
        assert!(neighbors.iter().any(|near| near.transition == trajectory.transitions()[0]));
        assert!(trajectory.rows()[1..].iter().all(|row| rows_of_member(&model, 2).contains(row)));
    }
    // Row 0 is its own nearest source, so the replacement stays there. The excluded row moves into the member.
    assert_eq!(replaced[0].replaced, None);
    assert_eq!(replaced[1].replaced, Some(0.0));
    assert!(matches!(&replaced[1].start, Start::External { row: RowIndex(0), .. }));
    let distance = replaced[2].replaced.expect("it is not in the member");
    assert!(distance > 0.0);
    let Start::At(transition) = replaced[2].start else { panic!("{:?}", replaced[2]) };
    assert!(member.contains(transition));
}

#[test]
fn nearest_starts_are_recorded_states_near_the_deployment() {
    let model = model(&ModelConfig::default());
    let member = model.member(3);
    let deployment = States::new(vec![0.2, 0.5, 0.8, 0.6, 0.6, 0.1], 2, 3).expect("valid");
    let starts =
        start_states(&member, StartSource::Nearest { states: &deployment }, 8, Seed::new(4))
            .expect("starts");
    let nearest = member.nearest_sources(&deployment, 1, &Silent).expect("found");
    let sources: Vec<RowIndex> =
        nearest.iter().map(|near| model.transitions().source(near[0].transition)).collect();
    let mut seen = BTreeSet::new();
    let source = StartSource::Nearest { states: &deployment };
    let others = start_states(&model.member(0), source, 8, Seed::new(4)).expect("starts");
    for (start, other) in starts.iter().zip(&others) {
        assert_eq!(start.wanted, other.wanted, "the same states for every member");
        let trajectory = rollout(&member, start, 1, Weights::Linear, Seed::new(4));
        let first = trajectory.rows()[0];
        let which = sources.iter().position(|&row| row == first).expect("one of the two");
        assert_eq!(start.replaced, Some(nearest[which][0].distance));
        assert_eq!(start.wanted, RequestedStart::Deployment(RowIndex::new(which)));
        seen.insert(which);
    }
    assert_eq!(seen.len(), 2);
}

/// Whether a row is in July of 1970 or 1971, with one row every two days from 1970-01-01.
fn is_in_july(row: u32) -> bool {
    (91..106).contains(&row) || (273..289).contains(&row)
}

#[test]
fn calendar_months_choose_rows_before_the_deployment() {
    let model = model(&ModelConfig::default());
    let member = model.member(0);
    // One row every two days from 1970-01-01: rows 0..16 are in January, and 441 rows reach into 1972.
    let timestamps: Vec<Timestamp> =
        (0..441).map(|row| Timestamp::from_micros(row * 2 * 86_400_000_000)).collect();
    let source =
        |month, before| StartSource::CalendarMonth { timestamps: &timestamps, month, before };
    let [both, first] = [None, Some(timestamps[300])].map(|before| -> BTreeSet<u32> {
        let starts = start_states(&member, source(7, before), 200, Seed::new(1)).expect("starts");
        starts
            .iter()
            .map(|s| rollout(&member, s, 0, Weights::Linear, Seed::new(0)).rows()[0].0)
            .collect()
    });
    // July 1970 and July 1971; block 0 ends before row 90.
    assert!(both.iter().all(|&row| is_in_july(row)), "{both:?}");
    assert!(both.iter().any(|&row| row < 106) && both.iter().any(|&row| row >= 273));
    // Row 300 is in August 1971, so July of that year is not in an earlier year.
    assert!(first.iter().all(|&row| is_in_july(row) && row < 106));
    // January 1970 is in the block that member 0 leaves out: it is replaced, not refused.
    let january = start_states(&member, source(1, Some(timestamps[200])), 20, Seed::new(1));
    for start in january.expect("starts") {
        let RequestedStart::Recorded(row) = start.wanted else { panic!("{start:?}") };
        assert!(row.0 < 16 && start.replaced.expect("it lacks it") > 0.0, "{start:?}");
    }
    let none = start_states(&member, source(2, Some(timestamps[10])), 1, Seed::new(1));
    let text = none.expect_err("nothing before 1970").to_string();
    assert!(text.contains("no rows in month 2 of a year before 1970"), "{text}");
    let bad = start_states(&member, source(13, None), 1, Seed::new(1));
    assert!(matches!(bad, Err(RolloutError::Month { got: 13 })));
}

/// A monitor that records the sizes of searches.
#[derive(Default)]
struct Searches(std::sync::Mutex<Vec<u64>>);

impl Monitor for Searches {
    fn begin(&self, task: &str, total: u64) {
        if task == "nearest states" {
            self.0.lock().expect("nobody panics").push(total);
        }
    }
}

#[test]
fn all_members_start_as_each_does() {
    let model = model(&ModelConfig::default());
    let timestamps: Vec<Timestamp> = (0..441).map(Timestamp::from_micros).collect();
    let deployment = States::new(vec![0.2, 0.5, 0.8, 0.6, 0.6, 0.1], 2, 3).expect("valid");
    let rows: Vec<RowIndex> = (0..441).step_by(20).map(RowIndex::new).collect();
    let directory = tempfile::tempdir().expect("a directory");
    let places = [ScratchPlace::Memory, ScratchPlace::Disk(directory.path().to_owned())];
    for source in [
        StartSource::Random,
        StartSource::Recent { timestamps: &timestamps, before: None, window: None },
        StartSource::Rows { rows: &rows, absent: Absent::External },
        StartSource::Rows { rows: &rows, absent: Absent::Replace },
        StartSource::Nearest { states: &deployment },
    ] {
        for place in &places {
            let seed = Seed::new(6);
            let searches = Searches::default();
            let all = start_states_of_all(&model, source, 30, seed, place, &searches);
            let all = all.expect("starts");
            assert_eq!(all.len(), 5);
            for (number, starts) in all.iter().enumerate() {
                let seed = source.seed_of(seed, number);
                let own = start_states(&model.member(number), source, 30, seed).expect("starts");
                assert_eq!(*starts, own, "{source:?} in member {number}");
            }
            let searches = searches.0.into_inner().expect("nobody panics");
            if let StartSource::Nearest { .. } = source {
                let of_all = searches.iter().filter(|&&queries| queries == 30).count();
                assert_eq!((searches[0], of_all), (30, 1), "one for all members: {searches:?}");
            }
        }
    }
}

#[test]
fn a_search_for_starts_ends_when_the_user_asks() {
    let model = model(&ModelConfig::default());
    let deployment = States::new(vec![0.2, 0.5, 0.8], 1, 3).expect("valid");
    let rows: Vec<RowIndex> = (0..441).map(RowIndex::new).collect();
    for source in [
        StartSource::Nearest { states: &deployment },
        StartSource::Rows { rows: &rows, absent: Absent::Replace },
    ] {
        let place = ScratchPlace::Memory;
        let stopped = start_states_of_all(&model, source, 441, Seed::new(1), &place, &LongStopped);
        assert!(matches!(stopped, Err(RolloutError::Cancelled(_))), "{stopped:?}");
    }
}

/// A monitor of a user who asked to stop before anything began.
struct LongStopped;

impl Monitor for LongStopped {
    fn interrupted(&self) -> bool {
        true
    }
}

#[test]
fn impossible_starts_are_refused() {
    let model =
        model(&ModelConfig { theiler: 200, members: 2, neighbors: 1, ..ModelConfig::default() });
    let member = model.member(0);
    let cases: [&[RowIndex]; 2] = [&[], &[RowIndex(441)]];
    let [none, unknown] = cases.map(|rows| {
        start_states(&member, StartSource::Rows { rows, absent: Absent::External }, 1, Seed::new(0))
    });
    assert!(matches!(none, Err(RolloutError::NoRows)));
    let unknown = unknown.expect_err("441 rows").to_string();
    assert!(unknown.contains("rows 0 to 440"), "{unknown}");
    let empty = States::new(Vec::new(), 0, 3).expect("valid");
    let none = start_states(&member, StartSource::Nearest { states: &empty }, 1, Seed::new(0));
    assert!(matches!(none, Err(RolloutError::NoStates)));
}
