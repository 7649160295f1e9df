//! Tables of play-session figures.

use super::figures::{Cause, Detected, FalseReport, Figures, InMap, Rates};
use radar_chaperone::report::Table;

/// One row per kind of object, and all together.
pub fn by_kind(figures: &Figures) -> Table {
    let mut rows: Vec<Vec<String>> =
        figures.kinds().iter().map(|kind| kind_row(kind, &figures.of_kind(kind).rates())).collect();
    rows.push(kind_row("all but walls", &figures.without_walls().rates()));
    rows.push(kind_row("all", &figures.rates()));
    let head = [
        "object", "due", "in time", "share", "bound", "first", "in time", "lead", "lead p10", "error", "p90", "nearer",
        "wider", "higher",
    ];
    Table { head: head.map(str::to_owned).to_vec(), rows, caption: CAPTION.into() }
}

const CAPTION: &str = "due: approaches within 1 m of an object that had been in the beam and not hidden for 0.75 s. \
    bound: those of whose own direct echoes at least three were 10 dB over the noise of a sub-aperture and \
    fixed a point to 25 cm by range and direction, the most that any reconstruction could warn of. first: each object's first approach. lead: distance at which the warning came on, m, 0 when \
    missed. error: from reported positions to the object's surface or nearest scatterer, m. nearer, wider, higher: bounds of the reported \
    cells of objects warned of, minus those of the objects' scatterers; medians, m.";

const CURVE_CAPTION: &str = "in time: warned of before 0.4 m or 0.6 s, of the approaches within 1 m of an object \
    that had been in the beam and not hidden for 0.75 s, without walls. first: of each object's first approach. \
    bound: those of whose echoes at least three were 10 dB over the noise of a sub-aperture and fixed a \
    point to 25 cm by range and direction, the most that any reconstruction could warn of. lead: \
    distance at which the warning came on, 0 when missed. false near: false reports, counted each time that one comes \
    within 1 m of the body; false: each false report once, anywhere. error: from reported positions to the \
    object's surface or nearest scatterer, median. removed: a chair that was carried away, time in the beam until it is no longer reported, \
    median.";

fn kind_row(name: &str, rates: &Rates) -> Vec<String> {
    let (metres, fine) = (|m: f64| formatted(m, 2), |m: f64| formatted(m, 3));
    vec![
        name.into(),
        rates.due.to_string(),
        rates.warned.to_string(),
        percent(rates.warned, rates.due),
        rates.locatable.to_string(),
        rates.first_due.to_string(),
        rates.first_warned.to_string(),
        metres(rates.lead_median_m),
        metres(rates.lead_p10_m),
        fine(rates.error_median_m),
        fine(rates.error_p90_m),
        metres(rates.bounds_median_m[0]),
        metres(rates.bounds_median_m[1]),
        metres(rates.bounds_median_m[2]),
    ]
}

/// A number as text: infinity is "never", NaN is a dash.
fn formatted(value: f64, digits: usize) -> String {
    match value {
        f64::INFINITY => "never".into(),
        value if value.is_nan() => "–".into(),
        value => format!("{value:.digits$}"),
    }
}

fn percent(part: usize, of: usize) -> String {
    if of == 0 { "–".into() } else { format!("{:.1}", 100.0 * part as f64 / of as f64) }
}

