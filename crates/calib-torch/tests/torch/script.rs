//! Tests the rollout of a user's model that is exported as `TorchScript`.

use calib_core::{RowIndex, Segments, Silent, States};
use calib_dynamics::{Ended, predict};
use calib_torch::{Device, Script};
use tch::{CModule, Kind, Tensor};

/// Writes a module that maps states `[n, columns]` with `forward`.
fn export(path: &std::path::Path, columns: i64, forward: &mut dyn FnMut(&Tensor) -> Tensor) {
    let example = Tensor::zeros([16, columns], (Kind::Float, Device::Cpu));
    let module =
        CModule::create_by_tracing("Model", "forward", &[example], &mut |inputs: &[Tensor]| {
            vec![forward(&inputs[0])]
        });
    module.expect("traced").save(path).expect("written");
}

#[test]
fn an_exported_model_is_fed_its_predictions() {
    let directory = tempfile::tempdir().expect("a directory");
    let path = directory.path().join("model.pt");
    export(&path, 2, &mut |states| states * 0.5 + 1.0);
    let script = Script::open(&path, 2, Device::Cpu).expect("it fits");
    let states = States::new(vec![0.0, 4.0, 1.0, -1.0], 2, 2).expect("finite");
    let segments = Segments::from_lengths([2]).expect("valid");
    let starts = [RowIndex(0), RowIndex(1)];
    let rolled = predict(&script, &states, &segments, &starts, 3, &Silent).expect("it runs");
    assert_eq!(rolled[0].state(1), [1.0, 3.0]);
    assert_eq!(rolled[0].state(3), [1.75, 2.25]);
    assert_eq!(rolled[1].state(2), [1.75, 1.25]);
    assert_eq!(rolled[1].ended(), Ended::Complete);
}

#[test]
fn what_does_not_map_states_to_states_is_refused_with_its_name() {
    let directory = tempfile::tempdir().expect("a directory");
    let path = directory.path().join("model.pt");
    export(&path, 3, &mut |states| states.narrow(1, 0, 2));
    let error = Script::open(&path, 3, Device::Cpu).expect_err("narrower").to_string();
    assert!(error.contains("model.pt") && error.contains("[16, 2]"), "{error}");
    std::fs::write(&path, "no model").expect("written");
    let error = Script::open(&path, 3, Device::Cpu).expect_err("text").to_string();
    assert!(error.contains("model.pt"), "{error}");
    assert!(Script::open(&directory.path().join("none.pt"), 3, Device::Cpu).is_err());
}
