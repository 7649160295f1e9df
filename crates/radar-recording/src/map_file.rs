//! The map of a room as a file: what is kept from one start to the next, one file for each universe of the tracking system, as JSON.
//!
//! A file is written whole or not at all, at most [`MAX_ROOMS`] are kept, and nothing in one is trusted: a file that is too long, of
//! another format or universe, or with numbers that are none is an error, which costs the map and nothing else.

use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use radar_mapping::{SavedMap, SavedMapError};
use radar_sar::geometry::Pose;

/// The only format there is.
const FORMAT_VERSION: u32 = 1;
/// A longer file is no map.
const MAX_BYTES: u64 = 8 << 20;
/// Rooms that are kept; the one that was not written for longest goes.
pub const MAX_ROOMS: usize = 16;

/// Why there is no map.
#[derive(Debug, thiserror::Error)]
pub enum MapFileError {
    /// The system refuses.
    #[error("cannot {doing} {}: {source}", path.display())]
    Io {
        /// What was tried.
        doing: &'static str,
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// No map by its length.
    #[error("{} is longer than a map: {MAX_BYTES} bytes at most", .0.display())]
    TooLong(PathBuf),
    /// Not what is written.
    #[error("{} is no map: {source}", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// Why not.
        source: serde_json::Error,
    },
    /// A format that is not known.
    #[error("{} is a map of format {found}; {FORMAT_VERSION} is known", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// Its format.
        found: u32,
    },
    /// Of another room.
    #[error("{} is the map of another universe, {found}", path.display())]
    Universe {
        /// The file.
        path: PathBuf,
        /// Its universe.
        found: u64,
    },
    /// Numbers that are none.
    #[error("{} has numbers that make no map: {source}", path.display())]
    Numbers {
        /// The file.
        path: PathBuf,
        /// Which.
        source: SavedMapError,
    },
    /// A pose or time that is none.
    #[error("{} has a standing universe or a time that is none", .0.display())]
    Place(PathBuf),
}

/// The map of a room, in the raw universe's frame, which recentring does not move.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MapFile {
    format_version: u32,
    /// The tracking system's name for the room.
    pub universe: u64,
    /// When it was written, seconds of Unix time.
    pub saved_unix_s: f64,
    /// Where the standing universe was then.
    pub standing_from_raw: Pose,
    /// What is known; times are nanoseconds since it was written, so none is above 0.
    pub map: SavedMap,
}

/// The format alone: what else there is depends on it.
#[derive(Deserialize)]
struct Format {
    format_version: u32,
}

impl MapFile {
    /// A map as it is now.
    pub fn new(universe: u64, saved_unix_s: f64, standing_from_raw: Pose, map: SavedMap) -> Self {
        Self { format_version: FORMAT_VERSION, universe, saved_unix_s, standing_from_raw, map }
    }

    /// Reads a file.
    ///
    /// # Errors
    /// The file is not there, too long, damaged, of another format, or has numbers that are none.
    pub fn read(path: &Path) -> Result<Self, MapFileError> {
        let (read, own) = (io_error("read", path), || path.to_owned());
        let mut text = Vec::new();
        File::open(path).and_then(|file| file.take(MAX_BYTES + 1).read_to_end(&mut text)).map_err(read)?;
        if text.len() as u64 > MAX_BYTES {
            return Err(MapFileError::TooLong(own()));
        }
        let no_map = |source| MapFileError::Json { path: own(), source };
        let Format { format_version: found } = serde_json::from_slice(&text).map_err(no_map)?;
        if found != FORMAT_VERSION {
            return Err(MapFileError::Format { path: own(), found });
        }
        let mut file: Self = serde_json::from_slice(&text).map_err(no_map)?;
        file.map.check().map_err(|source| MapFileError::Numbers { path: own(), source })?;
        let Pose { translation, rotation } = file.standing_from_raw;
        let standing = Pose::try_new(translation.to_array(), rotation.to_array());
        let is_time = file.saved_unix_s.is_finite();
        file.standing_from_raw = standing.ok().filter(|_| is_time).ok_or_else(|| MapFileError::Place(own()))?;
        Ok(file)
    }

    /// Writes the file, whole or not at all; its folder is made.
    ///
    /// # Errors
    /// The system refuses.
    pub fn write(&self, path: &Path) -> Result<(), MapFileError> {
        let error = io_error("write", path);
        let beside = path.with_extension(format!("{}.tmp", std::process::id()));
        let write = || {
            path.parent().map_or(Ok(()), fs::create_dir_all)?;
            fs::write(&beside, serde_json::to_vec(self)?)?;
            fs::rename(&beside, path)
        };
        write().map_err(|source| {
            // The first failure is the one to tell of.
            let _ = fs::remove_file(&beside);
            error(source)
        })
    }
}

