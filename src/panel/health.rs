//! State of sensor, tracking and reconstruction: turns numbers into plain text, with a remedy for
//! each fault.

use egui::{Align2, Color32, Painter, Rect, pos2, vec2};

use super::{BAD, CARD, FAINT, FAIR, GOOD, ROUND, TEXT, font};

/// A warning is shown from this share of lost sweeps on, percent. Choice: single losses are normal;
/// one in fifty points to a line or a computer that does not keep up.
const HIGH_LOSS_PERCENT: f64 = 2.0;
/// An older newest sweep means that no data arrives or none is processed, seconds. Choice: four
/// updates of the map missed in a row.
const STALE_AGE_S: f64 = 1.0;
/// A time offset with this 1σ is accurate enough for everything that is drawn, seconds. Choice: 4
/// mm at walking speed; in simulated furnished rooms an error of 3 ms added no false objects, one
/// of 10 ms many.
const GOOD_OFFSET_SIGMA_S: f64 = 3e-3;

/// State of the sensor.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum SensorHealth {
    /// Not found yet, or its port does not open.
    #[default]
    Missing,
    /// Connected; its rate is not known yet.
    Starting,
    /// Connected, but it sends no data.
    Silent,
    /// It sends data.
    Streaming {
        /// Sweep rate, Hz.
        sweeps_per_s: f64,
        /// Share of lost sweeps, percent.
        lost_percent: f64,
    },
}

/// What is known of the sensor's place on the headset.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum MountHealth {
    /// The motion so far does not show it.
    #[default]
    Unknown,
    /// The data agree with the setting.
    AsSet,
    /// The data gave another place or direction, which is in use.
    Corrected {
        /// Distance from the setting, millimetres.
        by_mm: i32,
        /// Angle from the set direction, degrees.
        by_deg: i32,
    },
    /// The data give another place or direction, which is not used.
    Contradicted,
}

/// What the VR runtime refuses to show.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DisplayTrouble {
    /// The display mode of the settings: panels are shown.
    PanelsInstead,
    /// All warnings: tones and pulses warn.
    CuesAlone,
}

/// State of the whole system.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Health {
    /// The sensor.
    pub sensor: SensorHealth,
    /// Whether the head is tracked.
    pub is_tracked: bool,
    /// Rate of poses that reach the reconstruction, Hz.
    pub poses_per_s: f64,
    /// Time of a sweep's pose minus time of the sweep, seconds.
    pub time_offset_s: f64,
    /// 1σ of `time_offset_s`, seconds, if it was estimated from the data.
    pub time_offset_sigma_s: Option<f64>,
    /// The sensor's place on the headset.
    pub mount: MountHealth,
    /// Slow tracking error in each axis as estimated, rms, metres.
    pub drift_m: Option<f64>,
    /// Measured minus true range, by which the ranges are corrected, metres.
    pub range_bias_m: Option<f64>,
    /// Age of the newest processed sweep, seconds; `None` before the first.
    pub age_s: Option<f64>,
    /// Whether the reconstruction is running.
    pub is_running: bool,
    /// Number of obstacles in the map.
    pub obstacles: usize,
    /// Number of walls in the map.
    pub walls: usize,
    /// Number of obstacles and walls from the saved map that were not detected again yet.
    pub restored: usize,
    /// Why the sensor does not measure.
    pub sensor_trouble: Option<String>,
    /// What the VR runtime refuses to show.
    pub display_trouble: Option<DisplayTrouble>,
    /// Error in the settings file, in one line.
    pub settings_trouble: Option<String>,
}

/// Severity.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum State {
    Good,
    Fair,
    Bad,
}

impl State {
    pub fn color(self) -> Color32 {
        match self {
            Self::Good => GOOD,
            Self::Fair => FAIR,
            Self::Bad => BAD,
        }
    }
}

/// The content of one status card.
#[derive(Debug, PartialEq)]
pub(super) struct StatusCard {
    pub title: &'static str,
    pub state: State,
    pub headline: String,
    /// Numbers if all is well, else the remedy.
    pub detail: String,
}

impl Health {
    /// Cards for sensor, headset, calibration, room.
    pub(super) fn status_cards(&self) -> [StatusCard; 4] {
        [self.sensor(), self.headset(), self.timing(), self.room()]
    }

