//! Settings that can change while the program runs, from the file or from the dashboard's panel.
//!
//! A thread polls the file four times a second: its time and length, and its text where these have
//! changed. That costs one system call per poll, works with every editor and file system, and needs
//! no file notification. Valid settings apply at once. Invalid ones are logged once, and the last
//! valid settings stay in use: the defaults, where the file is invalid from the start, since nobody
//! may see why a program does not start. The current fault can be read with
//! [`SettingsStore::trouble`]. Changes made in the program apply first and are saved to the file
//! after a delay, preserving comments; a file that is invalid at that time is not overwritten.

mod debounce;
mod edit;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, SystemTime};

use radar_recording::read_small_text;

use self::debounce::{FileDebouncer, FileState, Outcome};
use super::handover::Newest;
use super::now_ns;
use crate::settings::{Settings, path_of};

/// Polling interval of the file. Choice: a saved change appears at once to its author, for four
/// system calls a second.
const POLL_INTERVAL: Duration = Duration::from_millis(250);
/// Polling interval while a change is pending. Choice: half of what a text must stay stable, so
/// that a change applies within a quarter of a second.
const SHORT_POLL_INTERVAL: Duration = Duration::from_millis(80);
/// A file modified this recently may be modified again within the resolution of its timestamp.
/// Choice: the coarsest timestamps in use, FAT's, have 2 s.
const RECENT: Duration = Duration::from_secs(3);
/// Changes are saved after this time without another, nanoseconds, and after `MAX_SAVE_DELAY_NS` at
/// the latest: a slider sends many. Choice: a pause of the hand; 2 s bound what a crash loses.
const SAVE_DELAY_NS: i64 = 400_000_000;
const MAX_SAVE_DELAY_NS: i64 = 2_000_000_000;
/// Bound of waiting commands. Choice: a slider sends one a frame; the watcher empties the queue in
/// microseconds.
const MAX_COMMANDS: usize = 256;

/// Builds settings from a file's text, overriding `name=value` changes and the application key of
/// the game that is shown, or returns what is wrong.
pub type Compose<'a> = &'a (dyn Fn(&str, &[String], Option<&str>) -> Result<Settings, String> + Sync);
/// Called with the previous settings and the new ones.
pub type OnNew<'a> = &'a (dyn Fn(&Settings, &Settings) + Sync);

/// A change of one setting.
#[derive(Debug, Clone, PartialEq)]
pub struct SettingChange {
    /// Its name, as in `warning.brightness`.
    pub name: String,
    /// Its new value.
    pub value: toml::Value,
}

enum Command {
    Change(SettingChange),
    Recompose,
    /// Another game is shown, or none.
    Game(Option<String>),
    End,
}

/// Holds the settings in use.
pub struct SettingsStore {
    newest: Newest<Settings>,
    commands: SyncSender<Command>,
    /// Fault of the file, and why changes could not be saved to it.
    trouble: Mutex<[Option<String>; 2]>,
}

/// State of the watcher thread; see [`SettingsStore::new`].
pub struct SettingsWatcher {
    file: Option<PathBuf>,
    /// `name=value` changes that override the file.
    overrides: Vec<String>,
    commands: Receiver<Command>,
    /// The file's last valid text.
    text: String,
    debouncer: FileDebouncer,
    stamp: Option<(SystemTime, u64)>,
    /// Own changes that are not in the file yet.
    unsaved: BTreeMap<Vec<String>, toml::Value>,
    /// Application key of the game that is shown.
    game: Option<String>,
    changed_ns: Option<(i64, i64)>,
    cannot_save: Option<String>,
}

