//! Tests each rule with an accepted and a rejected configuration one step apart, and all rules
//! together against the sensor's limits, restated here from the vendor's documents and not from the
//! code under test.

use proptest::prelude::*;

use super::super::{FrameTiming, PRESETS, frame_timing, preset};
use super::*;

#[test]
fn every_preset_is_valid() {
    for name in PRESETS {
        preset(name).unwrap().validate().unwrap_or_else(|e| panic!("{name}: {e}"));
    }
}

type Change = fn(&mut SensorConfig);

/// Rows: text of the error, an accepted change of the default, and a rejected one a step away.
fn neighbours() -> Vec<(&'static str, Change, Change)> {
    vec![
        ("subsweeps is empty", |c| c.subsweeps.truncate(1), |c| c.subsweeps.truncate(0)),
        ("5 entries", |c| repeat(c, 4), |c| repeat(c, 5)),
        ("sweeps_per_frame is 0: it must lie in 1 to 4095", |c| c.sweeps_per_frame = 1, |c| c.sweeps_per_frame = 0),
        ("sweeps_per_frame is 4096", |c| buffer(c, 1, 4095), |c| buffer(c, 1, 4096)),
        ("start_point is -276: it must lie in -275", |c| first(c).start_point = -275, |c| first(c).start_point = -276),
        ("num_points is 0", |c| first(c).num_points = 1, |c| first(c).num_points = 0),
        ("num_points is 4096", |c| buffer(c, 4095, 1), |c| buffer(c, 4096, 1)),
        ("hwaas is 0", |c| first(c).hwaas = 1, |c| first(c).hwaas = 0),
        ("hwaas is 512: it must lie in 1 to 511", |c| first(c).hwaas = 511, |c| first(c).hwaas = 512),
        (
            "receiver_gain is 24: it must lie in 0 to 23",
            |c| first(c).receiver_gain = 23,
            |c| {
                first(c).receiver_gain = 24;
            },
        ),
        ("step_length is 0", |c| first(c).step_length = 1, |c| first(c).step_length = 0),
        ("step_length is 5", |c| first(c).step_length = 6, |c| first(c).step_length = 5),
        ("step_length is 25", |c| points(c, 2, 24), |c| points(c, 2, 25)),
        ("step_length is 36", |c| points(c, 2, 48), |c| points(c, 2, 36)),
        (
            "enable_loopback is true with profile 2",
            |c| (first(c).profile, first(c).enable_loopback) = (Profile::P3, true),
            |c| (first(c).profile, first(c).enable_loopback) = (Profile::P2, true),
        ),
        (
            "prf is 19.5 MHz with profile 2",
            |c| (first(c).profile, first(c).prf) = (Profile::P1, Prf::Mhz19_5),
            |c| (first(c).profile, first(c).prf) = (Profile::P2, Prf::Mhz19_5),
        ),
        // 80 + 24 · 81 base steps are 5.06 m, 24 more are 5.12 m.
        ("ends at 5.12 m: prf 15.6 MHz measures to 5.1 m", |c| points(c, 82, 24), |c| points(c, 83, 24)),
        (
            "subsweeps[1].prf is 15.6 MHz, above 13 MHz",
            |c| prfs(c, Prf::Mhz13_0, Prf::Mhz13_0),
            |c| prfs(c, Prf::Mhz13_0, Prf::Mhz15_6),
        ),
        ("is 160 × 26 = 4160: the sensor holds 4095", |c| c.sweeps_per_frame = 25, |c| c.sweeps_per_frame = 26),
        ("is 4096 × 1 = 4096: the sensor holds 4095", |c| two_subsweeps(c, 4094), |c| two_subsweeps(c, 4095)),
        (
            "the sensor holds 2047 with double_buffering",
            |c| {
                buffer(c, 2047, 1);
                c.double_buffering = true;
            },
            |c| {
                buffer(c, 2048, 1);
                c.double_buffering = true;
            },
        ),
        ("frame_rate is 0", |c| c.frame_rate = Some(1e-3), |c| c.frame_rate = Some(0.0)),
        ("frame_rate is -1", |c| c.frame_rate = Some(1.0), |c| c.frame_rate = Some(-1.0)),
        ("sweep_rate is NaN", |c| c.sweep_rate = None, |c| c.sweep_rate = Some(f64::NAN)),
        ("sweep_rate is inf", |c| c.sweep_rate = Some(1e6), |c| c.sweep_rate = Some(f64::INFINITY)),
        ("it must be above 0", |c| c.sweep_rate = Some(1e-37), |c| c.sweep_rate = Some(1e-39)),
        ("it may be 50 at most", |c| rates(c, 50.0), |c| rates(c, 50.001)),
        ("less deep", |c| idle(c, IdleState::Sleep, IdleState::Sleep), |c| idle(c, IdleState::Ready, IdleState::Sleep)),
        ("leave frame_rate out", continuous, |c| {
            continuous(c);
            c.frame_rate = Some(9.0);
        }),
        ("set sweep_rate", continuous, |c| {
            continuous(c);
            c.sweep_rate = None;
        }),
        ("make them equal", continuous, |c| {
            continuous(c);
            c.inter_frame_idle_state = IdleState::Sleep;
        }),
    ]
}

