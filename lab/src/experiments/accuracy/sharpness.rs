//! How sharp sub-apertures are with tracked poses, against the same sweeps with true poses.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use super::quantile;
use radar_chaperone::report::Table;
use radar_chaperone::settings::Settings;
use radar_mapping::{ObserverSettings, observe_all};
use radar_sar::Observation;
use radar_sar::geometry::Pose;
use radar_sar::subaperture::{PointSubaperture, SubapertureBuilder, SubapertureSettings};
use radar_simulation::{PlaySession, Session, TrackingErrors};

/// Power of an echo over the noise from which it counts. Choice: 17 dB, so that noise moves its peak by less than 2 %.
const MIN_POWER: f32 = 50.0;
/// Span of the difference that gives the true velocity, seconds. Choice: rounding of positions stays below 1 µm/s.
const VELOCITY_SPAN_S: f64 = 1e-3;
/// Steps by which a peak is sought, metres. Choice: from half of a peak's width across the beam to a thirtieth of it.
const STEPS_M: [f64; 5] = [16e-3, 8e-3, 4e-3, 2e-3, 1e-3];
/// Sub-apertures of the window over which an image adds up. Choice: as many as the map's 4 s hold.
const WINDOW: usize = 40;

/// One row per kind of tracking: the peaks of single scatterers in play, in one sub-aperture and over a window of them.
///
/// # Panics
/// The session cannot be simulated.
pub fn sharpness_table(session: &PlaySession, kinds: &[(&str, TrackingErrors)], seeds: &Range<u64>) -> Table {
    let row = |(name, errors): &(&str, TrackingErrors)| {
        let errors = TrackingErrors { mount_m: 0.0, ..*errors };
        let of_seed = |seed: u64| {
            let session = PlaySession { seed, errors, ..session.clone() };
            peaks(&session.prepare().unwrap_or_else(|error| panic!("{error}")))
        };
        let rooms: Vec<[Vec<f64>; 2]> = seeds.clone().into_par_iter().map(of_seed).collect();
        let shares = [0, 1].map(|n| rooms.iter().flat_map(|room| room[n].iter().copied()).collect::<Vec<f64>>());
        let percent = |values: &mut Vec<f64>, share: f64| format!("{:.1}", 100.0 * quantile(values, share));
        let [mut single, mut window] = shares;
        let count = single.len().to_string();
        let cells = [&mut single, &mut window].map(|values| [percent(values, 0.5), percent(values, 0.1)]);
        [(*name).to_owned(), count].into_iter().chain(cells.into_iter().flatten()).collect()
    };
    let head = ["tracking", "peaks", "sub-aperture (%)", "lowest tenth (%)", "window (%)", "lowest tenth (%)"];
    let caption =
        "Power of a scatterer's peak, in per cent of what the same sweeps give with true poses: median and 10 %. \
        sub-aperture: one of 90 ms. window: the sum of all within 4 s."
            .into();
    Table { head: head.map(str::to_owned).to_vec(), rows: kinds.iter().map(row).collect(), caption }
}

/// A sub-aperture with tracked and with true poses.
struct Pair {
    tracked: PointSubaperture,
    truth: PointSubaperture,
}

/// Shares of the true peaks' power: of single sub-apertures, of windows.
fn peaks(session: &Session) -> [Vec<f64>; 2] {
    let pairs = pairs(session);
    let things = session.things();
    let scatterers: Vec<DVec3> = things
        .iter()
        .filter(|object| object.until_s.is_infinite())
        .flat_map(|object| object.thing.scatterers.iter().map(|part| part.position_m))
        .collect();
    let mut shares = [Vec::new(), Vec::new()];
    for window in pairs.chunks(WINDOW) {
        for place in &scatterers {
            let seen: Vec<&Pair> =
                window.iter().filter(|pair| pair.truth.coherence_at(*place).power > MIN_POWER).collect();
            let Some(first) = seen.first() else { continue };
            shares[0].push(peak_share(&[*first], *place));
            // A peak that a single sub-aperture shows says nothing about the window.
            if seen.len() > 3 {
                shares[1].push(peak_share(&seen, *place));
            }
        }
    }
    shares
}

/// Highest power near a place with tracked poses, in units of that with true ones.
fn peak_share(pairs: &[&Pair], place: DVec3) -> f64 {
    let middle = pairs[pairs.len() / 2];
    let tracked_from_true = *middle.tracked.middle() * middle.truth.middle().inverse();
    let sum = |at: DVec3, of: fn(&Pair) -> &PointSubaperture| -> f64 {
        pairs.iter().map(|pair| f64::from(of(pair).coherence_at(at).power)).sum()
    };
    let tracked = climb(tracked_from_true.transform_point(place), |at| sum(at, |pair| &pair.tracked));
    tracked / climb(place, |at| sum(at, |pair| &pair.truth))
}

/// The greatest value that is reached by steps along the axes.
fn climb(mut at: DVec3, value: impl Fn(DVec3) -> f64) -> f64 {
    let mut best = value(at);
    for step_m in STEPS_M {
        loop {
            let next = DVec3::AXES.into_iter().flat_map(|axis| [at + axis * step_m, at - axis * step_m]);
            let (highest, place) =
                next.map(|place| (value(place), place)).max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((0.0, at));
            if highest <= best {
                break;
            }
            (best, at) = (highest, place);
        }
    }
    best
}

/// All sub-apertures of a session.
fn pairs(session: &Session) -> Vec<Pair> {
    let play = session.play();
    let history = Settings::default().tracking.history;
    let settings =
        ObserverSettings { history, head_from_sensor: play.head_from_sensor, time_offset_s: 0.0, range_bias_m: None };
    let frames = session.frames(0..session.frame_count());
    let poses: Vec<_> = session.poses().collect();
    let (observations, _) = observe_all(&play.config, settings, &frames, &poses);
    let mut builders: Vec<[SubapertureBuilder; 2]> = Vec::new();
    let mut pairs = Vec::new();
    for observation in observations {
        let subsweep = observation.geometry.subsweep;
        while builders.len() <= subsweep {
            builders.push([(); 2].map(|()| SubapertureBuilder::new(SubapertureSettings::default())));
        }
        let truth = with_true_pose(session, &observation);
        let [tracked_builder, true_builder] = &mut builders[subsweep];
        let closed = tracked_builder.push(observation).zip(true_builder.push(truth));
        pairs.extend(closed.map(|(tracked, truth)| Pair {
            tracked: PointSubaperture::of(&tracked, None),
            truth: PointSubaperture::of(&truth, None),
        }));
    }
    pairs
}

fn with_true_pose(session: &Session, observation: &Observation) -> Observation {
    let time_s = (observation.mid_time_ns - Session::host_ns(0.0)) as f64 * 1e-9;
    let at = |offset_s: f64| -> Pose { session.sensor_at(time_s + offset_s) };
    let half_s = VELOCITY_SPAN_S / 2.0;
    let velocity_m_per_s = (at(half_s).translation - at(-half_s).translation) / VELOCITY_SPAN_S;
    Observation { tracking_from_sensor: at(0.0), velocity_m_per_s, ..observation.clone() }
}
