//! The capacity of a board's link, and its faults and counters, as text.

use a121::find::Candidate;
use a121::{LineSpeed, Link, LinkCapacity, LinkRequirement, PRESETS, SensorConfig, SystemInfo, preset, preset_purpose};

use super::StreamCounters;
use crate::report::Table;

/// Speed of the link; uses the board's own report once there is one.
pub fn line_speed(candidate: &Candidate, baud: Option<u32>, info: Option<&SystemInfo>) -> Option<LineSpeed> {
    let expected = candidate.board.line_speed(baud);
    let Some(info) = info.filter(|_| !matches!(expected, Some(LineSpeed::Usb | LineSpeed::Network))) else {
        return expected;
    };
    if info.hw.as_deref().is_some_and(|hw| hw.eq_ignore_ascii_case("xc120")) {
        return Some(LineSpeed::Usb);
    }
    let fastest = info.max_baudrate.filter(|_| candidate.link(baud) == Link::Serial { baud: None });
    fastest.map(LineSpeed::Uart).or(expected)
}

/// Requirements of all presets and the share of the link that they use.
pub fn preset_table(line: Option<LineSpeed>) -> String {
    let named = PRESETS.iter().filter_map(|name| Some((*name, preset(name)?)));
    let rows = named.map(|(name, config)| {
        let mut row = needs(name, &config, line);
        row.push(preset_purpose(name).to_owned());
        row
    });
    table(line, &["for"], rows.collect())
}

/// Requirements of one configuration and the share of the link that it uses.
pub fn config_table(name: &str, config: &SensorConfig, line: Option<LineSpeed>) -> String {
    table(line, &[], vec![needs(name, config, line)])
}

fn table(line: Option<LineSpeed>, more: &[&str], rows: Vec<Vec<String>>) -> String {
    let line = line.map_or("line".to_owned(), |line| line.to_string());
    let head = ["preset", "sweep ms", "sweeps/s", "frames/s", "kB/s", &format!("carried by {line}")];
    let head = head.iter().chain(more).map(|&word| word.to_owned()).collect();
    Table { head, rows, caption: String::new() }.aligned()
}

fn needs(name: &str, config: &SensorConfig, line: Option<LineSpeed>) -> Vec<String> {
    let need = LinkRequirement::of(config);
    let frames = match need.requested_hz {
        Some(requested_hz) if !need.is_rate_reachable() => format!("{:.0} of {requested_hz:.0}", need.frame_hz),
        _ => format!("{:.0}", need.frame_hz),
    };
    vec![
        name.to_owned(),
        format!("{:.2}", need.sweep_s * 1e3),
        format!("{:.0}", need.sweeps_hz),
        frames,
        format!("{:.1}", need.bytes_per_s() * 1e-3),
        line.map_or("not known yet".to_owned(), |line| verdict(&need, line)),
    ]
}

/// Whether the link is fast enough, and its load.
pub fn verdict(need: &LinkRequirement, line: LineSpeed) -> String {
    let on = need.predict(line);
    match on.capacity {
        LinkCapacity::Yes => format!("yes, {:.0} % of it", 100.0 * on.load),
        LinkCapacity::IfPipelined => format!("if sent while measuring, else {:.0} frames/s", on.sequential_hz),
        LinkCapacity::No => format!("no: {:.0} to {:.0} frames/s", on.sequential_hz, on.pipelined_hz),
    }
}

