use calib_core::{Rng, Seed, TransitionIndex};
use calib_knn::{Ends, Member, Weights};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Number of rollouts per member.
const ROLLOUTS: usize = 32;
/// Steps per rollout: those of the paper's rollouts on one week of data.
const STEPS: usize = 30_000;
/// A rollout that visits fewer rows than this in its last third is trapped (our choice).
const TRAPPED: usize = 100;
/// Number of parts of the member, equally long in time order, between which mixing is measured.
const PARTS: usize = 10;
/// Parts with a smaller share of the steps are ignored when mixing is judged: hardly any rollout starts there.
const RARE: f64 = 0.01;
/// Rollouts have mixed when their distribution is within this total-variation distance of the stationary one (Levin &
/// Peres, Markov Chains and Mixing Times, 2017, §4.5).
const MIXED: f64 = 0.25;
/// Longest lag at which moves are counted directly.
const LONGEST_LAG: usize = 1 << 10;
/// Binary logarithm of the longest lag that is judged.
const MOST_POWER: u32 = 20;
/// Binary logarithm of the multiple of the lag that counts as the long run.
const LONG_RUN: u32 = 30;

/// How far rollouts of an ensemble member get: 32 rollouts of 30,000 steps, from transitions drawn uniformly.
///
/// The second halves of the rollouts show what a stationary rollout visits. All values are estimates, and they depend only on the seed, not
/// on the machine.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RolloutStatistics {
    /// Number of distinct transitions that a rollout draws, the median over rollouts.
    pub distinct_rows: usize,
    /// Number of rollouts, of 32, that draw fewer than 100 distinct transitions in their last 10,000 steps.
    pub trapped: usize,
    /// Effective number of rows that stationary rollouts visit, `1 / Σ π_i²` (Hill 1973, of order 2), where `π_i` is the share of steps
    /// that draw transition `i`. It is the number of rows if all were visited equally often. `Σ π_i²` is the rate at which two different
    /// rollouts draw the same transition at any two times; none if they never do.
    pub effective_rows: Option<f64>,
    /// Expected number of steps until a rollout ends in a trap, or in a closed class if the ensemble member has no trap. It does not return
    /// from there. The estimate is the number of steps of all rollouts before their end, divided by the number of rollouts that ended (the
    /// estimate for an exponential time from censored data); none if no rollout ended.
    pub steps_to_end: Option<f64>,
    /// Number of steps after which the position of a rollout no longer depends on the tenth of the ensemble member in which it was: the
    /// smallest power of two `t` with `max_a TV(P^t(a, ·), π) ≤ 1/4` over tenths `a`. `P^t(a, b)` is the rate at which a rollout in `a` is
    /// in `b` after `t` steps. Up to 1024 steps it is counted; beyond, `P^t` are powers of it (as in Markov state models: Prinz et al.
    /// 2011, J. Chem. Phys. 134, 174105). The mixing time between transitions is no shorter. None if it takes more than a million steps,
    /// for example if parts do not meet.
    pub mixing_steps: Option<usize>,
}

impl RolloutStatistics {
    /// Returns the statistics of `member`, whose rollouts end in `ends`.
    pub fn of(member: &Member<'_>, ends: &Ends, weights: Weights, seed: Seed) -> Self {
        let rollouts = DrawnTransitions::new(member, weights, seed, STEPS);
        let mut each: Vec<usize> = rollouts.all().map(distinct).collect();
        each.sort_unstable();
        let last_thirds = rollouts.all().map(|rollout| &rollout[2 * STEPS / 3..]);
        Self {
            distinct_rows: each[each.len() / 2],
            trapped: last_thirds.filter(|rows| distinct(rows) < TRAPPED).count(),
            effective_rows: rollouts.effective_rows(),
            steps_to_end: rollouts.steps_to_end(ends),
            mixing_steps: rollouts.mixing_steps(member),
        }
    }
}

/// Returns the number of different rows.
fn distinct(rows: &[u32]) -> usize {
    let mut rows = rows.to_vec();
    rows.sort_unstable();
    rows.dedup();
    rows.len()
}

/// The transitions that rollouts draw.
struct DrawnTransitions {
    /// Transitions `[rollout, step]`; the first is the start.
    transitions: Vec<u32>,
    steps: usize,
}

impl DrawnTransitions {
    fn new(member: &Member<'_>, weights: Weights, seed: Seed, steps: usize) -> Self {
        // Rollouts were called walks. The seed keeps the name, so that the numbers of models stay.
        let mut rngs: Vec<Rng> =
            (0..ROLLOUTS).map(|rollout| seed.child("walk").number(rollout as u64).rng()).collect();
        let mut transitions = vec![0; ROLLOUTS * steps];
        for (rollout, rng) in rngs.iter_mut().enumerate() {
            transitions[rollout * steps] = member.nth(rng.below(member.len())).0;
        }
        // Side by side, so that the processor waits for the rows of all rollouts at once.
        for step in 1..steps {
            for (rollout, rng) in rngs.iter_mut().enumerate() {
                let from = TransitionIndex(transitions[rollout * steps + step - 1]);
                transitions[rollout * steps + step] = member.draw(from, weights, rng).0;
            }
        }
        Self { transitions, steps }
    }

