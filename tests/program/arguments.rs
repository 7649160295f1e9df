//! Invalid settings and arguments: refused before any work, with a message that states what to do.

use crate::common::Folder;
use crate::vendor_file::short_h5;

/// A folder with a recording for the commands.
fn folder(test: &str) -> Folder {
    let folder = Folder::new(test);
    folder.run("simulate corner-reflector --motion stationary --snr-db 20 --duration-s 0.3 --out r.mcap").succeeds();
    folder
}

#[test]
fn impossible_settings_are_refused() {
    let folder = folder("settings");
    folder.write("text", "the quick brown fox");
    folder.write("typo.toml", "[reflectors]\nvoxels_m = 0.1\n");
    folder.write("kind.toml", "[reflectors]\nvoxel_m = \"small\"\n");
    for (arguments, message) in [
        ("--set warnings=1", "unknown field `warnings`, expected one of `radar`, `tracking`"),
        ("--set reflectors.voxels_m=1", "unknown field `voxels_m`, expected one of `voxel_m`"),
        ("--set reflectors.voxel_m", "--set reflectors.voxel_m: write it as name=value"),
        ("--set reflectors.voxel_m=", "expected a number"),
        ("--set reflectors.voxel_m=small", "expected a number"),
        ("--set reflectors.voxel_m=0", "setting reflectors.voxel_m is 0: it must lie in 0.005 to 0.5"),
        ("--set reflectors.voxel_m=nan", "setting reflectors.voxel_m is NaN"),
        ("--set reflectors.voxel_m=0.005", "voxels to search"),
        ("--set reflectors.threshold_sigma=nan", "setting reflectors.threshold_sigma is NaN"),
        ("--set reflectors.max_sweeps=-1", "expected a whole number"),
        ("--set rooms.clean.min_score=nan", "setting rooms.clean.min_score is NaN"),
        ("--set rooms.tracks.confirm_score=nan", "setting rooms.tracks.confirm_score is NaN"),
        ("--set rooms.subapertures.max_range_m=0.1", "setting rooms.subapertures.max_range_m is 0.1"),
        ("--set radar.range_bias_m=0.2", "setting radar.range_bias_m is 0.2: it must lie in -0.1 to 0.1"),
        ("--set radar.range_bias_m=nan", "setting radar.range_bias_m is NaN: it must lie in -0.1 to 0.1"),
        ("--set tracking.time_offset_s=inf", "setting tracking.time_offset_s is inf: it must lie in -10 to 10"),
        ("--set tracking.time_offset_s.x=1", "in `tracking.time_offset_s`"),
        ("--set tracking.history.smoothing_window_s=9", "smoothing_window_s is 9: it must lie in 0 to 0.5"),
        ("--set radar.beam=laser", "beam \"laser\" is not known: use uniform"),
        ("--set radar.beam=[[0,1],[10,nan]]", "beam table row 1 is [10, NaN]"),
        ("--set processing.mode=fast", "unknown variant `fast`, expected one of `auto`"),
        ("--set processing.region={min=[1,0,0],max=[0,1,1]}", "setting processing.region"),
        ("--set processing.region={min=[0,0,0],max=[1e9,1,1]}", "setting processing.region"),
        ("--set processing.region={min=[0,0,0],max=[50,50,50]}", "voxels to search"),
        ("--settings missing.toml", "cannot read settings missing.toml"),
        ("--settings r.mcap", "cannot read settings r.mcap"),
        ("--settings text", "settings: TOML parse error at line 1"),
        ("--settings typo.toml", "unknown field `voxels_m`"),
        ("--settings kind.toml", "expected a number"),
    ] {
        for command in ["replay r.mcap", "reconstruct r.mcap --out v.npy"] {
            let outcome = folder.run(&format!("{command} {arguments}")).fails_with(message);
            assert_eq!(outcome.err.matches(message).count(), 1, "printed twice: {outcome:#?}");
        }
    }
    assert!(!folder.path("v.npy").exists());
}

#[test]
fn settings_file_and_set_arguments_apply() {
    let folder = folder("settings_file");
    folder.write("my.toml", "[tracking]\ntime_offset_s = 0.01\n");
    folder.run("replay r.mcap --settings my.toml --out a").succeeds();
    assert_eq!(folder.json("a/obstacles.json")["time_offset_s"], 0.01);
    folder.run("replay r.mcap --settings my.toml --set tracking.time_offset_s=0.005 --out a").succeeds();
    assert_eq!(folder.json("a/obstacles.json")["time_offset_s"], 0.005);
}

