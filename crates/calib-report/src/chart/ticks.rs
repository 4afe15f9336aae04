//! Ticks of an axis: their positions and labels.

use calib_core::{number, setting, whole};

use super::{
    Scale, ScaleKind,
    dates::{dates, dates_apart},
    tick::Tick,
};

/// Returns the ticks of `scale`, about `wanted` of them with labels.
pub(crate) fn ticks(scale: &Scale, wanted: usize) -> Vec<Tick> {
    match &scale.kind {
        ScaleKind::Linear => linear(scale, wanted, 0.0),
        // Up to ten ranks all have labels.
        ScaleKind::Whole => linear(scale, wanted.max(10), 1.0),
        ScaleKind::Log => log(scale, wanted),
        ScaleKind::Time => dates(scale.min, scale.max, wanted),
        ScaleKind::CutTime(stretches) => {
            let recorded: f64 = stretches.iter().map(|(first, last)| last - first).sum();
            stretches
                .iter()
                .flat_map(|&(first, last): &(f64, f64)| {
                    dates_apart(first, last, recorded / wanted as f64)
                })
                .collect()
        }
        ScaleKind::Names(names) => names
            .iter()
            .enumerate()
            .map(|(i, name)| Tick { value: i as f64, label: Some(name.clone()) })
            .collect(),
    }
}

/// Upper limit for the number of ticks, more than any axis has room for.
const MOST: f64 = 1000.0;

/// Returns ticks at the two ends only, for a range whose numbers are too close to distinguish.
fn ends(scale: &Scale) -> Vec<Tick> {
    let finite = [scale.min, scale.max].into_iter().filter(|value| value.is_finite());
    finite.map(|value| Tick { value, label: Some(number(value)) }).collect()
}

/// Returns ticks at multiples of 1, 2 or 5 times a power of ten, at least `smallest_step` apart.
fn linear(scale: &Scale, wanted: usize, smallest_step: f64) -> Vec<Tick> {
    let low = scale.min.min(scale.max);
    let high = scale.min.max(scale.max);
    let rough = (high - low) / wanted.max(1) as f64;
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0]
        .into_iter()
        .map(|factor| factor * power)
        .find(|step| *step >= rough * 0.999)
        .unwrap_or(10.0 * power)
        .max(smallest_step);
    let first = (low / step).ceil();
    let last = (high / step).floor();
    // At the smallest and the largest numbers, a step can be below the resolution of floats.
    if !(step > 0.0 && (first + 1.0) * step > first * step && last - first <= MOST) {
        return ends(scale);
    }
    // Ranks start at 1, which is not a multiple of a larger step.
    let best = (smallest_step > 0.0 && step > 1.0)
        .then(|| Tick { value: 1.0, label: Some("1".to_owned()) });
    let first = if best.is_some() { (first as i64).max(1) } else { first as i64 };
    let multiples = (first..=last as i64).map(|multiple| {
        let value = multiple as f64 * step;
        Tick { value, label: Some(label(value, step)) }
    });
    best.into_iter().chain(multiples).collect()
}

/// Returns labelled ticks at powers of ten, and ticks at their multiples. Multiples by 2 and 5 have labels
/// if there is room.
fn log(scale: &Scale, wanted: usize) -> Vec<Tick> {
    if !(scale.min >= f64::MIN_POSITIVE && scale.max.is_finite()) {
        return ends(scale);
    }
    let first = scale.min.log10().floor() as i32;
    let last = scale.max.log10().ceil() as i32;
    let decades = scale.max.log10() - scale.min.log10();
    let every = (decades / wanted.max(1) as f64).ceil().max(1.0) as i32;
    let labelled: &[u32] = match decades {
        few if few < 1.0 => &[1, 2, 3, 5, 7],
        some if some < 2.0 => &[1, 2, 5],
        _ => &[1],
    };
    let mut ticks = Vec::new();
    // Over many decades, only ticks with a label are drawn.
    let digits = if last - first > 40 { 1..2_u32 } else { 1..10_u32 };
    let far = last - first > 40;
    for exponent in (first..=last).filter(|exponent| !far || exponent.rem_euclid(every) == 0) {
        for digit in digits.clone() {
            // Parsing gives the nearest float to the label. Multiplication would not.
            let value: f64 = format!("{digit}e{exponent}").parse().unwrap_or(f64::NAN);
            if scale.min <= value && value <= scale.max {
                let shown = labelled.contains(&digit) && exponent.rem_euclid(every) == 0;
                // One axis has one style: 1e-2 beside 1e-3, but 0.01 beside 0.1.
                let style = if scale.min < 5e-3 && exponent < 0 {
                    format!("{digit}e{exponent}")
                } else {
                    setting(value)
                };
                ticks.push(Tick { value, label: shown.then_some(style) });
            }
        }
    }
    ticks
}

/// Formats `value` with as many decimals as `step` needs.
fn label(value: f64, step: f64) -> String {
    let decimals = (-(step * 1.0001).log10().floor()).max(0.0) as usize;
    if decimals > 4 || value.abs() >= 1e6 {
        return number(value);
    }
    if decimals == 0 && value.abs() >= 1e3 {
        return whole(value);
    }
    let text = format!("{value:.decimals$}");
    if text.trim_start_matches('-').chars().all(|c| c == '0' || c == '.') {
        "0".to_owned()
    } else {
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(scale: &Scale) -> Vec<String> {
        ticks(scale, 6).into_iter().filter_map(|tick| tick.label).collect()
    }

    #[test]
    fn no_range_has_too_many_ticks() {
        let ends = [0.0, 5e-324, 1e-323, 1e-310, 1e-3, 1.0, 1e300, 1.5e308, f64::MAX];
        for (place, &low) in ends.iter().enumerate() {
            for &high in &ends[place..] {
                let values = [low, high];
                let scales = [
                    Scale::linear(low, high),
                    Scale::linear(-high, -low),
                    Scale::linear(-high, high),
                    Scale::around(&values),
                    Scale::log_around(&values),
                    Scale::linear_around(&values),
                ];
                for scale in scales {
                    let ticks = ticks(&scale, 6);
                    assert!(ticks.len() < 400, "{scale:?}: {} ticks", ticks.len());
                }
            }
        }
    }

    #[test]
    fn linear_ticks_are_round_numbers() {
        assert_eq!(labels(&Scale::linear(0.0, 1.0)), ["0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(
            labels(&Scale::linear(-30.0, 30.0)),
            ["-30", "-20", "-10", "0", "10", "20", "30"]
        );
        assert_eq!(labels(&Scale::linear(0.0, 30_000.0)).last().unwrap(), "30,000");
    }

    #[test]
    fn ranks_are_whole_and_start_at_the_best() {
        assert_eq!(labels(&Scale::ranks(5)), ["1", "2", "3", "4", "5"]);
        assert_eq!(labels(&Scale::ranks(30))[..3], ["1", "5", "10"]);
    }

    #[test]
    fn logarithmic_ticks_are_powers_of_ten() {
        let scale = Scale { kind: ScaleKind::Log, min: 5e-7, max: 2e-2 };
        assert_eq!(labels(&scale), ["1e-6", "1e-5", "1e-4", "1e-3", "1e-2"]);
        let narrow = Scale { kind: ScaleKind::Log, min: 0.9, max: 12.0 };
        assert_eq!(labels(&narrow), ["1", "2", "5", "10"]);
        assert!(ticks(&scale, 6).iter().any(|tick| tick.label.is_none()));
    }
}
