//! Raw figures of play sessions, and the rates computed from them.

use serde::Serialize;

use super::moving::MovingFigures;

/// Cause of a false report.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Cause {
    /// The player's own hands were there shortly before.
    Hand,
    /// The visitor was there shortly before.
    Visitor,
    /// No known cause.
    Nothing,
}

/// The body came within [`Rates::NEAR_M`] of an object or wall.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Approach {
    /// Kind of object: "chair", "wall".
    pub kind: String,
    /// Time at which it had to be warned of, seconds.
    pub deadline_s: f64,
    /// Distance from the body at that time, metres.
    pub deadline_m: f64,
    /// Time in the beam up to the deadline, seconds.
    pub in_beam_s: f64,
    /// Whether its echoes up to the deadline could locate it: at least three that were 10 dB over the noise of a
    /// sub-aperture, whose ranges and directions fix a point to 25 cm. True for walls.
    pub locatable: bool,
    /// Whether it is the first approach to this object.
    pub is_first: bool,
    /// Whether a warning was shown at the deadline.
    pub warned: bool,
    /// Distance from which on the warning was shown without a break, metres; 0 when it was not
    /// shown.
    pub lead_m: f64,
    /// Distances from the reported positions to the object's surfaces, in a room of points to its nearest scatterer,
    /// metres.
    pub errors_m: Vec<f64>,
    /// Errors of the reported bounds; `None` for objects that were not reported, and for walls.
    pub bounds: Option<BoundErrors>,
    /// Whether the map had it by the deadline; `None` for walls.
    pub in_map: Option<InMap>,
    /// What the mapper detected of it in the ten seconds before the deadline; `None` for walls.
    pub detected: Option<Detected>,
}

/// Whether the map has an object: a cell of an obstacle is within 25 cm of one of its scatterers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub enum InMap {
    /// It never had.
    Never,
    /// It had, and has not any more.
    Removed,
    /// It has.
    Present,
}

impl InMap {
    /// The state after a step in which the map has it or not.
    pub fn after(self, has_it: bool) -> Self {
        match (has_it, self) {
            (true, _) => Self::Present,
            (false, Self::Never) => Self::Never,
            (false, _) => Self::Removed,
        }
    }
}

/// Detections near an object's scatterers, whether or not they became a report. Zeros without any.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Detected {
    /// Their number, over all updates of the map.
    pub count: usize,
    /// How many of them are reported if the classifier finds them likely enough: the position is observable, it is no
    /// hand, and no object is known there already.
    pub may_be_new: usize,
    /// The greatest score.
    pub score: f64,
    /// The greatest log odds that the classifier gave to one of these.
    pub log_odds: f64,
    /// Whether these are enough for a report.
    pub is_likely: bool,
}

/// Bounds of the report against the object's own scatterers, metres. Positive: reported nearer,
/// wider or higher than it is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct BoundErrors {
    /// Near side, as seen from the body.
    pub near_m: f64,
    /// Width, horizontal and across the line of sight.
    pub width_m: f64,
    /// Top.
    pub top_m: f64,
}

/// A report where nothing is.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FalseReport {
    /// Time, seconds.
    pub time_s: f64,
    /// Cause.
    pub cause: Cause,
    /// Whether it was reported as a wall.
    pub is_wall: bool,
    /// Within [`Rates::NEAR_M`] of the body.
    pub is_near: bool,
    /// Position, tracking frame, metres; of a wall, the reported part that is nearest to the head.
    pub position_m: [f64; 3],
    /// Distance behind the nearest true wall, floor or ceiling, metres; negative inside the room.
    pub behind_m: f64,
    /// What lies at its mirror image in a wall, floor or ceiling; empty for nothing.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub mirrors: String,
}

/// Outcome for an object that was carried away.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RemovalOutcome {
    /// Whether it was reported when it was carried away.
    pub was_known: bool,
    /// Time that its former position was in the beam until it was no longer reported, seconds;
    /// `None`: still reported.
    pub looked_s: Option<f64>,
}

/// Figures of one or more sessions.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Figures {
    /// Time played, seconds.
    pub played_s: f64,
    /// Approaches, session by session, by deadline.
    pub approaches: Vec<Approach>,
    /// False reports: one entry when one first appears anywhere, and one each time that one comes
    /// near the body.
    pub false_reports: Vec<FalseReport>,
    /// Time with a false report near the body, seconds.
    pub false_near_s: f64,
    /// Chairs that were carried away.
    pub forgettings: Vec<RemovalOutcome>,
    /// Number of obstacles in the map at the end of each session.
    pub reports_at_end: Vec<usize>,
    /// Number of times that a warning switched on or off within a second of the opposite, for the
    /// same object.
    pub flickers: u64,
    /// Moving targets.
    pub moving: MovingFigures,
}

