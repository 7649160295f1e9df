//! When to play a tone and when to pulse a controller: a state machine over the warnings of each
//! frame.
//!
//! A cue follows the brightness of a warning, which contains distance, time to contact and
//! habituation. A wearer who stands still near a wall gets no cues, because the warning has dimmed
//! below the start level. Cues have hysteresis: they start at one brightness and stop at a lower
//! one. They repeat faster with brightness, up to a limit, and thin out after some seconds at the
//! same level.

use std::sync::LazyLock;

use glam::DVec3;
use radar_sar::{BoundedSettings, SettingBound, bounds};
use serde::{Deserialize, Serialize};

use super::panel::{Panel, Warnings};
use super::wearer::{BodyPart, Wearer};

/// Share of full brightness at which cues start, and the lower one at which they stop. Choice:
/// about half way into the fade distance, so drawing warns first; the gap keeps cues from
/// stuttering.
const START_LEVEL: f64 = 0.55;
const STOP_LEVEL: f64 = 0.40;
/// Interval between starts of pulses, seconds: at the start level, and at full brightness. Choice:
/// from single taps to nearly continuous, so the rate gives the distance.
const PULSE_INTERVAL_S: (f64, f64) = (0.6, 0.2);
/// Length of a pulse, nanoseconds. A pulse consists of ticks, one per frame. Choice: six ticks at
/// 90 Hz feel like one tap.
const PULSE_NS: i64 = 70_000_000;
/// Least interval between ticks, nanoseconds. Source: openvr.h, one pulse every 5 ms at most.
/// Choice: 1 ms more.
const MIN_TICK_INTERVAL_NS: i64 = 6_000_000;
/// Length of a tick at the start level and at full brightness, microseconds. A controller accepts
/// less than 4000. Choice: from just felt to nearly the limit.
const TICK_US: (f64, f64) = (900.0, 3500.0);
/// A cue thins out after this time at one level, nanoseconds. Choice: the wearer has understood by
/// then; going on would make them switch cues off.
const THIN_OUT_AFTER_NS: i64 = 4_000_000_000;
/// Interval of a thinned-out cue, seconds, and the rise of the level that ends the thinning.
/// Choice: a reminder while they stay; a level that rises by a third of the cues' span is news.
const THINNED_INTERVAL_S: f64 = 2.0;
const ESCALATION_LEVEL: f64 = 0.15;

/// Parameters of the tones.
static TONES: LazyLock<ToneParameters> = LazyLock::new(|| {
    let Ok(tones) = toml::from_str(include_str!("../../overlay_assets/tones.toml")) else {
        unreachable!("the parameters inside the program are valid");
    };
    tones
});

/// Parameters of the tones; pairs are values at the start level and at full brightness.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ToneParameters {
    length_s: f64,
    pitch_hz: (f64, f64),
    interval_s: (f64, f64),
}

/// Settings of the cues that accompany the drawn warnings.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CueSettings {
    /// Whether soft tones sound from the direction of the nearest obstacle.
    pub sound: bool,
    /// Volume of the tones, 0 to 1.
    pub volume: f64,
    /// Whether the controller of a hand near an obstacle pulses; both pulse for head or torso.
    pub pulse: bool,
    /// Strength of the pulses, 0 to 1.
    pub pulse_strength: f64,
}

impl BoundedSettings for CueSettings {
    const BOUNDS: &'static [SettingBound<Self>] = bounds![
        volume: 0.0, 1.0;
        pulse_strength: 0.0, 1.0;
    ];
}

impl Default for CueSettings {
    /// Pulses are on: only the wearer feels them, and they indicate the hand. Sound is off: it
    /// mixes with the game's sound, and other people may be in the room.
    fn default() -> Self {
        Self { sound: false, volume: 0.4, pulse: true, pulse_strength: 0.7 }
    }
}

/// A short soft tone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tone {
    /// Position from −1 (left) to 1 (right).
    pub pan: f32,
    /// Volume, 0 to 1.
    pub volume: f32,
    /// Pitch, hertz.
    pub hz: f32,
    /// Length, seconds.
    pub length_s: f32,
}

