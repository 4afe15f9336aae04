//! Tests of files as loggers and people write them, including damage.

use std::fmt::Write as _;

use calib_core::Silent;
use calib_data::{
    BadRows, ContradictionCause, Contradictions, DataConfig, format_time, sketch, table::Table,
};

use crate::support::{Folder, assert_refused, kept, log_at, profile, refusal, seconds};

const ROWS: u32 = 300;

fn wave(row: u32, length: f64, low: f64, high: f64) -> f64 {
    low + (high - low) * (0.5 + 0.5 * (f64::from(row) / length).sin())
}

/// Returns the day and the hour of a row in a log with one row per hour.
fn day_and_hour(row: u32) -> (u32, u32) {
    (1 + row / 24, row % 24)
}

/// Returns the log of an air-quality station in an Italian city: dates and times with dots in two columns, decimal
/// commas, -200 for a missing value, two empty columns, and empty rows at the end.
fn air_quality() -> String {
    let mut text = String::from("Date;Time;CO(GT);PT08.S1(CO);T;;\r\n");
    for row in 0..ROWS {
        let (day, hour) = day_and_hour(row);
        let co = wave(row, 4.0, 0.1, 11.9);
        let sensor = wave(row, 5.0, 647.0, 2_040.0);
        let t = wave(row, 9.0, -1.9, 44.6);
        let [co, sensor, t] = [co, sensor, t].map(|value| {
            if row % 50 == 7 { "-200".to_owned() } else { format!("{value:.1}").replace('.', ",") }
        });
        write!(text, "{day:02}/03/2004;{hour:02}.00.00;{co};{sensor};{t};;\r\n").expect("memory");
    }
    text + ";;;;;;\r\n;;;;;;\r\n"
}

#[test]
fn numbers_for_no_value_are_found_and_taken_out() {
    let folder = Folder::of_text("air.csv", &air_quality());
    let mut data = folder.data();
    let found = profile(&data);
    let [sentinel] = &found.sentinels[..] else { panic!("one: {:?}", found.sentinels) };
    assert_eq!((sentinel.value, sentinel.count), (-200.0, 18));
    assert_eq!(sentinel.channels, ["CO(GT)", "PT08.S1(CO)", "T"]);
    let doubt = found.sentinel_doubt().expect("told");
    assert!(doubt.contains("data.missing_values = [-200]"), "{doubt}");
    assert_eq!(sketch(&data, &Silent).expect("a log").sentinels, found.sentinels);
    data.missing_values = vec![-200.0];
    let cleaned = profile(&data);
    assert!(cleaned.sentinels.is_empty());
    let co = cleaned.channel("CO(GT)").expect("there");
    assert_eq!((co.stood_for_missing, co.missing), (6, 6));
    assert!(co.values.as_ref().is_some_and(|values| values.min >= 0.0));
    // On its own clock, before values are interpolated.
    data.resample = Some(calib_data::Resample::Linear);
    data.period_secs = Some(1_800.0);
    let resampled = profile(&data);
    let low = resampled.channel("CO(GT)").expect("there").values.as_ref().map(|values| values.min);
    assert!(low.is_some_and(|low| low >= 0.0), "{low:?}");
}

#[test]
fn dates_and_times_in_two_columns_are_one_time() {
    let folder = Folder::of_text("air.csv", &air_quality());
    let found = profile(&folder.data());
    assert_eq!(kept(&found), ["CO(GT)", "PT08.S1(CO)", "T"], "the time of day is no channel");
    assert!(found.channel("Time").is_err());
    assert_eq!((found.rows, found.period_secs, found.null_timestamps), (300, 3_600.0, 2));
    assert_eq!(format_time(found.end), "2004-03-13 11:00:00");
}

