use tch::{Device, TchError, Tensor};

/// Networks of one shape, whose parameters are stacked: `[networks, parameters]`, each as [`calib_nn::Mlp::parameters`].
pub(super) struct Stack {
    pub(super) parameters: Tensor,
    layers: Vec<Layer>,
}

/// Where the weights of a layer, `[inputs, outputs]`, and after them its biases are.
#[derive(Clone, Copy)]
struct Layer {
    inputs: i64,
    outputs: i64,
    weights: i64,
}

impl Layer {
    fn biases(self) -> i64 {
        self.weights + self.inputs * self.outputs
    }

    /// The weights of all networks, `[networks, inputs, outputs]`.
    fn weights_of(self, parameters: &Tensor) -> Result<Tensor, TchError> {
        let flat = parameters.f_narrow(1, self.weights, self.inputs * self.outputs)?;
        flat.f_view_([-1, self.inputs, self.outputs])
    }

    /// The biases of all networks, `[networks, 1, outputs]`.
    fn biases_of(self, parameters: &Tensor) -> Result<Tensor, TchError> {
        parameters.f_narrow(1, self.biases(), self.outputs)?.f_unsqueeze(1)
    }
}

impl Stack {
    /// Networks with these sizes of layers, of `parameters` one after the other.
    pub(super) fn new(
        sizes: &[usize],
        parameters: &[f32],
        device: Device,
    ) -> Result<Self, TchError> {
        let mut weights = 0;
        let mut layers = Vec::new();
        for pair in sizes.windows(2) {
            let layer = Layer { inputs: pair[0] as i64, outputs: pair[1] as i64, weights };
            weights = layer.biases() + layer.outputs;
            layers.push(layer);
        }
        let parameters = Tensor::f_from_slice(parameters)?.f_view_([-1, weights])?;
        Ok(Self { parameters: parameters.f_to_device(device)?, layers })
    }

    /// The same shape with other parameters.
    pub(super) fn with(&self, parameters: &Tensor) -> Self {
        Self { parameters: parameters.shallow_clone(), layers: self.layers.clone() }
    }

    /// The inputs of every layer and what comes out, of `[networks, rows, width]`.
    pub(super) fn forward(&self, states: &Tensor) -> Result<(Vec<Tensor>, Tensor), TchError> {
        let (mut inputs, mut hidden) = (Vec::new(), states.shallow_clone());
        for (number, layer) in self.layers.iter().enumerate() {
            let biases = layer.biases_of(&self.parameters)?;
            let mut made = biases.f_baddbmm(&hidden, &layer.weights_of(&self.parameters)?, 1, 1)?;
            if number + 1 < self.layers.len() {
                made = made.f_relu_()?;
            }
            inputs.push(std::mem::replace(&mut hidden, made));
        }
        Ok((inputs, hidden))
    }

    /// Gradient of the parameters, `[networks, parameters]`, where that of the outputs of the first `rows` rows is `slope`,
    /// `[networks, rows, outputs]`, and [`forward`](Self::forward) gave `inputs`.
    pub(super) fn backward(
        &self,
        inputs: &[Tensor],
        slope: Tensor,
        rows: i64,
    ) -> Result<Tensor, TchError> {
        let gradient = self.parameters.f_empty_like()?;
        let mut slope = slope;
        for (number, (layer, inputs)) in self.layers.iter().zip(inputs).enumerate().rev() {
            let inputs = inputs.f_narrow(1, 0, rows)?;
            let weights = inputs.f_transpose(1, 2)?.f_bmm(&slope)?;
            layer.weights_of(&gradient)?.f_copy_(&weights)?;
            let biases = slope.f_sum_dim_intlist(&[1_i64][..], true, None)?;
            layer.biases_of(&gradient)?.f_copy_(&biases)?;
            if number > 0 {
                let before = self.layers[number].weights_of(&self.parameters)?.f_transpose(1, 2)?;
                slope = slope.f_bmm(&before)?.f_mul(&inputs.f_gt(0)?)?;
            }
        }
        Ok(gradient)
    }
}

/// States of each run, `[runs, rows, width]`, for each of its networks, `[networks, rows, width]`.
pub(super) fn expanded(states: &Tensor, learners: i64) -> Result<Tensor, TchError> {
    let [runs, rows, width] = states.size3()?.into();
    let all = states.f_unsqueeze(1)?.f_expand([runs, learners, rows, width], false)?;
    all.f_reshape([runs * learners, rows, width])
}

/// A column of numbers, `[n, 1]`.
pub(super) fn column<T: tch::kind::Element>(
    numbers: &[T],
    device: Device,
) -> Result<Tensor, TchError> {
    Tensor::f_from_slice(numbers)?.f_view_([-1, 1])?.f_to_device(device)
}
