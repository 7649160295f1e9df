//! What commands write is never one of their inputs, another output, or a file of others that nobody gave up.

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::common::Folder;

/// A folder with a recording, also under names that results have.
fn folder(test: &str) -> Folder {
    let folder = Folder::new(test);
    folder.run("simulate corner-reflector --motion stationary --snr-db 20 --duration-s 0.5 --out r.mcap").succeeds();
    for name in ["v.json", "found/shape.ply", "calibrated/calibration.json"] {
        std::fs::create_dir_all(folder.path(name).parent().unwrap()).unwrap();
        std::fs::copy(folder.path("r.mcap"), folder.path(name)).unwrap();
    }
    folder.write("s.toml", "[tracking]\ntime_offset_s = 0.01\n");
    folder
}

/// Every file of a folder except the runs' output.
fn files(folder: &Folder) -> Vec<(String, Vec<u8>)> {
    let (mut folders, mut files) = (vec![folder.path("")], Vec::new());
    while let Some(inner) = folders.pop() {
        for path in std::fs::read_dir(inner).unwrap().map(|entry| entry.unwrap().path()) {
            match path.is_dir() {
                true if path.ends_with("streams") => {}
                true => folders.push(path),
                false => files.push((path.display().to_string(), std::fs::read(&path).unwrap_or_default())),
            }
        }
    }
    files.sort();
    files
}

#[test]
fn no_output_is_an_input_or_another_output() {
    let folder = folder("outputs_distinct");
    #[cfg(unix)]
    std::os::unix::fs::symlink("n.mcap", folder.path("link")).unwrap();
    let before = files(&folder);
    let (itself, twice) =
        ("itself: choose another name for what is written", "are one file: give each output its own name");
    for (command, message) in [
        ("reconstruct v.json --out v.npy --force", itself),
        ("reconstruct r.mcap --settings s.toml --out s.toml --force", itself),
        ("reconstruct r.mcap --out k.npy --cloud ./k.npy", twice),
        ("reconstruct r.mcap --out k.npy --cloud found/../k.json", twice),
        ("replay r.mcap --results q --film ./q", twice),
        ("replay r.mcap --results none/../q --film q", twice),
        ("replay r.mcap --out new --film new/map.png", twice),
        ("replay r.mcap --settings s.toml --film s.toml --force", itself),
        ("replay r.mcap --map v.json --results v.json --force", itself),
        ("replay found/shape.ply --out found --force", itself),
        ("calibrate calibrated/calibration.json --out calibrated --force", itself),
        ("simulate nothing --serve tcp:127.0.0.1:0 --duration-s 1 --poses-out t --track-out ./t", twice),
        ("record --port /dev/ttyNONE7 --no-poses --calibration n.mcap --out ./n.mcap", twice),
        ("run --record n.mcap --report ../outputs_distinct/n.mcap", twice),
        #[cfg(unix)]
        ("record --port /dev/ttyNONE7 --no-poses --calibration link --out n.mcap", twice),
        #[cfg(unix)]
        ("simulate nothing --serve pty:p --duration-s 1 --poses-out ./p", itself),
        #[cfg(any(windows, target_os = "macos"))]
        ("replay r.mcap --results q --film Q", twice),
    ] {
        folder.run(command).fails_with(message);
        assert!(files(&folder) == before, "{command} changed files");
    }
}

#[test]
fn files_of_others_are_replaced_only_when_asked() {
    let folder = folder("outputs_others");
    let picture = b"\x89PNG\r\n\x1a\nnot of this program";
    let serve = "simulate nothing --serve tcp:127.0.0.1:0 --duration-s 0.3";
    // The command, the file, and whether --force is tried: it takes the command's whole time.
    for (command, name, takes_force) in [
        (format!("{serve} --poses-out there/t.tum"), "there/t.tum", true),
        (format!("{serve} --track-out there/t.tum"), "there/t.tum", true),
        ("reconstruct r.mcap --voxel-m 0.5 --out there/y.npy".to_owned(), "there/y.json", true),
        ("replay r.mcap --set reflectors.voxel_m=0.2 --out there".to_owned(), "there/map.png", true),
        ("replay r.mcap --view-shot there".to_owned(), "there/above.png", false),
        ("calibrate r.mcap --out there".to_owned(), "there/synchronisation.png", false),
        ("demo --out there".to_owned(), "there/chair/map.png", false),
        ("run --report there/there.json".to_owned(), "there/there.json", false),
    ] {
        std::fs::create_dir_all(folder.path(name).parent().unwrap()).unwrap();
        folder.write(name, picture);
        folder.run(&command).fails_with("is there already: choose another name, or ");
        assert_eq!(folder.read(name), picture, "{command}");
        if takes_force {
            folder.run(&format!("{command} --force")).succeeds();
            assert_ne!(folder.read(name), picture, "{command}");
            // What the command made itself it replaces unasked.
            folder.run(&command).succeeds();
        }
        std::fs::remove_dir_all(folder.path("there")).unwrap();
    }
}

