use glam::DVec3;
use radar_chaperone::{geometry::*, imaging::*, obstacles::*, radar::*, simulation::*, tracking::*};
fn main() {
    for (motion, n) in [
        ("sphere-50cm", 50),
        ("sphere-10cm", 50),
        ("sphere-50cm", 0),
        ("sphere-10cm", 0),
        ("stationary", 50),
        ("x-50cm", 50),
        ("approach-1.0", 50),
    ] {
        let mut errs = vec![];
        let mut extra = 0;
        let mut s = String::new();
        let mut nees = vec![];
        let t = std::time::Instant::now();
        for seed in 0..20 {
            let mut sc = Scenario::new("corner-reflector", motion, preset("fine").unwrap(), 10.0, seed);
            sc.snr_db = Some(20.0);
            match std::env::args().nth(1).as_deref() {
                Some("none") => sc.errors = TrackingErrors::none(),
                Some("mount") => sc.errors.mount_m = 0.0,
                Some("wander") => sc.errors.wander_m = 0.0,
                Some("rot") => sc.errors.rotation_deg = 0.0,
                Some("jit") => sc.errors.jitter_m = 0.0,
                _ => {}
            }
            let sim = sc.run().unwrap();
            let settings = ObserverSettings {
                history: HistorySettings::default(),
                head_from_sensor: sc.head_from_sensor,
                time_offset_s: 0.0,
            };
            let (obs, _c) = observe_all(&sc.config, settings, &sim.frames, &sim.poses);
            let c = DVec3::new(0.0, 1.5, -1.5);
            let region = Aabb { min: c - 1.5, max: c + 1.5 };
            let set = ReflectorSettings { max_sweeps: n, ..Default::default() };
            let found = find_reflectors(&obs, &Beam::Lensless, &region, &set, &PositionErrors::default());
            let truth = sim.truth.obstacles[0].points_m[0];
            if let Some(o) = found.first() {
                let d = o.position_m - truth;
                errs.push(d.length() * 1e3);
                nees.push(d.dot(o.covariance_m2.inverse() * d));
                if seed < 2 {
                    s += &format!(
                        "  {:?} d {:.1?} mm cov sigma {:.1?} ev {:.0}\n",
                        o.observed,
                        (d * 1e3).to_array(),
                        [o.covariance_m2.x_axis.x, o.covariance_m2.y_axis.y, o.covariance_m2.z_axis.z]
                            .map(|v| v.sqrt() * 1e3),
                        o.evidence
                    );
                }
            }
            extra += found.len().saturating_sub(1);
        }
        errs.sort_by(f64::total_cmp);
        nees.sort_by(f64::total_cmp);
        println!(
            "{motion} N={n}: {} found, median {:.1} p95 {:.1} mm, extra {extra}, nees mean {:.1} median {:.1}, {:.1} s\n{s}",
            errs.len(),
            errs[errs.len() / 2],
            errs[errs.len() * 95 / 100],
            nees.iter().sum::<f64>() / nees.len() as f64,
            nees[nees.len() / 2],
            t.elapsed().as_secs_f64()
        );
    }
}
