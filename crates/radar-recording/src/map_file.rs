//! Saved map of a room: a JSON file per universe of the tracking system, kept from one start to the
//! next.
//!
//! A file is written atomically, and at most [`MAX_ROOMS`] are kept. Nothing in a file is trusted:
//! one that is too long, changed, of another format or universe, or with invalid numbers is an
//! error. The only consequence is that the map is lost.
//!
//! A file begins with `{"crc32":"01234567",`: the CRC-32 of all bytes behind that comma. Files of
//! format 1 have no checksum.

use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::whole_file::{Existing, Readers, write_whole};
use radar_mapping::{SavedMap, SavedMapError};
use radar_sar::geometry::Pose;

/// Version of the format that is written; all versions up to it are read. Since 2 a file has a checksum.
const FORMAT_VERSION: u32 = 2;
/// What stands before the eight hexadecimal digits of the checksum, and what behind them.
const CHECKSUM_START: &[u8] = b"{\"crc32\":\"";
const CHECKSUM_END: &[u8] = b"\",";
/// Limit of a file's size, bytes. Choice: a full map (2000 points with 48 cells each, 200 walls)
/// stays below; it bounds what a damaged file costs.
const MAX_BYTES: u64 = 8 << 20;
/// Number of maps kept; the one written least recently is removed first. Choice: more play areas
/// than a person has; a map takes some hundred kilobytes.
pub const MAX_ROOMS: usize = 16;

/// Why a map cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum MapFileError {
    /// The system refused a file operation.
    #[error("cannot {doing} {}: {source}", path.display())]
    Io {
        /// The operation.
        doing: &'static str,
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// A directory, device or pipe instead of a file.
    #[error("{} is a folder, a device or a pipe: give the map's file", .0.display())]
    NotAFile(PathBuf),
    /// The file is too long for a map.
    #[error("{} is longer than a map: {MAX_BYTES} bytes at most", .0.display())]
    TooLong(PathBuf),
    /// The file is not valid JSON of a map.
    #[error("{} is not a map: {source}", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// The parser's error.
        source: serde_json::Error,
    },
    /// The file was changed after it was written.
    #[error(
        "{} is damaged: its checksum is {stated}, that of its content {found}; use another copy, or begin without a map",
        path.display()
    )]
    Checksum {
        /// The file.
        path: PathBuf,
        /// The checksum that it states.
        stated: String,
        /// The checksum of its content.
        found: String,
    },
    /// An unsupported format version.
    #[error("{} is a map of format {found}; this program reads 1 to {FORMAT_VERSION}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// Its format version.
        found: u32,
    },
    /// The map of another universe.
    #[error("{} is the map of another universe, {found}", path.display())]
    Universe {
        /// The file.
        path: PathBuf,
        /// Its universe.
        found: u64,
    },
    /// Invalid numbers in the map.
    #[error("{} has invalid numbers: {source}", path.display())]
    Numbers {
        /// The file.
        path: PathBuf,
        /// The error.
        source: SavedMapError,
    },
    /// An invalid pose or time.
    #[error("{} has an invalid standing universe or time", .0.display())]
    Place(PathBuf),
}

/// The map of a room, in the frame of the raw universe, which recentring does not move.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MapFile {
    format_version: u32,
    /// The tracking system's id of the room.
    pub universe: u64,
    /// Time of writing, Unix seconds.
    pub saved_unix_s: f64,
    /// Pose of the standing universe at that time.
    pub standing_from_raw: Pose,
    /// The map. Its times are nanoseconds relative to the time of writing, so none is above 0.
    pub map: SavedMap,
}

/// The format version alone, since the other fields depend on it.
#[derive(Deserialize)]
struct Format {
    format_version: u32,
}

impl MapFile {
    /// A map of the current format.
    pub fn new(universe: u64, saved_unix_s: f64, standing_from_raw: Pose, map: SavedMap) -> Self {
        Self { format_version: FORMAT_VERSION, universe, saved_unix_s, standing_from_raw, map }
    }

