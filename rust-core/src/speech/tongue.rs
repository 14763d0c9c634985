//! How the tongue moves in speech.

use ndarray::{Array2, ArrayView2, Axis};

use super::{
    PhoneModel, SpeechFeatures,
    travel::{sure, travel},
};

/// Number of the tongue's movements in a frame: the tip rises to the ridge behind the upper teeth,
/// the middle rises to the palate, the back rises to the palate, and the tip goes to the edge of
/// the upper teeth.
pub const TONGUE_PLACES: usize = 4;

/// How far the tongue moves from rest to the roof of the mouth, as shares of the way, from closed
/// to mid. A place and a degree of constriction for the tongue tip and for the tongue body are
/// tract variables (Browman & Goldstein, "Articulatory gestures as phonological units", Phonology
/// 6, 1989). The values are ours: over a way of 12 mm, a critical constriction leaves about 1 mm, a
/// narrow one 4 mm and a mid one 7 mm.
const CLOSED: f32 = 1.0;
const CRITICAL: f32 = 0.9;
const NARROW: f32 = 0.7;
const MID: f32 = 0.4;

/// Targets of the phones that need the tongue: tip, middle, back, and tip at the teeth. They follow
/// the usual places of articulation: alveolar t d n l s z, dental θ ð, palatal j i,
/// velar k ɡ ŋ u w. The degrees are ours. For all other phones the tongue rests.
const TARGETS: &[(&[&str], [f32; TONGUE_PLACES])] = &[
    (&["t", "d", "n", "l", "r"], [CLOSED, 0.0, 0.0, 0.0]),
    (&["s", "z"], [CRITICAL, MID, 0.0, 0.0]),
    (&["ʃ", "ʒ"], [NARROW, NARROW, 0.0, 0.0]),
    (&["θ", "ð"], [0.0, 0.0, 0.0, CLOSED]),
    (&["k", "ɡ", "ŋ"], [0.0, 0.0, CLOSED, 0.0]),
    (&["x", "ʁ"], [0.0, 0.0, CRITICAL, 0.0]),
    (&["j", "i", "y"], [0.0, NARROW, 0.0, 0.0]),
    (&["ɹ", "ɝ"], [MID, MID, 0.0, 0.0]),
    (&["ɪ", "e", "ø"], [0.0, MID, 0.0, 0.0]),
    (&["u", "w"], [0.0, 0.0, NARROW, 0.0]),
    (&["ʊ", "o"], [0.0, 0.0, MID, 0.0]),
];

/// Seconds that the tongue takes to reach a target, and again to leave it. Its top speed is π / 2
/// times its mean speed: 0.29 m/s for a way of 15 mm.
const TRAVEL_S: f64 = 0.08;
/// Rows of posteriors on either side of a row that are averaged with it: 30 ms in all.
const NEAR_ROWS: usize = 1;

impl SpeechFeatures {
    /// The tongue's motion for the phones of the sound, `[T, 4]`, each a share of the way from rest
    /// to contact, 0 to 1: tip to the ridge behind the upper teeth, middle and back to the palate,
    /// tip to the edge of the upper teeth. All zeros if there is no phone model for the encoder's
    /// features.
    ///
    /// The tongue reaches the target of a phone at the instant at which the phone is most likely.
    pub fn tongue(&self, fps: f64) -> Array2<f32> {
        let frames = self.frames(fps);
        match self.phone_rows() {
            Some((phones, rows)) => {
                let rate_hz = phones.rows_per_second(&self.track);
                let targets = targets(rows, phones);
                travel(targets.view(), rate_hz, TRAVEL_S, frames, fps)
            }
            None => Array2::zeros((frames, TONGUE_PLACES)),
        }
    }
}

/// Targets `[R, 4]` from log-posteriors `[R, K]`, smoothed over neighbouring rows: of each place the
/// largest among the kinds of phones, as far as a kind is [`sure`].
fn targets(posteriors: ArrayView2<'_, f32>, phones: &PhoneModel) -> Array2<f32> {
    let kinds = TARGETS
        .iter()
        .map(|(names, target)| (classes_of(phones, names), target));
    let kinds: Vec<(Vec<usize>, &[f32; TONGUE_PLACES])> = kinds.collect();
    let mut sharp = Array2::zeros((posteriors.nrows(), TONGUE_PLACES));
    for (likely, mut row) in posteriors.outer_iter().zip(sharp.outer_iter_mut()) {
        for (classes, target) in &kinds {
            let heard = sure(classes.iter().map(|&class| likely[class].exp()).sum());
            row.iter_mut()
                .zip(*target)
                .for_each(|(to, x)| *to = f32::max(*to, heard * x));
        }
    }
    let mut smooth = sharp.clone();
    for (r, mut row) in smooth.outer_iter_mut().enumerate() {
        let near = r.saturating_sub(NEAR_ROWS)..(r + NEAR_ROWS + 1).min(sharp.nrows());
        let near = sharp.slice_axis(Axis(0), near.into());
        row.assign(&near.mean_axis(Axis(0)).expect("the row itself"));
    }
    smooth
}

