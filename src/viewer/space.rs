//! Draws a [`Drawing`] on the GPU: to a texture, with four samples per pixel and depth. Positions
//! reach the GPU relative to the eye, with the difference taken in f64, so precision does not
//! depend on the distance to the origin.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use super::camera::Eye;
use super::drawing::{Drawing, Face};
use super::style;

/// Format of the target texture. sRGB colours are stored unconverted, as egui expects.
pub const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;
/// Samples per pixel. Choice: every adapter must support four (WebGPU), and edges look smooth.
const SAMPLES: u32 = 4;
/// Lines are clipped at this distance from the eye, metres. Choice: just beyond the near plane,
/// where a line's width has no meaning.
const LINE_NEAR_M: f32 = 0.04;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct EyeUniform {
    clip_from_offset: [f32; 16],
    right: [f32; 4],
    up: [f32; 4],
    view: [f32; 4],
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct FaceCorner {
    position: [f32; 3],
    color: [f32; 4],
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct BallInstance {
    place_and_radius: [f32; 4],
    color: [f32; 4],
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct LineInstance {
    from: [f32; 3],
    to: [f32; 3],
    color: [f32; 4],
    width_px: f32,
}

/// The pipelines, and the target of the current size.
pub struct Space {
    faces: wgpu::RenderPipeline,
    balls: wgpu::RenderPipeline,
    lines: wgpu::RenderPipeline,
    transparent_faces: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
    canvas: Option<Canvas>,
}

struct Canvas {
    picture: wgpu::Texture,
    samples: wgpu::TextureView,
    depth: wgpu::TextureView,
}

impl Space {
    /// Creates the pipelines.
    pub fn new(device: &wgpu::Device) -> Self {
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: None,
            entries: &[wgpu::BindGroupLayoutEntry {
                binding: 0,
                visibility: wgpu::ShaderStages::VERTEX,
                ty: wgpu::BindingType::Buffer {
                    ty: wgpu::BufferBindingType::Uniform,
                    has_dynamic_offset: false,
                    min_binding_size: None,
                },
                count: None,
            }],
        });
        let module = device.create_shader_module(wgpu::include_wgsl!("../../overlay_assets/shaders/space.wgsl"));
        let part = |part| pipeline(device, &module, &layout, part);
        let corner = wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x4];
        let ball = wgpu::vertex_attr_array![0 => Float32x4, 1 => Float32x4];
        let line = wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x3, 2 => Float32x4, 3 => Float32];
        let triangles = wgpu::PrimitiveTopology::TriangleList;
        let strip = wgpu::PrimitiveTopology::TriangleStrip;
        Self {
            faces: part(Part {
                entries: ["face_corner", "plain"],
                vertices: vertices::<FaceCorner>(wgpu::VertexStepMode::Vertex, &corner),
                topology: triangles,
                hides: true,
            }),
            balls: part(Part {
                entries: ["ball_corner", "ball"],
                vertices: vertices::<BallInstance>(wgpu::VertexStepMode::Instance, &ball),
                topology: strip,
                hides: true,
            }),
            lines: part(Part {
                entries: ["line_corner", "plain"],
                vertices: vertices::<LineInstance>(wgpu::VertexStepMode::Instance, &line),
                topology: strip,
                hides: false,
            }),
            transparent_faces: part(Part {
                entries: ["face_corner", "plain"],
                vertices: vertices::<FaceCorner>(wgpu::VertexStepMode::Vertex, &corner),
                topology: triangles,
                hides: false,
            }),
            layout,
            canvas: None,
        }
    }

    /// Draws. Returns the target, and whether it is a new texture.
    pub fn draw(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        size_px: [u32; 2],
        (eye, drawing): (&Eye, &Drawing),
    ) -> (&wgpu::Texture, bool) {
        let is_kept = self.canvas.as_ref().is_some_and(|c| [c.picture.width(), c.picture.height()] == size_px);
        if !is_kept {
            self.canvas = None;
        }
        let origin = eye.tracking_from_eye.translation;
        let faces = corners(&drawing.faces, origin);
        let transparent_faces = corners(&far_to_near(&drawing.transparent_faces, origin), origin);
        let (balls, lines) = (balls(drawing, origin), lines(drawing, origin));
        let eye = self.bind(device, queue, eye, size_px);
        let canvas = self.canvas.get_or_insert_with(|| Canvas::new(device, size_px));
        {
            let mut pass = canvas.begin(encoder);
            pass.set_bind_group(0, &eye, &[]);
            let mut part = |pipeline: &wgpu::RenderPipeline, bytes: &[u8], vertices: u32, instances: u32| {
                if !bytes.is_empty() {
                    let buffer = buffer(device, queue, bytes, wgpu::BufferUsages::VERTEX);
                    pass.set_pipeline(pipeline);
                    pass.set_vertex_buffer(0, buffer.slice(..));
                    pass.draw(0..vertices, 0..instances);
                }
            };
            part(&self.faces, bytemuck::cast_slice(&faces), faces.len() as u32, 1);
            part(&self.balls, bytemuck::cast_slice(&balls), 4, balls.len() as u32);
            part(&self.lines, bytemuck::cast_slice(&lines), 4, lines.len() as u32);
            part(&self.transparent_faces, bytemuck::cast_slice(&transparent_faces), transparent_faces.len() as u32, 1);
        }
        (&canvas.picture, !is_kept)
    }

    fn bind(&self, device: &wgpu::Device, queue: &wgpu::Queue, eye: &Eye, size_px: [u32; 2]) -> wgpu::BindGroup {
        let rotation = eye.tracking_from_eye.rotation;
        let uniform = EyeUniform {
            clip_from_offset: eye.clip_from_offset().as_mat4().to_cols_array(),
            right: (rotation * DVec3::X).as_vec3().extend(0.0).to_array(),
            up: (rotation * DVec3::Y).as_vec3().extend(0.0).to_array(),
            view: [size_px[0] as f32, size_px[1] as f32, LINE_NEAR_M, 0.0],
        };
        let buffer = buffer(device, queue, bytemuck::bytes_of(&uniform), wgpu::BufferUsages::UNIFORM);
        device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &self.layout,
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: buffer.as_entire_binding() }],
        })
    }
}

