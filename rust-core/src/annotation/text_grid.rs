//! Praat's TextGrid, in long or short text.
//!
//! Praat itself reads only the free-standing numbers, quoted texts and flags of such a file and
//! skips the rest (Praat manual, "TextGrid file formats"). Read this way, the long and the short
//! form are the same.

use std::fmt::Write;

use super::{
    Annotation, Interval, Symbols, Tier,
    tiers::{finished, interval, time, wrong},
};

/// A number, flag or quoted text.
enum Token<'a> {
    Bare(&'a str),
    Quoted(String),
}

struct Tokens<'a> {
    rest: &'a str,
    line: usize,
}

impl<'a> Tokens<'a> {
    /// The next free-standing number, quoted text or flag.
    fn next(&mut self) -> Result<(usize, Token<'a>), String> {
        loop {
            self.skip_space();
            let line = self.line;
            if let Some(rest) = self.rest.strip_prefix('"') {
                self.rest = rest;
                return Ok((line, Token::Quoted(self.quoted(line)?)));
            }
            let end = self.rest.find(char::is_whitespace);
            let (word, rest) = self.rest.split_at(end.unwrap_or(self.rest.len()));
            self.rest = rest;
            if word.is_empty() {
                return Err(format!("{line}: expected more, got the end of the file"));
            }
            if word.starts_with('!') {
                self.rest = rest.find('\n').map_or("", |end| &rest[end..]);
            } else if word.starts_with('<') || word.parse::<f64>().is_ok() {
                return Ok((line, Token::Bare(word)));
            }
        }
    }

    fn skip_space(&mut self) {
        let rest = self.rest.trim_start();
        let skipped = &self.rest[..self.rest.len() - rest.len()];
        self.line += skipped.matches('\n').count();
        self.rest = rest;
    }

    /// Reads up to the closing quote. A doubled quote stands for one.
    fn quoted(&mut self, begun: usize) -> Result<String, String> {
        let mut out = String::new();
        loop {
            let Some((before, after)) = self.rest.split_once('"') else {
                return Err(format!("{begun}: expected a text that ends with a quote"));
            };
            self.line += before.matches('\n').count();
            out += before;
            self.rest = after;
            match after.strip_prefix('"') {
                Some(rest) => {
                    out.push('"');
                    self.rest = rest;
                }
                None => return Ok(out),
            }
        }
    }

    fn text(&mut self) -> Result<(usize, String), String> {
        match self.next()? {
            (line, Token::Quoted(text)) => Ok((line, text)),
            (line, Token::Bare(got)) => Err(wrong(line, "a text in quotes", got)),
        }
    }

    fn seconds(&mut self) -> Result<(usize, f64), String> {
        match self.next()? {
            (line, Token::Bare(text)) => Ok((line, time(line, text)?)),
            (line, Token::Quoted(got)) => Err(wrong(line, "a time in seconds", &got)),
        }
    }

    fn count(&mut self) -> Result<usize, String> {
        let (line, got) = match self.next()? {
            (line, Token::Bare(text)) => match text.parse() {
                Ok(count) => return Ok(count),
                Err(_) => (line, text.to_owned()),
            },
            (line, Token::Quoted(text)) => (line, text),
        };
        Err(wrong(line, "a number of items", &got))
    }
}

pub(super) fn read(text: &str) -> Result<Annotation, String> {
    let mut tokens = Tokens {
        rest: text,
        line: 1,
    };
    let header = [tokens.text(), tokens.text()];
    for (token, expected) in header.into_iter().zip(["ooTextFile", "TextGrid"]) {
        let (line, text) = token?;
        if text != expected {
            return Err(wrong(line, &format!("{expected:?}"), &text));
        }
    }
    let (_, (_, duration_s)) = (tokens.seconds()?, tokens.seconds()?);
    match tokens.next()? {
        (_, Token::Bare("<exists>")) => {}
        (_, Token::Bare("<absent>")) => return Ok(finished(Vec::new(), duration_s)),
        (line, Token::Bare(got)) => return Err(wrong(line, "<exists>", got)),
        (line, Token::Quoted(got)) => return Err(wrong(line, "<exists>", &got)),
    }
    let tiers = (0..tokens.count()?).map(|_| tier(&mut tokens));
    Ok(finished(tiers.collect::<Result<_, _>>()?, duration_s))
}

fn tier(tokens: &mut Tokens<'_>) -> Result<Tier, String> {
    let (line, class) = tokens.text()?;
    let is_points = match class.as_str() {
        "IntervalTier" => false,
        "TextTier" => true,
        _ => return Err(wrong(line, "\"IntervalTier\" or \"TextTier\"", &class)),
    };
    let (_, name) = tokens.text()?;
    let _span = [tokens.seconds()?, tokens.seconds()?];
    let (mut intervals, mut after_s): (Vec<Interval>, f64) = (Vec::new(), 0.0);
    for _ in 0..tokens.count()? {
        let (line, start_s) = tokens.seconds()?;
        let end_s = if is_points {
            start_s
        } else {
            tokens.seconds()?.1
        };
        let (_, label) = tokens.text()?;
        let next = interval(line, [start_s, end_s], label.trim(), after_s)?;
        after_s = end_s;
        // The gap between two labels is an interval without a label.
        if !next.label.is_empty() {
            intervals.push(next);
        }
    }
    let labels = intervals.iter().map(|interval| interval.label.as_str());
    Ok(Tier {
        symbols: Symbols::guess(&name, labels),
        intervals,
    })
}

pub(super) fn write(annotation: &Annotation) -> String {
    let end = annotation.duration_s;
    let mut out = String::from("File type = \"ooTextFile\"\nObject class = \"TextGrid\"\n\n");
    let count = annotation.tiers.len();
    let head = format!("xmin = 0\nxmax = {end}\ntiers? <exists>\nsize = {count}\nitem []:\n");
    out += &head;
    for (number, tier) in annotation.tiers.iter().enumerate() {
        let name = tier.symbols.name();
        let rows = without_gaps(&tier.intervals, end);
        let _ = write!(
            out,
            "    item [{}]:\n        class = \"IntervalTier\"\n        name = \"{name}\"\n        \
             xmin = 0\n        xmax = {end}\n        intervals: size = {}\n",
            number + 1,
            rows.len()
        );
        for (number, (from, to, label)) in rows.into_iter().enumerate() {
            let (number, label) = (number + 1, label.replace('"', "\"\""));
            let _ = write!(
                out,
                "        intervals [{number}]:\n            xmin = {from}\n            xmax = {to}\n\
                 \x20           text = \"{label}\"\n"
            );
        }
    }
    out
}

/// Fills gaps with unlabelled intervals: Praat requires intervals that touch, from 0 to the end.
fn without_gaps(intervals: &[Interval], end_s: f64) -> Vec<(f64, f64, &str)> {
    let (mut out, mut at) = (Vec::new(), 0.0);
    for interval in intervals.iter().filter(|i| i.start_s < end_s) {
        if interval.start_s > at {
            out.push((at, interval.start_s, ""));
        }
        out.push((interval.start_s, interval.end_s, interval.label.as_str()));
        at = interval.end_s;
    }
    if end_s > at || out.is_empty() {
        out.push((at, end_s, ""));
    }
    out
}
