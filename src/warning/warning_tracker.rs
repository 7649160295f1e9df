//! Warnings from frame to frame: keeps obstacle geometries stable between scenes and follows the
//! wearer with the brightness.
//!
//! The radar image of a stationary object flickers at its edge: single voxels come and go between
//! map updates. Drawn directly, silhouettes would flicker and textures change several times a
//! second. So a geometry is kept while the newer one agrees with it. New and removed obstacles,
//! movement and growth apply at once. Other changes wait half a second, small ones two; times are
//! those of the scene.
//!
//! The brightness of a hazard is its urgency, dimmed by habituation, held at the edges and limited
//! in rate. A hazard that leaves the scene fades at its last position. One that returns with
//! another id at the same position continues. The sum of all brightness changes per frame is limited,
//! so that a map that appears in one frame does not flash.

use std::collections::{BTreeMap, BTreeSet};

use super::body_model::{BodyModel, PostureEstimator};
use super::hazard::{Hazard, HazardKey};
use super::obstacle_body::ObstacleBody;
use super::panel::{PanelKind, Shape, Warnings};
use super::settings::WarningSettings;
use super::warn::{MAX_QUADS, bodies, sorted_by_brightness};
use super::warning_state::WarningState;
use super::wearer::Wearer;
use radar_mapping::{Scene, Wall};

/// Movement or growth that applies at once, metres. Choice: more than the voxel edge, which is how
/// far the image flickers.
const IMMEDIATE_CHANGE_M: f64 = 0.075;
/// A geometry is kept for this time although a good part differs, nanoseconds. Choice: two updates
/// of the map, of which the second confirms the change.
const HOLD_NS: i64 = 500_000_000;
/// A geometry is kept for this time when little differs, nanoseconds. Choice: eight updates;
/// redrawing for a few voxels would make outlines crawl.
const LONG_HOLD_NS: i64 = 2_000_000_000;
/// Small difference: share of the points that only one of the two has. Choice: noise changes voxels
/// at the edges; a part that moved or was added changes more than a quarter.
const SMALL_DIFFERENCE: f64 = 0.25;
/// An obstacle with a new id within this distance of a removed one is the same, metres. Choice:
/// farther than a detection lies off, nearer than two pieces of furniture stand.
const SAME_OBSTACLE_M: f64 = 0.25;
/// Cosine above which the normals of two walls are the same (8°). Choice: above the 6° by which a
/// new wall's direction may be off, below any corner's angle.
const SAME_WALL_COSINE: f64 = 0.99;
/// Duration assumed for the first frame and for one after a pause, seconds. Choice: a frame at 90
/// Hz.
const FIRST_FRAME_S: f64 = 0.011;
/// Longest duration counted for a frame, seconds, so that nothing flashes after a stall. Choice:
/// half of the rise from dark to full.
const MAX_FRAME_S: f64 = 0.05;
/// After a longer pause all warnings start dark, nanoseconds. Choice: the wearer has moved on; old
/// brightnesses mean nothing.
const PAUSE_NS: i64 = 500_000_000;
/// Limit of the summed brightness change of all panels per second: one and a half panels at full
/// rise. Choice: more would be a flash of the whole view, as when a room's map is restored.
const MAX_TOTAL_CHANGE_PER_S: f64 = 15.0;
/// Bonus that keeps a shown warning among the eight against slightly more urgent ones. Choice: more
/// than urgencies vary by sway, less than one step towards an obstacle.
const SHOWN_BONUS: f64 = 0.1;

/// Tracks the warnings of a scene. Deterministic: the same scenes and wearers in the same order
/// give the same warnings.
#[derive(Debug, Clone, Default)]
pub struct WarningTracker {
    held: Vec<StableBody>,
    /// Geometries that left the scene recently; they may return.
    gone: Vec<StableBody>,
    walls: Vec<(Wall, u64)>,
    states: BTreeMap<HazardKey, WarningState>,
    posture: PostureEstimator,
    last_ns: Option<i64>,
    /// Counts changes of hazards.
    versions: u64,
}

#[derive(Debug, Clone)]
struct StableBody {
    body: ObstacleBody,
    since_ns: i64,
    /// Time of the last scene that contained it.
    seen_ns: i64,
    /// Differs from before when the hazard has changed.
    version: u64,
}

