//! What the kernel sums: sweeps in runs, as the GPU's structures and tables.

use std::ops::Range;
use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use rayon::prelude::*;

use radar_sar::backprojection::BeamTable;
use radar_sar::subaperture::{SubapertureSettings, partition, taper};
use radar_sar::{Beam, Observation, RangeCompressor, Statistic, SweepGeometry, envelope, math};
use radar_sar::{subaperture_noise_rms, sweep_noise_rms};

/// Widest step of the tables, metres, and least number of steps per pulse width. Choice: as the
/// CPU's tables; linear interpolation of |z|² is then within 0.3 % of its peak.
const TABLE_STEP_M: f64 = 0.005;
const STEPS_PER_PULSE: f64 = 16.0;
/// Sweeps summed on their own before they are added to the total, for sums over single sweeps.
/// Choice: sums of 60 000 sweeps in f32 then round like sums of a thousand.
const RUN_SWEEPS: usize = 64;
/// Sub-apertures farther apart than this are not summed coherently, nanoseconds. Choice: as
/// [`radar_sar::subaperture::fine_image`].
const MAX_GAP_NS: i64 = 150_000_000;

/// What is summed at a voxel. The order is the kernel's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Kind {
    Amplitudes,
    Nearest,
    Power,
    LogPower,
    Glrt,
    Coherent,
    Subaperture,
    Fine,
}

impl Kind {
    pub(super) fn of(statistic: Statistic) -> Self {
        match statistic {
            Statistic::ThesisFull => Self::Amplitudes,
            Statistic::Thesis => Self::Nearest,
            Statistic::Ls => Self::Power,
            Statistic::Log => Self::LogPower,
            Statistic::Glrt => Self::Glrt,
            Statistic::Coherent => Self::Coherent,
            Statistic::Subaperture => Self::Subaperture,
        }
    }
}

/// A sweep as the kernel reads it.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(super) struct SweepParameters {
    position_m: [f32; 3],
    first_m: f32,
    velocity_m_per_s: [f32; 3],
    last_m: f32,
    forward: [f32; 3],
    entries_per_m: f32,
    time_s_per_m: f32,
    time_at_zero_s: f32,
    weight: f32,
    table: u32,
}

/// A run of sweeps as the kernel reads it.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(super) struct RunParameters {
    position_m: [f32; 3],
    pub first_sweep: u32,
    forward: [f32; 3],
    pub sweeps: u32,
    near_m2: f32,
    far_m2: f32,
    min_cos: f32,
    decay: f32,
}

/// A sweep with its taper and the factor of its samples.
#[derive(Debug, Clone, Copy)]
struct Member<'a> {
    observation: &'a Observation,
    weight: f64,
    scale: f64,
    axis: usize,
}

/// Sweeps that are summed together.
struct Run<'a> {
    members: Vec<Member<'a>>,
    /// Without place of its sweeps in the buffers.
    parameters: RunParameters,
}

/// All that is summed, for one origin.
pub(super) struct Job<'a> {
    pub kind: Kind,
    pub beam: Arc<BeamTable>,
    /// Factor of the results.
    pub share: f32,
    origin_m: DVec3,
    axes: Vec<Axis>,
    runs: Vec<Run<'a>>,
}

/// Runs that fit the GPU's buffers together.
pub(super) struct Batch {
    pub sweeps: Vec<SweepParameters>,
    pub runs: Vec<RunParameters>,
    pub tables: Vec<[f32; 2]>,
}

impl<'a> Job<'a> {
    /// A statistic over all usable sweeps.
    pub(super) fn statistic(
        statistic: Statistic,
        beam: &Beam,
        settings: &SubapertureSettings,
        observations: &'a [Observation],
        origin_m: DVec3,
    ) -> Self {
        let mut job = Self::empty(Kind::of(statistic), beam, origin_m);
        if statistic == Statistic::Subaperture {
            job.add_subapertures(beam, settings, observations);
            return job;
        }
        let usable: Vec<Member> = observations.iter().filter(|o| is_usable(o)).map(|o| job.member(o)).collect();
        job.runs = usable.chunks(RUN_SWEEPS).map(|members| Run::plain(members.to_vec())).collect();
        job
    }

    /// A fine image: sub-apertures that cover the region, at most `per_aperture` in each aperture.
    pub(super) fn fine(
        settings: &SubapertureSettings,
        observations: &'a [Observation],
        [center_m, size_m]: [DVec3; 2],
        per_aperture: usize,
    ) -> Self {
        let mut job = Self::empty(Kind::Fine, &Beam::Uniform, center_m);
        let (mut ends_ns, half_m) = (i64::MIN, 0.5 * size_m.length());
        let mut in_run = 0;
        for members in job.subapertures(settings, observations) {
            let middle = members[members.len() / 2].observation;
            let covers = |member: &Member| {
                let axis = &member.observation.geometry.axis;
                let distance_m = member.observation.tracking_from_sensor.translation.distance(center_m);
                axis.contains(distance_m - half_m) && axis.contains(distance_m + half_m)
            };
            if !members.iter().all(covers) {
                continue;
            }
            let gap_ns = middle.mid_time_ns.saturating_sub(ends_ns);
            ends_ns = middle.mid_time_ns;
            match job.runs.last_mut() {
                Some(run) if in_run < per_aperture && gap_ns <= MAX_GAP_NS => run.members.extend(members),
                _ => {
                    in_run = 0;
                    job.runs.push(Run::plain(members));
                }
            }
            in_run += 1;
        }
        job.share = 1.0 / job.runs.len().max(1) as f32;
        job
    }

