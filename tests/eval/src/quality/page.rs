//! A Markdown page that is built line by line.

use super::{bootstrap::Estimate, row::Row};

/// A Markdown page that is built line by line.
#[derive(Default)]
pub(super) struct Page {
    pub text: String,
}

impl Page {
    pub(super) fn line(&mut self, text: impl AsRef<str>) {
        self.text += text.as_ref();
        self.text += "\n";
    }

    /// Adds a paragraph or a heading, and a blank line after it.
    pub(super) fn block(&mut self, text: impl AsRef<str>) {
        self.line(text);
        self.line("");
    }

    pub(super) fn picture(&mut self, title: &str, images: &str, file: &str) {
        self.block(format!("![{title}]({images}/{file})"));
    }

    /// Adds a table of rows that share their titles. Adds nothing if there are no rows.
    pub(super) fn rows<'a>(&mut self, rows: impl IntoIterator<Item = &'a Row>) {
        let mut rows = rows.into_iter().peekable();
        if let Some(first) = rows.peek() {
            self.table(&first.titles(), rows.map(Row::texts));
        }
    }

    pub(super) fn table(&mut self, titles: &[&str], rows: impl IntoIterator<Item = Vec<String>>) {
        self.line(format!("| {} |", titles.join(" | ")));
        self.line(format!("|{}", " --- |".repeat(titles.len())));
        for row in rows {
            self.line(format!("| {} |", row.join(" | ")));
        }
        self.line("");
    }
}

pub(super) fn cell(estimate: Option<&Estimate>, digits: usize) -> String {
    estimate.map_or("–".into(), |e| e.text(digits))
}
