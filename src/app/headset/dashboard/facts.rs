//! Collects what the dashboard's panel shows. Numbers are rounded, so that the panel is redrawn
//! only for visible changes.

use super::super::display_monitor::WarningOutput;
use super::super::status::SensorCount;
use std::sync::Arc;

use glam::{DMat2, DVec2, DVec3};

use crate::app::{PublishedMap, Reconstruction};
use crate::panel::{
    DisplayTrouble, Head, Health, MountHealth, PanelView, Plan, PlanMovingTarget, PlanObstacle, SensorHealth, hull,
};
use crate::settings::Settings;
use radar_mapping::{MountInUse, MovingTarget, Obstacle, Wall};
use radar_sar::geometry::Pose;

/// Two-way amplitude at the edge of the drawn beam. Choice: the default of
/// `rooms.subapertures.min_amplitude`, so the panel draws the beam that is imaged.
const BEAM_EDGE_AMPLITUDE: f64 = 0.25;
/// Least interval over which rates are computed, nanoseconds. Choice: at 60 frames/s a shorter
/// interval changes the shown rate by percents from one picture to the next.
const MIN_RATE_INTERVAL_NS: i64 = 1_000_000_000;

/// State of the frame loop.
#[derive(Debug, Clone, Default)]
pub(in super::super) struct Facts {
    /// Head pose in the standing universe, while known.
    pub standing_from_head: Option<Pose>,
    /// Transforms the session frame, which the map uses, into the standing universe.
    pub standing_from_session: Option<Pose>,
    pub is_tracked: bool,
    /// What the sensor has sent, while it is connected.
    pub sensor: Option<SensorCount>,
    /// Whether the reconstruction is running, once there is one.
    pub is_alive: Option<bool>,
    /// How the wearer is warned.
    pub output: WarningOutput,
    /// Whether the user wants notices in the headset.
    pub may_notify: bool,
}

/// Counters at a time.
#[derive(Debug, Clone, Copy, Default)]
struct Counts {
    time_ns: i64,
    sweeps: u64,
    lost: u64,
    poses: u64,
}

/// Rates computed from counters.
#[derive(Debug, Default)]
pub(super) struct Rates {
    from: Option<Counts>,
    sweeps_per_s: f64,
    lost_percent: f64,
    poses_per_s: f64,
    is_known: bool,
}

impl Rates {
    /// Takes the counters of the sensor, while connected, and of poses. Rates of a reconnected
    /// sensor are unknown for a second.
    fn update(&mut self, time_ns: i64, sensor: Option<SensorCount>, poses: u64) {
        let before = self.from.unwrap_or_default();
        let SensorCount { sweeps, lost } = sensor.unwrap_or(SensorCount { sweeps: before.sweeps, lost: before.lost });
        self.push(Counts { time_ns, sweeps, lost, poses });
        self.is_known &= sensor.is_some();
    }

    fn push(&mut self, to: Counts) {
        let Some(from) = self.from else { return self.from = Some(to) };
        let past_ns = to.time_ns.saturating_sub(from.time_ns);
        if past_ns < MIN_RATE_INTERVAL_NS {
            return;
        }
        // Counters may have restarted at zero.
        let rate = |from: u64, to: u64| to.saturating_sub(from) as f64 / (past_ns as f64 * 1e-9);
        let lost = rate(from.lost, to.lost);
        let sweeps = rate(from.sweeps, to.sweeps);
        self.lost_percent = (1000.0 * lost / (lost + sweeps).max(1e-9)).round() / 10.0;
        // Two significant digits, so that steady rates do not flicker.
        let rounded = |rate: f64| {
            let step = 10f64.powf((rate.max(1.0)).log10().floor() - 1.0).max(1.0);
            (rate / step).round() * step
        };
        (self.sweeps_per_s, self.poses_per_s) = (rounded(sweeps), rounded(rate(from.poses, to.poses)));
        (self.from, self.is_known) = (Some(to), true);
    }
}

