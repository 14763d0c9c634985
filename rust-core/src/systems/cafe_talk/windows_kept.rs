//! Windows of a take that were sampled before: moving one event makes only those anew that it touches.

use std::{collections::VecDeque, sync::Mutex};

use ndarray::Array2;

use crate::{Result, cache::CacheKey};

/// [`CacheKey::digest`] of all that a window depends on.
type Digest = [u8; 32];

/// Windows that are remembered: some forty minutes of speech, 51 kB each.
const MOST: usize = 256;

/// The latest windows by what they depend on.
#[derive(Debug, Default)]
pub struct WindowsKept {
    kept: Mutex<VecDeque<(Digest, Array2<f32>)>>,
}

impl WindowsKept {
    /// The window of this key, `[T, 51]`, made if it is not known.
    ///
    /// # Errors
    /// Those of `make`.
    pub fn get_or_make(
        &self,
        key: &CacheKey,
        make: impl FnOnce() -> Result<Array2<f32>>,
    ) -> Result<Array2<f32>> {
        let key = key.digest();
        if let Some(known) = self.find(&key) {
            return Ok(known);
        }
        let made = make()?;
        let mut kept = self
            .kept
            .lock()
            .unwrap_or_else(|poisoned| poisoned.into_inner());
        kept.push_back((key, made.clone()));
        while kept.len() > MOST {
            kept.pop_front();
        }
        Ok(made)
    }

    fn find(&self, key: &Digest) -> Option<Array2<f32>> {
        let kept = self
            .kept
            .lock()
            .unwrap_or_else(|poisoned| poisoned.into_inner());
        let found = kept.iter().find(|(known, _)| known == key);
        found.map(|(_, window)| window.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_is_made_once_and_old_ones_are_forgotten() {
        let kept = WindowsKept::default();
        let key = |n: usize| CacheKey::new("test", 1).text(&n.to_string());
        let mut made = 0;
        let mut ask = |n: usize| {
            let window = kept.get_or_make(&key(n), || {
                made += 1;
                Ok(Array2::from_elem((2, 1), n as f32))
            });
            assert_eq!(window.unwrap()[[0, 0]], n as f32);
        };
        ask(7);
        ask(7);
        (100..100 + MOST).for_each(&mut ask);
        ask(7);
        assert_eq!(made, MOST + 2);
    }
}
