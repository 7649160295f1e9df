//! Coherence scores, as a volume and in the score field, against the oracle.

use radar_sar::subaperture::{Field, SubapertureBuilder, SubapertureSettings};
use radar_sar::{Oracle, Statistic, subaperture_volume};

use crate::cases::{cases, rows, sound, sweeps_along};
use crate::{agrees, quick_or_long};

/// Tolerance of `subaperture_volume`: this share of the peak, plus this constant.
const SHARE: f64 = 0.02;
const FLOOR: f64 = 0.02;

#[test]
fn coherence_scores_match_the_oracle() {
    let settings = SubapertureSettings::default();
    let mut wrong = Vec::new();
    for (case, path) in rows(&cases()) {
        let what = format!("{} / {}", case.name, path.name);
        let observations = sound(&sweeps_along(case, path, quick_or_long(120, 500), 2_000, 11));
        let oracle = Oracle::new(&observations, &case.beam, &settings);
        let volume = subaperture_volume(&observations, &case.beam, &settings, &case.region(), 2.4 * case.voxel_m);
        let mut field = Field::new(settings, settings.min_cos(&case.beam));
        let mut builder = SubapertureBuilder::new(settings);
        observations.iter().filter_map(|o| builder.push(o.clone())).for_each(|block| field.add(&block));
        builder.close().iter().for_each(|block| field.add(block));

        let places: Vec<_> = (0..volume.values.len()).map(|n| volume.center(volume.voxel(n))).collect();
        let exact: Vec<f64> = places.iter().map(|&place| oracle.value(Statistic::Subaperture, place)).collect();
        let allowed = SHARE * exact.iter().copied().fold(0.0, f64::max) + FLOOR;
        for ((place, value), exact) in places.iter().zip(&volume.values).zip(exact) {
            if !agrees(f64::from(*value), exact, allowed) {
                wrong.push(format!("{what} at {place}: {value}, oracle {exact}"));
            }
            // The field has its own grid: the oracle is evaluated at the centre of its voxel.
            let middle = ((*place / settings.voxel_m).floor() + 0.5) * settings.voxel_m;
            let (value, exact) = (field.score_at(*place), oracle.value(Statistic::Subaperture, middle));
            if value.is_some_and(|value| !agrees(value, exact, allowed + SHARE * exact.abs())) {
                wrong.push(format!("{what} at {middle}: {value:?} in the field, oracle {exact}"));
            }
        }
        if field.peaks(0.0, 0.15, i64::MIN).iter().any(|peak| !peak.score.is_finite()) {
            wrong.push(format!("{what}: a peak of the field is not finite"));
        }
    }
    wrong.truncate(200);
    assert!(wrong.is_empty(), "{} wrong:\n{}", wrong.len(), wrong.join("\n"));
}

#[test]
fn no_sweeps_give_no_score() {
    let (settings, case) = (SubapertureSettings::default(), &cases()[0]);
    let volume = subaperture_volume(&[], &case.beam, &settings, &case.region(), 0.05);
    assert!(volume.values.iter().all(|value| *value == 0.0));
    assert!(Field::new(settings, 0.5).peaks(0.0, 0.15, 0).is_empty());
}
