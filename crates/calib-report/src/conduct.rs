//! What an agent does: its last steps, and the actions that it takes along each column.

use calib_core::number;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{
    Cell, OverviewFigure, Panel, Table,
    chart::{Axis, Chart, Colour, Dash, Point, Scale, Series, Side},
};

/// Largest number of action columns that are drawn.
const ACTION_PANELS: usize = 3;
/// Names of the files with the actions along each column.
const TAKEN: [&str; 4] = ["taken-1", "taken-2", "taken-3", "taken-4"];

/// Behaviour of an agent at the end of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct AgentConduct {
    /// Number of steps that `taken` counts: the last quarter of the run.
    pub steps: usize,
    /// Values that each action column was set to in the last steps.
    pub set: Vec<SetValues>,
    /// Columns of the states, those of the reward first.
    pub columns: Vec<ColumnConduct>,
    /// Rewards of the last steps.
    pub rewards: Vec<f64>,
    /// Indices of the last steps at which an episode begins.
    pub begins: Vec<usize>,
}

/// A column of the actions.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SetValues {
    /// Its name.
    pub column: String,
    /// Values in the last steps.
    pub values: Vec<f64>,
}

/// A column of the states, in its unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ColumnConduct {
    /// Its name.
    pub column: String,
    /// Whether a term of the reward counts the column.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub in_reward: bool,
    /// Its set-point in the reward, if the reward has one and its values are known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub set_point: Option<SetPointValues>,
    /// Values in the last steps.
    pub values: Vec<f64>,
    /// Upper bounds of the parts of the recorded range.
    pub upper: Vec<f64>,
    /// Number of the agent's steps in each part.
    pub steps: Vec<usize>,
    /// Share of these steps in which the action was taken, `[actions][parts]`; 0 in parts that the agent
    /// never visited.
    pub taken: Vec<Vec<f64>>,
}

/// The set-point of a column.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SetPointValues {
    /// The column that holds it, if it is not one number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub column: Option<String>,
    /// Values in the last steps.
    pub values: Vec<f64>,
}

impl AgentConduct {
    /// Returns the figures of the chosen agent, with the names of their files: its last steps, and where along each
    /// column it takes which of these `actions`. `model` names the model of its run, such as "neighbours of the first ensemble member".
    pub fn figures(&self, actions: &[String], model: &str) -> Vec<(&'static str, OverviewFigure)> {
        let columns = TAKEN.into_iter().zip(&self.columns);
        std::iter::once(("last-steps", self.last_steps(model)))
            .chain(columns.map(|(name, column)| (name, self.taken(column, actions, model))))
            .collect()
    }

    /// Draws the last steps, one plot below the other: the columns of the reward, what was set, and the reward. If no
    /// column is counted by a term of the reward, all columns are drawn.
    fn last_steps(&self, model: &str) -> OverviewFigure {
        let plots = self.plots();
        let title = "The last steps of the chosen agent".to_owned();
        let headings: Vec<&str> = plots.iter().map(|plot| plot.heading.as_str()).collect();
        let description = format!("Against the step: {}.", headings.join("; "));
        let left = Axis { label: String::new(), scale: Scale::linear(0.0, 1.0) };
        let columns = plots.iter().flat_map(|plot| &plot.lines).map(|line| line.name.clone());
        OverviewFigure {
            caption: format!(
                "The last steps of the chosen agent's first run, in the {model}. Lines break where an episode begins."
            ),
            table: Table {
                title: title.clone(),
                columns: std::iter::once("step".to_owned()).chain(columns).collect(),
                rows: (0..self.rewards.len())
                    .map(|step| {
                        let lines = plots.iter().flat_map(|plot| &plot.lines);
                        let numbers = lines.map(|line| Cell::Number(line.values[step]));
                        let number = Cell::Count(self.first_step() as u64 + step as u64);
                        std::iter::once(number).chain(numbers).collect()
                    })
                    .collect(),
                ..Table::default()
            },
            panels: plots
                .iter()
                .enumerate()
                .map(|(number, plot)| {
                    let label = if number + 1 == plots.len() { "step" } else { "" };
                    Panel { heading: plot.heading.clone(), chart: self.chart(plot, number, label) }
                })
                .collect(),
            chart: Chart { title, description, ..Chart::of(self.step_axis("step"), left, vec![]) },
        }
    }