impl SettingsStore {
    /// Reads the file, which may be missing. Run the second value in a thread: [`SettingsWatcher::run`].
    ///
    /// # Errors
    /// What is wrong with `overrides`. An invalid file is ignored, and its fault kept.
    pub fn new(
        file: Option<PathBuf>,
        overrides: &[String],
        compose: Compose,
    ) -> Result<(Self, SettingsWatcher), String> {
        let seen = file.as_deref().map_or(FileState::Absent, seen);
        let read = match &seen {
            FileState::Text(text) => compose(text, overrides, None).map(|settings| (text.clone(), settings)),
            FileState::Absent => compose("", overrides, None).map(|settings| (String::new(), settings)),
            FileState::Unreadable(why) => Err(why.clone()),
        };
        let (text, first, wrong) = match read {
            Ok((text, settings)) => (text, settings, None),
            Err(why) => (String::new(), compose("", overrides, None)?, Some(why)),
        };
        if let (Some(why), Some(file)) = (&wrong, &file) {
            let why = why.trim_end();
            log::warn!("{}: {why}\nThe file is ignored: the defaults apply until it is fixed", file.display());
        }
        let (sender, commands) = sync_channel(MAX_COMMANDS);
        let trouble = Mutex::new([wrong, None]);
        let store = Self { newest: Newest::new(first), commands: sender, trouble };
        let stamp = file.as_deref().and_then(stamp);
        let work = SettingsWatcher {
            file,
            overrides: overrides.to_vec(),
            commands,
            text,
            debouncer: FileDebouncer::new(seen),
            stamp,
            unsaved: BTreeMap::new(),
            game: None,
            changed_ns: None,
            cannot_save: None,
        };
        Ok((store, work))
    }

    /// The settings in use.
    pub fn newest(&self) -> Arc<Settings> {
        self.newest.get()
    }

    /// The settings in use, if they are newer than that version; never waits.
    pub fn newer_than(&self, version: &mut u64) -> Option<Arc<Settings>> {
        self.newest.newer_than(version)
    }

    /// Requests a change of one setting, to be saved to the file; never waits.
    pub fn change(&self, change: SettingChange) {
        let _ = self.commands.try_send(Command::Change(change));
    }

    /// Requests rebuilding the settings, because the values below the file have changed.
    pub fn recompose(&self) {
        let _ = self.commands.try_send(Command::Recompose);
    }

    /// Another game is shown, by its application key, or none.
    pub fn set_game(&self, game: Option<String>) {
        let _ = self.commands.try_send(Command::Game(game));
    }

    /// Ends the thread.
    pub fn end(&self) {
        // The thread takes commands several times a second, so there will be room soon.
        let _ = self.commands.send(Command::End);
    }

    /// First line of the file's current fault, or of why changes could not be saved to it.
    pub fn trouble(&self) -> Option<String> {
        let [of_file, unsaved] = &*self.trouble.lock().unwrap_or_else(PoisonError::into_inner);
        let why = of_file.as_deref().or(unsaved.as_deref())?;
        why.lines().next().map(str::to_owned)
    }

    fn note_trouble(&self, of_file: Option<String>) {
        self.trouble.lock().unwrap_or_else(PoisonError::into_inner)[0] = of_file;
    }

    fn note_unsaved(&self, why: Option<String>) {
        self.trouble.lock().unwrap_or_else(PoisonError::into_inner)[1] = why;
    }

    fn publish(&self, settings: Settings, on_new: OnNew) {
        let new = Arc::new(settings);
        let before = self.newest.publish(Arc::clone(&new));
        if before != new {
            on_new(&before, &new);
        }
    }
}

