//! The input: a series of samples, each with one or several channels.

use crate::{DtwError, Role};

/// A borrowed series: row-major `f64 [samples, channels]`.
///
/// Slices, arrays and vectors convert to one-channel series with `into()`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Series<'a> {
    values: &'a [f64],
    channels: usize,
}

impl<'a> Series<'a> {
    /// Creates a series of one channel.
    pub fn new(values: &'a [f64]) -> Self {
        Self { values, channels: 1 }
    }

    /// Creates a series of `channels` values per sample, sample after sample.
    ///
    /// # Errors
    /// If `channels` is 0 or does not divide the number of values.
    pub fn with_channels(values: &'a [f64], channels: usize) -> Result<Self, DtwError> {
        if channels == 0 || !values.len().is_multiple_of(channels) {
            let got = values.len();
            return Err(DtwError::Shape { got, channels });
        }
        Ok(Self { values, channels })
    }

    /// Returns the number of samples.
    pub fn len(&self) -> usize {
        self.values.len() / self.channels
    }

    /// Whether there are no samples.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// Returns the number of values per sample.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Returns the values, sample after sample.
    pub fn values(&self) -> &'a [f64] {
        self.values
    }

    /// Returns the values of one sample.
    pub fn sample(&self, index: usize) -> &'a [f64] {
        &self.values[index * self.channels..][..self.channels]
    }

    /// Checks the values and returns the largest magnitude.
    pub(crate) fn checked(&self, role: Role) -> Result<f64, DtwError> {
        if self.is_empty() {
            return Err(DtwError::Empty { role });
        }
        if let Some(at) = self.values.iter().position(|value| !value.is_finite()) {
            return Err(DtwError::NotFinite {
                role,
                index: at / self.channels,
                channel: at % self.channels,
                got: self.values[at],
            });
        }
        Ok(self.values.iter().fold(0.0, |max, v| f64::max(max, v.abs())))
    }
}

impl<'a> From<&'a [f64]> for Series<'a> {
    fn from(values: &'a [f64]) -> Self {
        Self::new(values)
    }
}

impl<'a> From<&'a Vec<f64>> for Series<'a> {
    fn from(values: &'a Vec<f64>) -> Self {
        Self::new(values)
    }
}

impl<'a, const N: usize> From<&'a [f64; N]> for Series<'a> {
    fn from(values: &'a [f64; N]) -> Self {
        Self::new(values)
    }
}
