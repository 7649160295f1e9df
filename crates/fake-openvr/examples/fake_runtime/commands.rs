//! Commands of the configuration's script and of `commands.jsonl`.

use serde::Deserialize;

/// A command with its time.
#[derive(Debug, Clone, Deserialize)]
pub struct TimedCommand {
    /// Seconds since Init; at once if missing.
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

/// An action of the laser pointer on a dashboard tab.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Touch {
    Move,
    Down,
    Up,
    /// Move, down and up.
    Click,
    Leave,
}

/// A command.
#[derive(Debug, Clone, Deserialize)]
#[serde(tag = "do", rename_all = "snake_case")]
pub enum Command {
    /// Draws both eyes to `shots/NAME_left.png` and `NAME_right.png`.
    Shot { name: String },
    /// Writes the client's dashboard tab to `shots/NAME.png`, and its button to
    /// `shots/NAME_thumbnail.png`.
    TabShot { name: String },
    /// Opens or closes the dashboard, with the client's tab active.
    Dashboard { open: bool },
    /// Pointer input on the tab. `x` and `y` are from its upper left, in units of its mouse scale.
    Mouse {
        action: Touch,
        #[serde(default)]
        x: f32,
        #[serde(default)]
        y: f32,
    },
    /// Moves the zero pose, given in the previous universe.
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
    /// Makes poses invalid for this time, seconds.
    Invalid { for_s: f64 },
    /// Asks the client to quit.
    Quit,
    /// Makes the next `count` calls of a function fail.
    Fail { function: String, count: u32 },
    /// The next WaitFrameSync returns only after this time, seconds.
    Hang { for_s: f64 },
    /// Another game is shown; without a key none.
    Game {
        #[serde(default)]
        key: Option<String>,
    },
    /// The headset is taken off.
    Standby,
    /// The headset is put on.
    Wake,
    /// Changes the colour of the bounds, 0 to 255.
    Color { r: i32, g: i32, b: i32, a: i32 },
    /// Changes the play area.
    PlayArea { x: f32, z: f32 },
    /// Changes a setting.
    Setting { section: String, key: String, value: serde_json::Value },
}

impl TimedCommand {
    /// Parses a line.
    ///
    /// # Errors
    /// A message that describes what is wrong.
    pub fn parse(line: &str) -> Result<Self, String> {
        serde_json::from_str(line).map_err(|error| format!("{line:?} is no command: {error}"))
    }
}