/// Rates computed from the figures. 18 fields: one row of the tables, serialised as it is.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Rates {
    /// Approaches of objects that had been in the beam for [`Rates::SEEN_S`].
    pub due: usize,
    /// Of these, warned of in time.
    pub warned: usize,
    /// Of the due, those that could be located: the upper bound for any reconstruction.
    pub locatable: usize,
    /// First approaches only: due.
    pub first_due: usize,
    /// First approaches only: warned of in time.
    pub first_warned: usize,
    /// Median distance at which the warning came on, of the due approaches, missed ones at 0,
    /// metres.
    pub lead_median_m: f64,
    /// 10th percentile of that distance, metres.
    pub lead_p10_m: f64,
    /// False reports per minute, anywhere.
    pub false_per_min: f64,
    /// Times per minute that a false report is near the body.
    pub false_near_per_min: f64,
    /// Of these, caused by the player's own hands.
    pub hands_per_min: f64,
    /// False walls per minute, anywhere.
    pub false_walls_per_min: f64,
    /// Share of time with a false report near the body.
    pub false_near_share: f64,
    /// Median position error of objects warned of, metres.
    pub error_median_m: f64,
    /// 90th percentile of that error, metres.
    pub error_p90_m: f64,
    /// Median excess of the reported bounds (nearer, wider, higher) of objects warned of, metres.
    pub bounds_median_m: [f64; 3],
    /// 90th percentiles of the magnitude of that excess, metres.
    pub bounds_p90_m: [f64; 3],
    /// Median time in the beam until a removed chair is no longer reported, seconds; infinite:
    /// never.
    pub forget_median_s: f64,
    /// Longest such time, seconds.
    pub forget_worst_s: f64,
}

impl Rates {
    /// Distance that counts as near the body, metres. Choice: an arm's reach and a step's
    /// beginning: what a warning is for.
    pub const NEAR_M: f64 = 1.0;
    /// Minimum time in the beam before an object counts as due, seconds. Choice: eight
    /// sub-apertures, three updates of the map; nothing can be expected sooner.
    pub const SEEN_S: f64 = 0.75;
}

impl Figures {
    /// Adds another session's figures.
    pub fn add(&mut self, other: Self) {
        self.played_s += other.played_s;
        self.approaches.extend(other.approaches);
        self.false_reports.extend(other.false_reports);
        self.false_near_s += other.false_near_s;
        self.forgettings.extend(other.forgettings);
        self.reports_at_end.extend(other.reports_at_end);
        self.flickers += other.flickers;
        self.moving.add(other.moving);
    }

    /// Approaches of one kind of object alone.
    pub fn of_kind(&self, kind: &str) -> Self {
        let approaches = self.approaches.iter().filter(|a| a.kind == kind).cloned().collect();
        Self { approaches, ..self.clone() }
    }

    /// Approaches of everything but walls.
    pub fn without_walls(&self) -> Self {
        let approaches = self.approaches.iter().filter(|a| a.kind != "wall").cloned().collect();
        Self { approaches, ..self.clone() }
    }

    /// Kinds of objects that were approached, sorted by name.
    pub fn kinds(&self) -> Vec<String> {
        let mut kinds: Vec<String> = self.approaches.iter().map(|a| a.kind.clone()).collect();
        kinds.sort();
        kinds.dedup();
        kinds
    }

    /// Computes the rates.
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
            locatable: due.iter().filter(|a| a.locatable).count(),
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

/// Quantile of sorted values: the nearest of them; NaN without any. (`recorded::quantile`
/// interpolates and gives 0 without values; here the result is a measured value, or none.)
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
            locatable: in_beam_s > 1.0,
            is_first,
            warned: lead_m > 0.0,
            lead_m,
            errors_m: if lead_m > 0.0 { vec![0.02] } else { vec![] },
            bounds: Some(BoundErrors { near_m: -lead_m, width_m: 0.1, top_m: 0.0 }),
            in_map: None,
            detected: None,
        }
    }

    #[test]
    fn object_that_was_in_the_map_and_is_not_is_removed() {
        let after = |has_it: &[bool]| has_it.iter().fold(InMap::Never, |before, has_it| before.after(*has_it));
        assert_eq!(
            [after(&[false]), after(&[true]), after(&[true, false, false])],
            [InMap::Never, InMap::Present, InMap::Removed]
        );
        assert_eq!(after(&[true, false, true]), InMap::Present);
    }

    #[test]
    fn approaches_outside_the_beam_are_not_counted() {
        let approaches = vec![approach(0.7, 0.0, true), approach(1.6, 1.2, true), approach(0.8, 0.0, false)];
        let near = FalseReport {
            time_s: 1.0,
            cause: Cause::Hand,
            is_wall: false,
            is_near: true,
            position_m: [0.0; 3],
            behind_m: -1.0,
            mirrors: String::new(),
        };
        let far = FalseReport { cause: Cause::Nothing, is_near: false, ..near.clone() };
        let forgettings = vec![RemovalOutcome { was_known: true, looked_s: None }];
        let mut figures = Figures {
            played_s: 30.0,
            approaches,
            false_reports: vec![near, far.clone(), far],
            forgettings,
            ..Default::default()
        };
        let rates = figures.rates();
        assert_eq!((rates.due, rates.warned, rates.first_due, rates.first_warned, rates.locatable), (2, 1, 1, 1, 1));
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