/// The figures that decide, with their targets.
pub fn totals(figures: &Figures) -> Table {
    let (objects, all) = (figures.without_walls().rates(), figures.rates());
    let row = |name: &str, is: String, wanted: &str| vec![name.to_owned(), is, wanted.to_owned()];
    let at_end = figures.reports_at_end.iter().sum::<usize>() as f64 / figures.reports_at_end.len().max(1) as f64;
    let minutes = figures.played_s / 60.0;
    let (moving, per_hour) = (&figures.moving, |count: u64| count as f64 * 60.0 / minutes);
    let bound = |n: usize| {
        let [median_cm, p90_cm] = [objects.bounds_median_m, objects.bounds_p90_m].map(|of| 100.0 * of[n]);
        if median_cm.is_finite() { format!("{median_cm:+.0}; {p90_cm:.0}") } else { "–".into() }
    };
    let rows = vec![
        row("warned before 0.4 m or 0.6 s, %", percent(objects.warned, objects.due), "≥ 95"),
        row("lead distance, median, m", formatted(objects.lead_median_m, 2), "≥ 1.0"),
        row("lead distance, 10th percentile, m", formatted(objects.lead_p10_m, 2), "≥ 0.5"),
        row("false reports near the body, per minute", formatted(all.false_near_per_min, 2), "≤ 1"),
        row("   of these, from the player's hands", formatted(all.hands_per_min, 2), "≤ 0.5; tracked 0"),
        row("false reports anywhere, per minute", formatted(all.false_per_min, 2), ""),
        row("   of these, walls", formatted(all.false_walls_per_min, 2), ""),
        row("time with a false report near the body, %", formatted(100.0 * all.false_near_share, 1), ""),
        row("removed chair no longer reported, time in beam, median, s", formatted(all.forget_median_s, 1), "≤ 5"),
        row("   the slowest, s", formatted(all.forget_worst_s, 1), ""),
        row("position error of objects warned of, median, cm", formatted(100.0 * objects.error_median_m, 1), "≤ 5"),
        row("near side, reported nearer (+) than true: median; 90 % of magnitudes, cm", bound(0), ""),
        row("   width, reported wider (+)", bound(1), ""),
        row("   top, reported higher (+)", bound(2), ""),
        row("flickering warnings, per minute", formatted(figures.flickers as f64 / minutes, 2), ""),
        row(
            "a person within 2.5 m shown as moving, % of the time",
            formatted(100.0 * moving.people.share(), 0),
            "≥ 80",
        ),
        row("a pet within 2.5 m shown as moving, % of the time", formatted(100.0 * moving.pets.share(), 0), ""),
        row("shown as moving where nobody moves, per hour", formatted(per_hour(moving.nothing), 0), "≤ 1"),
        row("   where the player's hands are", formatted(per_hour(moving.hands), 0), ""),
        row("obstacles in the map at the end", format!("{at_end:.0}"), ""),
        row("played, minutes", format!("{minutes:.1}"), ""),
    ];
    Table { head: ["figure", "is", "to reach"].map(str::to_owned).to_vec(), rows, caption: String::new() }
}

/// A figure as text.
type FigureText<'a> = &'a dyn Fn(&Figures) -> String;

/// The figures that decide, one column per headset: Lighthouse, inside-out, poor.
pub fn by_headset(columns: &[(&str, &Figures)]) -> Table {
    let share = |part: usize, of: usize| format!("{} of {of}", percent(part, of));
    let in_time = |figures: &Figures| {
        let objects = figures.without_walls().rates();
        share(objects.warned, objects.due)
    };
    let locatable = |figures: &Figures| {
        let objects = figures.without_walls().rates();
        percent(objects.locatable, objects.due)
    };
    let soft = |figures: &Figures| {
        let chairs = figures.of_kind("soft chair").rates();
        share(chairs.warned, chairs.due)
    };
    let per_hour = |count: u64, figures: &Figures| formatted(count as f64 * 3600.0 / figures.played_s, 1);
    let width = |figures: &Figures| {
        let width_cm = 100.0 * figures.without_walls().rates().bounds_median_m[1];
        if width_cm.is_finite() { format!("{width_cm:+.0}") } else { "–".into() }
    };
    let place = |figures: &Figures| formatted(100.0 * figures.without_walls().rates().error_median_m, 1);
    let rows: [(&str, &str, FigureText); 12] = [
        ("warned before 0.4 m or 0.6 s, %", "≥ 98; 97; 93", &in_time),
        ("   soft chairs", "≥ 93; 90; –", &soft),
        ("   could be located, the bound", "", &locatable),
        ("false reports near the body, per minute", "≤ 0.2; 0.25; 0.5", &|f| {
            formatted(f.rates().false_near_per_min, 2)
        }),
        ("   of these, from the player's hands", "0", &|f| formatted(f.rates().hands_per_min, 2)),
        ("false reports anywhere, per minute", "", &|f| formatted(f.rates().false_per_min, 2)),
        ("removed chair no longer reported, median, s", "≤ 2.5; 3; 5", &|f| formatted(f.rates().forget_median_s, 1)),
        ("place, median, cm", "≤ 2; 3; 5", &place),
        ("width, reported wider (+), median, cm", "≤ +6; +8; –", &width),
        ("a person within 2.5 m shown as moving, %", "≥ 80; 75; –", &|f| {
            formatted(100.0 * f.moving.people.share(), 0)
        }),
        ("shown as moving where nobody moves, per hour", "≤ 1; 1; 3", &|f| per_hour(f.moving.nothing, f)),
        ("played, minutes", "", &|f| formatted(f.played_s / 60.0, 0)),
    ];
    let row = |(name, to_reach, of): &(&str, &str, FigureText)| {
        let figures = columns.iter().map(|(_, figures)| of(figures));
        [(*name).to_owned()].into_iter().chain(figures).chain([(*to_reach).to_owned()]).collect()
    };
    let head = ["figure"].into_iter().chain(columns.iter().map(|(name, _)| *name)).chain(["to reach"]);
    Table { head: head.map(str::to_owned).collect(), rows: rows.iter().map(row).collect(), caption: String::new() }
}

