// Texture of a panel: grid, silhouette, border. Units are metres on the panel. The derivative of
// the position gives the width of a pixel, so every edge is exactly one pixel soft at any
// resolution.

struct Panel {
    size: vec2f,
    spacing: f32,
    // Position of the first vertical grid line, relative to the centre.
    grid_from: f32,
    // Linear red, green, blue.
    color: vec3f,
    disc_count: u32,
    // 1 if the panel's object has an unknown direction: draws fog instead of a silhouette.
    fog: f32,
    // 1 if the sides have a border; otherwise they fade out.
    border: f32,
    style: u32,
    // The label's texels follow the discs, four per element. No columns: no label.
    label_columns: u32,
    // Centre and half size.
    label: vec4f,
    label_rows: u32,
}

const GRID = 0u;
const OUTLINE = 1u;
const SOLID = 2u;
const MINIMAL = 3u;
// Width of the dark borders beside bright lines and around letters, metres.
const RIM = 0.005;
const LETTER_RIM = 0.011;

@group(0) @binding(0) var<uniform> panel: Panel;
// Centre x, y and radius of each disc, the fourth value unused; then distances to the outline of
// the text.
@group(0) @binding(1) var<storage, read> discs: array<vec4f>;

struct Corner {
    @builtin(position) clip: vec4f,
    @location(0) point: vec2f,
}

@vertex
fn corner(@builtin(vertex_index) index: u32) -> Corner {
    let ndc = vec2f(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0);
    return Corner(vec4f(ndc, 0.0, 1.0), ndc * 0.5 * panel.size);
}

// Coverage of a pixel by a line at distance d. A line thinner than a pixel becomes fainter, not
// narrower.
fn line(d: f32, half_width: f32, pixel: f32) -> f32 {
    let drawn = max(half_width, 0.5 * pixel);
    return clamp((drawn - abs(d)) / pixel + 0.5, 0.0, 1.0) * half_width / drawn;
}

fn to_grid(x: f32) -> f32 {
    return abs(fract(x / panel.spacing + 0.5) - 0.5) * panel.spacing;
}

// Signed distance to the silhouette, negative inside: union of the discs with rounded notches
// (smooth minimum).
fn silhouette(p: vec2f) -> f32 {
    var sum = 1e-30;
    let softness = 0.65 * discs[0].z;
    for (var i = 0u; i < panel.disc_count; i++) {
        let disc = discs[i];
        sum += exp((disc.z - distance(p, disc.xy)) / softness);
    }
    // Overlapping neighbours enlarge the smooth union, by up to three discs at an edge. With this
    // offset, single voxels leave neither dents nor holes.
    return softness * (0.7 - log(sum));
}

// Alpha-blends a colour over premultiplied content.
fn lay(below: vec4f, color: vec3f, a: f32) -> vec4f {
    return vec4f(color * a, a) + below * (1.0 - a);
}

// A bright line between two dark borders: visible over bright and dark backgrounds.
fn rimmed(below: vec4f, d: f32, half_width: f32, strength: f32, white: f32, pixel: f32) -> vec4f {
    let away = abs(d) - half_width;
    let rim = 0.82 * strength * (1.0 - smoothstep(0.5 * RIM, RIM + pixel, away));
    let bright = mix(panel.color, vec3f(1.0), white);
    return lay(lay(below, vec3f(0.0), rim), bright, min(1.0, strength * line(d, half_width, pixel)));
}

// An arc across the panel: the object is somewhere along it.
fn bow(p: vec2f) -> f32 {
    let half = 0.45 * panel.size.x;
    let rise = 0.35 * half;
    let radius = (half * half + rise * rise) / (2.0 * rise);
    return distance(p, vec2f(0.0, 0.1 * panel.size.y + rise - radius)) - radius;
}

fn label_texel(x: i32, y: i32) -> f32 {
    let column = clamp(x, 0, i32(panel.label_columns) - 1);
    let row = clamp(y, 0, i32(panel.label_rows) - 1);
    let index = u32(row) * panel.label_columns + u32(column);
    return discs[panel.disc_count + index / 4u][index % 4u];
}

// Distance to the outline of the text, metres; 1 outside its box.
fn label_distance(p: vec2f) -> f32 {
    let from_middle = p - panel.label.xy;
    let half = panel.label.zw;
    if panel.label_columns == 0u || any(abs(from_middle) > half) {
        return 1.0;
    }
    let size = vec2f(f32(panel.label_columns), f32(panel.label_rows));
    let at = vec2f(from_middle.x + half.x, half.y - from_middle.y) / (2.0 * half) * size - 0.5;
    let low = floor(at);
    let share = at - low;
    let x = i32(low.x);
    let y = i32(low.y);
    let upper = mix(label_texel(x, y), label_texel(x + 1, y), share.x);
    let lower = mix(label_texel(x, y + 1), label_texel(x + 1, y + 1), share.x);
    return mix(upper, lower, share.y) * 2.0 * half.y / size.y;
}