    /// Reads a file.
    ///
    /// # Errors
    /// The file does not exist, is too long, damaged or of another format, or has invalid numbers.
    pub fn read(path: &Path) -> Result<Self, MapFileError> {
        let (read, own) = (io_error("read", path), || path.to_owned());
        // Opening a pipe would block until another program writes to it.
        if !fs::metadata(path).map_err(&read)?.is_file() {
            return Err(MapFileError::NotAFile(own()));
        }
        let mut text = Vec::new();
        File::open(path).and_then(|file| file.take(MAX_BYTES + 1).read_to_end(&mut text)).map_err(read)?;
        if text.len() as u64 > MAX_BYTES {
            return Err(MapFileError::TooLong(own()));
        }
        let mut file = Self::parse(path, &mut text)?;
        file.format_version = FORMAT_VERSION;
        file.map.check().map_err(|source| MapFileError::Numbers { path: own(), source })?;
        let Pose { translation, rotation } = file.standing_from_raw;
        let standing = Pose::try_new(translation.to_array(), rotation.to_array());
        let is_time = file.saved_unix_s.is_finite();
        file.standing_from_raw = standing.ok().filter(|_| is_time).ok_or_else(|| MapFileError::Place(own()))?;
        Ok(file)
    }

    /// Checks checksum and version and parses the fields; their values are not checked.
    fn parse(path: &Path, text: &mut [u8]) -> Result<Self, MapFileError> {
        let (stated, content) = split_checksum(text);
        let found = checksum(content);
        let damaged = |stated: &str| MapFileError::Checksum {
            path: path.to_owned(),
            stated: stated.to_owned(),
            found: found.clone(),
        };
        if let Some(stated) = stated.as_ref().filter(|stated| **stated != found) {
            return Err(damaged(stated));
        }
        let no_map = |source| MapFileError::Json { path: path.to_owned(), source };
        match serde_json::from_slice(content).map_err(no_map)? {
            Format { format_version: 1 } => {}
            Format { format_version: FORMAT_VERSION } if stated.is_some() => {}
            Format { format_version: FORMAT_VERSION } => return Err(damaged("missing")),
            Format { format_version: found } => return Err(MapFileError::Format { path: path.to_owned(), found }),
        }
        serde_json::from_slice(content).map_err(no_map)
    }

    /// Writes the file atomically and creates its directory.
    ///
    /// # Errors
    /// The system refuses.
    pub fn write(&self, path: &Path) -> Result<(), MapFileError> {
        let error = io_error("write", path);
        let content = serde_json::to_vec(self).map_err(|source| error(source.into()))?;
        write_whole(path, &with_checksum(&content), Readers::Owner, Existing::Replace).map_err(error)
    }
}

/// CRC-32 of a JSON object without its opening brace.
fn checksum(content: &[u8]) -> String {
    format!("{:08x}", crc32fast::hash(content.get(1..).unwrap_or_default()))
}

/// The file of a JSON object: the checksum becomes its first field.
fn with_checksum(content: &[u8]) -> Vec<u8> {
    let behind = content.get(1..).unwrap_or_default();
    [CHECKSUM_START, checksum(content).as_bytes(), CHECKSUM_END, behind].concat()
}

/// The checksum that a file states, if it does, and the JSON object without that field.
fn split_checksum(text: &mut [u8]) -> (Option<String>, &[u8]) {
    let digits = CHECKSUM_START.len()..CHECKSUM_START.len() + 8;
    let comma = digits.end + CHECKSUM_END.len() - 1;
    if !text.starts_with(CHECKSUM_START) || text.get(digits.end..=comma) != Some(CHECKSUM_END) {
        return (None, text);
    }
    let stated = String::from_utf8_lossy(&text[digits]).into_owned();
    // What follows the comma is an object once it has a brace.
    text[comma] = b'{';
    (Some(stated), &text[comma..])
}

/// Directory with the maps of all rooms.
#[derive(Debug, Clone)]
pub struct MapFolder(PathBuf);

impl MapFolder {
    /// The directory need not exist.
    pub fn new(folder: PathBuf) -> Self {
        Self(folder)
    }

