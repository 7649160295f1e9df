//! The classifier's model: gradient-boosted trees as a data file, checked when it is loaded.
//!
//! The file names its features in order and carries a hash of them. A model made for other features
//! is refused instead of giving wrong odds. Its card states the command and commit that made it,
//! its training worlds, and its score on held-out ones.

use std::sync::LazyLock;

use serde::{Deserialize, Serialize};

use super::FEATURES;

/// Version of the file's layout. A model file of another layout is refused.
const FORMAT: u32 = 1;

/// The model in use.
static EMBEDDED: LazyLock<Model> = LazyLock::new(|| {
    // The file is compiled in, and a test loads it.
    Model::from_json(include_str!("classifier.json")).expect("classifier.json is sound")
});

/// Gradient-boosted trees and their origin.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Model {
    format: u32,
    /// [`schema_hash`] of `features`.
    schema: String,
    features: Vec<String>,
    card: ModelCard,
    /// Log odds before the first split.
    prior: f64,
    trees: Vec<Tree>,
}

/// Origin and quality of a model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelCard {
    /// Command that trained it.
    pub command: String,
    /// Commit of the program that ran it; empty until it is known.
    pub commit: String,
    /// Training worlds.
    pub worlds: String,
    /// Training examples at real objects.
    pub things: usize,
    /// Training examples where nothing is.
    pub artefacts: usize,
    /// Score on worlds that it was not trained on; `None` until measured.
    #[serde(default)]
    pub held_out: Option<HeldOutScore>,
}

/// Score of a model on worlds that it was not trained on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeldOutScore {
    /// Command that measured it.
    pub command: String,
    /// Examples at real objects.
    pub things: usize,
    /// Examples where nothing is.
    pub artefacts: usize,
    /// Weighted mean of −ln(probability of the right class), nats; 0.693 for a coin.
    pub log_loss: f64,
    /// Area under the curve of detections against false alarms: 0.5 for chance, 1 for a perfect
    /// order.
    pub area_under_curve: f64,
}

/// A decision tree.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tree {
    /// Feature, bound, where to continue if the feature is not above the bound, and where if it is:
    /// the index of a later split, or `!` a leaf's.
    pub splits: Vec<(u8, f32, i16, i16)>,
    /// Log odds.
    pub leaves: Vec<f32>,
}

/// Why a model is refused.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// Not JSON, or other fields.
    #[error("the classifier's model cannot be read: {0}")]
    Json(#[from] serde_json::Error),
    /// A later layout.
    #[error("the classifier's model has format {0}, this program reads {FORMAT}: train it with this version")]
    Format(u32),
    /// Other features, or in another order.
    #[error(
        "the classifier's model is for the features with hash {found}, this program computes those with {expected}: train \
         it with this version"
    )]
    Schema {
        /// Of the file.
        found: String,
        /// Of [`FEATURES`].
        expected: String,
    },
    /// A split without a feature, a later split or a leaf, or with a number that is not finite.
    #[error("tree {tree} of the classifier's model is broken at split {split}")]
    Split {
        /// Index of the tree.
        tree: usize,
        /// Index of the split in it.
        split: usize,
    },
    /// A leaf that is not finite, or a tree without leaves.
    #[error("tree {0} of the classifier's model has no leaves, or one that is not finite")]
    Leaf(usize),
}

/// Plain strings, numbers and lists always convert to JSON.
fn json(value: &impl Serialize) -> String {
    serde_json::to_string(value).expect("plain data")
}

/// FNV-1a (64 bits) of the names, each followed by a line feed, in hexadecimal.
fn schema_hash<'a>(features: impl IntoIterator<Item = &'a str>) -> String {
    let bytes = features.into_iter().flat_map(|name| name.bytes().chain([b'\n']));
    let hash =
        bytes.fold(0xcbf2_9ce4_8422_2325u64, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3));
    format!("{hash:016x}")
}

