//! Streams of invalid frames and poses through the mapper: they are counted, the scene stays
//! finite, and valid data among them give the same scene as alone.

use a121::{Frame, FrameLayout, SensorConfig, frame_timing, preset};
use glam::DVec3;
use num_complex::{Complex, Complex64};
use radar_mapping::Event;
use radar_mapping::{Mapper, MappingSettings, Mode};
use radar_mapping::{ObserverCounters, range_axis};
use radar_sar::PoseSample;
use radar_sar::TrackingResult;
use radar_sar::geometry::Pose;
use radar_sar::{PHASE_RAD_PER_M, envelope};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::quick_or_long;

const START_NS: i64 = 1_000_000_000;
const POSE_NS: i64 = 1_000_000_000 / 120;
const CHAIR: DVec3 = DVec3::new(0.225, 1.525, -1.175);

/// The head's path.
fn head(time_s: f64) -> Pose {
    let t = 2.0 * time_s;
    let at = DVec3::Y * 1.5 + 0.15 * DVec3::new((2.1 * t).sin(), (3.4 * t).cos(), (2.7 * t + 0.5).sin());
    Pose::from_translation(at)
}

fn seconds(time_ns: i64) -> f64 {
    (time_ns - START_NS) as f64 * 1e-9
}

/// Frames of a chair in front of the moving head, and the head's poses.
fn sound_streams(config: &SensorConfig, duration_s: f64, seed: u64) -> (Vec<Frame>, Vec<PoseSample>) {
    let layout = FrameLayout::of(config);
    let axis = range_axis(&config.subsweeps[0]);
    let pulse_fwhm_m = config.subsweeps[0].profile.envelope_fwhm_m();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut noise = || -> f64 { StandardNormal.sample(&mut rng) };
    let period_s = frame_timing(config).frame_period_s;
    let mut frame = |n: usize| {
        let host_time_ns = START_NS + ((n + 1) as f64 * period_s * 1e9) as i64;
        let mut frame = Frame {
            tick: n as i64,
            host_time_ns,
            temperature_c: 30,
            data_saturated: false,
            frame_delayed: false,
            calibration_needed: false,
            samples: vec![Complex::new(0, 0); layout.samples_per_frame()],
        };
        let empty = frame.clone();
        let mut samples = Vec::new();
        for sweep in layout.sweeps(&empty).unwrap() {
            for point in 0..sweep.samples.len() {
                let time_ns = sweep.first_point_time_ns + (point as f64 * sweep.point_period_s * 1e9) as i64;
                let distance_m = head(seconds(time_ns)).translation.distance(CHAIR);
                let pulse = 200.0 * envelope(pulse_fwhm_m, axis.range_m(point) - distance_m);
                let echo = Complex64::from_polar(pulse, PHASE_RAD_PER_M * distance_m);
                samples.push(Complex::new((echo.re + 14.0 * noise()) as i16, (echo.im + 14.0 * noise()) as i16));
            }
        }
        frame.samples = samples;
        frame
    };
    let frames = (0..(duration_s / period_s) as usize).map(&mut frame).collect();
    let pose = |n: i64| PoseSample::valid(START_NS + n * POSE_NS, &head(seconds(START_NS + n * POSE_NS)));
    (frames, (-30..(duration_s * 120.0) as i64 + 60).map(pose).collect())
}

/// Both streams merged by time.
fn sound_events(config: &SensorConfig, duration_s: f64, seed: u64) -> Vec<Event> {
    let (frames, poses) = sound_streams(config, duration_s, seed);
    let mut events: Vec<(i64, Event)> = frames.into_iter().map(|f| (f.host_time_ns, Event::Frame(f))).collect();
    events.extend(poses.into_iter().map(|p| (p.time_ns, Event::Pose(p))));
    events.sort_by_key(|e| e.0);
    events.into_iter().map(|e| e.1).collect()
}

fn run(config: &SensorConfig, mode: Mode, events: &[Event]) -> Mapper {
    let mut settings = MappingSettings::default();
    settings.processing.mode = mode;
    settings.reflectors.voxel_m = 0.2;
    settings.reflectors.max_reflectors = 3;
    let mut mapper = Mapper::new(config, &Pose::IDENTITY, &settings);
    for event in events {
        // What is refused is counted.
        let _ = mapper.push(event.clone());
    }
    mapper.finish();
    mapper
}

