//! What differs between two takes of one actor.
//!
//! Slow, seeded changes of how far the mouth opens, widens and protrudes, of the side it prefers and of
//! how the brows are held. All of it rests while nobody speaks, and lips that close close as before.
//! Sizes of the sides are those of grid_s1: the mouth's corners part from symmetry by 0.53 mm across and
//! 0.40 mm up (medians of deviations within clips), the lips' openings left and right differ by 4 %.

use ndarray::{Array2, Array3};

use super::{
    articulation::keep_closures, chance::Chance, face_modes::FaceModes, phrases::Phrases,
    slow_noise::SlowNoise,
};
use crate::{
    Result,
    audio::Prosody,
    mesh::ibug::{BROWS, MOUTH, speaking},
};

/// Number of this process among the streams of a seed.
const STREAM: u64 = u64::MAX - 4;
/// How slowly it changes: the mouth, and the brows.
const MOUTH_HZ: (f64, f64) = (0.2, 0.8);
const BROWS_HZ: (f64, f64) = (0.12, 0.6);
/// Deviation of the scale of a take throughout, and of its changes, across, up and out of the face.
const TAKE: [f64; 3] = [0.08, 0.06, 0.08];
const CHANGE: [f64; 3] = [0.16, 0.13, 0.16];
/// Deviation of what one side of the mouth opens more than the other.
const SIDE: f64 = 0.04;
/// Deviation of the mouth's shift to a side, and of the corners' tilt, metres.
const SHIFT_M: f64 = 0.32e-3;
const TILT_M: f64 = 0.26e-3;
/// Deviation of the weight of raised and of knit brows.
const RAISE: f64 = 0.09;
const KNIT: f64 = 0.05;
/// Deviation of what one brow goes further than the other.
const BROW_SIDE: f64 = 0.25;
/// Where the landmarks of the mouth lie across at rest, shares of half its width, right to left.
const PLACES: [f32; 20] = [
    -1.0, -0.66, -0.3, 0.0, 0.3, 0.66, 1.0, 0.66, 0.33, 0.0, -0.33, -0.66, -0.9, -0.33, 0.0, 0.33,
    0.9, 0.33, 0.0, -0.33,
];

/// The slow changes of a take.
pub(super) struct Variety {
    phrases: Phrases,
    take: [f64; 3],
    change: [SlowNoise; 3],
    side: SlowNoise,
    shift: SlowNoise,
    tilt: SlowNoise,
    raise: SlowNoise,
    knit: SlowNoise,
    brow_side: SlowNoise,
}

impl Variety {
    /// Same seed, same take.
    pub(super) fn draw(prosody: &Prosody, seed: u64) -> Self {
        let mut chance = Chance::new(seed, STREAM);
        // A bell of deviation 1, within 2.6.
        let take = TAKE.map(|deviation| deviation * 5.3 * (chance.bell() - 0.5));
        let mut mouth = || SlowNoise::new(&mut chance, MOUTH_HZ.0, MOUTH_HZ.1);
        let change = std::array::from_fn(|_| mouth());
        let (side, shift, tilt) = (mouth(), mouth(), mouth());
        let mut brows = || SlowNoise::new(&mut chance, BROWS_HZ.0, BROWS_HZ.1);
        Variety {
            phrases: Phrases::of(prosody),
            take,
            change,
            side,
            shift,
            tilt,
            raise: brows(),
            knit: brows(),
            brow_side: brows(),
        }
    }

