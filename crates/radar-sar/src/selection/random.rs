//! Random selection: the first steps of a Fisher–Yates shuffle.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// `count` of the numbers below `from`, all equally likely, in rising order; all when there are no
/// more.
pub fn random(from: usize, count: usize, seed: u64) -> Vec<usize> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut all: Vec<usize> = (0..from).collect();
    for n in 0..count.min(from) {
        let other = rng.random_range(n..from);
        all.swap(n, other);
    }
    all.truncate(count);
    all.sort_unstable();
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_is_as_likely_as_any() {
        let mut times = [0; 10];
        (0..2000).flat_map(|seed| random(10, 3, seed)).for_each(|n| times[n] += 1);
        // 600 times each, give or take 20.
        assert!(times.iter().all(|&t| (520..=680).contains(&t)), "{times:?}");
    }
}
