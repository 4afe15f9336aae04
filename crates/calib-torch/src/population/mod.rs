//! Populations of value networks, stacked into batched products.

use calib_agent::{Accelerator, AgentError, Lockstep, Made, Networks, Steps};
use tch::{Device, Kind, TchError, Tensor, no_grad};

mod optimiser;
mod stack;

use optimiser::Descent;
use stack::{Stack, column, expanded};

/// libtorch, as what trains the agents of many runs side by side.
///
/// Networks are stacked: what is one product of matrices for one network is one batched product for all of them, and streams are gathered on the
/// device. Products are in single precision; TF32 is off, as libtorch has it by default.
#[derive(Clone, Copy, Debug)]
pub struct Populations {
    device: Device,
}

/// Bytes that stacked networks may take: what fits beside other work on a processor, and on any GPU.
const ON_PROCESSOR: u64 = 1 << 30;
const ON_GPU: u64 = 8 << 30;

impl Populations {
    /// Populations on this device.
    pub fn new(device: Device) -> Self {
        Self { device }
    }
}

impl Accelerator for Populations {
    fn class(&self) -> &str {
        if self.device.is_cuda() { "libtorch on the GPU" } else { "libtorch on the processor" }
    }

    fn memory(&self) -> u64 {
        if self.device.is_cuda() { ON_GPU } else { ON_PROCESSOR }
    }

    fn networks(&self, networks: &Networks<'_>) -> Result<Box<dyn Lockstep>, AgentError> {
        let population = no_grad(|| Population::new(networks, self.device));
        Ok(Box::new(population.map_err(failed)?))
    }
}

fn failed(error: TchError) -> AgentError {
    AgentError::Accelerator(format!("libtorch: {error}"))
}

/// Networks of `runs × learners`, those of one run after those of the other.
struct Population {
    device: Device,
    runs: i64,
    learners: i64,
    batch: i64,
    gamma: f64,
    /// What runs see, `[runs · states, width]`.
    states: Tensor,
    /// Where the states of each run begin, `[runs, 1]`.
    begins: Tensor,
    /// The predicted column of each learner.
    columns: Tensor,
    networks: Stack,
    /// Parameters of the target networks, and after how many updates those of each learner become the present ones.
    target: Option<(Tensor, Vec<usize>)>,
    updates: usize,
    descent: Descent,
}

