//! How the strength of an expression rises, holds and falls over time.

use ndarray::{Array2, ArrayView1, ArrayView2};

use super::table::Expressions;
use crate::{
    audio::Prosody,
    conditions::{EMOTIONS, Emotion, Strengths},
    mesh::ibug::{BROWS, LANDMARKS, LIDS, MOUTH},
    motion::{
        brow_accents::{BrowAccent, LEAD_S, ONSET_S, STRESSED, prominences},
        chance::Chance,
        phrases::smooth_step,
    },
};

/// A critically damped motion has gone nine tenths of its way after this many time constants.
const TIME_CONSTANTS: f64 = 3.89;
/// An emotion comes slower by this share for each unit of strength that others still have to lose: the
/// motions of a face that changes from one to another add up.
const CHANGE: f64 = 0.8;
/// A strength below this becomes 0 if its target is 0.
const NOTHING: f32 = 1e-3;
/// First of the random streams of the wandering: one for each region, then one for the level.
const STREAM: u64 = u64::MAX - 100;
/// Time between the random values through which a region wanders, seconds.
const WANDER_S: f64 = 0.8;
/// How far a region wanders from the level that all regions share, at most.
const WANDER: f32 = 0.06;
/// Least and greatest strength at an apex and at a lull, as shares of the requested strength. The
/// expression holds an apex, sinks to a lull and comes back, because a felt expression rarely stays at
/// its height for longer than four seconds (Ekman & Friesen 1982). The mean over time is the requested
/// strength.
const APEX: (f64, f64) = (1.04, 1.2);
const LULL: (f64, f64) = (0.62, 0.86);
/// Least and greatest time that it holds each, and that it takes to sink and to rise, seconds.
const APEX_S: (f64, f64) = (0.9, 3.0);
const LULL_S: (f64, f64) = (0.4, 1.4);
const SINK_S: (f64, f64) = (0.7, 1.2);
const RISE_S: (f64, f64) = (0.4, 0.7);
/// How much a stressed syllable adds per standard deviation of prominence, and at most.
const ACCENT: f32 = 0.08;
const MAX_ACCENT: f32 = 0.14;
/// Brows; lids; nose; jaw and mouth.
const REGIONS: usize = 4;

/// Strengths that move towards their targets. They start at the first targets, at rest.
#[derive(Debug, Clone)]
pub(crate) struct Follower {
    state: Option<[Damped; EMOTIONS.len()]>,
    /// Factor on the times of the table. 0 reaches every target at once.
    pub(crate) onset: f32,
}

/// A strength and how fast it changes.
#[derive(Debug, Clone, Copy)]
struct Damped {
    value: f64,
    per_s: f64,
}

impl Follower {
    pub(crate) fn new(onset: f32) -> Follower {
        Follower { state: None, onset }
    }

    /// The strengths one frame later.
    pub(crate) fn step(&mut self, targets: &Strengths, table: &Expressions, fps: f64) -> Strengths {
        let state = self.state.get_or_insert_with(|| {
            targets.map(|value| Damped {
                value: f64::from(value),
                per_s: 0.0,
            })
        });
        let falling = state.iter().zip(targets).skip(1);
        let falling = falling.map(|(damped, target)| damped.value - f64::from(*target));
        let change: f64 = falling.map(|excess| excess.max(0.0)).sum();
        for ((damped, target), manner) in state.iter_mut().zip(targets).zip(&table.manners) {
            let is_rising = f64::from(*target) > damped.value;
            let slower = if is_rising {
                1.0 + CHANGE * change
            } else {
                table.offset_over_onset
            };
            let onset_s = f64::from(self.onset) * slower * manner.onset_s;
            damped.step(*target, onset_s / TIME_CONSTANTS, 1.0 / fps);
        }
        state.map(|damped| damped.value as f32)
    }
}

impl Damped {
    /// The exact solution of `x'' = (target − x) / τ² − 2 x' / τ` over `step_s`. A time constant of 0
    /// gives the target.
    fn step(&mut self, target: f32, time_constant_s: f64, step_s: f64) {
        if time_constant_s == 0.0 {
            (self.value, self.per_s) = (f64::from(target), 0.0);
            return;
        }
        let target = f64::from(target);
        let away = self.value - target;
        let pull = self.per_s + away / time_constant_s;
        let decay = (-step_s / time_constant_s).exp();
        self.value = (target + (away + pull * step_s) * decay).max(0.0);
        self.per_s = (self.per_s - pull * step_s / time_constant_s) * decay;
        if target == 0.0 && self.value < f64::from(NOTHING) && self.per_s <= 0.0 {
            (self.value, self.per_s) = (0.0, 0.0);
        }
    }
}

/// The strength of an expression over time as a share of the requested strength. The whole face goes
/// from apex to lull and back, and each region wanders a little by itself. The same seed gives the same
/// values.
pub(super) struct Wandering {
    level: Level,
    regions: [Wanderer; REGIONS],
}

/// Alternates between apexes and lulls. Times must not fall from call to call.
struct Level {
    chance: Chance,
    is_apex: bool,
    /// The current level and the next one.
    here: f64,
    next: f64,
    /// When it leaves the current level, and how long the way to the next one takes, seconds.
    leave_s: f64,
    way_s: f64,
}

impl Level {
    fn new(seed: u64) -> Self {
        let mut chance = Chance::new(seed, STREAM + REGIONS as u64);
        let here = chance.between(APEX.0, APEX.1);
        let mut level = Level {
            chance,
            is_apex: true,
            here,
            next: here,
            leave_s: 0.0,
            way_s: 0.0,
        };
        level.go_on();
        level
    }

