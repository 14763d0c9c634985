//! Plots of the lip gap: over time, as a histogram, over frequency.

use plotters::prelude::*;

use super::{Album, Canvas, FONT, GRID, MODEL, OTHER, RECORDED, SOUND, drawing};
use crate::metrics::{Spectrum, quantile};
use anyface::{
    Result,
    audio::{SAMPLE_RATE_HZ, Waveform},
};

/// Longest part of a clip to show, seconds.
const SHOWN_S: f64 = 8.0;
const PANEL: (u32, u32) = (860, 170);
const SMALL: (u32, u32) = (560, 300);
/// Points along a sound's outline.
const OUTLINE: usize = 400;
const BIN_MM: f64 = 0.5;

/// One clip of the plot over time.
pub(crate) struct Track<'a> {
    pub title: String,
    pub waveform: &'a Waveform,
    pub fps: f64,
    /// The recorded lip gap, millimetres; `model` likewise.
    pub recorded: Vec<f64>,
    pub model: Vec<f64>,
}

impl Album {
    /// Draws the lip gap over time on top of the sound, one panel for each clip.
    pub(crate) fn gap_tracks(&self, name: &str, tracks: &[Track<'_>]) -> Result<String> {
        let size = (PANEL.0, PANEL.1 * tracks.len().max(1) as u32 + 30);
        self.plot(name, size, |canvas| {
            let (head, rest) = canvas.split_vertically(30);
            legend(
                &head,
                &[("recorded", RECORDED), ("model", MODEL), ("sound", SOUND)],
            )?;
            let panels = rest.split_evenly((tracks.len().max(1), 1));
            for (panel, track) in panels.iter().zip(tracks) {
                gap_panel(panel, track)?;
            }
            Ok(())
        })
    }

    /// Draws the share of frames in lip gap bins of half a millimetre.
    pub(crate) fn gap_histogram(&self, name: &str, curves: &[(&str, Vec<f64>)]) -> Result<String> {
        let all: Vec<f64> = curves.iter().flat_map(|(_, gaps)| gaps).copied().collect();
        let most = quantile(&all, 0.999).max(BIN_MM);
        let bins = (most / BIN_MM).ceil() as usize;
        let lines = curves.iter().map(|(name, gaps)| {
            let mut shares = vec![0.0; bins];
            for gap in gaps {
                shares[((gap / BIN_MM) as usize).min(bins - 1)] += 100.0 / gaps.len() as f64;
            }
            let steps = shares.iter().enumerate();
            let corners = steps.flat_map(|(b, share)| {
                [
                    (b as f64 * BIN_MM, *share),
                    ((b + 1) as f64 * BIN_MM, *share),
                ]
            });
            (*name, corners.collect())
        });
        let axes = ("lip gap, mm", "frames, %");
        self.lines(name, axes, &lines.collect::<Vec<_>>())
    }

    /// Draws power densities in decibels relative to 1 mm²/Hz.
    pub(crate) fn spectra(&self, name: &str, curves: &[(&str, Spectrum)]) -> Result<String> {
        let lines = curves.iter().map(|(name, spectrum)| {
            let density = spectrum.density();
            let bins = density.iter().enumerate().skip(1);
            let level = |(bin, power): (usize, &f64)| {
                (
                    bin as f64 * spectrum.step_hz,
                    10.0 * power.max(1e-6).log10(),
                )
            };
            (*name, bins.map(level).collect())
        });
        let axes = ("frequency, Hz", "gap power, dB re 1 mm²/Hz");
        self.lines(name, axes, &lines.collect::<Vec<_>>())
    }

    fn lines(
        &self,
        name: &str,
        (x, y): (&str, &str),
        lines: &[(&str, Vec<(f64, f64)>)],
    ) -> Result<String> {
        let points = || lines.iter().flat_map(|(_, points)| points);
        let range = |of: fn(&(f64, f64)) -> f64| {
            let low = points().map(of).fold(f64::INFINITY, f64::min);
            let high = points().map(of).fold(f64::NEG_INFINITY, f64::max);
            low..high + 0.05 * (high - low).max(1e-9)
        };
        self.plot(name, SMALL, |canvas| {
            let (head, body) = canvas.split_vertically(30);
            let mut keys = Vec::new();
            let mut chart = ChartBuilder::on(&body)
                .margin(8)
                .x_label_area_size(34)
                .y_label_area_size(52)
                .build_cartesian_2d(range(|p| p.0), range(|p| p.1))
                .map_err(drawing)?;
            let mesh = &mut chart.configure_mesh();
            mesh.x_desc(x)
                .y_desc(y)
                .light_line_style(WHITE)
                .bold_line_style(GRID);
            mesh.label_style((FONT, 13)).axis_desc_style((FONT, 13));
            mesh.draw().map_err(drawing)?;
            for (k, (name, points)) in lines.iter().enumerate() {
                let colour = [RECORDED, MODEL, OTHER][k.min(2)];
                let style = colour.stroke_width(2);
                chart
                    .draw_series(LineSeries::new(points.iter().copied(), style))
                    .map_err(drawing)?;
                keys.push((*name, colour));
            }
            legend(&head, &keys)
        })
    }
}

fn legend(canvas: &Canvas<'_>, keys: &[(&str, RGBColor)]) -> Result<()> {
    let mut x = 60;
    for (name, colour) in keys {
        let line = PathElement::new(vec![(x, 16), (x + 22, 16)], colour.stroke_width(4));
        canvas.draw(&line).map_err(drawing)?;
        let text = Text::new((*name).to_owned(), (x + 28, 9), (FONT, 14));
        canvas.draw(&text).map_err(drawing)?;
        x += 60 + 8 * name.chars().count() as i32;
    }
    Ok(())
}

fn gap_panel(panel: &Canvas<'_>, track: &Track<'_>) -> Result<()> {
    let frames = track.recorded.len().min((SHOWN_S * track.fps) as usize);
    let seconds = frames as f64 / track.fps;
    let shown = |curve: &[f64]| -> Vec<(f64, f64)> {
        let values = curve.iter().take(frames).enumerate();
        values
            .map(|(t, gap)| (t as f64 / track.fps, *gap))
            .collect()
    };
    let (recorded, model) = (shown(&track.recorded), shown(&track.model));
    let both = recorded.iter().chain(&model);
    let most = 1.08 * both.map(|(_, gap)| *gap).fold(1.0, f64::max);
    let mut chart = ChartBuilder::on(panel)
        .margin(6)
        .x_label_area_size(24)
        .y_label_area_size(52)
        .caption(&track.title, (FONT, 13))
        .build_cartesian_2d(0.0..seconds, 0.0..most)
        .map_err(drawing)?;
    let outline = outline(track.waveform, seconds, most);
    chart
        .draw_series([Polygon::new(outline, SOUND.filled())])
        .map_err(drawing)?;
    let mesh = &mut chart.configure_mesh();
    mesh.disable_mesh()
        .y_desc("gap, mm")
        .y_labels(4)
        .x_labels(9);
    mesh.label_style((FONT, 12)).axis_desc_style((FONT, 13));
    mesh.draw().map_err(drawing)?;
    for (points, colour) in [(recorded, RECORDED), (model, MODEL)] {
        chart
            .draw_series(LineSeries::new(points, colour.stroke_width(2)))
            .map_err(drawing)?;
    }
    Ok(())
}

/// The sound's amplitude above and below the panel's middle, as a closed outline.
fn outline(waveform: &Waveform, seconds: f64, most: f64) -> Vec<(f64, f64)> {
    let count = ((seconds * f64::from(SAMPLE_RATE_HZ)) as usize).min(waveform.samples.len());
    let samples = &waveform.samples[..count];
    let chunk = (count / OUTLINE).max(1);
    let peaks: Vec<f64> = samples
        .chunks(chunk)
        .map(|part| {
            part.iter()
                .fold(0.0, |most: f64, x| most.max(f64::from(x.abs())))
        })
        .collect();
    let loudest = peaks.iter().copied().fold(1e-9, f64::max);
    let at = |k: usize, sign: f64| {
        let x = (k * chunk) as f64 / f64::from(SAMPLE_RATE_HZ);
        (x, most * (0.5 + 0.48 * sign * peaks[k] / loudest))
    };
    let above = (0..peaks.len()).map(|k| at(k, 1.0));
    above
        .chain((0..peaks.len()).rev().map(|k| at(k, -1.0)))
        .collect()
}
