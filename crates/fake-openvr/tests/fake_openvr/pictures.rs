//! Images of the fake runtime, compared with the expected corners and colours of quads, which are
//! computed here from the matrices of the interface.

use glam::{DMat4, DVec2, DVec3};
use image::RgbImage;
use serde_json::{Value, json};

use crate::gpu::Gpu;
use crate::rig::{Rig, alone};
use crate::runtime::{Runtime, call, from_matrix, placed, to_matrix};
use crate::sys;

const STANDING: u32 = sys::ETrackingUniverseOrigin_TrackingUniverseStanding;
const SRGB: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8UnormSrgb;
const SIZE: [u32; 2] = [480, 540];
const BACKGROUND: [f64; 3] = [0.003, 0.004, 0.006];
const RED: [u8; 3] = [255, 0, 0];
const GREEN: [u8; 3] = [0, 255, 0];
const BLUE: [u8; 3] = [0, 0, 255];
const GREY: [u8; 3] = [128, 128, 128];

/// A small image, and a head at rest that is rotated and tilted.
fn config() -> Value {
    let turn = glam::DQuat::from_rotation_y(0.3) * glam::DQuat::from_rotation_x(-0.2);
    let [x, y, z, w] = turn.to_array();
    let track = format!(
        "0 0.2 1.5 0.4 {x} {y} {z} {w}
"
    );
    json!({ "files": { "rest.tum": track }, "track": "rest.tum", "display": { "shot_size": SIZE } })
}

/// An eye, from the matrices of the interface.
struct Eye {
    eye_from_standing: DMat4,
    /// Tangents at the left, right, upper and lower edge.
    edges: [f64; 4],
}

fn eyes(runtime: &Runtime) -> [Eye; 2] {
    let standing_from_head = runtime.head(STANDING);
    [sys::EVREye_Eye_Left, sys::EVREye_Eye_Right].map(|eye| {
        let head_from_eye = from_matrix(&call!(runtime.system, GetEyeToHeadTransform, eye));
        let (mut left, mut right, mut top, mut bottom) = (0.0, 0.0, 0.0, 0.0);
        call!(runtime.system, GetProjectionRaw, eye, &mut left, &mut right, &mut top, &mut bottom);
        // The interface's "top" is the lower edge.
        let edges = [left, right, bottom, top].map(f64::from);
        Eye { eye_from_standing: (standing_from_head * head_from_eye).inverse(), edges }
    })
}

impl Eye {
    /// Pixel of a point, from the upper left.
    fn pixel(&self, point: DVec3) -> DVec2 {
        let p = self.eye_from_standing.transform_point3(point);
        assert!(p.z < 0.0, "{p} is behind the eye");
        self.direction_pixel(DVec2::new(p.x, p.y) / -p.z)
    }

    /// Pixel of a direction given by its tangents.
    fn direction_pixel(&self, tangents: DVec2) -> DVec2 {
        let [left, right, up, down] = self.edges;
        let share = DVec2::new((tangents.x - left) / (right - left), (up - tangents.y) / (up - down));
        share * DVec2::new(f64::from(SIZE[0]), f64::from(SIZE[1]))
    }
}

/// A quad in the room.
#[derive(Clone, Copy)]
struct Quad {
    standing_from_overlay: DMat4,
    width_m: f64,
    height_m: f64,
}

impl Quad {
    /// A point on the quad, 0 to 1 from the upper left.
    fn point(&self, u: f64, v: f64) -> DVec3 {
        let place = DVec3::new((u - 0.5) * self.width_m, (0.5 - v) * self.height_m, 0.0);
        self.standing_from_overlay.transform_point3(place)
    }

    /// Distance of a pixel from the quad's outline, positive inside, pixels.
    fn depth(&self, eye: &Eye, pixel: DVec2) -> f64 {
        let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(u, v)| eye.pixel(self.point(u, v)));
        let distance = |i: usize| {
            let (from, to) = (corners[i], corners[(i + 1) % 4]);
            (to - from).normalize().perp_dot(pixel - from)
        };
        (0..4).map(distance).fold(f64::INFINITY, f64::min)
    }
}

