//! `calibrate`: known offsets are estimated, a lag at the start is detected, unobservable offsets
//! are reported as such.

use a121::preset;
use radar_mapping::MappingSettings;
use radar_mapping::{Synchronisation, SynchronisationError, synchronisation};
use radar_simulation::{Scenario, Simulated};

use crate::common::Folder;

fn trial(motion: &str, offset_s: f64, seed: u64) -> (Scenario, Simulated) {
    let mut scenario = Scenario::new("corner-reflector", motion, preset("fine").unwrap(), 10.0, seed);
    scenario.time_offset_s = offset_s;
    scenario.snr_db = Some(20.0);
    let simulated = scenario.run().unwrap();
    (scenario, simulated)
}

fn estimated(scenario: &Scenario, simulated: &Simulated) -> Result<Synchronisation, SynchronisationError> {
    let Simulated { frames, poses, .. } = simulated;
    synchronisation(&scenario.config, &scenario.head_from_sensor, &MappingSettings::default(), frames, poses)
}

#[test]
fn known_offsets_are_estimated_by_both_methods() {
    for (offset_s, seed) in [(-0.02, 1), (0.0, 2), (0.035, 3)] {
        let (scenario, simulated) = trial("to-and-fro", offset_s, seed);
        let estimate = estimated(&scenario, &simulated).unwrap();
        let whole = estimate.whole.estimate.unwrap();
        assert!(whole.observable && (whole.offset_s - offset_s).abs() < 0.7e-3, "{offset_s}: {whole:?}");
        assert!((whole.offset_s - offset_s).abs() < 4.0 * whole.sigma_s, "{offset_s}: {whole:?}");
        let rates = estimate.whole.by_rates.unwrap();
        assert!((rates.offset_s - offset_s).abs() < 2e-3 && rates.correlation > 0.98, "{offset_s}: {rates:?}");
        let first = estimate.windows[0];
        assert!(first.from_s > 0.9 && first.from_s < 1.4 && (first.to_s - first.from_s - 2.0).abs() < 1e-6);
        assert!((first.estimate.unwrap().offset_s - offset_s).abs() < 2e-3, "{offset_s}: {first:?}");
        assert!(!estimate.start_lag.unwrap().is_significant, "{offset_s}: {:?}", estimate.start_lag);
        assert!(estimate.spread_corrected_m.unwrap() < 4e-3, "{estimate:?}");
        if offset_s != 0.0 {
            assert!(estimate.spread_as_set_m > 2.0 * estimate.spread_corrected_m.unwrap());
        }
        let error_m = estimate.reflector_m.distance(simulated.truth.obstacles[0].points_m[0]);
        // The path is straight: the cross-range position is hardly known.
        assert!(error_m < 0.5, "{error_m}");
    }
}

#[test]
fn start_lag_is_detected_in_the_first_window() {
    for (lag_s, seed) in [(0.03, 4), (0.4, 5)] {
        let (scenario, mut simulated) = trial("to-and-fro", 0.0, seed);
        let until_ns = simulated.frames[0].host_time_ns + 3_300_000_000;
        let lag_ns = (lag_s * 1e9) as i64;
        // The sweeps of the first seconds are stamped late: their poses were earlier.
        for frame in simulated.frames.iter_mut().filter(|frame| frame.host_time_ns < until_ns) {
            frame.host_time_ns += lag_ns;
        }
        let mut last_ns = i64::MIN;
        simulated.frames.retain(|frame| {
            let is_later = frame.host_time_ns > last_ns;
            last_ns = last_ns.max(frame.host_time_ns);
            is_later
        });
        let estimate = estimated(&scenario, &simulated).unwrap();
        let lag = estimate.start_lag.unwrap();
        assert!(lag.is_significant && (lag.lag_s + lag_s).abs() < 3e-3, "{lag_s}: {lag:?} {:?}", estimate.windows);
        let later = estimate.windows.last().unwrap().estimate.unwrap();
        assert!(later.offset_s.abs() < 2e-3, "{later:?}");
    }
}

#[test]
fn unobservable_offsets_are_reported_as_unobservable() {
    let (scenario, simulated) = trial("straight-0.3", 0.02, 6);
    let estimate = estimated(&scenario, &simulated);
    assert!(estimate.as_ref().map_or(true, |t| t.whole.estimate.is_none_or(|e| !e.observable)), "{estimate:?}");
    let still = trial("stationary", 0.02, 7);
    let estimate = estimated(&still.0, &still.1).unwrap();
    assert!(estimate.whole.by_rates.is_none() && estimate.start_lag.is_none(), "{estimate:?}");
    assert!(estimate.whole.estimate.is_none_or(|e| !e.observable), "{estimate:?}");
    let mut empty = still.1.clone();
    empty.poses.clear();
    assert!(matches!(estimated(&still.0, &empty), Err(SynchronisationError::NoPoses)));
}

#[test]
fn command_prints_the_offset_and_writes_the_figure() {
    let folder = Folder::new("calibrate");
    folder
        .run("simulate corner-reflector --motion to-and-fro --time-offset-s 0.035 --snr-db 20 --duration-s 8 --out a.mcap")
        .succeeds();
    let out = folder.run("calibrate a.mcap --out found").succeeds().out;
    assert!(out.contains("tracking.time_offset_s=0.03") && out.contains("no lag"), "{out}");
    let json = folder.json("found/calibration.json");
    let offset_s = json["whole"]["estimate"]["offset_s"].as_f64().unwrap();
    assert!((offset_s - 0.035).abs() < 0.7e-3, "{offset_s}");
    assert!(json["windows"].as_array().unwrap().len() >= 3, "{json}");
    assert_eq!(&folder.read("found/synchronisation.png")[1..4], b"PNG");
    folder.run("calibrate missing.mcap").fails_with("missing.mcap");
    folder.run("simulate nothing --motion to-and-fro --duration-s 2 --out b.mcap").succeeds();
    folder.run("calibrate b.mcap").fails_with("no stationary reflector was found");
}

#[test]
fn command_finds_the_mount_and_names_what_was_not_observable() {
    let folder = Folder::new("calibrate-mount");
    // Assumed 3 cm too far to the left and 2 cm too low.
    folder.run("simulate play-room --duration-s 60 --seed 40 --mount 0.03,0.05,-0.1 --out play.mcap").succeeds();
    let assumed = "--set tracking.mount={translation=[0.0,0.03,-0.1],rotation=[0.0,0.0,0.0,1.0]}";
    let out = folder.run(&format!("calibrate play.mcap {assumed} --out found")).succeeds().out;
    assert!(out.contains("sets it") && out.contains("to the right: +"), "{out}");
    let mount = &folder.json("found/calibration.json")["mount"];
    let position_m = |k: usize| mount["position_m"][k].as_f64().unwrap();
    assert!((position_m(0) - 0.03).abs() < 5e-3 && (position_m(1) - 0.05).abs() < 10e-3, "{mount}");
    // A sensor that only moves to and fro does not turn.
    folder.run("simulate corner-reflector --motion to-and-fro --duration-s 8 --out line.mcap").succeeds();
    let out = folder.run("calibrate line.mcap").succeeds().out;
    assert!(out.contains("not observed: nod") && !out.contains("tracking.mount"), "{out}");
}