/// A stream's counters, one line each; faults only where there were some.
pub fn counter_lines(counters: &StreamCounters, lost: u64) -> Vec<String> {
    let (session, stream) = (&counters.session, &counters.session.stream);
    let mut lines = vec![format!(
        "Line       {} results, {lost} frames lost, {:.1} MB",
        session.results,
        stream.bytes as f64 * 1e-6
    )];
    if let Some(clock) = &counters.clock {
        lines.push(format!(
            "Clock      ±{:.0} µs, jitter {:.0} µs, drift {:+.1} ppm, results {:.1} ms late on average, {:.1} at most",
            clock.sigma_s * 1e6,
            clock.jitter_s * 1e6,
            clock.drift_ppm,
            clock.mean_delay_s * 1e3,
            clock.max_delay_s * 1e3
        ));
    }
    lines.push(format!(
        "Reader     last byte to hand-over {:.2} ms median, {:.2} p99, {:.2} at most; {:.1} % of a core",
        counters.latency.median_s * 1e3,
        counters.latency.p99_s * 1e3,
        counters.latency.max_s * 1e3,
        100.0 * counters.cpu_s / counters.running_s.max(1e-9)
    ));
    let faults = [
        (stream.resyncs, "resynchronisations"),
        (stream.skipped_bytes, "bytes skipped"),
        (stream.damaged_lines, "damaged lines"),
        (stream.damaged_payloads, "damaged payloads"),
        (stream.misfit_results, "results of unexpected shape"),
        (stream.unconfirmed_damage, "doubtful results"),
        (session.refused_ticks, "results rejected for their tick"),
        (session.tick_jumps, "jumps of the sensor's clock"),
        (session.unanswered, "unanswered commands"),
        (session.silences, "silences"),
        (session.recalibrations, "calibrations asked for"),
        (session.connects.saturating_sub(1), "new connections"),
        (counters.losses, "losses of the connection"),
        (counters.dropped.frames, "results dropped by a full queue"),
    ];
    let faults: Vec<String> = faults.iter().filter(|f| f.0 > 0).map(|(n, what)| format!("{n} {what}")).collect();
    lines.push(format!("Faults     {}", if faults.is_empty() { "none".to_owned() } else { faults.join(", ") }));
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use a121::find::{Board, choose};

    #[test]
    fn reported_board_speed_overrides_expected_speed() {
        let info = |hw: &str, max_baudrate| SystemInfo {
            rss_version: "a121-v1.12.0".into(),
            sensor: None,
            sensor_count: 1,
            ticks_per_second: 1000,
            hw: Some(hw.into()),
            max_baudrate,
        };
        let candidate = choose(Some("/dev/ttyNONE7"), &[]).unwrap();
        assert_eq!(line_speed(&candidate, None, None), None);
        assert_eq!(line_speed(&candidate, None, Some(&info("XC120", Some(3_000_000)))), Some(LineSpeed::Usb));
        let slow = info("xm125", Some(921_600));
        assert_eq!(line_speed(&candidate, None, Some(&slow)), Some(LineSpeed::Uart(921_600)));
        assert_eq!(line_speed(&candidate, Some(230_400), Some(&slow)), Some(LineSpeed::Uart(230_400)));
        let xe125 = Candidate { board: Board::Xe125, ..candidate.clone() };
        assert_eq!(line_speed(&xe125, None, None), Some(LineSpeed::Uart(2_000_000)));
        assert_eq!(line_speed(&xe125, None, Some(&slow)), Some(LineSpeed::Uart(921_600)));
        let ch340 = Candidate { board: Board::SparkfunXm125, ..candidate };
        assert_eq!(line_speed(&ch340, None, Some(&slow)), Some(LineSpeed::Uart(115_200)));
    }

    #[test]
    fn preset_table_lists_line_capacity() {
        let table = preset_table(Some(LineSpeed::Uart(2_000_000)));
        assert_eq!(table.lines().count(), 1 + PRESETS.len());
        let row = |name: &str| table.lines().find(|line| line.starts_with(name)).unwrap();
        assert!(table.lines().next().unwrap().contains("carried by 2000000 baud"), "{table}");
        assert!(row("d16").contains("no: ") && row("c16").contains("if sent while measuring, else 360"), "{table}");
        assert!(row("slow-link").contains("yes, 5 % of it"), "{table}");
        assert!(preset_table(None).contains("not known yet"));
        let config = SensorConfig { frame_rate: Some(1000.0), ..preset("thesis").unwrap() };
        assert!(config_table("mine", &config, Some(LineSpeed::Usb)).contains("of 1000"));
    }
}
