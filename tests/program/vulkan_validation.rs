//! Runs all of the renderer's work under Vulkan's validation layer (Debian:
//! `vulkan-validationlayers`); the layer must report nothing.
//!
//! The work runs in processes of its own, this test started again with the layer enabled, because
//! the environment selects the layer. It takes textures over as a VR runtime does: a copy
//! of its own on our queue, from the agreed layout. One run omits the hand-over: the layer must
//! complain then, or it is not active.

use std::path::Path;
use std::process::Command;

use ash::vk::{self, Handle};
use glam::{DMat3, DVec3};
use radar_chaperone::openvr::{VulkanDevice, VulkanRequirements, VulkanTexture, open};
use radar_chaperone::render::{EyeView, Quad, Renderer, StereoScene, Window};
use radar_chaperone::warning::{WarningSettings, WarningTracker, Warnings, Wearer};
use radar_mapping::{Observed, Obstacle, Scene, Wall};
use radar_sar::geometry::{Aabb, Plane, Pose};

const LAYER: &str = "VK_LAYER_KHRONOS_validation";
/// This variable has a process do the work of that name.
const WORK: &str = "RADAR_CHAPERONE_VALIDATED_WORK";
/// This test's name, as the processes are started.
const TEST: &str = "vulkan_validation::validation_layer_reports_nothing";
const MANIFESTS: [&str; 2] = ["/usr/share/vulkan/explicit_layer.d", "/etc/vulkan/explicit_layer.d"];

/// A box, an obstacle of unknown direction, and a wall.
fn scene() -> Scene {
    let shape = (0..500).map(|i| (DVec3::new((i % 5).into(), (i / 5 % 20).into(), (i / 100).into()) * 0.05, 1.0));
    let obstacle = Obstacle {
        id: 1,
        position_m: DVec3::new(0.1, 0.5, -0.8),
        covariance_m2: DMat3::IDENTITY * 1e-4,
        observed: Observed::Position,
        extent_m: DVec3::ZERO,
        evidence: 9.0,
        shape: shape.map(|(p, score)| (p + DVec3::new(0.0, 0.0, -1.0), score)).collect(),
        provisional: false,
        first_seen_ns: 0,
        last_seen_ns: 0,
    };
    let unknown = Obstacle {
        id: 2,
        position_m: DVec3::new(-0.9, 0.9, 0.2),
        observed: Observed::RangeOnly,
        shape: vec![],
        ..obstacle.clone()
    };
    let wall = Wall {
        id: 1,
        plane: Plane { outward: DVec3::X, offset_m: 0.9 },
        evidence: 5.0,
        seen_at: Aabb::from_corners(DVec3::new(0.8, 1.0, -1.0), DVec3::new(1.0, 1.6, 1.0)),
        provisional: false,
        first_seen_ns: 0,
        last_seen_ns: 0,
    };
    Scene { time_ns: 0, obstacles: vec![obstacle, unknown], walls: vec![wall], moving: vec![] }
}

fn device() -> VulkanDevice {
    open(&VulkanRequirements {
        instance_extensions: vec![c"VK_KHR_external_memory_capabilities".into()],
        device_extensions: &|_| vec![c"VK_KHR_external_memory".into()],
        adapter: &|_| None,
    })
    .unwrap()
}

