//! Moving targets: persons and pets. Echoes whose Doppler excludes an object at rest
//! are found in each sub-aperture and tracked from one to the next.
//!
//! A track is a range and a radial speed of its own. The sensor's displacement is taken out of the
//! range along the boresight, since the direction is known no better than the beam is wide. A small
//! Kalman filter with a gate assigns echoes to tracks. A range rate is known modulo the ambiguity,
//! so each value that a person in a room may have begins a track; tracks that the ranges do not
//! follow are dropped.
//!
//! A track is confirmed when most of the last sub-apertures had it, or fewer with strong echoes, and
//! it has travelled at least [`MtiSettings::min_travel_m`]. Travel counts only the part of the range
//! rate beyond that of everything at rest. Vibrating or swaying objects have travel of both signs, or turn back. A
//! track is dropped when unseen for a while. Sub-apertures in which objects at rest may have the
//! same range rate count neither for nor against a track.
//!
//! The wearer's own hands move as well. No track begins within the hands' reach. With tracked hands
//! this is the range of the farther hand, because arms end in hands. A track that was confirmed
//! beyond it is followed nearer, with a narrower gate and never by echoes that a tracked hand
//! accounts for.
//!
//! Limits: the tracker cannot separate the wearer's legs, should they be in the beam and beyond the
//! hands' reach, two persons at one range, or a person who walks across the line of sight from
//! objects at rest.

mod track;

use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};

use super::hands::{HandTrail, hand_ranges_m};
use radar_sar::Beam;
use radar_sar::geometry::Pose;
use radar_sar::subaperture::{MtiEcho, MtiFilter, MtiResult, Subaperture};
use radar_sar::{BoundedSettings, SettingBound, bounds, math, outer};
use track::{Association, MtiTrack, candidate_speeds};

/// Parameters of the moving target indication (MTI).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MtiSettings {
    /// Whether moving targets are detected.
    pub enabled: bool,
    /// Share of sub-apertures in which noise may make a moving echo.
    pub alarms_per_subaperture: f64,
    /// A target is confirmed by this many echoes in the last six sub-apertures that could have it. A
    /// strong echo counts as up to two, one near the threshold as half.
    pub confirm_subapertures: usize,
    /// Radial travel of its own that confirms a target, metres.
    pub min_travel_m: f64,
    /// A track unseen for this long is dropped, seconds.
    pub drop_after_s: f64,
}

impl BoundedSettings for MtiSettings {
    const BOUNDS: &'static [SettingBound<Self>] = bounds![
        alarms_per_subaperture: 1e-6, 1.0;
        confirm_subapertures: 1.0, 6.0;
        min_travel_m: 0.0, 1.0;
        drop_after_s: 0.1, 10.0;
    ];
}

impl Default for MtiSettings {
    fn default() -> Self {
        Self {
            enabled: true,
            alarms_per_subaperture: 0.03,
            confirm_subapertures: 3,
            min_travel_m: 0.07,
            drop_after_s: 1.0,
        }
    }
}

/// A moving target. Its range is known; its direction is anywhere in the beam.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MovingTarget {
    /// Stays the same while the target is tracked.
    pub id: u64,
    /// Sensor pose at the last detection, `tracking_from_sensor`. Range and direction are relative
    /// to it, the direction along its boresight.
    pub seen_from: Pose,
    /// Predicted present range from there, metres.
    pub range_m: f64,
    /// 1σ of the range, metres.
    pub range_sigma_m: f64,
    /// 1σ of its direction about the boresight in either axis, radians: as wide as the beam.
    pub direction_sigma_rad: f64,
    /// Radial speed of its own, metres a second; positive: receding.
    pub speed_m_per_s: f64,
    /// Power of its last echo relative to everything else at its range.
    pub evidence: f64,
    /// Times of the first and last sub-aperture that had it, host nanoseconds.
    pub first_seen_ns: i64,
    /// See `first_seen_ns`.
    pub last_seen_ns: i64,
}