    /// Returns the plots of the last steps, from top to bottom.
    fn plots(&self) -> Vec<StepPlot<'_>> {
        let has_terms = self.columns.iter().any(|column| column.in_reward);
        let columns = self.columns.iter().filter(|column| column.in_reward || !has_terms);
        let set = self.set.iter().take(ACTION_PANELS).map(|set| StepPlot {
            heading: set.column.clone(),
            lines: vec![StepLine::new(&set.column, &set.values).held()],
        });
        let reward = StepPlot {
            heading: "reward".to_owned(),
            lines: vec![StepLine::new("reward", &self.rewards)],
        };
        columns.map(ColumnConduct::plot).chain(set).chain([reward]).collect()
    }

    fn chart(&self, plot: &StepPlot<'_>, number: usize, x_label: &str) -> Chart {
        let values: Vec<f64> = plot.lines.iter().flat_map(|line| line.values).copied().collect();
        let left = Axis { label: String::new(), scale: Scale::linear_around(&values) };
        let series = plot.lines.iter().map(|line| Series {
            label: line.name.clone(),
            side: Side::Left,
            colour: Colour::Curve(number),
            dash: line.dash,
            width: 1.6,
            marker: None,
            points: self.points(line),
        });
        Chart::of(self.step_axis(x_label), left, series.collect())
    }

    fn points(&self, line: &StepLine<'_>) -> Vec<Point> {
        let mut points = Vec::with_capacity(2 * line.values.len());
        for (step, &y) in line.values.iter().enumerate() {
            let x = self.first_step() + step as f64;
            if self.begins.contains(&step) {
                // A missing point separates episodes.
                points.push(Point { x, y: f64::NAN, interval: None });
            } else if line.is_held && step > 0 {
                points.push(Point { x, y: line.values[step - 1], interval: None });
            }
            points.push(Point { x, y, interval: None });
        }
        points
    }

    /// Number of the first of the last steps among the counted steps, from 1 on.
    fn first_step(&self) -> f64 {
        1.0 + self.steps.saturating_sub(self.rewards.len()) as f64
    }

    fn step_axis(&self, label: &str) -> Axis {
        let first = self.first_step();
        let last = first + self.rewards.len() as f64 - 1.0;
        Axis { label: label.to_owned(), scale: Scale::linear(first, last) }
    }

    /// Draws the actions that the agent takes along a column.
    fn taken(&self, column: &ColumnConduct, actions: &[String], model: &str) -> OverviewFigure {
        let visited: Vec<Vec<f64>> = column
            .taken
            .iter()
            .map(|shares| {
                let parts = shares.iter().zip(&column.steps);
                parts.map(|(&share, &steps)| if steps > 0 { share } else { f64::NAN }).collect()
            })
            .collect();
        let name = &column.column;
        let shares = ActionShares {
            title: format!("What the chosen agent does along {name}"),
            caption: format!(
                "Share of the agent's steps in each fifth of {name} in which it takes the action, over the last {} steps of its first run in the \
                 {model}. Lines have no point where it never was. It goes on exploring, so no share need be 100 %.",
                self.steps
            ),
            axis: "steps in which it is taken (%)",
            column: name,
            upper: &column.upper,
            actions,
            shares: &visited,
        };
        shares.figure()
    }
}

/// One plot of the last steps.
struct StepPlot<'a> {
    heading: String,
    lines: Vec<StepLine<'a>>,
}

/// A line over the last steps.
struct StepLine<'a> {
    name: String,
    values: &'a [f64],
    dash: Dash,
    /// Whether a value holds until the next one.
    is_held: bool,
}

impl<'a> StepLine<'a> {
    fn new(name: &str, values: &'a [f64]) -> Self {
        Self { name: name.to_owned(), values, dash: Dash::Solid, is_held: false }
    }

