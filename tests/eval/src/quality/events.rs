//! Whether the face performs events in the right place and at the right time, and what that costs
//! the speech.

use std::ops::Range;

use ndarray::{Array2, Array3};
use serde::Serialize;

use super::{
    bootstrap::number,
    clip::{Clip, gap_mm, rest_gap_mm},
    closures::{CLOSED_MM, windows},
    labiodentals::Mouth,
    page::Page,
    phone::Phone,
    speaker::{Speaker, Wish},
};
use crate::metrics::{closures, control_leak, control_rate, pearson};
use anyface::{
    Performance, Result,
    conditions::{ACTION_UNITS, EDGE_S, Event, EventTrack, LEARNED_UNITS, Side},
    motion::{Motion, WeightClip},
    systems::Ability,
};

/// The most clips to try every unit on.
const CLIPS: usize = 8;
/// The slot of the event, seconds: in the middle of a clip of three seconds.
const SLOT_S: [f64; 2] = [1.0, 1.8];
/// Strengths of an event. The second must be 1.
const STRENGTHS: [f32; 4] = [0.5, 1.0, 1.5, 2.0];
/// Further than this many frames from an event, nothing should change.
const FAR: usize = 10;
const PER_CENT: f64 = 100.0;

/// The scores of all units.
#[derive(Debug, Clone, Serialize)]
pub(super) struct EventScores {
    pub clips: usize,
    pub units: Vec<UnitScores>,
    /// How many p, b and m in the slots close the lips, over all lower units.
    pub closures: Closures,
    /// f and v in the slots, over all lower units.
    pub teeth: TeethReached,
}

/// How near the lower lip comes to the upper incisors on f and v in the slots of events.
///
/// The events have strength 1. Values are median distances to the edge of the incisors, mm, as
/// [`Mouth`] measures them.
#[derive(Debug, Clone, Default, Serialize)]
pub(super) struct TeethReached {
    pub count: usize,
    /// Distance without an event.
    pub without_mm: f64,
    pub with_mm: f64,
    /// Distance where the event overrides the speech, which nothing then protects.
    pub over_mm: f64,
    /// Distance where the weights of the unit's shapes are added to those of the speech.
    pub added_mm: f64,
    /// The lower unit with the largest median distance under its event, and that distance.
    pub worst: Option<(String, f64)>,
}

/// The scores of one action unit on both sides. Means over clips, except `far` and `closures`.
#[derive(Debug, Clone, Serialize)]
pub(super) struct UnitScores {
    pub unit: String,
    pub label: String,
    pub is_lower: bool,
    /// Control rate at each of [`STRENGTHS`].
    pub control_rate: Vec<f64>,
    /// Control rate without an event.
    pub without: f64,
    /// The event's change in the five frames on either side, as a share of its change in the slot.
    pub leak: f64,
    /// Largest change of any weight beyond [`FAR`] frames from the slot, over all clips.
    pub far: f64,
    /// How much the event lowers Pearson's r between the lip gap and the recording's.
    pub gap_r_lost: f64,
    /// The same where the event overrides the speech.
    pub gap_r_lost_over: f64,
    /// How many p, b and m in the slots close the lips.
    pub closures: Closures,
}

/// Share of the p, b and m in the slots of an event of strength 1 that close the lips, %.
#[derive(Debug, Clone, Default, Serialize)]
pub(super) struct Closures {
    pub count: usize,
    /// Share without an event.
    pub without_percent: f64,
    pub with_percent: f64,
    /// Share where the event overrides the speech, which nothing then protects.
    pub over_percent: f64,
    /// Share where the weights of the unit's shapes are added to those of the speech.
    pub added_percent: f64,
}

/// A performance with the quantities that are compared.
struct Shown {
    weights: WeightClip,
    /// `[T, 68, 3]`, metres.
    landmarks: Array3<f64>,
    gap_mm: Vec<f64>,
}