/// The results of a mapper that are not finite.
fn not_finite(mapper: &Mapper) -> Vec<String> {
    let mut wrong = Vec::new();
    let scene = mapper.scene();
    for o in &scene.obstacles {
        let finite = o.position_m.is_finite() && o.covariance_m2.is_finite() && o.extent_m.is_finite();
        let shape = o.shape.iter().all(|(place, value)| place.is_finite() && value.is_finite());
        if !(finite && shape && o.evidence.is_finite()) {
            wrong.push(format!("{o:?}"));
        }
    }
    for w in &scene.walls {
        let finite = w.plane.outward.is_finite() && w.plane.offset_m.is_finite() && w.evidence.is_finite();
        if !(finite && w.seen_at.min.is_finite() && w.seen_at.max.is_finite()) {
            wrong.push(format!("{w:?}"));
        }
    }
    if let Some(estimate) = mapper.time_offset_estimate() {
        let sound = estimate.offset_s.is_finite() && estimate.sigma_s >= 0.0;
        if !sound || (estimate.observable && !estimate.sigma_s.is_finite()) {
            wrong.push(format!("{estimate:?}"));
        }
    }
    if !mapper.time_offset_s().is_finite() || mapper.time_offset_s().abs() > 0.11 {
        wrong.push(format!("applied time offset of {} s", mapper.time_offset_s()));
    }
    if let Some((time_ns, pose)) = mapper.sensor_path().find(|(_, pose)| !pose.translation.is_finite()) {
        wrong.push(format!("sensor at {time_ns} ns at {pose:?}"));
    }
    wrong
}

/// Damage to a stream: each event becomes zero or more events.
type Damage = fn(usize, Event) -> Vec<Event>;
/// The counter that must count the damage; `None`: nothing is refused.
type ExpectedCounter = Option<fn(&ObserverCounters) -> u64>;

fn pose(n: usize, event: Event, every: usize, change: impl Fn(&mut PoseSample)) -> Vec<Event> {
    match event {
        Event::Pose(mut pose) if n.is_multiple_of(every) => {
            change(&mut pose);
            vec![Event::Pose(pose)]
        }
        other => vec![other],
    }
}

fn frame(n: usize, event: Event, every: usize, change: impl Fn(&mut Frame)) -> Vec<Event> {
    match event {
        Event::Frame(mut frame) if n.is_multiple_of(every) => {
            change(&mut frame);
            vec![Event::Frame(frame)]
        }
        other => vec![other],
    }
}

const DAMAGES: [(&str, Damage, ExpectedCounter); 23] = [
    ("nothing", |_, e| vec![e], None),
    ("all saturated, marked", |n, e| frame(n, e, 1, |f| f.data_saturated = true), Some(|c| c.frames_saturated)),
    ("all saturated, not marked", |n, e| frame(n, e, 1, |f| f.samples.fill(Complex::new(i16::MIN, i16::MAX))), None),
    ("some saturated, not marked", |n, e| frame(n, e, 5, |f| f.samples.fill(Complex::new(i16::MIN, i16::MIN))), None),
    ("silent", |n, e| frame(n, e, 1, |f| f.samples.fill(Complex::new(0, 0))), None),
    ("one sample alone", |n, e| frame(n, e, 1, |f| f.samples[1..].fill(Complex::new(0, 0))), None),
    ("no samples", |n, e| frame(n, e, 3, |f| f.samples.clear()), Some(|c| c.frames_wrong_length)),
    (
        "a sample too many",
        |n, e| frame(n, e, 3, |f| f.samples.push(Complex::new(1, 1))),
        Some(|c| c.frames_wrong_length),
    ),
    (
        "frames back in time",
        |n, e| frame(n, e, 5, |f| f.host_time_ns -= 300_000_000),
        Some(|c| c.frames_time_not_rising),
    ),
    (
        "a frame at the maximum time",
        |n, e| frame(usize::from(n < 150), e, 2, |f| f.host_time_ns = i64::MAX),
        Some(|c| c.frames_time_leapt),
    ),
    (
        "a frame at the minimum time",
        |n, e| frame(usize::from(n < 150), e, 2, |f| f.host_time_ns = i64::MIN),
        Some(|c| c.frames_time_not_rising),
    ),
    ("NaN positions", |n, e| pose(n, e, 5, |p| p.position_m[1] = f64::NAN), Some(|c| c.poses_bad_numbers)),
    (
        "infinite positions",
        |n, e| pose(n, e, 5, |p| p.position_m[2] = f64::NEG_INFINITY),
        Some(|c| c.poses_bad_numbers),
    ),
    ("zero quaternions", |n, e| pose(n, e, 5, |p| p.quaternion_xyzw = [0.0; 4]), Some(|c| c.poses_bad_numbers)),
    ("NaN quaternions only", |n, e| pose(n, e, 1, |p| p.quaternion_xyzw[3] = f64::NAN), Some(|c| c.poses_bad_numbers)),
    ("tiny quaternions", |n, e| pose(n, e, 1, |p| p.quaternion_xyzw = p.quaternion_xyzw.map(|q| q * 1e-5)), None),
    ("invalid poses", |n, e| pose(n, e, 7, |p| p.result = TrackingResult::OutOfRange), Some(|c| c.poses_invalid)),
    ("poses back in time", |n, e| pose(n, e, 5, |p| p.time_ns -= 200_000_000), Some(|c| c.poses_time_not_rising)),
    (
        "a pose at the maximum time",
        |n, e| pose(usize::from(n < 170), e, 2, |p| p.time_ns = i64::MAX),
        Some(|c| c.poses_time_leapt),
    ),
    ("a pose at the minimum time", |n, e| pose(n, e, 91, |p| p.time_ns = i64::MIN), Some(|c| c.poses_time_not_rising)),
    ("leaps of 100 m", |n, e| pose(n, e, 41, |p| p.position_m[0] += 100.0), None),
    ("leaps to 1e300 m", |n, e| pose(n, e, 41, |p| p.position_m[0] = 1e300), None),
    ("a still head", |n, e| pose(n, e, 1, |p| p.position_m = [0.0, 1.5, 0.0]), None),
];

