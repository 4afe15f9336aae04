//! Reads a table of runs that another program made.

use std::{collections::BTreeMap, path::Path};

use calib_agent::{AgentConfig, Part, PartScore, Scores};
use calib_base::{Context as _, StepError, bail, ensure, memory::check_table};
use calib_data::table::{Table, read_parquet};
use calib_sweep::{Candidate, EnvironmentId, RunRow, Unit, UnitResult};
use serde_json::Value;

use crate::sweep::tables::MEASURED;

/// Limit on the number of settings, larger than any practical comparison.
const MOST_CANDIDATES: usize = 100_000;

/// The contents of a table of runs.
pub(super) struct Runs {
    /// Sensors in the order in which they appear.
    pub(super) sensors: Vec<String>,
    pub(super) candidates: Vec<Candidate>,
    pub(super) results: Vec<UnitResult>,
}

/// The columns of a table, each with a value in every row. A missing column takes its default.
struct Columns<'a> {
    table: &'a Table,
    rows: usize,
}

impl Columns<'_> {
    fn numbers(&self, name: &str, default: f64) -> Result<Vec<f64>, StepError> {
        match self.table.values(name) {
            None => Ok(vec![default; self.rows]),
            Some(_) => Ok(self.table.numbers(name)?),
        }
    }

    fn counts(&self, name: &str, default: Option<u64>) -> Result<Vec<u64>, StepError> {
        if let (None, Some(default)) = (self.table.values(name), default) {
            return Ok(vec![default; self.rows]);
        }
        let numbers = self.table.numbers(name)?;
        numbers
            .into_iter()
            .enumerate()
            .map(|(row, number)| {
                ensure!(
                    number >= 0.0 && number.fract() == 0.0 && number < 9e15,
                    "row {row}, column {name}: {number} is no count"
                );
                Ok(number as u64)
            })
            .collect()
    }

    fn truths(&self, name: &str) -> Result<Vec<bool>, StepError> {
        match self.table.values(name) {
            None => Ok(vec![false; self.rows]),
            Some(_) => Ok(self.table.column::<bool>(name)?.to_vec()),
        }
    }
}

/// Reads a table of runs. Its errors count for `part`.
pub(super) fn read(path: &Path, part: Part) -> Result<Runs, StepError> {
    check_table(path, None)?;
    let table = read_parquet(path)?;
    of_table(&table, part).with_context(|| format!("{} is no table of runs", path.display()))
}

fn of_table(table: &Table, part: Part) -> Result<Runs, StepError> {
    let environments = table.column::<String>("environment")?;
    let sensors = table.column::<String>("sensor")?;
    let rows = environments.len();
    ensure!(rows > 0, "it has no rows");
    let columns = Columns { table, rows };
    let numbers = columns.counts("candidate", None)?;
    let candidates = candidates(&columns, &numbers, sensors)?;
    let runs = columns.counts("run", None)?;
    let measured = Measured::of(&columns)?;
    let mut units: BTreeMap<(String, EnvironmentId, u64), UnitResult> = BTreeMap::new();
    let mut order: Vec<String> = Vec::new();
    let mut scales: BTreeMap<(&String, usize), f64> = BTreeMap::new();
    for row in 0..rows {
        let environment = environment(&environments[row]).with_context(|| format!("row {row}"))?;
        let sensor = &sensors[row];
        if !order.contains(sensor) {
            order.push(sensor.clone());
        }
        let unit = Unit { sensor: sensor.clone(), environment, run: runs[row] as usize };
        let result = units.entry((sensor.clone(), environment, runs[row]));
        let result = result.or_insert_with(|| measured.unit(row, unit.clone()));
        let candidate = numbers[row] as usize;
        let start_row = measured.start_row[row];
        ensure!(
            u64::from(result.start_row) == start_row,
            "row {row}: {unit} starts at row {start_row}, and at {} in a row before",
            result.start_row
        );
        let scale = *scales.entry((sensor, candidate)).or_insert(measured.error_scale[row]);
        ensure!(
            scale.total_cmp(&measured.error_scale[row]).is_eq(),
            "row {row}: the error_scale of {sensor} is {}, and {scale} in a row before",
            measured.error_scale[row]
        );
        ensure!(
            result.rows.iter().all(|other| other.candidate != candidate),
            "row {row}: candidate {candidate} has another row for {unit}"
        );
        result.rows.push(measured.row(row, candidate, part).with_context(|| format!("row {row}"))?);
    }
    for result in units.values_mut() {
        result.rows.sort_by_key(|row| row.candidate);
    }
    Ok(Runs { sensors: order, candidates, results: units.into_values().collect() })
}