    /// Varies the lower face of `[T, 68, 3]`, canonical metres; gaps of closed lips stay.
    pub(super) fn vary_mouth(&self, moved: &mut Array3<f32>, fps: f64, strength: f32) {
        let sampled = moved.clone();
        let strength = f64::from(strength);
        for (t, mut frame) in moved.outer_iter_mut().enumerate() {
            let time_s = t as f64 / fps;
            let activity = self.phrases.activity(time_s);
            let scale: [f32; 3] = std::array::from_fn(|i| {
                let change = self.take[i] + CHANGE[i] * self.change[i].at(time_s);
                (1.0 + strength * change).max(0.2) as f32
            });
            for n in speaking() {
                for (x, scale) in frame.row_mut(n).iter_mut().zip(scale) {
                    *x *= scale;
                }
            }
            let sized = |deviation: f64, noise: &SlowNoise| strength * deviation * noise.at(time_s);
            let side = sized(SIDE, &self.side) as f32;
            let shift = (activity * sized(SHIFT_M, &self.shift)) as f32;
            let tilt = (activity * sized(TILT_M, &self.tilt)) as f32;
            for (n, place) in MOUTH.zip(PLACES) {
                frame[[n, 1]] = frame[[n, 1]] * (1.0 + side * place) + tilt * place;
                frame[[n, 0]] += shift;
            }
        }
        keep_closures(moved, sampled.view(), fps);
    }

    /// Lifts, lowers and knits the brows a little while somebody speaks. `[T, 68, 3]`, canonical metres.
    pub(super) fn vary_brows(
        &self,
        moved: &mut Array3<f32>,
        fps: f64,
        modes: &FaceModes,
        strength: f32,
    ) -> Result<()> {
        let raise = sum(
            modes,
            [
                "browInnerUp_L",
                "browInnerUp_R",
                "browOuterUp_L",
                "browOuterUp_R",
            ],
        )?;
        let knit = sum(modes, ["browDown_L", "browDown_R"])?;
        let strength = f64::from(strength);
        for (t, mut frame) in moved.outer_iter_mut().enumerate() {
            let time_s = t as f64 / fps;
            let size = strength * self.phrases.activity(time_s);
            let side = strength * BROW_SIDE * self.brow_side.at(time_s);
            let raised = size * RAISE * self.raise.at(time_s);
            let knitted = size * KNIT * self.knit.at(time_s);
            for n in BROWS {
                let side = if n < BROWS.start + 5 {
                    1.0 - side
                } else {
                    1.0 + side
                };
                let mut row = frame.row_mut(n);
                row.scaled_add((side * raised) as f32, &raise.row(n));
                row.scaled_add((side * knitted) as f32, &knit.row(n));
            }
        }
        Ok(())
    }
}

