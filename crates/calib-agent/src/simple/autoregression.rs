use calib_core::Stream;

use super::{
    FittedPredictor,
    judged::Judged,
    moments::{Folds, Target, sum},
    solve::Square,
};

/// Numbers of lagged values that cross-validation chooses from.
const ORDERS: [usize; 10] = [1, 2, 3, 4, 6, 8, 12, 16, 24, 32];

/// Minimum number of rows per coefficient.
const ROWS_EACH: usize = 20;

/// Added to the diagonal, in units of its mean: successive values of a slow sensor are nearly the same.
const JITTER: f64 = 1e-9;

/// Fits a regression of `returns` on the latest values of a column, with the order that has the least squared error
/// over the folds. `None` if the column is constant.
pub(super) fn fit(
    stream: &dyn Stream,
    column: usize,
    returns: &[f64],
    folds: &Folds,
) -> Option<Judged> {
    let most = ORDERS[ORDERS.len() - 1];
    let size = most + 1;
    let mut starts = vec![0; stream.len()];
    for piece in stream.pieces() {
        starts[piece.clone()].fill(piece.start);
    }
    let values = folds.rows.iter().map(|&t| f64::from(stream.state(t)[column]));
    let center = values.sum::<f64>() / folds.rows.len() as f64;
    // The constant comes first, so that every order is a leading block of the same matrix.
    let write = |t: usize, to: &mut [f64]| {
        to[0] = 1.0;
        for lag in 0..most {
            let row = t.saturating_sub(lag).max(starts[t]);
            to[lag + 1] = f64::from(stream.state(row)[column]) - center;
        }
    };
    let second = folds.second_moments(size, write);
    let targets = folds.target_moments(size, write, |t| returns[t]);
    let solve = |parts: &[usize], order: usize| {
        let matrix = leading(&sum(&second, parts), order + 1);
        matrix.solve(&Target::sum(&targets, parts).products[..=order])
    };
    let padded = |parts: &[usize], order: usize| {
        let mut weights = solve(parts, order)?;
        weights.resize(size, 0.0);
        Some(weights)
    };
    let orders = ORDERS.into_iter().filter(|order| order * ROWS_EACH <= folds.rows.len());
    let errors = orders.filter_map(|order| {
        let errors = folds.cross_errors(&second, &targets, |parts| padded(parts, order))?;
        Some((order, errors.iter().sum::<f64>(), errors))
    });
    let (best, _, cross_errors) =
        errors.reduce(|best, other| if other.1 < best.1 { other } else { best })?;
    let weights = solve(&folds.all(), best)?;
    let lags = weights[1..].to_vec();
    let bias = weights[0] - center * lags.iter().sum::<f64>();
    let predictor = FittedPredictor::Autoregression { column, lags, bias };
    let squared_error = Folds::error_ahead(&second, &targets, |parts| padded(parts, best));
    Some(Judged { predictor, squared_error, cross_errors })
}

/// Returns the leading `size` rows and columns, with a small term added to the diagonal.
fn leading(matrix: &Square, size: usize) -> Square {
    let mut part = Square::zeros(size);
    for row in 0..size {
        part.row_mut(row).copy_from_slice(&matrix.row(row)[..size]);
    }
    let mean = (1..size).map(|row| part.row(row)[row]).sum::<f64>() / (size - 1).max(1) as f64;
    for row in 1..size {
        part.row_mut(row)[row] += JITTER * mean;
    }
    part
}
