//! Finds the nearest of many points with a grid of cells.

use std::collections::HashMap;

use glam::Vec3;

/// Points sorted into cubes, for queries that mostly lie near some point.
pub(crate) struct PointGrid<'a> {
    points: &'a [[f32; 3]],
    cell: f32,
    cells: HashMap<[i32; 3], Vec<u32>>,
}

impl<'a> PointGrid<'a> {
    /// `cell`: edge of a cube in the points' unit, positive.
    pub fn new(points: &'a [[f32; 3]], cell: f32) -> Self {
        let mut cells: HashMap<_, Vec<u32>> = HashMap::new();
        for (i, point) in points.iter().enumerate() {
            cells
                .entry(cell_of(*point, cell))
                .or_default()
                .push(i as u32);
        }
        PointGrid {
            points,
            cell,
            cells,
        }
    }

    /// Number and distance of the nearest point; `None` if none lies within `limit`.
    pub fn nearest(&self, query: [f32; 3], limit: f32) -> Option<(u32, f32)> {
        let centre = cell_of(query, self.cell);
        let mut best: Option<(u32, f32)> = None;
        let rings = (limit / self.cell).ceil() as i32 + 1;
        for ring in 0..=rings {
            // Everything in this ring is at least this far away.
            let least = (ring - 1).max(0) as f32 * self.cell;
            if best.is_some_and(|(_, d)| d < least) {
                break;
            }
            self.search_ring(query, centre, ring, &mut best);
        }
        best.filter(|&(_, d)| d <= limit)
    }

    /// Numbers and distances of the `most` nearest points within `limit`, nearest first.
    pub fn within(&self, query: [f32; 3], limit: f32, most: usize) -> Vec<(u32, f32)> {
        let [low, high] = [-limit, limit].map(|by| cell_of(query.map(|x| x + by), self.cell));
        let mut neighbours = Vec::new();
        for x in low[0]..=high[0] {
            for y in low[1]..=high[1] {
                for z in low[2]..=high[2] {
                    let cell = self.cells.get(&[x, y, z]).into_iter().flatten();
                    let near = cell.map(|&i| {
                        (
                            i,
                            Vec3::from(self.points[i as usize]).distance(query.into()),
                        )
                    });
                    neighbours.extend(near.filter(|(_, d)| *d <= limit));
                }
            }
        }
        // Ties go to the smaller number, whatever the order of the cells.
        neighbours.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
        neighbours.truncate(most);
        neighbours
    }

    fn search_ring(&self, query: [f32; 3], c: [i32; 3], ring: i32, best: &mut Option<(u32, f32)>) {
        for x in -ring..=ring {
            for y in -ring..=ring {
                let on_side = x.abs() == ring || y.abs() == ring;
                let step = if on_side || ring == 0 { 1 } else { 2 * ring };
                for z in (-ring..=ring).step_by(step as usize) {
                    let key = [
                        c[0].saturating_add(x),
                        c[1].saturating_add(y),
                        c[2].saturating_add(z),
                    ];
                    for &i in self.cells.get(&key).into_iter().flatten() {
                        let d = Vec3::from(self.points[i as usize]).distance(query.into());
                        // Ties go to the smaller number, whatever the order of the cells.
                        if best.is_none_or(|(j, b)| d < b || (d == b && i < j)) {
                            *best = Some((i, d));
                        }
                    }
                }
            }
        }
    }
}

fn cell_of(point: [f32; 3], cell: f32) -> [i32; 3] {
    point.map(|x| (x / cell).floor() as i32)
}

/// The point nearest to `p` on the line segment between two others.
pub(crate) fn nearest_between(p: Vec3, a: Vec3, b: Vec3) -> Vec3 {
    let way = b - a;
    let along = (p - a).dot(way) / way.length_squared().max(1e-12);
    a + along.clamp(0.0, 1.0) * way
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn grid_finds_what_a_plain_search_finds() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut point = || std::array::from_fn(|_| rng.random_range(-3.0..3.0f32));
        let points: Vec<[f32; 3]> = (0..400).map(|_| point()).collect();
        let grid = PointGrid::new(&points, 0.5);
        for _ in 0..200 {
            let query = point();
            let plain = points
                .iter()
                .map(|&p| Vec3::from(p).distance(query.into()))
                .fold(f32::INFINITY, f32::min);
            let neighbour = grid.nearest(query, 20.0).unwrap();
            assert_eq!(neighbour.1, plain);
            assert_eq!(grid.nearest(query, plain * 0.99), None);
        }
    }

    #[test]
    fn the_nearest_few_are_those_of_a_plain_search() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let mut point = || std::array::from_fn(|_| rng.random_range(-1.0..1.0f32));
        let points: Vec<[f32; 3]> = (0..500).map(|_| point()).collect();
        let grid = PointGrid::new(&points, 0.15);
        for _ in 0..100 {
            let query = point();
            let mut plain: Vec<(u32, f32)> = (0u32..)
                .zip(&points)
                .map(|(i, &p)| (i, Vec3::from(p).distance(query.into())))
                .filter(|(_, d)| *d <= 0.4)
                .collect();
            plain.sort_by(|a, b| a.1.total_cmp(&b.1));
            plain.truncate(8);
            assert_eq!(grid.within(query, 0.4, 8), plain);
        }
    }
}
