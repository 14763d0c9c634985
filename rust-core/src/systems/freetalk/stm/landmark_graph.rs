//! The graph of the 68 landmarks, and the encoding that tells each landmark from the others.

use ndarray::{Array1, Array2};

use crate::mesh::ibug::LANDMARKS;

/// The nine iBUG curves: first landmark, last landmark, and whether the curve is closed.
const CHAINS: [(usize, usize, bool); 9] = [
    (0, 16, false),
    (17, 21, false),
    (22, 26, false),
    (27, 30, false),
    (31, 35, false),
    (36, 41, true),
    (42, 47, true),
    (48, 59, true),
    (60, 67, true),
];

/// Edges between curves, so that the graph is connected and motion spreads to neighbouring curves.
#[rustfmt::skip]
const BRIDGES: [(usize, usize); 27] = [
    (0, 17), (16, 26), (17, 36), (26, 45), (21, 22), (21, 27), (22, 27), (21, 39), (22, 42),
    (27, 39), (27, 42), (30, 33), (31, 48), (33, 51), (35, 54), (48, 60), (54, 64), (51, 62),
    (57, 66), (62, 66), (8, 57), (4, 48), (12, 54), (31, 39), (35, 42), (2, 31), (14, 35),
];

/// Edges of the landmark graph, each once.
pub fn landmark_edges() -> Vec<(usize, usize)> {
    let mut edges = Vec::new();
    for (first, last, closed) in CHAINS {
        edges.extend((first..last).map(|node| (node, node + 1)));
        if closed {
            edges.push((last, first));
        }
    }
    edges.extend(BRIDGES);
    edges
}

/// Sine and cosine of `j / 10000^(2i/size)`, interleaved, for landmark `j`. `[N, size]`, size even.
pub fn index_encoding(size: usize) -> Array2<f32> {
    let frequency: Array1<f64> = (0..size)
        .map(|c| (-(10_000f64.ln()) * (c / 2 * 2) as f64 / size as f64).exp())
        .collect();
    Array2::from_shape_fn((LANDMARKS, size), |(j, c)| {
        let angle = j as f64 * frequency[c];
        (if c % 2 == 0 { angle.sin() } else { angle.cos() }) as f32
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn landmark_graph_is_connected() {
        let mut reached = [false; LANDMARKS];
        reached[0] = true;
        for _ in 0..LANDMARKS {
            for (a, b) in landmark_edges() {
                let either = reached[a] || reached[b];
                (reached[a], reached[b]) = (either, either);
            }
        }
        assert!(reached.iter().all(|r| *r));
    }
}
