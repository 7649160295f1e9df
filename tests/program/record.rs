//! `record` and `doctor`: their messages without hardware, and their work with a minimal board on a
//! socket.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Command, Stdio};
use std::thread::{sleep, spawn};
use std::time::{Duration, Instant};

use a121::find::{discover, list_ports};
use radar_chaperone::app::now_ns;

use crate::common::Folder;
use crate::tiny_board::TinyBoard;

/// Starts a board that serves one client after the other for as long as the tests run; returns its
/// address.
fn board() -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    spawn(move || listener.incoming().flatten().for_each(serve));
    format!("tcp:{address}")
}

fn serve(mut socket: TcpStream) {
    socket.set_read_timeout(Some(Duration::from_millis(1))).unwrap();
    let (mut line, mut buffer, mut board) = (Vec::new(), [0; 4096], TinyBoard::default());
    loop {
        match socket.read(&mut buffer) {
            Ok(0) => return,
            Ok(read) => line.extend_from_slice(&buffer[..read]),
            Err(error) if error.kind() == std::io::ErrorKind::ConnectionReset => return,
            Err(_) => {}
        }
        while let Some(end) = line.iter().position(|&byte| byte == b'\n') {
            let _ = socket.write_all(&board.answer(&line.drain(..=end).collect::<Vec<u8>>()));
        }
        if let Some(result) = board.result() {
            let _ = socket.write_all(&result);
        }
    }
}

#[test]
fn impossible_arguments_are_refused_before_anything_is_opened() {
    let folder = Folder::new("record_arguments");
    folder.write("there.mcap", "precious");
    folder.write("no.json", "{\"hwaas\":}");
    folder.write("rule.json", "{\"sweeps_per_frame\": 0}");
    for (arguments, message) in [
        ("--out there.mcap", "there.mcap is there already: choose another name"),
        ("--out none/r.mcap", "there is no folder none: make it"),
        ("--out r.mcap --duration-s 0", "--duration-s 0: give seconds above 0"),
        ("--out r.mcap --duration-s nan", "--duration-s NaN: give seconds above 0"),
        ("--out r.mcap --preset d17", "invalid value 'd17' for '--preset"),
        ("--out r.mcap --preset d16 --config rule.json", "cannot be used with"),
        ("--out r.mcap --config none.json", "cannot read configuration none.json"),
        ("--out r.mcap --config no.json", "no.json is no sensor configuration"),
        ("--out r.mcap --config rule.json", "sweeps_per_frame is 0"),
        ("--out r.mcap --baud 9600", "9600 is not in 115200.."),
        ("--out r.mcap --sensor 6", "6 is not in 1..=5"),
        ("--out r.mcap --mount left", "\"left\" is no mount"),
        ("--out r.mcap --mount 100,0,0", "--mount 100,0,0: the sensor is [100.0, 0.0, 0.0] m from the head"),
        ("--out r.mcap --poses .", ". is a folder or a device"),
        ("--out r.mcap --calibration no.json", "no.json is no calibration"),
        ("--out r.mcap --calibration .", ". is a folder: give the file to write"),
    ] {
        folder.run(&format!("record --port /dev/ttyNONE7 {arguments}")).fails_with(message);
    }
    assert_eq!(folder.read("there.mcap"), b"precious");
    assert!(!folder.path("r.mcap").exists());
}

#[test]
fn ports_that_cannot_be_opened_say_why() {
    let folder = Folder::new("record_ports");
    for (port, message) in [
        ("/dev/ttyNONE7", "there is no port /dev/ttyNONE7: there is"),
        ("/dev/null", "/dev/null is not a serial port"),
        ("tcp:", "\"tcp:\" is not an address: write tcp:HOST or tcp:HOST:PORT"),
        ("tcp:127.0.0.1:1", "tcp:127.0.0.1:1 refuses the connection: start the exploration server there"),
    ] {
        folder.run(&format!("record --out r.mcap --port {port}")).fails_with(message);
        let doctor = folder.run(&format!("doctor --port {port}")).fails_with("one problem must be fixed");
        assert!(doctor.out.contains("fix ") && doctor.out.contains(message), "{doctor:#?}");
    }
    assert!(!folder.path("r.mcap").exists());
    if discover(&list_ports()).candidates.is_empty() {
        folder.run("record --out r.mcap").fails_with("no A121 board is found: there is");
        let doctor = folder.run("doctor").fails_with("one problem must be fixed").prints("no A121 board is found");
        let doctor = doctor.prints("simulate furnished-room --serve").prints("carried by line").prints("not known yet");
        assert!(doctor.out.contains("slow-link      6.63        25        25    9.2"), "{doctor:#?}");
    }
}

