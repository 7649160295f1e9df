//! Every rule of the sensor, broken once in a configuration file: the message names field, value
//! and bound.

use serde_json::{Value, json};

use crate::common::Folder;

/// A configuration with these fields on top of the vendor's defaults, and likewise for its one
/// subsweep.
fn config(fields: Value, subsweep: Value) -> Value {
    let mut config = json!({"subsweeps": [subsweep]});
    config.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
    config
}

fn frame(fields: Value) -> Value {
    config(fields, json!({}))
}

fn subsweep(fields: Value) -> Value {
    config(json!({}), fields)
}

#[test]
fn broken_sensor_rule_names_field_value_and_bound() {
    let table = [
        (json!({"subsweeps": []}), "subsweeps is empty: give 1 to 4"),
        (json!({"subsweeps": [{}, {}, {}, {}, {}]}), "subsweeps has 5 entries: give 1 to 4"),
        (frame(json!({"sweeps_per_frame": 0})), "sweeps_per_frame is 0: it must lie in 1 to 4095"),
        (frame(json!({"sweeps_per_frame": 4096})), "sweeps_per_frame is 4096: it must lie in 1 to 4095"),
        (subsweep(json!({"start_point": -276})), "subsweeps[0].start_point is -276: it must lie in -275 to"),
        (subsweep(json!({"num_points": 0})), "subsweeps[0].num_points is 0: it must lie in 1 to 4095"),
        (subsweep(json!({"num_points": 4096})), "subsweeps[0].num_points is 4096: it must lie in 1 to 4095"),
        (subsweep(json!({"hwaas": 0})), "subsweeps[0].hwaas is 0: it must lie in 1 to 511"),
        (subsweep(json!({"hwaas": 512})), "subsweeps[0].hwaas is 512: it must lie in 1 to 511"),
        (subsweep(json!({"receiver_gain": 24})), "subsweeps[0].receiver_gain is 24: it must lie in 0 to 23"),
        (subsweep(json!({"step_length": 0})), "subsweeps[0].step_length is 0: it must divide 24 or be a multiple"),
        (subsweep(json!({"step_length": 5})), "subsweeps[0].step_length is 5: it must divide 24 or be a multiple"),
        (subsweep(json!({"step_length": 36})), "subsweeps[0].step_length is 36: it must divide 24 or be a multiple"),
        (
            subsweep(json!({"profile": 2, "enable_loopback": true})),
            "subsweeps[0].enable_loopback is true with profile 2: choose another profile",
        ),
        (subsweep(json!({"prf": "19_5_MHz"})), "subsweeps[0].prf is 19.5 MHz with profile 3: it needs profile 1"),
        (
            subsweep(json!({"step_length": 24, "num_points": 100})),
            "subsweeps[0] ends at 6.15 m: prf 15.6 MHz measures to 5.1 m; lower the prf or num_points",
        ),
        (
            json!({"subsweeps": [{"prf": "8_7_MHz"}, {"prf": "13_0_MHz"}]}),
            "subsweeps[1].prf is 13 MHz, above 8.7 MHz before it: it must not rise",
        ),
        (
            frame(json!({"sweeps_per_frame": 26})),
            "num_points × sweeps_per_frame is 160 × 26 = 4160: the sensor holds 4095",
        ),
        (
            frame(json!({"sweeps_per_frame": 13, "double_buffering": true})),
            "num_points × sweeps_per_frame is 160 × 13 = 2080: the sensor holds 2047 with double_buffering",
        ),
        (frame(json!({"frame_rate": 0.0})), "frame_rate is 0.0: it must be above 0"),
        (frame(json!({"sweep_rate": -2.5})), "sweep_rate is -2.5: it must be above 0"),
        (
            frame(json!({"frame_rate": 60.0, "sweep_rate": 100.0, "sweeps_per_frame": 2})),
            "frame_rate is 60: with 2 sweeps at sweep_rate 100 it may be 50 at most",
        ),
        (
            frame(json!({"inter_frame_idle_state": "ready", "inter_sweep_idle_state": "sleep"})),
            "inter_frame_idle_state is Ready, less deep than inter_sweep_idle_state Sleep: make it as deep",
        ),
        (
            frame(json!({"continuous_sweep_mode": true, "sweep_rate": 100.0, "frame_rate": 9.0})),
            "continuous_sweep_mode with frame_rate 9: leave frame_rate out",
        ),
        (frame(json!({"continuous_sweep_mode": true})), "continuous_sweep_mode without sweep_rate: set sweep_rate"),
        (
            frame(json!({"continuous_sweep_mode": true, "sweep_rate": 100.0})),
            "inter_frame_idle_state DeepSleep and inter_sweep_idle_state Ready: make them equal",
        ),
    ];
    let folder = Folder::new("rules");
    for (config, message) in table {
        folder.write("sensor.json", config.to_string());
        let outcome =
            folder.run("simulate nothing --config sensor.json --duration-s 0.2 --out r.mcap").fails_with(message);
        assert!(outcome.err.contains("sensor.json breaks a rule of the sensor"), "{outcome:#?}");
        assert!(!folder.path("r.mcap").exists(), "nothing is written");
    }
}