    fn file(&self, universe: u64) -> PathBuf {
        self.0.join(format!("universe-{universe}.json"))
    }

    /// Loads the map of a room; `None` if there is none.
    ///
    /// # Errors
    /// As [`MapFile::read`], and for a map of another universe.
    pub fn load(&self, universe: u64) -> Result<Option<MapFile>, MapFileError> {
        let path = self.file(universe);
        match MapFile::read(&path) {
            Err(MapFileError::Io { source, .. }) if source.kind() == io::ErrorKind::NotFound => Ok(None),
            Ok(file) if file.universe != universe => Err(MapFileError::Universe { path, found: file.universe }),
            read => read.map(Some),
        }
    }

    /// Saves the map of a room and removes the oldest beyond [`MAX_ROOMS`]. An empty map is not
    /// written unless it replaces a file.
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

    /// Removes the map of a room and an unusable one moved aside; returns whether there was a map.
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

    /// Renames an unusable map so that it is not overwritten; returns its new path. An earlier one
    /// is replaced.
    ///
    /// # Errors
    /// The system refuses.
    pub fn move_aside(&self, universe: u64) -> Result<PathBuf, MapFileError> {
        let path = self.file(universe);
        let aside = aside_path(&path);
        fs::rename(&path, &aside).map_err(io_error("rename", &path))?;
        Ok(aside)
    }

    /// All maps except this one, newest first.
    fn others_by_age(&self, but: &Path) -> Vec<PathBuf> {
        let entries = fs::read_dir(&self.0).into_iter().flatten().filter_map(Result::ok);
        let is_map = |path: &Path| {
            let name = path.file_name().and_then(|name| name.to_str());
            name.is_some_and(|name| name.starts_with("universe-") && name.ends_with(".json"))
        };
        let paths = entries.map(|entry| entry.path()).filter(|path| is_map(path) && path != but);
        let age = |path: &PathBuf| fs::metadata(path).ok().filter(fs::Metadata::is_file)?.modified().ok();
        let aged = paths.filter_map(|path| Some((age(&path)?, path)));
        let mut aged: Vec<_> = aged.collect();
        aged.sort_by(|a, b| b.cmp(a));
        aged.into_iter().map(|(_, path)| path).collect()
    }
}

