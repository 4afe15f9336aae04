use std::{cell::OnceCell, ops::Range};

use calib_core::Stream;

use super::{
    FittedPredictor, Mixture, SimplePredictor, autoregression,
    judged::Judged,
    moments::{Folds, Target, sum},
    solve::Square,
};
use crate::{discounted_returns, scoring::known_returns, truncation_horizon};

/// Penalties that cross-validation chooses from, relative to the number of rows. Features are standardised. The largest
/// leaves only the unpenalised terms.
const PENALTIES: [f64; 10] = [1e6, 1e2, 10.0, 1.0, 0.1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6];

/// With fewer rows than this, only the mean is fitted.
const FEW_ROWS: usize = 20;

/// Maximum number of products in the sums of a fit. In longer logs, only every n-th step counts.
const MOST_PRODUCTS: usize = 2_000_000_000;

/// Fits simple predictors of any column on the same rows: those with known returns, which require a horizon of
/// following states without a gap. Excluded states are a gap.
pub struct Fitter<'a> {
    stream: Remaining<'a>,
    gamma: f64,
    folds: Folds,
    features: Features,
    second: OnceCell<Vec<Square>>,
    ahead: OnceCell<Vec<Square>>,
}

/// This share of the best predictor's mean squared error over folds is added to the error of each fold before their
/// logarithms are compared. Our choice.
const RESTING: f64 = 0.01;

/// The systems of equations that cross-validation solves.
enum Equations<'m> {
    /// Least squares: the second moments of the features are the matrix.
    Ridge,
    /// Least-squares TD, with Σ x x'ᵀ.
    Td(&'m [Square]),
}

impl<'a> Fitter<'a> {
    /// Returns a fitter on the states of `stream`, without those in the ranges `excluded`.
    ///
    /// # Panics
    /// If `gamma` is not in [0, 1).
    pub fn new(stream: &'a dyn Stream, gamma: f64, excluded: &[Range<usize>]) -> Self {
        let horizon = truncation_horizon(gamma).max(1);
        let stream = Remaining::new(stream, excluded);
        let known = stream.pieces().iter().flat_map(|piece| known_returns(piece, gamma));
        let mut rows: Vec<usize> = known.collect();
        let size = stream.width() + 1;
        let most = (MOST_PRODUCTS / (size * size)).max(20 * size);
        let stride = rows.len().div_ceil(most).max(1);
        rows = rows.into_iter().step_by(stride).collect();
        let features = Features::new(&stream, &rows);
        let folds = Folds::new(rows, horizon);
        Self { stream, gamma, folds, features, second: OnceCell::new(), ahead: OnceCell::new() }
    }

    /// Returns the number of steps that predictors are fitted on.
    pub fn rows(&self) -> usize {
        self.folds.rows.len()
    }

    /// Fits a predictor of the return of `column`. With too few rows it predicts their mean, and without any rows 0.
    pub fn fit(&self, predictor: SimplePredictor, column: usize) -> FittedPredictor {
        let width = self.stream.width();
        if predictor == SimplePredictor::Persistence {
            return self.persistence(column);
        }
        let returns = discounted_returns(&self.stream, column, self.gamma);
        let rows = &self.folds.rows;
        let mean = rows.iter().map(|&t| returns[t]).sum::<f64>() / rows.len().max(1) as f64;
        let constant = FittedPredictor::Affine { weights: vec![0.0; width], bias: mean };
        if rows.len() < FEW_ROWS {
            return constant;
        }
        let fitted = match predictor {
            SimplePredictor::Best => return self.best(column, &returns, constant),
            SimplePredictor::Mixture => return self.mixture(column, &returns, constant),
            predictor => self.judged(predictor, column, &returns),
        };
        fitted.map_or(constant, |fitted| fitted.predictor)
    }