    /// Whether something estimated is in use that could be forgotten.
    pub(super) fn is_calibrated(&self) -> bool {
        self.time_offset_sigma_s.is_some() || matches!(self.mount, MountHealth::Corrected { .. })
    }

    /// Problems without a card: warnings are refused or switched off, or the settings file is invalid.
    pub(super) fn notice(&self, warnings: bool) -> Option<(State, String)> {
        match (&self.display_trouble, &self.settings_trouble, warnings) {
            (Some(DisplayTrouble::CuesAlone), _, _) => {
                Some((State::Bad, "SteamVR refuses warnings: tones and pulses warn. Restart SteamVR".into()))
            }
            (_, Some(why), _) => Some((State::Fair, format!("Settings file: {}", shortened(why)))),
            (_, None, false) => Some((State::Fair, "Warnings are switched off".into())),
            (Some(DisplayTrouble::PanelsInstead), None, true) => {
                Some((State::Fair, "SteamVR refuses this display mode: panels are shown".into()))
            }
            (None, None, true) => None,
        }
    }

    fn sensor(&self) -> StatusCard {
        let (state, headline, more) = match &self.sensor {
            SensorHealth::Missing => {
                (State::Bad, "No radar sensor found".into(), "Plug it in: it is looked for every two seconds.".into())
            }
            SensorHealth::Starting => (State::Good, "Radar is connected".into(), "Measuring its sweep rate.".into()),
            SensorHealth::Silent => (
                State::Bad,
                "The sensor sends nothing".into(),
                "Wait a moment; then unplug it and plug it in again.".into(),
            ),
            SensorHealth::Streaming { sweeps_per_s, lost_percent } if *lost_percent >= HIGH_LOSS_PERCENT => (
                State::Fair,
                format!("{lost_percent:.0} % of the sweeps are lost"),
                format!("{sweeps_per_s:.0} sweeps a second arrive. Use another USB port or a shorter cable."),
            ),
            SensorHealth::Streaming { sweeps_per_s, lost_percent } => (
                State::Good,
                "Radar is measuring".into(),
                format!("{sweeps_per_s:.0} sweeps a second, {lost_percent:.1} % lost{}", self.range_text()),
            ),
        };
        StatusCard { title: "Sensor", state, headline, detail: more }
    }

    fn range_text(&self) -> String {
        let text = |bias_m: f64| format!("; ranges corrected by {:.1} mm", -bias_m * 1e3);
        self.range_bias_m.map(text).unwrap_or_default()
    }

    fn headset(&self) -> StatusCard {
        let (state, headline, more) = match self.is_tracked {
            true if self.poses_per_s < 1.0 => (State::Good, "Headset is tracked".into(), "No poses used yet.".into()),
            true => {
                let drift = self.drift_m.map(|drift_m| format!("; it drifts by {:.1} mm", drift_m * 1e3));
                let detail = format!("{:.0} poses a second{}", self.poses_per_s, drift.unwrap_or_default());
                (State::Good, "Headset is tracked".into(), detail)
            }
            false => (
                State::Bad,
                "Headset is not tracked".into(),
                "Let it see the base stations or the lit room again.".into(),
            ),
        };
        StatusCard { title: "Headset", state, headline, detail: more }
    }

    fn timing(&self) -> StatusCard {
        let offset_ms = self.time_offset_s * 1e3;
        let (state, headline, more) = match self.time_offset_sigma_s {
            Some(sigma_s) if sigma_s <= GOOD_OFFSET_SIGMA_S && self.mount == MountHealth::Contradicted => (
                State::Fair,
                "The sensor is not where it is set".into(),
                "Run `radar-chaperone calibrate`, or set tracking.estimate_mount = true.".into(),
            ),
            Some(sigma_s) if sigma_s <= GOOD_OFFSET_SIGMA_S && self.mount == MountHealth::Unknown => (
                State::Fair,
                "The sensor's place is not known yet".into(),
                "Turn and nod your head for some seconds.".into(),
            ),
            Some(sigma_s) if sigma_s <= GOOD_OFFSET_SIGMA_S => (
                State::Good,
                "Radar and headset agree".into(),
                format!("offset {offset_ms:+.1} ± {:.1} ms; {}", sigma_s * 1e3, self.mount.text()),
            ),
            Some(sigma_s) => (
                State::Fair,
                "Timing is not known well yet".into(),
                format!("±{:.0} ms. Move your head to and fro for some seconds.", sigma_s * 1e3),
            ),
            None => {
                (State::Fair, "Timing is not known yet".into(), "Move your head to and fro for some seconds.".into())
            }
        };
        StatusCard { title: "Calibration", state, headline, detail: more }
    }

