//! Writes PNG files with at most 256 colours, a third of the size of full colour.

use std::{collections::HashMap, fmt::Debug};

use super::raster::Picture;
use anyface::{Error, Result};

/// Low bits of a channel to clear before counting colours.
const ROUNDED: u8 = 3;

/// The picture as a PNG file.
pub(super) fn png(picture: &Picture) -> Result<Vec<u8>> {
    let pixels: Vec<[u8; 3]> = picture.bytes().iter().map(|p| p.map(rounded)).collect();
    let mut counts: HashMap<[u8; 3], usize> = HashMap::new();
    for pixel in &pixels {
        *counts.entry(*pixel).or_default() += 1;
    }
    let mut colours: Vec<[u8; 3]> = counts.keys().copied().collect();
    colours.sort_by_key(|colour| (std::cmp::Reverse(counts[colour]), *colour));
    let palette = &colours[..colours.len().min(256)];
    let numbers: HashMap<[u8; 3], u8> = colours
        .iter()
        .map(|colour| (*colour, nearest(palette, *colour)))
        .collect();
    let indices: Vec<u8> = pixels.iter().map(|pixel| numbers[pixel]).collect();
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, picture.width as u32, picture.height as u32);
    encoder.set_color(png::ColorType::Indexed);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_palette(palette.concat());
    encoder.set_compression(png::Compression::High);
    encoder.set_filter(png::Filter::NoFilter);
    let mut writer = encoder.write_header().map_err(drawing)?;
    writer.write_image_data(&indices).map_err(drawing)?;
    writer.finish().map_err(drawing)?;
    Ok(out)
}

fn rounded(channel: u8) -> u8 {
    match channel {
        // White stays white.
        248.. => 255,
        _ => channel >> ROUNDED << ROUNDED,
    }
}

fn nearest(palette: &[[u8; 3]], colour: [u8; 3]) -> u8 {
    let distance = |other: &[u8; 3]| -> i32 {
        let apart = (0..3).map(|i| i32::from(colour[i]) - i32::from(other[i]));
        apart.map(|d| d * d).sum()
    };
    let closest = palette.iter().enumerate().min_by_key(|(_, c)| distance(c));
    closest.map_or(0, |(number, _)| number as u8)
}

/// Turns the error of a drawing library into an `Error`.
pub(crate) fn drawing(error: impl Debug) -> Error {
    Error::Numerics(format!("drawing: {error:?}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_comes_back_from_its_file() {
        let mut picture = Picture::white(3, 2);
        picture.darken(1, 1, 1.0);
        let file = png(&picture).unwrap();
        let mut decoder = png::Decoder::new(std::io::Cursor::new(&file));
        decoder.set_transformations(png::Transformations::EXPAND);
        let mut reader = decoder.read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!((info.width, info.height), (3, 2));
        assert_eq!(pixels[..3], [255, 255, 255]);
        assert!(pixels[12..15].iter().all(|channel| *channel < 40));
    }

    #[test]
    fn the_nearest_colour_stands_in() {
        let palette = [[0, 0, 0], [200, 0, 0], [255, 255, 255]];
        assert_eq!(nearest(&palette, [180, 20, 10]), 1);
    }
}