impl MovingTarget {
    /// The middle of the region that it may be in, tracking frame, metres.
    pub fn position_m(&self) -> DVec3 {
        self.seen_from.translation + self.seen_from.forward() * self.range_m
    }

    /// Covariance of that, m²: of the tangent plane, as for an obstacle whose range alone is known.
    pub fn covariance_m2(&self) -> DMat3 {
        let along = outer(self.seen_from.forward());
        let across_m = self.range_m * self.direction_sigma_rad;
        along * self.range_sigma_m.powi(2) + (DMat3::IDENTITY - along) * across_m.powi(2)
    }

    /// Half the width of the region that it may be in, radians about its `seen_from`: 2σ.
    pub fn half_width_rad(&self) -> f64 {
        2.0 * self.direction_sigma_rad
    }

    /// A point at its range, this far to the right of and above the boresight, radians, level
    /// however the sensor is rolled.
    pub fn place_m(&self, right_rad: f64, above_rad: f64) -> DVec3 {
        let ahead = self.seen_from.forward();
        let right = ahead.cross(DVec3::Y).try_normalize().unwrap_or(DVec3::X);
        let turned = DQuat::from_axis_angle(right.cross(ahead), -right_rad) * DQuat::from_axis_angle(right, above_rad);
        self.seen_from.translation + turned * ahead * self.range_m
    }

    /// The level arc that it lies on, from left to right, tracking frame, metres.
    pub fn arc_m(&self) -> impl Iterator<Item = DVec3> {
        /// Choice: the line stays within a centimetre of the arc at 3 m.
        const STEPS: i32 = 16;
        let step_rad = self.half_width_rad() / f64::from(STEPS / 2);
        (-STEPS / 2..=STEPS / 2).map(move |n| self.place_m(f64::from(n) * step_rad, 0.0))
    }

    /// Its label: distance from a head, and whether it approaches or recedes.
    pub fn label(&self, head: Option<&Pose>) -> String {
        let from = head.map_or(self.seen_from.translation, |head| head.translation);
        let way = match self.speed_m_per_s {
            speed if speed < -MIN_RADIAL_SPEED_M_PER_S => format!("comes at {:.1} m/s", -speed),
            speed if speed > MIN_RADIAL_SPEED_M_PER_S => format!("goes at {speed:.1} m/s"),
            _ => "passes".into(),
        };
        format!("moving {}  {:.1} m  {way}", self.id, self.position_m().distance(from))
    }

    /// The same in another frame: `to_from` transforms from this frame's coordinates.
    pub(super) fn moved(&self, to_from: &Pose) -> Self {
        Self { seen_from: *to_from * self.seen_from, ..*self }
    }
}

/// A target that approaches or recedes slower than this is labelled as passing, metres a second.
/// Choice: half of the speed's 1σ per echo; slower, the label's one decimal is noise.
const MIN_RADIAL_SPEED_M_PER_S: f64 = 0.15;
/// A track nearer than another by less than the first of these, or farther by less than the second,
/// belongs to the same body, metres. Choice: feet are farther than a chest.
const BODY_NEARER_M: f64 = 0.35;
const BODY_FARTHER_M: f64 = 0.7;
/// Most tracks. Further ones are not started. Choice: an echo begins up to five tracks, one for
/// each speed that it may have; three people and some false echoes fit.
const MAX_TRACKS: usize = 24;
/// A longer pause between sub-apertures ends all tracks, seconds. Choice: the default
/// `drop_after_s`, after which tracks end anyway.
const MAX_PAUSE_S: f64 = 1.0;

/// Tracks moving targets.
#[derive(Debug, Clone)]
pub struct MovingTargetTracker {
    settings: MtiSettings,
    mti_filter: MtiFilter,
    direction_sigma_rad: f64,
    tracks: Vec<MtiTrack>,
    next_id: u64,
    /// Time and pose of the newest sub-aperture.
    newest: Option<(i64, Pose)>,
}

