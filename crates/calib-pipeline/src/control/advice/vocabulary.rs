//! The names that users know for what the advice speaks of.

/// The user's names for the settings of a verdict.
#[derive(Clone, Copy, Debug)]
pub struct Vocabulary {
    /// The length of training.
    pub steps: &'static str,
    /// The number of runs per setting.
    pub runs: &'static str,
    /// The number of ensemble members.
    pub members: &'static str,
    /// The largest share of steps that the log may leave uncovered.
    pub most_uncovered: &'static str,
    /// The smallest number of terminals in the log.
    pub fewest_terminals: &'static str,
    /// A statement of what the default is.
    pub default: &'static str,
    /// A statement that no default is compared.
    pub no_default: &'static str,
    /// A statement that the default failed.
    pub default_failed: &'static str,
    /// The remedy for a default that failed.
    pub mend_default: &'static str,
    /// The remedy for too few settings.
    pub add_settings: &'static str,
}

/// The keys of a study.
pub(crate) const STUDY: Vocabulary = Vocabulary {
    steps: "control.steps",
    runs: "control.runs",
    members: "control.model.members",
    most_uncovered: "control.most_uncovered",
    fewest_terminals: "control.fewest_terminals",
    default: "the default is the agent of [control.agent], not what runs on the plant",
    no_default: "The default is not in the grid.",
    default_failed: "the program failed with the default",
    mend_default: "mend the program and run the same command again",
    add_settings: "Add values to [control.grid], such as step_size = [0.003, 0.03, 0.3].",
};

/// The keys of a study whose agents belong to a program.
pub(crate) const PROGRAM: Vocabulary = Vocabulary {
    default: "the default is the agent of [agent.parameters], not what runs on the plant",
    add_settings: "Add values to [sweep.grid].",
    ..STUDY
};

/// The arguments of `calib_rl.tune`.
pub const PYTHON: Vocabulary = Vocabulary {
    steps: "total_timesteps",
    runs: "runs",
    members: "members=, and control.model.members of the model",
    most_uncovered: "most_uncovered",
    fewest_terminals: "fewest_terminals",
    default: "the default is the agent as it is, or with the values of default=, not what runs on the plant",
    no_default: "No default was compared.",
    default_failed: "the default was tried, and failed",
    mend_default: "see in `failures` why, and mend it, or name another one with default=",
    add_settings: "Add values to the grid.",
};
