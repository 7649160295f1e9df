//! Wall cancellation: subtracts the echoes of known specular planes (walls, floor, ceiling) from
//! the sweeps of a sub-aperture before points are scored.
//!
//! A wall returns a thousand to a million times the power of a chair leg, and the sidelobes of its
//! pulse exceed the noise for 30 cm on either side. But everything about its echo except the
//! amplitude is known: the distance along the path is the plane's, the pulse is the sensor's. The
//! amplitude is estimated over groups of sweeps, interpolated linearly between groups, and the
//! modelled echo is subtracted. An object at exactly the wall's range loses whatever cannot be
//! distinguished from the wall within one group. Groups are therefore as long as possible while the
//! wall's residual stays below the noise. Tracking does not keep the phase of a strong wall stable
//! over a whole sub-aperture.

use std::ops::Range;

use num_complex::{Complex32, Complex64};

use crate::geometry::Plane;
use crate::math;
use crate::{Observation, PHASE_RAD_PER_M};

/// Candidate group lengths, seconds; the longest sufficient one is used. Choice: whole
/// sub-apertures (up to 0.5 s), a half, a third and a sixth of 90 ms; shorter groups would take
/// objects before the wall along.
const GROUP_LENGTHS_S: [f64; 4] = [1.0, 0.045, 0.03, 0.015];
/// Least echo power of one sweep, over the noise, at which a plane is cancelled. Choice: enough to
/// mask other objects at its range, since a sub-aperture adds dozens of sweeps.
const MIN_POWER_OVER_NOISE: f64 = 2.0;
/// With the shortest groups, least share of the sweeps' energy (noise subtracted) that must add up
/// in phase. Below it, the strong echo is not the plane's. Choice: a wall that tracking errors
/// disturb still adds up within 15 ms, another echo hardly does.
const MIN_IN_PHASE_SHARE: f64 = 0.7;
/// The echo is searched this many steps nearer and farther than the known plane; step in metres.
/// Choice: 8 cm either way, a known wall's error; a step is a seventh of the pulse, so that a
/// parabola interpolates.
const STEPS: usize = 4;
const STEP_M: f64 = 0.02;
/// Number of offsets tried.
const OFFSETS: usize = 2 * STEPS + 1;
/// The pulse at x widths from its middle is e^(cx²) ([`crate::envelope`]).
const EXPONENT: f64 = -4.0 * std::f64::consts::LN_2;
/// Extent of the modelled pulse, in pulse widths. Choice: down to −60 dB, as a wall may be 60 dB
/// stronger than a chair's leg.
const REACH_WIDTHS: f64 = 1.6;

/// The sweeps without the echoes of strong planes; `None` when there are none.
pub(super) fn subtract_planes(
    sweeps: &[Observation],
    planes: &[Plane],
    noise_rms_lsb: f64,
) -> Option<Vec<Observation>> {
    let mut cleaned: Option<Vec<Observation>> = None;
    for plane in planes {
        let from = cleaned.as_deref().unwrap_or(sweeps);
        let Some(echo) = PlaneEcho::found(from, plane, noise_rms_lsb) else { continue };
        let mut without = cleaned.take().unwrap_or_else(|| sweeps.to_vec());
        echo.subtract_from(&mut without);
        cleaned = Some(without);
    }
    cleaned
}

/// A plane's echo in a sub-aperture.
struct PlaneEcho<'m> {
    plane: &'m Plane,
    /// Offset of the echo's range from the known plane's, metres; positive is farther.
    range_offset_m: f64,
    /// For each group: its middle, as a sweep index, and its amplitude, LSB.
    amplitudes: Vec<(f64, Complex64)>,
}

/// Correlation of a group of sweeps with the echo's template.
#[derive(Clone, Copy, Default)]
struct Sums {
    /// Σ x e^(−jκd) E, and Σ E².
    in_phase: Complex64,
    template: f64,
    /// Σ over sweeps of abs(Σ x e^(−jκd) E)² / Σ E².
    energy: f64,
}