    fn held(self) -> Self {
        Self { is_held: true, ..self }
    }
}

impl ColumnConduct {
    fn plot(&self) -> StepPlot<'_> {
        let own = StepLine::new(&self.column, &self.values);
        let Some(set_point) = &self.set_point else {
            return StepPlot { heading: self.column.clone(), lines: vec![own] };
        };
        let told = match (&set_point.column, set_point.values.first()) {
            (Some(column), _) => format!("set-point {column}"),
            (None, Some(&value)) => format!("set-point {}", number(value)),
            (None, None) => "set-point".to_owned(),
        };
        let name = set_point.column.clone().unwrap_or_else(|| format!("{} set-point", self.column));
        let dashed = StepLine { dash: Dash::Dashed, ..StepLine::new(&name, &set_point.values) };
        StepPlot {
            heading: format!("{} (dashed: {told})", self.column),
            lines: vec![own, dashed.held()],
        }
    }
}

/// The share of each action in each part of a column.
#[derive(Debug, Clone, PartialEq)]
pub struct ActionShares<'a> {
    /// Title of the figure.
    pub title: String,
    /// Explanation of the figure.
    pub caption: String,
    /// What the shares are of, for the vertical axis.
    pub axis: &'a str,
    /// Name of the column.
    pub column: &'a str,
    /// Upper bounds of the parts.
    pub upper: &'a [f64],
    /// Names of the actions.
    pub actions: &'a [String],
    /// `[actions][parts]`, from 0 to 1; NaN for none.
    pub shares: &'a [Vec<f64>],
}

