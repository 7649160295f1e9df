//! `radar-chaperone calibrate FILE [--out DIR]`: the time offset between poses and sweeps of a
//! recording, and the sensor's position on the head.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::Args;

use super::files::{SettingsArguments, read_streams};
use super::outputs::{CommandFiles, ReplaceArgument, begins_with, is_png};
use crate::app::progress;
use crate::report::{OffsetSpan, SynchronisationPlot, Table, synchronisation_plot};
use glam::DVec3;
use radar_mapping::{MountEstimate, OffsetWindow, Synchronisation, synchronisation};

/// Margin of the enlarged figure before and after the first window, seconds. Choice: the onset of
/// the motion stays visible on either side of a window.
const ENLARGED_S: f64 = 0.5;

/// Estimates from a recording the time offset between poses and sweeps, and where the sensor is on the head
///
/// Move the sensor towards a strong reflector and back, several times, beginning at rest. The
/// offset is estimated over the whole recording, over the first two seconds of motion and over the
/// rest window by window, from ranges and phases and, as a check, from rates of change. With --out
/// writes calibration.json and synchronisation.png there. Where a motion does not make the offset
/// observable, the output says so.
///
/// Turning the head makes the sensor's position observable: look around before furniture or walls for a minute, from side to side and
/// up and down.
#[derive(Debug, Args)]
pub(super) struct Calibrate {
    /// Recording (.mcap)
    file: PathBuf,
    /// Folder for calibration.json and the figure
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    replace: ReplaceArgument,
    #[command(flatten)]
    settings: SettingsArguments,
}

impl Calibrate {
    pub fn run(&self) -> Result<()> {
        let names = ["calibration.json", "synchronisation.png"];
        let [json_path, figure_path] = names.map(|name| self.out.as_ref().map(|out| out.join(name)));
        let files = CommandFiles::default().reads([&self.file]).reads(self.settings.file());
        let outputs =
            files.writes(&json_path, is_calibration).writes(&figure_path, is_own_figure).check(self.replace)?;
        let spinner = progress::spinner("reading and comparing");
        let (recording, frames, poses) = read_streams(&self.file)?;
        let header = recording.header();
        let settings = self.settings.over_recorded(&header.settings)?;
        let trial = synchronisation(&header.config, &header.head_from_sensor, &settings.mapping(), &frames, &poses)
            .with_context(|| self.file.display().to_string())?;
        spinner.finish_and_clear();
        outln!("{}", report_text(&trial).trim_end())?;
        if let (Some(out), Some(json_path), Some(figure_path)) = (&self.out, &json_path, &figure_path) {
            outputs.write(json_path, &serde_json::to_vec_pretty(&trial)?)?;
            let title = format!("Poses and radar over time: {}", header.source);
            outputs.write(figure_path, &figure(&trial, &title).png()?)?;
            outln!("\nWritten to {}", out.display())?;
        }
        Ok(())
    }
}

fn is_calibration(file: &Path) -> bool {
    begins_with(file, b"{\n  \"reflector_m\": [")
}

/// Pictures look like others': one beside a calibration is its figure.
fn is_own_figure(file: &Path) -> bool {
    is_png(file) && is_calibration(&file.with_file_name("calibration.json"))
}

fn figure(trial: &Synchronisation, title: &str) -> crate::report::Picture {
    let observed = |w: &OffsetWindow| w.estimate.filter(|e| e.observable).map(|e| (e.offset_s, e.sigma_s));
    let span = |w: &OffsetWindow| OffsetSpan {
        span_s: [w.from_s, w.to_s],
        by_phases: observed(w),
        by_rates: w.by_rates.map(|r| (r.offset_s, r.sigma_s)),
    };
    let offsets: Vec<OffsetSpan> = trial.windows.iter().map(span).collect();
    let first_s = trial.windows.first().map_or([0.0, 1.0], |first| [first.from_s, first.to_s]);
    synchronisation_plot(&SynchronisationPlot {
        title,
        radar_m: &trial.radar_range_m,
        poses_m: &trial.pose_range_m,
        offset_s: observed(&trial.whole).map(|(offset_s, _)| offset_s),
        offsets: &offsets,
        enlarged_s: [(first_s[0] - ENLARGED_S).max(0.0), first_s[1] + ENLARGED_S],
    })
}

/// The report as text.
fn report_text(trial: &Synchronisation) -> String {
    let p = trial.reflector_m;
    let mut text = format!(
        "Reflector at ({:.3}, {:.3}, {:.3}) m, its range read {} times\n\n",
        p.x,
        p.y,
        p.z,
        trial.radar_range_m.len()
    );
    text += &table(trial).aligned();
    text += "\nOffset: time of a sweep's pose minus time of the sweep, as stamped.\n";
    text += &verdict(trial);
    text + &mount_text(trial.mount.as_ref())
}