@fragment
fn paint(in: Corner) -> @location(0) vec4f {
    let p = in.point;
    let pixel = fwidth(p.x);
    let half = 0.5 * panel.size;
    let to_top = half.y - p.y;
    let to_floor = p.y + half.y;
    let to_side = half.x - abs(p.x);
    let shaped = panel.disc_count > 0u;
    let bordered = panel.border > 0.5;
    let foggy = panel.fog > 0.5;
    let is_grid = panel.style == GRID;
    let is_solid = panel.style == SOLID;
    var to_shape = 1.0;
    if shaped {
        to_shape = silhouette(p);
    }

    // A faint tint makes the surface visible.
    var seen = lay(vec4f(0.0), panel.color, select(select(0.0, 0.12, is_solid && !shaped), 0.035, is_grid));
    if is_grid {
        let across = to_grid(p.x - panel.grid_from);
        let up = to_grid(to_floor);
        let nearest = min(across, up);
        seen = lay(seen, panel.color, 0.06 * exp(-nearest * nearest / 0.0003));
        seen = rimmed(seen, nearest, 0.0022, 0.95, 0.0, pixel);
    }

    // Sides: an object's panel has a border; a wall's panel and one of unknown direction fade out.
    let framed = (is_grid && bordered) || panel.style == MINIMAL || (!is_grid && !shaped && !foggy);
    if framed {
        let inset = 0.012;
        let thin = select(0.004, 0.003, panel.style == MINIMAL);
        // The frame is open at the floor, where the foot line closes it.
        seen = rimmed(seen, to_side - inset, thin, 0.95, 0.0, pixel);
    }
    let side_fade = select(smoothstep(0.0, min(0.3, 0.3 * panel.size.x), to_side), 1.0, bordered || framed);
    if foggy {
        let thickness = select(0.30, 0.42, is_solid) * select(1.0, 0.5, panel.style == MINIMAL);
        seen = lay(seen, panel.color, thickness * exp(-4.0 * (p.x * p.x) / (half.x * half.x)));
    }
    seen *= smoothstep(0.0, min(0.35, 0.35 * panel.size.y), to_top) * side_fade;
    if foggy {
        seen = rimmed(seen, bow(p), 0.004, side_fade, 0.2, pixel);
    }
    // A bright foot line: the panel stands on the floor.
    let foot = rimmed(seen, to_floor - 0.008, 0.005, 1.0, 0.0, pixel);
    seen = mix(seen, lay(foot, panel.color, 0.22 * exp(-to_floor / 0.04)), side_fade);

    if shaped && panel.style != MINIMAL {
        let inside = clamp(0.5 - to_shape / pixel, 0.0, 1.0);
        let fill = select(select(0.0, 0.22, is_grid), 0.62, is_solid);
        let edge = select(0.0, 0.16, is_grid || is_solid) * exp(min(to_shape, 0.0) / 0.03);
        // The silhouette is in front of the grid and dims the lines inside it.
        seen *= 1.0 - inside * select(0.0, 0.35, is_grid);
        seen = lay(seen, panel.color, inside * (fill + edge));
        // The glow ends before the edge of the panel.
        let rim = smoothstep(0.0, 0.05, min(to_side, to_top));
        seen = lay(seen, panel.color, (1.0 - inside) * 0.30 * exp(-max(to_shape, 0.0) / 0.025) * rim);
        // Dark border only on the outside, so that thin parts inside do not become spotted.
        let thick = select(0.005, 0.006, panel.style == OUTLINE);
        let dark = 0.82 * smoothstep(0.0, thick, to_shape) * (1.0 - smoothstep(0.5 * RIM, RIM + pixel, to_shape - thick));
        seen = lay(lay(seen, vec3f(0.0), dark), mix(panel.color, vec3f(1.0), 0.35), line(to_shape, thick, pixel));
    }
    let to_text = label_distance(p);
    if to_text < 0.02 {
        seen = lay(seen, vec3f(0.0), 0.82 * (1.0 - smoothstep(0.4 * LETTER_RIM, LETTER_RIM, to_text)));
        seen = lay(seen, mix(panel.color, vec3f(1.0), 0.6), clamp(0.5 - (to_text - 0.0008) / pixel, 0.0, 1.0));
    }
    return seen;
}
