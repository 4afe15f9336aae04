use calib_nn::{AdamRule, Moments};
use tch::{Device, TchError, Tensor, no_grad};

/// Adam over one flat vector of parameters, as in [`calib_nn::Adam`]. With one vector, a step is a few large
/// operations, and a checkpoint is three arrays.
pub(crate) struct Adam {
    rule: AdamRule,
    mean: Tensor,
    square: Tensor,
    powers: (f64, f64),
}

impl Adam {
    pub(crate) fn new(rule: AdamRule, parameters: &Tensor) -> Self {
        let mean = parameters.detach().zeros_like();
        let square = parameters.detach().zeros_like();
        Self { rule, mean, square, powers: (1.0, 1.0) }
    }

    pub(crate) fn from_moments(rule: AdamRule, moments: &Moments, device: Device) -> Self {
        let [mean, square] = [&moments.mean, &moments.square]
            .map(|values| Tensor::from_slice(values).to_device(device));
        Self { rule, mean, square, powers: moments.powers }
    }

    /// Returns the state that a checkpoint needs, besides the parameters.
    pub(crate) fn moments(&self) -> Result<Moments, TchError> {
        let mean = values(&self.mean)?;
        let square = values(&self.square)?;
        Ok(Moments { mean, square, powers: self.powers })
    }

    /// Updates `parameters` by one step against their gradient, and clears the gradient.
    pub(crate) fn step(&mut self, parameters: &mut Tensor) {
        let AdamRule { learning_rate, beta1, beta2, epsilon, .. } = self.rule;
        self.powers.0 *= beta1;
        self.powers.1 *= beta2;
        let correction = (1.0 - self.powers.1).sqrt();
        let rate = learning_rate / (1.0 - self.powers.0);
        no_grad(|| {
            let mut gradient = parameters.grad();
            let _ = self.mean.g_mul_scalar_(beta1).g_add_(&(&gradient * (1.0 - beta1)));
            let _ =
                self.square.g_mul_scalar_(beta2).g_add_(&(&gradient * &gradient * (1.0 - beta2)));
            let scale = self.square.sqrt() / correction + epsilon;
            let _ = parameters.g_sub_(&(&self.mean / scale * rate));
            let _ = gradient.zero_();
        });
    }
}

/// Returns the values of a tensor on any device.
pub(crate) fn values(tensor: &Tensor) -> Result<Vec<f32>, TchError> {
    Vec::<f32>::try_from(tensor.detach().to_device(Device::Cpu).contiguous().view(-1))
}
