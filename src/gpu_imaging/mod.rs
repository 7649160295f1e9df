//! Dense volumes on the graphics card (wgpu): every statistic, and the fine coherent image.
//!
//! The kernel computes the formulas of docs/method.md at every voxel in f32, with range compression
//! from tables as fine as the CPU's. It agrees with the oracle to 0.5 % of the volume's peak, except
//! for voxels within 0.1 mm of an edge of range or beam, which may count differently. Bits depend
//! on the card and its driver; the CPU's do not.
//!
//! A game may share the card, so work is divided into dispatches of about 2 ms, and each is awaited
//! before the next.

mod job;
mod pace;

use std::collections::BTreeMap;
use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;
use wgpu::BufferUsages;

use crate::render::{Gpu, RenderError};
use job::{Batch, Job, Kind, RunParameters};
use pace::Pace;
use radar_sar::geometry::Aabb;
use radar_sar::subaperture::{FineImage, MEAN_LOG_OF_NOISE, SubapertureSettings};
use radar_sar::{Beam, Observation, Statistic, Volume, WAVELENGTH_M};

/// Voxels along a brick's edge, and in a brick: a workgroup.
const EDGE: usize = 4;
const VOXELS: usize = EDGE * EDGE * EDGE;
/// Bricks whose sums are on the card at once. Source: the number of workgroups that every card
/// dispatches along one axis (WebGPU); their sums take 64 MiB.
const MAX_BRICKS: usize = 65_535;
/// Greatest size of the tables that are on the card at once, bytes. Choice: sweeps of a minute,
/// and within the 128 MiB that every card binds (WebGPU).
const MAX_TABLE_BYTES: usize = 64 << 20;

/// Images on a graphics card.
pub struct GpuImager {
    gpu: Gpu,
    pace: Pace,
    layout: wgpu::BindGroupLayout,
    /// Compiled at first use.
    pipelines: BTreeMap<Kind, Pipelines>,
    /// Kept from volume to volume, since allocating them takes longer than a small volume.
    slab: Option<Slab>,
}

/// A volume from a graphics card and the work that it took.
#[derive(Debug, Clone, PartialEq)]
pub struct GpuVolume {
    /// The statistic's value at every voxel.
    pub volume: Volume,
    /// (voxel, sweep) pairs.
    pub updates: u64,
    /// The work on the card.
    pub work: GpuWork,
}

/// Work of a volume on the card.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct GpuWork {
    /// Dispatches.
    pub dispatches: u64,
    /// Sum of their times, from submission to completion, seconds.
    pub sum_s: f64,
    /// The longest one, seconds.
    pub longest_s: f64,
}

impl GpuWork {
    /// Counts a dispatch.
    fn add(&mut self, seconds: f64) {
        self.dispatches += 1;
        self.sum_s += seconds;
        self.longest_s = self.longest_s.max(seconds);
    }
}

/// The constants of one dispatch, as the kernel reads them.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Chunk {
    corner_m: [f32; 3],
    voxel_m: f32,
    bricks_x: u32,
    bricks_y: u32,
    first_brick: u32,
    base_brick: u32,
    first_run: u32,
    runs: u32,
    cut_cos: f32,
    share: f32,
    part: u32,
    is_beam_solid: u32,
    padding: [u32; 2],
}

impl GpuImager {
    /// Opens the fastest graphics card, or a software renderer if there is none.
    ///
    /// # Errors
    /// [`RenderError::NoAdapter`] if the machine has neither; [`RenderError::NoDevice`] if the
    /// adapter cannot be used.
    pub fn open() -> Result<Self, RenderError> {
        let limits = |offered: &wgpu::Limits| wgpu::Limits::default().using_resolution(offered.clone());
        let gpu = Gpu::headless_with(limits)?;
        let layout = bind_group_layout(&gpu.device);
        Ok(Self { gpu, pace: Pace::default(), layout, pipelines: BTreeMap::new(), slab: None })
    }

    /// Sets the time of one dispatch, seconds, for a card that is shared otherwise than with a game.
    pub fn set_dispatch_time(&mut self, dispatch_s: f64) {
        self.pace = Pace::new(dispatch_s);
    }

