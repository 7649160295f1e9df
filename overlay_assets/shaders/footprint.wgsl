// Texture of a footprint: the area is filled faintly, more strongly towards its outline. Metres; +y
// points away from the viewer's feet.

struct Footprint {
    size: vec2f,
    corner_count: u32,
    unused: f32,
    // Linear red, green, blue.
    color: vec4f,
}

@group(0) @binding(0) var<uniform> footprint: Footprint;
// Corners relative to the centre in x and y, counter-clockwise; z and w are unused.
@group(0) @binding(1) var<storage, read> corners: array<vec4f>;

struct Corner {
    @builtin(position) clip: vec4f,
    @location(0) point: vec2f,
}

@vertex
fn corner(@builtin(vertex_index) index: u32) -> Corner {
    let ndc = vec2f(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0);
    return Corner(vec4f(ndc, 0.0, 1.0), ndc * 0.5 * footprint.size);
}

// Signed distance to the outline, negative inside: distance to the nearest edge. A point is inside
// if it is to the left of every edge.
fn polygon(p: vec2f) -> f32 {
    var nearest = 1e9;
    var inside = true;
    for (var i = 0u; i < footprint.corner_count; i++) {
        let a = corners[i].xy;
        let b = corners[(i + 1u) % footprint.corner_count].xy;
        let edge = b - a;
        let away = p - a;
        let on_edge = clamp(dot(away, edge) / max(dot(edge, edge), 1e-12), 0.0, 1.0);
        nearest = min(nearest, distance(away, edge * on_edge));
        inside = inside && edge.x * away.y - edge.y * away.x >= 0.0;
    }
    return select(nearest, -nearest, inside);
}

@fragment
fn paint(in: Corner) -> @location(0) vec4f {
    let d = polygon(in.point);
    let pixel = fwidth(in.point.x);
    let inside = clamp(0.5 - d / pixel, 0.0, 1.0);
    let outline = clamp((0.003 - abs(d)) / pixel + 0.5, 0.0, 1.0);
    // Bright line between dark borders, like the lines of panels.
    let rim = 0.75 * (1.0 - smoothstep(0.0055, 0.009 + pixel, abs(d)));
    let glow = inside * (0.10 + 0.14 * exp(min(d, 0.0) / 0.05))
        + (1.0 - inside) * 0.16 * exp(-max(d, 0.0) / 0.02) * smoothstep(0.08, 0.05, d);
    var seen = vec4f(footprint.color.rgb * glow, glow) * (1.0 - rim) + vec4f(0.0, 0.0, 0.0, rim);
    let line = 0.9 * outline;
    seen = seen * (1.0 - line) + vec4f(footprint.color.rgb * line, line);
    return seen;
}