    /// Fits [`SimplePredictor::Best`], or returns the constant if no predictor can be validated.
    fn best(&self, column: usize, returns: &[f64], constant: FittedPredictor) -> FittedPredictor {
        self.best_judged(column, returns).map_or(constant, |(_, judged)| judged.predictor)
    }

    /// Returns the best predictor for a column, or `None` if there are too few rows to tell.
    pub fn best_of(&self, column: usize) -> Option<SimplePredictor> {
        if self.folds.rows.len() < FEW_ROWS {
            return None;
        }
        let returns = discounted_returns(&self.stream, column, self.gamma);
        self.best_judged(column, &returns).map(|(best, _)| best)
    }

    /// Returns the simplest predictor within a hundredth of the least cross-validated error.
    ///
    /// The error is a geometric mean over the folds, so that one fold in which all predictors err a lot does not decide
    /// alone. Later folds alone would give weight to the fits on the first days of a log. If the plant was then run
    /// differently, persistence would seem best, because it is not fitted.
    fn best_judged(&self, column: usize, returns: &[f64]) -> Option<(SimplePredictor, Judged)> {
        let judged: Vec<(SimplePredictor, Judged)> = SimplePredictor::ALL
            .into_iter()
            .filter_map(|predictor| Some((predictor, self.judged(predictor, column, returns)?)))
            .collect();
        let least = judged.iter().map(|(_, judged)| judged.mean_cross_error());
        let least = least.fold(f64::INFINITY, f64::min);
        // A fold in which the sensor is constant must not decide either.
        let rest = RESTING * least + f64::MIN_POSITIVE;
        let least = judged.iter().map(|(_, judged)| judged.typical_cross_error(rest));
        let least = least.fold(f64::INFINITY, f64::min);
        // A hundredth of the root mean squared error.
        let limit = 1.01 * 1.01 * least;
        judged.into_iter().find(|(_, judged)| judged.typical_cross_error(rest) <= limit)
    }

    /// Returns all predictors that can be validated on later folds, the simplest first.
    fn all_judged(&self, column: usize, returns: &[f64]) -> Vec<Judged> {
        SimplePredictor::ALL
            .into_iter()
            .filter_map(|predictor| self.judged(predictor, column, returns))
            .filter(|judged| judged.squared_error.is_finite())
            .collect()
    }

    /// Returns a mixture of all predictors.
    fn mixture(
        &self,
        column: usize,
        returns: &[f64],
        constant: FittedPredictor,
    ) -> FittedPredictor {
        let count = self.folds.rows_ahead().count() as f64;
        let judged = self.all_judged(column, returns);
        if judged.is_empty() || count == 0.0 {
            return constant;
        }
        let (predictors, errors) = judged
            .into_iter()
            .map(|judged| (judged.predictor, judged.squared_error / count))
            .unzip();
        let mut range = [f64::INFINITY, f64::NEG_INFINITY];
        for piece in self.stream.pieces() {
            for t in piece.clone() {
                let value = f64::from(self.stream.state(t)[column]);
                range = [range[0].min(value), range[1].max(value)];
            }
        }
        FittedPredictor::Mixture(Mixture { column, range, gamma: self.gamma, predictors, errors })
    }

    /// Returns a predictor and its error on later folds when fitted on earlier ones, or `None` if the column does not
    /// allow it.
    fn judged(&self, predictor: SimplePredictor, column: usize, returns: &[f64]) -> Option<Judged> {
        match predictor {
            SimplePredictor::Mean => self.line(None, returns),
            SimplePredictor::Persistence => {
                let error = |t: usize| {
                    returns[t] - f64::from(self.stream.state(t)[column]) / (1.0 - self.gamma)
                };
                let squared_error = self.folds.rows_ahead().map(|t| error(t).powi(2)).sum();
                let cross_errors = self.folds.errors_across(error);
                Some(Judged { predictor: self.persistence(column), squared_error, cross_errors })
            }
            SimplePredictor::Line => self.line(Some(column), returns),
            SimplePredictor::Autoregression => {
                autoregression::fit(&self.stream, column, returns, &self.folds)
            }
            SimplePredictor::Ridge => self.linear(column, returns, &Equations::Ridge),
            SimplePredictor::LeastSquaresTd => {
                self.linear(column, returns, &Equations::Td(self.ahead()))
            }
            SimplePredictor::Best | SimplePredictor::Mixture => None,
        }
    }

