//! The environments of a sweep: members, Online and log replay.

use calib_core::Seed;
use calib_data::Dataset;
use calib_files::Fingerprint;
use calib_rollout::Wanted;
use calib_study::Job;
use calib_sweep::{
    Environment, MemberEnvironment, PredictedEnvironment, ReplayEnvironment, RolloutOptions,
};

use crate::{
    model::{
        kinds::{Model, search_place},
        model_files::OpenModel,
        starts::{StartSummary, Starts, summaries},
    },
    output::Printer,
    sweep::streams::Streams,
};

/// Everything that agents are trained in.
pub(crate) struct Environments<'a> {
    pub(crate) environments: Vec<Box<dyn Environment + 'a>>,
    /// What the reader should know of start states.
    pub(crate) starts: Vec<String>,
}

impl<'a> Environments<'a> {
    /// As long as `streams` says.
    pub(crate) fn new(
        job: &'a Job,
        model: &'a OpenModel,
        dataset: &'a Dataset,
        streams: &Streams,
        printer: &Printer,
    ) -> anyhow::Result<Self> {
        let (study, paths) = (job.study(), job.layout());
        let seed = Seed::new(study.seed);
        let (sweep, span) = (&study.sweep, streams.demand.span);
        let mut environments: Vec<Box<dyn Environment + 'a>> = Vec::new();
        let rollout_seed = seed.child("rollout");
        let configured = study.sweep_starts();
        let starts = Starts::new(&configured, model, dataset.held_out.as_ref(), rollout_seed)?;
        let inputs = Fingerprint::of(&serde_json::to_vec(&(
            model.manifest.content()?,
            (study.model.weights, study.model.temperature),
            &configured,
            // Not the deployment itself: where start states are the same for several, so are the streams.
            starts.origin(dataset.held_out_fingerprint.as_ref())?,
        ))?);
        let mut given: Vec<Vec<(Wanted, Option<f32>)>> = Vec::new();
        match &model.model {
            Model::Knn(knn) => {
                let weights = study.model.weights()?;
                // Beside the states that are searched: what the sweep writes need not be there yet.
                let place = search_place(&model.model, &paths.model());
                let progress = printer.progress();
                let all = starts.of_members(knn, study.member_runs(), &place, &progress)?;
                drop(progress);
                for (number, own) in all.into_iter().enumerate() {
                    let member = knn.member(number);
                    given.push(own.iter().map(|start| (start.wanted, start.replaced)).collect());
                    let (seed, inputs) = (rollout_seed, inputs.clone());
                    let options = RolloutOptions { span, weights, seed, inputs };
                    let states = model.frames.states();
                    environments
                        .push(Box::new(MemberEnvironment::new(member, states, own, options)));
                }
            }
            Model::Parametric(network) => {
                let own = starts.of_network(study.member_runs())?;
                given.push(own.iter().map(|start| (start.wanted, start.replaced)).collect());
                let rows = own.iter().map(|start| start.row).collect();
                let frames = &model.frames;
                let predicted = PredictedEnvironment::new(&**network, frames, rows, span, inputs)?;
                environments.push(Box::new(predicted));
            }
        }
        if let (Some(held_out), Some(inputs), Some(windows)) =
            (&dataset.held_out, &dataset.held_out_fingerprint, &streams.online)
        {
            let (windows, inputs) = (windows.clone(), inputs.clone());
            let online = ReplayEnvironment::online(held_out, windows, sweep.online_runs, inputs);
            environments.push(Box::new(online));
        }
        if !streams.log.starts.is_empty() {
            let (windows, inputs) = (streams.log.clone(), dataset.fingerprint.clone());
            let replay = ReplayEnvironment::log_replay(&dataset.train, windows, inputs);
            environments.push(Box::new(replay));
        }
        Ok(Self { environments, starts: notes(&summaries(&given)) })
    }
}

/// One sentence a member whose start states are not those that were asked for.
fn notes(summaries: &[StartSummary]) -> Vec<String> {
    let lacking = summaries.iter().enumerate().filter(|(_, summary)| summary.replaced > 0);
    lacking
        .filter_map(|(member, summary)| Some(format!("member {member}: {}", summary.text()?)))
        .collect()
}
