// The texture of a panel: grid, silhouette, border. Metres on the panel; the derivative of the place gives the width of a
// pixel, so every edge is exactly one pixel soft at any resolution.

struct Panel {
    size: vec2f,
    spacing: f32,
    // Where the grid's first upright line is, from the middle.
    grid_from: f32,
    // Linear red, green, blue.
    color: vec3f,
    disc_count: u32,
    // 1 when the panel stands for something of unknown direction: a soft fog in place of a silhouette.
    fog: f32,
    // 1 when its sides have a border; else they end softly.
    border: f32,
}

@group(0) @binding(0) var<uniform> panel: Panel;
// Middle x, y and radius of each disc; the fourth is not used.
@group(0) @binding(1) var<storage, read> discs: array<vec4f>;

struct Corner {
    @builtin(position) clip: vec4f,
    @location(0) place: vec2f,
}

@vertex
fn corner(@builtin(vertex_index) index: u32) -> Corner {
    let ndc = vec2f(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0);
    return Corner(vec4f(ndc, 0.0, 1.0), ndc * 0.5 * panel.size);
}

// How much of a pixel a line covers whose middle is d away; thinner than a pixel it turns fainter, not narrower.
fn line(d: f32, half_width: f32, pixel: f32) -> f32 {
    let drawn = max(half_width, 0.5 * pixel);
    return clamp((drawn - abs(d)) / pixel + 0.5, 0.0, 1.0) * half_width / drawn;
}

fn to_grid(x: f32) -> f32 {
    return abs(fract(x / panel.spacing + 0.5) - 0.5) * panel.spacing;
}

// Distance to the silhouette's edge, negative inside: the discs' union, its notches rounded (a soft minimum).
fn silhouette(p: vec2f) -> f32 {
    var sum = 1e-30;
    let softness = 0.55 * discs[0].z;
    for (var i = 0u; i < panel.disc_count; i++) {
        let disc = discs[i];
        sum += exp((disc.z - distance(p, disc.xy)) / softness);
    }
    // Overlapping neighbours swell the soft union: two to three at an edge.
    return softness * (0.9 - log(sum));
}

fn over(below: f32, above: f32) -> f32 {
    return below + above * (1.0 - below);
}

@fragment
fn paint(in: Corner) -> @location(0) vec4f {
    let p = in.place;
    let pixel = fwidth(p.x);
    let half = 0.5 * panel.size;
    let to_top = half.y - p.y;
    let to_floor = p.y + half.y;
    let to_side = half.x - abs(p.x);
    let shaped = panel.disc_count > 0u;
    let bordered = panel.border > 0.5;

    // The grid, with a faint halo around each line, on a breath of tint that makes a surface of it.
    let across = to_grid(p.x - panel.grid_from);
    let up = to_grid(to_floor);
    let nearest = min(across, up);
    var a = 0.035;
    a = over(a, 0.10 * exp(-nearest * nearest / 0.0003));
    a = over(a, 0.55 * max(line(across, 0.0018, pixel), line(up, 0.0018, pixel)));

    // Ends: an object's panel has a border, a wall and a fog just end softly.
    let side_fade = select(smoothstep(0.0, min(0.3, 0.3 * panel.size.x), to_side), 1.0, bordered);
    if bordered {
        a = over(a, 0.75 * line(to_side - 0.003, 0.003, pixel));
    }
    let fog = panel.fog * 0.30 * exp(-4.0 * (p.x * p.x) / (half.x * half.x));
    a = over(a, fog);
    a *= smoothstep(0.0, min(0.35, 0.35 * panel.size.y), to_top) * side_fade;
    // It stands on the floor: a bright foot.
    a = over(a, (0.9 * line(to_floor - 0.005, 0.005, pixel) + 0.25 * exp(-to_floor / 0.04)) * side_fade);

    var white = 0.0;
    if shaped {
        let d = silhouette(p);
        let inside = clamp(0.5 - d / pixel, 0.0, 1.0);
        a = over(a, inside * (0.24 + 0.16 * exp(min(d, 0.0) / 0.03)));
        // The glow ends before the panel does.
        let rim = smoothstep(0.0, 0.05, min(to_side, to_top));
        a = over(a, (1.0 - inside) * 0.38 * exp(-max(d, 0.0) / 0.03) * rim);
        let outline = line(d, 0.004, pixel);
        a = over(a, 0.95 * outline);
        white = 0.45 * outline;
    }
    return vec4f(mix(panel.color, vec3f(1.0), white) * a, a);
}