    fn persistence(&self, column: usize) -> FittedPredictor {
        let mut weights = vec![0.0; self.stream.width()];
        weights[column] = 1.0 / (1.0 - self.gamma);
        FittedPredictor::Affine { weights, bias: 0.0 }
    }

    /// Fits least squares on a constant, and on one column if given.
    fn line(&self, column: Option<usize>, returns: &[f64]) -> Option<Judged> {
        let width = self.stream.width();
        let size = 1 + usize::from(column.is_some());
        if column.is_some_and(|column| self.features.scales[column] == 0.0) {
            return None;
        }
        let write = |t: usize, to: &mut [f64]| {
            to[0] = 1.0;
            if let Some(column) = column {
                let value = f64::from(self.stream.state(t)[column]);
                to[1] = (value - self.features.means[column]) * self.features.scales[column];
            }
        };
        let second = self.folds.second_moments(size, write);
        let targets = self.folds.target_moments(size, write, |t| returns[t]);
        let solve =
            |parts: &[usize]| sum(&second, parts).solve(&Target::sum(&targets, parts).products);
        let solved = solve(&self.folds.all())?;
        let mut weights = vec![0.0; width + 1];
        weights[width] = solved[0];
        if let Some(column) = column {
            weights[column] = solved[1];
        }
        let squared_error = Folds::error_ahead(&second, &targets, solve);
        let cross_errors = self.folds.cross_errors(&second, &targets, solve)?;
        let predictor = self.features.affine(&weights);
        Some(Judged { predictor, squared_error, cross_errors })
    }

    /// Fits the linear predictor on all columns with the penalty that has the least squared error over the folds.
    fn linear(&self, column: usize, returns: &[f64], equations: &Equations<'_>) -> Option<Judged> {
        let size = self.stream.width() + 1;
        let second = self.second();
        let write = |t: usize, to: &mut [f64]| self.features.write(self.stream.state(t), to);
        let targets = self.folds.target_moments(size, write, |t| returns[t]);
        let rewards = match equations {
            Equations::Ridge => None,
            Equations::Td(_) => Some(
                self.folds
                    .target_moments(size, write, |t| f64::from(self.stream.state(t + 1)[column])),
            ),
        };
        let solve = |parts: &[usize], penalty: f64| {
            let mut matrix = sum(second, parts);
            let right = match equations {
                Equations::Ridge => Target::sum(&targets, parts),
                Equations::Td(ahead) => {
                    matrix.add(-self.gamma, &sum(ahead, parts));
                    Target::sum(rewards.as_ref()?, parts)
                }
            };
            let penalty = penalty * self.folds.count(parts) as f64;
            for feature in 0..size - 1 {
                let value = &mut matrix.row_mut(feature)[feature];
                if self.features.scales[feature] == 0.0 {
                    // A constant column has no equation: its weight is 0.
                    *value = 1.0;
                } else if feature != column {
                    *value += penalty;
                }
            }
            matrix.solve(&right.products)
        };
        let errors = PENALTIES.into_iter().filter_map(|penalty| {
            let errors = self
                .folds
                .cross_errors(second, &targets, |parts: &[usize]| solve(parts, penalty))?;
            Some((penalty, errors.iter().sum::<f64>(), errors))
        });
        // The largest of the penalties with equal errors.
        let (best, _, cross_errors) =
            errors.reduce(|best, other| if other.1 < best.1 { other } else { best })?;
        let predictor = self.features.affine(&solve(&self.folds.all(), best)?);
        let squared_error = Folds::error_ahead(second, &targets, |parts| solve(parts, best));
        Some(Judged { predictor, squared_error, cross_errors })
    }

