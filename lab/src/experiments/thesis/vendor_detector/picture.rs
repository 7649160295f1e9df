//! Range–speed picture of one window of the vendor's detector.

use glam::DVec3;

use super::super::Outcome;
use super::detector_run::WindowWithTruth;
use radar_chaperone::report::HeatChart;
use radar_sar::math;

/// Draws a window with the true and the detected reflections.
pub(super) fn draw_look(outcome: &mut Outcome, name: &str, title: &str, sight: &WindowWithTruth, things_m: &[DVec3]) {
    let spectrum = &sight.result.spectrum;
    let count = spectrum.bins.len();
    let mut bins: Vec<usize> = (0..count).collect();
    bins.sort_by(|a, b| spectrum.velocity_m_per_s(*a as f64).total_cmp(&spectrum.velocity_m_per_s(*b as f64)));
    let greatest = spectrum.bins.iter().flatten().map(|z| math::norm(*z)).fold(f64::MIN_POSITIVE, f64::max);
    let decibels = |bin: &usize| {
        spectrum.bins[*bin].iter().map(|z| 20.0 * math::log10(math::norm(*z) / greatest)).collect::<Vec<_>>()
    };
    let slowest = bins.first().map_or(0.0, |bin| spectrum.velocity_m_per_s(*bin as f64)) - 0.5 * spectrum.bin_m_per_s;
    let (axis, half_m) = (&spectrum.axis, 0.5 * spectrum.axis.step_m);
    let picture = HeatChart {
        title: title.into(),
        x_label: "range (m)".into(),
        y_label: "speed, away from the sensor (m/s)".into(),
        quantity: "magnitude relative to the greatest (dB)".into(),
        x: [axis.first_m - half_m, axis.last_m() + half_m],
        y: [slowest, slowest + count as f64 * spectrum.bin_m_per_s],
        columns: axis.points,
        values: bins.iter().flat_map(decibels).collect(),
        scale: [-50.0, 0.0],
        truth: things_m.iter().map(|&point| [sight.distance_m(point), sight.velocity_m_per_s(point)]).collect(),
        found: sight.result.reflections.iter().map(|found| [found.distance_m, found.velocity_m_per_s]).collect(),
    };
    outcome.draw(name, picture.draw(), format!("{title}: range and speed, as the thesis' figure 2.4."));
}