fn light(byte: u8) -> f64 {
    let v = f64::from(byte) / 255.0;
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

fn byte(light: f64) -> f64 {
    255.0 * if light <= 0.0031308 { light * 12.92 } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 }
}

/// A colour over the background.
fn over_background(color: [u8; 3], alpha: f64) -> [f64; 3] {
    std::array::from_fn(|c| byte(light(color[c]) * alpha + BACKGROUND[c] * (1.0 - alpha)))
}

fn differs(a: [u8; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max)
}

#[track_caller]
fn assert_color(picture: &RgbImage, at: DVec2, expected: [f64; 3]) {
    let seen = picture.get_pixel(at.x as u32, at.y as u32).0;
    assert!(differs(seen, expected) <= 2.0, "at {at}: {seen:?}, expected {expected:?}");
}

/// The quad is at its expected position to 1.5 pixels, and the rest is background.
#[track_caller]
fn assert_outline(picture: &RgbImage, quad: &Quad, eye: &Eye) {
    let background = over_background(RED, 0.0);
    let mut inside = 0;
    for (x, y, pixel) in picture.enumerate_pixels() {
        let depth = quad.depth(eye, DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
        let is_background = differs(pixel.0, background) <= 1.0;
        assert!(depth.abs() < 1.5 || is_background == (depth < 0.0), "({x}, {y}), {depth} inside: {pixel:?}");
        inside += u32::from(depth > 0.0);
    }
    assert!(inside > 1000, "{inside} pixels: too few to tell anything");
}

/// Four colours: upper left, upper right, lower left, lower right.
fn quarters(gpu: &Gpu, [width, height]: [u32; 2], colors: [[u8; 3]; 4]) -> wgpu::Texture {
    gpu.texture([width, height], SRGB, |x, y| {
        let [r, g, b] = colors[usize::from(2 * x >= width) + 2 * usize::from(2 * y >= height)];
        [r, g, b, 255]
    })
}

fn plain(gpu: &Gpu, [r, g, b]: [u8; 3]) -> wgpu::Texture {
    gpu.texture([16, 16], SRGB, |_, _| [r, g, b, 255])
}

/// A visible overlay with a pose.
fn overlay(runtime: &Runtime, key: &std::ffi::CStr, quad: &Quad) -> u64 {
    let handle = runtime.create(key);
    let mut matrix = to_matrix(quad.standing_from_overlay);
    assert_eq!(call!(runtime.overlay, SetOverlayTransformAbsolute, handle, STANDING, &mut matrix), 0);
    assert_eq!(call!(runtime.overlay, SetOverlayWidthInMeters, handle, quad.width_m as f32), 0);
    assert_eq!(call!(runtime.overlay, ShowOverlay, handle), 0);
    handle
}

/// In front of the head, rotated and tilted, and away from the edges of the image.
fn ahead(width_m: f64, height_m: f64, distance_m: f64) -> Quad {
    let head =
        DMat4::from_translation(DVec3::new(0.2, 1.5, 0.4)) * DMat4::from_rotation_y(0.3) * DMat4::from_rotation_x(-0.2);
    let place = head.transform_point3(DVec3::new(0.15, -0.1, -distance_m));
    let tilt = DMat4::from_rotation_y(0.6) * DMat4::from_rotation_x(0.1) * DMat4::from_rotation_z(0.2);
    Quad { standing_from_overlay: DMat4::from_translation(place) * tilt, width_m, height_m }
}

const COLORS: [[u8; 3]; 4] = [RED, GREEN, BLUE, GREY];

fn assert_quarters(picture: &RgbImage, quad: &Quad, eye: &Eye, alpha: f64) {
    let places = [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)];
    for ((u, v), color) in places.into_iter().zip(COLORS) {
        assert_color(picture, eye.pixel(quad.point(u, v)), over_background(color, alpha));
    }
}