/// Tries every unit on some clips. `None` for a system without events or without weights.
pub(super) fn measure(
    speaker: &Speaker,
    wish: &Wish,
    mouth: &Mouth,
    clips: &[Clip],
) -> Result<Option<EventScores>> {
    if !speaker.engine.system().can(Ability::Events) {
        return Ok(None);
    }
    let long = |clip: &&Clip| clip.frames() as f64 / clip.fps > SLOT_S[1] + 0.5;
    let said = |clip: &&Clip| labiodentals(clip).next().is_some();
    let with_teeth = clips.iter().filter(long).filter(said).take(CLIPS);
    let teeth = teeth_reached(speaker, wish, mouth, &with_teeth.collect::<Vec<_>>())?;
    let clips: Vec<&Clip> = clips.iter().filter(long).take(CLIPS).collect();
    let plain = clips.iter().map(|clip| shown(speaker, wish, clip));
    let Some(plain) = plain.collect::<Result<Option<Vec<Shown>>>>()? else {
        return Ok(None);
    };
    let mut units = Vec::new();
    for unit in 0..LEARNED_UNITS {
        let mut closures = Closures::default();
        let mut rows = Vec::new();
        for (clip, plain) in clips.iter().zip(&plain) {
            let each = STRENGTHS.iter().map(|&strength| {
                let wish = with_event(wish, event(unit, strength, false));
                shown(speaker, &wish, clip)
            });
            let Some(each) = each.collect::<Result<Option<Vec<Shown>>>>()? else {
                return Ok(None);
            };
            let over = with_event(wish, event(unit, 1.0, true));
            let Some(over) = shown(speaker, &over, clip)? else {
                return Ok(None);
            };
            let added = added(speaker, clip, plain, unit)?;
            closures.add(clip, [plain, &each[1], &over, &added])?;
            rows.push(score(unit, clip, plain, &each, &over)?);
        }
        units.push(mean_of(unit, &rows, closures));
    }
    let lower = units.iter().filter(|unit| unit.is_lower);
    let closures = lower.fold(Closures::default(), |sum, unit| sum.and(&unit.closures));
    Ok(Some(EventScores {
        clips: clips.len(),
        units: units.into_iter().map(UnitScores::in_percent).collect(),
        closures: closures.in_percent(),
        teeth,
    }))
}

/// The f and v within a clip's slot.
fn labiodentals(clip: &Clip) -> impl Iterator<Item = &Phone> {
    let phones = clip.phones.iter().flatten();
    let inside = |phone: &&Phone| phone.from_s >= SLOT_S[0] && phone.to_s <= SLOT_S[1];
    phones.filter(|phone| phone.is_labiodental()).filter(inside)
}

/// Tries all lower units on clips that say f or v in their slot.
fn teeth_reached(
    speaker: &Speaker,
    wish: &Wish,
    mouth: &Mouth,
    clips: &[&Clip],
) -> Result<TeethReached> {
    let mut out = TeethReached::default();
    let mut frames: [Vec<Array2<f64>>; 4] = Default::default();
    for unit in (0..LEARNED_UNITS).filter(|&unit| ACTION_UNITS[unit].is_lower) {
        let first = frames[1].len();
        for clip in clips {
            let Some(plain) = shown(speaker, wish, clip)? else {
                return Ok(out);
            };
            let [with, over] = [false, true].map(|over_speech| {
                let wish = with_event(wish, event(unit, 1.0, over_speech));
                shown(speaker, &wish, clip)
            });
            let added = added(speaker, clip, &plain, unit)?;
            for (of, frames) in [Some(plain), with?, over?, Some(added)]
                .iter()
                .zip(&mut frames)
            {
                let landmarks = &of.as_ref().expect("weights, as without an event").landmarks;
                let nearest = mouth.nearest_of(labiodentals(clip), clip, landmarks);
                frames.extend(nearest.iter().map(|frame| frame.to_owned()));
            }
        }
        let frames_of_event: Vec<_> = frames[1][first..]
            .iter()
            .map(|frame| frame.view())
            .collect();
        if let Some(far) = mouth.distance_mm(&speaker.engine, &frames_of_event)?
            && out.worst.as_ref().is_none_or(|(_, worst)| far > *worst)
        {
            out.worst = Some((ACTION_UNITS[unit].name.to_owned(), far));
        }
    }
    out.count = frames[0].len();
    let places = [
        &mut out.without_mm,
        &mut out.with_mm,
        &mut out.over_mm,
        &mut out.added_mm,
    ];
    for (frames, place) in frames.iter().zip(places) {
        let views: Vec<_> = frames.iter().map(|frame| frame.view()).collect();
        *place = mouth
            .distance_mm(&speaker.engine, &views)?
            .unwrap_or(f64::NAN);
    }
    Ok(out)
}