    fn empty(kind: Kind, beam: &Beam, origin_m: DVec3) -> Self {
        Self { kind, beam: BeamTable::of(beam), share: 1.0, origin_m, axes: Vec::new(), runs: Vec::new() }
    }

    /// Number of sweeps summed at each voxel.
    pub(super) fn sweeps(&self) -> usize {
        self.runs.iter().map(|run| run.members.len()).sum()
    }

    /// Number of runs: apertures, for a fine image.
    pub(super) fn runs(&self) -> usize {
        self.runs.len()
    }

    fn member(&mut self, observation: &'a Observation) -> Member<'a> {
        let same =
            |axis: &Axis| Arc::ptr_eq(&axis.geometry, &observation.geometry) || axis.geometry == observation.geometry;
        let axis = self.axes.iter().position(same).unwrap_or_else(|| {
            self.axes.push(Axis::new(&observation.geometry, self.kind));
            self.axes.len() - 1
        });
        let scale = if self.kind == Kind::LogPower { 1.0 / sweep_noise_rms(&observation.samples) } else { 1.0 };
        Member { observation, weight: 1.0, scale, axis }
    }

    /// Sub-apertures of the first sweep's subsweep, in time order, with taper and noise.
    fn subapertures(
        &mut self,
        settings: &SubapertureSettings,
        observations: &'a [Observation],
    ) -> Vec<Vec<Member<'a>>> {
        let Some(subsweep) = observations.first().map(|o| o.geometry.subsweep) else { return Vec::new() };
        let mut found = Vec::new();
        for mut block in partition(observations, settings) {
            block.retain(|&n| is_usable(&observations[n]));
            if block.first().is_none_or(|&n| observations[n].geometry.subsweep != subsweep) {
                continue;
            }
            let noise_rms = subaperture_noise_rms(block.iter().map(|&n| observations[n].samples.as_slice()));
            let members = block.iter().enumerate().map(|(k, &n)| Member {
                weight: taper(k, block.len()),
                scale: 1.0 / noise_rms,
                ..self.member(&observations[n])
            });
            found.push(members.collect());
        }
        found
    }

    fn add_subapertures(&mut self, beam: &Beam, settings: &SubapertureSettings, observations: &'a [Observation]) {
        let newest_ns = observations.iter().map(|o| o.mid_time_ns).max().unwrap_or(0);
        let min_cos = settings.min_cos(beam) as f32;
        for members in self.subapertures(settings, observations) {
            let middle = members[members.len() / 2].observation;
            let settings = settings.within(&middle.geometry.axis);
            let pose = &middle.tracking_from_sensor;
            let age_s = newest_ns.saturating_sub(middle.mid_time_ns) as f64 * 1e-9;
            let parameters = RunParameters {
                position_m: (pose.translation - self.origin_m).as_vec3().to_array(),
                forward: pose.forward().as_vec3().to_array(),
                near_m2: (settings.min_range_m * settings.min_range_m) as f32,
                // An axis entirely beyond the farthest range sees nothing.
                far_m2: (settings.max_range_m * settings.max_range_m) as f32,
                min_cos,
                decay: math::exp(-age_s / settings.decay_s) as f32,
                ..RunParameters::zeroed()
            };
            self.runs.push(Run { members, parameters });
        }
    }

    /// Divides the runs so that the tables of each part fit so many entries; at least one run each.
    pub(super) fn batches(&self, most_entries: usize) -> Vec<Range<usize>> {
        let (mut batches, mut first, mut entries) = (Vec::new(), 0, 0);
        for (n, run) in self.runs.iter().enumerate() {
            let more: usize = run.members.iter().map(|member| self.axes[member.axis].entries()).sum();
            if n > first && entries + more > most_entries {
                batches.push(first..n);
                (first, entries) = (n, 0);
            }
            entries += more;
        }
        if first < self.runs.len() {
            batches.push(first..self.runs.len());
        }
        batches
    }

