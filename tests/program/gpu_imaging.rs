//! Volumes from the graphics card against the oracle. They run on any Vulkan driver, a software
//! renderer too.

use a121::preset;
use glam::DVec3;
use radar_chaperone::gpu_imaging::{GpuImager, GpuVolume};
use radar_chaperone::settings::Settings;
use radar_mapping::{ObserverSettings, observe_all};
use radar_sar::geometry::Aabb;
use radar_sar::subaperture::{SubapertureBuilder, SubapertureSettings, fine_image};
use radar_sar::{Beam, Observation, Oracle, Statistic, Volume, oracle_volume};
use radar_simulation::Scenario;

/// Sweeps of a furnished room in natural play, with noise and tracking errors; every `n`th is kept.
fn observations(duration_s: f64, seed: u64, n: usize) -> Vec<Observation> {
    let scenario = Scenario::new("furnished-room", "natural", preset("d16").unwrap(), duration_s, seed);
    let simulated = scenario.run().unwrap();
    let observer = ObserverSettings {
        history: Settings::default().tracking.history,
        head_from_sensor: scenario.head_from_sensor,
        time_offset_s: 0.0,
        range_bias_m: None,
    };
    let (all, _) = observe_all(&scenario.config, observer, &simulated.frames, &simulated.poses);
    assert!(all.len() > 20 * n, "{} sweeps", all.len());
    all.into_iter().step_by(n).collect()
}

/// Around the first sensor: ranges from zero on, beam edges, sensors within the box.
fn region(sweeps: &[Observation]) -> Aabb {
    let pose = &sweeps[0].tracking_from_sensor;
    let middle = pose.translation + 0.6 * pose.forward();
    Aabb { min: middle - 0.9, max: middle + DVec3::new(0.85, 0.8, 0.95) }
}

fn volume(
    imager: &mut GpuImager,
    statistic: Statistic,
    beam: &Beam,
    sweeps: &[Observation],
    voxel_m: f64,
) -> GpuVolume {
    imager.volume(statistic, beam, &SubapertureSettings::default(), sweeps, &region(sweeps), voxel_m).unwrap()
}

/// Whether some sweep may count differently in f32: an edge of range or beam, or of a nearest
/// point, within 0.1 mm.
fn is_at_an_edge(place: DVec3, sweeps: &[Observation], beam: &Beam, statistic: Statistic) -> bool {
    sweeps.iter().any(|o| {
        let (d, axis) = (o.distance_m(place), &o.geometry.axis);
        let cos = o.cos_off_boresight(place);
        let turn = 1e-4 / d.max(1e-4);
        let beam_edge = (beam.amplitude(cos - turn) > 0.0) != (beam.amplitude(cos + turn) > 0.0);
        let jump = (axis.point_at(d).rem_euclid(1.0) - 0.5).abs() * axis.step_m < 1e-4;
        [axis.first_m, axis.last_m()].iter().any(|edge| (d - edge).abs() < 1e-4)
            || beam_edge
            || statistic == Statistic::Thesis && jump
    })
}

/// The greatest difference from the oracle where no edge is near, as a share of the peak.
fn greatest_difference(found: &Volume, statistic: Statistic, beam: &Beam, sweeps: &[Observation]) -> f64 {
    let settings = SubapertureSettings::default();
    let exact = oracle_volume(&Oracle::new(sweeps, beam, &settings), statistic, &region(sweeps), found.voxel_m);
    assert_eq!(found.size, exact.size);
    let peak = f64::from(exact.peak().unwrap().1);
    let (mut worst, mut compared) = (0.0f64, 0);
    for (index, (a, b)) in found.values.iter().zip(&exact.values).enumerate() {
        if !is_at_an_edge(exact.center(exact.voxel(index)), sweeps, beam, statistic) {
            worst = worst.max(f64::from((a - b).abs()) / peak);
            compared += 1;
        }
    }
    assert!(2 * compared > found.values.len(), "{compared} of {} voxels are compared", found.values.len());
    worst
}