/// The log of a household meter: days and months without leading zeros, question marks, a text file.
#[test]
fn days_without_leading_zeros_are_read_from_txt() {
    let mut text = String::from("Date;Time;Global_active_power;Voltage\n");
    for row in 0..ROWS {
        let (day, hour) = day_and_hour(row + 20 * 24);
        let power =
            if row == 9 { "?".to_owned() } else { format!("{:.3}", wave(row, 3.0, 0.2, 4.0)) };
        writeln!(
            text,
            "{}/{}/2007;{hour:02}:00:00;{power};{:.2}",
            day % 28 + 1,
            1 + day / 28,
            wave(row, 7.0, 230.0, 245.0)
        )
        .expect("memory");
    }
    let folder = Folder::of_text("household_power_consumption.txt", &text);
    folder.write_file("README.txt", "A meter, read every minute.\n");
    let found = profile(&folder.data());
    assert_eq!((found.rows, found.files), (300, 1));
    assert_eq!(format_time(found.start), "2007-01-22 00:00:00");
    assert_eq!(found.channels[0].words, [("?".to_owned(), 1)]);
}

/// Writes lines of a logger that lost power: one cut off, one written into another, null bytes, a header in the middle.
fn damaged(folder: &Folder, rows: u32) {
    for (day, lines) in
        [(13, [(3, "13.03.2024 00:0")]), (14, [(40, "14.03.2024 00:3814.03.2024 00:39;1,5;2")])]
    {
        let mut text = String::from("Datum Uhrzeit;T1;T2\n");
        for row in 0..rows {
            if let Some((_, damage)) = lines.iter().find(|(at, _)| *at == row) {
                writeln!(text, "{damage}").expect("memory");
            }
            if row == 60 {
                text.push_str("\0\0\0\0\0\0\0\0;1,0;2,0\nDatum Uhrzeit;T1;T2\n");
            }
            let hour = row / 60;
            let minute = row % 60;
            let values =
                format!("{:.2};{:.2}", wave(row, 9.0, 10.0, 60.0), wave(row, 7.0, 0.0, 9.0));
            let values = values.replace('.', ",");
            writeln!(text, "{day}.03.2024 {hour:02}:{minute:02};{values}").expect("memory");
        }
        folder.write_file(&format!("202403{day}.csv"), &text);
    }
}

#[test]
fn a_hint_that_asks_has_no_full_stop() {
    let mut text = String::from("time,a,b\n");
    for row in 0..300 {
        writeln!(text, "{},{},{}", 1_704_067_200 + row, row % 7, row % 5).expect("memory");
    }
    text.push_str("end of export\n");
    let folder = Folder::of_text("a.csv", &text);
    let told = refusal(&folder.data());
    assert!(told.contains("notes below the table? Restore"), "{told}");
}

#[test]
fn damaged_lines_are_told_together_and_left_out() {
    let folder = Folder::new();
    damaged(&folder, 600);
    let mut data = folder.data();
    let told = refusal(&data);
    assert!(told.starts_with("6 of 1206 lines cannot be read: "), "{told}");
    assert!(
        told.contains("20240313.csv, line 5: 1 cells") || told.contains("20240313.csv, line 5: "),
        "{told}"
    );
    assert!(told.contains("20240314.csv, line 42: "), "{told}");
    assert_eq!(told.matches(", line ").count(), 5, "the first five: {told}");
    assert!(told.contains("data.bad_rows = \"skip\" leaves such lines out"), "{told}");
    assert_eq!(told.matches("data.timestamp_format").count(), 1, "the advice once: {told}");
    data.bad_rows = BadRows::Skip;
    let found = profile(&data);
    assert_eq!((found.bad_rows.count, found.bad_rows.examples.len(), found.rows), (6, 5, 1_200));
    assert_eq!(kept(&found), ["T1", "T2"]);
    let few = Folder::new();
    damaged(&few, 61);
    let data = DataConfig { bad_rows: BadRows::Skip, ..few.data() };
    assert_refused(&data, &["more than one line in a hundred"]);
}

#[test]
fn a_damaged_time_among_the_first_rows_has_a_line() {
    let text = "time;a\n01.03.2024 00:00;1\n13.03.2024 0x:01;2\n14.03.2024 00:02;3\n";
    let folder = Folder::of_text("a.csv", text);
    assert_refused(&folder.data(), &["line 3", "13.03.2024 0x:01"]);
}

