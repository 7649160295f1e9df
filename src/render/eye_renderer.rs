//! Draws the parts of one eye's view: backdrop, dots at the true objects, balls of obstacle shapes,
//! quads. [`super::preview`] and [`super::stereo`] combine the parts.
//!
//! Four samples per pixel, one depth buffer, reversed depth (nearer is greater). Dots and balls
//! occlude what is behind them. Quads are depth-tested against these and blended from far to near.
//! Positions reach the GPU relative to the eye, with the difference taken in f64, so precision does
//! not depend on the distance to the origin.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use super::eye::EyeView;
use super::gpu::{FORMAT, Gpu};
use super::quads::Quad;

/// Samples per pixel. Choice: every adapter must support four (WebGPU), and edges look smooth.
const SAMPLES: u32 = 4;
const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct EyeUniform {
    clip_from_offset: [f32; 16],
    right: [f32; 4],
    up: [f32; 4],
    back: [f32; 4],
    tangents: [f32; 4],
    on_floor: [f32; 2],
    height: f32,
    pixel: f32,
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct QuadCorner {
    position: [f32; 3],
    uv: [f32; 2],
    alpha: f32,
}

/// A ball in the room.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ball {
    /// Centre, tracking frame, metres.
    pub position_m: DVec3,
    /// Radius, metres.
    pub radius_m: f64,
    /// Linear red, green, blue, premultiplied by alpha, and alpha.
    pub color: [f32; 4],
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct BallInstance {
    place_and_radius: [f32; 4],
    color: [f32; 4],
}

/// Pipelines of all parts.
pub(super) struct EyeRenderer {
    backdrop: wgpu::RenderPipeline,
    dots: wgpu::RenderPipeline,
    balls: wgpu::RenderPipeline,
    quads: wgpu::RenderPipeline,
    eye_layout: wgpu::BindGroupLayout,
    image_layout: wgpu::BindGroupLayout,
    sampler: wgpu::Sampler,
}

/// GPU data of one eye's view.
pub(super) struct DrawList {
    eye: wgpu::BindGroup,
    /// Dots, balls and quad corners, one after the other, with the byte offsets of the latter two.
    vertices: wgpu::Buffer,
    balls_at: u64,
    corners_at: u64,
    dot_count: u32,
    ball_count: u32,
    images: Vec<wgpu::BindGroup>,
}

impl EyeRenderer {
    pub fn new(gpu: &Gpu) -> Self {
        let eye_layout = eye_layout(gpu);
        let image_layout = image_layout(gpu);
        let module = gpu.device.create_shader_module(wgpu::include_wgsl!("../../overlay_assets/shaders/view.wgsl"));
        let part = |part| pipeline(gpu, &module, &[Some(&eye_layout), Some(&image_layout)], part);
        let corner = wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x2, 2 => Float32];
        let dot = wgpu::vertex_attr_array![0 => Float32x4];
        let backdrop = part(Part {
            entries: ["backdrop_corner", "backdrop"],
            vertices: None,
            depth: (false, wgpu::CompareFunction::Always),
            blend: None,
            alpha_to_coverage: false,
        });
        let dots = part(Part {
            entries: ["dot_corner", "ball"],
            vertices: Some(layout::<[f32; 4]>(wgpu::VertexStepMode::Instance, &dot)),
            depth: (true, wgpu::CompareFunction::Greater),
            blend: None,
            alpha_to_coverage: true,
        });
        let ball = wgpu::vertex_attr_array![0 => Float32x4, 1 => Float32x4];
        let balls = part(Part {
            entries: ["ball_corner", "shape_ball"],
            vertices: Some(layout::<BallInstance>(wgpu::VertexStepMode::Instance, &ball)),
            depth: (true, wgpu::CompareFunction::Greater),
            blend: None,
            alpha_to_coverage: false,
        });
        let quads = part(Part {
            entries: ["quad_corner", "quad"],
            vertices: Some(layout::<QuadCorner>(wgpu::VertexStepMode::Vertex, &corner)),
            depth: (false, wgpu::CompareFunction::Greater),
            blend: Some(wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING),
            alpha_to_coverage: false,
        });
        let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            mipmap_filter: wgpu::MipmapFilterMode::Linear,
            anisotropy_clamp: 8,
            ..Default::default()
        });
        Self { backdrop, dots, balls, quads, eye_layout, image_layout, sampler }
    }

    /// Uploads what one eye sees of dots (points and radii, metres), balls and quads.
    pub fn draw_list(
        &self,
        gpu: &Gpu,
        view: &EyeView,
        dots: &[(DVec3, f64)],
        balls: &[Ball],
        quads: &[&Quad],
    ) -> DrawList {
        let order = far_to_near(quads, view);
        let corners: Vec<QuadCorner> = order.iter().flat_map(|quad| quad_corners(quad, view)).collect();
        let dots = dot_instances(dots, view);
        let balls = ball_instances(balls, view);
        let (dot_bytes, ball_bytes) = (bytemuck::cast_slice(&dots), bytemuck::cast_slice(&balls));
        let bytes: Vec<u8> = [dot_bytes, ball_bytes, bytemuck::cast_slice(&corners)].concat();
        DrawList {
            eye: self.bind_eye(gpu, view),
            vertices: gpu.buffer(&bytes, wgpu::BufferUsages::VERTEX),
            balls_at: dot_bytes.len() as u64,
            corners_at: (dot_bytes.len() + ball_bytes.len()) as u64,
            dot_count: dots.len() as u32,
            ball_count: balls.len() as u32,
            images: order.iter().map(|quad| self.bind_image(gpu, &quad.texture)).collect(),
        }
    }

    /// Fills the image with the floor and horizon of a dark room.
    pub fn draw_backdrop(&self, pass: &mut wgpu::RenderPass, sight: &DrawList) {
        pass.set_bind_group(0, &sight.eye, &[]);
        pass.set_pipeline(&self.backdrop);
        pass.draw(0..3, 0..1);
    }

    /// Dots, balls and quads.
    pub fn draw_objects(&self, pass: &mut wgpu::RenderPass, sight: &DrawList) {
        pass.set_bind_group(0, &sight.eye, &[]);
        let instances = [(&self.dots, 0, sight.dot_count), (&self.balls, sight.balls_at, sight.ball_count)];
        for (pipeline, at, count) in instances.into_iter().filter(|(.., count)| *count > 0) {
            pass.set_pipeline(pipeline);
            pass.set_vertex_buffer(0, sight.vertices.slice(at..));
            pass.draw(0..4, 0..count);
        }
        if !sight.images.is_empty() {
            pass.set_pipeline(&self.quads);
            pass.set_vertex_buffer(0, sight.vertices.slice(sight.corners_at..));
        }
        for (first, image) in (0..).step_by(4).zip(&sight.images) {
            pass.set_bind_group(1, image, &[]);
            pass.draw(first..first + 4, 0..1);
        }
    }

    fn bind_eye(&self, gpu: &Gpu, view: &EyeView) -> wgpu::BindGroup {
        let axis = |v: DVec3| view.tracking_from_eye.transform_vector(v).as_vec3().extend(0.0).to_array();
        let at = view.tracking_from_eye.translation;
        let [left, right, ..] = view.edges();
        let uniform = EyeUniform {
            clip_from_offset: view.clip_from_offset().to_cols_array(),
            right: axis(DVec3::X),
            up: axis(DVec3::Y),
            back: axis(DVec3::Z),
            tangents: view.edges().map(|t| t as f32),
            on_floor: [(at.x - at.x.floor()) as f32, (at.z - at.z.floor()) as f32],
            height: at.y as f32,
            pixel: ((right - left) / f64::from(view.size_px[0])) as f32,
        };
        let buffer = gpu.buffer(bytemuck::bytes_of(&uniform), wgpu::BufferUsages::UNIFORM);
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &self.eye_layout,
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: buffer.as_entire_binding() }],
        })
    }

    fn bind_image(&self, gpu: &Gpu, texture: &wgpu::Texture) -> wgpu::BindGroup {
        let view = texture.create_view(&Default::default());
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &self.image_layout,
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::TextureView(&view) },
                wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::Sampler(&self.sampler) },
            ],
        })
    }
}

