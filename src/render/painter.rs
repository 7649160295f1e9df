//! Draws the textures of panels and footprints. It does not know their poses: the preview and
//! SteamVR overlays use the same textures.
//!
//! RGBA, 8 bits, sRGB curve, premultiplied alpha; row 0 is the upper edge. A VR runtime copies only
//! the finest mip level. The coarser levels, which avoid shimmering on distant panels, are drawn
//! when this program first samples the texture. A new texture is in the copy-source state.

use bytemuck::{Pod, Zeroable};
use glam::DVec2;

use super::gpu::{FORMAT, Gpu};
use super::label::Label;
use crate::warning::{PanelKind, Style, WarningSettings};

/// Texture resolution. Choice: a grid line is two pixels wide.
const PIXELS_PER_M: f64 = 512.0;
/// Longest side of a texture. Larger panels get fewer pixels per metre. Choice: 2 m at full
/// resolution; 4 MB a texture.
const MAX_SIDE_PX: f64 = 1024.0;
/// A texture's size is kept while it has at most this many times the pixels that are needed. Choice: painting costs by the pixel, and
/// a panel whose side halves is another panel.
const MAX_SPARE: u64 = 2;
/// Shortest side of a texture. Choice: 12 cm; smaller sizes save nothing.
const MIN_SIDE_PX: f64 = 64.0;

/// Height of the distance label with its margin, metres. Choice: readable at 1.5 m.
const LABEL_HEIGHT_M: f64 = 0.13;
/// Height of the label's centre above the silhouette, metres. Choice: half the label's height, so
/// that its lower edge touches the silhouette.
const LABEL_ABOVE_M: f64 = 0.06;
/// Height of the label's centre above the floor if there is no silhouette, metres. Choice: chest
/// height, in view of a wearer who looks ahead, below what the game shows.
const LABEL_ON_WALL_M: f64 = 1.3;