/// Returns four turbines in one table.
fn turbines(by_time: bool) -> String {
    let mut text = String::from("Wind_turbine_name,Date_time,P_avg,Ws_avg,Wa_avg\n");
    let names = ["R80711", "R80721", "R80736", "R80790"];
    let mut rows: Vec<(u32, usize)> =
        (0..ROWS).flat_map(|row| (0..4).map(move |turbine| (row, turbine))).collect();
    if !by_time {
        rows.sort_by_key(|(_, turbine)| *turbine);
    }
    for (row, turbine) in rows {
        let (day, hour) = day_and_hour(row);
        let shift = 3.0 * turbine as f64;
        writeln!(
            text,
            "{},2014-01-{day:02}T{hour:02}:00:00+01:00,{:.2},{:.2},{:.1}",
            names[turbine],
            wave(row, 9.0, shift, 2_000.0),
            wave(row, 7.0, 1.0, 14.0 + shift),
            wave(row, 5.0, 0.0, 359.0 - shift)
        )
        .expect("memory");
    }
    text
}

#[test]
fn one_of_several_plants_in_a_table_is_chosen() {
    for by_time in [true, false] {
        let folder = Folder::of_text("wind.csv", &turbines(by_time));
        let mut data = folder.data();
        let expected = "They are of 4 different \"Wind_turbine_name\" (R80711, R80721, R80736, R80790): choose one with data.where, \
                        on the command line as --set 'data.where={ \"Wind_turbine_name\" = \"R80711\" }'";
        assert_refused(&data, &[expected]);
        let told = sketch(&data, &Silent).expect_err("refused").to_string();
        assert!(told.contains(expected) && told.contains("P_avg is"), "{told}");
        assert!(matches!(
            profile(&data).contradictions.cause,
            Some(ContradictionCause::Column { .. })
        ));
        data.only.insert("Wind_turbine_name".to_owned(), "R80721".to_owned());
        let found = profile(&data);
        assert_eq!(
            (found.rows, found.duplicates.identical, found.contradictions.count),
            (300, 0, 0)
        );
        assert_eq!(kept(&found), ["P_avg", "Ws_avg", "Wa_avg"]);
        data.only.insert("Turbine".to_owned(), "1".to_owned());
        assert_refused(&data, &["no column \"Turbine\", which data.where names"]);
    }
}

#[test]
fn one_of_several_plants_in_parquet_is_chosen() {
    let times = (0..200_i64).map(|row| row / 2 * 60);
    let unit: Vec<f64> = (0..200).map(|row| f64::from(row % 2 + 1)).collect();
    let flow: Vec<f64> =
        (0..200).map(|row| f64::from(row % 2) * 50.0 + wave(row / 2, 9.0, 1.0, 4.0)).collect();
    let folder = Folder::of("log.parquet", &log_at(times, &[("unit", &unit), ("flow", &flow)]));
    let mut data = folder.data();
    assert_refused(&data, &["'data.where={ \"unit\" = \"1\" }'"]);
    data.only.insert("unit".to_owned(), "2".to_owned());
    let found = profile(&data);
    assert_eq!((found.rows, found.null_timestamps, found.duplicates.identical), (100, 0, 0));
    let flow = found.channel("flow").expect("there").values.as_ref();
    assert!(flow.is_some_and(|values| values.min > 50.0));
}

fn room(shift: f64) -> String {
    let mut text = String::from("time,temperature,co2\n");
    for row in 0..ROWS {
        let (day, hour) = day_and_hour(row);
        writeln!(
            text,
            "2024-03-{day:02} {hour:02}:00,{:.2},{:.0}",
            wave(row, 9.0, 18.0, 20.0 + shift),
            wave(row, 5.0, 400.0, 900.0 + shift)
        )
        .expect("memory");
    }
    text
}