/// The measured values of each run.
struct Measured {
    rmse: Vec<f64>,
    error_scale: Vec<f64>,
    mean_return: Vec<f64>,
    return_std: Vec<f64>,
    steps: Vec<u64>,
    scored_steps: Vec<u64>,
    start_row: Vec<u64>,
    updates: Vec<u64>,
}

impl Measured {
    fn of(columns: &Columns<'_>) -> Result<Self, StepError> {
        let start_row = columns.counts("start_row", Some(0))?;
        let far = start_row.iter().position(|&start| start > u64::from(u32::MAX));
        if let Some(row) = far {
            bail!("row {row}: start_row is {}, expected at most {}", start_row[row], u32::MAX);
        }
        Ok(Self {
            rmse: columns.table.numbers("rmse")?,
            error_scale: columns.numbers("error_scale", 1.0)?,
            mean_return: columns.numbers("mean_return", 0.0)?,
            return_std: columns.numbers("return_std", 0.0)?,
            steps: columns.counts("steps", Some(0))?,
            scored_steps: columns.counts("scored_steps", Some(1))?,
            start_row,
            updates: columns.counts("updates", Some(1))?,
        })
    }

    fn unit(&self, row: usize, unit: Unit) -> UnitResult {
        UnitResult {
            key: String::new(),
            unit,
            seed: 0,
            // Checked before to fit.
            start_row: self.start_row[row] as u32,
            not_finite: None,
            rows: Vec::new(),
        }
    }

    /// Returns one run, with errors in units of the scale.
    fn row(&self, row: usize, candidate: usize, part: Part) -> Result<RunRow, StepError> {
        let rmse = self.rmse[row];
        let scale = self.error_scale[row];
        ensure!(rmse >= 0.0, "rmse is {rmse}; expected an error, or +∞ where the run diverged");
        ensure!(
            scale > 0.0 && scale.is_finite(),
            "error_scale is {scale}; expected a positive number"
        );
        // The returns of a diverged run are not known.
        let [mean_return, return_std] = [self.mean_return[row], self.return_std[row]]
            .map(|value| if value.is_finite() { value / scale } else { 0.0 });
        let score = PartScore {
            scored_steps: self.scored_steps[row].max(1) as usize,
            rmse: rmse / scale,
            mean_return,
            return_std,
        };
        Ok(RunRow {
            candidate,
            steps: self.steps[row] as usize,
            updates: self.updates[row],
            scores: scores(part, score),
            diverged_at: rmse.is_infinite().then_some(0),
            curve: Vec::new(),
        })
    }
}

fn scores(part: Part, score: PartScore) -> Scores {
    let mut scores = Scores::default();
    *match part {
        Part::WholeRun => &mut scores.whole_run,
        Part::AfterFirstQuarter => &mut scores.after_first_quarter,
        Part::FinalQuarter => &mut scores.final_quarter,
    } = Some(score);
    scores
}

/// Parses an environment: `member:3`, `online` or `log-replay`.
fn environment(text: &str) -> Result<EnvironmentId, StepError> {
    match text.split_once(':') {
        None if text == "online" => return Ok(EnvironmentId::Online),
        None if text == "log-replay" => return Ok(EnvironmentId::LogReplay),
        Some(("member", number)) => {
            if let Ok(number) = number.parse() {
                return Ok(EnvironmentId::Member(number));
            }
        }
        _ => {}
    }
    bail!(
        "environment is \"{text}\"; expected \"member:0\" and so on, \"online\" or \"log-replay\""
    )
}

