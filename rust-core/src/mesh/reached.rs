//! A vertex in the queue of a search for shortest ways.

use std::cmp::Ordering;

/// A vertex reached by a way of some length, and what the search knows of the way. The greatest is
/// the one with the shortest way, so that a `BinaryHeap` gives the nearest first; of equally near
/// ones that with the smallest number.
pub(crate) struct Reached<T = ()>(pub f32, pub u32, pub T);

impl<T> Ord for Reached<T> {
    fn cmp(&self, other: &Self) -> Ordering {
        let nearer = other.0.total_cmp(&self.0);
        nearer.then_with(|| other.1.cmp(&self.1))
    }
}

impl<T> PartialOrd for Reached<T> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl<T> PartialEq for Reached<T> {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl<T> Eq for Reached<T> {}