impl ActionShares<'_> {
    /// Draws the shares, one curve per action.
    pub fn figure(&self) -> OverviewFigure {
        let Self { title, caption, axis, column, upper, actions, shares } = self;
        let series = actions.iter().zip(*shares).enumerate().map(|(number, (action, shares))| {
            let points = shares.iter().enumerate().map(|(part, share)| Point {
                x: part as f64,
                y: 100.0 * share,
                interval: None,
            });
            Series::numbered(number, action, points.collect())
        });
        let parts: Vec<String> =
            upper.iter().map(|upper| format!("to {}", number(*upper))).collect();
        OverviewFigure {
            caption: caption.clone(),
            table: Table {
                title: title.clone(),
                columns: std::iter::once((*column).to_owned())
                    .chain(actions.iter().cloned())
                    .collect(),
                rows: parts
                    .iter()
                    .enumerate()
                    .map(|(part, name)| {
                        let own = shares.iter().map(|shares| match shares[part] {
                            share if share.is_nan() => Cell::Missing,
                            share => Cell::Percent(share),
                        });
                        std::iter::once(Cell::Text(name.clone())).chain(own).collect()
                    })
                    .collect(),
                ..Table::default()
            },
            chart: Chart {
                description: format!("{title}: {axis} of each action."),
                title: title.clone(),
                x: Axis { label: (*column).to_owned(), scale: Scale::names(parts) },
                // Leaves room for whole markers at 100 %.
                left: Axis { label: (*axis).to_owned(), scale: Scale::linear(0.0, 103.0) },
                right: None,
                series: series.collect(),
                rules: Vec::new(),
            },
            panels: Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn column(name: &str, in_reward: bool, set_point: Option<SetPointValues>) -> ColumnConduct {
        ColumnConduct {
            column: name.to_owned(),
            in_reward,
            set_point,
            values: vec![1.0, 2.0, 4.0, 3.0],
            upper: vec![2.0, 4.0],
            steps: vec![5, 3],
            taken: vec![vec![1.0, 0.0], vec![0.0, 1.0]],
        }
    }

    fn conduct(columns: Vec<ColumnConduct>) -> AgentConduct {
        let set = SetValues { column: "valve".to_owned(), values: vec![0.0, 1.0, 1.0, 0.0] };
        AgentConduct { steps: 8, set: vec![set], columns, rewards: vec![-1.0; 4], begins: vec![2] }
    }

    fn last_steps(conduct: &AgentConduct) -> OverviewFigure {
        let actions = ["shut", "open"].map(str::to_owned);
        let (name, figure) =
            conduct.figures(&actions, "neighbours of the first ensemble member").swap_remove(0);
        assert_eq!(name, "last-steps");
        figure
    }

    fn headings(figure: &OverviewFigure) -> Vec<&str> {
        figure.panels.iter().map(|panel| panel.heading.as_str()).collect()
    }

    /// Returns the path elements of an SVG that have this class of colour.
    fn paths<'a>(svg: &'a str, colour: &str) -> Vec<&'a str> {
        let start = format!("path class=\"line {colour}\"");
        svg.split('<').filter(|element| element.starts_with(&start)).collect()
    }

    #[test]
    fn every_column_of_the_reward_has_a_plot_with_its_set_point_dashed() {
        let number = SetPointValues { column: None, values: vec![2.5; 4] };
        let tag = SetPointValues { column: Some("target".to_owned()), values: vec![3.0; 4] };
        let columns = vec![
            column("level", true, Some(number)),
            column("flow", true, Some(tag)),
            column("pressure", true, None),
            column("ambient", false, None),
        ];
        let figure = last_steps(&conduct(columns));
        assert_eq!(
            headings(&figure),
            [
                "level (dashed: set-point 2.5)",
                "flow (dashed: set-point target)",
                "pressure",
                "valve",
                "reward"
            ]
        );
        let svg = figure.figure().svg();
        // Two episodes are two lines, and so are their set-points.
        for (colour, lines, dashed) in
            [("c0", 4, 2), ("c1", 4, 2), ("c2", 2, 0), ("c3", 2, 0), ("c4", 2, 0)]
        {
            let drawn = paths(&svg, colour);
            let with_dashes = drawn.iter().filter(|path| path.contains("stroke-dasharray"));
            assert_eq!((drawn.len(), with_dashes.count()), (lines, dashed), "{colour}");
        }
        assert_eq!(
            figure.table.columns,
            ["step", "level", "level set-point", "flow", "target", "pressure", "valve", "reward"]
        );
        assert_eq!(figure.table.rows.len(), 4);
        assert_eq!(
            figure.table.rows[0][..3],
            [Cell::Count(5), Cell::Number(1.0), Cell::Number(2.5)]
        );
    }

    #[test]
    fn without_terms_every_column_is_drawn() {
        let columns = vec![column("angle", false, None), column("spin", false, None)];
        assert_eq!(headings(&last_steps(&conduct(columns))), ["angle", "spin", "valve", "reward"]);
    }

    #[test]
    fn an_action_holds_until_the_next_one_and_not_across_episodes() {
        let conduct = conduct(Vec::new());
        let valve = StepLine::new("valve", &conduct.set[0].values).held();
        let drawn: Vec<(f64, Option<f64>)> = conduct
            .points(&valve)
            .into_iter()
            .map(|point| (point.x, Some(point.y).filter(|y| !y.is_nan())))
            .collect();
        assert_eq!(
            drawn,
            [
                (5.0, Some(0.0)),
                (6.0, Some(0.0)),
                (6.0, Some(1.0)),
                (7.0, None),
                (7.0, Some(1.0)),
                (8.0, Some(1.0)),
                (8.0, Some(0.0)),
            ]
        );
    }

    #[test]
    fn actions_have_no_share_in_parts_that_were_not_visited() {
        let mut level = column("level", true, None);
        level.steps = vec![8, 0];
        let actions = ["shut", "open"].map(str::to_owned);
        let figures = conduct(vec![level]).figures(&actions, "network of ensemble member 3");
        assert_eq!(
            figures.iter().map(|(name, _)| *name).collect::<Vec<_>>(),
            ["last-steps", "taken-1"]
        );
        let taken = &figures[1].1;
        assert!(
            taken.caption.contains("in the network of ensemble member 3."),
            "{}",
            taken.caption
        );
        assert_eq!(taken.table.rows[1][1..], [Cell::Missing, Cell::Missing]);
        assert_eq!(taken.table.rows[0][1..], [Cell::Percent(1.0), Cell::Percent(0.0)]);
    }
}
