//! Places labels so that they do not overlap.

use egui::{Rect, Vec2, vec2};

/// Gap between two labels, pixels. Choice: borders stay distinguishable.
const GAP: f32 = 1.0;
/// Limit of stacked labels. Choice: a higher stack would leave the mark it belongs to.
const STEPS: usize = 8;

/// Areas that are taken by labels.
#[derive(Default)]
pub struct Labels(Vec<Rect>);

impl Labels {
    /// Takes an area regardless of overlap.
    pub fn take(&mut self, rect: Rect) -> Rect {
        self.0.push(rect);
        rect
    }

    /// Takes an area, or the free one above the labels that overlap it.
    pub fn place_above(&mut self, mut rect: Rect) -> Rect {
        for _ in 0..STEPS {
            let Some(under) = self.0.iter().find(|other| other.intersects(rect)) else { break };
            rect = rect.translate(vec2(0.0, under.top() - rect.bottom() - GAP));
        }
        self.take(rect)
    }

    /// Takes the first free area for a label at a corner of a mark, preferably one that covers no
    /// other mark. `None` if other labels cover all corners.
    pub fn place_beside(&mut self, mark: Rect, size: Vec2, marks: &[Rect]) -> Option<Rect> {
        let (right, left) = (mark.right() + GAP, mark.left() - GAP - size.x);
        let (high, low) = (mark.center().y - 0.5 * GAP - size.y, mark.center().y + 0.5 * GAP);
        let corners = [(right, high), (left, high), (right, low), (left, low)];
        let rects = corners.into_iter().map(|(x, y)| Rect::from_min_size((x, y).into(), size));
        let is_over = |rect: &Rect, others: &[Rect]| others.iter().any(|other| other.intersects(*rect));
        let free: Vec<Rect> = rects.filter(|rect| !is_over(rect, &self.0)).collect();
        let rect = free.iter().find(|rect| !is_over(rect, marks)).or(free.first())?;
        Some(self.take(*rect))
    }
}

#[cfg(test)]
mod tests {
    use egui::pos2;

    use super::*;

    fn rect(x: f32, y: f32) -> Rect {
        Rect::from_min_size(pos2(x, y), vec2(20.0, 10.0))
    }

    #[test]
    fn labels_at_one_point_stack_upwards() {
        let mut labels = Labels::default();
        let stacked = [0, 1, 2].map(|_| labels.place_above(rect(100.0, 100.0)).top());
        assert_eq!(stacked, [100.0, 89.0, 78.0]);
        assert_eq!(labels.place_above(rect(150.0, 100.0)), rect(150.0, 100.0));
    }

    #[test]
    fn labels_surround_their_mark_then_are_dropped() {
        let mut labels = Labels::default();
        let mark = Rect::from_center_size(pos2(100.0, 100.0), vec2(10.0, 10.0));
        let rects: Vec<_> = (0..8).filter_map(|_| labels.place_beside(mark, vec2(20.0, 10.0), &[])).collect();
        assert_eq!(rects.len(), 4, "{rects:?}");
        for (n, one) in rects.iter().enumerate() {
            assert!(!rects[n + 1..].iter().any(|other| other.intersects(*one)), "{rects:?}");
            assert!(one.distance_to_pos(mark.center()) < 8.0, "near its mark: {one:?}");
        }
    }

    #[test]
    fn labels_avoid_other_marks() {
        let mark = |x: f32| Rect::from_center_size(pos2(x, 100.0), vec2(10.0, 10.0));
        let beside = |marks: &[Rect]| Labels::default().place_beside(mark(100.0), vec2(20.0, 10.0), marks).unwrap();
        assert!(beside(&[]).left() > 100.0 && beside(&[mark(115.0)]).right() < 100.0);
        let around: Vec<Rect> = (0..9).map(|n| mark(60.0 + 10.0 * n as f32)).collect();
        assert_eq!(beside(&around), beside(&[]), "all are covered alike");
    }
}
