//! Weights as named tensors in PyTorch's layout: `Linear.weight` is `[outputs, inputs]`.

use std::collections::BTreeMap;

use calib_files::{Tensor, Tensors};
use calib_nn::{Mlp, Naming};

use crate::{DynamicsError, FeedForward, GruLayer, Recurrent};

/// Key of the text with the kind of the weights.
const KIND: &str = "kind";
/// Key of the text with the number of states that fill the hidden state.
const HISTORY: &str = "history";

fn wrong(reason: impl Into<String>) -> DynamicsError {
    DynamicsError::Weights { reason: reason.into() }
}

fn tensor(name: String, shape: &[usize], values: Vec<f32>) -> Tensor {
    Tensor { name, shape: shape.to_vec(), values }
}

fn values(tensors: &Tensors, name: &str) -> Result<Vec<f32>, DynamicsError> {
    let found = tensors.get(name).ok_or_else(|| wrong(format!("there is no {name}")))?;
    Ok(found.values.clone())
}

fn check_kind(tensors: &Tensors, expected: &str) -> Result<(), DynamicsError> {
    match tensors.metadata.get(KIND) {
        Some(kind) if kind == expected => Ok(()),
        other => Err(wrong(format!("their kind is {other:?}, expected {expected}"))),
    }
}

impl FeedForward {
    /// Returns the weights with PyTorch's names: `layers.N.weight` `[outputs, inputs]` and `layers.N.bias`.
    pub fn to_tensors(&self) -> Tensors {
        let metadata = BTreeMap::from([(KIND.to_owned(), "nn".to_owned())]);
        Tensors { tensors: self.network().to_tensors(Naming::Layers), metadata }
    }

    /// Creates a model from [such](Self::to_tensors) weights.
    ///
    /// # Errors
    /// If they are of another kind, or of sizes that do not agree.
    pub fn from_tensors(tensors: &Tensors) -> Result<Self, DynamicsError> {
        check_kind(tensors, "nn")?;
        let network = Mlp::from_tensors(tensors, "", Naming::Layers);
        Self::new(network.map_err(|error| wrong(error.to_string()))?)
    }
}

impl Recurrent {
    /// Returns the weights with PyTorch's names: `gru.weight_ih_l0` … of a `GRU`, and `head.weight` and `head.bias` of
    /// a `Linear`.
    pub fn to_tensors(&self) -> Tensors {
        let units = self.hidden();
        let columns = self.head().1.len();
        let mut tensors = Vec::new();
        for (number, layer) in self.layers().iter().enumerate() {
            let inputs = layer.weight_ih.len() / (3 * units);
            let all = [
                ("weight_ih", vec![3 * units, inputs], &layer.weight_ih),
                ("weight_hh", vec![3 * units, units], &layer.weight_hh),
                ("bias_ih", vec![3 * units], &layer.bias_ih),
                ("bias_hh", vec![3 * units], &layer.bias_hh),
            ];
            for (name, shape, values) in all {
                tensors.push(tensor(format!("gru.{name}_l{number}"), &shape, values.clone()));
            }
        }
        let (weight, bias) = self.head();
        tensors.push(tensor("head.weight".to_owned(), &[columns, units], weight.to_vec()));
        tensors.push(tensor("head.bias".to_owned(), &[columns], bias.to_vec()));
        let history = crate::Dynamics::history(self).to_string();
        let metadata = [(KIND, "gru".to_owned()), (HISTORY, history)];
        let metadata = metadata.map(|(name, text)| (name.to_owned(), text));
        Tensors { tensors, metadata: BTreeMap::from(metadata) }
    }

    /// Creates a model from [such](Self::to_tensors) weights.
    ///
    /// # Errors
    /// If they are of another kind, or of sizes that do not agree.
    pub fn from_tensors(tensors: &Tensors) -> Result<Self, DynamicsError> {
        check_kind(tensors, "gru")?;
        let history = tensors.metadata.get(HISTORY).and_then(|text| text.parse().ok());
        let history = history.ok_or_else(|| wrong("they do not say their history"))?;
        let mut layers = Vec::new();
        while tensors.get(&format!("gru.weight_ih_l{}", layers.len())).is_some() {
            let number = layers.len();
            let [weight_ih, weight_hh, bias_ih, bias_hh] =
                ["weight_ih", "weight_hh", "bias_ih", "bias_hh"]
                    .map(|name| values(tensors, &format!("gru.{name}_l{number}")));
            layers.push(GruLayer {
                weight_ih: weight_ih?,
                weight_hh: weight_hh?,
                bias_ih: bias_ih?,
                bias_hh: bias_hh?,
            });
        }
        Self::new(layers, values(tensors, "head.weight")?, values(tensors, "head.bias")?, history)
    }
}

#[cfg(test)]
mod tests {
    use calib_core::Seed;

    use super::*;

    /// Returns a layer of four units.
    fn layer(inputs: usize) -> GruLayer {
        GruLayer {
            weight_ih: (0..12 * inputs).map(|v| v as f32).collect(),
            weight_hh: vec![0.5; 48],
            bias_ih: vec![0.25; 12],
            bias_hh: vec![0.75; 12],
        }
    }

    #[test]
    fn weights_come_back() {
        let network = Mlp::new(&[3, 5, 4, 3], Seed::new(1));
        let model = FeedForward::new(network).expect("square");
        let tensors = model.to_tensors();
        assert_eq!(tensors.get("layers.1.weight").expect("there").shape, [4, 5]);
        assert_eq!(FeedForward::from_tensors(&tensors).expect("they fit"), model);
        let layers = vec![layer(3), layer(4)];
        let model = Recurrent::new(layers, vec![1.0; 12], vec![2.0; 3], 19).expect("valid");
        let tensors = model.to_tensors();
        assert_eq!(tensors.get("gru.weight_ih_l1").expect("there").shape, [12, 4]);
        assert_eq!(Recurrent::from_tensors(&tensors).expect("they fit"), model);
        assert!(FeedForward::from_tensors(&tensors).is_err(), "another kind");
    }

    #[test]
    fn what_does_not_fit_is_named() {
        let model = FeedForward::new(Mlp::new(&[3, 5, 3], Seed::new(1))).expect("square");
        let mut tensors = model.to_tensors();
        tensors.tensors.retain(|tensor| tensor.name != "layers.1.bias");
        let error = FeedForward::from_tensors(&tensors).expect_err("a bias is missing");
        assert!(error.to_string().contains("layers.1.bias"), "{error}");
        let wide = FeedForward::new(Mlp::new(&[3, 4], Seed::new(1))).expect_err("wide");
        assert!(wide.to_string().contains("3 values go in and 4 come out"), "{wide}");
    }
}
