//! Tests the choice of a device.

use calib_torch::{Device, DeviceChoice, device};

#[test]
fn choices_are_read_and_the_processor_is_always_there() {
    for choice in [DeviceChoice::Cpu, DeviceChoice::Cuda, DeviceChoice::Auto] {
        assert_eq!(choice.to_string().parse::<DeviceChoice>().expect("its own name"), choice);
    }
    assert!("gpu".parse::<DeviceChoice>().is_err());
    assert_eq!(device(DeviceChoice::Cpu).expect("always"), Device::Cpu);
    device(DeviceChoice::Auto).expect("always something");
    if let Err(error) = device(DeviceChoice::Cuda) {
        assert!(error.to_string().contains("--device cpu"), "{error}");
    }
}
