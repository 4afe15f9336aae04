//! Channels that are angles. Each one is read as two channels: its sine and its cosine.
//!
//! The step from 359° to 1° is small, and their mean is 0° and not 180°. So a channel in `data.angles` is read as a
//! point on the unit circle, before any value is averaged, interpolated, filled or compared. The mean of several
//! directions is the direction of the mean of these points (Mardia and Jupp, *Directional Statistics*, 2000, section
//! 2.2).

use std::f64::consts::TAU;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Description;

/// Directions that differ by less than this share of a turn are equal: they differ only by rounding. Our choice, as for
/// [`is_same`](crate::is_same).
const NOISE: f64 = 1e-12;
/// An angle that covers a smaller share of a turn, or more turns, probably has its turn in another unit: a turn of 360
/// is 57 times one of 2π. Our choice.
const COVERED: [f64; 2] = [0.02, 50.0];

/// The sine or the cosine channel of an angle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum AnglePart {
    /// `NAME_sin`.
    Sine,
    /// `NAME_cos`.
    Cosine,
}

impl AnglePart {
    /// Both parts.
    pub const ALL: [Self; 2] = [Self::Sine, Self::Cosine];

    /// Returns the name of the channel that holds this part of the angle `channel`.
    pub fn channel_of(self, channel: &str) -> String {
        match self {
            Self::Sine => format!("{channel}_sin"),
            Self::Cosine => format!("{channel}_cos"),
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Sine => "sine",
            Self::Cosine => "cosine",
        }
    }
}

/// The recorded angle whose sine or cosine a channel is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct AngleOf {
    /// Name of the angle's channel in the files.
    pub channel: String,
    /// A full turn, in the unit of the angle.
    pub turn: f64,
    /// Whether the channel is the sine or the cosine.
    pub part: AnglePart,
    /// The smallest and the largest recorded angle, in its unit. Default: none was recorded, or the range was not
    /// computed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recorded: Option<[f64; 2]>,
}

impl AngleOf {
    /// Replaces each angle by its sine or cosine; NaN stays.
    pub(crate) fn replace(&self, angles: &mut [f64]) {
        for angle in angles {
            let [sine, cosine] = sine_and_cosine(*angle, self.turn);
            *angle = match self.part {
                AnglePart::Sine => sine,
                AnglePart::Cosine => cosine,
            };
        }
    }

    /// Whether two angles are the same direction up to rounding.
    pub(crate) fn is_same(&self, one: f64, other: f64) -> bool {
        let apart = (one - other).rem_euclid(self.turn);
        let largest = one.abs().max(other.abs()).max(self.turn);
        apart.min(self.turn - apart) <= NOISE * largest
    }

    /// Returns the description of the sine or cosine, derived from that of the angle. It has no unit.
    #[must_use]
    pub fn described(&self, angle: &Description) -> Description {
        let part = self.part.name();
        Description {
            unit: None,
            label: angle.label.as_ref().map(|label| format!("{part} of {label}")),
        }
    }

    /// Describes the channel in words.
    pub fn told(&self) -> String {
        let Self { channel, turn, part, recorded } = self;
        let recorded = recorded
            .map_or_else(String::new, |[low, high]| format!("recorded from {low} to {high}, "));
        format!("{} of {channel} ({recorded}a turn is {turn})", part.name())
    }

    /// Returns the warning for an angle whose turn is probably in another unit.
    pub fn doubt(&self) -> Option<String> {
        let Self { channel, turn, .. } = self;
        let [low, high] = self.recorded.filter(|[low, high]| low < high)?;
        let turns = (high - low) / turn;
        let [least, most] = COVERED;
        (turns < least || turns > most).then(|| {
            format!(
                "{channel} runs from {low} to {high}, which is {turns:.3} turns of {turn}: give data.angles a full turn in the unit of the channel, \
                 360 for degrees and {TAU} for radians"
            )
        })
    }
}

/// Returns a hint for users who name the angle `name` instead of one of its two channels; `None` if it is not the angle
/// of any of `channels`.
pub fn angle_hint<'a>(
    name: &str,
    mut channels: impl Iterator<Item = &'a AngleOf>,
) -> Option<String> {
    channels.find(|angle| angle.channel == name)?;
    let [sine, cosine] = AnglePart::ALL.map(|part| part.channel_of(name));
    Some(format!("; data.angles makes {sine} and {cosine} of it: name one of these"))
}