fn first(config: &mut SensorConfig) -> &mut Subsweep {
    &mut config.subsweeps[0]
}

fn repeat(config: &mut SensorConfig, count: usize) {
    config.subsweeps = vec![Subsweep::default(); count];
}

fn points(config: &mut SensorConfig, num_points: u32, step_length: u32) {
    (first(config).num_points, first(config).step_length) = (num_points, step_length);
}

fn buffer(config: &mut SensorConfig, num_points: u32, sweeps_per_frame: u32) {
    (first(config).num_points, first(config).prf) = (num_points, Prf::Mhz8_7);
    config.sweeps_per_frame = sweeps_per_frame;
}

fn two_subsweeps(config: &mut SensorConfig, num_points: u32) {
    buffer(config, num_points, 1);
    config.subsweeps.push(Subsweep { num_points: 1, prf: Prf::Mhz8_7, ..Default::default() });
}

fn prfs(config: &mut SensorConfig, first: Prf, second: Prf) {
    config.subsweeps = [first, second].map(|prf| Subsweep { prf, ..Default::default() }).into();
}

fn rates(config: &mut SensorConfig, frame_rate: f64) {
    (config.frame_rate, config.sweep_rate, config.sweeps_per_frame) = (Some(frame_rate), Some(100.0), 2);
}

fn idle(config: &mut SensorConfig, frame: IdleState, sweep: IdleState) {
    (config.inter_frame_idle_state, config.inter_sweep_idle_state) = (frame, sweep);
}

fn continuous(config: &mut SensorConfig) {
    (config.continuous_sweep_mode, config.sweep_rate) = (true, Some(100.0));
    idle(config, IdleState::Ready, IdleState::Ready);
}

#[test]
fn each_rule_rejects_and_accepts_its_neighbouring_examples() {
    let mut told = [false; 15];
    for (says, accepted, refused) in neighbours() {
        let mut config = SensorConfig::default();
        accepted(&mut config);
        assert_eq!(config.validate(), Ok(()), "beside: {says}");
        let mut config = SensorConfig::default();
        refused(&mut config);
        let error = config.validate().expect_err(says);
        assert!(error.to_string().contains(says), "{error} should say {says}");
        told[rule_of(&error)] = true;
    }
    assert_eq!(told, [true; 15], "a rule without examples");
}

/// Index of each rule; a new rule does not compile until it has one.
fn rule_of(error: &ConfigError) -> usize {
    match error {
        ConfigError::NoSubsweeps => 0,
        ConfigError::TooManySubsweeps(_) => 1,
        ConfigError::OutOfRange { .. } => 2,
        ConfigError::StepLength { .. } => 3,
        ConfigError::LoopbackWithProfile2(_) => 4,
        ConfigError::PrfNeedsProfile1 { .. } => 5,
        ConfigError::BeyondPrf { .. } => 6,
        ConfigError::PrfRises { .. } => 7,
        ConfigError::Rate { .. } => 8,
        ConfigError::FrameRateAboveSweeps { .. } => 9,
        ConfigError::FrameIdleShallower { .. } => 10,
        ConfigError::ContinuousWithFrameRate(_) => 11,
        ConfigError::ContinuousWithoutSweepRate => 12,
        ConfigError::ContinuousIdleStates { .. } => 13,
        ConfigError::Buffer { .. } => 14,
    }
}

/// PRF, MHz, and the farthest range of a point, metres.
const PRF_LIMITS: [(Prf, f64, f64); 6] = [
    (Prf::Mhz19_5, 19.5, 3.1),
    (Prf::Mhz15_6, 15.6, 5.1),
    (Prf::Mhz13_0, 13.0, 7.0),
    (Prf::Mhz8_7, 8.7, 12.7),
    (Prf::Mhz6_5, 6.5, 18.5),
    (Prf::Mhz5_2, 5.2, 24.3),
];
/// Distance between points at step length 1, metres, as in every recording of the vendor.
const STEP_M: f64 = 0.002_502_274_001_017_21;

#[test]
fn points_reach_to_the_prf_limit_and_no_farther() {
    for (prf, _, max_m) in PRF_LIMITS {
        let last = (max_m / STEP_M) as i32;
        for (start_point, is_sound) in [(last, true), (last + 1, false)] {
            let profile = if prf == Prf::Mhz19_5 { Profile::P1 } else { Profile::P4 };
            let subsweeps = vec![Subsweep { start_point, num_points: 1, prf, profile, ..Default::default() }];
            let result = SensorConfig { subsweeps, ..Default::default() }.validate();
            assert_eq!(result.is_ok(), is_sound, "{prf:?} at {start_point}: {result:?}");
        }
    }
}

