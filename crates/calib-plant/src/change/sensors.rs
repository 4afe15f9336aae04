use super::{Changes, Dated, Sensor, Timeline};
use crate::{
    fluctuation::Follower,
    signal::{Frame, Signal},
};

/// The sensors that change, which show other values than the true ones.
#[derive(Clone, Debug)]
pub(crate) struct Sensors {
    lines: Vec<Line>,
    period_secs: f64,
}

/// One sensor with its changes over time.
#[derive(Clone, Debug)]
struct Line {
    signal: Signal,
    timeline: Timeline<Sensor>,
    /// The time of the latest change, and the filter of the shown value. `None` while the sensor shows the true
    /// value.
    now: Option<(f64, Follower)>,
}

impl Sensors {
    pub(crate) fn new(changes: &Changes, period_secs: f64) -> Self {
        Self {
            lines: changes
                .sensors
                .iter()
                .map(|(info, timeline)| Line {
                    signal: info.signal,
                    timeline: timeline.clone(),
                    now: None,
                })
                .collect(),
            period_secs,
        }
    }

    /// Replaces true values by those shown `t` seconds after the start. Calls are one period apart.
    pub(crate) fn read(&mut self, t: f64, frame: &mut Frame) {
        for line in &mut self.lines {
            let Some(Dated { at, value: sensor }) = line.timeline.at(t) else { continue };
            let shown = sensor.gain * frame[line.signal] + sensor.offset;
            // A newly fitted sensor shows its full reading at once: it has settled while it was fitted.
            let fitted = || Follower::new(shown, sensor.time_constant_secs, self.period_secs);
            let (since, follower) = line.now.get_or_insert_with(|| (at, fitted()));
            if *since < at {
                (*since, *follower) = (at, fitted());
            }
            frame[line.signal] = follower.step(shown);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::signal::SIGNALS;

    #[test]
    fn a_sensor_shows_the_truth_until_it_is_changed_and_follows_it_then() {
        let sensor = Sensor { offset: 2.0, gain: 1.5, time_constant_secs: 10.0, noise: 1.0 };
        let events = vec![Dated { at: 5.0, value: sensor }];
        let sensors = vec![(&SIGNALS[Signal::Temperature as usize], Timeline::new(events))];
        let changes = Changes { sensors, ..Changes::default() };
        let mut sensors = Sensors::new(&changes, 1.0);
        let mut shown = |t: f64, truth: f64| {
            let mut frame = Frame::zero();
            frame[Signal::Temperature] = truth;
            sensors.read(t, &mut frame);
            assert!(frame[Signal::Pressure] == 0.0, "other sensors are as they were");
            frame[Signal::Temperature]
        };
        assert_eq!([shown(0.0, 4.0), shown(4.0, 4.0)], [4.0, 4.0]);
        assert_eq!([shown(5.0, 4.0), shown(6.0, 4.0)], [8.0, 8.0]);
        // A step of 2 in the true value is a step of 3 here, of which 1 − exp(−1/10) is seen after a second.
        assert!((shown(7.0, 6.0) - (8.0 + 3.0 * (1.0 - (-0.1_f64).exp()))).abs() < 1e-12);
    }
}