/// Content of a panel's texture.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct PanelContent<'a> {
    pub kind: PanelKind,
    pub size_m: DVec2,
    pub silhouette: &'a [(DVec2, f64)],
    /// Distance on the label, tenths of a metre.
    pub label_dm: Option<i32>,
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct PanelUniform {
    size: [f32; 2],
    spacing: f32,
    grid_from: f32,
    color: [f32; 3],
    disc_count: u32,
    fog: f32,
    border: f32,
    style: u32,
    label_columns: u32,
    label: [f32; 4],
    label_rows: u32,
    unused: [u32; 3],
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct FootprintUniform {
    size: [f32; 2],
    corner_count: u32,
    unused: f32,
    color: [f32; 4],
}

/// Pipelines that draw the textures.
pub(super) struct Painter {
    panel: wgpu::RenderPipeline,
    footprint: wgpu::RenderPipeline,
    downsampler: wgpu::util::TextureBlitter,
}

impl Painter {
    pub fn new(gpu: &Gpu) -> Self {
        let downsampler =
            wgpu::util::TextureBlitterBuilder::new(&gpu.device, FORMAT).sample_type(wgpu::FilterMode::Linear).build();
        Self {
            panel: pipeline(gpu, wgpu::include_wgsl!("../../overlay_assets/shaders/panel.wgsl")),
            footprint: pipeline(gpu, wgpu::include_wgsl!("../../overlay_assets/shaders/footprint.wgsl")),
            downsampler,
        }
    }

    /// The texture of a panel.
    pub fn panel(
        &self,
        gpu: &Gpu,
        content: &PanelContent,
        style: &WarningSettings,
        size_px: [u32; 2],
    ) -> wgpu::Texture {
        let mut list: Vec<[f32; 4]> =
            content.silhouette.iter().map(|(c, r)| [c.x as f32, c.y as f32, *r as f32, 0.0]).collect();
        let is_wall = content.kind == PanelKind::Wall;
        let is_fog = content.kind == PanelKind::Object && list.is_empty();
        let disc_count = list.len() as u32;
        let label =
            content.label_dm.map_or_else(Label::default, |dm| Label::new(&format!("{}.{} m", dm / 10, dm % 10)));
        let texels = label.distances.chunks(4).map(|four| std::array::from_fn(|n| four.get(n).copied().unwrap_or(0.0)));
        list.extend(texels);
        let [red, green, blue, _] = linear(style.color);
        let uniform = PanelUniform {
            size: content.size_m.as_vec2().to_array(),
            spacing: spacing(style),
            grid_from: if is_wall { -0.5 * content.size_m.x as f32 } else { 0.0 },
            color: [red, green, blue],
            disc_count,
            fog: f32::from(u8::from(is_fog)),
            border: f32::from(u8::from(!is_wall && !is_fog)),
            style: style_number(style.style),
            label_columns: label.columns,
            label: label_rect(content, &label),
            label_rows: label.rows,
            unused: [0; 3],
        };
        self.paint(gpu, &self.panel, size_px, bytemuck::bytes_of(&uniform), list)
    }

    /// The texture of a footprint. `corners_m`: corners relative to its centre, counter-clockwise
    /// with y up, metres.
    pub fn footprint(
        &self,
        gpu: &Gpu,
        size_m: DVec2,
        corners_m: &[DVec2],
        style: &WarningSettings,
        size_px: [u32; 2],
    ) -> wgpu::Texture {
        let corners: Vec<[f32; 4]> = corners_m.iter().map(|c| [c.x as f32, c.y as f32, 0.0, 0.0]).collect();
        let uniform = FootprintUniform {
            size: size_m.as_vec2().to_array(),
            corner_count: corners.len() as u32,
            unused: 0.0,
            color: linear(style.color),
        };
        self.paint(gpu, &self.footprint, size_px, bytemuck::bytes_of(&uniform), corners)
    }

    fn paint(
        &self,
        gpu: &Gpu,
        pipeline: &wgpu::RenderPipeline,
        size_px: [u32; 2],
        uniform: &[u8],
        mut list: Vec<[f32; 4]>,
    ) -> wgpu::Texture {
        // A storage buffer must not be empty.
        if list.is_empty() {
            list.push([0.0; 4]);
        }
        let uniform = gpu.buffer(uniform, wgpu::BufferUsages::UNIFORM);
        let list = gpu.buffer(bytemuck::cast_slice(&list), wgpu::BufferUsages::STORAGE);
        let bound = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: uniform.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 1, resource: list.as_entire_binding() },
            ],
        });
        let texture = gpu.texture(size_px, FORMAT, 1, size_px[0].max(size_px[1]).ilog2() + 1);
        let finest = level_view(&texture, 0);
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                    view: &finest,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations {
                        load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                        store: wgpu::StoreOp::Store,
                    },
                })],
                ..Default::default()
            });
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &bound, &[]);
            pass.draw(0..3, 0..1);
        }
        transition_to_copy_source(&mut encoder, [&texture].into_iter());
        gpu.queue.submit([encoder.finish()]);
        texture
    }

    /// Draws the coarser mip levels, each from the previous one.
    pub fn draw_mip_levels(&self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, texture: &wgpu::Texture) {
        let views: Vec<_> = (0..texture.mip_level_count()).map(|level| level_view(texture, level)).collect();
        for pair in views.windows(2) {
            self.downsampler.copy(&gpu.device, encoder, &pair[0], &pair[1]);
        }
    }
}

/// Style number used by the shader.
pub(super) fn style_number(style: Style) -> u32 {
    match style {
        Style::Grid => 0,
        Style::Outline => 1,
        Style::Solid => 2,
        Style::Minimal => 3,
    }
}

/// Centre and half size of the label: above the top of the silhouette, or slightly below eye height
/// on a wall.
fn label_rect(content: &PanelContent, label: &Label) -> [f32; 4] {
    let half_size = DVec2::new(label.aspect(), 1.0) * LABEL_HEIGHT_M / 2.0;
    let highest = content.silhouette.iter().max_by(|a, b| (a.0.y + a.1).total_cmp(&(b.0.y + b.1)));
    let wanted = match highest {
        Some((middle, radius)) => DVec2::new(middle.x, middle.y + radius + LABEL_ABOVE_M),
        None => DVec2::new(0.0, LABEL_ON_WALL_M - content.size_m.y / 2.0),
    };
    let most = (content.size_m / 2.0 - half_size).max(DVec2::ZERO);
    let middle = wanted.clamp(-most, most);
    [middle.x, middle.y, half_size.x, half_size.y].map(|v| v as f32)
}

/// Leaves textures in the layout in which a VR runtime takes them (Vulkan's
/// `TRANSFER_SRC_OPTIMAL`).
pub(super) fn transition_to_copy_source<'t>(
    encoder: &mut wgpu::CommandEncoder,
    textures: impl Iterator<Item = &'t wgpu::Texture>,
) {
    let ready = |texture| wgpu::TextureTransition { texture, selector: None, state: wgpu::TextureUses::COPY_SRC };
    encoder.transition_resources(std::iter::empty(), textures.map(ready));
}