#[test]
fn quad_is_drawn_at_its_pose_and_moves_with_its_universe() {
    let name = "pictures::quad_is_drawn_at_its_pose_and_moves_with_its_universe";
    alone(name, &config(), |rig| {
        let gpu = Gpu::open();
        let runtime = Runtime::connected();
        let quad = ahead(1.2, 0.6, 1.8);
        let handle = overlay(&runtime, c"test.quad", &quad);
        let texture = quarters(&gpu, [64, 32], COLORS);
        assert_eq!(gpu.show(&runtime, handle, &texture), 0);
        assert_eq!(call!(runtime.overlay, SetOverlayAlpha, handle, 0.5), 0);
        let (json, pictures) = rig.shot("first");
        assert_eq!(json["overlays"][0]["key"], "test.quad");
        assert!((json["overlays"][0]["height_m"].as_f64().unwrap() - 0.6).abs() < 1e-6);
        for (picture, eye) in pictures.iter().zip(eyes(&runtime)) {
            assert_outline(picture, &quad, &eye);
            assert_quarters(picture, &quad, &eye, 0.5);
        }
        // Standing coordinates stay the same, so the quad moves with the universe.
        rig.command(&json!({ "do": "recenter", "x": 0.2, "z": 0.1, "yaw_deg": 10 }));
        crate::rig::until("the event", || runtime.event());
        let (_, moved) = rig.shot("moved");
        for (picture, eye) in moved.iter().zip(eyes(&runtime)) {
            assert_outline(picture, &quad, &eye);
        }
        assert_ne!(pictures, moved);
        runtime.cleanup();
        assert_eq!(rig.report()["violations"], json!({}));
    });
}

#[test]
fn disparity_matches_distance() {
    alone("pictures::disparity_matches_distance", &json!({ "display": { "shot_size": SIZE } }), |rig| {
        let gpu = Gpu::open();
        let runtime = Runtime::connected();
        let quad = Quad { standing_from_overlay: placed(0.0, [0.1, 1.7, -1.5]), width_m: 0.4, height_m: 0.4 };
        let handle = overlay(&runtime, c"test.quad", &quad);
        let texture = plain(&gpu, GREEN);
        assert_eq!(gpu.show(&runtime, handle, &texture), 0);
        let (_, pictures) = rig.shot("disparity");
        let eyes = eyes(&runtime);
        let tangent = |side: usize| {
            let lit = pictures[side].enumerate_pixels().filter(|(_, _, pixel)| pixel.0[1] > 128);
            let (sum, count) = lit.fold((0.0, 0.0), |(sum, n), (x, _, _)| (sum + f64::from(x) + 0.5, n + 1.0));
            let [left, right, ..] = eyes[side].edges;
            left + (right - left) * sum / count / f64::from(SIZE[0])
        };
        // A near object is further to the right for the left eye.
        assert!((tangent(0) - tangent(1) - 0.063 / 1.5).abs() < 0.002, "{} {}", tangent(0), tangent(1));
        assert!(((tangent(0) + tangent(1)) / 2.0 - 0.1 / 1.5).abs() < 0.002);
        runtime.cleanup();
    });
}

#[test]
fn side_by_side_halves_and_bounds_are_applied() {
    alone("pictures::side_by_side_halves_and_bounds_are_applied", &config(), |rig| {
        let gpu = Gpu::open();
        let runtime = Runtime::connected();
        // 64 × 32 for both eyes: each has a square half, and texels twice as wide as high make it
        // half as high.
        let quad = ahead(0.8, 0.4, 1.6);
        let handle = overlay(&runtime, c"test.stereo", &quad);
        let texture = quarters(&gpu, [64, 32], [RED, GREEN, RED, GREEN]);
        let flag = sys::VROverlayFlags_SideBySide_Parallel;
        assert_eq!(call!(runtime.overlay, SetOverlayFlag, handle, flag, true), 0);
        assert_eq!(call!(runtime.overlay, SetOverlayTexelAspect, handle, 2.0), 0);
        assert_eq!(gpu.show(&runtime, handle, &texture), 0);
        let (_, pictures) = rig.shot("stereo");
        for ((picture, eye), color) in pictures.iter().zip(eyes(&runtime)).zip([RED, GREEN]) {
            assert_outline(picture, &quad, &eye);
            for (u, v) in [(0.05, 0.05), (0.5, 0.5), (0.95, 0.95)] {
                assert_color(picture, eye.pixel(quad.point(u, v)), over_background(color, 1.0));
            }
        }
        // The right half of a quad: a square of the second colour.
        assert_eq!(call!(runtime.overlay, SetOverlayFlag, handle, flag, false), 0);
        assert_eq!(call!(runtime.overlay, SetOverlayTexelAspect, handle, 1.0), 0);
        let mut bounds = sys::VRTextureBounds_t { uMin: 0.5, vMin: 0.0, uMax: 1.0, vMax: 1.0 };
        assert_eq!(call!(runtime.overlay, SetOverlayTextureBounds, handle, &mut bounds), 0);
        let (_, pictures) = rig.shot("bounds");
        let square = Quad { height_m: 0.8, ..quad };
        for (picture, eye) in pictures.iter().zip(eyes(&runtime)) {
            assert_outline(picture, &square, &eye);
            assert_color(picture, eye.pixel(square.point(0.1, 0.1)), over_background(GREEN, 1.0));
        }
        runtime.cleanup();
    });
}

