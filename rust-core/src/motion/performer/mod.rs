//! How one person's mouth differs from that of the model's own speaker.
//!
//! The difference is a linear read-out of the ear's features. [`learn`] fits it to a few seconds of that
//! person's face by ridge regression (Hoerl and Kennard 1970), so fifteen seconds are enough and nothing
//! of the model is trained.

mod aim;
mod learn;
mod read_out;

use std::{collections::HashMap, io::Write, path::Path};

use ndarray::{ArrayView1, ArrayView2, ArrayViewMut2, ArrayViewMut3, Axis};
use safetensors::{
    Dtype, SafeTensors,
    tensor::{TensorInfo, TensorView},
};
use serde::{Deserialize, Serialize};

use crate::{
    Error, Result,
    job::{InputKind, read_file, write_atomically},
    mesh::ibug::speaking,
    models::Weights,
};

pub use learn::{Lesson, learn};
use read_out::ReadOut;

/// The name under which a file keeps the card.
const CARD: &str = "card";
/// The version of the file.
const VERSION: u32 = 1;

/// What a performer was learned from, and how well it follows its own person.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PerformerCard {
    /// Version of the file's layout.
    pub version: u32,
    /// Name of the system with whose own speaker it was compared, and which shows it.
    pub system: String,
    /// Name of the speech encoder whose features it reads.
    pub encoder: String,
    /// Whether it was learned from takes that somebody corrected. Then it is added to finished motion, before
    /// lips touch. Another performer is added to what the system's own speaker does.
    pub corrects: bool,
    /// The takes that it was learned from.
    pub takes: Vec<LearnedTake>,
    /// How strongly the fit keeps to the model's own speaker, per second of sound.
    pub ridge: f64,
    /// Agreement with the person on parts that were left out of the fit, by aspect of the mouth: `gap`,
    /// `width`, `chin` and `protrusion`.
    pub scores: Vec<AspectScore>,
    /// The same for the live stream. Empty for a performer that streams cannot show.
    pub live_scores: Vec<AspectScore>,
    /// Why no stream can show it; empty if one can.
    pub live_refusal: String,
}

/// A take from which a performer was learned.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LearnedTake {
    /// The name that the user gave, such as that of the file.
    pub name: String,
    /// The time in which both sound and motion are known, seconds.
    pub seconds: f64,
    /// By how much the motion lags behind the sound, seconds. The fit takes this off.
    pub lag_s: f64,
}

/// How well one aspect of the mouth follows the person, on parts that were left out of the fit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AspectScore {
    /// The aspect.
    pub name: String,
    /// Pearson's correlation with the captured motion.
    pub r: f64,
    /// Slope of the motion over the captured motion, 1 if it moves as far.
    pub slope: f64,
    /// The correlation of the model's own speaker.
    pub r_without: f64,
    /// The slope of the model's own speaker.
    pub slope_without: f64,
}

/// The mouth of one person.
#[derive(Debug, Clone, PartialEq)]
pub struct Performer {
    card: PerformerCard,
    /// From features `[C]` to the difference at the `L` landmarks of jaw and mouth, `[3 L]` in canonical metres.
    read_out: ReadOut,
    /// The same from the features of the live stream.
    live: Option<ReadOut>,
}

impl Performer {
    /// What it was learned from.
    pub fn card(&self) -> &PerformerCard {
        &self.card
    }

    /// With what `live` learned from the features of the live stream of the same system.
    pub(crate) fn with_live(mut self, live: Performer) -> Performer {
        self.card.live_scores = live.card.scores;
        self.live = Some(live.read_out);
        self.card.live_refusal.clear();
        self
    }

    /// With the reason why no live stream can show it.
    pub(crate) fn without_live(mut self, reason: String) -> Performer {
        self.card.live_refusal = reason;
        self
    }

    /// Checks that it can be shown by a live stream, whose network has `channels` features. Only one system has such
    /// a stream.
    ///
    /// # Errors
    /// `InvalidInput` if it was learned with another system or stream.
    pub(crate) fn check_live(&self, channels: usize) -> Result<()> {
        match &self.live {
            Some(live) if live.mean.len() == channels => Ok(()),
            _ => Err(Error::InvalidInput(format!(
                "performer: expected one that the live stream can show, got one that it cannot ({}): learn it anew \
                 with freetalk, from more takes",
                self.card.live_refusal
            ))),
        }
    }

    /// Adds the person's own motion to a frame `[68, 3]` of the live stream, canonical metres, for its features
    /// `[C]`, as many as [`Performer::check_live`] expected.
    pub(crate) fn add_to_frame(
        &self,
        face: &mut ArrayViewMut2<'_, f32>,
        features: &[f32],
        strength: f32,
    ) {
        if let Some(live) = &self.live {
            let features = ArrayView2::from_shape((1, features.len()), features);
            let own = live.at(features.expect("one row"));
            add_row(face, own.row(0), strength);
        }
    }

    /// Checks that it was learned with this system.
    ///
    /// # Errors
    /// `InvalidInput` if it was another one.
    pub(crate) fn check_system(&self, name: &str) -> Result<()> {
        if self.card.system == name {
            return Ok(());
        }
        Err(Error::InvalidInput(format!(
            "performer: expected one that was learned with {name}, got one of {}: learn it anew with that system, or \
             speak with {}",
            self.card.system, self.card.system
        )))
    }

