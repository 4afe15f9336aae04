use calib_agent::Epoch;
use calib_base::{
    StepError,
    artefact::MANIFEST,
    outcome::{Outcome, Told},
    output::{Printer, duration, number, table},
};
use calib_study::{Job, StepKind};

use crate::agents::{pretrain::PretrainedAgents, pretrain_files::PretrainedAgent};

impl Told for PretrainedAgents {
    fn outcome(&self) -> Outcome {
        if self.diverged().is_empty() { Outcome::Done } else { Outcome::Negative }
    }

    fn tell(&self, job: &Job, printer: &Printer) -> Result<(), StepError> {
        let Self { manifest, directory, trained, took } = self;
        if printer.is_json() {
            printer.json(manifest)?;
        } else {
            let verb = if *trained == 0 { "up to date:" } else { "wrote" };
            let place = directory.join(MANIFEST);
            printer.result(&format!("{verb} {} in {}", place.display(), duration(*took)))?;
            let header = [
                "sensor",
                "epoch",
                "training loss",
                "validation loss",
                "validation NRMSE",
                "of epoch 1",
            ];
            let rows: Vec<Vec<String>> = manifest.agents.iter().map(row).collect();
            printer.lines(&table(&header, &rows))?;
        }
        printer.next(&job.next_commands(StepKind::Pretrain));
        let study = job.study();
        for (sensor, epoch) in self.diverged() {
            printer.error(&format!(
                "pre-training for {sensor} diverged in epoch {epoch}, and there is no agent for it; \
                 use a smaller pretrain.learning_rate than {}",
                study.pretrain.agent(&study.agent).learning_rate
            ));
        }
        Ok(())
    }
}

/// Returns the row of an agent: the epoch of its checkpoint, next to the first epoch.
fn row(agent: &PretrainedAgent) -> Vec<String> {
    let kept = agent.curve.get(agent.epoch.saturating_sub(1));
    vec![
        agent.sensor.clone(),
        format!("{} of {}", agent.epoch, agent.curve.len()),
        number_or_unknown(kept.map(|epoch| epoch.training_loss)),
        number_or_unknown(kept.map(|epoch| epoch.validation_loss)),
        nrmse(kept),
        nrmse(agent.curve.first()),
    ]
}

fn nrmse(epoch: Option<&Epoch>) -> String {
    number_or_unknown(epoch.and_then(|epoch| epoch.validation_nrmse))
}

fn number_or_unknown(value: Option<f64>) -> String {
    value.map_or_else(|| "unknown".to_owned(), number)
}
