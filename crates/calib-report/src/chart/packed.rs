//! Compact encoding of long series for the page's script.

use base64::{Engine as _, engine::general_purpose::STANDARD};
use serde_json::{Map, Value, json};

/// Every value of a trajectory. The page draws the visible part.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Detail<'a> {
    /// Distance between values, in the unit of the horizontal axis.
    pub(crate) step: f64,
    /// Values; the first is at position 0, and NaN stands for a missing value.
    pub(crate) values: &'a [f64],
}

/// Code for NaN. 65,534 is the code for the largest value.
const MISSING: u16 = u16::MAX;
const LARGEST: f64 = 65_534.0;
/// Series that extend over more than this many plot heights would lose their shape in 16 bits.
const FAR: f64 = 50.0;

impl Detail<'_> {
    /// Returns `step`, and `packed`: little-endian numbers in base 64. They are 16-bit steps between `from` and `to`.
    /// If a value is infinite, or values reach far beyond a plot of this `height`, they are 32-bit floats without
    /// `from` and `to`.
    pub(crate) fn fields(&self, height: f64) -> Map<String, Value> {
        let mut fields = Map::new();
        fields.insert("step".to_owned(), json!(self.step));
        let (low, high) = super::extent(self.values).unwrap_or((0.0, 0.0));
        let is_wild = self.values.iter().any(|value| value.is_infinite());
        let bytes: Vec<u8> = if is_wild || high - low > FAR * height.abs() {
            self.values.iter().flat_map(|&value| (value as f32).to_le_bytes()).collect()
        } else {
            fields.insert("from".to_owned(), json!(low));
            fields.insert("to".to_owned(), json!(high));
            let scale = if low < high { LARGEST / (high - low) } else { 0.0 };
            let steps = self.values.iter().map(|&value| {
                if value.is_nan() { MISSING } else { ((value - low) * scale).round() as u16 }
            });
            steps.flat_map(u16::to_le_bytes).collect()
        };
        fields.insert("packed".to_owned(), json!(STANDARD.encode(bytes)));
        fields
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(fields: &Map<String, Value>) -> Vec<u8> {
        STANDARD.decode(fields["packed"].as_str().unwrap()).unwrap()
    }

    #[test]
    fn a_spike_among_thirty_thousand_values_is_there_to_a_few_millionths_of_the_range() {
        let mut values: Vec<f64> = (0..30_000).map(|i| (f64::from(i) * 0.01).sin()).collect();
        values[7_777] = 5.0;
        values[7_778] = f64::NAN;
        let fields = Detail { step: 1.0, values: &values }.fields(7.0);
        let from = fields["from"].as_f64().unwrap();
        let to = fields["to"].as_f64().unwrap();
        let numbers: Vec<u16> = bytes(&fields)
            .chunks_exact(2)
            .map(|pair| u16::from_le_bytes(pair.try_into().unwrap()))
            .collect();
        assert_eq!((numbers.len(), numbers[7_777], numbers[7_778]), (30_000, 65_534, MISSING));
        assert!((0..7_777).all(|i: usize| {
            let back = from + f64::from(numbers[i]) * (to - from) / LARGEST;
            (back - values[i]).abs() < 1e-4
        }));
    }

    #[test]
    fn what_runs_away_keeps_its_shape_in_floats() {
        for values in [[1.0, f64::INFINITY], [1.0, 5e30]] {
            let fields = Detail { step: 1.0, values: &values }.fields(2.0);
            assert!(!fields.contains_key("from"));
            let second = f32::from_le_bytes(bytes(&fields)[4..].try_into().unwrap());
            assert!(second.is_infinite() || second == 5e30);
        }
    }

    #[test]
    fn constant_and_empty_series_are_packed_too() {
        assert_eq!(bytes(&Detail { step: 1.0, values: &[3.0, 3.0] }.fields(1.0)), [0; 4]);
        assert!(bytes(&Detail { step: 1.0, values: &[] }.fields(1.0)).is_empty());
    }
}
