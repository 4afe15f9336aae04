//! Sobol's sequence with a digital shift.
//!
//! Direction numbers: S. Joe and F. Y. Kuo, "Constructing Sobol sequences with better two-dimensional
//! projections", SIAM J. Sci. Comput. 30 (2008), table new-joe-kuo-6 (published under a BSD licence,
//! copyright 2008 Frances Y. Kuo and Stephen Joe).

use calib_core::Seed;

/// Degree s, coefficients a of the primitive polynomial, and m₁ … mₛ, for dimensions 2, 3, …
const DIRECTIONS: [(u32, u32, &[u32]); 20] = [
    (1, 0, &[1]),
    (2, 1, &[1, 3]),
    (3, 1, &[1, 3, 1]),
    (3, 2, &[1, 1, 1]),
    (4, 1, &[1, 1, 3, 3]),
    (4, 4, &[1, 3, 5, 13]),
    (5, 2, &[1, 1, 5, 5, 17]),
    (5, 4, &[1, 1, 5, 5, 5]),
    (5, 7, &[1, 1, 7, 11, 19]),
    (5, 11, &[1, 1, 5, 1, 1]),
    (5, 13, &[1, 1, 1, 3, 11]),
    (5, 14, &[1, 3, 5, 5, 31]),
    (6, 1, &[1, 3, 3, 9, 7, 49]),
    (6, 13, &[1, 1, 1, 15, 21, 21]),
    (6, 16, &[1, 3, 1, 13, 27, 49]),
    (6, 19, &[1, 1, 1, 15, 7, 5]),
    (6, 22, &[1, 3, 1, 15, 13, 25]),
    (6, 25, &[1, 1, 5, 5, 19, 61]),
    (7, 1, &[1, 3, 7, 11, 23, 15, 103]),
    (7, 4, &[1, 3, 7, 13, 13, 15, 69]),
];

/// Number of dimensions with direction numbers. It is larger than the number of agent fields.
pub(crate) const DIMENSIONS: usize = DIRECTIONS.len() + 1;

/// A sequence of points that fill the unit cube evenly. Each of 2ᵐ equal intervals of every dimension holds
/// one of the first 2ᵐ points.
#[derive(Clone, Debug)]
pub(crate) struct Sobol {
    /// v₁ … v₃₂ of each dimension.
    directions: Vec<[u32; 32]>,
    /// Shift per dimension, combined with every point by exclusive or. It keeps the evenness and moves the
    /// sequence away from the corner in which it begins.
    shifts: Vec<u32>,
}

impl Sobol {
    /// Creates the sequence in `dimensions` dimensions, at most [`DIMENSIONS`], with a shift drawn from
    /// `seed`.
    pub(crate) fn new(dimensions: usize, seed: Seed) -> Self {
        assert!(dimensions <= DIMENSIONS, "direction numbers for {DIMENSIONS} dimensions");
        Self {
            directions: (0..dimensions).map(directions).collect(),
            shifts: (0..dimensions)
                .map(|dimension| (seed.number(dimension as u64).rng().bits() >> 32) as u32)
                .collect(),
        }
    }

    /// Returns point `index`, with coordinates in `[0, 1)`.
    pub(crate) fn point(&self, index: u32) -> Vec<f64> {
        self.directions
            .iter()
            .zip(&self.shifts)
            .map(|(directions, shift): (&[u32; 32], &u32)| {
                let bits = (0..32).filter(|bit| index >> bit & 1 == 1);
                let digits = bits.fold(*shift, |digits, bit| digits ^ directions[bit]);
                f64::from(digits) / 2_f64.powi(32)
            })
            .collect()
    }
}

/// Computes vₖ = mₖ 2³²⁻ᵏ with mₖ = 2a₁mₖ₋₁ ⊕ … ⊕ 2ˢ⁻¹aₛ₋₁mₖ₋ₛ₊₁ ⊕ 2ˢmₖ₋ₛ ⊕ mₖ₋ₛ.
fn directions(dimension: usize) -> [u32; 32] {
    let mut v = std::array::from_fn(|k| 1 << (31 - k));
    let Some((degree, coefficients, m)) = dimension.checked_sub(1).map(|index| DIRECTIONS[index])
    else {
        return v;
    };
    let degree = degree as usize;
    for k in 0..32 {
        v[k] = if k < degree {
            m[k] << (31 - k)
        } else {
            let mut value = v[k - degree] ^ (v[k - degree] >> degree);
            for term in 1..degree {
                if coefficients >> (degree - 1 - term) & 1 == 1 {
                    value ^= v[k - term];
                }
            }
            value
        };
    }
    v
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn unshifted(dimensions: usize) -> Sobol {
        Sobol { shifts: vec![0; dimensions], ..Sobol::new(dimensions, Seed::new(0)) }
    }

    proptest! {
        #[test]
        fn every_dimension_is_even_at_every_power_of_two(seed: u64, m in 0_u32..9) {
            let sobol = Sobol::new(DIMENSIONS, Seed::new(seed));
            let points: Vec<Vec<f64>> = (0..1 << m).map(|index| sobol.point(index)).collect();
            for dimension in 0..DIMENSIONS {
                let intervals = points.iter().map(|point| point[dimension] * f64::from(1 << m));
                let mut hit: Vec<u32> = intervals.map(|interval| interval as u32).collect();
                hit.sort_unstable();
                prop_assert_eq!(hit, (0..1 << m).collect::<Vec<u32>>());
            }
        }

        #[test]
        fn two_dimensions_are_even_in_every_elementary_rectangle(seed: u64, m in 0_u32..9, cut in 0_u32..9) {
            let (wide, high) = (1_u32 << cut.min(m), 1_u32 << (m - cut.min(m)));
            let sobol = Sobol::new(2, Seed::new(seed));
            let mut hit: Vec<u32> = (0..1 << m)
                .map(|index| {
                    let point = sobol.point(index);
                    (point[0] * f64::from(wide)) as u32 * high + (point[1] * f64::from(high)) as u32
                })
                .collect();
            hit.sort_unstable();
            prop_assert_eq!(hit, (0..1 << m).collect::<Vec<u32>>());
        }
    }

    #[test]
    fn points_are_those_of_joe_and_kuo() {
        let sobol = unshifted(DIMENSIONS);
        for (index, expected) in GOLDEN {
            let got = sobol.point(index).into_iter().map(|x| x * 1024.0);
            assert_eq!(got.collect::<Vec<_>>(), expected.map(f64::from), "point {index}");
        }
    }

    /// Points times 1024, from `scipy.stats.qmc.Sobol(21, scramble=False)`, whose i-th point is that of the
    /// Gray code of i.
    const GOLDEN: [(u32, [u32; DIMENSIONS]); 2] = [
        (
            5,
            [
                640, 128, 896, 640, 640, 896, 128, 128, 128, 384, 128, 640, 128, 896, 640, 640,
                640, 640, 128, 384, 384,
            ],
        ),
        (
            540,
            [
                225, 99, 531, 693, 287, 929, 47, 921, 513, 71, 87, 261, 165, 393, 147, 379, 737,
                353, 1015, 743, 535,
            ],
        ),
    ];
}
