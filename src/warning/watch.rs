//! Warnings from frame to frame: bodies are made once a scene, and stay as they are while nothing speaks against it.
//!
//! A radar's image of a thing that stands still flickers at its rim: from look to look single voxels come and go. Drawn as they
//! are, silhouettes would twinkle and every picture be drawn anew several times a second. So a body is kept while the
//! newer one agrees with it. What matters at once is taken at once: what is new, what is gone, what has moved, and what
//! reaches farther than before. The rest waits half a second, small changes two; times are those of the scene.

use std::collections::BTreeSet;

use glam::DVec3;

use super::body::Body;
use super::panel::{PanelKind, Shape, Warnings};
use super::player::Player;
use super::settings::WarningSettings;
use super::warn::{bodies, warn_of};
use crate::obstacles::{Scene, Wall};

/// Movement or growth beyond this is taken at once, metres: more than the voxels' edge, which is how far the rim flickers.
const AT_ONCE_M: f64 = 0.075;
/// A body stays for so long although a good part of it differs, nanoseconds.
const HOLD_NS: i64 = 500_000_000;
/// It stays for so long when little differs.
const LONG_HOLD_NS: i64 = 2_000_000_000;
/// Little: this share of all places that either has.
const LITTLE: f64 = 0.25;

/// A scene that is being watched. The same scenes and heads in the same order give the same warnings.
#[derive(Debug, Clone, Default)]
pub struct Watch {
    held: Vec<Held>,
    walls: Vec<Wall>,
}

#[derive(Debug, Clone)]
struct Held {
    body: Body,
    since_ns: i64,
}

impl Watch {
    /// Nothing seen yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes the newest scene.
    pub fn see(&mut self, scene: &Scene) {
        let before = std::mem::take(&mut self.held);
        let steady = |body: Body| {
            let fresh = Held { since_ns: scene.time_ns, body };
            let known = before.iter().find(|held| held.body.id == fresh.body.id);
            known.filter(|held| held.outlasts(&fresh)).cloned().unwrap_or(fresh)
        };
        self.held = bodies(&scene.obstacles).into_iter().map(steady).collect();
        self.walls.clone_from(&scene.walls);
    }

    /// What to draw for the player; see [`super::warn()`].
    pub fn warn(&mut self, player: &Player, settings: &WarningSettings) -> Warnings {
        warn_of(self.held.iter().map(|held| &held.body), &self.walls, &player.tracking_from_head, settings)
    }

    /// The shapes of the obstacles that panels warn of, in the panels' order.
    pub fn shapes(&self, warnings: &Warnings) -> Vec<Shape> {
        let objects = warnings.panels.iter().filter(|panel| panel.kind != PanelKind::Wall);
        let shape = |panel: &super::Panel| {
            let body = self.held.iter().map(|held| &held.body).find(|body| body.id == panel.id && body.has_shape)?;
            let points_m = body.points.clone();
            Some(Shape { id: panel.id, points_m, radius_m: body.radius_m, alpha: panel.alpha })
        };
        objects.filter_map(shape).collect()
    }

    /// Holds nothing any more: for when the room's frame is another one.
    pub fn forget(&mut self) {
        *self = Self::default();
    }
}

impl Held {
    /// Whether this body stays although a newer one is there.
    fn outlasts(&self, newer: &Held) -> bool {
        let age_ns = newer.since_ns.saturating_sub(self.since_ns);
        let (old, new) = (&self.body, &newer.body);
        if age_ns < 0 || old.has_shape != new.has_shape || old.anchor.distance(new.anchor) > AT_ONCE_M {
            return false;
        }
        let (old_min, old_max) = corners(old);
        let (new_min, new_max) = corners(new);
        let growth = (old_min - new_min).max(new_max - old_max).max_element();
        if growth > AT_ONCE_M {
            return false;
        }
        age_ns < if difference(old, new) > LITTLE { HOLD_NS } else { LONG_HOLD_NS }
    }
}

fn corners(body: &Body) -> (DVec3, DVec3) {
    body.points.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(min, max), p| (min.min(*p), max.max(*p)))
}