#[test]
fn invalid_configuration_file_is_refused_with_position() {
    let folder = Folder::new("no_config");
    let table = [
        ("", "EOF while parsing"),
        ("subsweeps = 1", "expected value at line 1"),
        ("{\"subsweeps\": 3}", "invalid type: integer `3`, expected a sequence"),
        ("{\"subsweeps\": [{\"profile\": 6}]}", "it is 1 to 5"),
        ("{\"subsweeps\": [{\"prf\": \"14 MHz\"}]}", "unknown variant `14 MHz`"),
        ("{\"sweeps_per_frame\": -1}", "invalid value: integer `-1`"),
        ("{\"frame_rate\": 1e999}", "number out of range"),
    ];
    for (text, message) in table {
        folder.write("sensor.json", text);
        let outcome = folder.run("simulate nothing --config sensor.json --out r.mcap").fails_with(message);
        assert!(outcome.err.contains("sensor.json is no sensor configuration"), "{outcome:#?}");
    }
    folder
        .run("simulate nothing --config missing.json --out r.mcap")
        .fails_with("cannot read configuration missing.json");
}

#[test]
fn a_sound_configuration_is_simulated() {
    let folder = Folder::new("sound_config");
    folder.write("sensor.json", r#"{"subsweeps": [{"num_points": 20, "step_length": 24}], "frame_rate": 50.0}"#);
    folder
        .run("simulate corner-reflector --config sensor.json --duration-s 1 --out r.mcap")
        .succeeds()
        .prints("20 points a sweep");
}

#[test]
fn extreme_valid_configurations_are_simulated_and_replayed() {
    let folder = Folder::new("borders");
    let table = [
        // One frame in 10⁹ seconds; more frames than a sensor can make.
        config(json!({"frame_rate": 1e-9}), json!({"num_points": 1})),
        config(json!({"frame_rate": 1e9}), json!({"num_points": 1})),
        config(json!({"sweep_rate": 1e38}), json!({"num_points": 1, "hwaas": 1})),
        config(json!({"sweep_rate": 1e-37}), json!({"num_points": 1, "hwaas": 511})),
        // All points are before the antenna.
        config(json!({"sweeps_per_frame": 500}), json!({"num_points": 1, "start_point": -275})),
        json!({"sweeps_per_frame": 10, "subsweeps": [
            {"num_points": 2, "start_point": -275},
            {"num_points": 3, "profile": 5, "enable_tx": false},
        ]}),
    ];
    for config in table {
        println!("{config}");
        folder.write("sensor.json", config.to_string());
        folder.run("simulate furnished-room --config sensor.json --duration-s 0.3 --out r.mcap --force").succeeds();
        for mode in ["rooms", "reflectors"] {
            folder.run(&format!("replay r.mcap --set processing.mode={mode} --out found")).succeeds();
        }
    }
}