#[test]
fn every_statistic_agrees_with_the_oracle() {
    let mut imager = GpuImager::open().unwrap();
    let hollow = Beam::from_table(vec![[0.0, 0.0], [10.0, 0.0], [20.0, 1.0], [30.0, 0.5]]).unwrap();
    let sparse = observations(1.2, 1, 40);
    for beam in [Beam::Lensless, Beam::Thesis, Beam::Uniform, hollow] {
        for statistic in Statistic::ALL.into_iter().filter(|s| *s != Statistic::Subaperture) {
            let found = volume(&mut imager, statistic, &beam, &sparse, 0.11);
            assert_eq!(found.updates, (found.volume.values.len() * sparse.len()) as u64);
            let worst = greatest_difference(&found.volume, statistic, &beam, &sparse);
            assert!(worst < 0.005, "{} {beam:?}: {worst:.2e} of the peak", statistic.name());
        }
    }
}

#[test]
fn the_subaperture_score_agrees_with_the_oracle() {
    let mut imager = GpuImager::open().unwrap();
    let dense = observations(0.6, 2, 1);
    let found = volume(&mut imager, Statistic::Subaperture, &Beam::Lensless, &dense, 0.13);
    let worst = greatest_difference(&found.volume, Statistic::Subaperture, &Beam::Lensless, &dense);
    assert!(worst < 0.02, "{worst:.2e} of the peak");
}

#[test]
fn bits_do_not_depend_on_how_the_work_is_divided() {
    let sparse = observations(1.2, 3, 8);
    let mut imager = GpuImager::open().unwrap();
    let [small, large] = [1e-9, 10.0].map(|dispatch_s| {
        imager.set_dispatch_time(dispatch_s);
        volume(&mut imager, Statistic::Coherent, &Beam::Lensless, &sparse, 0.12)
    });
    assert!(small.work.dispatches > 10 * large.work.dispatches, "{:?} {:?}", small.work, large.work);
    assert_eq!(small.volume, large.volume);
}

#[test]
fn unusable_sweeps_are_left_out_and_none_give_an_empty_volume() {
    let mut imager = GpuImager::open().unwrap();
    let good = observations(0.4, 4, 10);
    let mut bad = good.clone();
    let mut broken = good[0].clone();
    broken.samples[3].re = f32::NAN;
    let mut short = good[1].clone();
    short.samples.pop();
    let mut lost = good[2].clone();
    lost.tracking_from_sensor.translation.x = f64::INFINITY;
    bad.extend([broken, short, lost]);
    let of =
        |imager: &mut GpuImager, sweeps: &[Observation]| volume(imager, Statistic::Ls, &Beam::Lensless, sweeps, 0.2);
    assert_eq!(of(&mut imager, &bad).volume, of(&mut imager, &good).volume);
    let none = of(&mut imager, &bad[good.len()..]);
    assert_eq!((none.updates, none.volume.peak()), (0, None));
}

#[test]
fn the_fine_image_agrees_with_the_processor() {
    let mut imager = GpuImager::open().unwrap();
    let (settings, observations) = (SubapertureSettings::default(), observations(1.0, 5, 1));
    let pose = &observations[0].tracking_from_sensor;
    let at = pose.translation + 1.2 * pose.forward();
    let region = Aabb { min: at - 0.1, max: at + 0.1 };
    let found = imager.fine_image(&settings, &observations, &region, 0.02, 4).unwrap().unwrap();
    let mut builder = SubapertureBuilder::new(settings);
    let mut blocks: Vec<_> = observations.iter().filter_map(|o| builder.push(o.clone())).collect();
    blocks.extend(builder.close());
    let expected = fine_image(&blocks.iter().collect::<Vec<_>>(), &region, 0.02, 4).unwrap();
    assert_eq!(found.apertures, expected.apertures);
    for (found, expected) in [(&found.coherent, &expected.coherent), (&found.incoherent, &expected.incoherent)] {
        let (index, peak) = expected.peak().unwrap();
        assert_eq!(found.peak().unwrap().0, index);
        let difference = |(a, b): (&f32, &f32)| (a - b).abs();
        let worst = found.values.iter().zip(&expected.values).map(difference).fold(0.0, f32::max);
        // The processor's path follows a sub-aperture's motion by a polynomial.
        assert!(worst < 0.02 * peak, "{worst} of {peak}");
    }
    let far = Aabb { min: at + DVec3::Y * 9.0, max: at + DVec3::Y * 9.1 };
    assert_eq!(imager.fine_image(&settings, &observations, &far, 0.02, 4).unwrap(), None);
}
