// Faces, balls and lines in 3D. Positions are relative to the eye; colours are sRGB, alpha is not
// premultiplied.

struct Eye {
    clip_from_offset: mat4x4<f32>,
    right: vec4<f32>,
    up: vec4<f32>,
    // Width and height, pixels; distance of the near plane, metres.
    view: vec4<f32>,
}

@group(0) @binding(0) var<uniform> eye: Eye;

struct Colored {
    @builtin(position) clip: vec4<f32>,
    @location(0) color: vec4<f32>,
}

@vertex
fn face_corner(@location(0) point: vec3<f32>, @location(1) color: vec4<f32>) -> Colored {
    return Colored(eye.clip_from_offset * vec4(point, 1.0), color);
}

@fragment
fn plain(in: Colored) -> @location(0) vec4<f32> {
    return vec4(in.color.rgb * in.color.a, in.color.a);
}

struct Ball {
    @builtin(position) clip: vec4<f32>,
    @location(0) color: vec4<f32>,
    @location(1) at: vec2<f32>,
    @location(2) radius: f32,
}

@vertex
fn ball_corner(
    @builtin(vertex_index) corner: u32,
    @location(0) center_and_radius: vec4<f32>,
    @location(1) color: vec4<f32>,
) -> Ball {
    let at = vec2(f32(corner & 1u), f32(corner >> 1u)) * 2.0 - 1.0;
    let point = center_and_radius.xyz + (eye.right.xyz * at.x + eye.up.xyz * at.y) * center_and_radius.w;
    return Ball(eye.clip_from_offset * vec4(point, 1.0), color, at, center_and_radius.w);
}

@fragment
fn ball(in: Ball) -> @location(0) vec4<f32> {
    let from_middle = dot(in.at, in.at);
    if from_middle > 1.0 {
        discard;
    }
    // Small balls are not shaded, so that their colours stay readable side by side.
    if in.radius < 0.02 {
        return vec4(in.color.rgb * in.color.a, in.color.a);
    }
    let light = 0.72 + 0.28 * (0.4 * in.at.y - 0.2 * in.at.x + sqrt(1.0 - from_middle));
    return vec4(in.color.rgb * light * in.color.a, in.color.a);
}

// Clips the line at the near plane, then widens it by pixels.
@vertex
fn line_corner(
    @builtin(vertex_index) corner: u32,
    @location(0) start: vec3<f32>,
    @location(1) end: vec3<f32>,
    @location(2) color: vec4<f32>,
    @location(3) width_px: f32,
) -> Colored {
    var a = eye.clip_from_offset * vec4(start, 1.0);
    var b = eye.clip_from_offset * vec4(end, 1.0);
    let near = eye.view.z;
    if a.w < near && b.w < near {
        return Colored(vec4(0.0, 0.0, -1.0, 1.0), color);
    }
    if a.w < near {
        a = mix(a, b, (near - a.w) / (b.w - a.w));
    } else if b.w < near {
        b = mix(b, a, (near - b.w) / (a.w - b.w));
    }
    let half_view = eye.view.xy * 0.5;
    let way = b.xy / b.w * half_view - a.xy / a.w * half_view;
    let along = way / max(length(way), 1e-6);
    let aside = vec2(-along.y, along.x) * (f32(corner & 1u) * 2.0 - 1.0) * width_px * 0.5;
    let at = select(a, b, corner >= 2u);
    return Colored(vec4(at.xy + aside / half_view * at.w, at.zw), color);
}
