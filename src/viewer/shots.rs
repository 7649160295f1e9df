//! Screenshots of the view without a window, as PNG files, for documentation and tests. The same
//! recording gives the same states.

use image::RgbaImage;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};

use super::app::{App, Arrangement};
use super::camera::View;
use super::error::ViewError;
use super::map_view::Cut;
use super::screen::{Screen, adapter};
use super::space::FORMAT;
use crate::render::RenderError;

/// Size of the images, pixels. Choice: a laptop's screen.
pub const SIZE_PX: [u32; 2] = [1600, 1000];
/// Names of the images' files.
pub const NAMES: [&str; 4] = ["overview.png", "above.png", "first-person.png", "maps.png"];
/// Passes until the layout has settled. Choice: egui needs two passes for sizes that depend on each
/// other; two in reserve.
const PASSES: u32 = 4;

/// Draws the states as PNG files, in the order of [`NAMES`]. The app's history must be complete.
///
/// # Errors
/// There is no graphics adapter, or the device fails.
pub fn shots(app: &mut App, duration_s: f64) -> Result<Vec<Vec<u8>>, ViewError> {
    let mut described = wgpu::InstanceDescriptor::new_without_display_handle();
    described.backends = wgpu::Backends::VULKAN;
    let adapter = adapter(&wgpu::Instance::new(described), None)?;
    let mut screen = Screen::new(&adapter, FORMAT)?;
    app.set_texture(screen.texture());
    app.player.pause();
    let states: [fn(&mut App); NAMES.len()] = [
        |app| {
            app.set_arrangement(Arrangement::Both);
            app.set_view(View::Overview);
        },
        |app| {
            app.set_arrangement(Arrangement::Room);
            app.set_view(View::Above);
            app.layers.truth = true;
        },
        |app| {
            app.set_view(View::FirstPerson);
            app.layers.truth = false;
            app.layers.evidence = false;
        },
        |app| {
            app.set_arrangement(Arrangement::Maps);
            app.set_cut(Cut::All);
            app.layers.evidence = true;
        },
    ];
    let shares = [0.6, 1.0, app.brightest(duration_s), 0.6];
    let mut files = Vec::new();
    for (prepare, share) in states.into_iter().zip(shares) {
        prepare(app);
        let extent = super::player::Extent { buffered_s: duration_s, duration_s, is_complete: true };
        app.player.seek(share * duration_s, &extent);
        files.push(png(picture(&mut screen, app)?)?);
    }
    Ok(files)
}

fn picture(screen: &mut Screen, app: &mut App) -> Result<RgbaImage, ViewError> {
    let [width, height] = SIZE_PX;
    let texture = screen.device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: FORMAT,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    });
    let view = texture.create_view(&Default::default());
    for n in 0..PASSES {
        let size = egui::vec2(width as f32, height as f32);
        let input = egui::RawInput {
            screen_rect: Some(egui::Rect::from_min_size(egui::Pos2::ZERO, size)),
            // Animations have ended by then.
            time: Some(screen.context.input(|input| input.time) + f64::from(n)),
            max_texture_side: Some(screen.device.limits().max_texture_dimension_2d as usize),
            ..Default::default()
        };
        screen.pass(app, input, &view, SIZE_PX)?;
    }
    Ok(read(screen, &texture)?)
}

fn read(screen: &Screen, texture: &wgpu::Texture) -> Result<RgbaImage, RenderError> {
    let failed = |error: &dyn std::fmt::Display| RenderError::Device(error.to_string());
    let (width, height) = (texture.width(), texture.height());
    let row = (4 * width).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
    let buffer = screen.device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: u64::from(row) * u64::from(height),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = screen.device.create_command_encoder(&Default::default());
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row), rows_per_image: None };
    encoder.copy_texture_to_buffer(
        texture.as_image_copy(),
        wgpu::TexelCopyBufferInfo { buffer: &buffer, layout },
        wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
    );
    screen.queue.submit([encoder.finish()]);
    buffer.map_async(wgpu::MapMode::Read, .., |_| {});
    let waited = screen.device.poll(wgpu::PollType::wait_indefinitely());
    screen.check()?;
    waited.map_err(|error| failed(&error))?;
    let mapped = buffer.get_mapped_range(..).map_err(|error| failed(&error))?;
    let pixels = mapped.chunks(row as usize).flat_map(|line| &line[..4 * width as usize]).copied().collect();
    let mut picture = RgbaImage::from_raw(width, height, pixels).ok_or_else(|| failed(&"image has too few pixels"))?;
    picture.pixels_mut().for_each(|pixel| pixel[3] = 255);
    Ok(picture)
}

fn png(picture: RgbaImage) -> Result<Vec<u8>, ViewError> {
    let mut bytes = Vec::new();
    let encoder = PngEncoder::new_with_quality(&mut bytes, CompressionType::Best, FilterType::Adaptive);
    let rgb = image::DynamicImage::ImageRgba8(picture).into_rgb8();
    rgb.write_with_encoder(encoder).map_err(|error| ViewError::Png(error.to_string()))?;
    Ok(bytes)
}