    /// Name of the graphics adapter.
    pub fn adapter_name(&self) -> &str {
        &self.gpu.name
    }

    /// Whether the adapter is a software renderer, which is slower than the program's own kernels.
    pub fn is_software(&self) -> bool {
        self.gpu.is_software
    }

    /// A statistic over all usable sweeps, at every voxel of a box: as
    /// [`radar_sar::backprojection::dense_volume`] and [`radar_sar::subaperture_volume`].
    ///
    /// # Errors
    /// [`RenderError::DeviceLost`] or [`RenderError::Device`] if the card fails.
    pub fn volume(
        &mut self,
        statistic: Statistic,
        beam: &Beam,
        settings: &SubapertureSettings,
        observations: &[Observation],
        region: &Aabb,
        voxel_m: f64,
    ) -> Result<GpuVolume, RenderError> {
        let mut volume = Volume::covering(region, voxel_m);
        let origin_m = volume.region().center();
        let job = Job::statistic(statistic, beam, settings, observations, origin_m);
        let work = self.run(&job, std::slice::from_mut(&mut volume))?;
        let updates = (volume.values.len() * job.sweeps()) as u64;
        Ok(GpuVolume { volume, updates, work })
    }

    /// The fine coherent image of a region, from sub-apertures of which every sweep covers it: as
    /// [`radar_sar::subaperture::fine_image`], for voxels of any size. `None` if no sub-aperture
    /// covers the region.
    ///
    /// # Errors
    /// [`RenderError::DeviceLost`] or [`RenderError::Device`] if the card fails.
    pub fn fine_image(
        &mut self,
        settings: &SubapertureSettings,
        observations: &[Observation],
        region: &Aabb,
        voxel_m: f64,
        per_aperture: usize,
    ) -> Result<Option<FineImage>, RenderError> {
        let job = Job::fine(settings, observations, [region.center(), region.size()], per_aperture);
        if job.runs() == 0 {
            return Ok(None);
        }
        let mut parts = [0, 1].map(|_| Volume::covering(region, voxel_m));
        self.run(&job, &mut parts)?;
        let [coherent, incoherent] = parts;
        Ok(Some(FineImage { coherent, incoherent, apertures: job.runs() }))
    }

    /// Computes a job's results over the voxels of volumes, all over the same box.
    fn run(&mut self, job: &Job, results: &mut [Volume]) -> Result<GpuWork, RenderError> {
        let (gpu, layout) = (&self.gpu, &self.layout);
        self.pipelines.entry(job.kind).or_insert_with(|| Pipelines::new(gpu, layout, job));
        let grid = results[0].size.map(|n| n.div_ceil(EDGE));
        let (count, mut work) = (grid.iter().product::<usize>(), GpuWork::default());
        let at_once = count.min(MAX_BRICKS);
        let slab = match self.slab.take() {
            Some(slab) if slab.bricks >= at_once => self.slab.insert(slab),
            _ => self.slab.insert(Slab::new(gpu, at_once)),
        };
        let buffers = Buffers::new(gpu, slab, job, &results[0], grid);
        gpu.check()?;
        let batches = job.batches(MAX_TABLE_BYTES / size_of::<[f32; 2]>());
        let mut loaded: Option<(usize, wgpu::BindGroup, Vec<RunParameters>)> = None;
        for first in (0..count).step_by(MAX_BRICKS) {
            let some = first..count.min(first + MAX_BRICKS);
            buffers.clear(&self.gpu);
            for (n, runs) in batches.iter().enumerate() {
                // One batch stays for all slabs.
                let (_, bound, runs) = match loaded.take() {
                    Some(batch) if batch.0 == n => loaded.insert(batch),
                    _ => {
                        let batch = job.batch(runs.clone());
                        loaded.insert((n, buffers.bind(&self.gpu, &self.layout, &batch), batch.runs))
                    }
                };
                self.pace.add(runs, &some, &mut work, |runs, bricks| {
                    let chunk = Chunk {
                        first_brick: bricks.start as u32,
                        base_brick: some.start as u32,
                        first_run: runs.start as u32,
                        runs: runs.len() as u32,
                        ..buffers.constants
                    };
                    buffers.dispatch(&self.gpu, &self.pipelines[&job.kind].add, bound, &chunk, bricks.len(), 0);
                    self.gpu.wait()
                })?;
            }
            let Some((_, bound, _)) = &loaded else { return Ok(work) };
            for (part, volume) in (0..).zip(&mut *results) {
                let chunk = Chunk { part, ..buffers.constants };
                let bytes = (some.len() * VOXELS * size_of::<f32>()) as u64;
                let finish = &self.pipelines[&job.kind].finish;
                buffers.dispatch(&self.gpu, finish, bound, &chunk, some.len(), bytes);
                self.gpu.read_buffer(&slab.copy, bytes, |bytes| {
                    put_bricks(volume, grid, some.clone(), bytemuck::cast_slice(bytes));
                })?;
            }
        }
        Ok(work)
    }
}

