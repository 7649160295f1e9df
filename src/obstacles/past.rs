//! What was seen at a place before the window: some of the blocks that have left it, for most of a minute.
//!
//! An artefact of the last seconds' movement stands where the beam has been before and nothing was; a weak thing was seen a little each
//! time. A place that is newly believed is therefore asked of the past: had a thing of this strength been there, some blocks should
//! have seen it. Things are moved, so the past is evidence among other evidence and no proof.

use std::collections::VecDeque;

use glam::DVec3;

use super::views::View;
use crate::imaging::blocks::{Block, BlockSettings, PlaceBlock};
use crate::radar::Beam;

/// One block of so many is kept.
const EVERY: u64 = 3;
/// So many are kept: 50 s of preset d16.
const KEPT: usize = 190;
/// How sure it is that a block sees a thing that is there: most things return into some directions only.
const SURELY: f64 = 0.5;
/// Greatest that one block adds to the log odds.
const MOST_A_BLOCK: f64 = 1.0;

/// Blocks that have left the window.
#[derive(Debug, Default)]
pub(super) struct Past {
    blocks: VecDeque<PlaceBlock>,
    left: u64,
}

impl Past {
    /// A block leaves the window.
    pub fn take(&mut self, block: Block) {
        self.left += 1;
        if !self.left.is_multiple_of(EVERY) {
            return;
        }
        if self.blocks.len() == KEPT {
            self.blocks.pop_front();
        }
        self.blocks.push_back(PlaceBlock::of(block));
    }

    /// How much likelier the past makes it that something is at a place which returns what these views of the window say, log odds; 0 where
    /// they say nothing.
    pub fn log_odds(
        &self,
        place: DVec3,
        views: &[Option<View>],
        (settings, min_cos): (&BlockSettings, f64),
        beam: &Beam,
    ) -> f64 {
        let Some(strength) = strength(views) else { return 0.0 };
        let that_see_it = self.blocks.iter().filter(|block| settings.sees(block.middle(), min_cos, place));
        let of_block = |block: &PlaceBlock| {
            let range_m = block.distance_m(place);
            let toward = (place - block.middle().translation) / range_m.max(1e-9);
            let seen_from = (block.middle(), block.motion());
            let ratio =
                View::new(seen_from, block.coherence_at(place), range_m, toward, beam).likelihood_ratio(strength);
            (SURELY * ratio + 1.0 - SURELY).ln().min(MOST_A_BLOCK)
        };
        that_see_it.map(of_block).sum()
    }
}

/// What a thing returns at 1 m on the axis, over the noise: the geometric mean of what telling views say.
fn strength(views: &[Option<View>]) -> Option<f64> {
    let logs = || views.iter().flatten().filter_map(|view| view.ln_strength);
    let count = logs().count();
    (count > 0).then(|| (logs().sum::<f64>() / count as f64).exp())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::blocks::BlockBuilder;
    use crate::imaging::test_data::{Echo, sweeps, winding};

    const THING: DVec3 = DVec3::new(0.2, 0.1, -1.2);
    const NOTHING: DVec3 = DVec3::new(-0.4, -0.1, -1.4);

    /// What the past says of a thing of the strength of what is at `THING`, at a place.
    fn log_odds(place: DVec3, duration_s: f64) -> f64 {
        let (settings, beam, mut past) = (BlockSettings::default(), Beam::Lensless, Past::default());
        let mut builder = BlockBuilder::new(settings);
        let echoes = [(Echo::Point(THING), 2.0)];
        let blocks: Vec<_> =
            sweeps(duration_s, winding, &echoes, 3).into_iter().filter_map(|o| builder.push(o)).collect();
        let view = |block: &Block| {
            let range_m = block.distance_m(THING);
            let toward = (THING - block.middle.translation) / range_m;
            let coherence = PlaceBlock::of(block.clone()).coherence_at(THING);
            View::new((&block.middle, block.motion), coherence, range_m, toward, &beam)
        };
        let views: Vec<_> = blocks.iter().map(|block| Some(view(block))).collect();
        blocks.into_iter().for_each(|block| past.take(block));
        assert!(past.blocks.len() <= KEPT);
        past.log_odds(place, &views, (&settings, settings.min_cos(&beam)), &beam)
    }

    #[test]
    fn the_past_speaks_for_what_was_there_and_against_what_was_not() {
        let (thing, nothing) = (log_odds(THING, 3.0), log_odds(NOTHING, 3.0));
        assert!(thing > 5.0 && nothing < -4.0, "{thing} {nothing}");
        let behind = log_odds(DVec3::new(0.0, 0.0, 1.5), 3.0);
        assert_eq!(behind, 0.0, "where nobody looked");
        assert_eq!(Past::default().log_odds(THING, &[None], (&BlockSettings::default(), 0.5), &Beam::Lensless), 0.0);
    }

    #[test]
    fn a_block_for_places_says_what_the_block_said() {
        let mut builder = BlockBuilder::new(BlockSettings::default());
        let echoes = [(Echo::Point(THING), 2.0)];
        let blocks = sweeps(0.5, winding, &echoes, 3).into_iter().filter_map(|o| builder.push(o));
        for block in blocks {
            let relative = (THING - block.middle.translation).as_vec3().to_array();
            let said = block.coherence_at_points(&[relative])[0];
            assert_eq!(PlaceBlock::of(block).coherence_at(THING), said);
        }
    }
}
