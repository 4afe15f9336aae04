/// Transposes `[rows, columns]` into `[columns, rows]`.
pub(super) fn transpose(values: &[f32], rows: usize, columns: usize, out: &mut [f32]) {
    assert!(values.len() == rows * columns && out.len() == values.len());
    #[cfg(target_arch = "x86_64")]
    if rows.is_multiple_of(x86::SIDE)
        && columns.is_multiple_of(x86::SIDE)
        && let pulp::Arch::V4(simd) = pulp::Arch::new()
    {
        pulp::Simd::vectorize(simd, x86::Blocks { simd, values, rows, columns, out });
        return;
    }
    for (column, out) in out.chunks_exact_mut(rows).enumerate() {
        for (out, values) in out.iter_mut().zip(values[column..].iter().step_by(columns)) {
            *out = *values;
        }
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use pulp::{NullaryFnOnce, Simd, cast, x86::V4};

    pub(super) use crate::square::SIDE;
    use crate::square::turn;

    /// A transpose of whole blocks.
    pub(super) struct Blocks<'a> {
        pub(super) simd: V4,
        pub(super) values: &'a [f32],
        pub(super) rows: usize,
        pub(super) columns: usize,
        pub(super) out: &'a mut [f32],
    }

    impl NullaryFnOnce for Blocks<'_> {
        type Output = ();

        #[expect(
            clippy::inline_always,
            reason = "only what is inlined into the dispatch is compiled for the processor"
        )]
        #[inline(always)]
        fn call(self) {
            let Self { simd, values, rows, columns, out } = self;
            let mut square = [simd.avx512f._mm512_setzero_si512(); SIDE];
            for row in (0..rows).step_by(SIDE) {
                for column in (0..columns).step_by(SIDE) {
                    for (place, square) in square.iter_mut().enumerate() {
                        let from = &values[(row + place) * columns + column..][..SIDE];
                        *square = cast(V4::as_simd_f32s(from).0[0]);
                    }
                    for (place, &turned) in turn(simd, square).iter().enumerate() {
                        let to = &mut out[(column + place) * rows + row..][..SIDE];
                        V4::as_mut_simd_f32s(to).0[0] = cast(turned);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_become_columns() {
        for (rows, columns) in [(1, 3), (16, 16), (64, 64), (48, 112), (5, 64), (64, 2)] {
            let values: Vec<f32> = (0..rows * columns).map(|value| value as f32).collect();
            let mut out = vec![0.0; values.len()];
            transpose(&values, rows, columns, &mut out);
            for row in 0..rows {
                for column in 0..columns {
                    assert_eq!(out[column * rows + row], values[row * columns + column]);
                }
            }
        }
    }
}
