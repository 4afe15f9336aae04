/// A value that holds from an instant on, in seconds after the plant's
/// start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Dated<T> {
    pub(crate) at: f64,
    pub(crate) value: T,
}

/// A value over time: dated values in time order, of which the latest
/// holds.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Timeline<T>(Vec<Dated<T>>);

impl<T> Default for Timeline<T> {
    /// Returns an empty timeline.
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<T: Copy> Timeline<T> {
    /// Returns the timeline of `events`, which are in time order.
    pub(crate) fn new(events: Vec<Dated<T>>) -> Self {
        debug_assert!(events.is_sorted_by(|a, b| a.at <= b.at), "in the order of time");
        Self(events)
    }

    /// Returns the value that holds at `t`, s, or `None` before the
    /// first event.
    pub(crate) fn at(&self, t: f64) -> Option<Dated<T>> {
        let after = self.0.partition_point(|event| event.at <= t);
        after.checked_sub(1).map(|place| self.0[place])
    }

    pub(crate) fn events(&self) -> &[Dated<T>] {
        &self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_latest_event_holds() {
        let events = [(5.0, 'a'), (9.0, 'b')].map(|(at, value)| Dated { at, value });
        let timeline = Timeline::new(events.to_vec());
        let found = [4.9, 5.0, 8.9, 9.0].map(|t| timeline.at(t).map(|event| event.value));
        assert_eq!(found, [None, Some('a'), Some('a'), Some('b')]);
        assert_eq!(Timeline::<char>::default().at(1.0), None);
    }
}
