//! The composition root: everything with threads and clocks. A session with SteamVR joins the
//! sensor's threads, the reconstruction's thread, the frame loop, the dashboard, the settings file,
//! the saved map, the desktop view and the recording.

mod board_messages;
mod board_report;
mod core_wait;
mod event_merger;
mod file_type;
mod folders;
mod frame_intake;
mod frame_loss;
mod handover;
mod headset;
mod host_clock;
mod instance;
mod latency;
mod latency_tracker;
mod log_file;
mod mount_memory;
mod platform;
mod pose_tail;
mod printable;
mod priority;
pub mod progress;
mod queue;
mod reconstruction;
mod record_file;
mod registration;
mod sensor;
mod sensor_supervisor;
mod session;
mod session_report;
mod session_view;
mod settings_store;
mod sound;
mod stop;
mod sync;
#[cfg(all(test, unix))]
mod test_board;
mod watchdog;
mod welcome;

pub use board_report::{config_table, counter_lines, line_speed, preset_table, verdict};
pub use core_wait::CoreWait;
pub use event_merger::{EventMerger, MAX_WAITING};
pub use file_type::{add_file_type, remove_file_type};
pub use folders::{user_folder, without_personal_names};
pub use frame_intake::{ChosenSensor, FrameIntake, Until};
pub use frame_loss::FrameLossCounter;
pub use headset::{
    Ending, EventSink, FrameLoop, FrameReport, HeadPoses, HeadsetError, HeadsetReport, HeadsetStatus, MapStore,
    RetainedGraphics, SensorCount, WarningOutput,
};
pub use host_clock::{now_ns, thread_cpu_ns};
pub use latency::{Latency, LatencyReport};
pub use log_file::{begin_log_file, log_line, print_line};
pub use mount_memory::{correction_text, known_mounts};
pub use platform::{
    has_own_console, leave_own_console, limit_memory_of_this_process, open_missing_console, refine_timers,
};
pub use pose_tail::{PoseTail, PoseTailCounters};
pub use printable::printable;
pub use priority::{lower_priority_of_this_thread, raise_priority_of_this_thread};
pub use queue::{Dropped, Received};
pub use reconstruction::{
    PublishedMap, Reconstruction, ReconstructionCounters, ReconstructionError, ReconstructionOptions,
};
pub use record_file::{MAX_WAITING_POSES, PoseSource, RecordFile};
pub use registration::{own_path, registration_trouble};
pub use sensor::{SensorStream, StreamCounters, StreamError, StreamEvent, StreamOptions};
pub use sensor_supervisor::{ChooseSensor, SensorSupervisor, SupervisorPlan};
pub use session::SessionOptions;
pub use session_report::is_session_report;
pub use settings_store::{Compose, OnNew, SettingChange, SettingsStore, SettingsWatcher};
pub use stop::stop_flag;
