//! Summary of a recording, as printed by `radar-chaperone info FILE`.

use radar_mapping::Event;
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

use super::{Damage, Header, Recording, RecordingError};
use a121::{Frame, Subsweep, frame_timing};
use radar_mapping::HandsSample;
use radar_mapping::range_axis;
use radar_sar::geometry::Pose;
use radar_sar::{BoundedSettings, HistorySettings, PoseSample};

/// An interval longer than this many median intervals is a gap. Choice: one missing entry and late
/// neighbours are no gap, two missing ones are.
const GAP_FACTOR: f64 = 2.5;
/// Share of the poses' intervals above the limit from which on the poses are too sparse, rather than
/// interrupted. Choice: interruptions are fewer, and of poses at the limit's rate with jitter half are
/// above it.
const MIN_SPARSE_SHARE: f64 = 0.25;

/// Summary of a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordingSummary {
    /// The header.
    pub header: Header,
    /// Times of the frames.
    pub frames: StreamSummary,
    /// Frames with samples at the limit of the converter; not used.
    pub frames_saturated: u64,
    /// Frames that the sensor marked as late.
    pub frames_delayed: u64,
    /// Frames whose length differs from the configuration; not used.
    pub frames_wrong_length: u64,
    /// Times of the poses, valid or not.
    pub poses: StreamSummary,
    /// Poses that are invalid, not fully tracked, or have invalid numbers; not used.
    pub poses_invalid: u64,
    /// Times of the hands.
    pub hands: StreamSummary,
    /// How many of these have the left and the right hand tracked.
    pub hands_tracked: [u64; 2],
    /// Snapshots of results.
    pub scenes: u64,
    /// What could not be read.
    pub damage: Damage,
}

/// Times of one stream.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct StreamSummary {
    /// Number of entries.
    pub count: u64,
    /// Earliest time, host nanoseconds.
    pub first_ns: Option<i64>,
    /// Latest time, host nanoseconds.
    pub last_ns: Option<i64>,
    /// Entries that are not later than the one before.
    pub not_rising: u64,
    previous_ns: Option<i64>,
    intervals: Intervals,
}

/// Positive intervals, in groups that differ by a thousandth: a file may claim any number of them.
#[derive(Debug, Clone, Default, PartialEq)]
struct Intervals {
    /// Number and sum, nanoseconds, by the interval with its lower bits cleared.
    groups: BTreeMap<i64, (u64, i128)>,
    longest_ns: i64,
}

/// Leading bits by which intervals are grouped. Choice: at most 56 000 groups; the medians printed have four digits.
const GROUP_BITS: u32 = 11;

impl Intervals {
    fn push(&mut self, interval_ns: i64) {
        let low_bits = (i64::BITS - interval_ns.leading_zeros()).saturating_sub(GROUP_BITS);
        let (count, sum_ns) = self.groups.entry(interval_ns >> low_bits << low_bits).or_default();
        (*count, *sum_ns) = (*count + 1, *sum_ns + i128::from(interval_ns));
        self.longest_ns = self.longest_ns.max(interval_ns);
    }

    /// Number and mean of each group, seconds, rising.
    fn groups(&self) -> impl Iterator<Item = (u64, f64)> {
        self.groups.values().map(|(count, sum_ns)| (*count, *sum_ns as f64 * 1e-9 / *count as f64))
    }

    fn count(&self) -> u64 {
        self.groups().map(|(count, _)| count).sum()
    }
}

impl StreamSummary {
    fn push(&mut self, time_ns: i64) {
        self.count += 1;
        self.first_ns = Some(self.first_ns.map_or(time_ns, |t| t.min(time_ns)));
        self.last_ns = Some(self.last_ns.map_or(time_ns, |t| t.max(time_ns)));
        match self.previous_ns.replace(time_ns) {
            Some(before_ns) if time_ns <= before_ns => self.not_rising += 1,
            Some(before_ns) => self.intervals.push(time_ns.saturating_sub(before_ns)),
            None => {}
        }
    }

