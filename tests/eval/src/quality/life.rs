//! Compares the life around the mouth with the tracked speaker's: head rotation, gaze and blinks.

use std::path::Path;

use ndarray::{Array2, Array3, ArrayView1, ArrayView2};

use super::{
    bootstrap::{estimate, mean},
    clip::Clip,
    grid::{FPS, TRACK, every_tenth, spans},
    row::Row,
    speaker::{Speaker, Wish},
};
use crate::metrics::quantile;
use crate::tensors::TensorFile;
use anyface::Result;

/// The quantities measured for each clip.
pub(super) const QUANTITIES: [&str; 5] = [
    "pitch, standard deviation, degrees",
    "yaw, standard deviation, degrees",
    "roll, standard deviation, degrees",
    "saccades a minute",
    "blinks a minute",
];
const RADIANS_PER_UNIT: f64 = 1e-4;
const WEIGHT_PER_UNIT: f64 = 1.0 / 255.0;
/// Rotation of the eye at a gaze weight of 1, degrees. ARKit does not define it; rigs use about
/// this much.
const GAZE_DEGREES: f64 = 30.0;
/// A saccade turns the eyes by more than this from one video frame to the next, degrees.
const SACCADE_DEGREES: f64 = 3.0;
/// Lids count as shut below this share of the clip's wide opening, its 95 % quantile.
const SHUT: f64 = 0.5;
/// Pairs of upper and lower lid landmarks, two for each eye.
const LIDS: [[usize; 2]; 4] = [[37, 41], [38, 40], [43, 47], [44, 46]];
const TAILS: [f64; 3] = [0.05, 0.5, 0.95];
const SECONDS_PER_MINUTE: f64 = 60.0;

/// The motion around the mouth during one clip, at the frame rate of the tracked video.
pub(super) struct Surroundings {
    /// `[T]`: pitch, yaw and roll, degrees; none if the head does not turn by itself.
    pub head: Option<Vec<[f64; 3]>>,
    /// `[T]`: the eyes' yaw and pitch, degrees; none if there is no gaze.
    pub gaze: Option<Vec<[f64; 2]>>,
    /// `[T]`, opening of the lids as a share of the clip's 95 % quantile.
    pub lids: Vec<f64>,
}

pub(super) fn measure(
    speaker: &Speaker,
    wish: &Wish,
    data: &Path,
    clips: &[Clip],
) -> Result<Vec<Row>> {
    let wish = Wish {
        default_controls: true,
        ..wish.clone()
    };
    let recorded: Vec<Numbers> = recorded(data, clips)?
        .iter()
        .map(Surroundings::numbers)
        .collect();
    let numbers = clips.iter().map(|clip| performed(speaker, &wish, clip));
    let numbers: Vec<Numbers> = numbers
        .map(|life| Ok(life?.numbers()))
        .collect::<Result<_>>()?;
    let rows = QUANTITIES.iter().enumerate().map(|(k, quantity)| {
        let of_speaker: Vec<f64> = recorded.iter().filter_map(|n| n[k]).collect();
        let tails = TAILS.map(|q| quantile(&of_speaker, q));
        let values: Vec<f64> = numbers.iter().filter_map(|n| n[k]).collect();
        let numbers = estimate(&values, |of| mean(of.iter().map(|x| **x)));
        let within = numbers.map(|numbers| (tails[0]..=tails[2]).contains(&numbers.value));
        Row::default()
            .with("quantity", "", 0, *quantity)
            .with("recorded", "speaker, 5, 50, 95 %", 2, tails)
            .with("made", "performance", 2, numbers)
            .with("within", "within", 0, within)
    });
    Ok(rows.collect())
}

/// One value for each of [`QUANTITIES`], in their order.
type Numbers = [Option<f64>; 5];

impl Surroundings {
    fn numbers(&self) -> Numbers {
        let turn = |axis: usize| {
            let head = self.head.as_ref()?;
            Some(deviation(head.iter().map(|angles| angles[axis])))
        };
        let minutes = self.lids.len() as f64 / FPS / SECONDS_PER_MINUTE;
        let gaze = self.gaze.as_ref();
        let saccades = gaze.map(|gaze| self.saccades(gaze) as f64 / minutes);
        let blinks = onsets(self.lids.iter().map(|opening| *opening < SHUT)) as f64 / minutes;
        [turn(0), turn(1), turn(2), saccades, Some(blinks)]
    }

    /// Counts jumps of the gaze. The lids must be open before and after a jump.
    fn saccades(&self, gaze: &[[f64; 2]]) -> usize {
        let jumps = (1..gaze.len()).map(|t| {
            let open = self.lids[t - 1].min(self.lids[t]) >= SHUT;
            let turn = (gaze[t][0] - gaze[t - 1][0]).hypot(gaze[t][1] - gaze[t - 1][1]);
            open && turn > SACCADE_DEGREES
        });
        onsets(jumps)
    }
}

fn deviation(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let count = values.clone().count().max(1) as f64;
    let mean = values.clone().sum::<f64>() / count;
    (values.map(|x| (x - mean).powi(2)).sum::<f64>() / count).sqrt()
}

/// How often the state changes from false to true.
fn onsets(states: impl Iterator<Item = bool>) -> usize {
    let mut before = false;
    let mut count = 0;
    for now in states {
        count += usize::from(now && !before);
        before = now;
    }
    count
}

