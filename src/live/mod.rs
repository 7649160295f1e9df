//! Everything with threads and clocks: the sensor's reader thread, the host's clock, pose files
//! that grow, the reconstruction's thread, the frame loop with SteamVR, and sounds.

mod core_wait;
mod event_merger;
mod frame_loss;
mod headset;
mod host_clock;
mod latency;
mod latency_tracker;
mod pose_tail;
mod priority;
mod queue;
mod reconstruction;
mod sensor;
mod settings_store;
mod sound;
#[cfg(all(test, unix))]
mod test_board;

pub use core_wait::CoreWait;
pub use event_merger::{EventMerger, MAX_WAITING};
pub use frame_loss::FrameLossCounter;
pub use headset::{
    Ending, EventSink, FrameLoop, FrameReport, HeadPoses, HeadsetError, HeadsetReport, HeadsetStatus, MapStore,
    RetainedGraphics, SensorCount,
};
pub use host_clock::{now_ns, thread_cpu_ns};
pub use latency::{Latency, LatencyReport};
pub use pose_tail::{PoseTail, PoseTailCounters};
pub use priority::lower_priority_of_this_thread;
pub use queue::{Dropped, Received};
pub use reconstruction::{
    PublishedMap, Reconstruction, ReconstructionCounters, ReconstructionError, ReconstructionOptions,
};
pub use sensor::{SensorStream, StreamCounters, StreamError, StreamEvent, StreamOptions};
pub use settings_store::{Compose, OnNew, SettingChange, SettingsStore, SettingsWatcher};
