//! Accuracy of a single reflector's position, for chosen trials and without kinds of errors. The
//! documented table is `lab results reflectors`.
//!
//!     cargo run --release -p lab --example ls_accuracy -- [seeds=FIRST..END] [motion=NAME] \
//!         [sweeps=N] [snr=DB] [without=jitter|wander|rotation|mount|all] [unknown-wander=MM] [near] [detail]
//!
//! Defaults: seeds 100..120, every trial. `detail` adds the consistency along each axis of the
//! covariance; `near` searches 0.8 m around the truth; `unknown-wander` is a drift that the settings do not know of.

use lab::experiments::accuracy::{ErrorKind, REFLECTOR_TRIALS, ReflectorOptions, reflector_table};

fn main() {
    let mut options =
        ReflectorOptions { seeds: 100..120, without: None, near: false, by_axis: false, unknown_wander_m: None };
    let mut trials = REFLECTOR_TRIALS.to_vec();
    for argument in std::env::args().skip(1) {
        match argument.split_once('=') {
            Some(("seeds", range)) => {
                let (first, end) = range.split_once("..").expect("seeds=FIRST..END");
                options.seeds = first.parse().expect("a seed")..end.parse().expect("a seed");
            }
            Some(("motion", name)) => trials.retain(|trial| trial.motion == name),
            Some(("sweeps", count)) => {
                let count: usize = count.parse().expect("a number of sweeps");
                trials.retain(|trial| trial.sweeps == count);
            }
            Some(("snr", db)) => {
                let db: f64 = db.parse().expect("decibels");
                trials.retain(|trial| trial.snr_db == db);
            }
            Some(("unknown-wander", mm)) => {
                let mm: f64 = mm.parse().expect("millimetres");
                options.unknown_wander_m = Some(mm * 1e-3);
            }
            Some(("without", what)) => options.without = Some(kind(what)),
            _ if argument == "near" => options.near = true,
            _ if argument == "detail" => options.by_axis = true,
            _ => panic!("{argument}: see the head of this file"),
        }
    }
    let table = reflector_table(&trials, &options);
    println!("{}\n{}", table.aligned(), table.caption);
}

fn kind(name: &str) -> ErrorKind {
    match name {
        "jitter" => ErrorKind::Jitter,
        "wander" => ErrorKind::Wander,
        "rotation" => ErrorKind::Rotation,
        "mount" => ErrorKind::Mount,
        "all" => ErrorKind::All,
        _ => panic!("without={name}: jitter, wander, rotation, mount or all"),
    }
}
