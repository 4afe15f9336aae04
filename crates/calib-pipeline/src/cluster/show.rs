//! Lines and tables for plans, shards and their results.

use std::path::Path;

use calib_base::{
    StepError,
    options::ArrayOf,
    outcome::{Freshness, Outcome, Told},
    output::{Printer, bytes, count, counted, duration, span, table},
};
use calib_study::shell_words;

use crate::cluster::{
    make::{ClusterDryPlan, ClusterPlan},
    run::ClusterShard,
    shard_ranges::ranges,
    status::{ClusterStatus, State, Status, Summary},
    submit::{ClusterScript, ClusterScripts, SubmittedPlan},
};

impl Told<()> for ClusterPlan {
    fn tell(&self, _of: &(), printer: &Printer) -> Result<(), StepError> {
        self.summary.tell(printer)?;
        let place = shell_words([self.directory.display().to_string()]);
        match self.summary.shards.checked_sub(1) {
            None => printer.next(&[format!("calib cluster merge {place}")]),
            Some(last) => printer.next(&[
                format!("calib cluster submit {place} --engine slurm --dry-run"),
                format!("calib cluster run {place} --shard N, with every N from 0 to {last}"),
            ]),
        }
        Ok(())
    }
}

impl Told<()> for ClusterDryPlan {
    fn tell(&self, _of: &(), printer: &Printer) -> Result<(), StepError> {
        let Self(plan) = self;
        plan.summary.tell(printer)?;
        printer.say(&format!("dry run: nothing written to {}", plan.directory.display()));
        Ok(())
    }
}

impl Summary {
    fn tell(&self, printer: &Printer) -> Result<(), StepError> {
        if printer.is_json() {
            return printer.json(self);
        }
        self.lines().iter().try_for_each(|line| printer.result(line))
    }

    fn lines(&self) -> Vec<String> {
        if self.shards == 0 {
            return vec!["nothing is left to train".to_owned()];
        }
        let stages = match self.stages {
            1 => String::new(),
            stages => format!(" in {stages} stages, one after the other"),
        };
        // The settings that continue a race are not known yet, even if only its last stage is left.
        let up_to = if self.has_race { "up to " } else { "" };
        vec![
            format!(
                "{}{stages}, {up_to}{}",
                counted(self.shards, "shard"),
                counted(self.training_runs, "training run")
            ),
            format!(
                "predicted: {} of one thread in all, {} the longest shard, {} where every shard has a core; up to {} of \
                 memory a shard",
                span(self.secs),
                span(self.longest_secs),
                span(self.together_secs),
                bytes(self.memory)
            ),
        ]
    }
}

impl Told<()> for ClusterShard {
    fn tell(&self, _of: &(), printer: &Printer) -> Result<(), StepError> {
        let Self { number, freshness, made, took } = *self;
        match freshness {
            Freshness::Kept => printer.result(&format!("shard {number} is done already")),
            Freshness::Made => {
                let made = counted(made, "training run");
                let took = duration(took);
                printer.result(&format!("shard {number} is done: {made} made in {took}"))
            }
        }
    }
}

impl Told<()> for ClusterStatus {
    fn outcome(&self) -> Outcome {
        if self.status.is_done() { Outcome::Done } else { Outcome::Incomplete }
    }

    fn tell(&self, _of: &(), printer: &Printer) -> Result<(), StepError> {
        match self.only_missing {
            Some(ArrayOf::Slurm) => printer.result(&ranges(&self.missing())),
            Some(ArrayOf::Lines) => {
                self.missing().iter().try_for_each(|number| printer.result(&number.to_string()))
            }
            None if printer.is_json() => printer.json(&self.status),
            None => self.status.tell(&self.directory, printer),
        }
    }
}

impl Status {
    /// Prints the result for the plan in `directory`.
    ///
    /// # Errors
    /// Returns an error if it cannot be printed.
    pub(crate) fn tell(&self, directory: &Path, printer: &Printer) -> Result<(), StepError> {
        let Self { shards, done, .. } = self;
        let [begun, missing, faulty] = [State::Begun, State::Missing, State::Faulty]
            .map(|state| shards.iter().filter(|shard| shard.state == state).count());
        printer.result(&format!(
            "{done} of {} done, {begun} begun, {missing} missing, {faulty} faulty; {} of {} training runs",
            counted(shards.len(), "shard"),
            count(shards.iter().map(|shard| shard.training_runs).sum()),
            count(shards.iter().map(|shard| shard.all_training_runs).sum()),
        ))?;
        let left: f64 = shards
            .iter()
            .filter(|shard| shard.state != State::Done)
            .map(|shard| shard.predicted_secs)
            .sum();
        if left > 0.0 {
            printer.result(&format!("left: {} of one thread, as predicted", span(left)))?;
        }
        let rows: Vec<Vec<String>> = shards
            .iter()
            .filter(|shard| shard.note.is_some() || shard.queue.is_some())
            .map(|shard| {
                let runs =
                    format!("{} of {}", count(shard.training_runs), count(shard.all_training_runs));
                let notes = [shard.queue.clone(), shard.note.clone()];
                let notes: Vec<String> = notes.into_iter().flatten().collect();
                vec![shard.shard.to_string(), runs, notes.join("; ")]
            })
            .collect();
        if !rows.is_empty() {
            printer.lines(&table(&["shard", "training runs", ""], &rows))?;
        }
        let place = shell_words([directory.display().to_string()]);
        if self.is_done() {
            printer.next(&[format!("calib cluster merge {place}")]);
        }
        Ok(())
    }
}

impl Told<()> for ClusterScripts {
    fn tell(&self, _of: &(), printer: &Printer) -> Result<(), StepError> {
        for ClusterScript { name, text } in &self.scripts {
            printer.lines(&format!("==> {name}\n{text}"))?;
        }
        self.command.as_ref().map_or(Ok(()), |command| printer.result(command))
    }
}

impl Told<()> for SubmittedPlan {
    fn outcome(&self) -> Outcome {
        match self {
            Self::Ray { is_done: false } => Outcome::Incomplete,
            Self::Slurm { .. } | Self::Ray { .. } | Self::Kubernetes { .. } => Outcome::Done,
        }
    }

    fn tell(&self, _of: &(), printer: &Printer) -> Result<(), StepError> {
        match self {
            Self::Slurm { directory, shards, arrays, merge } => {
                printer.result(&format!(
                    "{} submitted as {}; merged by job {merge}",
                    counted(*shards, "shard"),
                    arrays.join(", "),
                ))?;
                let place = directory.display().to_string();
                printer.next(&[shell_words(["calib", "cluster", "status", &place])]);
            }
            // The driver has printed its own messages.
            Self::Ray { .. } => {}
            Self::Kubernetes { manifests } => {
                for path in manifests {
                    printer.result(&format!("kubectl apply -f {}", path.display()))?;
                }
                printer.say("each when the one before is complete; calib applies none of them");
            }
        }
        Ok(())
    }
}
