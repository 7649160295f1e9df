use glam::DVec3;
use radar_chaperone::{geometry::*, imaging::blocks::*, obstacles::*, radar::*, simulation::*, tracking::*};
use std::collections::VecDeque;
fn main() {
    let arg = |n: usize, d: f64| std::env::args().nth(n).and_then(|a| a.parse().ok()).unwrap_or(d);
    let seeds = arg(1, 3.0) as u64;
    let confirm = arg(2, 6.0);
    let block_s = arg(3, 0.09);
    let pmin = arg(4, 7.0);
    let scene = std::env::args().nth(5).unwrap_or("furnished-room".into());
    let (mut due, mut found_n, mut ghosts_t, mut rep_t) = (0, 0, 0, 0);
    let mut errs: Vec<f64> = vec![];
    let (mut pdue, mut pfound) = (0, 0);
    for seed in 0..seeds {
        let sc = Scenario::new(&scene, "natural", preset("d16").unwrap(), 30.0, seed);
        let t0 = std::time::Instant::now();
        let sim = sc.run().unwrap();
        let t_sim = t0.elapsed().as_secs_f64();
        let settings = ObserverSettings {
            history: HistorySettings::default(),
            head_from_sensor: sc.head_from_sensor,
            time_offset_s: 0.0,
        };
        let t0 = std::time::Instant::now();
        let (obs, c) = observe_all(&sc.config, settings, &sim.frames, &sim.poses);
        let t_obs = t0.elapsed().as_secs_f64();
        let bs = BlockSettings { block_s, ..Default::default() };
        let es = ExplainSettings { plane_min_score: pmin, ..Default::default() };
        let ms = MapSettings { confirm_score: confirm, ..Default::default() };
        let min_cos = bs.min_cos(&sc.beam);
        let mut field = Field::new(bs, min_cos);
        let mut planes = PlaneField::new(bs, min_cos);
        let mut builder = BlockBuilder::new(bs);
        let mut window: VecDeque<Block> = VecDeque::new();
        let mut map: Sightings<DVec3> = Default::default();
        let mut walls: Sightings<Plane> = Default::default();
        let (mut t_field, mut t_planes, mut t_exp) = (0.0, 0.0, 0.0);
        let mut next = 0i64;
        let mut max_noise: f64 = 0.0;
        for o in obs {
            if let Some(b) = builder.push(o) {
                let t = std::time::Instant::now();
                field.add(&b);
                t_field += t.elapsed().as_secs_f64();
                let t = std::time::Instant::now();
                planes.add(&b);
                t_planes += t.elapsed().as_secs_f64();
                let now = b.mid_time_ns;
                window.push_back(b);
                while window.front().is_some_and(|w| w.mid_time_ns < now - 4_000_000_000) {
                    window.pop_front();
                }
                if now >= next {
                    let t = std::time::Instant::now();
                    next = now + 250_000_000;
                    let since = now - 4_000_000_000;
                    let pp: Vec<Plane> = planes.peaks(pmin, 13, since).iter().map(|p| p.plane).collect();
                    let mut pk: Vec<DVec3> = field.peaks(2.5, 0.15, since).iter().map(|p| p.position_m).collect();
                    pk.truncate(400);
                    let mut w = Window::new(window.iter(), &es, &bs, min_cos);
                    let ep = w.explain_planes(&pp);
                    let ex = w.explain_points(&pk);
                    max_noise = max_noise.max(ex.first().map_or(0.0, |e| e.score));
                    walls.update(&ep, &ms, same_plane(DVec3::new(0.0, 1.2, 0.0)));
                    map.update(&ex, &ms, same_place(0.15));
                    t_exp += t.elapsed().as_secs_f64();
                }
            }
        }
        let near = |p: DVec3| {
            // nearest truth
            sim.truth
                .obstacles
                .iter()
                .enumerate()
                .flat_map(|(i, o)| o.points_m.iter().map(move |q| (q.distance(p), i)))
                .min_by(|a, b| a.0.total_cmp(&b.0))
                .unwrap_or((9.0, 0))
        };
        let wall_near = |p: DVec3| sim.truth.walls.iter().map(|w| w.extent.distance(p)).fold(9.0, f64::min);
        let reps: Vec<_> = map.confirmed().collect();
        let ghosts: Vec<_> = reps.iter().filter(|r| near(r.thing).0 > 0.25 && wall_near(r.thing) > 0.25).collect();
        println!(
            "seed {seed}: sim {t_sim:.1} obs {t_obs:.1} field {t_field:.1} planes {t_planes:.1} explain {t_exp:.1} s, updates {} M; reports {} ghosts {} max {max_noise:.1} sat {}",
            field.updates / 1_000_000,
            reps.len(),
            ghosts.len(),
            c.frames_saturated
        );
        for g in &ghosts {
            println!(
                "   ghost {:.2?} score {:.1} near {:.2} wall {:.2}",
                g.thing.to_array(),
                g.score,
                near(g.thing).0,
                wall_near(g.thing)
            );
        }
        for w in walls.confirmed() {
            println!("   wall {:.3?} off {:.2} score {:.1}", w.thing.outward.to_array(), w.thing.offset_m, w.score);
        }
        ghosts_t += ghosts.len();
        rep_t += reps.len();
        for o in &sim.truth.obstacles {
            let best = reps
                .iter()
                .map(|r| o.points_m.iter().map(|q| q.distance(r.thing)).fold(9.0, f64::min))
                .fold(9.0, f64::min);
            println!(
                "   {:14} closest {:.2} in beam {:.1} s  nearest report {:.3}",
                o.name, o.closest_approach_m, o.in_beam_s, best
            );
            if o.closest_approach_m <= 1.0 {
                due += 1;
                if best <= 0.10 {
                    found_n += 1;
                }
                errs.push(best);
                for q in &o.points_m {
                    pdue += 1;
                    if reps.iter().any(|r| r.thing.distance(*q) < 0.1) {
                        pfound += 1;
                    }
                }
            }
        }
    }
    errs.sort_by(f64::total_cmp);
    println!(
        "found {found_n}/{due}, points {pfound}/{pdue}, ghosts {ghosts_t} of {rep_t}, median err {:.3} p90 {:.3}",
        errs.get(errs.len() / 2).unwrap_or(&0.0),
        errs.get(errs.len() * 9 / 10).unwrap_or(&0.0)
    );
}
