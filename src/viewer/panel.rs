//! The side panel: state of the recording, detected obstacles, visible layers.

use egui::{CollapsingHeader, Color32, Grid, RichText, ScrollArea, Ui};

use super::history::{Health, Moment};
use super::layers::Layers;
use super::recording_info::RecordingInfo;
use super::style;
use radar_mapping::MapperKind;
use radar_mapping::{Observed, Obstacle};

/// Draws the panel in one column.
pub fn panel(ui: &mut Ui, about: &RecordingInfo, moment: &Moment, layers: &mut Layers, top_score: f32) {
    ScrollArea::vertical().auto_shrink([false, false]).show(ui, |ui| {
        let heading = if about.is_live { "Sensor and tracking" } else { "Recording" };
        open(ui, heading, |ui| health(ui, about, moment));
        open(ui, "Layers", |ui| switches(ui, about, layers, top_score));
        open(ui, &format!("Obstacles ({})", moment.scene.obstacles.len()), |ui| obstacles(ui, moment, layers));
    });
}

fn open(ui: &mut Ui, heading: &str, content: impl FnOnce(&mut Ui)) {
    // The open state belongs to the first word of the heading, because the rest of the text
    // changes.
    let id = heading.split(' ').next().unwrap_or_default().to_owned();
    CollapsingHeader::new(RichText::new(heading).strong()).id_salt(id).default_open(true).show(ui, content);
    ui.add_space(6.0);
}

/// Name, value, and whether the value is healthy.
type Row = (&'static str, String, bool);

fn health(ui: &mut Ui, about: &RecordingInfo, moment: &Moment) {
    ui.label(RichText::new(&about.title).color(style::MUTED));
    let Some(health) = &moment.health else {
        ui.label("Nothing processed yet.");
        return;
    };
    Grid::new("health").num_columns(2).spacing([10.0, 3.0]).show(ui, |ui| {
        for (name, value, is_sound) in rows(about, health, moment.time_s) {
            ui.label(RichText::new(name).color(style::MUTED));
            let value = RichText::new(value);
            ui.label(if is_sound { value } else { value.color(style::BAD) });
            ui.end_row();
        }
    });
}

fn rows(about: &RecordingInfo, health: &Health, time_s: f64) -> Vec<Row> {
    let streams = &health.counters.streams;
    let refused =
        streams.poses_invalid + streams.poses_bad_numbers + streams.poses_time_not_rising + streams.poses_time_leapt;
    let lost = streams.frames_saturated
        + streams.frames_wrong_length
        + streams.frames_time_not_rising
        + streams.frames_time_leapt
        + streams.frames_without_pose;
    let without_pose = streams.sweeps_outside_poses + streams.sweeps_in_pose_gap + streams.sweeps_at_invalid_pose;
    let sweeps = streams.observations / about.subsweeps as u64;
    let rate = sweeps as f64 / time_s.max(1e-3);
    let mut rows = vec![
        ("Sweeps imaged", sweeps.to_string(), true),
        ("Sweep rate", format!("{rate:.0} of {:.0} a second", about.sweeps_per_s), rate > 0.5 * about.sweeps_per_s),
        ("Frames", streams.frames.to_string(), true),
        ("Frames rejected", lost.to_string(), lost * 50 <= streams.frames),
        ("Sweeps without pose", without_pose.to_string(), without_pose * 20 <= streams.observations),
        (
            "Poses",
            format!("{} used, {refused} rejected", streams.poses.saturating_sub(refused)),
            refused * 20 <= streams.poses,
        ),
        ("Tracking jumps", streams.tracking_jumps.to_string(), true),
        ("Time offset", offset(health), true),
    ];
    if about.search == MapperKind::Rooms {
        rows.push(("Map updates", health.counters.engine.rooms.looks.to_string(), true));
    }
    rows
}

/// The active offset, and its 1σ if it was estimated from the data.
fn offset(health: &Health) -> String {
    let in_force = format!("{:+.1} ms", health.time_offset_s * 1e3);
    match health.estimate {
        Some(estimate) if estimate.observable => format!("{in_force} ± {:.1} ms (1σ)", estimate.sigma_s * 1e3),
        Some(_) => format!("{in_force}, not observable"),
        None => format!("{in_force}, as set"),
    }
}

fn obstacles(ui: &mut Ui, moment: &Moment, layers: &mut Layers) {
    let mut listed: Vec<(f64, &Obstacle)> = moment
        .scene
        .obstacles
        .iter()
        .map(|obstacle| {
            (moment.head.as_ref().map_or(f64::INFINITY, |head| obstacle.distance_m(head.translation)), obstacle)
        })
        .collect();
    listed.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.id.cmp(&b.1.id)));
    if listed.is_empty() {
        ui.label(RichText::new("None confirmed yet.").color(style::MUTED));
        return;
    }
    Grid::new("obstacles").num_columns(5).striped(true).spacing([12.0, 4.0]).show(ui, |ui| {
        for head in ["", "distance", "size (cm)", "evidence", "± 2σ"] {
            ui.label(RichText::new(head).small().color(style::MUTED));
        }
        ui.end_row();
        for (distance_m, obstacle) in listed {
            row(ui, distance_m, obstacle, layers);
            ui.end_row();
        }
    });
    ui.label(
        RichText::new("Nearest first, from the head. Click a number to cut the maps there.")
            .small()
            .color(style::MUTED),
    );
}

