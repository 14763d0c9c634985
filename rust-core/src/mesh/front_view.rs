//! A depth picture of surfaces, seen from the front without perspective.

/// The kind of a cell that no surface covers.
pub const NOTHING: u8 = 0;

/// Square cells over a rectangle. Each holds the nearest surface at its centre; +z is nearer.
///
/// ```
/// use anyface::mesh::FrontView;
///
/// let mut view = FrontView::new([0.0, 0.0], [4.0, 4.0], 1.0);
/// view.draw([[0.0, 0.0, 1.0], [9.0, 0.0, 1.0], [0.0, 9.0, 1.0]], 1);
/// view.draw([[0.0, 0.0, 2.0], [2.2, 0.0, 2.0], [0.0, 2.2, 2.0]], 2);
/// assert_eq!((view.kind(0, 0), view.kind(3, 3), view.depth(0, 0)), (2, 1, 2.0));
/// ```
#[derive(Debug, Clone)]
pub struct FrontView {
    low: [f32; 2],
    cell: f32,
    columns: usize,
    rows: usize,
    /// Depth and kind of each cell, row by row.
    nearest: Vec<(f32, u8)>,
}

impl FrontView {
    /// An empty picture from `low` to `high` with cells of side `cell`.
    pub fn new(low: [f32; 2], high: [f32; 2], cell: f32) -> FrontView {
        let count = |i: usize| ((high[i] - low[i]) / cell).ceil().max(0.0) as usize;
        let (columns, rows) = (count(0), count(1));
        FrontView {
            low,
            cell,
            columns,
            rows,
            nearest: vec![(f32::NEG_INFINITY, NOTHING); columns * rows],
        }
    }

    /// Number of columns, from the left.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Number of rows, from below.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Kind of the surface that is seen in a cell, `NOTHING` if there is none.
    pub fn kind(&self, column: usize, row: usize) -> u8 {
        self.nearest[row * self.columns + column].1
    }

    /// Depth of the surface that is seen in a cell, minus infinity if there is none.
    pub fn depth(&self, column: usize, row: usize) -> f32 {
        self.nearest[row * self.columns + column].0
    }

    /// Centre of a cell.
    pub fn centre(&self, column: usize, row: usize) -> [f32; 2] {
        let at = |low: f32, k: usize| low + (k as f32 + 0.5) * self.cell;
        [at(self.low[0], column), at(self.low[1], row)]
    }

    /// Column and row of the cell that contains a point, or of the nearest cell.
    pub fn cell_at(&self, point: [f32; 2]) -> [usize; 2] {
        let counts = [self.columns, self.rows];
        std::array::from_fn(|i| {
            let cell = ((point[i] - self.low[i]) / self.cell).max(0.0) as usize;
            cell.min(counts[i].saturating_sub(1))
        })
    }

    /// Draws one triangle. Both of its sides are visible.
    pub fn draw(&mut self, triangle: [[f32; 3]; 3], kind: u8) {
        let [a, b, c] = triangle;
        let span = |i: usize, count: usize| {
            let low = a[i].min(b[i]).min(c[i]) - self.low[i];
            let high = a[i].max(b[i]).max(c[i]) - self.low[i];
            let last = (high / self.cell + 0.5).floor().clamp(0.0, count as f32);
            (low / self.cell - 0.5).ceil().clamp(0.0, count as f32) as usize..last as usize
        };
        let (columns, rows) = (span(0, self.columns), span(1, self.rows));
        for row in rows {
            for column in columns.clone() {
                let Some(depth) = depth_at(&triangle, self.centre(column, row)) else {
                    continue;
                };
                let cell = &mut self.nearest[row * self.columns + column];
                if depth > cell.0 {
                    *cell = (depth, kind);
                }
            }
        }
    }
}

/// Depth of a triangle at a place, if the triangle covers it. Both of its sides are visible.
#[inline]
pub(crate) fn depth_at([a, b, c]: &[[f32; 3]; 3], [x, y]: [f32; 2]) -> Option<f32> {
    let area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
    if area == 0.0 {
        return None;
    }
    let of_a = ((b[0] - x) * (c[1] - y) - (c[0] - x) * (b[1] - y)) / area;
    let of_b = ((c[0] - x) * (a[1] - y) - (a[0] - x) * (c[1] - y)) / area;
    let of_c = 1.0 - of_a - of_b;
    let covers = of_a.min(of_b).min(of_c) >= -1e-6;
    covers.then(|| of_a * a[2] + of_b * b[2] + of_c * c[2])
}
