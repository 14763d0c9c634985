//! When the words of a text are said: the most probable path of its letters through the frames.
//!
//! Twin of `training/speech/letters.py`. A path (Viterbi, "Error bounds for convolutional codes", 1967)
//! goes from a pause through the units of a word to the next pause; units may be silent at a cost, pauses
//! may be left out.

use std::ops::Range;

use ndarray::Array2;

use super::letters::Word;

/// Nepers that a silent unit costs.
const SILENT_COST: f32 = 5.0;
/// Nepers of a vowel that the name of a letter does not have.
const NAME_COST: f32 = 1.0;
/// States in a row that a path may leave out.
const LONGEST_SKIP: usize = 2;
/// States to either side of the best one that a path may be in. Texts with fewer states get the best
/// path of all; it bounds the memory of longer ones to a byte for each of these and each frame.
const REACH: usize = 1000;

/// A state of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct State {
    /// Column of the emissions.
    pub(super) column: usize,
    /// Index of the word; `None` for a pause.
    pub(super) word: Option<usize>,
    /// Nepers of leaving it out; infinite where it must be heard.
    pub(super) skip: f32,
}

/// A pause, the units of a word, a pause, …; words without units have no state. `pause` is the column
/// of a pause.
pub(super) fn states_of(words: &[Word], pause: usize) -> Vec<State> {
    let state = |column, word, skip| State { column, word, skip };
    let mut out = vec![state(pause, None, 0.0)];
    for (word, said) in words.iter().enumerate() {
        let count = said.units.len();
        for (place, &column) in said.units.iter().enumerate() {
            let skip = match said.is_name {
                true if place != 1 => NAME_COST,
                // One of two units is always heard, so that no word vanishes between two pauses.
                false if count > 2 || count == 2 && place == 1 => SILENT_COST,
                _ => f32::INFINITY,
            };
            out.push(state(column, Some(word), skip));
        }
        if count > 0 {
            out.push(state(pause, None, 0.0));
        }
    }
    out
}

/// State of each frame on the best path, `[T]`; none where there is no way through.
///
/// `emission`: nepers of each frame in each column, `[T, columns]`. From a state the path stays, goes
/// on, or leaves out up to two states at their cost.
pub(super) fn best_path(emission: &Array2<f32>, states: &[State]) -> Option<Vec<usize>> {
    best_path_within(emission, states, REACH)
}

/// How a path came to the states of one frame: the first state, and by how many states each came.
struct Back {
    first: usize,
    moves: Vec<u8>,
}

fn best_path_within(emission: &Array2<f32>, states: &[State], reach: usize) -> Option<Vec<usize>> {
    let skipped = |range: Range<usize>| -> f64 {
        let costs = states[range].iter().map(|state| f64::from(state.skip));
        costs.sum()
    };
    let (count, mut backs) = (states.len(), Vec::with_capacity(emission.nrows()));
    // Scores of the states from `first` on; before the first frame the path stands before them all.
    let mut scores: Vec<f64> = Vec::new();
    let mut window = 0..count.min(LONGEST_SKIP + 1);
    for (t, row) in emission.rows().into_iter().enumerate() {
        let before = std::mem::take(&mut scores);
        let known = backs.last().map_or(0, |back: &Back| back.first);
        let from = |state: usize, step: usize| -> Option<f64> {
            let score = *before.get(state.checked_sub(step)?.checked_sub(known)?)?;
            Some(score - skipped(state + 1 - step.max(1)..state))
        };
        let mut moves = Vec::with_capacity(window.len());
        for state in window.clone() {
            let (mut best, mut by) = (f64::NEG_INFINITY, 0);
            if t == 0 {
                best = -skipped(0..state);
            } else {
                for step in 0..LONGEST_SKIP + 2 {
                    if let Some(score) = from(state, step).filter(|score| *score > best) {
                        (best, by) = (score, step as u8);
                    }
                }
            }
            scores.push(best + f64::from(row[states[state].column]));
            moves.push(by);
        }
        backs.push(Back {
            first: window.start,
            moves,
        });
        window = next_window(&scores, &window, count, reach);
    }
    let last = backs.last()?.first;
    let ends = scores.iter().enumerate().filter_map(|(index, score)| {
        let left = last + index + 1..count;
        (left.len() <= LONGEST_SKIP).then(|| (last + index, score - skipped(left)))
    });
    let (end, best) = ends.max_by(|a, b| a.1.total_cmp(&b.1))?;
    best.is_finite().then(|| back_from(end, &backs))
}

