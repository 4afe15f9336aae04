//! Tests that training through libtorch agrees step by step with native training, from the same weights on the
//! same batches.

use calib_core::{Seed, Segments, Silent, States, Transitions};
use calib_dynamics::{Dynamics as _, DynamicsConfig, LANES, Recurrent, Trainer, Transitioning};
use calib_represent::{
    Batch, LaplacianConfig, LossConfig, LossForm, Split, Stepper as _, Task, Training, train,
    train_with,
};
use calib_torch::{
    Device, DeviceChoice, FeedForwardTrainer, LaplacianTraining, RecurrentTrainer, device,
};

/// Both round to 24 bits, each in its own order. Adam's division by small roots amplifies the difference.
const TOLERANCE: f32 = 2e-5;

/// Returns the CPU, set up as programs do.
fn processor() -> Device {
    device(DeviceChoice::Cpu).expect("always there")
}

fn data() -> (States, Transitions) {
    let mut rng = Seed::new(6).rng();
    let mut values = Vec::new();
    for row in 0..600 {
        let phase = f64::from(row) * 0.1;
        for column in 0..5 {
            let wave = (phase * (1.0 + f64::from(column) * 0.3)).sin();
            values.push((0.5 + 0.4 * wave + 0.02 * rng.normal()) as f32);
        }
    }
    let states = States::new(values, 600, 5).expect("finite");
    (states, Transitions::new(Segments::from_lengths([250, 30, 320]).expect("valid")))
}

fn config(epochs: usize) -> DynamicsConfig {
    DynamicsConfig {
        hidden_units: 40,
        batch_size: 50,
        epochs,
        sequence_length: 8,
        ..DynamicsConfig::default()
    }
}

fn assert_close(what: &str, a: &[f32], b: &[f32]) {
    assert_eq!(a.len(), b.len(), "{what}");
    for (place, (a, b)) in a.iter().zip(b).enumerate() {
        assert!((a - b).abs() <= TOLERANCE * (1.0 + a.abs()), "{what} {place}: {a} and {b}");
    }
}

/// Returns the GPU if there is one. Otherwise reports that the test is skipped.
#[expect(clippy::print_stderr, reason = "a test that skips says so")]
fn gpu() -> Option<Device> {
    let found = device(DeviceChoice::Cuda);
    if let Err(error) = &found {
        eprintln!("skipped: {error}");
    }
    found.ok()
}

fn feed_forward_agrees(device: Device) {
    let (states, transitions) = data();
    let data = Transitioning::new(&states, &transitions, 0.1).expect("enough");
    let config = config(1);
    let seed = Seed::new(2);
    let mut native = calib_dynamics::FeedForwardTrainer::new(&data, &config, seed);
    let mut torch = FeedForwardTrainer::new(&data, &config, seed, device);
    for step in 0..60_u32 {
        let batch: Vec<u32> = (0..50).map(|i| (i * 7 + step * 13) % 500).collect();
        let losses = (native.update(&batch), torch.update(&batch).expect("libtorch"));
        assert!((losses.0 - losses.1).abs() < 1e-5 * losses.0, "step {step}: {losses:?}");
        let parameters = torch.parameters().expect("libtorch");
        assert_close(&format!("step {step}"), native.network().parameters(), &parameters);
    }
}

#[test]
fn feed_forward_networks_agree_step_by_step() {
    feed_forward_agrees(processor());
}

#[test]
fn feed_forward_networks_agree_on_a_gpu() {
    if let Some(device) = gpu() {
        feed_forward_agrees(device);
    }
}

#[test]
fn epochs_draw_the_same_batches() {
    let (states, transitions) = data();
    let data = Transitioning::new(&states, &transitions, 0.1).expect("enough");
    let config = config(3);
    let mut native = calib_dynamics::FeedForwardTrainer::new(&data, &config, Seed::new(2));
    let mut torch = FeedForwardTrainer::new(&data, &config, Seed::new(2), processor());
    assert_eq!(native.updates_per_epoch(), torch.updates_per_epoch());
    for _ in 0..3 {
        let losses =
            (native.epoch(&Silent).expect("finite"), torch.epoch(&Silent).expect("finite"));
        assert!((losses.0.training - losses.1.training).abs() < 1e-4 * losses.0.training);
        assert!((losses.0.validation - losses.1.validation).abs() < 1e-4 * losses.0.validation);
    }
    let native = native.weights().expect("native");
    let torch = torch.weights().expect("libtorch");
    assert_eq!(native.metadata, torch.metadata);
    for (a, b) in native.tensors.iter().zip(&torch.tensors) {
        assert_eq!((&a.name, &a.shape), (&b.name, &b.shape));
        let close = a.values.iter().zip(&b.values).all(|(a, b)| (a - b).abs() < 1e-3);
        assert!(close, "{}", a.name);
    }
}

#[test]
fn a_gru_learns_and_rolls_out_natively() {
    let (states, transitions) = data();
    let data = Transitioning::new(&states, &transitions, 0.1).expect("enough");
    let config = DynamicsConfig { learning_rate: 1e-2, ..config(40) };
    let mut trainer =
        RecurrentTrainer::new(&data, &config, Seed::new(2), processor()).expect("sequences");
    // The loss of the first batch, computed by the native model.
    let model = trainer.present().expect("libtorch");
    let first: Vec<u32> = (0..LANES as u32).map(|lane| lane * 11).collect();
    let expected = loss_by_rollouts(&model, &states, &transitions, &first, 8);
    let got = trainer.update(&first).expect("libtorch");
    assert!((got - expected).abs() < 1e-6, "{got} {expected}");

    while !trainer.record().is_complete(&config) {
        trainer.epoch(&Silent).expect("finite");
    }
    let last = trainer.record().epochs[39].validation;
    assert!(last < 0.75 * data.persistence_loss(), "{last} {}", data.persistence_loss());
    let kept = Recurrent::from_tensors(&trainer.weights().expect("libtorch")).expect("its own");
    assert_eq!(kept.history(), 7);
    let directory = tempfile::tempdir().expect("a directory");
    let path = directory.path().join("weights.safetensors");
    calib_files::write_tensors(&path, &kept.to_tensors()).expect("written");
    let read = calib_files::read_tensors(&path).expect("readable");
    assert_eq!(Recurrent::from_tensors(&read).expect("its own"), kept);
}

