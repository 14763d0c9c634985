//! Rounds the lips in weights of shapes.

use super::{
    super::{
        FaceModes, WeightClip,
        contacts::{forward, shortfall},
    },
    starts,
};
use crate::{Result, speech::LipRounding};

const PUCKER: &str = "mouthPucker";

impl WeightClip {
    /// Brings the lips forward where speech rounds them: adds as much `mouthPucker` as they still
    /// lack. Frames with an event `over_speech` stay as they are. How far the jaw moves the lips
    /// does not count.
    ///
    /// # Errors
    /// `Weights` if a name is not one of ARKit's.
    pub fn round_lips(
        &mut self,
        rounding: &LipRounding,
        modes: &FaceModes,
        over_speech: &[bool],
    ) -> Result<()> {
        let Some(pucker) = self.column(PUCKER) else {
            return Ok(());
        };
        let shapes = modes.of_shapes(&self.names)?;
        let names = self.names.iter().zip(shapes.outer_iter());
        let by = names.map(|(name, shape)| match starts(name, &["jaw"]) {
            true => 0.0,
            false => forward(shape),
        });
        let by: ndarray::Array1<f32> = by.collect();
        let degrees = rounding.at_frames(self.weights.nrows(), self.fps);
        for (t, mut row) in self.weights.outer_iter_mut().enumerate() {
            if over_speech.get(t) != Some(&true) {
                row[pucker] += shortfall(degrees[t], row.dot(&by)) / by[pucker];
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pucker_comes_as_far_as_it_lacks_and_only_there() {
        let names = ["mouthPucker", "mouthFunnel", "jawOpen"].map(str::to_owned);
        let weights = ndarray::arr2(&[[0.0, 0.0, 0.2], [0.0, 0.0, 0.2], [0.0, 0.9, 0.2]]);
        let mut clip = WeightClip {
            names: names.to_vec(),
            weights: weights.clone(),
            fps: 25.0,
            together: Vec::new(),
        };
        let modes = FaceModes::open(None).unwrap();
        let rounding = LipRounding::heard(vec![1.0; 3], 25.0);
        clip.round_lips(&rounding, &modes, &[true, false, false])
            .unwrap();
        assert_eq!(clip.weights.row(0), weights.row(0));
        assert!(
            (0.25..0.6).contains(&clip.weights[[1, 0]]),
            "{}",
            clip.weights
        );
        assert_eq!(clip.weights.row(2), weights.row(2));
    }
}
