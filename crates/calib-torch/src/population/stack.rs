use tch::{Device, Kind, TchError, Tensor};

/// Number of networks in one product on a GPU. It is constant, because a library may choose another order of sums for another number. So
/// the result of a network does not depend on how many others are trained beside it.
const ON_GPU: i64 = 32;
const ON_PROCESSOR: i64 = 4;
/// Number of values in 64 bytes. Matrices begin at multiples of it, because a library may choose its method by their alignment.
const ALIGNED: i64 = 16;

/// Networks of one shape with stacked parameters, `[networks, places]`. The order is that of [`calib_nn::Mlp::parameters`], with gaps of
/// zeros that align weights and biases. Unused networks of zeros pad the stack to whole products.
pub(super) struct Stack {
    pub(super) parameters: Tensor,
    layers: Vec<Layer>,
    /// Number of networks in a product.
    block: i64,
}

/// The positions of a layer's weights, `[inputs, outputs]`, and of its biases.
#[derive(Clone, Copy)]
struct Layer {
    inputs: i64,
    outputs: i64,
    weights: i64,
    biases: i64,
}

impl Layer {
    /// Returns the weights of all networks, `[networks, inputs, outputs]`.
    fn weights_of(self, parameters: &Tensor) -> Result<Tensor, TchError> {
        let flat = parameters.f_narrow(1, self.weights, self.inputs * self.outputs)?;
        flat.f_view_([-1, self.inputs, self.outputs])
    }

    /// Returns the biases of all networks, `[networks, 1, outputs]`.
    fn biases_of(self, parameters: &Tensor) -> Result<Tensor, TchError> {
        parameters.f_narrow(1, self.biases, self.outputs)?.f_unsqueeze(1)
    }
}

impl Stack {
    /// Creates networks with these layer sizes, one for each item of `parameters`.
    pub(super) fn new(
        sizes: &[usize],
        parameters: &[&[f32]],
        device: Device,
    ) -> Result<Self, TchError> {
        let mut layers = Vec::new();
        let mut end = 0;
        for pair in sizes.windows(2) {
            let inputs = pair[0] as i64;
            let outputs = pair[1] as i64;
            let weights = end;
            let biases = aligned(weights + inputs * outputs);
            layers.push(Layer { inputs, outputs, weights, biases });
            end = aligned(biases + outputs);
        }
        let block = if device.is_cuda() { ON_GPU } else { ON_PROCESSOR };
        let count = (parameters.len() as u64).next_multiple_of(block as u64) as i64;
        let zeros = Tensor::f_zeros([count, end], (Kind::Float, device))?;
        let stack = Self { parameters: zeros, layers, block };
        stack
            .parameters
            .f_narrow(0, 0, parameters.len() as i64)?
            .f_copy_(&stack.placed(parameters)?)?;
        Ok(stack)
    }

    /// Places one number per parameter in the layout of the stack, for some networks.
    pub(super) fn placed(&self, numbers: &[&[f32]]) -> Result<Tensor, TchError> {
        let places = self.parameters.size()[1];
        let mut all = vec![0.0_f32; numbers.len() * places as usize];
        for (to, from) in all.chunks_exact_mut(places as usize).zip(numbers) {
            let mut rest = *from;
            for layer in &self.layers {
                let parts =
                    [(layer.weights, layer.inputs * layer.outputs), (layer.biases, layer.outputs)];
                for (place, count) in parts {
                    let (own, after) = rest.split_at(count as usize);
                    to[place as usize..][..own.len()].copy_from_slice(own);
                    rest = after;
                }
            }
        }
        let all = Tensor::f_from_slice(&all)?.f_view_([-1, places])?;
        all.f_to_device(self.parameters.device())
    }

    /// Returns the same shape with other parameters.
    pub(super) fn with(&self, parameters: &Tensor) -> Self {
        let layers = self.layers.clone();
        Self { parameters: parameters.shallow_clone(), layers, block: self.block }
    }

    /// Returns the inputs of every layer and the outputs, for `[networks, rows, width]`.
    pub(super) fn forward(&self, states: &Tensor) -> Result<(Vec<Tensor>, Tensor), TchError> {
        let mut inputs = Vec::new();
        let mut hidden = states.shallow_clone();
        for (number, layer) in self.layers.iter().enumerate() {
            let mut made = self.product(&hidden, &layer.weights_of(&self.parameters)?)?;
            made = made.f_add_(&layer.biases_of(&self.parameters)?)?;
            if number + 1 < self.layers.len() {
                made = made.f_relu_()?;
            }
            inputs.push(std::mem::replace(&mut hidden, made));
        }
        Ok((inputs, hidden))
    }

    /// Returns the gradient of the parameters. `slope` is the gradient of the outputs of the first rows, `[networks, rows, outputs]`, and
    /// `inputs` comes from [`forward`](Self::forward).
    pub(super) fn backward(&self, inputs: &[Tensor], slope: Tensor) -> Result<Tensor, TchError> {
        let gradient = self.parameters.f_zeros_like()?;
        let rows = slope.size()[1];
        // Sums over rows are computed as products, which have a fixed order.
        let ones = Tensor::f_ones([1, 1, rows], (Kind::Float, gradient.device()))?;
        let ones = ones.f_expand([gradient.size()[0], -1, -1], false)?;
        let mut slope = slope;
        for (number, (layer, inputs)) in self.layers.iter().zip(inputs).enumerate().rev() {
            let inputs = inputs.f_narrow(1, 0, rows)?;
            let weights = self.product(&inputs.f_transpose(1, 2)?, &slope)?;
            layer.weights_of(&gradient)?.f_copy_(&weights)?;
            layer.biases_of(&gradient)?.f_copy_(&self.product(&ones, &slope)?)?;
            if number > 0 {
                let back = layer.weights_of(&self.parameters)?.f_transpose(1, 2)?;
                slope = self.product(&slope, &back)?.f_mul_(&inputs.f_gt(0)?)?;
            }
        }
        Ok(gradient)
    }

    /// Returns the product for each network, `[networks, a, b]` and `[networks, b, c]`.
    fn product(&self, left: &Tensor, right: &Tensor) -> Result<Tensor, TchError> {
        let count = left.size()[0];
        let rows = left.size()[1];
        let columns = right.size()[2];
        let places = aligned(rows * columns);
        let all = Tensor::f_empty([count, places], (Kind::Float, left.device()))?;
        let all = all.f_narrow(1, 0, rows * columns)?.f_view_([count, rows, columns])?;
        for first in (0..count).step_by(self.block as usize) {
            let [left, out, right] =
                [left, &all, right].map(|matrices| matrices.f_narrow(0, first, self.block));
            let _ = left?.f_bmm_out(&out?, &right?)?;
        }
        Ok(all)
    }
}

/// Returns the next position where a matrix may begin.
pub(super) fn aligned(place: i64) -> i64 {
    (place as u64).next_multiple_of(ALIGNED as u64) as i64
}

/// Returns a column of numbers, `[n, 1]`.
pub(super) fn column<T: tch::kind::Element>(
    numbers: &[T],
    device: Device,
) -> Result<Tensor, TchError> {
    Tensor::f_from_slice(numbers)?.f_view_([-1, 1])?.f_to_device(device)
}
