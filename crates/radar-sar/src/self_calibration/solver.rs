//! The corrections that explain the tracks best, by Gauss–Newton, and how large the slow tracking error is.

use std::cmp::Reverse;

use glam::DVec3;
use rayon::prelude::*;

use super::combination::{Combination, TrackTerm, combine};
use super::corrections::{BIAS, CORRECTIONS, Corrections, OFFSET, Quadratic, SHIFT};
use super::estimator::CalibrationSettings;
use super::fitted_track::{DRIFT_SCALE_BOUNDS, FittedTrack, MAX_DRIFT_CHANGE, REFIT_DRIFT};
use super::path::SensorPath;
use crate::PositionErrors;

/// Greatest distance of the time offset from the middle of the search, seconds, and its 1σ before. Choice: delays of
/// headsets and lines are tens of milliseconds.
pub(super) const REACH_S: f64 = 0.1;
/// 1σ of the range bias before, metres. Measured: the vendor's offset compensation
/// puts profile 3 at −6 to 0 mm.
const BIAS_SIGMA_M: f64 = 3e-3;
/// Time offsets that the first iterations start from, relative to the middle of the search, seconds. Choice: descents
/// begin at most 25 ms off.
const STARTS_S: [f64; 5] = [0.0, -0.05, 0.05, -0.09, 0.09];
/// A start other than the middle is taken when it explains this share more of the tracks better than worse, each clearly:
/// by more than this difference of minus twice the log likelihood. Choice: tracking errors let single tracks prefer any
/// offset; a likelihood ratio of e⁵.
const LEAD_OF_FAR_START: f64 = 0.5;
const CLEAR_GAIN: f64 = 10.0;
/// Starts are compared by the longest tracks, at most so many. Choice: long ones show most; it bounds the work of a
/// comparison, which motion that leaves the offset unobserved needs again and again.
const COMPARED_TRACKS: usize = 32;
/// Greatest steps of an iteration. Choice: the second-order approximation holds about as far.
const MAX_STEP: Corrections = [0.02, 0.03, 0.03, 0.03, 0.01];
/// Iterations of an estimate, and of each start. Choice: three to five suffice from a good start.
const MAX_ITERATIONS: usize = 12;
const START_ITERATIONS: usize = 4;
/// The iteration ends when a step is smaller than this share of 1σ.
const SMALL_STEP: f64 = 0.1;
/// How many degrees of freedom the settings' drift is worth. Choice: as many as one good track of 5 s.
const DRIFT_PRIOR_FREEDOM: f64 = 20.0;
/// Share of the tracks, by degrees of freedom, that show less than the tracking's drift. Measured (`lab --example mount`, worlds
/// dining and office): at a half the estimate runs to its bound, because highlights slide over most surfaces, and the mount is
/// off by 4 mm instead of 1; at a fifth it is 0.8 mm of 1, and 2.4 mm of 4.
const DRIFT_QUANTILE: f64 = 0.2;
/// With more drift than this, metres, the tracks' variance grows with its square. Measured (`lab --example mount`, headsets
/// inside-out and poor): tracking that wanders by 4 or 5 mm jumps, has wrong stamps and a bent frame as well, its drift is
/// found to be 2.4 or 3 mm, and the errors are twice what the scatter of the tracks shows; with 1 mm they agree.
const TRUSTED_DRIFT_M: f64 = 1.3e-3;
/// 1σ of what a single track may deviate by beyond its own errors. Choice: ten times what matters.
const TRACK_SPREAD: Corrections = [10e-3, 30e-3, 30e-3, 30e-3, 5e-3];

/// The corrections and the drift's variance, relative to the settings', that tracks are fitted for.
#[derive(Debug, Clone, Copy)]
pub(super) struct Point {
    pub at: Corrections,
    pub drift_scale: f64,
}

impl Point {
    /// Shift of the sensor along its own axes, metres.
    pub fn shift_m(&self) -> DVec3 {
        DVec3::new(self.at[SHIFT], self.at[SHIFT + 1], self.at[SHIFT + 2])
    }

    /// Slow tracking error in each axis, rms, metres.
    pub fn drift_m(&self, errors: &PositionErrors) -> f64 {
        (self.drift_scale * errors.slow_variance_m2()).sqrt()
    }

    /// The tracks' information at this point.
    pub fn terms<'t>(&self, tracks: impl Iterator<Item = &'t FittedTrack>, errors: &PositionErrors) -> Vec<TrackTerm> {
        let unmodelled = (self.drift_m(errors) / TRUSTED_DRIFT_M).max(1.0).powi(2);
        tracks.filter_map(|track| track.term_at(&self.at, unmodelled)).collect()
    }
}

