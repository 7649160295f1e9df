//! A raster canvas: signed-distance shapes and text, drawn at twice the final size in each
//! direction and averaged down for smooth edges. All lengths are pixels of the final image, x to
//! the right, y down. Shapes with non-finite coordinates are skipped; nothing here panics on its
//! input.

use super::Picture;
use super::style::{PAPER, Rgb, font};

/// Samples per pixel in each direction. Choice: smooth edges for four times the memory. `S`: the
/// same as a number.
const SCALE: usize = 2;
const S: f64 = SCALE as f64;

/// Alignment of a text relative to its anchor point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Align {
    /// The point is at the left end.
    Left,
    /// The point is at the centre.
    Center,
    /// The point is at the right end.
    Right,
}

/// An axis-aligned rectangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rect {
    /// Left edge.
    pub x: f64,
    /// Upper edge.
    pub y: f64,
    /// Width.
    pub width: f64,
    /// Height.
    pub height: f64,
}

impl Rect {
    pub fn new(x: f64, y: f64, width: f64, height: f64) -> Self {
        Self { x, y, width, height }
    }

    pub fn right(&self) -> f64 {
        self.x + self.width
    }

    pub fn bottom(&self) -> f64 {
        self.y + self.height
    }

    pub fn center(&self) -> [f64; 2] {
        [self.x + 0.5 * self.width, self.y + 0.5 * self.height]
    }

    pub fn overlaps(&self, other: &Self) -> bool {
        self.x < other.right() && other.x < self.right() && self.y < other.bottom() && other.y < self.bottom()
    }

    /// Area of the intersection; 0 if disjoint.
    pub fn shared_area(&self, other: &Self) -> f64 {
        let width = self.right().min(other.right()) - self.x.max(other.x);
        let height = self.bottom().min(other.bottom()) - self.y.max(other.y);
        width.max(0.0) * height.max(0.0)
    }
}

/// An image being drawn.
pub struct Canvas {
    width: usize,
    height: usize,
    pixels: Vec<u8>,
    clip: Rect,
}

impl Canvas {
    /// A white canvas of `width` × `height` final pixels.
    pub fn new(width: usize, height: usize) -> Self {
        let pixels = vec![PAPER[0]; 3 * SCALE * SCALE * width * height];
        Self { width, height, pixels, clip: Rect::new(0.0, 0.0, width as f64, height as f64) }
    }

    /// Draws with everything outside `area` left unchanged.
    pub fn clipped(&mut self, area: Rect, draw: impl FnOnce(&mut Self)) {
        let before = std::mem::replace(&mut self.clip, area);
        draw(self);
        self.clip = before;
    }

    pub fn fill(&mut self, area: Rect, color: Rgb) {
        self.blend_rect(area, color, 1.0);
    }

    pub fn blend_rect(&mut self, area: Rect, color: Rgb, alpha: f64) {
        let [cx, cy] = area.center();
        let (half_width, half_height) = (0.5 * area.width, 0.5 * area.height);
        let distance = |x: f64, y: f64| ((x - cx).abs() - half_width).max((y - cy).abs() - half_height);
        self.shape(area, color, alpha, distance);
    }

    /// The outline of a rectangle, one pixel inside its edge.
    pub fn outline(&mut self, area: Rect, width_px: f64, color: Rgb) {
        let corners =
            [[area.x, area.y], [area.right(), area.y], [area.right(), area.bottom()], [area.x, area.bottom()]];
        for n in 0..4 {
            self.line(corners[n], corners[(n + 1) % 4], width_px, color);
        }
    }

    pub fn disc(&mut self, center: [f64; 2], radius: f64, color: Rgb) {
        self.blend_disc(center, radius, color, 1.0);
    }

    pub fn blend_disc(&mut self, [cx, cy]: [f64; 2], radius: f64, color: Rgb, alpha: f64) {
        let area = Rect::new(cx - radius, cy - radius, 2.0 * radius, 2.0 * radius);
        self.shape(area, color, alpha, |x, y| (x - cx).hypot(y - cy) - radius);
    }