    /// From the first to the last entry, seconds.
    pub fn duration_s(&self) -> f64 {
        match (self.first_ns, self.last_ns) {
            (Some(first), Some(last)) => last.saturating_sub(first) as f64 * 1e-9,
            _ => 0.0,
        }
    }

    /// Median interval, seconds, within a thousandth.
    pub fn median_interval_s(&self) -> Option<f64> {
        let mut before = 0;
        let middle = self.intervals.count() / 2;
        self.intervals.groups().find_map(|(count, mean_s)| {
            before += count;
            (before > middle).then_some(mean_s)
        })
    }

    /// Entries per second outside gaps.
    pub fn rate_hz(&self) -> Option<f64> {
        let border_s = self.gap_threshold_s(0.0);
        let usual = self.intervals.groups().filter(|(_, mean_s)| *mean_s <= border_s);
        let (count, sum_s) =
            usual.fold((0, 0.0), |(all, sum_s), (count, mean_s)| (all + count, sum_s + count as f64 * mean_s));
        (sum_s > 0.0).then(|| count as f64 / sum_s)
    }

    /// Shortest interval that counts as a gap, seconds.
    fn gap_threshold_s(&self, least_s: f64) -> f64 {
        self.median_interval_s().map_or(least_s, |usual_s| least_s.max(GAP_FACTOR * usual_s))
    }

    /// Number of intervals longer than this, seconds.
    fn intervals_above(&self, limit_s: f64) -> u64 {
        self.intervals.groups().filter(|(_, mean_s)| *mean_s > limit_s).map(|(count, _)| count).sum()
    }

    /// Number of gaps, and the longest one in seconds: intervals above `least_s` and 2.5 times the
    /// median.
    pub fn gaps(&self, least_s: f64) -> (u64, f64) {
        let count = self.intervals_above(self.gap_threshold_s(least_s));
        (count, if count > 0 { self.intervals.longest_ns as f64 * 1e-9 } else { 0.0 })
    }
}

/// Poses that come too rarely to be joined: sweeps between them have none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SparsePoses {
    /// Median interval of the poses, seconds.
    pub interval_s: f64,
    /// Longest interval across which they are joined, the setting `tracking.history.max_gap_s`.
    pub max_gap_s: f64,
}

impl SparsePoses {
    /// What happened and what to do.
    pub fn remedy(&self) -> String {
        let Self { interval_s, max_gap_s } = *self;
        // One pose may be missing, or late by half an interval.
        let (rate_hz, gap_s) = ((2.0 / max_gap_s).ceil(), (interval_s * 150.0 - 1e-6).ceil() / 100.0);
        let mut text = format!("{self}. Record the poses at {rate_hz} Hz or more");
        if gap_s <= max_gap_limit_s() {
            text += &format!(", or have them joined, less exactly, with --set tracking.history.max_gap_s={gap_s}");
        }
        text + "."
    }
}

impl fmt::Display for SparsePoses {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { interval_s, max_gap_s } = self;
        write!(
            f,
            "poses come at {:.1} Hz (median spacing {:.0} ms), tracking.history.max_gap_s joins those within {:.0} ms",
            1.0 / interval_s,
            interval_s * 1e3,
            max_gap_s * 1e3
        )
    }
}

/// Upper bound of the setting.
fn max_gap_limit_s() -> f64 {
    HistorySettings::BOUNDS.iter().find(|bound| bound.name == "max_gap_s").map_or(0.0, |bound| bound.max)
}

impl RecordingSummary {
    /// An empty summary.
    pub fn new(header: Header) -> Self {
        Self {
            header,
            frames: StreamSummary::default(),
            frames_saturated: 0,
            frames_delayed: 0,
            frames_wrong_length: 0,
            poses: StreamSummary::default(),
            poses_invalid: 0,
            hands: StreamSummary::default(),
            hands_tracked: [0; 2],
            scenes: 0,
            damage: Damage::default(),
        }
    }