/// The objects that were not warned of in time, by whether the map had them and by what was detected of them: one row per
/// kind, most often missed first.
pub fn missed(figures: &Figures) -> Table {
    let missed: Vec<_> = figures.approaches.iter().filter(|a| a.in_beam_s >= Rates::SEEN_S && !a.warned).collect();
    let row = |kind: String| {
        let of_kind = || missed.iter().filter(|a| a.kind == kind);
        let detected: Vec<_> = of_kind().filter_map(|a| a.detected).collect();
        let count = |is_counted: fn(&Detected) -> bool| detected.iter().filter(|d| is_counted(d)).count().to_string();
        let in_map = |state: InMap| of_kind().filter(|a| a.in_map == Some(state)).count().to_string();
        let mut scores: Vec<f64> = detected.iter().map(|d| d.score).collect();
        scores.sort_by(f64::total_cmp);
        let median = scores.get(scores.len() / 2).copied().unwrap_or(f64::NAN);
        (
            of_kind().count(),
            vec![
                kind.clone(),
                of_kind().count().to_string(),
                in_map(InMap::Never),
                in_map(InMap::Removed),
                in_map(InMap::Present),
                count(|d| d.count == 0),
                count(|d| d.count > 0 && d.may_be_new == 0),
                count(|d| d.may_be_new > 0 && !d.is_likely),
                count(|d| d.is_likely),
                formatted(median, 1),
            ],
        )
    };
    let mut rows: Vec<_> = figures.kinds().into_iter().map(row).filter(|(count, _)| *count > 0).collect();
    rows.sort_by_key(|(count, _)| std::cmp::Reverse(*count));
    let in_map = ["never in the map", "removed from it", "in it"];
    let detected = ["nothing detected", "not reportable", "unlikely", "likely", "greatest score, median"];
    let head = [&["missed", "times"][..], &in_map, &detected].concat();
    Table {
        head: head.into_iter().map(str::to_owned).collect(),
        rows: rows.into_iter().map(|(_, row)| row).collect(),
        caption: MISSED_CAPTION.into(),
    }
}

const MISSED_CAPTION: &str = "Approaches without a warning in time. Of these, by the map until the deadline: no obstacle had been at \
    the object, one had been and was removed, one is. And by the detections within 25 cm of the object in the ten seconds \
    before. not reportable: of each, the position is not observable, or it may be a hand, or it is known already. \
    unlikely, likely: the greatest log odds that the classifier gave to one that is, against those at which an object is \
    reported.";

/// False reports anywhere, by where they are.
pub fn false_reports(figures: &Figures) -> Table {
    let all: Vec<_> = figures.false_reports.iter().filter(|report| !report.is_near).collect();
    let class = |report: &FalseReport| match report {
        FalseReport { is_wall: true, .. } => "wall where there is none",
        FalseReport { cause: Cause::Hand, .. } => "where a hand was",
        FalseReport { cause: Cause::Visitor, .. } => "where a person was",
        FalseReport { mirrors, .. } if !mirrors.is_empty() => "behind a wall, mirror image of an object",
        FalseReport { behind_m, .. } if *behind_m > 0.0 => "behind a wall, of nothing",
        _ => "in the room, where nothing is",
    };
    let mut classes: Vec<&str> = all.iter().map(|report| class(report)).collect();
    classes.sort_unstable();
    let rows = classes.chunk_by(|a, b| a == b).map(|same| {
        let per_min = same.len() as f64 * 60.0 / figures.played_s;
        vec![same[0].to_owned(), same.len().to_string(), formatted(per_min, 2)]
    });
    let head = ["false report", "times", "per minute"];
    Table { head: head.map(str::to_owned).to_vec(), rows: rows.collect(), caption: String::new() }
}

/// Detections against false reports, one row per setting.
pub fn curve<'f>(settings: impl Iterator<Item = (&'f str, &'f Figures)>) -> Table {
    let row = |(name, figures): (&str, &Figures)| {
        let (objects, all) = (figures.without_walls().rates(), figures.rates());
        vec![
            name.into(),
            percent(objects.warned, objects.due),
            percent(objects.first_warned, objects.first_due),
            percent(objects.locatable, objects.due),
            formatted(objects.lead_median_m, 2),
            formatted(objects.lead_p10_m, 2),
            formatted(all.false_near_per_min, 2),
            formatted(all.false_per_min, 2),
            formatted(100.0 * objects.error_median_m, 1),
            formatted(all.forget_median_s, 1),
        ]
    };
    let head = [
        "setting",
        "in time, %",
        "first, %",
        "bound, %",
        "lead, m",
        "p10, m",
        "false near, /min",
        "false, /min",
        "error, cm",
        "removed, s",
    ];
    Table { head: head.map(str::to_owned).to_vec(), rows: settings.map(row).collect(), caption: CURVE_CAPTION.into() }
}
