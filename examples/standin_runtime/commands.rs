//! What a script or a line of `commands.jsonl` can ask for.

use serde::Deserialize;

/// A command and when it is due.
#[derive(Debug, Clone, Deserialize)]
pub struct TimedCommand {
    /// Seconds since Init; at once where it is missing.
    #[serde(default)]
    pub at_s: f64,
    #[serde(flatten)]
    pub command: Command,
}

/// A universe that can be recentred.
#[derive(Debug, Clone, Copy, Default, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RecenterTarget {
    #[default]
    Standing,
    Seated,
}

/// What the laser pointer does on a tab of the dashboard.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Touch {
    Move,
    Down,
    Up,
    /// All three.
    Click,
    Leave,
}

/// What to do.
#[derive(Debug, Clone, Deserialize)]
#[serde(tag = "do", rename_all = "snake_case")]
pub enum Command {
    /// Draws both eyes to `shots/NAME_left.png` and `NAME_right.png`.
    Shot { name: String },
    /// Writes the client's tab of the dashboard to `shots/NAME.png`, its button to `shots/NAME_thumbnail.png`.
    TabShot { name: String },
    /// Opens or closes the dashboard, with the client's tab in front.
    Dashboard { open: bool },
    /// Touches the tab, `x` and `y` from its upper left in units of its mouse scale.
    Mouse {
        action: Touch,
        #[serde(default)]
        x: f32,
        #[serde(default)]
        y: f32,
    },
    /// Puts the zero pose elsewhere, given in the universe as it was.
    Recenter {
        #[serde(default)]
        x: f64,
        #[serde(default)]
        z: f64,
        #[serde(default)]
        yaw_deg: f64,
        #[serde(default)]
        universe: RecenterTarget,
    },
    /// Changes the raw universe, as configured.
    Universe,
    /// Poses are invalid for a while.
    Invalid { for_s: f64 },
    /// Asks the client to quit.
    Quit,
    /// The next `count` calls of a function fail.
    Fail { function: String, count: u32 },
    /// The headset was taken off.
    Standby,
    /// The headset was put on.
    Wake,
    /// The user chose another colour for the bounds, 0 to 255.
    Color { r: i32, g: i32, b: i32, a: i32 },
    /// The user set up another play area.
    PlayArea { x: f32, z: f32 },
    /// The user changed a setting.
    Setting { section: String, key: String, value: serde_json::Value },
}

impl TimedCommand {
    /// From a line.
    ///
    /// # Errors
    /// What is wrong with it, in words.
    pub fn parse(line: &str) -> Result<Self, String> {
        serde_json::from_str(line).map_err(|error| format!("{line:?} is no command: {error}"))
    }
}