fn event(unit: usize, strength: f32, over_speech: bool) -> Event {
    Event {
        slot_s: SLOT_S,
        units: vec![(unit, Side::Both)],
        strength,
        over_speech,
    }
}

fn with_event(wish: &Wish, event: Event) -> Wish {
    Wish {
        events: vec![event],
        ..wish.clone()
    }
}

/// Adds the unit's shapes to the speech, at weight 1 within the slot.
fn added(speaker: &Speaker, clip: &Clip, plain: &Shown, unit: usize) -> Result<Shown> {
    let mut weights = plain.weights.clone();
    let (frames, fps) = (weights.weights.nrows(), weights.fps);
    let track = EventTrack::of(
        &[event(unit, 1.0, false)],
        &weights.names,
        (frames, fps),
        EDGE_S,
        1.0,
    );
    weights.weights += &track.mask;
    of_weights(speaker, clip, weights)
}

/// Performs a clip. `None` if the motion does not consist of weights.
fn shown(speaker: &Speaker, wish: &Wish, clip: &Clip) -> Result<Option<Shown>> {
    let Performance { motion, .. } = speaker.performance(&clip.waveform, clip.fps, wish)?;
    match motion {
        Motion::Weights(weights) => of_weights(speaker, clip, weights).map(Some),
        _ => Ok(None),
    }
}

fn of_weights(speaker: &Speaker, clip: &Clip, weights: WeightClip) -> Result<Shown> {
    let landmarks = speaker.landmarks(&Motion::Weights(weights.clone()))?;
    Ok(Shown {
        gap_mm: gap_mm(&clip.neutral, landmarks.view())?,
        landmarks,
        weights,
    })
}

/// The scores of one unit on one clip.
struct Row {
    control_rate: Vec<f64>,
    without: f64,
    leak: Option<f64>,
    far: f64,
    gap_r_lost: f64,
    gap_r_lost_over: f64,
}

fn score(unit: usize, clip: &Clip, plain: &Shown, with: &[Shown], over: &Shown) -> Result<Row> {
    let slot = frames(clip);
    let of = |shown: &Shown| unit_weights(&shown.weights, unit);
    let rate = |shown: &Shown| control_rate(&of(shown), &slot).unwrap_or(0.0);
    let usual = &with[1];
    let recorded = gap_mm(&clip.speaker, clip.motion.view())?;
    let r = |shown: &Shown| {
        let count = recorded.len().min(shown.gap_mm.len());
        pearson(&shown.gap_mm[..count], &recorded[..count])
    };
    Ok(Row {
        control_rate: with.iter().map(rate).collect(),
        without: rate(plain),
        leak: control_leak(&of(usual), &of(plain), &slot),
        far: far(&plain.weights, &usual.weights, &slot),
        gap_r_lost: r(plain) - r(usual),
        gap_r_lost_over: r(plain) - r(over),
    })
}

fn frames(clip: &Clip) -> Range<usize> {
    let [from, to] = SLOT_S.map(|second| (second * clip.fps).round() as usize);
    from..to
}

