//! The content of the window and its actions. It knows no window and no GPU: a pass takes input,
//! and returns egui shapes and a request for an image of the room.

use std::time::Duration;

use egui::{CentralPanel, Frame, Panel, RichText, Ui, UiBuilder};

use super::camera::{Camera, Eye, View};
use super::drawing::Drawing;
use super::history::Moment;
use super::keys::{self, Action};
use super::layers::Layers;
use super::map_view::{Cut, MapView};
use super::player::Player;
use super::recorder::SharedHistory;
use super::recording_info::RecordingInfo;
use super::room::room;
use super::viewport::{ViewContent, viewport};
use super::{panel, style, timeline};
use crate::warning::{Panel as WarningPanel, warn};
use radar_sar::geometry::Aabb;

/// Repaint interval of the timeline while the recording is being processed. Choice: the bar grows
/// smoothly, and the processor is left to the processing.
const BUFFERING_REPAINT: Duration = Duration::from_millis(100);
/// Repaint interval of live data. Choice: five times the rate of map updates, so that the head's
/// path moves smoothly.
const LIVE_REPAINT: Duration = Duration::from_millis(50);
/// Limit of the time between two passes, seconds. After a pause, playback does not skip ahead by
/// more than this. Choice: an update of the map.
const MAX_PASS_S: f64 = 0.25;
/// Share of the width that the room has if maps are beside it. Choice: about two thirds; three maps
/// below each other fit the rest.
const ROOM_SHARE: f32 = 0.68;
/// Limit of drawn points of the head's path. Choice: about one per pixel of the view's width.
const PATH_POINTS: usize = 1500;

/// What the central area shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arrangement {
    /// The room.
    Room,
    /// The room with the maps beside it.
    Both,
    /// The maps.
    Maps,
}

/// A request for an image of the room.
pub struct RoomRequest {
    /// The camera.
    pub eye: Eye,
    /// What to draw.
    pub drawing: Drawing,
    /// Size, egui points.
    pub size: egui::Vec2,
}

/// State of everything that the window shows.
pub struct App {
    about: RecordingInfo,
    history: SharedHistory,
    /// Playback state.
    pub player: Player,
    /// Visible layers.
    pub layers: Layers,
    arrangement: Arrangement,
    camera: Camera,
    /// The named view that follows the content, until the user moves the camera.
    view: Option<View>,
    maps: MapView,
    is_help: bool,
    before_s: Option<f64>,
    texture: egui::TextureId,
    room_request: Option<RoomRequest>,
}

impl App {
    /// At the beginning of the recording. `texture`: the texture that will hold the image of the
    /// room.
    pub fn new(about: RecordingInfo, history: SharedHistory) -> Self {
        Self {
            layers: Layers::new(about.min_score()),
            player: if about.is_live { Player::live() } else { Player::default() },
            about,
            history,
            arrangement: Arrangement::Both,
            camera: Camera::default(),
            view: Some(View::Overview),
            maps: MapView::default(),
            is_help: false,
            before_s: None,
            texture: egui::TextureId::default(),
            room_request: None,
        }
    }

    /// Sets the texture that will hold the image of the room.
    pub fn set_texture(&mut self, texture: egui::TextureId) {
        self.texture = texture;
    }

    /// Selects a named view.
    pub fn set_view(&mut self, view: View) {
        self.view = Some(view);
    }

    /// Selects room, maps or both.
    pub fn set_arrangement(&mut self, arrangement: Arrangement) {
        self.arrangement = arrangement;
    }

    /// Selects where the maps are cut.
    pub fn set_cut(&mut self, cut: Cut) {
        self.maps.set_cut(cut);
    }

    /// Time as a share of the recording at which the warnings straight ahead are brightest.
    pub fn brightest(&self, duration_s: f64) -> f64 {
        let brightness = |share: &f64| {
            let moment = self.history.lock().moment(share * duration_s, 2);
            let Some(head) = moment.head else { return 0.0 };
            let ahead = |panel: &WarningPanel| {
                let to = panel.tracking_from_panel.translation - head.translation;
                f64::from(panel.alpha) * to.normalize_or_zero().dot(head.forward()).max(0.0).powi(4)
            };
            warn(&moment.scene, &head, &self.about.warning).panels.iter().map(ahead).sum()
        };
        let shares = (1..=100).map(|n| f64::from(n) / 100.0);
        let all = shares.map(|share| (share, brightness(&share)));
        all.fold((1.0, 0.0), |best, one| if one.1 > best.1 { one } else { best }).0
    }

    /// The image requested since the last pass, if any.
    pub fn take_room_request(&mut self) -> Option<RoomRequest> {
        self.room_request.take()
    }

    /// Whether live data has ended.
    pub fn is_over(&self) -> bool {
        self.about.is_live && self.history.lock().extent().is_complete
    }