/// Everything that the panel shows.
pub(super) fn view(
    now_ns: i64,
    facts: &Facts,
    settings: &(Arc<Settings>, toml::Table),
    [settings_trouble, sensor_trouble]: [Option<String>; 2],
    reconstruction: Option<&Reconstruction>,
    rates: &mut Rates,
) -> PanelView {
    let counters = reconstruction.map(Reconstruction::counters);
    let poses = counters.map_or(0, |counters| counters.mapper.streams.poses);
    rates.update(now_ns, facts.sensor, poses);
    let published = reconstruction.map(Reconstruction::latest);
    let mut health = Health {
        sensor: match facts.sensor {
            None => SensorHealth::Missing,
            Some(_) if !rates.is_known => SensorHealth::Starting,
            Some(_) if rates.sweeps_per_s < 1.0 => SensorHealth::Silent,
            Some(_) => SensorHealth::Streaming { sweeps_per_s: rates.sweeps_per_s, lost_percent: rates.lost_percent },
        },
        is_tracked: facts.is_tracked,
        poses_per_s: rates.poses_per_s,
        is_running: facts.is_alive == Some(true),
        settings_trouble,
        sensor_trouble,
        display_trouble: match facts.output {
            WarningOutput::AsSet => None,
            WarningOutput::PanelsInstead => Some(DisplayTrouble::PanelsInstead),
            WarningOutput::CuesAlone => Some(DisplayTrouble::CuesAlone),
        },
        ..Health::default()
    };
    if let Some(published) = &published {
        fill(&mut health, published, now_ns);
    }
    let plan = plan(facts, &settings.0, published.as_deref());
    // Floor and ceiling do not count as walls for the user.
    health.walls = plan.walls_m.len();
    PanelView { settings: settings.1.clone(), plan, health }
}

fn fill(health: &mut Health, published: &PublishedMap, now_ns: i64) {
    if let Some(calibration) = &published.calibration {
        health.time_offset_s = to_tenths_of_ms(calibration.time_offset_s);
        let offset = calibration.observed_time_offset();
        health.time_offset_sigma_s = offset.map(|offset| to_tenths_of_ms(offset.sigma_s));
        health.mount = mount_health(&calibration.mount);
        // To half a millimetre: the panel is drawn anew when it changes.
        health.drift_m = calibration.drift_m.map(|drift_m| (drift_m * 2e3).round() / 2e3);
        health.range_bias_m = calibration.greatest_range_bias_m();
    }
    let scene = &published.scene;
    health.obstacles = scene.obstacles.len();
    let remembered_walls = scene.walls.iter().filter(|wall| wall.provisional && self::wall(wall).is_some()).count();
    health.restored = scene.obstacles.iter().filter(|obstacle| obstacle.provisional).count() + remembered_walls;
    if published.newest_sweep_ns > 0 {
        let age_s = now_ns.saturating_sub(published.newest_sweep_ns) as f64 * 1e-9;
        health.age_s = Some(age_s.max(0.0).floor());
    }
}

/// Rounded to millimetres and degrees: the panel is drawn anew when it changes.
fn mount_health(mount: &MountInUse) -> MountHealth {
    let (by_mm, by_deg) = (mount.correction_m() * 1e3, mount.correction_rad().to_degrees());
    match mount {
        _ if mount.is_corrected() => {
            MountHealth::Corrected { by_mm: by_mm.round() as i32, by_deg: by_deg.round() as i32 }
        }
        _ if mount.is_contradicted() => MountHealth::Contradicted,
        _ if mount.is_observed() => MountHealth::AsSet,
        _ => MountHealth::Unknown,
    }
}

fn to_tenths_of_ms(seconds: f64) -> f64 {
    (seconds * 1e4).round() / 1e4
}

fn plan(facts: &Facts, settings: &Settings, published: Option<&PublishedMap>) -> Plan {
    let mut plan = Plan { play_area_m: settings.warning.play_area_m, ..Plan::default() };
    plan.head = facts.standing_from_head.map(|head| self::head(&head, settings));
    let (Some(published), Some(standing_from_session)) = (published, &facts.standing_from_session) else { return plan };
    let scene = published.scene.moved(standing_from_session);
    plan.walls_m = scene.walls.iter().filter_map(wall).collect();
    plan.obstacles = scene.obstacles.iter().map(|obstacle| plan_obstacle(obstacle, plan.head, settings)).collect();
    plan.moving = scene.moving.iter().filter_map(mover).collect();
    plan
}