fn loss_by_rollouts(
    model: &Recurrent,
    states: &States,
    transitions: &Transitions,
    first: &[u32],
    length: usize,
) -> f64 {
    let columns = states.columns();
    let mut rollouts = model.begin_rollouts().expect("it runs");
    let mut now = vec![0.0; LANES * columns];
    let mut next = vec![0.0; LANES * columns];
    let mut squares = 0.0;
    for step in 0..length {
        let rows: Vec<usize> = first[..LANES]
            .iter()
            .map(|&transition| transitions.sources()[transition as usize] as usize + step)
            .collect();
        for (now, &row) in now.chunks_exact_mut(columns).zip(&rows) {
            now.copy_from_slice(states.row(row));
        }
        rollouts.step(&now, &mut next).expect("a step");
        for (next, &row) in next.chunks_exact(columns).zip(&rows) {
            let pairs = next.iter().zip(states.row(row + 1));
            squares += pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
        }
    }
    squares / (LANES * length * columns) as f64
}

#[test]
fn training_that_was_put_aside_goes_on() {
    let (states, transitions) = data();
    let data = Transitioning::new(&states, &transitions, 0.1).expect("enough");
    let config = config(4);
    let seed = Seed::new(2);
    let mut whole = RecurrentTrainer::new(&data, &config, seed, processor()).expect("sequences");
    for _ in 0..2 {
        whole.epoch(&Silent).expect("finite");
    }
    let checkpoint = whole.checkpoint().expect("libtorch");
    let mut resumed = RecurrentTrainer::resume(&data, &config, seed, processor(), &checkpoint)
        .expect("its own checkpoint");
    for _ in 0..2 {
        whole.epoch(&Silent).expect("finite");
        resumed.epoch(&Silent).expect("finite");
    }
    assert_eq!(whole.record().updates, resumed.record().updates);
    let whole = whole.present().expect("libtorch").flat();
    let resumed = resumed.present().expect("libtorch").flat();
    assert_close("resumed", &whole, &resumed);
    assert!(FeedForwardTrainer::resume(&data, &config, seed, processor(), &checkpoint).is_err());
}

fn laplacian_agrees(device: Device) {
    let (states, transitions) = data();
    let segments = transitions.segments();
    for form in [LossForm::A, LossForm::B] {
        let config = LaplacianConfig {
            dimension: 6,
            hidden_units: 32,
            batch_size: 40,
            learning_rate: 1e-3,
            steps: 60,
            loss: LossConfig { form, ..LossConfig::default() },
            ..LaplacianConfig::default()
        };
        let split = Split::in_time(segments).expect("long enough");
        let mut native =
            Training::new(&config, &states, segments, &split, Seed::new(3)).expect("valid");
        let task = Task { states: &states, segments, split: &split, seed: Seed::new(3) };
        let mut torch = LaplacianTraining::new(&config, task, device).expect("valid");
        let mut batch = Batch::default();
        for step in 0..60 {
            native.draw(&mut batch);
            let losses = (native.step_on(&batch).total, torch.step().expect("libtorch"));
            let scale = losses.0.abs().max(1e-2);
            assert!((losses.0 - losses.1).abs() < 1e-4 * scale, "step {step}: {losses:?}");
            let encoder = torch.encoder().expect("libtorch");
            let native = native.encoder().parameters();
            assert_close(&format!("step {step}"), native, encoder.parameters());
        }
    }
}

#[test]
fn laplacian_encoders_agree_step_by_step() {
    laplacian_agrees(processor());
}

#[test]
fn laplacian_encoders_agree_on_a_gpu() {
    if let Some(device) = gpu() {
        laplacian_agrees(device);
    }
}

#[test]
fn a_representation_is_trained_and_resumed_through_libtorch() {
    let (states, transitions) = data();
    let segments = transitions.segments();
    let split = Split::in_time(segments).expect("long enough");
    let task = Task { states: &states, segments, split: &split, seed: Seed::new(3) };
    let config = LaplacianConfig {
        dimension: 4,
        hidden_units: 24,
        batch_size: 32,
        learning_rate: 3e-3,
        steps: 200,
        ..LaplacianConfig::default()
    };
    let native = train(&config, task, None, &Silent).expect("trains");
    let fresh = || LaplacianTraining::new(&config, task, processor()).expect("valid");
    let whole = train_with(&mut fresh(), &config, task, None, &Silent).expect("trains");
    assert_eq!(whole.points.len(), native.points.len());
    let a = whole.points[19].loss;
    let b = native.points[19].loss;
    assert!((a - b).abs() < 0.01 * b.abs(), "{a} {b}");

    let mut first = fresh();
    for _ in 0..120 {
        first.step().expect("libtorch");
    }
    let mut second = fresh();
    let encoder = first.encoder().expect("libtorch");
    second.restore(encoder.parameters(), first.moments().expect("libtorch"), first.done());
    for _ in 0..20 {
        let losses = (first.step().expect("libtorch"), second.step().expect("libtorch"));
        assert!((losses.0 - losses.1).abs() < 1e-6, "{losses:?}");
    }
}
