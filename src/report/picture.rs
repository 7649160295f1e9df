//! A finished image: written as a PNG file, or as PNG bytes for a report.

use std::path::Path;

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};

use super::{ReportError, write_atomically};

/// An image.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// Width, pixels.
    pub width: usize,
    /// Height, pixels.
    pub height: usize,
    /// Red, green, blue, 8 bits each, row by row from the upper left.
    pub rgb: Vec<u8>,
}

impl Picture {
    /// The bytes of a PNG file.
    ///
    /// # Errors
    /// The image has no pixels, or its number of bytes does not match its size.
    pub fn png(&self) -> Result<Vec<u8>, ReportError> {
        let failed = |source| ReportError::Png { width: self.width, height: self.height, source };
        if self.rgb.len() != 3 * self.width * self.height {
            let text = format!("{} bytes", self.rgb.len());
            return Err(failed(image::ImageError::IoError(std::io::Error::other(text))));
        }
        let mut bytes = Vec::new();
        PngEncoder::new_with_quality(&mut bytes, CompressionType::Level(4), FilterType::Adaptive)
            .write_image(&self.rgb, self.width as u32, self.height as u32, ExtendedColorType::Rgb8)
            .map_err(failed)?;
        Ok(bytes)
    }

    /// Writes a PNG file.
    ///
    /// # Errors
    /// As [`Picture::png`], or the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), ReportError> {
        write_atomically(path, &self.png()?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn png_contains_the_pixels() {
        let rgb: Vec<u8> = (0..5 * 3 * 3).map(|n| (n * 5) as u8).collect();
        let picture = Picture { width: 5, height: 3, rgb };
        let read = image::load_from_memory(&picture.png().unwrap()).unwrap().to_rgb8();
        assert_eq!(read.dimensions(), (5, 3));
        assert_eq!(read.into_raw(), picture.rgb);
    }

    #[test]
    fn wrong_image_size_is_rejected() {
        assert!(Picture { width: 9, height: 9, rgb: vec![0; 3] }.png().is_err());
    }
}