/// Position rounded to 2 cm, direction to 0.04 rad.
fn head(standing_from_head: &Pose, settings: &Settings) -> Head {
    let ahead = standing_from_head.transform_vector(-DVec3::Z);
    let level = DVec2::new(ahead.x, ahead.z).try_normalize().unwrap_or(-DVec2::Y);
    let angle = (level.y.atan2(level.x) / 0.04).round() * 0.04;
    let at = standing_from_head.translation;
    Head {
        at_m: [at.x, at.z].map(|v| (v * 50.0).round() / 50.0),
        forward: [angle.cos(), angle.sin()],
        beam_rad: settings.radar.beam.cut_off_cos(BEAM_EDGE_AMPLITUDE).acos(),
        beam_m: settings.rooms.subapertures.max_range_m,
    }
}

/// Both ends of the observed part; `None` for floors and ceilings.
fn wall(wall: &Wall) -> Option<[[f64; 2]; 2]> {
    let outward = DVec2::new(wall.plane.outward.x, wall.plane.outward.z);
    let outward = outward.try_normalize().filter(|_| !wall.plane.is_level())?;
    let along = outward.perp();
    let foot = wall.plane.foot(wall.seen_at.center());
    let middle = DVec2::new(foot.x, foot.z);
    let half = wall.seen_at.size() / 2.0;
    // A wall observed at one spot is drawn half a metre wide.
    let reach = (along.x.abs() * half.x + along.y.abs() * half.z).max(0.25);
    Some([middle - along * reach, middle + along * reach].map(|end| end.to_array()))
}

/// Rounded to 5 cm; `None` for positions that are not finite.
fn mover(moving: &MovingTarget) -> Option<PlanMovingTarget> {
    let level = |point: DVec3| [point.x, point.z].map(|v| (v * 20.0).round() / 20.0);
    let mover =
        PlanMovingTarget { from_m: level(moving.seen_from.translation), arc_m: moving.arc_m().map(level).collect() };
    let is_somewhere = mover.arc_m.iter().chain([&mover.from_m]).all(|[x, z]| x.is_finite() && z.is_finite());
    is_somewhere.then_some(mover)
}

fn plan_obstacle(obstacle: &Obstacle, head: Option<Head>, settings: &Settings) -> PlanObstacle {
    let level = |point: DVec3| [point.x, point.z];
    let mut points: Vec<[f64; 2]> = obstacle.shape.iter().map(|(point, _)| level(*point)).collect();
    if points.is_empty() {
        let (at, half) = (obstacle.position_m, obstacle.extent_m / 2.0);
        points = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
            .map(|[x, z]| [at.x + x * half.x, at.z + z * half.z])
            .to_vec();
    }
    let distance_m = |point: &[f64; 2], from: [f64; 2]| DVec2::from_array(*point).distance(DVec2::from_array(from));
    let is_near = head
        .is_some_and(|head| points.iter().any(|point| distance_m(point, head.at_m) < settings.warning.fade_distance_m));
    PlanObstacle {
        outline_m: hull(&points),
        at_m: level(obstacle.position_m),
        sigma_m: axes(obstacle),
        is_near,
        is_restored: obstacle.provisional,
    }
}

