use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{Exclusion, KnnError, PrototypeKind, SelfMatch, Shortcuts, Weights};

/// The keys of `[model]` in a study about neighbours.
///
/// | key | default | meaning |
/// |---|---|---|
/// | `members` | 5 | blocks `B`, and members of the ensemble; at least 2 |
/// | `neighbors` | 3 | neighbours `k` of each transition; at least 1 |
/// | `exclude_self` | false | forbid a row as its own neighbour |
/// | `theiler` | 0 | Theiler window in rows; 0 for none |
/// | `weights` | `"linear"` | weights by which a step samples a neighbour: `"linear"`, `"uniform"`, `"softmax"`, `"inverse"`, `"rank"` |
/// | `temperature` | 1.0 | only for `"softmax"`; positive, in units of distance |
/// | `prototypes` | 1 | only about one source in N can be a neighbour |
/// | `prototype_kind` | `"every"` | which sources: `"every"` N-th in time order, or those that cover the states, `"k_centre"` |
/// | `components` | 0 | principal components in which neighbours are searched; 0 for all columns |
/// | `leaf_budget` | 0 | maximum number of leaves that the join visits for a band of queries, not counting their own; 0 for no limit |
/// | `remove_traps` | true | remove transitions that would trap rollouts |
/// | `index` | `"auto"` | search structure: `"auto"`, `"kd_tree"`, `"join"`, `"scan"`; the tables are the same |
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ModelConfig {
    /// Blocks of the log, which is also the number of ensemble members: each lacks one block.
    pub members: usize,
    /// Neighbours of each transition.
    pub neighbors: usize,
    /// Forbid a row as its own neighbour.
    pub exclude_self: bool,
    /// Theiler window in rows.
    pub theiler: u32,
    /// Weights by which a step samples a neighbour.
    pub weights: WeightsKind,
    /// Temperature of softmax weights, in units of distance.
    pub temperature: f64,
    /// About one source in N can be a neighbour, where N is this number.
    pub prototypes: u32,
    /// Which sources can be neighbours, if `prototypes` is above 1.
    pub prototype_kind: PrototypeKind,
    /// Principal components in which neighbours are searched; 0 for all columns.
    pub components: usize,
    /// Maximum number of leaves that the join visits for a band of queries, not counting their own; 0 for no limit.
    pub leaf_budget: usize,
    /// Remove transitions that would trap rollouts. The earlier name of this key is `recurrent`.
    #[serde(alias = "recurrent")]
    pub remove_traps: bool,
    /// Search structure.
    pub index: IndexKind,
}

impl Default for ModelConfig {
    fn default() -> Self {
        Self {
            members: 5,
            neighbors: 3,
            exclude_self: false,
            theiler: 0,
            weights: WeightsKind::Linear,
            temperature: 1.0,
            prototypes: 1,
            prototype_kind: PrototypeKind::Every,
            components: 0,
            leaf_budget: 0,
            remove_traps: true,
            index: IndexKind::Auto,
        }
    }
}

/// Weights by which a step samples one of the neighbours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum WeightsKind {
    /// The weight falls linearly with the neighbour's share of the distances.
    #[default]
    Linear,
    /// All neighbours have the same weight.
    Uniform,
    /// Boltzmann weights of the distances, by `temperature`.
    Softmax,
    /// The weight is the inverse of the distance.
    Inverse,
    /// The weight is the inverse of the neighbour's rank, as in the k-nearest-neighbour bootstrap.
    Rank,
}

/// The search structure that builds the tables. All structures give identical tables.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum IndexKind {
    /// The structure that suits the data.
    #[default]
    Auto,
    /// A k-d tree, for few columns.
    KdTree,
    /// Leaves with bounding boxes, for data with structure.
    Join,
    /// Comparison of every pair, for data without structure.
    Scan,
}

impl ModelConfig {
    /// Returns which sources may not be neighbours.
    pub fn exclusion(&self) -> Exclusion {
        Exclusion {
            self_match: if self.exclude_self { SelfMatch::Excluded } else { SelfMatch::Allowed },
            theiler: self.theiler,
        }
    }

    /// Returns the options that make the search approximate.
    pub fn shortcuts(&self) -> Shortcuts {
        let Self { prototypes, prototype_kind, components, leaf_budget, .. } = *self;
        Shortcuts { prototypes, prototype_kind, components, leaf_budget }
    }

    /// Returns how a neighbour is drawn.
    ///
    /// # Errors
    /// If softmax has a temperature that is not positive and finite.
    pub fn weights(&self) -> Result<Weights, KnnError> {
        match self.weights {
            WeightsKind::Linear => Ok(Weights::Linear),
            WeightsKind::Uniform => Ok(Weights::Uniform),
            WeightsKind::Inverse => Ok(Weights::Inverse),
            WeightsKind::Rank => Ok(Weights::Rank),
            WeightsKind::Softmax if self.temperature > 0.0 && self.temperature.is_finite() => {
                Ok(Weights::Softmax { temperature: self.temperature })
            }
            WeightsKind::Softmax => Err(KnnError::Temperature { got: self.temperature }),
        }
    }

    /// Checks what can be checked before data is read.
    ///
    /// # Errors
    /// Fewer than two members, no neighbours, no prototypes, a leaf budget for a structure without leaves, or a bad
    /// temperature.
    pub fn check(&self) -> Result<(), KnnError> {
        if self.members < 2 {
            return Err(KnnError::TooFewMembers { members: self.members });
        }
        if self.neighbors == 0 {
            return Err(KnnError::NoNeighbors);
        }
        if self.prototypes == 0 {
            return Err(KnnError::NoPrototypes);
        }
        if self.leaf_budget > 0 && !matches!(self.index, IndexKind::Auto | IndexKind::Join) {
            return Err(KnnError::Budget { index: self.index.name() });
        }
        self.weights().map(|_| ())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_section_is_the_documented_default() {
        let config: ModelConfig = toml::from_str("").expect("all keys have defaults");
        assert_eq!(config, ModelConfig::default());
        assert_eq!(config.exclusion(), Exclusion::default());
        assert_eq!(config.weights().expect("linear"), Weights::Linear);
    }

    #[test]
    fn a_section_is_read_and_checked() {
        let text = "members = 4\nneighbors = 2\nexclude_self = true\ntheiler = 60\nweights = \"softmax\"\ntemperature = 0.5\nindex = \"kd_tree\"";
        let config: ModelConfig = toml::from_str(text).expect("valid");
        assert_eq!(config.weights().expect("valid"), Weights::Softmax { temperature: 0.5 });
        assert_eq!(config.exclusion().theiler, 60);
        assert_eq!(config.exclusion().self_match, SelfMatch::Excluded);
        assert_eq!(config.index, IndexKind::KdTree);
        assert!(toml::from_str::<ModelConfig>("neighbours = 3").is_err());
        let cold = ModelConfig { temperature: 0.0, ..config };
        assert!(matches!(cold.check(), Err(KnnError::Temperature { .. })));
        let no_leaves = ModelConfig { leaf_budget: 5, ..config };
        assert!(no_leaves.check().expect_err("a tree").to_string().contains("\"kd_tree\""));
        let no_prototypes = ModelConfig { prototypes: 0, ..config };
        assert!(matches!(no_prototypes.check(), Err(KnnError::NoPrototypes)));
        let none = ModelConfig { neighbors: 0, ..config };
        assert!(matches!(none.check(), Err(KnnError::NoNeighbors)));
    }
}