/// The cues of one frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Cue {
    /// How long to drive the left and the right controller, microseconds.
    pub ticks_us: [Option<u16>; 2],
    /// A tone to start.
    pub tone: Option<Tone>,
}

/// Schedules cues. Deterministic: the same warnings and wearers in the same order give the same
/// cues.
#[derive(Debug, Clone, Default)]
pub struct CueScheduler {
    pulses: [Repeater; 2],
    ticked_ns: [Option<i64>; 2],
    tones: Repeater,
    last_ns: Option<i64>,
}

impl CueScheduler {
    /// Without any history.
    pub fn new() -> Self {
        // Parsed here, not in the first frame with a warning.
        LazyLock::force(&TONES);
        Self::default()
    }

    /// The cues for this frame. `brightness` is the greatest brightness of the settings.
    pub fn update(&mut self, warnings: &Warnings, wearer: &Wearer, brightness: f32, settings: &CueSettings) -> Cue {
        let now_ns = wearer.time_ns;
        if self.last_ns.is_some_and(|then_ns| now_ns < then_ns) {
            *self = Self::default();
        }
        self.last_ns = Some(now_ns);
        let level = |panel: &Panel| (f64::from(panel.alpha) / f64::from(brightness).max(1e-3)).clamp(0.0, 1.0);
        let mut cue = Cue::default();
        for (hand, part) in [BodyPart::LeftHand, BodyPart::RightHand].into_iter().enumerate() {
            let concerns = |panel: &&Panel| {
                panel.nearest_part == part || matches!(panel.nearest_part, BodyPart::Head | BodyPart::Torso)
            };
            let worst = warnings.panels.iter().filter(concerns).map(level).fold(0.0, f64::max);
            let is_pulsing = self.pulses[hand].update(now_ns, worst, PULSE_INTERVAL_S);
            let ticked_ns = &mut self.ticked_ns[hand];
            let may_tick = ticked_ns.is_none_or(|then_ns| now_ns.saturating_sub(then_ns) >= MIN_TICK_INTERVAL_NS);
            if settings.pulse && is_pulsing.within(now_ns, PULSE_NS) && may_tick {
                *ticked_ns = Some(now_ns);
                cue.ticks_us[hand] =
                    Some((settings.pulse_strength * interpolate(TICK_US, worst)).clamp(0.0, 3999.0) as u16);
            }
        }
        let worst = warnings.panels.iter().max_by(|a, b| a.alpha.total_cmp(&b.alpha).then(b.id.cmp(&a.id)));
        let sounds = self.tones.update(now_ns, worst.map_or(0.0, level), TONES.interval_s);
        if let Some(panel) = worst.filter(|_| settings.sound && sounds == LastStart::Now) {
            let hz = interpolate(TONES.pitch_hz, level(panel)) as f32;
            let volume = settings.volume as f32;
            cue.tone = Some(Tone { pan: pan(panel, wearer), volume, hz, length_s: TONES.length_s as f32 });
        }
        cue
    }
}

/// Sine of the horizontal direction of the nearest point, positive to the right of the head.
fn pan(panel: &Panel, wearer: &Wearer) -> f32 {
    let head = &wearer.tracking_from_head;
    let away = (panel.nearest_m - head.translation) * DVec3::new(1.0, 0.0, 1.0);
    let right = head.transform_vector(DVec3::X);
    let pan = away.normalize_or_zero().dot(right) as f32;
    if pan.is_finite() { pan.clamp(-1.0, 1.0) } else { 0.0 }
}

/// Interpolates from the value at the start level to that at full brightness.
fn interpolate((begin, full): (f64, f64), level: f64) -> f64 {
    begin + (full - begin) * ((level - START_LEVEL) / (1.0 - START_LEVEL)).clamp(0.0, 1.0)
}

/// Last start of a repeating cue.
#[derive(Debug, Clone, Copy, PartialEq)]
enum LastStart {
    Never,
    Now,
    Then(i64),
}

