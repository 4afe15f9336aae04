//! Populations of value networks, stacked for batched matrix products.

use calib_agent::{Accelerator, AgentError, Lockstep, LockstepResults, Networks, Steps};
use tch::{Device, Kind, TchError, Tensor, no_grad};

mod optimiser;
mod stack;

use optimiser::Descent;
use stack::{Stack, aligned, column};

/// An accelerator that trains the agents of many runs side by side, through libtorch.
///
/// Networks are stacked: one matrix product per network becomes one batched product for all of them. The device gathers the states from the
/// streams. All arithmetic is in single precision.
#[derive(Clone, Copy, Debug)]
pub struct Populations {
    device: Device,
}

/// Maximum size of stacked networks and their streams, in bytes. It leaves memory for other work.
const ON_PROCESSOR: u64 = 1 << 30;
const ON_GPU: u64 = 8 << 30;

impl Populations {
    /// Creates populations on this device.
    pub fn new(device: Device) -> Self {
        Self { device }
    }
}

impl Accelerator for Populations {
    fn class(&self) -> &str {
        if self.device.is_cuda() { "libtorch-cuda" } else { "libtorch-cpu" }
    }

    fn memory(&self) -> u64 {
        if self.device.is_cuda() { ON_GPU } else { ON_PROCESSOR }
    }

    fn networks(&self, networks: &Networks<'_>) -> Result<Box<dyn Lockstep>, AgentError> {
        let population = no_grad(|| Population::new(networks, self.device));
        Ok(Box::new(population.map_err(|error| failed(&error))?))
    }
}

fn failed(error: &TchError) -> AgentError {
    AgentError::Accelerator(format!("libtorch: {error}"))
}

/// The networks of `runs × learners`, run after run.
struct Population {
    device: Device,
    runs: i64,
    learners: i64,
    batch: i64,
    gamma: f64,
    /// The states of the runs, `[runs · states, width]`.
    states: Tensor,
    /// The first row of each run's states, `[runs, 1]`.
    begins: Tensor,
    /// The run of each network, and the column that it predicts, `[networks, 1, 1]`.
    run_of: Tensor,
    columns: Tensor,
    networks: Stack,
    /// Parameters of the target networks, and the update period of each learner's target network.
    target: Option<(Tensor, Vec<usize>)>,
    updates: usize,
    descent: Descent,
}

