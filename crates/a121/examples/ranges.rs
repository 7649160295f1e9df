//! Range of the strongest return, frame by frame, from a board on a port or from a simulated one.
//!
//!     cargo run --release -p a121 --features simulated-board --example ranges -- [PORT]
//!
//! PORT is a path such as /dev/ttyACM0, a name such as COM3, or tcp:HOST[:PORT]. `simulated`, the
//! default, serves a board on a local socket that sees one reflector move between 0.5 and 1.5 m.
//! Prints 100 frames of preset d16: time, range, and amplitude in LSB (rms over the frame's
//! sweeps). Against a board whose serial line is slower than USB, use preset c16 or slow-link.

use std::time::{Duration, Instant};

use a121::{Action, Event, Frame, FrameLayout, Line, SensorConfig, Session, Setup, find, preset};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let port = std::env::args().nth(1).filter(|port| port != "simulated").map_or_else(simulated::serve, Ok)?;
    let place = find::choose(Some(&port), &find::list_ports())?;
    let config = preset("d16").ok_or("there is no such preset")?;
    let (layout, start) = (FrameLayout::of(&config), Instant::now());
    let now_ns = || start.elapsed().as_nanos() as i64;
    let mut line = Line::open(&place.address)?;
    let mut session = Session::new(Setup::single(1, config.clone()), place.link(None), now_ns())?;
    let (mut buffer, mut frames) = (vec![0; 64 << 10], 0);
    while !session.is_over() {
        while let Some(action) = session.next_action() {
            line.perform(&action)?;
            if action == Action::Reopen {
                drop(line);
                line = Line::open(&place.address)?;
                session.line_opened(now_ns());
            }
        }
        let wait_ns = session.next_deadline_ns().saturating_sub(now_ns()).clamp(0, 100_000_000);
        let count = line.read(&mut buffer, Duration::from_nanos(wait_ns as u64))?;
        if count > 0 {
            session.receive(&buffer[..count], now_ns());
        }
        session.poll(now_ns());
        while let Some(event) = session.next_event() {
            match event {
                Event::Frames(of_sensors) => {
                    for frame in of_sensors.iter().map(|of| &of.frame) {
                        print_strongest(&config, &layout, frame);
                        frames += 1;
                    }
                    if frames == 100 {
                        session.stop(now_ns());
                    }
                }
                Event::Trouble(error) => eprintln!("{error}; trying again"),
                Event::Failed(error) => return Err(error.into()),
                other => eprintln!("{other:?}"),
            }
        }
    }
    Ok(())
}

fn print_strongest(config: &SensorConfig, layout: &FrameLayout, frame: &Frame) {
    let Some(sweeps) = layout.sweeps(frame) else { return };
    let mut power = vec![0.0; config.points_per_sweep()];
    for sweep in sweeps {
        for (sum, sample) in power.iter_mut().zip(sweep.samples) {
            *sum += f64::from(sample.re).powi(2) + f64::from(sample.im).powi(2);
        }
    }
    let Some((point, sum)) = power.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)) else { return };
    let subsweep = &config.subsweeps[0];
    let range_m = subsweep.first_m() + point as f64 * subsweep.step_m();
    let rms = (sum / f64::from(config.sweeps_per_frame)).sqrt();
    println!("{:8.3} s  {range_m:.2} m  {rms:6.0} LSB", frame.host_time_ns as f64 * 1e-9);
}

/// A simulated board, served on a thread of its own.
mod simulated {
    use a121::device::{Board, Device, FaultPlan, FrameRequest, SampleSource, ServeAddress, Server};
    use a121::monotonic_ns;
    use num_complex::Complex;

    /// Starts it; returns its port.
    pub fn serve() -> Result<String, Box<dyn std::error::Error>> {
        let address = ServeAddress::parse("tcp:127.0.0.1:6110", false)?;
        let device = Device::new(Board::Xc120, Box::new(MovingReflector), FaultPlan::default(), 1, monotonic_ns());
        let (port, mut server) = (address.port(), Server::open(address, device)?);
        std::thread::spawn(move || while server.step(i64::MAX).is_ok() {});
        Ok(port)
    }

    /// One reflector that goes to and fro within two seconds.
    struct MovingReflector;

    impl SampleSource for MovingReflector {
        fn frame(&mut self, request: &FrameRequest, samples: &mut Vec<Complex<i16>>) -> bool {
            let subsweep = &request.config.subsweeps[0];
            let distance_m = 1.0 + 0.5 * (request.end_ns as f64 * 1e-9 * std::f64::consts::PI).sin();
            let sample = |point: u32| {
                let off_m = subsweep.first_m() + f64::from(point) * subsweep.step_m() - distance_m;
                let pulse = 0.5f64.powf(4.0 * (off_m / subsweep.profile.envelope_fwhm_m()).powi(2));
                Complex::new((2000.0 * pulse) as i16, 0)
            };
            let sweep: Vec<_> = (0..subsweep.num_points).map(sample).collect();
            (0..request.config.sweeps_per_frame).for_each(|_| samples.extend(&sweep));
            false
        }
    }
}