/// Half axes of the 1σ ellipse on the floor.
fn axes(obstacle: &Obstacle) -> [[f64; 2]; 2] {
    let c = obstacle.covariance_m2;
    let level = DMat2::from_cols(DVec2::new(c.x_axis.x, c.x_axis.z), DVec2::new(c.z_axis.x, c.z_axis.z));
    let (mean, half) = ((level.x_axis.x + level.y_axis.y) / 2.0, (level.x_axis.x - level.y_axis.y) / 2.0);
    let skew = level.x_axis.y;
    let spread = half.hypot(skew);
    let angle = skew.atan2(half) / 2.0;
    let axis = |variance: f64, angle: f64| {
        (DVec2::from_angle(angle) * variance.max(0.0).sqrt()).to_array().map(|v| if v.is_finite() { v } else { 0.0 })
    };
    [axis(mean + spread, angle), axis(mean - spread, angle + std::f64::consts::FRAC_PI_2)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat3;
    use radar_mapping::Observed;
    use radar_sar::geometry::{Aabb, Plane};

    fn obstacle() -> Obstacle {
        Obstacle {
            id: 1,
            position_m: DVec3::new(0.5, 1.0, -1.0),
            covariance_m2: DMat3::from_diagonal(DVec3::new(0.04, 1.0, 0.01)),
            observed: Observed::Position,
            extent_m: DVec3::splat(0.2),
            evidence: 9.0,
            shape: Vec::new(),
            provisional: false,
            first_seen_ns: 0,
            last_seen_ns: 0,
        }
    }

    #[test]
    fn ellipse_matches_floor_covariance() {
        let [long, short] = axes(&obstacle());
        assert!((long[0].abs() - 0.2).abs() < 1e-9 && long[1].abs() < 1e-9, "{long:?}");
        assert!((short[1].abs() - 0.1).abs() < 1e-9 && short[0].abs() < 1e-9, "{short:?}");
        let turn = DMat3::from_rotation_y(0.5);
        let turned = Obstacle { covariance_m2: turn * obstacle().covariance_m2 * turn.transpose(), ..obstacle() };
        let [long, _] = axes(&turned);
        let expected = turn * DVec3::X * 0.2;
        assert!((DVec2::from_array(long).dot(DVec2::new(expected.x, expected.z)).abs() - 0.04).abs() < 1e-9);
    }

    #[test]
    fn walls_give_segments_and_floors_give_none() {
        let seen_at = Aabb { min: DVec3::new(-1.0, 0.5, -2.1), max: DVec3::new(2.0, 1.5, -1.9) };
        let of = |outward: DVec3, offset_m| Wall {
            id: 1,
            plane: Plane { outward, offset_m },
            evidence: 1.0,
            seen_at,
            provisional: false,
            first_seen_ns: 0,
            last_seen_ns: 0,
        };
        let mut ends = wall(&of(-DVec3::Z, 2.0)).unwrap();
        ends.sort_by(|a, b| a[0].total_cmp(&b[0]));
        assert_eq!(ends, [[-1.0, -2.0], [2.0, -2.0]]);
        assert_eq!(wall(&of(-DVec3::Y, 0.0)), None);
    }

    #[test]
    fn reconnected_sensor_gives_no_rate_spike() {
        let mut rates = Rates::default();
        let mut take = |second: i64, sweeps: Option<u64>| {
            let sensor = sweeps.map(|sweeps| SensorCount { sweeps, lost: 0 });
            rates.update(second * 1_000_000_000, sensor, 250 * second as u64);
            (rates.is_known, rates.sweeps_per_s, rates.poses_per_s)
        };
        let steady: Vec<_> = (0..=10).map(|n| take(n, Some(1000 * n as u64))).collect();
        assert_eq!(steady[2..], [(true, 1000.0, 250.0); 9]);
        assert_eq!([11, 12].map(|n| take(n, None)), [(false, 0.0, 250.0); 2]);
        assert_eq!(take(13, Some(10_000)), (true, 0.0, 250.0));
        assert_eq!(take(14, Some(11_000)), (true, 1000.0, 250.0));
    }

    #[test]
    fn rates_cover_one_second_and_restart() {
        let mut rates = Rates::default();
        let s = 1_000_000_000;
        for n in 0..=20 {
            rates.push(Counts { time_ns: n * s / 10, sweeps: 105 * n as u64, lost: 0, poses: 25 * n as u64 });
        }
        assert_eq!((rates.sweeps_per_s, rates.poses_per_s), (1100.0, 250.0));
        rates.push(Counts { time_ns: 4 * s, sweeps: 0, lost: 0, poses: 0 });
        assert_eq!((rates.sweeps_per_s, rates.lost_percent), (0.0, 0.0));
    }

    #[test]
    fn obstacles_within_fade_distance_are_near() {
        let settings = Settings::default();
        let from = |x: f64| Some(head(&Pose::from_translation(DVec3::new(x, 1.6, -1.0)), &settings));
        assert!(plan_obstacle(&obstacle(), from(-0.7), &settings).is_near);
        assert!(
            !plan_obstacle(&obstacle(), from(-1.5), &settings).is_near
                && !plan_obstacle(&obstacle(), None, &settings).is_near
        );
        assert_eq!(plan_obstacle(&obstacle(), None, &settings).outline_m.len(), 4);
    }
}
