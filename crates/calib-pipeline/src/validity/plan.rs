//! What a dry run says.

use std::time::Duration;

use calib_base::{
    StepError,
    log::context::RunContext,
    output::{duration, table},
};

use super::{studies::Listing, task::Task};

/// Every plant with its task, and what is left to run.
pub(super) fn show(listing: &Listing, context: &RunContext) -> Result<(), StepError> {
    let mut rows = Vec::with_capacity(listing.studies.len());
    let (mut unfinished, mut finished, mut secs) = (0, 0, 0.0);
    for study in &listing.studies {
        let state = match (study.out_of_reach()?, study.left(context)?) {
            (Some(reason), _) => format!("left out: {reason}"),
            (None, 0) => {
                finished += 1;
                secs += study.swept_secs()?;
                "swept".to_owned()
            }
            (None, left) => {
                unfinished += 1;
                format!("{left} to be run")
            }
        };
        let Task { optimiser, gamma, steps, batch_size, agent } =
            Task::of(study.study(), study.study().sweep.steps);
        let numbers = [gamma.to_string(), steps.to_string(), batch_size.to_string()];
        let names = [study.plant.clone(), optimiser.to_owned(), agent];
        rows.push(names.into_iter().chain(numbers).chain([state]).collect());
    }
    let header = ["plant", "optimiser", "agent", "gamma", "steps", "batch", "models"];
    context.lines(&table(&header, &rows))?;
    let estimate = if finished > 0 && unfinished > 0 {
        let left = Duration::from_secs_f64(secs / f64::from(finished)) * unfinished;
        format!("; about {} if their sweeps take as long as those that are done", duration(left))
    } else {
        String::new()
    };
    let all = listing.studies.len();
    context.result(&format!("{unfinished} of {all} plants are to be run{estimate}"))
}
