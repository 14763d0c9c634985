//! The differences between two takes of one actor.
//!
//! Seeded changes of how far the mouth opens, widens and protrudes, of the side it prefers, and of
//! the brows. Everything that is added fades out while nobody speaks, and lips that close still
//! close as before. The sizes come from grid_s1. The corners of his mouth deviate from symmetry
//! within a clip by 0.38 mm up and 0.55 mm across (medians of standard deviations). Of this,
//! changes slower than 1 Hz have 0.26 and 0.37 mm, and faster ones 0.22 and 0.34 mm. From clip to
//! clip the means differ by 0.33 mm up. The lips' openings left and right differ by 4 %. His brows
//! deviate by 0.35 mm within a clip, 0.23 mm of it slower than 1 Hz. Their means differ by 0.55 mm.

use ndarray::{Array2, Array3};

use super::{
    articulation::keep_closures, brow_accents::RAISING, chance::Chance, face_modes::FaceModes,
    phrases::Phrases, slow_noise::SlowNoise,
};
use crate::{
    Result,
    audio::Prosody,
    mesh::ibug::{BROWS, MOUTH, speaking},
};

/// The number of the random stream that this process draws from.
const STREAM: u64 = u64::MAX - 4;
/// Frequencies of the slow changes of the mouth.
const MOUTH_HZ: (f64, f64) = (0.2, 0.8);
/// Frequencies of the slow changes of the brows.
const BROWS_HZ: (f64, f64) = (0.12, 0.6);
/// Standard deviation of the constant part of a take's scales: across, up and out of the face.
const TAKE: [f64; 3] = [0.08, 0.06, 0.08];
/// Standard deviation of the changes of these scales.
const CHANGE: [f64; 3] = [0.16, 0.13, 0.16];
/// Standard deviation of how much more one side of the mouth opens than its middle.
const SIDE: f64 = 0.04;
/// Standard deviations of the mouth's shift to a side, metres: constant, slow and quick part.
const SHIFT_M: [f64; 3] = [0.2e-3, 0.32e-3, 0.24e-3];
/// The same for the tilt, which raises one corner by this much and lowers the other.
const TILT_M: [f64; 3] = [0.14e-3, 0.2e-3, 0.14e-3];
/// Frequencies of the quick changes.
const QUICK_HZ: (f64, f64) = (1.2, 3.5);
/// Standard deviations of the weight of raised brows: between phrases, slow and quick part.
const RAISE: [f64; 3] = [0.06, 0.016, 0.012];
/// How long the brows take from one phrase to the next, seconds.
const RAISE_S: f64 = 0.7;
/// Standard deviation of the weight of knit brows.
const KNIT: f64 = 0.03;
/// Standard deviation of the share by which one brow moves further and the other less.
const BROW_SIDE: f64 = 0.25;
/// Positions of the mouth's landmarks across at rest, −1 at the right corner to 1 at the left.
const PLACES: [f32; 20] = [
    -1.0, -0.66, -0.3, 0.0, 0.3, 0.66, 1.0, 0.66, 0.33, 0.0, -0.33, -0.66, -0.9, -0.33, 0.0, 0.33,
    0.9, 0.33, 0.0, -0.33,
];

/// The changes of a take.
pub(super) struct Variety {
    phrases: Phrases,
    /// 0 for seed 0, whose mouth goes as far as the model learned, and 1 for others.
    size: f64,
    take: [f64; 3],
    change: [SlowNoise; 3],
    side: SlowNoise,
    shift: Change,
    tilt: Change,
    /// One value per phrase, in standard deviations.
    raises: Vec<f64>,
    raise: [SlowNoise; 2],
    knit: SlowNoise,
    brow_side: SlowNoise,
}

/// A constant part, slow changes and quick changes.
struct Change {
    take: f64,
    slow: SlowNoise,
    quick: SlowNoise,
}

impl Change {
    fn draw(chance: &mut Chance) -> Self {
        Change {
            take: deviate(chance),
            slow: SlowNoise::new(chance, MOUTH_HZ.0, MOUTH_HZ.1),
            quick: SlowNoise::new(chance, QUICK_HZ.0, QUICK_HZ.1),
        }
    }

    fn at(&self, time_s: f64, [take, slow, quick]: [f64; 3]) -> f64 {
        take * self.take + slow * self.slow.at(time_s) + quick * self.quick.at(time_s)
    }
}

/// A random number from a bell curve of standard deviation 1, within ±2.65.
fn deviate(chance: &mut Chance) -> f64 {
    5.3 * (chance.bell() - 0.5)
}

/// How the lower face differs at an instant.
#[derive(Debug, Clone, Copy)]
pub(super) struct MouthVariety {
    /// Factors on its motion across, up and out of the face.
    pub(super) scale: [f32; 3],
    /// The share by which the left side opens more and the right side less.
    pub(super) side: f32,
    /// How far the mouth is shifted to the left, metres.
    pub(super) shift_m: f32,
    /// How much the left corner is raised and the right one lowered, metres.
    pub(super) tilt_m: f32,
}