impl WarningTracker {
    /// Without any history.
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes the newest scene.
    pub fn update(&mut self, scene: &Scene) {
        self.versions += 1;
        let mut before = std::mem::take(&mut self.held);
        before.append(&mut self.gone);
        let mut newer = bodies(scene);
        newer.sort_by_key(|body| body.id);
        let mut taken: BTreeSet<u64> = newer.iter().map(|body| body.id).collect();
        for body in newer {
            let by_position = |held: &&StableBody| !taken.contains(&held.body.id) && held.is_replaced_by(&body);
            let known = before.iter().find(|held| held.body.id == body.id).or_else(|| before.iter().find(by_position));
            if let Some(known) = known {
                taken.insert(known.body.id);
                self.rename(HazardKey::Object(known.body.id), HazardKey::Object(body.id));
            }
            self.held.push(StableBody::of(body, known, scene.time_ns, self.versions));
        }
        let is_recent = |held: &StableBody| (0..LONG_HOLD_NS).contains(&scene.time_ns.saturating_sub(held.seen_ns));
        before.retain(|held| !taken.contains(&held.body.id) && is_recent(held));
        self.gone = before;
        self.update_walls(&scene.walls);
    }

    fn update_walls(&mut self, walls: &[Wall]) {
        let before = std::mem::take(&mut self.walls);
        let gone: Vec<_> = before.iter().filter(|(old, _)| !walls.iter().any(|wall| wall.id == old.id)).collect();
        let mut taken = BTreeSet::new();
        for wall in walls {
            let known = before.iter().find(|(old, _)| old.id == wall.id);
            let known =
                known.or_else(|| gone.iter().find(|(old, _)| is_same(old, wall) && taken.insert(old.id)).copied());
            if let Some((old, _)) = known {
                self.rename(HazardKey::Wall(old.id), HazardKey::Wall(wall.id));
            }
            let version = known.filter(|(old, _)| is_same(old, wall)).map_or(self.versions, |(_, version)| *version);
            self.walls.push((wall.clone(), version));
        }
    }

    /// Moves the warning state from one key to another.
    fn rename(&mut self, from: HazardKey, to: HazardKey) {
        if from == to {
            return;
        }
        if let Some(mut state) = self.states.remove(&from) {
            let (HazardKey::Object(id) | HazardKey::Wall(id)) = to;
            state.drawn.iter_mut().for_each(|drawn| drawn.set_id(id));
            self.states.insert(to, state);
        }
    }

    /// What to draw for the wearer now. Brightness starts dark and rises within 0.1 s; call it
    /// every frame. A wearer with an invalid head position gives nothing. With
    /// [`WarningSettings::labels`] the panels carry the gap between body and hazard as a label.
    pub fn warn(&mut self, wearer: &Wearer, settings: &WarningSettings) -> Warnings {
        let Some(body_model) = self.posture.update(wearer) else { return Warnings::default() };
        let now_ns = wearer.time_ns;
        let passed_s = self.passed_s(now_ns);
        self.update_states(now_ns, &body_model, settings);
        let changes: Vec<f64> = self.states.values().map(|state| state.change(passed_s, body_model.head_m)).collect();
        let sum: f64 = changes.iter().map(|change| change.abs()).sum();
        let slowed = (MAX_TOTAL_CHANGE_PER_S * passed_s / sum.max(1e-12)).min(1.0);
        for (state, change) in self.states.values_mut().zip(changes) {
            state.shown = (state.shown + slowed * change).clamp(0.0, 1.0);
        }
        self.states.retain(|_, state| !state.is_over());
        sorted_by_brightness(self.states.values().filter_map(|state| state.visual(settings)))
    }

    /// Counted seconds since the last frame.
    fn passed_s(&mut self, now_ns: i64) -> f64 {
        let passed_ns = self.last_ns.map(|then_ns| now_ns.saturating_sub(then_ns));
        self.last_ns = Some(now_ns);
        match passed_ns {
            Some(ns) if ns <= 0 => 0.0,
            Some(ns) if ns <= PAUSE_NS => (ns as f64 * 1e-9).min(MAX_FRAME_S),
            _ => {
                self.states.values_mut().for_each(|state| state.shown = 0.0);
                FIRST_FRAME_S
            }
        }
    }