impl<'m> PlaneEcho<'m> {
    fn found(sweeps: &[Observation], plane: &'m Plane, noise_rms_lsb: f64) -> Option<Self> {
        let middle = sweeps.get(sweeps.len() / 2)?;
        let distance_m = plane.distance(middle.tracking_from_sensor.translation);
        if !middle.geometry.axis.contains(distance_m) {
            return None;
        }
        let turned = TurnedSweeps::of(sweeps, plane);
        let range_offset_m = estimate_range_offset_m(sweeps, &turned)?;
        let noise = noise_rms_lsb.powi(2) * sweeps.len() as f64;
        for group_s in GROUP_LENGTHS_S {
            let groups = groups(sweeps, group_s);
            let sums: Vec<Sums> = groups.iter().map(|group| turned.sums(group, range_offset_m)).collect();
            let energy = sums.iter().map(|sums| sums.energy).sum::<f64>() - noise;
            let noise_in_phase = noise_rms_lsb.powi(2) * groups.len() as f64;
            let in_phase = sums.iter().map(coherent_energy).sum::<f64>() - noise_in_phase;
            if energy < MIN_POWER_OVER_NOISE * noise {
                return None;
            }
            let is_shortest = group_s == GROUP_LENGTHS_S[GROUP_LENGTHS_S.len() - 1];
            if energy - in_phase <= noise || (is_shortest && in_phase >= MIN_IN_PHASE_SHARE * energy) {
                let middles = groups.iter().map(|group| 0.5 * (group.start + group.end - 1) as f64);
                let amplitudes = sums.iter().map(|sums| sums.in_phase / sums.template.max(1e-12));
                return Some(Self { plane, range_offset_m, amplitudes: middles.zip(amplitudes).collect() });
            }
        }
        None
    }

    fn subtract_from(&self, sweeps: &mut [Observation]) {
        for (k, sweep) in sweeps.iter_mut().enumerate() {
            let amplitude = self.amplitude(k as f64);
            let template = Template::of(sweep, self.plane);
            let points = template.points(self.range_offset_m, 0.0);
            let pulses = template.pulses(points.start, self.range_offset_m);
            let echo = pulses.zip(template.phases(points.start)).map(|(pulse, phase)| amplitude * phase * pulse);
            for (sample, echo) in sweep.samples[points].iter_mut().zip(echo) {
                *sample -= Complex32::new(echo.re as f32, echo.im as f32);
            }
        }
    }

    /// Amplitude at a sweep: linear between the middles of neighbouring groups, extrapolated at the
    /// ends.
    fn amplitude(&self, sweep: f64) -> Complex64 {
        let last = self.amplitudes.len() - 1;
        let after = self.amplitudes.partition_point(|(middle, _)| *middle <= sweep).clamp(1.min(last), last);
        let ((from, a), (to, b)) = (self.amplitudes[after.saturating_sub(1)], self.amplitudes[after]);
        let share = if to > from { (sweep - from) / (to - from) } else { 0.0 };
        a + (b - a) * share
    }
}

/// Offset of the echo's range from the known plane's, metres, positive farther; `None` when the
/// maximum lies at the edge of the search.
fn estimate_range_offset_m(sweeps: &[Observation], turned: &TurnedSweeps) -> Option<f64> {
    let mut curve = [0.0; OFFSETS];
    for group in groups(sweeps, GROUP_LENGTHS_S[GROUP_LENGTHS_S.len() - 1]) {
        curve.iter_mut().zip(turned.energies(&group)).for_each(|(sum, energy)| *sum += energy);
    }
    let best = (0..curve.len()).max_by(|&a, &b| curve[a].total_cmp(&curve[b]))?;
    let (before, after) = (*curve.get(best.checked_sub(1)?)?, *curve.get(best + 1)?);
    let bend = before + after - 2.0 * curve[best];
    let between = if bend < 0.0 { 0.5 * (before - after) / bend } else { 0.0 };
    Some((best as f64 - STEPS as f64 + between.clamp(-0.5, 0.5)) * STEP_M)
}

