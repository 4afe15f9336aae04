use super::*;

#[test]
fn defaults_are_valid_and_every_field_but_traces_is_a_scalar() {
    let config = AgentConfig::default();
    assert_eq!(config.check(), Ok(()));
    let value = serde_json::to_value(&config).expect("serialises");
    for (field, value) in value.as_object().expect("a table") {
        let list = field == "traces";
        assert!(value.is_number() || value.is_string() || list, "{field} is {value}");
    }
    assert_eq!(value["value_function"], "mlp");
    assert_eq!(serde_json::from_value::<AgentConfig>(value).expect("reads"), config);
    let partial: AgentConfig =
        serde_json::from_str(r#"{"replay": "none", "optimiser": "sgd"}"#).expect("reads");
    assert_eq!(partial.replay, ReplayKind::None);
    assert_eq!(partial.batch_size, 256);
    let error = serde_json::from_str::<AgentConfig>(r#"{"learning_rat": 1}"#);
    assert!(error.expect_err("unknown").to_string().contains("learning_rat"));
}

/// Returns the error with which the default is refused after a change.
fn refusal(change: fn(&mut AgentConfig)) -> AgentConfigError {
    let mut config = AgentConfig::default();
    change(&mut config);
    config.check().expect_err("outside the range")
}

#[test]
fn fields_outside_their_range_are_named() {
    assert_eq!(
        refusal(|config| config.learning_rate = f64::NAN).to_string(),
        "agent hyperparameter `learning_rate`: expected 0 or a number from 1e-45 to 1e38 \
         (parameters are in single precision), got NaN"
    );
    assert!(refusal(|config| config.learning_rate = 1e300).to_string().ends_with("got 1e300"));
    assert_eq!(refusal(|config| config.gamma = 1.0).field, "gamma");
    let of_sensor = refusal(|config| config.gammas = BTreeMap::from([("A".to_owned(), 1.0)]));
    assert_eq!((of_sensor.field, of_sensor.got.as_str()), ("gammas", "1 for A"));
    assert_eq!(refusal(|config| config.traces = vec![0.9, 1.0]).field, "traces");
    assert_eq!(
        refusal(|config| config.traces = vec![0.9, 0.9]).to_string(),
        "agent hyperparameter `traces`: expected at most 16 different numbers in [0, 1), such as \
         [0.9, 0.99], got [0.9, 0.9]"
    );
    assert_eq!(refusal(|config| config.hidden_layers = 0).field, "hidden_layers");
    assert_eq!(refusal(|config| config.hidden_units = 0).field, "hidden_units");
    assert_eq!(refusal(|config| config.beta1 = 1.0).field, "beta1");
    assert_eq!(refusal(|config| config.beta2 = -0.1).field, "beta2");
    assert_eq!(refusal(|config| config.epsilon = 0.0).field, "epsilon");
    assert_eq!(refusal(|config| config.weight_decay = -1.0).field, "weight_decay");
    assert_eq!(refusal(|config| config.batch_size = 0).field, "batch_size");
    assert_eq!(refusal(|config| config.updates_per_step = 0).field, "updates_per_step");
    assert_eq!(
        refusal(|config| config.replay_capacity = 100).to_string(),
        "agent hyperparameter `replay_capacity`: expected batch_size (256) to 4294967296, got 100"
    );
    let linear = AgentConfig {
        value_function: ValueFunction::Linear,
        hidden_layers: 0,
        ..AgentConfig::default()
    };
    assert_eq!(linear.check(), Ok(()));
    let rounded = AgentConfig { precision: Precision::Bf16, ..linear };
    assert_eq!(
        rounded.check().expect_err("refused").to_string(),
        "agent hyperparameter `precision`: expected f32 with value_function = \"linear\": its updates wait \
         for memory, not for products, got bf16"
    );
}

/// Returns the precision in the serialised configuration, if it is present.
fn written_precision(precision: Precision) -> Option<Value> {
    let config = AgentConfig { precision, ..AgentConfig::default() };
    assert_eq!(config.fields()["precision"], serde_json::json!(precision));
    let written = serde_json::to_value(&config).expect("serialises");
    assert_eq!(serde_json::from_value::<AgentConfig>(written.clone()).expect("reads"), config);
    written.get("precision").cloned()
}

#[test]
fn precision_is_written_where_it_is_not_the_default() {
    assert_eq!(written_precision(Precision::F32), None, "known as before");
    assert_eq!(written_precision(Precision::Bf16), Some("bf16".into()));
}

#[test]
fn a_sensor_has_its_own_discount_factor_or_that_of_all() {
    let plain = AgentConfig { gamma: 0.9, ..AgentConfig::default() };
    let config = AgentConfig { gammas: BTreeMap::from([("A".to_owned(), 0.5)]), ..plain.clone() };
    assert_eq!((config.gamma_for("A"), config.gamma_for("B")), (0.5, 0.9));
    assert_eq!(config.for_sensor("A"), AgentConfig { gamma: 0.5, ..plain.clone() });
    assert_eq!(config.for_sensor("B"), plain);
    assert_eq!(config.check(), Ok(()));
    // It is neither a hyperparameter of one agent nor part of a run's key.
    assert_eq!(config.fields(), plain.fields());
    assert_eq!(*config.identity(), plain);
    let written = serde_json::to_value(&plain).expect("serialises");
    assert_eq!(written.get("gammas"), None, "known as before");
}
