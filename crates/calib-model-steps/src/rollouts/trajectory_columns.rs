//! The names of a sensor's columns in `trajectories.parquet`.

use std::collections::BTreeSet;

/// Columns that do not belong to a sensor.
const OTHERS: [&str; 7] =
    ["member", "rollout", "step", "row", "timestamp", "wanted_row", "wanted_timestamp"];

/// Prefix for a sensor whose columns would have the name of another column.
const PREFIX: &str = "sensor:";

/// The columns of one sensor.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Columns {
    /// Values in physical units.
    pub physical: String,
    /// Normalised values.
    pub(crate) normalised: String,
    /// The record, in physical units.
    pub recorded: String,
}

impl Columns {
    /// Returns the columns of each of `sensors`: `NAME`, `NAME.normalised`, `NAME.recorded`. If one of them would have
    /// the name of another column, the prefix `sensor:` is added, repeatedly if necessary.
    pub fn of<S: AsRef<str>>(sensors: &[S]) -> Vec<Self> {
        let plain: Vec<Self> = sensors.iter().map(|name| Self::called(name.as_ref())).collect();
        let unusual: Vec<bool> = (0..plain.len())
            .map(|place| {
                let others = plain.iter().enumerate().filter(|(other, _)| *other != place);
                let taken: BTreeSet<&str> = (OTHERS.into_iter())
                    .chain(others.flat_map(|(_, column)| column.names()))
                    .collect();
                plain[place].names().iter().any(|name| taken.contains(name))
            })
            .collect();
        let mut taken: BTreeSet<String> = OTHERS.map(str::to_owned).into();
        // Names that need no prefix are reserved before the others are chosen.
        for (columns, _) in plain.iter().zip(&unusual).filter(|(_, unusual)| !**unusual) {
            taken.extend(columns.names().map(str::to_owned));
        }
        plain
            .clone()
            .into_iter()
            .zip(unusual)
            .map(|(columns, unusual)| {
                if !unusual {
                    return columns;
                }
                let mut name = columns.physical;
                loop {
                    name.insert_str(0, PREFIX);
                    let own = Self::called(&name);
                    if !own.names().iter().any(|name| taken.contains(*name)) {
                        taken.extend(own.names().map(str::to_owned));
                        return own;
                    }
                }
            })
            .collect()
    }

    fn called(name: &str) -> Self {
        Self {
            physical: name.to_owned(),
            normalised: format!("{name}.normalised"),
            recorded: format!("{name}.recorded"),
        }
    }

    fn names(&self) -> [&str; 3] {
        [&self.physical, &self.normalised, &self.recorded]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn physical(sensors: &[&str]) -> Vec<String> {
        Columns::of(sensors).into_iter().map(|columns| columns.physical).collect()
    }

    #[test]
    fn names_stay_unless_they_are_taken() {
        assert_eq!(physical(&["PIT300", "steps"]), ["PIT300", "steps"]);
        assert_eq!(physical(&["step", "row", "A"]), ["sensor:step", "sensor:row", "A"]);
        let nested = ["sensor:A", "sensor:sensor:A.normalised"];
        assert_eq!(physical(&["A", "A.normalised"]), nested);
    }

    #[test]
    fn every_column_has_a_name_of_its_own() {
        let parts = ["A", "step", "row", "sensor:", ".normalised", ".recorded"];
        let mut names: Vec<String> = Vec::new();
        for one in parts {
            for other in parts {
                for third in ["", "sensor:", ".recorded"] {
                    names.push(format!("{third}{one}{other}"));
                }
                names.push(one.to_owned());
            }
        }
        names.sort();
        names.dedup();
        let all = Columns::of(&names);
        let different: BTreeSet<&str> =
            OTHERS.into_iter().chain(all.iter().flat_map(Columns::names)).collect();
        assert_eq!(different.len(), OTHERS.len() + 3 * names.len());
    }
}