    fn go_on(&mut self) {
        let (stay, way, next) = if self.is_apex {
            (APEX_S, SINK_S, LULL)
        } else {
            (LULL_S, RISE_S, APEX)
        };
        self.leave_s += self.way_s + self.chance.between(stay.0, stay.1);
        self.way_s = self.chance.between(way.0, way.1);
        self.next = self.chance.between(next.0, next.1);
    }

    fn at(&mut self, time_s: f64) -> f32 {
        while time_s >= self.leave_s + self.way_s {
            (self.here, self.is_apex) = (self.next, !self.is_apex);
            self.go_on();
        }
        let share = smooth_step((time_s - self.leave_s) / self.way_s);
        (self.here + share * (self.next - self.here)) as f32
    }
}

/// A smooth curve through random values. Times must not fall from call to call.
struct Wanderer {
    chance: Chance,
    /// Index of the value before the current time.
    index: usize,
    before: f32,
    after: f32,
}

impl Wandering {
    pub(super) fn new(seed: u64) -> Self {
        let region = |region: usize| {
            let mut chance = Chance::new(seed, STREAM + region as u64);
            let mut value = || chance.between(-1.0, 1.0) as f32;
            let (before, after) = (value(), value());
            Wanderer {
                chance,
                index: 0,
                before,
                after,
            }
        };
        Wandering {
            level: Level::new(seed),
            regions: std::array::from_fn(region),
        }
    }

    /// Factors on the expression of each region. `time_s` must not lie before that of the last call.
    pub(super) fn at(&mut self, time_s: f64) -> [f32; REGIONS] {
        let (level, place) = (self.level.at(time_s), time_s / WANDER_S);
        std::array::from_fn(|region| level + WANDER * self.regions[region].at(place))
    }
}

impl Wanderer {
    fn at(&mut self, place: f64) -> f32 {
        while place >= (self.index + 1) as f64 {
            self.before = self.after;
            self.after = self.chance.between(-1.0, 1.0) as f32;
            self.index += 1;
        }
        let x = (place - self.index as f64) as f32;
        self.before + (self.after - self.before) * x * x * (3.0 - 2.0 * x)
    }
}

/// Index of the region of landmark `n` among the factors of [`Wandering::at`].
pub(super) fn region(n: usize) -> usize {
    debug_assert!(n < LANDMARKS);
    match n {
        n if BROWS.contains(&n) => 0,
        n if LIDS.contains(&n) => 1,
        n if (BROWS.end..MOUTH.start).contains(&n) => 2,
        _ => 3,
    }
}

/// Accents that let an expression grow on stressed syllables, shaped like brow raises.
pub(super) fn accents(prosody: &Prosody) -> Vec<BrowAccent> {
    let stressed = prominences(prosody)
        .into_iter()
        .filter(|(_, prominence)| *prominence >= STRESSED);
    stressed
        .map(|(frame, prominence)| BrowAccent {
            start_s: (Prosody::time_s(frame) - LEAD_S - ONSET_S).max(0.0),
            weight: (ACCENT * prominence).min(MAX_ACCENT),
        })
        .collect()
}

/// What the strongest accent at a time adds to the factors on an expression.
pub(super) fn accent_at(accents: &[BrowAccent], time_s: f64) -> f32 {
    let from = accents.partition_point(|accent| accent.end_s() < time_s);
    let near = accents[from..]
        .iter()
        .take_while(|accent| accent.start_s <= time_s);
    near.map(|accent| accent.at(time_s)).fold(0.0, f32::max)
}

impl Expressions {
    /// The strengths `[T]` with which the face follows `affect` `[T, 16]`. They start at the first target,
    /// without motion. `onset`: factor on the times of the table.
    pub(in crate::motion) fn followed(
        &self,
        affect: ArrayView2<'_, f32>,
        fps: f64,
        onset: f32,
    ) -> Vec<Strengths> {
        let mut follower = Follower::new(onset);
        let rows = affect.outer_iter();
        rows.map(|row| follower.step(&targets(row), self, fps))
            .collect()
    }

    /// `affect` `[T, 16]`, a mixture of emotions and an intensity, as the face follows it: for networks
    /// that show emotion as soon as they are told. Rows in which nothing changes stay bit for bit the
    /// same. `onset`: factor on the times of the table; 0 follows at once.
    pub fn eased(&self, mut affect: Array2<f32>, fps: f64, onset: f32) -> Array2<f32> {
        let followed = self.followed(affect.view(), fps, onset);
        for (mut row, mut strengths) in affect.outer_iter_mut().zip(followed) {
            let targets = targets(row.view());
            if strengths[1..] == targets[1..] {
                continue;
            }
            // Neutral gets what the others leave: its own strength has no meaning.
            let others: f32 = strengths[1..].iter().sum();
            strengths[0] = (row[EMOTIONS.len()] - others).max(0.0);
            let intensity = strengths[0] + others;
            for (e, share) in row.iter_mut().take(EMOTIONS.len()).enumerate() {
                *share = if intensity > 0.0 {
                    strengths[e] / intensity
                } else {
                    Emotion::default().mixture[e]
                };
            }
            row[EMOTIONS.len()] = intensity;
        }
        affect
    }
}

/// The strengths in a row of a mixture of emotions and an intensity, `[16]`.
fn targets(row: ArrayView1<'_, f32>) -> Strengths {
    std::array::from_fn(|e| row[e] * row[EMOTIONS.len()])
}
