//! The shapes of the mouth by which a viewer tells sounds apart, apart from contacts of the lips.

use ndarray::{Array2, ArrayView2};

use super::travel::{EARLY_S, sure, travel};

/// Seconds that lips and jaw take to reach a shape, and again to leave it.
const TRAVEL_S: f64 = 0.08;
/// Where the mouth has to be in some phones. Each length has a least and a largest value, metres
/// relative to the neutral face.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LipShape {
    /// Its name.
    pub name: &'static str,
    /// Its phones, each with how much of the shape it takes.
    phones: &'static [(&'static str, f32)],
    /// How far forward the lips are on average.
    pub forward_m: [f32; 2],
    /// Distance between the corners of the mouth.
    pub width_m: [f32; 2],
    /// Opening of the lips at the middle.
    pub gap_m: [f32; 2],
    /// How far the chin hangs.
    pub chin_m: [f32; 2],
}

const FREE: [f32; 2] = [f32::NEG_INFINITY, f32::INFINITY];

const fn least(metres: f32) -> [f32; 2] {
    [metres, f32::INFINITY]
}

const fn most(metres: f32) -> [f32; 2] {
    [f32::NEG_INFINITY, metres]
}

/// The shapes. Degrees and lengths are ours: what viewers need to tell the sounds apart. Recorded
/// lips show less of them, because the depth of a tracked face is an estimate.
pub const LIP_SHAPES: [LipShape; 4] = [
    LipShape {
        name: "oo",
        phones: &[("u", 1.0), ("w", 1.0), ("y", 0.9), ("ʊ", 0.3)],
        forward_m: least(4.4e-3),
        width_m: most(-6e-3),
        gap_m: most(6e-3),
        chin_m: most(8e-3),
    },
    LipShape {
        name: "sh",
        phones: &[("ʃ", 1.0), ("ʒ", 1.0)],
        forward_m: least(4.8e-3),
        width_m: FREE,
        gap_m: [3.2e-3, 5.5e-3],
        chin_m: most(4e-3),
    },
    LipShape {
        name: "th",
        phones: &[("θ", 1.0), ("ð", 1.0)],
        forward_m: FREE,
        width_m: FREE,
        gap_m: [8e-3, 10e-3],
        chin_m: [5e-3, 7e-3],
    },
    LipShape {
        name: "oh",
        phones: &[("o", 1.0)],
        forward_m: least(2e-3),
        width_m: most(-3e-3),
        gap_m: least(8e-3),
        chin_m: least(5.5e-3),
    },
];

/// How far the mouth goes to each of [`LIP_SHAPES`] over time.
///
/// ```
/// use anyface::speech::{LIP_SHAPES, LipShapes};
///
/// let shapes = LipShapes::at(LIP_SHAPES[0].name, 0.5..0.6);
/// let degrees = shapes.at_frames(50, 50.0);
/// assert!(degrees[[27, 0]] > 0.99 && degrees[[15, 0]] == 0.0 && degrees[[27, 1]] == 0.0);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct LipShapes {
    /// `[R, shapes]`, 0 to 1.
    degree: Array2<f32>,
    rate_hz: f64,
}

impl LipShapes {
    /// From log-posteriors `[R, K]`, `rate_hz` rows a second. `phones` `[K]`: the sign of each class.
    pub(super) fn heard(
        posteriors: ArrayView2<'_, f32>,
        phones: &[String],
        rate_hz: f64,
    ) -> LipShapes {
        let likely = posteriors.mapv(f32::exp);
        let mut degree = Array2::zeros((likely.nrows(), LIP_SHAPES.len()));
        for (shape, mut column) in LIP_SHAPES.iter().zip(degree.columns_mut()) {
            let known = phones.iter().enumerate();
            let of_shape: Vec<(usize, f32)> = known
                .filter_map(|(class, sign)| {
                    let phone = shape.phones.iter().find(|(known, _)| known == sign)?;
                    Some((class, phone.1))
                })
                .collect();
            for (row, degree) in likely.outer_iter().zip(&mut column) {
                let sum: f32 = of_shape.iter().map(|&(class, _)| row[class]).sum();
                let weighted: f32 = of_shape
                    .iter()
                    .map(|&(class, part)| part * row[class])
                    .sum();
                *degree = sure(sum) * weighted / sum.max(f32::MIN_POSITIVE);
            }
        }
        LipShapes { degree, rate_hz }
    }

    /// No shape at all.
    pub fn none() -> LipShapes {
        let degree = Array2::zeros((0, LIP_SHAPES.len()));
        LipShapes {
            degree,
            rate_hz: 100.0,
        }
    }

    /// One shape, complete during `seconds`; nothing if no shape has that name.
    pub fn at(name: &str, seconds: std::ops::Range<f64>) -> LipShapes {
        let rate_hz = 100.0;
        let row = |time_s: f64| ((time_s + EARLY_S) * rate_hz).round() as usize;
        let (first, end) = (row(seconds.start), row(seconds.end));
        let mut degree = Array2::zeros((end + 1, LIP_SHAPES.len()));
        for (shape, mut column) in LIP_SHAPES.iter().zip(degree.columns_mut()) {
            if shape.name == name {
                column.slice_mut(ndarray::s![first..=end]).fill(1.0);
            }
        }
        LipShapes { degree, rate_hz }
    }

    /// The degree of each shape at each motion frame, `[T, shapes]`. The mouth starts early enough to
    /// be there in time.
    pub fn at_frames(&self, frames: usize, fps: f64) -> Array2<f32> {
        travel(self.degree.view(), self.rate_hz, TRAVEL_S, frames, fps)
    }
}

#[cfg(test)]
mod tests {
    use super::{super::PhoneModel, *};

    #[test]
    fn every_phone_of_a_shape_is_one_that_the_model_hears() {
        let phones = PhoneModel::open(None).unwrap();
        for (name, _) in LIP_SHAPES.iter().flat_map(|shape| shape.phones) {
            assert!(phones.classes().iter().any(|known| known == name), "{name}");
        }
    }

    #[test]
    fn an_unlikely_phone_asks_for_nothing_and_a_likely_one_for_all_of_its_shape() {
        let phones = PhoneModel::open(None).unwrap();
        let classes = phones.classes();
        let of = |name: &str| classes.iter().position(|known| known == name).unwrap();
        let mut likely = Array2::from_elem((3, classes.len()), 1e-6);
        (likely[[0, of("u")]], likely[[1, of("u")]]) = (0.1, 0.4);
        (likely[[1, of("y")]], likely[[2, of("θ")]]) = (0.4, 0.9);
        let shapes = LipShapes::heard(likely.mapv(f32::ln).view(), classes, 100.0);
        let row = |r: usize| shapes.degree.row(r).to_vec();
        assert!(row(0).iter().all(|degree| *degree < 1e-3), "{:?}", row(0));
        assert!((row(1)[0] - 0.95).abs() < 1e-3, "{:?}", row(1));
        assert!(row(2)[2] > 0.999 && row(2)[0] < 1e-3, "{:?}", row(2));
    }
}