/// Multisampled colour and depth buffers of one size. Images are drawn here and then resolved.
pub(super) struct Canvas {
    samples: wgpu::TextureView,
    depth: wgpu::TextureView,
}

impl Canvas {
    pub fn new(gpu: &Gpu, size_px: [u32; 2]) -> Self {
        let view = |format| gpu.target(size_px, format, SAMPLES).create_view(&Default::default());
        Self { samples: view(FORMAT), depth: view(DEPTH) }
    }

    /// Starts a pass that begins transparent and resolves into `picture`, which must have the size
    /// of the canvas.
    pub fn begin<'e>(&self, encoder: &'e mut wgpu::CommandEncoder, picture: &wgpu::Texture) -> wgpu::RenderPass<'e> {
        let nothing = wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT);
        encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &self.samples,
                depth_slice: None,
                resolve_target: Some(&picture.create_view(&Default::default())),
                ops: wgpu::Operations { load: nothing, store: wgpu::StoreOp::Discard },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &self.depth,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: wgpu::StoreOp::Discard }),
                stencil_ops: None,
            }),
            ..Default::default()
        })
    }
}

/// Quads on the floor first, then by decreasing distance from the eye.
fn far_to_near<'q>(quads: &[&'q Quad], view: &EyeView) -> Vec<&'q Quad> {
    let eye = view.tracking_from_eye.translation;
    let distance = |quad: &Quad| quad.tracking_from_quad.translation.distance(eye);
    let mut order: Vec<&Quad> = quads.iter().copied().filter(|quad| quad.alpha > 0.0).collect();
    order.sort_by(|a, b| b.on_floor.cmp(&a.on_floor).then(distance(b).total_cmp(&distance(a))));
    order
}

