//! The room from above as a short film: how the map grows while the wearer looks around.

use image::codecs::gif::{GifEncoder, Repeat};
use image::{Delay, Frame, RgbImage};

use radar_mapping::Scene;

use super::ReportError;
use super::room_map::{RoomMap, region, room_map};
use super::views::drawable;

/// Pictures of a film, and for how long each and the last are shown, milliseconds. Choice: twelve seconds that can be followed,
/// and time to look at the result.
const MAX_PICTURES: usize = 120;
const PICTURE_MS: u32 = 100;
const LAST_MS: u32 = 3000;
/// Speed of the choice of 256 colours, 1 to 30. Choice: maps have few colours; slower ones look the same.
const QUANTIZER_SPEED: i32 = 20;

/// A moment of the film.
#[derive(Debug, Clone, PartialEq)]
struct Moment {
    time_ns: i64,
    scene: Scene,
}

/// Collects what a film shows, in bounded memory: when there are too many moments, every second is dropped.
#[derive(Debug, Default)]
pub struct FilmRecorder {
    moments: Vec<Moment>,
    step_ns: i64,
}

impl FilmRecorder {
    /// Takes the scene of a time.
    pub fn record(&mut self, time_ns: i64, scene: &Scene) {
        if self.moments.last().is_some_and(|last| time_ns.saturating_sub(last.time_ns) < self.step_ns) {
            return;
        }
        if self.moments.len() >= 2 * MAX_PICTURES {
            let mut index = 0;
            self.moments.retain(|_| {
                index += 1;
                index % 2 == 1
            });
            let covered_ns = time_ns.saturating_sub(self.moments[0].time_ns);
            self.step_ns = covered_ns / MAX_PICTURES as i64;
        }
        self.moments.push(Moment { time_ns, scene: scene.clone() });
    }

    /// The bytes of the film, an animated GIF. `last` is the whole map at the end: every picture shows its part of the room.
    /// `path_ns` holds the times of its path.
    ///
    /// # Errors
    /// A picture cannot be encoded.
    pub fn gif(&self, last: &RoomMap, path_ns: &[i64]) -> Result<Vec<u8>, ReportError> {
        let moments = self.moments.iter().step_by(self.moments.len().div_ceil(MAX_PICTURES).max(1));
        let shown = drawable(&region(last));
        let first_ns = self.moments.first().map_or(0, |moment| moment.time_ns);
        let mut bytes = Vec::new();
        let failed = |source| ReportError::Gif { frames: self.moments.len(), source };
        {
            let mut encoder = GifEncoder::new_with_speed(&mut bytes, QUANTIZER_SPEED);
            encoder.set_repeat(Repeat::Infinite).map_err(failed)?;
            for moment in moments {
                let second = moment.time_ns.saturating_sub(first_ns) / 1_000_000_000;
                let title = format!("{}, {second} s", last.title);
                let walked = path_ns.partition_point(|time_ns| *time_ns <= moment.time_ns).min(last.path_m.len());
                let path_m = &last.path_m[..walked];
                let map = RoomMap { title: &title, scene: &moment.scene, path_m, region: Some(shown), ..*last };
                encoder.encode_frame(frame(&map, PICTURE_MS)).map_err(failed)?;
            }
            encoder.encode_frame(frame(&RoomMap { region: Some(shown), ..*last }, LAST_MS)).map_err(failed)?;
        }
        Ok(bytes)
    }
}

fn frame(map: &RoomMap, shown_ms: u32) -> Frame {
    let picture = room_map(map);
    let image = RgbImage::from_raw(picture.width as u32, picture.height as u32, picture.rgb).unwrap_or_default();
    let rgba = image::DynamicImage::ImageRgb8(image).into_rgba8();
    Frame::from_parts(rgba, 0, 0, Delay::from_numer_denom_ms(shown_ms, 1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use image::AnimationDecoder;
    use image::codecs::gif::GifDecoder;

    #[test]
    fn film_shows_the_beginning_and_the_end() {
        let mut recorder = FilmRecorder::default();
        for second in 0..1000 {
            recorder.record(second * 1_000_000_000, &Scene::default());
            assert!(recorder.moments.len() <= 2 * MAX_PICTURES);
        }
        let path_m: Vec<DVec3> =
            (0..1000).map(|n| DVec3::new((f64::from(n) * 0.01).sin(), 1.6, -0.002 * f64::from(n))).collect();
        let path_ns: Vec<i64> = (0..1000).map(|second| second * 1_000_000_000).collect();
        let scene = Scene::default();
        let last = RoomMap { title: "simulated room", scene: &scene, truth: None, path_m: &path_m, region: None };
        let bytes = recorder.gif(&last, &path_ns).unwrap();
        let frames = GifDecoder::new(std::io::Cursor::new(&bytes)).unwrap().into_frames().collect_frames().unwrap();
        assert!((60..=MAX_PICTURES + 1).contains(&frames.len()), "{}", frames.len());
        let size = frames[0].buffer().dimensions();
        assert!(frames.iter().all(|frame| frame.buffer().dimensions() == size), "one part of the room in all of them");
        assert_ne!(frames[0].buffer(), frames[frames.len() - 1].buffer());
    }
}