/// Copies a texture to the host as a runtime would: on our queue, with commands unknown to wgpu.
fn copied_by_runtime(device: &VulkanDevice, texture: &wgpu::Texture) -> Vec<u8> {
    // SAFETY: the device outlives this function, every object made here is destroyed here after the
    // queue has finished with it, and nothing else submits meanwhile.
    unsafe {
        let hal = device.device.as_hal::<wgpu::hal::vulkan::Api>().unwrap();
        let handed: VulkanTexture = device.texture_handles(texture).unwrap();
        let (vulkan, queue) = (hal.raw_device(), vk::Queue::from_raw(handed.queue));
        let size = u64::from(handed.width) * u64::from(handed.height) * 4;
        let described = vk::BufferCreateInfo::default().size(size).usage(vk::BufferUsageFlags::TRANSFER_DST);
        let buffer = vulkan.create_buffer(&described, None).unwrap();
        let needs = vulkan.get_buffer_memory_requirements(buffer);
        let kinds =
            hal.shared_instance().raw_instance().get_physical_device_memory_properties(hal.raw_physical_device());
        let wanted = vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT;
        let suits = |i: &u32| {
            needs.memory_type_bits >> i & 1 == 1 && kinds.memory_types[*i as usize].property_flags.contains(wanted)
        };
        let kind = (0..kinds.memory_type_count).find(suits).unwrap();
        let memory = vk::MemoryAllocateInfo::default().allocation_size(needs.size).memory_type_index(kind);
        let memory = vulkan.allocate_memory(&memory, None).unwrap();
        vulkan.bind_buffer_memory(buffer, memory, 0).unwrap();

        let pool = vk::CommandPoolCreateInfo::default().queue_family_index(handed.queue_family);
        let pool = vulkan.create_command_pool(&pool, None).unwrap();
        let commands = vk::CommandBufferAllocateInfo::default().command_pool(pool).command_buffer_count(1);
        let commands = vulkan.allocate_command_buffers(&commands).unwrap();
        vulkan.begin_command_buffer(commands[0], &vk::CommandBufferBeginInfo::default()).unwrap();
        let color = vk::ImageSubresourceLayers::default().aspect_mask(vk::ImageAspectFlags::COLOR).layer_count(1);
        let extent = vk::Extent3D { width: handed.width, height: handed.height, depth: 1 };
        vulkan.cmd_copy_image_to_buffer(
            commands[0],
            vk::Image::from_raw(handed.image),
            vk::ImageLayout::TRANSFER_SRC_OPTIMAL,
            buffer,
            &[vk::BufferImageCopy::default().image_subresource(color).image_extent(extent)],
        );
        vulkan.end_command_buffer(commands[0]).unwrap();
        vulkan.queue_submit(queue, &[vk::SubmitInfo::default().command_buffers(&commands)], vk::Fence::null()).unwrap();
        vulkan.queue_wait_idle(queue).unwrap();

        let mapped = vulkan.map_memory(memory, 0, size, vk::MemoryMapFlags::empty()).unwrap();
        let pixels = std::slice::from_raw_parts(mapped.cast::<u8>(), size as usize).to_vec();
        vulkan.unmap_memory(memory);
        vulkan.destroy_command_pool(pool, None);
        vulkan.destroy_buffer(buffer, None);
        vulkan.free_memory(memory, None);
        pixels
    }
}

fn copy_all_as_runtime(device: &VulkanDevice, renderer: &Renderer, quads: &[Quad]) {
    for quad in quads {
        assert_eq!(
            copied_by_runtime(device, &quad.texture),
            renderer.picture_of(quad).unwrap().into_raw(),
            "{:?}",
            quad.key()
        );
    }
}

/// The warnings after the head has stayed there for half a second, when they have faded in.
fn settled_warnings(tracker: &mut WarningTracker, head: Pose, style: &WarningSettings) -> Warnings {
    (0..50).map(|step| tracker.warn(&Wearer::head_only(step * 10_000_000, head), style)).last().unwrap()
}

