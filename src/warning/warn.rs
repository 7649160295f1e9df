//! From the scene to what is drawn for one head pose. A pure function: the same scene, head and
//! settings give the same warnings.

use super::body_model::BodyModel;
use super::group::group_obstacles;
use super::hazard::{Hazard, WarningVisual};
use super::label::rounded_label;
use super::obstacle_body::ObstacleBody;
use super::panel::{Footprint, Panel, Warnings};
use super::settings::WarningSettings;
use super::urgency::urgencies;
use radar_mapping::{Scene, Wall};
use radar_sar::geometry::Pose;

/// Largest number of quads at a time, panels and footprints together. Choice: each is an overlay
/// that the compositor draws.
pub const MAX_QUADS: usize = 8;

/// Panels and footprints of everything near enough, brightest first, then nearest; at most
/// [`MAX_QUADS`]. Never panics: an invalid head pose gives nothing, invalid obstacles and walls are
/// ignored. It uses no hands and no velocities and does not fade. For a live scene use
/// [`super::WarningTracker`].
pub fn warn(scene: &Scene, tracking_from_head: &Pose, settings: &WarningSettings) -> Warnings {
    let body_model = BodyModel::still(tracking_from_head);
    body_model.map_or_else(Warnings::default, |body_model| {
        warnings_of_hazards(&bodies(scene), &scene.walls, &body_model, settings)
    })
}

/// Geometries of all obstacles, grouped where they lie close together, and of the moving targets.
pub(super) fn bodies(scene: &Scene) -> Vec<ObstacleBody> {
    let standing = group_obstacles(&scene.obstacles);
    standing
        .iter()
        .filter_map(ObstacleBody::of)
        .chain(scene.moving.iter().filter_map(ObstacleBody::of_moving))
        .collect()
}

/// Warnings of these obstacles and walls for a wearer who stands upright and still.
fn warnings_of_hazards(
    bodies: &[ObstacleBody],
    walls: &[Wall],
    body_model: &BodyModel,
    settings: &WarningSettings,
) -> Warnings {
    let hazards = bodies.iter().map(Hazard::Object).chain(walls.iter().map(Hazard::Wall));
    let drawn = hazards.filter_map(|hazard| {
        let [body, _] = urgencies(&hazard.proximities(body_model, settings), settings);
        let (near, urgency) = body.map(|urgency| (urgency.near, urgency.value()))?;
        let alpha = settings.alpha_of(urgency * hazard.brightness(settings));
        let mut drawn = (alpha > 0.0).then(|| hazard.draw(body_model, &near, alpha, settings, None))??;
        drawn.panel.label_m = settings.labels.then(|| rounded_label(near.gap_m));
        Some(drawn)
    });
    sorted_by_brightness(drawn)
}

