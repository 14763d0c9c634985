//! Words whose units no network has learned, or that the network misreads.

use super::sentence::{Clause, SaidSide};
use crate::conditions::ActionUnit;

/// Phrases and the units that they stand for. Each word may have any of its forms (`|` between
/// them). An earlier phrase takes its words away from later ones.
const PHRASES: [(&str, &str); 14] = [
    ("press|presses|pressed|pressing lip|lips", "23"),
    ("lip|lips press|presses|pressed|pressing", "23"),
    ("tighten|tightens|tightened|tightening lip|lips", "23"),
    ("part|parts|parted|parting lip|lips", "25"),
    ("lip|lips part|parts|parted|parting|apart", "25"),
    ("puff|puffs|puffed|puffing cheek|cheeks", "8 23 34"),
    ("kiss|kisses|kissed|kissing", "8 18"),
    ("pout|pouts|pouted|pouting", "8 15 17 18"),
    (
        "pucker|puckers|puckered|puckering|purses|pursed|pursing",
        "18",
    ),
    ("sneeze|sneezes|sneezed|sneezing", "4 6 9 10 45"),
    (
        "wince|winces|winced|wincing|flinch|flinches|flinched|flinching",
        "4 6 7 10",
    ),
    ("funnel|funnels|funnelled|funneled", "22"),
    ("haughty|haughtily|supercilious", "1 2 14 17"),
    ("eyes up|upwards|heavenwards", "63"),
];
/// Words for rolling eyes. They mean more than eyes that look up.
const ROLLS: &str = "roll|rolls|rolled|rolling";
const EYES: &str = "eye|eyes";
/// The unit of rolling eyes.
const ROLLING: &str = "68";
/// Words for emotions, and for each a word with the same meaning that the text space knows well.
const FEELINGS: [(&str, &str); 11] = [
    (
        "livid|wrathful|fuming|irked|miffed|peeved|hostile|grumpy|crabby",
        "angry",
    ),
    ("petrified|spooked|shaken", "afraid"),
    ("jittery|tense|rattled", "anxious"),
    (
        "crestfallen|downcast|forlorn|morose|sullen|sulky|lonely|anguished",
        "sad",
    ),
    ("jolly|jovial|blissful|euphoric|exuberant", "happy"),
    ("awestruck|speechless", "astonished"),
    ("squeamish|woozy|feverish", "queasy"),
    ("snooty|mocking", "scornful"),
    ("abashed|bashful", "embarrassed"),
    ("mellow|composed", "calm"),
    ("puzzled|mystified|perplexed|baffled", "confused"),
];
/// Verbs of looking. A side or a height in the same clause says where the eyes go.
const LOOKS: &str = "look|looks|looked|looking|glance|glances|glanced|glancing|gaze|gazes|gazed|gazing|stares|stared|staring|peers|eyes|roll|rolls|rolled|rolling";
const HEIGHTS: [(&str, &str); 2] = [
    ("up|upward|upwards|above|skyward|skywards|ceiling", "63"),
    ("down|downward|downwards|below|floor|ground", "64"),
];
const SIDES: [(SaidSide, &str); 2] = [(SaidSide::Left, "61"), (SaidSide::Right, "62")];

/// Finds the units of words in a clause, as numbers of [`crate::conditions::ACTION_UNITS`], and
/// removes these words from it. A clause with denied words has none.
pub(super) fn take_units(clause: &mut Clause) -> Vec<usize> {
    let mut units = Vec::new();
    if !clause.denied.is_empty() {
        return units;
    }
    let mut words: Vec<String> = clause.said.split_whitespace().map(str::to_owned).collect();
    let place = |forms| words.iter().position(|word| is_form(word, forms));
    if let (Some(roll), Some(eyes)) = (place(ROLLS), place(EYES)) {
        units.extend(ActionUnit::find(ROLLING));
        let heights = HEIGHTS.iter().filter_map(|(forms, _)| place(forms));
        let places: Vec<usize> = [roll, eyes].into_iter().chain(heights).collect();
        take(clause, &mut words, &places);
        clause.side = None;
    }
    if let Some(at) = words.iter().position(|word| is_form(word, LOOKS)) {
        let height = HEIGHTS.iter().find_map(|(forms, unit)| {
            let place = words.iter().position(|word| is_form(word, forms))?;
            Some((place, *unit))
        });
        let side = SIDES.iter().find(|(side, _)| clause.side == Some(*side));
        if let Some((_, unit)) = side {
            units.extend(ActionUnit::find(unit));
            clause.side = None;
        }
        if let Some((place, unit)) = height {
            units.extend(ActionUnit::find(unit));
            take(clause, &mut words, &[at, place]);
        } else if side.is_some() {
            take(clause, &mut words, &[at]);
        }
    }
    for (phrase, phrase_units) in PHRASES {
        let forms: Vec<&str> = phrase.split(' ').collect();
        let is_here = |at: &usize| {
            let stand = words[*at..].iter().zip(&forms);
            words.len() - at >= forms.len()
                && stand.clone().all(|(word, forms)| is_form(word, forms))
        };
        let adjoining = (0..words.len()).find(is_here);
        // "Presses her lips": one other word may stand between the two of a phrase.
        let apart = || {
            let first = words.iter().position(|word| is_form(word, forms[0]))?;
            let last = words
                .iter()
                .skip(first)
                .position(|word| is_form(word, forms[forms.len() - 1]))?;
            (forms.len() == 2 && last <= 2 && last > 0).then_some([first, first + last])
        };
        let places: Vec<usize> = match (adjoining, apart()) {
            (Some(at), _) => (at..at + forms.len()).collect(),
            (None, Some(places)) => places.to_vec(),
            (None, None) => continue,
        };
        units.extend(phrase_units.split(' ').filter_map(ActionUnit::find));
        take(clause, &mut words, &places);
    }
    units.sort_unstable();
    units.dedup();
    units
}

/// Replaces words for emotions by those that the text space knows well.
pub(super) fn put_known_feelings(clause: &mut Clause) {
    let known = |word: &str| {
        let mut feelings = FEELINGS.iter();
        feelings.find_map(|(forms, known)| is_form(word, forms).then_some(*known))
    };
    for word in clause.words.iter_mut().chain(&mut clause.denied) {
        if let Some(known) = known(word) {
            known.clone_into(word);
        }
    }
    let said = clause.said.split_whitespace();
    let said: Vec<&str> = said.map(|word| known(word).unwrap_or(word)).collect();
    clause.said = said.join(" ");
}

fn is_form(word: &str, forms: &str) -> bool {
    forms.split('|').any(|form| form == word)
}

/// Removes words from a clause.
fn take(clause: &mut Clause, words: &mut Vec<String>, places: &[usize]) {
    let gone: Vec<String> = places.iter().map(|place| words[*place].clone()).collect();
    let mut place = 0;
    words.retain(|_| {
        place += 1;
        !places.contains(&(place - 1))
    });
    clause.said = words.join(" ");
    clause.words.retain(|word| !gone.contains(word));
}
