use crate::{Layer, Mlp};

/// A parameter of a network as PyTorch names and lays it out.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedParameter {
    /// Its name, such as `2.weight`.
    pub name: String,
    /// `[outputs, inputs]` of a weight, `[outputs]` of a bias.
    pub shape: Vec<usize>,
    /// Values, last dimension fastest.
    pub values: Vec<f32>,
}

/// Named parameters are not those of a network.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SequentialError {
    /// One is missing.
    #[error("there is no `{0}`; expected the weights of Sequential(Linear, ReLU, …, Linear)")]
    Missing(String),
    /// One has another shape.
    #[error("`{name}` has the shape {got:?}, expected {expected}")]
    Shape {
        /// The parameter.
        name: String,
        /// Its shape.
        got: Vec<usize>,
        /// What it should be.
        expected: String,
    },
}

impl Mlp {
    /// The parameters as those of PyTorch's `Sequential(Linear, ReLU, Linear, …, Linear)`: layer l is
    /// `{2l}.weight` `[outputs, inputs]` and `{2l}.bias` `[outputs]`, ready for `load_state_dict`.
    pub fn to_sequential(&self) -> Vec<NamedParameter> {
        let named = |(index, layer): (usize, &Layer)| {
            let weights = &self.parameters()[layer.weights.clone()];
            let (inputs, outputs) = (layer.inputs, layer.outputs);
            let places =
                (0..outputs).flat_map(|output| (0..inputs).map(move |input| (input, output)));
            let values = places.map(|(input, output)| weights[input * outputs + output]).collect();
            let bias = self.parameters()[layer.bias.clone()].to_vec();
            [
                NamedParameter {
                    name: name(index, "weight"),
                    shape: vec![outputs, inputs],
                    values,
                },
                NamedParameter { name: name(index, "bias"), shape: vec![outputs], values: bias },
            ]
        };
        self.layers().iter().enumerate().flat_map(named).collect()
    }

    /// The network whose parameters these are; layers are counted by their names. The inverse of
    /// [`Mlp::to_sequential`]. `parameter` returns the shape and the values of the parameter of that name.
    ///
    /// # Errors
    /// If a parameter is missing or does not fit the layer before it.
    pub fn from_sequential<'a>(
        parameter: impl Fn(&str) -> Option<(&'a [usize], &'a [f32])>,
    ) -> Result<Self, SequentialError> {
        let (mut sizes, mut parameters) = (Vec::new(), Vec::new());
        for index in 0.. {
            let weight = name(index, "weight");
            let Some((shape, values)) = parameter(&weight) else {
                if index == 0 {
                    return Err(SequentialError::Missing(weight));
                }
                break;
            };
            let fits = |inputs: usize| sizes.last().is_none_or(|&before| before == inputs);
            let &[outputs, inputs] = shape else {
                return Err(misshapen(weight, shape, "[outputs, inputs]".to_owned()));
            };
            if !fits(inputs) || inputs * outputs == 0 || values.len() != inputs * outputs {
                let before = sizes.last().map_or("inputs".to_owned(), ToString::to_string);
                return Err(misshapen(weight, shape, format!("[outputs, {before}]")));
            }
            let bias = name(index, "bias");
            let (shape, bias_values) =
                parameter(&bias).ok_or_else(|| SequentialError::Missing(bias.clone()))?;
            if shape != [outputs] || bias_values.len() != outputs {
                return Err(misshapen(bias, shape, format!("[{outputs}]")));
            }
            if sizes.is_empty() {
                sizes.push(inputs);
            }
            sizes.push(outputs);
            for input in 0..inputs {
                parameters.extend((0..outputs).map(|output| values[output * inputs + input]));
            }
            parameters.extend_from_slice(bias_values);
        }
        Ok(Self::from_parameters(&sizes, parameters)
            .unwrap_or_else(|_| unreachable!("the parameters were collected by these sizes")))
    }
}

fn name(index: usize, of: &str) -> String {
    format!("{}.{of}", 2 * index)
}

fn misshapen(name: String, got: &[usize], expected: String) -> SequentialError {
    SequentialError::Shape { name, got: got.to_vec(), expected }
}

#[cfg(test)]
mod tests {
    use calib_core::Seed;

    use super::*;

    fn read(named: &[NamedParameter]) -> Result<Mlp, SequentialError> {
        Mlp::from_sequential(|name| {
            let found = named.iter().find(|parameter| parameter.name == name)?;
            Some((&found.shape[..], &found.values[..]))
        })
    }

    #[test]
    fn networks_come_back_from_pytorchs_layout() {
        let network = Mlp::new(&[3, 4, 2], Seed::new(1));
        let mut named = network.to_sequential();
        let names: Vec<&str> = named.iter().map(|parameter| &parameter.name[..]).collect();
        assert_eq!(names, ["0.weight", "0.bias", "2.weight", "2.bias"]);
        assert_eq!(named[0].shape, [4, 3]);
        // PyTorch: output o from input i is weight[o, i]; ours is weight[i, o].
        assert_eq!(named[0].values[2 * 3 + 1], network.parameters()[4 + 2]);
        assert_eq!(read(&named), Ok(network));
        named[2].shape = vec![2, 5];
        let error = read(&named).expect_err("misshapen").to_string();
        assert!(error.contains("`2.weight`") && error.contains("[outputs, 4]"), "{error}");
        assert!(read(&[]).expect_err("nothing").to_string().contains("`0.weight`"));
        assert!(read(&named[..1]).expect_err("no bias").to_string().contains("`0.bias`"));
    }
}