/// Why it iterates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Rounds {
    /// To compare starts.
    Start,
    /// For the result.
    Final,
}

/// What the corrections are found with, besides the tracks.
#[derive(Debug, Clone, Copy)]
pub(super) struct Solver<'s> {
    pub settings: &'s CalibrationSettings,
    pub path: &'s SensorPath,
    /// Information of former tracks on the corrections.
    pub former: &'s FormerTracks,
}

/// Information of former tracks on the mount and the range bias, near the corrections `at`.
#[derive(Debug, Clone, Default)]
pub(super) struct FormerTracks {
    pub quadratic: Quadratic,
    pub at: Corrections,
}

impl FormerTracks {
    /// Whether there were none.
    pub fn is_empty(&self) -> bool {
        self.quadratic.matrix.iter().flatten().all(|value| *value == 0.0)
    }

    /// The same, seen from other corrections.
    pub fn seen_from(&self, at: &Corrections) -> Quadratic {
        self.quadratic.after(&std::array::from_fn(|k| at[k] - self.at[k]))
    }
}

impl Solver<'_> {
    /// The best corrections near these.
    pub fn near(&self, tracks: &mut [FittedTrack], start: Point) -> Option<(Point, Combination)> {
        self.iterate(tracks, start, Rounds::Final)
    }

    /// The best corrections from the best of several starts.
    pub fn of_best_start(&self, tracks: &mut [FittedTrack]) -> Option<(Point, Combination)> {
        let best = self.best_start(tracks)?;
        self.near(tracks, best)
    }

    /// A time offset this far from the middle of the search, and nothing else.
    pub fn start(&self, from_middle_s: f64) -> Point {
        let mut at = Corrections::default();
        at[OFFSET] = self.settings.middle_s + from_middle_s;
        Point { at, drift_scale: 1.0 }
    }

    /// Where the start ends that explains the tracks best; `None` where no track distinguishes time offsets.
    fn best_start(&self, tracks: &[FittedTrack]) -> Option<Point> {
        let mut varied: Vec<&FittedTrack> = tracks.iter().filter(|track| !track.is_uniform).collect();
        varied.sort_by_key(|track| Reverse(track.fit.last_ns.saturating_sub(track.fit.first_ns)));
        let varied: Vec<FittedTrack> = varied.into_iter().take(COMPARED_TRACKS).cloned().collect();
        let tried = STARTS_S.into_iter().filter_map(|from_middle_s| {
            let mut tracks = varied.clone();
            let (point, _) = self.iterate(&mut tracks, self.start(from_middle_s), Rounds::Start)?;
            Some((point, tracks))
        });
        let tried: Vec<(Point, Vec<FittedTrack>)> = tried.collect();
        let (near, near_tracks) = tried.first()?;
        let lead = |(_, tracks): &(Point, Vec<FittedTrack>)| lead(tracks, near_tracks);
        let best = tried.iter().map(|start| (lead(start), start.0)).max_by(|a, b| a.0.total_cmp(&b.0))?;
        Some(if best.0 >= LEAD_OF_FAR_START { best.1 } else { *near })
    }

    /// Gauss–Newton from a start.
    fn iterate(&self, tracks: &mut [FittedTrack], start: Point, rounds: Rounds) -> Option<(Point, Combination)> {
        let (mut point, mut found) = (start, None);
        let most = if rounds == Rounds::Start { START_ITERATIONS } else { MAX_ITERATIONS };
        for _ in 0..most {
            self.refit(tracks, &point, rounds);
            // A large drift explains any offset: starts are compared without it.
            let change = match rounds {
                Rounds::Start => 1.0,
                Rounds::Final => drift_change(tracks.iter().filter_map(FittedTrack::own_drift), point.drift_scale),
            };
            let terms = point.terms(tracks.iter(), &self.settings.errors);
            if terms.is_empty() && self.former.is_empty() {
                return None;
            }
            let combination = combine(&terms, &self.prior_at(&point.at), &TRACK_SPREAD)?;
            if terms.is_empty() {
                // After a long rest: what was known stays known, and stays.
                return Some((point, combination));
            }
            let is_small = |k: usize| combination.step[k].abs() <= SMALL_STEP * combination.covariance[k][k].sqrt();
            let is_done = (0..CORRECTIONS).all(is_small) && (1.0 / REFIT_DRIFT..REFIT_DRIFT).contains(&change);
            self.step(&mut point, &combination.step, change);
            found = Some(combination);
            if is_done {
                break;
            }
        }
        found.map(|found| (point, found))
    }

    /// Moves a point by a step of the corrections and a change of the drift's variance, within their bounds.
    fn step(&self, point: &mut Point, step: &Corrections, change: f64) {
        for (at, (step, most)) in point.at.iter_mut().zip(step.iter().zip(MAX_STEP)) {
            *at += step.clamp(-most, most);
        }
        let middle_s = self.settings.middle_s;
        point.at[OFFSET] = point.at[OFFSET].clamp(middle_s - REACH_S, middle_s + REACH_S);
        let (least, most) = DRIFT_SCALE_BOUNDS;
        point.drift_scale = (point.drift_scale * change).clamp(least, most);
    }

    /// Fits the tracks that were fitted too far from a point.
    fn refit(&self, tracks: &mut [FittedTrack], point: &Point, rounds: Rounds) {
        let drift_scale = |track: &FittedTrack| match rounds {
            Rounds::Start => point.drift_scale,
            Rounds::Final => track.drift_scale_at(point.drift_scale),
        };
        let is_far = |track: &FittedTrack| !track.is_near(&point.at, drift_scale(track));
        if !tracks.iter().any(is_far) {
            return;
        }
        let path = self.path.shifted(point.shift_m());
        tracks.par_iter_mut().filter(|track| is_far(track)).for_each(|track| {
            track.refit(&path, &point.at, drift_scale(track));
        });
    }

    /// The prior at these corrections, with the information of former tracks.
    fn prior_at(&self, at: &Corrections) -> Quadratic {
        let mut known = self.former.seen_from(at);
        let CalibrationSettings { middle_s, mount_sigma_m, .. } = *self.settings;
        known.expect(OFFSET, middle_s - at[OFFSET], REACH_S);
        (SHIFT..BIAS).for_each(|k| known.expect(k, -at[k], mount_sigma_m));
        known.expect(BIAS, -at[BIAS], BIAS_SIGMA_M);
        known
    }
}