impl Model {
    /// The model that is compiled into the program.
    pub fn embedded() -> &'static Self {
        &EMBEDDED
    }

    /// Of trees for [`FEATURES`].
    pub fn new(prior: f64, trees: Vec<Tree>, card: ModelCard) -> Self {
        let features = FEATURES.map(String::from).to_vec();
        Self { format: FORMAT, schema: schema_hash(FEATURES), features, card, prior, trees }
    }

    /// Reads and checks a model.
    ///
    /// # Errors
    /// It is not for [`FEATURES`] in their order, or a tree is invalid.
    pub fn from_json(text: &str) -> Result<Self, ModelError> {
        let model: Self = serde_json::from_str(text)?;
        if model.format != FORMAT {
            return Err(ModelError::Format(model.format));
        }
        let (found, expected) = (schema_hash(model.features.iter().map(String::as_str)), schema_hash(FEATURES));
        if found != expected || model.schema != expected {
            let found = if found == expected { model.schema } else { found };
            return Err(ModelError::Schema { found, expected });
        }
        for (number, tree) in model.trees.iter().enumerate() {
            tree.check(number)?;
        }
        Ok(model)
    }

    /// The model as its file: one tree a line.
    pub fn to_json(&self) -> String {
        let list = |lines: Vec<String>| lines.join(",\n");
        format!(
            "{{\n  \"format\": {},\n  \"schema\": {},\n  \"features\": [\n{}\n  ],\n  \"card\": {},\n  \"prior\": {},\n  \
             \"trees\": [\n{}\n  ]\n}}\n",
            self.format,
            json(&self.schema),
            list(self.features.iter().map(|name| format!("    {}", json(name))).collect()),
            json(&self.card),
            json(&self.prior),
            list(self.trees.iter().map(|tree| format!("    {}", json(tree))).collect()),
        )
    }

    /// Its origin.
    pub fn card(&self) -> &ModelCard {
        &self.card
    }

    /// The same with a held-out score.
    #[must_use]
    pub fn with_held_out(mut self, score: HeldOutScore) -> Self {
        self.card.held_out = Some(score);
        self
    }

    /// Log odds of a real object; 0 is even.
    pub fn log_odds(&self, features: &[f64; FEATURES.len()]) -> f64 {
        self.prior + self.trees.iter().map(|tree| tree.log_odds(features)).sum::<f64>()
    }
}

impl Tree {
    fn log_odds(&self, features: &[f64; FEATURES.len()]) -> f64 {
        let mut at = 0;
        while at >= 0 {
            let (feature, bound, not_above, above) = self.splits[at as usize];
            at = if features[usize::from(feature)] > f64::from(bound) { above } else { not_above };
        }
        f64::from(self.leaves[!at as usize])
    }

    /// Every split leads to a later one or to a leaf, so each walk ends.
    fn check(&self, tree: usize) -> Result<(), ModelError> {
        if self.leaves.is_empty() || self.leaves.iter().any(|leaf| !leaf.is_finite()) {
            return Err(ModelError::Leaf(tree));
        }
        for (split, &(feature, bound, not_above, above)) in self.splits.iter().enumerate() {
            let is_there = |then: i16| match then {
                0.. => then as usize > split && (then as usize) < self.splits.len(),
                _ => (!then as usize) < self.leaves.len(),
            };
            let is_sound = usize::from(feature) < FEATURES.len() && bound.is_finite();
            if !is_sound || !is_there(not_above) || !is_there(above) {
                return Err(ModelError::Split { tree, split });
            }
        }
        // A tree needs at least one split to start from.
        if self.splits.is_empty() { Err(ModelError::Split { tree, split: 0 }) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const EMBEDDED_TEXT: &str = include_str!("classifier.json");

    #[test]
    fn embedded_model_is_valid_and_round_trips() {
        let model = Model::from_json(EMBEDDED_TEXT).unwrap();
        assert!(model.prior.is_finite() && model.trees.len() > 100);
        assert!(model.trees.iter().flat_map(|tree| &tree.leaves).all(|odds| odds.abs() < 2.0));
        assert_eq!(Model::from_json(&model.to_json()).unwrap(), model);
        assert!(model.card.held_out.is_some(), "its held-out score is in its card");
    }

    #[test]
    fn a_model_with_two_features_swapped_is_refused() {
        let mut swapped = Model::from_json(EMBEDDED_TEXT).unwrap();
        swapped.features.swap(3, 4);
        assert!(matches!(Model::from_json(&swapped.to_json()), Err(ModelError::Schema { .. })));
        // A hash made to fit does not help.
        swapped.schema = schema_hash(swapped.features.iter().map(String::as_str));
        assert!(matches!(Model::from_json(&swapped.to_json()), Err(ModelError::Schema { .. })));
        let mut forged = Model::from_json(EMBEDDED_TEXT).unwrap();
        forged.schema = "0000000000000000".into();
        assert!(matches!(Model::from_json(&forged.to_json()), Err(ModelError::Schema { .. })));
    }

    #[test]
    fn broken_trees_and_other_files_are_refused() {
        let sound = Model::from_json(EMBEDDED_TEXT).unwrap();
        let with = |change: &dyn Fn(&mut Model)| {
            let mut model = sound.clone();
            change(&mut model);
            Model::from_json(&model.to_json())
        };
        // A split that leads back would never end.
        assert!(matches!(with(&|m| m.trees[5].splits[2].2 = 1), Err(ModelError::Split { tree: 5, split: 2 })));
        assert!(matches!(with(&|m| m.trees[0].splits[0].0 = 27), Err(ModelError::Split { tree: 0, split: 0 })));
        assert!(matches!(with(&|m| m.trees[0].splits[1].3 = -99), Err(ModelError::Split { tree: 0, split: 1 })));
        assert!(matches!(with(&|m| m.trees[7].leaves.clear()), Err(ModelError::Leaf(7))));
        assert!(matches!(with(&|m| m.trees[7].splits.clear()), Err(ModelError::Split { tree: 7, split: 0 })));
        assert!(matches!(with(&|m| m.format = 2), Err(ModelError::Format(2))));
        assert!(matches!(Model::from_json("{}"), Err(ModelError::Json(_))));
    }
}