    /// Runs one pass.
    pub fn ui(&mut self, ui: &mut Ui) {
        if let Some(about) = self.history.take_info() {
            self.about = about;
        }
        let now_s = ui.input(|input| input.time);
        let passed_s = self.before_s.replace(now_s).map_or(0.0, |before_s| (now_s - before_s).clamp(0.0, MAX_PASS_S));
        let (extent, marks, heads, top_score) = {
            let history = self.history.lock();
            (history.extent(), history.marks().collect::<Vec<_>>(), history.heads_around(), history.greatest_score())
        };
        self.player.advance(passed_s, &extent);
        for action in ui.input(keys::pressed) {
            self.apply_action(action);
        }
        Panel::top("top").frame(Frame::side_top_panel(ui.style())).show(ui, |ui| self.top(ui));
        let asked =
            Panel::bottom("time").show(ui, |ui| timeline::timeline(ui, &mut self.player, &extent, &marks)).inner;
        self.is_help |= asked.help;
        self.step(asked.step);
        let corners = heads.map(|heads| [heads.min, heads.max]);
        let bounds = self.about.bounds(corners.into_iter().flatten());
        let moment = self.history.lock().moment(self.player.time_s(), PATH_POINTS);
        Panel::right("panel").default_size(330.0).min_size(260.0).show(ui, |ui| {
            panel::panel(ui, &self.about, &moment, &mut self.layers, top_score);
        });
        CentralPanel::default()
            .frame(Frame::new().fill(style::GROUND))
            .show(ui, |ui| self.middle(ui, &moment, &bounds, top_score));
        if self.is_help {
            keys::list(ui.ctx(), &mut self.is_help);
        }
        self.ask_for_more(ui, &extent);
    }

    /// Requests a repaint only if something will change.
    fn ask_for_more(&self, ui: &Ui, extent: &super::player::Extent) {
        let is_waiting = self.player.time_s() >= extent.buffered_s && !extent.is_complete;
        if self.player.is_at_edge() && !extent.is_complete {
            ui.ctx().request_repaint_after(LIVE_REPAINT);
        } else if self.player.is_playing() && !is_waiting {
            ui.ctx().request_repaint();
        } else if !extent.is_complete {
            ui.ctx().request_repaint_after(BUFFERING_REPAINT);
        }
    }

    fn top(&mut self, ui: &mut Ui) {
        ui.horizontal(|ui| {
            ui.label(RichText::new("View").color(style::MUTED));
            let views = [View::Overview, View::Above, View::Side, View::FirstPerson];
            for (view, name) in views.into_iter().zip(["Overview", "From above", "From the side", "First person"]) {
                if ui.selectable_label(self.view == Some(view), name).clicked() {
                    self.view = Some(view);
                }
            }
            ui.separator();
            let arrangements = [Arrangement::Room, Arrangement::Both, Arrangement::Maps];
            for (arrangement, name) in arrangements.into_iter().zip(["Room", "Room and maps", "Maps"]) {
                ui.selectable_value(&mut self.arrangement, arrangement, name);
            }
        });
    }

    fn middle(&mut self, ui: &mut Ui, moment: &Moment, bounds: &Aabb, top_score: f32) {
        let shown =
            ViewContent { about: &self.about, moment, layers: &self.layers, bounds, top_score, texture: self.texture };
        let whole = ui.available_rect_before_wrap();
        let share = match self.arrangement {
            Arrangement::Room => 1.0,
            Arrangement::Both => ROOM_SHARE,
            Arrangement::Maps => 0.0,
        };
        let (left, right) = whole.split_left_right_at_fraction(share);
        if share > 0.0 {
            let aspect = f64::from(left.width() / left.height().max(1.0));
            if let Some(view) = self.view {
                self.camera = Camera::fitting(view, bounds, aspect);
            }
            let (eye, is_moved) = viewport(ui, left, &mut self.camera, &shown);
            if is_moved {
                self.view = None;
            }
            let inside = self.camera.is_first_person && moment.head.is_some();
            let drawing = room(&self.about, moment, &self.layers, bounds, top_score, inside);
            self.room_request = Some(RoomRequest { eye, drawing, size: left.size() });
        }
        if share < 1.0 {
            let builder = UiBuilder::new().max_rect(right.shrink(8.0));
            ui.scope_builder(builder, |ui| self.maps.show(ui, &shown));
        }
    }

    fn apply_action(&mut self, action: Action) {
        let extent = self.history.lock().extent();
        match action {
            Action::Toggle => self.player.toggle(&extent),
            Action::Step(way) => self.step(way),
            Action::Jump(way) => self.player.seek(self.player.time_s() + f64::from(way), &extent),
            Action::Home => self.player.seek(0.0, &extent),
            Action::End => self.player.seek(extent.duration_s, &extent),
            Action::Loop => self.player.set_looping(!self.player.is_looping()),
            Action::Speed(steps) => self.player.change_speed(steps),
            Action::View(n) => {
                let views = [View::Overview, View::Above, View::Side, View::FirstPerson];
                self.view = views.get(n).copied();
            }
            Action::Arrangement => {
                self.arrangement = match self.arrangement {
                    Arrangement::Room => Arrangement::Both,
                    Arrangement::Both => Arrangement::Maps,
                    Arrangement::Maps => Arrangement::Room,
                }
            }
            Action::Truth => self.layers.truth = !self.layers.truth,
            Action::Warnings => self.layers.warnings = !self.layers.warnings,
            Action::Help => self.is_help = !self.is_help,
            Action::NoHelp => self.is_help = false,
        }
    }