impl Population {
    fn new<'a>(networks: &'a Networks<'a>, device: Device) -> Result<Self, TchError> {
        let Networks { sizes, learners, parameters, states, batch } = networks;
        let runs = parameters.len() as i64;
        let width = sizes[0] as i64;
        let own = parameters.iter().flat_map(|own| {
            learners
                .iter()
                .map(move |learner| learner.start.map_or(&own[..], |start| &start.parameters[..]))
        });
        let own: Vec<&[f32]> = own.collect();
        let of_run = states.len() as i64 / runs / width;
        let begins: Vec<i64> = (0..runs).map(|run| run * of_run).collect();
        let networks = Stack::new(sizes, &own, device)?;
        // Padding networks belong to the first run and learner.
        let count = networks.parameters.size()[0] as usize;
        let own = 0..runs as usize * learners.len();
        let run_of = own.clone().map(|network| (network / learners.len()) as i64);
        let run_of = padded(run_of, count, device)?;
        let columns = own.map(|network| learners[network % learners.len()].cumulant as i64);
        let columns = padded(columns, count, device)?;
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
            run_of,
            columns: columns.f_view_([-1, 1, 1])?,
            target: target.map(|target| (target, periods)),
            updates: 0,
            descent: Descent::new(learners, runs, &networks)?,
            networks,
        })
    }

    /// Returns the states with these row numbers, `[runs, rows]`, for each network: `[networks, rows, width]`.
    fn gathered(&self, rows: &Tensor) -> Result<Tensor, TchError> {
        let count = rows.size()[1];
        let states = self.states.f_index_select(0, &rows.f_add(&self.begins)?.f_view_([-1])?)?;
        states.f_view_([self.runs, count, -1])?.f_index_select(0, &self.run_of)
    }

    /// Removes the padding networks from a tensor with one value per network.
    fn wanted(&self, of_all: &Tensor) -> Result<Tensor, TchError> {
        of_all.f_narrow(0, 0, self.runs * self.learners)
    }

    /// Makes one update on the transitions that begin in `starts`, `[runs, batch]`. Returns the values of the present states before the
    /// update, and whether the TD errors were finite.
    fn learn(
        &mut self,
        present: &Tensor,
        starts: &Tensor,
        step: usize,
    ) -> Result<[Tensor; 2], TchError> {
        let batch = self.batch;
        let rows = Tensor::f_cat(&[starts, present, &starts.f_add_scalar(1)?], 1)?;
        let count = rows.size()[1];
        // Padded with the first state, whose results are unused.
        let rows = rows.f_constant_pad_nd([0, aligned(count) - count])?;
        let states = self.gathered(&rows)?;
        let after = states.f_narrow(1, batch + 1, batch)?;
        let (values, inputs, next) = match &self.target {
            None => {
                let (inputs, values) = self.networks.forward(&states)?;
                let next = values.f_narrow(1, batch + 1, batch)?;
                (values, inputs, next)
            }
            Some((target, _)) => {
                let (inputs, values) =
                    self.networks.forward(&states.f_narrow(1, 0, aligned(batch + 1))?)?;
                let (_, next) = self.networks.with(target).forward(&after)?;
                (values, inputs, next)
            }
        };
        let columns = self.columns.f_expand([-1, batch, 1], false)?;
        let targets = after.f_gather(2, &columns, false)?.f_add(&next.f_mul_scalar(self.gamma)?)?;
        let errors = targets.f_sub(&values.f_narrow(1, 0, batch)?)?;
        // A network that does not learn need not have finite errors.
        let finite = errors.f_squeeze_dim(2)?.f_isfinite()?.f_all_dim(1, false)?;
        let finite = finite.f_logical_or(&self.descent.frozen)?;
        let slope = errors.f_mul_scalar(-1.0 / batch as f64)?;
        // The gradient is zero in rows that are not for training.
        let slope = slope.f_constant_pad_nd([0, 0, 0, aligned(batch) - batch])?;
        let gradient = self.networks.backward(&inputs, slope)?;
        self.descent.step(&mut self.networks.parameters, &gradient, step)?;
        self.updates += 1;
        self.renew_targets()?;
        let values = values.f_select(1, batch)?.f_squeeze_dim(1)?;
        Ok([self.wanted(&values)?, self.wanted(&finite)?])
    }

    /// Copies the current parameters to the target networks that are due.
    fn renew_targets(&mut self) -> Result<(), TchError> {
        let Some((target, periods)) = &self.target else { return Ok(()) };
        let shape = [self.runs, self.learners, -1];
        let [present, target] = [&self.networks.parameters, target]
            .map(|parameters| self.wanted(parameters)?.f_view_(shape));
        let present = present?;
        let target = target?;
        for (learner, &period) in periods.iter().enumerate() {
            if period > 0 && self.updates.is_multiple_of(period) {
                let present = present.f_select(1, learner as i64)?;
                target.f_select(1, learner as i64)?.f_copy_(&present)?;
            }
        }
        Ok(())
    }

    fn make(&mut self, steps: &Steps) -> Result<LockstepResults, TchError> {
        let (runs, count) = (self.runs, steps.present.len() as i64 / self.runs);
        let present = shaped(&steps.present, &[count, runs, 1], self.device)?;
        let mut predictions = Vec::new();
        let mut finite = Vec::new();
        if steps.starts.is_empty() {
            for step in 0..count {
                let rows = present.f_select(0, step)?.f_constant_pad_nd([0, aligned(1) - 1])?;
                let states = self.gathered(&rows)?;
                let values = self.networks.forward(&states)?.1.f_select(1, 0)?.f_squeeze_dim(1)?;
                predictions.push(self.wanted(&values)?);
            }
        } else {
            let starts = shaped(&steps.starts, &[count, runs, self.batch], self.device)?;
            self.descent.prepare(count as usize, self.device)?;
            for step in 0..count {
                let present = present.f_select(0, step)?;
                let starts = starts.f_select(0, step)?;
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
        Ok(LockstepResults { predictions, finite })
    }
}

/// Returns one number per network. Padding networks, of `count` in all, have zeros.
fn padded(
    numbers: impl Iterator<Item = i64>,
    count: usize,
    device: Device,
) -> Result<Tensor, TchError> {
    let all: Vec<i64> = numbers.chain(std::iter::repeat(0)).take(count).collect();
    Tensor::f_from_slice(&all)?.f_to_device(device)
}

/// Returns numbers in this shape.
fn shaped(numbers: &[u32], shape: &[i64], device: Device) -> Result<Tensor, TchError> {
    let numbers: Vec<i64> = numbers.iter().map(|&number| i64::from(number)).collect();
    Tensor::f_from_slice(&numbers)?.f_view_(shape)?.f_to_device(device)
}

impl Lockstep for Population {
    fn make(&mut self, steps: &Steps) -> Result<LockstepResults, AgentError> {
        no_grad(|| Self::make(self, steps)).map_err(|error| failed(&error))
    }

    fn finite(&self) -> Result<Vec<bool>, AgentError> {
        no_grad(|| -> Result<Vec<bool>, TchError> {
            let all = self.networks.parameters.f_isfinite()?.f_all_dim(1, false)?;
            Vec::try_from(flat(&self.wanted(&all)?)?)
        })
        .map_err(|error| failed(&error))
    }
}

/// Returns all values in one dimension, in CPU memory.
fn flat(tensor: &Tensor) -> Result<Tensor, TchError> {
    let here = tensor.f_to_device(Device::Cpu)?;
    let here = if here.kind() == Kind::Bool { here } else { here.f_to_kind(Kind::Float)? };
    here.f_contiguous()?.f_view_([-1])
}
