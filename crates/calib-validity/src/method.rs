//! Selection methods, by name.

use std::{borrow::Cow, fmt};

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Serialize, Serializer};

/// A selection method: a way to choose a value.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Method {
    /// calib's choice in a model by the rule of the study.
    Model(String),
    /// The choice of a rule from the evidence of a model.
    RuleOf(String, String),
    /// The choices of a rule from the evidence of each model, all models together.
    Rule(String),
    /// On each sensor the choice of the model with the smallest one-step error there.
    MostAccurate,
    /// On each sensor the choice of the model whose rollouts have the smallest warping distance.
    LeastWarped,
    /// The value that is best on the replayed log.
    LogReplay,
    /// The value that is best on the latest window of the replayed log.
    LatestWindow,
    /// The default value of the study.
    Default,
    /// The single value with the smallest typical regret over all pairs. It is known only afterwards.
    BestDefault,
    /// The best single value for each optimiser, known only afterwards.
    BestDefaultOfOptimiser,
    /// The single value with the smallest typical regret over the pairs of all other plants: a choice by experience.
    OtherPlants,
    /// The same over the other plants whose agents have the same optimiser.
    OtherPlantsWithOptimiser,
    /// A uniformly random value of the grid: the mean of all regrets.
    Random,
    /// The best constant value over the held-out windows of the pair itself, a lower bound on regret.
    Hindsight,
    /// The best value of one held-out window, judged on the others. It sees the deployment itself, at another time.
    AnotherWindow,
}

impl fmt::Display for Method {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Model(model) => model,
            Self::RuleOf(model, rule) => {
                return write!(formatter, "{model}, {}", rule.replace('_', " "));
            }
            Self::Rule(rule) => return formatter.write_str(&rule.replace('_', " ")),
            Self::MostAccurate => "least one-step error",
            Self::LeastWarped => "least warping distance",
            Self::LogReplay => "log replay",
            Self::LatestWindow => "latest window of the log",
            Self::Default => "the study's default",
            Self::BestDefault => "best default in hindsight",
            Self::BestDefaultOfOptimiser => "best default per optimiser",
            Self::OtherPlants => "other plants' best default",
            Self::OtherPlantsWithOptimiser => "others' best, same optimiser",
            Self::Random => "random choice",
            Self::Hindsight => "best fixed setting",
            Self::AnotherWindow => "another window",
        })
    }
}

impl Serialize for Method {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&self.name())
    }
}

impl JsonSchema for Method {
    fn schema_name() -> Cow<'static, str> {
        "Method".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        let description = "A way to choose a setting: model:NAME, model:NAME:RULE, rule:RULE, or words such as log_replay";
        json_schema!({ "type": "string", "description": description })
    }
}

impl Method {
    /// Returns the name in files: `model:NAME`, `model:NAME:RULE`, `rule:RULE`, or words.
    pub fn name(&self) -> String {
        match self {
            Self::Model(model) => return format!("model:{model}"),
            Self::RuleOf(model, rule) => return format!("model:{model}:{rule}"),
            Self::Rule(rule) => return format!("rule:{rule}"),
            Self::MostAccurate => "most_accurate_model",
            Self::LeastWarped => "least_warped_model",
            Self::LogReplay => "log_replay",
            Self::LatestWindow => "latest_window",
            Self::Default => "default",
            Self::BestDefault => "best_default",
            Self::BestDefaultOfOptimiser => "best_default_of_optimiser",
            Self::OtherPlants => "best_default_of_other_plants",
            Self::OtherPlantsWithOptimiser => "best_default_of_other_plants_with_optimiser",
            Self::Random => "random",
            Self::Hindsight => "hindsight",
            Self::AnotherWindow => "another_window",
        }
        .to_owned()
    }

    /// Whether it is the choice of a model by the rule of the study.
    pub fn is_model(&self) -> bool {
        matches!(self, Self::Model(_))
    }

    /// Whether it sees held-out data, and so is a reference rather than a usable method.
    pub fn is_floor(&self) -> bool {
        matches!(self, Self::Hindsight | Self::AnotherWindow)
    }
}
