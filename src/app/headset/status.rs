//! What the frame loop reports, and what it receives about the sensor.

use super::display_monitor::WarningOutput;
use super::graphics::GraphicsError;
use super::meter::FrameReport;
use crate::openvr::OpenVrError;
use radar_mapping::Event;

/// Takes every head pose and the positions of the wearer's hands, in the session frame; must not
/// block.
pub type EventSink<'a> = &'a (dyn Fn(Event) + Sync);

/// What the sensor has sent so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SensorCount {
    /// Sweeps received.
    pub sweeps: u64,
    /// Sweeps that were measured and lost.
    pub lost: u64,
}

/// Why the loop ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// This program was asked to end.
    Asked,
    /// SteamVR quits.
    SteamVrQuit,
    /// SteamVR exited unexpectedly.
    SteamVrGone,
}

/// Why the loop cannot start.
#[derive(Debug, thiserror::Error)]
pub enum HeadsetError {
    /// SteamVR refuses something.
    #[error(transparent)]
    SteamVr(#[from] OpenVrError),
    /// The system provides no thread.
    #[error("cannot start a thread: {0}")]
    Thread(#[from] std::io::Error),
    /// There is no usable graphics device.
    #[error(transparent)]
    Graphics(#[from] GraphicsError),
}

/// Status of the loop.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct HeadsetStatus {
    /// Frames and their cost.
    pub frames: FrameReport,
    /// Whether the head is tracked.
    pub is_tracked: bool,
    /// Number of overlays shown.
    pub overlays_shown: usize,
    /// Distance to the nearest obstacle with a warning, metres.
    pub nearest_m: Option<f64>,
    /// Pictures passed to the runtime so far.
    pub pictures: u64,
    /// Most memory used by the panels' pictures, bytes.
    pub most_picture_bytes: u64,
    /// How often the user recentred.
    pub recentred: u64,
    /// How often the map was reset: for another room, or by the user.
    pub forgotten: u64,
    /// How often the graphics device was lost.
    pub devices_lost: u64,
    /// Whether the notice of the first session has been shown to its end; at the end of a loop.
    pub is_welcomed: bool,
    /// How the wearer is warned.
    pub output: WarningOutput,
    /// Calls refused by the runtime.
    pub refused: u64,
    /// Poses dropped because reading them took too long to know their time.
    pub poses_untimed: u64,
}

/// Result of a loop that has ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeadsetReport {
    /// Why it ended.
    pub ending: Ending,
    /// Its last status.
    pub status: HeadsetStatus,
}