    /// A circle, with a line `width_px` wide centred on `radius`.
    pub fn ring(&mut self, [cx, cy]: [f64; 2], radius: f64, width_px: f64, color: Rgb) {
        let outer = radius + 0.5 * width_px;
        let area = Rect::new(cx - outer, cy - outer, 2.0 * outer, 2.0 * outer);
        self.shape(area, color, 1.0, |x, y| ((x - cx).hypot(y - cy) - radius).abs() - 0.5 * width_px);
    }

    /// A straight line with round ends.
    pub fn line(&mut self, from: [f64; 2], to: [f64; 2], width_px: f64, color: Rgb) {
        /// Longest piece of a slanted line, pixels. Choice: a long slanted line's bounding box
        /// would cover the canvas.
        const PIECE: f64 = 60.0;
        let length = (to[0] - from[0]).hypot(to[1] - from[1]);
        if !length.is_finite() || length > 1e5 {
            return;
        }
        // A long oblique line in one piece would visit all pixels of its bounding box.
        let upright = from[0] == to[0] || from[1] == to[1];
        let pieces = if upright { 1.0 } else { (length / PIECE).ceil().max(1.0) };
        let at = |share: f64| [from[0] + (to[0] - from[0]) * share, from[1] + (to[1] - from[1]) * share];
        for n in 0..pieces as usize {
            self.capsule(at(n as f64 / pieces), at((n + 1) as f64 / pieces), 0.5 * width_px, color);
        }
    }

    /// Line segments from point to point, interrupted at non-finite points.
    pub fn polyline(&mut self, points: &[[f64; 2]], width_px: f64, color: Rgb) {
        for pair in visible_indices(points).windows(2) {
            self.line(points[pair[0]], points[pair[1]], width_px, color);
        }
    }

