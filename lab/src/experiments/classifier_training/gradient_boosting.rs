//! Gradient-boosted trees for two classes (Friedman 2001, Annals of Statistics 29:1189), with
//! second derivatives of the logistic loss (Chen and Guestrin 2016, KDD, eq. 7).
//!
//! Each tree grows best first: the split with the greatest gain is made next, until the tree has
//! its number of leaves. Each leaf takes a Newton step times the learning rate. Splits are searched
//! exactly. Ties go to the first feature and the lower threshold, so equal rows give equal trees on
//! any number of threads.

use rayon::prelude::*;

use radar_sar::math;

/// One labelled feature vector; no feature is NaN.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct LabelledFeatures<const N: usize> {
    pub features: [f64; N],
    pub is_object: bool,
    /// Log odds that are added to those of the trees.
    pub added_log_odds: f64,
    pub weight: f64,
}

/// One split. `then` is the next node for values at or below the bound and for values above it: the
/// index of a split, or `!index` of a leaf.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Split {
    pub feature: usize,
    pub threshold: f64,
    pub children: [isize; 2],
}

/// One tree: its splits, root first, and the log odds that each leaf adds.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct FittedTree {
    pub splits: Vec<Split>,
    pub leaves: Vec<f64>,
}

/// Hyperparameters of the fit.
#[derive(Debug, Clone, Copy)]
pub(super) struct BoostSettings {
    pub trees: usize,
    /// Maximum number of leaves of a tree.
    pub leaves: usize,
    /// Learning rate: each leaf takes this share of its Newton step.
    pub learning_rate: f64,
    /// Minimum number of rows in a leaf.
    pub min_rows: usize,
    /// L2 regularisation, added to a leaf's curvature: leaves of few rows take smaller steps.
    pub l2_regularisation: f64,
}

/// Fits the prior log odds and the trees. Without rows of both classes the prior is not finite and
/// there are no trees.
pub(super) fn boost<const N: usize>(rows: &[LabelledFeatures<N>], settings: &BoostSettings) -> (f64, Vec<FittedTree>) {
    let total: f64 = rows.iter().map(|row| row.weight).sum();
    let objects: f64 = rows.iter().filter(|row| row.is_object).map(|row| row.weight).sum();
    let prior = math::ln(objects / (total - objects));
    if !prior.is_finite() {
        return (prior, Vec::new());
    }
    let sorted_rows = sorted_rows(rows);
    let mut odds: Vec<f64> = rows.iter().map(|row| prior + row.added_log_odds).collect();
    let mut trees = Vec::new();
    for _ in 0..settings.trees {
        let slopes = rows.iter().zip(&odds).map(|(row, odds)| GradientSums::of(row, *odds)).collect();
        let Some(tree) = (TreeFitter { rows, slopes, settings }).tree(&sorted_rows) else { break };
        odds.iter_mut().zip(rows).for_each(|(odds, row)| *odds += tree.log_odds(&row.features));
        trees.push(tree);
    }
    (prior, trees)
}

impl FittedTree {
    /// Log odds that the tree adds for these features.
    pub fn log_odds<const N: usize>(&self, features: &[f64; N]) -> f64 {
        let mut at = 0;
        while at >= 0 {
            let question = &self.splits[at as usize];
            at = question.children[usize::from(features[question.feature] > question.threshold)];
        }
        self.leaves[!at as usize]
    }

    fn set(&mut self, parent: Option<(usize, usize)>, then: isize) {
        if let Some((question, side)) = parent {
            self.splits[question].children[side] = then;
        }
    }
}

/// Row indices sorted by each feature, ascending.
fn sorted_rows<const N: usize>(rows: &[LabelledFeatures<N>]) -> Vec<Vec<u32>> {
    let by = |feature: usize| {
        let mut order: Vec<u32> = (0..rows.len() as u32).collect();
        order.sort_by(|&a, &b| rows[a as usize].features[feature].total_cmp(&rows[b as usize].features[feature]));
        order
    };
    (0..N).map(by).collect()
}

/// First derivative of the log likelihood by the log odds and magnitude of the second, for one row
/// or summed over rows.
#[derive(Debug, Clone, Copy, Default)]
struct GradientSums {
    gradient: f64,
    curvature: f64,
}

