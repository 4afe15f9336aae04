//! Figures and pages from typed rows: SVG, PNG, HTML. It reads no files.
//!
//! - [`Sensitivity`], [`LearningCurves`], [`RolloutFigure`], [`RolloutGrid`], [`RecordedFigure`]: the paper's figures. Each becomes a [`Figure`], written as SVG or PNG.
//! - [`Report`]: all results of a study; [`Report::html`] makes one self-contained page.
//! - [`Overview`]: a page of charts and tables on several studies.
//! - [`AgentConduct`]: what an agent that acts does, and its figures.
//! - [`Verdict`]: what to deploy for one sensor, with its reasons in sentences.
//!
//! This crate lays out curves and paints them as SVG. tiny-skia, with a compiled-in font, turns the same layout into pixels.
//! The output does not depend on the fonts, the clock or the locale of the machine: equal rows give equal bytes.

mod chart;
mod conduct;
mod downsample;
mod duration;
mod environment;
mod error;
mod figures;
mod overview;
mod page;
mod report;
mod setting;

pub use chart::{Axis, Chart, Colour, Dash, Marker, Point, Rule, Scale, ScaleKind, Series, Side};
pub use conduct::{ActionShares, AgentConduct, ColumnConduct, SetPointValues, SetValues};
pub use downsample::{min_max_in_time, min_max_indices};
pub use duration::duration;
pub use environment::LearningEnvironment;
pub use error::ReportError;
pub use figures::{
    Dimension, ErrorCurve, ErrorSource, Figure, LearningCurve, LearningCurves, MAX_POINTS, Panel,
    PeriodUse, RankCurve, RecordedFigure, RecordedLevel, RecordedPeriod, RolloutFigure,
    RolloutGrid, RolloutRow, Samples, Sensitivity, Trajectory,
};
pub use overview::{Decision, Overview, OverviewFigure, OverviewText, Support};
pub use report::{
    Alternative, Best, Cell, Channel, ChannelStatus, ChoiceBaseline, DataProfile, Grade,
    HeldOutResult, JumpStatistics, PartRow, Reason, Recommendation, Report, Reproduction,
    Separation, SimpleRow, Simpler, Sources, Table, TopK, Verdict, caveats, joined, listed,
};
pub use setting::Setting;