impl LastStart {
    fn within(self, now_ns: i64, length_ns: i64) -> bool {
        match self {
            Self::Never => false,
            Self::Now => true,
            Self::Then(then_ns) => now_ns.saturating_sub(then_ns) < length_ns,
        }
    }
}

/// Repeats a cue while its level is high enough.
#[derive(Debug, Clone, Default)]
struct Repeater {
    /// Start time and level of the current run; it restarts when the level rises by `ESCALATION_LEVEL`.
    on: Option<(i64, f64)>,
    began_ns: Option<i64>,
}

impl Repeater {
    fn update(&mut self, now_ns: i64, level: f64, every_s: (f64, f64)) -> LastStart {
        let since = || self.began_ns.map_or(LastStart::Never, LastStart::Then);
        if level < if self.on.is_some() { STOP_LEVEL } else { START_LEVEL } {
            self.on = None;
            return since();
        }
        let on = self.on.filter(|(_, worst)| level < worst + ESCALATION_LEVEL).unwrap_or((now_ns, level));
        self.on = Some(on);
        let is_tired = now_ns.saturating_sub(on.0) >= THIN_OUT_AFTER_NS;
        let every_s = if is_tired { THINNED_INTERVAL_S } else { interpolate(every_s, level) };
        if self.began_ns.is_some_and(|began_ns| now_ns.saturating_sub(began_ns) < (every_s * 1e9) as i64) {
            return since();
        }
        self.began_ns = Some(now_ns);
        LastStart::Now
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::warning::PanelKind;
    use glam::{DQuat, DVec2};
    use radar_sar::geometry::Pose;

    const FRAME_NS: i64 = 11_111_111;
    const BOTH: CueSettings = CueSettings { sound: true, volume: 0.4, pulse: true, pulse_strength: 1.0 };

    fn warnings(alpha: f64, part: BodyPart) -> Warnings {
        let panel = Panel {
            id: 1,
            kind: PanelKind::Object,
            tracking_from_panel: Pose::IDENTITY,
            size_m: DVec2::ONE,
            silhouette: std::sync::Arc::default(),
            alpha: alpha as f32,
            distance_m: 0.5,
            time_to_contact_s: None,
            nearest_part: part,
            nearest_m: DVec3::new(1.0, 0.4, 0.0),
            label_m: None,
        };
        Warnings { panels: vec![panel], footprints: vec![] }
    }

    /// The cues of ten seconds for a brightness over time.
    fn played(settings: &CueSettings, part: BodyPart, level: impl Fn(f64) -> f64) -> Vec<(f64, Cue)> {
        let mut cues = CueScheduler::new();
        let at = |frame: i64| {
            let time_s = (frame * FRAME_NS) as f64 * 1e-9;
            let wearer = Wearer::head_only(frame * FRAME_NS, Pose::from_translation(DVec3::Y * 1.6));
            (time_s, cues.update(&warnings(level(time_s), part), &wearer, 1.0, settings))
        };
        (0..900).map(at).collect()
    }

    fn tones(played: &[(f64, Cue)]) -> Vec<f64> {
        played.iter().filter(|(_, cue)| cue.tone.is_some()).map(|(time_s, _)| *time_s).collect()
    }

    #[test]
    fn cue_rate_rises_with_brightness() {
        assert!(played(&BOTH, BodyPart::Torso, |_| 0.5).iter().all(|(_, cue)| *cue == Cue::default()));
        let in_3_s =
            |level: f64| tones(&played(&BOTH, BodyPart::Torso, |_| level)).iter().filter(|t| **t < 3.0).count();
        assert_eq!((in_3_s(0.56), in_3_s(1.0)), (4, 10));
    }

    #[test]
    fn cue_start_has_hysteresis() {
        let wavers = |time_s: f64| 0.55 + 0.1 * (40.0 * time_s).sin();
        let all = tones(&played(&BOTH, BodyPart::Torso, wavers));
        assert!(all.windows(2).all(|pair| pair[1] - pair[0] > 0.29), "{all:?}");
    }

    #[test]
    fn lasting_cues_thin_out_until_brightness_rises() {
        let all = tones(&played(&BOTH, BodyPart::Torso, |time_s| if time_s < 8.0 { 0.7 } else { 0.95 }));
        let between = |from: f64, to: f64| all.iter().filter(|t| (from..to).contains(*t)).count();
        assert!(between(0.0, 4.0) >= 4 && between(4.0, 8.0) <= 3 && between(8.0, 10.0) >= 5, "{all:?}");
    }

    #[test]
    fn near_hand_is_pulsed_and_both_hands_for_the_body() {
        let hands = |part| {
            let all = played(&BOTH, part, |_| 1.0);
            [0, 1].map(|hand| all.iter().filter(|(_, cue)| cue.ticks_us[hand].is_some()).count())
        };
        let [left, right] = hands(BodyPart::LeftHand);
        assert!(left > 50 && right == 0);
        let [left, right] = hands(BodyPart::Torso);
        assert!(left > 50 && right == left);
        let quiet = CueSettings { pulse: false, sound: false, ..BOTH };
        assert!(played(&quiet, BodyPart::Torso, |_| 1.0).iter().all(|(_, cue)| *cue == Cue::default()));
    }

    #[test]
    fn ticks_stay_within_controller_limits() {
        let mut cues = CueScheduler::new();
        let mut last_ns = None;
        for millisecond in 0..3000 {
            let wearer = Wearer::head_only(millisecond * 1_000_000, Pose::IDENTITY);
            let cue = cues.update(&warnings(1.0, BodyPart::Head), &wearer, 1.0, &BOTH);
            if let Some(tick_us) = cue.ticks_us[0] {
                assert!((1..4000).contains(&tick_us));
                assert!(last_ns.is_none_or(|then: i64| wearer.time_ns - then >= 5_000_000));
                last_ns = Some(wearer.time_ns);
            }
        }
        assert!(last_ns.is_some());
    }

    #[test]
    fn tone_parameters_are_audible_and_rise_with_brightness() {
        let ToneParameters { length_s, pitch_hz, interval_s } = &*TONES;
        assert!((0.02..=2.0).contains(length_s));
        assert!(pitch_hz.0 > 100.0 && pitch_hz.1 > pitch_hz.0 && pitch_hz.1 < 4000.0, "{pitch_hz:?}");
        assert!(interval_s.1 > *length_s && interval_s.0 > interval_s.1, "{interval_s:?}");
    }

    #[test]
    fn tones_have_pitch_and_length_of_the_parameters() {
        let tone = |level: f64| played(&BOTH, BodyPart::Torso, |_| level)[0].1.tone.unwrap();
        let (soft, loud) = (tone(START_LEVEL + 1e-6), tone(1.0));
        assert!((soft.hz - 440.0).abs() < 1e-2 && soft.length_s == 0.12, "{soft:?}");
        assert!(loud.hz == 660.0 && loud.length_s == 0.12, "{loud:?}");
    }

    #[test]
    fn tones_are_panned_towards_the_obstacle() {
        let pan_of = |turn: f64| {
            let head = Pose::new(DVec3::Y * 1.6, DQuat::from_rotation_y(turn));
            let cue =
                CueScheduler::new().update(&warnings(1.0, BodyPart::Head), &Wearer::head_only(0, head), 1.0, &BOTH);
            cue.tone.unwrap().pan
        };
        assert!((pan_of(0.0) - 1.0).abs() < 1e-6 && (pan_of(std::f64::consts::PI) + 1.0).abs() < 1e-6);
        assert!(pan_of(-std::f64::consts::FRAC_PI_2).abs() < 1e-6, "turned to it");
    }

    #[test]
    fn cues_tolerate_low_brightness_and_backward_clock() {
        let mut cues = CueScheduler::new();
        let mut at = |time_ns: i64, alpha| {
            cues.update(&warnings(alpha, BodyPart::Head), &Wearer::head_only(time_ns, Pose::IDENTITY), 0.5, &BOTH)
        };
        assert!(at(i64::MAX, 0.5).tone.is_some());
        assert!(at(0, 0.5).tone.is_some(), "backwards: it begins anew");
        assert_eq!(at(0, 0.5), Cue::default(), "time stands still");
    }
}
