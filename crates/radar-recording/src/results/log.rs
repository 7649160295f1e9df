//! Log lines about the changes between two snapshots.

use std::collections::BTreeMap;

use glam::DVec3;

use super::snapshot::{ResultsCounters, Snapshot};

/// Limit of the lines per snapshot; the rest is only counted. Choice: a burst of events must not
/// push older lines out of the viewers' panels.
const MAX_LINES: usize = 40;
/// Smallest change of the time offset that is logged, seconds. Choice: below what is applied (0.5
/// ms) by far; it only excludes rounding.
const MIN_OFFSET_CHANGE_S: f64 = 1e-7;

/// State at the snapshot before.
#[derive(Debug, Default)]
pub struct LogState {
    obstacles: BTreeMap<u64, DVec3>,
    walls: BTreeMap<u64, DVec3>,
    moving: BTreeMap<u64, f64>,
    time_offset_s: Option<f64>,
    counted: ResultsCounters,
}

/// A log line, and whether it is a warning.
#[derive(Debug, PartialEq)]
pub struct Line {
    pub text: String,
    pub is_warning: bool,
}

impl LogState {
    /// Returns what is new, gone or changed since the snapshot before.
    pub fn lines_for(&mut self, snapshot: &Snapshot) -> Vec<Line> {
        let mut lines = Vec::new();
        let mut add = |text: String, is_warning| lines.push(Line { text, is_warning });
        let head = snapshot.head.map(|head| head.translation);
        let scene = snapshot.scene;
        for obstacle in scene.obstacles.iter().filter(|o| !self.obstacles.contains_key(&o.id)) {
            let p = obstacle.position_m;
            let far = head.map_or(String::new(), |head| format!(", {:.2} m from the head", obstacle.distance_m(head)));
            add(format!("obstacle {} found at ({:.2}, {:.2}, {:.2}) m{far}", obstacle.id, p.x, p.y, p.z), false);
        }
        for wall in scene.walls.iter().filter(|w| !self.walls.contains_key(&w.id)) {
            let n = wall.plane.outward;
            let towards = format!("({:.2}, {:.2}, {:.2})", n.x, n.y, n.z);
            add(format!("wall {} found towards {towards} at {:.2} m", wall.id, wall.plane.offset_m), false);
        }
        let obstacles: BTreeMap<u64, DVec3> = scene.obstacles.iter().map(|o| (o.id, o.position_m)).collect();
        let walls: BTreeMap<u64, DVec3> = scene.walls.iter().map(|w| (w.id, w.seen_at.center())).collect();
        for (id, p) in self.obstacles.iter().filter(|(id, _)| !obstacles.contains_key(id)) {
            add(format!("obstacle {id} gone from ({:.2}, {:.2}, {:.2}) m", p.x, p.y, p.z), false);
        }
        for id in self.walls.keys().filter(|id| !walls.contains_key(id)) {
            add(format!("wall {id} gone"), false);
        }
        for moving in scene.moving.iter().filter(|m| !self.moving.contains_key(&m.id)) {
            let (range_m, speed) = (moving.range_m, moving.speed_m_per_s);
            add(format!("moving target {} found {range_m:.2} m ahead at {speed:+.2} m/s", moving.id), false);
        }
        let moving: BTreeMap<u64, f64> = scene.moving.iter().map(|m| (m.id, m.range_m)).collect();
        for (id, range_m) in self.moving.iter().filter(|(id, _)| !moving.contains_key(id)) {
            add(format!("moving target {id} lost at {range_m:.2} m"), false);
        }
        (self.obstacles, self.walls, self.moving) = (obstacles, walls, moving);
        let offset_s = snapshot.calibration.time_offset_s;
        let before_s = self.time_offset_s.replace(offset_s);
        if let Some(before_s) = before_s.filter(|before_s| (offset_s - before_s).abs() > MIN_OFFSET_CHANGE_S) {
            let (now, before) = (offset_s * 1e3, before_s * 1e3);
            add(format!("time offset set to {now:+.2} ms, before {before:+.2} ms"), false);
        }
        let (now, then) = (snapshot.counted, std::mem::replace(&mut self.counted, snapshot.counted));
        let left_out = [
            ("frames", now.frames_left_out, then.frames_left_out),
            ("sweeps", now.sweeps_left_out, then.sweeps_left_out),
            ("poses", now.poses_left_out, then.poses_left_out),
        ];
        for (what, now, then) in left_out.into_iter().filter(|(_, now, then)| now > then) {
            add(format!("{} {what} left out, {now} so far", now - then), true);
        }
        if lines.len() > MAX_LINES {
            let more = lines.len() - MAX_LINES;
            lines.truncate(MAX_LINES);
            lines.push(Line { text: format!("and {more} more"), is_warning: false });
        }
        lines
    }
}
