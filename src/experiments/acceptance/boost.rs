//! Gradient boosting of trees of depth two for two classes (Friedman 2001, Annals of Statistics 29:1189): each tree is fitted by least
//! squares to what is left of the labels, its leaves then take a Newton step of the logistic loss, shortened. Splits are searched
//! exactly, ties go to the first feature and the lower bound, so the same rows give the same trees.

/// A labelled row of features.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Row<const N: usize> {
    pub features: [f64; N],
    pub is_thing: bool,
    pub weight: f64,
}

/// Two questions and what the answers add.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Fitted {
    /// Feature and bound; above it is the second side.
    pub by: (usize, f64),
    /// The same on each side.
    pub then: [(usize, f64); 2],
    /// What each leaf adds to the log odds.
    pub odds: [f64; 4],
}

/// How trees are fitted.
#[derive(Debug, Clone, Copy)]
pub(super) struct BoostSettings {
    pub trees: usize,
    /// A leaf takes so much of its step.
    pub share: f64,
    /// Rows that a leaf has at least.
    pub least_rows: usize,
}

/// Log odds before any question, and the trees.
pub(super) fn boost<const N: usize>(rows: &[Row<N>], settings: &BoostSettings) -> (f64, Vec<Fitted>) {
    let total: f64 = rows.iter().map(|row| row.weight).sum();
    let things: f64 = rows.iter().filter(|row| row.is_thing).map(|row| row.weight).sum();
    let prior = (things / (total - things)).ln();
    if !prior.is_finite() {
        return (prior, Vec::new());
    }
    let fit = Fit { rows, rising: rising(rows), settings };
    let mut odds = vec![prior; rows.len()];
    let mut trees = Vec::new();
    for _ in 0..settings.trees {
        let Some(tree) = fit.tree(&odds) else { break };
        odds.iter_mut().zip(rows).for_each(|(odds, row)| *odds += tree.odds[tree.leaf(&row.features)]);
        trees.push(tree);
    }
    (prior, trees)
}

impl Fitted {
    pub fn leaf<const N: usize>(&self, features: &[f64; N]) -> usize {
        let side = usize::from(features[self.by.0] > self.by.1);
        2 * side + usize::from(features[self.then[side].0] > self.then[side].1)
    }
}

/// Numbers of the rows by each feature, rising.
fn rising<const N: usize>(rows: &[Row<N>]) -> Vec<Vec<usize>> {
    let by = |feature: usize| {
        let mut order: Vec<usize> = (0..rows.len()).collect();
        order.sort_by(|&a, &b| rows[a].features[feature].total_cmp(&rows[b].features[feature]));
        order
    };
    (0..N).map(by).collect()
}

struct Fit<'r, const N: usize> {
    rows: &'r [Row<N>],
    rising: Vec<Vec<usize>>,
    settings: &'r BoostSettings,
}

impl<const N: usize> Fit<'_, N> {
    /// The next tree; `None` when nothing can be divided.
    fn tree(&self, odds: &[f64]) -> Option<Fitted> {
        let likely: Vec<f64> = odds.iter().map(|odds| 1.0 / (1.0 + (-odds).exp())).collect();
        let left: Vec<f64> =
            self.rows.iter().zip(&likely).map(|(row, p)| f64::from(u8::from(row.is_thing)) - p).collect();
        let all = vec![true; self.rows.len()];
        let by = self.split(&left, &all)?;
        let sides = [false, true].map(|above| self.side(&all, by, above));
        // A side that cannot be divided is one leaf, twice.
        let then = [0, 1].map(|side| self.split(&left, &sides[side]).unwrap_or(by));
        let leaf = |n: usize| {
            let within = self.side(&sides[n / 2], then[n / 2], n % 2 == 1);
            self.step(&left, &likely, &within)
        };
        Some(Fitted { by, then, odds: [0, 1, 2, 3].map(leaf) })
    }

    /// The rows of `within` below or above a bound.
    fn side(&self, within: &[bool], (feature, bound): (usize, f64), above: bool) -> Vec<bool> {
        let is_there = |(row, within): (&Row<N>, &bool)| *within && (row.features[feature] > bound) == above;
        self.rows.iter().zip(within).map(is_there).collect()
    }

    /// A leaf's shortened Newton step.
    fn step(&self, left: &[f64], likely: &[f64], within: &[bool]) -> f64 {
        let (mut gradient, mut curvature) = (0.0, 0.0);
        for n in (0..self.rows.len()).filter(|&n| within[n]) {
            gradient += self.rows[n].weight * left[n];
            curvature += self.rows[n].weight * likely[n] * (1.0 - likely[n]);
        }
        if curvature > 1e-9 { self.settings.share * gradient / curvature } else { 0.0 }
    }

    /// The split that leaves the least squares.
    fn split(&self, left: &[f64], within: &[bool]) -> Option<(usize, f64)> {
        let mut best: Option<(f64, (usize, f64))> = None;
        for (feature, order) in self.rising.iter().enumerate() {
            let order: Vec<usize> = order.iter().copied().filter(|&n| within[n]).collect();
            let weight: f64 = order.iter().map(|&n| self.rows[n].weight).sum();
            let sum: f64 = order.iter().map(|&n| self.rows[n].weight * left[n]).sum();
            let (mut weight_below, mut sum_below) = (0.0, 0.0);
            for (k, pair) in order.windows(2).enumerate() {
                let row = &self.rows[pair[0]];
                weight_below += row.weight;
                sum_below += row.weight * left[pair[0]];
                let [low, high] = [row.features[feature], self.rows[pair[1]].features[feature]];
                let rows_below = k + 1;
                let is_leaf = |rows: usize| rows >= self.settings.least_rows;
                if low >= high || !is_leaf(rows_below) || !is_leaf(order.len() - rows_below) {
                    continue;
                }
                let above = (sum - sum_below).powi(2) / (weight - weight_below);
                let gain = sum_below.powi(2) / weight_below + above - sum.powi(2) / weight;
                if best.is_none_or(|(most, _)| gain > most) {
                    best = Some((gain, (feature, 0.5 * (low + high))));
                }
            }
        }
        best.filter(|(gain, _)| *gain > 0.0).map(|(_, by)| by)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SETTINGS: BoostSettings = BoostSettings { trees: 60, share: 0.2, least_rows: 5 };

    fn odds(prior: f64, trees: &[Fitted], features: &[f64; 2]) -> f64 {
        prior + trees.iter().map(|tree| tree.odds[tree.leaf(features)]).sum::<f64>()
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