    fn room(&self) -> StatusCard {
        let found = || format!("{} and {}", count_text(self.obstacles, "obstacle"), count_text(self.walls, "wall"));
        let (state, headline, more) = match self.age_s {
            _ if !self.is_running && self.age_s.is_some() => {
                (State::Bad, "The map has stopped".into(), "Restart Radar chaperone.".into())
            }
            None if self.restored > 0 => {
                (State::Fair, format!("{} remembered", found()), "The map begins with the first sweeps.".into())
            }
            None => (State::Fair, "Nothing mapped yet".into(), "The map begins with the first sweeps.".into()),
            Some(age_s) if age_s > STALE_AGE_S => {
                (State::Bad, "The map is not updating".into(), format!("{} known, {}", found(), age_text(age_s)))
            }
            Some(_) if self.obstacles + self.walls == 0 => {
                (State::Fair, "Nothing found yet".into(), "Look around the room for some seconds.".into())
            }
            Some(_) if self.restored > 0 => {
                (State::Good, found(), format!("{} of them remembered, not seen again yet", self.restored))
            }
            Some(age_s) => (State::Good, found(), age_text(age_s)),
        };
        StatusCard { title: "Room", state, headline, detail: more }
    }
}

impl MountHealth {
    fn text(self) -> String {
        match self {
            Self::AsSet => "the sensor is where it is set".into(),
            Self::Corrected { by_mm, by_deg: 0 } => format!("the sensor is {by_mm} mm from where it is set"),
            Self::Corrected { by_mm, by_deg } => format!("the sensor is {by_mm} mm and {by_deg}° from how it is set"),
            Self::Unknown | Self::Contradicted => String::new(),
        }
    }
}

/// Shortens a text to the width of the header.
fn shortened(text: &str) -> String {
    /// Length of a shown text, characters. Choice: what fits the header's width.
    const MOST: usize = 60;
    match text.char_indices().nth(MOST) {
        Some((end, _)) => format!("{}…", text[..end].trim_end()),
        None => text.to_owned(),
    }
}

