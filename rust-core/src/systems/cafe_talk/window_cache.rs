//! Caches the sampled windows of a take: when one event changes, only the windows that contain it
//! are sampled again.

use std::{collections::VecDeque, sync::Mutex};

use ndarray::Array2;

use crate::{Result, cache::CacheKey};

/// The [`CacheKey::digest`] of everything that a window depends on.
type Digest = [u8; 32];

/// The most windows in the cache: about forty minutes of speech, at 51 kB a window.
const MOST: usize = 256;

/// The latest windows by their keys.
#[derive(Debug, Default)]
pub struct WindowCache {
    windows: Mutex<VecDeque<(Digest, Array2<f32>)>>,
}

impl WindowCache {
    /// The window of this key, `[T, 51]`. Calls `make` if it is not in the cache.
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
        let window = make()?;
        let mut windows = self
            .windows
            .lock()
            .unwrap_or_else(|poisoned| poisoned.into_inner());
        windows.push_back((key, window.clone()));
        while windows.len() > MOST {
            windows.pop_front();
        }
        Ok(window)
    }

    fn find(&self, key: &Digest) -> Option<Array2<f32>> {
        let windows = self
            .windows
            .lock()
            .unwrap_or_else(|poisoned| poisoned.into_inner());
        let entry = windows.iter().find(|(known, _)| known == key);
        entry.map(|(_, window)| window.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_is_made_once_and_old_ones_are_forgotten() {
        let cache = WindowCache::default();
        let key = |n: usize| CacheKey::new("test", 1).text(&n.to_string());
        let mut count = 0;
        let mut ask = |n: usize| {
            let window = cache.get_or_make(&key(n), || {
                count += 1;
                Ok(Array2::from_elem((2, 1), n as f32))
            });
            assert_eq!(window.unwrap()[[0, 0]], n as f32);
        };
        ask(7);
        ask(7);
        (100..100 + MOST).for_each(&mut ask);
        ask(7);
        assert_eq!(count, MOST + 2);
    }
}