#[test]
#[cfg(target_os = "linux")]
fn busy_port_names_the_process_that_holds_it() {
    use a121::{Address, Line};
    let folder = Folder::new("record_busy");
    let (_board, ours) = serialport::TTYPort::pair().unwrap();
    let path = serialport::SerialPort::name(&ours).unwrap();
    drop(ours);
    let _held = Line::open(&Address::Serial { path: path.clone(), flow_control: true }).unwrap();
    let message = format!("{path} is in use by ");
    let outcome = folder.run(&format!("record --out r.mcap --port {path}")).fails_with(&message);
    assert!(outcome.err.contains(&format!("(process {})", std::process::id())), "{outcome:#?}");
    folder.run(&format!("doctor --port {path}")).fails_with("one problem must be fixed").prints(&message);
}

#[test]
fn a_board_is_recorded_with_poses_and_calibration() {
    let folder = Folder::new("record_board");
    let port = board();
    let now_s = now_ns() as f64 * 1e-9;
    let poses =
        (-50..2000).map(|n| format!("{:.4} 0 1.5 {} 0 0 0 1\n", now_s + f64::from(n) * 0.01, f64::from(n) * 1e-4));
    folder.write("t.tum", "# a track\nnonsense\n".to_owned() + &poses.collect::<String>());
    let outcome = folder.run(&format!(
        "record --port {port} --out r.mcap --duration-s 1 --poses t.tum --mount 0,0.03,-0.1 --calibration c.json"
    ));
    let outcome = outcome.succeeds().prints("Raspberry Pi on tcp:").prints("yes, 2 % of it").prints("Faults     none");
    let outcome = outcome.prints("0 frames lost").prints("1 invalid lines").prints("Written to r.mcap");
    assert!(outcome.out.contains("tiny, software a121-v1.12.0, 1000000 ticks a second"), "{outcome:#?}");
    let info = folder.run("info r.mcap").succeeds().prints("Raspberry Pi on tcp:").prints("Damage     none");
    let info = info.prints("Board      tiny, software a121-v1.12.0, 1000000 ticks").prints("+0.100 m ahead");
    assert!(info.out.lines().any(|l| l.starts_with("Frames ") && l.ends_with("no gaps")), "{info:#?}");
    assert!(info.out.contains("100.0 a second, no gaps, all valid"), "{info:#?}");
    assert_eq!(folder.json("c.json")[0]["data"], "00ff");
    folder.run(&format!("record --port {port} --out 2.mcap --duration-s 0.2 --calibration c.json")).succeeds();
    folder.run("replay r.mcap --out replayed").succeeds();
}

#[test]
fn doctor_passes_a_healthy_board() {
    let folder = Folder::new("doctor_board");
    let outcome = folder.run(&format!("doctor --port {}", board())).succeeds();
    for message in ["ok       Board", "ok       Opens", "ok       Answers", "ok       Sensors      connected: 1 of 1"] {
        assert!(outcome.out.contains(message), "{message}: {outcome:#?}");
    }
    assert!(outcome.out.contains("carried by network") && !outcome.out.contains("fix "), "{outcome:#?}");
    assert!(outcome.out.contains("Stream       preset d16: ") && outcome.out.contains(" 0 lost"), "{outcome:#?}");
}

#[test]
#[cfg(unix)]
fn signals_end_the_recording_without_damage() {
    let folder = Folder::new("record_signal");
    for signal in ["-INT", "-TERM", "-HUP"] {
        let out = format!("r{signal}.mcap");
        let mut program = Command::new(crate::PROGRAM);
        // These tests may themselves be run by nohup.
        // SAFETY: the call is allowed between fork and exec, and touches no memory.
        unsafe {
            std::os::unix::process::CommandExt::pre_exec(&mut program, || {
                libc::signal(libc::SIGHUP, libc::SIG_DFL);
                Ok(())
            });
        }
        let mut child = recording(&folder, &mut program, &out);
        wait_for_bytes(&folder, &out, 100_000);
        send(signal, &child);
        assert_eq!(child.0.wait().unwrap().code(), Some(0));
        folder.run(&format!("info {out}")).succeeds().prints("Damage     none").prints("no gaps");
    }
}

#[test]
#[cfg(unix)]
fn a_recording_that_is_removed_or_replaced_is_kept_under_another_name() {
    let folder = Folder::new("record_displaced");
    for (out, copy) in [("removed.mcap", "removed-2.mcap"), ("replaced.mcap", "replaced-2.mcap")] {
        let mut program = Command::new(crate::PROGRAM);
        program.stderr(Stdio::piped());
        let mut child = recording(&folder, &mut program, out);
        wait_for_bytes(&folder, out, 100_000);
        std::fs::remove_file(folder.path(out)).unwrap();
        if out == "replaced.mcap" {
            folder.write(out, "theirs");
        }
        send("-INT", &child);
        assert_eq!(child.0.wait().unwrap().code(), Some(1));
        let message = std::io::read_to_string(child.0.stderr.take().unwrap()).unwrap();
        assert!(message.contains(&format!("while it was recorded: the complete recording is in {copy}")), "{message}");
        assert!(!message.contains("ended early"), "{message}");
        folder.run(&format!("info {copy}")).succeeds().prints("Damage     none").prints("no gaps");
    }
    assert_eq!(folder.read("replaced.mcap"), b"theirs");
}

