use serde::{Deserialize, Serialize};

/// How a learning curve is sub-sampled. The run's steps are cut into `windows` windows of equal
/// length, with one point each: window w of a run of n steps holds the steps t with ⌊t · windows / n⌋
/// = w.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CurveRule {
    /// Number of windows. 0 draws no curve. Default 100.
    pub windows: usize,
}

impl Default for CurveRule {
    fn default() -> Self {
        Self { windows: 100 }
    }
}

/// One point of a learning curve.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CurvePoint {
    /// The step after the window's last.
    pub step: usize,
    /// RMSE over the steps of the window with known returns.
    #[serde(with = "crate::scoring::infinite")]
    pub rmse: f64,
}

/// Running sums of the present window, and the points so far.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Curve {
    windows: usize,
    steps: usize,
    window: usize,
    sum: f64,
    count: usize,
    points: Vec<CurvePoint>,
}

impl Curve {
    pub(crate) fn new(rule: CurveRule, steps: usize) -> Self {
        let windows = rule.windows.min(steps);
        Self { windows, steps, window: 0, sum: 0.0, count: 0, points: Vec::with_capacity(windows) }
    }

    /// Adds the squared error at step `t`. Steps come in order.
    pub(crate) fn add(&mut self, t: usize, squared_error: f64) {
        if self.windows == 0 {
            return;
        }
        let window = (t as u128 * self.windows as u128 / self.steps as u128) as usize;
        if window != self.window {
            self.close();
            self.window = window;
        }
        self.sum += squared_error;
        self.count += 1;
    }

    fn close(&mut self) {
        if self.count > 0 {
            let end = (self.window as u128 + 1) * self.steps as u128;
            self.points.push(CurvePoint {
                step: end.div_ceil(self.windows as u128) as usize,
                rmse: (self.sum / self.count as f64).sqrt(),
            });
        }
        (self.sum, self.count) = (0.0, 0);
    }

    /// Returns all points. Windows without a known return have no point.
    pub(crate) fn finish(mut self) -> Vec<CurvePoint> {
        self.close();
        self.points
    }

    /// Returns the points of the windows before the present one.
    pub(crate) fn abandon(self) -> Vec<CurvePoint> {
        self.points
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_are_equal_and_hold_their_steps() {
        let mut curve = Curve::new(CurveRule { windows: 3 }, 10);
        // The windows are 0..4, 4..7 and 7..10.
        for t in [0, 1, 2, 3, 8] {
            curve.add(t, (t * t) as f64);
        }
        let points = curve.finish();
        assert_eq!(points.len(), 2);
        assert_eq!(points[0].step, 4);
        assert!((points[0].rmse - (14.0_f64 / 4.0).sqrt()).abs() < 1e-12);
        assert_eq!(points[1], CurvePoint { step: 10, rmse: 8.0 });
    }

    #[test]
    fn short_runs_have_a_point_a_step() {
        let mut curve = Curve::new(CurveRule::default(), 2);
        curve.add(0, 1.0);
        curve.add(1, 4.0);
        let points = curve.finish();
        assert_eq!(points[0], CurvePoint { step: 1, rmse: 1.0 });
        assert_eq!(points[1], CurvePoint { step: 2, rmse: 2.0 });
        let mut none = Curve::new(CurveRule { windows: 0 }, 2);
        none.add(0, 1.0);
        assert_eq!(none.finish(), []);
    }
}
