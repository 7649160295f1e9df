//! Header of a recording and its form in MCAP metadata records: text fields, with numbers as JSON.
//! Floating-point numbers round-trip bit for bit.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;

use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

use super::damaged_places::MAX_HEADER_BYTES;
use super::{MAX_SMALL_BYTES, RecordingError};
use a121::SensorConfig;
use radar_sar::geometry::{self, Pose};
use radar_sar::truth::Truth;

/// Version of the format that is written; all versions up to it are read. Since 2, header and truth have a checksum, stand in the
/// file twice, and hold no unknown field.
pub const FORMAT_VERSION: u32 = 2;
/// Name of the metadata record with the header.
pub(super) const HEADER_RECORD: &str = "radar_chaperone";
/// Name of the metadata record with the truth.
pub(super) const TRUTH_RECORD: &str = "radar_chaperone.truth";
/// Its only key but the checksum's.
const TRUTH_KEY: &str = "truth";
/// Key of the checksum of all other fields.
const CHECKSUM_KEY: &str = "crc32";
/// Distances between neighbouring range points that are possible, metres. Source: the A121's is 2.5 mm.
const BASE_STEPS_M: RangeInclusive<f64> = 1e-3..=10e-3;
/// Keys of the header but the checksum's.
const KEYS: [&str; 6] = ["format_version", "source", "sensor_config", "sensor", "head_from_sensor", "settings"];

/// Information from the board; unknown parts are `None`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SensorMetadata {
    /// Ticks of [`Frame::tick`](a121::Frame::tick) per second.
    pub ticks_per_second: Option<u32>,
    /// Distance between neighbouring range points at step length 1, metres.
    pub base_step_length_m: Option<f64>,
    /// "xc120", "xm125", "simulated", …
    pub board: Option<String>,
    /// Version of the sensor's software.
    pub rss_version: Option<String>,
}

/// Header of a recording, stored at the start of the file.
#[derive(Debug, Clone, PartialEq)]
pub struct Header {
    /// Origin: "xc120 on /dev/ttyACM0", "simulation: sphere-50cm, seed 1", "import of x.h5".
    pub source: String,
    /// Configuration of the sensor; breaks no rule of the sensor.
    pub config: SensorConfig,
    /// Information from the board.
    pub sensor: SensorMetadata,
    /// Pose of the sensor's phase centre on the head (mount).
    pub head_from_sensor: Pose,
    /// The program's settings as TOML; empty if there were none.
    pub settings: String,
    /// Ground truth, if known.
    pub truth: Option<Truth>,
}

/// The mount as numbers.
#[derive(Serialize, Deserialize)]
struct MountNumbers {
    position_m: [f64; 3],
    quaternion_xyzw: [f64; 4],
}

impl Header {
    /// A header without settings, truth or board information.
    pub fn new(source: impl Into<String>, config: SensorConfig, head_from_sensor: Pose) -> Self {
        Self {
            source: source.into(),
            config,
            sensor: SensorMetadata::default(),
            head_from_sensor,
            settings: String::new(),
            truth: None,
        }
    }

    /// The fields of [`HEADER_RECORD`].
    pub(super) fn to_fields(&self) -> BTreeMap<String, String> {
        let mount = MountNumbers {
            position_m: self.head_from_sensor.translation.to_array(),
            quaternion_xyzw: self.head_from_sensor.rotation.to_array(),
        };
        let field = |name: &str, value: String| (name.to_owned(), value);
        with_checksum(BTreeMap::from([
            field("format_version", FORMAT_VERSION.to_string()),
            field("source", self.source.clone()),
            field("sensor_config", json(&self.config)),
            field("sensor", json(&self.sensor)),
            field("head_from_sensor", json(&mount)),
            field("settings", self.settings.clone()),
        ]))
    }

    /// The fields of [`TRUTH_RECORD`], when the truth is known.
    pub(super) fn truth_to_fields(&self) -> Option<BTreeMap<String, String>> {
        self.truth.as_ref().map(|truth| with_checksum(BTreeMap::from([(TRUTH_KEY.to_owned(), json(truth))])))
    }