/// Where the sensor is, axis by axis, and which motion makes observable what is not.
fn mount_text(mount: Option<&MountEstimate>) -> String {
    const AXES: [(&str, f64); 3] = [("to the right", 1.0), ("up", 1.0), ("forward", -1.0)];
    const MOTION: [&str; 3] = ["turn the head from side to side", "nod", "turn the head farther, to both sides"];
    let Some(mount) = mount else {
        return "Mount      not observable: no echo was followed\n".to_owned();
    };
    if let Some(mistake) = mount.pose_mistake {
        return format!("Mount      not observable: the poses do not fit the echoes; likeliest, {mistake}\n");
    }
    let (position_m, shift_m, sigma_m) = (mount.position_m, mount.shift_m(), mount.sigma_m());
    let contradicts = mount.contradicts();
    let mut text = String::new();
    for (k, (axis, sign)) in AXES.into_iter().enumerate() {
        let title = if k == 0 { "Mount" } else { "" };
        let state = match (mount.observed[k], contradicts[k]) {
            (false, _) => format!("not observed: {}", MOTION[k]),
            (true, false) => "as it is set".to_owned(),
            (true, true) => format!("{:+.1} mm from where it is set", sign * shift_m[k] * 1e3),
        };
        let (position_mm, sigma_mm) = (sign * position_m[k] * 1e3, sigma_m[k] * 1e3);
        text += &format!("{title:<11}{position_mm:+7.1} ± {sigma_mm:.1} mm {axis}: {state}\n");
    }
    text += &format!("{:<11}{}\n", "Direction", direction_text(mount));
    if contradicts.contains(&true) || mount.contradicts_direction() {
        // What was not observed, and what agrees, stays as it is set.
        let new = |k: usize| if contradicts[k] { position_m[k] } else { mount.assumed.translation[k] };
        let [x, y, z] = [0, 1, 2].map(new);
        let q = if mount.contradicts_direction() { mount.turned() } else { mount.assumed.rotation };
        text += &format!(
            "           --set 'tracking.mount={{ translation = [{x:.4}, {y:.4}, {z:.4}], \
             rotation = [{:.4}, {:.4}, {:.4}, {:.4}] }}' sets it\n",
            q.x, q.y, q.z, q.w
        );
    }
    text
}

/// Where the sensor faces, and which motion makes it observable when it is not.
fn direction_text(mount: &MountEstimate) -> String {
    let (Some(boresight), Some(turn_rad)) = (mount.boresight, mount.turn_rad()) else {
        return "not observed: turn the head towards objects and away from them".to_owned();
    };
    let DVec3 { x, y, z } = boresight.direction;
    let side = |degrees: f64, positive: &str, negative: &str| {
        format!("{:.0}° {}", degrees.abs(), if degrees >= 0.0 { positive } else { negative })
    };
    let right = side(x.atan2(-z).to_degrees(), "to the right", "to the left");
    let up = side(y.clamp(-1.0, 1.0).asin().to_degrees(), "up", "down");
    let state = match (mount.contradicts_direction(), boresight.observed) {
        (true, _) => format!("{:.0}° from where it is set to face", turn_rad.to_degrees()),
        (false, true) => "as it is set".to_owned(),
        (false, false) => "the side that it is set to face".to_owned(),
    };
    format!("{right}, {up} of the head's, ± {:.0}°: {state}", boresight.sigma_rad.to_degrees())
}

fn table(trial: &Synchronisation) -> Table {
    let names = ["first 2 s of motion".to_owned()].into_iter().chain(std::iter::repeat(String::new()));
    let windows = names.zip(&trial.windows);
    let rows =
        std::iter::once(("whole".to_owned(), &trial.whole)).chain(windows).map(|(name, window)| row(&name, window));
    let head = ["", "from s", "to s", "offset ms", "1σ ms", "tracks", "by rates ms", "1σ ms", "correlation"];
    Table { head: head.map(String::from).to_vec(), rows: rows.collect(), caption: String::new() }
}

fn row(name: &str, window: &OffsetWindow) -> Vec<String> {
    let ms = |s: f64| format!("{:+.2}", s * 1e3);
    let sigma_ms = |s: f64| format!("{:.2}", s * 1e3);
    let estimate = window.estimate.filter(|e| e.observable);
    let estimate =
        estimate.map_or(["–"; 3].map(String::from), |e| [ms(e.offset_s), sigma_ms(e.sigma_s), e.tracks.to_string()]);
    let rates = window.by_rates.map_or(["–"; 3].map(String::from), |r| {
        [ms(r.offset_s), sigma_ms(r.sigma_s), format!("{:.3}", r.correlation)]
    });
    let span = [name.to_owned(), format!("{:.1}", window.from_s), format!("{:.1}", window.to_s)];
    span.into_iter().chain(estimate).chain(rates).collect()
}

fn verdict(trial: &Synchronisation) -> String {
    let mut text = match trial.whole.estimate {
        Some(e) if e.observable => {
            let change = format!("--set tracking.time_offset_s={:.5}", e.offset_s);
            let away = (e.offset_s - trial.set_offset_s).abs() > (3.0 * e.sigma_s).max(0.5e-3);
            let advice = if away { format!("; {change} sets it") } else { "; as it is set".to_owned() };
            format!("Offset     {:+.2} ± {:.2} ms{advice}\n", e.offset_s * 1e3, e.sigma_s * 1e3)
        }
        _ => "Offset     not observable: this motion does not separate it from depth\n".to_owned(),
    };
    text += &match trial.start_lag {
        Some(lag) => format!(
            "At start   {:+.2} ± {:.2} ms against the rest: {}\n",
            lag.lag_s * 1e3,
            lag.sigma_s * 1e3,
            if lag.is_significant { "a LAG in the first seconds" } else { "no lag" }
        ),
        None => "At start   not observable\n".to_owned(),
    };
    text += &format!("Residual   radar minus poses ±{:.1} mm as set", trial.spread_as_set_m * 1e3);
    if let Some(spread_m) = trial.spread_corrected_m {
        text += &format!(", ±{:.1} mm with the offset found", spread_m * 1e3);
    }
    text + "\n"
}
