use std::{collections::BTreeMap, ops::Range, path::Path, sync::Arc};

use calib_core::TransitionIndex;
use calib_files::{FileError, map_npy, write_npy};

use crate::{Blocks, KnnError, LeftOut, NeighborTable, bits::Bits};

/// Writes `table` as `neighbors.npy` (`u32 [t, k]`) and `distances.npy` (`f32 [t, k]`) in `directory`.
///
/// # Errors
/// If a file cannot be written.
pub fn write_table(directory: &Path, table: &NeighborTable) -> Result<(), FileError> {
    let rows = table.len();
    let k = table.k();
    write_npy(&directory.join("neighbors.npy"), table.neighbors(), rows, k)?;
    write_npy(&directory.join("distances.npy"), table.distances(), rows, k)
}

/// Maps the table of member `member` from `directory` and checks every value.
///
/// After this, no value of the table can lead outside the member. Rows of the member contain transitions of the member at finite
/// distances in ascending order. All other rows contain the filler.
///
/// # Errors
/// If a file cannot be read, has another shape, or contains a value that the model cannot have.
pub fn open_table(
    directory: &Path,
    blocks: &Blocks,
    member: usize,
) -> Result<NeighborTable, KnnError> {
    let neighbors = map_npy::<u32>(&directory.join("neighbors.npy"))?;
    let distances = map_npy::<f32>(&directory.join("distances.npy"))?;
    let rows = neighbors.rows();
    let k = neighbors.columns();
    if rows != blocks.transitions() || k == 0 {
        return Err(damaged(
            member,
            format!(
                "neighbors.npy has shape ({rows}, {k}), expected ({}, k) with k of at least 1",
                blocks.transitions()
            ),
        ));
    }
    if (distances.rows(), distances.columns()) != (rows, k) {
        return Err(damaged(
            member,
            format!(
                "distances.npy has shape ({}, {}), expected ({rows}, {k}) as neighbors.npy",
                distances.rows(),
                distances.columns()
            ),
        ));
    }
    let pairs = neighbors.as_slice().chunks_exact(k).zip(distances.as_slice().chunks_exact(k));
    for (row, (neighbors, distances)) in pairs.enumerate() {
        check_row(blocks, member, row, neighbors, distances)
            .map_err(|reason| damaged(member, reason))?;
    }
    Ok(NeighborTable::from_shared(Arc::new(neighbors), Arc::new(distances), k))
}

/// Marks an exclusion for every row of the table, in the first column of `left_out.npy`.
const EVERY_ROW: u32 = u32::MAX;

/// Writes the exclusions of a member as `left_out.npy` (`u32 [n, 3]`) in `directory`. The columns are the row of the table
/// (`u32::MAX` for every row), the first transition that the row must not contain, and one past the last. Entries are in row order;
/// those for every row come last.
///
/// # Errors
/// If the file cannot be written.
pub(crate) fn write_left_out(directory: &Path, left_out: &LeftOut) -> Result<(), FileError> {
    let exits =
        left_out.exits().flat_map(|(row, runs)| runs.iter().map(move |run| (row, run.clone())));
    let all = exits.chain(left_out.runs().map(|run| (EVERY_ROW, run)));
    let cells: Vec<u32> = all.flat_map(|(row, run)| [row, run.start, run.end]).collect();
    write_npy(&directory.join("left_out.npy"), &cells, cells.len() / 3, 3)
}

/// Reads the exclusions of member `member` from `directory`, and checks that its table contains none of them.
///
/// # Errors
/// If the file cannot be read, has another shape, or does not fit the table.
pub(crate) fn open_left_out(
    directory: &Path,
    blocks: &Blocks,
    member: usize,
    table: &NeighborTable,
) -> Result<LeftOut, KnnError> {
    let file = map_npy::<u32>(&directory.join("left_out.npy"))?;
    if file.columns() != 3 {
        let rows = file.rows();
        let columns = file.columns();
        return Err(damaged(
            member,
            format!("left_out.npy has shape ({rows}, {columns}), expected (n, 3)"),
        ));
    }
    let mut for_all = Bits::new(blocks.transitions());
    let mut exits: BTreeMap<u32, Vec<Range<u32>>> = BTreeMap::new();
    for line in file.as_slice().chunks_exact(3) {
        let row = line[0];
        let run = line[1]..line[2];
        if run.is_empty() || run.end as usize > blocks.transitions() {
            return Err(damaged(
                member,
                format!("left_out.npy has the run {run:?} of transitions"),
            ));
        }
        if row == EVERY_ROW {
            for_all.extend(run);
        } else if blocks.contains(member, TransitionIndex(row)) {
            exits.entry(row).or_default().push(run);
        } else {
            return Err(damaged(
                member,
                format!("left_out.npy names row {row}, which is not in the member"),
            ));
        }
    }
    let left_out = LeftOut::new(for_all, exits);
    if !left_out.is_empty() {
        check_left_out(&left_out, table).map_err(|reason| damaged(member, reason))?;
    }
    Ok(left_out)
}

fn damaged(member: usize, reason: String) -> KnnError {
    KnnError::Table { member, reason }
}

/// Checks that no row of the table contains a transition that is left out.
fn check_left_out(left_out: &LeftOut, table: &NeighborTable) -> Result<(), String> {
    for (row, neighbors) in (0_u32..).zip(table.neighbors().chunks_exact(table.k())) {
        if let Some(bad) = neighbors.iter().find(|&&to| left_out.bars(row, to)) {
            return Err(format!("row {row} names transition {bad}, which is left out"));
        }
    }
    Ok(())
}

