//! The frame loop with SteamVR: poses in, warnings out, every frame.
//!
//! The loop waits only for the runtime's next frame. Poses go into the reconstruction's queue, the
//! newest scene is read without waiting, and pictures are drawn only when they change. The loop
//! owns the graphics device and the overlays, which belong to one thread. Another thread reads
//! poses between frames, while the loop sleeps in the runtime.

mod anchor;
mod cue_output;
mod dashboard;
mod display;
mod display_monitor;
mod frames;
mod graphics;
mod head_poses;
mod map_autosave;
mod meter;
mod overlay_pool;
mod pose_thread;
mod runtime_monitor;
mod samples;
mod session_frame;
mod status;

pub use display_monitor::WarningOutput;
pub use frames::{FrameLoop, RetainedGraphics};
pub use head_poses::HeadPoses;
pub use map_autosave::MapStore;
pub use meter::FrameReport;
pub use status::{Ending, EventSink, HeadsetError, HeadsetReport, HeadsetStatus, SensorCount};