#[test]
fn a_folder_that_cannot_be_made_is_refused_before_any_work() {
    let folder = folder("outputs_folder");
    // No input is there: that would be the next complaint.
    for command in [
        "replay none.mcap --out s.toml/out",
        "replay none.mcap --results s.toml/a/b.mcap",
        "calibrate none.mcap --out s.toml/c",
    ] {
        folder.run(command).fails_with("s.toml is no folder");
    }
    // Recordings are written into folders that are there.
    for command in ["replay none.mcap --results gone/b.mcap", "recover none.mcap --out gone/b.mcap"] {
        folder.run(command).fails_with("there is no folder gone: make it, or choose another name");
    }
    // What lies beside a folder that is still to be made does not matter.
    std::fs::create_dir(folder.path("y.npy")).unwrap();
    folder.run("reconstruct r.mcap --voxel-m 0.5 --out new/y.npy").succeeds();
    assert!(folder.path("new/y.npy").is_file());
}

/// A replay of half a second at a speed, which writes all the while.
fn slow_replay(folder: &Folder, speed: &str) -> Child {
    let mut program = Command::new(crate::PROGRAM);
    program.args(["replay", "r.mcap", "--speed", speed, "--results", "res.mcap"]).current_dir(folder.path(""));
    let child = program.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let start = Instant::now();
    while unfinished(&folder.path("")).is_empty() {
        assert!(start.elapsed() < Duration::from_secs(60), "nothing is written");
        sleep(Duration::from_millis(5));
    }
    child
}

fn unfinished(folder: &Path) -> Vec<String> {
    let names = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    names.filter(|name| name.starts_with(".res.mcap.")).collect()
}

#[test]
fn a_file_that_appears_while_another_is_written_stays() {
    let folder = folder("outputs_meanwhile");
    let child = slow_replay(&folder, "0.05");
    folder.write("res.mcap", "theirs");
    let outcome = child.wait_with_output().unwrap();
    let message = String::from_utf8(outcome.stderr).unwrap();
    assert_eq!(outcome.status.code(), Some(1), "{message}");
    assert!(message.contains("meanwhile: it stays, and what was written is in res-2.mcap"), "{message}");
    assert_eq!(folder.read("res.mcap"), b"theirs");
    folder.run("info res-2.mcap").succeeds().prints("Damage     none");
    assert!(unfinished(&folder.path("")).is_empty());
}

#[test]
fn what_a_killed_command_left_is_removed_by_the_next() {
    let folder = folder("outputs_killed");
    let mut child = slow_replay(&folder, "0.001");
    // It is still being written.
    folder.run("recover r.mcap --out res.mcap").succeeds();
    assert_eq!(unfinished(&folder.path("")).len(), 1);
    child.kill().unwrap();
    child.wait().unwrap();
    assert_eq!(unfinished(&folder.path("")).len(), 1);
    folder.run("recover r.mcap --out res.mcap --force").succeeds();
    assert_eq!(unfinished(&folder.path("")).len(), 0);
}

#[test]
fn the_longest_names_can_be_written() {
    let folder = folder("outputs_long");
    let name = format!("{}.mcap", "x".repeat(250));
    folder.run(&format!("recover r.mcap --out {name}")).succeeds();
    folder.run(&format!("recover r.mcap --out {name} --force")).succeeds();
    assert!(folder.path(&name).is_file());
}