    /// Parses the fields of [`HEADER_RECORD`]; the truth is stored separately.
    ///
    /// # Errors
    /// A newer format, a missing, unknown or invalid field, another checksum, a configuration that breaks a rule.
    pub(super) fn from_fields(fields: &BTreeMap<String, String>) -> Result<Self, RecordingError> {
        if version(text(fields, "format_version")?)? >= 2 {
            check_fields(fields, "header", &KEYS)?;
        }
        let config: SensorConfig = parsed(fields, "sensor_config")?;
        config.validate()?;
        let sensor: SensorMetadata = parsed(fields, "sensor")?;
        if let Some(step_m) = sensor.base_step_length_m.filter(|step_m| !BASE_STEPS_M.contains(step_m)) {
            return Err(unusable("sensor", format!("a base step of {step_m} m is impossible")));
        }
        let settings = text(fields, "settings")?;
        if settings.len() as u64 > MAX_SMALL_BYTES {
            return Err(unusable("settings", format!("they have {} bytes, at most {MAX_SMALL_BYTES}", settings.len())));
        }
        Ok(Self {
            source: text(fields, "source")?.to_owned(),
            config,
            sensor,
            head_from_sensor: mount(parsed(fields, "head_from_sensor")?)?,
            settings: settings.to_owned(),
            truth: None,
        })
    }

    /// Parses the fields of [`TRUTH_RECORD`].
    ///
    /// # Errors
    /// The field is missing or invalid, or the checksum is another.
    pub(super) fn truth_from_fields(fields: &BTreeMap<String, String>) -> Result<Truth, RecordingError> {
        if fields.len() > 1 {
            check_fields(fields, "truth", &[TRUTH_KEY])?;
        }
        parsed(fields, TRUTH_KEY)
    }

    /// Checks that reading returns what is written.
    ///
    /// # Errors
    /// The field that would be rejected or changed: a broken rule, a number that is not finite, or more than is read.
    pub(super) fn check_readable(&self) -> Result<(), RecordingError> {
        let mut back = Self::from_fields(&self.to_fields())?;
        if let Some(fields) = self.truth_to_fields() {
            let bytes: usize = fields.values().map(String::len).sum();
            if bytes as u64 > MAX_HEADER_BYTES / 2 {
                return Err(unusable(TRUTH_KEY, format!("it has {bytes} bytes, at most {}", MAX_HEADER_BYTES / 2)));
            }
            back.truth = Some(Self::truth_from_fields(&fields)?);
        }
        if back != *self {
            return Err(unusable("header", "a number in it is not finite".into()));
        }
        Ok(())
    }
}

fn unusable(field: &'static str, reason: String) -> RecordingError {
    RecordingError::HeaderField { field, reason }
}

/// Serialises a value. The header's types hold only numbers, text and lists, so this cannot fail.
fn json(value: &impl Serialize) -> String {
    serde_json::to_string(value).unwrap_or_default()
}

fn text<'a>(fields: &'a BTreeMap<String, String>, field: &'static str) -> Result<&'a str, RecordingError> {
    fields.get(field).map(String::as_str).ok_or_else(|| unusable(field, "it is missing".into()))
}

fn parsed<T: for<'de> Deserialize<'de>>(
    fields: &BTreeMap<String, String>,
    field: &'static str,
) -> Result<T, RecordingError> {
    serde_json::from_str(text(fields, field)?).map_err(|error| unusable(field, error.to_string()))
}

fn with_checksum(mut fields: BTreeMap<String, String>) -> BTreeMap<String, String> {
    fields.insert(CHECKSUM_KEY.to_owned(), checksum(&fields));
    fields
}

/// Over all fields but its own, each name and value ended by a zero.
fn checksum(fields: &BTreeMap<String, String>) -> String {
    let mut crc = crc32fast::Hasher::new();
    for text in fields.iter().filter(|(key, _)| *key != CHECKSUM_KEY).flat_map(|(key, value)| [key, value]) {
        crc.update(text.as_bytes());
        crc.update(&[0]);
    }
    format!("{:08x}", crc.finalize())
}

/// Checks that these fields and the checksum are there, no others, and the checksum itself.
fn check_fields(fields: &BTreeMap<String, String>, what: &'static str, keys: &[&str]) -> Result<(), RecordingError> {
    if let Some(unknown) = fields.keys().find(|key| *key != CHECKSUM_KEY && !keys.contains(&key.as_str())) {
        return Err(unusable(what, format!("there is an unknown field {unknown:?}")));
    }
    let (stated, found) = (text(fields, CHECKSUM_KEY)?, checksum(fields));
    match stated == found {
        true => Ok(()),
        false => Err(unusable(what, format!("its checksum is {stated}, of its content {found}"))),
    }
}

fn version(version: &str) -> Result<u32, RecordingError> {
    match version.parse::<u32>() {
        Ok(found) if found > FORMAT_VERSION => Err(RecordingError::NewerFormat { found, known: FORMAT_VERSION }),
        Ok(found @ 1..) => Ok(found),
        _ => Err(unusable("format_version", format!("{version:?} is not a number from 1 up"))),
    }
}

