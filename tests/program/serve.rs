//! `simulate --serve` with a client that implements only the protocol, over TCP and over a
//! pseudo-terminal.

use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;
use std::os::unix::fs::FileTypeExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
use serde_json::{Value, json};

use crate::common::Folder;

const PATIENCE: Duration = Duration::from_secs(20);

/// The serving program; killed when dropped.
struct Serving(Child);

impl Serving {
    fn start(folder: &Folder, line: &str) -> Self {
        let child = Command::new(env!("CARGO_BIN_EXE_radar-chaperone"))
            .args(line.split_whitespace())
            .current_dir(folder.path(""))
            .stdin(Stdio::null())
            .stdout(File::create(folder.path("out.txt")).unwrap())
            .stderr(File::create(folder.path("err.txt")).unwrap())
            .spawn()
            .unwrap();
        Self(child)
    }

    /// Sends Ctrl-C and returns the output.
    fn end(mut self, folder: &Folder) -> String {
        let id = rustix::process::Pid::from_child(&self.0);
        rustix::process::kill_process(id, rustix::process::Signal::INT).unwrap();
        let begin = Instant::now();
        while self.0.try_wait().unwrap().is_none() {
            assert!(begin.elapsed() < PATIENCE, "does not exit");
            sleep(Duration::from_millis(5));
        }
        assert_eq!(String::from_utf8(folder.read("err.txt")).unwrap(), "");
        String::from_utf8(folder.read("out.txt")).unwrap()
    }
}

impl Drop for Serving {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A protocol client on a port.
struct Client<T> {
    port: T,
    held: Vec<u8>,
}

impl<T: Read + Write> Client<T> {
    fn new(port: T) -> Self {
        Self { port, held: Vec::new() }
    }

    fn send(&mut self, command: Value) {
        self.port.write_all(format!("{command}\n").as_bytes()).unwrap();
    }

    fn fill(&mut self, begin: Instant) {
        assert!(begin.elapsed() < PATIENCE, "no answer; held {:?}", String::from_utf8_lossy(&self.held));
        let mut buffer = [0; 4096];
        match self.port.read(&mut buffer) {
            Ok(count) if count > 0 => self.held.extend(&buffer[..count]),
            Err(error) if error.kind() == ErrorKind::WouldBlock => sleep(Duration::from_millis(1)),
            other => panic!("{other:?}"),
        }
    }

    /// The next message that is no log line: header and payload.
    fn hear(&mut self) -> (Value, Vec<u8>) {
        let begin = Instant::now();
        loop {
            let Some(end) = self.held.iter().position(|byte| *byte == b'\n') else {
                self.fill(begin);
                continue;
            };
            let header: Value = serde_json::from_slice(&self.held[..end]).unwrap();
            let count = header["payload_size"].as_u64().unwrap_or(0) as usize;
            if self.held.len() < end + 1 + count {
                self.fill(begin);
                continue;
            }
            let rest = self.held.split_off(end + 1 + count);
            let message = std::mem::replace(&mut self.held, rest);
            if header["status"] != "log" {
                return (header, message[end + 1..].to_vec());
            }
        }
    }

    fn ask(&mut self, command: Value) -> Value {
        self.send(command);
        self.hear().0
    }

