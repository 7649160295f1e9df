//! What is noted of sessions, and what comes of it.

use serde::Serialize;

/// Why something was reported that is not there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Cause {
    /// The player's own hands were there a moment ago.
    Hand,
    /// The visitor was there a moment ago.
    Visitor,
    /// Nothing that is known of.
    Nothing,
}

/// The body came within [`Rates::NEAR_M`] of a thing.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Approach {
    /// What it is: "chair", "wall".
    pub kind: String,
    /// When it had to be warned of, seconds.
    pub deadline_s: f64,
    /// How near the body was then, metres.
    pub deadline_m: f64,
    /// Time that it had been in the beam by then, seconds.
    pub in_beam_s: f64,
    /// Time that it had returned enough for any reconstruction with this sensor, seconds.
    pub visible_s: f64,
    /// The first of this thing.
    pub is_first: bool,
    /// It was being warned of at the deadline.
    pub warned: bool,
    /// From how far on it had been warned of without a break, metres; 0 when it was not.
    pub lead_m: f64,
    /// From reported places of it to its nearest scatterer, metres.
    pub errors_m: Vec<f64>,
    /// How what was reported of it is bounded; `None` of what was not reported, and of walls.
    pub bounds: Option<BoundErrors>,
}

/// What is reported of a thing against the thing's own scatterers, metres: positive where it is shown nearer, wider, higher
/// than it is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct BoundErrors {
    /// Its near side, seen from the body.
    pub near_m: f64,
    /// Its width, across the line of sight and level.
    pub width_m: f64,
    /// Its top.
    pub top_m: f64,
}

/// Something was reported where nothing is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FalseReport {
    /// When, seconds.
    pub time_s: f64,
    /// Why.
    pub cause: Cause,
    /// As a wall.
    pub is_wall: bool,
    /// Within [`Rates::NEAR_M`] of the body.
    pub is_near: bool,
}

/// What became of a thing that was carried away.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RemovalOutcome {
    /// It was known when it went.
    pub was_known: bool,
    /// Time that its place was in the beam from then on, until it was no longer reported, seconds; `None`: it still is.
    pub looked_s: Option<f64>,
}

/// All that was noted of some sessions.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Figures {
    /// Time played, seconds.
    pub played_s: f64,
    /// Approaches, session by session, by their deadlines.
    pub approaches: Vec<Approach>,
    /// Reports of nothing: each time one appears anywhere, and each time that one comes near the body.
    pub false_reports: Vec<FalseReport>,
    /// Time during which a report of nothing was near the body, seconds.
    pub false_near_s: f64,
    /// Chairs that were carried away.
    pub forgettings: Vec<RemovalOutcome>,
    /// Obstacles in the map at the end of each session.
    pub reports_at_end: Vec<usize>,
    /// Times that a warning came on or went out within a second of doing the opposite, for the same thing.
    pub flickers: u64,
}

/// What the figures come to.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Rates {
    /// Approaches of things that had been in the beam for [`Rates::SEEN_S`].
    pub due: usize,
    /// Of these, warned of in time.
    pub warned: usize,
    /// Of the due, those that had returned enough for long enough: no reconstruction could warn of more.
    pub visible: usize,
    /// The first approach of each thing: due and warned.
    pub first_due: usize,
    /// See `first_due`.
    pub first_warned: usize,
    /// Lead of the due approaches, missed ones at 0: median and 10th percentile, metres.
    pub lead_median_m: f64,
    /// See `lead_median_m`.
    pub lead_p10_m: f64,
    /// Reports of nothing a minute, wherever they are.
    pub false_per_min: f64,
    /// Times a minute that a report of nothing is near the body.
    pub false_near_per_min: f64,
    /// Of these, from the player's own hands.
    pub hands_per_min: f64,
    /// Walls that are none a minute, wherever they are.
    pub false_walls_per_min: f64,
    /// Share of time with a report of nothing near the body.
    pub false_near_share: f64,
    /// Position error of what was warned of: median and 90th percentile, metres.
    pub error_median_m: f64,
    /// See `error_median_m`.
    pub error_p90_m: f64,
    /// Of what was warned of, how much nearer, wider and higher it is reported than it is: medians, metres.
    pub bounds_median_m: [f64; 3],
    /// The 90th percentiles of how far these are off either way.
    pub bounds_p90_m: [f64; 3],
    /// Time in the beam until a removed chair is forgotten: median and greatest, seconds; infinite: it never was.
    pub forget_median_s: f64,
    /// See `forget_median_s`.
    pub forget_worst_s: f64,
}

impl Rates {
    /// Near the body, metres.
    pub const NEAR_M: f64 = 1.0;
    /// Time in the beam from which on a thing can be asked for, seconds.
    pub const SEEN_S: f64 = 0.75;
}

impl Figures {
    /// Adds another session's.
    pub fn add(&mut self, other: Self) {
        self.played_s += other.played_s;
        self.approaches.extend(other.approaches);
        self.false_reports.extend(other.false_reports);
        self.false_near_s += other.false_near_s;
        self.forgettings.extend(other.forgettings);
        self.reports_at_end.extend(other.reports_at_end);
        self.flickers += other.flickers;
    }

    /// Approaches of one kind of thing alone.
    pub fn of_kind(&self, kind: &str) -> Self {
        let approaches = self.approaches.iter().filter(|a| a.kind == kind).cloned().collect();
        Self { approaches, ..self.clone() }
    }