    /// Computes the tables of some runs, on all cores.
    pub(super) fn batch(&self, runs: Range<usize>) -> Batch {
        let mut batch = Batch { sweeps: Vec::new(), runs: Vec::new(), tables: Vec::new() };
        let runs = &self.runs[runs];
        for run in runs {
            let (first_sweep, sweeps) = (batch.sweeps.len() as u32, run.members.len() as u32);
            batch.runs.push(RunParameters { first_sweep, sweeps, ..run.parameters });
            for member in &run.members {
                let table = batch.tables.len();
                batch.tables.resize(table + self.axes[member.axis].entries(), [0.0; 2]);
                batch.sweeps.push(self.parameters(member, table as u32));
            }
        }
        let (mut rest, mut tables) = (batch.tables.as_mut_slice(), Vec::with_capacity(batch.sweeps.len()));
        for member in runs.iter().flat_map(|run| &run.members) {
            let (table, others) = rest.split_at_mut(self.axes[member.axis].entries());
            tables.push((member, table));
            rest = others;
        }
        tables.into_par_iter().for_each(|(member, table)| self.axes[member.axis].write(self.kind, member, table));
        batch
    }

    fn parameters(&self, member: &Member, table: u32) -> SweepParameters {
        let (observation, axis) = (member.observation, &self.axes[member.axis]);
        let pose = &observation.tracking_from_sensor;
        let range = &observation.geometry.axis;
        SweepParameters {
            position_m: (pose.translation - self.origin_m).as_vec3().to_array(),
            first_m: range.first_m as f32,
            velocity_m_per_s: observation.velocity_m_per_s.as_vec3().to_array(),
            last_m: range.last_m() as f32,
            forward: pose.forward().as_vec3().to_array(),
            entries_per_m: (1.0 / axis.step_m) as f32,
            time_s_per_m: (observation.geometry.point_period_s / range.step_m) as f32,
            time_at_zero_s: observation.point_time_s(range.point_at(0.0)) as f32,
            weight: member.weight as f32,
            table,
        }
    }
}

impl<'a> Run<'a> {
    fn plain(members: Vec<Member<'a>>) -> Self {
        Self { members, parameters: RunParameters::zeroed() }
    }
}

/// Whether a sweep may be summed: finite, and as long as its axis.
fn is_usable(observation: &Observation) -> bool {
    let pose = &observation.tracking_from_sensor;
    let finite = pose.translation.is_finite() && pose.rotation.is_finite() && observation.velocity_m_per_s.is_finite();
    let points = observation.geometry.axis.points;
    finite
        && points > 0
        && observation.samples.len() == points
        // The converter ends at 2¹⁵; squares and their sums stay finite far beyond.
        && observation.samples.iter().all(|x| x.re.abs() <= 1e9 && x.im.abs() <= 1e9)
}

/// The tables of one range axis.
struct Axis {
    geometry: Arc<SweepGeometry>,
    compressor: RangeCompressor,
    step_m: f64,
    /// `[entry][point]` of `thesis-full`: the template, not normalised.
    envelopes: Vec<Vec<f32>>,
}

impl Axis {
    fn new(geometry: &Arc<SweepGeometry>, kind: Kind) -> Self {
        let widest_m = TABLE_STEP_M.min(geometry.pulse_fwhm_m / STEPS_PER_PULSE);
        let compressor = RangeCompressor::with_step(geometry, widest_m);
        let axis = &geometry.axis;
        let template = |entry: usize| {
            let range_m = compressor.first_m() + entry as f64 * compressor.step_m();
            (0..axis.points).map(|n| envelope(geometry.pulse_fwhm_m, axis.range_m(n) - range_m) as f32).collect()
        };
        let entries = if kind == Kind::Amplitudes { compressor.entries() } else { 0 };
        let step_m = if kind == Kind::Nearest { axis.step_m } else { compressor.step_m() };
        let envelopes = (0..entries).map(template).collect();
        Self { geometry: Arc::clone(geometry), compressor, step_m, envelopes }
    }

    /// Number of entries of a table: one more than are written, so that every entry has a next one.
    fn entries(&self) -> usize {
        self.compressor.entries().max(self.geometry.axis.points) + 1
    }

    fn write(&self, kind: Kind, member: &Member, table: &mut [[f32; 2]]) {
        let samples = &member.observation.samples;
        let magnitudes = || samples.iter().map(|x| math::norm(*x));
        match kind {
            Kind::Nearest => table.iter_mut().zip(magnitudes()).for_each(|(to, x)| to[0] = x),
            Kind::Amplitudes => {
                let magnitudes: Vec<f32> = magnitudes().collect();
                for (to, template) in table.iter_mut().zip(&self.envelopes) {
                    to[0] = template.iter().zip(&magnitudes).map(|(e, x)| e * x).sum();
                }
            }
            _ => {
                let z = self.compressor.compress(samples, member.scale as f32).z;
                table.iter_mut().zip(z).for_each(|(to, z)| *to = [z.re, z.im]);
            }
        }
        // Beyond the last written entry its value is held.
        let written = if kind == Kind::Nearest { samples.len() } else { self.compressor.entries() };
        let last = table[written - 1];
        table[written..].fill(last);
    }
}
