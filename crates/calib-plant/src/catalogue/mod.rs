//! The catalogue of channels for a plant of a given size.

mod alive;
mod dead;

use crate::channel::Channel;

/// Returns how many of `channels` survive preprocessing: most of a small plant, 142 of 480 (the
/// paper's figures), and a little over a quarter of a very large one.
pub(crate) fn alive_count(channels: usize) -> usize {
    let n = channels as f64;
    let share = 0.2825 + 0.7175 * (-(n - 3.0) / 120.0).exp();
    ((share * n).round() as usize).clamp(channels.min(4), channels)
}

/// Returns the channels of a plant in the order of its columns: the three roles and the mode,
/// then living and dead ones evenly mixed.
pub(crate) fn channels(count: usize) -> Vec<Channel> {
    let alive = alive_count(count);
    let mut living = alive::channels(alive).into_iter();
    let mut dead = dead::channels(count - alive).into_iter();
    let first = 4.min(count);
    let mut mixed: Vec<Channel> = living.by_ref().take(first).collect();
    let rest = count - first;
    let living_rest = alive - first;
    for position in 0..rest {
        // Bresenham: after `position` columns, a proportional number of living ones.
        let due = (position + 1) * living_rest / rest > position * living_rest / rest;
        mixed.extend(if due { living.next() } else { dead.next() });
    }
    mixed
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;
    use crate::channel::Fate;
    use crate::{MODE_CHANNEL, ROLES};

    fn fates(count: usize) -> (usize, usize, usize) {
        let channels = channels(count);
        assert_eq!(channels.len(), count);
        let [alive, constant, missing] = [Fate::Alive, Fate::Constant, Fate::Missing]
            .map(|fate| channels.iter().filter(|c| c.info.fate == fate).count());
        (alive, constant, missing)
    }

    #[test]
    fn the_mix_scales() {
        assert_eq!(fates(3), (3, 0, 0));
        assert_eq!(fates(4), (4, 0, 0));
        assert_eq!(fates(24), (21, 1, 2));
        let (alive, constant, missing) = fates(64);
        assert_eq!(alive, 46);
        assert!(constant > 5 && missing > 5);
        let (alive, constant, missing) = fates(480);
        assert_eq!(alive, 142);
        assert!(constant > 150 && missing > 100);
    }

    #[test]
    fn roles_come_first_and_names_are_unique() {
        for count in [3, 5, 24, 480, 10_000] {
            let channels = channels(count);
            for (channel, name) in channels.iter().zip(ROLES.into_iter().chain([MODE_CHANNEL])) {
                assert_eq!(channel.info.name, name);
            }
            let names: HashSet<&str> = channels.iter().map(|c| c.info.name.as_str()).collect();
            assert_eq!(names.len(), count);
        }
    }

    fn living(count: usize) -> HashSet<String> {
        channels(count)
            .into_iter()
            .filter(|c| c.info.fate == Fate::Alive)
            .map(|c| c.info.name)
            .collect()
    }

    #[test]
    fn a_larger_plant_contains_the_living_channels_of_a_smaller_one() {
        assert!(living(24).is_subset(&living(64)) && living(64).is_subset(&living(480)));
    }
}