    /// Sets up, streams a second's frames and stops.
    fn stream(&mut self) {
        let config = json!({"sweeps_per_frame": 16, "sweep_rate": 0.0, "frame_rate": 66.0,
            "inter_frame_idle_state": "ready", "inter_sweep_idle_state": "ready",
            "subsweeps": [{"start_point": 80, "num_points": 50, "step_length": 24, "profile": 3, "hwaas": 16,
                "phase_enhancement": true, "prf": "15_6_MHz"}]});
        let reply = self.ask(json!({"cmd": "setup", "groups": [[{"sensor_id": 1, "config": config}]]}));
        assert_eq!(reply["metadata"][0][0]["frame_data_length"], 800, "{reply}");
        assert_eq!(self.ask(json!({"cmd": "start_streaming"}))["status"], "start");
        let (begin, mut frames): (Instant, Vec<(u32, bool, Vec<u8>)>) = (Instant::now(), Vec::new());
        while frames.len() < 66 {
            let (header, payload) = self.hear();
            assert_eq!(payload.len(), 3200, "{header}");
            let info = &header["result_info"][0][0];
            frames.push((info["tick"].as_u64().unwrap() as u32, info["frame_delayed"] == true, payload));
        }
        // Not faster than the clock, whatever else the machine does.
        assert!(begin.elapsed() > Duration::from_millis(900), "{:?}", begin.elapsed());
        // Evenly spaced ticks but for frames that the board says it took late because this client did not
        // read, and no frame twice.
        let mut even = 0;
        for pair in frames.windows(2) {
            let (step, is_delayed) = (pair[1].0.wrapping_sub(pair[0].0), pair[1].1);
            let is_even = (15_000..15_300).contains(&step);
            assert!((is_even || is_delayed && step > 15_000) && pair[0].2 != pair[1].2, "{step}");
            even += usize::from(is_even);
        }
        assert!(even > 20, "{even}");
        self.send(json!({"cmd": "stop_streaming"}));
        while self.hear().0["status"] != "stop" {}
    }
}

fn until<T>(mut there: impl FnMut() -> Option<T>) -> T {
    let begin = Instant::now();
    loop {
        if let Some(value) = there() {
            return value;
        }
        assert!(begin.elapsed() < PATIENCE, "no board is served");
        sleep(Duration::from_millis(5));
    }
}

/// Opens a serial port as a client does: raw and non-blocking.
fn open_terminal(path: &Path, baud: u32) -> File {
    let file = File::options().read(true).write(true).open(path).unwrap();
    let mut modes = tcgetattr(&file).unwrap();
    modes.make_raw();
    modes.set_speed(baud).unwrap();
    tcsetattr(&file, OptionalActions::Now, &modes).unwrap();
    rustix::io::ioctl_fionbio(&file, true).unwrap();
    file
}

#[test]
fn client_streams_over_tcp_while_poses_are_written() {
    let folder = Folder::new("serve_tcp");
    let port = 20_000 + (std::process::id() % 10_000) as u16;
    let serving = Serving::start(
        &folder,
        &format!("simulate furnished-room --serve tcp:127.0.0.1:{port} --poses-out poses.tum --faults saturate=600"),
    );
    for _ in 0..2 {
        let stream = until(|| TcpStream::connect(("127.0.0.1", port)).ok());
        stream.set_nonblocking(true).unwrap();
        let mut client = Client::new(stream);
        let info = client.ask(json!({"cmd": "get_system_info"}));
        assert_eq!(info["system_info"]["ticks_per_second"], 1_000_000);
        client.stream();
    }
    let out = serving.end(&folder);
    assert!(out.contains(&format!("record --port tcp:127.0.0.1:{port} --poses poses.tum")), "{out}");
    assert!(out.contains("Clients  2, 8 commands") && out.contains("saturate"), "{out}");
    let track = String::from_utf8(folder.read("poses.tum")).unwrap();
    let times: Vec<f64> = track.lines().skip(1).map(|line| line.split(' ').next().unwrap().parse().unwrap()).collect();
    assert!(times.len() > 200 && times.windows(2).all(|t| (t[1] - t[0] - 1.0 / 120.0).abs() < 1e-6));
    assert!(track.lines().skip(1).all(|line| line.split(' ').count() == 8));
}

#[test]
fn client_streams_repeatedly_over_a_pseudo_terminal() {
    let folder = Folder::new("serve_pty");
    let serving = Serving::start(&folder, "simulate nothing --serve pty:board --board xm125 --duration-s 50");
    let path = folder.path("board");
    until(|| std::fs::metadata(&path).ok().filter(|there| there.file_type().is_char_device()));
    for _ in 0..2 {
        let mut client = Client::new(open_terminal(&path, 115_200));
        let info = client.ask(json!({"cmd": "get_system_info"}));
        assert_eq!(info["system_info"]["max_baudrate"], 2_000_000);
        assert_eq!(client.ask(json!({"cmd": "set_uart_baudrate", "baudrate": 1_000_000}))["status"], "ok");
        // At the old speed the board sees a break and restarts; at the new speed it answers.
        let mut modes = tcgetattr(&client.port).unwrap();
        modes.set_speed(1_000_000).unwrap();
        tcsetattr(&client.port, OptionalActions::Now, &modes).unwrap();
        assert_eq!(client.ask(json!({"cmd": "get_sensor_info"}))["sensor_info"][0]["connected"], true);
        modes.set_speed(115_200).unwrap();
        tcsetattr(&client.port, OptionalActions::Now, &modes).unwrap();
        assert_eq!(client.ask(json!({"cmd": "start_streaming"}))["message"], "not set up");
    }
    serving.end(&folder);
    let serving = Serving::start(&folder, "simulate nothing --serve pty:board");
    until(|| std::fs::metadata(&path).ok());
    let mut client = Client::new(open_terminal(&path, 115_200));
    client.stream();
    let out = serving.end(&folder);
    assert!(out.contains("Faults   none") && std::fs::symlink_metadata(&path).is_err(), "{out}");
}

#[test]
fn track_out_equals_the_poses_written_while_serving() {
    let folder = Folder::new("serve_track");
    let serving = Serving::start(
        &folder,
        "simulate furnished-room --motion approach-chair --serve pty:board --duration-s 60 --start-in-s 0.5 \
         --track-out track.tum --poses-out poses.tum --dropouts-per-minute 300",
    );
    let path = folder.path("board");
    until(|| std::fs::metadata(&path).ok().filter(|there| there.file_type().is_char_device()));
    let times = |text: &str| -> Vec<f64> {
        text.lines().skip(1).map(|line| line.split(' ').next().unwrap().parse().unwrap()).collect()
    };
    let track = String::from_utf8(folder.read("track.tum")).unwrap();
    let written = || String::from_utf8(folder.read("poses.tum")).unwrap();
    until(|| Some(()).filter(|()| written().lines().count() > 100));
    let out = serving.end(&folder);
    let origin = out.lines().find_map(|line| line.strip_prefix("The motion begins at ")).unwrap();
    let origin_s: f64 = origin.split(' ').next().unwrap().parse().unwrap();
    let all = times(&track);
    assert!((all[0] - origin_s).abs() < 1.0 && (all[all.len() - 1] - origin_s - 60.0).abs() < 1.0);
    assert!(all.iter().map(|t| (t - origin_s) * 120.0).all(|n| (n - n.round()).abs() < 1e-4));
    // Lost tracking leaves a gap.
    assert!(all.len() < 7000 && all.windows(2).any(|t| t[1] - t[0] > 0.05), "{}", all.len());
    let meanwhile = written();
    let complete = meanwhile.lines().count() - 1;
    assert!(meanwhile.lines().take(complete).eq(track.lines().take(complete)));
}

#[test]
fn an_unplugged_board_comes_back_under_its_name() {
    let folder = Folder::new("serve_unplug");
    let serving =
        Serving::start(&folder, "simulate nothing --serve pty:board --faults unplug=60 --seed 3 --duration-s 40");
    let path = folder.path("board");
    let first = until(|| std::fs::read_link(&path).ok());
    until(|| std::fs::read_link(&path).is_err().then_some(()));
    let second = until(|| std::fs::read_link(&path).ok());
    assert!(first.starts_with("/dev/pts") && second.starts_with("/dev/pts"));
    assert!(serving.end(&folder).contains("unplug"));
}

#[test]
fn places_that_cannot_be_served_are_refused() {
    let folder = Folder::new("serve_refused");
    folder.write("taken", "a file");
    for (arguments, message) in [
        ("--serve tcp:0.0.0.0:6110", "0.0.0.0:6110 can be reached from other computers: use 127.0.0.1"),
        ("--serve tcp:localhost", "is not an address to serve a board at: write pty:PATH, or tcp:"),
        ("--serve udp:1", "is not an address to serve a board at"),
        ("--serve pty:", "is not an address to serve a board at"),
        ("--serve pty:taken", "taken exists and is not a link to a terminal"),
        ("--serve pty:missing/board", "cannot serve at missing/board"),
        ("--serve pty:board --faults fly=1", "fault \"fly\" is not known: use drop, double"),
        ("--serve pty:board --faults flip", "\"flip\" is not a fault: write kind=times-a-minute"),
        ("--serve pty:board --faults flip=1e9", "1000000000 times a minute: give 0 to 6000"),
        ("--serve pty:board --duration-s 0", "a duration of 0 s cannot be served"),
        ("--serve pty:board --board xe999", "invalid value 'xe999' for '--board"),
        ("--serve pty:board --out x.mcap", "cannot be used with"),
        ("--serve pty:board --preset d16", "cannot be used with"),
        ("--serve pty:board --poses-out missing/p.tum", "there is no folder missing: make it, or choose"),
        ("--out x.mcap --faults flip=1", "--faults is for serving: give --serve PLACE in place of --out"),
        ("--serve pty:board --track-out t.tum", "--track-out writes the whole track beforehand: give --duration-s"),
        ("--serve pty:board --track-out t.tum --duration-s 4000", "give --duration-s, at most 3600 s"),
        ("--serve pty:board --start-in-s -1", "unexpected argument"),
        ("--serve pty:board --start-in-s=-1", "--start-in-s -1: give 0 to 3600"),
        ("--serve pty:board --motion approach-chair", "needs a chair to walk up to"),
        ("--out x.mcap --board xm125", "--board is for serving"),
    ] {
        folder.run(&format!("simulate nothing {arguments}")).fails_with(message);
    }
    assert_eq!(folder.read("taken"), b"a file");
    assert!(std::fs::symlink_metadata(folder.path("board")).is_err() && !folder.path("x.mcap").exists());
}
