use std::collections::HashSet;

use calib_data::{AnglePart, Sketch};

/// A channel whose values are angles.
#[derive(Clone, Debug, PartialEq)]
pub struct Angle {
    /// Name of the channel in the files.
    pub channel: String,
    /// A full turn in the unit of the channel: 360 or 2π.
    pub turn: f64,
}

impl Angle {
    /// Returns the angles among the channels of a log, in their order, without
    /// those whose sine or cosine is a column of the log.
    pub fn all(sketch: &Sketch) -> Vec<Self> {
        let names: HashSet<&str> =
            sketch.channels.iter().map(|channel| channel.name.as_str()).collect();
        let mut angles = Vec::new();
        for channel in &sketch.channels {
            let taken =
                AnglePart::ALL.map(|part| names.contains(part.channel_of(&channel.name).as_str()));
            if let Some(turn) = channel.wraps
                && taken == [false; 2]
            {
                angles.push(Self { channel: channel.name.clone(), turn });
            }
        }
        angles
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{sketch, wave};

    #[test]
    fn angles_without_columns_of_their_own_are_found() {
        let mut log = sketch(
            640,
            &[
                ("wind", wave(40.0)),
                ("T", wave(50.0)),
                ("yaw", wave(60.0)),
                ("yaw_cos", wave(60.0)),
            ],
        );
        log.channels[0].wraps = Some(360.0);
        log.channels[2].wraps = Some(360.0);
        assert_eq!(Angle::all(&log), [Angle { channel: "wind".to_owned(), turn: 360.0 }]);
    }
}