/// Opening of the lids under motion `[T, 68, 3]` of a face, as a share of its 95 % quantile.
fn lids(face: &Array2<f64>, motion: &Array3<f64>) -> Vec<f64> {
    let opening = |t: usize, [a, b]: [usize; 2]| {
        let along = |i: usize| {
            let at = |n: usize| face[[n, i]] + motion[[t, n, i]];
            at(a) - at(b)
        };
        (0..3).map(|i| along(i).powi(2)).sum::<f64>().sqrt()
    };
    let sums = (0..motion.dim().0).map(|t| LIDS.iter().map(|pair| opening(t, *pair)).sum());
    let sums: Vec<f64> = sums.collect();
    let wide = quantile(&sums, TAILS[2]).max(f64::MIN_POSITIVE);
    sums.into_iter().map(|sum| sum / wide).collect()
}

/// The motion that the engine makes around the mouth for a clip's sound.
fn performed(speaker: &Speaker, wish: &Wish, clip: &Clip) -> Result<Surroundings> {
    let performance = speaker.performance(&clip.waveform, FPS, wish)?;
    let life = &performance.life;
    let turn = |row: ArrayView1<'_, f32>| [0, 1, 2].map(|axis| f64::from(row[axis]).to_degrees());
    let between = |eyes: ArrayView2<'_, f32>| {
        [0, 1].map(|axis| f64::from(0.5 * (eyes[[0, axis]] + eyes[[1, axis]])).to_degrees())
    };
    let (head, gaze) = (life.head.outer_iter(), life.gaze.outer_iter());
    let (head, gaze) = (head.map(turn).collect(), gaze.map(between).collect());
    let motion = speaker.landmarks(&performance.motion)?;
    Ok(Surroundings {
        head: Some(head),
        gaze: Some(gaze),
        lids: lids(&clip.neutral, &motion),
    })
}

/// The tracked speaker's motion during `clips`, which must be the first of the held-out clips.
fn recorded(data: &Path, clips: &[Clip]) -> Result<Vec<Surroundings>> {
    let file = TensorFile::read(&data.join(TRACK))?;
    let names = file.words("clips")?;
    let spans = spans(&file, names.len())?;
    let (head, shape) = file.floats("head")?;
    let weights = Weights::read(&file)?;
    let held_out = every_tenth(&names, 0).into_iter();
    let each = held_out.zip(clips).map(|(c, clip)| {
        let frames = || clip.judged.clone().map(|t| spans[c].start + t);
        let angle = |t: usize, axis: usize| {
            (f64::from(head[t * shape[1] + axis]) * RADIANS_PER_UNIT).to_degrees()
        };
        let opening = lids(&clip.speaker, &clip.motion);
        Surroundings {
            head: Some(
                frames()
                    .map(|t| [0, 1, 2].map(|axis| angle(t, axis)))
                    .collect(),
            ),
            gaze: Some(frames().map(|t| weights.gaze_degrees(t)).collect()),
            lids: opening[clip.judged.clone()].to_vec(),
        }
    });
    Ok(each.collect())
}

/// The tracked blend weights that turn the eyes.
struct Weights {
    values: Vec<f32>,
    columns: usize,
    /// Columns of the weights, left eye then right: away from the nose, towards it, up and down.
    out: [usize; 2],
    inward: [usize; 2],
    up: [usize; 2],
    down: [usize; 2],
}

impl Weights {
    fn read(file: &TensorFile) -> Result<Self> {
        let names = file.words("weight_names")?;
        let (values, _) = file.floats("weights")?;
        let both = |way: &str| -> Result<[usize; 2]> {
            let column = |side: &str| {
                let name = format!("eyeLook{way}{side}");
                let position = names.iter().position(|n| *n == name);
                position.ok_or_else(|| file.bad(&format!("expected a weight {name}, got none")))
            };
            Ok([column("Left")?, column("Right")?])
        };
        Ok(Weights {
            columns: names.len(),
            out: both("Out")?,
            inward: both("In")?,
            up: both("Up")?,
            down: both("Down")?,
            values,
        })
    }

    /// Mean yaw towards the subject's left and mean pitch upwards of both eyes, degrees.
    fn gaze_degrees(&self, frame: usize) -> [f64; 2] {
        let at =
            |column: usize| f64::from(self.values[frame * self.columns + column]) * WEIGHT_PER_UNIT;
        let left = at(self.out[0]) - at(self.inward[0]);
        let right = at(self.inward[1]) - at(self.out[1]);
        let up = |eye: usize| at(self.up[eye]) - at(self.down[eye]);
        [
            0.5 * GAZE_DEGREES * (left + right),
            0.5 * GAZE_DEGREES * (up(0) + up(1)),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_saccades_and_blinks_are_counted() {
        let frames = 50;
        let mut life = Surroundings {
            head: Some(
                (0..frames)
                    .map(|t| [f64::from(t % 2) * 2.0, 0.0, 1.0])
                    .collect(),
            ),
            gaze: Some(
                (0..frames)
                    .map(|t| [if t < 25 { 0.0 } else { 8.0 }, 0.0])
                    .collect(),
            ),
            lids: vec![1.0; frames as usize],
        };
        life.lids[10..13].fill(0.1);
        life.lids[40..42].fill(0.2);
        let [pitch, yaw, roll, saccades, blinks] = life.numbers().map(Option::unwrap);
        assert!((pitch - 1.0).abs() < 1e-12 && yaw == 0.0 && roll == 0.0);
        assert!((saccades - 30.0).abs() < 1e-9 && (blinks - 60.0).abs() < 1e-9);
        life.lids[25] = 0.1;
        assert_eq!(life.numbers()[3], Some(0.0));
        life.gaze = None;
        assert_eq!(life.numbers()[3], None);
    }
}
