//! The search for single reflectors as a mapper: keeps observations, and searches them when a scene
//! is asked for. For slow sensors and trials.

use radar_sar::Observation;
use radar_sar::geometry::{Aabb, Pose};

use super::{Evidence, MappingSettings, Obstacle, cube_ahead, find_reflectors, reflector_evidence};

/// Largest number of observations kept; beyond, every second sweep is dropped. Choice: 2.7 minutes
/// at 120 sweeps/s; with 300 points a sweep it takes 50 MB.
const MAX_OBSERVATIONS: usize = 20_000;

/// Observations of single reflectors.
#[derive(Debug)]
pub(crate) struct ReflectorMapper {
    settings: MappingSettings,
    kept: Vec<Observation>,
    first_pose: Option<Pose>,
    thinned: u64,
}

impl ReflectorMapper {
    pub fn new(settings: &MappingSettings) -> Self {
        Self { settings: settings.clone(), kept: Vec::new(), first_pose: None, thinned: 0 }
    }

    /// Observations dropped to bound memory.
    pub fn thinned(&self) -> u64 {
        self.thinned
    }

    /// Takes an observation. When full, every second sweep is dropped, so that the rest still spans
    /// the whole motion.
    pub fn push(&mut self, observation: Observation) {
        self.first_pose.get_or_insert(observation.tracking_from_sensor);
        if self.kept.len() >= MAX_OBSERVATIONS {
            let mut sweep = 0;
            let before = self.kept.len();
            let mut last_subsweep = None;
            self.kept.retain(|o| {
                sweep += usize::from(last_subsweep.is_none_or(|last| o.geometry.subsweep <= last));
                last_subsweep = Some(o.geometry.subsweep);
                sweep % 2 == 0
            });
            self.thinned += (before - self.kept.len()) as u64;
        }
        self.kept.push(observation);
    }

    /// Keeps the observations that `repose` gives a new pose.
    pub fn repose(&mut self, repose: impl FnMut(&mut Observation) -> bool) {
        self.kept.retain_mut(repose);
    }

    /// The box searched: from the settings, or a cube ahead of the first pose.
    fn region(&self) -> Aabb {
        self.settings.processing.region.unwrap_or_else(|| cube_ahead(&self.first_pose.unwrap_or(Pose::IDENTITY)))
    }

    /// The reflectors found, strongest first. This does the search.
    pub fn obstacles(&self) -> Vec<Obstacle> {
        let MappingSettings { radar, tracking, reflectors, .. } = &self.settings;
        find_reflectors(&self.kept, &radar.beam, &self.region(), reflectors, &tracking.errors)
    }

    /// The `most` strongest voxels by excess over noise.
    pub fn evidence(&self, most: usize) -> Evidence {
        let MappingSettings { radar, reflectors, .. } = &self.settings;
        reflector_evidence(&self.kept, &radar.beam, &self.region(), reflectors, most)
    }
}
