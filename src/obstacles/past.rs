//! What was seen at a place before the window: some of the blocks that have left it, for most of a minute.
//!
//! An artefact of the last seconds' movement stands where the beam has been before and nothing was; a weak thing was seen a little each
//! time. A place that is newly believed is therefore asked of the past: had a thing of this strength been there, some blocks should
//! have seen it. Things are moved, so the past is evidence among other evidence and no proof, and the newest looks at the place alone
//! count: a chair that was put where nothing was is believed after some seconds in sight.

use std::collections::VecDeque;

use glam::{DMat3, DVec3};

use super::views::View;
use crate::imaging::blocks::{Block, BlockSettings, PlaceBlock};
use crate::math;
use crate::radar::Beam;

/// One block of so many is kept.
const EVERY: u64 = 3;
/// So many are kept: 50 s of preset d16.
const KEPT: usize = 190;
/// How sure it is that a block sees a thing that is there: most things return into some directions only.
const SURELY: f64 = 0.5;
/// So many blocks that have it in their beam count, the newest.
const NEWEST: usize = 16;
/// What is gone was so near to where it was known, metres.
const GONE_M: f64 = 0.4;
/// Greatest that one block adds to the log odds.
const MOST_A_BLOCK: f64 = 1.0;

/// What the past says of a place.
#[derive(Debug, Clone, Copy)]
pub(super) struct PastSays {
    /// How much likelier it makes it that something is there, log odds; 0 where it says nothing.
    pub log_odds: f64,
    /// Blocks that tell of it, and how well these know where it is, 1/m².
    pub telling: usize,
    /// See `telling`.
    pub information: DMat3,
}

/// Blocks that have left the window.
#[derive(Debug, Default)]
pub(super) struct Past {
    blocks: VecDeque<PlaceBlock>,
    left: u64,
    /// Where something was and is gone, and the time of the newest block that was known then.
    gone: VecDeque<(DVec3, i64)>,
}

impl Past {
    /// A block leaves the window.
    pub fn take(&mut self, block: &Block) {
        self.left += 1;
        if !self.left.is_multiple_of(EVERY) {
            return;
        }
        // Memory that is taken and given back among what stays goes to pieces.
        let oldest = if self.blocks.len() == KEPT { self.blocks.pop_front() } else { None };
        self.blocks.push_back(PlaceBlock::of(block, oldest));
        let from_ns = self.blocks.front().map_or(i64::MAX, PlaceBlock::mid_time_ns);
        self.gone.retain(|(_, until_ns)| *until_ns >= from_ns);
    }

    /// What was at a place is gone: blocks up to then say nothing of what is there now.
    pub fn is_gone(&mut self, place: DVec3, until_ns: i64) {
        self.gone.push_back((place, until_ns));
    }

    /// What it says of a place which returns what these views of the window say.
    pub fn says(
        &self,
        place: DVec3,
        views: &[Option<View>],
        (settings, min_cos): (&BlockSettings, f64),
        beam: &Beam,
    ) -> PastSays {
        let mut says = PastSays { log_odds: 0.0, telling: 0, information: DMat3::ZERO };
        let Some(strength) = strength(views) else { return says };
        let sees = |block: &&PlaceBlock| settings.within(&block.geometry().axis).sees(block.middle(), min_cos, place);
        let near = self.gone.iter().filter(|(gone, _)| gone.distance(place) <= GONE_M);
        let gone_ns = near.map(|(_, until_ns)| *until_ns).max().unwrap_or(i64::MIN);
        let since = self.blocks.iter().rev().take_while(|block| block.mid_time_ns() > gone_ns);
        let that_see_it = since.filter(sees).take(NEWEST);
        for block in that_see_it {
            let range_m = block.distance_m(place);
            let toward = (place - block.middle().translation) / range_m.max(1e-9);
            let seen_from = (block.middle(), block.motion());
            let view = View::new(seen_from, block.coherence_at(place), range_m, toward, beam);
            says.log_odds += math::ln(SURELY * view.likelihood_ratio(strength) + 1.0 - SURELY).min(MOST_A_BLOCK);
            if view.is_telling() {
                says.telling += 1;
                says.information += view.information(block.motion(), block.geometry(), block.aperture_m());
            }
        }
        says
    }
}