impl Canvas {
    fn new(device: &wgpu::Device, [width, height]: [u32; 2]) -> Self {
        let texture = |format, sample_count, usage| {
            device.create_texture(&wgpu::TextureDescriptor {
                label: None,
                size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT | usage,
                view_formats: &[],
            })
        };
        let view = |format| texture(format, SAMPLES, wgpu::TextureUsages::empty()).create_view(&Default::default());
        let picture = texture(FORMAT, 1, wgpu::TextureUsages::TEXTURE_BINDING);
        Self { picture, samples: view(FORMAT), depth: view(DEPTH) }
    }

    fn begin<'e>(&self, encoder: &'e mut wgpu::CommandEncoder) -> wgpu::RenderPass<'e> {
        let [r, g, b, _] = style::rgba(style::GROUND, 1.0).map(f64::from);
        encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &self.samples,
                depth_slice: None,
                resolve_target: Some(&self.picture.create_view(&Default::default())),
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color { r, g, b, a: 1.0 }),
                    store: wgpu::StoreOp::Discard,
                },
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

fn far_to_near(transparent_faces: &[Face], eye_m: DVec3) -> Vec<Face> {
    let distance = |face: &Face| (face.corners_m.iter().sum::<DVec3>() / 3.0).distance_squared(eye_m);
    let mut order: Vec<(f64, Face)> = transparent_faces.iter().map(|face| (distance(face), *face)).collect();
    order.sort_by(|a, b| b.0.total_cmp(&a.0));
    order.into_iter().map(|(_, face)| face).collect()
}

fn corners(faces: &[Face], origin: DVec3) -> Vec<FaceCorner> {
    let corner = |position: DVec3, color| FaceCorner { position: (position - origin).as_vec3().to_array(), color };
    faces.iter().flat_map(|face| face.corners_m.map(|position| corner(position, face.color))).collect()
}

fn balls(drawing: &Drawing, origin: DVec3) -> Vec<BallInstance> {
    let ball = |point: &super::drawing::Point| BallInstance {
        place_and_radius: (point.position_m - origin).as_vec3().extend(point.radius_m).to_array(),
        color: point.color,
    };
    drawing.points.iter().map(ball).collect()
}

fn lines(drawing: &Drawing, origin: DVec3) -> Vec<LineInstance> {
    let line = |line: &super::drawing::Line| LineInstance {
        from: (line.from_m - origin).as_vec3().to_array(),
        to: (line.to_m - origin).as_vec3().to_array(),
        color: line.color,
        width_px: line.width_px,
    };
    drawing.lines.iter().map(line).collect()
}

fn buffer(device: &wgpu::Device, queue: &wgpu::Queue, bytes: &[u8], usage: wgpu::BufferUsages) -> wgpu::Buffer {
    let buffer = device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: bytes.len() as u64,
        usage: usage | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    queue.write_buffer(&buffer, 0, bytes);
    buffer
}

fn vertices<T>(step_mode: wgpu::VertexStepMode, attributes: &[wgpu::VertexAttribute]) -> wgpu::VertexBufferLayout<'_> {
    wgpu::VertexBufferLayout { array_stride: size_of::<T>() as u64, step_mode, attributes }
}

/// What distinguishes one pipeline from another.
struct Part<'a> {
    /// Vertex and fragment entry points.
    entries: [&'a str; 2],
    vertices: wgpu::VertexBufferLayout<'a>,
    topology: wgpu::PrimitiveTopology,
    /// Whether it occludes what is behind it.
    hides: bool,
}

fn pipeline(
    device: &wgpu::Device,
    module: &wgpu::ShaderModule,
    layout: &wgpu::BindGroupLayout,
    part: Part,
) -> wgpu::RenderPipeline {
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        bind_group_layouts: &[Some(layout)],
        ..Default::default()
    });
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: None,
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module,
            entry_point: Some(part.entries[0]),
            compilation_options: Default::default(),
            buffers: &[Some(part.vertices)],
        },
        primitive: wgpu::PrimitiveState { topology: part.topology, ..Default::default() },
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH,
            depth_write_enabled: Some(part.hides),
            depth_compare: Some(wgpu::CompareFunction::GreaterEqual),
            stencil: Default::default(),
            bias: Default::default(),
        }),
        multisample: wgpu::MultisampleState { count: SAMPLES, mask: !0, alpha_to_coverage_enabled: false },
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some(part.entries[1]),
            compilation_options: Default::default(),
            targets: &[Some(wgpu::ColorTargetState {
                format: FORMAT,
                blend: Some(wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING),
                write_mask: wgpu::ColorWrites::ALL,
            })],
        }),
        multiview_mask: None,
        cache: None,
    })
}