/// All work, which the layer must find nothing wrong with.
fn everything() {
    let device = device();
    let mut renderer = Renderer::from_device(device.device.clone(), device.queue.clone(), &device.name).unwrap();
    let style = WarningSettings::default();
    let mut tracker = WarningTracker::new();
    tracker.update(&scene());
    for step in 0..8 {
        let head = Pose::from_translation(DVec3::new(0.05 * f64::from(step), 1.6, -0.02 * f64::from(step)));
        let warnings = settled_warnings(&mut tracker, head, &style);
        let views = EyeView::pair(&head, 0.064, 1.6, [200 + 3 * step, 160]);
        let quads = renderer.quads(&warnings, &style).unwrap();
        assert!(quads.len() >= 4, "{} quads", quads.len());
        copy_all_as_runtime(&device, &renderer, &quads);
        renderer.preview(&warnings, &style, &views[0], &[(DVec3::new(0.0, 1.0, -1.0), 0.03)]).unwrap();
        renderer.prepare_for_copy(&quads).unwrap();
        copy_all_as_runtime(&device, &renderer, &quads);
        let shapes = tracker.shapes(&warnings);
        let scenery = StereoScene { quads: &quads, shapes: &shapes, color: style.color };
        let eyes_m = views.map(|view| view.tracking_from_eye.translation);
        for window in Window::of_panels(&scenery, eyes_m) {
            let texture = renderer.window(&scenery, &window, eyes_m, [150, 120]).unwrap();
            let picture = renderer.picture_of_texture(&texture).unwrap();
            assert_eq!(copied_by_runtime(&device, &texture), picture.into_raw());
        }
        for texture in renderer.windows(&scenery, &Window::of_panels(&scenery, eyes_m), eyes_m).unwrap() {
            assert_eq!(copied_by_runtime(&device, &texture), renderer.picture_of_texture(&texture).unwrap().into_raw());
        }
        for (side, view) in views.iter().enumerate() {
            let texture = renderer.eye(&scenery, side, view).unwrap();
            assert_eq!(copied_by_runtime(&device, &texture), renderer.picture_of_texture(&texture).unwrap().into_raw());
        }
        renderer.prepare_for_copy(&quads).unwrap();
        copy_all_as_runtime(&device, &renderer, &quads);
    }
}

/// Copies a texture used by a preview, without a hand-over.
fn everything_but_the_hand_over() {
    let device = device();
    let mut renderer = Renderer::from_device(device.device.clone(), device.queue.clone(), &device.name).unwrap();
    let (style, head) = (WarningSettings::default(), Pose::from_translation(DVec3::Y * 1.6));
    let mut tracker = WarningTracker::new();
    tracker.update(&scene());
    let warnings = settled_warnings(&mut tracker, head, &style);
    let quads = renderer.quads(&warnings, &style).unwrap();
    renderer.preview(&warnings, &style, &EyeView::pair(&head, 0.064, 1.6, [200, 160])[0], &[]).unwrap();
    copied_by_runtime(&device, &quads[0].texture);
}

/// Messages of the layer during that work.
fn layer_messages_during(work: &str, folder: &Path) -> String {
    let (log, settings) = (folder.join(format!("{work}.log")), folder.join(format!("{work}.txt")));
    let lines = [
        "khronos_validation.debug_action = VK_DBG_LAYER_ACTION_LOG_MSG".to_owned(),
        "khronos_validation.report_flags = error,warn,perf".to_owned(),
        "khronos_validation.enables = VK_VALIDATION_FEATURE_ENABLE_SYNCHRONIZATION_VALIDATION_EXT".to_owned(),
        "khronos_validation.enable_message_limit = false".to_owned(),
        format!("khronos_validation.log_filename = {}", log.display()),
    ];
    std::fs::write(&settings, lines.join("\n")).unwrap();
    let ran = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", TEST, "--nocapture"])
        .env(WORK, work)
        .env("VK_INSTANCE_LAYERS", LAYER)
        .env("VK_LAYER_SETTINGS_PATH", &settings)
        .output()
        .unwrap();
    assert!(ran.status.success(), "{work}: {}", String::from_utf8_lossy(&ran.stderr));
    std::fs::read_to_string(&log).unwrap_or_default()
}

#[test]
fn validation_layer_reports_nothing() {
    match std::env::var(WORK).as_deref() {
        Ok("everything") => return everything(),
        Ok("everything_but_the_hand_over") => return everything_but_the_hand_over(),
        Ok(other) => panic!("there is no work {other:?}"),
        Err(_) => {}
    }
    let is_there = |folder: &str| Path::new(folder).join("VkLayer_khronos_validation.json").exists();
    assert!(
        MANIFESTS.iter().any(|folder| is_there(folder)),
        "Vulkan's validation layer is missing: ./setup.sh installs it"
    );
    let folder = std::env::temp_dir().join(format!("radar-chaperone-validation-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let watched = layer_messages_during("everything_but_the_hand_over", &folder);
    let messages = layer_messages_during("everything", &folder);
    std::fs::remove_dir_all(&folder).unwrap();
    // The first work is wrong on purpose; with no message, the processes did not run it either.
    assert!(watched.contains("TRANSFER_SRC_OPTIMAL"), "the layer is not active: {watched:?}");
    assert!(messages.trim().is_empty(), "{messages}");
}
