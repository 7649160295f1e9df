//! Threads and clocks around what is pure: the sensor's reader thread, the host's clock, poses that grow in a file, the
//! reconstruction beside the frame loop, the frame loop beside SteamVR, and sounds.

mod core_wait;
mod freshness;
mod headset;
mod host_clock;
mod latency;
mod losses;
mod merge;
mod pose_tail;
mod priority;
mod queue;
mod reconstruction;
mod sensor;
mod settings_desk;
mod sound;
#[cfg(all(test, unix))]
mod test_board;

pub use core_wait::CoreWait;
pub use headset::{
    Drawn, Ending, FrameLoop, FrameReport, HandSink, HeadPoses, HeadsetError, HeadsetReport, HeadsetStatus, KeptMaps,
    PoseSink, SensorCount,
};
pub use host_clock::{now_ns, thread_cpu_ns};
pub use latency::{Latency, LatencyReport};
pub use losses::Losses;
pub use merge::{MAX_WAITING, Merge};
pub use pose_tail::{PoseTail, PoseTailCounters};
pub use priority::lower_priority_of_this_thread;
pub use queue::{Dropped, Received};
pub use reconstruction::{
    Published, Reconstruction, ReconstructionCounters, ReconstructionError, ReconstructionOptions,
};
pub use sensor::{SensorStream, StreamCounters, StreamError, StreamEvent, StreamOptions};
pub use settings_desk::{Change, Compose, DeskWork, OnNew, SettingsDesk};
