//! The frame loop beside SteamVR: poses in, warnings out, every frame.
//!
//! The loop waits for the runtime's next frame and for nothing else: poses go into the reconstruction's queue, the newest
//! scene is taken from where it lies, pictures are drawn only when they change. It owns graphics device and overlays, which belong to
//! one thread. Poses between frames are read by a thread of their own, since the loop sleeps in the runtime then.

mod anchor;
mod cue_output;
mod dashboard;
mod display;
mod frames;
mod graphics;
mod head_poses;
mod map_autosave;
mod meter;
mod overlay_pool;
mod pose_thread;
mod runtime_monitor;
mod samples;

pub use dashboard::SensorCount;
pub use frames::{Ending, FrameLoop, HandSink, HeadsetError, HeadsetReport, HeadsetStatus, PoseSink, RetainedGraphics};
pub use head_poses::HeadPoses;
pub use map_autosave::MapStore;
pub use meter::FrameReport;
