//! Resolution of the coherent image: widths of a point target at half power, against sums of power.
//!
//!     cargo run --release -p lab --example fine_resolution -- [SEEDS]
//!
//! A corner reflector at about 1 m, preset d16, the thesis' 50 cm sphere for 2 s, default tracking
//! errors, images of 5 mm voxels; medians over the seeds (5 by default). Also prints the time for a
//! 30 cm cube of 1 cm voxels.

use std::time::Instant;

use a121::preset;
use glam::DVec3;
use radar_chaperone::settings::Settings;
use radar_mapping::{ObserverSettings, observe_all};
use radar_sar::Volume;
use radar_sar::geometry::Aabb;
use radar_sar::subaperture::{Subaperture, SubapertureBuilder, fine_image};
use radar_simulation::Scenario;

const APERTURES: [usize; 5] = [1, 2, 4, 8, 1000];

fn main() {
    let seeds: u64 = std::env::args().nth(1).map_or(5, |n| n.parse().expect("a number of seeds"));
    let mut widths: Vec<[Vec<f64>; 4]> = vec![Default::default(); APERTURES.len() + 1];
    for seed in 0..seeds {
        let (subapertures, at) = subapertures(seed);
        let subapertures: Vec<&Subaperture> = subapertures.iter().collect();
        let region = Aabb { min: at - DVec3::new(0.45, 0.45, 0.2), max: at + DVec3::new(0.45, 0.45, 0.2) };
        for (n, per_aperture) in APERTURES.into_iter().enumerate() {
            let image = fine_image(&subapertures, &region, 0.005, per_aperture).expect("the region is covered");
            note(&mut widths[n + 1], &image.coherent, at);
            if n == 0 {
                note(&mut widths[0], &image.incoherent, at);
            }
        }
        if seed == 0 {
            let cube = Aabb { min: at - 0.15, max: at + 0.15 };
            let start = Instant::now();
            let image = fine_image(&subapertures, &cube, 0.01, 1).expect("the region is covered");
            println!("30³ voxels, {} sub-apertures: {:.1} ms\n", image.apertures, start.elapsed().as_secs_f64() * 1e3);
        }
    }
    println!("| summed coherently (90 ms each) | x, mm | y, mm | z, mm | peak error, mm |\n|---|---|---|---|---|");
    let names = ["nothing".to_string()].into_iter().chain(APERTURES.map(|n| format!("at most {n} sub-apertures")));
    for (name, mut widths) in names.zip(widths) {
        let [x, y, z, off] = [0, 1, 2, 3].map(|n| median_mm(&mut widths[n]));
        println!("| {name} | {x:.0} | {y:.0} | {z:.0} | {off:.1} |");
    }
}

/// Sub-apertures of one recording, and the reflector's position.
fn subapertures(seed: u64) -> (Vec<Subaperture>, DVec3) {
    let scenario = Scenario::new("corner-reflector", "sphere-50cm", preset("d16").expect("d16 exists"), 2.0, seed);
    let simulated = scenario.run().unwrap_or_else(|error| panic!("{error}"));
    let settings = Settings::default();
    let observer = ObserverSettings {
        history: settings.tracking.history,
        head_from_sensor: scenario.head_from_sensor,
        time_offset_s: 0.0,
        range_bias_m: None,
    };
    let (observations, _) = observe_all(&scenario.config, observer, &simulated.frames, &simulated.poses);
    let mut builder = SubapertureBuilder::new(settings.rooms.subapertures);
    let mut subapertures: Vec<Subaperture> = observations.into_iter().filter_map(|o| builder.push(o)).collect();
    subapertures.extend(builder.close());
    (subapertures, simulated.truth.obstacles[0].points_m[0])
}

/// Width at half power through the peak along each axis, and error of the peak, metres.
fn note(into: &mut [Vec<f64>; 4], volume: &Volume, at: DVec3) {
    let (peak, greatest) = volume.peak().expect("an echo");
    let here = volume.voxel(peak);
    for axis in 0..3 {
        let strong = |n: &usize| {
            let mut voxel = here;
            voxel[axis] = *n;
            volume.values[volume.index(voxel)] >= 0.5 * greatest
        };
        let below = (0..here[axis]).rev().take_while(strong).count();
        let above = (here[axis]..volume.size[axis]).take_while(strong).count();
        into[axis].push((below + above) as f64 * volume.voxel_m);
    }
    into[3].push(volume.center(here).distance(at));
}

fn median_mm(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2] * 1e3
}