/// The folder with the maps of all rooms.
#[derive(Debug, Clone)]
pub struct MapFolder(PathBuf);

impl MapFolder {
    /// It need not be there.
    pub fn new(folder: PathBuf) -> Self {
        Self(folder)
    }

    fn file(&self, universe: u64) -> PathBuf {
        self.0.join(format!("universe-{universe}.json"))
    }

    /// The map of a room; `None`: there is none.
    ///
    /// # Errors
    /// See [`MapFile::read`]; and a map of another universe.
    pub fn load(&self, universe: u64) -> Result<Option<MapFile>, MapFileError> {
        let path = self.file(universe);
        match MapFile::read(&path) {
            Err(MapFileError::Io { source, .. }) if source.kind() == io::ErrorKind::NotFound => Ok(None),
            Ok(file) if file.universe != universe => Err(MapFileError::Universe { path, found: file.universe }),
            read => read.map(Some),
        }
    }

    /// Keeps the map of a room; the oldest of too many go. Nothing is written where there is neither a map nor anything to keep.
    ///
    /// # Errors
    /// The system refuses.
    pub fn save(&self, file: &MapFile) -> Result<(), MapFileError> {
        let path = self.file(file.universe);
        if file.map.is_empty() && !path.exists() {
            return Ok(());
        }
        file.write(&path)?;
        for old in self.others_by_age(&path).iter().skip(MAX_ROOMS - 1) {
            fs::remove_file(old).map_err(io_error("remove", old))?;
        }
        Ok(())
    }

    /// Forgets the map of a room, and what was put aside of it; says whether there was one.
    ///
    /// # Errors
    /// The system refuses.
    pub fn remove(&self, universe: u64) -> Result<bool, MapFileError> {
        let path = self.file(universe);
        let is_removed = |path: &Path| match fs::remove_file(path) {
            Ok(()) => Ok(true),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
            Err(source) => Err(io_error("remove", path)(source)),
        };
        let was_there = is_removed(&path)?;
        is_removed(&aside_path(&path))?;
        Ok(was_there)
    }

    /// Puts a room's map aside that cannot be used, so that it is not written over; says where it is now. One that was put aside before goes.
    ///
    /// # Errors
    /// The system refuses.
    pub fn move_aside(&self, universe: u64) -> Result<PathBuf, MapFileError> {
        let path = self.file(universe);
        let aside = aside_path(&path);
        fs::rename(&path, &aside).map_err(io_error("rename", &path))?;
        Ok(aside)
    }

    /// Maps but this one, newest first.
    fn others_by_age(&self, but: &Path) -> Vec<PathBuf> {
        let entries = fs::read_dir(&self.0).into_iter().flatten().filter_map(Result::ok);
        let is_map = |path: &Path| {
            let name = path.file_name().and_then(|name| name.to_str());
            name.is_some_and(|name| name.starts_with("universe-") && name.ends_with(".json"))
        };
        let paths = entries.map(|entry| entry.path()).filter(|path| is_map(path) && path != but);
        let aged = paths.filter_map(|path| Some((fs::metadata(&path).and_then(|data| data.modified()).ok()?, path)));
        let mut aged: Vec<_> = aged.collect();
        aged.sort_by(|a, b| b.cmp(a));
        aged.into_iter().map(|(_, path)| path).collect()
    }
}

/// Where a map is put that cannot be used.
fn aside_path(map: &Path) -> PathBuf {
    map.with_extension("json.bad")
}