#[test]
fn quads_are_ordered_by_sort_order_then_distance() {
    let name = "pictures::quads_are_ordered_by_sort_order_then_distance";
    alone(name, &config(), |rig| {
        let gpu = Gpu::open();
        let runtime = Runtime::connected();
        let (near, far) = (ahead(0.4, 0.4, 1.2), ahead(0.8, 0.8, 1.8));
        let near_handle = overlay(&runtime, c"test.near", &near);
        let far_handle = overlay(&runtime, c"test.far", &far);
        let textures = [plain(&gpu, RED), plain(&gpu, BLUE)];
        assert_eq!(gpu.show(&runtime, near_handle, &textures[0]), 0);
        assert_eq!(gpu.show(&runtime, far_handle, &textures[1]), 0);
        for (order, color) in [(0, RED), (1, BLUE)] {
            assert_eq!(call!(runtime.overlay, SetOverlaySortOrder, far_handle, order), 0);
            let (_, pictures) = rig.shot(&format!("order{order}"));
            for (picture, eye) in pictures.iter().zip(eyes(&runtime)) {
                assert_color(picture, eye.pixel(near.point(0.5, 0.5)), over_background(color, 1.0));
            }
        }
        assert_eq!(call!(runtime.overlay, HideOverlay, far_handle), 0);
        let (json, pictures) = rig.shot("hidden");
        assert_eq!(json["overlays"].as_array().unwrap().len(), 1);
        for (picture, eye) in pictures.iter().zip(eyes(&runtime)) {
            assert_outline(picture, &near, &eye);
        }
        runtime.cleanup();
    });
}

#[test]
fn premultiplied_flag_is_respected() {
    alone("pictures::premultiplied_flag_is_respected", &config(), |rig| {
        let gpu = Gpu::open();
        let runtime = Runtime::connected();
        let quad = ahead(0.8, 0.8, 1.6);
        let handle = overlay(&runtime, c"test.alpha", &quad);
        let [r, g, b, a] = [100u8, 60, 200, 153];
        let colors = [0.5f32, 1.0, 0.25];
        assert_eq!(call!(runtime.overlay, SetOverlayColor, handle, colors[0], colors[1], colors[2]), 0);
        assert_eq!(call!(runtime.overlay, SetOverlayAlpha, handle, 0.5), 0);
        let formats = [(SRGB, [r, g, b, a]), (wgpu::TextureFormat::Bgra8UnormSrgb, [b, g, r, a])];
        let textures = formats.map(|(format, bytes)| gpu.texture([8, 8], format, |_, _| bytes));
        for (premultiplied, texture) in [(false, &textures[0]), (true, &textures[1])] {
            let flag = sys::VROverlayFlags_IsPremultiplied;
            assert_eq!(call!(runtime.overlay, SetOverlayFlag, handle, flag, premultiplied), 0);
            assert_eq!(gpu.show(&runtime, handle, texture), 0);
            let (_, pictures) = rig.shot(&format!("alpha{premultiplied}"));
            let alpha = f64::from(a) / 255.0;
            let by = 0.5 * if premultiplied { 1.0 } else { alpha };
            let expected = std::array::from_fn(|c| {
                byte(light([r, g, b][c]) * by * f64::from(colors[c]) + BACKGROUND[c] * (1.0 - 0.5 * alpha))
            });
            for (picture, eye) in pictures.iter().zip(eyes(&runtime)) {
                assert_color(picture, eye.pixel(quad.point(0.3, 0.6)), expected);
            }
        }
        runtime.cleanup();
        assert_eq!(rig.report()["textures"], 2);
    });
}