#[test]
fn files_of_rooms_with_the_same_columns_are_told_apart_by_name() {
    for names in [
        ["kitchen.csv", "bath.csv"],
        ["kitchen/log.csv", "bath/log.csv"],
        ["kitchen_2024-03-01.csv", "bath_2024-03-01.csv"],
    ] {
        let folder = Folder::of_text(names[0], &room(1.0));
        folder.write_file(names[1], &room(3.0));
        let mut data = folder.data();
        assert_refused(
            &data,
            &["files with the same columns (bath, kitchen)", "data.file_as_prefix = true"],
        );
        data.file_as_prefix = true;
        let found = profile(&data);
        let channels = ["bath temperature", "bath co2", "kitchen temperature", "kitchen co2"];
        assert_eq!(kept(&found), channels, "{names:?}");
        assert_eq!((found.rows, found.duplicates.identical, found.merged_rows), (300, 0, 300));
    }
}

#[test]
fn columns_of_several_files_are_merged_and_no_duplicates() {
    let folder = Folder::of_text("a.csv", &room(1.0));
    folder.write_file("b.csv", &room(3.0).replace("temperature,co2", "level,flow"));
    let found = profile(&folder.data());
    assert_eq!((found.duplicates.identical, found.merged_rows), (0, 300));
    // A repeated row is a duplicate.
    let twice = room(1.0) + "2024-03-13 12:00,18.00,400\n2024-03-13 12:00,18.00,400\n";
    folder.write_file("a.csv", &twice);
    let found = profile(&folder.data());
    assert_eq!((found.duplicates.identical, found.merged_rows), (1, 300));
}

#[test]
fn a_log_without_times_has_numbered_rows_if_the_period_is_given() {
    let folder = Folder::new();
    for name in ["a.csv", "b.csv"] {
        let mut text = String::from("flow,level\n");
        (0..ROWS).for_each(|row| {
            writeln!(text, "{:.2},{:.2}", wave(row, 9.0, 0.0, 1.0), wave(row, 5.0, 2.0, 7.0))
                .expect("memory");
        });
        folder.write_file(name, &text);
    }
    let mut data = folder.data();
    let told = refusal(&data);
    let hint = "if the log has no times, set data.period_secs to the seconds from row to row (--set data.period_secs=60)";
    assert!(told.contains(hint), "{told}");
    data.period_secs = Some(10.0);
    let found = profile(&data);
    assert!(found.without_times);
    assert_eq!((found.rows, found.gaps.count, found.duplicates.identical), (600, 1, 0));
    let [doubt] = &found.clock_doubts()[..] else { panic!("one: {:?}", found.clock_doubts()) };
    assert!(doubt.contains("NO COLUMN OF TIMES") && doubt.contains("10 s apart"), "{doubt}");
    // A file without times among others is not part of the log.
    folder.write_file("c.csv", &room(1.0));
    assert_refused(&folder.data(), &["1 other file has one: leave this file out of data.path"]);
}

/// The result of R's write.table for a room's sensors: the column of row names has no name itself.
#[test]
fn names_of_rows_are_left_out() {
    let mut text = String::from("\"date\",\"Temperature\",\"CO2\"\n");
    for row in 0..ROWS {
        let t = wave(row, 9.0, 19.0, 24.4);
        let co2 = wave(row, 5.0, 412.0, 1_402.0);
        let (day, hour) = day_and_hour(row);
        writeln!(text, "\"{}\",\"2015-02-{day:02} {hour:02}:00:00\",{t:.2},{co2:.1}", row + 140)
            .expect("memory");
    }
    let folder = Folder::of_text("datatest.txt", &text);
    let data = DataConfig { path: folder.file("datatest.txt").into(), ..folder.data() };
    let found = profile(&data);
    assert_eq!(kept(&found), ["Temperature", "CO2"]);
    assert_eq!((found.period_secs, found.rows), (3_600.0, u64::from(ROWS)));
    let [told] = &found.clock_doubts()[..] else { panic!("one: {:?}", found.clock_doubts()) };
    assert!(told.contains("the header has 3 names and rows have 4 values"), "{told}");
    assert!(told.contains("left out as \"row\""), "{told}");
}