    /// Updates the wanted brightness of every hazard, and the visuals of those that are shown.
    fn update_states(&mut self, now_ns: i64, body_model: &BodyModel, settings: &WarningSettings) {
        let bodies = self.held.iter().map(|held| (Hazard::Object(&held.body), held.version));
        let walls = self.walls.iter().map(|(wall, version)| (Hazard::Wall(wall), *version));
        let mut there = BTreeMap::new();
        for (hazard, version) in bodies.chain(walls) {
            let state = self.states.entry(hazard.key()).or_insert_with(|| WarningState::new(version));
            state.update(now_ns, &hazard, version, body_model, settings);
            there.insert(hazard.key(), hazard);
        }
        for (_, state) in self.states.iter_mut().filter(|(key, _)| !there.contains_key(key)) {
            state.mark_missing(now_ns);
        }
        let draw = |key: &HazardKey, state: &mut WarningState| {
            if let Some(hazard) = there.get(key) {
                state.update_visual(now_ns, hazard, body_model, settings);
            }
        };
        draw_most_urgent(&mut self.states, draw);
    }

    /// Shapes of the obstacles that have panels, in the order of the panels.
    pub fn shapes(&self, warnings: &Warnings) -> Vec<Shape> {
        let objects = warnings.panels.iter().filter(|panel| panel.kind != PanelKind::Wall);
        let shape = |panel: &super::Panel| {
            let shape = self.states.get(&HazardKey::Object(panel.id))?.drawn.as_ref()?.shape.clone()?;
            Some(Shape { alpha: panel.alpha, ..shape })
        };
        objects.filter_map(shape).collect()
    }

    /// Drops all history: for another room.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// The room is the same but its frame has changed: drops all positions and keeps the
    /// brightness, so that recentring does not blink. The next scene and wearer must be in the new
    /// frame.
    pub fn change_frame(&mut self) {
        (self.held, self.gone, self.walls) = (Vec::new(), Vec::new(), Vec::new());
        self.posture = PostureEstimator::default();
        self.states.values_mut().for_each(|state| state.drawn = None);
    }
}

/// Only [`MAX_QUADS`] can be shown, those with something to draw: the others fade out. What stays dark is not drawn, since that
/// takes most of a frame's time where many hazards are near.
fn draw_most_urgent(states: &mut BTreeMap<HazardKey, WarningState>, draw: impl Fn(&HazardKey, &mut WarningState)) {
    let rank = |state: &WarningState| state.wanted + if state.shown > 0.0 { SHOWN_BONUS } else { 0.0 };
    let mut by_rank: Vec<(f64, HazardKey, &mut WarningState)> =
        states.iter_mut().map(|(key, state)| (rank(state), *key, state)).filter(|(rank, ..)| *rank > 0.0).collect();
    by_rank.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut count = 0;
    for (_, key, state) in by_rank {
        if count == MAX_QUADS {
            state.wanted = 0.0;
        }
        if state.wanted > 0.0 || state.shown > 0.0 {
            draw(&key, state);
        }
        count += usize::from(state.wanted > 0.0);
    }
}

fn is_same(a: &Wall, b: &Wall) -> bool {
    let middle = a.plane.foot(a.seen_at.center());
    a.plane.outward.dot(b.plane.outward) > SAME_WALL_COSINE && b.plane.distance(middle).abs() < IMMEDIATE_CHANGE_M
}

impl StableBody {
    /// The new geometry, or the previous one where it is kept.
    fn of(body: ObstacleBody, known: Option<&StableBody>, now_ns: i64, version: u64) -> Self {
        let Some(known) = known else { return Self { body, since_ns: now_ns, seen_ns: now_ns, version } };
        let age_ns = now_ns.saturating_sub(known.since_ns);
        if age_ns < 0 || !known.is_similar_to(&body) {
            Self { body, since_ns: now_ns, seen_ns: now_ns, version }
        } else if known.stays_over(&body, age_ns) {
            Self { body: known.body.with_identity_of(&body), seen_ns: now_ns, ..*known }
        } else {
            Self { body, since_ns: now_ns, seen_ns: now_ns, version: known.version }
        }
    }