/// Writes bricks' values, which lie brick by brick, into a volume.
fn put_bricks(volume: &mut Volume, grid: [usize; 3], bricks: Range<usize>, values: &[f32]) {
    let [nx, ny, _] = volume.size;
    let in_layer = grid[0] * grid[1];
    let layers = volume.values.par_chunks_mut(EDGE * nx * ny).enumerate();
    layers.skip(bricks.start / in_layer).take(bricks.len().div_ceil(in_layer) + 1).for_each(|(z, out)| {
        let some = bricks.start.max(z * in_layer)..bricks.end.min((z + 1) * in_layer);
        for brick in some {
            let values = &values[(brick - bricks.start) * VOXELS..][..VOXELS];
            let [x, y] = [brick % grid[0], brick / grid[0] % grid[1]].map(|n| n * EDGE);
            let wide = EDGE.min(nx - x);
            for (layer, values) in out.chunks_exact_mut(nx * ny).zip(values.chunks_exact(EDGE * EDGE)) {
                for (row, values) in (y..ny).zip(values.chunks_exact(EDGE)) {
                    layer[row * nx + x..][..wide].copy_from_slice(&values[..wide]);
                }
            }
        }
    });
}

/// What the card executes for one kind of sum.
struct Pipelines {
    add: wgpu::ComputePipeline,
    finish: wgpu::ComputePipeline,
}

impl Pipelines {
    fn new(gpu: &Gpu, layout: &wgpu::BindGroupLayout, job: &Job) -> Self {
        let device = &gpu.device;
        let shader = device.create_shader_module(wgpu::include_wgsl!("../../overlay_assets/shaders/imaging.wgsl"));
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: None,
            bind_group_layouts: &[Some(layout)],
            immediate_size: 0,
        });
        // The beam's table covers cosines from −1 to 1.
        let entries_per_cos = 0.5 * (job.beam.amplitudes.len() - 1) as f64;
        let constants = [
            ("KIND", f64::from(job.kind as u32)),
            ("ENTRIES_PER_COS", entries_per_cos),
            ("MEAN_LOG_OF_NOISE", MEAN_LOG_OF_NOISE),
            ("CYCLES_PER_M", 2.0 / WAVELENGTH_M),
        ];
        let [add, finish] = ["add_runs", "finish"].map(|entry_point| {
            device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: None,
                layout: Some(&pipeline_layout),
                module: &shader,
                entry_point: Some(entry_point),
                compilation_options: wgpu::PipelineCompilationOptions { constants: &constants, ..Default::default() },
                cache: None,
            })
        });
        Self { add, finish }
    }
}

/// What the card holds of bricks that are computed at once.
struct Slab {
    bricks: usize,
    sums: wgpu::Buffer,
    values: wgpu::Buffer,
    /// The values where the processor reads them.
    copy: wgpu::Buffer,
}