/// How the brows differ at an instant, in weights of ARKit's shapes, which may be negative.
#[derive(Debug, Clone, Copy)]
pub(super) struct BrowVariety {
    pub(super) raised: f32,
    pub(super) knit: f32,
    /// The share by which the left brow moves further and the right one less.
    pub(super) side: f32,
}

impl Variety {
    /// Draws a take. The same seed gives the same take.
    pub(super) fn draw(prosody: &Prosody, seed: u64) -> Self {
        let mut chance = Chance::new(seed, STREAM);
        let take = TAKE.map(|deviation| deviation * deviate(&mut chance));
        let mut mouth = || SlowNoise::new(&mut chance, MOUTH_HZ.0, MOUTH_HZ.1);
        let change: [SlowNoise; 3] = std::array::from_fn(|_| mouth());
        let side = mouth();
        let (shift, tilt) = (Change::draw(&mut chance), Change::draw(&mut chance));
        let mut brows = |(low, high)| SlowNoise::new(&mut chance, low, high);
        let raise = [brows(BROWS_HZ), brows(QUICK_HZ)];
        let (knit, brow_side) = (brows(BROWS_HZ), brows(BROWS_HZ));
        let phrases = Phrases::of(prosody);
        let raises = phrases.0.iter().map(|_| deviate(&mut chance)).collect();
        Variety {
            phrases,
            // Stretches of a long sound differ in the upper half of the seed.
            size: if seed as u32 == 0 { 0.0 } else { 1.0 },
            take,
            change,
            side,
            shift,
            tilt,
            raises,
            raise,
            knit,
            brow_side,
        }
    }

    /// How the mouth differs at `time_s`.
    pub(super) fn mouth(&self, time_s: f64, strength: f32) -> MouthVariety {
        let strength = f64::from(strength);
        let size = strength * self.phrases.activity(time_s);
        MouthVariety {
            scale: std::array::from_fn(|i| {
                let change = self.take[i] + CHANGE[i] * self.change[i].at(time_s);
                (1.0 + self.size * strength * change).max(0.2) as f32
            }),
            side: (strength * SIDE * self.side.at(time_s)) as f32,
            shift_m: (size * self.shift.at(time_s, SHIFT_M)) as f32,
            tilt_m: (size * self.tilt.at(time_s, TILT_M)) as f32,
        }
    }

    /// How the brows differ at `time_s`.
    pub(super) fn brows(&self, time_s: f64, strength: f32) -> BrowVariety {
        let strength = f64::from(strength);
        let size = strength * self.phrases.activity(time_s);
        let [slow, quick] = &self.raise;
        let raised = RAISE[0] * self.phrases.between(&self.raises, 0.0, RAISE_S, time_s)
            + RAISE[1] * slow.at(time_s)
            + RAISE[2] * quick.at(time_s);
        BrowVariety {
            raised: (size * raised) as f32,
            knit: (size * KNIT * self.knit.at(time_s)) as f32,
            side: (strength * BROW_SIDE * self.brow_side.at(time_s)) as f32,
        }
    }

    /// Varies the lower face of `[T, 68, 3]`, canonical metres. The gaps of closed lips stay.
    pub(super) fn vary_mouth(&self, moved: &mut Array3<f32>, fps: f64, strength: f32) {
        let sampled = moved.clone();
        for (t, mut frame) in moved.outer_iter_mut().enumerate() {
            let MouthVariety {
                scale,
                side,
                shift_m,
                tilt_m,
            } = self.mouth(t as f64 / fps, strength);
            for n in speaking() {
                for (x, scale) in frame.row_mut(n).iter_mut().zip(scale) {
                    *x *= scale;
                }
            }
            for (n, place) in MOUTH.zip(PLACES) {
                frame[[n, 1]] = frame[[n, 1]] * (1.0 + side * place) + tilt_m * place;
                frame[[n, 0]] += shift_m;
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
        let raise = sum(modes, RAISING)?;
        let knit = sum(modes, ["browDown_L", "browDown_R"])?;
        for (t, mut frame) in moved.outer_iter_mut().enumerate() {
            let brows = self.brows(t as f64 / fps, strength);
            for n in BROWS {
                let side = if n < BROWS.start + 5 {
                    1.0 - brows.side
                } else {
                    1.0 + brows.side
                };
                let mut row = frame.row_mut(n);
                row.scaled_add(side * brows.raised, &raise.row(n));
                row.scaled_add(side * brows.knit, &knit.row(n));
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

    /// A jaw that opens three times a second, lips that round, and closures in between.
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

    /// Standard deviation of a landmark's position between takes, averaged over frames and
    /// `region`, millimetres.
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
        assert!((0.3..1.2).contains(&brows), "brows {brows} mm");
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
    fn the_first_take_opens_as_far_as_the_model_and_others_differ() {
        let voice = voice(9, 40);
        let scale = |seed: u64| Variety::draw(&voice, seed).mouth(1.0, 1.0).scale;
        assert_eq!(scale(0), [1.0; 3]);
        assert!((1..6).all(|seed| scale(seed) != [1.0; 3]));
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
