use super::*;

fn read(text: &str) -> Reward {
    #[derive(Deserialize)]
    struct Section {
        reward: Reward,
    }
    let section: Section = toml::from_str(&format!("reward = {text}")).expect("valid");
    section.reward
}

/// Returns the rewards of rows with these values of `x`, of its set-point `sp`, and of the action `valve`.
fn rewards(text: &str, x: &[f64], set_points: &[f64], valve: &[f64]) -> Vec<f32> {
    let names = ["valve", "x", "sp"].map(str::to_owned);
    let values = [valve, x, set_points].map(<[f64]>::to_vec);
    let columns = RewardColumns { names: &names, values: &values, actions: 1 };
    let segments = Segments::from_lengths([x.len()]).expect("rows");
    read(text).of_rows(&columns, &segments, |row| !valve[row].is_nan())
}

const MISSING: f64 = f64::NAN;

/// Returns the rewards of rows with these values of `x`.
fn of_x(text: &str, x: &[f64]) -> Vec<f32> {
    rewards(text, x, &vec![0.0; x.len()], &vec![0.0; x.len()])
}

#[test]
fn terms_are_their_formulas() {
    assert_eq!(of_x("[{ column = 'x', weight = -2 }]", &[3.0]), [-6.0]);
    assert_eq!(of_x("[{ column = 'x', weight = -2, set_point = 5 }]", &[3.0, 7.5]), [-4.0, -5.0]);
    let limits = "[{ column = 'x', weight = -2, low = 1.0, high = 2.0 }]";
    assert_eq!(of_x(limits, &[0.5, 1.5, 4.0]), [-1.0, 0.0, -4.0]);
    assert!(of_x(limits, &[MISSING])[0].is_nan());
    assert_eq!(of_x("'x'", &[7.0, 8.0]), [7.0, 8.0]);
}

#[test]
fn terms_add_up_row_by_row() {
    let text = "[{ column = 'x', weight = -2 }, { column = 'x', weight = -2, high = 2 }]";
    let got = rewards(text, &[1.0, 4.0, MISSING], &[0.0; 3], &[0.0; 3]);
    assert_eq!(got[..2], [-2.0, -12.0]);
    assert!(got[2].is_nan());
}

#[test]
fn a_set_point_may_be_a_column() {
    let text = "[{ column = 'x', weight = -1, set_point = 'sp' }]";
    let got = rewards(text, &[1.0, 4.0, 5.0], &[2.0, 2.0, MISSING], &[0.0; 3]);
    assert_eq!(got[..2], [-1.0, -2.0]);
    assert!(got[2].is_nan(), "a set-point that is missing is no reward of nought");
    assert_eq!(read(text).columns().collect::<Vec<_>>(), ["x", "sp"]);
}

/// Returns the rewards of rows with these values of `x`, for a square with these keys. The set-point is 5.
fn of_squares(keys: &str, x: &[f64]) -> Vec<f32> {
    let text = format!("[{{ column = 'x', weight = -2, power = 2{keys} }}]");
    rewards(&text, x, &vec![5.0; x.len()], &vec![0.0; x.len()])
}

#[test]
fn what_counts_may_be_squared() {
    assert_eq!(of_squares("", &[3.0, -1.0]), [-18.0, -2.0], "of x itself");
    assert_eq!(of_squares(", set_point = 'sp'", &[3.0, 6.0]), [-8.0, -2.0], "of the distance");
    assert_eq!(of_squares(", low = 1, high = 2", &[-2.0, 1.5, 4.0]), [-18.0, 0.0, -8.0]);
    assert!(of_squares("", &[MISSING])[0].is_nan());
    let cube = read("[{ column = 'x' }, { column = 'x', power = 3 }]");
    let told = cube.check().expect_err("a cube").to_string();
    assert!(told.contains("`reward[1].power` is 3, expected 1, or 2"), "{told}");
    let linear = read("[{ column = 'x', power = 1 }]");
    let written = serde_json::to_string(&linear).expect("JSON");
    assert!(!written.contains("power"), "as without the key");
}

#[test]
fn an_action_counts_in_the_step_that_it_was_taken_in() {
    let valve = [1.0, 2.0, 4.0];
    let got = rewards("[{ column = 'valve', weight = -1 }]", &[0.0; 3], &[0.0; 3], &valve);
    assert!(got[0].is_nan(), "no step led there");
    assert_eq!(got[1..], [-1.0, -2.0]);
    let text = "[{ column = 'x', weight = -1, set_point = 'valve' }]";
    let got = rewards(text, &[0.0, 5.0, 5.0], &[0.0; 3], &valve);
    assert_eq!(got[1..], [-4.0, -3.0], "a set-point that an agent sets");
}

/// Returns the rewards of five rows with these actions.
fn of_valve(text: &str, valve: &[f64]) -> Vec<f32> {
    rewards(text, &[7.0; 5], &[0.0; 5], valve)
}