impl Slab {
    fn new(gpu: &Gpu, bricks: usize) -> Self {
        let voxels = (bricks * VOXELS) as u64;
        let bytes = voxels * size_of::<f32>() as u64;
        Self {
            bricks,
            sums: empty(gpu, 4 * bytes, BufferUsages::STORAGE | BufferUsages::COPY_DST),
            values: empty(gpu, bytes, BufferUsages::STORAGE | BufferUsages::COPY_SRC),
            copy: gpu.readable(bytes),
        }
    }
}

fn empty(gpu: &Gpu, size: u64, usage: BufferUsages) -> wgpu::Buffer {
    gpu.device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false })
}

/// The buffers of one job.
struct Buffers<'a> {
    slab: &'a Slab,
    chunk: wgpu::Buffer,
    beam: wgpu::Buffer,
    /// Without what changes from dispatch to dispatch.
    constants: Chunk,
}

impl<'a> Buffers<'a> {
    fn new(gpu: &Gpu, slab: &'a Slab, job: &Job, volume: &Volume, grid: [usize; 3]) -> Self {
        // One more entry: interpolation reads the entry after the last one.
        let mut amplitudes = job.beam.amplitudes.clone();
        amplitudes.extend(amplitudes.last().copied());
        let corner_m = volume.origin_m - volume.region().center();
        Self {
            slab,
            chunk: empty(gpu, size_of::<Chunk>() as u64, BufferUsages::UNIFORM | BufferUsages::COPY_DST),
            beam: gpu.buffer(bytemuck::cast_slice(&amplitudes), BufferUsages::STORAGE),
            constants: Chunk {
                corner_m: corner_m.as_vec3().to_array(),
                voxel_m: volume.voxel_m as f32,
                bricks_x: grid[0] as u32,
                bricks_y: grid[1] as u32,
                cut_cos: job.beam.cut_cos,
                is_beam_solid: u32::from(job.beam.solid),
                share: job.share,
                ..Chunk::zeroed()
            },
        }
    }

    /// Writes a batch to the card.
    fn bind(&self, gpu: &Gpu, layout: &wgpu::BindGroupLayout, batch: &Batch) -> wgpu::BindGroup {
        let storage = |bytes: &[u8]| gpu.buffer(bytes, BufferUsages::STORAGE);
        let sweeps = storage(bytemuck::cast_slice(&batch.sweeps));
        let runs = storage(bytemuck::cast_slice(&batch.runs));
        let tables = storage(bytemuck::cast_slice(&batch.tables));
        let buffers = [&self.chunk, &sweeps, &runs, &tables, &self.beam, &self.slab.sums, &self.slab.values];
        let entries: Vec<wgpu::BindGroupEntry> = (0..)
            .zip(buffers)
            .map(|(binding, buffer)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() })
            .collect();
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
    }

    fn clear(&self, gpu: &Gpu) {
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        encoder.clear_buffer(&self.slab.sums, 0, None);
        gpu.queue.submit([encoder.finish()]);
    }

    /// Submits a dispatch, and a copy of so many bytes of the values.
    fn dispatch(
        &self,
        gpu: &Gpu,
        pipeline: &wgpu::ComputePipeline,
        bound: &wgpu::BindGroup,
        chunk: &Chunk,
        workgroups: usize,
        copy_bytes: u64,
    ) {
        gpu.queue.write_buffer(&self.chunk, 0, bytemuck::bytes_of(chunk));
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, bound, &[]);
        pass.dispatch_workgroups(workgroups as u32, 1, 1);
        drop(pass);
        if copy_bytes > 0 {
            encoder.copy_buffer_to_buffer(&self.slab.values, 0, &self.slab.copy, 0, copy_bytes);
        }
        gpu.queue.submit([encoder.finish()]);
    }
}

/// The buffers in the order of the kernel's bindings: constants, four to read, two to write.
fn bind_group_layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    let entry = |binding: u32| wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer {
            ty: match binding {
                0 => wgpu::BufferBindingType::Uniform,
                _ => wgpu::BufferBindingType::Storage { read_only: binding <= 4 },
            },
            has_dynamic_offset: false,
            min_binding_size: None,
        },
        count: None,
    };
    let entries: Vec<_> = (0..=6).map(entry).collect();
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: None, entries: &entries })
}
