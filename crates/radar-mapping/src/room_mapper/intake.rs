//! First stage: groups sweeps into sub-apertures, and keeps the window's sweeps for the refinement.

use std::collections::{BTreeMap, VecDeque};

use glam::DVec3;
use radar_sar::Observation;
use radar_sar::geometry::{Plane, Pose};
use radar_sar::subaperture::{Subaperture, SubapertureBuilder, SubapertureSettings};

/// Sweeps on their way into sub-apertures.
#[derive(Debug)]
pub(super) struct SweepIntake {
    settings: SubapertureSettings,
    /// By subsweep.
    builders: BTreeMap<usize, SubapertureBuilder>,
    /// Sweeps of the window, for the refinement.
    sweeps: VecDeque<Observation>,
    /// Number of those taken since the last sub-aperture was completed.
    sweeps_since: usize,
    /// Sweeps that are processed first, because they are imaged again.
    backlog: VecDeque<Observation>,
    /// Position of the sensor at the newest sweep.
    sensor_m: Option<DVec3>,
}

impl SweepIntake {
    /// `backlog`: sweeps to process before any new ones.
    pub fn new(settings: SubapertureSettings, backlog: VecDeque<Observation>) -> Self {
        let (builders, sweeps) = (BTreeMap::new(), VecDeque::new());
        Self { settings, builders, sweeps, sweeps_since: 0, backlog, sensor_m: None }
    }

    /// Position of the sensor at the newest sweep.
    pub fn sensor_m(&self) -> Option<DVec3> {
        self.sensor_m
    }

    /// Sweeps skipped: too few before a pause to make a sub-aperture.
    pub fn dropped_sweeps(&self) -> u64 {
        self.builders.values().map(|builder| builder.dropped_sweeps).sum()
    }

    /// Takes a new sweep; returns it unless it has to wait behind the backlog.
    pub fn receive(&mut self, observation: Observation) -> Option<Observation> {
        self.sensor_m = Some(observation.tracking_from_sensor.translation);
        if self.backlog.is_empty() {
            return Some(observation);
        }
        self.backlog.push_back(observation);
        None
    }

    /// The next sweep of the backlog.
    pub fn next_of_backlog(&mut self) -> Option<Observation> {
        self.backlog.pop_front()
    }

    pub fn has_backlog(&self) -> bool {
        !self.backlog.is_empty()
    }

    /// When a sweep would close the current sub-aperture: gives that sub-aperture's sweeps the
    /// sensor poses and velocities that `sensor_at` returns for their times.
    pub fn update_poses_before(&mut self, next: &Observation, sensor_at: impl Fn(i64) -> Option<(Pose, DVec3)>) {
        let subsweep = next.geometry.subsweep;
        let builder = self.builders.get_mut(&subsweep).filter(|builder| builder.is_closed_by(next.mid_time_ns));
        let Some(sweeps) = builder.filter(|_| self.backlog.is_empty()).map(SubapertureBuilder::sweeps_mut) else {
            return;
        };
        let Some(first_ns) = sweeps.first().map(|sweep| sweep.mid_time_ns) else { return };
        // The sweeps kept for the refinement are copies of these.
        let kept = self.sweeps.iter_mut().rev().take_while(|sweep| sweep.mid_time_ns >= first_ns);
        for sweep in sweeps.iter_mut().chain(kept.filter(|sweep| sweep.geometry.subsweep == subsweep)) {
            if let Some((tracking_from_sensor, velocity_m_per_s)) = sensor_at(sweep.mid_time_ns) {
                (sweep.tracking_from_sensor, sweep.velocity_m_per_s) = (tracking_from_sensor, velocity_m_per_s);
            }
        }
    }

    /// Keeps a copy of a sweep for the refinement; returns whether the sweep closes the current
    /// sub-aperture.
    pub fn keep(&mut self, observation: &Observation) -> bool {
        self.sweeps.push_back(observation.clone());
        self.sweeps_since += 1;
        let builder = self.builders.get(&observation.geometry.subsweep);
        builder.is_some_and(|builder| builder.is_closed_by(observation.mid_time_ns))
    }

    /// Adds a sweep; returns the sub-aperture that it completes.
    pub fn add(&mut self, observation: Observation) -> Option<Subaperture> {
        let settings = self.settings;
        let builder = self.builders.entry(observation.geometry.subsweep);
        let completed = builder.or_insert_with(|| SubapertureBuilder::new(settings)).push(observation);
        if completed.is_some() {
            self.sweeps_since = 0;
        }
        completed
    }

    /// Makes the following sub-apertures cancel these walls.
    pub fn cancel_walls(&mut self, walls: &[Plane]) {
        self.builders.values_mut().for_each(|builder| builder.cancel_walls(walls));
    }

    /// Completes the sub-apertures that are being gathered.
    pub fn close(&mut self) -> Vec<Subaperture> {
        self.builders.values_mut().filter_map(SubapertureBuilder::close).collect()
    }

    /// Drops sweeps that have left the window.
    pub fn drop_before(&mut self, since_ns: i64) {
        while self.sweeps.pop_front_if(|sweep| sweep.mid_time_ns < since_ns).is_some() {}
    }

    /// Sweeps of the completed sub-apertures of the window, in rising time.
    pub fn window_sweeps(&self) -> impl Iterator<Item = &Observation> {
        self.sweeps.iter().take(self.sweeps.len() - self.sweeps_since.min(self.sweeps.len()))
    }

    /// All sweeps kept, to be imaged again: those of the window, then those that wait.
    pub fn take_sweeps(&mut self) -> VecDeque<Observation> {
        let mut sweeps = std::mem::take(&mut self.sweeps);
        sweeps.append(&mut self.backlog);
        sweeps
    }
}