    /// Steps to the previous or next frame and pauses.
    fn step(&mut self, way: i32) {
        if way == 0 {
            return;
        }
        let history = self.history.lock();
        let (extent, frame_s) = (history.extent(), history.adjacent_frame(self.player.time_s(), way));
        drop(history);
        self.player.pause();
        if let Some(frame_s) = frame_s {
            self.player.seek(frame_s, &extent);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Settings;
    use a121::preset;
    use egui::{Context, Event, Key, Modifiers, Pos2, RawInput, Rect, vec2};
    use glam::DVec3;
    use radar_mapping::MapperKind;
    use radar_recording::Header;
    use radar_sar::geometry::Pose;

    fn app() -> App {
        let header = Header::new("test", preset("d16").unwrap(), Pose::IDENTITY);
        let history = SharedHistory::new(1.0);
        for tick in 0..100i64 {
            let mut inside = history.lock();
            inside.push_head(tick * 10_000_000, Pose::from_translation(DVec3::Y * 1.6));
            inside.push_frame(tick * 10_000_000);
        }
        history.lock().complete();
        App::new(RecordingInfo::new(&header, &Settings::default(), MapperKind::Rooms, 1.0), history)
    }

    fn pass(context: &Context, app: &mut App, time_s: f64, events: Vec<Event>) -> Duration {
        let screen_rect = Some(Rect::from_min_size(Pos2::ZERO, vec2(1200.0, 800.0)));
        let input = RawInput { screen_rect, time: Some(time_s), events, ..Default::default() };
        let output = context.run_ui(input, |ui| app.ui(ui));
        let delay = output.viewport_output.values().map(|viewport| viewport.repaint_delay).min();
        output.drop_without_applying_deltas();
        delay.unwrap_or(Duration::MAX)
    }

    fn key(key: Key) -> Vec<Event> {
        vec![Event::Key { key, physical_key: None, pressed: true, repeat: false, modifiers: Modifiers::NONE }]
    }

    #[test]
    fn keys_play_stop_and_step() {
        let (context, mut app) = (Context::default(), app());
        pass(&context, &mut app, 0.0, vec![]);
        pass(&context, &mut app, 0.1, vec![]);
        assert!((app.player.time_s() - 0.1).abs() < 1e-9);
        pass(&context, &mut app, 0.2, key(Key::Space));
        let stopped_s = app.player.time_s();
        pass(&context, &mut app, 0.3, vec![]);
        assert_eq!(app.player.time_s(), stopped_s);
        pass(&context, &mut app, 0.4, key(Key::ArrowRight));
        assert!((app.player.time_s() - stopped_s - 0.01).abs() < 1e-6, "{}", app.player.time_s());
        pass(&context, &mut app, 0.5, key(Key::ArrowLeft));
        assert!((app.player.time_s() - stopped_s).abs() < 1e-6);
        pass(&context, &mut app, 0.6, key(Key::End));
        assert!((app.player.time_s() - 0.99).abs() < 1e-9);
    }

    #[test]
    fn no_repaint_without_changes() {
        let (context, mut app) = (Context::default(), app());
        assert_eq!(pass(&context, &mut app, 0.0, vec![]), Duration::ZERO, "it plays");
        app.player.pause();
        let delays: Vec<_> = (1..20).map(|n| pass(&context, &mut app, f64::from(n), vec![])).collect();
        assert!(*delays.last().unwrap() > Duration::from_secs(1), "{delays:?}");
    }

    #[test]
    fn clicking_the_timeline_seeks() {
        let (context, mut app) = (Context::default(), app());
        app.player.pause();
        pass(&context, &mut app, 0.0, vec![]);
        let at = egui::pos2(600.0, 775.0);
        let button = |pressed| Event::PointerButton {
            pos: at,
            button: egui::PointerButton::Primary,
            pressed,
            modifiers: Modifiers::NONE,
        };
        pass(&context, &mut app, 0.1, vec![Event::PointerMoved(at)]);
        pass(&context, &mut app, 0.2, vec![button(true)]);
        pass(&context, &mut app, 0.3, vec![button(false)]);
        assert!((app.player.time_s() - 0.495).abs() < 0.02, "{}", app.player.time_s());
    }

    #[test]
    fn every_view_and_arrangement_renders() {
        let (context, mut app) = (Context::default(), app());
        for (n, k) in [Key::Num1, Key::Num2, Key::Num3, Key::Num4, Key::M, Key::M, Key::M, Key::T, Key::W, Key::F1]
            .into_iter()
            .enumerate()
        {
            pass(&context, &mut app, n as f64, key(k));
            let is_wanted = app.take_room_request().is_some();
            assert_eq!(is_wanted, app.arrangement != Arrangement::Maps, "{k:?}");
        }
    }
}
