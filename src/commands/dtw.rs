use std::{io::Write as _, path::Path};

use calib_dtw::{Alignment, Distance, Dtw, Ends, PatternSet, Series, Settings, StepPattern};
use calib_files::{FileError, check_output, is_same_file, write_output};
use calib_pipeline::{
    Context as _, ExistingFile, Outcome, Printer, StepError, bail,
    output::{count, table},
    require_memory,
};
use schemars::JsonSchema;
use serde::Serialize;

use super::series;
use crate::cli::DtwArgs;

/// The output of `--json`.
#[derive(Debug, Serialize, JsonSchema)]
pub(crate) struct Results {
    results: Vec<PatternResult>,
}

#[derive(Debug, Serialize, JsonSchema)]
pub(crate) struct PatternResult {
    step_pattern: String,
    distance: f64,
    /// The normalised distance; `null` for step patterns without a normalisation.
    normalized_distance: Option<f64>,
}

impl PatternResult {
    fn new(pattern: &StepPattern, distance: Distance) -> Self {
        Self {
            step_pattern: pattern.name().to_owned(),
            distance: distance.raw,
            normalized_distance: distance.normalised,
        }
    }
}

/// Compares two series with one or several step patterns.
pub(super) fn run(args: &DtwArgs, printer: &Printer) -> Result<Outcome, StepError> {
    let existing = if args.force { ExistingFile::Replaced } else { ExistingFile::Kept };
    if let Some(path) = &args.path {
        check_output(path, existing)?;
        if [&args.query, &args.reference]
            .iter()
            .any(|argument| is_same_file(&series::path(argument), path))
        {
            return Err(FileError::Input { path: path.clone() }.into());
        }
    }
    let query = series::read(&args.query).context("query")?;
    let reference = series::read(&args.reference).context("reference")?;
    let query = Series::with_channels(&query.values, query.channels)?;
    let reference = Series::with_channels(&reference.values, reference.channels)?;
    printer.say(&format!(
        "dtw: query of {}, reference of {} samples",
        count(query.len()),
        count(reference.len())
    ));
    let settings = Settings {
        local_distance: args.local_distance,
        window: args.window,
        ends: match (args.open_begin, args.open_end) {
            (false, false) => Ends::Closed,
            (false, true) => Ends::OpenEnd,
            (true, false) => Ends::OpenBegin,
            (true, true) => Ends::OpenBoth,
        },
    };
    let results = match &args.path {
        Some(path) => vec![aligned(args, settings, query, reference, (path, existing), printer)?],
        None => compared(args, settings, query, reference)?,
    };
    if printer.is_json() {
        printer.json(&Results { results })?;
    } else {
        show(&results, printer)?;
    }
    Ok(Outcome::Done)
}

fn compared(
    args: &DtwArgs,
    settings: Settings,
    query: Series<'_>,
    reference: Series<'_>,
) -> Result<Vec<PatternResult>, StepError> {
    let set = PatternSet::new(args.step_pattern.as_slice(), settings);
    let distances = set.distances(query, reference)?;
    let patterns = args.step_pattern.iter().zip(distances);
    patterns.map(|(pattern, distance)| Ok(PatternResult::new(pattern, distance?))).collect()
}

/// Compares two series with one step pattern, and writes the warping path to a file.
fn aligned(
    args: &DtwArgs,
    settings: Settings,
    query: Series<'_>,
    reference: Series<'_>,
    (path, existing): (&Path, ExistingFile),
    printer: &Printer,
) -> Result<PatternResult, StepError> {
    let [pattern] = args.step_pattern.as_slice() else {
        bail!(
            "--path wants exactly one --step-pattern, got {}; choose one, such as --step-pattern {}",
            args.step_pattern.len(),
            args.step_pattern.first().map_or("symmetric2", StepPattern::name),
        );
    };
    let dtw = Dtw::with_settings(pattern.clone(), settings);
    let needed = dtw.path_bytes(query.len(), reference.len());
    require_memory(needed, "the warping path", "shorten the series, or leave --path out")?;
    let alignment = dtw.align(query, reference)?;
    write_path(path, existing, &alignment)?;
    printer.say(&format!(
        "wrote {}: {} matched samples, counted from 0",
        path.display(),
        count(alignment.path.len())
    ));
    Ok(PatternResult::new(pattern, alignment.distance))
}

fn write_path(path: &Path, existing: ExistingFile, alignment: &Alignment) -> Result<(), FileError> {
    write_output(path, existing, |file| {
        writeln!(file, "query,reference")?;
        for (query, reference) in &alignment.path {
            writeln!(file, "{query},{reference}")?;
        }
        Ok(())
    })
}

fn show(results: &[PatternResult], printer: &Printer) -> Result<(), StepError> {
    let rows: Vec<Vec<String>> = results
        .iter()
        .map(|result| {
            vec![
                result.step_pattern.clone(),
                number_text(result.distance),
                result.normalized_distance.map_or_else(|| "–".to_owned(), number_text),
            ]
        })
        .collect();
    printer.lines(&table(&["step pattern", "distance", "normalised"], &rows))
}

/// Formats a number with six decimals, or with an exponent if it is very small or long.
fn number_text(number: f64) -> String {
    if number == 0.0 || (1e-3..1e9).contains(&number) {
        format!("{number:.6}")
    } else {
        format!("{number:.6e}")
    }
}