fn row(ui: &mut Ui, distance_m: f64, obstacle: &Obstacle, layers: &mut Layers) {
    let is_selected = layers.selected == Some(obstacle.id);
    let color = if obstacle.provisional { style::MUTED } else { style::FOUND };
    let name = ui.selectable_label(is_selected, RichText::new(format!("#{}", obstacle.id)).color(color));
    let since =
        if obstacle.provisional { "From the saved map, not detected again yet" } else { "Seen in this session" };
    if name.on_hover_text(since).clicked() {
        layers.selected = (!is_selected).then_some(obstacle.id);
    }
    let distance = if distance_m.is_finite() { format!("{distance_m:.2} m") } else { "–".into() };
    ui.label(distance);
    let [x, y, z] = (obstacle.extent_m * 100.0).to_array();
    let has_size = obstacle.extent_m.max_element() > 0.0;
    ui.label(if has_size { format!("{x:.0} × {y:.0} × {z:.0}") } else { "point".into() })
        .on_hover_text("Width along x, height along y, depth along z of what was seen of it");
    ui.label(format!("{:.1}", obstacle.evidence));
    let (doubt, is_known) = uncertainty_text(obstacle);
    let text = RichText::new(doubt);
    ui.label(if is_known { text } else { text.color(style::BAD) }).on_hover_text(observed(obstacle.observed));
}

/// Largest 2σ along an axis, or what is unknown.
fn uncertainty_text(obstacle: &Obstacle) -> (String, bool) {
    let c = &obstacle.covariance_m2;
    let greatest = [c.x_axis.x, c.y_axis.y, c.z_axis.z].into_iter().fold(0.0, f64::max);
    match obstacle.observed {
        Observed::Position => (format!("{:.1} cm", 200.0 * greatest.max(0.0).sqrt()), true),
        Observed::RangeAndOneDirection => ("1 direction".into(), false),
        Observed::RangeOnly => ("range only".into(), false),
    }
}

fn observed(observed: Observed) -> &'static str {
    match observed {
        Observed::Position => "Its position is known in all three directions; the greatest 2σ along an axis.",
        Observed::RangeAndOneDirection => "One direction was not observable from the motion.",
        Observed::RangeOnly => "Only the range was observed: its direction is unknown.",
    }
}

fn switches(ui: &mut Ui, about: &RecordingInfo, layers: &mut Layers, top_score: f32) {
    let [r, g, b] = about.warning.color;
    let mut switch = |shown: &mut bool, color: Color32, name: &str, hint: &str| {
        ui.horizontal(|ui| {
            ui.checkbox(shown, "");
            let (swatch, _) = ui.allocate_exact_size(egui::vec2(12.0, 12.0), egui::Sense::hover());
            ui.painter().rect_filled(swatch, 2.0, color);
            ui.label(name).on_hover_text(hint);
        });
    };
    switch(
        &mut layers.obstacles,
        style::FOUND,
        "Obstacles",
        "Detected obstacles: box, 2σ ellipsoid, distance from the head",
    );
    switch(
        &mut layers.moving,
        style::MOVING,
        "Moving targets",
        "People and pets: their range, and the wedge that they are in",
    );
    switch(&mut layers.walls, style::WALL, "Walls", "Planes; brighter where their reflections came from");
    switch(&mut layers.evidence, style::evidence(0.7), "Evidence", "Voxels by their score");
    switch(&mut layers.beam, style::BEAM, "Radar beam", "The cone that is searched, from the first to the last range");
    switch(&mut layers.path, style::HEAD, "Path of the head", "Bright: the last four seconds");
    switch(&mut layers.warnings, Color32::from_rgb(r, g, b), "Warnings", "Panels and footprints as the user sees them");
    if about.truth.is_some() {
        switch(&mut layers.truth, style::TRUTH, "Truth", "The true objects, from the recording");
    } else if !about.is_live {
        ui.label(RichText::new("The recording has no ground truth.").small().color(style::MUTED));
    }
    ui.add_space(4.0);
    ui.label(RichText::new(format!("Smallest {} of shown evidence", about.score_name())).color(style::MUTED));
    let top = top_score.max(about.min_score() + 1.0);
    ui.add(egui::Slider::new(&mut layers.min_score, 0.0..=top).fixed_decimals(1));
}

#[cfg(test)]
mod tests {
    use radar_mapping::MappingSettings;

    use super::*;
    use crate::settings::Settings;
    use a121::preset;
    use radar_mapping::Mapper;
    use radar_recording::Header;
    use radar_sar::TimeOffset;
    use radar_sar::geometry::Pose;

    #[test]
    fn unhealthy_values_are_flagged() {
        let header = Header::new("test", preset("d16").unwrap(), Pose::IDENTITY);
        let about = RecordingInfo::new(&header, &Settings::default(), MapperKind::Rooms, 1.0);
        let mapper = Mapper::new(&header.config, &Pose::IDENTITY, &MappingSettings::default());
        let mut counters = mapper.counters();
        counters.streams.observations = (about.sweeps_per_s * 2.0) as u64 * about.subsweeps as u64;
        counters.streams.poses = 100;
        let mut health = Health { counters, time_offset_s: 0.0042, estimate: None };
        assert!(rows(&about, &health, 2.0).iter().all(|row| row.2));
        assert_eq!(offset(&health), "+4.2 ms, as set");
        health.counters.streams.frames_without_pose = 3;
        health.counters.streams.frames = 100;
        health.counters.streams.poses_invalid = 30;
        let bad: Vec<_> = rows(&about, &health, 2.0).into_iter().filter(|row| !row.2).collect();
        assert_eq!(
            bad.iter().map(|row| (row.0, row.1.as_str())).collect::<Vec<_>>(),
            [("Frames rejected", "3"), ("Poses", "70 used, 30 rejected")]
        );
        let estimate = TimeOffset { offset_s: 0.004, sigma_s: 0.0003, observable: true, tracks: 3, tracks_left_out: 0 };
        health.estimate = Some(estimate);
        assert_eq!(offset(&health), "+4.2 ms ± 0.3 ms (1σ)");
    }
}