    /// Adds the person's own motion to that of the model's speaker.
    ///
    /// `displacements` `[T, 68, 3]` in canonical metres, `features` `[T, C]` of the encoder `encoder` in the
    /// same frames. `strength` 1 is the person, 0 the model's speaker.
    ///
    /// # Errors
    /// `InvalidInput` for the features of another encoder.
    pub fn add_to(
        &self,
        mut displacements: ArrayViewMut3<'_, f32>,
        (features, encoder): (ArrayView2<'_, f32>, &str),
        strength: f32,
    ) -> Result<()> {
        let channels = self.read_out.mean.len();
        if features.ncols() != channels || encoder != self.card.encoder {
            return Err(Error::InvalidInput(format!(
                "performer: expected an engine with the speech encoder {} of {channels} features, with which it was \
                 learned, got {encoder} with {}: learn it anew",
                self.card.encoder,
                features.ncols()
            )));
        }
        let own = self.read_out.at(features);
        for (mut face, row) in displacements.outer_iter_mut().zip(own.outer_iter()) {
            add_row(&mut face, row, strength);
        }
        Ok(())
    }

    /// Reads a performer that [`Performer::write`] wrote.
    ///
    /// # Errors
    /// `Io` if the file cannot be read; `InvalidInput` for another kind of file, or one that is damaged.
    pub fn read(path: &Path) -> Result<Performer> {
        let bytes = read_file(path, InputKind::Numbers)?;
        Self::from_bytes(&bytes).map_err(|error| {
            Error::InvalidInput(format!(
                "{}: expected a performer of `anyface performer learn`, got another or a damaged file ({error})",
                path.display()
            ))
        })
    }

    /// Reads the bytes of [`Performer::write`].
    ///
    /// # Errors
    /// `InvalidInput` or `Weights` for bytes that are none of a performer.
    pub fn from_bytes(bytes: &[u8]) -> Result<Performer> {
        let bad = |error: &dyn std::fmt::Display| Error::InvalidInput(error.to_string());
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(|e| bad(&e))?;
        let texts = header.metadata().as_ref();
        let card = texts.and_then(|texts| texts.get(CARD));
        let card = card.ok_or_else(|| bad(&"it has no card"))?;
        let card: PerformerCard = serde_json::from_str(card).map_err(|e| bad(&e))?;
        if card.version != VERSION {
            return Err(bad(&format!(
                "expected version {VERSION}, got {}: learn it anew",
                card.version
            )));
        }
        let arrays = Weights::from_bytes(bytes)?;
        arrays.check_range()?;
        let read_out = |arrays: &Weights, mean: &TensorInfo| {
            let (channels, values) = (mean.shape.iter().product(), 3 * speaking().count());
            Ok::<_, Error>(ReadOut {
                mean: arrays.vector("mean", channels)?,
                weights: arrays.matrix("weights", channels, values)?,
                offset: arrays.vector("offset", values)?,
            })
        };
        let mean = header.info("mean").ok_or_else(|| bad(&"it has no mean"))?;
        let live = header.info("live.mean");
        let live = live.map(|mean| read_out(&arrays.pp("live"), mean));
        Ok(Performer {
            read_out: read_out(&arrays, mean)?,
            live: live.transpose()?,
            card,
        })
    }

    /// Writes the performer as safetensors, with its card as JSON among the metadata.
    ///
    /// # Errors
    /// `Io` if the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        let bytes = self.to_bytes()?;
        write_atomically(path, |file| file.write_all(&bytes))
    }

    fn to_bytes(&self) -> Result<Vec<u8>> {
        let bad =
            |error: &dyn std::fmt::Display| Error::InvalidInput(format!("performer: {error}"));
        let card = serde_json::to_string(&self.card).map_err(|e| bad(&e))?;
        let read_outs = [("", Some(&self.read_out)), ("live.", self.live.as_ref())];
        let mut arrays = Vec::new();
        for (prefix, read_out) in read_outs {
            let Some(read_out) = read_out else { continue };
            let ReadOut {
                mean,
                weights,
                offset,
            } = read_out;
            for (name, shape, bytes) in [
                ("mean", mean.shape(), bytes_of(mean.iter())),
                ("weights", weights.shape(), bytes_of(weights.iter())),
                ("offset", offset.shape(), bytes_of(offset.iter())),
            ] {
                arrays.push((format!("{prefix}{name}"), shape, bytes));
            }
        }
        let mut views = Vec::new();
        for (name, shape, bytes) in &arrays {
            let view = TensorView::new(Dtype::F32, shape.to_vec(), bytes).map_err(|e| bad(&e))?;
            views.push((name, view));
        }
        let texts = HashMap::from([(CARD.to_owned(), card)]);
        safetensors::serialize(views, Some(texts)).map_err(|e| bad(&e))
    }
}

fn bytes_of<'a>(values: impl Iterator<Item = &'a f32>) -> Vec<u8> {
    values.flat_map(|value| value.to_le_bytes()).collect()
}

/// Adds a row `[3 L]` to the landmarks of jaw and mouth of a face `[68, 3]`.
fn add_row(face: &mut ArrayViewMut2<'_, f32>, row: ArrayView1<'_, f32>, strength: f32) {
    for (landmark, own) in speaking().zip(row.axis_chunks_iter(Axis(0), 3)) {
        face.row_mut(landmark).scaled_add(strength, &own);
    }
}