fn sum<const N: usize>(modes: &FaceModes, names: [&str; N]) -> Result<Array2<f32>> {
    let mut total = Array2::zeros((crate::mesh::ibug::LANDMARKS, 3));
    for name in names {
        total += &modes.mode(name)?;
    }
    Ok(total)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{mesh::ibug::MIRROR, motion::phrases::tests::speaking as voice};

    const FPS: f64 = 30.0;
    const FRAMES: usize = 270;

    /// A jaw that opens four times a second, lips that round, closures in between.
    fn talking(modes: &FaceModes) -> Array3<f32> {
        let shapes = ["jawOpen", "mouthPucker", "mouthSmile_L", "mouthSmile_R"]
            .map(|name| modes.mode(name).unwrap());
        Array3::from_shape_fn((FRAMES, 68, 3), |(t, n, i)| {
            let s = t as f32 / FPS as f32;
            let open = (std::f32::consts::TAU * 3.0 * s).sin().max(0.0);
            let smile = 0.15 * (5.0 * s).sin().abs();
            0.35 * open * shapes[0][[n, i]]
                + 0.3 * (4.0 * s).sin().abs() * shapes[1][[n, i]] * open
                + smile * open * (shapes[2][[n, i]] + shapes[3][[n, i]])
        })
    }

    fn varied(seed: u64, modes: &FaceModes) -> Array3<f32> {
        let mut moved = talking(modes);
        let variety = Variety::draw(&voice(9, 40), seed);
        variety.vary_mouth(&mut moved, FPS, 1.0);
        variety.vary_brows(&mut moved, FPS, modes, 1.0).unwrap();
        moved
    }

    /// Deviation of a landmark's place between takes, mean over frames and `region`, millimetres.
    fn deviation_mm(takes: &[Array3<f32>], region: impl Iterator<Item = usize>) -> f64 {
        let deviation = |t: usize, n: usize| {
            let variance = |i: usize| {
                let values = || takes.iter().map(|take| f64::from(take[[t, n, i]]));
                let mean = values().sum::<f64>() / takes.len() as f64;
                values().map(|x| (x - mean).powi(2)).sum::<f64>() / (takes.len() - 1) as f64
            };
            (0..3).map(variance).sum::<f64>().sqrt()
        };
        let all: Vec<f64> = region
            .flat_map(|n| (0..FRAMES).map(move |t| deviation(t, n)))
            .collect();
        1000.0 * all.iter().sum::<f64>() / all.len() as f64
    }

    fn pearson(a: &[f64], b: &[f64]) -> f64 {
        let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
        let (mean_a, mean_b) = (mean(a), mean(b));
        let joint = |x: &[f64], mean_x: f64, y: &[f64], mean_y: f64| -> f64 {
            let pairs = x.iter().zip(y);
            pairs.map(|(x, y)| (x - mean_x) * (y - mean_y)).sum()
        };
        let (aa, bb) = (joint(a, mean_a, a, mean_a), joint(b, mean_b, b, mean_b));
        joint(a, mean_a, b, mean_b) / (aa * bb).sqrt()
    }

    fn gap(moved: &Array3<f32>, t: usize) -> f32 {
        moved[[t, 62, 1]] - moved[[t, 66, 1]]
    }

    #[test]
    fn takes_differ_in_lips_and_brows_and_close_alike() {
        let modes = FaceModes::open(None).unwrap();
        let plain = talking(&modes);
        let takes: Vec<_> = (0..6).map(|seed| varied(seed, &modes)).collect();
        let (lips, brows) = (deviation_mm(&takes, MOUTH), deviation_mm(&takes, BROWS));
        assert!((0.35..1.2).contains(&lips), "lips {lips} mm");
        assert!((0.5..1.5).contains(&brows), "brows {brows} mm");
        let closed = (0..FRAMES).filter(|t| gap(&plain, *t) < 1e-4);
        let mut count = 0;
        for t in closed {
            let take = varied(1, &modes);
            assert!((gap(&take, t) - gap(&plain, t)).abs() < 5e-5);
            count += 1;
            if count == 40 {
                break;
            }
        }
        assert!(count == 40);
    }

    #[test]
    fn the_opening_of_the_lips_still_follows_speech() {
        let modes = FaceModes::open(None).unwrap();
        let plain = talking(&modes);
        for seed in 0..6 {
            let take = varied(seed, &modes);
            let gaps = |moved: &Array3<f32>| -> Vec<f64> {
                (0..FRAMES).map(|t| f64::from(gap(moved, t))).collect()
            };
            let r = pearson(&gaps(&plain), &gaps(&take));
            assert!(r > 0.97, "r {r}");
        }
    }

    #[test]
    fn left_and_right_differ_a_little() {
        let modes = FaceModes::open(None).unwrap();
        let take = varied(2, &modes);
        let uneven = (0..FRAMES).map(|t| (take[[t, 54, 1]] - take[[t, MIRROR[54], 1]]).abs());
        let mean_mm = 1000.0 * uneven.sum::<f32>() / FRAMES as f32;
        assert!((0.1..1.0).contains(&mean_mm), "{mean_mm}");
    }

    #[test]
    fn silence_and_strength_0_leave_everything() {
        let modes = FaceModes::open(None).unwrap();
        let still = Array3::zeros((30, 68, 3));
        let silence = Prosody::of(&crate::audio::Waveform {
            samples: vec![0.0; 16_000],
        });
        let mut moved = still.clone();
        let variety = Variety::draw(&silence, 1);
        variety.vary_mouth(&mut moved, FPS, 1.0);
        variety.vary_brows(&mut moved, FPS, &modes, 1.0).unwrap();
        assert_eq!(moved, still);
    }
}
