//! A track, and its information on the corrections near those that it was last fitted for.

use super::combination::TrackTerm;
use super::corrections::{CORRECTIONS, Corrections};
use super::information::Information;
use super::path::SensorPath;
use super::track_fit::TrackFit;
use crate::math;

/// A track is fitted anew when the corrections are farther than this from those that it was fitted for, or the drift's
/// variance by more than this factor. Choice: within these the quadratic approximation changes by a few per cent.
const REFIT: Corrections = [0.3e-3, 1e-3, 1e-3, 1e-3, 3e-3];
pub(super) const REFIT_DRIFT: f64 = 1.3;
/// A track's own slow error is used when its variance is this many times the tracking's, which counts as so many degrees of
/// freedom in it. Measured (`lab --example mount`, worlds dining and office): a factor of 1.3 or 4, or one degree, is worse
/// in some worlds.
const OWN_EXCESS: f64 = 2.0;
const OWN_PRIOR_FREEDOM: f64 = 4.0;
/// Greatest change of the drift's variance in an iteration, as a factor, and its bounds relative to the settings'.
/// Choice: keeps a few odd tracks from running away with it.
pub(super) const MAX_DRIFT_CHANGE: f64 = 4.0;
pub(super) const DRIFT_SCALE_BOUNDS: (f64, f64) = (0.04, 64.0);

/// A track with its information on corrections near `at`.
#[derive(Debug, Clone)]
pub(super) struct FittedTrack {
    pub fit: TrackFit,
    /// The sensor went straight at constant speed: any time offset is equivalent to a displaced reflector.
    pub is_uniform: bool,
    at: Corrections,
    /// Variance of the slow error that it was fitted with, relative to the settings'.
    drift_scale: f64,
    /// That variance as the track alone shows it, and its degrees of freedom.
    own_drift: Option<(f64, f64)>,
    information: Option<Information>,
}

impl FittedTrack {
    /// Not fitted for any corrections yet.
    pub fn new(fit: TrackFit, is_uniform: bool) -> Self {
        Self { fit, is_uniform, at: Corrections::default(), drift_scale: 1.0, own_drift: None, information: None }
    }

    /// Whether it was fitted for corrections and a variance of the slow error near these.
    pub fn is_near(&self, at: &Corrections, drift_scale: f64) -> bool {
        let drift_is_near = (1.0 / REFIT_DRIFT..=REFIT_DRIFT).contains(&(self.drift_scale / drift_scale));
        self.information.is_some() && drift_is_near && (0..CORRECTIONS).all(|k| (self.at[k] - at[k]).abs() <= REFIT[k])
    }

    /// Fits it for these. `path` is shifted by the corrections' shift.
    pub fn refit(&mut self, path: &SensorPath, at: &Corrections, drift_scale: f64) {
        (self.at, self.drift_scale) = (*at, drift_scale);
        self.information = self.fit.information(path, at, drift_scale);
        let drift = self.information.and_then(|information| information.drift);
        let own = |(power, freedom): (f64, f64)| {
            let change = (power / freedom).clamp(1.0 / MAX_DRIFT_CHANGE, MAX_DRIFT_CHANGE);
            let (least, most) = DRIFT_SCALE_BOUNDS;
            ((drift_scale * change).clamp(least, most), freedom)
        };
        self.own_drift = drift.filter(|(_, freedom)| *freedom > 0.1).map(own).or(self.own_drift);
    }

    /// Variance of its slow error as it alone shows it, relative to the settings', and its degrees of freedom.
    pub fn own_drift(&self) -> Option<(f64, f64)> {
        self.own_drift
    }

    /// Variance of its slow error: the tracking's, or its own where that is clearly more, as of a highlight that slides over
    /// a surface.
    pub fn drift_scale_at(&self, of_tracking: f64) -> f64 {
        let own = self.own_drift.map_or(of_tracking, |(own, freedom)| {
            (of_tracking * OWN_PRIOR_FREEDOM + own * freedom) / (OWN_PRIOR_FREEDOM + freedom)
        });
        if own > OWN_EXCESS * of_tracking { own } else { of_tracking }
    }

    /// Its information at these corrections. `unmodelled`: factor of its variance.
    pub fn term_at(&self, at: &Corrections, unmodelled: f64) -> Option<TrackTerm> {
        let Information { quadratic, variance_factor, middle_ns, .. } = self.information?;
        let step = std::array::from_fn(|k| at[k] - self.at[k]);
        let variance_factor = variance_factor * unmodelled;
        Some(TrackTerm { quadratic: quadratic.after(&step), variance_factor, middle_ns })
    }

    /// Minus twice the log likelihood when the variance of its residuals is unknown.
    pub fn misfit(&self) -> Option<f64> {
        let (squares, count) = self.information?.residuals;
        Some(count * math::ln((squares / count).max(0.1)))
    }
}