#[test]
fn both_vendor_spellings_are_parsed() {
    let session = r#"{"profile": "PROFILE_5", "prf": "PRF_8_7_MHz", "num_points": 53}"#;
    let protocol = r#"{"profile": 5, "prf": "8_7_MHz", "num_points": 53}"#;
    let a: Subsweep = serde_json::from_str(session).unwrap();
    assert_eq!(a, serde_json::from_str(protocol).unwrap());
    assert_eq!(a.profile, Profile::P5);
    assert!(serde_json::from_str::<Subsweep>(r#"{"profile": 6}"#).unwrap_err().to_string().contains("1 to 5"));
}

/// Whether the sensor accepts the configuration, by the vendor's documents.
fn is_within_limits(config: &SensorConfig) -> bool {
    let SensorConfig { sweeps_per_frame, sweep_rate, frame_rate, subsweeps, .. } = config;
    // Servers store rates as 32-bit floats, of which 0 means none.
    let is_rate = |rate: f64| (1.175_494_4e-38..=3.402_823_4e38).contains(&rate);
    let depth = |state: IdleState| match state {
        IdleState::Ready => 0,
        IdleState::Sleep => 1,
        IdleState::DeepSleep => 2,
    };
    let (frame_depth, sweep_depth) = (depth(config.inter_frame_idle_state), depth(config.inter_sweep_idle_state));
    let samples = subsweeps.iter().map(|s| u64::from(s.num_points)).sum::<u64>() * u64::from(*sweeps_per_frame);
    let mhz = |s: &Subsweep| PRF_LIMITS.iter().find(|(prf, ..)| *prf == s.prf).unwrap().1;
    let all = [
        (1..=4).contains(&subsweeps.len()),
        *sweeps_per_frame >= 1,
        subsweeps.iter().all(is_subsweep_within_limits),
        subsweeps.windows(2).all(|pair| mhz(&pair[1]) <= mhz(&pair[0])),
        samples <= if config.double_buffering { 2047 } else { 4095 },
        sweep_rate.is_none_or(is_rate) && frame_rate.is_none_or(is_rate),
        sweep_rate.is_none_or(|sweep| frame_rate.is_none_or(|frame| frame <= sweep / f64::from(*sweeps_per_frame))),
        frame_depth >= sweep_depth,
        !config.continuous_sweep_mode || frame_rate.is_none() && sweep_rate.is_some() && frame_depth == sweep_depth,
    ];
    all.into_iter().all(|holds| holds)
}

fn is_subsweep_within_limits(s: &Subsweep) -> bool {
    let max_m = PRF_LIMITS.iter().find(|(prf, ..)| *prf == s.prf).unwrap().2;
    let last = f64::from(s.start_point) + (f64::from(s.num_points) - 1.0) * f64::from(s.step_length);
    let all = [
        s.start_point >= -275,
        s.num_points >= 1,
        [1, 2, 3, 4, 6, 8, 12].contains(&s.step_length) || s.step_length >= 24 && s.step_length.is_multiple_of(24),
        (1..=511).contains(&s.hwaas),
        s.receiver_gain <= 23,
        !(s.enable_loopback && s.profile == Profile::P2),
        s.prf != Prf::Mhz19_5 || s.profile == Profile::P1,
        last * STEP_M <= max_m,
    ];
    all.into_iter().all(|holds| holds)
}

/// Mostly valid values, with a few at and beyond the limits.
fn mostly<T: Clone + std::fmt::Debug + 'static>(sound: &[T], odd: &[T]) -> impl Strategy<Value = T> + use<T> {
    prop_oneof![30 => prop::sample::select(sound.to_vec()), 1 => prop::sample::select(odd.to_vec())]
}

fn any_subsweep() -> impl Strategy<Value = Subsweep> {
    let places = (
        prop_oneof![-275..1000i32, mostly(&[-275, 0, 80, 1200], &[-276, 9000, i32::MIN, i32::MAX])],
        prop_oneof![9 => 1..60u32, 1 => mostly(&[1, 500, 1023, 2047], &[0, 4095, 4096, u32::MAX])],
        mostly(&[1, 2, 3, 4, 6, 8, 12, 24], &[48, 240, 0, 5, 7, 36, 25, 4_294_967_280, u32::MAX]),
    );
    let quality = (
        prop::sample::select(Profile::ALL.to_vec()),
        prop_oneof![1..=511u32, mostly(&[1, 511], &[0, 512, u32::MAX])],
        mostly(&[0, 16, 23], &[24, u32::MAX]),
        prop::sample::select(PRF_LIMITS[1..].to_vec()),
        prop::bool::weighted(0.1),
        prop::bool::weighted(0.02),
    );
    (places, quality).prop_map(|(places, (profile, hwaas, receiver_gain, (prf, ..), enable_loopback, is_fastest))| {
        let (start_point, num_points, step_length) = places;
        let prf = if is_fastest { Prf::Mhz19_5 } else { prf };
        let known = Subsweep { start_point, num_points, step_length, profile, hwaas, ..Default::default() };
        Subsweep { receiver_gain, prf, enable_loopback, ..known }
    })
}

fn any_config() -> impl Strategy<Value = SensorConfig> {
    let rate = || {
        let odd = [0.0, -0.0, -5.0, 1e-39, 5e-324, 1e39, f64::NAN, f64::INFINITY].map(Some);
        prop_oneof![2 => Just(None), 1 => mostly(&[0.1, 10.0, 100.0, 1000.0, 2e-38, 1e6].map(Some), &odd)]
    };
    let idle = || prop::sample::select(vec![IdleState::Ready, IdleState::Sleep, IdleState::DeepSleep]);
    let subsweeps = (prop::collection::vec(any_subsweep(), 1..4), 0..40usize, prop::bool::weighted(0.9));
    let flags = (prop::bool::weighted(0.1), prop::bool::weighted(0.2));
    let sweeps = prop_oneof![1..8u32, mostly(&[1, 16], &[0, 4095, 4096, u32::MAX])];
    (subsweeps, sweeps, rate(), rate(), flags, idle(), idle()).prop_map(
        |((mut subsweeps, count, is_sorted), sweeps_per_frame, sweep_rate, frame_rate, flags, frame, sweep)| {
            if is_sorted {
                subsweeps.sort_by(|a, b| b.prf.hz().total_cmp(&a.prf.hz()));
            }
            if let 0 | 4 | 5 = count {
                subsweeps.resize(count, Subsweep { num_points: 2, prf: Prf::Mhz5_2, ..Default::default() });
            }
            SensorConfig {
                sweeps_per_frame,
                sweep_rate,
                frame_rate,
                continuous_sweep_mode: flags.0,
                double_buffering: flags.1,
                inter_frame_idle_state: if is_sorted { frame.max(sweep) } else { frame },
                inter_sweep_idle_state: if is_sorted { frame.min(sweep) } else { sweep },
                subsweeps,
            }
        },
    )
}

/// All times of a timing, in one row.
fn times_s(timing: &FrameTiming) -> Vec<f64> {
    let FrameTiming { sweep_period_s, sweep_s, frame_s, frame_period_s, .. } = *timing;
    [sweep_period_s, sweep_s, frame_s, frame_period_s].into_iter().chain(timing.subsweeps.iter().map(|s| s.1)).collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 4000, max_global_rejects: 100_000, ..Default::default() })]

    #[test]
    fn validation_accepts_exactly_what_is_within_limits(config in any_config()) {
        let result = config.validate();
        prop_assert_eq!(result.is_ok(), is_within_limits(&config), "{:?}", result);
    }

    #[test]
    fn times_are_positive_and_rise_with_points_and_averages(config in any_config(), which in 0..4usize) {
        prop_assume!(config.validate().is_ok());
        let timing = frame_timing(&config);
        let times = times_s(&timing);
        prop_assert!(times.iter().all(|time_s| time_s.is_finite() && *time_s > 0.0), "{:?}", timing);
        prop_assert!(timing.subsweeps.iter().all(|(offset_s, _)| offset_s.is_finite() && *offset_s >= 0.0));
        prop_assert!(timing.sweep_period_s >= timing.sweep_s && timing.frame_s >= timing.sweep_s);
        prop_assert!(timing.frame_period_s >= timing.frame_s * (1.0 - 1e-12));
        let which = which % config.subsweeps.len();
        let mut more_points = config.clone();
        more_points.subsweeps[which].num_points += 1;
        let mut more_averages = config;
        more_averages.subsweeps[which].hwaas += 1;
        for more in [more_points, more_averages] {
            let more = frame_timing(&more);
            prop_assert!(more.sweep_s > timing.sweep_s, "{:?} after {:?}", more, timing);
            prop_assert!(times_s(&more).iter().zip(&times).all(|(after, before)| after >= before));
        }
    }
}

#[test]
fn generated_configurations_are_both_valid_and_invalid() {
    use proptest::strategy::ValueTree;
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let configs = (0..2000).map(|_| any_config().new_tree(&mut runner).unwrap().current());
    let accepted = configs.filter(|config| config.validate().is_ok()).count();
    assert!((200..1800).contains(&accepted), "{accepted} of 2000 accepted");
}