/// Checks the mount and keeps its bits: the quaternion is not normalised again.
fn mount(numbers: MountNumbers) -> Result<Pose, RecordingError> {
    let MountNumbers { position_m, quaternion_xyzw } = numbers;
    geometry::mount(position_m, quaternion_xyzw).map_err(|error| unusable("head_from_sensor", error.to_string()))?;
    let rotation = DQuat::from_array(quaternion_xyzw);
    if (rotation.length() - 1.0).abs() > 1e-6 {
        let reason = format!("quaternion (x y z w) {quaternion_xyzw:?} has length {}: make it 1", rotation.length());
        return Err(unusable("head_from_sensor", reason));
    }
    Ok(Pose { translation: DVec3::from_array(position_m), rotation })
}

#[cfg(test)]
mod tests {
    use super::*;
    use a121::{ConfigError, preset};

    fn header() -> Header {
        let mount = Pose::new(DVec3::new(0.1 + 0.2, -1e-300, 0.0), DQuat::from_rotation_x(-0.3));
        Header::new("test", preset("d16").unwrap(), mount)
    }

    #[test]
    fn header_round_trips_exactly() {
        let header = header();
        assert_eq!(Header::from_fields(&header.to_fields()).unwrap(), header);
    }

    #[test]
    fn unreadable_header_is_rejected_before_writing() {
        let mut nan = header();
        nan.head_from_sensor.translation.x = f64::NAN;
        assert!(matches!(nan.check_readable(), Err(RecordingError::HeaderField { field: "head_from_sensor", .. })));
        let mut broken = header();
        broken.config.subsweeps[0].hwaas = 0;
        assert!(matches!(broken.check_readable(), Err(RecordingError::Config(ConfigError::OutOfRange { .. }))));
        let mut truth = header();
        truth.truth = Some(Truth { time_offset_s: f64::INFINITY, ..Default::default() });
        assert!(matches!(truth.check_readable(), Err(RecordingError::HeaderField { field: "truth", .. })));
        header().check_readable().unwrap();
    }

    #[test]
    fn invalid_fields_are_named() {
        let mut fields = header().to_fields();
        fields.insert("format_version".into(), "3".into());
        assert!(matches!(Header::from_fields(&fields), Err(RecordingError::NewerFormat { found: 3, known: 2 })));
        // Of the first version, which had no checksum.
        let first_version = || {
            let mut fields = header().to_fields();
            fields.remove(CHECKSUM_KEY);
            fields.insert("format_version".into(), "1".into());
            fields
        };
        assert_eq!(Header::from_fields(&first_version()).unwrap(), header());
        let mut fields = first_version();
        fields.insert("sensor_config".into(), "{\"subsweeps\": 3}".into());
        assert!(Header::from_fields(&fields).unwrap_err().to_string().contains("sensor_config"));
        let mut fields = first_version();
        fields.remove("settings");
        assert!(Header::from_fields(&fields).unwrap_err().to_string().contains("settings is unusable: it is missing"));
        let mut fields = first_version();
        fields.insert("head_from_sensor".into(), r#"{"position_m":[0,0,0],"quaternion_xyzw":[0,0,0,2]}"#.into());
        assert!(Header::from_fields(&fields).unwrap_err().to_string().contains("length 2"));
        let mut far = header();
        far.head_from_sensor.translation.x = 1e308;
        assert!(Header::from_fields(&far.to_fields()).unwrap_err().to_string().contains("at most 10 m"));
        for base_step_length_m in [0.0, -1.0, 1e308] {
            let mut header = header();
            header.sensor.base_step_length_m = Some(base_step_length_m);
            assert!(Header::from_fields(&header.to_fields()).unwrap_err().to_string().contains("base step"));
        }
    }

    #[test]
    fn changed_and_unknown_fields_are_refused() {
        let refused = |fields: BTreeMap<String, String>| Header::from_fields(&fields).unwrap_err().to_string();
        let mut fields = header().to_fields();
        fields.insert("source".into(), "tesu".into());
        assert!(refused(fields).contains("checksum"));
        let mut fields = header().to_fields();
        fields.insert("colour".into(), "red".into());
        assert!(refused(fields).contains("unknown field \"colour\""));
        let mut fields = header().to_fields();
        fields.remove(CHECKSUM_KEY);
        assert!(refused(fields).contains("crc32"));
        // Whole, but impossible.
        let mut broken = header();
        broken.config.subsweeps[0].hwaas = 0;
        assert!(refused(broken.to_fields()).contains("subsweeps[0].hwaas is 0"));
    }
}
