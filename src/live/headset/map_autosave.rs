//! Keeps the map from one start to the next: a thread of its own beside the frame loop, since it reads and writes files.
//!
//! Once it is known which universe this is and there is a reconstruction, the universe's map is handed to that as provisional; every half
//! minute and at the end what is known is written. What is written is in the raw universe's frame. A raw universe that leaps while its name
//! stays makes what was kept of it worthless; and who
//! presses the panel's button to forget the room wants that of what is kept as well.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use super::pose_thread::{RoomFrame, SharedFrame};
use crate::live::{Reconstruction, SettingsStore, now_ns};
use radar_mapping::SavedMap;
use radar_recording::{MapFile, MapFileError, MapFolder};

/// Between two looks at what there is to do.
const POLL_INTERVAL: Duration = Duration::from_millis(50);
/// Between two times that the map is written, nanoseconds.
const SAVE_INTERVAL_NS: i64 = 30_000_000_000;
/// After a leap the tracking system may still tell that this is another universe, nanoseconds.
const LEAP_SETTLE_NS: i64 = 1_000_000_000;

/// Where maps are kept, and whether what is there is forgotten: once for each room, however many sessions there are.
#[derive(Debug)]
pub struct MapStore {
    folder: MapFolder,
    forget: bool,
    /// Universes that were begun anew.
    reset_universes: Mutex<Vec<u64>>,
}

impl MapStore {
    /// The maps of all rooms are in a folder; `forget`: each room's is removed when it is first come upon.
    pub fn new(folder: MapFolder, forget: bool) -> Self {
        Self { folder, forget, reset_universes: Mutex::default() }
    }

    /// Whether a universe's map is to be forgotten now.
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
    pub reconstruction: &'a (dyn Fn() -> Option<&'a Reconstruction> + Sync),
    pub settings: &'k SettingsStore,
}

/// What was done so far.
#[derive(Default)]
struct Progress {
    /// In this epoch, of this universe, what was kept has been taken up.
    restored: Option<(u64, u64)>,
    leaps: u64,
    leapt: Option<(u64, i64)>,
    map_resets: u64,
    saved_ns: i64,
    has_failed: bool,
}

impl MapAutosave<'_, '_> {
    /// Until the frame loop is over.
    pub fn run(&self, done: &AtomicBool) {
        let mut progress = Progress { saved_ns: now_ns(), ..Progress::default() };
        while !done.load(Ordering::Relaxed) {
            std::thread::sleep(POLL_INTERVAL);
            self.step(&mut progress, false);
        }
        self.step(&mut progress, true);
    }

    fn step(&self, progress: &mut Progress, is_last: bool) {
        let Some(reconstruction) = (self.reconstruction)() else { return };
        // Whoever lays the frame anew forgets under the same lock: frame and epoch belong together.
        let frame = self.frame.lock().unwrap_or_else(PoisonError::into_inner);
        let (room, epoch) = (*frame, reconstruction.epoch());
        drop(frame);
        let Some(room) = room else { return };
        let Some(universe) = room.universe else { return };
        let (keeps, is_reset) = (self.settings.newest().headset.keep_map, progress.map_resets != room.map_resets);
        if !(keeps || is_reset) || !self.has_settled(progress, &room, universe) {
            return;
        }
        if is_reset {
            progress.map_resets = room.map_resets;
            self.remove(progress, universe);
            // Though it could not be removed it is not taken up again.
            progress.restored = Some((epoch, universe));
        }
        if !keeps {
            return;
        }
        if progress.restored != Some((epoch, universe)) {
            progress.restored = Some((epoch, universe));
            if let Some(remembered) = self.load(progress, &room, universe) {
                reconstruction.restore(epoch, remembered);
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

    /// Whether it is known which room this is; what was kept of one that has leapt is removed.
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
                    log::warn!("the map that was kept of this room is of no use any more: it begins anew");
                }
                true
            }
        }
    }

    /// What was kept of a room, in the session's frame and by its clock.
    fn load(&self, progress: &mut Progress, room: &RoomFrame, universe: u64) -> Option<SavedMap> {
        if self.maps.take_reset(universe) {
            if self.remove(progress, universe) {
                log::info!("the map that was kept of this room is forgotten");
            }
            return None;
        }
        match self.maps.folder.load(universe) {
            Ok(file) => {
                let file = file?;
                let age_s = (unix_s() - file.saved_unix_s).max(0.0);
                let saved_ns = now_ns().saturating_sub((age_s * 1e9) as i64);
                let (places, walls) = (file.map.places.len(), file.map.walls.len());
                log::info!("{places} places and {walls} walls are remembered of this room");
                Some(file.map.moved(&room.session_from_raw).later_by_ns(saved_ns))
            }
            Err(error) => {
                let aside = match error {
                    // It may be sound.
                    MapFileError::Io { .. } => None,
                    _ => self.maps.folder.move_aside(universe).ok(),
                };
                let aside = aside.map_or(String::new(), |path| format!("; it is kept as {}", path.display()));
                log::warn!("the map that was kept of this room is left out: {error}{aside}");
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
        log::warn!("the map is not kept: {error}");
    }
}

fn unix_s() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64())
}
