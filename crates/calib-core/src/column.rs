use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A value in the unit of its sensor.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Physical(pub f64);

/// A value on the scale of the states, usually in `[0, 1]` over the training range.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Normalised(pub f32);

/// The affine map of one column: `normalised = (physical - offset) / scale`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Bounds {
    /// Physical value that maps to 0.
    pub offset: f64,
    /// Physical span that maps to 1; positive and finite.
    pub scale: f64,
}

impl Bounds {
    /// The identity map, for a column that is already on the scale of the states.
    pub const IDENTITY: Self = Self { offset: 0.0, scale: 1.0 };

    /// Converts to the scale of the states.
    pub fn normalise(self, value: Physical) -> Normalised {
        Normalised(((value.0 - self.offset) / self.scale) as f32)
    }

    /// Converts to the unit of the sensor.
    pub fn physical(self, value: Normalised) -> Physical {
        Physical(f64::from(value.0) * self.scale + self.offset)
    }
}

/// The kind of a column of the states.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ColumnKind {
    /// A sensor of the plant.
    Sensor,
    /// A feature computed from the log: time of day, trace, one-hot mode.
    Feature,
}

/// One column of the states.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Column {
    /// The name of the channel in the log, or of the feature.
    pub name: String,
    /// Sensor or feature.
    pub kind: ColumnKind,
    /// The map between physical and normalised values, fitted on the training range.
    pub bounds: Bounds,
}

/// The columns of the states, in order, with their maps between physical and normalised units.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct Normaliser {
    columns: Vec<Column>,
}

impl Normaliser {
    /// Returns a normaliser over these columns.
    pub fn new(columns: Vec<Column>) -> Self {
        Self { columns }
    }

    /// Returns the columns in the order of the states.
    pub fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// Returns the number of columns.
    pub fn len(&self) -> usize {
        self.columns.len()
    }

    /// Whether there are no columns.
    pub fn is_empty(&self) -> bool {
        self.columns.is_empty()
    }

    /// Returns the position of the column with this name.
    pub fn position(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|column| column.name == name)
    }

    /// Converts a value of column `column` to the unit of its sensor.
    pub fn physical(&self, column: usize, value: Normalised) -> Physical {
        self.columns[column].bounds.physical(value)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn physical_values_come_back(value in -1e6_f64..1e6, offset in -1e6_f64..1e6, scale in 1e-3_f64..1e6) {
            let bounds = Bounds { offset, scale };
            let back = bounds.physical(bounds.normalise(Physical(value))).0;
            // f32 keeps 24 bits of the normalised value.
            let tolerance = 1e-7 * ((value - offset).abs() + offset.abs() + scale);
            prop_assert!((back - value).abs() <= tolerance);
        }
    }
}