    /// Whether a geometry with another id is the same obstacle.
    fn is_replaced_by(&self, body: &ObstacleBody) -> bool {
        let (old, new) = (&self.body, body);
        let apart = (old.around.min - new.around.max).max(new.around.min - old.around.max).max_element();
        old.approach_m_per_s.is_none()
            && new.approach_m_per_s.is_none()
            && old.has_shape == new.has_shape
            && apart <= IMMEDIATE_CHANGE_M
            && old.anchor.distance(new.anchor) <= SAME_OBSTACLE_M
    }

    /// Whether the new geometry has no change that must apply at once.
    fn is_similar_to(&self, new: &ObstacleBody) -> bool {
        if new.approach_m_per_s.is_some() {
            return false;
        }
        let old = &self.body;
        let growth = (old.around.min - new.around.min).max(new.around.max - old.around.max).max_element();
        old.has_shape == new.has_shape
            && old.anchor.distance(new.anchor) <= IMMEDIATE_CHANGE_M
            && growth <= IMMEDIATE_CHANGE_M
    }

    /// Whether this geometry is kept at this age instead of a similar newer one.
    fn stays_over(&self, new: &ObstacleBody, age_ns: i64) -> bool {
        let old = &self.body;
        age_ns < if difference(old, new) > SMALL_DIFFERENCE { HOLD_NS } else { LONG_HOLD_NS }
    }
}

