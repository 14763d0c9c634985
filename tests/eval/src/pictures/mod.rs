//! Pictures for a report: plots as SVG, contact sheets as PNG.

pub(super) mod letters;
pub(super) mod lip_plots;
mod palette;
pub(super) mod raster;
pub(super) mod sheets;

use std::{
    io::Write,
    path::{Path, PathBuf},
};

use plotters::{coord::Shift, prelude::*};

use anyface::{Error, Result, job::write_atomically};
pub(super) use palette::drawing;

/// Recorded motion.
const RECORDED: RGBColor = RGBColor(40, 40, 40);
/// The model's motion.
pub(super) const MODEL: RGBColor = RGBColor(214, 69, 33);
/// A further curve.
pub(super) const OTHER: RGBColor = RGBColor(60, 120, 190);
const SOUND: RGBColor = RGBColor(214, 220, 228);
pub(super) const GRID: RGBColor = RGBColor(235, 235, 235);
pub(super) const FONT: &str = "sans-serif";

pub(super) type Canvas<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// The folder for the pictures.
pub(super) struct Album {
    folder: PathBuf,
}

impl Album {
    /// Creates the folder if it does not exist.
    pub(super) fn new(folder: PathBuf) -> Result<Self> {
        std::fs::create_dir_all(&folder).map_err(Error::io(&folder))?;
        Ok(Album { folder })
    }

    /// Draws a plot of `size` pixels on white into `name`.svg and returns that name.
    pub(super) fn plot(
        &self,
        name: &str,
        size: (u32, u32),
        draw: impl FnOnce(&Canvas<'_>) -> Result<()>,
    ) -> Result<String> {
        let mut text = String::new();
        {
            let canvas = SVGBackend::with_string(&mut text, size).into_drawing_area();
            canvas.fill(&WHITE).map_err(drawing)?;
            draw(&canvas)?;
            canvas.present().map_err(drawing)?;
        }
        self.write(&format!("{name}.svg"), text.as_bytes())
    }

    /// Writes a finished picture into `name`.png and returns that name.
    pub(super) fn picture(&self, name: &str, picture: &raster::Picture) -> Result<String> {
        self.write(&format!("{name}.png"), &palette::png(picture)?)
    }

    fn write(&self, name: &str, bytes: &[u8]) -> Result<String> {
        let path: &Path = &self.folder.join(name);
        write_atomically(path, |file| file.write_all(bytes))?;
        Ok(name.into())
    }
}