    /// A dashed polyline: dashes and gaps are `dash_px` long.
    pub fn dashed(&mut self, points: &[[f64; 2]], dash_px: f64, width_px: f64, color: Rgb) {
        let mut walked = 0.0;
        for pair in points.windows(2) {
            let length = (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]);
            if !length.is_finite() || length > 1e5 {
                continue;
            }
            let at = |t: f64| [0, 1].map(|n| pair[0][n] + (pair[1][n] - pair[0][n]) * t / length.max(1e-12));
            let mut start = -(walked % (2.0 * dash_px));
            while start < length {
                if start + dash_px > 0.0 {
                    self.line(at(start.max(0.0)), at((start + dash_px).min(length)), width_px, color);
                }
                start += 2.0 * dash_px;
            }
            walked += length;
        }
    }

    /// Fills a convex polygon whose corners run clockwise on the screen.
    pub fn convex(&mut self, corners: &[[f64; 2]], color: Rgb, alpha: f64) {
        let Some(area) = bounding_box(corners) else { return };
        let edges: Vec<([f64; 2], [f64; 2])> =
            (0..corners.len()).filter_map(|n| outward_normal(corners[n], corners[(n + 1) % corners.len()])).collect();
        self.shape(area, color, alpha, |x, y| {
            let beyond = |(p, n): &([f64; 2], [f64; 2])| (x - p[0]) * n[0] + (y - p[1]) * n[1];
            edges.iter().map(beyond).fold(f64::NEG_INFINITY, f64::max)
        });
    }

    /// Colours `area` pixel by pixel. `color` takes the relative position, 0 to 1 from the upper
    /// left.
    pub fn paint(&mut self, area: Rect, color: impl Fn(f64, f64) -> Rgb) {
        let Some([x0, x1, y0, y1]) = self.raster(area, 0.0) else { return };
        for j in y0..y1 {
            let v = ((j as f64 + 0.5) / S - area.y) / area.height;
            for i in x0..x1 {
                let u = ((i as f64 + 0.5) / S - area.x) / area.width;
                if (0.0..1.0).contains(&u) && (0.0..1.0).contains(&v) {
                    let at = 3 * (j * self.width * SCALE + i);
                    self.pixels[at..at + 3].copy_from_slice(&color(u, v));
                }
            }
        }
    }

    /// One line of text. `y` is the middle of the capital letters.
    pub fn text(&mut self, [x, y]: [f64; 2], align: Align, text: &str, height_px: f64, color: Rgb) {
        self.glyphs([x, y], align, text, height_px, color, |[x, y], along, up| [x + along, y + up]);
    }

    /// Text that is scaled down, by at most a third, if it would be wider than `most_px`.
    pub fn text_fitted(
        &mut self,
        origin: [f64; 2],
        align: Align,
        text: &str,
        height_px: f64,
        most_px: f64,
        color: Rgb,
    ) {
        let share = most_px / text_width(text, height_px).max(1.0);
        self.text(origin, align, text, height_px * share.clamp(0.67, 1.0), color);
    }

    /// Text that reads from bottom to top. `x` is the middle of the capital letters.
    pub fn text_upwards(&mut self, [x, y]: [f64; 2], align: Align, text: &str, height_px: f64, color: Rgb) {
        self.glyphs([x, y], align, text, height_px, color, |[x, y], along, up| [x + up, y - along]);
    }

    /// Text with an outline in another colour, readable on any background.
    pub fn text_rimmed(&mut self, [x, y]: [f64; 2], align: Align, text: &str, height_px: f64, color: Rgb, rim: Rgb) {
        for [dx, dy] in [[-1.2, 0.0], [1.2, 0.0], [0.0, -1.2], [0.0, 1.2], [-0.9, -0.9], [0.9, 0.9]] {
            self.text([x + dx, y + dy], align, text, height_px, rim);
        }
        self.text([x, y], align, text, height_px, color);
    }

    /// The final image.
    pub fn finish(self) -> Picture {
        let row = 3 * SCALE * self.width;
        let mut rgb = Vec::with_capacity(3 * self.width * self.height);
        for y in 0..self.height {
            let (upper, lower) = self.pixels[2 * y * row..(2 * y + 2) * row].split_at(row);
            for (a, b) in upper.chunks_exact(6).zip(lower.chunks_exact(6)) {
                let mean = |n: usize| (a[n] as u16 + a[n + 3] as u16 + b[n] as u16 + b[n + 3] as u16 + 2) / 4;
                rgb.extend([mean(0) as u8, mean(1) as u8, mean(2) as u8]);
            }
        }
        Picture { width: self.width, height: self.height, rgb }
    }

    fn capsule(&mut self, a: [f64; 2], b: [f64; 2], radius: f64, color: Rgb) {
        let Some(area) = bounding_box(&[a, b]) else { return };
        let area = Rect::new(area.x - radius, area.y - radius, area.width + 2.0 * radius, area.height + 2.0 * radius);
        let [dx, dy] = [b[0] - a[0], b[1] - a[1]];
        let per_length2 = 1.0 / (dx * dx + dy * dy).max(1e-12);
        self.shape(area, color, 1.0, |x, y| {
            let along = (((x - a[0]) * dx + (y - a[1]) * dy) * per_length2).clamp(0.0, 1.0);
            (x - a[0] - along * dx).hypot(y - a[1] - along * dy) - radius
        });
    }

    /// Blends `color` within `area` according to `distance`, the signed distance to the shape's
    /// edge, negative inside.
    fn shape(&mut self, area: Rect, color: Rgb, alpha: f64, distance: impl Fn(f64, f64) -> f64) {
        let Some([x0, x1, y0, y1]) = self.raster(area, 1.0) else { return };
        for j in y0..y1 {
            for i in x0..x1 {
                let away = distance((i as f64 + 0.5) / S, (j as f64 + 0.5) / S);
                let covered = (0.5 - away * S).clamp(0.0, 1.0) * alpha;
                if covered > 0.0 {
                    self.blend(i, j, color, covered as f32);
                }
            }
        }
    }

    /// Raster columns and rows of an area enlarged by `margin_px`, within the clip; `None` if
    /// empty.
    fn raster(&self, area: Rect, margin_px: f64) -> Option<[usize; 4]> {
        if ![area.x, area.y, area.width, area.height].iter().all(|v| v.is_finite()) {
            return None;
        }
        let range = |low: f64, high: f64, clip_low: f64, clip_high: f64, size: usize| {
            let low = (low - margin_px).max(clip_low).max(0.0) * S;
            let high = (high + margin_px).min(clip_high) * S;
            (low.round() as usize, (high.ceil().max(0.0) as usize).min(size * SCALE))
        };
        let (x0, x1) = range(area.x, area.right(), self.clip.x, self.clip.right(), self.width);
        let (y0, y1) = range(area.y, area.bottom(), self.clip.y, self.clip.bottom(), self.height);
        (x0 < x1 && y0 < y1).then_some([x0, x1, y0, y1])
    }

    fn blend(&mut self, i: usize, j: usize, color: Rgb, covered: f32) {
        let at = 3 * (j * self.width * SCALE + i);
        for (pixel, target) in self.pixels[at..at + 3].iter_mut().zip(color) {
            let before = *pixel as f32;
            *pixel = (before + (target as f32 - before) * covered + 0.5) as u8;
        }
    }

    fn glyphs(
        &mut self,
        origin: [f64; 2],
        align: Align,
        text: &str,
        height_px: f64,
        color: Rgb,
        onto_canvas: impl Fn([f64; 2], f64, f64) -> [f64; 2],
    ) {
        let size = height_px * S;
        let start = match align {
            Align::Left => 0.0,
            Align::Center => -0.5 * text_width(text, height_px),
            Align::Right => -text_width(text, height_px),
        };
        // The font puts the baseline half a size below the point; capitals are 0.6 of the size
        // high.
        let lift = 0.30 * size - 0.5 * size;
        let mut dots = Vec::new();
        let _ = font(size).draw(text, (0, 0), |along, down, covered| {
            dots.push((along, down, covered));
            Ok::<(), std::convert::Infallible>(())
        });
        for (along, down, covered) in dots {
            // The light font is drawn twice, half a pixel apart, to look like a regular weight.
            for thicker in 0..2 {
                let [x, y] = onto_canvas(origin, start + (along + thicker) as f64 / S, (down as f64 + lift) / S);
                let (i, j) = ((x * S).round(), (y * S).round());
                let inside =
                    i >= 0.0 && j >= 0.0 && i < (self.width * SCALE) as f64 && j < (self.height * SCALE) as f64;
                if inside {
                    self.blend(i as usize, j as usize, color, covered.clamp(0.0, 1.0));
                }
            }
        }
    }
}

