//! The SteamVR part of `doctor`: installed, running, headset, graphics card, and whether it starts
//! this program.

use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};

use super::findings::Findings;
use crate::app::{correction_text, known_mounts, own_path, registration_trouble};
use crate::openvr::{OpenVrError, Registration, Role, Runtime, RuntimePaths, Universe};

/// Longest time of the checks. Choice: opening a graphics card takes a second or two; a runtime that hangs must not hang the doctor.
const MAX_CHECK: Duration = Duration::from_secs(30);

/// Checks SteamVR in a process of its own: the runtime's library may end the process in which it is loaded, or hang it.
pub(super) fn check_steamvr_apart(findings: &mut Findings) -> Result<()> {
    let own = match own_path() {
        Ok(own) => own,
        // Without /proc, as in some containers: all else is checked.
        Err(error) => return findings.warn("SteamVR", &format!("not checked: {error:#}")),
    };
    let mut child = Command::new(own)
        .args(["doctor", "--steamvr-in-this-process"])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .spawn()
        .context("cannot start the checks of SteamVR")?;
    let (lines, found) = mpsc::channel();
    if let Some(out) = child.stdout.take() {
        thread::spawn(move || BufReader::new(out).lines().map_while(Result::ok).try_for_each(|line| lines.send(line)));
    }
    let end = Instant::now() + MAX_CHECK;
    let has_ended = loop {
        match found.recv_timeout(end.saturating_duration_since(Instant::now())) {
            Ok(line) => findings.repeat(&line)?,
            Err(RecvTimeoutError::Disconnected) => break true,
            Err(RecvTimeoutError::Timeout) => break false,
        }
    };
    if !has_ended {
        let _ = child.kill();
    }
    let status = child.wait().context("cannot wait for the checks of SteamVR")?;
    match (has_ended, status.success()) {
        (true, true) => Ok(()),
        (true, false) => findings.fix(
            "SteamVR",
            &format!(
                "the VR runtime's library ended the process that had loaded it ({status}): repair or change the runtime"
            ),
        ),
        (false, _) => findings
            .fix("SteamVR", &format!("the VR runtime has not answered for {} s: restart it", MAX_CHECK.as_secs())),
    }
}

/// Checks SteamVR. A computer without SteamVR has nothing to fix: it records and replays.
pub(super) fn check_steamvr(findings: &mut Findings) -> Result<()> {
    let paths = match RuntimePaths::find() {
        Ok(paths) => paths,
        Err(error @ OpenVrError::NotInstalled(_)) => {
            return findings.warn("SteamVR", &format!("{error}; for recording and replay it is not needed"));
        }
        Err(error) => return findings.fix("SteamVR", &error.to_string()),
    };
    match paths.is_steamvr() {
        true => findings.ok("SteamVR", &format!("in {}", paths.runtime.display()))?,
        false => findings.warn(
            "SteamVR",
            &format!(
                "{} is not SteamVR: this program was made for SteamVR, and others may refuse it",
                paths.runtime.display()
            ),
        )?,
    }
    check_registration(findings, &paths)?;
    match Runtime::start(&paths, Role::Background) {
        Ok(runtime) => check_running(findings, &runtime),
        Err(error @ OpenVrError::NotRunning) => findings.warn("Running", &error.to_string()),
        Err(error) => findings.fix("Running", &error.to_string()),
    }
}

fn check_registration(findings: &mut Findings, paths: &RuntimePaths) -> Result<()> {
    let registration = match Runtime::start(paths, Role::Utility) {
        Ok(runtime) => runtime.registration(),
        Err(error) => {
            return findings
                .warn("Manifest", &format!("SteamVR does not report whether it starts this program: {error}"));
        }
    };
    match (&registration, registration_trouble(&registration)) {
        (_, Some(trouble)) => findings.fix("Manifest", &trouble),
        (Registration { is_registered: false, .. }, _) => {
            findings.warn("Manifest", "SteamVR does not know this program: `radar-chaperone install` has it started with the headset")
        }
        (Registration { autolaunch: true, .. }, _) => findings.ok("Manifest", "SteamVR starts this program with the headset"),
        (Registration { .. }, _) => findings.warn(
            "Manifest",
            "SteamVR knows this program and does not start it: switch it on under Settings, Startup / Shutdown, Choose Startup \
             Overlay Apps",
        ),
    }
}

fn check_running(findings: &mut Findings, runtime: &Runtime) -> Result<()> {
    findings.ok("Running", &runtime.name_and_version())?;
    let timing = runtime.display_timing();
    findings.ok("Headset", &format!("{}, {:.0} frames a second", runtime.headset_name(), timing.frame_hz))?;
    if runtime.universe_id().is_none() {
        findings.warn("Room", "the VR runtime has no ids of rooms: no map is kept from one session to the next")?;
    }
    check_mount(findings, &runtime.headset_name())?;
    let poses = runtime.poses(Universe::Standing, 0.0, runtime.hands());
    match poses.head.valid_pose() {
        Some(head) => {
            let [x, y, z] = head.translation.to_array();
            findings.ok("Tracking", &format!("the head is at {x:.2}, {y:.2}, {z:.2} m"))?;
        }
        None => findings
            .warn("Tracking", "the headset is not tracked: is it switched on, and seen by its base stations?")?,
    }
    let hands = poses.hands.iter().filter(|hand| hand.valid_pose().is_some()).count();
    findings.ok("Controllers", &format!("{hands} tracked"))?;
    check_chaperone(findings, runtime)?;
    match runtime.open_device() {
        Ok(device) => findings.ok("Graphics", &format!("{}, as SteamVR wants it", device.name)),
        Err(error) => findings.fix("Graphics", &error.to_string()),
    }
}

/// Where the last session found the sensor on this headset.
fn check_mount(findings: &Findings, headset: &str) -> Result<()> {
    let known = match known_mounts() {
        Ok(mut known) => known.remove(headset),
        Err(error) => return findings.warn("Mount", &format!("{error:#}: the next session writes it anew")),
    };
    let Some(mount) = known else {
        return findings
            .ok("Mount", "not known from a session yet: `run` finds where the sensor is as you look around");
    };
    let [x, y, z] = mount.in_use.translation.to_array();
    let correction = correction_text(&mount);
    let place = format!("sensor at ({x:.3}, {y:.3}, {z:.3}) m on the head, {correction} from where it is set");
    match mount.is_contradicted() {
        false => findings.ok("Mount", &place),
        true if mount.pose_mistake().is_some() => {
            findings.warn("Mount", &format!("{place}; the poses did not fit the echoes: `calibrate` shows more"))
        }
        true => findings.warn("Mount", &format!("{place}, which the data contradict: `calibrate` shows more")),
    }
}

fn check_chaperone(findings: &mut Findings, runtime: &Runtime) -> Result<()> {
    let chaperone = runtime.chaperone();
    let area = match chaperone.play_area_m {
        Some([x, z]) => format!("play area {x:.1} by {z:.1} m"),
        None => "no play area is set up: obstacles are warned of wherever they are".to_owned(),
    };
    let fade = chaperone.fade_distance_m.map_or(String::new(), |m| format!(", fades in at {m:.1} m"));
    findings.ok("Chaperone", &format!("{area}{fade}"))
}
