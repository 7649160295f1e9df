//! A thread that renders snapshots and writes them: `NAME_left.png`, `NAME_right.png`, and last
//! `NAME.json`.

use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::JoinHandle;

use image::{ImageFormat, Rgb, RgbImage};

use crate::dashboard::TabPicture;
use crate::eye_picture::{Layer, Paint, Surface, draw};
use crate::pyramid::{PixelDecoding, Pyramid, srgb_byte};
use crate::report::write_whole;
use crate::snapshot::{Eye, Item, Snapshot};
use crate::sys;
use crate::world::lock;

/// Limit of queued snapshots. Choice: a picture a second for a minute, on a machine that takes a second for each;
/// a snapshot holds copies of its textures, some MB.
const MAX_QUEUED: usize = 64;

/// A queued job.
enum Job {
    Eyes(Box<Snapshot>),
    Tab(Box<TabPicture>),
}

/// Handle of the thread.
pub struct Painter {
    wanted: SyncSender<Job>,
    thread: JoinHandle<()>,
}

impl Painter {
    /// Starts the thread. Images are written to `folder`.
    pub fn start(folder: PathBuf) -> Self {
        let (wanted, all) = sync_channel(MAX_QUEUED);
        let thread = std::thread::spawn(move || run(&folder, &all));
        Self { wanted, thread }
    }

    /// Queues a snapshot.
    ///
    /// # Errors
    /// The queue is full.
    pub fn draw(&self, snapshot: Snapshot) -> Result<(), String> {
        self.enqueue(Job::Eyes(Box::new(snapshot)))
    }

    /// Queues the images of a tab.
    ///
    /// # Errors
    /// The queue is full.
    pub fn write(&self, picture: TabPicture) -> Result<(), String> {
        self.enqueue(Job::Tab(Box::new(picture)))
    }

    fn enqueue(&self, wanted: Job) -> Result<(), String> {
        self.wanted.try_send(wanted).map_err(|error| match error {
            TrySendError::Full(_) => format!("{MAX_QUEUED} images are queued already"),
            TrySendError::Disconnected(_) => "the painter thread has ended".into(),
        })
    }

    /// Stops the thread after the queued jobs.
    pub fn finish(self) {
        drop(self.wanted);
        if self.thread.join().is_err() {
            eprintln!("fake runtime: the painter panicked");
        }
    }
}

fn run(folder: &Path, wanted: &Receiver<Job>) {
    for wanted in wanted {
        let outcome = match &wanted {
            Job::Eyes(snapshot) => paint(folder, snapshot),
            Job::Tab(picture) => picture.write(folder),
        };
        if let Some(world) = lock().as_mut() {
            match outcome {
                Ok(()) => world.report.shots += 1,
                Err(why) => world.report.shot_failed(why),
            }
        }
    }
}

/// The mip pyramids of an overlay: one for both eyes, or one for each.
fn pyramids(item: &Item) -> Result<Vec<Pyramid>, String> {
    let Some(texture) = &item.overlay.texture else { return Ok(Vec::new()) };
    let copied = texture.copied.as_ref().ok_or_else(|| format!("{}: its texture was not copied", item.overlay.key))?;
    let bytes = copied.read()?;
    let color_space = match item.overlay.look.color_space {
        sys::EColorSpace_ColorSpace_Auto => texture.color_space,
        chosen => chosen,
    };
    let reading = PixelDecoding {
        format: copied.image.format,
        linear: color_space == sys::EColorSpace_ColorSpace_Linear,
        premultiplied: item.overlay.has(sys::VROverlayFlags_IsPremultiplied),
        ignore_alpha: item.overlay.has(sys::VROverlayFlags_IgnoreTextureAlpha),
    };
    let width = copied.image.width as usize;
    let part = |columns| Pyramid::new(&bytes, width, columns, reading);
    Ok(match item.left_half_first() {
        None => vec![part([0, width])],
        Some(_) if width < 2 => return Err(format!("{}: no halves in a texture 1 pixel wide", item.overlay.key)),
        Some(_) => vec![part([0, width / 2]), part([width / 2, width / 2 * 2])],
    })
}

/// The layer of an overlay for an eye.
fn layer<'a>(snapshot: &Snapshot, item: &'a Item, pyramids: &'a [Pyramid], eye: &Eye) -> Option<Layer<'a>> {
    let size_m = [f64::from(item.overlay.look.width_m), item.height_m()?];
    let surface = Surface::new(item.shape, size_m, eye)?;
    let half = item.left_half_first().map_or(0, |left_first| usize::from(eye.is_left != left_first));
    let paint = if surface.faces_eye() {
        Paint::Texture { pyramid: pyramids.get(half)?, bounds: item.overlay.look.bounds.map(f64::from) }
    } else if snapshot.backs && !item.overlay.has(sys::VROverlayFlags_NoBackside) {
        Paint::Back
    } else {
        return None;
    };
    Some(Layer { surface, paint, alpha: item.overlay.look.alpha, color: item.overlay.look.color })
}

/// An eye's layers in drawing order.
fn layers<'a>(snapshot: &'a Snapshot, pyramids: &'a [Vec<Pyramid>], eye: &Eye) -> Vec<Layer<'a>> {
    let items = snapshot.items.iter().zip(pyramids);
    let mut layers: Vec<_> = items
        .filter_map(|(item, pyramids)| Some((item.overlay.look.sort_order, layer(snapshot, item, pyramids, eye)?)))
        .collect();
    layers.sort_by(|(a, left), (b, right)| {
        let far_first = right.surface.distance_m().total_cmp(&left.surface.distance_m());
        a.cmp(b).then(far_first)
    });
    layers.into_iter().map(|(_, layer)| layer).collect()
}

fn paint(folder: &Path, snapshot: &Snapshot) -> Result<(), String> {
    let said = |path: &Path, error: &dyn std::fmt::Display| format!("{}: {error}", path.display());
    std::fs::create_dir_all(folder).map_err(|error| said(folder, &error))?;
    let pyramids = snapshot.items.iter().map(pyramids).collect::<Result<Vec<_>, _>>()?;
    for eye in &snapshot.eyes {
        let picture = draw(snapshot, eye, &layers(snapshot, &pyramids, eye));
        let side = if eye.is_left { "left" } else { "right" };
        let path = folder.join(format!("{}_{side}.png", snapshot.name));
        write_whole(&path, &png(&picture, snapshot.size)?).map_err(|error| said(&path, &error))?;
    }
    let path = folder.join(format!("{}.json", snapshot.name));
    let json = serde_json::to_vec_pretty(&snapshot.to_json()).map_err(|error| said(&path, &error))?;
    write_whole(&path, &json).map_err(|error| said(&path, &error))
}

fn png(picture: &[[f32; 3]], [width, height]: [u32; 2]) -> Result<Vec<u8>, String> {
    let mut image = RgbImage::new(width, height);
    // Most pixels have the colour of the pixel before them, and the curve is slow.
    let mut last = ([0.0; 3], [0.0; 3].map(srgb_byte));
    for (pixel, light) in image.pixels_mut().zip(picture) {
        if *light != last.0 {
            last = (*light, light.map(srgb_byte));
        }
        *pixel = Rgb(last.1);
    }
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, ImageFormat::Png).map_err(|error| error.to_string())?;
    Ok(bytes.into_inner())
}

/// Whether a name is allowed as a part of a file name.
pub fn is_name(name: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    (1..=100).contains(&name.len()) && !name.starts_with('.') && name.chars().all(plain)
}
