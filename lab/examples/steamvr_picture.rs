//! `steamvr_picture OUT.png SHOT…`: shots of the fake SteamVR runtime side by side, left and right
//! eye of each, cropped to where warnings are visible. `docs/beside-steamvr.sh` makes the picture
//! of the live display with it.

use std::fs::File;
use std::io::BufWriter;

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::imageops::{self, FilterType::Lanczos3};
use image::{ExtendedColorType, ImageEncoder, RgbImage};

/// Crop of an eye's picture, as shares of its width and height: left, top, width, height. Choice:
/// the warnings without the black around them.
const CUT: [f32; 4] = [0.12, 0.38, 0.72, 0.5];
/// Size of each crop, pixels. Choice: all shots fit a page's width.
const SIZE: [u32; 2] = [300, 234];
/// Gap between two eyes, and between two shots, pixels. Choice: two eyes belong together, two shots
/// do not.
const GAPS: [u32; 2] = [2, 14];

fn cut(path: &str) -> RgbImage {
    let picture = image::open(path).unwrap_or_else(|e| panic!("{path}: {e}")).to_rgb8();
    let [left, top, width, height] = CUT;
    let across = |share: f32| (share * picture.width() as f32) as u32;
    let down = |share: f32| (share * picture.height() as f32) as u32;
    let part = imageops::crop_imm(&picture, across(left), down(top), across(width), down(height)).to_image();
    imageops::resize(&part, SIZE[0], SIZE[1], Lanczos3)
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let out = arguments.next().expect("steamvr_picture OUT.png SHOT…");
    let shots: Vec<[RgbImage; 2]> =
        arguments.map(|shot| ["left", "right"].map(|eye| cut(&format!("{shot}_{eye}.png")))).collect();
    let count = shots.len() as u32;
    let width = count * (2 * SIZE[0] + GAPS[0]) + count.saturating_sub(1) * GAPS[1];
    let mut all = RgbImage::from_pixel(width, SIZE[1], image::Rgb([255; 3]));
    let mut at = 0;
    for eyes in &shots {
        for eye in eyes {
            imageops::replace(&mut all, eye, i64::from(at), 0);
            at += SIZE[0] + GAPS[0];
        }
        at += GAPS[1] - GAPS[0];
    }
    // Sets the two lowest bits: their noise is invisible and would double the file size.
    all.iter_mut().for_each(|channel| *channel |= 3);
    let file = File::create(&out).unwrap_or_else(|e| panic!("{out}: {e}"));
    PngEncoder::new_with_quality(BufWriter::new(file), CompressionType::Best, FilterType::Adaptive)
        .write_image(&all, all.width(), all.height(), ExtendedColorType::Rgb8)
        .unwrap_or_else(|e| panic!("{out}: {e}"));
}
