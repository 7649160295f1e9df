//! Saves the map from one start to the next, in its own thread, because it accesses files.
//!
//! Once the universe is known and there is a reconstruction, the universe's saved map is restored
//! as provisional. Every half minute and at the end the map is saved, in the raw universe's frame.
//! When the raw universe leaps and its id stays, the saved map is invalid and removed. The panel's
//! button to forget the room removes the saved map as well. The sensor's mount is kept in the same intervals.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use super::pose_thread::{RoomFrame, SharedFrame};
use crate::app::{SensorSupervisor, SettingsStore, now_ns};
use radar_mapping::SavedMap;
use radar_recording::{MapFile, MapFileError, MapFolder};

/// Polling interval. Choice: a saved map is restored before the wearer has taken a step, at
/// negligible cost.
const POLL_INTERVAL: Duration = Duration::from_millis(50);
/// Interval of saves, nanoseconds. Choice: a crash costs at most this much of a map that takes
/// minutes to learn; saving costs one small file.
const SAVE_INTERVAL_NS: i64 = 30_000_000_000;
/// Time after a leap during which the tracking system may still report another universe,
/// nanoseconds. Choice: long enough for the runtime to change its universe id after a leap, short
/// enough to restore the map before the wearer has moved far.
const LEAP_SETTLE_NS: i64 = 1_000_000_000;

/// A room without an id for this time has none, nanoseconds. Choice: an id may become known after the first poses.
const MAX_NAMELESS_NS: i64 = 5_000_000_000;

/// The folder of the saved maps, and whether to remove them: once for each room, over all sessions.
#[derive(Debug)]
pub struct MapStore {
    folder: MapFolder,
    forget: bool,
    /// Universes whose map was removed.
    reset_universes: Mutex<Vec<u64>>,
}

impl MapStore {
    /// `forget`: the map of each room is removed when the room is first entered.
    pub fn new(folder: MapFolder, forget: bool) -> Self {
        Self { folder, forget, reset_universes: Mutex::default() }
    }

    /// Whether to remove a universe's map now; true once per universe.
    fn take_reset(&self, universe: u64) -> bool {
        let mut reset_universes = self.reset_universes.lock().unwrap_or_else(PoisonError::into_inner);
        let is_first = self.forget && !reset_universes.contains(&universe);
        if is_first {
            reset_universes.push(universe);
        }
        is_first
    }
}

/// What the thread works with.
pub(super) struct MapAutosave<'k, 'a> {
    pub maps: &'k MapStore,
    pub frame: &'k SharedFrame,
    pub supervisor: &'a SensorSupervisor,
    pub settings: &'k SettingsStore,
}

/// State of the thread.
#[derive(Default)]
struct Progress {
    /// Epoch and universe whose saved map was restored.
    restored: Option<(u64, u64)>,
    leaps: u64,
    leapt: Option<(u64, i64)>,
    map_resets: u64,
    saved_ns: i64,
    has_failed: bool,
    /// Since when the room has had no id, and whether that was logged.
    nameless_since_ns: Option<i64>,
    nameless_logged: bool,
}

impl MapAutosave<'_, '_> {
    /// Runs until the frame loop has ended.
    pub fn run(&self, done: &AtomicBool) {
        let mut progress = Progress { saved_ns: now_ns(), ..Progress::default() };
        let mut kept_ns = progress.saved_ns;
        while !done.load(Ordering::Relaxed) {
            std::thread::sleep(POLL_INTERVAL);
            self.step(&mut progress, false);
            if now_ns().saturating_sub(kept_ns) >= SAVE_INTERVAL_NS {
                kept_ns = now_ns();
                self.supervisor.keep_mount();
            }
        }
        self.step(&mut progress, true);
        self.supervisor.keep_mount();
    }

