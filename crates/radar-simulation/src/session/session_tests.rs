use super::*;
use a121::{noise_rms_lsb, preset};

fn session(seed: u64, duration_s: f64) -> Session {
    PlaySession { duration_s, ..PlaySession::new(preset("d16").unwrap(), seed) }.prepare().unwrap()
}

#[test]
fn same_seed_gives_same_session_on_any_thread_count() {
    let (a, b) = (session(3, 4.0), session(3, 4.0));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert_eq!(a.frames(100..120), pool.install(|| b.frames(100..120)));
    assert!(a.poses().eq(b.poses()));
    assert_ne!(a.frames(100..101), session(4, 4.0).frames(100..101));
    assert_eq!(a.frame_count(), a.frames(0..a.frame_count()).len() as u64);
}

fn physical(world: PlayWorld, seed: u64, duration_s: f64) -> Session {
    let play = PlaySession { duration_s, world, ..PlaySession::new(preset("d16").unwrap(), seed) };
    play.prepare().unwrap()
}

#[test]
fn physical_frames_depend_on_neither_threads_nor_ranges() {
    for world in [PlayWorld::Office, PlayWorld::Dining, PlayWorld::Living] {
        let session = physical(world, 5, 4.0);
        let whole = session.frames(100..110);
        let parts = [session.frames(100..104), session.frames(104..110)].concat();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert_eq!(whole, parts);
        assert_eq!(whole, pool.install(|| session.frames(100..110)));
        // The player looks at something in four seconds.
        let all = session.frames(0..session.frame_count());
        assert_eq!(whole, all[100..110]);
        let noise = noise_rms_lsb(&session.play.config.subsweeps[0]);
        let strongest = all.iter().flat_map(|frame| &frame.samples).map(|s| f64::from(s.re).hypot(f64::from(s.im)));
        let strongest = strongest.fold(0.0, f64::max) / noise;
        assert!(strongest > 5.0, "{world:?} is silent: {strongest} times the noise");
    }
}

#[test]
fn players_of_physical_worlds_come_near_furniture_and_walk_through_none() {
    for world in [PlayWorld::Office, PlayWorld::Dining, PlayWorld::Living] {
        for seed in 0..4 {
            let session = physical(world, seed, 120.0);
            assert!(session.things().iter().any(|object| object.until_s.is_finite()));
            assert!(session.things().iter().any(|object| object.thing.name == "soft chair"));
            let level = |p: DVec3| DVec3::new(p.x, 0.0, p.z);
            let mut nearest_m = f64::INFINITY;
            for n in 0..1200 {
                let head = session.player.head_at(f64::from(n) * 0.1).translation;
                let away = session.before.scatterers().map(|s| level(s.position_m).distance(level(head)));
                nearest_m = away.fold(nearest_m, f64::min);
            }
            assert!((0.12..0.7).contains(&nearest_m), "{world:?} {seed}: {nearest_m}");
        }
    }
}

#[test]
fn motion_is_continuous_and_avoids_furniture() {
    for seed in 0..4 {
        let session = session(seed, 60.0);
        let parts = |t: f64| session.moving_at(t).iter().map(|s| s.position_m).collect::<Vec<_>>();
        for n in 0..6000 {
            let (t, next) = (f64::from(n) * 0.01, f64::from(n + 1) * 0.01);
            let head = session.player.head_at(t);
            assert!(head.translation.distance(session.player.head_at(next).translation) < 0.03, "seed {seed} at {t}");
            let (now, then) = (parts(t), parts(next));
            if now.len() == then.len() {
                let step = now.iter().zip(&then).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
                assert!(step < 0.09, "seed {seed} at {t}: {step}");
            }
            let body = |p: DVec3| DVec3::new(p.x - head.translation.x, 0.0, p.z - head.translation.z).length();
            let nearest = session.before.scatterers().map(|s| body(s.position_m)).fold(f64::INFINITY, f64::min);
            assert!(nearest > 0.15, "seed {seed} at {t}: {nearest}");
        }
    }
}

