use calib_data::{Dropped, Imported, Shape, without_times};
use calib_pipeline::{
    ExistingFile, Outcome, Printer, StepError, check_log, ensure, on_this_machine,
    output::{count, counted},
    text_left_alone,
};

use crate::cli::ImportArgs;

/// Converts a log of any form to one wide Parquet file.
pub(super) fn run(args: &ImportArgs, printer: &Printer) -> Result<Outcome, StepError> {
    let out = args.out.display();
    ensure!(
        args.out.extension().is_some_and(|extension| extension == "parquet"),
        "{out}: expected the name of a file that ends in .parquet"
    );
    let study = calib_study::of_data(&args.logs, &args.set)?;
    let data = on_this_machine(study.data);
    printer.say(&format!("import: reading {}", data.path.0.join(", ")));
    text_left_alone(&data, printer)?;
    check_log(&data)?;
    let existing = if args.force { ExistingFile::Replaced } else { ExistingFile::Kept };
    let imported = calib_data::import(&data, &args.out, existing, &printer.progress())?;
    if printer.is_json() {
        printer.json(&imported)?;
        return Ok(Outcome::Done);
    }
    let Imported { shape, rows, channels, .. } = imported;
    printer.result(&format!(
        "{out}: {} of {}, from {}",
        counted(rows, "row"),
        counted(channels, "channel"),
        shape_name(shape)
    ))?;
    if let Some(secs) = imported.counted_secs {
        printer.warn(&without_times(secs, imported.files));
    }
    show_dropped(&imported, printer)?;
    for (channel, words) in &imported.words {
        let words: Vec<String> =
            words.iter().take(WORDS).map(|(word, times)| format!("\"{word}\" x{times}")).collect();
        printer.result(&format!("{channel}: {} became missing values", words.join(", ")))?;
    }
    for (channel, times) in &imported.non_finite {
        printer.result(&format!(
            "{channel}: {} not finite or beyond ±1e150 became missing",
            counted(*times as usize, "value")
        ))?;
    }
    for (channel, type_name) in &imported.unreadable {
        printer.result(&format!("{channel}: left out, its type is {type_name}"))?;
    }
    Ok(Outcome::Done)
}

/// Reports the parts of the files that are not in the rows.
fn show_dropped(imported: &Imported, printer: &Printer) -> Result<(), StepError> {
    let Dropped { without_time, undecided, repeated, bad_quality, bad_rows } = &imported.dropped;
    if !bad_rows.is_none() {
        printer.result(&format!(
            "{} cannot be read: left out, such as",
            counted(bad_rows.count as usize, "line")
        ))?;
        let examples = bad_rows.examples.iter();
        for example in examples {
            printer.result(&format!("    {example}"))?;
        }
    }
    let told = [
        (*without_time, "without a timestamp of the years 1 to 9998: dropped"),
        (
            *undecided,
            "among these of an hour that clocks showed twice or never (data.time_zone), which no other row decides",
        ),
        (*repeated, "of the same time as another: one with it"),
        (*bad_quality, "of bad quality: missing values"),
    ];
    for (number, what) in told.into_iter().filter(|(number, _)| *number > 0) {
        printer.result(&format!(
            "{} of {} {what}",
            count(number as usize),
            counted(imported.file_rows as usize, "row")
        ))?;
    }
    Ok(())
}

/// Most words of a channel that are shown.
const WORDS: usize = 3;

/// Returns the name of a shape in messages.
pub(super) fn shape_name(shape: Shape) -> &'static str {
    match shape {
        Shape::Wide => "wide tables: one column per channel",
        Shape::Long => "long tables: one row per sample",
        Shape::FilePerTag => "files of one tag each",
    }
}
