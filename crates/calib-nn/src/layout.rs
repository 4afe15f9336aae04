use calib_files::{Tensor, Tensors};

use crate::Mlp;

/// The names of the weights and biases of the layers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Naming {
    /// The names that `load_state_dict` of PyTorch's `Sequential(Linear, ReLU, …, Linear)` expects: `0.weight`, `0.bias`,
    /// `2.weight`, …
    Sequential,
    /// `layers.0.weight`, `layers.0.bias`, `layers.1.weight`, …
    Layers,
}

impl Naming {
    fn name(self, layer: usize, part: &str) -> String {
        match self {
            Self::Sequential => format!("{}.{part}", 2 * layer),
            Self::Layers => format!("layers.{layer}.{part}"),
        }
    }
}

/// The tensors do not form a network.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LayoutError {
    /// A tensor is missing.
    #[error("there is no `{0}`; expected a weight and a bias of every layer")]
    Missing(String),
    /// A tensor has the wrong shape.
    #[error("`{name}` has the shape {got:?}, expected {expected}")]
    Shape {
        /// Name of the tensor.
        name: String,
        /// Shape of the tensor.
        got: Vec<usize>,
        /// Expected shape.
        expected: String,
    },
}

impl Mlp {
    /// Returns the parameters in PyTorch's layout of `Linear`: weights `[outputs, inputs]` and biases `[outputs]`, layer by
    /// layer.
    pub fn to_tensors(&self, naming: Naming) -> Vec<Tensor> {
        self.layers()
            .iter()
            .enumerate()
            .flat_map(|(number, layer)| {
                let weights = &self.parameters()[layer.weights.clone()];
                let inputs = layer.inputs;
                let outputs = layer.outputs;
                let weight = Tensor {
                    name: naming.name(number, "weight"),
                    shape: vec![outputs, inputs],
                    values: transposed(weights, inputs, outputs),
                };
                let bias = self.parameters()[layer.bias.clone()].to_vec();
                [weight, Tensor::flat(naming.name(number, "bias"), bias)]
            })
            .collect()
    }

    /// Creates a network from [such](Self::to_tensors) tensors, whose names may have a `prefix`. The names determine the
    /// number of layers.
    ///
    /// # Errors
    /// If a tensor is missing or does not fit the previous layer.
    pub fn from_tensors(
        tensors: &Tensors,
        prefix: &str,
        naming: Naming,
    ) -> Result<Self, LayoutError> {
        let mut sizes = Vec::new();
        let mut parameters = Vec::new();
        for layer in 0.. {
            let [weight, bias] = ["weight", "bias"].map(|part| {
                let name = format!("{prefix}{}", naming.name(layer, part));
                tensors.get(&name).ok_or(LayoutError::Missing(name))
            });
            let weight = match weight {
                Err(_) if layer > 0 => break,
                found => found?,
            };
            let &[outputs, inputs] = weight.shape.as_slice() else {
                return Err(misshapen(weight, "[outputs, inputs]".to_owned()));
            };
            let before = sizes.last().copied().unwrap_or(inputs);
            if before != inputs || inputs * outputs == 0 || weight.values.len() != inputs * outputs
            {
                let expected = sizes.last().map_or("inputs".to_owned(), ToString::to_string);
                return Err(misshapen(weight, format!("[outputs, {expected}]")));
            }
            let bias = bias?;
            if bias.shape != [outputs] || bias.values.len() != outputs {
                return Err(misshapen(bias, format!("[{outputs}]")));
            }
            if sizes.is_empty() {
                sizes.push(inputs);
            }
            sizes.push(outputs);
            parameters.extend(transposed(&weight.values, outputs, inputs));
            parameters.extend_from_slice(&bias.values);
        }
        Ok(Self::from_parameters(&sizes, &parameters)
            .unwrap_or_else(|_| unreachable!("the parameters were collected by these sizes")))
    }
}

/// Transposes `[rows, columns]` into `[columns, rows]`.
fn transposed(values: &[f32], rows: usize, columns: usize) -> Vec<f32> {
    (0..columns).flat_map(|j| (0..rows).map(move |i| values[i * columns + j])).collect()
}

fn misshapen(tensor: &Tensor, expected: String) -> LayoutError {
    LayoutError::Shape { name: tensor.name.clone(), got: tensor.shape.clone(), expected }
}

#[cfg(test)]
mod tests {
    use calib_core::Seed;

    use super::*;

    fn read(tensors: &[Tensor]) -> Result<Mlp, LayoutError> {
        let content = Tensors { tensors: tensors.to_vec(), ..Tensors::default() };
        Mlp::from_tensors(&content, "", Naming::Sequential)
    }

    #[test]
    fn networks_come_back_from_pytorchs_layout() {
        let network = Mlp::new(&[3, 4, 2], Seed::new(1));
        let mut named = network.to_tensors(Naming::Sequential);
        let names: Vec<&str> = named.iter().map(|parameter| &parameter.name[..]).collect();
        assert_eq!(names, ["0.weight", "0.bias", "2.weight", "2.bias"]);
        assert_eq!(named[0].shape, [4, 3]);
        // In PyTorch, output o from input i is weight[o, i]; here it is weight[i, o].
        assert_eq!(named[0].values[2 * 3 + 1], network.parameters()[4 + 2]);
        assert_eq!(read(&named), Ok(network));
        named[2].shape = vec![2, 5];
        let error = read(&named).expect_err("misshapen").to_string();
        assert!(error.contains("`2.weight`") && error.contains("[outputs, 4]"), "{error}");
        assert!(read(&[]).expect_err("nothing").to_string().contains("`0.weight`"));
        assert!(read(&named[..1]).expect_err("no bias").to_string().contains("`0.bias`"));
    }
}