#[test]
fn quad_back_follows_sdk_version_and_flag() {
    let name = "pictures::quad_back_follows_sdk_version_and_flag";
    alone(name, &config(), |rig| {
        let gpu = Gpu::open();
        let runtime = Runtime::connected();
        let front = ahead(0.8, 0.8, 1.6);
        let turned = front.standing_from_overlay * DMat4::from_rotation_y(std::f64::consts::PI);
        let quad = Quad { standing_from_overlay: turned, ..front };
        let handle = overlay(&runtime, c"test.back", &quad);
        let texture = plain(&gpu, RED);
        assert_eq!(gpu.show(&runtime, handle, &texture), 0);
        let middle = |name: &str| {
            let (_, pictures) = rig.shot(name);
            let at = eyes(&runtime)[0].pixel(quad.point(0.5, 0.5));
            pictures[0].get_pixel(at.x as u32, at.y as u32).0
        };
        let nothing = over_background(RED, 0.0);
        assert!(differs(middle("old"), nothing) <= 1.0);
        assert_eq!(call!(runtime.system, SetSDKVersion, 2, 15, 6), 0);
        let [r, g, b] = middle("new");
        assert!(r > 20 && r.abs_diff(g) < 5 && g.abs_diff(b) < 5, "{r} {g} {b}");
        let flag = sys::VROverlayFlags_NoBackside;
        assert_eq!(call!(runtime.overlay, SetOverlayFlag, handle, flag, true), 0);
        assert!(differs(middle("none"), nothing) <= 1.0);
        runtime.cleanup();
    });
}

/// Projections over both eyes, drawn with the view rotated by 0.1 rad to the left; the matrix in
/// the given direction.
fn projection(rig: &Rig, direction: &str) {
    let gpu = Gpu::open();
    let runtime = Runtime::connected();
    let texture = quarters(&gpu, [64, 64], COLORS);
    let turn = DMat4::from_rotation_y(0.1);
    for (side, eye) in eyes(&runtime).iter().enumerate() {
        let handle = runtime.create([c"test.left", c"test.right"][side]);
        let tracking_from_view = eye.eye_from_standing.inverse() * turn;
        let matrix = if direction == "tracking_from_eye" { tracking_from_view } else { tracking_from_view.inverse() };
        let [left, right, up, down] = eye.edges.map(|edge| edge as f32);
        let mut edges = sys::VROverlayProjection_t { fLeft: left, fRight: right, fTop: down, fBottom: up };
        let mut matrix = to_matrix(matrix);
        let number = side as u32;
        let table = runtime.overlay;
        let set = call!(table, SetOverlayTransformProjection, handle, STANDING, &mut matrix, &mut edges, number);
        assert_eq!((set, call!(table, ShowOverlay, handle)), (0, 0));
        assert_eq!(gpu.show(&runtime, handle, &texture), 0);
    }
    call!(runtime.overlay, WaitFrameSync, 100);
    let (_, pictures) = rig.shot("projection");
    for (picture, eye) in pictures.iter().zip(eyes(&runtime)) {
        let [left, right, up, down] = eye.edges;
        for (u, v, color) in
            [(0.3, 0.3, COLORS[0]), (0.7, 0.3, COLORS[1]), (0.3, 0.7, COLORS[2]), (0.7, 0.7, COLORS[3])]
        {
            let in_view = DVec3::new(left + u * (right - left), up + v * (down - up), -1.0);
            let seen = turn.transform_vector3(in_view);
            let at = eye.direction_pixel(DVec2::new(seen.x, seen.y) / -seen.z);
            assert_color(picture, at, over_background(color, 1.0));
        }
        // Beside the view, on the right, there is nothing.
        let beside = DVec2::new(f64::from(SIZE[0]) - 2.0, f64::from(SIZE[1]) / 2.0);
        assert_color(picture, beside, over_background(RED, 0.0));
    }
    runtime.cleanup();
    assert_eq!(rig.report()["violations"], json!({}));
}