/// Returns the sine and the cosine of an angle in units of which `turn` make a full turn. Quarters of a turn give
/// exactly 0, 1 and −1. Angles that are whole turns apart give equal values.
fn sine_and_cosine(angle: f64, turn: f64) -> [f64; 2] {
    let turns = angle.rem_euclid(turn) / turn;
    let quarters = (4.0 * turns).round();
    let (sine, cosine) = (TAU * (turns - quarters / 4.0)).sin_cos();
    let both = match quarters as u8 % 4 {
        0 => [sine, cosine],
        1 => [cosine, -sine],
        2 => [-sine, -cosine],
        _ => [-cosine, sine],
    };
    // Turns −0 into 0.
    both.map(|value| value + 0.0)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn degrees(part: AnglePart) -> AngleOf {
        AngleOf { channel: "wind".to_owned(), turn: 360.0, part, recorded: None }
    }

    fn replaced(part: AnglePart, angles: &[f64]) -> Vec<f64> {
        let mut values = angles.to_vec();
        degrees(part).replace(&mut values);
        values
    }

    /// Returns the direction of the mean of some directions, in degrees from 0 to 360.
    fn mean_direction(angles: &[f64]) -> f64 {
        let [sine, cosine] = AnglePart::ALL
            .map(|part| replaced(part, angles).iter().sum::<f64>() / angles.len() as f64);
        sine.atan2(cosine).to_degrees().rem_euclid(360.0)
    }

    #[test]
    fn quarters_of_a_turn_are_exact() {
        let quarters = [0.0, 90.0, 180.0, 270.0, 360.0, -90.0, 450.0, -720.0];
        let sines = replaced(AnglePart::Sine, &quarters);
        assert_eq!(sines, [0.0, 1.0, 0.0, -1.0, 0.0, -1.0, 1.0, 0.0]);
        let cosines = replaced(AnglePart::Cosine, &quarters);
        assert_eq!(cosines, [1.0, 0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
        assert!(sines.iter().chain(&cosines).all(|value| value.to_bits() != (-0.0_f64).to_bits()));
        assert!(replaced(AnglePart::Sine, &[f64::NAN])[0].is_nan());
    }

    #[test]
    fn directions_are_the_same_whole_turns_apart() {
        let wind = degrees(AnglePart::Sine);
        for (one, other) in [(0.0, 360.0), (-90.0, 270.0), (370.0, 10.0), (0.1 + 0.2, 360.3)] {
            assert!(wind.is_same(one, other) && wind.is_same(other, one), "{one} and {other}");
        }
        assert!(!wind.is_same(0.0, 180.0) && !wind.is_same(359.9, 0.0));
        let shaft = AngleOf { turn: TAU, ..wind };
        assert!(shaft.is_same(0.0, TAU) && !shaft.is_same(0.0, 6.2));
    }

    fn recorded_angle(turn: f64, recorded: [f64; 2]) -> AngleOf {
        AngleOf { turn, recorded: Some(recorded), ..degrees(AnglePart::Sine) }
    }

    #[test]
    fn a_turn_of_another_unit_is_doubted() {
        let doubt = recorded_angle(360.0, [0.0, 6.25]).doubt().expect("radians");
        assert!(
            doubt.starts_with("wind runs from 0 to 6.25, which is 0.017 turns of 360"),
            "{doubt}"
        );
        assert!(recorded_angle(TAU, [-180.0, 180.0]).doubt().is_some());
        for recorded in [[0.0, 359.0], [-180.0, 180.0], [80.0, 95.0], [0.0, 7_200.0], [5.0, 5.0]] {
            assert_eq!(recorded_angle(360.0, recorded).doubt(), None, "{recorded:?}");
        }
    }

    proptest! {
        #[test]
        fn a_point_of_the_circle_has_the_direction_and_no_other(
            angle in -1e4_f64..1e4,
            turn in prop_oneof![Just(360.0), Just(TAU), Just(24.0), 0.5_f64..1e3],
        ) {
            let [sine, cosine] = sine_and_cosine(angle, turn);
            prop_assert!((sine.hypot(cosine) - 1.0).abs() < 1e-14);
            prop_assert!(sine.abs() <= 1.0 && cosine.abs() <= 1.0);
            let back = sine.atan2(cosine) / TAU * turn;
            let apart = (back - angle).rem_euclid(turn);
            prop_assert!(apart.min(turn - apart) <= 1e-9 * turn, "{} and {}", back, angle);
        }

        #[test]
        fn means_turn_with_their_directions(
            angles in prop::collection::vec(-60.0_f64..60.0, 1..20),
            by in -1_000.0_f64..1_000.0,
        ) {
            // The directions lie within half a turn of each other, so that their mean is defined.
            let turned: Vec<f64> = angles.iter().map(|angle| angle + by).collect();
            let apart = (mean_direction(&turned) - by - mean_direction(&angles)).rem_euclid(360.0);
            prop_assert!(apart.min(360.0 - apart) < 1e-6, "{}", apart);
        }
    }
}
