//! `benchmark`: its rows, its files, its error messages. Times are not compared.

use std::collections::BTreeMap;

use serde_json::Value;

use crate::common::Folder;

#[test]
fn a_quick_benchmark_writes_table_plot_and_rows() {
    let folder = Folder::new("benchmark");
    folder
        .run("benchmark --quick --json b.json --out d")
        .succeeds()
        .prints("error (mm)")
        .prints("threads, ")
        .prints("Written to d\n")
        .prints("Written to b.json");
    assert!(folder.read("d/benchmark.png").starts_with(b"\x89PNG"));
    let text = String::from_utf8(folder.read("d/benchmark.md")).unwrap();
    let rows = folder.json("b.json");
    let rows = rows.as_array().unwrap();
    assert!(text.matches("\n| ").count() > rows.len(), "{text}");
    let mut of_workload: BTreeMap<String, Vec<(&Value, &Value)>> = BTreeMap::new();
    for row in rows {
        for field in ["median_s", "updates", "updates_per_s", "error_m", "error_p95_m", "trials"] {
            assert!(row[field].as_f64().is_some_and(|v| v.is_finite() && v > 0.0), "{field}: {row}");
        }
        assert!(row["name"].is_string() && row["workload"].is_string() && row["pareto"].is_boolean(), "{row}");
        let same = ["workload", "statistic", "voxel_m", "sweeps", "selection", "refined"];
        of_workload
            .entry(same.map(|f| row[f].to_string()).join(" "))
            .or_default()
            .push((&row["search"], &row["error_m"]));
    }
    let pairs: Vec<_> = of_workload.values().filter(|rows| rows.len() > 1).collect();
    // Five statistics at two voxel sizes, dense and adaptive, and a window, fresh and rolling.
    assert_eq!(pairs.len(), 11, "{of_workload:#?}");
    assert!(pairs.iter().all(|rows| rows.iter().all(|row| row.1 == rows[0].1)), "{pairs:#?}");
    assert!(rows.iter().any(|row| row["pareto"] == true));
    let refined = rows.iter().find(|row| row["refined"] == true && row["selection"] == "farthest-point").unwrap();
    assert!(refined["error_m"].as_f64().unwrap() < 0.01, "{refined}");
}

#[test]
fn unwritable_output_is_refused_before_the_benchmark_runs() {
    let folder = Folder::new("benchmark_refused");
    folder.write("file", "not a folder");
    std::fs::create_dir(folder.path("folder")).unwrap();
    for (arguments, message) in [
        ("--out file", "cannot make folder file"),
        ("--out file/deeper", "cannot make folder file/deeper"),
        ("--json folder", "--json folder: give the name of a file"),
        ("--json file/b.json", "cannot make folder file"),
        ("--out d --json d/benchmark.md", "a file of --out has this name"),
        ("--json", "a value is required for '--json"),
        ("--slow", "unexpected argument '--slow'"),
    ] {
        let outcome = folder.run(&format!("benchmark {arguments}")).fails_with(message);
        assert!(outcome.out.is_empty(), "{outcome:#?}");
    }
}

#[test]
fn play_sessions_report_warning_rates_reproducibly() {
    let folder = Folder::new("play_sessions");
    let play = |name: &str, more: &str| -> Value {
        let done = folder.run(&format!("play --rooms 1 --minutes 0.5 --json {name} {more}")).succeeds();
        done.prints("warned before 0.4 m or 0.6 s").prints("all but walls");
        serde_json::from_slice(&folder.read(name)).unwrap()
    };
    let first = play("a.json", "--seed 1000");
    let rates = &first[0]["rates"];
    assert!(rates["due"].as_u64().unwrap() > 5, "{rates}");
    assert!(2 * rates["warned"].as_u64().unwrap() >= rates["due"].as_u64().unwrap(), "{rates}");
    assert!(rates["lead_median_m"].as_f64().unwrap() > 0.5, "{rates}");
    assert_eq!(first, play("b.json", "--seed 1000"), "a seed gives the same figures");
    // Only far outside of the room is searched: no warnings and no reports.
    let elsewhere = "--set processing.region={min=[40,0,40],max=[41,1,41]}";
    let deaf = play("c.json", &format!("--seed 1000 --set processing.mode=reflectors {elsewhere}"));
    assert_eq!(deaf[0]["rates_without_walls"]["warned"], 0);
    assert_eq!(deaf[0]["rates"]["false_per_min"], 0.0);
}
