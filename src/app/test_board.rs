//! A small fake board for the tests of this module: canned answers and small frames at a steady
//! rate, over a socket or a pseudo-terminal that can be unplugged and replugged.

use std::io::{Read, Write};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{JoinHandle, sleep, spawn};
use std::time::{Duration, Instant};

use serialport::{SerialPort, TTYPort};

use a121::Setup;
use a121::{SensorConfig, Subsweep, preset};

/// Samples per frame. Choice: small, so that the tests measure the reader and not the line.
pub(super) const SAMPLES: usize = 40;
/// Interval of frames. Choice: hundreds of frames within a test of seconds.
const PERIOD: Duration = Duration::from_millis(5);

/// The set-up that the tests request.
pub(super) fn setup() -> Setup {
    let d16 = preset("d16").unwrap();
    let subsweeps = vec![Subsweep { num_points: 10, ..d16.subsweeps[0] }];
    Setup::single(1, SensorConfig { sweeps_per_frame: 4, frame_rate: Some(200.0), subsweeps, ..d16 })
}

/// A fake board in its own thread; dropping it ends the thread.
pub(super) struct TestBoard {
    pulled: Arc<AtomicBool>,
    over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    link: Option<PathBuf>,
}

impl TestBoard {
    /// Listens on a free local port; returns the address as `host:port`.
    pub fn on_tcp() -> (Self, String) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        // While unplugged, nothing listens.
        let mut listener = Some(listener);
        let board = Self::start(None, move |pulled| {
            if pulled {
                listener = None;
                return None;
            }
            let listener = listener.get_or_insert_with(|| TcpListener::bind(address).unwrap());
            listener.set_nonblocking(true).unwrap();
            let (socket, _) = listener.accept().ok()?;
            socket.set_nonblocking(false).unwrap();
            socket.set_read_timeout(Some(Duration::from_millis(1))).unwrap();
            Some(socket)
        });
        (board, address.to_string())
    }

    /// Behind a symbolic link of this name to its current terminal.
    pub fn on_terminal(link: &Path) -> Self {
        let path = link.to_owned();
        let board = Self::start(Some(path.clone()), move |pulled| {
            let _ = std::fs::remove_file(&path);
            if pulled {
                return None;
            }
            let (mut ours, theirs) = TTYPort::pair().unwrap();
            std::os::unix::fs::symlink(theirs.name().unwrap(), &path).unwrap();
            ours.set_timeout(Duration::from_millis(1)).unwrap();
            Some(ours)
        });
        while !link.exists() {
            sleep(Duration::from_millis(1));
        }
        board
    }

    /// Unplugs it until it is plugged in again.
    pub fn pull(&self) {
        self.pulled.store(true, Ordering::Relaxed);
    }

    pub fn plug_in(&self) {
        self.pulled.store(false, Ordering::Relaxed);
    }

    fn start<W: Read + Write>(link: Option<PathBuf>, open: impl FnMut(bool) -> Option<W> + Send + 'static) -> Self {
        let (pulled, over) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicBool::new(false)));
        let (is_pulled, is_over, mut open) = (Arc::clone(&pulled), Arc::clone(&over), open);
        let thread = spawn(move || {
            while !is_over.load(Ordering::Relaxed) {
                match open(is_pulled.load(Ordering::Relaxed)) {
                    Some(wire) => serve(wire, || is_pulled.load(Ordering::Relaxed) || is_over.load(Ordering::Relaxed)),
                    None => sleep(Duration::from_millis(2)),
                }
            }
        });
        Self { pulled, over, thread: Some(thread), link }
    }
}

impl Drop for TestBoard {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        let _ = self.thread.take().unwrap().join();
        if let Some(link) = &self.link {
            let _ = std::fs::remove_file(link);
        }
    }
}

/// Serves one client until it disconnects or the board is unplugged.
fn serve(mut wire: impl Read + Write, is_gone: impl Fn() -> bool) {
    let (mut line, mut buffer, mut next_frame, mut count) = (Vec::new(), [0; 4096], None::<Instant>, 0u32);
    while !is_gone() {
        match wire.read(&mut buffer) {
            Ok(0) => return,
            Ok(read) => line.extend_from_slice(&buffer[..read]),
            Err(error) if error.kind() == std::io::ErrorKind::ConnectionReset => return,
            // A terminal that nobody has opened yet also gives errors.
            Err(_) => sleep(Duration::from_micros(100)),
        }
        while let Some(end) = line.iter().position(|&byte| byte == b'\n') {
            let command: Vec<u8> = line.drain(..=end).collect();
            let text = String::from_utf8_lossy(&command);
            let _ = wire.write_all(answer(&text).as_bytes());
            if text.contains("start_streaming") {
                next_frame = Some(Instant::now() + PERIOD);
            } else if text.contains("stop_streaming") {
                next_frame = None;
            }
        }
        if next_frame.is_some_and(|at| Instant::now() >= at) {
            next_frame = next_frame.map(|at| at + PERIOD);
            count += 1;
            let _ = wire.write_all(&frame(count));
        }
    }
}

fn answer(command: &str) -> String {
    let answers = [
        (
            "get_system_info",
            "{\"status\":\"ok\",\"system_info\":{\"rss_version\":\"a121-v1.12.0\",\"sensor\":\"a121\",\
             \"sensor_count\":1,\"ticks_per_second\":1000000,\"hw\":\"xc120\"}}",
        ),
        ("get_sensor_info", "{\"status\":\"ok\",\"sensor_info\":[{\"connected\":true}]}"),
        (
            "\"setup\"",
            "{\"status\":\"ok\",\"tick_period\":0,\"metadata\":[[{\"frame_data_length\":40,\
             \"sweep_data_length\":10}]]}",
        ),
        ("start_streaming", "{\"status\":\"start\"}"),
        ("stop_streaming", "{\"status\":\"stop\"}"),
    ];
    let known = answers.iter().find(|(name, _)| command.contains(name));
    format!("{}\n", known.map_or("{\"status\":\"error\",\"message\":\"what?\"}", |(_, answer)| answer))
}

fn frame(count: u32) -> Vec<u8> {
    let line = format!(
        "{{\"result_info\":[[{{\"tick\":{},\"data_saturated\":false,\"temperature\":25,\"calibration_needed\":false,\
         \"frame_delayed\":false}}]],\"status\":\"ok\",\"payload_size\":{}}}\n",
        count * PERIOD.as_micros() as u32,
        4 * SAMPLES
    );
    let samples = (0..2 * SAMPLES).flat_map(|n| (count as i16).wrapping_add(n as i16).to_le_bytes());
    line.into_bytes().into_iter().chain(samples).collect()
}