    fn all(&self) -> impl Iterator<Item = &[u32]> {
        self.transitions.chunks_exact(self.steps)
    }

    /// Iterates over the second halves of the rollouts.
    fn settled(&self) -> impl Iterator<Item = &[u32]> {
        self.all().map(|rollout| &rollout[self.steps / 2..])
    }

    fn effective_rows(&self) -> Option<f64> {
        let numbered = self.settled().enumerate();
        let mut drawn: Vec<(u32, u32)> = numbered
            .flat_map(|(number, rollout)| rollout.iter().map(move |&row| (row, number as u32)))
            .collect();
        drawn.sort_unstable();
        // Pairs of steps of different rollouts, and the number of pairs at the same transition. Each pair counts in both
        // orders.
        let all = drawn.len();
        let own = drawn.len() / ROLLOUTS;
        let pairs = all * all - ROLLOUTS * own * own;
        let same = drawn.chunk_by(|a, b| a.0 == b.0).map(|row| {
            let own: usize =
                row.chunk_by(|a, b| a.1 == b.1).map(|rollout| rollout.len() * rollout.len()).sum();
            row.len() * row.len() - own
        });
        let same: usize = same.sum();
        (same > 0).then(|| pairs as f64 / same as f64)
    }

    fn steps_to_end(&self, ends: &Ends) -> Option<f64> {
        let before: Vec<Option<usize>> = self
            .all()
            .map(|rollout| rollout.iter().position(|row| ends.contains(TransitionIndex(*row))))
            .collect();
        let ended = before.iter().flatten().count();
        let steps: usize = before.into_iter().map(|steps| steps.unwrap_or(self.steps)).sum();
        (ended > 0).then(|| steps as f64 / ended as f64)
    }

    fn mixing_steps(&self, member: &Member<'_>) -> Option<usize> {
        let dropped = member.model().blocks().dropped(member.number());
        let rollouts: Vec<Vec<usize>> = self
            .all()
            .map(|rollout| {
                rollout
                    .iter()
                    .map(|&row| {
                        let before = if row < dropped.start { 0 } else { dropped.len() };
                        (row as usize - before) * PARTS / member.len()
                    })
                    .collect()
            })
            .collect();
        mixing_steps(&rollouts)
    }
}

/// Transition probabilities between parts after some steps, one row per starting part.
type Moves = [[f64; PARTS]; PARTS];

/// Returns the number of steps after which the position of a rollout no longer depends on its starting part. `rollouts` holds
/// the part at each step.
fn mixing_steps(rollouts: &[Vec<usize>]) -> Option<usize> {
    let steps: usize = rollouts.iter().map(Vec::len).sum();
    let mut share = [0.0; PARTS];
    rollouts.iter().flatten().for_each(|&part| share[part] += 1.0 / steps as f64);
    let rare = share.map(|share| share < RARE);
    let mut moves = after(rollouts, 1);
    for power in 0..=MOST_POWER {
        let lag = 1_usize << power;
        if lag <= LONGEST_LAG {
            moves = after(rollouts, lag);
        } else {
            // Assumes that the next steps do not depend on how a part was entered.
            moves = product(&moves, &moves);
        }
        let mean = stationary(&moves, &share);
        if moves
            .iter()
            .zip(&rare)
            .all(|(row, rare): (&[f64; PARTS], &bool)| *rare || variation(row, &mean) <= MIXED)
        {
            return Some(lag);
        }
    }
    None
}

/// Returns the transition probabilities between parts after `lag` steps.
fn after(rollouts: &[Vec<usize>], lag: usize) -> Moves {
    let mut moves = [[0.0; PARTS]; PARTS];
    for rollout in rollouts {
        rollout.iter().zip(rollout.iter().skip(lag)).for_each(|(&a, &b)| moves[a][b] += 1.0);
    }
    for (part, row) in moves.iter_mut().enumerate() {
        let sum: f64 = row.iter().sum();
        if sum > 0.0 {
            for count in row.iter_mut() {
                *count /= sum;
            }
        } else {
            row[part] = 1.0;
        }
    }
    moves
}

fn product(a: &Moves, b: &Moves) -> Moves {
    let mut product = [[0.0; PARTS]; PARTS];
    for (row, out) in a.iter().zip(&mut product) {
        for (share, next) in row.iter().zip(b) {
            out.iter_mut().zip(next).for_each(|(out, next)| *out += share * next);
        }
    }
    product
}

/// Returns the long-run distribution over parts from the initial `share`, after many times as many steps.
fn stationary(moves: &Moves, share: &[f64; PARTS]) -> [f64; PARTS] {
    let mut long = *moves;
    for _ in 0..LONG_RUN {
        long = product(&long, &long);
    }
    std::array::from_fn(|part: usize| {
        long.iter().zip(share).map(|(row, share)| share * row[part]).sum()
    })
}

/// Returns the total-variation distance: half of the sum of differences.
fn variation(a: &[f64; PARTS], b: &[f64; PARTS]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum::<f64>() / 2.0
}