impl SettingsWatcher {
    /// Runs until asked to end.
    pub fn run(mut self, store: &SettingsStore, compose: Compose, on_new: OnNew) {
        loop {
            let turn = if self.debouncer.is_waiting() || self.changed_ns.is_some() {
                SHORT_POLL_INTERVAL
            } else {
                POLL_INTERVAL
            };
            match self.commands.recv_timeout(turn) {
                Ok(Command::Change(change)) => self.take(change, store, compose, on_new),
                Ok(Command::Recompose) => self.recompose(store, compose, on_new),
                Ok(Command::Game(game)) if game == self.game => {}
                Ok(Command::Game(game)) => {
                    self.game = game;
                    self.recompose(store, compose, on_new);
                }
                Ok(Command::End) | Err(RecvTimeoutError::Disconnected) => break,
                Err(RecvTimeoutError::Timeout) => self.check_file(store, compose, on_new),
            }
            let now_ns = now_ns();
            let is_due = |(first_ns, last_ns): (i64, i64)| {
                now_ns.saturating_sub(last_ns) >= SAVE_DELAY_NS || now_ns.saturating_sub(first_ns) >= MAX_SAVE_DELAY_NS
            };
            if self.changed_ns.is_some_and(is_due) {
                self.save(store, compose);
            }
        }
        if self.changed_ns.is_some() {
            self.save(store, compose);
        }
    }

    /// The last valid text with the own changes.
    fn text_now(&self) -> String {
        let change = |text: String, (path, value): (&Vec<String>, &toml::Value)| {
            edit::with_value(&text, path, value).unwrap_or(text)
        };
        self.unsaved.iter().fold(self.text.clone(), change)
    }

    fn take(&mut self, change: SettingChange, store: &SettingsStore, compose: Compose, on_new: OnNew) {
        let SettingChange { name, value } = change;
        // The newest change overrides the command line.
        let overrides = self.overrides.clone();
        self.overrides.retain(|set| set.split_once('=').is_none_or(|(set, _)| set.trim() != name));
        let path = path_of(&self.text, self.game.as_deref(), &name);
        let before = self.unsaved.insert(path.clone(), value);
        match compose(&self.text_now(), &self.overrides, self.game.as_deref()) {
            Ok(settings) => {
                let now_ns = now_ns();
                self.changed_ns = Some((self.changed_ns.map_or(now_ns, |(first_ns, _)| first_ns), now_ns));
                store.publish(settings, on_new);
            }
            Err(why) => {
                log::warn!("{name} is not changed: {why}");
                self.overrides = overrides;
                match before {
                    Some(before) => self.unsaved.insert(path, before),
                    None => self.unsaved.remove(&path),
                };
                // The sender of the change sees that the old value is still in use.
                store.publish(Settings::clone(&store.newest()), on_new);
            }
        }
    }

    fn recompose(&mut self, store: &SettingsStore, compose: Compose, on_new: OnNew) {
        match compose(&self.text_now(), &self.overrides, self.game.as_deref()) {
            Ok(settings) => store.publish(settings, on_new),
            Err(why) => log::warn!("the settings are not changed: {why}"),
        }
    }

    fn check_file(&mut self, store: &SettingsStore, compose: Compose, on_new: OnNew) {
        let Some(file) = self.file.as_deref() else { return };
        let stamp = stamp(file);
        let is_fresh = stamp.is_some_and(|(time, _)| time.elapsed().is_ok_and(|age| age < RECENT));
        if stamp == self.stamp && !is_fresh && !self.debouncer.is_waiting() {
            return;
        }
        self.stamp = stamp;
        let name = file.display().to_string();
        let (overrides, game) = (&self.overrides, self.game.as_deref());
        match self.debouncer.observe(now_ns(), seen(file), |text| compose(text, overrides, game)) {
            Outcome::Unchanged => {}
            Outcome::Rejected(why) => {
                log::warn!("{name}: {}. The previous settings stay in use", why.trim_end().trim_end_matches('.'));
                store.note_trouble(Some(why));
            }
            Outcome::Accepted(text, settings) => {
                log::info!("{name}: settings applied");
                store.note_trouble(None);
                self.text = text;
                if self.unsaved.is_empty() {
                    store.publish(settings, on_new);
                } else {
                    // Changes that could not be saved override the new text, and are saved to it.
                    self.changed_ns = Some((now_ns(), now_ns()));
                    self.recompose(store, compose, on_new);
                }
            }
        }
    }