/// The states that the next frame may be in: those that can be reached, within `reach` of the best.
fn next_window(scores: &[f64], window: &Range<usize>, count: usize, reach: usize) -> Range<usize> {
    let best = (0..scores.len()).max_by(|a, b| scores[*a].total_cmp(&scores[*b]));
    let best = window.start + best.unwrap_or(0);
    let end = (window.end + LONGEST_SKIP + 1).min(count);
    window.start.max(best.saturating_sub(reach))..end.min(best + reach + 1)
}

fn back_from(end: usize, backs: &[Back]) -> Vec<usize> {
    let mut path = vec![end; backs.len()];
    for t in (1..backs.len()).rev() {
        let back = &backs[t];
        path[t - 1] = path[t] - usize::from(back.moves[path[t] - back.first]);
    }
    path
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every path there is, one after the other.
    fn slow_best(emission: &Array2<f32>, states: &[State]) -> Option<f64> {
        fn from(emission: &Array2<f32>, states: &[State], t: usize, at: usize) -> f64 {
            let here = f64::from(emission[[t, states[at].column]]);
            let cost = |from: usize, to: usize| -> f64 {
                states[from..to].iter().map(|s| f64::from(s.skip)).sum()
            };
            if t + 1 == emission.nrows() {
                let left = states.len() - at - 1;
                let end = if left <= LONGEST_SKIP {
                    -cost(at + 1, states.len())
                } else {
                    f64::NEG_INFINITY
                };
                return here + end;
            }
            let last = (at + LONGEST_SKIP + 1).min(states.len() - 1);
            let next = (at..=last).map(|to| {
                let over = if to > at { cost(at + 1, to) } else { 0.0 };
                from(emission, states, t + 1, to) - over
            });
            here + next.fold(f64::NEG_INFINITY, f64::max)
        }
        let first = (0..states.len().min(LONGEST_SKIP + 1)).map(|at| {
            let cost: f64 = states[..at].iter().map(|s| f64::from(s.skip)).sum();
            from(emission, states, 0, at) - cost
        });
        Some(first.fold(f64::NEG_INFINITY, f64::max)).filter(|best| best.is_finite())
    }

    fn score(emission: &Array2<f32>, states: &[State], path: &[usize]) -> f64 {
        let cost =
            |range: Range<usize>| -> f64 { states[range].iter().map(|s| f64::from(s.skip)).sum() };
        let said = path.iter().enumerate();
        let said: f64 = said
            .map(|(t, s)| f64::from(emission[[t, states[*s].column]]))
            .sum();
        let steps = path.windows(2).filter(|pair| pair[1] > pair[0]);
        let left: f64 = steps.map(|pair| cost(pair[0] + 1..pair[1])).sum();
        said - left - cost(0..path[0]) - cost(path[path.len() - 1] + 1..states.len())
    }

    fn noise(frames: usize, columns: usize, seed: u32) -> Array2<f32> {
        let mut state = seed.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        Array2::from_shape_simple_fn((frames, columns), || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32 * -8.0
        })
    }

    #[test]
    fn the_best_path_is_the_best_of_all() {
        let texts: [&[&[usize]]; 4] = [&[&[0]], &[&[0, 1], &[2]], &[&[1, 0, 2], &[]], &[]];
        for seed in 0..12 {
            for text in texts {
                let words: Vec<Word> = text.iter().map(|word| Word::of(word)).collect();
                let states = states_of(&words, 3);
                let emission = noise(6, 4, seed);
                let path = best_path(&emission, &states).unwrap();
                let best = slow_best(&emission, &states).unwrap();
                assert!(
                    (score(&emission, &states, &path) - best).abs() < 1e-5,
                    "{path:?}"
                );
            }
        }
    }

    #[test]
    fn where_frames_are_too_few_there_is_no_path() {
        let states = states_of(&[[0], [1], [2]].map(|word| Word::of(&word)), 3);
        assert!(best_path(&noise(2, 4, 1), &states).is_none());
        assert!(best_path(&noise(3, 4, 1), &states).is_some());
        assert!(best_path(&Array2::zeros((0, 4)), &states).is_none());
    }

    #[test]
    fn a_long_text_is_followed_within_reach() {
        let words: Vec<Word> = (0..60)
            .map(|w| Word::of(&[w % 3, (w + 1) % 3, (w + 2) % 3]))
            .collect();
        let states = states_of(&words, 3);
        // Four frames for each state, in their order.
        let wanted: Vec<usize> = (0..4 * states.len()).map(|t| t / 4).collect();
        let emission = Array2::from_shape_fn((wanted.len(), 4), |(t, column)| {
            if states[wanted[t]].column == column {
                0.0
            } else {
                -5.0
            }
        });
        assert!(best_path_within(&emission, &states, 8).unwrap() == wanted);
        assert!(best_path(&emission, &states).unwrap() == wanted);
    }
}
