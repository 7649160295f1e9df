// One invocation per voxel: the statistics of docs/method.md straight from their formulas, in f32.
// Sweeps come in runs; each run is summed on its own and then added, so that the result does not
// depend on how runs are divided among dispatches.

// In the order of `Kind`.
const SUM_OF_AMPLITUDES: u32 = 0u; // thesis-full
const SUM_OF_NEAREST: u32 = 1u;    // thesis
const SUM_OF_POWER: u32 = 2u;      // ls
const SUM_OF_LOG_POWER: u32 = 3u;  // log
const GLRT: u32 = 4u;
const COHERENT: u32 = 5u;
const SUBAPERTURE: u32 = 6u;
const FINE: u32 = 7u;
override KIND: u32 = SUM_OF_POWER;

// Half of the beam table's steps: entries per unit of cosine.
override ENTRIES_PER_COS: f32 = 2048.0;
override MEAN_LOG_OF_NOISE: f32 = 0.0;
// Cycles of the two-way phase per metre, 2/λ.
override CYCLES_PER_M: f32 = 0.0;
const TAU: f32 = 6.283185307179586;

struct Sweep {
    position_m: vec3f,
    first_m: f32,
    velocity_m_per_s: vec3f,
    last_m: f32,
    forward: vec3f,
    entries_per_m: f32,
    // A point at range d is sampled d · time_s_per_m + time_at_zero_s after the pose's time.
    time_s_per_m: f32,
    time_at_zero_s: f32,
    // Taper within its sub-aperture.
    weight: f32,
    table: u32,
}

struct Run {
    // Of a sub-aperture: its middle pose, and which points it sees.
    position_m: vec3f,
    first_sweep: u32,
    forward: vec3f,
    sweeps: u32,
    near_m2: f32,
    far_m2: f32,
    min_cos: f32,
    decay: f32,
}

struct Chunk {
    // Lowest corner of the volume relative to the origin of the sweeps' positions.
    corner_m: vec3f,
    voxel_m: f32,
    // Bricks of 4 × 4 × 4 voxels along x and y, and the first brick of this dispatch.
    bricks_x: u32,
    bricks_y: u32,
    first_brick: u32,
    // First brick that the sums hold.
    base_brick: u32,
    first_run: u32,
    runs: u32,
    // Points at a smaller cosine to the boresight are out of the beam.
    cut_cos: f32,
    // Factor of the results (fine image).
    share: f32,
    // Which of the results: the statistic, or the fine image's incoherent reference.
    part: u32,
    // Whether every point within the cut is in the beam.
    is_beam_solid: u32,
}

@group(0) @binding(0) var<uniform> chunk: Chunk;
@group(0) @binding(1) var<storage, read> sweeps: array<Sweep>;
@group(0) @binding(2) var<storage, read> runs: array<Run>;
@group(0) @binding(3) var<storage, read> tables: array<vec2f>;
@group(0) @binding(4) var<storage, read> beam: array<f32>;
@group(0) @binding(5) var<storage, read_write> sums: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> values: array<f32>;

fn center_m(brick: u32, within: vec3u) -> vec3f {
    let x = brick % chunk.bricks_x;
    let y = brick / chunk.bricks_x % chunk.bricks_y;
    let z = brick / (chunk.bricks_x * chunk.bricks_y);
    return chunk.corner_m + (vec3f(vec3u(x, y, z) * 4u + within) + 0.5) * chunk.voxel_m;
}

fn amplitude(cosine: f32) -> f32 {
    let at = (clamp(cosine, -1.0, 1.0) + 1.0) * ENTRIES_PER_COS;
    let n = u32(at);
    return mix(beam[n], beam[n + 1u], at - f32(n));
}

fn is_seen(run: Run, place: vec3f) -> bool {
    let to = place - run.position_m;
    let distance2 = dot(to, to);
    let along = dot(to, run.forward);
    return distance2 >= run.near_m2 && distance2 <= run.far_m2
        && along * abs(along) >= run.min_cos * abs(run.min_cos) * distance2;
}

