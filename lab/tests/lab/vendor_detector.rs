//! The vendor's detector on the vendor's recording.

use a121::Frame;
use lab::baselines::{Sampling, VendorDetector};
use radar_mapping::range_axis;
use radar_recording::{ImportOptions, import_h5};
use radar_sar::PoseSample;

use crate::common::real_recording;

/// The vendor's method on the vendor's recording: the reflector in the tank slides along the
/// boresight; the track that comes with the recording gives its speed, from another subsweep's
/// envelope. Frames of one sweep make the windows.
#[test]
#[ignore = "needs the vendor's recordings in ../shared/recordings"]
fn vendor_detector_measures_range_and_speed_of_the_tank_reflector() {
    let [frames, track] = ["medium_tank.h5", "medium_tank_poses.tum"].map(real_recording);
    let import = import_h5(&frames, Some(&track), &ImportOptions::default()).unwrap();
    let (config, frames) = (&import.header.config, import.vendor.frames().collect::<Result<Vec<_>, _>>().unwrap());
    let position = |pose: &PoseSample| (pose.time_ns, pose.tracking_from_head().unwrap().translation.z);
    let poses: Vec<(i64, f64)> = import.poses().map(|pose| position(&pose.unwrap())).collect();
    // Profile 3: its subsweep follows that of profile 1.
    let (before, subsweep) = (config.subsweeps[0].num_points as usize, config.subsweeps[1]);
    let sweeps = |frame: &Frame| vec![frame.samples[before..before + subsweep.num_points as usize].to_vec()];
    let seconds = (frames[frames.len() - 1].host_time_ns - frames[0].host_time_ns) as f64 * 1e-9;
    let sampling = Sampling {
        axis: range_axis(&subsweep),
        profile: subsweep.profile,
        sweep_rate_hz: (frames.len() - 1) as f64 / seconds,
        sweeps: 16,
    };
    let calibration: Vec<_> = frames[..100].iter().flat_map(sweeps).collect();
    let mut detector = VendorDetector::new(sampling, &calibration);
    let (mut windows, mut distances, mut speeds) = (0, Vec::new(), Vec::new());
    for frame in &frames {
        let Some(result) = detector.push(&sweeps(frame)) else { continue };
        let middle_ns = frame.host_time_ns - (7.5 / sampling.sweep_rate_hz * 1e9) as i64;
        let at = poses.partition_point(|pose| pose.0 < middle_ns);
        if at < 4 || at + 4 >= poses.len() {
            continue;
        }
        let (early, late) = (poses[at - 4], poses[at + 4]);
        // The reflector stands still at z = −0.8 m: the sensor's way is its.
        let speed = (late.1 - early.1) / ((late.0 - early.0) as f64 * 1e-9);
        let distance = poses[at].1 + 0.8;
        let [near, far] = detector.range_m();
        if !(near + 0.02..far - 0.02).contains(&distance) || speed.abs() > 0.08 {
            continue;
        }
        windows += 1;
        if let Some(found) = result.reflections.first() {
            distances.push((found.distance_m - distance).abs());
            speeds.push((found.velocity_m_per_s - speed).abs());
        }
    }
    let median = |values: &mut Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    assert!(windows > 50 && distances.len() * 10 > windows * 9, "{windows} windows, {} seen", distances.len());
    let (distance, speed) = (median(&mut distances), median(&mut speeds));
    // A bin is 13 mm/s wide, and the reflector changes its speed within a window of 0.19 s.
    assert!(distance < 0.01 && speed < 0.0134, "{distance} m, {speed} m/s");
}
