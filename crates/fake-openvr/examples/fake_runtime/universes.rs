//! The tracking universes. Devices move in the world, which never changes. Raw, standing and seated
//! are defined relative to it and can be moved: recentring moves standing or seated, a change of
//! universe moves raw.

use radar_sar::geometry::Pose;

use crate::config::Config;
use crate::sys;

/// Poses of the universes. The world is the initial standing universe.
#[derive(Debug, Clone, Copy)]
pub struct Universes {
    raw_from_world: Pose,
    raw_from_standing: Pose,
    raw_from_seated: Pose,
    /// Id of the raw universe.
    pub id: u64,
}

impl Universes {
    /// The configured universes.
    pub fn new(config: &Config) -> Self {
        let raw_from_standing = config.raw_from_standing.pose();
        let raw_from_seated = config.raw_from_seated.pose();
        Self { raw_from_world: raw_from_standing, raw_from_standing, raw_from_seated, id: config.universe_id }
    }

    /// The universe's pose in raw; `None` for an invalid number.
    fn raw_from(&self, origin: sys::ETrackingUniverseOrigin) -> Option<Pose> {
        match origin {
            sys::ETrackingUniverseOrigin_TrackingUniverseSeated => Some(self.raw_from_seated),
            sys::ETrackingUniverseOrigin_TrackingUniverseStanding => Some(self.raw_from_standing),
            sys::ETrackingUniverseOrigin_TrackingUniverseRawAndUncalibrated => Some(Pose::IDENTITY),
            _ => None,
        }
    }

    /// Transform from the world to a universe; `None` for an invalid number.
    pub fn universe_from_world(&self, origin: sys::ETrackingUniverseOrigin) -> Option<Pose> {
        Some(self.raw_from(origin)?.inverse() * self.raw_from_world)
    }

    /// Transform from the world to the standing universe.
    pub fn standing_from_world(&self) -> Pose {
        self.raw_from_standing.inverse() * self.raw_from_world
    }

    /// Transform from raw to standing.
    pub fn standing_from_raw(&self) -> Pose {
        self.raw_from_standing.inverse()
    }

    /// Transform from seated to standing.
    pub fn standing_from_seated(&self) -> Pose {
        self.raw_from_standing.inverse() * self.raw_from_seated
    }

    /// Moves the standing (or seated) universe to a pose given in its previous frame.
    pub fn recenter(&mut self, seated: bool, old_from_new: Pose) {
        let moved = if seated { &mut self.raw_from_seated } else { &mut self.raw_from_standing };
        *moved = *moved * old_from_new;
    }

    /// Switches to another raw universe, at a pose in the old one. Standing and seated keep their
    /// poses in raw, so they move in the world, as after a new setup of the base stations.
    pub fn change(&mut self, old_raw_from_new: Pose) {
        self.raw_from_world = old_raw_from_new.inverse() * self.raw_from_world;
        self.id += 1;
    }
}
