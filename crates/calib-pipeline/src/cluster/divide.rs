//! Division of work into shards.

use std::ops::Range;

/// The requested size and number of shards.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Division {
    /// Time of a shard on one thread, in seconds.
    pub(crate) secs: f64,
    /// Largest number of shards, over all stages.
    pub(crate) most: usize,
    /// Fixed number of shards, whatever their time.
    pub(crate) exactly: Option<usize>,
}

impl Division {
    /// Returns the number of groups to split `sensors` sensors into. `passes` passes take `secs` seconds in all.
    /// Sensors of a group share a pass over a stream, which saves a little time. So they are only split if a pass takes
    /// longer than a shard should.
    pub(crate) fn groups(&self, passes: usize, sensors: usize, secs: f64) -> usize {
        let wanted = match self.exactly {
            Some(shards) => shards.div_ceil(passes.max(1)),
            None => (secs / passes.max(1) as f64 / self.secs).ceil() as usize,
        };
        wanted.clamp(1, sensors.max(1))
    }

    /// Returns the number of shards for this many passes. They take `secs` of the `total` seconds of all stages.
    fn shards(&self, passes: usize, secs: f64, total: f64) -> usize {
        let share = secs / total.max(f64::MIN_POSITIVE);
        let most = ((self.most as f64 * share).floor() as usize).max(1);
        let wanted = match self.exactly {
            Some(shards) => shards,
            None => ((secs / self.secs).ceil() as usize).min(most),
        };
        wanted.clamp(1, passes.max(1))
    }

    /// Cuts passes with these times into shards, each a range of passes. Passes that share states and tables must be
    /// adjacent. No shard exceeds the mean by more than one pass.
    pub(crate) fn cut(&self, secs: &[f64], total: f64) -> Vec<Range<usize>> {
        let sum: f64 = secs.iter().sum();
        let shards = self.shards(secs.len(), sum, total);
        let mut ranges = Vec::with_capacity(shards);
        let mut start = 0;
        let mut done = 0.0;
        for number in 0..shards {
            let left = shards - number - 1;
            let target = sum * (number + 1) as f64 / shards as f64;
            let mut end = start;
            // Keeps at least one pass for each later shard, and otherwise ends as near to the target as possible.
            while end < secs.len() - left
                && (end == start || left == 0 || done + secs[end] / 2.0 <= target)
            {
                done += secs[end];
                end += 1;
            }
            ranges.push(start..end);
            start = end;
        }
        ranges
    }
}

/// Splits `count` items into `groups` ranges of nearly equal length.
pub(crate) fn evenly(count: usize, groups: usize) -> impl Iterator<Item = Range<usize>> {
    (0..groups).map(move |group| count * group / groups..count * (group + 1) / groups)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn division(exactly: Option<usize>) -> Division {
        Division { secs: 1800.0, most: 1000, exactly }
    }

    #[test]
    fn sensors_are_cut_only_where_a_pass_is_too_long() {
        assert_eq!(division(None).groups(100, 200, 100.0 * 600.0), 1);
        assert_eq!(division(None).groups(100, 200, 100.0 * 5400.0), 3);
        assert_eq!(division(None).groups(100, 2, 100.0 * 90_000.0), 2);
        assert_eq!(division(Some(40)).groups(9, 2, 1.0), 2);
        assert_eq!(division(Some(7)).groups(9, 2, 1.0), 1);
    }

    proptest! {
        #[test]
        fn every_pass_is_in_one_shard_and_none_is_much_longer_than_the_mean(
            secs in prop::collection::vec(0.1..10.0_f64, 1..200),
            exactly in prop::option::of(1..60_usize),
            goal in 1.0..50.0_f64,
        ) {
            let division = Division { secs: goal, most: 100, exactly };
            let sum: f64 = secs.iter().sum();
            let ranges = division.cut(&secs, sum);
            let mut next = 0;
            for range in &ranges {
                prop_assert_eq!(range.start, next);
                prop_assert!(range.end > range.start);
                next = range.end;
            }
            prop_assert_eq!(next, secs.len());
            if let Some(exactly) = exactly {
                prop_assert_eq!(ranges.len(), exactly.min(secs.len()));
            }
            let mean = sum / ranges.len() as f64;
            let longest = secs.iter().copied().fold(0.0, f64::max);
            // Except if there is hardly one pass per shard: the last passes are then kept for the later shards.
            for range in &ranges {
                let own: f64 = secs[range.clone()].iter().sum();
                prop_assert!(own <= mean + 2.0 * longest + 1e-9, "{own} {mean} {longest}");
            }
        }

        #[test]
        fn groups_are_even(count in 1..300_usize, groups in 1..50_usize) {
            let groups = groups.min(count);
            let lengths: Vec<usize> = evenly(count, groups).map(|range| range.len()).collect();
            prop_assert_eq!(lengths.iter().sum::<usize>(), count);
            let (least, most) = (lengths.iter().min(), lengths.iter().max());
            prop_assert!(most.zip(least).is_some_and(|(most, least)| most - least <= 1));
        }
    }
}
