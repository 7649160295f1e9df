//! What the reconstruction's thread does: takes poses and frames, works them off, publishes.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use super::{Input, Published, Shared, lock};
use crate::live::freshness::Freshness;
use crate::live::queue::Queue;
use crate::live::{Latency, Received, now_ns, thread_cpu_ns};
use crate::settings::Settings;
use a121::{Frame, SensorConfig};
use radar_mapping::Scene;
use radar_mapping::{Pipeline, Search};
use radar_sar::geometry::Pose;

/// Longest wait for input: how soon being asked to stop or to forget is noticed at the latest.
const TURN: Duration = Duration::from_millis(50);
/// Counters are renewed this often, nanoseconds.
const COUNT_NS: i64 = 100_000_000;
/// What is known of the room is told this often, nanoseconds.
const REMEMBER_NS: i64 = 1_000_000_000;
/// A search for single reflectors goes through everything kept: once a second, and for a fifth of the time at most.
const REFLECTORS_NS: i64 = 1_000_000_000;
const REFLECTORS_REST: i64 = 4;

/// What a fresh pipeline is made of.
pub(super) struct Begin {
    pub config: SensorConfig,
    pub head_from_sensor: Pose,
    pub settings: Settings,
}

impl Begin {
    /// A fresh one, whose work waits until nothing else does.
    pub fn pipeline(&self) -> Pipeline {
        let mut pipeline = Pipeline::new(&self.config, &self.head_from_sensor, &self.settings.mapping());
        pipeline.defer();
        pipeline
    }
}

/// What the thread owns.
pub(super) struct Worker {
    pipeline: Pipeline,
    begin: Begin,
    shared: Arc<Shared>,
    queue: Arc<Queue<Input, 3>>,
    epoch: u64,
    published: Published,
    /// What the scene that is published rests on, host nanoseconds.
    evidence_ns: Option<i64>,
    next_reflectors_ns: i64,
    freshness: Freshness,
    step: Latency,
    outdated: u64,
    scenes: u64,
    start_ns: i64,
    counted_ns: i64,
    remembered_ns: i64,
}

impl Worker {
    pub fn new(pipeline: Pipeline, begin: Begin, shared: Arc<Shared>, queue: Arc<Queue<Input, 3>>) -> Self {
        let now_ns = now_ns();
        Self {
            pipeline,
            begin,
            shared,
            queue,
            epoch: 0,
            published: Published::nothing(0),
            evidence_ns: None,
            next_reflectors_ns: now_ns,
            freshness: Freshness::default(),
            step: Latency::default(),
            outdated: 0,
            scenes: 0,
            start_ns: now_ns,
            counted_ns: now_ns,
            remembered_ns: now_ns,
        }
    }

    /// Works until asked to stop, or until nothing comes any more. To be called inside the pool.
    pub fn run(mut self) {
        while !self.shared.stop.load(Ordering::SeqCst) && !self.is_late() {
            // What came goes before what it set off: a look at the evidence holds up no sweep.
            let received = self.queue.receive(if self.pipeline.has_work() { Duration::ZERO } else { TURN });
            self.heed_epoch();
            self.take_up();
            match received {
                Received::Event(input) => self.take(input),
                Received::TimedOut => self.work(),
                Received::Over => break,
            }
            self.count(COUNT_NS);
            self.remember(REMEMBER_NS);
        }
        if !self.shared.stop.load(Ordering::SeqCst) {
            self.heed_epoch();
            self.pipeline.finish();
            self.publish(true);
        }
        self.count(0);
        self.remember(0);
    }

    fn is_late(&self) -> bool {
        now_ns() as u64 >= self.shared.finish_by_ns.load(Ordering::SeqCst)
    }

    /// Begins anew when everything is to be forgotten.
    fn heed_epoch(&mut self) {
        let epoch = self.shared.epoch.load(Ordering::SeqCst);
        if epoch == self.epoch {
            return;
        }
        self.epoch = epoch;
        if let Some(settings) = lock(&self.shared.next_settings).take() {
            self.begin.settings = settings;
        }
        self.pipeline = self.begin.pipeline();
        self.freshness.forget();
        self.evidence_ns = None;
        self.hand_over(Published { number: self.published.number, ..Published::nothing(epoch) });
    }

    /// Takes up what is remembered of the room; it is part of the scene at once.
    fn take_up(&mut self) {
        let shared = Arc::clone(&self.shared);
        // Held until what is told has it: nobody takes what is known without it for all there is.
        let mut waiting = lock(&shared.restore);
        let Some((_, remembered)) =
            waiting.take_if(|(epoch, _)| *epoch <= self.epoch).filter(|(e, _)| *e == self.epoch)
        else {
            return;
        };
        if let Err(error) = self.pipeline.restore(&remembered) {
            log::warn!("what is remembered of the room is left out: {error}");
        }
        self.remember(0);
        if self.pipeline.engine().search() == Search::Rooms {
            let scene = Arc::new(self.pipeline.scene());
            self.scenes += 1;
            self.hand_over(Published { scene, ..self.published.clone() });
        }
    }

    /// Tells what is known of the room, when what was told is older than this.
    fn remember(&mut self, age_ns: i64) {
        let now_ns = now_ns();
        if now_ns.saturating_sub(self.remembered_ns) < age_ns {
            return;
        }
        self.remembered_ns = now_ns;
        let remembered = Some((self.epoch, Arc::new(self.pipeline.saved_map())));
        let before = std::mem::replace(&mut *lock(&self.shared.remembered), remembered);
        // Let go after the lock is.
        drop(before);
    }

