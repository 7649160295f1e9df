//! Benchmark results as a table, as JSON and as a plot.

use serde_json::{Value, json};

use super::plan::{Case, Search};
use super::row::Row;
use radar_chaperone::report::{Table, TradeOff, TradeOffMarker, TradeOffPoint};
use radar_sar::math;

/// One table row per case; those on the Pareto front are starred.
pub fn table(rows: &[Row]) -> Table {
    let head = [
        "front",
        "motion",
        "statistic",
        "voxel (cm)",
        "sweeps",
        "chosen by",
        "search",
        "refined",
        "time (ms)",
        "updates (M)",
        "updates/s (M)",
        "bounds (M)",
        "error (mm)",
        "95 % (mm)",
    ];
    let cells = |row: &Row| {
        let case = &row.case;
        vec![
            if row.on_front { "*" } else { "" }.to_owned(),
            case.motion.to_owned(),
            case.statistic.name().to_owned(),
            format!("{:.1}", case.voxel_m * 100.0),
            case.sweeps_text(),
            case.selection_name().to_owned(),
            case.search.name().to_owned(),
            if case.refined { "yes" } else { "" }.to_owned(),
            digits(row.median_s * 1e3),
            digits(row.updates as f64 * 1e-6),
            digits(updates_per_s(row) * 1e-6),
            if row.bounds == 0 { String::new() } else { digits(row.bounds as f64 * 1e-6) },
            millimetres(row.error_m),
            millimetres(row.error_p95_m),
        ]
    };
    let head = head.map(str::to_owned).to_vec();
    Table { head, rows: rows.iter().map(cells).collect(), caption: String::new() }
}

/// One JSON object per row. `threads` and `instructions` describe the machine.
pub fn json(rows: &[Row], threads: usize, instructions: &str) -> Value {
    let object = |row: &Row| {
        let case = &row.case;
        json!({
            "name": case.name(),
            "workload": row.workload,
            "median_s": row.median_s,
            "updates": row.updates,
            "updates_per_s": updates_per_s(row),
            "error_m": row.error_m,
            "error_p95_m": row.error_p95_m,
            "p95_s": row.p95_s,
            "choosing_s": row.selection_s,
            "bounds": row.bounds,
            "trials": row.trials,
            "motion": case.motion,
            "statistic": case.statistic.name(),
            "voxel_m": case.voxel_m,
            "sweeps": if case.sweeps == 0 { Value::Null } else { case.sweeps.into() },
            "selection": case.selection_name(),
            "search": case.search.name(),
            "refined": case.refined,
            "pareto": row.on_front,
            "threads": threads,
            "instructions": instructions,
        })
    };
    rows.iter().map(object).collect()
}

/// Plot of the cases with the wide motion. Oracle and windows are shown, but do not compete for the
/// front.
pub fn plot(rows: &[Row], machine: &str) -> TradeOff {
    let shown: Vec<&Row> = rows.iter().filter(|row| row.case.motion == "sphere-50cm").collect();
    let partner = |row: &Row| {
        let slow = if row.case.has_window() { Search::Window } else { Search::Dense };
        let wanted = Case { search: slow, ..row.case };
        (row.case != wanted).then(|| shown.iter().position(|other| other.case == wanted)).flatten()
    };
    let point = |row: &&Row| TradeOffPoint {
        series: row.case.statistic.name().to_owned(),
        mark: mark(&row.case),
        at: [row.median_s * 1e3, row.error_m * 1e3],
        label: case_label(&row.case),
        from: partner(row),
        on_front: row.on_front,
    };
    TradeOff {
        title: "Run time against error: one reflector at 1 m, found in a 3 m cube".into(),
        notes: vec![
            "Lower left is better. Each point: one way to image the same recordings, from raw sweeps to the position."
                .into(),
            format!("Head motion within 50 cm, 20 dB, tracking errors; median error over seeds. {machine}."),
        ],
        x_label: "time for one image (ms)".into(),
        y_label: "error, median (mm)".into(),
        x_unit: "ms".into(),
        y_unit: "mm".into(),
        points: shown.iter().map(point).collect(),
    }
}

fn mark(case: &Case) -> TradeOffMarker {
    match case.search {
        Search::Oracle => TradeOffMarker::Slow,
        Search::Rolling | Search::Window => TradeOffMarker::Rolling,
        _ if case.refined => TradeOffMarker::Refined,
        Search::Dense => TradeOffMarker::Dense,
        Search::Adaptive | Search::Peak => TradeOffMarker::Adaptive,
    }
}

/// Short label of a case.
fn case_label(case: &Case) -> String {
    let statistic = case.statistic.name();
    let (voxel_cm, sweeps) = (case.voxel_m * 100.0, case.sweeps_text());
    let chosen = match case.selection_name() {
        "all" | "newest" | "farthest-point" => String::new(),
        other => format!(" by {other}"),
    };
    let search = case.search.name();
    let refined = if case.refined { ", refined" } else { "" };
    format!("{statistic}, {voxel_cm} cm, {sweeps} sweeps{chosen}, {search}{refined}")
}

fn updates_per_s(row: &Row) -> f64 {
    if row.median_s > 0.0 { row.updates as f64 / row.median_s } else { 0.0 }
}

fn millimetres(error_m: f64) -> String {
    if error_m.is_finite() { format!("{:.1}", error_m * 1e3) } else { "–".into() }
}

/// Three significant digits, without exponent.
fn digits(value: f64) -> String {
    let decimals = if value > 0.0 { (2.0 - math::log10(value).floor()).clamp(0.0, 4.0) as usize } else { 0 };
    format!("{value:.decimals$}")
}
