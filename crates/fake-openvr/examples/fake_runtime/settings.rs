//! IVRSettings: sections of keys, in memory, over those of the configuration.

use std::collections::BTreeMap;
use std::ffi::c_char;

use serde_json::Value;

use crate::config::Defect;
use crate::memory::{read_text, write, write_text};
use crate::table::{table, text};
use crate::world::call;
use crate::{sys, table};

const NONE: u32 = sys::EVRSettingsError_VRSettingsError_None;
const UNSET: u32 = sys::EVRSettingsError_VRSettingsError_UnsetSettingHasNoDefault;
const READ_FAILED: u32 = sys::EVRSettingsError_VRSettingsError_ReadFailed;
/// Limit of settings that a client may add. Choice: bounds memory when a client adds without end.
const MAX_ADDED_SETTINGS: usize = 1000;
const BOUNDS: &str = "collisionBounds";
const BOUNDS_COLOR: [&str; 4] = [
    "CollisionBoundsColorGammaR",
    "CollisionBoundsColorGammaG",
    "CollisionBoundsColorGammaB",
    "CollisionBoundsColorGammaA",
];

/// All settings.
#[derive(Debug)]
pub struct Settings {
    sections: BTreeMap<String, BTreeMap<String, Value>>,
}

impl Settings {
    /// SteamVR's defaults, overridden by the configuration.
    pub fn new(configured: &BTreeMap<String, BTreeMap<String, Value>>) -> Self {
        let mut settings = Self { sections: BTreeMap::new() };
        settings.set_bounds_color([0, 255, 255, 153]);
        settings.set(BOUNDS, "CollisionBoundsFadeDistance", 0.7.into());
        settings.set(BOUNDS, "CollisionBoundsWallHeight", 2.45.into());
        settings.set(BOUNDS, "CollisionBoundsStyle", 0.into());
        settings.set(BOUNDS, "CollisionBoundsGroundPerimeterOn", false.into());
        settings.set(BOUNDS, "CollisionBoundsCenterMarkerOn", false.into());
        settings.set(BOUNDS, "CollisionBoundsPlaySpaceOn", false.into());
        for (section, keys) in configured {
            keys.iter().for_each(|(key, value)| settings.set(section, key, value.clone()));
        }
        settings
    }

    /// Sets a value.
    pub fn set(&mut self, section: &str, key: &str, value: Value) {
        self.sections.entry(section.to_owned()).or_default().insert(key.to_owned(), value);
    }

    fn len(&self) -> usize {
        self.sections.values().map(BTreeMap::len).sum()
    }

    fn get(&self, section: &str, key: &str) -> Option<&Value> {
        self.sections.get(section)?.get(key)
    }

    /// Sets the colour of the bounds, 0 to 255.
    pub fn set_bounds_color(&mut self, color: [i32; 4]) {
        BOUNDS_COLOR.iter().zip(color).for_each(|(key, value)| self.set(BOUNDS, key, value.into()));
    }

    /// The colour of the bounds, 0 to 1.
    pub fn bounds_color(&self) -> [f32; 4] {
        BOUNDS_COLOR.map(|key| self.get(BOUNDS, key).and_then(Value::as_f64).unwrap_or(0.0) as f32 / 255.0)
    }
}

/// Reads a setting and writes its error.
fn get<T: table::Failure + Copy>(
    name: &'static str,
    section: *const c_char,
    key: *const c_char,
    error: *mut u32,
    convert: impl FnOnce(&Value) -> Option<T>,
) -> T {
    call(name, 0, |world| {
        let (Some(section), Some(key)) = (read_text(section), read_text(key)) else {
            world.report.violation("null pointer", name);
            write(error, READ_FAILED);
            return T::failure(0);
        };
        if world.config.has(Defect::ZeroSettings) {
            write(error, NONE);
            return T::failure(0);
        }
        let found = world.settings.get(section, key);
        let value = found.and_then(convert);
        write(
            error,
            if value.is_some() {
                NONE
            } else if found.is_some() {
                READ_FAILED
            } else {
                UNSET
            },
        );
        value.unwrap_or(T::failure(0))
    })
}

fn set(name: &'static str, section: *const c_char, key: *const c_char, error: *mut u32, value: Option<Value>) {
    call(name, 0, |world| {
        let (Some(section), Some(key), Some(value)) = (read_text(section), read_text(key), value) else {
            world.report.violation("null pointer", name);
            return write(error, sys::EVRSettingsError_VRSettingsError_WriteFailed);
        };
        if world.settings.get(section, key).is_none() && world.settings.len() >= MAX_ADDED_SETTINGS {
            return write(error, sys::EVRSettingsError_VRSettingsError_WriteFailed);
        }
        world.settings.set(section, key, value);
        write(error, NONE);
    });
}

unsafe extern "C" fn error_name(error: u32) -> *mut c_char {
    text(match error {
        NONE => c"VRSettingsError_None",
        UNSET => c"VRSettingsError_UnsetSettingHasNoDefault",
        READ_FAILED => c"VRSettingsError_ReadFailed",
        _ => c"VRSettingsError",
    })
}

unsafe extern "C" fn get_bool(section: *mut c_char, key: *mut c_char, error: *mut u32) -> bool {
    get("GetBool", section, key, error, Value::as_bool)
}

unsafe extern "C" fn get_int(section: *mut c_char, key: *mut c_char, error: *mut u32) -> i32 {
    get("GetInt32", section, key, error, |value| value.as_i64().and_then(|v| v.try_into().ok()))
}

unsafe extern "C" fn get_float(section: *mut c_char, key: *mut c_char, error: *mut u32) -> f32 {
    get("GetFloat", section, key, error, |value| value.as_f64().map(|v| v as f32))
}

unsafe extern "C" fn get_string(
    section: *mut c_char,
    key: *mut c_char,
    value: *mut c_char,
    room: u32,
    error: *mut u32,
) {
    get("GetString", section, key, error, |found| found.as_str().map(|found| write_text(value, room, found)));
}

unsafe extern "C" fn set_bool(section: *mut c_char, key: *mut c_char, value: bool, error: *mut u32) {
    set("SetBool", section, key, error, Some(value.into()));
}

unsafe extern "C" fn set_int(section: *mut c_char, key: *mut c_char, value: i32, error: *mut u32) {
    set("SetInt32", section, key, error, Some(value.into()));
}

unsafe extern "C" fn set_float(section: *mut c_char, key: *mut c_char, value: f32, error: *mut u32) {
    set("SetFloat", section, key, error, Some(value.into()));
}

unsafe extern "C" fn set_string(section: *mut c_char, key: *mut c_char, value: *mut c_char, error: *mut u32) {
    set("SetString", section, key, error, read_text(value).map(Value::from));
}

/// IVRSettings_003.
pub fn new_table() -> usize {
    table::leaked(table! { VR_IVRSettings_FnTable, "IVRSettings";
        given {
            GetSettingsErrorNameFromEnum: error_name,
            SetBool: set_bool,
            SetInt32: set_int,
            SetFloat: set_float,
            SetString: set_string,
            GetBool: get_bool,
            GetInt32: get_int,
            GetFloat: get_float,
            GetString: get_string,
        }
        fails(0) { RemoveSection, RemoveKeyInSection }
    })
}
