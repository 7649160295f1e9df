//! Accuracy of moving targets (people crossing a room) in play sessions.
//!
//!     cargo run --release -p lab --example moving -- [FIRST..END] [--seconds=20] [--preset=d16] \
//!         [--world=points] [--headset=NAME] [--effects=none] [--controllers] [--no-visitor] \
//!         [--no-hands] [--each] [rooms.moving.confirm_subapertures=4 …]
//!
//! Each session is processed into sub-apertures and moving targets only, without the rest of the
//! program: the sensor's leakage and ringing are not subtracted. Counted per sub-aperture: how often a
//! person of whom a part is seen within 2.5 m is shown at the right range, in all sub-apertures and in
//! those in which the body's range rate is impossible for an object at rest; the range error; the delay
//! after entering the beam; and false targets per minute. Also the cost, CPU time of the thread.

use a121::{frame_timing, preset};
use glam::DVec3;
use lab::experiments::moving::{AFTER_S, FALSE_M, NEAR_M, RIGHT_M, movers_at, range_off_m};
use radar_chaperone::settings::Settings;
use radar_mapping::{HandTrail, MovingTargetTracker};
use radar_mapping::{Observer, ObserverSettings};
use radar_sar::subaperture::{MtiFilter, Subaperture, SubapertureBuilder};
use radar_simulation::{Headset, PlaySession, PlayWorld, Session};

/// Index of the visitor's part that stands for the body, in every world.
const CHEST: usize = 2;

#[derive(Default)]
struct Figures {
    subapertures: u64,
    not_evaluable: u64,
    seen: u64,
    seen_shown: u64,
    detectable: u64,
    detectable_shown: u64,
    errors_m: Vec<f64>,
    delays_s: Vec<f64>,
    false_tracks: u64,
    played_s: f64,
    cost_s: f64,
}

struct Options {
    settings: Settings,
    session: PlaySession,
    controllers: bool,
    each: bool,
}

fn main() {
    let (mut seeds, mut seconds, mut changes) = (0..4, 20.0, Vec::new());
    let (mut controllers, mut each, mut visitor, mut hands) = (false, false, true, true);
    let mut session = PlaySession::new(preset("d16").expect("d16 exists"), 0);
    for argument in std::env::args().skip(1) {
        match argument.split_once('=') {
            Some(("--seconds", value)) => seconds = value.parse().expect("seconds"),
            Some(("--preset", value)) => session.config = preset(value).expect("a preset"),
            Some(("--world", value)) => session.world = PlayWorld::from_name(value).expect("a world"),
            Some(("--headset", value)) => session.errors = Headset::from_name(value).expect("a headset").errors(),
            Some(("--effects", value)) => session.effects = value.parse().expect("effects"),
            Some(_) => changes.push(argument),
            None => match argument.as_str() {
                "--controllers" => controllers = true,
                "--each" => each = true,
                "--no-visitor" => visitor = false,
                "--no-hands" => hands = false,
                range => {
                    let (first, end) = range.split_once("..").expect("FIRST..END");
                    seeds = first.parse().expect("a seed")..end.parse().expect("a seed");
                }
            },
        }
    }
    let settings = Settings::from_toml("", &changes).unwrap_or_else(|error| panic!("{error}"));
    let session = PlaySession { duration_s: seconds, hands, visitor, ..session };
    let options = Options { settings, session, controllers, each };
    let mut figures = Figures::default();
    for seed in seeds {
        let session =
            PlaySession { seed, ..options.session.clone() }.prepare().unwrap_or_else(|error| panic!("{error}"));
        play(&session, &options, &mut figures);
    }
    figures.print();
}

/// One session, sub-aperture by sub-aperture.
fn play(session: &Session, options: &Options, figures: &mut Figures) {
    let (play, settings) = (session.play(), &options.settings);
    let mut observer = Observer::new(
        &play.config,
        ObserverSettings {
            history: settings.tracking.history,
            head_from_sensor: play.head_from_sensor,
            time_offset_s: 0.0,
            range_bias_m: None,
        },
    );
    let mut builder = SubapertureBuilder::new(settings.rooms.subapertures);
    let mut watch = SessionMonitor::new(session, options);
    let batch = (4.0 / frame_timing(&play.config).frame_period_s) as u64;
    let mut frames = Vec::new().into_iter().peekable();
    let mut next = 0;
    for pose in session.poses() {
        loop {
            if frames.peek().is_none() && next < session.frame_count() {
                frames = session.frames(next..(next + batch).min(session.frame_count())).into_iter().peekable();
                next += batch;
            }
            let Some(frame) = frames.next_if(|f: &a121::Frame| f.host_time_ns <= pose.time_ns) else {
                break;
            };
            let _ = observer.push_frame(frame);
        }
        watch.push_hands(pose.time_ns);
        let _ = observer.push_pose(&pose);
        for observation in observer.take_ready() {
            if let Some(subaperture) = builder.push(observation) {
                watch.take(&subaperture, figures);
            }
        }
    }
    figures.played_s += play.duration_s;
}

struct SessionMonitor<'a> {
    session: &'a Session,
    options: &'a Options,
    tracks: MovingTargetTracker,
    finder: MtiFilter,
    hands: HandTrail,
    /// Time at which a person entered the beam, seconds, and whether they were shown since.
    came_s: Option<(f64, bool)>,
    false_ids: Vec<u64>,
}

impl<'a> SessionMonitor<'a> {
    fn new(session: &'a Session, options: &'a Options) -> Self {
        let moving = options.settings.rooms.moving;
        Self {
            session,
            options,
            tracks: MovingTargetTracker::new(moving, &session.play().beam),
            finder: MtiFilter::new(&session.play().beam, moving.alarms_per_subaperture),
            hands: HandTrail::default(),
            came_s: None,
            false_ids: Vec::new(),
        }
    }

