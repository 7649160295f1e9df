//! Merges frames and poses, which arrive separately and late, into one time order: each event waits
//! for earlier ones that may still arrive.

use std::collections::BTreeMap;

use radar_mapping::Event;

/// Largest number of waiting events; beyond, the earliest are emitted at once. Choice: bounds
/// memory when one stream is far behind; more than a minute of frames, poses and hands at 850 a
/// second.
pub const MAX_WAITING: usize = 65_536;

/// Merges two streams in time. An event that arrives too late is emitted all the same, and counted.
pub struct EventMerger {
    hold_ns: i64,
    waiting: BTreeMap<(i64, u64), Event>,
    next: u64,
    emitted_ns: i64,
    late: u64,
}

impl EventMerger {
    /// `hold_ns`: how long each event waits, nanoseconds of the host's clock.
    pub fn new(hold_ns: i64) -> Self {
        Self { hold_ns, waiting: BTreeMap::new(), next: 0, emitted_ns: i64::MIN, late: 0 }
    }

    /// Takes an event of either stream.
    pub fn push(&mut self, event: Event) {
        self.late += u64::from(event.time_ns() < self.emitted_ns);
        self.waiting.insert((event.time_ns(), self.next), event);
        self.next += 1;
    }

    /// The next event that has waited long enough at a host time.
    pub fn next_due(&mut self, now_ns: i64) -> Option<Event> {
        let (&(time_ns, _), _) = self.waiting.first_key_value()?;
        let is_due = time_ns.saturating_add(self.hold_ns) <= now_ns || self.waiting.len() > MAX_WAITING;
        is_due.then(|| self.pop())?
    }

    /// The next event, however short it has waited: for the end of the streams.
    pub fn pop(&mut self) -> Option<Event> {
        let ((time_ns, _), event) = self.waiting.pop_first()?;
        self.emitted_ns = self.emitted_ns.max(time_ns);
        Some(event)
    }

    /// Events that arrived after later ones had been emitted.
    pub fn late(&self) -> u64 {
        self.late
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use a121::Frame;
    use radar_sar::PoseSample;
    use radar_sar::geometry::Pose;

    fn pose(time_ns: i64) -> Event {
        Event::Pose(PoseSample::valid(time_ns, &Pose::IDENTITY))
    }

    fn frame(host_time_ns: i64) -> Event {
        let flags = (false, false, false);
        Event::Frame(Frame {
            tick: 0,
            host_time_ns,
            temperature_c: 0,
            data_saturated: flags.0,
            frame_delayed: flags.1,
            calibration_needed: flags.2,
            samples: vec![],
        })
    }

    fn due(merge: &mut EventMerger, now_ns: i64) -> Vec<i64> {
        std::iter::from_fn(|| merge.next_due(now_ns)).map(|event| event.time_ns()).collect()
    }

    #[test]
    fn events_come_out_in_time_order() {
        let mut merge = EventMerger::new(100);
        [frame(50), frame(90), pose(40), pose(60), pose(120)].into_iter().for_each(|event| merge.push(event));
        assert_eq!(due(&mut merge, 150), [40, 50]);
        merge.push(pose(55));
        merge.push(pose(45));
        assert_eq!((merge.late(), due(&mut merge, 160)), (1, vec![45, 55, 60]));
        assert_eq!((due(&mut merge, 1000), due(&mut merge, 1000)), (vec![90, 120], vec![]));
    }

    #[test]
    fn equal_times_keep_their_order_and_memory_is_bounded() {
        let mut merge = EventMerger::new(i64::MAX);
        (0..MAX_WAITING as i64 + 10).for_each(|n| merge.push(pose(n / 2)));
        assert_eq!(due(&mut merge, 0), [0, 0, 1, 1, 2, 2, 3, 3, 4, 4]);
        let mut equal = EventMerger::new(0);
        equal.push(pose(5));
        equal.push(frame(5));
        assert!(matches!(equal.pop(), Some(Event::Pose(_))) && matches!(equal.pop(), Some(Event::Frame(_))));
        assert!(equal.pop().is_none());
    }
}