    /// Reads a whole recording, one chunk at a time.
    ///
    /// # Errors
    /// The recording cannot be opened; later damage is part of the summary.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, RecordingError> {
        let mut recording = Recording::open(path)?;
        let mut summary = Self::new(recording.header().clone());
        for event in &mut recording {
            summary.push(&event);
        }
        summary.damage = recording.damage().clone();
        Ok(summary)
    }

    /// Counts an event.
    pub fn push(&mut self, event: &Event) {
        match event {
            Event::Frame(frame) => self.push_frame(frame),
            Event::Pose(pose) => self.push_pose(pose),
            Event::Hands(hands) => self.push_hands(hands),
        }
    }

    /// Counts a frame.
    pub fn push_frame(&mut self, frame: &Frame) {
        self.frames.push(frame.host_time_ns);
        self.frames_saturated += u64::from(frame.data_saturated);
        self.frames_delayed += u64::from(frame.frame_delayed);
        self.frames_wrong_length += u64::from(frame.samples.len() != self.header.config.points_per_frame());
    }

    /// Counts a pose.
    pub fn push_pose(&mut self, pose: &PoseSample) {
        self.poses.push(pose.time_ns);
        self.poses_invalid += u64::from(pose.tracking_from_head().is_err());
    }

    /// Counts hands.
    pub fn push_hands(&mut self, hands: &HandsSample) {
        self.hands.push(hands.time_ns);
        for (count, position_m) in self.hands_tracked.iter_mut().zip(hands.hands_m) {
            *count += u64::from(position_m.is_some_and(|position_m| position_m.is_finite()));
        }
    }

    /// Whether a good part of the poses are farther apart than `max_gap_s`.
    pub fn sparse_poses(&self, max_gap_s: f64) -> Option<SparsePoses> {
        let interval_s = self.poses.median_interval_s()?;
        let (above, all) = (self.poses.intervals_above(max_gap_s), self.poses.intervals.count());
        (above as f64 >= MIN_SPARSE_SHARE * all as f64).then_some(SparsePoses { interval_s, max_gap_s })
    }

    /// From the first to the last frame or pose, seconds.
    pub fn duration_s(&self) -> f64 {
        let both = [&self.frames, &self.poses];
        let first = both.iter().filter_map(|s| s.first_ns).min();
        let last = both.iter().filter_map(|s| s.last_ns).max();
        StreamSummary { first_ns: first, last_ns: last, ..Default::default() }.duration_s()
    }
}

impl fmt::Display for RecordingSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let line = |f: &mut fmt::Formatter<'_>, name: &str, text: String| writeln!(f, "{name:<10} {text}");
        line(f, "Source", self.header.source.clone())?;
        line(f, "Duration", format!("{:.2} s", self.duration_s()))?;
        line(f, "Board", board(&self.header))?;
        line(f, "Frames", self.frames_text())?;
        line(f, "Sensor", timing_text(&self.header))?;
        for (index, subsweep) in self.header.config.subsweeps.iter().enumerate() {
            line(f, if index == 0 { "Subsweeps" } else { "" }, subsweep_text(subsweep))?;
        }
        line(f, "Poses", self.poses_text())?;
        if self.hands.count > 0 {
            let [left, right] = self.hands_tracked;
            line(f, "Hands", format!("{} times, left tracked in {left}, right in {right}", self.hands.count))?;
        }
        line(f, "Mount", mount_text(&self.header.head_from_sensor))?;
        if self.scenes > 0 {
            line(f, "Results", format!("{} scenes", self.scenes))?;
        }
        let settings = if self.header.settings.is_empty() { "none recorded" } else { "recorded" };
        line(f, "Settings", settings.into())?;
        line(f, "Truth", truth_text(&self.header))?;
        write!(f, "{:<10} {}", "Damage", self.damage)
    }
}

impl RecordingSummary {
    fn frames_text(&self) -> String {
        if self.frames.count == 0 {
            return "none: nothing can be seen with this recording".into();
        }
        let mut parts = vec![stream_text(&self.frames, 0.0)];
        let counted = [
            (self.frames_saturated, "saturated"),
            (self.frames_delayed, "late"),
            (self.frames_wrong_length, "of wrong length"),
        ];
        parts.extend(counted.iter().filter(|c| c.0 > 0).map(|(count, what)| format!("{count} {what}")));
        parts.join(", ")
    }