fn check_row(
    blocks: &Blocks,
    member: usize,
    row: usize,
    neighbors: &[u32],
    distances: &[f32],
) -> Result<(), String> {
    if !blocks.contains(member, TransitionIndex::new(row)) {
        let filler = neighbors.iter().all(|&j| j == u32::MAX)
            && distances.iter().all(|&distance| distance == f32::INFINITY);
        return if filler {
            Ok(())
        } else {
            Err(format!("row {row} is not in the member, expected {} and inf", u32::MAX))
        };
    }
    if let Some(&bad) = neighbors.iter().find(|&&j| !blocks.contains(member, TransitionIndex(j))) {
        return Err(format!("row {row} names transition {bad}, which is not in the member"));
    }
    let ascending = distances.windows(2).all(|pair| pair[0] <= pair[1]);
    if !ascending || !distances.iter().all(|distance| distance.is_finite() && *distance >= 0.0) {
        return Err(format!(
            "row {row} has distances {distances:?}, expected finite numbers from 0 in ascending order"
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use calib_core::{Segments, Silent, States, Transitions};

    use super::*;
    use crate::{Exclusion, IndexKind, build_tables};

    fn table() -> (Blocks, NeighborTable) {
        let states = States::new(
            (0..24_u8).map(|v| f32::from((u16::from(v) * u16::from(v) % 7) as u8)).collect(),
            12,
            2,
        )
        .expect("valid");
        let transitions = Transitions::new(Segments::from_lengths([7, 5]).expect("valid"));
        let blocks = Blocks::new(&transitions, 3).expect("valid");
        let tables = build_tables(
            &states,
            &transitions,
            &blocks,
            2,
            Exclusion::default(),
            IndexKind::Auto,
            &Silent,
        )
        .expect("built");
        (blocks, tables[1].clone())
    }

    #[test]
    fn a_table_comes_back() {
        let directory = tempfile::tempdir().expect("a directory");
        let (blocks, table) = table();
        write_table(directory.path(), &table).expect("written");
        let opened = open_table(directory.path(), &blocks, 1).expect("valid");
        assert_eq!(opened.neighbors(), table.neighbors());
        assert_eq!(opened.distances(), table.distances());
        assert_eq!((opened.len(), opened.k()), (10, 2));
        let other = open_table(directory.path(), &blocks, 0).expect_err("another member");
        assert!(other.to_string().contains("member 0 is damaged"), "{other}");
    }

    /// Returns a table of two neighbours per row with one neighbour changed.
    fn with_neighbor(table: &NeighborTable, cell: usize, value: u32) -> NeighborTable {
        let mut neighbors = table.neighbors().to_vec();
        neighbors[cell] = value;
        let distances = table.distances().to_vec();
        NeighborTable::from_shared(Arc::new(neighbors), Arc::new(distances), 2)
    }

    /// Returns a table of two neighbours per row with one distance changed.
    fn with_distance(table: &NeighborTable, cell: usize, value: f32) -> NeighborTable {
        let mut distances = table.distances().to_vec();
        distances[cell] = value;
        let neighbors = table.neighbors().to_vec();
        NeighborTable::from_shared(Arc::new(neighbors), Arc::new(distances), 2)
    }

    #[test]
    fn damage_is_found_on_opening() {
        let (blocks, table) = table();
        let inside = 2
            * (0..10).find(|&row| blocks.contains(1, TransitionIndex(row))).expect("some") as usize;
        let outside = 2 * blocks.own(1).start as usize;
        let damaged = [
            with_neighbor(&table, inside, 10),
            with_neighbor(&table, inside, u32::MAX),
            with_neighbor(&table, inside, blocks.own(1).start),
            with_neighbor(&table, outside, 0),
            with_distance(&table, outside, 0.5),
            with_distance(&table, inside, f32::NAN),
            with_distance(&table, inside, -1.0),
            with_distance(&table, inside + 1, f32::INFINITY),
            with_distance(&table, inside, 1e9),
        ];
        for table in damaged {
            let directory = tempfile::tempdir().expect("a directory");
            write_table(directory.path(), &table).expect("written");
            let error = open_table(directory.path(), &blocks, 1).expect_err("damaged");
            assert!(matches!(error, KnnError::Table { member: 1, .. }), "{error}");
        }
    }

    #[test]
    fn other_shapes_are_refused() {
        let directory = tempfile::tempdir().expect("a directory");
        let (blocks, table) = table();
        write_npy(&directory.path().join("neighbors.npy"), table.neighbors(), 5, 4)
            .expect("written");
        write_npy(&directory.path().join("distances.npy"), table.distances(), 10, 2)
            .expect("written");
        let error = open_table(directory.path(), &blocks, 1).expect_err("five rows");
        assert!(error.to_string().contains("shape (5, 4)"), "{error}");
        write_npy(&directory.path().join("neighbors.npy"), table.neighbors(), 10, 2)
            .expect("written");
        write_npy(&directory.path().join("distances.npy"), table.distances(), 20, 1)
            .expect("written");
        let error = open_table(directory.path(), &blocks, 1).expect_err("other shapes");
        assert!(error.to_string().contains("(20, 1)"), "{error}");
    }
}
