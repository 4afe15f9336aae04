use anyhow::ensure;
use calib_data::{DataConfig, Imported, Shape};
use calib_pipeline::{Outcome, Printer, Standing, output::counted, text_left_alone, working_files};

use crate::cli::ImportArgs;

/// Write a log of any form as one wide Parquet file.
pub(super) fn run(args: &ImportArgs, printer: &Printer) -> anyhow::Result<Outcome> {
    let out = args.out.display();
    ensure!(
        args.out.extension().is_some_and(|extension| extension == "parquet"),
        "{out}: expected the name of a file that ends in .parquet"
    );
    let study = calib_study::of_data(&args.logs, &args.set)?;
    let data = DataConfig { scratch: working_files(), ..study.data };
    printer.say(&format!("import: reading {}", data.path.0.join(", ")));
    text_left_alone(&data, printer)?;
    let standing = if args.force { Standing::Replaced } else { Standing::Kept };
    let imported = calib_data::import(&data, &args.out, standing, &printer.progress())?;
    if printer.is_for_machines() {
        printer.json(&imported)?;
        return Ok(Outcome::Done);
    }
    let Imported { shape, rows, channels, words } = imported;
    printer.result(&format!(
        "{out}: {} of {}, from {}",
        counted(rows, "row"),
        counted(channels, "channel"),
        shape_name(shape)
    ))?;
    for (channel, words) in words {
        let words: Vec<String> =
            words.iter().take(WORDS).map(|(word, times)| format!("\"{word}\" x{times}")).collect();
        printer.result(&format!("{channel}: {} became missing values", words.join(", ")))?;
    }
    Ok(Outcome::Done)
}

/// Words of a channel that are shown.
const WORDS: usize = 3;

/// What a person calls a shape.
pub(super) fn shape_name(shape: Shape) -> &'static str {
    match shape {
        Shape::Wide => "wide tables: a column a channel",
        Shape::Long => "long tables: a row a sample",
        Shape::FilePerTag => "files of one tag each",
    }
}