    fn poses_text(&self) -> String {
        if self.poses.count == 0 {
            return "none: ranges can be read, positions cannot".into();
        }
        let invalid =
            if self.poses_invalid == 0 { "all valid".into() } else { format!("{} invalid", self.poses_invalid) };
        let max_gap_s = HistorySettings::default().max_gap_s;
        let mut text = format!("{}, {invalid}", stream_text(&self.poses, max_gap_s));
        if self.sparse_poses(max_gap_s).is_some() {
            text += &format!(", TOO FAR APART (imaging joins those within {:.0} ms)", max_gap_s * 1e3);
        }
        text
    }
}

fn stream_text(stream: &StreamSummary, least_gap_s: f64) -> String {
    let mut parts = vec![format!("{} over {:.2} s", stream.count, stream.duration_s())];
    parts.extend(stream.rate_hz().map(|rate| format!("{rate:.1} a second")));
    let (gaps, longest_s) = stream.gaps(least_gap_s);
    parts.push(match gaps {
        0 => "no gaps".into(),
        _ => format!("{gaps} gaps (longest {longest_s:.3} s)"),
    });
    if stream.not_rising > 0 {
        parts.push(format!("{} not later than the one before", stream.not_rising));
    }
    parts.join(", ")
}

fn board(header: &Header) -> String {
    let sensor = &header.sensor;
    let mut parts = vec![sensor.board.clone().unwrap_or_else(|| "unknown".into())];
    parts.extend(sensor.rss_version.as_ref().map(|version| format!("software {version}")));
    parts.extend(sensor.ticks_per_second.map(|ticks| format!("{ticks} ticks a second")));
    parts.join(", ")
}

fn timing_text(header: &Header) -> String {
    let timing = frame_timing(&header.config);
    format!(
        "{} sweeps a frame, {} points a sweep; predicted: {:.1} sweeps a second inside a frame, {:.1} frames a second at most",
        header.config.sweeps_per_frame,
        header.config.points_per_sweep(),
        1.0 / timing.sweep_period_s,
        1.0 / timing.frame_period_s
    )
}

fn subsweep_text(subsweep: &Subsweep) -> String {
    let axis = range_axis(subsweep);
    format!(
        "{:.2} to {:.2} m in steps of {:.1} mm ({} points), profile {} (pulse {:.0} mm), HWAAS {}, gain {}, PRF {:.1} MHz{}",
        axis.first_m,
        axis.last_m(),
        axis.step_m * 1e3,
        axis.points,
        u8::from(subsweep.profile),
        subsweep.profile.envelope_fwhm_m() * 1e3,
        subsweep.hwaas,
        subsweep.receiver_gain,
        subsweep.prf.hz() / 1e6,
        match (subsweep.hears_echoes(), subsweep.phase_enhancement) {
            (false, _) if subsweep.enable_loopback => ", loopback: hears no echoes",
            (false, _) => ", transmitter off: hears no echoes",
            (true, false) => ", phase enhancement OFF (imaging needs it)",
            (true, true) => "",
        }
    )
}

fn mount_text(head_from_sensor: &Pose) -> String {
    if *head_from_sensor == Pose::IDENTITY {
        return "the poses are the sensor's own".into();
    }
    let [x, y, z] = head_from_sensor.translation.to_array();
    let ahead = -z;
    let [fx, fy, fz] = head_from_sensor.forward().to_array();
    format!(
        "sensor {x:+.3} m right, {y:+.3} m up, {ahead:+.3} m ahead of the head's origin, looking along ({fx:.2}, {fy:.2}, {fz:.2})"
    )
}