/// Corners in triangle-strip order.
fn quad_corners(quad: &Quad, view: &EyeView) -> [QuadCorner; 4] {
    [[0.0, 1.0], [1.0, 1.0], [0.0, 0.0], [1.0, 0.0]].map(|uv: [f64; 2]| {
        let on_quad = DVec3::new((uv[0] - 0.5) * quad.size_m.x, (0.5 - uv[1]) * quad.size_m.y, 0.0);
        let position = quad.tracking_from_quad.transform_point(on_quad) - view.tracking_from_eye.translation;
        QuadCorner { position: position.as_vec3().to_array(), uv: uv.map(|v| v as f32), alpha: quad.alpha }
    })
}

/// Positions relative to the eye, with radii. Non-finite entries are left out.
fn dot_instances(truth: &[(DVec3, f64)], view: &EyeView) -> Vec<[f32; 4]> {
    let eye = view.tracking_from_eye.translation;
    let sound = truth.iter().filter(|(position, radius)| position.is_finite() && radius.is_finite() && *radius >= 0.0);
    sound.map(|(position, radius)| (*position - eye).as_vec3().extend(*radius as f32).to_array()).collect()
}

fn ball_instances(balls: &[Ball], view: &EyeView) -> Vec<BallInstance> {
    let eye = view.tracking_from_eye.translation;
    let sound = balls.iter().filter(|ball| ball.position_m.is_finite() && ball.radius_m.is_finite());
    sound
        .map(|ball| BallInstance {
            place_and_radius: (ball.position_m - eye).as_vec3().extend(ball.radius_m as f32).to_array(),
            color: ball.color,
        })
        .collect()
}

fn layout<T>(step_mode: wgpu::VertexStepMode, attributes: &[wgpu::VertexAttribute]) -> wgpu::VertexBufferLayout<'_> {
    wgpu::VertexBufferLayout { array_stride: size_of::<T>() as u64, step_mode, attributes }
}

/// What distinguishes one pipeline from another.
struct Part<'a> {
    /// Vertex and fragment entry points.
    entries: [&'a str; 2],
    vertices: Option<wgpu::VertexBufferLayout<'a>>,
    /// Whether it writes depth, and the depth test.
    depth: (bool, wgpu::CompareFunction),
    blend: Option<wgpu::BlendState>,
    alpha_to_coverage: bool,
}

fn pipeline(
    gpu: &Gpu,
    module: &wgpu::ShaderModule,
    groups: &[Option<&wgpu::BindGroupLayout>],
    part: Part,
) -> wgpu::RenderPipeline {
    let bind_group_layouts = if part.blend.is_some() { groups } else { &groups[..1] };
    let layout =
        gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor { bind_group_layouts, ..Default::default() });
    let topology = if part.vertices.is_some() {
        wgpu::PrimitiveTopology::TriangleStrip
    } else {
        wgpu::PrimitiveTopology::TriangleList
    };
    let buffers: Vec<_> = part.vertices.into_iter().map(Some).collect();
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: None,
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module,
            entry_point: Some(part.entries[0]),
            compilation_options: Default::default(),
            buffers: &buffers,
        },
        primitive: wgpu::PrimitiveState { topology, ..Default::default() },
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH,
            depth_write_enabled: Some(part.depth.0),
            depth_compare: Some(part.depth.1),
            stencil: Default::default(),
            bias: Default::default(),
        }),
        multisample: wgpu::MultisampleState {
            count: SAMPLES,
            mask: !0,
            alpha_to_coverage_enabled: part.alpha_to_coverage,
        },
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some(part.entries[1]),
            compilation_options: Default::default(),
            targets: &[Some(wgpu::ColorTargetState {
                format: FORMAT,
                blend: part.blend,
                write_mask: wgpu::ColorWrites::ALL,
            })],
        }),
        multiview_mask: None,
        cache: None,
    })
}

fn eye_layout(gpu: &Gpu) -> wgpu::BindGroupLayout {
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: None,
        entries: &[wgpu::BindGroupLayoutEntry {
            binding: 0,
            visibility: wgpu::ShaderStages::VERTEX_FRAGMENT,
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Uniform,
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        }],
    })
}

fn image_layout(gpu: &Gpu) -> wgpu::BindGroupLayout {
    let entry =
        |binding, ty| wgpu::BindGroupLayoutEntry { binding, visibility: wgpu::ShaderStages::FRAGMENT, ty, count: None };
    let texture = wgpu::BindingType::Texture {
        sample_type: wgpu::TextureSampleType::Float { filterable: true },
        view_dimension: wgpu::TextureViewDimension::D2,
        multisampled: false,
    };
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: None,
        entries: &[entry(0, texture), entry(1, wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering))],
    })
}