/// The sweeps of each group of about `group_s`.
fn groups(sweeps: &[Observation], group_s: f64) -> Vec<Range<usize>> {
    let span_ns = sweeps[sweeps.len() - 1].mid_time_ns.saturating_sub(sweeps[0].mid_time_ns);
    let count = ((span_ns as f64 * 1e-9 / group_s).round() as usize).clamp(1, sweeps.len().div_ceil(2));
    (0..count).map(|n| n * sweeps.len() / count..(n + 1) * sweeps.len() / count).collect()
}

fn coherent_energy(sums: &Sums) -> f64 {
    sums.in_phase.norm_sqr() / sums.template.max(1e-12)
}

/// Sweeps about a plane's echo, each sample turned back by the phase that the echo would have there: what every offset of the
/// search has in common.
struct TurnedSweeps {
    /// Of each sweep its template, the first point, and where the samples from there on are.
    sweeps: Vec<(Template, usize, Range<usize>)>,
    samples: Vec<Complex64>,
}

impl TurnedSweeps {
    fn of(sweeps: &[Observation], plane: &Plane) -> Self {
        let mut turned = Self { sweeps: Vec::with_capacity(sweeps.len()), samples: Vec::new() };
        for sweep in sweeps {
            let template = Template::of(sweep, plane);
            let points = template.points(0.0, (STEPS + 1) as f64 * STEP_M);
            let (first, start) = (points.start, turned.samples.len());
            let wide = |sample: &Complex32| Complex64::new(sample.re.into(), sample.im.into());
            let phases = template.phases(first).map(|phase| phase.conj());
            let samples = sweep.samples.get(points).unwrap_or_default().iter().map(wide);
            turned.samples.extend(samples.zip(phases).map(|(sample, phase)| sample * phase));
            turned.sweeps.push((template, first, start..turned.samples.len()));
        }
        turned
    }

    /// Energy that adds up in phase at each offset of the search, −4δ to 4δ. At an offset of nδ the pulse is e^(c(x − nδ)²), which is
    /// e^(cx²) times the n-th power of e^(−2cxδ), and a factor that all points share, because their pulses have one width, and
    /// that the energy does not depend on. The powers stay finite for pulses of 2 cm and wider.
    fn energies(&self, group: &Range<usize>) -> [f64; OFFSETS] {
        let (mut in_phase, mut norms) = ([Complex64::ZERO; OFFSETS], [0.0; OFFSETS]);
        for (template, first, range) in &self.sweeps[group.clone()] {
            let [x, step] = template.widths_from_pulse(*first, 0.0);
            let step_widths = STEP_M / template.pulse_fwhm_m;
            let mut factor = math::exp(-2.0 * EXPONENT * x * step_widths);
            let factor_step = math::exp(-2.0 * EXPONENT * step * step_widths);
            for (sample, pulse) in self.samples[range.clone()].iter().zip(template.pulses(*first, 0.0)) {
                // The fourth power: the precision of `powi` depends on the system.
                const { assert!(STEPS == 4) };
                let square = factor * factor;
                let mut value = pulse / (square * square);
                for (sum, norm) in in_phase.iter_mut().zip(&mut norms) {
                    *sum += sample * value;
                    *norm += value * value;
                    value *= factor;
                }
                factor *= factor_step;
            }
        }
        std::array::from_fn(|n| in_phase[n].norm_sqr() / norms[n].max(1e-12))
    }

    fn sums(&self, group: &Range<usize>, range_offset_m: f64) -> Sums {
        let mut all = Sums::default();
        for (template, first, range) in &self.sweeps[group.clone()] {
            let points = template.points(range_offset_m, 0.0);
            let skipped = points.start.saturating_sub(*first).min(range.len());
            let samples = self.samples[range.clone()][skipped..].iter().take(points.len());
            let (mut in_phase, mut norm) = (Complex64::ZERO, 0.0);
            for (sample, pulse) in samples.zip(template.pulses(first + skipped, range_offset_m)) {
                in_phase += sample * pulse;
                norm += pulse * pulse;
            }
            all.in_phase += in_phase;
            all.template += norm;
            all.energy += in_phase.norm_sqr() / norm.max(1e-12);
        }
        all
    }
}

