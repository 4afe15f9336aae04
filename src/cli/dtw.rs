//! Arguments of `calib dtw`.

use std::path::PathBuf;

use calib_dtw::{LocalDistance, StepPattern, Window};
use calib_pipeline::STEP_PATTERNS;
use clap::Args;

use super::heading::OUTPUT;

#[derive(Debug, Args)]
#[expect(clippy::struct_excessive_bools, reason = "each is an option of its own")]
pub(crate) struct DtwArgs {
    /// The first series: FILE.npy, FILE.csv or FILE.parquet, with :COLUMN where there are several
    pub(crate) query: String,
    /// The second series, in the same form
    pub(crate) reference: String,
    /// Which steps a warping path may take and what they cost, such as symmetricP2 or
    /// rabinerJuang:3c:smoothed; may be given several times
    #[arg(long, value_name = "PATTERN", default_values = STEP_PATTERNS)]
    pub(crate) step_pattern: Vec<StepPattern>,
    /// Which pairs of samples may be matched: none, sakoeChiba:RADIUS, slanted:RADIUS or itakura
    #[arg(long, value_name = "WINDOW", default_value = "none")]
    pub(crate) window: Window,
    /// The query may begin anywhere in the reference (patterns normalised by the query's length)
    #[arg(long)]
    pub(crate) open_begin: bool,
    /// The query may end anywhere in the reference
    #[arg(long)]
    pub(crate) open_end: bool,
    /// Distance of two samples: absolute, squared or euclidean
    #[arg(long, value_name = "DISTANCE", default_value = "absolute")]
    pub(crate) local_distance: LocalDistance,
    /// Write the warping path as CSV; needs exactly one step pattern
    #[arg(long, value_name = "FILE")]
    pub(crate) path: Option<PathBuf>,
    /// Replace the file of the warping path if it is there
    #[arg(long, requires = "path")]
    pub(crate) force: bool,
    /// Print the distances as JSON
    #[arg(long, help_heading = OUTPUT)]
    pub(crate) json: bool,
}