impl MovingTargetTracker {
    /// Nothing tracked yet.
    pub fn new(settings: MtiSettings, beam: &Beam) -> Self {
        Self {
            mti_filter: MtiFilter::new(beam, settings.alarms_per_subaperture),
            direction_sigma_rad: direction_sigma_rad(beam),
            settings,
            tracks: Vec::new(),
            next_id: 0,
            newest: None,
        }
    }

    /// Adds a sub-aperture, in rising time. `hands_reach_m`: how far untracked hands reach, metres.
    pub fn push(&mut self, subaperture: &Subaperture, hands: &HandTrail, hands_reach_m: f64) {
        if self.settings.enabled {
            let reach_m = hand_reach_m(subaperture, hands, hands_reach_m);
            let mut movers = self.mti_filter.detect(subaperture);
            if let Some(movers) = &mut movers {
                movers.echoes.retain(|echo| !is_from_hand(echo, subaperture, hands));
            }
            self.advance(&subaperture.middle, subaperture.mid_time_ns, movers.as_ref(), reach_m);
        }
    }

    /// Time of the newest sub-aperture, host nanoseconds.
    pub fn newest_ns(&self) -> Option<i64> {
        self.newest.map(|(newest_ns, _)| newest_ns)
    }

    /// Confirmed targets, predicted to the time of the newest sub-aperture.
    pub fn targets(&self) -> Vec<MovingTarget> {
        let Some((now_ns, _)) = self.newest else { return Vec::new() };
        let moving = |track: &MtiTrack| {
            let unseen_s = now_ns.saturating_sub(track.last_ns) as f64 * 1e-9;
            Some(MovingTarget {
                id: track.id?,
                seen_from: track.seen_from,
                range_m: (track.seen_range_m + track.speed_m_per_s * unseen_s).max(0.1),
                range_sigma_m: track.covariance[0].sqrt(),
                direction_sigma_rad: self.direction_sigma_rad,
                speed_m_per_s: track.speed_m_per_s,
                evidence: track.evidence,
                first_seen_ns: track.first_ns,
                last_seen_ns: track.last_ns,
            })
        };
        self.tracks.iter().filter_map(moving).collect()
    }

    fn advance(&mut self, sensor: &Pose, now_ns: i64, movers: Option<&MtiResult>, reach_m: f64) {
        let before = self.newest.replace((now_ns, *sensor));
        if let Some((then_ns, then)) = before {
            let passed_s = now_ns.saturating_sub(then_ns) as f64 * 1e-9;
            if !(0.0..=MAX_PAUSE_S).contains(&passed_s) {
                self.tracks.clear();
            }
            let way = sensor.translation - then.translation;
            self.tracks.iter_mut().for_each(|track| track.predict(passed_s, way, &then));
        }
        if let Some(movers) = movers {
            self.assign_echoes(
                sensor,
                now_ns,
                movers,
                reach_m,
                before.map_or(0.0, |(then_ns, _)| now_ns.saturating_sub(then_ns) as f64 * 1e-9),
            );
        }
        let forget_ns = (self.settings.drop_after_s * 1e9) as i64;
        self.tracks.retain(|track| now_ns.saturating_sub(track.last_ns) < forget_ns && !track.is_abandoned());
        self.merge_same_body();
    }

