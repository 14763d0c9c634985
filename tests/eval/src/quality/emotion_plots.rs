//! Plots of emotion: the confusion matrix of the categories and the curves of intensity.

use plotters::{
    prelude::*,
    style::text_anchor::{HPos, Pos, VPos},
};

use super::{
    emotions::{INTENSITIES, IntensityCurve},
    reading::Reading,
};
use crate::pictures::{Album, Canvas, FONT, GRID, MODEL, OTHER, drawing};
use anyface::Result;

const CELL: i32 = 36;
const NAMES: i32 = 92;
const PANEL: (u32, u32) = (176, 150);
const PANELS_IN_A_ROW: usize = 5;

impl Album {
    /// Draws the confusion matrix over all heads. Rows: the performed emotion; columns: the emotion
    /// that was read; the darker a cell, the larger its share.
    pub(super) fn confusion(&self, name: &str, reading: &Reading) -> Result<String> {
        let (rows, columns) = (
            reading.answers.len() as i32 - 1,
            reading.answers.len() as i32,
        );
        let size = (NAMES + CELL * columns + 12, NAMES + CELL * rows + 24);
        let stills: usize = reading.heads.iter().map(|head| head.stills).sum();
        self.plot(name, (size.0 as u32, size.1 as u32), |canvas| {
            for (column, answer) in (0..).zip(&reading.answers) {
                let x = NAMES + CELL * column + CELL / 2;
                label(canvas, answer, (x, NAMES - 6), true)?;
            }
            for (row, emotion) in (0..).zip(&reading.answers[1..]) {
                let y = NAMES + CELL * row;
                label(canvas, emotion, (NAMES - 6, y + CELL / 2), false)?;
                for column in 0..columns {
                    let of_head = reading.heads.iter().map(|h| &h.confusion[row as usize]);
                    let read: usize = of_head.map(|counts| counts[column as usize]).sum();
                    let share = read as f64 / stills.max(1) as f64;
                    cell(canvas, (NAMES + CELL * column, y), share)?;
                }
            }
            Ok(())
        })
    }

    /// Draws a small panel of intensity for every category.
    pub(super) fn intensities(&self, name: &str, curves: &[IntensityCurve]) -> Result<String> {
        let rows = curves.len().div_ceil(PANELS_IN_A_ROW).max(1);
        let size = (PANEL.0 * PANELS_IN_A_ROW as u32, PANEL.1 * rows as u32);
        let most = curves
            .iter()
            .flat_map(|c| &c.mm)
            .copied()
            .fold(0.1, f64::max);
        self.plot(name, size, |canvas| {
            let panels = canvas.split_evenly((rows, PANELS_IN_A_ROW));
            for (panel, curve) in panels.iter().zip(curves) {
                intensity_panel(panel, curve, 1.05 * most)?;
            }
            Ok(())
        })
    }
}

fn label(canvas: &Canvas<'_>, text: &str, at: (i32, i32), upright: bool) -> Result<()> {
    let style = TextStyle::from((FONT, 14).into_font());
    let style = if upright {
        // Rotated text is anchored at its start.
        TextStyle::from((FONT, 14).into_font().transform(FontTransform::Rotate270))
            .pos(Pos::new(HPos::Left, VPos::Center))
    } else {
        style.pos(Pos::new(HPos::Right, VPos::Center))
    };
    canvas
        .draw(&Text::new(text.to_owned(), at, style))
        .map_err(drawing)
}

fn cell(canvas: &Canvas<'_>, (x, y): (i32, i32), share: f64) -> Result<()> {
    let mix = |from: f64, to: f64| (from + (to - from) * share) as u8;
    let colour = RGBColor(mix(246.0, 30.0), mix(248.0, 90.0), mix(250.0, 160.0));
    let square = [(x + 1, y + 1), (x + CELL - 1, y + CELL - 1)];
    canvas
        .draw(&Rectangle::new(square, colour.filled()))
        .map_err(drawing)?;
    if share == 0.0 {
        return Ok(());
    }
    let ink = if share > 0.5 { WHITE } else { BLACK };
    let style = TextStyle::from((FONT, 13).into_font())
        .color(&ink)
        .pos(Pos::new(HPos::Center, VPos::Center));
    let text = format!("{:.0}", 100.0 * share);
    let middle = (x + CELL / 2, y + CELL / 2);
    canvas
        .draw(&Text::new(text, middle, style))
        .map_err(drawing)
}

fn intensity_panel(panel: &Canvas<'_>, curve: &IntensityCurve, most: f64) -> Result<()> {
    let last = f64::from(INTENSITIES[INTENSITIES.len() - 1]);
    let mut chart = ChartBuilder::on(panel)
        .margin(5)
        .x_label_area_size(20)
        .y_label_area_size(28)
        .caption(curve.emotion, (FONT, 14))
        .build_cartesian_2d(0.0..last, 0.0..most)
        .map_err(drawing)?;
    let mesh = &mut chart.configure_mesh();
    mesh.x_labels(4)
        .y_labels(4)
        .light_line_style(WHITE)
        .bold_line_style(GRID);
    mesh.label_style((FONT, 11)).draw().map_err(drawing)?;
    let colour = if curve.grows { OTHER } else { MODEL };
    let at = [0.0].into_iter().chain(INTENSITIES);
    let points: Vec<(f64, f64)> = at.map(f64::from).zip(curve.mm.iter().copied()).collect();
    let dots = points.iter().map(|p| Circle::new(*p, 2, colour.filled()));
    chart.draw_series(dots).map_err(drawing)?;
    chart
        .draw_series(LineSeries::new(
            points.iter().copied(),
            colour.stroke_width(2),
        ))
        .map_err(drawing)?;
    Ok(())
}