#[test]
fn bad_streams_are_counted_and_the_scene_stays_finite() {
    let mut wrong = Vec::new();
    for (name, preset_name, mode) in [("rooms", "d16", Mode::Rooms), ("reflectors", "fine", Mode::Reflectors)] {
        let config = preset(preset_name).unwrap();
        let sound = sound_events(&config, quick_or_long(1.3, 6.0), 1);
        for (damage, harm, tells) in DAMAGES {
            let what = format!("{name} / {damage}");
            let events: Vec<Event> = sound.iter().cloned().enumerate().flat_map(|(n, e)| harm(n, e)).collect();
            // The modulus must not miss all events of one of the streams.
            if (events == sound) != (damage == "nothing") {
                wrong.push(format!("{what}: no damage was done"));
            }
            let mapper = run(&config, mode, &events);
            let counters = mapper.counters().streams;
            let poses = events.iter().filter(|e| matches!(e, Event::Pose(_))).count() as u64;
            if (counters.poses, counters.frames) != (poses, events.len() as u64 - poses) {
                wrong.push(format!("{what}: {counters:?}"));
            }
            if tells.is_some_and(|told| told(&counters) == 0) {
                wrong.push(format!("{what}: not counted, {counters:?}"));
            }
            let engine = mapper.counters().engine.observations;
            if engine != counters.observations {
                wrong.push(format!("{what}: {engine} observations imaged of {}", counters.observations));
            }
            wrong.extend(not_finite(&mapper).into_iter().map(|of| format!("{what}: {of}")));
            if damage == "nothing" {
                let nearest = mapper.scene().obstacles.iter().map(|o| o.position_m.distance(CHAIR)).fold(9.0, f64::min);
                if nearest > 0.15 {
                    wrong.push(format!("{what}: the chair is {nearest} m from the nearest obstacle"));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{} wrong:\n{}", wrong.len(), wrong.join("\n"));
}

#[test]
fn valid_data_among_bad_data_give_the_same_scene() {
    let config = preset("d16").unwrap();
    let sound = sound_events(&config, quick_or_long(1.6, 8.0), 2);
    let with_bad = |event: &Event| -> Vec<Event> {
        let bad = match event.clone() {
            Event::Pose(pose) => vec![
                Event::Pose(PoseSample { time_ns: pose.time_ns - 1, position_m: [f64::NAN; 3], ..pose }),
                Event::Pose(PoseSample { position_m: [50.0; 3], ..pose }),
                Event::Pose(PoseSample { time_ns: i64::MIN, quaternion_xyzw: [0.0; 4], ..pose }),
            ],
            Event::Hands(_) => Vec::new(),
            Event::Frame(frame) => {
                let loud = vec![Complex::new(i16::MAX, i16::MIN); frame.samples.len()];
                vec![
                    Event::Frame(Frame { samples: loud[1..].to_vec(), host_time_ns: i64::MAX, ..frame.clone() }),
                    Event::Frame(Frame { samples: loud.clone(), ..frame.clone() }),
                    Event::Frame(Frame { samples: loud, host_time_ns: frame.host_time_ns - 1, ..frame }),
                ]
            }
        };
        std::iter::once(event.clone()).chain(bad).collect()
    };
    let mixed: Vec<Event> = sound.iter().flat_map(with_bad).collect();
    let (alone, among) = (run(&config, Mode::Rooms, &sound), run(&config, Mode::Rooms, &mixed));
    assert_eq!(among.scene(), alone.scene());
    assert_eq!(among.counters().engine, alone.counters().engine);
    assert!(!alone.scene().obstacles.is_empty());
    let counters = among.counters().streams;
    assert_eq!(counters.poses, 4 * alone.counters().streams.poses);
    assert_eq!(counters.frames_wrong_length, alone.counters().streams.frames);
    assert_eq!(counters.frames_time_not_rising, 2 * alone.counters().streams.frames);
}