/// Returns the log of a city's weather station, whose program wrote each part of the time into its own column.
fn times_in_parts(header: &str, hours: bool) -> String {
    let mut text = format!("{header}\n");
    for row in 0..24 {
        let (day, hour) = day_and_hour(row);
        let clock = if hours { format!("{hour},") } else { String::new() };
        let day = if hours { day } else { row + 1 };
        let wind = ["NW", "cv"][row as usize % 2];
        let dew = wave(row, 5.0, -21.0, 3.0);
        writeln!(text, "{},2010,1,{day},{clock}{dew:.1},{wind}", row + 1).expect("memory");
    }
    text
}

#[test]
fn times_in_parts_are_joined() {
    let folder =
        Folder::of_text("PRSA.csv", &times_in_parts("No,year,month,day,hour,DEWP,cbwd", true));
    let data = DataConfig { path: folder.file("PRSA.csv").into(), ..folder.data() };
    let found = profile(&data);
    assert_eq!(found.period_secs, 3_600.0);
    assert_eq!(format_time(found.start), "2010-01-01 00:00:00");
    assert_eq!(format_time(found.end), "2010-01-01 23:00:00");
    assert_eq!(kept(&found), ["No", "DEWP"], "no part of the time is a channel");
    let told = found.clock_doubts().join("; ");
    assert!(told.contains("joined from the columns year, month, day, hour"), "{told}");
    folder.write_file("daily.csv", &times_in_parts("No,Year,Month,Day,DEWP,cbwd", false));
    let data = DataConfig { path: folder.file("daily.csv").into(), ..folder.data() };
    assert_eq!(profile(&data).period_secs, 86_400.0);
    folder.write_file(
        "short.csv",
        &times_in_parts("No,year,month,day,hour,DEWP,cbwd", true).replace("2010", "10"),
    );
    let data = DataConfig { path: folder.file("short.csv").into(), ..folder.data() };
    let error = refusal(&data);
    assert!(error.contains("The columns year to hour look like parts of a date"), "{error}");
    assert!(error.contains("--set data.timestamp=NAME") && !error.contains("DEWP"), "{error}");
}

/// Returns three rows per minute, whose times an export cut to the minute. The first minute lacks a row.
fn without_seconds() -> String {
    let mut text = String::from("date,flow,level\n");
    for row in 1..ROWS {
        let hour = row / 180;
        let minute = row / 3 % 60;
        writeln!(
            text,
            "2017-03-10 {hour:02}:{minute:02},{:.3},{:.3}",
            wave(row, 9.0, 10.0, 20.0),
            wave(row, 50.0, 0.0, 1.0)
        )
        .expect("memory");
    }
    text
}

#[test]
fn rows_whose_seconds_were_lost_are_spread() {
    let folder = Folder::of_text("plant.csv", &without_seconds());
    let mut data = folder.data();
    let expected = "About 3 rows share each time, and times are 60 s apart. If the export cut the times, data.contradictions = \"spread\" puts these rows 20 s apart \
                    (on the command line, --set data.contradictions=spread)";
    assert_refused(&data, &[expected]);
    let told = sketch(&data, &Silent).expect_err("refused").to_string();
    assert!(told.contains(expected), "{told}");
    data.contradictions = Contradictions::Spread;
    let found = profile(&data);
    assert_eq!((found.rows, found.duplicates.identical), (u64::from(ROWS) - 1, 0));
    assert_eq!((found.period_secs, found.contradictions.count), (20.0, 0));
    assert_eq!(
        [found.start, found.end].map(format_time),
        ["2017-03-10 00:00:00", "2017-03-10 01:39:40"]
    );
    assert_eq!(found.read_as, ["rows that share a time (about 3 of each) are put 20 s apart"]);
    let read = sketch(&data, &Silent).expect("a log");
    assert_eq!(read.read_as, found.read_as);

    // Times that repeat irregularly are still rejected.
    let twice = "date,flow\n2017-03-10 00:00,1\n2017-03-10 00:01,2\n2017-03-10 00:01,3\n2017-03-10 00:02,4\n";
    folder.write_file("plant.csv", twice);
    assert_refused(&data, &["contradict each other in 1 values"]);
}