// Adds a sweep at a place: the sum's two parts, and Σ w² or the energy.
fn add_sweep(sweep: Sweep, place: vec3f, sum: ptr<function, vec3f>) {
    let to = place - sweep.position_m;
    let pose_distance = length(to);
    var weight = sweep.weight;
    if KIND < SUBAPERTURE {
        // First, since most places are out of most sweeps' beams.
        let cosine = dot(to, sweep.forward) / max(pose_distance, 1e-9);
        if cosine < chunk.cut_cos {
            return;
        }
        if chunk.is_beam_solid == 0u || !(KIND == SUM_OF_POWER || KIND == SUM_OF_LOG_POWER) {
            weight = amplitude(cosine);
            if weight <= 0.0 {
                return;
            }
        }
    }
    var distance = pose_distance;
    if any(sweep.velocity_m_per_s != vec3f(0.0)) {
        // From where the sensor was when it sampled points at about this range. A second iteration would change the
        // distance by a micrometre.
        let time = pose_distance * sweep.time_s_per_m + sweep.time_at_zero_s;
        distance = length(to - sweep.velocity_m_per_s * time);
    }
    if !(distance > 0.0 && distance >= sweep.first_m && distance <= sweep.last_m) {
        return;
    }
    if KIND < SUBAPERTURE {
        weight /= distance * distance;
    }
    let at = (distance - sweep.first_m) * sweep.entries_per_m;
    if KIND == SUM_OF_NEAREST {
        (*sum).x += tables[sweep.table + u32(at + 0.5)].x * weight;
        return;
    }
    let n = u32(at);
    let here = tables[sweep.table + n];
    let z = mix(here, tables[sweep.table + n + 1u], at - f32(n));
    switch KIND {
        case SUM_OF_AMPLITUDES: {
            (*sum).x += z.x * weight;
        }
        case SUM_OF_POWER: {
            (*sum).x += dot(z, z);
        }
        case SUM_OF_LOG_POWER: {
            (*sum).x += log(1.0 + dot(z, z));
        }
        case GLRT: {
            *sum += vec3f(length(z) * weight, 0.0, weight * weight);
        }
        default: {
            let cycles = distance * CYCLES_PER_M;
            let phase = -TAU * (cycles - round(cycles));
            let turn = vec2f(cos(phase), sin(phase)) * weight;
            let turned = vec2f(z.x * turn.x - z.y * turn.y, z.x * turn.y + z.y * turn.x);
            let energy = select(weight * weight, weight * weight * dot(z, z), KIND >= SUBAPERTURE);
            *sum += vec3f(turned, energy);
        }
    }
}

@compute @workgroup_size(4, 4, 4)
fn add_runs(
    @builtin(workgroup_id) group: vec3u,
    @builtin(local_invocation_id) within: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let brick = chunk.first_brick + group.x;
    let place = center_m(brick, within);
    let voxel = (brick - chunk.base_brick) * 64u + lane;
    var total = sums[voxel];
    for (var r = chunk.first_run; r < chunk.first_run + chunk.runs; r++) {
        let run = runs[r];
        if KIND == SUBAPERTURE && !is_seen(run, place) {
            continue;
        }
        var sum = vec3f(0.0);
        for (var k = run.first_sweep; k < run.first_sweep + run.sweeps; k++) {
            add_sweep(sweeps[k], place, &sum);
        }
        let count = f32(run.sweeps);
        let power = dot(sum.xy, sum.xy) / count;
        if KIND == SUBAPERTURE {
            let coherence = power / max((sum.z - power) / (count - 1.0), 1.0);
            total.x += run.decay * (log(1.0 + coherence) - MEAN_LOG_OF_NOISE);
            total.y += run.decay * run.decay;
        } else if KIND == FINE {
            total.x += power;
            total.y += sum.z / count;
        } else {
            total += vec4f(sum, 0.0);
        }
    }
    sums[voxel] = total;
}

// The values from the sums, brick by brick.
@compute @workgroup_size(64)
fn finish(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
    let voxel = group.x * 64u + lane;
    let sum = sums[voxel];
    var value = select(sum.x, sum.y, chunk.part == 1u);
    if KIND == SUBAPERTURE {
        value = select(0.0, sum.x / sqrt(sum.y), sum.y > 0.0);
    } else if KIND == GLRT {
        value = select(0.0, sum.x / sqrt(sum.z), sum.z > 0.0);
    } else if KIND == COHERENT {
        value = select(0.0, length(sum.xy) / sqrt(sum.z), sum.z > 0.0);
    }
    values[voxel] = value * chunk.share;
}