#[test]
#[cfg(unix)]
fn a_recording_by_nohup_outlives_its_terminal() {
    let folder = Folder::new("record_nohup");
    // What `nohup` does: the program inherits that the signal is ignored.
    let mut shell = Command::new("sh");
    shell.args(["-c", "trap '' HUP; exec \"$0\" \"$@\"", crate::PROGRAM]);
    let mut child = recording(&folder, &mut shell, "r.mcap");
    wait_for_bytes(&folder, "r.mcap", 100_000);
    send("-HUP", &child);
    let bytes = std::fs::metadata(folder.path("r.mcap")).unwrap().len();
    wait_for_bytes(&folder, "r.mcap", bytes + 200_000);
    send("-TERM", &child);
    assert_eq!(child.0.wait().unwrap().code(), Some(0));
    folder.run("info r.mcap").succeeds().prints("Damage     none").prints("no gaps");
}

#[test]
#[cfg(unix)]
fn a_recording_that_was_stopped_for_a_while_goes_on_without_a_gap() {
    // As a machine does that is suspended while the board and the line go on.
    const STOPPED_S: u64 = 3;
    let folder = Folder::new("record_stopped");
    let mut child = recording(&folder, &mut Command::new(crate::PROGRAM), "r.mcap");
    wait_for_bytes(&folder, "r.mcap", 100_000);
    send("-STOP", &child);
    sleep(Duration::from_secs(STOPPED_S));
    let bytes = std::fs::metadata(folder.path("r.mcap")).unwrap().len();
    send("-CONT", &child);
    wait_for_bytes(&folder, "r.mcap", bytes + 200_000);
    send("-INT", &child);
    assert_eq!(child.0.wait().unwrap().code(), Some(0));
    folder.run("info r.mcap").succeeds().prints("Damage     none").prints("no gaps");
}

#[cfg(unix)]
fn recording(folder: &Folder, program: &mut Command, out: &str) -> Recording {
    let program = program.args(["record", "--port", &board(), "--out", out]);
    Recording(program.current_dir(folder.path("")).stdout(Stdio::null()).spawn().unwrap())
}

/// A program that records. It ends with its test, also if that fails: it would wait for its board for ever.
#[cfg(unix)]
struct Recording(std::process::Child);

#[cfg(unix)]
impl Drop for Recording {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[cfg(unix)]
fn wait_for_bytes(folder: &Folder, name: &str, bytes: u64) {
    let start = Instant::now();
    while std::fs::metadata(folder.path(name)).map_or(0, |metadata| metadata.len()) < bytes {
        assert!(start.elapsed() < Duration::from_secs(30), "nothing is recorded");
        sleep(Duration::from_millis(20));
    }
}

#[cfg(unix)]
fn send(signal: &str, child: &Recording) {
    assert!(Command::new("kill").args([signal, &child.0.id().to_string()]).status().unwrap().success());
}

#[test]
fn run_leaves_in_the_log_file_why_it_ended() {
    let folder = Folder::new("run_log");
    let home = folder.path("");
    let home = home.to_str().unwrap();
    // SteamVR is not installed there.
    let variables = ["HOME", "LOCALAPPDATA", "XDG_STATE_HOME", "XDG_CONFIG_HOME"].map(|name| (name, home));
    for _ in 0..2 {
        folder.run_with("run", &variables).fails_with("SteamVR is not installed");
    }
    let log = String::from_utf8(folder.read("radar-chaperone/run.log")).unwrap();
    let lines: Vec<&str> = log.lines().filter(|line| line.contains("Z error: SteamVR is not installed")).collect();
    assert!(lines.len() == 2 && lines[0].starts_with("20"), "{log}");
}

#[cfg(unix)]
#[test]
fn run_waits_for_no_pipe_in_place_of_its_own_files() {
    let folder = Folder::new("run_pipes");
    let home = folder.path("");
    let home = home.to_str().unwrap();
    let variables = ["HOME", "XDG_STATE_HOME", "XDG_CONFIG_HOME"].map(|name| (name, home));
    std::fs::create_dir(folder.path("radar-chaperone")).unwrap();
    let [log, lock] = ["run.log", "run.lock"].map(|name| folder.path(&format!("radar-chaperone/{name}")));
    assert!(Command::new("mkfifo").arg(&log).status().unwrap().success());
    let outcome = folder.run_with("run", &variables).fails_with("SteamVR is not installed");
    assert!(
        outcome.err.contains("there is no log file") && outcome.err.contains("run.log: it is a folder"),
        "{outcome:?}"
    );
    std::fs::remove_file(&lock).unwrap();
    assert!(Command::new("mkfifo").arg(&lock).status().unwrap().success());
    folder
        .run_with("run", &variables)
        .fails_with("run.lock: it is a folder, a device or a pipe, not a file: remove it");
}
