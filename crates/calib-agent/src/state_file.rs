use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use calib_files::{CheckpointFile, FileError, Tensor, Tensors};
use calib_nn::Moments;
use serde::{Deserialize, Serialize, de::DeserializeOwned};

use crate::{Checkpoint, ValueState};

/// The state of unfinished training in one file (safetensors, with non-array data as JSON in its
/// metadata).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StateFile(CheckpointFile);

/// The data that are not arrays.
#[derive(Serialize, Deserialize)]
struct Scalars {
    number: usize,
    updates: usize,
    powers: Option<(f64, f64)>,
}

const PARTS: [&str; 5] = ["parameters", "mean", "square", "target", "traces"];

impl StateFile {
    /// Returns the file at `path` for the training that `key` identifies.
    pub fn new(path: PathBuf, key: String) -> Self {
        Self(CheckpointFile::new(path, key))
    }

    /// Returns the path of the file.
    pub fn path(&self) -> &Path {
        self.0.path()
    }

    /// Reads the last written progress and value functions. `None` if the file is missing, damaged or of
    /// another training.
    pub fn read<P: DeserializeOwned>(&self) -> Option<(P, Vec<(usize, ValueState)>)> {
        let mut file = self.0.read()?;
        let progress = serde_json::from_str(file.metadata.get("progress")?).ok()?;
        let scalars: Vec<Scalars> = serde_json::from_str(file.metadata.get("scalars")?).ok()?;
        let mut arrays: BTreeMap<String, Vec<f32>> =
            file.tensors.drain(..).map(|tensor| (tensor.name, tensor.values)).collect();
        let values = scalars.into_iter().map(|Scalars { number, updates, powers }| {
            let [parameters, mean, square, target, traces] =
                PARTS.map(|part| arrays.remove(&format!("{number}.{part}")));
            let moments = match powers {
                Some(powers) => Some(Moments { mean: mean?, square: square?, powers }),
                None => None,
            };
            let checkpoint = Checkpoint { parameters: parameters?, moments };
            Some((number, ValueState { checkpoint, target, traces, updates }))
        });
        Some((progress, values.collect::<Option<_>>()?))
    }

    /// Writes progress and numbered value functions in place of the previous content.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write<P: Serialize>(
        &self,
        progress: &P,
        values: Vec<(usize, ValueState)>,
    ) -> Result<(), FileError> {
        let mut tensors = Vec::new();
        let mut scalars = Vec::new();
        for (number, ValueState { checkpoint, target, traces, updates }) in values {
            let Checkpoint { parameters, moments } = checkpoint;
            let powers = moments.as_ref().map(|moments| moments.powers);
            let (mean, square) = moments.map(|Moments { mean, square, .. }| (mean, square)).unzip();
            scalars.push(Scalars { number, updates, powers });
            for (part, values) in PARTS.iter().zip([Some(parameters), mean, square, target, traces])
            {
                let name = format!("{number}.{part}");
                tensors.extend(values.map(|values| Tensor::flat(name, values)));
            }
        }
        let metadata = BTreeMap::from([
            ("progress".to_owned(), serde_json::json!(progress).to_string()),
            ("scalars".to_owned(), serde_json::json!(scalars).to_string()),
        ]);
        self.0.write(Tensors { tensors, metadata })
    }

    /// Removes the file after the training is finished.
    pub fn remove(&self) {
        // If the file remains, other training ignores it.
        let _ = self.0.remove();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a value function of three parameters after seven updates.
    fn state(target: Option<Vec<f32>>, powers: Option<(f64, f64)>) -> ValueState {
        ValueState {
            checkpoint: Checkpoint {
                parameters: vec![0.1, -0.0, 3.0],
                moments: powers.map(|powers| Moments {
                    mean: vec![1e-40, 2.0, 3.0],
                    square: vec![0.3; 3],
                    powers,
                }),
            },
            traces: target.clone(),
            target,
            updates: 7,
        }
    }

    #[test]
    fn states_come_back_and_only_to_the_same_training() {
        let directory = tempfile::tempdir().expect("a directory");
        let [own, other] =
            ["a", "b"].map(|key| StateFile::new(directory.path().join("a/state"), key.to_owned()));
        let values = vec![
            (0, state(None, Some((0.1 + 0.2, 1e-300)))),
            (3, state(Some(vec![1.0, 2.0, 3.0]), None)),
        ];
        let progress = (5, 0.1_f64 + 0.2);
        assert_eq!(own.read::<(i32, f64)>(), None);
        own.write(&progress, values.clone()).expect("written");
        assert_eq!(own.read(), Some((progress, values)));
        assert_eq!(other.read::<(i32, f64)>(), None);
        own.remove();
        assert_eq!(own.read::<(i32, f64)>(), None);
    }
}