fn io_error(doing: &'static str, path: &Path) -> impl Fn(io::Error) -> MapFileError {
    let path = path.to_owned();
    move |source| MapFileError::Io { doing, path: path.clone(), source }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DQuat, DVec3};
    use radar_mapping::{SavedPoint, SavedWall};
    use radar_sar::geometry::{Aabb, Plane};

    struct Folder(PathBuf);

    impl Folder {
        fn new(name: &str) -> Self {
            let folder = std::env::temp_dir().join(format!("map-file-{name}-{}", std::process::id()));
            let _ = fs::remove_dir_all(&folder);
            Self(folder)
        }

        fn maps(&self) -> MapFolder {
            MapFolder::new(self.0.clone())
        }
    }

    impl Drop for Folder {
        fn drop(&mut self) {
            let _ = fs::remove_dir_all(&self.0);
        }
    }

    fn map(universe: u64) -> MapFile {
        let place = SavedPoint {
            id: 3,
            position_m: DVec3::new(0.1 + 0.2, 1.0 / 3.0, -1e-17),
            covariance_m2: DMat3::from_diagonal(DVec3::new(1e-4, 4e-4, 9e-4)),
            score: 8.7,
            strengths: std::array::from_fn(|side| side as f64 * 0.1),
            shape: vec![(DVec3::new(0.3, 0.3, 0.0), 7.1)],
            first_ns: -1_000_000_007,
            last_ns: -5,
        };
        let wall = SavedWall {
            id: 1,
            plane: Plane { outward: DVec3::new(0.6, 0.0, -0.8), offset_m: 2.0 },
            score: 20.0,
            seen_at: Aabb { min: DVec3::NEG_ONE, max: DVec3::ONE },
            first_ns: -9,
            last_ns: -4,
        };
        let standing_from_raw = Pose::new(DVec3::new(0.3, -0.05, 0.2), DQuat::from_rotation_y(0.5));
        MapFile::new(universe, 1.7e9, standing_from_raw, SavedMap { places: vec![place], walls: vec![wall] })
    }

    #[test]
    fn loaded_map_equals_saved_map() {
        let folder = Folder::new("same");
        let maps = folder.maps();
        assert!(maps.load(7).unwrap().is_none());
        maps.save(&map(7)).unwrap();
        let loaded = maps.load(7).unwrap().unwrap();
        assert_eq!(loaded.map, map(7).map, "to the bit");
        assert!(loaded.standing_from_raw.translation == map(7).standing_from_raw.translation);
        assert_eq!(fs::read_dir(&folder.0).unwrap().count(), 1, "nothing is left beside it");
        assert!(maps.remove(7).unwrap() && !maps.remove(7).unwrap());
        let empty = MapFile { map: SavedMap::default(), ..map(7) };
        maps.save(&empty).unwrap();
        assert!(maps.load(7).unwrap().is_none(), "nothing is not written");
        maps.save(&map(7)).unwrap();
        maps.save(&empty).unwrap();
        assert!(maps.load(7).unwrap().unwrap().map.is_empty(), "but what is gone is gone");
    }

    #[test]
    fn unusable_map_is_moved_aside_and_kept() {
        let folder = Folder::new("aside");
        let maps = folder.maps();
        maps.save(&map(3)).unwrap();
        fs::write(maps.file(3), "no map").unwrap();
        assert!(maps.load(3).is_err());
        let aside = maps.move_aside(3).unwrap();
        maps.save(&map(3)).unwrap();
        assert_eq!(fs::read_to_string(&aside).unwrap(), "no map");
        assert!(maps.load(3).unwrap().is_some());
        assert!(maps.remove(3).unwrap() && !aside.exists() && !maps.remove(3).unwrap(), "all of it is forgotten");
    }

    #[test]
    fn oldest_maps_are_removed() {
        let folder = Folder::new("oldest");
        let maps = folder.maps();
        for universe in 0..MAX_ROOMS as u64 + 3 {
            maps.save(&map(universe)).unwrap();
            let time = std::time::UNIX_EPOCH + std::time::Duration::from_secs(1_000_000 + universe);
            File::options().append(true).open(maps.file(universe)).unwrap().set_modified(time).unwrap();
        }
        maps.save(&map(50)).unwrap();
        assert_eq!(fs::read_dir(&folder.0).unwrap().count(), MAX_ROOMS);
        assert!(maps.load(3).unwrap().is_none() && maps.load(4).unwrap().is_some() && maps.load(50).unwrap().is_some());
    }

    #[test]
    fn invalid_map_file_is_an_error() {
        let folder = Folder::new("bad");
        let maps = folder.maps();
        maps.save(&map(7)).unwrap();
        let text = fs::read_to_string(maps.file(7)).unwrap();
        let spoilt: [(String, &str); 7] = [
            (text[..text.len() / 2].to_owned(), "is no map"),
            (String::new(), "is no map"),
            (text.replace("\"format_version\":1", "\"format_version\":2"), "format 2"),
            (text.replace("\"universe\":7", "\"universe\":8"), "another universe, 8"),
            (text.replace("\"score\":8.7", "\"score\":-8.7"), "the score of 3"),
            (text.replace("\"score\":8.7", "\"score\":1e999"), "is no map"),
            (" ".repeat(MAX_BYTES as usize + 1), "longer than a map"),
        ];
        for (spoilt, says) in spoilt {
            assert_ne!(spoilt, text);
            fs::write(maps.file(7), spoilt).unwrap();
            let error = maps.load(7).unwrap_err().to_string();
            assert!(error.contains(says), "{error}, not {says}");
        }
        let mut flipped = text.clone().into_bytes();
        for at in (0..flipped.len()).step_by(3) {
            flipped[at] ^= 0x11;
            fs::write(maps.file(7), &flipped).unwrap();
            // Whatever it is taken for, it is sound.
            if let Ok(Some(file)) = maps.load(7) {
                file.map.check().unwrap();
            }
            flipped[at] ^= 0x11;
        }
    }
}