#[test]
fn impossible_volumes_are_refused() {
    let folder = folder("volumes");
    for (arguments, message) in [
        ("--voxel-m 0", "--voxel-m 0: give"),
        ("--voxel-m nan", "--voxel-m NaN: give"),
        ("--voxel-m inf", "--voxel-m inf: give"),
        ("--voxel-m 1e300", "--voxel-m 1"),
        ("--voxel-m=-0.1", "--voxel-m -0.1: give"),
        ("--voxel-m small", "invalid value 'small' for '--voxel-m"),
        ("--voxel-m 0.0001", "voxels of 0.0001 m: at most"),
        ("--box 1,1,1,0,0,0", "--box 1,1,1,0,0,0: give x0,y0,z0,x1,y1,z1 in metres"),
        ("--box 0,0,0,0,1,1", "each second corner above the first"),
        ("--box nan,0,0,1,1,1", "--box nan,0,0,1,1,1: give"),
        ("--box 0,0,0,inf,1,1", "--box 0,0,0,inf,1,1: give"),
        ("--box 0,0,0", "--box 0,0,0: give"),
        ("--box 0,0,0,1,1,1,1", "give x0,y0,z0,x1,y1,z1"),
        ("--box a,b,c,d,e,f", "give x0,y0,z0,x1,y1,z1"),
        ("--box -1e9,-1e9,-1e9,1e9,1e9,1e9", "voxels of 0.05 m: at most"),
        ("--box -1e300,-1e300,-1e300,1e300,1e300,1e300", "voxels of 0.05 m: at most"),
        ("--sweeps 0", "--sweeps 0: give at least 1"),
        ("--sweeps -3", "unexpected argument '-3'"),
        ("--sweeps some", "invalid value 'some' for '--sweeps"),
        ("--statistic nonsense", "statistic \"nonsense\" is not known: use thesis-full, thesis, ls, log"),
        ("--search adaptive --threshold-share 0", "--threshold-share 0: give a share above 0, at most 1"),
        ("--search adaptive --threshold-share nan", "--threshold-share NaN: give a share"),
        ("--search adaptive --statistic blocks --voxel-m 0.5", "--search adaptive does not serve subaperture"),
        ("--search adaptive --device gpu --voxel-m 0.5", "--device gpu computes dense volumes"),
        ("--search sideways", "invalid value 'sideways' for '--search"),
        ("--time-offset-s nan", "--time-offset-s NaN: give"),
        ("--time-offset-s 1e300", "--time-offset-s 1"),
        ("--time-offset-s 9", "no sweep of r.mcap has a pose"),
    ] {
        folder.run(&format!("reconstruct r.mcap --out v.npy {arguments}")).fails_with(message);
    }
    assert!(!folder.path("v.npy").exists());
    folder.run("reconstruct r.mcap").fails_with("--out <FILE.npy>");
    folder
        .run("reconstruct r.mcap --out v.json")
        .fails_with("--out v.json: the .json beside the volume takes this name");
}

#[test]
fn asking_for_too_many_sweeps_uses_all() {
    let folder = folder("all_sweeps");
    folder.run("reconstruct r.mcap --voxel-m 0.5 --sweeps 1000000 --out v.npy").succeeds().prints(" 36 sweeps");
}

#[test]
fn impossible_scenarios_are_refused() {
    let folder = Folder::new("scenarios");
    for (arguments, message) in [
        ("moon", "invalid value 'moon' for '<ROOM>'"),
        ("nothing --motion moonwalk", "invalid value 'moonwalk' for '--motion"),
        ("nothing --preset best", "invalid value 'best' for '--preset"),
        ("nothing --preset fine --config sensor.json", "cannot be used with"),
        ("nothing --beam laser", "beam \"laser\" is not known: use uniform"),
        ("nothing --seed -1", "unexpected argument '-1'"),
        ("nothing --duration-s 0", "a duration of 0 s cannot be simulated: give 0.1 to 3600 s"),
        ("nothing --duration-s nan", "a duration of NaN s cannot be simulated"),
        ("nothing --duration-s 1e9", "give 0.1 to 3600 s"),
        ("nothing --snr-db nan", "an SNR of NaN dB cannot be simulated"),
        ("nothing --snr-db 1e9", "give −100 to 100 dB"),
        ("nothing --mount 1,2", "\"1,2\" is no mount: give x,y,z or x,y,z,qx,qy,qz,qw"),
        ("nothing --mount nan,0,0", "is not finite"),
        (
            "nothing --mount 1000,0,0",
            "--mount 1000,0,0: the sensor is [1000.0, 0.0, 0.0] m from the head: give at most 10 m",
        ),
        ("nothing --mount 0,0,0,0,0,0,0", "has length zero: it defines no rotation"),
        ("nothing --time-offset-s nan", "a time offset of NaN s cannot be simulated: give −10 to 10 s"),
        ("nothing --time-offset-s 1e9", "a time offset of 1000000000 s cannot be simulated"),
        ("nothing --dropouts-per-minute nan", "NaN dropouts a minute cannot be simulated"),
        ("nothing --dropouts-per-minute 1e9", "1000000000 dropouts a minute cannot be simulated"),
    ] {
        folder.run(&format!("simulate {arguments} --out x.mcap")).fails_with(message);
        assert!(!folder.path("x.mcap").exists(), "{arguments}");
    }
    folder.run("simulate nothing").fails_with("--out <FILE.mcap>");
}

