//! Moving targets in play sessions, through the whole mapper: a visitor is shown, nobody else is,
//! and the rest of the scene does not change.

use a121::preset;
use glam::DVec3;
use radar_chaperone::settings::Settings;
use radar_mapping::Mapper;
use radar_mapping::in_time_order;
use radar_mapping::{MovingTarget, Scene};
use radar_simulation::{PlaySession, Session};

fn session(seed: u64, duration_s: f64, visitor: bool) -> Session {
    let play = PlaySession { duration_s, visitor, ..PlaySession::new(preset("d16").unwrap(), seed) };
    play.prepare().unwrap()
}

/// Plays a session. `on_update` is called after each update of the map with the time, seconds, and the
/// scene.
fn played(session: &Session, changes: &[&str], mut on_update: impl FnMut(f64, Scene)) {
    let changes: Vec<String> = changes.iter().map(|change| (*change).to_owned()).collect();
    let settings = Settings::from_toml("", &changes).unwrap();
    let play = session.play();
    let mut mapper = Mapper::new(&play.config, &play.head_from_sensor, &settings.mapping());
    for event in in_time_order(session.frames(0..session.frame_count()), session.poses()) {
        mapper.push(event).unwrap();
        if let Some(scene) = mapper.poll_scene() {
            let evidence_ns = mapper.evidence_ns().unwrap_or(0);
            on_update((evidence_ns - Session::host_ns(0.0)) as f64 * 1e-9, scene);
        }
    }
}

/// Difference between a reported range and that of the nearest part of a person, metres.
fn off_m(moving: &MovingTarget, parts: &[DVec3]) -> f64 {
    let ranges = parts.iter().map(|part| part.distance(moving.seen_from.translation));
    ranges.map(|range_m| (range_m - moving.range_m).abs()).fold(f64::INFINITY, f64::min)
}

#[test]
fn visitor_is_shown_at_the_right_range_and_static_scene_is_unchanged() {
    let session = session(14, 20.0, true);
    let (mut shown, mut off) = (0, 0);
    let mut standing = Vec::new();
    played(&session, &[], |time_s, scene| {
        for one in &scene.moving {
            let recent = (0..12).map(|n| session.visitor_at(time_s - f64::from(n) * 0.1));
            let nearest_m = recent.map(|parts| off_m(one, &parts)).fold(f64::INFINITY, f64::min);
            (shown, off) = (shown + 1, off + usize::from(nearest_m > 0.5));
        }
        standing.push((scene.obstacles, scene.walls));
    });
    // The visitor crosses twice, in and out of the beam; there are four updates per second.
    assert!(shown >= 4 && off * 4 <= shown, "shown {shown} times, {off} of them where nobody is");
    let mut without = Vec::new();
    played(&session, &["rooms.moving.enabled=false"], |_, scene| {
        assert!(scene.moving.is_empty());
        without.push((scene.obstacles, scene.walls));
    });
    assert_eq!(standing, without, "the static scene must not depend on the search for moving targets");
}

#[test]
fn no_moving_target_without_a_visitor() {
    // Hands move all the time with untracked controllers; the player turns, steps and crouches. One
    // minute in all: a rate of three false targets per hour would still pass nineteen times of
    // twenty.
    for seed in [40, 41, 42] {
        played(&session(seed, 20.0, false), &[], |time_s, scene| {
            assert!(scene.moving.is_empty(), "seed {seed}, {time_s:.1} s: {:?}", scene.moving);
        });
    }
}