    fn take(&mut self, input: Input) {
        let (begin_ns, without_pose) = (now_ns(), self.without_pose());
        match input {
            Input::Pose(epoch, pose) if epoch == self.epoch => self.pipeline.push_pose(&pose),
            Input::Hands(epoch, hands) if epoch == self.epoch => self.pipeline.push_hands(hands.time_ns, hands.hands_m),
            Input::Frame(epoch, frame, arrived_ns) if epoch == self.epoch => self.take_frame(frame, arrived_ns),
            _ => return self.outdated += 1,
        }
        self.freshness.without_pose(self.without_pose() - without_pose);
        self.publish(false);
        self.step.push(now_ns().saturating_sub(begin_ns));
    }

    /// A part of what was set off.
    fn work(&mut self) {
        let begin_ns = now_ns();
        if self.pipeline.work() {
            self.publish(false);
            self.step.push(now_ns().saturating_sub(begin_ns));
        }
    }

    fn take_frame(&mut self, frame: Frame, arrived_ns: i64) {
        let (end_ns, refused) = (frame.host_time_ns, self.refused());
        self.pipeline.push_frame(frame);
        if self.refused() == refused {
            self.freshness.accepted(end_ns, arrived_ns);
        }
        self.pipeline.work_off_late();
    }

    /// Frames that no pose was found for.
    fn without_pose(&self) -> u64 {
        self.pipeline.counters().streams.frames_without_pose
    }

    /// Frames that the pipeline would not have.
    fn refused(&self) -> u64 {
        let streams = self.pipeline.counters().streams;
        streams.frames_saturated
            + streams.frames_wrong_length
            + streams.frames_time_not_rising
            + streams.frames_time_leapt
    }

    /// Publishes what is new.
    fn publish(&mut self, is_last: bool) {
        let newest_sweep_ns = self.pipeline.engine().newest_sweep_ns().unwrap_or(0);
        let scene = self.new_scene(is_last);
        if newest_sweep_ns == self.published.newest_sweep_ns && scene.is_none() {
            return;
        }
        self.pipeline.forget_sensor_path();
        self.scenes += u64::from(scene.is_some());
        let estimate = self.pipeline.time_offset_estimate().filter(|estimate| estimate.observable);
        self.hand_over(Published {
            number: self.published.number,
            scene: scene.map_or_else(|| Arc::clone(&self.published.scene), Arc::new),
            newest_sweep_ns,
            time_offset_s: self.pipeline.time_offset_s(),
            time_offset_sigma_s: estimate.map(|estimate| estimate.sigma_s),
            epoch: self.epoch,
        });
        let now_ns = now_ns();
        self.freshness.worked_off_until(newest_sweep_ns, now_ns);
        if let Some(evidence_ns) = self.evidence_ns {
            self.freshness.seen_until(evidence_ns, now_ns);
        }
    }

    fn hand_over(&mut self, published: Published) {
        self.published = Published { number: published.number + 1, ..published };
        let published = Arc::new(self.published.clone());
        let before = std::mem::replace(&mut *lock(&self.shared.newest), published);
        // Let go after the lock is.
        drop(before);
    }

    /// The scene, when it may have changed.
    fn new_scene(&mut self, is_last: bool) -> Option<Scene> {
        let engine = self.pipeline.engine();
        let evidence_ns = engine.evidence_ns();
        let begin_ns = now_ns();
        let is_due = engine.search() == Search::Rooms || begin_ns >= self.next_reflectors_ns;
        if !is_last && (evidence_ns == self.evidence_ns || !is_due) {
            return None;
        }
        let scene = self.pipeline.scene();
        let end_ns = now_ns();
        self.next_reflectors_ns = end_ns + REFLECTORS_NS.max(REFLECTORS_REST * (end_ns - begin_ns));
        self.evidence_ns = evidence_ns;
        self.tell_evidence();
        Some(scene)
    }

    /// The evidence behind a scene, for who watches.
    fn tell_evidence(&self) {
        let most = self.shared.evidence_wanted.load(Ordering::Relaxed);
        if most > 0 {
            let evidence = Arc::new(self.pipeline.engine().evidence(most));
            let before = lock(&self.shared.evidence).replace(evidence);
            // Let go after the lock is.
            drop(before);
        }
    }

    /// Renews the counters that others see, when they are older than this.
    fn count(&mut self, age_ns: i64) {
        let now_ns = now_ns();
        if now_ns.saturating_sub(self.counted_ns) < age_ns {
            return;
        }
        self.counted_ns = now_ns;
        let cpu_s = rayon::broadcast(|_| thread_cpu_ns()).into_iter().sum::<i64>() as f64 * 1e-9;
        let mut counters = lock(&self.shared.counters);
        counters.pipeline = self.pipeline.counters();
        counters.epoch = self.epoch;
        counters.outdated = self.outdated;
        counters.published = self.published.number;
        counters.scenes = self.scenes;
        counters.worked_off = self.freshness.worked_off();
        counters.evidence_age = self.freshness.evidence_age();
        counters.step = self.step.report();
        counters.cpu_s = cpu_s;
        counters.running_s = now_ns.saturating_sub(self.start_ns) as f64 * 1e-9;
    }
}
