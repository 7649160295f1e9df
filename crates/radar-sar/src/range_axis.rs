//! Ranges of the points of a subsweep.

/// Range of point `n`: `first_m + n · step_m`, metres from the sensor's phase centre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RangeAxis {
    /// Range of the first point; may be negative.
    pub first_m: f64,
    /// Distance between points, above 0.
    pub step_m: f64,
    /// Number of points, at least 1.
    pub points: usize,
}

impl RangeAxis {
    /// Range of point `n`, metres.
    #[inline]
    pub fn range_m(&self, n: usize) -> f64 {
        self.first_m + n as f64 * self.step_m
    }

    /// Range of the last point, metres.
    #[inline]
    pub fn last_m(&self) -> f64 {
        self.range_m(self.points.saturating_sub(1))
    }

    /// Whether a range lies between the first and the last point.
    #[inline]
    pub fn contains(&self, range_m: f64) -> bool {
        range_m >= self.first_m && range_m <= self.last_m()
    }

    /// The (fractional) point at a range.
    #[inline]
    pub fn point_at(&self, range_m: f64) -> f64 {
        (range_m - self.first_m) / self.step_m
    }
}
