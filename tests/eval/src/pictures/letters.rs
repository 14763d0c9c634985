//! Writes text on pixel pictures.

use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster, get_raster_width};

use super::raster::Picture;

const HEIGHT: RasterHeight = RasterHeight::Size16;
/// Height of a line of text, pixels.
pub(crate) const LINE: usize = 16;

/// Width of a text, pixels.
pub(crate) fn width(text: &str) -> usize {
    text.chars().count() * get_raster_width(FontWeight::Regular, HEIGHT)
}

/// Writes dark text with its upper left corner at (`left`, `top`). Skips pixels outside the picture
/// and letters outside basic Latin.
pub(crate) fn write(picture: &mut Picture, text: &str, left: usize, top: usize) {
    let step = get_raster_width(FontWeight::Regular, HEIGHT);
    for (k, letter) in text.chars().enumerate() {
        let Some(letter) = get_raster(letter, FontWeight::Regular, HEIGHT) else {
            continue;
        };
        for (y, row) in letter.rows().enumerate() {
            for (x, ink) in row.iter().enumerate() {
                picture.darken(left + k * step + x, top + y, f32::from(*ink) / 255.0);
            }
        }
    }
}