/// The share of places that only one of the two has.
fn difference(a: &Body, b: &Body) -> f64 {
    let places = |body: &Body| -> BTreeSet<[i64; 3]> {
        body.points.iter().map(|p| (*p * 100.0).round().to_array().map(|v| v as i64)).collect()
    };
    let (a, b) = (places(a), places(b));
    let either = a.union(&b).count();
    a.symmetric_difference(&b).count() as f64 / either.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Pose;
    use crate::obstacles::{Observed, Obstacle};
    use glam::DMat3;

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
            first_seen_ns: 0,
            last_seen_ns: 0,
        }
    }

    fn scene(time_s: f64, obstacles: Vec<Obstacle>) -> Scene {
        Scene { time_ns: (time_s * 1e9) as i64, obstacles, walls: vec![] }
    }

    fn seen(watch: &mut Watch, scene: &Scene) -> Warnings {
        watch.see(scene);
        let head = Pose::from_translation(DVec3::new(0.0, 1.6, 0.0));
        watch.warn(&Player::head_only(scene.time_ns, head), &WarningSettings::default())
    }

    #[test]
    fn a_flickering_rim_is_held_and_taken_after_two_seconds() {
        let mut watch = Watch::new();
        let first = seen(&mut watch, &scene(0.0, vec![column(1, 0.0)]));
        let mut flickers = column(1, 0.0);
        flickers.shape.truncate(190);
        flickers.position_m.x += 0.01;
        assert_eq!(seen(&mut watch, &scene(1.9, vec![flickers.clone()])), first);
        let later = seen(&mut watch, &scene(2.0, vec![flickers.clone()]));
        assert_ne!(later, first);
        assert_eq!(later, seen(&mut Watch::new(), &scene(2.0, vec![flickers])));
    }

    #[test]
    fn what_shrinks_waits_half_a_second_and_what_grows_is_there_at_once() {
        let mut watch = Watch::new();
        let whole = seen(&mut watch, &scene(0.0, vec![column(1, 0.0)]));
        let mut half = column(1, 0.0);
        half.shape.truncate(100);
        assert_eq!(seen(&mut watch, &scene(0.4, vec![half.clone()])), whole);
        assert_ne!(seen(&mut watch, &scene(0.5, vec![half])), whole);
        assert_eq!(seen(&mut watch, &scene(0.6, vec![column(1, 0.0)])), whole);
    }

    #[test]
    fn what_moves_comes_or_goes_does_so_at_once() {
        let mut watch = Watch::new();
        let first = seen(&mut watch, &scene(0.0, vec![column(1, 0.0)]));
        let moved = seen(&mut watch, &scene(0.1, vec![column(1, 0.1)]));
        assert_ne!(moved, first);
        assert_eq!(moved, seen(&mut Watch::new(), &scene(0.1, vec![column(1, 0.1)])));
        assert_eq!(seen(&mut watch, &scene(0.2, vec![column(1, 0.1), column(2, -1.2)])).panels.len(), 2);
        assert_eq!(seen(&mut watch, &scene(0.3, vec![])), Warnings::default());
        watch.see(&scene(0.4, vec![column(1, 0.0)]));
        watch.forget();
        assert_eq!(watch.warn(&Player::head_only(0, Pose::IDENTITY), &WarningSettings::default()), Warnings::default());
    }

    #[test]
    fn time_that_runs_backwards_holds_nothing() {
        let mut watch = Watch::new();
        seen(&mut watch, &scene(10.0, vec![column(1, 0.0)]));
        let mut other = column(1, 0.0);
        other.shape.truncate(199);
        let early = scene(1.0, vec![other]);
        assert_eq!(seen(&mut watch, &early), seen(&mut Watch::new(), &early));
    }

    #[test]
    fn evidence_going_up_and_down_changes_nothing() {
        let (a, b) = (column(1, 0.0), column(2, 0.55));
        let (mut weak, mut strong) = (a.clone(), b.clone());
        (weak.evidence, strong.evidence) = (9.0, 11.0);
        let once = seen(&mut Watch::new(), &scene(0.0, vec![a, b]));
        assert_eq!((once.panels.len(), once.panels[0].id), (1, 1), "one group, named after the one known longest");
        assert_eq!(once, seen(&mut Watch::new(), &scene(0.0, vec![strong, weak])));
    }

    #[test]
    fn shapes_are_those_of_the_panels() {
        let mut watch = Watch::new();
        let warnings = seen(&mut watch, &scene(0.0, vec![column(1, 0.0), column(7, 30.0)]));
        let shapes = watch.shapes(&warnings);
        assert_eq!((shapes.len(), shapes[0].id, shapes[0].points_m.len()), (1, 1, 200));
        assert_eq!(shapes[0].alpha, warnings.panels[0].alpha);
        let bare = warnings.without_silhouettes();
        assert_eq!((bare.panels[0].kind, bare.panels[0].silhouette.len()), (PanelKind::Pane, 0));
        assert_eq!(watch.shapes(&bare), shapes);
    }
}