fn count_text(count: usize, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

fn age_text(age_s: f64) -> String {
    match age_s {
        age_s if age_s <= STALE_AGE_S => "up to date".to_owned(),
        age_s => format!("last seen {age_s:.0} s ago"),
    }
}

/// Number of the card about calibration.
pub(super) const CALIBRATION: usize = 2;

/// Where a card is in a grid of two by two.
pub(super) fn card_area(area: Rect, number: usize) -> Rect {
    /// Gap between cards, pixels. Choice: half the panel's margin.
    const GAP: f32 = 14.0;
    let size = (area.size() - vec2(GAP, GAP)) / 2.0;
    let (column, row) = ((number % 2) as f32, (number / 2) as f32);
    Rect::from_min_size(area.min + vec2(column * (size.x + GAP), row * (size.y + GAP)), size)
}

/// Draws the cards.
pub(super) fn cards(painter: &Painter, area: Rect, status_cards: &[StatusCard; 4]) {
    for (n, finding) in status_cards.iter().enumerate() {
        let card = card_area(area, n);
        painter.rect_filled(card, ROUND, CARD);
        let left = card.min.x + 24.0;
        painter.circle_filled(pos2(left + 10.0, card.min.y + 33.0), 10.0, finding.state.color());
        let title = pos2(left + 34.0, card.min.y + 33.0);
        painter.text(title, Align2::LEFT_CENTER, finding.title, font(21.0), FAINT);
        let width = card.width() - 44.0;
        let headline = painter.layout(finding.headline.clone(), font(27.0), TEXT, width);
        painter.galley(pos2(left, card.min.y + 54.0), headline, TEXT);
        let more = painter.layout(finding.detail.clone(), font(20.0), FAINT, width);
        painter.galley(pos2(left, card.min.y + 94.0), more, FAINT);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn well() -> Health {
        Health {
            sensor_trouble: None,
            display_trouble: None,
            sensor: SensorHealth::Streaming { sweeps_per_s: 1056.0, lost_percent: 0.0 },
            is_tracked: true,
            poses_per_s: 250.0,
            time_offset_s: 0.0021,
            time_offset_sigma_s: Some(0.0004),
            mount: MountHealth::Corrected { by_mm: 42, by_deg: 0 },
            drift_m: Some(0.0012),
            range_bias_m: None,
            age_s: Some(0.05),
            is_running: true,
            obstacles: 5,
            walls: 1,
            restored: 0,
            settings_trouble: None,
        }
    }

    fn states(health: &Health) -> [State; 4] {
        health.status_cards().map(|finding| finding.state)
    }

    #[test]
    fn healthy_state_is_described() {
        assert_eq!(states(&well()), [State::Good; 4]);
        let [sensor, headset, timing, room] = well().status_cards();
        assert_eq!(sensor.detail, "1056 sweeps a second, 0.0 % lost");
        let corrected = Health { range_bias_m: Some(0.0043), ..well() };
        assert_eq!(corrected.status_cards()[0].detail, "1056 sweeps a second, 0.0 % lost; ranges corrected by -4.3 mm");
        assert_eq!(headset.detail, "250 poses a second; it drifts by 1.2 mm");
        assert_eq!(timing.detail, "offset +2.1 ± 0.4 ms; the sensor is 42 mm from where it is set");
        assert_eq!(room.headline, "5 obstacles and 1 wall");
    }

    #[test]
    fn each_fault_has_its_card_and_remedy() {
        let lossy = SensorHealth::Streaming { sweeps_per_s: 900.0, lost_percent: 15.0 };
        for (health, at, state, word) in [
            (Health { sensor: SensorHealth::Missing, ..well() }, 0, State::Bad, "Plug"),
            (Health { sensor: SensorHealth::Silent, ..well() }, 0, State::Bad, "plug"),
            (Health { sensor: lossy, ..well() }, 0, State::Fair, "USB"),
            (Health { is_tracked: false, ..well() }, 1, State::Bad, "see"),
            (Health { time_offset_sigma_s: None, ..well() }, 2, State::Fair, "to and fro"),
            (Health { time_offset_sigma_s: Some(0.01), ..well() }, 2, State::Fair, "to and fro"),
            (Health { mount: MountHealth::Contradicted, ..well() }, 2, State::Fair, "calibrate"),
            (Health { mount: MountHealth::Unknown, ..well() }, 2, State::Fair, "nod"),
            (Health { age_s: None, ..well() }, 3, State::Fair, "first sweeps"),
            (Health { age_s: Some(4.0), ..well() }, 3, State::Bad, "4 s ago"),
            (Health { is_running: false, ..well() }, 3, State::Bad, "Restart"),
            (Health { obstacles: 0, walls: 0, ..well() }, 3, State::Fair, "Look around"),
            (Health { age_s: None, restored: 6, ..well() }, 3, State::Fair, "first sweeps"),
        ] {
            let mut expected = [State::Good; 4];
            expected[at] = state;
            assert_eq!(states(&health), expected, "{health:?}");
            assert!(health.status_cards()[at].detail.contains(word), "{:?}", health.status_cards()[at]);
        }
    }

    #[test]
    fn unknown_rates_are_not_shown_as_zero() {
        let begins = Health { sensor: SensorHealth::Starting, poses_per_s: 0.0, restored: 4, ..well() };
        assert_eq!(states(&begins), [State::Good; 4]);
        let details = begins.status_cards().map(|finding| finding.detail);
        assert!(details.iter().all(|more| !more.contains("0 sweeps") && !more.contains("0 poses")), "{details:?}");
        assert_eq!(details[3], "4 of them remembered, not seen again yet");
    }

    #[test]
    fn notice_reports_settings_errors_and_disabled_warnings() {
        assert_eq!(well().notice(true), None);
        assert_eq!(well().notice(false), Some((State::Fair, "Warnings are switched off".into())));
        let why = "TOML parse error at line 12, column 3, with a great many words of what else there might have been";
        let (state, headline) = Health { settings_trouble: Some(why.into()), ..well() }.notice(false).unwrap();
        assert!(
            state == State::Fair && headline.starts_with("Settings file: TOML parse error at line 12"),
            "{headline}"
        );
        assert!(headline.chars().count() < 80 && headline.ends_with('…'), "{headline}");
    }
}