    /// Each echo goes to the confirmed track that it fits best. If it fits no confirmed track, it
    /// goes to every other track that it fits. If it fits none at all and lies beyond the hands'
    /// reach, it begins a track.
    fn assign_echoes(&mut self, sensor: &Pose, now_ns: i64, movers: &MtiResult, reach_m: f64, passed_s: f64) {
        let mut seen_with_power = vec![None; self.tracks.len()];
        for echo in &movers.echoes {
            let unseen = self.tracks.iter().zip(&seen_with_power).enumerate().filter(|(_, (_, power))| power.is_none());
            let fitting: Vec<(usize, bool, Association)> = unseen
                .filter_map(|(n, (track, _))| Some((n, track.id.is_some(), track.associate(echo, movers, reach_m)?)))
                .collect();
            let confirmed = fitting.iter().filter(|(_, is_confirmed, _)| *is_confirmed);
            let best = confirmed.min_by(|a, b| a.2.distance2.total_cmp(&b.2.distance2)).map(|(n, ..)| *n);
            for (n, _, fit) in fitting.iter().filter(|(n, ..)| best.is_none_or(|best| best == *n)) {
                seen_with_power[*n] = Some(echo.power);
                self.tracks[*n].update(sensor, now_ns, echo, movers, fit, passed_s);
            }
            if fitting.is_empty() && echo.range_m >= reach_m {
                self.start_tracks(sensor, now_ns, echo, movers, passed_s);
            }
        }
        for (track, power) in self.tracks.iter_mut().zip(seen_with_power) {
            track.record_hit(power, movers);
        }
        let settings = self.settings;
        let far = |track: &MtiTrack| track.range_m >= reach_m;
        for track in
            self.tracks.iter_mut().filter(|track| track.id.is_none() && track.is_confirmable(&settings) && far(track))
        {
            self.next_id += 1;
            track.id = Some(self.next_id);
        }
    }

    /// One track for every value that the range rate may have.
    fn start_tracks(&mut self, sensor: &Pose, now_ns: i64, echo: &MtiEcho, movers: &MtiResult, passed_s: f64) {
        for speed_m_per_s in candidate_speeds(echo, movers) {
            if self.tracks.len() >= MAX_TRACKS {
                break;
            }
            self.tracks.push(MtiTrack::start(sensor, now_ns, echo, movers, (speed_m_per_s, passed_s)));
        }
    }

    /// Keeps one track of a body. A confirmed one stays; of several confirmed ones the nearest
    /// stays, under the id of the oldest.
    fn merge_same_body(&mut self) {
        let mut bodies: Vec<MtiTrack> = Vec::new();
        self.tracks.sort_by(|a, b| a.id.is_none().cmp(&b.id.is_none()).then(a.range_m.total_cmp(&b.range_m)));
        for track in std::mem::take(&mut self.tracks) {
            let is_of =
                |body: &&mut MtiTrack| (-BODY_NEARER_M..BODY_FARTHER_M).contains(&(track.range_m - body.range_m));
            match bodies.iter_mut().filter(|body| body.id.is_some()).find(is_of) {
                Some(body) if track.id.is_some() => {
                    body.id = body.id.min(track.id);
                    body.first_ns = body.first_ns.min(track.first_ns);
                }
                Some(_) => {}
                None => bodies.push(track),
            }
        }
        bodies.sort_by_key(|track| (track.id.unwrap_or(u64::MAX), track.first_ns));
        self.tracks = bodies;
    }
}

/// Range within which no track may begin: the reach of the hands, tracked or not.
fn hand_reach_m(subaperture: &Subaperture, hands: &HandTrail, hands_reach_m: f64) -> f64 {
    let hands = hands.at(subaperture.mid_time_ns);
    let reach_m =
        |hand: Option<DVec3>| hand.map_or(hands_reach_m, |hand| hand_ranges_m(subaperture.distance_m(hand)).end);
    hands.into_iter().map(reach_m).fold(0.0, f64::max)
}

/// Whether a tracked hand or its forearm accounts for the echo.
fn is_from_hand(echo: &MtiEcho, subaperture: &Subaperture, hands: &HandTrail) -> bool {
    let mut tracked = hands.at(subaperture.mid_time_ns).into_iter().flatten();
    tracked.any(|hand| hand_ranges_m(subaperture.distance_m(hand)).contains(&echo.range_m))
}