impl GradientSums {
    fn of<const N: usize>(row: &LabelledFeatures<N>, odds: f64) -> Self {
        let likely = 1.0 / (1.0 + math::exp(-odds));
        let left = f64::from(u8::from(row.is_object)) - likely;
        Self { gradient: row.weight * left, curvature: row.weight * likely * (1.0 - likely) }
    }

    fn plus(self, other: Self) -> Self {
        Self { gradient: self.gradient + other.gradient, curvature: self.curvature + other.curvature }
    }

    fn minus(self, other: Self) -> Self {
        Self { gradient: self.gradient - other.gradient, curvature: self.curvature - other.curvature }
    }

    /// Twice the gain in log likelihood of the best step.
    fn gain(self, l2_regularisation: f64) -> f64 {
        self.gradient.powi(2) / (self.curvature + l2_regularisation)
    }
}

/// A leaf that can still be split: its rows sorted by each feature, its parent split and side, and
/// its best split.
struct Leaf {
    sorted_rows: Vec<Vec<u32>>,
    parent: Option<(usize, usize)>,
    sum: GradientSums,
    best: Option<(f64, (usize, f64))>,
}

struct TreeFitter<'r, const N: usize> {
    rows: &'r [LabelledFeatures<N>],
    slopes: Vec<GradientSums>,
    settings: &'r BoostSettings,
}