/// What a thing returns at 1 m on the axis, over the noise: the geometric mean of what telling views say.
fn strength(views: &[Option<View>]) -> Option<f64> {
    let logs = || views.iter().flatten().filter_map(|view| view.ln_strength);
    let count = logs().count();
    (count > 0).then(|| math::exp(logs().sum::<f64>() / count as f64))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::blocks::BlockBuilder;
    use crate::imaging::test_data::{Echo, sweeps, winding};

    const THING: DVec3 = DVec3::new(0.2, 0.1, -1.2);
    const NOTHING: DVec3 = DVec3::new(-0.4, -0.1, -1.4);

    fn blocks(duration_s: f64, echoes: &[(Echo, f64)]) -> Vec<Block> {
        let mut builder = BlockBuilder::new(BlockSettings::default());
        sweeps(duration_s, winding, echoes, 3).into_iter().filter_map(|o| builder.push(o)).collect()
    }

    fn view_of_thing(block: &Block) -> Option<View> {
        let range_m = block.distance_m(THING);
        let toward = (THING - block.middle.translation) / range_m;
        let coherence = PlaceBlock::of(block, None).coherence_at(THING);
        Some(View::new((&block.middle, block.motion), coherence, range_m, toward, &Beam::Lensless))
    }

    /// What these blocks, when they have left the window, say of a thing of the strength of what is at `THING`, at a place.
    fn log_odds(place: DVec3, left: Vec<Block>) -> f64 {
        let (settings, beam, mut past) = (BlockSettings::default(), Beam::Lensless, Past::default());
        let views: Vec<_> = blocks(2.0, &SEEN).iter().map(view_of_thing).collect();
        left.iter().for_each(|block| past.take(block));
        assert!(past.blocks.len() <= KEPT);
        past.says(place, &views, (&settings, settings.min_cos(&beam)), &beam).log_odds
    }

    const SEEN: [(Echo, f64); 1] = [(Echo::Point(THING), 2.0)];

    #[test]
    fn the_past_speaks_for_what_was_there_and_against_what_was_not() {
        let (thing, nothing) = (log_odds(THING, blocks(3.0, &SEEN)), log_odds(NOTHING, blocks(3.0, &SEEN)));
        assert!(thing > 5.0 && nothing < -4.0, "{thing} {nothing}");
        let behind = log_odds(DVec3::new(0.0, 0.0, 1.5), blocks(3.0, &SEEN));
        assert_eq!(behind, 0.0, "where nobody looked");
        assert_eq!(
            Past::default().says(THING, &[None], (&BlockSettings::default(), 0.5), &Beam::Lensless).log_odds,
            0.0
        );
    }

    #[test]
    fn what_was_put_there_a_moment_ago_is_believed_after_some_seconds() {
        let after = |seconds: f64| log_odds(THING, [blocks(20.0, &[]), blocks(seconds, &SEEN)].concat());
        assert!(after(0.3) < -4.0 && after(3.0) > 0.0, "{} {}", after(0.3), after(3.0));
    }

    #[test]
    fn what_is_gone_is_not_vouched_for_by_what_was_there() {
        let (settings, beam, mut past) = (BlockSettings::default(), Beam::Lensless, Past::default());
        let left = blocks(3.0, &SEEN);
        let views: Vec<_> = left.iter().map(view_of_thing).collect();
        left.iter().for_each(|block| past.take(block));
        let says = |past: &Past| past.says(THING, &views, (&settings, settings.min_cos(&beam)), &beam);
        let before = says(&past);
        assert!(before.log_odds > 5.0 && before.telling > 3 && before.information.x_axis.x > 0.0);
        past.is_gone(NOTHING + DVec3::X, left[left.len() - 1].mid_time_ns);
        assert_eq!(says(&past).telling, before.telling, "something else is gone");
        past.is_gone(THING + DVec3::X * 0.2, left[left.len() / 2].mid_time_ns);
        let after = says(&past);
        assert!(after.telling > 0 && after.telling < before.telling, "{} {}", after.telling, before.telling);
    }

    #[test]
    fn a_block_for_places_says_what_the_block_said() {
        for block in blocks(0.5, &SEEN) {
            let relative = (THING - block.middle.translation).as_vec3().to_array();
            let said = block.coherence_at_points(&[relative])[0];
            let other = PlaceBlock::of(&blocks(0.3, &[])[0], None);
            assert_eq!(PlaceBlock::of(&block, Some(other)).coherence_at(THING), said);
        }
    }
}
