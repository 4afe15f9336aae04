//! State columns that count up evenly, such as a row or episode number. Their states never recur.

use calib_base::StepError;
use calib_core::Monitor;
use calib_data::{
    ChannelProfile, DataConfig, FEW_VALUES, PreprocessConfig, Surveyed, counts_on_evenly, entry_of,
};

use super::log_warnings::LogWarnings;

/// Number of columns that are read at once.
const AT_ONCE: usize = 8;
/// A counting column has about as many values as there are steps in its range. The factor allows for missing rows.
const SLACK: f64 = 2.0;

/// Surveys a log without unnamed columns of row numbers. Warns about other columns that count up evenly.
///
/// # Errors
/// Fails as [`calib_data::survey`] and [`Surveyed::recorded`] do.
pub(super) fn survey(
    mut data: DataConfig,
    preprocess: &PreprocessConfig,
    warnings: &mut LogWarnings<'_>,
    monitor: &dyn Monitor,
) -> Result<Surveyed, StepError> {
    let surveyed = calib_data::survey(&data, preprocess, monitor)?;
    let counting = counting_columns(&surveyed, monitor)?;
    let (numbers, others): (Vec<String>, Vec<String>) =
        counting.into_iter().partition(|name| is_without_name(name));
    warnings.give(others.iter().map(|name| counting_told(name)));
    if numbers.is_empty() {
        return Ok(surveyed);
    }
    warnings.give(numbers.iter().map(|name| numbers_told(name)));
    // The entries are names, and must not be read as patterns.
    data.exclude.extend(numbers.iter().map(|name| entry_of(name, |_| false)));
    Ok(calib_data::survey(&data, preprocess, monitor)?)
}

/// Whether this is a name for pandas row numbers: the first CSV column without a heading, here or in pandas, or the
/// index in Parquet.
fn is_without_name(name: &str) -> bool {
    let index = name.strip_prefix("__index_level_").and_then(|rest| rest.strip_suffix("__"));
    let number = index.or_else(|| name.strip_prefix("Unnamed: "));
    name == "column 1" || number.is_some_and(|number| number.parse::<u32>().is_ok())
}

/// Returns the warning about a column of row numbers.
fn numbers_told(name: &str) -> String {
    format!(
        "{name} has no name of its own and numbers the rows, so it is left out: to keep it as a sensor, give the column a name in the log"
    )
}

/// Returns the kept channels that count up evenly.
///
/// # Errors
/// Fails as [`Surveyed::recorded`] does.
fn counting_columns(surveyed: &Surveyed, monitor: &dyn Monitor) -> Result<Vec<String>, StepError> {
    let profile = surveyed.profile();
    let candidates = profile.kept().filter(|channel| may_count(channel, profile.rows));
    let candidates: Vec<String> = candidates.map(|channel| channel.name.clone()).collect();
    let mut counting = Vec::new();
    for names in candidates.chunks(AT_ONCE) {
        let recorded = surveyed.recorded(names, monitor)?;
        let columns = names.iter().zip(&recorded.values);
        let evenly = columns.filter(|(_, values)| counts_on_evenly(values));
        counting.extend(evenly.map(|(name, _)| name.clone()));
    }
    Ok(counting)
}

/// Whether the values of a channel may fill an even grid almost completely. Those of most sensors do not.
fn may_count(channel: &ChannelProfile, rows: u64) -> bool {
    let Some(values) = &channel.values else { return false };
    let Some(step) = values.smallest_change.filter(|step| *step > 0.0) else { return false };
    let points = (values.max - values.min) / step + 1.0;
    let there = values.distinct.map_or(rows as f64, f64::from);
    points > f64::from(FEW_VALUES) && points <= SLACK * there
}

/// Returns the warning about a column that counts up evenly.
fn counting_told(name: &str) -> String {
    format!(
        "{name} counts on evenly, as the number of a row or an episode does, and agents see it as a sensor: add {name:?} to data.exclude, unless \
         it says how far an episode is"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn row_numbers_of_pandas_have_no_name() {
        for name in ["column 1", "Unnamed: 0", "__index_level_0__"] {
            assert!(is_without_name(name), "{name}");
        }
        for name in ["step", "column 2", "Unnamed: tank", "__index_level_x__", ""] {
            assert!(!is_without_name(name), "{name}");
        }
    }

    #[test]
    fn columns_that_count_are_told_with_a_remedy() {
        let told = counting_told("step");
        assert!(told.starts_with("step counts on evenly, as the number of a row"), "{told}");
        assert!(told.contains("add \"step\" to data.exclude"), "{told}");
        assert!(numbers_told("column 1").starts_with("column 1 has no name of its own and"));
    }
}
