//! Gradient boosting of trees for two classes (Friedman 2001, Annals of Statistics 29:1189), with second derivatives of the logistic loss
//! (Chen and Guestrin 2016, KDD, eq. 7): a tree grows where a question gains most, until it has its leaves; each leaf takes a shortened
//! Newton step. Splits are searched exactly, ties go to the first feature and the lower bound, so the same rows give the same trees on any
//! number of threads.

use rayon::prelude::*;

use crate::math;

/// A labelled row of features, none of them NaN.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Row<const N: usize> {
    pub features: [f64; N],
    pub is_thing: bool,
    pub weight: f64,
}

/// Whether a feature is above a bound, and where to go on, below and above: a question's number, or `!` a leaf's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Question {
    pub feature: usize,
    pub bound: f64,
    pub then: [isize; 2],
}

/// Questions, the first one first, and what each leaf adds to the log odds.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Fitted {
    pub questions: Vec<Question>,
    pub leaves: Vec<f64>,
}

/// How trees are fitted.
#[derive(Debug, Clone, Copy)]
pub(super) struct BoostSettings {
    pub trees: usize,
    /// Leaves of a tree at most.
    pub leaves: usize,
    /// A leaf takes so much of its step.
    pub share: f64,
    /// Rows that a leaf has at least.
    pub least_rows: usize,
    /// Added to a leaf's curvature: what few rows say counts for less.
    pub damping: f64,
}

/// Log odds before any question, and the trees.
pub(super) fn boost<const N: usize>(rows: &[Row<N>], settings: &BoostSettings) -> (f64, Vec<Fitted>) {
    let total: f64 = rows.iter().map(|row| row.weight).sum();
    let things: f64 = rows.iter().filter(|row| row.is_thing).map(|row| row.weight).sum();
    let prior = math::ln(things / (total - things));
    if !prior.is_finite() {
        return (prior, Vec::new());
    }
    let rising = rising(rows);
    let mut odds = vec![prior; rows.len()];
    let mut trees = Vec::new();
    for _ in 0..settings.trees {
        let slopes = rows.iter().zip(&odds).map(|(row, odds)| Slope::of(row, *odds)).collect();
        let Some(tree) = (Fit { rows, slopes, settings }).tree(&rising) else { break };
        odds.iter_mut().zip(rows).for_each(|(odds, row)| *odds += tree.adds(&row.features));
        trees.push(tree);
    }
    (prior, trees)
}

impl Fitted {
    /// What the tree adds to the log odds.
    pub fn adds<const N: usize>(&self, features: &[f64; N]) -> f64 {
        let mut at = 0;
        while at >= 0 {
            let question = &self.questions[at as usize];
            at = question.then[usize::from(features[question.feature] > question.bound)];
        }
        self.leaves[!at as usize]
    }

    fn set(&mut self, of: Option<(usize, usize)>, then: isize) {
        if let Some((question, side)) = of {
            self.questions[question].then[side] = then;
        }
    }
}

/// Numbers of the rows by each feature, rising.
fn rising<const N: usize>(rows: &[Row<N>]) -> Vec<Vec<u32>> {
    let by = |feature: usize| {
        let mut order: Vec<u32> = (0..rows.len() as u32).collect();
        order.sort_by(|&a, &b| rows[a as usize].features[feature].total_cmp(&rows[b as usize].features[feature]));
        order
    };
    (0..N).map(by).collect()
}

/// First derivative of the likelihood by the log odds, and the second's magnitude; sums of them.
#[derive(Debug, Clone, Copy, Default)]
struct Slope {
    gradient: f64,
    curvature: f64,
}

impl Slope {
    fn of<const N: usize>(row: &Row<N>, odds: f64) -> Self {
        let likely = 1.0 / (1.0 + math::exp(-odds));
        let left = f64::from(u8::from(row.is_thing)) - likely;
        Self { gradient: row.weight * left, curvature: row.weight * likely * (1.0 - likely) }
    }

    fn and(self, other: Self) -> Self {
        Self { gradient: self.gradient + other.gradient, curvature: self.curvature + other.curvature }
    }

    fn without(self, other: Self) -> Self {
        Self { gradient: self.gradient - other.gradient, curvature: self.curvature - other.curvature }
    }

    /// Twice what the best step gains.
    fn gain(self, damping: f64) -> f64 {
        self.gradient.powi(2) / (self.curvature + damping)
    }
}

/// A leaf that may be divided: its rows by each feature, whose side of which question it is, and the best question.
struct Leaf {
    rising: Vec<Vec<u32>>,
    of: Option<(usize, usize)>,
    sum: Slope,
    best: Option<(f64, (usize, f64))>,
}

struct Fit<'r, const N: usize> {
    rows: &'r [Row<N>],
    slopes: Vec<Slope>,
    settings: &'r BoostSettings,
}

