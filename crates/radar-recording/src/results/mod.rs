//! A recording with what came of it: beside the topics of every recording, these. Each message of a topic holds all that
//! the topic shows, so a viewer that jumps to a time needs the last one alone.
//!
//! | topic | schema | frame | what |
//! |---|---|---|---|
//! | `/room` | `foxglove.FrameTransform` | | `room` → `tracking`, once: `room` has +z up, as viewers do |
//! | `/beam` | `foxglove.SceneUpdate` | `sensor` | the beam's edge between the first and the last range, once |
//! | `/beam/outline` | `foxglove.PointCloud` | `sensor` | the same in dots |
//! | `/scene` | `foxglove.SceneUpdate` | `tracking` | obstacles, walls and what moves, at every look |
//! | `/scene/points` | `foxglove.PointCloud` | `tracking` | the voxels of the obstacles, when they changed |
//! | `/scene/outlines` | `foxglove.PointCloud` | `tracking` | boxes, uncertainties, walls and what moves in dots, when they changed |
//! | `/evidence` | `foxglove.PointCloud` | `tracking` | the strongest voxels, twice a second at most |
//! | `/figures` | `radar_chaperone.results.Figures` | | numbers to plot, at every look |
//! | `/log` | `foxglove.Log` | | what was found and forgotten, changes of the time offset, what was left out |
//!
//! Foxglove shows all of it. Rerun (0.41) knows no `SceneUpdate`: for it the outlines are drawn in dots.

mod beam;
mod cloud;
mod entities;
mod figures;
mod log;
mod outlines;
mod shapes;
mod snapshot;
mod writer;

pub use beam::BeamCone;
pub use figures::wire;
pub use snapshot::{OffsetEstimate, ResultsCounters, Snapshot};
pub use writer::ResultsWriter;
