//! The SteamVR part of `doctor`: installed, running, headset, graphics card, and whether it starts
//! this program.

use anyhow::Result;

use super::findings::Findings;
use crate::app::{correction_text, known_mounts, registration_trouble};
use crate::openvr::{OpenVrError, Registration, Role, Runtime, RuntimePaths, Universe};

/// Checks SteamVR. A computer without SteamVR has nothing to fix: it records and replays.
pub(super) fn check_steamvr(findings: &mut Findings) -> Result<()> {
    let paths = match RuntimePaths::find() {
        Ok(paths) => paths,
        Err(error @ OpenVrError::NotInstalled(_)) => {
            return findings.warn("SteamVR", &format!("{error}; for recording and replay it is not needed"));
        }
        Err(error) => return findings.fix("SteamVR", &error.to_string()),
    };
    findings.ok("SteamVR", &format!("in {}", paths.runtime.display()))?;
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
    findings.ok("Running", &format!("SteamVR {}", runtime.version()))?;
    let timing = runtime.display_timing();
    findings.ok("Headset", &format!("{}, {:.0} frames a second", runtime.headset_name(), timing.frame_hz))?;
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
