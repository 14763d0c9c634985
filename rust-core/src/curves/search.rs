//! Chooses the frames that get keys, by dynamic programming over all frames.

use super::{
    segment::{LONGEST, Table},
    slopes::natural,
};

/// The search tries longer segments until more than this many in a row do not fit.
const PATIENCE: usize = 12;
/// A key costs 1. A key at an extreme costs this much less.
const EXTREME: f64 = 0.3;
/// A segment whose error reaches its limit costs this much more.
const ERROR: f64 = 0.2;

/// The frames of the keys, including the first and the last frame.
pub fn rows(values: &[f64], limits: &[f64], fixed: &[bool]) -> Vec<usize> {
    let count = values.len();
    if count < 2 {
        return (0..count).collect();
    }
    let slopes = natural(values);
    let (mut cost, mut from) = (vec![f64::INFINITY; count], vec![0; count]);
    cost[0] = 0.0;
    for to in 1..count {
        let key = 1.0 - if is_extreme(values, to) { EXTREME } else { 0.0 };
        let mut missed = 0;
        for length in 1..=LONGEST.min(to) {
            let first = to - length;
            let (part, room) = (&values[first..=to], &limits[first..=to]);
            let excess = Table::of(length).excess(part, room, [slopes[first], slopes[to]]);
            if excess <= 1.0 {
                missed = 0;
                let total = cost[first] + key + ERROR * excess * excess;
                if total < cost[to] {
                    (cost[to], from[to]) = (total, first);
                }
            } else {
                missed += 1;
            }
            if fixed[first] || missed > PATIENCE {
                break;
            }
        }
    }
    let mut keys = vec![count - 1];
    while let Some(&last) = keys.last()
        && last > 0
    {
        keys.push(from[last]);
    }
    keys.reverse();
    keys
}

fn is_extreme(values: &[f64], at: usize) -> bool {
    let Some(&after) = values.get(at + 1) else {
        return false;
    };
    let (before, here) = (values[at - 1], values[at]);
    (here - before) * (after - here) < 0.0
}