/// Returns the settings that the rows describe.
fn candidates(
    columns: &Columns<'_>,
    numbers: &[u64],
    sensors: &[String],
) -> Result<Vec<Candidate>, StepError> {
    let count = numbers.iter().max().map_or(0, |most| *most as usize + 1);
    ensure!(count <= MOST_CANDIDATES, "candidate {} is not numbered from 0 on", count - 1);
    let mut firsts: Vec<Option<usize>> = vec![None; count];
    for (row, &candidate) in numbers.iter().enumerate() {
        firsts[candidate as usize].get_or_insert(row);
    }
    let labels = match columns.table.values("label") {
        None => None,
        Some(_) => Some(columns.table.column::<String>("label")?),
    };
    let defaults = columns.truths("is_default")?;
    for (row, &candidate) in numbers.iter().enumerate() {
        let first = firsts[candidate as usize].unwrap_or(row);
        let told = |what: String, before: String| {
            format!("row {row}: candidate {candidate} {what}, and {before} in row {first}")
        };
        if let Some(labels) = labels {
            let here = &labels[row];
            let there = &labels[first];
            ensure!(here == there, told(format!("is called \"{here}\""), format!("\"{there}\"")));
        }
        let here = defaults[row];
        let there = defaults[first];
        ensure!(here == there, told(format!("has is_default = {here}"), there.to_string()));
    }
    let gammas = gammas(columns, numbers, sensors, count)?;
    let fields = fields(columns, numbers, count);
    let mut all: Vec<Candidate> = Vec::with_capacity(count);
    for (index, (first, gammas)) in firsts.into_iter().zip(gammas).enumerate() {
        let row = first.with_context(|| {
            format!("candidate {index} of {count} has no row; number them from 0 on")
        })?;
        let values = match labels {
            Some(labels) => labelled(&labels[row]),
            None if fields.is_empty() => vec![("candidate".to_owned(), index.into())],
            None => {
                fields.iter().map(|(name, values)| (name.clone(), values[index].clone())).collect()
            }
        };
        let agent = AgentConfig { gammas, ..AgentConfig::default() };
        all.push(Candidate { index, is_default: defaults[row], values, agent });
    }
    let mut names: BTreeMap<String, usize> = BTreeMap::new();
    for candidate in &all {
        if let Some(other) = names.insert(candidate.label(), candidate.index) {
            bail!(
                "candidates {other} and {} are both \"{}\"; give each a label of its own",
                candidate.index,
                candidate.label()
            );
        }
    }
    let defaults: Vec<usize> = all
        .iter()
        .filter(|candidate| candidate.is_default)
        .map(|candidate| candidate.index)
        .collect();
    ensure!(
        defaults.len() <= 1,
        "candidates {} and {} are both the default (is_default); one can be",
        defaults[0],
        defaults[1]
    );
    Ok(all)
}

/// Returns the discount factor of each sensor, for each of `count` settings. Numbers outside [0, 1) are left out.
///
/// # Errors
/// Returns an error if rows of a setting and a sensor have different values.
fn gammas(
    columns: &Columns<'_>,
    numbers: &[u64],
    sensors: &[String],
    count: usize,
) -> Result<Vec<BTreeMap<String, f64>>, StepError> {
    let gamma = columns.numbers("gamma", AgentConfig::default().gamma)?;
    let mut firsts: BTreeMap<(u64, &str), usize> = BTreeMap::new();
    let mut all = vec![BTreeMap::new(); count];
    for (row, (&candidate, sensor)) in numbers.iter().zip(sensors).enumerate() {
        let first = *firsts.entry((candidate, sensor.as_str())).or_insert(row);
        let [here, there] = [gamma[row], gamma[first]];
        ensure!(
            here.total_cmp(&there).is_eq(),
            "row {row}: candidate {candidate} has gamma = {here} for {sensor}, and {there} in row {first}"
        );
        if first == row && (0.0..1.0).contains(&here) {
            all[candidate as usize].insert(sensor.clone(), here);
        }
    }
    Ok(all)
}