    /// Approaches of everything but walls.
    pub fn without_walls(&self) -> Self {
        let approaches = self.approaches.iter().filter(|a| a.kind != "wall").cloned().collect();
        Self { approaches, ..self.clone() }
    }

    /// Kinds of things that were approached, by name.
    pub fn kinds(&self) -> Vec<String> {
        let mut kinds: Vec<String> = self.approaches.iter().map(|a| a.kind.clone()).collect();
        kinds.sort();
        kinds.dedup();
        kinds
    }

    /// What they come to.
    pub fn rates(&self) -> Rates {
        let due: Vec<&Approach> = self.approaches.iter().filter(|a| a.in_beam_s >= Rates::SEEN_S).collect();
        let firsts = || due.iter().filter(|a| a.is_first);
        let leads = sorted(due.iter().map(|a| a.lead_m));
        let errors = sorted(due.iter().filter(|a| a.warned).flat_map(|a| a.errors_m.iter().copied()));
        let per_min = |wanted: &dyn Fn(&FalseReport) -> bool| {
            self.false_reports.iter().filter(|report| wanted(report)).count() as f64 * 60.0 / self.played_s
        };
        let forgot = self.forgettings.iter().filter(|f| f.was_known).map(|f| f.looked_s.unwrap_or(f64::INFINITY));
        let forgot = sorted(forgot);
        let bounds = || due.iter().filter(|a| a.warned).filter_map(|a| a.bounds);
        let parts: [fn(BoundErrors) -> f64; 3] = [|b| b.near_m, |b| b.width_m, |b| b.top_m];
        Rates {
            due: due.len(),
            warned: due.iter().filter(|a| a.warned).count(),
            visible: due.iter().filter(|a| a.visible_s >= Rates::SEEN_S).count(),
            first_due: firsts().count(),
            first_warned: firsts().filter(|a| a.warned).count(),
            lead_median_m: quantile(&leads, 0.5),
            lead_p10_m: quantile(&leads, 0.1),
            false_per_min: per_min(&|report| !report.is_near),
            false_near_per_min: per_min(&|report| report.is_near),
            false_walls_per_min: per_min(&|report| !report.is_near && report.is_wall),
            hands_per_min: per_min(&|report| report.is_near && report.cause == Cause::Hand),
            false_near_share: self.false_near_s / self.played_s,
            error_median_m: quantile(&errors, 0.5),
            error_p90_m: quantile(&errors, 0.9),
            bounds_median_m: parts.map(|part| quantile(&sorted(bounds().map(part)), 0.5)),
            bounds_p90_m: parts.map(|part| quantile(&sorted(bounds().map(|b| part(b).abs())), 0.9)),
            forget_median_s: quantile(&forgot, 0.5),
            forget_worst_s: quantile(&forgot, 1.0),
        }
    }
}

fn sorted(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values
}

/// Of rising values, the nearest; NaN of none. (`recorded::quantile` lies between two of them and is 0 of none: here it is to be one that was
/// measured, and of nothing nothing is told.)
fn quantile(sorted: &[f64], share: f64) -> f64 {
    let at = (share * sorted.len().saturating_sub(1) as f64).round() as usize;
    sorted.get(at).copied().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn approach(in_beam_s: f64, lead_m: f64, is_first: bool) -> Approach {
        Approach {
            kind: "chair".into(),
            deadline_s: 1.0,
            deadline_m: 0.4,
            in_beam_s,
            visible_s: in_beam_s / 2.0,
            is_first,
            warned: lead_m > 0.0,
            lead_m,
            errors_m: if lead_m > 0.0 { vec![0.02] } else { vec![] },
            bounds: Some(BoundErrors { near_m: -lead_m, width_m: 0.1, top_m: 0.0 }),
        }
    }

    #[test]
    fn approaches_outside_the_beam_are_not_counted() {
        let approaches = vec![approach(0.7, 0.0, true), approach(1.6, 1.2, true), approach(0.8, 0.0, false)];
        let near = FalseReport { time_s: 1.0, cause: Cause::Hand, is_wall: false, is_near: true };
        let far = FalseReport { cause: Cause::Nothing, is_near: false, ..near };
        let forgettings = vec![RemovalOutcome { was_known: true, looked_s: None }];
        let mut figures = Figures {
            played_s: 30.0,
            approaches,
            false_reports: vec![near, far, far],
            forgettings,
            ..Default::default()
        };
        let rates = figures.rates();
        assert_eq!((rates.due, rates.warned, rates.first_due, rates.first_warned, rates.visible), (2, 1, 1, 1, 1));
        assert_eq!((rates.false_per_min, rates.false_near_per_min, rates.hands_per_min), (4.0, 2.0, 2.0));
        assert_eq!((rates.error_median_m, rates.forget_median_s), (0.02, f64::INFINITY));
        assert_eq!(
            (rates.bounds_median_m, rates.bounds_p90_m),
            ([-1.2, 0.1, 0.0], [1.2, 0.1, 0.0]),
            "of the one warned of"
        );
        figures.add(figures.clone());
        assert_eq!((figures.rates().due, figures.rates().false_near_per_min), (4, 2.0));
        assert_eq!((figures.kinds(), figures.of_kind("wall").rates().due), (vec!["chair".to_owned()], 0));
    }
}
