//! Expected cost of building tables of neighbours, from builds of the first of the states.

use calib_base::{
    StepError,
    clock::TimeTaken,
    log::{context::RunContext, partition, prepared_log::Prepared},
};
use calib_core::{Monitor, Segments, States, Transitions};
use calib_knn::{KnnModel, ModelConfig};
use calib_study::{Job, StepKind};

use crate::{
    model::{build_plan::BuildPlan, model_files},
    represent::Width,
};

/// Number of rows of the first timed build.
const FIRST_ROWS: usize = 1_000;
/// Wall time that is enough for a timed build, s. Builds before it take as long together, so that all stay far below a
/// second (our choice).
const ENOUGH_SECS: f64 = 0.15;
/// Exponent of the rows in the time of a search, if only one build was timed: between that of a join (1) and that of a
/// scan (2).
const USUAL_GROWTH: f64 = 1.5;

/// Reports the expected cost of the model of a job, unless the model is there. `width` is that of the searched states.
pub(super) fn expect(
    job: &Job,
    prepared: Prepared,
    config: &ModelConfig,
    width: Width,
    plan: &BuildPlan,
    context: &RunContext,
) -> Result<(), StepError> {
    let dataset = partition::parts(job.study(), prepared)?.dataset;
    if model_files::is_kept(job, &dataset) {
        return Ok(());
    }
    let states = dataset.train.states();
    // The states stand in for a representation that is not made yet.
    let columns = width.coordinates(states.columns());
    let sample = Sample { states, every: context.stands_in().unwrap_or(1), columns };
    let monitor = context.silent().progress();
    let Some(secs) = sample.processor_secs(config, &monitor)? else { return Ok(()) };
    context.tell_cost(StepKind::BuildModel, job, plan.cost(secs));
    Ok(())
}

/// States of which parts are searched.
#[derive(Clone, Copy)]
pub(crate) struct Sample<'a> {
    pub(crate) states: &'a States,
    /// The distance of its rows: a stand-in for another log repeats each row so many times.
    pub(crate) every: usize,
    /// Number of columns: the first ones. If the states have fewer, they are repeated.
    pub(crate) columns: usize,
}

/// A build of some rows.
struct TimedBuild {
    rows: usize,
    /// Processor seconds.
    secs: f64,
}

impl Sample<'_> {
    /// Returns the number of its rows.
    fn rows(&self) -> usize {
        self.states.rows().div_ceil(self.every)
    }

    /// Returns the model of the first `rows` rows, or of all rows if there are fewer.
    pub(crate) fn model(
        &self,
        rows: usize,
        config: &ModelConfig,
        monitor: &dyn Monitor,
    ) -> Result<KnnModel, StepError> {
        let &Self { states, every, columns } = self;
        let rows = rows.min(self.rows());
        let values: Vec<f32> = (0..rows)
            .flat_map(|row| states.row(row * every).iter().cycle().take(columns))
            .copied()
            .collect();
        let states = States::new(values, rows, columns)?;
        let transitions = Transitions::new(Segments::from_lengths([rows])?);
        Ok(KnnModel::build(states, transitions, config, monitor)?)
    }

    /// Returns the processor seconds to build the model of all states, from builds of more and more rows. `None` if no
    /// part of them makes a model.
    fn processor_secs(
        &self,
        config: &ModelConfig,
        monitor: &dyn Monitor,
    ) -> Result<Option<f64>, StepError> {
        let most = self.rows();
        let mut before: Option<TimedBuild> = None;
        let mut rows = FIRST_ROWS.min(most);
        loop {
            let (built, taken) = TimeTaken::by(|| self.model(rows, config, monitor));
            match built {
                Ok(_) => {
                    let timed = TimedBuild { rows, secs: taken.on_processors() };
                    if rows == most || taken.secs >= ENOUGH_SECS {
                        return Ok(Some(timed.secs_of(self.states.rows(), before.as_ref())));
                    }
                    before = Some(timed);
                }
                Err(reason) if reason.was_cancelled() => return Err(reason),
                // Few rows may have too few candidates. What is wrong with all of them is told by the plan.
                Err(_) if rows == most => return Ok(None),
                Err(_) => {}
            }
            rows = (2 * rows).min(most);
        }
    }
}

/// Returns how many times as many these rows are.
fn times(rows: usize, fewer: usize) -> f64 {
    rows as f64 / fewer as f64
}

impl TimedBuild {
    /// Returns the processor seconds of a build of `rows` rows. They grow by a power of the rows, which follows from a
    /// build of fewer rows.
    fn secs_of(&self, rows: usize, before: Option<&Self>) -> f64 {
        let growth = before.map_or(USUAL_GROWTH, |before| {
            let growth = (self.secs / before.secs).ln() / times(self.rows, before.rows).ln();
            growth.clamp(1.0, 2.0)
        });
        self.secs * times(rows, self.rows).powf(growth)
    }
}

#[cfg(test)]
mod tests {
    use calib_core::Silent;

    use super::*;

    fn timed(rows: usize, secs: f64) -> TimedBuild {
        TimedBuild { rows, secs }
    }

    #[test]
    fn builds_grow_by_a_power_of_their_rows() {
        let (half, all) = (timed(1_000, 0.1), timed(2_000, 0.2));
        assert!((all.secs_of(8_000, Some(&half)) - 0.8).abs() < 1e-12, "as the rows");
        let all = timed(2_000, 0.4);
        assert!((all.secs_of(8_000, Some(&half)) - 6.4).abs() < 1e-12, "as their square");
        let all = timed(2_000, 0.8);
        assert!((all.secs_of(8_000, Some(&half)) - 12.8).abs() < 1e-12, "never faster");
        assert!((all.secs_of(8_000, None) - 0.8 * 8.0).abs() < 1e-12);
        assert_eq!(all.secs_of(2_000, None), 0.8);
    }

    #[test]
    fn repeated_rows_are_left_out_of_a_sample() {
        let values: Vec<f32> = (0..600_u16).map(|row| (f32::from(row / 3) * 0.3).sin()).collect();
        let states = States::new(values, 300, 2).expect("finite");
        let config = ModelConfig::default();
        let sample = Sample { states: &states, every: 3, columns: 1 };
        let model = sample.model(1_000, &config, &Silent).expect("enough rows");
        assert_eq!((model.states().rows(), model.states().columns()), (100, 1));
        assert_eq!(model.states().row(7)[0], states.row(21)[0]);
        let wider = Sample { columns: 5, ..sample }.model(1_000, &config, &Silent);
        let wider = wider.expect("enough rows");
        let [first, second] = [0, 1].map(|column| states.row(21)[column]);
        assert_eq!(wider.states().row(7), [first, second, first, second, first]);
        let secs = sample.processor_secs(&config, &Silent).expect("not interrupted");
        assert!(secs.is_some_and(|secs| secs > 0.0), "{secs:?}");
        let most = ModelConfig { neighbors: 100, ..config };
        assert_eq!(sample.processor_secs(&most, &Silent).expect("not interrupted"), None);
    }
}