impl<const N: usize> Fit<'_, N> {
    /// The next tree; `None` when nothing can be divided.
    fn tree(&self, rising: &[Vec<u32>]) -> Option<Fitted> {
        let mut tree = Fitted::default();
        let mut open = vec![self.leaf(rising.to_vec(), None)];
        while open.len() < self.settings.leaves {
            let gain = |leaf: &Leaf| leaf.best.map_or(0.0, |(gain, _)| gain);
            let most = (0..open.len()).max_by(|&a, &b| gain(&open[a]).total_cmp(&gain(&open[b])).then(b.cmp(&a)))?;
            let Some((_, by)) = open[most].best else { break };
            let leaf = open.swap_remove(most);
            let number = tree.questions.len();
            tree.set(leaf.of, number as isize);
            tree.questions.push(Question { feature: by.0, bound: by.1, then: [0; 2] });
            for (side, above) in [false, true].into_iter().enumerate() {
                open.push(self.leaf(self.side(&leaf.rising, by, above), Some((number, side))));
            }
        }
        for leaf in &open {
            let number = tree.leaves.len();
            tree.set(leaf.of, !(number as isize));
            let sum = leaf.sum;
            tree.leaves.push(self.settings.share * sum.gradient / (sum.curvature + self.settings.damping).max(1e-9));
        }
        (!tree.questions.is_empty()).then_some(tree)
    }

    fn leaf(&self, rising: Vec<Vec<u32>>, of: Option<(usize, usize)>) -> Leaf {
        let slopes = rising.first().into_iter().flatten().map(|&n| self.slopes[n as usize]);
        let sum = slopes.fold(Slope::default(), Slope::and);
        let splits: Vec<_> =
            rising.par_iter().enumerate().map(|(feature, order)| self.split(feature, order, sum)).collect();
        let better = |best: Option<(f64, _)>, split: Option<(f64, _)>| match (best, split) {
            (Some(best), Some(split)) if split.0 <= best.0 => Some(best),
            (best, split) => split.or(best),
        };
        let best = splits.into_iter().fold(None, better);
        Leaf { rising, of, sum, best }
    }

    /// Those of the rows that are below or above a bound, by each feature.
    fn side(&self, rising: &[Vec<u32>], (feature, bound): (usize, f64), above: bool) -> Vec<Vec<u32>> {
        let is_there = |n: &u32| (self.rows[*n as usize].features[feature] > bound) == above;
        rising.par_iter().map(|order| order.iter().copied().filter(is_there).collect()).collect()
    }

    /// The bound on a feature that gains most, and how much.
    fn split(&self, feature: usize, order: &[u32], sum: Slope) -> Option<(f64, (usize, f64))> {
        let BoostSettings { damping, least_rows, .. } = *self.settings;
        let (whole, mut below) = (sum.gain(damping), Slope::default());
        let mut best: Option<(f64, (usize, f64))> = None;
        for (k, pair) in order.windows(2).enumerate() {
            below = below.and(self.slopes[pair[0] as usize]);
            let [low, high] = [0, 1].map(|n: usize| self.rows[pair[n] as usize].features[feature]);
            let rows_below = k + 1;
            if low >= high || rows_below < least_rows || order.len() - rows_below < least_rows {
                continue;
            }
            let gain = below.gain(damping) + sum.without(below).gain(damping) - whole;
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

    const SETTINGS: BoostSettings = BoostSettings { trees: 60, leaves: 4, share: 0.2, least_rows: 5, damping: 0.1 };

    fn odds(prior: f64, trees: &[Fitted], features: &[f64; 2]) -> f64 {
        prior + trees.iter().map(|tree| tree.adds(features)).sum::<f64>()
    }

    /// What neither feature tells alone.
    fn checkered() -> Vec<Row<2>> {
        let place = |n: usize| [(n % 20) as f64 / 10.0 - 0.95, (n / 20) as f64 / 10.0 - 0.9];
        (0..380)
            .map(place)
            .map(|features| Row { features, is_thing: features[0] * features[1] > 0.0, weight: 1.0 })
            .collect()
    }

    #[test]
    fn what_two_questions_tell_is_learned() {
        let rows = checkered();
        let (prior, trees) = boost(&rows, &SETTINGS);
        let right = rows.iter().filter(|row| (odds(prior, &trees, &row.features) > 0.0) == row.is_thing).count();
        assert!(right * 100 > rows.len() * 95, "{right} of {}", rows.len());
        assert_eq!(boost(&rows, &SETTINGS).1, trees);
    }

    #[test]
    fn a_tree_has_as_many_leaves_as_it_may_each_with_its_rows() {
        let rows = checkered();
        for leaves in [2, 5, 9] {
            let (_, trees) = boost(&rows, &BoostSettings { leaves, trees: 5, ..SETTINGS });
            for tree in trees {
                assert!(tree.leaves.len() <= leaves && tree.questions.len() + 1 == tree.leaves.len());
                for leaf in &tree.leaves {
                    let count = rows.iter().filter(|row| tree.adds(&row.features) == *leaf).count();
                    assert!(count >= SETTINGS.least_rows, "{count}");
                }
            }
        }
    }

    #[test]
    fn weights_move_the_prior_and_one_class_gives_no_trees() {
        let mut rows = checkered();
        let (even, _) = boost(&rows, &SETTINGS);
        rows.iter_mut().filter(|row| row.is_thing).for_each(|row| row.weight = 3.0);
        let (likely, _) = boost(&rows, &SETTINGS);
        assert!((likely - even - 3f64.ln()).abs() < 1e-9);
        rows.retain(|row| row.is_thing);
        assert!(boost(&rows, &SETTINGS).1.is_empty() && boost::<2>(&[], &SETTINGS).1.is_empty());
    }
}
