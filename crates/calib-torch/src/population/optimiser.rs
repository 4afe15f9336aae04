use calib_agent::{AgentConfig, Learner, OptimiserKind};
use tch::{Device, TchError, Tensor};

use super::stack::{Stack, column};

/// The optimiser of all networks, as [`calib_nn::Adam`] and [`calib_nn::Sgd`]. Each network has its own
/// hyperparameters.
pub(super) struct Descent {
    /// Whether the learning rate of each network is 0, `[networks]`. Such a network only predicts.
    pub(super) frozen: Tensor,
    /// 1 − αλ and α, `[networks, 1]`.
    keep: Tensor,
    rate: Tensor,
    /// α of each network.
    rates: Vec<f64>,
    adam: Option<Adam>,
}

struct Adam {
    mean: Tensor,
    square: Tensor,
    /// β₁, 1 − β₁, β₂, 1 − β₂ and ε, `[networks, 1]`.
    beta1: [Tensor; 2],
    beta2: [Tensor; 2],
    epsilon: Tensor,
    /// β₁ and β₂ of each network, and their current powers.
    betas: Vec<[f64; 2]>,
    powers: Vec<[f64; 2]>,
    /// The factors of the prepared steps: α/(1−β₁ᵗ) and 1/√(1−β₂ᵗ), `[steps, networks, 1]`.
    ahead: [Tensor; 2],
}

impl Descent {
    /// Creates the optimiser for the networks of these learners in each of the runs.
    pub(super) fn new(
        learners: &[Learner<'_>],
        runs: i64,
        networks: &Stack,
    ) -> Result<Self, TchError> {
        let device = networks.parameters.device();
        let count = networks.parameters.size()[0] as usize;
        let of_all = |number: fn(&AgentConfig) -> f64| -> Vec<f64> {
            let own = (0..runs).flat_map(|_| learners.iter());
            // Padding networks have the settings of the first learner.
            let all = own.chain(std::iter::repeat(&learners[0])).take(count);
            all.map(|learner| number(learner.config)).collect()
        };
        let on_device = |number: fn(&AgentConfig) -> f64| {
            let numbers: Vec<f32> =
                of_all(number).into_iter().map(|number| number as f32).collect();
            column(&numbers, device)
        };
        let is_adam = learners[0].config.optimiser == OptimiserKind::Adam;
        let adam = is_adam.then(|| -> Result<Adam, TchError> {
            let [mean, square] = moments(learners, runs, networks)?;
            let beta1 = of_all(|config| config.beta1);
            let beta2 = of_all(|config| config.beta2);
            Ok(Adam {
                mean,
                square,
                beta1: [on_device(|config| config.beta1)?, on_device(|config| 1.0 - config.beta1)?],
                beta2: [on_device(|config| config.beta2)?, on_device(|config| 1.0 - config.beta2)?],
                epsilon: on_device(|config| config.epsilon)?,
                betas: beta1.into_iter().zip(beta2).map(|(one, two)| [one, two]).collect(),
                powers: {
                    let own = (0..runs).flat_map(|_| learners.iter());
                    own.chain(std::iter::repeat(&learners[0]))
                        .take(count)
                        .map(|learner| {
                            let moments = learner.start.and_then(|start| start.moments.as_ref());
                            moments.map_or([1.0; 2], |moments| [moments.powers.0, moments.powers.1])
                        })
                        .collect()
                },
                ahead: [Tensor::new(), Tensor::new()],
            })
        });
        let rate = on_device(|config| config.learning_rate)?;
        Ok(Self {
            frozen: rate.f_eq(0)?.f_view_([-1])?,
            keep: on_device(|config| 1.0 - config.learning_rate * config.weight_decay)?,
            rate,
            rates: of_all(|config| config.learning_rate),
            adam: adam.transpose()?,
        })
    }

    /// Prepares the factors of the next `count` steps.
    pub(super) fn prepare(&mut self, count: usize, device: Device) -> Result<(), TchError> {
        let Some(adam) = &mut self.adam else { return Ok(()) };
        let mut rates = Vec::new();
        let mut corrections = Vec::new();
        for _ in 0..count {
            for ((powers, betas), rate) in adam.powers.iter_mut().zip(&adam.betas).zip(&self.rates)
            {
                powers[0] *= betas[0];
                powers[1] *= betas[1];
                rates.push((rate / (1.0 - powers[0])) as f32);
                corrections.push((1.0 / (1.0 - powers[1]).sqrt()) as f32);
            }
        }
        let shape = [count as i64, adam.powers.len() as i64, 1];
        let [rates, corrections] = [rates, corrections]
            .map(|values| Tensor::f_from_slice(&values)?.f_view_(shape)?.f_to_device(device));
        adam.ahead = [rates?, corrections?];
        Ok(())
    }

    /// Takes the prepared step number `step` with all networks.
    pub(super) fn step(
        &mut self,
        parameters: &mut Tensor,
        gradient: &Tensor,
        step: usize,
    ) -> Result<(), TchError> {
        let change = match &mut self.adam {
            None => gradient.f_mul(&self.rate)?,
            Some(adam) => adam.change(gradient, step as i64)?,
        };
        // A mask avoids 0 · ∞ where the observed values are large.
        let change = change.f_masked_fill(&self.frozen.f_unsqueeze(1)?, 0)?;
        let _ = parameters.f_mul_(&self.keep)?.f_sub_(&change)?;
        Ok(())
    }
}

impl Adam {
    fn change(&mut self, gradient: &Tensor, step: i64) -> Result<Tensor, TchError> {
        let _ = self.mean.f_mul_(&self.beta1[0])?.f_addcmul_(gradient, &self.beta1[1])?;
        let squares = gradient.f_mul(gradient)?;
        let _ = self.square.f_mul_(&self.beta2[0])?.f_addcmul_(&squares, &self.beta2[1])?;
        let [rate, correction] = &self.ahead;
        let rate = rate.f_select(0, step)?;
        let correction = correction.f_select(0, step)?;
        let scale = self.square.f_sqrt()?.f_mul_(&correction)?.f_add_(&self.epsilon)?;
        self.mean.f_div(&scale)?.f_mul_(&rate)
    }
}

/// Returns the moments of all networks, `[networks, parameters]`: those of checkpoints, or zeros.
fn moments(learners: &[Learner<'_>], runs: i64, networks: &Stack) -> Result<[Tensor; 2], TchError> {
    let zeros = networks.parameters.f_zeros_like()?;
    let both = [zeros.f_detach_copy()?, zeros];
    let shape = [runs, learners.len() as i64, -1];
    for (number, learner) in learners.iter().enumerate() {
        let Some(kept) = learner.start.and_then(|start| start.moments.as_ref()) else { continue };
        for (all, own) in both.iter().zip([&kept.mean, &kept.square]) {
            let own = networks.placed(&[own])?;
            let of_runs = all.f_narrow(0, 0, runs * learners.len() as i64)?.f_view_(shape)?;
            let mut place = of_runs.f_select(1, number as i64)?;
            place.f_copy_(&own.f_expand([runs, -1], false)?)?;
        }
    }
    Ok(both)
}