/// Share of the tracks that are explained better than by other corrections, minus the share explained worse.
fn lead(tracks: &[FittedTrack], other: &[FittedTrack]) -> f64 {
    let pairs = tracks.iter().zip(other).filter_map(|(a, b)| Some(b.misfit()? - a.misfit()?));
    let votes: Vec<f64> = pairs.map(|gain| if gain.abs() < CLEAR_GAIN { 0.0 } else { gain.signum() }).collect();
    votes.iter().sum::<f64>() / votes.len().max(1) as f64
}

/// By which factor the drift's variance should change. All tracks have the tracking's drift, some have more of their own: the
/// lower of them count, and the settings' value as some more. `own`: each track's variance and its degrees of freedom.
fn drift_change(own: impl Iterator<Item = (f64, f64)>, scale: f64) -> f64 {
    let mut ratios: Vec<(f64, f64)> = own.map(|(own, freedom)| (own / scale, freedom)).collect();
    ratios.sort_by(|a, b| a.0.total_cmp(&b.0));
    let freedom: f64 = ratios.iter().map(|ratio| ratio.1).sum();
    let mut above = DRIFT_QUANTILE * freedom;
    let lower = ratios.iter().find(|ratio| {
        above -= ratio.1;
        above <= 0.0
    });
    let change =
        (lower.map_or(1.0, |ratio| ratio.0) * freedom + DRIFT_PRIOR_FREEDOM / scale) / (freedom + DRIFT_PRIOR_FREEDOM);
    change.clamp(1.0 / MAX_DRIFT_CHANGE, MAX_DRIFT_CHANGE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tracks_that_slide_do_not_count_as_drift_of_the_tracking() {
        let honest = |n: usize| (1.0 + 0.1 * n as f64, 8.0);
        let own = || (0..6).map(honest).chain((0..14).map(|n| (20.0 + n as f64, 8.0)));
        let mut scale = 1.0;
        for _ in 0..20 {
            scale *= drift_change(own(), scale);
        }
        assert!((0.9..1.6).contains(&scale), "{scale}");
        // All of them: it is the tracking.
        for _ in 0..20 {
            scale *= drift_change((0..14).map(|n| (20.0 + f64::from(n), 8.0)), scale);
        }
        assert!((15.0..25.0).contains(&scale), "{scale}");
        assert!((drift_change(std::iter::empty(), 4.0) - 0.25).abs() < 1e-12, "the settings' alone");
    }
}
