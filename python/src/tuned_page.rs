//! The page on agents that were tuned from Python.

use std::{io::Write as _, path::PathBuf};

use calib_files::write_atomically;
use calib_report::{
    AgentConduct, Axis, Cell, Chart, Dash, Decision, Overview, OverviewFigure, Point, Rule, Scale,
    Series, Table,
};
use calib_stats::jackknife;
use pyo3::prelude::*;
use serde::Deserialize;

use crate::errors;

/// The number of settings whose returns are drawn. The table has all settings.
const DRAWN: usize = 12;

/// The content of the page.
#[derive(Deserialize)]
struct TunedPage {
    title: String,
    subtitle: String,
    decision: Decision,
    findings: Vec<String>,
    warnings: Vec<String>,
    /// The settings, the best first.
    settings: Vec<PageSetting>,
    /// The kinds of models that agents learned in.
    kinds: Vec<String>,
    /// `None` if no run of the chosen agent was recorded.
    conduct: Option<PageConduct>,
    command: String,
}

/// What the chosen agent did at the end of a run.
#[derive(Deserialize)]
struct PageConduct {
    /// The kind of model of the run and its ensemble member, as in "the neighbours of ensemble member 0".
    model: String,
    /// Names of the actions.
    actions: Vec<String>,
    conduct: AgentConduct,
}

#[derive(Deserialize)]
struct PageSetting {
    name: String,
    /// "chosen", "default", or an empty text.
    role: String,
    mean_rank: f64,
    worst_rank: f64,
    /// `None` if the setting diverged.
    mean_return: Option<f64>,
    uncovered: f64,
    chosen_again: f64,
    /// For each kind of model, the mean return in each ensemble member; `None` if it diverged.
    returns: Vec<Vec<Option<f64>>>,
}

impl PageSetting {
    fn label(&self) -> String {
        if self.role.is_empty() {
            self.name.clone()
        } else {
            format!("{} ({})", self.name, self.role)
        }
    }
}

/// Writes a page on tuned agents, given as JSON.
#[pyfunction]
pub(crate) fn write_tuned_page(py: Python<'_>, path: PathBuf, page: &str) -> PyResult<()> {
    let page: TunedPage = serde_json::from_str(page).map_err(errors::unusable)?;
    let html = page.overview().html();
    write_atomically(&path, |file| file.write_all(html.as_bytes()))
        .map_err(|error| errors::of_any(py, &error))
}

impl TunedPage {
    fn overview(self) -> Overview {
        let mut figures = vec![self.returns()];
        if let Some(PageConduct { model, actions, conduct }) = &self.conduct {
            figures.extend(conduct.figures(actions, model).into_iter().map(|(_, figure)| figure));
        }
        let tables = vec![self.table()];
        Overview {
            title: self.title,
            subtitle: Some(self.subtitle),
            decision: Some(self.decision),
            findings: self.findings,
            warnings: self.warnings,
            texts: Vec::new(),
            figures,
            tables,
            command: self.command,
        }
    }

    /// Returns a table of all settings, in the order of the rule.
    fn table(&self) -> Table {
        let columns = [
            "setting",
            "",
            "mean rank",
            "worst rank",
            "model return",
            "not covered",
            "chosen again",
        ];
        Table {
            title: "Settings".to_owned(),
            caption: "By mean rank over the ensemble members of all kinds of models. The return in the model ranks settings, and is not what the plant will give. Not covered: steps for which the log has no such action near. Chosen again: the share of resamples of the runs in which the setting is chosen."
                .to_owned(),
            columns: columns.map(str::to_owned).to_vec(),
            rows: self.settings.iter().map(|setting| {
            vec![
                Cell::Text(setting.name.clone()),
                Cell::Text(setting.role.clone()),
                Cell::Number(setting.mean_rank),
                Cell::Number(setting.worst_rank),
                Cell::Number(setting.mean_return.unwrap_or(f64::NAN)),
                Cell::Percent(setting.uncovered),
                Cell::Percent(setting.chosen_again),
            ]
        }).collect(),
            best: None,
        }
    }

    /// Returns a figure of each setting's mean return in each kind of model, with intervals
    /// over ensemble members.
    fn returns(&self) -> OverviewFigure {
        let placed = self
            .settings
            .iter()
            .enumerate()
            .filter(|(place, setting)| *place < DRAWN || setting.role == "default");
        let drawn: Vec<&PageSetting> = placed.map(|(_, setting)| setting).collect();
        let mut series = Vec::with_capacity(self.kinds.len());
        for (kind, name) in self.kinds.iter().enumerate() {
            let points = drawn.iter().enumerate().map(|(place, setting)| {
                let members = setting.returns[kind].iter();
                let members: Vec<f64> = members.map(|value| value.unwrap_or(f64::NAN)).collect();
                let mean = members.iter().sum::<f64>() / members.len() as f64;
                let interval = jackknife(mean, &members).map(|ends| (ends.low, ends.high));
                Point { x: place as f64, y: mean, interval }
            });
            series.push(Series::numbered(kind, name, points.collect()));
        }
        let scale = Series::scale_around(&series);
        let marks = [("chosen", Dash::Solid), ("default", Dash::Dashed)];
        let rules = marks.into_iter().filter_map(|(role, dash)| {
            let place = drawn.iter().position(|setting| setting.role == role)?;
            Some(Rule { x: place as f64, label: role.to_owned(), dash })
        });
        let title = "Return in the models".to_owned();
        let rows = drawn.iter().enumerate().map(|(place, setting)| {
            let returns = series.iter().map(|series| Cell::Number(series.points[place].y));
            std::iter::once(Cell::Text(setting.label())).chain(returns).collect()
        });
        let rows = rows.collect();
        OverviewFigure {
            caption: "Mean return per episode, learning included, in each kind of model, with 95 % intervals over blocks of the log. The best setting by mean rank is on the left. Returns rank settings and do not say what the plant will give."
                .to_owned(),
            table: Table {
                title: title.clone(),
                columns: std::iter::once("setting".to_owned()).chain(self.kinds.clone()).collect(),
                rows,
                ..Table::default()
            },
            panels: Vec::new(),
            chart: Chart {
                description: "Mean return per episode of each setting, in each kind of model."
                    .to_owned(),
                title,
                x: Axis {
                    label: "setting".to_owned(),
                    scale: Scale::names(drawn.iter().map(|setting| setting.name.clone()).collect()),
                },
                left: Axis { label: "return per episode, in the model".to_owned(), scale },
                right: None,
                rules: rules.collect(),
                series,
            },
        }
    }
}
