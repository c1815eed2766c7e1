//! Texts of models on their way into recordings: an entry names a model by its hash only.

use std::collections::VecDeque;
use std::sync::{Mutex, PoisonError};

/// Texts kept for the recorder; a switch that it has missed so many switches ago is of no use to anybody.
const KEPT: usize = 8;

/// A model file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct ModelText {
    pub(super) hash: [u8; 32],
    pub(super) path: String,
    pub(super) text: String,
}

/// The models that an engine may be given. Never locked by the cycle.
#[derive(Debug, Default)]
pub struct ModelTexts(Mutex<VecDeque<ModelText>>);

impl ModelTexts {
    /// Announces a model file before an engine is given its model; gives the hash that the recording knows it by.
    pub fn put(&self, path: &str, text: &str) -> [u8; 32] {
        let hash = *blake3::hash(text.as_bytes()).as_bytes();
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        kept.retain(|known| known.hash != hash);
        if kept.len() == KEPT {
            kept.pop_front();
        }
        kept.push_back(ModelText { hash, path: path.to_owned(), text: text.to_owned() });
        hash
    }

    pub(super) fn find(&self, hash: &[u8; 32]) -> Option<ModelText> {
        let kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        kept.iter().find(|known| known.hash == *hash).cloned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_are_kept_and_found_by_their_hash() {
        let texts = ModelTexts::default();
        let hashes: Vec<_> = (0..10).map(|k| texts.put("m.toml", &format!("model {k}"))).collect();
        assert_eq!(texts.find(&hashes[1]), None);
        assert_eq!(texts.find(&hashes[2]).map(|t| t.text), Some("model 2".to_owned()));
        assert_eq!(texts.put("again.toml", "model 2"), hashes[2]);
        assert_eq!(texts.find(&hashes[3]).map(|t| t.path), Some("m.toml".to_owned()));
        assert_eq!(texts.find(&hashes[2]).map(|t| t.path), Some("again.toml".to_owned()));
    }
}