/// The classes of the phones with these signs.
fn classes_of(phones: &PhoneModel, names: &[&str]) -> Vec<usize> {
    let classes = phones.classes().iter().enumerate();
    let known = classes.filter(|(_, sign)| names.contains(&sign.as_str()));
    known.map(|(class, _)| class).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE_HZ: f64 = 100.0;

    #[test]
    fn each_phone_moves_its_own_part_of_the_tongue() {
        let of = |name: &str| {
            let known = TARGETS.iter().find(|(names, _)| names.contains(&name));
            known.map_or([0.0; TONGUE_PLACES], |(_, target)| *target)
        };
        for name in ["_", "a"] {
            assert_eq!(of(name), [0.0; TONGUE_PLACES]);
        }
        for (names, place) in [(&["l", "t"][..], 0), (&["j"], 1), (&["k"], 2), (&["θ"], 3)] {
            for name in names {
                let most = (0..TONGUE_PLACES).max_by(|a, b| of(name)[*a].total_cmp(&of(name)[*b]));
                assert_eq!(most, Some(place), "{name}");
                assert!(of(name)[place] >= NARROW, "{name}");
            }
        }
        assert!(of("s")[0] < of("t")[0]);
    }

    #[test]
    fn every_phone_with_a_target_is_one_that_the_model_hears() {
        let phones = PhoneModel::open(None).unwrap();
        for name in TARGETS.iter().flat_map(|(names, _)| *names) {
            assert!(phones.classes().iter().any(|known| known == name), "{name}");
        }
    }

    #[test]
    fn likely_phones_move_the_tongue_all_the_way_and_unlikely_ones_less() {
        let phones = PhoneModel::open(None).unwrap();
        let classes = phones.classes();
        let of = |name: &str| classes.iter().position(|known| known == name).unwrap();
        let mut posteriors = Array2::from_elem((9, classes.len()), f32::NEG_INFINITY);
        posteriors.column_mut(of("l")).fill(0.75f32.ln());
        posteriors.column_mut(of("k")).fill(0.25f32.ln());
        let mixed = targets(posteriors.view(), &phones);
        for row in mixed.rows() {
            assert_eq!(row[0], 1.0);
            assert!((row[2] - sure(0.25)).abs() < 1e-6 && row[2] < 0.5);
            assert_eq!((row[1], row[3]), (0.0, 0.0));
        }
    }

    #[test]
    fn the_tongue_is_there_in_time_and_no_faster_than_tongues_are() {
        // An l of 50 ms around 0.5 s, then a k 120 ms after it.
        let mut targets = Array2::zeros((102, TONGUE_PLACES));
        targets.slice_mut(ndarray::s![50..55, 0]).fill(1.0);
        targets.slice_mut(ndarray::s![67..72, 2]).fill(1.0);
        let fps = 200.0;
        let travelled = travel(targets.view(), RATE_HZ, TRAVEL_S, 200, fps);
        let at = |time_s: f64, place: usize| travelled[[(time_s * fps) as usize, place]];
        assert!(at(0.5, 0) > 0.999 && at(0.67, 2) > 0.999);
        assert!(at(0.5, 2) == 0.0 && at(0.67, 0) == 0.0);
        for (t, row) in travelled.outer_iter().enumerate() {
            let time_s = t as f64 / fps;
            let is_silent = !(0.39..0.81).contains(&time_s);
            assert!(!is_silent || row.iter().all(|x| *x == 0.0), "{time_s}");
        }
        let steps = travelled.outer_iter().zip(travelled.outer_iter().skip(1));
        let fastest = steps.flat_map(|(a, b)| (&b - &a).to_vec());
        let fastest = fps as f32 * fastest.fold(0.0, |most: f32, x| most.max(x.abs()));
        assert!(0.015 * fastest < 0.3, "{fastest} ways a second");
    }

    #[test]
    fn no_targets_are_stillness_and_a_short_sound_is_no_error() {
        for rows in [0, 40] {
            let silence = Array2::<f32>::zeros((rows, TONGUE_PLACES));
            let travelled = travel(silence.view(), RATE_HZ, TRAVEL_S, 9, 30.0);
            assert_eq!(travelled.dim(), (9, TONGUE_PLACES));
            assert!(travelled.iter().all(|x| *x == 0.0));
        }
    }
}