fn level_view(texture: &wgpu::Texture, level: u32) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        base_mip_level: level,
        mip_level_count: Some(1),
        ..Default::default()
    })
}

fn pipeline(gpu: &Gpu, shader: wgpu::ShaderModuleDescriptor) -> wgpu::RenderPipeline {
    let module = gpu.device.create_shader_module(shader);
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: None,
        layout: None,
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("corner"),
            compilation_options: Default::default(),
            buffers: &[],
        },
        primitive: Default::default(),
        depth_stencil: None,
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some("paint"),
            compilation_options: Default::default(),
            targets: &[Some(FORMAT.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}

/// Texture size in pixels for a size in metres, at least at the resolution of panels unless that exceeds the longest side. A texture
/// is stretched to its panel.
///
/// A runtime creates its copy anew whenever the size of an overlay's texture changes, and a panel's size changes with every estimate.
/// So sides are multiples of an eighth of the next power of two, and the size of the last texture, `last_px`, is kept as long as it
/// has enough pixels and at most [`MAX_SPARE`] times as many as needed. It shrinks in neither side while the other one grows.
pub(super) fn texture_size(size_m: DVec2, last_px: Option<[u32; 2]>) -> [u32; 2] {
    let scale = PIXELS_PER_M.min(MAX_SIDE_PX / size_m.max_element().max(1e-3));
    let least_px = (size_m * scale).to_array().map(|px| (px - 0.5).clamp(MIN_SIDE_PX, MAX_SIDE_PX).ceil() as u32);
    let stepped_px = least_px.map(|px| px.next_multiple_of(px.next_power_of_two() / 8));
    let grown_px =
        last_px.map(|last| [0, 1].map(|axis| if last[axis] < least_px[axis] { stepped_px[axis] } else { last[axis] }));
    let pixels = |[width, height]: [u32; 2]| u64::from(width) * u64::from(height);
    grown_px.filter(|grown| pixels(*grown) <= MAX_SPARE * pixels(least_px)).unwrap_or(stepped_px)
}

/// Grid spacing, metres, limited to a range that can be drawn.
fn spacing(style: &WarningSettings) -> f32 {
    let given = style.grid_spacing_m as f32;
    if given.is_finite() { given.clamp(0.05, 1.0) } else { 0.2 }
}

/// Linear red, green, blue of an sRGB colour; the fourth value is 1.
pub(super) fn linear(srgb: [u8; 3]) -> [f32; 4] {
    let [red, green, blue] = srgb.map(|v| {
        let v = f32::from(v) / 255.0;
        if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
    });
    [red, green, blue, 1.0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_kept_while_they_suffice() {
        // The width and height of an obstacle that is seen ever better, with noise of 3 cm.
        let mut last = None;
        let mut changes = 0;
        for step in 0..200 {
            let noise = DVec2::new((f64::from(step) * 2.3).sin(), (f64::from(step) * 1.7).cos()) * 0.03;
            let size_m = DVec2::new(0.5, 0.9) * (1.0 + 0.3 * f64::from(step) / 200.0) + noise;
            let size_px = texture_size(size_m, last);
            let least_px = (size_m * PIXELS_PER_M).to_array().map(|px| px - 0.5);
            assert!(f64::from(size_px[0]) >= least_px[0] && f64::from(size_px[1]) >= least_px[1]);
            changes += u32::from(last.replace(size_px) != Some(size_px));
        }
        assert!(changes <= 8, "{changes} sizes");
    }

    #[test]
    fn a_texture_has_at_most_twice_the_pixels_that_are_needed() {
        let large = texture_size(DVec2::new(1.8, 1.2), None);
        let small_m = DVec2::new(0.5, 0.5);
        assert_eq!(texture_size(small_m, Some(large)), texture_size(small_m, None));
        assert_eq!(texture_size(DVec2::new(1.5, 1.0), Some(large)), large);
        assert_eq!(texture_size(DVec2::ZERO, None), [MIN_SIDE_PX as u32; 2]);
        assert!(texture_size(DVec2::splat(100.0), Some(large)).iter().all(|side| f64::from(*side) <= MAX_SIDE_PX));
    }
}
