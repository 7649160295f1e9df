//! What holds for the whole recording, as the view needs it.

use glam::DVec3;

use crate::settings::Settings;
use crate::warning::WarningSettings;
use a121::{SensorConfig, frame_timing};
use radar_mapping::MapperKind;
use radar_recording::Header;
use radar_sar::RangeAxis;
use radar_sar::geometry::{Aabb, Pose};
use radar_sar::truth::Truth;

/// What holds for the whole recording.
#[derive(Debug, Clone)]
pub struct RecordingInfo {
    /// Where it comes from.
    pub title: String,
    /// How long it says it is, seconds.
    pub expected_s: f64,
    /// It comes in as it happens, and has no end yet.
    pub is_live: bool,
    /// Where the sensor sits on the head.
    pub head_from_sensor: Pose,
    /// Widest angle to the boresight that counts, radians.
    pub beam_rad: f64,
    /// First and last range that is looked at, metres.
    pub ranges_m: [f64; 2],
    /// Subsweeps of a sweep.
    pub subsweeps: usize,
    /// Sweeps a second that the sensor makes at most.
    pub sweeps_per_s: f64,
    /// How it is searched.
    pub search: MapperKind,
    /// Score from which on a sighting counts.
    pub confirm_score: f64,
    /// What is really there, where it is known.
    pub truth: Option<Truth>,
    /// How warnings look.
    pub warning: WarningSettings,
}

impl RecordingInfo {
    /// Of a recording and the settings that it is worked off with.
    pub fn new(header: &Header, settings: &Settings, search: MapperKind, expected_s: f64) -> Self {
        let (beam, blocks) = (&settings.radar.beam, &settings.rooms.blocks);
        let sensor_m = ranges_m(&header.config);
        let (min_cos, ranges_m) = match search {
            MapperKind::Rooms => {
                let ranges_m = [sensor_m[0].max(blocks.min_range_m), sensor_m[1].min(blocks.max_range_m)];
                (blocks.min_cos(beam), ranges_m)
            }
            // Sums have no cut-off but the beam's own; its half amplitude is what one imagines.
            MapperKind::Reflectors => (beam.cut_off_cos(0.5), sensor_m),
        };
        Self {
            title: header.source.clone(),
            expected_s,
            is_live: false,
            head_from_sensor: settings.tracking.mount.unwrap_or(header.head_from_sensor),
            beam_rad: min_cos.clamp(-1.0, 1.0).acos(),
            ranges_m: [ranges_m[0].min(ranges_m[1]), ranges_m[1]],
            subsweeps: header.config.subsweeps.len().max(1),
            sweeps_per_s: f64::from(header.config.sweeps_per_frame) / frame_timing(&header.config).frame_period_s,
            search,
            confirm_score: settings.rooms.map.confirm_score,
            truth: header.truth.clone(),
            warning: settings.warning.clone(),
        }
    }

    /// Of what comes in as it happens.
    pub fn live(header: &Header, settings: &Settings, search: MapperKind) -> Self {
        Self { is_live: true, ..Self::new(header, settings, search, 0.0) }
    }

    /// Evidence below this is not shown at first: less confirms nothing.
    pub fn min_score(&self) -> f32 {
        match self.search {
            MapperKind::Rooms => self.confirm_score as f32,
            MapperKind::Reflectors => 0.0,
        }
    }

    /// What the evidence is measured in.
    pub fn score_name(&self) -> &'static str {
        match self.search {
            MapperKind::Rooms => "block score",
            MapperKind::Reflectors => "excess over noise (σ)",
        }
    }

    /// The box that is shown: the true room, else what the radar reaches around where the head was.
    pub fn bounds(&self, heads_m: impl IntoIterator<Item = DVec3>) -> Aabb {
        let walls = self.truth.iter().flat_map(|truth| &truth.walls).flat_map(|w| [w.extent.min, w.extent.max]);
        let things = self.truth.iter().flat_map(|truth| &truth.obstacles).flat_map(|o| o.points_m.iter().copied());
        let sound = |place: &DVec3| place.is_finite() && place.abs().max_element() < 1e4;
        let reach = DVec3::new(self.ranges_m[1], 0.0, self.ranges_m[1]).min(DVec3::splat(3.0));
        let known = Aabb::around(walls.chain(things).filter(sound));
        let heads = Aabb::around(heads_m.into_iter().filter(sound));
        let around = heads.map(|heads| {
            // A head near 0 stands in a frame that does not begin at the floor.
            let floor_m = if heads.min.y > 0.5 { 0.0 } else { heads.min.y - 1.0 };
            let low = (heads.min - reach).with_y(floor_m);
            Aabb { min: low, max: (heads.max + reach).with_y(heads.max.y + 0.4) }
        });
        match (known, around, heads) {
            // The room, and the head within it.
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
    let axes: Vec<RangeAxis> = config.subsweeps.iter().map(radar_mapping::range_axis).collect();
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