#[test]
fn player_approaches_furniture_and_visitor_crosses_twice() {
    let session = session(1, 120.0);
    let times: Vec<f64> = (0..1200).map(|n| f64::from(n) * 0.1).collect();
    let level = |a: DVec3, b: DVec3| DVec3::new(a.x - b.x, 0.0, a.z - b.z).length();
    let objects = session.things();
    let near = objects.iter().filter(|session_object| {
        let nearest = |t: &f64| {
            let head = session.head_at(*t).translation;
            session_object.thing.scatterers.iter().map(|s| level(s.position_m, head)).fold(f64::INFINITY, f64::min)
        };
        times.iter().map(nearest).fold(f64::INFINITY, f64::min) < 0.5
    });
    assert!(near.count() >= 3);
    let there: Vec<bool> = times.iter().map(|t| !session.visitor_at(*t).is_empty()).collect();
    assert_eq!(there.windows(2).filter(|w| !w[0] && w[1]).count(), 2);
    let gone = session.things().iter().filter(|session_object| session_object.until_s == 60.0).count();
    assert_eq!(gone, 1);
}

#[test]
fn reported_coordinates_are_the_room_transformed() {
    let session = session(2, 20.0);
    let turned_rad = session.tracking_from_room.rotation.to_scaled_axis();
    assert!(turned_rad.x.hypot(turned_rad.z) < 1e-12 && turned_rad.y.abs() > 0.01, "{turned_rad}");
    for time_s in [0.0, 7.3, 15.0] {
        let (tracked, room) = (session.sensor_at(time_s), session.sensor_in_room(time_s));
        let tracked_scatterers =
            session.things().into_iter().flat_map(|session_object| &session_object.thing.scatterers);
        for (there, here) in tracked_scatterers.zip(session.before.scatterers()) {
            let towards = |from: &Pose, to: &Scatterer| {
                let way = to.position_m - from.translation;
                DVec3::new(way.length(), way.normalize().dot(from.forward()), to.rcs_towards_dbsm(-way.normalize()))
            };
            assert!(towards(&tracked, there).distance(towards(&room, here)) < 1e-9);
        }
        for (wall, panel) in session.walls().iter().zip(&session.before.walls) {
            let away_m = wall.plane.distance(tracked.translation);
            assert!((away_m - panel.plane.distance(room.translation)).abs() < 1e-9);
            assert!((wall.distance_m(tracked.translation) - panel.extent.distance(room.translation)).abs() < 1e-9);
        }
    }
}

#[test]
fn objects_are_illuminated_unless_hidden_out_of_the_beam_or_gone() {
    let session = physical(PlayWorld::Dining, 3, 40.0);
    let room = session.physical.as_ref().unwrap();
    let from_tracking = session.tracking_from_room.inverse();
    let (mut illuminated, mut hidden_parts, mut strong) = (0, 0, 0);
    for n in 0..100 {
        let time_s = f64::from(n) * 0.4;
        let sensor = session.sensor_at(time_s);
        for (index, object) in session.things().into_iter().enumerate() {
            let in_beam = object.thing.scatterers.iter().filter(|part| session.is_in_beam(&sensor, part.position_m));
            let is_open = |part: &&Scatterer| {
                let [from_m, to_m] = [sensor.translation, part.position_m].map(|m| from_tracking.transform_point(m));
                room.has_line_of_sight(time_s >= object.until_s, from_m, to_m)
            };
            let (open, hidden): (Vec<&Scatterer>, Vec<&Scatterer>) = in_beam.partition(is_open);
            let is_illuminated = session.is_illuminated(index, time_s);
            assert_eq!(is_illuminated, !open.is_empty() && time_s < object.until_s);
            illuminated += u32::from(is_illuminated);
            hidden_parts += hidden.len();
            strong += u32::from(is_illuminated && session.echo_snr_db(index, time_s) > 0.0);
            if time_s >= object.until_s {
                assert_eq!((is_illuminated, session.echo_snr_db(index, time_s)), (false, f64::NEG_INFINITY));
            }
        }
    }
    assert!(illuminated > 20 && hidden_parts > 100, "{illuminated} {hidden_parts}");
    assert!((1..illuminated).contains(&strong), "{strong} of {illuminated}");
}