/// Brightest first, then nearest; at most [`MAX_QUADS`].
pub(super) fn sorted_by_brightness(drawn: impl Iterator<Item = WarningVisual>) -> Warnings {
    let mut all: Vec<(Panel, Option<Footprint>)> = drawn.map(|drawn| (drawn.panel, drawn.footprint)).collect();
    all.sort_by(|(a, _), (b, _)| {
        b.alpha.total_cmp(&a.alpha).then(a.distance_m.total_cmp(&b.distance_m)).then(a.id.cmp(&b.id))
    });
    let (panels, footprints): (Vec<_>, Vec<_>) = all.into_iter().unzip();
    Warnings { panels, footprints: footprints.into_iter().flatten().collect() }.at_most(MAX_QUADS)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::warning::PanelKind;
    use glam::{DMat3, DQuat, DVec3};
    use proptest::prelude::*;
    use radar_mapping::{MovingTarget, Observed, Obstacle, Wall};
    use radar_sar::geometry::{Aabb, Plane};

    /// Head at 1.6 m, looking along −z.
    fn head() -> Pose {
        Pose::from_translation(DVec3::new(0.0, 1.6, 0.0))
    }

    /// A box of 0.3 × 0.9 × 0.3 m standing on the floor, its near side at `z`, in voxels of 5 cm.
    fn chair(id: u64, x: f64, z: f64) -> Obstacle {
        let shape = (0..6 * 18 * 6)
            .map(|i| DVec3::new((i % 6).into(), (i / 6 % 18).into(), -f64::from(i / 108)))
            .map(|v| (v * 0.05 + DVec3::new(x - 0.125, 0.025, z - 0.025), 1.0))
            .collect();
        Obstacle {
            id,
            position_m: DVec3::new(x, 0.45, z - 0.15),
            covariance_m2: DMat3::from_diagonal(DVec3::splat(1e-4)),
            observed: Observed::Position,
            extent_m: DVec3::new(0.3, 0.9, 0.3),
            evidence: 10.0,
            shape,
            provisional: false,
            first_seen_ns: 0,
            last_seen_ns: 0,
        }
    }

    fn wall(outward: DVec3, offset_m: f64) -> Wall {
        let seen_at = Aabb::from_corners(DVec3::new(-2.0, 1.5, -2.0), DVec3::new(2.0, 1.7, 2.0));
        let plane = Plane { outward, offset_m };
        Wall { id: 9, plane, evidence: 5.0, seen_at, provisional: false, first_seen_ns: 0, last_seen_ns: 0 }
    }

    fn warnings_of(obstacles: Vec<Obstacle>, walls: Vec<Wall>) -> Warnings {
        warn(&Scene { time_ns: 0, obstacles, walls, moving: vec![] }, &head(), &WarningSettings::default())
    }

    /// A person 1.2 m ahead.
    fn someone(speed_m_per_s: f64) -> MovingTarget {
        MovingTarget {
            id: 1,
            seen_from: head(),
            range_m: 1.2,
            range_sigma_m: 0.1,
            direction_sigma_rad: 0.3,
            speed_m_per_s,
            evidence: 30.0,
            first_seen_ns: 0,
            last_seen_ns: 0,
        }
    }

    #[test]
    fn moving_target_panel_is_as_wide_as_direction_uncertainty() {
        let settings = WarningSettings::default();
        let of = |moving: MovingTarget, settings: &WarningSettings| {
            let scene = Scene { obstacles: vec![chair(1, 2.0, 3.0)], moving: vec![moving], ..Scene::default() };
            warn(&scene, &head(), settings)
        };
        let [comes, stands] = [-1.0, 0.0].map(|speed| of(someone(speed), &settings));
        let [panel] = &comes.panels[..] else { panic!("{comes:?}") };
        assert!(panel.kind == PanelKind::Object && panel.silhouette.is_empty() && panel.size_m.x > 1.0, "{panel:?}");
        assert!(panel.time_to_contact_s.is_some_and(|s| (0.5..1.2).contains(&s)), "{panel:?}");
        // A short time to contact is brighter than distance alone, and the obstacle with the same
        // id is another hazard.
        assert!(panel.alpha > stands.panels[0].alpha && panel.id != 1);
        assert!(of(someone(-1.0), &WarningSettings { moving: false, ..settings.clone() }).panels.is_empty());
        for bad in [MovingTarget { range_m: f64::NAN, ..someone(-1.0) }, someone(f64::NAN)] {
            assert!(of(bad, &settings).panels.iter().all(|panel| panel.alpha.is_finite()));
        }
    }

    #[test]
    fn panel_is_between_head_and_obstacle_facing_the_head() {
        let panel = &warnings_of(vec![chair(1, 0.0, -0.8)], vec![]).panels[0];
        let position = panel.tracking_from_panel.translation;
        assert!(position.z < 0.0 && position.z > -0.8 && position.z < -0.7, "{position}");
        assert!(position.x.abs() < 0.06, "{position}");
        assert!((panel.tracking_from_panel.rotation * DVec3::Z - DVec3::Z).length() < 0.02);
        assert!((position.y - panel.size_m.y / 2.0).abs() < 1e-9, "it stands on the floor");
        assert!(panel.size_m.y >= 0.9 && panel.size_m.y < 1.2 && panel.size_m.x >= 0.3 && panel.size_m.x < 0.7);
        assert!(!panel.silhouette.is_empty() && panel.silhouette.len() <= 384);
    }

    #[test]
    fn obstacles_out_of_reach_of_the_play_area_are_excluded() {
        let shown = |area_m: [f64; 2], obstacles: Vec<Obstacle>, walls: Vec<Wall>| {
            let settings = WarningSettings { play_area_m: Some(area_m), play_area_margin_m: 0.2, ..Default::default() };
            !warn(&Scene { time_ns: 0, obstacles, walls, moving: vec![] }, &head(), &settings).panels.is_empty()
        };
        assert!(shown([2.0, 1.4], vec![chair(1, 0.0, -0.8)], vec![]), "its near side is 0.1 m outside");
        assert!(!shown([2.0, 1.0], vec![chair(1, 0.0, -0.8)], vec![]));
        assert!(shown([2.0, 1.2], vec![], vec![wall(DVec3::NEG_Z, 0.7)]));
        assert!(!shown([2.0, 0.8], vec![], vec![wall(DVec3::NEG_Z, 0.7)]));
    }

    #[test]
    fn past_the_boundary_of_the_play_area_everything_near_is_warned_of() {
        let settings = WarningSettings { play_area_m: Some([2.0, 1.0]), play_area_margin_m: 0.2, ..Default::default() };
        let scene =
            Scene { obstacles: vec![chair(1, 0.0, -1.3)], walls: vec![wall(DVec3::NEG_Z, 1.5)], ..Scene::default() };
        let shown = |z: f64| {
            let at = Pose::new(DVec3::new(0.0, 1.6, z), DQuat::IDENTITY);
            let kinds = warn(&scene, &at, &settings).panels.iter().map(|panel| panel.kind).collect::<Vec<_>>();
            (kinds.contains(&PanelKind::Object), kinds.contains(&PanelKind::Wall))
        };
        assert_eq!(shown(-0.45), (false, false));
        assert_eq!(shown(-0.75), (true, true));
        // Beyond the wall's plane as well, which the wearer may have passed by a door or by a wrong wall.
        assert!(shown(-1.6).1);
    }

    #[test]
    fn low_obstacles_leave_the_view_above_them_free() {
        let panel_height_m = |height_m: f64| {
            let mut sofa = chair(1, 0.0, -0.8);
            sofa.shape.retain(|(point, _)| point.y < height_m);
            warnings_of(vec![sofa], vec![]).panels[0].size_m.y
        };
        assert!((0.5..=0.6).contains(&panel_height_m(0.4)), "{}", panel_height_m(0.4));
        assert!((0.8..=1.2).contains(&panel_height_m(1.0)), "{}", panel_height_m(1.0));
    }

    #[test]
    fn panels_transform_with_the_scene() {
        let scene = Scene {
            time_ns: 0,
            obstacles: vec![chair(1, 0.1, -0.8)],
            walls: vec![wall(DVec3::NEG_Z, 0.9)],
            moving: vec![],
        };
        let to_from = Pose::new(DVec3::new(0.7, 0.0, -0.4), DQuat::from_rotation_y(0.9));
        let settings = WarningSettings::default();
        let before = warn(&scene, &head(), &settings);
        let moved = warn(&scene.moved(&to_from), &(to_from * head()), &settings);
        assert_eq!(before.panels.len(), moved.panels.len());
        for (was, is) in before.panels.iter().zip(&moved.panels) {
            let expected = to_from.transform_point(was.tracking_from_panel.translation);
            // Sizes and a wall's edges are rounded to steps, which differ in a turned frame.
            assert!(is.tracking_from_panel.translation.distance(expected) < 0.15, "{:?}", is.kind);
            assert!((is.distance_m - was.distance_m).abs() < 1e-9, "{} {}", is.distance_m, was.distance_m);
        }
    }

    #[test]
    fn brightness_falls_with_obstacle_distance() {
        assert_eq!(warnings_of(vec![chair(1, 0.0, -0.3)], vec![]).panels[0].alpha, 1.0);
        assert_eq!(warnings_of(vec![chair(1, 0.0, -1.7)], vec![]), Warnings::default());
        let alpha = |z| warnings_of(vec![chair(1, 0.0, z)], vec![]).panels[0].alpha;
        assert!(alpha(-0.6) > alpha(-0.9) && alpha(-0.9) > alpha(-1.2));
    }

    #[test]
    fn low_obstacle_at_the_feet_counts_as_near() {
        let mut stool = chair(1, 0.0, -0.35);
        stool.shape.retain(|(p, _)| p.y < 0.4);
        assert_eq!(warnings_of(vec![stool], vec![]).panels[0].alpha, 1.0);
    }

    #[test]
    fn panel_width_follows_direction_uncertainty() {
        let width = |sigma_m: f64| {
            let mut obstacle = chair(1, 0.0, -0.8);
            obstacle.covariance_m2 = DMat3::from_diagonal(DVec3::new(sigma_m * sigma_m, 1e-6, 1e-6));
            warnings_of(vec![obstacle], vec![]).panels[0].size_m.x
        };
        assert!(width(0.1) >= width(0.0) + 0.35);
        assert!(width(0.3) > width(0.1));
        assert_eq!(width(1e9), 2.5, "capped");
        let mut unknown = chair(1, 0.0, -0.8);
        unknown.observed = Observed::RangeOnly;
        let warnings = warnings_of(vec![unknown], vec![]);
        assert!(warnings.panels[0].size_m.x > 1.0 && warnings.panels[0].silhouette.is_empty());
    }

    #[test]
    fn missing_shape_falls_back_to_extent_box() {
        let mut plain = chair(1, 0.0, -0.8);
        plain.shape.clear();
        let panel = &warnings_of(vec![plain], vec![]).panels[0];
        assert!((panel.distance_m - 0.8).abs() < 0.1, "{}", panel.distance_m);
        assert!(panel.silhouette.len() > 10);
    }

    #[test]
    fn footprint_is_counter_clockwise_from_above() {
        let corners = &warnings_of(vec![chair(1, 0.2, -0.8)], vec![]).footprints[0].corners_xz_m;
        let area: f64 = (0..corners.len())
            .map(|i| {
                let (a, b) = (corners[i], corners[(i + 1) % corners.len()]);
                (a.x * -b.y - -a.y * b.x) / 2.0
            })
            .sum();
        assert!(area > 0.09 && area < 0.15, "{area} m²");
    }

    #[test]
    fn wall_panel_lies_in_the_wall_with_a_fixed_grid() {
        let at = |x: f64| {
            let head = Pose::from_translation(DVec3::new(x, 1.6, 0.0));
            let scene = Scene { walls: vec![wall(DVec3::NEG_Z, 0.7)], ..Default::default() };
            warn(&scene, &head, &WarningSettings::default()).panels[0].clone()
        };
        let panel = at(0.0);
        assert_eq!(panel.kind, PanelKind::Wall);
        assert!((panel.tracking_from_panel.translation - DVec3::new(0.0, 1.1, -0.7)).length() < 1e-9);
        assert_eq!(panel.size_m.y, 2.2);
        assert!((panel.distance_m - 0.7).abs() < 1e-12);
        assert_eq!(panel.tracking_from_panel, at(0.03).tracking_from_panel);
        assert!(at(3.0).size_m.x < 1.0, "only what was seen");
        let beyond = Pose::from_translation(DVec3::new(0.0, 1.6, -0.9));
        let scene = Scene { walls: vec![wall(DVec3::NEG_Z, 0.7)], ..Default::default() };
        let behind = warn(&scene, &beyond, &WarningSettings::default()).panels[0].clone();
        assert!((behind.tracking_from_panel.rotation * DVec3::Z - DVec3::NEG_Z).length() < 1e-9, "it faces the head");
        assert_eq!(behind.alpha, 1.0);
        assert_eq!(warnings_of(vec![], vec![wall(DVec3::NEG_Y, 0.3), wall(DVec3::Y, 2.4)]), Warnings::default());
    }

    #[test]
    fn nearest_eight_are_shown() {
        // Poles around the head, too far apart to be grouped.
        let many = (0..10).map(|i| {
            let (sin, cos) = (i as f64 * std::f64::consts::TAU / 10.0).sin_cos();
            let distance_m = 1.4 - 0.01 * i as f64;
            let mut pole = chair(i, distance_m * sin, 0.15 - distance_m * cos);
            pole.shape.retain(|(point, _)| {
                (point.x - pole.position_m.x).abs().max((point.z - pole.position_m.z).abs()) < 0.05
            });
            pole
        });
        let many: Vec<_> = many.collect();
        let few = warnings_of(many.iter().step_by(2).cloned().collect(), vec![]);
        assert_eq!((few.panels.len(), few.footprints.len()), (5, 3), "footprints take what room is left");
        assert_eq!(few.footprints[0].id, few.panels[0].id);
        let warnings = warnings_of(many, vec![]);
        assert_eq!(warnings.panels.len(), MAX_QUADS);
        assert!(warnings.panels.windows(2).all(|w| w[0].alpha >= w[1].alpha));
        assert!(warnings.panels.windows(2).all(|w| w[0].distance_m <= w[1].distance_m));
        assert_eq!(warnings.footprints, []);
    }

    #[test]
    fn head_sway_rarely_changes_the_texture() {
        let scene = Scene { obstacles: vec![chair(1, 0.0, -0.8)], ..Default::default() };
        let pictures: Vec<_> = (0..90)
            .map(|k| {
                let sway = glam::DVec2::from_angle(f64::from(k) / 90.0 * std::f64::consts::TAU) * 0.005;
                let head = Pose::from_translation(DVec3::new(0.1 + sway.x, 1.6, sway.y));
                let panel = warn(&scene, &head, &WarningSettings::default()).panels.remove(0);
                (panel.size_m, panel.silhouette)
            })
            .collect();
        let changes = pictures.windows(2).filter(|pair| pair[0] != pair[1]).count();
        assert!(changes <= 2, "{changes} new textures in one second");
    }

    #[test]
    fn picture_changes_every_fifteen_degrees() {
        let scene = Scene { obstacles: vec![chair(1, 0.0, 0.15)], ..Default::default() };
        let panels: Vec<_> = (0..3600)
            .map(|k| {
                let around = glam::DVec2::from_angle(f64::from(k) / 3600.0 * std::f64::consts::TAU) * 0.9;
                let head = Pose::from_translation(DVec3::new(around.x, 1.6, around.y));
                warn(&scene, &head, &WarningSettings::default()).panels.remove(0)
            })
            .collect();
        let changes = panels.windows(2).filter(|p| (p[0].size_m, &p[0].silhouette) != (p[1].size_m, &p[1].silhouette));
        assert!((12..=30).contains(&changes.count()), "a picture for each direction");
        let leap = panels
            .windows(2)
            .map(|p| p[0].tracking_from_panel.translation.distance(p[1].tracking_from_panel.translation));
        assert!(leap.fold(0.0, f64::max) < 0.06, "the panel goes around smoothly, but for steps of its size");
    }

    #[test]
    fn wall_normal_is_renormalised() {
        let outward = DVec3::new(0.94, 0.0, -0.342);
        assert_eq!(warnings_of(vec![], vec![wall(outward, 0.7)]).panels.len(), 1);
        assert_eq!(warnings_of(vec![], vec![wall(outward * 3.0, 0.7)]).panels.len(), 0);
    }

    fn any_number() -> impl Strategy<Value = f64> {
        prop_oneof![
            8 => -2.0..2.0f64,
            1 => prop::sample::select(vec![0.0, -0.0, 1e-300, 1e300, -1e9, f64::NAN, f64::INFINITY, f64::NEG_INFINITY]),
        ]
    }

    fn any_point() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(any_number()).prop_map(DVec3::from_array)
    }

    fn any_obstacle() -> impl Strategy<Value = Obstacle> {
        let observed =
            prop::sample::select(vec![Observed::Position, Observed::RangeAndOneDirection, Observed::RangeOnly]);
        let shape = prop::collection::vec((any_point(), 0.0f32..9.0), 0..12);
        let covariance = prop::array::uniform9(any_number());
        (any_point(), covariance, any_point(), observed, shape).prop_map(
            |(position_m, c, extent_m, observed, shape)| {
                let covariance_m2 = DMat3::from_cols_array(&c);
                Obstacle { position_m, covariance_m2, extent_m, observed, shape, ..chair(3, 0.0, 0.0) }
            },
        )
    }

    fn any_wall() -> impl Strategy<Value = Wall> {
        (any_point(), any_number(), any_point(), any_point()).prop_map(|(outward, offset_m, min, max)| {
            let outward = outward.try_normalize().unwrap_or(outward);
            Wall { seen_at: Aabb { min, max }, ..wall(outward, offset_m) }
        })
    }

    fn is_sound(panel: &Panel) -> bool {
        panel.tracking_from_panel.translation.is_finite()
            && panel.tracking_from_panel.rotation.is_normalized()
            && panel.size_m.is_finite()
            && panel.size_m.min_element() > 0.0
            && panel.silhouette.iter().all(|(c, r)| c.is_finite() && *r > 0.0 && r.is_finite())
            && panel.alpha > 0.0
            && panel.alpha <= 1.0
            && panel.distance_m.is_finite()
    }

    proptest! {
        #[test]
        fn arbitrary_input_gives_valid_panels(
            obstacles in prop::collection::vec(any_obstacle(), 0..6),
            walls in prop::collection::vec(any_wall(), 0..3),
            position in any_point(),
            turn in prop::array::uniform4(any_number()),
            (full, fade, grid) in (any_number(), any_number(), any_number()),
        ) {
            let settings = WarningSettings {
                full_distance_m: full,
                fade_distance_m: fade,
                grid_spacing_m: grid,
                ..Default::default()
            };
            let head = Pose { translation: position, rotation: DQuat::from_array(turn) };
            let scene = Scene { time_ns: 0, obstacles, walls, moving: vec![] };
            let warnings = warn(&scene, &head, &settings);
            prop_assert!(warnings.panels.iter().all(is_sound), "{warnings:?}");
            for footprint in &warnings.footprints {
                let corners = &footprint.corners_xz_m;
                prop_assert!(corners.len() >= 3 && corners.iter().all(|c| c.is_finite()));
            }
        }
    }
}