/// Echo of a plane that returns 1 LSB in one sweep: pulse and phase for the sensor's position at each point's own time. Ranges and
/// distances are linear in the points, so both follow recurrences over them.
struct Template {
    points: usize,
    pulse_fwhm_m: f64,
    /// Distance of the plane when the first point is measured, metres, and what each further point adds.
    distance_m: f64,
    distance_step_m: f64,
    /// Range of the first point beyond that distance, metres, and what each further point adds.
    excess_m: f64,
    excess_step_m: f64,
    /// See [`math::gaussians`].
    ratio_step: f64,
}

impl Template {
    fn of(sweep: &Observation, plane: &Plane) -> Self {
        let (axis, pulse_fwhm_m) = (sweep.geometry.axis, sweep.geometry.pulse_fwhm_m);
        let at_first = sweep.tracking_from_sensor.translation + sweep.velocity_m_per_s * sweep.point_time_s(0.0);
        let distance_m = plane.distance(at_first);
        let distance_step_m = -plane.outward.dot(sweep.velocity_m_per_s) * sweep.geometry.point_period_s;
        let excess_step_m = axis.step_m - distance_step_m;
        let x = excess_step_m / pulse_fwhm_m;
        Self {
            points: axis.points.min(sweep.samples.len()),
            pulse_fwhm_m,
            distance_m,
            distance_step_m,
            excess_m: axis.first_m - distance_m,
            excess_step_m,
            ratio_step: math::gaussian_ratio_step(EXPONENT, x),
        }
    }

    /// The points at which the pulse is not negligible, and those up to `more_m` beyond.
    fn points(&self, range_offset_m: f64, more_m: f64) -> Range<usize> {
        let reach_m = REACH_WIDTHS * self.pulse_fwhm_m + more_m;
        let point_at = |excess_m: f64| (excess_m - self.excess_m) / self.excess_step_m;
        let first = point_at(range_offset_m - reach_m).ceil().clamp(0.0, self.points as f64) as usize;
        let end = (point_at(range_offset_m + reach_m).floor() + 1.0).clamp(0.0, self.points as f64) as usize;
        first..end.max(first)
    }

    /// Range of a point beyond the pulse's middle, and what each further point adds, in pulse widths.
    fn widths_from_pulse(&self, point: usize, range_offset_m: f64) -> [f64; 2] {
        let excess_m = self.excess_m + point as f64 * self.excess_step_m - range_offset_m;
        [excess_m / self.pulse_fwhm_m, self.excess_step_m / self.pulse_fwhm_m]
    }

    /// The pulse from a point on.
    fn pulses(&self, first: usize, range_offset_m: f64) -> impl Iterator<Item = f64> + use<> {
        let [x, step] = self.widths_from_pulse(first, range_offset_m);
        math::gaussians(EXPONENT, x, step, self.ratio_step)
    }

