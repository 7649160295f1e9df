//! Decides when the runtime refuses a display for good, and what serves instead: panels for the
//! other display modes, cues for panels. Refused warnings must not look like a room without
//! obstacles.

use crate::warning::CueSettings;

/// A display that has been refused for this time without a success is given up, nanoseconds.
/// Choice: a runtime that is busy refuses single calls; a walker at 1.2 m/s covers 0.6 m in it, less
/// than half of the default fade distance.
const MAX_REFUSING_NS: i64 = 500_000_000;
/// Least volume of the tones that replace warnings, 0 to 1. Choice: the default of the cues.
const MIN_VOLUME: f64 = 0.4;

/// How the wearer is warned.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum WarningOutput {
    /// By the display mode of the settings.
    #[default]
    AsSet,
    /// By panels: the runtime refuses the display mode of the settings.
    PanelsInstead,
    /// By tones and pulses alone: the runtime refuses panels too.
    CuesAlone,
}

/// What to do after a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum DisplayChange {
    None,
    /// Switch to panels.
    ToPanels,
    /// No display is left.
    ToCues,
    /// Panels are accepted again.
    ToDisplay,
}

/// Follows the outcomes of frames that have something to show.
#[derive(Debug, Default)]
pub(super) struct DisplayMonitor {
    refusing_since_ns: Option<i64>,
    output: WarningOutput,
    /// The output before panels were refused.
    before_cues: WarningOutput,
}

impl DisplayMonitor {
    pub fn output(&self) -> WarningOutput {
        self.output
    }

    /// `is_as_set`: the runtime has accepted the display mode of the settings.
    pub fn new(is_as_set: bool) -> Self {
        let output = if is_as_set { WarningOutput::AsSet } else { WarningOutput::PanelsInstead };
        Self { output, ..Self::default() }
    }

    /// Takes the outcome of a frame in which warnings were to be shown. `is_panels`: panels are the
    /// display mode in use.
    pub fn frame(&mut self, now_ns: i64, is_refused: bool, is_panels: bool) -> DisplayChange {
        if !is_refused {
            self.refusing_since_ns = None;
            if self.output == WarningOutput::CuesAlone {
                self.output = self.before_cues;
                return DisplayChange::ToDisplay;
            }
            return DisplayChange::None;
        }
        let since_ns = *self.refusing_since_ns.get_or_insert(now_ns);
        if now_ns.saturating_sub(since_ns) < MAX_REFUSING_NS || self.output == WarningOutput::CuesAlone {
            return DisplayChange::None;
        }
        self.refusing_since_ns = None;
        if is_panels {
            (self.before_cues, self.output) = (self.output, WarningOutput::CuesAlone);
            return DisplayChange::ToCues;
        }
        self.output = WarningOutput::PanelsInstead;
        DisplayChange::ToPanels
    }

    /// The settings of the cues, turned up where they alone warn.
    pub fn cues(&self, set: &CueSettings) -> CueSettings {
        match self.output {
            WarningOutput::CuesAlone => {
                CueSettings { sound: true, volume: set.volume.max(MIN_VOLUME), pulse: true, ..*set }
            }
            _ => *set,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    #[test]
    fn lasting_refusal_falls_back_to_panels_and_then_to_cues() {
        let mut monitor = DisplayMonitor::default();
        assert_eq!(monitor.frame(0, true, false), DisplayChange::None);
        assert_eq!(monitor.frame(499 * MS, true, false), DisplayChange::None);
        assert_eq!(monitor.frame(500 * MS, true, false), DisplayChange::ToPanels);
        assert_eq!(monitor.output(), WarningOutput::PanelsInstead);
        assert_eq!(monitor.frame(510 * MS, true, true), DisplayChange::None, "panels get their own time");
        assert_eq!(monitor.frame(1010 * MS, true, true), DisplayChange::ToCues);
        let quiet = CueSettings { sound: false, volume: 0.0, pulse: false, ..CueSettings::default() };
        let cues = monitor.cues(&quiet);
        assert!(cues.sound && cues.pulse && cues.volume >= 0.4);
        assert_eq!(monitor.frame(9000 * MS, true, true), DisplayChange::None, "once");
        assert_eq!(monitor.frame(9010 * MS, false, true), DisplayChange::ToDisplay);
        assert_eq!((monitor.cues(&quiet), monitor.output()), (quiet, WarningOutput::PanelsInstead));
    }

    #[test]
    fn single_refusals_change_nothing() {
        let mut monitor = DisplayMonitor::default();
        let changes = (0..1000).map(|frame| monitor.frame(frame * 11 * MS, frame % 2 == 0, false));
        assert!(changes.into_iter().all(|change| change == DisplayChange::None));
        assert_eq!(monitor.output(), WarningOutput::AsSet);
    }
}