/// Mean weight of a unit's shapes in every frame.
fn unit_weights(clip: &WeightClip, unit: usize) -> Vec<f64> {
    let unit = &ACTION_UNITS[unit];
    let is_own = |name: &str| unit.shapes.iter().any(|stem| name.starts_with(stem));
    let columns: Vec<usize> = (0..clip.names.len())
        .filter(|&n| is_own(&clip.names[n]))
        .collect();
    let mean = |row: ndarray::ArrayView1<'_, f32>| {
        columns.iter().map(|&n| f64::from(row[n])).sum::<f64>() / columns.len() as f64
    };
    clip.weights.outer_iter().map(mean).collect()
}

fn far(a: &WeightClip, b: &WeightClip, slot: &Range<usize>) -> f64 {
    let beyond = |t: &usize| t + FAR < slot.start || *t >= slot.end + FAR;
    let changes = (0..a.weights.nrows()).filter(beyond).map(|t| {
        let pairs = a.weights.row(t).into_iter().zip(b.weights.row(t));
        pairs
            .map(|(a, b)| f64::from((a - b).abs()))
            .fold(0.0, f64::max)
    });
    changes.fold(0.0, f64::max)
}

impl Closures {
    /// Counts the closures of one clip. `shown`: without an event, with it, with it overriding the
    /// speech, and with its shapes added.
    fn add(&mut self, clip: &Clip, shown: [&Shown; 4]) -> Result<()> {
        let phones = clip.phones.as_deref().unwrap_or_default();
        let inside = |(from, to): &(f64, f64)| *from >= SLOT_S[0] && *to <= SLOT_S[1];
        let windows_in_event: Vec<_> = windows(phones).into_iter().filter(inside).collect();
        let rest_mm = rest_gap_mm(&clip.neutral)?;
        let closed = shown.map(|shown| {
            let closures_in_event = closures(&shown.gap_mm, clip.fps, &windows_in_event);
            closures_in_event
                .iter()
                .filter(|c| c.gap - rest_mm < CLOSED_MM)
                .count() as f64
        });
        let [without, with, over, added] = closed;
        let more = Closures {
            count: windows_in_event.len(),
            without_percent: without,
            with_percent: with,
            over_percent: over,
            added_percent: added,
        };
        *self = self.clone().and(&more);
        Ok(())
    }

    fn and(self, other: &Closures) -> Closures {
        Closures {
            count: self.count + other.count,
            without_percent: self.without_percent + other.without_percent,
            with_percent: self.with_percent + other.with_percent,
            over_percent: self.over_percent + other.over_percent,
            added_percent: self.added_percent + other.added_percent,
        }
    }

    fn in_percent(self) -> Closures {
        let share = PER_CENT / self.count.max(1) as f64;
        Closures {
            without_percent: share * self.without_percent,
            with_percent: share * self.with_percent,
            over_percent: share * self.over_percent,
            added_percent: share * self.added_percent,
            ..self
        }
    }
}

impl UnitScores {
    fn in_percent(self) -> UnitScores {
        UnitScores {
            closures: self.closures.in_percent(),
            ..self
        }
    }
}

fn mean_of(unit: usize, rows: &[Row], closures: Closures) -> UnitScores {
    let mean =
        |of: &dyn Fn(&Row) -> f64| rows.iter().map(of).sum::<f64>() / rows.len().max(1) as f64;
    let known: Vec<f64> = rows.iter().filter_map(|row| row.leak).collect();
    UnitScores {
        unit: ACTION_UNITS[unit].name.to_owned(),
        label: ACTION_UNITS[unit].label.to_owned(),
        is_lower: ACTION_UNITS[unit].is_lower,
        control_rate: (0..STRENGTHS.len())
            .map(|k| mean(&|row| row.control_rate[k]))
            .collect(),
        without: mean(&|row| row.without),
        leak: known.iter().sum::<f64>() / known.len().max(1) as f64,
        far: rows.iter().map(|row| row.far).fold(0.0, f64::max),
        gap_r_lost: mean(&|row| row.gap_r_lost),
        gap_r_lost_over: mean(&|row| row.gap_r_lost_over),
        closures,
    }
}