    /// The phase from a point on.
    fn phases(&self, first: usize) -> impl Iterator<Item = Complex64> + use<> {
        let at_first = PHASE_RAD_PER_M * (self.distance_m + first as f64 * self.distance_step_m);
        let step = math::from_polar(1.0, PHASE_RAD_PER_M * self.distance_step_m);
        std::iter::successors(Some(math::from_polar(1.0, at_first)), move |phase| Some(phase * step))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::subaperture::{Subaperture, SubapertureBuilder, SubapertureSettings};
    use crate::test_data::{Echo, sweeps, winding};
    use crate::{RangeAxis, SweepGeometry};
    use glam::DVec3;
    use std::sync::Arc;

    const WALL: Plane = Plane { outward: DVec3::NEG_Z, offset_m: 1.8 };

    fn first_subaperture(echoes: &[(Echo, f64)], planes: &[Plane]) -> Subaperture {
        let mut builder = SubapertureBuilder::new(SubapertureSettings::default());
        builder.cancel_walls(planes);
        sweeps(0.3, winding, echoes, 7).into_iter().find_map(|sweep| builder.push(sweep)).unwrap()
    }

    fn coherence(block: &Subaperture, at: DVec3) -> f32 {
        block.coherence_at_points(&[(at - block.middle.translation).as_vec3().to_array()])[0].m
    }

    #[test]
    fn cancelling_a_strong_wall_restores_coherence_of_an_object_in_front() {
        // At nearly the wall's range, but in another direction as seen along the sensor's path.
        let chair = DVec3::new(0.8, -0.8, -1.2);
        let alone = coherence(&first_subaperture(&[(Echo::Point(chair), 0.5)], &[]), chair);
        for snr in [30.0, 1000.0] {
            let both = [(Echo::Point(chair), 0.5), (Echo::Plane(WALL), snr)];
            let masked = coherence(&first_subaperture(&both, &[]), chair);
            // The wall is known to within a few centimetres.
            let known = Plane { offset_m: WALL.offset_m - 0.023, ..WALL };
            let cleaned = coherence(&first_subaperture(&both, &[known]), chair);
            assert!(cleaned > 0.7 * alone && masked < 0.3 * alone, "{masked} {cleaned} {alone} at {snr}");
        }
    }

    #[test]
    fn recurrences_give_pulse_and_phase_of_each_point() {
        for sweep in sweeps(0.05, winding, &[], 7) {
            let template = Template::of(&sweep, &WALL);
            for offset_m in [-0.08, 0.013] {
                let points = template.points(offset_m, 0.1);
                assert!(points.len() > 8);
                let modelled = template.pulses(points.start, offset_m).zip(template.phases(points.start));
                for (n, (pulse, phase)) in points.zip(modelled) {
                    let moved_m = sweep.velocity_m_per_s * sweep.point_time_s(n as f64);
                    let distance_m = WALL.distance(sweep.tracking_from_sensor.translation + moved_m);
                    let excess_m = sweep.geometry.axis.range_m(n) - distance_m - offset_m;
                    assert!((pulse - crate::envelope(sweep.geometry.pulse_fwhm_m, excess_m)).abs() < 1e-12);
                    assert!((phase - math::from_polar(1.0, PHASE_RAD_PER_M * distance_m)).norm() < 1e-10);
                }
            }
        }
    }

    #[test]
    fn energies_of_the_search_are_those_of_each_offset() {
        for (pulse_fwhm_m, step_m) in [(0.02, 0.01), (0.04, 0.02), (0.14, 0.06), (0.32, 0.06)] {
            let mut sweeps = sweeps(0.05, winding, &[(Echo::Plane(WALL), 5.0)], 7);
            let axis = RangeAxis { first_m: WALL.offset_m - 25.0 * step_m, step_m, points: 50 };
            for sweep in &mut sweeps {
                sweep.geometry = Arc::new(SweepGeometry { pulse_fwhm_m, axis, ..*sweep.geometry });
            }
            let turned = TurnedSweeps::of(&sweeps, &Plane { offset_m: WALL.offset_m - 0.03, ..WALL });
            for group in [0..sweeps.len(), 3..9] {
                let energies = turned.energies(&group);
                let greatest = energies.into_iter().fold(0.0, f64::max);
                for (n, energy) in energies.into_iter().enumerate() {
                    let alone = coherent_energy(&turned.sums(&group, (n as f64 - STEPS as f64) * STEP_M));
                    // Apart from the pulse's ends, which are cut off in one of them.
                    assert!((energy - alone).abs() < 5e-3 * greatest, "{pulse_fwhm_m} {n}: {energy} {alone}");
                }
            }
        }
    }

    #[test]
    fn point_echo_is_not_cancelled() {
        let point = (Echo::Point(DVec3::new(0.9, 0.3, -1.5)), 50.0);
        let sweeps = sweeps(0.09, winding, &[point], 7);
        assert!(subtract_planes(&sweeps, &[WALL], 20.0).is_none());
        assert!(subtract_planes(&sweeps, &[], 20.0).is_none());
        let far = Plane { offset_m: 9.0, ..WALL };
        assert!(subtract_planes(&sweeps, &[far], 20.0).is_none());
    }
}