fn truth_text(header: &Header) -> String {
    let Some(truth) = &header.truth else { return "not known".into() };
    let names: Vec<&str> = truth.obstacles.iter().map(|o| o.name.as_str()).collect();
    let obstacles = if names.is_empty() { "no obstacles".into() } else { names.join(", ") };
    format!("{}; {obstacles}; {} walls; time offset {:+.4} s", truth.title, truth.walls.len(), truth.time_offset_s)
}

#[cfg(test)]
mod tests {
    use super::super::test_files::{TestFile, events, header, recorded};
    use super::*;

    #[test]
    fn summary_text_is_as_expected() {
        let mut written = events(4);
        // One second without poses, and a pose whose time runs backwards.
        written.retain(|e| !matches!(e, Event::Pose(p) if (1_000_000_000..2_000_000_000).contains(&p.time_ns)));
        let last = written.iter().rposition(|e| matches!(e, Event::Pose(_))).unwrap();
        if let Event::Pose(pose) = &mut written[last] {
            pose.time_ns -= 2_000_000_000;
        }
        let file = TestFile::with(&recorded(&written));
        let text = RecordingSummary::read(&file.0).unwrap().to_string();
        let expected = "\
Source     test room, seed 1
Duration   3.95 s
Board      simulated, 1000000 ticks a second
Frames     80 over 3.95 s, 20.0 a second, no gaps, 4 saturated, 6 late
Sensor     1 sweeps a frame, 50 points a sweep; predicted: 1126.2 sweeps a second inside a frame, 500.0 frames a second at most
Subsweeps  0.20 to 3.14 m in steps of 60.1 mm (50 points), profile 3 (pulse 140 mm), HWAAS 16, gain 16, PRF 15.6 MHz
Poses      120 over 3.95 s, 40.0 a second, 1 gaps (longest 1.025 s), 1 not later than the one before, 6 invalid
Mount      sensor +0.000 m right, +0.031 m up, +0.100 m ahead of the head's origin, looking along (0.00, -0.20, -0.98)
Settings   recorded
Truth      two posts; post; 0 walls; time offset +0.0100 s
Damage     none";
        assert_eq!(text, expected);
    }

    fn with_pose_intervals(intervals_ms: &[i64]) -> RecordingSummary {
        let mut summary = RecordingSummary::new(header());
        let mut time_ns = 0;
        for interval_ms in [0].iter().chain(intervals_ms) {
            time_ns += interval_ms * 1_000_000;
            summary.push_pose(&PoseSample::valid(time_ns, &Pose::IDENTITY));
        }
        summary
    }

    #[test]
    fn poses_too_sparse_for_the_settings_are_reported_with_the_remedy() {
        let sparse = with_pose_intervals(&[100; 50]);
        let remedy = sparse.sparse_poses(0.05).unwrap().remedy();
        assert_eq!(
            remedy,
            "poses come at 10.0 Hz (median spacing 100 ms), tracking.history.max_gap_s joins those within 50 ms. Record the \
             poses at 40 Hz or more, or have them joined, less exactly, with --set tracking.history.max_gap_s=0.15."
        );
        assert!(
            sparse
                .to_string()
                .contains("10.0 a second, no gaps, all valid, TOO FAR APART (imaging joins those within 50 ms)")
        );
        assert_eq!(sparse.sparse_poses(0.15), None);
        // Beyond what may be set.
        let remedy = with_pose_intervals(&[1000; 5]).sparse_poses(0.05).unwrap().remedy();
        assert!(remedy.contains("1.0 Hz") && !remedy.contains("--set"), "{remedy}");
        // At the limit's rate with jitter; interrupted; without an interval.
        assert!(with_pose_intervals(&[48, 52, 49, 51]).sparse_poses(0.05).is_some());
        assert_eq!(with_pose_intervals(&[10, 10, 10, 10, 10, 10, 10, 900]).sparse_poses(0.05), None);
        assert_eq!(with_pose_intervals(&[]).sparse_poses(0.05), None);
    }

    #[test]
    fn empty_recording_is_reported_as_empty() {
        let text = RecordingSummary::new(header()).to_string();
        assert!(text.contains("Frames     none") && text.contains("Poses      none"), "{text}");
    }
}