    /// Saves the own changes to the current file.
    fn save(&mut self, store: &SettingsStore, compose: Compose) {
        self.changed_ns = None;
        let why = match self.try_save(compose) {
            Ok(()) => None,
            Err(why) => Some(format!("changes apply until the program ends and are not saved: {why}")),
        };
        if why.is_some() && why != self.cannot_save {
            log::warn!("{}", why.as_deref().unwrap_or_default());
        }
        if why.is_none() {
            // The file was readable and is valid now.
            store.note_trouble(None);
        }
        store.note_unsaved(why.clone());
        self.cannot_save = why;
    }

    fn try_save(&mut self, compose: Compose) -> Result<(), String> {
        let file = self.file.as_deref().ok_or("there is no settings folder for this user")?;
        let named = |why: String| format!("{}: {why}", file.display());
        // It may have been changed a moment ago.
        let text = match seen(file) {
            FileState::Text(text) if !text.trim().is_empty() => text,
            FileState::Text(_) | FileState::Absent => self.text.clone(),
            FileState::Unreadable(why) => return Err(named(why)),
        };
        let game = self.game.as_deref();
        compose(&text, &self.overrides, game).map_err(&named)?;
        self.text = text;
        let text = self.text_now();
        compose(&text, &self.overrides, game).map_err(&named)?;
        edit::replace(file, &text).map_err(|error| named(error.to_string()))?;
        self.debouncer.set_written(&text);
        self.text = text;
        self.unsaved.clear();
        Ok(())
    }
}

/// Modification time and length of a file.
fn stamp(file: &Path) -> Option<(SystemTime, u64)> {
    let metadata = std::fs::metadata(file).ok()?;
    Some((metadata.modified().ok()?, metadata.len()))
}