#[test]
fn projections_are_drawn_in_their_directions() {
    alone("pictures::projections_are_drawn_in_their_directions", &config(), |rig| {
        projection(rig, "eye_from_tracking");
    });
}

#[test]
fn projection_matrix_direction_is_configurable() {
    let mut config = config();
    config["projection_matrix"] = json!("tracking_from_eye");
    alone("pictures::projection_matrix_direction_is_configurable", &config, |rig| {
        projection(rig, "tracking_from_eye");
    });
}

#[test]
fn headset_gpu_is_selected_by_name() {
    alone("pictures::headset_gpu_is_selected_by_name", &json!({}), |rig| {
        let gpu = Gpu::open();
        let runtime = Runtime::connected();
        let (physical_device, instance) = gpu.physical_device_and_instance();
        let mut found = 0u64;
        call!(runtime.system, GetOutputDevice, &mut found, sys::ETextureType_TextureType_Vulkan, instance);
        assert_ne!(found, 0);
        let mut names = [0u8; 1024];
        let at = names.as_mut_ptr().cast();
        let device = physical_device as *mut _;
        let needed = call!(runtime.compositor, GetVulkanDeviceExtensionsRequired, device, at, 1024) as usize;
        let text = std::str::from_utf8(&names[..needed - 1]).unwrap();
        assert!(text.split(' ').all(|name| name.starts_with("VK_")) && !text.is_empty(), "{text:?}");
        runtime.cleanup();
        assert_eq!(rig.report()["violations"], json!({}));
    });
}

#[test]
fn texture_copies_reuse_memory() {
    alone("pictures::texture_copies_reuse_memory", &config(), |rig| {
        let gpu = Gpu::open();
        let runtime = Runtime::connected();
        let quad = ahead(0.8, 0.8, 1.6);
        let handles = [c"test.a", c"test.b"].map(|key| overlay(&runtime, key, &quad));
        let textures: Vec<_> =
            (0..4u8).map(|i| gpu.texture([64 << i, 64], SRGB, |_, _| [i * 60, 90, 0, 255])).collect();
        for round in 0..400 {
            for handle in handles {
                assert_eq!(gpu.show(&runtime, handle, &textures[round % 4]), 0);
            }
            call!(runtime.overlay, WaitFrameSync, 100);
        }
        let (json, _) = rig.shot("last");
        assert_eq!(json["overlays"][0]["texture_size"], json!([512, 64]));
        runtime.cleanup();
        let report = rig.report();
        assert_eq!((&report["textures"], &report["textures_not_copied"]), (&json!(800), &json!(0)));
        assert_eq!(report["violations"], json!({}));
    });
}

#[test]
fn device_change_is_reported_and_continues() {
    alone("pictures::device_change_is_reported_and_continues", &config(), |rig| {
        let first = Gpu::open();
        let runtime = Runtime::connected();
        let quad = ahead(0.8, 0.8, 1.6);
        let handle = overlay(&runtime, c"test.quad", &quad);
        let texture = plain(&first, RED);
        assert_eq!(first.show(&runtime, handle, &texture), 0);
        let second = Gpu::open();
        let texture = plain(&second, BLUE);
        assert_eq!(second.show(&runtime, handle, &texture), 0);
        let (_, pictures) = rig.shot("second");
        let at = eyes(&runtime)[0].pixel(quad.point(0.5, 0.5));
        assert_color(&pictures[0], at, over_background(BLUE, 1.0));
        runtime.cleanup();
        assert_eq!(rig.report()["violations"]["handles change from texture to texture"]["count"], 1);
    });
}