/// Path of an unusable map.
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
        let point = SavedPoint {
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
        MapFile::new(universe, 1.7e9, standing_from_raw, SavedMap { places: vec![point], walls: vec![wall] })
    }

    /// The same map as earlier versions wrote it.
    fn of_format_1(text: &str) -> String {
        let content = text.split_once(',').unwrap().1;
        format!("{{{content}").replace("\"format_version\":2", "\"format_version\":1")
    }

    #[test]
    fn map_of_format_1_is_read_and_written_as_format_2() {
        let folder = Folder::new("format");
        let maps = folder.maps();
        maps.save(&map(7)).unwrap();
        let saved = maps.load(7).unwrap().unwrap();
        let text = fs::read_to_string(maps.file(7)).unwrap();
        fs::write(maps.file(7), of_format_1(&text)).unwrap();
        let loaded = maps.load(7).unwrap().unwrap();
        assert_eq!(loaded, saved);
        maps.save(&loaded).unwrap();
        assert!(fs::read(maps.file(7)).unwrap().starts_with(CHECKSUM_START));
        assert_eq!(maps.load(7).unwrap().unwrap(), saved);
    }

    #[test]
    fn no_changed_bit_is_believed() {
        let folder = Folder::new("bits");
        let maps = folder.maps();
        maps.save(&map(7)).unwrap();
        let mut text = fs::read(maps.file(7)).unwrap();
        for bit in 0..8 * text.len() {
            text[bit / 8] ^= 1 << (bit % 8);
            assert!(MapFile::parse(Path::new("map"), &mut text.clone()).is_err(), "bit {bit}");
            text[bit / 8] ^= 1 << (bit % 8);
        }
        let moved = String::from_utf8(text).unwrap().replace("0.30000000000000004", "9.30000000000000004");
        fs::write(maps.file(7), moved).unwrap();
        let error = maps.load(7).unwrap_err();
        assert!(
            matches!(error, MapFileError::Checksum { .. }) && error.to_string().contains("is damaged: its checksum")
        );
    }

    #[test]
    fn folders_and_pipes_are_refused() {
        let folder = Folder::new("kinds");
        fs::create_dir_all(folder.maps().file(7)).unwrap();
        assert!(matches!(folder.maps().load(7), Err(MapFileError::NotAFile(_))));
        #[cfg(unix)]
        {
            let pipe = folder.0.join("pipe");
            assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
            assert!(matches!(MapFile::read(&pipe), Err(MapFileError::NotAFile(_))));
        }
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
        assert_eq!(fs::read_dir(&folder.0).unwrap().count(), 1, "no temporary file is left");
        assert!(maps.remove(7).unwrap() && !maps.remove(7).unwrap());
        let empty = MapFile { map: SavedMap::default(), ..map(7) };
        maps.save(&empty).unwrap();
        assert!(maps.load(7).unwrap().is_none(), "an empty map is not written");
        maps.save(&map(7)).unwrap();
        maps.save(&empty).unwrap();
        assert!(maps.load(7).unwrap().unwrap().map.is_empty(), "an empty map replaces a file");
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
        assert!(maps.remove(3).unwrap() && !aside.exists() && !maps.remove(3).unwrap(), "both files are removed");
    }

    #[test]
    fn oldest_maps_are_removed() {
        let folder = Folder::new("oldest");
        let maps = folder.maps();
        // What is no file is no map, and stays.
        fs::create_dir_all(folder.0.join("universe-none.json")).unwrap();
        for universe in 0..MAX_ROOMS as u64 + 3 {
            maps.save(&map(universe)).unwrap();
            let time = std::time::UNIX_EPOCH + std::time::Duration::from_secs(1_000_000 + universe);
            File::options().append(true).open(maps.file(universe)).unwrap().set_modified(time).unwrap();
        }
        maps.save(&map(50)).unwrap();
        assert_eq!(fs::read_dir(&folder.0).unwrap().count(), MAX_ROOMS + 1);
        assert!(maps.load(3).unwrap().is_none() && maps.load(4).unwrap().is_some() && maps.load(50).unwrap().is_some());
    }

    #[test]
    fn invalid_map_file_is_an_error() {
        let folder = Folder::new("bad");
        let maps = folder.maps();
        maps.save(&map(7)).unwrap();
        // Damage that no checksum shows.
        let text = of_format_1(&fs::read_to_string(maps.file(7)).unwrap());
        let spoilt: [(String, &str); 8] = [
            (text[..text.len() / 2].to_owned(), "is not a map"),
            (String::new(), "is not a map"),
            (text.replace("\"format_version\":1", "\"format_version\":2"), "its checksum is missing"),
            (text.replace("\"format_version\":1", "\"format_version\":3"), "format 3; this program reads 1 to 2"),
            (text.replace("\"universe\":7", "\"universe\":8"), "another universe, 8"),
            (text.replace("\"score\":8.7", "\"score\":-8.7"), "the score of 3"),
            (text.replace("\"score\":8.7", "\"score\":1e999"), "is not a map"),
            (" ".repeat(MAX_BYTES as usize + 1), "longer than a map"),
        ];
        for (spoilt, message) in spoilt {
            assert_ne!(spoilt, text);
            fs::write(maps.file(7), spoilt).unwrap();
            let error = maps.load(7).unwrap_err().to_string();
            assert!(error.contains(message), "{error}, not {message}");
        }
        let mut flipped = text.clone().into_bytes();
        for at in (0..flipped.len()).step_by(3) {
            flipped[at] ^= 0x11;
            fs::write(maps.file(7), &flipped).unwrap();
            // Whatever was parsed must be valid.
            if let Ok(Some(file)) = maps.load(7) {
                file.map.check().unwrap();
            }
            flipped[at] ^= 0x11;
        }
    }
}
