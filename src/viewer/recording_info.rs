//! Information about a whole recording that the view needs.

use glam::DVec3;

use crate::settings::Settings;
use crate::warning::WarningSettings;
use a121::{SensorConfig, frame_timing};
use radar_mapping::MapperKind;
use radar_recording::Header;
use radar_sar::RangeAxis;
use radar_sar::geometry::{Aabb, Pose};
use radar_sar::truth::Truth;

/// Information about a whole recording.
#[derive(Debug, Clone)]
pub struct RecordingInfo {
    /// Source of the recording.
    pub title: String,
    /// Announced duration, seconds.
    pub expected_s: f64,
    /// Whether the data arrives live; then the recording has no end yet.
    pub is_live: bool,
    /// Pose of the sensor in the head frame.
    pub head_from_sensor: Pose,
    /// Half opening angle of the beam: the largest angle to the boresight that is used, radians.
    pub beam_rad: f64,
    /// First and last range that is used, metres.
    pub ranges_m: [f64; 2],
    /// Subsweeps per sweep.
    pub subsweeps: usize,
    /// Largest sweep rate of the sensor, Hz.
    pub sweeps_per_s: f64,
    /// Search mode.
    pub search: MapperKind,
    /// Score from which an observation counts.
    pub confirm_score: f64,
    /// The true objects, if known.
    pub truth: Option<Truth>,
    /// Style of the warnings.
    pub warning: WarningSettings,
}

impl RecordingInfo {
    /// For a recording and the settings with which it is processed.
    pub fn new(header: &Header, settings: &Settings, search: MapperKind, expected_s: f64) -> Self {
        let (beam, subapertures) = (&settings.radar.beam, &settings.rooms.subapertures);
        let sensor_m = ranges_m(&header.config);
        let (min_cos, ranges_m) = match search {
            MapperKind::Rooms => {
                let ranges_m = [sensor_m[0].max(subapertures.min_range_m), sensor_m[1].min(subapertures.max_range_m)];
                (subapertures.min_cos(beam), ranges_m)
            }
            // The backprojection has no cut-off except the beam itself; its half-amplitude angle is
            // shown.
            MapperKind::Reflectors => (beam.cut_off_cos(0.5), sensor_m),
        };
        Self {
            title: header.source.clone(),
            expected_s,
            is_live: false,
            head_from_sensor: settings.tracking.mount.unwrap_or(header.head_from_sensor),
            beam_rad: min_cos.clamp(-1.0, 1.0).acos(),
            ranges_m: [ranges_m[0].min(ranges_m[1]), ranges_m[1]],
            subsweeps: header.config.subsweeps.iter().filter(|subsweep| subsweep.hears_echoes()).count().max(1),
            sweeps_per_s: f64::from(header.config.sweeps_per_frame) / frame_timing(&header.config).frame_period_s,
            search,
            confirm_score: settings.rooms.tracks.confirm_score,
            truth: header.truth.clone(),
            warning: settings.warning.clone(),
        }
    }

    /// For live data.
    pub fn live(header: &Header, settings: &Settings, search: MapperKind) -> Self {
        Self { is_live: true, ..Self::new(header, settings, search, 0.0) }
    }

    /// Evidence below this is hidden at first, because it confirms nothing.
    pub fn min_score(&self) -> f32 {
        match self.search {
            MapperKind::Rooms => self.confirm_score as f32,
            MapperKind::Reflectors => 0.0,
        }
    }

    /// Name and unit of the evidence.
    pub fn score_name(&self) -> &'static str {
        match self.search {
            MapperKind::Rooms => "coherence score",
            MapperKind::Reflectors => "excess over noise (σ)",
        }
    }

    /// The displayed box: the true room if known, else the radar's range around the positions of
    /// the head.
    pub fn bounds(&self, heads_m: impl IntoIterator<Item = DVec3>) -> Aabb {
        let walls = self.truth.iter().flat_map(|truth| &truth.walls).flat_map(|w| [w.extent.min, w.extent.max]);
        let points = self.truth.iter().flat_map(|truth| &truth.obstacles).flat_map(|o| o.points_m.iter().copied());
        let sound = |point: &DVec3| point.is_finite() && point.abs().max_element() < 1e4;
        let reach = DVec3::new(self.ranges_m[1], 0.0, self.ranges_m[1]).min(DVec3::splat(3.0));
        let known = Aabb::around(walls.chain(points).filter(sound));
        let heads = Aabb::around(heads_m.into_iter().filter(sound));
        let around = heads.map(|heads| {
            // A head near height 0 is in a frame whose origin is not on the floor.
            let floor_m = if heads.min.y > 0.5 { 0.0 } else { heads.min.y - 1.0 };
            let low = (heads.min - reach).with_y(floor_m);
            Aabb { min: low, max: (heads.max + reach).with_y(heads.max.y + 0.4) }
        });
        match (known, around, heads) {
            // The true room, enlarged to contain the head.
            (Some(known), _, Some(heads)) => {
                Aabb { min: known.min.min(heads.min - 0.3), max: known.max.max(heads.max + 0.3) }
            }
            (Some(known), ..) => known,
            (None, Some(around), _) => around,
            _ => Aabb { min: DVec3::new(-2.0, 0.0, -2.0), max: DVec3::new(2.0, 2.0, 2.0) },
        }
    }
}

fn ranges_m(config: &SensorConfig) -> [f64; 2] {
    let axes: Vec<RangeAxis> =
        config.subsweeps.iter().filter(|subsweep| subsweep.hears_echoes()).map(radar_mapping::range_axis).collect();
    let first = axes.iter().map(|axis| axis.first_m).fold(f64::INFINITY, f64::min);
    let last = axes.iter().map(RangeAxis::last_m).fold(0.0, f64::max);
    [first.min(last).max(0.0), last]
}

#[cfg(test)]
mod tests {
    use super::*;
    use a121::preset;

    fn about() -> RecordingInfo {
        let header = Header::new("test", preset("d16").unwrap(), Pose::from_translation(DVec3::Y));
        RecordingInfo::new(&header, &Settings::default(), MapperKind::Rooms, 3.0)
    }

    #[test]
    fn beam_angle_matches_subaperture_cutoff() {
        let about = about();
        assert!(about.beam_rad > 0.3 && about.beam_rad < 1.6, "{}", about.beam_rad);
        assert_eq!(about.ranges_m[1], 2.3);
        assert_eq!(about.head_from_sensor.translation, DVec3::Y);
        assert!(about.sweeps_per_s > 400.0);
    }

    #[test]
    fn bounds_contain_head_and_floor() {
        let about = about();
        let bounds = about.bounds([DVec3::new(5.0, 1.6, 0.0), DVec3::new(6.0, 1.7, 0.0), DVec3::NAN]);
        assert!(bounds.contains(DVec3::new(5.5, 1.65, 0.0)) && bounds.min.y == 0.0, "{bounds:?}");
        assert!(about.bounds([]).size().min_element() > 1.0);
        assert!(about.bounds([DVec3::ZERO]).min.y < -0.5, "a frame that begins at the head");
    }
}
