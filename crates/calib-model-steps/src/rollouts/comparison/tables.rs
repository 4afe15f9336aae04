//! The comparison in the report.

use calib_base::StepError;
use calib_report::{Best, Cell, Table};
use calib_stats::{ClusterSummary, Difference};

use super::{
    MEASURES, SensorComparison,
    pair::Distance,
    paired::ComparedModel,
    show::{basis, left_out, mean_and_half, plus_minus},
};
use crate::{
    STEP_PATTERNS,
    rollouts::{self, every_two},
};

/// Columns before those of the models, in the table of warping distances and in that of the other measures.
const OF_WARPING: [&str; 3] = ["sensor", "step pattern", "distance"];
const OF_OTHERS: [&str; 2] = ["sensor", "distance"];

/// Returns tables for the report: the means of each model, then every two models. If there are several models, the best
/// of a row is bold, and so are all without a clear difference from it.
///
/// # Errors
/// If an interval cannot be computed.
pub fn report_tables(models: &[ComparedModel<'_>]) -> Result<Vec<Table>, StepError> {
    // A model without a comparison has empty columns beside those of others.
    let Some(first) = models.iter().find(|model| !model.comparison.sensors.is_empty()) else {
        return Ok(Vec::new());
    };
    let mut warping = Rows::default();
    let mut others = Rows::default();
    for sensor in &first.comparison.sensors {
        let name = Cell::Text(sensor.sensor.clone());
        for (place, pattern) in STEP_PATTERNS.iter().enumerate() {
            let kinds =
                [("normalised", Distance::Normalised(place)), ("raw", Distance::Raw(place))];
            for (kind, distance) in kinds {
                let leading = [(*pattern).to_owned(), kind.to_owned()].map(Cell::Text);
                let leading = [&[name.clone()][..], &leading].concat();
                warping.add(leading, models, &sensor.sensor, distance)?;
            }
        }
        for (place, measure) in MEASURES.iter().enumerate() {
            let leading = vec![name.clone(), Cell::Text(measure.label.to_owned())];
            others.add(leading, models, &sensor.sensor, Distance::Measure(place))?;
        }
    }
    let equal =
        (models.iter()).all(|model| model.comparison.fewest_steps == model.comparison.most_steps);
    let raw = if equal { "" } else { " Raw distances grow with the number of steps." };
    let mut tables = vec![
        warping.into_table(
            models,
            "Dynamic time warping",
            &format!(
                "Lower is better. Compare models within a row, not step patterns with each other.{raw}"
            ),
            &OF_WARPING,
        ),
        others.into_table(
            models,
            "Other distances of trajectories",
            "Lower is better. They compare distributions, memory and frequencies, so a rollout may be out of step and still score well.",
            &OF_OTHERS,
        ),
    ];
    tables.extend(two_by_two(models, &first.comparison.sensors)?);
    Ok(tables)
}

/// Cells of a table, and the positions of the bold ones.
#[derive(Default)]
struct Rows {
    cells: Vec<Vec<Cell>>,
    bold: Vec<(usize, usize)>,
}

impl Rows {
    /// Returns the table with these columns before those of the models. `how` says how to read it.
    fn into_table(
        self,
        models: &[ComparedModel<'_>],
        title: &str,
        how: &str,
        leading: &[&str],
    ) -> Table {
        Table {
            title: title.to_owned(),
            caption: caption(models, how),
            columns: columns(models, leading),
            rows: self.cells,
            best: Some(Best::Cells(self.bold)),
        }
    }

    /// Adds the means of all models for one distance.
    fn add(
        &mut self,
        mut row: Vec<Cell>,
        models: &[ComparedModel<'_>],
        sensor: &str,
        distance: Distance,
    ) -> Result<(), StepError> {
        let leading = row.len();
        let summaries: Vec<Option<&ClusterSummary>> =
            models.iter().map(|model| model.summary(sensor, distance)).collect();
        row.extend(summaries.iter().flat_map(|summary| cells(*summary)));
        let place = self.cells.len();
        for model in not_worse(models, &summaries, sensor, distance)? {
            self.bold.push((place, leading + 2 * model));
        }
        self.cells.push(row);
        Ok(())
    }
}

/// Returns the model with the smallest mean, and all without a clear difference from it. Empty if there is no choice.
fn not_worse(
    models: &[ComparedModel<'_>],
    summaries: &[Option<&ClusterSummary>],
    sensor: &str,
    distance: Distance,
) -> Result<Vec<usize>, StepError> {
    let own = summaries.iter().enumerate();
    let known = own.filter_map(|(model, summary)| Some((model, (*summary)?.mean)));
    let known: Vec<(usize, f64)> = known.collect();
    if known.len() < 2 || !are_alike(models) {
        return Ok(Vec::new());
    }
    rollouts::not_worse(&known, |model, best| {
        let difference = models[model].minus(&models[best], sensor, distance)?;
        Ok(difference.is_some_and(|difference| difference.is_told()))
    })
}

/// Whether all models are compared with the same record. A model that is compared with its own past has an easier task
/// than one that is compared with a deployment.
fn are_alike(models: &[ComparedModel<'_>]) -> bool {
    models.iter().all(|one| models.iter().all(|other| one.is_held_to_the_record_of(other)))
}

fn columns(models: &[ComparedModel<'_>], leading: &[&str]) -> Vec<String> {
    let models = models.iter().flat_map(|model| [model.name.to_owned(), "95 %".to_owned()]);
    leading.iter().map(|&name| name.to_owned()).chain(models).collect()
}

fn cells(summary: Option<&ClusterSummary>) -> [Cell; 2] {
    let Some(summary) = summary else { return [Cell::Missing, Cell::Missing] };
    let half = summary.interval.map_or(Cell::Missing, |interval| Cell::Text(plus_minus(interval)));
    [Cell::Number(summary.mean), half]
}

fn caption(models: &[ComparedModel<'_>], how: &str) -> String {
    let several = models.len() > 1;
    let basis = bases(models);
    let sentences = [
        (
            several && are_alike(models),
            " Bold: the smallest mean of a row, and every other without a clear difference from it, because the 95 % interval \
             of their difference contains 0 or there is none.",
        ),
        (!are_alike(models), " Models are held to different records: none is best."),
    ];
    let sentences = sentences.into_iter().filter(|(holds, _)| *holds).map(|(_, text)| text);
    let missing = models.iter().flat_map(|model| {
        let whose = if several { format!(" of {}", model.name) } else { String::new() };
        left_out(model.comparison)
            .map(move |(number, why)| format!(" {number} rollouts{whose} are left out: {why}."))
    });
    let more: String = sentences.map(str::to_owned).chain(missing).collect();
    format!(
        "Rollouts against what was recorded after the same start (or the state of the deployment that it stands for), on \
         the normalised sensor: {basis}. Ensemble members that start from the same state are one observation: a mean over start states of the means over ensemble members. {how}{more}"
    )
}

/// Returns a text on the data over which each model's means are taken. Models with the same text are named together.
fn bases(models: &[ComparedModel<'_>]) -> String {
    let mut bases: Vec<(String, Vec<&str>)> = Vec::new();
    for model in models.iter().filter(|model| !model.comparison.sensors.is_empty()) {
        let own = basis(model.comparison);
        match bases.iter_mut().find(|(basis, _)| *basis == own) {
            Some((_, names)) => names.push(model.name),
            None => bases.push((own, vec![model.name])),
        }
    }
    if let [(only, _)] = bases.as_slice() {
        return only.clone();
    }
    let named = bases.iter().map(|(basis, names)| format!("{}: {basis}", names.join(", ")));
    named.collect::<Vec<_>>().join("; ")
}

/// Returns a table of every two models, if there are several: differences of distances, and how often one is nearer.
fn two_by_two(
    models: &[ComparedModel<'_>],
    sensors: &[SensorComparison],
) -> Result<Option<Table>, StepError> {
    let alike = every_two(models).filter(|(one, other)| one.is_held_to_the_record_of(other));
    let pairs: Vec<(&ComparedModel<'_>, &ComparedModel<'_>)> = alike.collect();
    let mut rows = Rows::default();
    for sensor in sensors {
        for distance in Distance::shown() {
            let mut row = vec![Cell::Text(sensor.sensor.clone()), Cell::Text(distance.label())];
            for (one, other) in &pairs {
                let difference = one.minus(other, &sensor.sensor, distance)?;
                if difference.is_some_and(|difference| difference.is_told()) {
                    rows.bold.push((rows.cells.len(), row.len()));
                }
                row.extend(of_two(difference));
            }
            rows.cells.push(row);
        }
    }
    if pairs.is_empty() {
        return Ok(None);
    }
    let headings = pairs.iter().flat_map(|(one, other)| {
        [format!("{} − {}", one.name, other.name), format!("nearer, {} : {}", one.name, other.name)]
    });
    Ok(Some(Table {
        title: "Models two by two".to_owned(),
        caption: "Distance of the first model minus that of the second, from the same start state and, where both have as many, in the same ensemble member: mean over start states ± 95 % interval. Below 0 the first is nearer to what was \
                  recorded. Bold: the interval does not contain 0. Then from how many start states the first is nearer and from \
                  how many the second; nothing where two models share too few start states, whose difference is that of \
                  independent samples."
            .to_owned(),
        columns: OF_OTHERS.map(str::to_owned).into_iter().chain(headings).collect(),
        rows: rows.cells,
        best: Some(Best::Cells(rows.bold)),
    }))
}

fn of_two(difference: Option<Difference>) -> [Cell; 2] {
    let Some(difference) = difference else { return [Cell::Missing, Cell::Missing] };
    let nearer = difference.smaller.map(|[one, other]| Cell::Text(format!("{one} : {other}")));
    let mean = Cell::Text(mean_and_half(difference.mean, difference.interval));
    [mean, nearer.unwrap_or(Cell::Missing)]
}