/// Parses the values in a label such as `learning_rate = 0.1, optimiser = adam`. A label of another form counts as a
/// value itself.
fn labelled(label: &str) -> Vec<(String, Value)> {
    let pairs: Option<Vec<_>> = label
        .split(", ")
        .map(|part| {
            let (name, told) = part.split_once(" = ")?;
            Some((name.to_owned(), number_or_text(told)))
        })
        .collect();
    pairs.unwrap_or_else(|| vec![("value".to_owned(), number_or_text(label))])
}

fn number_or_text(text: &str) -> Value {
    let number = text.parse::<f64>().ok().and_then(serde_json::Number::from_f64);
    number.map_or_else(|| Value::from(text), Value::Number)
}

/// Returns the swept fields: columns that calib does not define, with one number per setting and at least two different
/// numbers.
fn fields(columns: &Columns<'_>, numbers: &[u64], count: usize) -> Vec<(String, Vec<Value>)> {
    let mut fields = Vec::new();
    for name in columns.table.names().filter(|name| !describes_runs(name)) {
        let Ok(values) = columns.table.numbers(name) else { continue };
        let mut of_candidates: Vec<Option<f64>> = vec![None; count];
        let alike = values.iter().zip(numbers).all(|(value, candidate)| {
            let known = of_candidates[*candidate as usize].get_or_insert(*value);
            known.to_bits() == value.to_bits()
        });
        let known: Vec<f64> = of_candidates.into_iter().flatten().collect();
        let differ = known.windows(2).any(|pair| pair[0] != pair[1]);
        if alike && differ && known.len() == count {
            let values = known.into_iter().map(Value::from).collect();
            fields.push((name.to_owned(), values));
        }
    }
    fields
}

