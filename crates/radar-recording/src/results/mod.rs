//! Recordings with results: topics in addition to those of every recording. Each message holds
//! everything that its topic shows, so a viewer that jumps to a time needs only the last one.
//!
//! Topics (name, schema, frame, content):
//!
//! - `/room`, `foxglove.FrameTransform`: `room` → `tracking`, once; `room` has +z up, as viewers
//!   do.
//! - `/beam`, `foxglove.SceneUpdate`, in `sensor`: outline of the beam between the first and the
//!   last range, once.
//! - `/beam/outline`, `foxglove.PointCloud`, in `sensor`: the same as dots.
//! - `/scene`, `foxglove.SceneUpdate`, in `tracking`: obstacles, walls and moving targets, for
//!   every snapshot.
//! - `/scene/points`, `foxglove.PointCloud`, in `tracking`: voxels of the obstacles, when they
//!   change.
//! - `/scene/outlines`, `foxglove.PointCloud`, in `tracking`: boxes, uncertainties, walls and
//!   moving targets as dots, when they change.
//! - `/evidence`, `foxglove.PointCloud`, in `tracking`: the strongest voxels, at most twice a
//!   second.
//! - `/figures`, `radar_chaperone.results.Figures`: numbers to plot, for every snapshot.
//! - `/log`, `foxglove.Log`: new and removed objects, changes of the time offset, skipped data.
//!
//! Foxglove shows all of it. Rerun (0.41) does not support `SceneUpdate`; it shows the outlines as
//! dots.

mod beam;
mod cloud;
mod entities;
mod figures;
mod log;
mod outlines;
mod shapes;
mod snapshot;
mod topics;
mod writer;

pub use beam::BeamCone;
pub use figures::wire;
pub use snapshot::{ResultsCounters, Snapshot};
pub use writer::ResultsWriter;