/// Indices of the points that are distinguishable on the screen: the first, the last, and those
/// more than half a pixel from the one kept before. Thousands of poses per second fall on the same
/// few pixels.
pub fn visible_indices(points: &[[f64; 2]]) -> Vec<usize> {
    let mut kept: Vec<usize> = Vec::new();
    for (n, point) in points.iter().enumerate() {
        let moved = kept.last().map_or(f64::NAN, |&k| (point[0] - points[k][0]).hypot(point[1] - points[k][1]));
        // A NaN distance keeps the point: the line is interrupted there.
        if n + 1 == points.len() || moved.is_nan() || moved > 0.5 {
            kept.push(n);
        }
    }
    kept
}

/// Width of a line of text, pixels.
pub fn text_width(text: &str, height_px: f64) -> f64 {
    font(height_px * S).box_size(text).map_or(0.0, |(width, _)| width as f64 / S)
}

fn bounding_box(points: &[[f64; 2]]) -> Option<Rect> {
    if points.is_empty() || !points.iter().flatten().all(|v| v.is_finite() && v.abs() < 1e6) {
        return None;
    }
    let low = points.iter().fold([f64::MAX; 2], |a, p| [a[0].min(p[0]), a[1].min(p[1])]);
    let high = points.iter().fold([f64::MIN; 2], |a, p| [a[0].max(p[0]), a[1].max(p[1])]);
    Some(Rect::new(low[0], low[1], high[0] - low[0], high[1] - low[1]))
}

