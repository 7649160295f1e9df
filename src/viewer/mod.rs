//! The desktop view: a window that replays a recording or shows live data, in 3D, over time and in
//! cross-sections.
//!
//! The pipeline only runs forward, in its own thread and as fast as it can. A [`Recorder`] reads
//! its state after every event and stores it in a bounded [`History`]. The window shows any moment
//! of that history, so seeking back shows what was known at that time. State that can be tested
//! without a GPU (player, camera, history, maps, drawings) is in files without GPU code. `space`
//! draws it, `screen` adds egui, `window` and `shots` are the two outputs.

mod app;
mod camera;
mod decimated_series;
mod drawing;
mod error;
mod history;
mod keys;
mod labels;
mod layers;
mod map_view;
mod maps;
mod panel;
mod player;
mod recorder;
mod recording_info;
mod room;
mod screen;
mod shots;
mod space;
mod style;
mod timeline;
mod viewport;
mod window;

use app::App;
use recorder::SharedHistory;

pub use error::ViewError;
pub use history::{Health, History, VOXELS};
pub use recorder::Recorder;
pub use recording_info::RecordingInfo;
pub use shots::{NAMES as SHOT_NAMES, SIZE_PX as SHOT_SIZE_PX};

/// Runs `work` in its own thread and shows the state that its recorder stores, until the window is
/// closed. Then waits for `work`; its recorder reports that the window is closed. Returns the
/// result of `work`.
///
/// # Errors
/// There is no window or no surface. `work` has ended by then.
pub fn show<T: Send>(about: RecordingInfo, work: impl FnOnce(Recorder) -> T + Send) -> Result<T, ViewError> {
    show_with_cancel(about, work, || {})
}

/// As [`show`], for work that continues after the window is closed. If there is no window,
/// `give_up` must make the work end.
///
/// # Errors
/// As [`show`].
pub fn show_with_cancel<T: Send>(
    about: RecordingInfo,
    work: impl FnOnce(Recorder) -> T + Send,
    give_up: impl FnOnce(),
) -> Result<T, ViewError> {
    let history = SharedHistory::new(about.expected_s);
    let title = format!("{} – radar-chaperone", about.title);
    let mut app = App::new(about, history.clone());
    std::thread::scope(|scope| {
        let recorder = Recorder::new(&history);
        let worker = scope.spawn(|| work(recorder));
        let shown = window::show(&mut app, &title);
        history.close();
        if shown.is_err() {
            give_up();
        }
        let done = joined(worker)?;
        shown.map(|()| done)
    })
}

/// Runs `work` to its end and draws some states of its history, as PNG files of the names [`SHOT_NAMES`]. Returns them and the
/// result of `work`.
///
/// # Errors
/// There is no graphics adapter, or the device fails.
pub fn draw<T>(about: RecordingInfo, work: impl FnOnce(Recorder) -> T) -> Result<(Vec<Vec<u8>>, T), ViewError> {
    let history = SharedHistory::new(about.expected_s);
    let mut app = App::new(about, history.clone());
    let done = work(Recorder::new(&history));
    let duration_s = history.lock().extent().duration_s;
    Ok((shots::shots(&mut app, duration_s)?, done))
}

fn joined<T>(worker: std::thread::ScopedJoinHandle<T>) -> Result<T, ViewError> {
    worker.join().map_err(|panic| {
        let text =
            panic.downcast_ref::<&str>().map(ToString::to_string).or_else(|| panic.downcast_ref::<String>().cloned());
        ViewError::Stopped(text.unwrap_or_else(|| "it panicked".into()))
    })
}
