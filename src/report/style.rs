//! Style of all figures: colours, sizes, fonts, ticks. The colours are from the set of Okabe and
//! Ito, which is distinguishable with colour blindness. Sizes are pixels of the final image.

use std::sync::Once;

use plotters::style::{FontDesc, FontFamily, FontStyle, register_font};

/// Red, green, blue.
pub type Rgb = [u8; 3];

/// Background of figures.
pub const PAPER: Rgb = [255, 255, 255];
/// Titles, numbers, frames.
pub const INK: Rgb = [28, 36, 48];
/// Labels and secondary text.
pub const MUTED: Rgb = [96, 106, 120];
/// Grid lines and empty background.
pub const GRID: Rgb = [226, 230, 236];
/// Ground truth.
pub const TRUTH: Rgb = [255, 255, 255];
/// Detections, on dark background.
pub const FOUND: Rgb = [64, 224, 255];
/// The sensor's path, on dark background.
pub const PATH: Rgb = [120, 235, 140];
/// Detections, on white.
pub const FOUND_INK: Rgb = [0, 114, 178];
/// False detections.
pub const FALSE_INK: Rgb = [213, 60, 0];
/// The sensor's path, on white.
pub const PATH_INK: Rgb = [0, 158, 115];

/// Height of a figure's title, pixels. Choice: of these four, each differs visibly from the next,
/// and the least is readable at half the picture's size.
pub const TITLE_PX: f64 = 23.0;
/// Height of a panel's title, pixels. Choice: see [`TITLE_PX`].
pub const HEADING_PX: f64 = 18.0;
/// Height of axis labels, legends, annotations, pixels. Choice: see [`TITLE_PX`].
pub const LABEL_PX: f64 = 16.0;
/// Height of the numbers at ticks, pixels. Choice: see [`TITLE_PX`].
pub const TICK_PX: f64 = 15.0;

const FAMILY: &str = "radar-chaperone-figures";

/// The font of the figures, `height_px` from the lowest descender to the highest ascender.
pub fn font(height_px: f64) -> FontDesc<'static> {
    static REGISTERED: Once = Once::new();
    REGISTERED.call_once(|| {
        if register_font(FAMILY, FontStyle::Normal, epaint_default_fonts::UBUNTU_LIGHT).is_err() {
            unreachable!("the font inside the program is a sound font");
        }
    });
    FontDesc::new(FontFamily::Name(FAMILY), height_px, FontStyle::Normal)
}

/// Round numbers within `[low, high]`, ascending, about `about` of them. Empty if the range is not
/// finite.
pub fn ticks(low: f64, high: f64, about: usize) -> Vec<f64> {
    let (low, high) = (low.min(high), low.max(high));
    let span = high - low;
    if !(span.is_finite() && span > 0.0) {
        return Vec::new();
    }
    let rough = span / about.max(1) as f64;
    let decade = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|n| n * decade).into_iter().find(|&step| step >= rough * 0.7);
    let step = step.unwrap_or(10.0 * decade);
    let first = (low / step - 1e-9).ceil();
    let last = (high / step + 1e-9).floor();
    if !(0.0..1000.0).contains(&(last - first)) {
        return Vec::new();
    }
    (0..=(last - first) as usize).map(|n| (first + n as f64) * step).collect()
}

/// Text of a tick on an axis with ticks `step` apart: as many decimals as the step needs, and a
/// typographic minus sign.
pub fn tick_text(value: f64, step: f64) -> String {
    let decimals = if step > 0.0 { (-(step * 1.001).log10().floor()).clamp(0.0, 6.0) as usize } else { 0 };
    let value = if value.abs() < step * 1e-6 { 0.0 } else { value };
    format!("{value:.decimals$}").replace('-', "−")
}

/// A number with three significant digits, for evidence and colour bars. Scientific notation from
/// 1e5 and below 1e-3.
pub fn short_number(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    let exponent = value.abs().log10().floor();
    if !(-3.0..5.0).contains(&exponent) {
        let mantissa = value / 10f64.powf(exponent);
        return format!("{mantissa:.1}e{exponent}").replace('-', "−");
    }
    let decimals = (2.0 - exponent).clamp(0.0, 6.0) as usize;
    format!("{value:.decimals$}").replace('-', "−")
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn ticks_are_round_and_in_range() {
        assert_eq!(ticks(0.0, 3.0, 6), [0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0]);
        assert_eq!(ticks(2.0, -1.0, 3), [-1.0, 0.0, 1.0, 2.0]);
        assert!(ticks(1.0, 1.0, 5).is_empty());
        assert!(ticks(f64::NAN, 1.0, 5).is_empty());
    }

    #[test]
    fn numbers_are_formatted_for_reading() {
        assert_eq!(tick_text(-0.5, 0.5), "−0.5");
        assert_eq!(tick_text(-1e-17, 0.5), "0.0");
        assert_eq!(tick_text(3.0, 1.0), "3");
        assert_eq!(short_number(1234.5), "1234");
        assert_eq!(short_number(0.01234), "0.0123");
        assert_eq!(short_number(3.2e8), "3.2e8");
    }

    proptest! {
        #[test]
        fn tick_count_is_bounded(low in -1e6..1e6f64, span in 1e-6..1e6f64, about in 1usize..12) {
            let ticks = ticks(low, low + span, about);
            prop_assert!(ticks.len() <= 2 * about + 3);
            prop_assert!(ticks.iter().all(|&t| t >= low - span * 1e-3 && t <= low + span * 1.001));
        }
    }
}
