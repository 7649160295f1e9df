//! The desktop view: a window in which a recording is replayed, or what is seen right now is shown, in space, over time and in
//! cross-sections.
//!
//! The pipeline runs forward only, in a thread of its own and as fast as it can; a [`Recorder`] asks it after every event and notes
//! what it knows in a bounded [`History`]. The window shows any moment of that, so going back shows what was known then. State that
//! can be tested without a GPU (player, camera, history, maps, what is drawn) lies in files that know none; `space` draws it,
//! `screen` lays egui over it, `window` and `shots` are the two ways to look at it.

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

use std::path::{Path, PathBuf};

use app::App;
use recorder::SharedHistory;

pub use error::ViewError;
pub use history::{Health, History, VOXELS};
pub use recorder::Recorder;
pub use recording_info::RecordingInfo;

/// Runs `work` in a thread of its own and shows in a window what its recorder notes, until the window is closed. Then `work` is
/// waited for; a recorder says whether anybody still looks. Gives what `work` gave.
///
/// # Errors
/// No window, or nothing that draws to it. `work` has ended by then.
pub fn show<T: Send>(about: RecordingInfo, work: impl FnOnce(Recorder) -> T + Send) -> Result<T, ViewError> {
    show_with_cancel(about, work, || {})
}

/// The same for work that goes on when the window is closed, and has to be told to end, by `give_up`, where there is none.
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

/// Runs `work` to its end and draws a few states of what its recorder noted into a folder. Gives the files and what `work` gave.
///
/// # Errors
/// No graphics adapter, a device that fails, a folder that cannot be written to.
pub fn draw<T>(
    about: RecordingInfo,
    folder: &Path,
    work: impl FnOnce(Recorder) -> T,
) -> Result<(Vec<PathBuf>, T), ViewError> {
    let history = SharedHistory::new(about.expected_s);
    let mut app = App::new(about, history.clone());
    let done = work(Recorder::new(&history));
    let duration_s = history.lock().extent().duration_s;
    Ok((shots::shots(&mut app, folder, duration_s)?, done))
}

fn joined<T>(worker: std::thread::ScopedJoinHandle<T>) -> Result<T, ViewError> {
    worker.join().map_err(|panic| {
        let text =
            panic.downcast_ref::<&str>().map(ToString::to_string).or_else(|| panic.downcast_ref::<String>().cloned());
        ViewError::Stopped(text.unwrap_or_else(|| "it panicked".into()))
    })
}
