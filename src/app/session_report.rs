//! Report of a session with SteamVR, as text and as JSON.

use std::path::Path;

use anyhow::{Context, Result};
use serde_json::{Value, json};

use radar_mapping::{CalibrationInUse, MountInUse};
use radar_recording::{Existing, Readers, read_small_text, write_whole_through_links};

use super::{
    Ending, HeadsetReport, HeadsetStatus, LatencyReport, Reconstruction, ReconstructionCounters, WarningOutput,
    correction_text,
};

/// Results of a session.
pub struct SessionReport {
    ending: Ending,
    headset: HeadsetStatus,
    reconstruction: Option<ReconstructionCounters>,
    obstacles: usize,
    calibration: Option<CalibrationInUse>,
}

impl SessionReport {
    pub fn new(done: &HeadsetReport, reconstruction: Option<&Reconstruction>) -> Self {
        let newest = reconstruction.map(Reconstruction::latest);
        Self {
            ending: done.ending,
            headset: done.status,
            reconstruction: reconstruction.map(Reconstruction::counters),
            obstacles: newest.as_ref().map_or(0, |newest| newest.scene.obstacles.len()),
            calibration: newest.and_then(|newest| newest.calibration.clone()),
        }
    }

    /// 1σ of the time offset, where the motion made it observable, seconds.
    fn offset_sigma_s(&self) -> Option<f64> {
        Some(self.calibration.as_ref()?.observed_time_offset()?.sigma_s)
    }

    pub fn write(&self, path: &Path) -> Result<()> {
        let HeadsetStatus { frames, .. } = self.headset;
        let reconstruction = self.reconstruction.map(|counters| {
            json!({
                "worked_off": latency(&counters.processed),
                "evidence_age": latency(&counters.evidence_age),
                "step": latency(&counters.step),
                "cpu_s": counters.cpu_s,
                "running_s": counters.running_s,
                "frames_dropped": counters.frames_dropped,
                "poses_dropped": counters.poses_dropped,
                "outdated": counters.outdated,
                "epoch": counters.epoch,
                "counters": counters.mapper,
            })
        });
        let calibration = self.calibration.as_ref();
        let report = json!({
            "ending": format!("{:?}", self.ending),
            "frames": frames.frames,
            "frames_missed_by_us": frames.missed_by_loop,
            "frames_missed_for_a_core": frames.missed_waiting_for_core,
            "frames_missed_elsewhere": frames.missed_elsewhere,
            "frame_cpu": latency(&frames.cpu),
            "frame_wall": latency(&frames.wall),
            "sweep_to_warning": latency(&frames.sweep_to_warning),
            "pictures": self.headset.pictures,
            "most_picture_bytes": self.headset.most_picture_bytes,
            "recentred": self.headset.recentred,
            "forgotten": self.headset.forgotten,
            "devices_lost": self.headset.devices_lost,
            "warnings_by": match self.headset.output {
                WarningOutput::AsSet => "display mode of the settings",
                WarningOutput::PanelsInstead => "panels",
                WarningOutput::CuesAlone => "cues",
            },
            "calls_refused": self.headset.refused,
            "poses_untimed": self.headset.poses_untimed,
            "obstacles": self.obstacles,
            "time_offset_s": calibration.map_or(0.0, |calibration| calibration.time_offset_s),
            "time_offset_sigma_s": self.offset_sigma_s(),
            "mount": calibration.map(|calibration| calibration.mount),
            "drift_m": calibration.and_then(|calibration| calibration.drift_m),
            "range_bias_m": calibration.and_then(|calibration| calibration.range_bias_m.as_deref()),
            "reconstruction": reconstruction,
        });
        let existing = if is_session_report(path) { Existing::Replace } else { Existing::Keep };
        write_whole_through_links(path, format!("{report:#}\n").as_bytes(), Readers::Usual, existing)
            .with_context(|| format!("cannot write {}", path.display()))
    }
}

/// Whether the file is the report of an earlier session, which the next one replaces.
pub fn is_session_report(path: &Path) -> bool {
    let text = read_small_text(path).unwrap_or_default();
    let report: Value = serde_json::from_str(&text).unwrap_or_default();
    ["ending", "frames_missed_by_us", "sweep_to_warning"].iter().all(|key| report.get(key).is_some())
}

fn latency(report: &LatencyReport) -> Value {
    json!({
        "count": report.count,
        "median_s": report.median_s,
        "p99_s": report.p99_s,
        "p999_s": report.p999_s,
        "max_s": report.max_s,
    })
}

/// Prints the report.
pub fn print_report(report: &SessionReport) -> Result<()> {
    let HeadsetStatus { frames, pictures, recentred, forgotten: map_resets, devices_lost, refused, output, .. } =
        report.headset;
    let ms = |seconds: f64| seconds * 1e3;
    outln!(
        "Frames    {} seen, {} missed by this program, {} waiting for a free core, {} elsewhere; {:.2} ms of processor each (p99.9 {:.2}, max {:.2})",
        frames.frames,
        frames.missed_by_loop,
        frames.missed_waiting_for_core,
        frames.missed_elsewhere,
        ms(frames.cpu.median_s),
        ms(frames.cpu.p999_s),
        ms(frames.cpu.max_s)
    )?;
    let age = frames.sweep_to_warning;
    if age.count > 0 {
        let (median, p99, max) = (ms(age.median_s), ms(age.p99_s), ms(age.max_s));
        outln!("Sweeps    {median:.1} ms from sweep to warning (p99 {p99:.1}, max {max:.1})")?;
    }
    if let Some(counters) = &report.reconstruction {
        let share = 100.0 * counters.cpu_s / counters.running_s.max(1e-3);
        let dropped = counters.frames_dropped + counters.poses_dropped;
        outln!("Imaging   {} obstacles, {share:.1} % of a core, {dropped} frames and poses dropped", report.obstacles)?;
        if let Some(reason) = counters.mapper.engine.no_subaperture() {
            outln!("Imaging   {reason}")?;
        }
        let jumps = counters.mapper.streams.tracking_jumps;
        if jumps > 0 {
            outln!("Tracking  {jumps} jumps; the map did not jump")?;
        }
    }
    if let Some((calibration, sigma_s)) = report.calibration.as_ref().zip(report.offset_sigma_s()) {
        outln!("Time      offset {:.1} ± {:.1} ms in use", ms(calibration.time_offset_s), ms(sigma_s))?;
    }
    let mount = report.calibration.as_ref().map(|calibration| calibration.mount);
    if let Some(mount) = mount.filter(MountInUse::is_corrected) {
        let [x, y, z] = mount.in_use.translation.to_array();
        let correction = correction_text(&mount);
        outln!("Mount     sensor at ({x:.3}, {y:.3}, {z:.3}) m on the head, corrected by {correction}")?;
    }
    outln!(
        "Overlays  {pictures} pictures handed over; recentred {recentred} times, map reset {map_resets}, graphics device \
         lost {devices_lost}, calls refused {refused}"
    )?;
    match output {
        WarningOutput::AsSet => Ok(()),
        WarningOutput::PanelsInstead => outln!("Display   refused by the VR runtime: panels were shown instead"),
        WarningOutput::CuesAlone => {
            outln!("Display   warnings were refused by the VR runtime: tones and pulses warned")
        }
    }
}
