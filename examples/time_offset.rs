//! draft
use radar_chaperone::imaging::*;
use radar_chaperone::radar::preset;
use radar_chaperone::simulation::{Scenario, TrackingErrors};
use radar_chaperone::tracking::*;

fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let (scene, preset_name, motion) = (args[0].as_str(), args[1].as_str(), args[2].as_str());
    let seeds: u64 = args[3].parse().unwrap();
    let marks: Vec<f64> = args[4].split(',').map(|x| x.parse().unwrap()).collect();
    let offsets: Vec<f64> = args[5].split(',').map(|x| x.parse().unwrap()).collect();
    let perfect = args.get(6).is_some_and(|a| a == "perfect");
    let each = args.get(6).is_some_and(|a| a == "each");
    let mut results: Vec<Vec<(f64, f64, bool)>> = vec![Vec::new(); marks.len()];
    let mut spent = 0.0;
    for offset in offsets {
        for seed in 100..100 + seeds {
            let mut scenario =
                Scenario::new(scene, motion, preset(preset_name).unwrap(), marks.last().unwrap().max(10.0), seed);
            if scene == "corner-reflector" {
                scenario.snr_db = Some(20.0);
            }
            scenario.time_offset_s = offset;
            if perfect {
                scenario.errors = TrackingErrors::none();
            }
            let sim = scenario.run().unwrap();
            let settings = ObserverSettings {
                history: HistorySettings::default(),
                head_from_sensor: scenario.head_from_sensor,
                time_offset_s: 0.0,
            };
            let mut observer = Observer::new(&scenario.config, settings);
            let mut est =
                TimeOffsetEstimator::new(TimeOffsetSettings { middle_s: 0.0, errors: PositionErrors::default() });
            let mut frames = sim.frames.iter().peekable();
            let start = std::time::Instant::now();
            let mut at = 0;
            for pose in &sim.poses {
                while let Some(f) = frames.next_if(|f| f.host_time_ns <= pose.time_ns) {
                    observer.push_frame(f.clone());
                }
                observer.push_pose(pose);
                for s in observer.take_path() {
                    est.push_path(s.time_ns, s.tracking_from_sensor.translation, s.velocity_m_per_s);
                }
                for o in observer.take_ready() {
                    est.push_sweep(&o);
                }
                if at < marks.len() && (pose.time_ns as f64 * 1e-9 - 1.0) > marks[at] + 0.15 {
                    if let Some(e) = est.estimate() {
                        if each {
                            println!(
                                "seed {seed} {offset} at {}: error {:.2} ms ± {:.2}, {} tracks, {} out",
                                marks[at],
                                (e.offset_s - offset) * 1e3,
                                e.sigma_s * 1e3,
                                e.tracks,
                                e.tracks_left_out
                            );
                        }
                        results[at].push((e.offset_s - offset, e.sigma_s, e.observable));
                    } else {
                        results[at].push((f64::NAN, f64::NAN, false));
                    }
                    at += 1;
                }
            }
            spent += start.elapsed().as_secs_f64();
        }
    }
    for (mark, r) in marks.iter().zip(&results) {
        let mut e: Vec<f64> = r.iter().map(|x| x.0.abs() * 1e3).filter(|x| x.is_finite()).collect();
        let mut s: Vec<f64> = r.iter().map(|x| x.1.abs() * 1e3).filter(|x| x.is_finite()).collect();
        e.sort_by(f64::total_cmp);
        s.sort_by(f64::total_cmp);
        let q = |e: &Vec<f64>, p: f64| {
            e.get(((e.len() as f64 * p) as usize).min(e.len().saturating_sub(1))).copied().unwrap_or(f64::NAN)
        };
        let nees: f64 = r.iter().map(|x| (x.0 / x.1).powi(2)).filter(|x| x.is_finite()).sum::<f64>() / e.len() as f64;
        let obs = r.iter().filter(|x| x.2).count();
        let mut oe: Vec<f64> = r.iter().filter(|x| x.2).map(|x| x.0.abs() * 1e3).collect();
        oe.sort_by(f64::total_cmp);
        println!(
            "{mark} s: n {} |e| {:.2}/{:.2} ms sigma {:.2}/{:.2} nees {:.2} observable {obs}/{} their |e| {:.2}/{:.2}",
            e.len(),
            q(&e, 0.5),
            q(&e, 0.95),
            q(&s, 0.5),
            q(&s, 0.95),
            nees,
            r.len(),
            q(&oe, 0.5),
            q(&oe, 0.95)
        );
    }
    println!("{spent:.2} s spent");
}
