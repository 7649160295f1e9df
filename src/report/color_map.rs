//! Perceptually uniform colour maps (matplotlib's inferno and viridis, from nine anchors).

use super::style::Rgb;

/// Colours at equal steps (source: matplotlib's colour maps inferno and viridis).
const INFERNO: [u32; 9] = [0x000004, 0x210c4a, 0x56106e, 0x89226a, 0xbb3754, 0xe35932, 0xf98c0a, 0xf9c932, 0xfcffa4];
const VIRIDIS: [u32; 9] = [0x440154, 0x472d7b, 0x3b528b, 0x2c728e, 0x21908c, 0x27ad81, 0x5dc863, 0xaadc32, 0xfde725];

/// Black over purple and orange to pale yellow, for `share` 0 to 1. For magnitudes.
pub fn inferno(share: f64) -> Rgb {
    interpolate(&INFERNO, share)
}

/// Dark blue over green to yellow, for `share` 0 to 1. For categories and times.
pub fn viridis(share: f64) -> Rgb {
    interpolate(&VIRIDIS, share)
}

/// `a` blended with `share` of `b`.
pub fn mix(a: Rgb, b: Rgb, share: f64) -> Rgb {
    std::array::from_fn(|n| (a[n] as f64 + (b[n] as f64 - a[n] as f64) * share).round() as u8)
}

fn interpolate(anchors: &[u32; 9], share: f64) -> Rgb {
    let at = if share.is_nan() { 0.0 } else { share.clamp(0.0, 1.0) * 8.0 };
    let below = (at as usize).min(7);
    mix(rgb(anchors[below]), rgb(anchors[below + 1]), at - below as f64)
}

fn rgb(hex: u32) -> Rgb {
    [(hex >> 16) as u8, (hex >> 8) as u8, hex as u8]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn color_maps_increase_in_brightness() {
        let luminance = |c: Rgb| 0.2126 * c[0] as f64 + 0.7152 * c[1] as f64 + 0.0722 * c[2] as f64;
        for map in [inferno, viridis] {
            let values: Vec<f64> = (0..=100).map(|n| luminance(map(n as f64 / 100.0))).collect();
            assert!(values.windows(2).all(|w| w[1] > w[0] - 1.0));
        }
        assert_eq!(inferno(0.0), [0, 0, 4]);
        assert_eq!(inferno(7.0), [252, 255, 164]);
        assert_eq!(viridis(f64::NAN), [68, 1, 84]);
    }
}
