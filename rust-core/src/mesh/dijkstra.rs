//! The queue of Dijkstra's search for shortest paths over a mesh.

use std::cmp::Ordering;

/// The length of a path, its last vertex, and further data that the search keeps about the path.
///
/// The entry with the shortest path is the greatest, so that a `BinaryHeap` returns the nearest
/// vertex first. Among equally near vertices, it returns the one with the smallest number.
pub(crate) struct QueueEntry<T = ()>(pub f32, pub u32, pub T);

impl<T> Ord for QueueEntry<T> {
    fn cmp(&self, other: &Self) -> Ordering {
        let nearer = other.0.total_cmp(&self.0);
        nearer.then_with(|| other.1.cmp(&self.1))
    }
}

impl<T> PartialOrd for QueueEntry<T> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl<T> PartialEq for QueueEntry<T> {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl<T> Eq for QueueEntry<T> {}
