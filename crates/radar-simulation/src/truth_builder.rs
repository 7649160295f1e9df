//! Ground truth of a simulated recording: objects, their closest approach and their time in the
//! beam.

use super::Room;
use radar_sar::Beam;
use radar_sar::geometry::Pose;
use radar_sar::truth::{Truth, TruthObstacle, TruthWall};

/// An object is in the beam if its two-way amplitude is at least this, and its distance at most
/// [`IN_BEAM_M`], metres. Choice: the defaults of `subapertures.min_amplitude` and
/// `subapertures.max_range_m`, within which the reconstruction looks.
pub(super) const IN_BEAM_AMPLITUDE: f64 = 0.25;
pub(super) const IN_BEAM_M: f64 = 2.3;

/// Time step along the path, seconds. Choice: a head at 1 m/s moves 2 cm.
const STEP_S: f64 = 0.02;

/// Data of a recording that its truth depends on.
pub(super) struct TruthBuilder<'k> {
    /// Scene and motion.
    pub title: String,
    /// Seed of the recording.
    pub seed: u64,
    /// Length, seconds.
    pub duration_s: f64,
    /// The sensor's beam.
    pub beam: &'k Beam,
}

impl TruthBuilder<'_> {
    /// The truth of a room, with `tracking_from_head` and `tracking_from_sensor` as functions of
    /// time, seconds.
    pub fn build(&self, room: &Room, head_at: impl Fn(f64) -> Pose, sensor_at: impl Fn(f64) -> Pose) -> Truth {
        let times: Vec<f64> = (0..(self.duration_s / STEP_S) as usize).map(|i| i as f64 * STEP_S).collect();
        let obstacles = room.things.iter().map(|object| {
            let points_m: Vec<_> = object.scatterers.iter().map(|s| s.position_m).collect();
            let nearest = |t: f64| {
                let head = head_at(t).translation;
                points_m.iter().map(|p| p.distance(head)).fold(f64::INFINITY, f64::min)
            };
            let in_beam = |t: &&f64| {
                let sensor = sensor_at(**t);
                points_m.iter().any(|p| {
                    let to = *p - sensor.translation;
                    let cos = to.normalize_or_zero().dot(sensor.forward());
                    to.length() <= IN_BEAM_M && self.beam.amplitude(cos) >= IN_BEAM_AMPLITUDE
                })
            };
            TruthObstacle {
                name: object.name.clone(),
                rcs_dbsm: object.scatterers.iter().map(|s| s.rcs_dbsm).collect(),
                closest_approach_m: times.iter().map(|&t| nearest(t)).fold(f64::INFINITY, f64::min),
                in_beam_s: times.iter().filter(in_beam).count() as f64 * STEP_S,
                points_m: points_m.clone(),
            }
        });
        let walls = room.walls.iter();
        Truth {
            title: self.title.clone(),
            seed: self.seed,
            obstacles: obstacles.collect(),
            walls: walls.map(|w| TruthWall { name: w.name.clone(), plane: w.plane, extent: w.extent }).collect(),
            time_offset_s: 0.0,
        }
    }
}
