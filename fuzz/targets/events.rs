//! The whole pipeline on a stream of events with wrong times, numbers and lengths.
//!
//! Checks: no panic, no hang; memory is bounded; obstacles have finite positions and evidence; frames of a wrong length change nothing: without
//! them the map is the same.
#![no_main]

use a121::{Frame, SensorConfig, preset};
use glam::{DQuat, DVec3};
use libfuzzer_sys::fuzz_target;
use num_complex::Complex;
use radar_chaperone_fuzz::{memory, script::Script, seeds};
use radar_mapping::{Event, Mapper, MappingSettings, Refusal, SavedMap, Scene};
use radar_sar::geometry::Pose;
use radar_sar::{PHASE_RAD_PER_M, PoseSample, envelope};

/// Limit of the map, the windows and the queues of a short stream, bytes.
const PEAK_BYTES: usize = 256 << 20;
const LARGEST_BYTES: usize = 64 << 20;
/// Most frames of a stream: the target has 5 s for each input.
const MAX_FRAMES: usize = 100;
const STEP_NS: i64 = 5_000_000;
/// Where the reflector is.
const REFLECTOR: DVec3 = DVec3::new(0.1, 0.0, -1.2);

/// What a script makes of a stream: sound steps of a moving sensor that sees a reflector, and what goes wrong in between.
struct Stream {
    config: SensorConfig,
    time_ns: i64,
    noise: u32,
    frames: usize,
    events: Vec<Event>,
}

impl Stream {
    fn pose(&self) -> PoseSample {
        let turn = self.time_ns as f64 * 1e-9 * std::f64::consts::TAU;
        let at = DVec3::new(0.15 * turn.sin(), 0.15 * turn.cos(), 0.03 * (3.0 * turn).sin());
        PoseSample::valid(self.time_ns, &Pose::new(at, DQuat::from_rotation_y(0.1 * turn.sin())))
    }

    fn frame(&mut self) -> Frame {
        let subsweep = &self.config.subsweeps[0];
        let (step_m, first_m) = (f64::from(subsweep.step_length) * 2.5e-3, f64::from(subsweep.start_point) * 2.5e-3);
        let at = DVec3::from_array(self.pose().position_m);
        let distance_m = at.distance(REFLECTOR);
        let mut samples = Vec::new();
        for n in 0..self.config.points_per_frame() {
            self.noise = self.noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let noise = |shift: u32| f64::from((self.noise >> shift) as u8) / 16.0 - 8.0;
            let amplitude = 100.0 * envelope(0.14, first_m + n as f64 * step_m - distance_m);
            let echo = Complex::from_polar(amplitude, PHASE_RAD_PER_M * distance_m);
            samples.push(Complex::new((echo.re + noise(24)) as i16, (echo.im + noise(16)) as i16));
        }
        self.frames += 1;
        let (data_saturated, frame_delayed, calibration_needed) = (false, false, false);
        let (tick, host_time_ns) = (self.time_ns / 1000, self.time_ns + 1_000_000);
        Frame { tick, host_time_ns, temperature_c: 25, data_saturated, frame_delayed, calibration_needed, samples }
    }

    fn push_script(&mut self, script: &mut Script) {
        while !script.is_over() && self.frames < MAX_FRAMES {
            match script.u8() % 8 {
                0 | 1 => {
                    for _ in 0..script.u8() {
                        self.time_ns += STEP_NS;
                        self.events.push(Event::Pose(self.pose()));
                        let frame = self.frame();
                        self.events.push(Event::Frame(frame));
                    }
                }
                2 => {
                    let mut frame = self.frame();
                    frame.samples.resize(usize::from(script.u16()), Complex::new(7, -7));
                    self.events.push(Event::Frame(frame));
                }
                3 => {
                    let frame = Frame { data_saturated: true, ..self.frame() };
                    self.events.push(Event::Frame(frame));
                }
                4 => {
                    let mut pose = self.pose();
                    let number = f64::from_bits(script.i64() as u64);
                    match script.u8() % 8 {
                        n @ 0..3 => pose.position_m[usize::from(n)] = number,
                        n @ 3..7 => pose.quaternion_xyzw[usize::from(n) - 3] = number,
                        _ => pose.valid = false,
                    }
                    self.time_ns += STEP_NS / 5;
                    self.events.push(Event::Pose(PoseSample { time_ns: self.time_ns, ..pose }));
                }
                5 => self.events.push(Event::Pose(PoseSample { time_ns: script.i64(), ..self.pose() })),
                6 => {
                    let frame = Frame { host_time_ns: script.i64(), ..self.frame() };
                    self.events.push(Event::Frame(frame));
                }
                _ => {
                    let hand = Some(DVec3::splat(f64::from_bits(script.i64() as u64)));
                    self.events.push(Event::hands(self.time_ns, [hand, None]));
                }
            }
        }
    }
}

fn map(config: &SensorConfig, events: &[Event]) -> (Vec<Option<Refusal>>, Scene, SavedMap) {
    let mut mapper = Mapper::new(config, &Pose::IDENTITY, &MappingSettings::default());
    let refusals = events.iter().map(|event| mapper.push(event.clone()).err()).collect();
    mapper.finish();
    (refusals, mapper.scene(), mapper.saved_map())
}

/// Whether a refused event leaves no trace. An invalid pose is a border that is not interpolated across, a saturated frame has a
/// time, and a wrong time is remembered: a second one like it confirms it.
fn leaves_no_trace(refusal: &Option<Refusal>) -> bool {
    matches!(refusal, Some(Refusal::FrameLength { .. }))
}

fuzz_target!(init: seeds::write("events"), |data: &[u8]| {
    let config = preset("c16").expect("a preset");
    let mut stream = Stream { config: config.clone(), time_ns: 0, noise: 1, frames: 0, events: Vec::new() };
    stream.push_script(&mut Script(data));
    let events = stream.events;
    let (refusals, scene, saved) = memory::bounded(PEAK_BYTES, LARGEST_BYTES, || map(&config, &events));
    for obstacle in &scene.obstacles {
        assert!(obstacle.position_m.is_finite() && obstacle.evidence.is_finite(), "{obstacle:?}");
    }
    let kept: Vec<Event> =
        events.iter().zip(&refusals).filter(|(_, refusal)| !leaves_no_trace(refusal)).map(|(event, _)| event.clone()).collect();
    if kept.len() < events.len() {
        let (_, scene_of_kept, saved_of_kept) = map(&config, &kept);
        assert_eq!((scene, saved), (scene_of_kept, saved_of_kept));
    }
});