    fn step(&self, progress: &mut Progress, is_last: bool) {
        let Some(reconstruction) = self.supervisor.reconstruction() else { return };
        // A map reset changes frame and epoch under this lock, so they belong together.
        let frame = self.frame.lock().unwrap_or_else(PoisonError::into_inner);
        let (room, epoch) = (*frame, reconstruction.epoch());
        drop(frame);
        let Some(room) = room else { return };
        let Some(universe) = room.universe else { return self.log_nameless_room(progress) };
        let (keeps, is_reset) = (self.settings.newest().headset.keep_map, progress.map_resets != room.map_resets);
        if !(keeps || is_reset) || !self.has_settled(progress, &room, universe) {
            return;
        }
        if is_reset {
            progress.map_resets = room.map_resets;
            self.remove(progress, universe);
            // Even if it could not be removed it is not restored again.
            progress.restored = Some((epoch, universe));
        }
        if !keeps {
            return;
        }
        if progress.restored != Some((epoch, universe)) {
            progress.restored = Some((epoch, universe));
            if let Some(saved) = self.load(progress, &room, universe) {
                reconstruction.restore(epoch, saved);
            }
            return;
        }
        if is_last || now_ns().saturating_sub(progress.saved_ns) >= SAVE_INTERVAL_NS {
            progress.saved_ns = now_ns();
            if let Some((_, known)) = reconstruction.saved_map().filter(|(of, _)| *of == epoch) {
                self.save(progress, &room, universe, &known);
            }
        }
    }

    /// Logs once that the map is not kept, when a room has had no id for some time.
    fn log_nameless_room(&self, progress: &mut Progress) {
        let since_ns = *progress.nameless_since_ns.get_or_insert(now_ns());
        let is_lasting = now_ns().saturating_sub(since_ns) >= MAX_NAMELESS_NS;
        if is_lasting && !progress.nameless_logged && self.settings.newest().headset.keep_map {
            log::warn!("the VR runtime has no id for this room: the map is not kept for the next session");
            progress.nameless_logged = true;
        }
    }

    /// Whether the current room is certain; removes the saved map of a room that has leapt.
    fn has_settled(&self, progress: &mut Progress, room: &RoomFrame, universe: u64) -> bool {
        let now_ns = now_ns();
        if room.leaps != progress.leaps {
            progress.leaps = room.leaps;
            progress.leapt = Some((universe, now_ns));
        }
        match progress.leapt {
            None => true,
            Some((of, _)) if of != universe => {
                progress.leapt = None;
                true
            }
            Some((_, since_ns)) if now_ns.saturating_sub(since_ns) < LEAP_SETTLE_NS => false,
            Some(_) => {
                progress.leapt = None;
                if self.remove(progress, universe) {
                    log::warn!("the saved map of this room is no longer valid and was removed");
                }
                true
            }
        }
    }

    /// Loads the saved map of a room, into the session frame and the host's clock.
    fn load(&self, progress: &mut Progress, room: &RoomFrame, universe: u64) -> Option<SavedMap> {
        if self.maps.take_reset(universe) {
            if self.remove(progress, universe) {
                log::info!("the saved map of this room was removed");
            }
            return None;
        }
        match self.maps.folder.load(universe) {
            Ok(file) => {
                let file = file?;
                let age_s = (unix_s() - file.saved_unix_s).max(0.0);
                let saved_ns = now_ns().saturating_sub((age_s * 1e9) as i64);
                let (places, walls) = (file.map.places.len(), file.map.walls.len());
                log::info!("{places} points and {walls} walls are restored from the saved map of this room");
                Some(file.map.moved(&room.session_from_raw).later_by_ns(saved_ns))
            }
            Err(error) => {
                let aside = match error {
                    // The file itself may be valid.
                    MapFileError::Io { .. } => None,
                    _ => self.maps.folder.move_aside(universe).ok(),
                };
                let aside = aside.map_or(String::new(), |path| format!("; it is kept as {}", path.display()));
                log::warn!("the saved map of this room is ignored: {error}{aside}");
                None
            }
        }
    }

    fn save(&self, progress: &mut Progress, room: &RoomFrame, universe: u64, known: &SavedMap) {
        let map = known.moved(&room.session_from_raw.inverse()).later_by_ns(now_ns().saturating_neg());
        let saved = self.maps.folder.save(&MapFile::new(universe, unix_s(), room.standing_from_raw, map));
        if let Err(error) = saved {
            warn_once(progress, &error);
        }
    }

    fn remove(&self, progress: &mut Progress, universe: u64) -> bool {
        self.maps.folder.remove(universe).unwrap_or_else(|error| {
            warn_once(progress, &error);
            false
        })
    }
}

fn warn_once(progress: &mut Progress, error: &MapFileError) {
    if !std::mem::replace(&mut progress.has_failed, true) {
        log::warn!("the map is not saved: {error}");
    }
}

fn unix_s() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64())
}
