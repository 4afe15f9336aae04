use super::{Dated, Feed, Timeline};
use crate::options::SECONDS_PER_DAY;

/// The feed of the plant over time: one feed after the other, each blended in over days.
#[derive(Clone, Debug)]
pub(crate) struct Feeds(Timeline<Blending>);

/// The transition from one feed to the next.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Blending {
    from: Feed,
    to: Feed,
}

impl Feeds {
    pub(crate) fn new(feeds: &Timeline<Feed>) -> Self {
        let mut from = Feed::FIRST;
        let mut blendings: Vec<Dated<Blending>> = Vec::with_capacity(feeds.events().len());
        for &Dated { at, value: to } in feeds.events() {
            if let Some(before) = blendings.last() {
                from = before.value.after(at - before.at);
            }
            blendings.push(Dated { at, value: Blending { from, to } });
        }
        Self(Timeline::new(blendings))
    }

    /// Returns the feed `t` seconds after the start.
    pub(crate) fn at(&self, t: f64) -> Feed {
        match self.0.at(t) {
            Some(Dated { at, value }) => value.after(t - at),
            None => Feed::FIRST,
        }
    }
}

impl Blending {
    /// Returns the feed `secs` after blending began. After a share s of the time, s² (3 − 2s) of the way is
    /// done, so that neither a quantity nor its slope jumps.
    fn after(&self, secs: f64) -> Feed {
        let share = (secs / (self.to.blending_days * SECONDS_PER_DAY)).min(1.0);
        self.from.blended(&self.to, share * share * (3.0 - 2.0 * share))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn feed(blending_days: f64, temperature_offset: f64) -> Feed {
        Feed { blending_days, temperature_offset, ..Feed::FIRST }
    }

    fn offset(feeds: &Feeds, days: f64) -> f64 {
        feeds.at(days * SECONDS_PER_DAY).temperature_offset
    }

    #[test]
    fn a_feed_comes_without_a_jump_also_into_one_that_is_still_coming() {
        let day = SECONDS_PER_DAY;
        let events = vec![
            Dated { at: 10.0 * day, value: feed(4.0, 2.0) },
            Dated { at: 12.0 * day, value: feed(2.0, -1.0) },
        ];
        let feeds = Feeds::new(&Timeline::new(events));
        assert_eq!(feeds.at(9.0 * day), Feed::FIRST);
        let offsets = [10.0, 12.0, 13.0, 14.0, 400.0].map(|days| offset(&feeds, days));
        assert_eq!(offsets, [0.0, 1.0, 0.0, -1.0, -1.0]);
        let largest = (900..1500).map(|hundredth| {
            let days = f64::from(hundredth) / 100.0;
            (offset(&feeds, days + 0.01) - offset(&feeds, days)).abs()
        });
        // The slope is at most 1.5 times the mean one.
        assert!(largest.fold(0.0, f64::max) < 1.5 * 2.0 / 2.0 * 0.0101);
    }
}
