use calib_control::ControlConfig;
use calib_data::AnglePart;

use crate::{
    Study,
    error::{Problem, refuse, require},
    message::nearest,
};

/// Upper limit for numbers of runs and rollouts, far above any practical use.
const MANY_RUNS: usize = 100_000;

/// Upper limit for numbers of steps, far above any practical use: three years at 1 Hz.
const MANY_STEPS: usize = 100_000_000;

impl Study {
    /// Checks the constraints that the types do not express.
    pub(crate) fn check(&self) -> Result<(), Problem> {
        self.data.check()?;
        self.check_simulate()?;
        self.check_deployments()?;
        self.preprocess.check()?;
        self.representation
            .check()
            .map_err(|error| Problem::from(error).within("representation"))?;
        self.model.check().map_err(|error| Problem::from(error).within("model"))?;
        self.dynamics.check().map_err(|error| Problem::from(error).within("dynamics"))?;
        self.agent.check().map_err(|error| Problem::from(error).within("agent"))?;
        self.pretrain.check()?;
        require!(
            !(self.agent.is_external() && self.pretrain.is_on()),
            "agent.kind = \"external\" is a program whose agents calib cannot pre-train; leave [pretrain] out"
        );
        if let Some(control) = &self.control {
            control.check().map_err(|error| Problem::from(error).within("control"))?;
            let own = ControlConfig::default();
            require!(
                !(self.agent.is_external() && self.is_of_acting_agents())
                    || (control.agent, &control.grid) == (own.agent, &own.grid),
                "agent.kind = \"external\" makes a program act, and [control.agent] and [control.grid] are of calib's own agents; give the \
                 program's parameters in [agent.parameters] and the values to try in [sweep.grid], and leave these two out"
            );
        }
        // The upper limits are far above any practical use. They catch typing errors.
        let counts = [
            ("sweep.steps", self.sweep.steps, 2, MANY_STEPS),
            ("sweep.member_runs", self.sweep.member_runs, 1, MANY_RUNS),
            ("sweep.network_runs", self.sweep.runs_of_network(), 1, MANY_RUNS),
            ("sweep.online_runs", self.sweep.online_runs, 1, MANY_RUNS),
            ("sweep.online_windows", self.sweep.online_windows, 1, MANY_RUNS),
            ("sweep.log_replay_runs", self.sweep.log_replay_runs, 0, MANY_RUNS),
            ("sweep.curve_points", self.sweep.curve_points, 0, MANY_RUNS),
            ("pretrain.epochs", self.pretrain.epochs, 0, MANY_RUNS),
            ("rollout.steps", self.rollout.steps, 1, MANY_STEPS),
            ("rollout.rollouts", self.rollout.rollouts, 1, MANY_RUNS),
            ("rollout.recent_window", self.rollout.recent_window.unwrap_or(1), 1, usize::MAX),
            ("evaluate.top_k", self.evaluate.top_k, 1, MANY_RUNS),
            ("evaluate.resamples", self.evaluate.resamples, 0, MANY_RUNS),
        ];
        for (key, got, least, most) in counts {
            require!(
                (least..=most).contains(&got),
                "{key} must be from {least} to {most}, got {got}"
            );
        }
        require!(
            self.rollout.steps.saturating_mul(self.rollout.rollouts) <= MANY_STEPS,
            "rollout.steps x rollout.rollouts must be at most {MANY_STEPS}, got {} x {}",
            self.rollout.steps,
            self.rollout.rollouts
        );
        self.check_without_model()?;
        let sensors = &self.sweep.sensors;
        if let Some(twice) =
            (1..sensors.len()).find(|&place| sensors[..place].contains(&sensors[place]))
        {
            refuse!("sweep.sensors names {} twice; remove one", sensors[twice]);
        }
        self.check_gammas()?;
        self.check_angles()
    }

    /// Checks that no sensor has a discount factor without being predicted.
    fn check_gammas(&self) -> Result<(), Problem> {
        let sensors: Vec<&str> = self.sweep.sensors.iter().map(String::as_str).collect();
        for name in self.agent.gammas.keys() {
            let similar = nearest(name, &sensors)
                .map_or_else(String::new, |similar| format!(" (did you mean {similar}?)"));
            require!(
                sensors.contains(&name.as_str()),
                "agent.gammas names {name}{similar}, which sweep.sensors does not have; name a predicted sensor, or remove it"
            );
        }
        Ok(())
    }

    /// Refuses the name of an angle where one of its two channels is meant.
    /// The matches of the patterns in `data.angles` are unknown before the log is read.
    fn check_angles(&self) -> Result<(), Problem> {
        let mut named: Vec<(&str, &String)> = Vec::new();
        named.extend(self.sweep.sensors.iter().map(|name| ("sweep.sensors", name)));
        named.extend(self.sensors.keys().map(|name| ("sensors", name)));
        named.extend(self.preprocess.one_hot.iter().map(|name| ("preprocess.one_hot", name)));
        let columns = self.control.as_ref().map_or_else(Vec::new, ControlConfig::columns);
        named.extend(columns.iter().map(|name| ("control", name)));
        for (key, name) in named {
            require!(
                !self.data.angles.contains_key(name),
                "{key} names {name}, and data.angles makes {} and {} of it: name one of these",
                AnglePart::Sine.channel_of(name),
                AnglePart::Cosine.channel_of(name)
            );
        }
        Ok(())
    }

    /// Checks that a study without a model has another way to choose a setting.
    fn check_without_model(&self) -> Result<(), Problem> {
        if self.has_model() {
            return Ok(());
        }
        let rule = self.evaluate.rule;
        require!(
            rule.works_without_model(),
            "evaluate.rule = \"{}\" counts runs in a model, and model.kind = \"none\" is a study without one; use \"log_replay\", or set \
             model.kind = \"knn\"",
            rule.name()
        );
        require!(
            self.sweep.log_replay_runs > 0,
            "sweep.log_replay_runs = 0 leaves no run to choose by: without a model (model.kind = \"none\") and without log replay nothing \
             would decide; set it to 1 or more, or set model.kind = \"knn\""
        );
        Ok(())
    }

    /// Checks that the plant can be simulated, and that the study names one folder for the log.
    fn check_simulate(&self) -> Result<(), Problem> {
        let Some(simulate) = &self.simulate else { return Ok(()) };
        simulate.plant().map_err(|error| Problem::from(error).within("simulate"))?;
        let paths = self.data.path.0.as_slice();
        require!(
            matches!(paths, [path] if is_plain_folder(path)),
            "[simulate] writes to data.path, which must be one plain folder then, such as \"plant\", got {paths:?}; \
             change data.path, or remove [simulate]"
        );
        Ok(())
    }
}

/// Whether the path can be that of one folder: neither a pattern nor a log file.
fn is_plain_folder(path: &str) -> bool {
    let lower = path.to_lowercase();
    let is_file = [".parquet", ".parq", ".pq"].iter().any(|end| lower.ends_with(end));
    !path.is_empty() && !path.contains(['*', '?', '[', ']', '{', '}']) && !is_file
}