/// Writes the section of the report.
pub(super) fn section(page: &mut Page, scores: &EventScores) {
    page.block("## Events");
    page.block(format!(
        "Every action unit, on both sides, from {} to {} s of {} held-out clips of grid_s1, without any other \
         control. Control rate (Cafe-Talk eq. 7): the unit's largest weight in the slot over the mean of the five \
         frames either side, at four strengths and without an event; leak: what the event adds to those frames, of \
         what it adds within; far: the largest change of any weight more than {FAR} frames away; r lost: \
         correlation of the lip gap with the recording, without the event minus with it, and behind the stroke with \
         the event put over the speech, where nothing guards it; closed: of the {} p, b and m in the slots those that \
         close the lips, in the same way, and at last with the unit's shapes added to the speech's.",
        SLOT_S[0],
        SLOT_S[1],
        scores.clips,
        scores.units.first().map_or(0, |unit| unit.closures.count)
    ));
    let strengths = STRENGTHS.map(|strength| format!("strength {strength}"));
    let mut titles = vec!["unit", "none"];
    titles.extend(strengths.iter().map(String::as_str));
    titles.extend(["leak", "far", "r lost", "closed"]);
    let mut rows: Vec<Vec<String>> = scores.units.iter().map(row).collect();
    let count = scores.units.len() as f64;
    let mean = |k: usize| scores.units.iter().map(|u| u.control_rate[k]).sum::<f64>() / count;
    let mut last = vec!["**mean**".to_owned(), String::new()];
    last.extend((0..STRENGTHS.len()).map(|k| number(mean(k), 2)));
    last.extend(vec![String::new(); 4]);
    rows.push(last);
    page.table(&titles, rows);
    page.block("");
    page.block(format!(
        "Of {} p, b and m in the slots of lower units {:.0} % close the lips without the event, {:.0} % with it; {:.0} % \
         with the event over the speech, {:.0} % with the unit's shapes added.",
        scores.closures.count,
        scores.closures.without_percent,
        scores.closures.with_percent,
        scores.closures.over_percent,
        scores.closures.added_percent
    ));
    let teeth = &scores.teeth;
    page.block(format!(
        "In {} f and v in the slots of lower units, on the first {CLIPS} clips that say one there, the lower lip comes to \
         {:.2} mm from the edge of the upper incisors without the event (median), to {:.2} mm with it; to {:.2} mm \
         with the event over the speech, to {:.2} mm with the unit's shapes added.{}",
        teeth.count,
        teeth.without_mm,
        teeth.with_mm,
        teeth.over_mm,
        teeth.added_mm,
        match &teeth.worst {
            Some((unit, mm)) => format!(" Farthest: {mm:.2} mm under unit {unit}."),
            None => String::new(),
        }
    ));
}

fn row(unit: &UnitScores) -> Vec<String> {
    let mut out = vec![
        format!("{} {}", unit.unit, unit.label),
        number(unit.without, 2),
    ];
    out.extend(unit.control_rate.iter().map(|rate| number(*rate, 2)));
    out.push(format!("{:.0} %", PER_CENT * unit.leak));
    out.push(number(unit.far, 3));
    let lost = [unit.gap_r_lost, unit.gap_r_lost_over].map(|r| number(r, 3));
    out.push(lost.join(" / "));
    let Closures {
        with_percent,
        over_percent,
        added_percent,
        ..
    } = unit.closures;
    let closed = [with_percent, over_percent, added_percent].map(|share| format!("{share:.0}"));
    out.push(format!("{} %", closed.join(" / ")));
    out
}