/// Share of the points that only one of the two has.
fn difference(a: &ObstacleBody, b: &ObstacleBody) -> f64 {
    let cells = |body: &ObstacleBody| -> BTreeSet<[i64; 3]> {
        body.points.iter().map(|p| (*p * 100.0).round().to_array().map(|v| v as i64)).collect()
    };
    let (a, b) = (cells(a), cells(b));
    let either = a.union(&b).count();
    a.symmetric_difference(&b).count() as f64 / either.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::warning::BodyPart;
    use glam::{DMat3, DVec3};
    use radar_mapping::{Observed, Obstacle};
    use radar_sar::geometry::Pose;

    /// A column of voxels of 5 cm, ten wide and twenty high, 0.8 m ahead.
    fn column(id: u64, x: f64) -> Obstacle {
        let shape = (0..200).map(|i| (DVec3::new(x + f64::from(i % 10) * 0.05, f64::from(i / 10) * 0.05, -0.8), 1.0));
        Obstacle {
            id,
            position_m: DVec3::new(x + 0.25, 0.5, -0.8),
            covariance_m2: DMat3::IDENTITY * 1e-6,
            observed: Observed::Position,
            extent_m: DVec3::ZERO,
            evidence: 10.0,
            shape: shape.collect(),
            provisional: false,
            first_seen_ns: 0,
            last_seen_ns: 0,
        }
    }

    fn scene(time_s: f64, obstacles: Vec<Obstacle>) -> Scene {
        Scene { time_ns: (time_s * 1e9) as i64, obstacles, walls: vec![], moving: vec![] }
    }

    /// Enough frames for all brightness to settle.
    const SETTLE: i64 = 150;
    const FRAME_NS: i64 = 11_000_000;

    fn stands(time_ns: i64) -> Wearer {
        Wearer::head_only(time_ns, Pose::from_translation(DVec3::new(0.0, 1.6, 0.0)))
    }

    fn seen(tracker: &mut WarningTracker, scene: &Scene) -> Warnings {
        tracker.update(scene);
        let from_ns = tracker.last_ns.unwrap_or(0);
        let all =
            (1..=SETTLE).map(|frame| tracker.warn(&stands(from_ns + frame * FRAME_NS), &WarningSettings::default()));
        all.last().unwrap()
    }

    #[test]
    fn small_shape_changes_apply_after_two_seconds() {
        let mut tracker = WarningTracker::new();
        let first = seen(&mut tracker, &scene(0.0, vec![column(1, 0.0)]));
        let mut flickers = column(1, 0.0);
        flickers.shape.truncate(190);
        flickers.position_m.x += 0.01;
        assert_eq!(seen(&mut tracker, &scene(1.9, vec![flickers.clone()])), first);
        let later = seen(&mut tracker, &scene(2.0, vec![flickers.clone()]));
        assert_ne!(later, first);
        assert_eq!(later, seen(&mut WarningTracker::new(), &scene(2.0, vec![flickers])));
    }

    #[test]
    fn shrinking_waits_half_a_second_and_growth_is_immediate() {
        let mut tracker = WarningTracker::new();
        let whole = seen(&mut tracker, &scene(0.0, vec![column(1, 0.0)]));
        let mut half = column(1, 0.0);
        half.shape.truncate(100);
        assert_eq!(seen(&mut tracker, &scene(0.4, vec![half.clone()])), whole);
        assert_ne!(seen(&mut tracker, &scene(0.5, vec![half])), whole);
        assert_eq!(seen(&mut tracker, &scene(0.6, vec![column(1, 0.0)])), whole);
    }

    #[test]
    fn moves_arrivals_and_removals_are_immediate() {
        let mut tracker = WarningTracker::new();
        let first = seen(&mut tracker, &scene(0.0, vec![column(1, 0.0)]));
        let moved = seen(&mut tracker, &scene(0.1, vec![column(1, 0.1)]));
        assert_ne!(moved, first);
        assert_eq!(moved, seen(&mut WarningTracker::new(), &scene(0.1, vec![column(1, 0.1)])));
        assert_eq!(seen(&mut tracker, &scene(0.2, vec![column(1, 0.1), column(2, -1.2)])).panels.len(), 2);
        assert_eq!(seen(&mut tracker, &scene(0.3, vec![])), Warnings::default());
        tracker.update(&scene(0.4, vec![column(1, 0.0)]));
        tracker.reset();
        assert_eq!(tracker.warn(&stands(0), &WarningSettings::default()), Warnings::default());
    }

    #[test]
    fn backward_time_holds_no_body() {
        let mut tracker = WarningTracker::new();
        seen(&mut tracker, &scene(10.0, vec![column(1, 0.0)]));
        let mut other = column(1, 0.0);
        other.shape.truncate(199);
        let early = scene(1.0, vec![other]);
        assert_eq!(seen(&mut tracker, &early), seen(&mut WarningTracker::new(), &early));
    }

    #[test]
    fn evidence_changes_keep_the_body() {
        let (a, b) = (column(1, 0.0), column(2, 0.55));
        let (mut weak, mut strong) = (a.clone(), b.clone());
        (weak.evidence, strong.evidence) = (9.0, 11.0);
        let once = seen(&mut WarningTracker::new(), &scene(0.0, vec![a, b]));
        assert_eq!((once.panels.len(), once.panels[0].id), (1, 1), "one group, named after the one known longest");
        assert_eq!(once, seen(&mut WarningTracker::new(), &scene(0.0, vec![strong, weak])));
    }

    #[test]
    fn shapes_follow_the_panel_order() {
        let mut tracker = WarningTracker::new();
        let warnings = seen(&mut tracker, &scene(0.0, vec![column(1, 0.0), column(7, 30.0)]));
        let shapes = tracker.shapes(&warnings);
        assert_eq!((shapes.len(), shapes[0].id, shapes[0].points_m.len()), (1, 1, 200));
        assert_eq!(shapes[0].alpha, warnings.panels[0].alpha);
        let bare = warnings.without_silhouettes();
        assert_eq!((bare.panels[0].kind, bare.panels[0].silhouette.len()), (PanelKind::Pane, 0));
        assert_eq!(tracker.shapes(&bare), shapes);
    }

    /// Brightness of each frame while the wearer follows a path over time in seconds.
    fn alphas(tracker: &mut WarningTracker, frames: std::ops::Range<i64>, head_at: impl Fn(f64) -> DVec3) -> Vec<f64> {
        let settings = WarningSettings::default();
        let alpha = |frame: i64| {
            let time_ns = frame * FRAME_NS;
            let pose = Pose::from_translation(head_at(time_ns as f64 * 1e-9));
            let warnings = tracker.warn(&Wearer::head_only(time_ns, pose), &settings);
            warnings.panels.first().map_or(0.0, |panel| f64::from(panel.alpha))
        };
        frames.map(alpha).collect()
    }

    fn wall(id: u64, ahead_m: f64) -> Wall {
        let plane = radar_sar::geometry::Plane { outward: DVec3::NEG_Z, offset_m: ahead_m };
        let seen_at =
            radar_sar::geometry::Aabb::from_corners(DVec3::new(-2.0, 1.5, -ahead_m), DVec3::new(2.0, 1.7, -ahead_m));
        Wall { id, plane, evidence: 5.0, seen_at, provisional: false, first_seen_ns: 0, last_seen_ns: 0 }
    }

    fn before_a_wall(ahead_m: f64) -> WarningTracker {
        let mut tracker = WarningTracker::new();
        tracker.update(&Scene { time_ns: 0, obstacles: vec![], walls: vec![wall(1, ahead_m)], moving: vec![] });
        tracker
    }

    #[test]
    fn running_is_warned_before_walking() {
        let lit_from_m = |speed_m_per_s: f64| {
            let head_at = |time_s: f64| DVec3::new(0.0, 1.6, -(time_s - 1.0).max(0.0) * speed_m_per_s);
            let lit = alphas(&mut before_a_wall(3.5), 0..600, head_at);
            let frame = lit.iter().position(|alpha| *alpha > 0.1).unwrap();
            3.5 + head_at(frame as f64 * FRAME_NS as f64 * 1e-9).z
        };
        let (strolls_m, walks_m, runs_m) = (lit_from_m(0.6), lit_from_m(1.3), lit_from_m(2.5));
        assert!(strolls_m > 1.2 && strolls_m < 1.5, "{strolls_m}");
        assert!(walks_m > strolls_m + 0.2 && runs_m > walks_m + 0.8, "{strolls_m} {walks_m} {runs_m}");
    }

    #[test]
    fn standing_still_dims_and_approaching_restores_warnings() {
        let mut tracker = before_a_wall(0.8);
        let sways = |time_s: f64| DVec3::new(0.0, 1.6, 0.02 * (2.0 * time_s).sin());
        let stood = alphas(&mut tracker, 0..1000, sways);
        let dim = stood[999] / stood[300];
        assert!((0.2..0.45).contains(&dim), "{} of {}", stood[999], stood[300]);
        assert!(stood[300..].windows(2).all(|pair| (pair[0] - pair[1]).abs() < 0.05));
        let goes = |time_s: f64| sways(time_s) - DVec3::Z * (time_s - 11.0).max(0.0) * 0.6;
        let went = alphas(&mut tracker, 1000..1040, goes);
        assert!(went[27] > stood[300], "a quarter of a second and 18 cm later: {went:?}");
        let mut nearer = before_a_wall(0.2);
        let close = alphas(&mut nearer, 0..1000, |_| DVec3::Y * 1.6);
        assert!(
            (close[999] - 0.65).abs() < 0.02,
            "dims by half as much halfway into the full distance: {}",
            close[999]
        );
    }

    #[test]
    fn contact_never_dims() {
        for beyond_m in [0.0, 0.2, 0.45] {
            let lit = alphas(&mut before_a_wall(0.5), 0..1200, |_| DVec3::new(0.0, 1.6, -0.5 - beyond_m));
            assert_eq!(lit[1199], 1.0, "{beyond_m} m beyond");
        }
        let far = alphas(&mut before_a_wall(0.5), 0..100, |_| DVec3::new(0.0, 1.6, -0.5 - 2.1));
        assert_eq!(far[99], 0.0);
        let mut hollow = column(1, -0.5);
        hollow.shape.extend(hollow.shape.clone().iter().map(|(p, s)| (*p - DVec3::Z * 0.9, *s)));
        let mut tracker = WarningTracker::new();
        tracker.update(&scene(0.0, vec![hollow]));
        let within = alphas(&mut tracker, 0..1200, |_| DVec3::new(-0.3, 1.6, -1.25));
        assert_eq!(within[1199], 1.0);
    }

    #[test]
    fn hand_swing_brightens_the_obstacle() {
        let mut tracker = WarningTracker::new();
        tracker.update(&scene(0.0, vec![column(1, -0.25)]));
        let settings = WarningSettings { fade_distance_m: 0.6, ..Default::default() };
        let mut lit = Vec::new();
        for frame in 0..100 {
            let reach_m = if frame < 60 { 0.0 } else { 0.025 * f64::from(frame - 60) };
            let hand = DVec3::new(0.2, 0.8, -0.1 - reach_m.min(0.5));
            let wearer = Wearer { hands_m: [None, Some(hand)], ..stands(i64::from(frame) * FRAME_NS) };
            let warnings = tracker.warn(&wearer, &settings);
            lit.push(warnings.panels.first().map(|panel| (panel.alpha, panel.nearest_part, panel.time_to_contact_s)));
        }
        assert_eq!(lit[59], None, "a hand at rest 0.6 m away");
        let (alpha, part, time_s) = lit[72].unwrap();
        assert!(alpha > 0.4 && part == BodyPart::RightHand && time_s.unwrap() < 0.5, "{alpha} {time_s:?}");
    }

    #[test]
    fn new_warnings_fade_in() {
        let mut all: Vec<Obstacle> = (0..8).map(|n| column(n, 1.3 * n as f64 - 5.0)).collect();
        for (n, hazard) in all.iter_mut().enumerate() {
            let away = DVec3::new(-1.3 * n as f64 + 4.75, 0.0, 0.8);
            let to = glam::DQuat::from_rotation_y(n as f64 * 0.785) * DVec3::new(0.0, 0.0, -0.75);
            hazard.position_m += away + to;
            hazard.shape.iter_mut().for_each(|(point, _)| *point += away + to);
        }
        let mut tracker = WarningTracker::new();
        tracker.update(&scene(0.0, all));
        let (mut sums, settings) = (Vec::new(), WarningSettings::default());
        for frame in 0..100 {
            // A pause and a stumble of the frame loop in the middle.
            let time_ns = frame * FRAME_NS
                + if frame > 60 { 300_000_000 } else { 0 }
                + if frame > 80 { 5_000_000_000 } else { 0 };
            let warnings = tracker.warn(&stands(time_ns), &settings);
            sums.push(warnings.panels.iter().map(|panel| f64::from(panel.alpha)).sum::<f64>());
        }
        let rises = sums.windows(2).map(|pair| pair[1] - pair[0]);
        assert!(sums[50] > 3.0 && rises.fold(0.0, f64::max) <= MAX_TOTAL_CHANGE_PER_S * MAX_FRAME_S + 1e-6, "{sums:?}");
        assert!(sums[81] < 0.2, "after a long pause it begins in the dark");
        let wide = alphas(&mut before_a_wall(0.35), 0..60, |_| DVec3::Y * 1.6);
        let full = wide.iter().position(|alpha| *alpha >= 0.95).unwrap() as f64 * FRAME_NS as f64 * 1e-9;
        assert!((0.2..0.3).contains(&full), "{full} s");
    }

    #[test]
    fn only_what_can_be_shown_is_drawn() {
        let turned = |n: u64| glam::DQuat::from_rotation_y(n as f64 * 0.62);
        let post = |n: u64| {
            let shape = (0..20).map(|i| (turned(n) * DVec3::new(0.0, f64::from(i) * 0.05, -1.2), 1.0)).collect();
            Obstacle { position_m: turned(n) * DVec3::new(0.0, 0.5, -1.2), shape, ..column(n, 0.0) }
        };
        let mut tracker = WarningTracker::new();
        let warnings = seen(&mut tracker, &scene(0.0, (0..10).map(post).collect()));
        assert_eq!((warnings.panels.len(), tracker.states.len()), (MAX_QUADS, 10), "all are near enough");
        assert_eq!(tracker.states.values().filter(|state| state.drawn.is_some()).count(), MAX_QUADS);
    }

    #[test]
    fn missing_obstacles_fade_and_renamed_ones_continue() {
        let mut tracker = WarningTracker::new();
        let before = seen(&mut tracker, &scene(0.0, vec![column(1, 0.0)]));
        let from = tracker.last_ns.unwrap() / FRAME_NS + 1;
        tracker.update(&scene(0.25, vec![column(7, 0.02)]));
        let renamed = tracker.warn(&stands(from * FRAME_NS), &WarningSettings::default());
        assert_eq!((renamed.panels[0].id, renamed.panels[0].alpha), (7, before.panels[0].alpha));
        assert_eq!(renamed.panels[0].silhouette, before.panels[0].silhouette, "not drawn anew");
        tracker.update(&scene(0.5, vec![]));
        let fading = alphas(&mut tracker, from + 1..from + 80, |_| DVec3::Y * 1.6);
        assert_eq!(f64::from(before.panels[0].alpha), fading[40], "held for two updates");
        assert!(
            fading.windows(2).all(|pair| pair[0] - pair[1] < 0.05 && pair[0] >= pair[1]) && fading[78] == 0.0,
            "{fading:?}"
        );
    }

    #[test]
    fn noise_at_the_fade_distance_does_not_flicker() {
        let mut state = 1u64;
        let mut noise = move || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) as f64 / f64::from(1u32 << 31)
        };
        // At the fade distance, with 4 cm of jitter, missing in every fifth update and renamed in
        // every tenth.
        let mut tracker = WarningTracker::new();
        let (mut lit, mut id) = (Vec::new(), 1);
        let settings = WarningSettings::default();
        for frame in 0..(60 * 90) {
            if frame % 22 == 0 {
                id += u64::from(noise() < 0.1);
                let mut hazard = column(id, -0.25);
                let jitter = DVec3::new(noise() - 0.5, noise() - 0.5, noise() - 0.5) * 0.08 - DVec3::Z * 0.67;
                hazard.position_m += jitter;
                hazard.shape.iter_mut().for_each(|(point, _)| *point += jitter);
                let there = noise() > 0.2;
                tracker.update(&scene(frame as f64 * 0.011, if there { vec![hazard] } else { vec![] }));
            }
            let sway = DVec3::new(0.0, 1.6, 0.01 * (frame as f64 * 0.02).sin());
            let wearer = Wearer::head_only(frame * FRAME_NS, Pose::from_translation(sway));
            lit.push(tracker.warn(&wearer, &settings).panels.first().map_or(0.0, |panel| f64::from(panel.alpha)));
        }
        let switches = lit.windows(2).filter(|pair| (pair[0] > 0.0) != (pair[1] > 0.0)).count();
        // A visible reversal: the brightness turned by more than 3 % of full.
        let (mut reversals, mut turned_at, mut rising) = (0, lit[0], true);
        for alpha in &lit {
            turned_at = if rising { alpha.max(turned_at) } else { alpha.min(turned_at) };
            if (alpha - turned_at).abs() > 0.03 {
                (reversals, turned_at, rising) = (reversals + 1, *alpha, !rising);
            }
        }
        println!("{switches} switches, {reversals} reversals in a minute");
        assert!(switches <= 5 && reversals <= 6, "{switches} switches, {reversals} reversals in a minute");
    }

    #[test]
    fn tracker_is_deterministic_and_tolerates_bad_times() {
        let times = [0, 11, 22, 22, 22, 10, 21, 5000, 5011, -9_000_000_000_000, i64::MAX / 1_000_000, 33];
        let play = || {
            let mut tracker = WarningTracker::new();
            tracker.update(&scene(0.0, vec![column(1, 0.0), column(2, -1.2)]));
            let at =
                |time_ms: i64| tracker.warn(&stands(time_ms.saturating_mul(1_000_000)), &WarningSettings::default());
            times.map(at)
        };
        let once = play();
        assert_eq!(once, play());
        assert_eq!(once[3], once[2], "time stands still");
        assert!(once.iter().flat_map(|w| &w.panels).all(|panel| (0.0..=1.0).contains(&panel.alpha)));
    }

    #[test]
    fn frame_change_keeps_brightness() {
        let mut tracker = WarningTracker::new();
        let first = scene(0.0, vec![column(1, 0.0)]);
        let before = seen(&mut tracker, &first);
        tracker.change_frame();
        let turned = Pose::new(DVec3::new(2.0, 0.0, 1.0), glam::DQuat::from_rotation_y(1.0));
        tracker.update(&first.moved(&turned));
        let head = turned * Pose::from_translation(DVec3::new(0.0, 1.6, 0.0));
        let wearer = Wearer::head_only(tracker.last_ns.unwrap() + FRAME_NS, head);
        let after = tracker.warn(&wearer, &WarningSettings::default());
        assert_eq!(after.panels[0].alpha, before.panels[0].alpha);
        let expected = turned.transform_point(before.panels[0].tracking_from_panel.translation);
        assert!(after.panels[0].tracking_from_panel.translation.distance(expected) < 0.15);
    }
}