impl<const N: usize> TreeFitter<'_, N> {
    /// Fits the next tree; `None` when nothing can be split.
    fn tree(&self, sorted_rows: &[Vec<u32>]) -> Option<FittedTree> {
        let mut tree = FittedTree::default();
        let mut open = vec![self.leaf(sorted_rows.to_vec(), None)];
        while open.len() < self.settings.leaves {
            let gain = |leaf: &Leaf| leaf.best.map_or(0.0, |(gain, _)| gain);
            let most = (0..open.len()).max_by(|&a, &b| gain(&open[a]).total_cmp(&gain(&open[b])).then(b.cmp(&a)))?;
            let Some((_, by)) = open[most].best else { break };
            let leaf = open.swap_remove(most);
            let number = tree.splits.len();
            tree.set(leaf.parent, number as isize);
            tree.splits.push(Split { feature: by.0, threshold: by.1, children: [0; 2] });
            for (side, above) in [false, true].into_iter().enumerate() {
                open.push(self.leaf(self.partition(&leaf.sorted_rows, by, above), Some((number, side))));
            }
        }
        for leaf in &open {
            let number = tree.leaves.len();
            tree.set(leaf.parent, !(number as isize));
            let sum = leaf.sum;
            tree.leaves.push(
                self.settings.learning_rate * sum.gradient
                    / (sum.curvature + self.settings.l2_regularisation).max(1e-9),
            );
        }
        (!tree.splits.is_empty()).then_some(tree)
    }

    fn leaf(&self, sorted_rows: Vec<Vec<u32>>, parent: Option<(usize, usize)>) -> Leaf {
        let slopes = sorted_rows.first().into_iter().flatten().map(|&n| self.slopes[n as usize]);
        let sum = slopes.fold(GradientSums::default(), GradientSums::plus);
        let splits: Vec<_> =
            sorted_rows.par_iter().enumerate().map(|(feature, order)| self.best_split(feature, order, sum)).collect();
        let better = |best: Option<(f64, _)>, split: Option<(f64, _)>| match (best, split) {
            (Some(best), Some(split)) if split.0 <= best.0 => Some(best),
            (best, split) => split.or(best),
        };
        let best = splits.into_iter().fold(None, better);
        Leaf { sorted_rows, parent, sum, best }
    }

    /// The rows at or below the bound, or above it, sorted by each feature.
    fn partition(&self, sorted_rows: &[Vec<u32>], (feature, threshold): (usize, f64), above: bool) -> Vec<Vec<u32>> {
        let is_there = |n: &u32| (self.rows[*n as usize].features[feature] > threshold) == above;
        sorted_rows.par_iter().map(|order| order.iter().copied().filter(is_there).collect()).collect()
    }

    /// The split of one feature with the greatest gain, and the gain.
    fn best_split(&self, feature: usize, order: &[u32], sum: GradientSums) -> Option<(f64, (usize, f64))> {
        let BoostSettings { l2_regularisation, min_rows, .. } = *self.settings;
        let (whole, mut below) = (sum.gain(l2_regularisation), GradientSums::default());
        let mut best: Option<(f64, (usize, f64))> = None;
        for (k, pair) in order.windows(2).enumerate() {
            below = below.plus(self.slopes[pair[0] as usize]);
            let [low, high] = [0, 1].map(|n: usize| self.rows[pair[n] as usize].features[feature]);
            let rows_below = k + 1;
            if low >= high || rows_below < min_rows || order.len() - rows_below < min_rows {
                continue;
            }
            let gain = below.gain(l2_regularisation) + sum.minus(below).gain(l2_regularisation) - whole;
            if gain > best.map_or(1e-9, |(most, _)| most) {
                best = Some((gain, (feature, 0.5 * (low + high))));
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SETTINGS: BoostSettings =
        BoostSettings { trees: 60, leaves: 4, learning_rate: 0.2, min_rows: 5, l2_regularisation: 0.1 };

    fn odds(prior: f64, trees: &[FittedTree], features: &[f64; 2]) -> f64 {
        prior + trees.iter().map(|tree| tree.log_odds(features)).sum::<f64>()
    }

    /// Labels that depend on both features together and on neither alone.
    fn checkerboard() -> Vec<LabelledFeatures<2>> {
        let point = |n: usize| [(n % 20) as f64 / 10.0 - 0.95, (n / 20) as f64 / 10.0 - 0.9];
        (0..380)
            .map(point)
            .map(|features| LabelledFeatures {
                features,
                is_object: features[0] * features[1] > 0.0,
                added_log_odds: 0.0,
                weight: 1.0,
            })
            .collect()
    }

    #[test]
    fn interaction_of_two_features_is_learned() {
        let rows = checkerboard();
        let (prior, trees) = boost(&rows, &SETTINGS);
        let right = rows.iter().filter(|row| (odds(prior, &trees, &row.features) > 0.0) == row.is_object).count();
        assert!(right * 100 > rows.len() * 95, "{right} of {}", rows.len());
        assert_eq!(boost(&rows, &SETTINGS).1, trees);
    }

    #[test]
    fn what_is_added_besides_is_not_learned() {
        let separated = |n: usize, added_log_odds: f64| LabelledFeatures {
            features: [f64::from(n < 100), 0.0],
            is_object: n < 100,
            added_log_odds: if n < 100 { added_log_odds } else { -added_log_odds },
            weight: 1.0,
        };
        let [alone, besides] = [0.0, 3.0].map(|added_log_odds| {
            let rows: Vec<_> = (0..200).map(|n| separated(n, added_log_odds)).collect();
            let (prior, trees) = boost(&rows, &SETTINGS);
            odds(prior, &trees, &[1.0, 0.0])
        });
        assert!(alone > 3.0 && (0.0..alone - 2.0).contains(&besides), "{alone} {besides}");
    }

    #[test]
    fn trees_respect_max_leaves_and_min_rows() {
        let rows = checkerboard();
        for leaves in [2, 5, 9] {
            let (_, trees) = boost(&rows, &BoostSettings { leaves, trees: 5, ..SETTINGS });
            for tree in trees {
                assert!(tree.leaves.len() <= leaves && tree.splits.len() + 1 == tree.leaves.len());
                for leaf in &tree.leaves {
                    let count = rows.iter().filter(|row| tree.log_odds(&row.features) == *leaf).count();
                    assert!(count >= SETTINGS.min_rows, "{count}");
                }
            }
        }
    }

    #[test]
    fn weights_shift_the_prior_and_a_single_class_gives_no_trees() {
        let mut rows = checkerboard();
        let (even, _) = boost(&rows, &SETTINGS);
        rows.iter_mut().filter(|row| row.is_object).for_each(|row| row.weight = 3.0);
        let (likely, _) = boost(&rows, &SETTINGS);
        assert!((likely - even - 3f64.ln()).abs() < 1e-9);
        rows.retain(|row| row.is_object);
        assert!(boost(&rows, &SETTINGS).1.is_empty() && boost::<2>(&[], &SETTINGS).1.is_empty());
    }
}
