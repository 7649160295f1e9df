//! A texture as a mip pyramid in linear light, premultiplied, and its sampling.

use ash::vk;

/// A pixel: red, green, blue times alpha, and alpha.
pub type Pixel = [f32; 4];

/// How bytes are decoded to linear light.
#[derive(Debug, Clone, Copy)]
pub struct PixelDecoding {
    pub format: vk::Format,
    /// Whether values are linear for a format without sRGB curve.
    pub linear: bool,
    pub premultiplied: bool,
    pub ignore_alpha: bool,
}

struct Level {
    width: usize,
    height: usize,
    pixels: Vec<Pixel>,
}

/// A texture and its halved copies, down to one pixel.
pub struct Pyramid {
    levels: Vec<Level>,
}

impl Pyramid {
    /// From rows of four bytes per pixel: the columns `first` to `last` of rows that are `stride`
    /// pixels long.
    pub fn new(bytes: &[u8], stride: usize, [first, last]: [usize; 2], reading: PixelDecoding) -> Self {
        let decode = decoding(reading);
        let columns = |row: &[u8]| -> Vec<Pixel> {
            row[first * 4..last * 4]
                .chunks_exact(4)
                .map(|p| pixel([p[0], p[1], p[2], p[3]], reading, &decode))
                .collect()
        };
        let pixels: Vec<Pixel> = bytes.chunks_exact(stride * 4).flat_map(columns).collect();
        let width = last - first;
        let mut levels = vec![Level { width, height: pixels.len() / width, pixels }];
        while let Some(next) = levels.last().and_then(Level::halved) {
            levels.push(next);
        }
        Self { levels }
    }

    /// Width and height, pixels.
    pub fn size(&self) -> [usize; 2] {
        [self.levels[0].width, self.levels[0].height]
    }

    /// Mean colour around a point (0 to 1 across and down) over the area spanned by `along` and
    /// `across` in the same units, with several samples along the longer of the two.
    pub fn sample(&self, at: [f64; 2], along: [f64; 2], across: [f64; 2]) -> Pixel {
        /// Choice: anisotropic filtering for views down to 7°; more oblique ones blur.
        const MAX_SAMPLES: f64 = 8.0;
        let [width, height] = self.size().map(|size| size as f64);
        let texels = |v: [f64; 2]| ((v[0] * width).powi(2) + (v[1] * height).powi(2)).sqrt();
        let (long, short) = if texels(along) >= texels(across) { (along, across) } else { (across, along) };
        let count = (texels(long) / texels(short).max(1.0)).ceil().clamp(1.0, MAX_SAMPLES);
        let level = (texels(long) / count).max(texels(short)).max(1.0).log2();
        let mut sum = [0.0; 4];
        for step in 0..count as usize {
            let share = (step as f64 + 0.5) / count - 0.5;
            add(&mut sum, self.between_levels([at[0] + share * long[0], at[1] + share * long[1]], level), 1.0);
        }
        sum.map(|v| v / count as f32)
    }

    fn between_levels(&self, at: [f64; 2], level: f64) -> Pixel {
        let level = level.min((self.levels.len() - 1) as f64);
        let (lower, share) = (level.floor() as usize, level.fract() as f32);
        let mut mean = [0.0; 4];
        add(&mut mean, self.levels[lower].bilinear(at), 1.0 - share);
        if share > 0.0 {
            add(&mut mean, self.levels[lower + 1].bilinear(at), share);
        }
        mean
    }
}

fn add(sum: &mut Pixel, pixel: Pixel, weight: f32) {
    sum.iter_mut().zip(pixel).for_each(|(sum, part)| *sum += weight * part);
}

impl Level {
    fn at(&self, x: i64, y: i64) -> Pixel {
        let inside = |i: i64, size: usize| i.clamp(0, size as i64 - 1) as usize;
        self.pixels[inside(y, self.height) * self.width + inside(x, self.width)]
    }

    fn bilinear(&self, [u, v]: [f64; 2]) -> Pixel {
        let (x, y) = (u * self.width as f64 - 0.5, v * self.height as f64 - 0.5);
        let (left, up) = (x.floor() as i64, y.floor() as i64);
        let (right_share, down_share) = ((x - x.floor()) as f32, (y - y.floor()) as f32);
        let mut mean = [0.0; 4];
        add(&mut mean, self.at(left, up), (1.0 - right_share) * (1.0 - down_share));
        add(&mut mean, self.at(left + 1, up), right_share * (1.0 - down_share));
        add(&mut mean, self.at(left, up + 1), (1.0 - right_share) * down_share);
        add(&mut mean, self.at(left + 1, up + 1), right_share * down_share);
        mean
    }

    /// Means of two by two pixels; `None` for a single pixel.
    fn halved(&self) -> Option<Self> {
        if self.width == 1 && self.height == 1 {
            return None;
        }
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let mean = |i: usize| {
            let (x, y) = (2 * (i % width) as i64, 2 * (i / width) as i64);
            let mut mean = [0.0; 4];
            [(0, 0), (1, 0), (0, 1), (1, 1)].iter().for_each(|(dx, dy)| add(&mut mean, self.at(x + dx, y + dy), 0.25));
            mean
        };
        Some(Self { width, height, pixels: (0..width * height).map(mean).collect() })
    }
}

/// Linear value of each byte.
fn decoding(reading: PixelDecoding) -> [f32; 256] {
    let is_srgb = matches!(reading.format, vk::Format::R8G8B8A8_SRGB | vk::Format::B8G8R8A8_SRGB);
    std::array::from_fn(|byte| {
        let value = byte as f32 / 255.0;
        if reading.linear && !is_srgb { value } else { light(value) }
    })
}

fn pixel([r, g, b, a]: [u8; 4], reading: PixelDecoding, decode: &[f32; 256]) -> Pixel {
    let is_bgra = matches!(reading.format, vk::Format::B8G8R8A8_SRGB | vk::Format::B8G8R8A8_UNORM);
    let [r, b] = if is_bgra { [b, r] } else { [r, b] };
    let alpha = if reading.ignore_alpha { 1.0 } else { f32::from(a) / 255.0 };
    let by = if reading.premultiplied { 1.0 } else { alpha };
    let [r, g, b] = [r, g, b].map(|byte| decode[usize::from(byte)] * by);
    [r, g, b, alpha]
}

/// Linear value of an sRGB value, 0 to 1.
fn light(value: f32) -> f32 {
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

/// The sRGB byte of a linear value.
pub fn srgb_byte(light: f32) -> u8 {
    let light = light.clamp(0.0, 1.0);
    let value = if light <= 0.003_130_8 { light * 12.92 } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 };
    (value * 255.0).round() as u8
}
