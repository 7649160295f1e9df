//! A short text as a signed distance field, which a shader draws with an outline at any size.

use ab_glyph::{Font, FontRef, PxScale, ScaleFont};

/// Ubuntu Light, the font that egui draws the panel with.
const FONT: &[u8] = include_bytes!("../../overlay_assets/fonts/Ubuntu-Light.ttf");
/// Font height, texels. Choice: a distance field of this size stays sharp at arm's length.
const FONT_PX: f32 = 40.0;
/// Margin around the text and largest distance stored, texels. Choice: the outline's width, in the
/// finest texture's pixels.
const MARGIN_TEXELS: i32 = 7;

/// Signed distances to the outline of a text, texels, negative inside, `[row][column]` from the
/// top.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Label {
    pub columns: u32,
    pub rows: u32,
    pub distances: Vec<f32>,
}

impl Label {
    /// The text in one line. Empty if the font cannot be read.
    pub fn new(text: &str) -> Self {
        let Ok(font) = FontRef::try_from_slice(FONT) else { return Self::default() };
        let font = font.as_scaled(PxScale::from(FONT_PX));
        let mut right = MARGIN_TEXELS as f32;
        let mut outlines = Vec::new();
        for letter in text.chars() {
            let mut glyph = font.scaled_glyph(letter);
            glyph.position = ab_glyph::point(right, MARGIN_TEXELS as f32 + font.ascent());
            right += font.h_advance(glyph.id);
            outlines.extend(font.outline_glyph(glyph));
        }
        let columns = right.ceil() as i32 + MARGIN_TEXELS;
        let rows = (font.ascent() - font.descent()).ceil() as i32 + 2 * MARGIN_TEXELS;
        let mut covered = vec![0.0f32; (columns * rows) as usize];
        for outline in outlines {
            let corner = outline.px_bounds().min;
            outline.draw(|x, y, coverage| {
                let (x, y) = (x as i32 + corner.x as i32, y as i32 + corner.y as i32);
                if (0..columns).contains(&x) && (0..rows).contains(&y) {
                    let texel = &mut covered[(y * columns + x) as usize];
                    *texel = texel.max(coverage);
                }
            });
        }
        Self { columns: columns as u32, rows: rows as u32, distances: distances(&covered, columns, rows) }
    }

    /// Width over height.
    pub fn aspect(&self) -> f64 {
        f64::from(self.columns) / f64::from(self.rows.max(1))
    }
}

/// Distance of each texel to the nearest texel on the other side of the outline, corrected by the
/// coverage of that texel.
fn distances(covered: &[f32], columns: i32, rows: i32) -> Vec<f32> {
    let at = |x: i32, y: i32| {
        let is_there = (0..columns).contains(&x) && (0..rows).contains(&y);
        if is_there { covered[(y * columns + x) as usize] } else { 0.0 }
    };
    let texel = |index: i32| {
        let (x, y) = (index % columns, index / columns);
        let own = at(x, y);
        let is_inside = own >= 0.5;
        let mut nearest = MARGIN_TEXELS as f32;
        for dy in -MARGIN_TEXELS..=MARGIN_TEXELS {
            for dx in -MARGIN_TEXELS..=MARGIN_TEXELS {
                let other = at(x + dx, y + dy);
                if (other >= 0.5) != is_inside {
                    let edge = f32::hypot(dx as f32, dy as f32) - (other - 0.5).abs();
                    nearest = nearest.min(edge.max(0.0));
                }
            }
        }
        if is_inside { -nearest } else { nearest }
    };
    (0..columns * rows).map(texel).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn label_has_inside_outside_and_width() {
        let (short, long) = (Label::new("0.8 m"), Label::new("10.8 m"));
        assert!(long.columns > short.columns + 8 && long.rows == short.rows);
        assert_eq!(short.distances.len(), (short.columns * short.rows) as usize);
        let inside = short.distances.iter().filter(|d| **d < 0.0).count();
        assert!(inside > 200 && inside < short.distances.len() / 4, "{inside} of {}", short.distances.len());
        let edge = |n: u32| short.distances[n as usize];
        assert!((0..short.columns).all(|n| edge(n) > 0.0), "the text does not touch its edge");
        assert_ne!(short, Label::new("0.9 m"));
        assert_eq!(Label::new("").distances.iter().filter(|d| **d < 0.0).count(), 0);
    }
}
