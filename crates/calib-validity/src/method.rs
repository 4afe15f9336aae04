//! Ways to choose a value, by name.

use std::{borrow::Cow, fmt};

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Serialize, Serializer};

/// A way to choose a value.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Method {
    /// What calib chooses in a model by the rule of the study.
    Model(String),
    /// What a rule chooses from the evidence of a model.
    RuleOf(String, String),
    /// What a rule chooses from the evidence of each model, all models together.
    Rule(String),
    /// On each sensor the choice of the model with the smallest one-step error there.
    MostAccurate,
    /// On each sensor the choice of the model whose rollouts warp least.
    LeastWarped,
    /// The value that is best on the replayed log.
    LogReplay,
    /// The value that is best on the latest window of the replayed log.
    LatestWindow,
    /// The value that the study gives as its default.
    Default,
    /// The one value with the smallest typical regret over all pairs: nobody knows it beforehand.
    BestDefault,
    /// The same for each optimiser by itself.
    BestDefaultOfOptimiser,
    /// The one value with the smallest typical regret over the pairs of all other plants: what experience would say.
    OtherPlants,
    /// The same over the other plants whose agents have the same optimiser.
    OtherPlantsWithOptimiser,
    /// Any value of the grid, evenly: the mean of their regrets.
    Random,
    /// The best constant value over the held-out windows of the pair itself: nobody can do better.
    Hindsight,
    /// The best value of one held-out window, judged on the others: what sees the deployment itself, at another time.
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
    /// The name in files: `model:NAME`, `model:NAME:RULE`, `rule:RULE`, or words.
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

    /// Whether it is what a model chooses by the rule of the study.
    pub fn is_model(&self) -> bool {
        matches!(self, Self::Model(_))
    }

    /// Whether it sees held-out data, and is no way to choose.
    pub fn is_floor(&self) -> bool {
        matches!(self, Self::Hindsight | Self::AnotherWindow)
    }
}