fn seen(file: &Path) -> FileState {
    match read_small_text(file) {
        Ok(text) => FileState::Text(text),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => FileState::Absent,
        Err(error) => FileState::Unreadable(format!("cannot be read: {error}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn compose(text: &str, overrides: &[String], game: Option<&str>) -> Result<Settings, String> {
        Settings::for_game(toml::Table::new(), text, overrides, game).map_err(|error| error.to_string())
    }

    /// Runs a test on a store with its thread, on a file with that text.
    fn with_store(name: &str, text: Option<&str>, overrides: &[&str], test: impl FnOnce(&SettingsStore, &Path)) {
        let folder = std::env::temp_dir().join(format!("radar-chaperone-desk-{name}-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let file = folder.join("settings.toml");
        if let Some(text) = text {
            fs::write(&file, text).unwrap();
        }
        let overrides: Vec<String> = overrides.iter().map(|set| (*set).to_owned()).collect();
        let (store, work) = SettingsStore::new(Some(file.clone()), &overrides, &compose).unwrap();
        std::thread::scope(|scope| {
            scope.spawn(|| work.run(&store, &compose, &|_, _| {}));
            test(&store, &file);
            store.end();
        });
        fs::remove_dir_all(&folder).unwrap();
    }

    fn wait_for(what: &str, is_so: impl Fn() -> bool) {
        for _ in 0..2000 {
            if is_so() {
                return;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        panic!("{what} did not come");
    }

    fn brightness(value: f64) -> SettingChange {
        SettingChange { name: "warning.brightness".into(), value: value.into() }
    }

    #[test]
    fn file_changes_apply_and_invalid_files_do_not() {
        with_store("follow", Some("[warning]\nbrightness = 0.5\n"), &[], |store, file| {
            let is = |value: f32| store.newest().warning.brightness == value;
            assert!(is(0.5));
            fs::write(file, "[warning]\nbrightness = 0.25\n").unwrap();
            wait_for("the file", || is(0.25));
            fs::write(file, "[warning]\nbrightness = 7\n").unwrap();
            wait_for("its fault", || store.trouble().is_some());
            assert!(is(0.25));
            fs::write(file, "[warning]\nbrightness = 0.75\n").unwrap();
            wait_for("a good one", || is(0.75));
        });
    }

    #[test]
    fn changes_apply_and_are_saved_with_comments() {
        let text = "# mine\n[warning]\nbrightness = 0.5 # half\n";
        with_store("change", Some(text), &["warning.brightness=1.0"], |store, file| {
            assert_eq!(store.newest().warning.brightness, 1.0);
            store.change(brightness(0.25));
            wait_for("the change", || store.newest().warning.brightness == 0.25);
            wait_for("the file", || fs::read_to_string(file).unwrap() == text.replace("0.5", "0.25"));
            // The changes are taken in their order.
            store.change(brightness(9.0));
            store.change(SettingChange { name: "warning.fade_distance_m".into(), value: 2.0.into() });
            wait_for("the change after it", || store.newest().warning.fade_distance_m == 2.0);
            assert_eq!(store.newest().warning.brightness, 0.25);
        });
    }

    #[test]
    fn settings_of_a_game_apply_and_are_changed_while_it_is_shown() {
        let text = "[warning]\nbrightness = 0.5\n[games.\"steam.app.1\".warning]\nbrightness = 0.25 # dark\n";
        with_store("games", Some(text), &[], |store, file| {
            let is = |value: f32| store.newest().warning.brightness == value;
            assert!(is(0.5));
            store.set_game(Some("steam.app.1".into()));
            wait_for("the game's", || is(0.25));
            store.change(brightness(0.75));
            wait_for("the change", || is(0.75));
            wait_for("the file", || fs::read_to_string(file).unwrap() == text.replace("0.25", "0.75"));
            store.set_game(None);
            wait_for("the others", || is(0.5));
        });
    }

    #[test]
    fn invalid_file_is_not_overwritten_until_valid() {
        with_store("wrong", Some(""), &[], |store, file| {
            fs::write(file, "[warning\n").unwrap();
            store.change(brightness(0.25));
            wait_for("the change", || store.newest().warning.brightness == 0.25);
            wait_for("the refused save", || store.trouble.lock().unwrap()[1].is_some());
            assert_eq!(fs::read_to_string(file).unwrap(), "[warning\n");
            fs::write(file, "[warning]\nfade_distance_m = 2.0\n").unwrap();
            let whole = "[warning]\nfade_distance_m = 2.0\nbrightness = 0.25\n";
            wait_for("both", || fs::read_to_string(file).unwrap() == whole);
            assert_eq!(store.newest().warning.fade_distance_m, 2.0);
        });
    }

    #[test]
    fn initially_invalid_file_gives_defaults_and_is_reported() {
        with_store("begins-wrong", Some("broken ["), &["warning.brightness=0.5"], |store, file| {
            let default = Settings::default().warning;
            assert_eq!((store.newest().warning.brightness, store.newest().warning.style), (0.5, default.style));
            let trouble = store.trouble().expect("it is wrong");
            assert!(trouble.contains("line 1") && !trouble.contains('\n'), "{trouble}");
            fs::write(file, "[cues]\nvolume = 2.0\n").unwrap();
            wait_for("the other fault", || store.trouble().is_some_and(|trouble| trouble.contains("cues.volume is 2")));
            fs::write(file, "[cues]\nvolume = 0.25\n").unwrap();
            wait_for("a good one", || store.newest().cues.volume == 0.25 && store.trouble().is_none());
        });
        let nonsense = ["warning.brightness=9".to_owned()];
        assert!(SettingsStore::new(None, &nonsense, &compose).is_err(), "the command line is refused");
    }

    #[test]
    fn missing_file_is_created() {
        with_store("made", None, &[], |store, file| {
            store.change(brightness(0.25));
            wait_for("the file", || {
                fs::read_to_string(file).is_ok_and(|text| text == "[warning]\nbrightness = 0.25\n")
            });
        });
    }
}