/// 1σ of an echo's direction about the boresight in either axis, weighted by the beam's power.
fn direction_sigma_rad(beam: &Beam) -> f64 {
    let angles = (0..=180).map(|degrees| f64::from(degrees).to_radians());
    let (sum, weight) = angles.fold((0.0, 0.0), |(sum, total), angle| {
        let weight = beam.amplitude(math::cos(angle)).powi(2) * math::sin(angle);
        (sum + 0.5 * angle * angle * weight, total + weight)
    });
    (sum / weight.max(f64::MIN_POSITIVE)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use radar_sar::Observation;
    use radar_sar::subaperture::{SubapertureBuilder, SubapertureSettings};
    use radar_sar::test_data::{Echo, sweeps};

    const STEP_NS: i64 = 90_000_000;

    /// What a sensor at rest measures of echoes at these (range, range rate).
    fn mti_result(echoes: &[(f64, f64)], ambiguity_m_per_s: f64) -> MtiResult {
        let echo = |&(range_m, rate): &(f64, f64)| {
            let turns = (rate / ambiguity_m_per_s).round();
            MtiEcho { range_m, range_rate_m_per_s: rate - turns * ambiguity_m_per_s, power: 30.0 }
        };
        MtiResult {
            echoes: echoes.iter().map(echo).collect(),
            clutter_m_per_s: [-0.05, 0.05],
            guard_m_per_s: 0.07,
            ahead_m_per_s: 0.0,
            ambiguity_m_per_s,
            ranges_m: [0.2, 3.1],
        }
    }

    fn tracks() -> MovingTargetTracker {
        MovingTargetTracker::new(MtiSettings::default(), &Beam::Lensless)
    }

    /// Confirmed targets after each of so many sub-apertures.
    fn targets_after_each(
        subapertures: i64,
        reach_m: f64,
        movers: impl Fn(f64) -> MtiResult,
    ) -> Vec<Vec<MovingTarget>> {
        let mut tracks = tracks();
        let step = |n: i64| {
            tracks.advance(&Pose::IDENTITY, n * STEP_NS, Some(&movers(n as f64 * 0.09)), reach_m);
            tracks.targets()
        };
        (0..subapertures).map(step).collect()
    }

    #[test]
    fn approaching_target_is_tracked_within_hand_reach_and_dropped_after_one_second() {
        let comes = |t: f64| mti_result(&if t < 1.8 { vec![(2.3 - t, -1.0)] } else { vec![] }, 2.8);
        let shown = targets_after_each(40, 0.9, comes);
        let first = shown.iter().position(|moving| !moving.is_empty()).unwrap();
        assert!(first <= 4, "{first}");
        for (n, moving) in shown.iter().enumerate().take(20).skip(first) {
            let [one] = moving[..] else { panic!("{n}: {moving:?}") };
            assert!((one.range_m - (2.3 - 0.09 * n as f64)).abs() < 0.05 && (one.speed_m_per_s + 1.0).abs() < 0.2);
            assert_eq!((one.id, one.first_seen_ns), (1, 0));
        }
        // Unseen although detectable, its speed is limited to those that objects at rest hide, so
        // it comes no nearer. After a second it is gone.
        assert!(shown[24][0].range_m > 0.3 && shown[33].is_empty(), "{:?}", shown[24]);
    }

    #[test]
    fn swaying_objects_hands_and_single_echoes_are_not_confirmed() {
        // Once a second to and fro, through 7.5 cm; and from one sub-aperture to the next.
        let sways = |t: f64| mti_result(&[(1.5, if t.fract() < 0.5 { 0.15 } else { -0.15 })], 2.8);
        assert_eq!(targets_after_each(100, 0.9, sways).concat(), []);
        let flutters = |t: f64| mti_result(&[(1.5, if (t * 100.0).round() as i64 % 2 == 0 { 0.3 } else { -0.3 })], 2.8);
        assert_eq!(targets_after_each(100, 0.9, flutters).concat(), []);
        let reaches = |t: f64| mti_result(&[(0.5 + 0.3 * (3.0 * t).sin(), 0.9 * (3.0 * t).cos())], 2.8);
        assert_eq!(targets_after_each(100, 0.9, reaches).concat(), []);
        let once = |t: f64| mti_result(&if (t % 0.9) < 0.09 { vec![(1.7, 0.6)] } else { vec![] }, 2.8);
        assert_eq!(targets_after_each(100, 0.9, once).concat(), []);
    }

    #[test]
    fn strong_echoes_confirm_sooner_than_weak_ones() {
        let first_shown = |power: f64| {
            let comes = |t: f64| {
                let mut movers = mti_result(&[(2.3 - t, -1.0)], 2.8);
                movers.echoes[0].power = power;
                movers
            };
            targets_after_each(8, 0.9, comes).iter().position(|moving| !moving.is_empty())
        };
        // Counted from the first echo: two that count double, three that count once, six near the threshold.
        assert_eq!([200.0, 26.0, 14.0].map(first_shown), [Some(1), Some(2), Some(5)]);
    }

    #[test]
    fn ranges_resolve_ambiguous_range_rates() {
        let comes = |t: f64| mti_result(&if t < 1.5 { vec![(2.6 - 1.2 * t, -1.2)] } else { vec![] }, 1.08);
        let shown = targets_after_each(16, 0.9, comes);
        let one = shown[12].first().unwrap();
        assert!((one.speed_m_per_s + 1.2).abs() < 0.25, "{one:?}");
        assert!((one.range_m - (2.6 - 1.2 * 0.09 * 12.0)).abs() < 0.15, "{one:?}");
    }

    #[test]
    fn parts_of_one_body_merge_and_two_people_stay_separate() {
        let body = |t: f64| mti_result(&[(1.4 + 0.5 * t, 0.5), (1.8 + 0.5 * t, 0.6)], 2.8);
        assert!(targets_after_each(20, 0.9, body).iter().all(|moving| moving.len() <= 1));
        let two = |t: f64| mti_result(&[(1.2 + 0.3 * t, 0.3), (2.8 - 0.3 * t, -0.4)], 2.8);
        assert!(targets_after_each(12, 0.9, two).iter().any(|moving| moving.len() == 2));
    }

    #[test]
    fn track_count_is_bounded_and_bad_times_are_harmless() {
        let mut tracks = tracks();
        for n in 0..200i64 {
            let echoes: Vec<_> = (0..50).map(|k| (f64::from(k) * 0.06 + 0.3, 1.0 - 0.04 * f64::from(k))).collect();
            let time_ns = if n % 50 == 49 { i64::MIN + n } else { n * STEP_NS };
            tracks.advance(&Pose::IDENTITY, time_ns, Some(&mti_result(&echoes, 0.4)), 0.9);
            assert!(tracks.tracks.len() <= MAX_TRACKS);
            assert!(tracks.targets().iter().all(|one| one.range_m.is_finite() && one.speed_m_per_s.is_finite()));
        }
    }

    #[test]
    fn covariance_is_narrow_in_range_and_beam_wide_across() {
        let shown = targets_after_each(8, 0.9, |t| mti_result(&[(2.3 - t, -1.0)], 2.8));
        let one = shown[7][0];
        let covariance = one.covariance_m2();
        assert!(covariance.z_axis.z.sqrt() < 0.15 && covariance.x_axis.x.sqrt() > 0.25 * one.range_m, "{covariance}");
        assert!((one.position_m() - DVec3::NEG_Z * one.range_m).length() < 1e-12);
        for point in one.arc_m() {
            assert!((point.length() - one.range_m).abs() < 1e-9 && point.y.abs() < 1e-9);
        }
        assert!(one.place_m(0.3, 0.0).x > 0.0 && one.place_m(0.0, 0.3).y > 0.0);
        let turned = one.moved(&Pose::new(DVec3::Y, DQuat::from_rotation_y(1.0)));
        let to_from = Pose::new(DVec3::Y, DQuat::from_rotation_y(1.0));
        assert!((turned.position_m() - to_from.transform_point(one.position_m())).length() < 1e-12);
        assert_eq!(one.label(None), format!("moving 1  {:.1} m  comes at 1.0 m/s", one.range_m));
    }

    /// A head that sways and steps.
    fn head(time_s: f64) -> DVec3 {
        DVec3::new(0.1 * (1.1 * time_s).sin(), 0.02 * (2.3 * time_s).sin(), 0.06 * (1.7 * time_s).cos())
    }

    /// Furniture and a wall, and a person whose middle is at `middle_m` while it is `Some`.
    fn room(duration_s: f64, middle_m: impl Fn(f64) -> Option<DVec3>, seed: u64) -> Vec<Observation> {
        let wall = radar_sar::geometry::Plane { outward: DVec3::NEG_Z, offset_m: 2.6 };
        let points = [(0.5, -0.4, -1.1, 20.0), (-0.6, 0.2, -1.5, 12.0), (0.1, -0.8, -1.9, 8.0)];
        let mut still = points.map(|(x, y, z, snr)| (Echo::Point(DVec3::new(x, y, z)), snr)).to_vec();
        still.push((Echo::Plane(wall), 30.0));
        let mut all = sweeps(duration_s, head, &still, seed);
        for (part, snr) in [(DVec3::ZERO, 1.0), (DVec3::new(0.15, 0.1, 0.05), 0.7), (DVec3::new(-0.1, -0.6, -0.1), 0.6)]
        {
            // Relative to the part, the head moves the other way.
            let from = |t: f64| head(t) - middle_m(t).unwrap_or(DVec3::splat(1e3)) - part;
            let moving = sweeps(duration_s, from, &[(Echo::Point(DVec3::ZERO), snr)], seed + 7);
            let samples = all
                .iter_mut()
                .zip(moving)
                .filter(|(one, _)| middle_m((one.mid_time_ns - 1_000_000_000) as f64 * 1e-9).is_some());
            samples.for_each(|(one, more)| one.samples.iter_mut().zip(more.samples).for_each(|(a, b)| *a += b));
        }
        all
    }

    /// Time and confirmed targets after each sub-aperture.
    fn timed_targets(observations: Vec<Observation>) -> Vec<(f64, Vec<MovingTarget>)> {
        let (mut builder, mut tracks) = (SubapertureBuilder::new(SubapertureSettings::default()), tracks());
        let subapertures: Vec<Subaperture> = observations.into_iter().filter_map(|o| builder.push(o)).collect();
        let watch = |subaperture: &Subaperture| {
            tracks.push(subaperture, &HandTrail::default(), 0.9);
            ((subaperture.end_ns - 1_000_000_000) as f64 * 1e-9, tracks.targets())
        };
        subapertures.iter().map(watch).collect()
    }

    #[test]
    fn person_crossing_at_two_metres_is_reported_within_one_second() {
        let middle_m = |t: f64| (1.0..4.0).contains(&t).then(|| DVec3::new(t - 2.5, 0.0, -2.0));
        for seed in [1, 2, 3] {
            let shown = timed_targets(room(6.0, middle_m, seed));
            let first_s = shown.iter().find(|(_, moving)| !moving.is_empty()).map(|(time_s, _)| *time_s);
            assert!(first_s.is_some_and(|time_s| (1.0..=2.0).contains(&time_s)), "{first_s:?}");
            for (time_s, moving) in shown.iter().filter(|(time_s, _)| (first_s.unwrap()..4.0).contains(time_s)) {
                for one in moving {
                    let range_m = middle_m(*time_s - 0.045).unwrap().distance(one.seen_from.translation);
                    assert!((one.range_m - range_m).abs() < 0.2, "{time_s}: {range_m} {one:?}");
                }
            }
            assert!(shown.iter().filter(|(time_s, _)| *time_s > 5.5).all(|(_, moving)| moving.is_empty()));
        }
    }

    #[test]
    fn static_room_and_reaching_hands_give_no_moving_target() {
        for seed in [4, 5] {
            assert!(timed_targets(room(10.0, |_| None, seed)).iter().all(|(_, moving)| moving.is_empty()));
        }
        let hand = |t: f64| Some(DVec3::new(0.15, -0.1, -0.5 - 0.25 * (4.0 * t).sin()));
        assert!(timed_targets(room(6.0, hand, 6)).iter().all(|(_, moving)| moving.is_empty()));
    }
}
