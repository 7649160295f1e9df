//! `experiment`: writes pictures, tables and a report of the requested experiments.

use crate::common::Folder;

#[test]
fn an_experiment_writes_its_report_pictures_and_tables() {
    let folder = Folder::new("experiment");
    let run = folder.run("experiment data-set-size thinning --seeds 1 --out out").succeeds();
    assert!(run.out.contains("Data set size") && run.out.contains("Thinning"), "{run:#?}");
    assert!(!run.out.contains("Sensor velocity"), "{run:#?}");
    // Standard error is no terminal here, so there is no progress output.
    assert!(!run.err.contains("1 of 2"), "{run:#?}");
    let page = String::from_utf8(folder.read("out/report.html")).unwrap();
    assert!(page.contains("One sweep gives the depth") && page.contains("data:image/png;base64,"));
    for picture in ["sweeps-1", "sweeps-50", "error-over-sweeps"] {
        assert!(folder.read(&format!("out/data-set-size/{picture}.png")).len() > 3_000, "{picture}");
    }
    let table = String::from_utf8(folder.read("out/data-set-size/table-1.csv")).unwrap();
    assert_eq!(table.lines().count(), 17, "a head and eight rows at either SNR: {table}");
    assert!(table.starts_with("sweeps,"), "{table}");
}

#[test]
fn common_objects_leave_point_clouds_that_other_programs_open() {
    let folder = Folder::new("experiment-clouds");
    folder.run("experiment common-objects --seeds 1 --out out").succeeds();
    for cloud in ["chair-squared-cloud", "two-chairs-sub-apertures-cloud"] {
        let bytes = folder.read(&format!("out/common-objects/{cloud}.ply"));
        assert!(
            bytes.starts_with(b"ply\nformat binary_little_endian") && bytes.len() > 250,
            "{cloud}: {}",
            bytes.len()
        );
    }
}

#[test]
fn volumes_and_clouds_are_written_for_other_tools() {
    let folder = Folder::new("experiment-outputs");
    folder.run("experiment outputs --seeds 1 --out out").succeeds();
    for volume in ["chairs", "reflector"] {
        assert!(folder.read(&format!("out/outputs/{volume}.npy")).starts_with(b"\x93NUMPY"));
        let info = folder.json(&format!("out/outputs/{volume}.json"));
        assert_eq!(info["axes"], serde_json::json!(["z", "y", "x"]));
        assert_eq!(info["voxel_m"], 0.04);
    }
    let cloud = folder.read("out/outputs/reflector.ply");
    assert!(cloud.starts_with(b"ply\n") && String::from_utf8_lossy(&cloud).contains("property float cov_zz"));
}

#[test]
fn experiments_are_listed_and_unknown_names_refused() {
    let folder = Folder::new("experiment-names");
    let list = folder.run("experiment").succeeds();
    assert!(list.out.contains("matched-filter") && list.out.lines().count() >= 8, "{list:#?}");
    let wrong = folder.run("experiment nonsense");
    assert_eq!(wrong.code, Some(1), "{wrong:#?}");
    assert!(wrong.err.contains("no experiment \"nonsense\"") && wrong.err.contains("data-set-size"), "{wrong:#?}");
}