    fn second(&self) -> &[Square] {
        self.second.get_or_init(|| {
            self.folds.second_moments(self.stream.width() + 1, |t: usize, to: &mut [f64]| {
                self.features.write(self.stream.state(t), to);
            })
        })
    }

    fn ahead(&self) -> &[Square] {
        self.ahead.get_or_init(|| {
            self.folds.cross_moments(self.stream.width() + 1, |t, now, next| {
                self.features.write(self.stream.state(t), now);
                self.features.write(self.stream.state(t + 1), next);
            })
        })
    }
}

/// Columns scaled to mean 0 and standard deviation 1 over the rows, followed by a column of ones.
struct Features {
    means: Vec<f64>,
    /// Scaling factor per column; 0 for a constant one.
    scales: Vec<f64>,
}

impl Features {
    fn new(stream: &dyn Stream, rows: &[usize]) -> Self {
        let width = stream.width();
        let count = rows.len().max(1) as f64;
        let mut means = vec![0.0; width];
        for &t in rows {
            for (mean, &value) in means.iter_mut().zip(stream.state(t)) {
                *mean += f64::from(value) / count;
            }
        }
        let mut squares = vec![0.0; width];
        for &t in rows {
            for ((square, mean), &value) in squares.iter_mut().zip(&means).zip(stream.state(t)) {
                *square += (f64::from(value) - mean).powi(2) / count;
            }
        }
        let scales = squares
            .iter()
            .zip(&means)
            .map(|(square, mean): (&f64, &f64)| {
                // Below this threshold a column is constant up to rounding.
                let moves = square.sqrt() > 1e-7 * mean.abs().max(1e-7);
                if moves { 1.0 / square.sqrt() } else { 0.0 }
            })
            .collect();
        Self { means, scales }
    }

    fn write(&self, state: &[f32], to: &mut [f64]) {
        for (((to, &value), mean), scale) in
            to.iter_mut().zip(state).zip(&self.means).zip(&self.scales)
        {
            *to = (f64::from(value) - mean) * scale;
        }
        to[state.len()] = 1.0;
    }

    /// Returns the predictor with these weights on the features.
    fn affine(&self, weights: &[f64]) -> FittedPredictor {
        let width = self.means.len();
        let scaled: Vec<f64> = weights[..width]
            .iter()
            .zip(&self.scales)
            .map(|(weight, scale)| weight * scale)
            .collect();
        let shift: f64 = scaled.iter().zip(&self.means).map(|(weight, mean)| weight * mean).sum();
        FittedPredictor::Affine { weights: scaled, bias: weights[width] - shift }
    }
}

/// A stream without some of its states. The removed states are gaps.
struct Remaining<'a> {
    stream: &'a dyn Stream,
    pieces: Vec<Range<usize>>,
}

impl<'a> Remaining<'a> {
    fn new(stream: &'a dyn Stream, excluded: &[Range<usize>]) -> Self {
        let mut pieces = stream.pieces().to_vec();
        for range in excluded {
            pieces = pieces
                .into_iter()
                .flat_map(|piece| {
                    let before = piece.start..piece.end.min(range.start);
                    let after = piece.start.max(range.end)..piece.end;
                    [before, after]
                })
                .filter(|piece| !piece.is_empty())
                .collect();
        }
        Self { stream, pieces }
    }
}

impl Stream for Remaining<'_> {
    fn len(&self) -> usize {
        self.stream.len()
    }

    fn width(&self) -> usize {
        self.stream.width()
    }

    fn state(&self, t: usize) -> &[f32] {
        self.stream.state(t)
    }

    fn pieces(&self) -> &[Range<usize>] {
        &self.pieces
    }
}