/// Returns trends from a spreadsheet, each with its times beside it: P is recorded five hours after Q.
fn pairs(header: &str) -> String {
    let mut text = format!("{header}\n");
    for minute in 0..30 {
        writeln!(
            text,
            "2024-03-11 00:{minute:02}:00,{:.2},2024-03-11 05:{minute:02}:00,{:.2}",
            wave(minute, 9.0, 110.0, 130.0),
            wave(minute, 7.0, 400.0, 440.0)
        )
        .expect("memory");
    }
    text
}

#[test]
fn pairs_of_times_and_values_are_refused_with_what_to_do() {
    for (header, first, next) in [
        ("Time Q,Q,Time P,P", "Time Q", "Time P"),
        ("Time,Q,Time P,P", "Time", "Time P"),
        ("Zeit,Q,Zeit P,P", "Zeit", "Zeit P"),
    ] {
        let folder = Folder::of_text("trends.csv", &pairs(header));
        let parts = [
            format!("times in {first:?} and, after a column of values, times again in {next:?}"),
            "Write a file for each pair of columns".to_owned(),
        ];
        let parts: Vec<&str> = parts.iter().map(String::as_str).collect();
        let data = folder.data();
        assert_refused(&data, &parts);
        // If the user follows the advice to name one of them, the other still causes an error.
        let named = DataConfig { timestamp: first.to_owned(), ..data };
        assert_refused(&named, &parts);
        let excluded = DataConfig { exclude: vec![next.to_owned()], ..named };
        let found = profile(&excluded);
        assert_eq!(kept(&found), ["Q", "P"]);
    }
    // A time at the end of a row does not belong to a pair.
    let mut text = String::new();
    for line in pairs("Time,Q,Stored,P").lines() {
        let cells: Vec<&str> = line.split(',').collect();
        writeln!(text, "{},{},{},{}", cells[0], cells[1], cells[3], cells[2]).expect("memory");
    }
    let found = Folder::of_text("a.csv", &text).inspect();
    assert_eq!(kept(&found), ["Q", "P"]);
}

/// A long table of a room in which two devices measure the same, ten times each.
#[test]
fn tags_of_several_devices_are_told() {
    let mut text = String::from("source,timestamp,property,value,unit\n");
    let mut sources = Vec::new();
    for row in 0..20_i64 {
        let source = if row < 10 { "bms" } else { "meter" };
        for (property, unit) in [("co2", "ppm"), ("temp", "C")] {
            let value = 400 + row;
            writeln!(text, "{source},2022-10-18 13:{row:02}:00,{property},{value},{unit}")
                .expect("memory");
            sources.push((row, source.to_owned(), property.to_owned()));
        }
    }
    let folder = Folder::of_text("room.csv", &text);
    let mut data = folder.data();
    data.tag = Some("property".to_owned());
    let told = "co2, temp have samples of several \"source\", such as bms and meter: if these are different devices, choose one with \
                data.where = { \"source\" = \"bms\" }";
    assert_eq!(profile(&data).read_as, [told]);
    assert_eq!(sketch(&data, &Silent).expect("a log").read_as, [told]);
    data.only.insert("source".to_owned(), "bms".to_owned());
    let one = profile(&data);
    assert_eq!((one.rows, one.read_as.len()), (10, 0));

    // The same as Parquet, where rows are chosen after reading.
    let table = Table::new()
        .with("timestamp", seconds(sources.iter().map(|(row, ..)| 60 * row)))
        .with("source", sources.iter().map(|(_, source, _)| source.clone()).collect::<Vec<_>>())
        .with("property", sources.iter().map(|(_, _, tag)| tag.clone()).collect::<Vec<_>>())
        .with("value", sources.iter().map(|(row, ..)| *row).collect::<Vec<i64>>());
    let folder = Folder::of("room.parquet", &table);
    let mut data = folder.data();
    data.tag = Some("property".to_owned());
    assert_eq!(profile(&data).read_as, [told]);
    data.only.insert("source".to_owned(), "meter".to_owned());
    assert_eq!(profile(&data).read_as, Vec::<String>::new());
}
