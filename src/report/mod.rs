//! Writes plain data to files: figures, volumes, point clouds, scores, the HTML report. Nothing
//! here computes results. All functions accept empty, flat or invalid data without panicking, and
//! write files atomically.

mod atomic;
mod base64;
mod canvas;
mod chart;
mod color_map;
mod cross_sections;
mod error;
mod heat_chart;
mod html;
mod marks;
mod motion_plot;
mod npy;
mod obstacles_json;
mod pareto;
mod picture;
mod plot;
mod ply;
mod point_cloud;
mod room_film;
mod room_map;
mod score;
mod style;
mod synchronisation;
mod text_table;
mod views;

pub use atomic::write_atomically;
pub use chart::{Chart, Series};
pub use color_map::inferno;
pub use cross_sections::{Accumulated, accumulate, cross_sections, greatest};
pub use error::ReportError;
pub use heat_chart::HeatChart;
pub use html::{Figure, Report, Section, Table};
pub use marks::Marks;
pub use motion_plot::motion_plot;
pub use npy::{VolumeInfo, read_volume, volume_bytes, volume_of, write_volume};
pub use obstacles_json::{obstacles_json, write_obstacles_json};
pub use pareto::{TradeOff, TradeOffMarker, TradeOffPoint, pareto_front};
pub use picture::Picture;
pub use ply::{CloudPoint, cloud_bytes, cloud_of, ply_bytes, write_ply};
pub use point_cloud::{point_cloud, points_above};
pub use room_film::FilmRecorder;
pub use room_map::{RoomMap, room_map};
pub use score::{Limits, ObstacleScore, Score, Verdict, score, verdict};
pub use synchronisation::{OffsetMark, OffsetSpan, SynchronisationPlot, synchronisation_plot};
