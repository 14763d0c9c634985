//! Finds when the words of a text are spoken, by the most probable path of its letters through the
//! frames.
//!
//! Twin of `training/speech/letters.py`. A path (Viterbi, "Error bounds for convolutional codes",
//! 1967) goes from a pause through the units of a word to the next pause. Units may be silent at a
//! cost. Pauses may be skipped.

use std::ops::Range;

use ndarray::{Array2, ArrayView1};

use super::letters::Word;

/// Cost of a silent unit, nepers.
const SILENT_COST: f32 = 5.0;
/// Cost of skipping the vowel before or after a consonant that is read by its name, nepers.
const NAME_COST: f32 = 1.0;
/// The fewest rows of a unit that sounds, since each unit has this many states in a row.
const LEAST_ROWS: usize = 3;
/// Most states in a row that a path may skip: two units and a pause.
const LONGEST_SKIP: usize = 2 * LEAST_ROWS + 1;
/// Cost of skipping a state that must not be skipped, nepers.
const NEVER: f32 = 1e9;
/// How many states a path may be away from the best one, to either side. For texts with fewer
/// states the path is the best of all. For longer texts this limits the memory to a byte for each
/// of these states and each frame.
const REACH: usize = 1500;

/// Cost of each row of a word outside the rows in which it may be said, nepers. Times that are known
/// of a word may be wrong, so this is not [`NEVER`].
const ASTRAY: f64 = 8.0;

/// A state of a path.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct State {
    /// Column of the emissions.
    pub(super) column: usize,
    /// Index of the word; `None` for a pause.
    pub(super) word: Option<usize>,
    /// Cost of skipping the state, nepers.
    pub(super) skip: f32,
    /// The rows in which the word may be said.
    pub(super) rows: Range<usize>,
}

impl State {
    /// How likely the state is in a row, nepers.
    fn likelihood(&self, row: usize, emission: ArrayView1<'_, f32>) -> f64 {
        let astray = if self.rows.contains(&row) {
            0.0
        } else {
            ASTRAY
        };
        f64::from(emission[self.column]) - astray
    }
}

/// The states of a text: a pause, the units of a word, a pause, and so on. Words without units have
/// no states. `pause`: the column of a pause.
pub(super) fn states_of(words: &[Word], pause: usize) -> Vec<State> {
    let state = |column, word, skip| State {
        column,
        word,
        skip,
        rows: 0..usize::MAX,
    };
    let mut out = vec![state(pause, None, 0.0)];
    for (word, said) in words.iter().enumerate() {
        let count = said.units.len();
        for (place, &column) in said.units.iter().enumerate() {
            let cost = match said.is_name {
                true if place != 1 => NAME_COST,
                // The first of two units always sounds, so that no word vanishes between pauses.
                false if count > 2 || count == 2 && place == 1 => SILENT_COST,
                _ => NEVER,
            };
            let unit = state(column, Some(word), cost / LEAST_ROWS as f32);
            out.extend(std::iter::repeat_n(unit, LEAST_ROWS));
        }
        if count > 0 {
            out.push(state(pause, None, 0.0));
        }
    }
    out
}

/// The state of each frame on the best path, `[T]`, and how likely the path is, nepers. `None` if there
/// is no path.
///
/// `emission`: nepers of each frame in each column, `[T, columns]`. From a state the path stays,
/// advances by one, or skips states at their cost.
pub(super) fn best_path(emission: &Array2<f32>, states: &[State]) -> Option<(Vec<usize>, f64)> {
    best_path_within(emission, states, REACH)
}

/// How the best paths reached the states of one frame: the first of these states, and for each
/// state by how many states its path advanced.
struct Back {
    first: usize,
    moves: Vec<u8>,
}