/// Whether a column describes runs, and is therefore not a swept field.
fn describes_runs(column: &str) -> bool {
    let named = ["environment", "sensor", "run", "candidate", "label", "is_default"];
    named.contains(&column) || MEASURED.contains(&column)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(environments: [&str; 4], candidates: [u32; 4], rmse: [f64; 4]) -> Table {
        Table::new()
            .with("environment", environments.map(str::to_owned).to_vec())
            .with("sensor", vec!["A".to_owned(); 4])
            .with("run", vec![0_u32; 4])
            .with("candidate", candidates.to_vec())
            .with("rmse", rmse.to_vec())
            .with("step_size", candidates.map(|number| f64::from(number) / 4.0).to_vec())
    }

    fn refused(table: &Table) -> String {
        match of_table(table, Part::WholeRun) {
            Ok(_) => unreachable!("refused"),
            Err(error) => format!("{error}"),
        }
    }

    const MEMBERS: [&str; 4] = ["member:0", "member:0", "member:1", "member:1"];

    #[test]
    fn rows_become_units() {
        let rmse = [1.0, 2.0, f64::INFINITY, 0.5];
        let runs = of_table(&table(MEMBERS, [0, 1, 1, 0], rmse), Part::FinalQuarter);
        let runs = runs.expect("valid");
        assert_eq!(runs.sensors, ["A"]);
        let labels: Vec<String> = runs.candidates.iter().map(Candidate::label).collect();
        assert_eq!(labels, ["step_size = 0", "step_size = 0.25"]);
        assert_eq!(runs.results.len(), 2);
        let [first, second] = [0, 1].map(|unit: usize| -> Vec<Option<f64>> {
            runs.results[unit].rows.iter().map(|row| row.rmse(Part::FinalQuarter)).collect()
        });
        assert_eq!(first, [Some(1.0), Some(2.0)]);
        assert_eq!(second, [Some(0.5), Some(f64::INFINITY)]);
    }

    fn fine() -> Table {
        table(MEMBERS, [0, 1, 0, 1], [1.0, 2.0, 1.5, 0.5])
    }

    fn texts(texts: [&str; 4]) -> Vec<String> {
        texts.map(str::to_owned).to_vec()
    }

    #[test]
    fn contradictions_are_refused() {
        assert!(
            of_table(&fine().with("label", texts(["a", "b", "a", "b"])), Part::WholeRun).is_ok()
        );
        for (bad, told) in [
            (
                fine().with("label", texts(["a", "b", "a", "c"])),
                "row 3: candidate 1 is called \"c\"",
            ),
            (fine().with("label", texts(["a", "a", "a", "a"])), "0 and 1 are both \"value = a\""),
            (fine().with("is_default", vec![true, false, false, false]), "row 2: candidate 0 has"),
            (fine().with("is_default", vec![true; 4]), "are both the default"),
            (
                fine().with("gamma", vec![0.9, 0.9, 0.8, 0.9]),
                "row 2: candidate 0 has gamma = 0.8 for A, and 0.9 in row 0",
            ),
            (fine().with("error_scale", vec![1.0, 1.0, 2.0, 1.0]), "the error_scale of A is 2"),
            (fine().with("start_row", vec![5_u32, 6, 7, 7]), "starts at row 6, and at 5"),
            (fine().with("start_row", vec![5_i64, 5, 7, 1 << 40]), "expected at most 4294967295"),
        ] {
            assert!(refused(&bad).contains(told), "{told}: {}", refused(&bad));
        }
    }

    #[test]
    fn sensors_may_have_discount_factors_of_their_own() {
        let table = Table::new()
            .with("environment", texts(["member:0"; 4]))
            .with("sensor", texts(["A", "A", "B", "B"]))
            .with("run", vec![0_u32; 4])
            .with("candidate", vec![0_u32, 1, 0, 1])
            .with("rmse", vec![1.0, 2.0, 1.5, 0.5])
            .with("step_size", vec![0.0, 0.25, 0.0, 0.25])
            .with("gamma", vec![0.9, 0.9, 0.8, 0.8]);
        let runs = of_table(&table, Part::WholeRun).expect("valid");
        for candidate in &runs.candidates {
            let gammas = ["A", "B"].map(|sensor| candidate.agent.gamma_for(sensor));
            assert_eq!(gammas, [0.9, 0.8]);
        }
        let labels: Vec<String> = runs.candidates.iter().map(Candidate::label).collect();
        assert_eq!(labels, ["step_size = 0", "step_size = 0.25"], "gamma was not swept");
    }

    fn labelled_candidate(label: &str) -> Candidate {
        Candidate {
            index: 0,
            is_default: false,
            values: labelled(label),
            agent: AgentConfig::default(),
        }
    }

    #[test]
    fn labels_tell_values() {
        for label in ["learning_rate = 0.1, optimiser = adam", "value = forest", "a = 1e-3"] {
            assert_eq!(labelled_candidate(label).label(), label);
        }
        assert_eq!(labelled_candidate("forest, deep").label(), "value = forest, deep");
        assert_eq!(labelled_candidate("a = 0.001").values[0].1.as_f64(), Some(0.001));
    }

    #[test]
    fn mistakes_are_located() {
        let fine = [1.0; 4];
        let strange = ["member:0", "member:0", "member:1", "membre:1"];
        for (bad, told) in [
            (table(strange, [0, 1, 0, 1], fine), "row 3: environment is \"membre:1\""),
            (table(MEMBERS, [0, 0, 0, 1], fine), "row 1: candidate 0 has another row"),
            (table(MEMBERS, [0, 2, 0, 2], fine), "candidate 1 of 3 has no row"),
            (table(MEMBERS, [0, 1, 0, 1], [1.0, f64::NAN, 1.0, 1.0]), "row 1: rmse is NaN"),
            (Table::new().with("environment", vec![String::new()]), "sensor"),
        ] {
            assert!(refused(&bad).contains(told), "{told}: {}", refused(&bad));
        }
    }
}
