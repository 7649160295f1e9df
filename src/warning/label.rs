//! Distance label of a panel: in steps of 10 cm, held while nearly right, so that the panel's
//! texture changes rarely.

/// Step of the labels, metres. Choice: the accuracy of the body model; finer digits would flicker.
const STEP_M: f64 = 0.1;
/// A label stays while its error is below this, metres. Choice: more than half a step, so that a
/// head's sway does not alternate two labels.
const MAX_LABEL_ERROR_M: f64 = 0.08;
/// Least time a label stays, nanoseconds. Choice: a number that changes faster cannot be read.
const MIN_LABEL_NS: i64 = 250_000_000;
/// Largest label, metres. Choice: two digits fit the label; no obstacle is mapped that far away.
const MAX_LABEL_M: f64 = 9.9;

/// Rounded to the nearest step.
pub(super) fn rounded_label(gap_m: f64) -> f64 {
    (gap_m / STEP_M).round().clamp(0.0, MAX_LABEL_M / STEP_M) * STEP_M
}

/// Label state from frame to frame.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct DistanceLabel {
    shown: Option<(i64, f64)>,
}

impl DistanceLabel {
    /// The label for this gap between the wearer's body and the hazard.
    pub fn update(&mut self, now_ns: i64, gap_m: f64) -> f64 {
        let held = self.shown.filter(|(since_ns, label_m)| {
            let age_ns = now_ns.saturating_sub(*since_ns);
            (label_m - gap_m).abs() < MAX_LABEL_ERROR_M || (0..MIN_LABEL_NS).contains(&age_ns)
        });
        let (since_ns, label_m) = held.unwrap_or_else(|| (now_ns, rounded_label(gap_m)));
        self.shown = Some((since_ns, label_m));
        label_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn label_is_accurate_to_one_step_and_stable() {
        let mut label = DistanceLabel::default();
        let sway = |frame: i64| 0.75 + 0.02 * (frame as f64 * 0.3).sin();
        let labels: Vec<f64> = (0..900).map(|frame| label.update(frame * 11_000_000, sway(frame))).collect();
        assert!(labels.windows(2).all(|pair| pair[0] == pair[1]) && (labels[0] - 0.75).abs() < 0.06, "{}", labels[0]);
        assert!((label.update(20_000_000_000, 0.42) - 0.4).abs() < 1e-9);
        assert!((label.update(20_100_000_000, 0.1) - 0.4).abs() < 1e-9, "not that soon");
        assert!((label.update(20_300_000_000, 0.1) - 0.1).abs() < 1e-9);
        assert_eq!((rounded_label(77.0), rounded_label(0.0)), (9.9, 0.0));
    }
}