impl Population {
    fn new(networks: &Networks<'_>, device: Device) -> Result<Self, TchError> {
        let Networks { sizes, learners, parameters, states, batch } = networks;
        let (runs, width) = (parameters.len() as i64, sizes[0] as i64);
        let all: Vec<f32> = parameters
            .iter()
            .flat_map(|own| {
                let start = |learner: &calib_agent::Learner<'_>| match learner.start {
                    Some(start) => start.parameters.clone(),
                    None => own.clone(),
                };
                learners.iter().flat_map(start)
            })
            .collect();
        let of_run = states.len() as i64 / runs / width;
        let begins: Vec<i64> = (0..runs).map(|run| run * of_run).collect();
        let columns: Vec<i64> = learners.iter().map(|learner| learner.cumulant as i64).collect();
        let networks = Stack::new(sizes, &all, device)?;
        let periods: Vec<usize> =
            learners.iter().map(|learner| learner.config.target_network_period).collect();
        let target = periods[0] > 0;
        let target = target.then(|| networks.parameters.f_detach_copy()).transpose()?;
        Ok(Self {
            device,
            runs,
            learners: learners.len() as i64,
            batch: *batch as i64,
            gamma: learners[0].config.gamma,
            states: Tensor::f_from_slice(states)?.f_view_([-1, width])?.f_to_device(device)?,
            begins: column(&begins, device)?,
            columns: Tensor::f_from_slice(&columns)?.f_to_device(device)?,
            target: target.map(|target| (target, periods)),
            updates: 0,
            descent: Descent::new(learners, runs, &networks)?,
            networks,
        })
    }

    /// The states of these numbers, `[runs, rows]`, for each network, `[networks, rows, width]`.
    fn gathered(&self, rows: &Tensor) -> Result<Tensor, TchError> {
        let count = rows.size()[1];
        let states = self.states.f_index_select(0, &rows.f_add(&self.begins)?.f_view_([-1])?)?;
        states.f_view_([self.runs, count, -1])
    }

    /// One value a state, `[networks, rows]`, and the inputs of all layers.
    fn values(&self, states: &Tensor) -> Result<(Tensor, Vec<Tensor>), TchError> {
        let (inputs, values) = self.networks.forward(&expanded(states, self.learners)?)?;
        Ok((values.f_squeeze_dim(2)?, inputs))
    }

    /// Learn from the transitions that begin in `starts`, `[runs, batch]`. Values of the present states before, and whether TD errors were finite.
    fn learn(
        &mut self,
        present: &Tensor,
        starts: &Tensor,
        step: usize,
    ) -> Result<[Tensor; 2], TchError> {
        let batch = self.batch;
        let rows = Tensor::f_cat(&[starts, present, &starts.f_add_scalar(1)?], 1)?;
        let states = self.gathered(&rows)?;
        let after = states.f_narrow(1, batch + 1, batch)?;
        let (values, inputs, next) = match &self.target {
            None => {
                let (values, inputs) = self.values(&states)?;
                let next = values.f_narrow(1, batch + 1, batch)?;
                (values, inputs, next)
            }
            Some((target, _)) => {
                let (values, inputs) = self.values(&states.f_narrow(1, 0, batch + 1)?)?;
                let target = self.networks.with(target);
                let (_, next) = target.forward(&expanded(&after, self.learners)?)?;
                (values, inputs, next.f_squeeze_dim(2)?)
            }
        };
        // o' of each learner, [runs, learners, batch].
        let cumulants = after.f_index_select(2, &self.columns)?.f_transpose(1, 2)?;
        let targets = cumulants.f_reshape([-1, batch])?.f_add(&next.f_mul_scalar(self.gamma)?)?;
        let errors = targets.f_sub(&values.f_narrow(1, 0, batch)?)?;
        let finite = errors.f_isfinite()?.f_all_dim(1, false)?;
        let slope = errors.f_mul_scalar(-1.0 / batch as f64)?.f_unsqueeze(2)?;
        let gradient = self.networks.backward(&inputs, slope, batch)?;
        self.descent.step(&mut self.networks.parameters, &gradient, step)?;
        self.updates += 1;
        self.renew_targets()?;
        Ok([values.f_select(1, batch)?, finite])
    }

    /// Target networks that are due become the present ones.
    fn renew_targets(&mut self) -> Result<(), TchError> {
        let Some((target, periods)) = &self.target else { return Ok(()) };
        let shape = [self.runs, self.learners, -1];
        let (present, target) = (self.networks.parameters.f_view_(shape)?, target.f_view_(shape)?);
        for (learner, &period) in periods.iter().enumerate() {
            if period > 0 && self.updates.is_multiple_of(period) {
                let own = |of: &Tensor| of.f_select(1, learner as i64);
                own(&target)?.f_copy_(&own(&present)?)?;
            }
        }
        Ok(())
    }

    fn make(&mut self, steps: &Steps) -> Result<Made, TchError> {
        let (runs, count) = (self.runs, steps.present.len() as i64 / self.runs);
        let numbers = |of: &[u32], shape: &[i64]| -> Result<Tensor, TchError> {
            let of: Vec<i64> = of.iter().map(|&number| i64::from(number)).collect();
            Tensor::f_from_slice(&of)?.f_view_(shape)?.f_to_device(self.device)
        };
        let present = numbers(&steps.present, &[count, runs, 1])?;
        let (mut predictions, mut finite) = (Vec::new(), Vec::new());
        if steps.starts.is_empty() {
            for step in 0..count {
                let states = self.gathered(&present.f_select(0, step)?)?;
                predictions.push(self.values(&states)?.0.f_squeeze_dim(1)?);
            }
        } else {
            let starts = numbers(&steps.starts, &[count, runs, self.batch])?;
            self.descent.prepare(count as usize, self.device)?;
            for step in 0..count {
                let (present, starts) = (present.f_select(0, step)?, starts.f_select(0, step)?);
                let [values, own] = self.learn(&present, &starts, step as usize)?;
                predictions.push(values);
                finite.push(own);
            }
        }
        let predictions = Tensor::f_stack(&predictions, 0)?;
        let predictions: Vec<f32> = Vec::try_from(flat(&predictions)?)?;
        let finite = match finite.as_slice() {
            [] => vec![true; predictions.len()],
            made => Vec::try_from(flat(&Tensor::f_stack(made, 0)?)?)?,
        };
        Ok(Made { predictions, finite })
    }
}

impl Lockstep for Population {
    fn make(&mut self, steps: &Steps) -> Result<Made, AgentError> {
        no_grad(|| Self::make(self, steps)).map_err(failed)
    }

    fn finite(&self) -> Result<Vec<bool>, AgentError> {
        let finite = || -> Result<Vec<bool>, TchError> {
            Vec::try_from(flat(&self.networks.parameters.f_isfinite()?.f_all_dim(1, false)?)?)
        };
        no_grad(finite).map_err(failed)
    }
}

/// All values, one after the other, where the processor reads them.
fn flat(tensor: &Tensor) -> Result<Tensor, TchError> {
    let here = tensor.f_to_device(Device::Cpu)?;
    let here = if here.kind() == Kind::Bool { here } else { here.f_to_kind(Kind::Float)? };
    here.f_contiguous()?.f_view_([-1])
}