    fn push_hands(&mut self, time_ns: i64) {
        let time_s = (time_ns - Session::host_ns(0.0)) as f64 * 1e-9;
        if let Some(hands_m) = self.session.hands_at(time_s).filter(|_| self.options.controllers) {
            self.hands.push(time_ns, hands_m.map(Some), None);
        }
    }

    fn take(&mut self, subaperture: &Subaperture, figures: &mut Figures) {
        let start_s = cpu_s();
        self.tracks.push(subaperture, &self.hands, self.options.settings.rooms.tracks.hands_reach_m);
        figures.cost_s += cpu_s() - start_s;
        let time_s = (subaperture.mid_time_ns - Session::host_ns(0.0)) as f64 * 1e-9;
        let sensor = self.session.sensor_at(time_s);
        let parts = self.session.visitor_at(time_s);
        let moving = self.tracks.targets();
        let movers = self.finder.detect(subaperture);
        figures.subapertures += 1;
        figures.not_evaluable += u64::from(movers.is_none());
        let is_near = |part: &DVec3| part.distance(sensor.translation) <= NEAR_M && self.session.is_seen(time_s, *part);
        if self.options.each
            && let Some(movers) = movers.as_ref().filter(|m| !m.echoes.is_empty())
        {
            println!(
                "seed {} {time_s:.2} s still {:.2?} echoes {:.2?} body {:.2?}",
                self.session.play().seed,
                movers.clutter_m_per_s,
                movers.echoes.iter().map(|e| (e.range_m, e.range_rate_m_per_s, e.power)).collect::<Vec<_>>(),
                parts.get(CHEST).map(|p| p.distance(sensor.translation))
            );
        }
        if parts.iter().any(is_near) {
            let is_shown = moving.iter().any(|one| range_off_m(one, &parts) <= RIGHT_M);
            let later = self.session.visitor_at(time_s + 0.01);
            let rate = later.get(CHEST).map(|p| {
                (p.distance(self.session.sensor_at(time_s + 0.01).translation)
                    - parts[CHEST].distance(sensor.translation))
                    / 0.01
            });
            let is_told = movers.as_ref().zip(rate).is_some_and(|(movers, rate)| movers.is_observable(rate));
            figures.seen += 1;
            figures.seen_shown += u64::from(is_shown);
            figures.detectable += u64::from(is_told);
            figures.detectable_shown += u64::from(is_told && is_shown);
            let (came_s, was_shown) = self.came_s.unwrap_or((time_s, false));
            if is_shown && !was_shown {
                figures.delays_s.push(time_s - came_s);
            }
            self.came_s = Some((came_s, was_shown || is_shown));
            for one in moving.iter().filter(|one| range_off_m(one, &parts) <= RIGHT_M) {
                figures.errors_m.push(one.range_m - parts[CHEST].distance(one.seen_from.translation));
            }
        } else if parts.is_empty() {
            self.came_s = None;
        }
        for one in &moving {
            let recent = (0..=(AFTER_S * 10.0) as usize).map(|n| movers_at(self.session, time_s - n as f64 * 0.1));
            let is_false = recent.into_iter().all(|parts| range_off_m(one, &parts) > FALSE_M);
            if is_false && !self.false_ids.contains(&one.id) {
                self.false_ids.push(one.id);
                figures.false_tracks += 1;
                if self.options.each {
                    println!("seed {} {time_s:.2} s FALSE {one:?}", self.session.play().seed);
                }
            }
        }
    }
}

/// CPU time of this thread, seconds.
fn cpu_s() -> f64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    now.tv_sec as f64 + now.tv_nsec as f64 * 1e-9
}

fn quantile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(((values.len().max(1) - 1) as f64 * share).round() as usize).copied().unwrap_or(f64::NAN)
}

impl Figures {
    fn print(mut self) {
        let percent = |part: u64, of: u64| 100.0 * part as f64 / of.max(1) as f64;
        let mut off_m: Vec<f64> = self.errors_m.iter().map(|m| m.abs()).collect();
        println!(
            "played {:.1} min, {} sub-apertures, {:.1} % of them not evaluable",
            self.played_s / 60.0,
            self.subapertures,
            percent(self.not_evaluable, self.subapertures)
        );
        println!(
            "in the beam within {NEAR_M} m: {} sub-apertures, {:.1} % shown",
            self.seen,
            percent(self.seen_shown, self.seen)
        );
        println!(
            "   and distinguishable from objects at rest: {} sub-apertures, {:.1} % shown",
            self.detectable,
            percent(self.detectable_shown, self.detectable)
        );
        println!(
            "range error to the chest, m: median {:.2}, 90 % {:.2}, signed median {:.2}",
            quantile(&mut off_m, 0.5),
            quantile(&mut off_m, 0.9),
            quantile(&mut self.errors_m, 0.5)
        );
        println!(
            "shown {} times, s after coming into the beam: median {:.2}, 90 % {:.2}",
            self.delays_s.len(),
            quantile(&mut self.delays_s, 0.5),
            quantile(&mut self.delays_s, 0.9)
        );
        println!(
            "false targets: {}, {:.2} per minute",
            self.false_tracks,
            self.false_tracks as f64 / self.played_s * 60.0
        );
        println!(
            "cost: {:.3} ms per sub-aperture, {:.2} % of a core",
            self.cost_s * 1e3 / self.subapertures as f64,
            100.0 * self.cost_s / self.played_s
        );
    }
}
