//! The picture in README.md: an eye preview of the demo next to its map.
//!
//!     cargo run --release -p lab --example readme_picture -- [DEMO_FOLDER]

use std::fs::File;
use std::io::BufWriter;

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::imageops::{self, FilterType::Lanczos3};
use image::{ExtendedColorType, ImageEncoder, RgbImage};

/// Height of both pictures, pixels. Choice: both fit a page's width.
const HEIGHT: u32 = 480;

fn at_height(path: &str) -> RgbImage {
    let picture = image::open(path).unwrap_or_else(|e| panic!("{path}: {e}; run the demo first")).to_rgb8();
    let width = picture.width() * HEIGHT / picture.height();
    imageops::resize(&picture, width, HEIGHT, Lanczos3)
}

fn main() {
    let folder = std::env::args().nth(1).unwrap_or("demo-out".into()) + "/furnished-room";
    let (eye, map) = (at_height(&format!("{folder}/eye_left.png")), at_height(&format!("{folder}/map.png")));
    let mut both = RgbImage::new(eye.width() + map.width(), HEIGHT);
    imageops::replace(&mut both, &eye, 0, 0);
    imageops::replace(&mut both, &map, i64::from(eye.width()), 0);
    // Sets the two lowest bits: their noise is invisible and would double the file size.
    both.iter_mut().for_each(|channel| *channel |= 3);
    let file = File::create("docs/furnished-room.png").expect("docs/furnished-room.png");
    PngEncoder::new_with_quality(BufWriter::new(file), CompressionType::Best, FilterType::Adaptive)
        .write_image(&both, both.width(), both.height(), ExtendedColorType::Rgb8)
        .expect("docs/furnished-room.png");
}