fn outward_normal(from: [f64; 2], to: [f64; 2]) -> Option<([f64; 2], [f64; 2])> {
    let [dx, dy] = [to[0] - from[0], to[1] - from[1]];
    let length = dx.hypot(dy);
    (length > 1e-9).then(|| (from, [dy / length, -dx / length]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::style::INK;

    fn pixel(picture: &Picture, x: usize, y: usize) -> [u8; 3] {
        let at = 3 * (y * picture.width + x);
        picture.rgb[at..at + 3].try_into().unwrap()
    }

    #[test]
    fn shapes_cover_only_their_inside() {
        let mut canvas = Canvas::new(40, 20);
        canvas.fill(Rect::new(2.0, 3.0, 5.0, 4.0), INK);
        canvas.disc([30.0, 10.0], 4.0, INK);
        canvas.convex(&[[12.0, 2.0], [20.0, 2.0], [20.0, 8.0], [12.0, 8.0]], INK, 1.0);
        let picture = canvas.finish();
        let dark = picture.rgb.chunks(3).filter(|p| p[0] < 100).count();
        assert_eq!(pixel(&picture, 2, 3), INK);
        assert_eq!(pixel(&picture, 1, 3), PAPER);
        assert_eq!(pixel(&picture, 30, 10), INK);
        assert_eq!(pixel(&picture, 15, 5), INK);
        assert!((110..125).contains(&dark), "{dark}");
    }

    #[test]
    fn non_finite_or_outside_shapes_draw_nothing() {
        let mut canvas = Canvas::new(10, 10);
        canvas.line([f64::NAN, 0.0], [3.0, 3.0], 1.0, INK);
        canvas.line([f64::INFINITY, 0.0], [3.0, 3.0], 1.0, INK);
        canvas.disc([1e300, 5.0], 2.0, INK);
        canvas.disc([5.0, 5.0], f64::NAN, INK);
        canvas.dashed(&[[0.0, f64::NAN], [3.0, 3.0]], 2.0, 1.0, INK);
        canvas.convex(&[], INK, 1.0);
        canvas.text([f64::NAN, 1e12], Align::Center, "nowhere", 12.0, INK);
        canvas.clipped(Rect::new(20.0, 20.0, 5.0, 5.0), |c| c.fill(Rect::new(0.0, 0.0, 10.0, 10.0), INK));
        assert!(canvas.finish().rgb.iter().all(|&v| v == 255));
    }

    #[test]
    fn duplicate_pixels_are_merged_and_gaps_kept() {
        assert_eq!(visible_indices(&[[0.0, 0.0], [0.1, 0.0], [0.7, 0.0], [0.8, 0.0]]), [0, 2, 3]);
        assert_eq!(visible_indices(&[[0.0, 0.0], [f64::NAN, 0.0], [0.1, 0.0], [0.2, 0.0]]), [0, 1, 2, 3]);
        assert!(visible_indices(&[]).is_empty());
    }

    #[test]
    fn text_is_aligned_and_centered() {
        let mut canvas = Canvas::new(100, 30);
        canvas.text([50.0, 15.0], Align::Center, "HHHH", 16.0, INK);
        let picture = canvas.finish();
        let dark: Vec<usize> = (0..3000).filter(|&n| picture.rgb[3 * n] < 128).collect();
        let mean = |f: fn(usize) -> usize| dark.iter().map(|&n| f(n) as f64).sum::<f64>() / dark.len() as f64;
        assert!((mean(|n| n % 100) - 50.0).abs() < 2.0);
        assert!((mean(|n| n / 100) - 15.0).abs() < 1.5);
    }
}
