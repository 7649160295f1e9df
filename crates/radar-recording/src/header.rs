//! Header of a recording and its form in MCAP metadata records: text fields, with numbers as JSON.
//! Floating-point numbers round-trip bit for bit.

use std::collections::BTreeMap;

use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

use super::RecordingError;
use a121::SensorConfig;
use radar_sar::geometry::Pose;
use radar_sar::truth::Truth;

/// Version of the format that is written; all versions up to it are read.
pub const FORMAT_VERSION: u32 = 1;
/// Name of the metadata record with the header.
pub(super) const HEADER_RECORD: &str = "radar_chaperone";
/// Name of the metadata record with the truth.
pub(super) const TRUTH_RECORD: &str = "radar_chaperone.truth";
/// Its only key.
const TRUTH_KEY: &str = "truth";

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
        BTreeMap::from([
            field("format_version", FORMAT_VERSION.to_string()),
            field("source", self.source.clone()),
            field("sensor_config", json(&self.config)),
            field("sensor", json(&self.sensor)),
            field("head_from_sensor", json(&mount)),
            field("settings", self.settings.clone()),
        ])
    }

    /// The fields of [`TRUTH_RECORD`], when the truth is known.
    pub(super) fn truth_to_fields(&self) -> Option<BTreeMap<String, String>> {
        self.truth.as_ref().map(|truth| BTreeMap::from([(TRUTH_KEY.to_owned(), json(truth))]))
    }

    /// Parses the fields of [`HEADER_RECORD`]; the truth is stored separately.
    ///
    /// # Errors
    /// A newer format, a missing or invalid field, a configuration that breaks a rule.
    pub(super) fn from_fields(fields: &BTreeMap<String, String>) -> Result<Self, RecordingError> {
        check_version(text(fields, "format_version")?)?;
        let config: SensorConfig = parsed(fields, "sensor_config")?;
        config.validate()?;
        Ok(Self {
            source: text(fields, "source")?.to_owned(),
            config,
            sensor: parsed(fields, "sensor")?,
            head_from_sensor: mount(parsed(fields, "head_from_sensor")?)?,
            settings: text(fields, "settings")?.to_owned(),
            truth: None,
        })
    }

    /// Parses the fields of [`TRUTH_RECORD`].
    ///
    /// # Errors
    /// The field is missing or invalid.
    pub(super) fn truth_from_fields(fields: &BTreeMap<String, String>) -> Result<Truth, RecordingError> {
        parsed(fields, TRUTH_KEY)
    }

    /// Checks that reading returns what is written.
    ///
    /// # Errors
    /// The field that would be rejected or changed: a broken rule, or a number that is not finite.
    pub(super) fn check_readable(&self) -> Result<(), RecordingError> {
        let mut back = Self::from_fields(&self.to_fields())?;
        if let Some(fields) = self.truth_to_fields() {
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

fn check_version(version: &str) -> Result<(), RecordingError> {
    match version.parse::<u32>() {
        Ok(found) if found > FORMAT_VERSION => Err(RecordingError::NewerFormat { found, known: FORMAT_VERSION }),
        Ok(1..) => Ok(()),
        _ => Err(unusable("format_version", format!("{version:?} is not a number from 1 up"))),
    }
}

/// Checks the mount and keeps its bits: the quaternion is not normalised again.
fn mount(numbers: MountNumbers) -> Result<Pose, RecordingError> {
    let MountNumbers { position_m, quaternion_xyzw } = numbers;
    Pose::try_new(position_m, quaternion_xyzw).map_err(|error| unusable("head_from_sensor", error.to_string()))?;
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
        fields.insert("format_version".into(), "2".into());
        assert!(matches!(Header::from_fields(&fields), Err(RecordingError::NewerFormat { found: 2, known: 1 })));
        let mut fields = header().to_fields();
        fields.insert("sensor_config".into(), "{\"subsweeps\": 3}".into());
        assert!(Header::from_fields(&fields).unwrap_err().to_string().contains("sensor_config"));
        let mut fields = header().to_fields();
        fields.remove("settings");
        assert!(Header::from_fields(&fields).unwrap_err().to_string().contains("settings is unusable: it is missing"));
        let mut fields = header().to_fields();
        fields.insert("head_from_sensor".into(), r#"{"position_m":[0,0,0],"quaternion_xyzw":[0,0,0,2]}"#.into());
        assert!(Header::from_fields(&fields).unwrap_err().to_string().contains("length 2"));
    }
}
