// View of one eye: a dark room with a 1 m floor grid, dots at the true objects, obstacle shapes,
// and the warnings. Positions are relative to the eye, in the axes of the tracking frame.

struct Eye {
    clip_from_offset: mat4x4f,
    // Axes of the eye in the tracking frame, in xyz.
    right: vec4f,
    up: vec4f,
    back: vec4f,
    // Tangents: left, right, lower, upper edge; y up.
    tangents: vec4f,
    // x and z of the eye within its square metre, its height, and the angle of a pixel as a
    // tangent.
    on_floor: vec2f,
    height: f32,
    pixel: f32,
}

@group(0) @binding(0) var<uniform> eye: Eye;

// ---- backdrop

struct Sight {
    @builtin(position) clip: vec4f,
    @location(0) tangent: vec2f,
}

@vertex
fn backdrop_corner(@builtin(vertex_index) index: u32) -> Sight {
    let ndc = vec2f(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0);
    let share = ndc * 0.5 + 0.5;
    return Sight(vec4f(ndc, 0.0, 1.0), mix(eye.tangents.xz, eye.tangents.yw, share));
}

// Coverage of a pixel of this width by lines 8 mm wide, one per metre.
fn metre_line(x: f32, pixel: f32) -> f32 {
    let half_width = 0.004;
    let d = abs(fract(x + 0.5) - 0.5);
    let drawn = max(half_width, 0.5 * pixel);
    let near = clamp((drawn - d) / pixel + 0.5, 0.0, 1.0) * half_width / drawn;
    return mix(near, 2.0 * half_width, smoothstep(0.3, 0.6, pixel));
}

@fragment
fn backdrop(in: Sight) -> @location(0) vec4f {
    let sight = eye.right.xyz * in.tangent.x + eye.up.xyz * in.tangent.y - eye.back.xyz;
    let rise = sight.y / length(sight);
    let level = max(1e-4, -sight.y);
    let away = eye.height / level;
    let point = eye.on_floor + sight.xz * away;
    // Width of a pixel on the floor, along and across the line of sight, from the angle at which it
    // meets the floor.
    let pixel = vec2f(length(vec2f(1.0, sight.x / level)), length(vec2f(1.0, sight.z / level))) * away * eye.pixel;
    let lines = max(metre_line(point.x, pixel.x), metre_line(point.y, pixel.y));
    let far = exp(-away * length(sight) / 6.0);

    let sky = mix(vec3f(0.010, 0.014, 0.020), vec3f(0.0022, 0.003, 0.0045), smoothstep(0.0, 0.7, rise));
    let floor = mix(vec3f(0.010, 0.014, 0.020), vec3f(0.0055, 0.0075, 0.010), 1.0 - exp(rise * 6.0));
    let on_floor = select(0.0, clamp(-rise / (1.5 * eye.pixel), 0.0, 1.0), eye.height > 0.0);
    var color = mix(sky, floor + vec3f(0.05, 0.06, 0.07) * lines * far, on_floor);
    color += vec3f(0.010, 0.014, 0.018) * exp(-abs(rise) / 0.012);
    return vec4f(color, 1.0);
}

// ---- warnings

@group(1) @binding(0) var image: texture_2d<f32>;
@group(1) @binding(1) var smooth_sampler: sampler;

struct QuadCorner {
    @builtin(position) clip: vec4f,
    @location(0) uv: vec2f,
    @location(1) alpha: f32,
}

@vertex
fn quad_corner(@location(0) point: vec3f, @location(1) uv: vec2f, @location(2) alpha: f32) -> QuadCorner {
    return QuadCorner(eye.clip_from_offset * vec4f(point, 1.0), uv, alpha);
}

@fragment
fn quad(in: QuadCorner) -> @location(0) vec4f {
    return textureSample(image, smooth_sampler, in.uv) * in.alpha;
}

// ---- dots at the true objects

struct DotCorner {
    @builtin(position) clip: vec4f,
    @location(0) on_dot: vec2f,
    @location(1) light: f32,
}

@vertex
fn dot_corner(@builtin(vertex_index) index: u32, @location(0) ball: vec4f) -> DotCorner {
    let on_dot = vec2f(f32(index & 1u) * 2.0 - 1.0, f32(index >> 1u) * 2.0 - 1.0);
    let away = length(ball.xyz);
    let radius = max(ball.w, 0.8 * eye.pixel * away);
    let point = ball.xyz + (eye.right.xyz * on_dot.x + eye.up.xyz * on_dot.y) * radius;
    return DotCorner(eye.clip_from_offset * vec4f(point, 1.0), on_dot, exp(-away / 4.0));
}

@fragment
fn ball(in: DotCorner) -> @location(0) vec4f {
    let from_middle = length(in.on_dot);
    let soft = fwidth(from_middle);
    let covered = clamp((1.0 - from_middle) / soft + 0.5, 0.0, 1.0);
    // A small ball, lit from above.
    let lit = 0.65 + 0.35 * in.on_dot.y - 0.25 * from_middle * from_middle;
    return vec4f(vec3f(0.10, 0.095, 0.09) * lit * in.light, covered);
}

// ---- obstacle shapes: balls that occlude each other, with the shading and depth of a sphere

struct BallCorner {
    @builtin(position) clip: vec4f,
    // Interpolated per sample: the edge is as smooth as the image's samples, and occludes only
    // those.
    @location(0) @interpolate(perspective, sample) on_ball: vec2f,
    @location(1) @interpolate(flat) color: vec4f,
    // Depth times distance, distance of the centre along the line of sight, radius.
    @location(2) @interpolate(flat) deep: vec3f,
}

@vertex
fn ball_corner(
    @builtin(vertex_index) index: u32,
    @location(0) ball: vec4f,
    @location(1) color: vec4f,
) -> BallCorner {
    let on_ball = vec2f(f32(index & 1u) * 2.0 - 1.0, f32(index >> 1u) * 2.0 - 1.0);
    // Faces the eye, not the image plane: a ball seen obliquely through a window stays round.
    let away = max(length(ball.xyz), 1e-6);
    let to_eye = -ball.xyz / away;
    let aside = cross(eye.up.xyz, to_eye);
    let right = select(eye.right.xyz, normalize(aside), dot(aside, aside) > 1e-6);
    let up = cross(to_eye, right);
    let clip = eye.clip_from_offset * vec4f(ball.xyz + (right * on_ball.x + up * on_ball.y) * ball.w, 1.0);
    let middle = eye.clip_from_offset * vec4f(ball.xyz, 1.0);
    return BallCorner(clip, on_ball, color, vec3f(middle.z, middle.w, ball.w));
}

struct BallPixel {
    @location(0) color: vec4f,
    @builtin(frag_depth) depth: f32,
}

@fragment
fn shape_ball(in: BallCorner) -> BallPixel {
    let outside = dot(in.on_ball, in.on_ball);
    if outside > 1.0 {
        discard;
    }
    let bulge = sqrt(1.0 - outside);
    let depth = in.deep.x / max(in.deep.y - in.deep.z * bulge, in.deep.x);
    // Lit from the eye and slightly from above.
    let lit = 0.45 + 0.4 * bulge + 0.15 * in.on_ball.y;
    return BallPixel(vec4f(in.color.rgb * lit, in.color.a), clamp(depth, 0.0, 1.0));
}