fn best_path_within(
    emission: &Array2<f32>,
    states: &[State],
    reach: usize,
) -> Option<(Vec<usize>, f64)> {
    let count = states.len();
    let costs = costs_before(states);
    let mut backs: Vec<Back> = Vec::with_capacity(emission.nrows());
    // Scores of the window's states in the latest frame. Before the first frame the path stands
    // before all states.
    let mut scores: Vec<f64> = Vec::new();
    let mut window = 0..count.min(LONGEST_SKIP + 1);
    for (t, row) in emission.rows().into_iter().enumerate() {
        let known = backs.last().map(|back| back.first);
        let steps = window.clone().map(|state| match known {
            None => (-costs[state], 0),
            Some(first) => best_step(state, &scores, first, &costs),
        });
        let (next, moves): (Vec<f64>, Vec<u8>) = steps
            .zip(&states[window.clone()])
            .map(|((score, step), state)| (score + state.likelihood(t, row), step))
            .unzip();
        let first = window.start;
        backs.push(Back { first, moves });
        scores = next;
        window = next_window(&scores, &window, count, reach);
    }
    let first = backs.last()?.first;
    let ends = (first..first + scores.len()).filter(|end| count - 1 - end <= LONGEST_SKIP);
    let ends = ends.map(|end| (end, scores[end - first] - (costs[count] - costs[end + 1])));
    let (end, best) = ends.max_by(|a, b| a.1.total_cmp(&b.1))?;
    (best > -f64::from(NEVER) / 10.0).then(|| (back_from(end, &backs), best))
}

/// The cost of skipping all states before each state, `[N + 1]`, nepers.
fn costs_before(states: &[State]) -> Vec<f64> {
    let mut sum = 0.0;
    let after = states.iter().map(|state| {
        sum += f64::from(state.skip);
        sum
    });
    std::iter::once(0.0).chain(after).collect()
}

/// The best score for reaching a state, and by how many states the path advances to it.
/// `scores`: those of the states from `first` on, in the frame before.
fn best_step(state: usize, scores: &[f64], first: usize, costs: &[f64]) -> (f64, u8) {
    let (mut best, mut by) = (f64::NEG_INFINITY, 0);
    for step in 0..=(LONGEST_SKIP + 1).min(state.saturating_sub(first)) {
        let left_out = if step > 1 {
            costs[state] - costs[state + 1 - step]
        } else {
            0.0
        };
        let from = scores.get(state - step - first);
        if let Some(score) = from.map(|score| score - left_out).filter(|s| *s > best) {
            (best, by) = (score, step as u8);
        }
    }
    (best, by)
}

/// The states that the next frame may be in: the reachable ones within `reach` of the best state.
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

    /// Tries every path, one after the other.
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
        Some(first.fold(f64::NEG_INFINITY, f64::max))
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
        let texts: [&[&[usize]]; 4] = [&[&[0]], &[&[0, 1]], &[&[1, 0, 2], &[]], &[]];
        for seed in 0..12 {
            for text in texts {
                let words: Vec<Word> = text.iter().map(|word| Word::of(word)).collect();
                let states = states_of(&words, 3);
                let emission = noise(7, 4, seed);
                let (path, likely) = best_path(&emission, &states).unwrap();
                let best = slow_best(&emission, &states).unwrap();
                let walked = score(&emission, &states, &path);
                assert!((walked - best).abs() < 1e-5, "{path:?}");
                assert!((likely - best).abs() < 1e-5, "{path:?}");
            }
        }
    }

    #[test]
    fn where_frames_are_too_few_there_is_no_path() {
        let states = states_of(&[[0], [1], [2]].map(|word| Word::of(&word)), 3);
        assert!(best_path(&noise(3 * LEAST_ROWS - 1, 4, 1), &states).is_none());
        assert!(best_path(&noise(3 * LEAST_ROWS, 4, 1), &states).is_some());
        assert!(best_path(&Array2::zeros((0, 4)), &states).is_none());
    }

    #[test]
    fn a_long_text_is_followed_within_reach() {
        let words: Vec<Word> = (0..60)
            .map(|w| Word::of(&[w % 3, (w + 1) % 3, (w + 2) % 3]))
            .collect();
        let states = states_of(&words, 3);
        // A frame for each state, and four for pauses.
        let frames =
            |(state, s): (usize, &State)| vec![state; if s.word.is_none() { 4 } else { 1 }];
        let expected: Vec<usize> = states.iter().enumerate().flat_map(frames).collect();
        let emission = Array2::from_shape_fn((expected.len(), 4), |(t, column)| {
            if states[expected[t]].column == column {
                0.0
            } else {
                -5.0
            }
        });
        assert!(best_path_within(&emission, &states, 20).unwrap().0 == expected);
        assert!(best_path(&emission, &states).unwrap().0 == expected);
    }
}
