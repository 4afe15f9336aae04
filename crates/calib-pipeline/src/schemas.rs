//! The JSON Schema of the output of each command with `--json`.

use std::collections::BTreeMap;

use calib_base::log::simulate::Simulated;
use calib_model_steps::{
    model::{build_plan::BuildPlan, model_files::ModelManifest},
    represent::RepresentationManifest,
    rollouts::rollout::RolloutManifest,
};
use calib_study::StepKind;
use calib_sweep_steps::{
    agents::pretrain_files::PretrainManifest,
    sweep::{SweepManifest, plan::SweepPlan},
    verdict::{compare::Summaries, judged::Summary},
};
use schemars::{JsonSchema, Schema, SchemaGenerator, generate::SchemaSettings, json_schema};

use crate::{
    check::CheckedResults,
    cluster::{Status, Summary as ClusterSummary},
    control::{ControlPlan, ControlSummary, SimulatedTask},
    plan::Plan,
    propose::{Chosen, ChosenControl},
    status::StandingOf,
    validity,
};

/// The documents that a command may print. Each output is one of them.
pub struct JsonDocuments {
    generator: SchemaGenerator,
    documents: Vec<Schema>,
}

impl JsonDocuments {
    /// Starts with documents of type `T`.
    pub fn of<T: JsonSchema>() -> Self {
        let generator = SchemaSettings::draft2020_12().for_serialize().into_generator();
        Self { generator, documents: Vec::new() }.or::<T>()
    }

    /// Adds documents of type `T`.
    #[must_use]
    pub fn or<T: JsonSchema>(mut self) -> Self {
        self.documents.push(self.generator.subschema_for::<T>());
        self
    }

    /// Returns the schema of the output of `command`.
    pub fn schema(mut self, command: &str) -> Schema {
        json_schema!({
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            "title": format!("calib {command} --json"),
            "anyOf": self.documents,
            "$defs": self.generator.take_definitions(true),
        })
    }
}

/// Returns the schemas of the pipeline's steps, by command.
pub fn json_schemas() -> BTreeMap<&'static str, Schema> {
    let documents = [
        (StepKind::BuildModel.command(), JsonDocuments::of::<ModelManifest>().or::<BuildPlan>()),
        ("check", JsonDocuments::of::<CheckedResults>()),
        ("cluster plan", JsonDocuments::of::<ClusterSummary>()),
        ("cluster status", JsonDocuments::of::<Status>()),
        (
            StepKind::Control.command(),
            JsonDocuments::of::<ControlSummary<'_>>().or::<ControlPlan>(),
        ),
        (StepKind::Evaluate.command(), verdicts()),
        ("init", JsonDocuments::of::<Chosen>().or::<ChosenControl>()),
        (StepKind::Pretrain.command(), JsonDocuments::of::<PretrainManifest>()),
        ("quickstart", verdicts()),
        (StepKind::Represent.command(), JsonDocuments::of::<RepresentationManifest>()),
        (StepKind::Rollout.command(), JsonDocuments::of::<RolloutManifest>()),
        (
            StepKind::Prepare.command(),
            verdicts().or::<Plan>().or::<ControlSummary<'_>>().or::<ControlPlan>(),
        ),
        (StepKind::Simulate.command(), JsonDocuments::of::<Simulated>().or::<SimulatedTask>()),
        ("status", JsonDocuments::of::<StandingOf>()),
        (StepKind::Sweep.command(), JsonDocuments::of::<SweepManifest>().or::<SweepPlan>()),
        ("validity", JsonDocuments::of::<validity::Summary<'_>>()),
    ];
    documents.into_iter().map(|(command, documents)| (command, documents.schema(command))).collect()
}

/// Returns the documents of verdicts: on one study, or on several of its deployments or models.
fn verdicts() -> JsonDocuments {
    JsonDocuments::of::<Summary>().or::<Summaries>()
}