#[test]
fn a_change_of_an_action_counts_in_the_step_that_it_made() {
    let valve = [1.0, 3.0, 3.0, 2.0, 5.0];
    let text = "[{ column = 'valve', change = true, weight = -2 }]";
    // The step to row 1 begins the episode. The step to row 2 has action 3 after 1, that to row 3 has 3 after 3, and that to row 4 has
    // 2 after 3. The last action makes no step.
    assert_eq!(of_valve(text, &valve)[1..], [0.0, -4.0, 0.0, -2.0]);
    let square = "[{ column = 'valve', change = true, power = 2, weight = -2 }]";
    assert_eq!(of_valve(square, &valve)[1..], [0.0, -8.0, 0.0, -2.0]);
    // Without an action in row 1, an episode begins in row 2.
    let got = of_valve(text, &[1.0, MISSING, 3.0, 2.0, 5.0]);
    assert_eq!([got[1], got[3], got[4]], [0.0, 0.0, -2.0]);
    // Without a reward in row 2, an episode begins there too.
    let text = "[{ column = 'valve', change = true, weight = -2 }, { column = 'x' }]";
    let got = rewards(text, &[7.0, 7.0, MISSING, 7.0, 7.0], &[0.0; 5], &valve);
    assert!(got[2].is_nan());
    assert_eq!([got[1], got[3], got[4]], [7.0, 7.0, 5.0]);
}

#[test]
fn a_change_of_a_sensor_counts_in_the_row_that_has_it() {
    let text = "[{ column = 'x', change = true, weight = -1 }]";
    let got = rewards(text, &[1.0, 4.0, 4.0, MISSING, 2.0], &[0.0; 5], &[0.0; 5]);
    assert_eq!(got[..3], [0.0, -3.0, 0.0]);
    assert!(got[3].is_nan() && got[4].is_nan(), "what is missing may have changed");
    let columns = ["valve", "x"].map(str::to_owned);
    let values = [vec![0.0; 4], vec![1.0, 2.0, 9.0, 7.0]];
    let columns = RewardColumns { names: &columns, values: &values, actions: 1 };
    let segments = Segments::from_lengths([2, 2]).expect("rows");
    let got = read(text).of_rows(&columns, &segments, |_| true);
    assert_eq!(got, [0.0, -1.0, 0.0, -2.0], "nothing changes across a gap");
}

#[test]
fn the_key_of_a_column_names_its_term() {
    let reward = read("[{ column = 'x' }, { column = 'y', set_point = 'sp' }]");
    assert_eq!(reward.key_of("x").as_deref(), Some("reward[0].column"));
    assert_eq!(reward.key_of("sp").as_deref(), Some("reward[1].set_point"));
    assert_eq!(reward.key_of("z"), None);
    assert_eq!(read("'x'").key_of("x").as_deref(), Some("reward"));
}

fn refused(text: &str) -> String {
    read(text).check().expect_err(text).to_string()
}

#[test]
fn terms_that_make_no_sense_are_refused() {
    let told = refused("[{ column = 'x' }, { column = 'x', low = 3, high = 2 }]");
    assert!(told.starts_with("`reward[1].low` is 3, expected at most what `high` is"), "{told}");
    assert!(read("[{ column = 'x', low = 2, high = 2 }]").check().is_ok());
    let told = refused("[{ column = 'y' }, { column = 'x', set_point = 'x' }]");
    assert!(told.starts_with("the set-point of reward[1] is its own column, x"), "{told}");
    let told = refused("[{ column = 'x', weight = 0 }]");
    assert!(told.starts_with("`reward[0].weight` is 0, expected another number"), "{told}");
    assert!(read("[{ column = 'x', weight = 0 }, { column = 'y' }]").check().is_ok());
}

#[test]
fn what_means_two_things_is_refused() {
    let told = refused("[{ column = 'x' }, { column = 'x', set_point = 'sp', high = 2 }]");
    assert!(told.starts_with("reward[1] has both set_point and high"), "{told}");
    assert!(told.contains("two terms"), "{told}");
    let told = refused("[{ column = 'x', change = true, set_point = 1 }]");
    assert!(told.starts_with("reward[0] has both change and set_point"), "{told}");
    refused("[{ column = 'x', change = true, low = 1 }]");
    assert!(read("[{ column = 'x', low = 1, high = 2 }]").check().is_ok());
    assert!(Reward::Terms(vec![]).check().is_err());
    let told = refused("[{ column = 'x' }, { column = 'x', low = nan }]");
    assert!(told.starts_with("`reward[1].low` is NaN, expected a finite number"), "{told}");
    let told = refused("[{ column = 'x', set_point = inf }]");
    assert!(told.starts_with("`reward[0].set_point` is inf"), "{told}");
    let told = toml::from_str::<Term>("column = 'x'\nset_point = true").expect_err("neither");
    assert!(told.to_string().contains("a number or the name of a column"), "{told}");
}