#[test]
fn impossible_speeds_are_refused() {
    let folder = folder("speeds");
    for (speed, message) in [
        ("0", "--speed 0: give a number above 0"),
        ("nan", "--speed NaN: give a number above 0"),
        ("inf", "--speed inf: give a number above 0"),
        ("fast", "invalid value 'fast' for '--speed"),
    ] {
        folder.run(&format!("replay r.mcap --speed {speed}")).fails_with(message);
    }
    folder.run("replay r.mcap --speed=-1").fails_with("--speed -1: give a number above 0");
}

#[test]
fn an_impossible_mount_of_an_import_is_refused() {
    let folder = Folder::new("import_mount");
    folder.write("input.h5", short_h5());
    for (mount, message) in [("1", "\"1\" is no mount"), ("0,0,inf", "is not finite"), ("0,0,0,0,0,0,0", "length zero")]
    {
        folder.run(&format!("import input.h5 --mount {mount} --out r.mcap")).fails_with(message);
    }
}

#[test]
fn unwritable_outputs_are_reported_once() {
    let folder = folder("unwritable");
    std::fs::create_dir(folder.path("folder")).unwrap();
    for (line, reason) in [
        ("simulate nothing --duration-s 0.2 --out missing/r.mcap", "there is no folder missing"),
        ("reconstruct r.mcap --voxel-m 0.5 --out r.mcap/v.npy", "is no folder"),
        ("replay r.mcap --out r.mcap", "is no folder"),
    ] {
        let outcome = folder.run(line).fails_with(reason);
        assert_eq!(outcome.err.matches(reason).count(), 1, "printed twice: {outcome:#?}");
    }
    for line in ["simulate nothing --out folder", "recover r.mcap --out folder", "reconstruct r.mcap --out folder"] {
        folder.run(line).fails_with("folder is a folder: give the file to write");
    }
}

#[test]
fn closed_stdout_loses_no_file() {
    let folder = folder("unread");
    for (line, file) in [
        ("simulate nothing --duration-s 0.2 --out s.mcap", "s.mcap"),
        ("replay r.mcap --set reflectors.voxel_m=0.2 --out found", "found/report.html"),
        ("reconstruct r.mcap --voxel-m 0.5 --out v.npy", "v.npy"),
        ("recover r.mcap --out saved.mcap", "saved.mcap"),
        ("info r.mcap", "r.mcap"),
        ("--help", "r.mcap"),
    ] {
        folder.run_unread(line).succeeds();
        assert!(folder.path(file).exists(), "{line}");
    }
}

#[test]
fn files_that_are_there_are_replaced_only_when_asked() {
    let folder = folder("replace");
    folder.write("input.h5", short_h5());
    let before = folder.read("r.mcap");
    for command in [
        "recover r.mcap --out there",
        "replay r.mcap --set reflectors.voxel_m=0.2 --results there",
        "simulate nothing --duration-s 0.2 --out there",
        "import input.h5 --out there",
        "reconstruct r.mcap --voxel-m 0.5 --out there",
        "reconstruct r.mcap --voxel-m 0.5 --out v.npy --cloud there",
    ] {
        folder.write("there", "mine");
        folder.run(command).fails_with("there is there already: choose another name, or give --force to replace it");
        assert_eq!(folder.read("there"), b"mine", "{command}");
        folder.run(&format!("{command} --force")).succeeds();
        assert_ne!(folder.read("there"), b"mine", "{command}");
        let _ = std::fs::remove_file(folder.path("v.npy"));
    }
    folder.write("sensor.json", "mine");
    let command = "reconstruct r.mcap --voxel-m 0.5 --out sensor.npy";
    folder.run(command).fails_with("sensor.json is there already");
    // Another name of the input is replaced, the input is not.
    for name in ["recover r.mcap --out linked.mcap", "replay r.mcap --set reflectors.voxel_m=0.2 --results linked.mcap"]
    {
        std::fs::hard_link(folder.path("r.mcap"), folder.path("linked.mcap")).unwrap();
        folder.run(&format!("{name} --force")).succeeds();
        assert!(folder.read("r.mcap") == before, "{name}");
        std::fs::remove_file(folder.path("linked.mcap")).unwrap();
    }
}

#[test]
fn no_command_overwrites_its_input() {
    let folder = folder("overwrite");
    let before = folder.read("r.mcap");
    folder.run("recover r.mcap --out r.mcap").fails_with("choose another name for what is written");
    folder.run("recover r.mcap --out ../overwrite/r.mcap").fails_with("choose another name for what is written");
    folder.run("reconstruct r.mcap --voxel-m 0.5 --out r.mcap").fails_with("choose another name for what is written");
    assert!(folder.read("r.mcap") == before);
    folder.write("sensor.json", "{}");
    folder
        .run("simulate nothing --config sensor.json --duration-s 0.2 --out sensor.json")
        .fails_with("choose another name for what is written");
    folder.write("input.h5", short_h5());
    let before = folder.read("input.h5");
    folder.run("import input.h5 --out input.h5").fails_with("choose another name for what is written");
    folder.write("track.tum", "0 0 0 0 0 0 0 1\n");
    folder
        .run("import input.h5 --poses track.tum --out track.tum")
        .fails_with("choose another name for what is written");
    assert!(folder.read("input.h5") == before);
}
