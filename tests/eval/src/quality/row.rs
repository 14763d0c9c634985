//! One row of a table. Each value comes with its key in JSON and its title on the page.

use serde::{Serialize, Serializer, ser::SerializeMap};

use super::bootstrap::{Estimate, number};

/// A row of a section, from left to right.
#[derive(Debug, Clone, Default)]
pub(super) struct Row {
    cells: Vec<Cell>,
}

#[derive(Debug, Clone)]
struct Cell {
    /// `None` if JSON holds the value elsewhere.
    key: Option<&'static str>,
    title: &'static str,
    /// Decimals that the page shows.
    digits: usize,
    value: Value,
}

/// Content of a cell.
#[derive(Debug, Clone, Serialize)]
#[serde(untagged)]
pub(super) enum Value {
    Missing,
    Text(String),
    Count(usize),
    Counts([usize; 3]),
    Number(f64),
    Numbers([f64; 3]),
    Estimate(Estimate),
    Verdict(bool),
}

impl Row {
    pub(super) fn with(
        mut self,
        key: &'static str,
        title: &'static str,
        digits: usize,
        value: impl Into<Value>,
    ) -> Row {
        let (key, value) = (Some(key), value.into());
        self.cells.push(Cell {
            key,
            title,
            digits,
            value,
        });
        self
    }

    /// Puts the name of the row's group in front, for a table that shows several groups. JSON lists
    /// the groups one by one, so this cell is not part of it.
    pub(super) fn of_group(mut self, title: &'static str, group: &str) -> Row {
        let cell = Cell {
            key: None,
            title,
            digits: 0,
            value: group.into(),
        };
        self.cells.insert(0, cell);
        self
    }

    pub(super) fn estimate(&self, key: &str) -> Option<Estimate> {
        let cell = self.cells.iter().find(|cell| cell.key == Some(key))?;
        match cell.value {
            Value::Estimate(estimate) => Some(estimate),
            _ => None,
        }
    }

    pub(super) fn titles(&self) -> Vec<&'static str> {
        self.cells.iter().map(|cell| cell.title).collect()
    }

    pub(super) fn texts(&self) -> Vec<String> {
        let cells = self.cells.iter();
        cells.map(|cell| cell.value.text(cell.digits)).collect()
    }
}

impl Serialize for Row {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        for cell in &self.cells {
            if let Some(key) = cell.key {
                map.serialize_entry(key, &cell.value)?;
            }
        }
        map.end()
    }
}

impl Value {
    fn text(&self, digits: usize) -> String {
        match self {
            Value::Missing => "–".into(),
            Value::Text(text) => text.clone(),
            Value::Count(count) => count.to_string(),
            Value::Counts(counts) => counts.map(|count| count.to_string()).join(", "),
            Value::Number(value) => number(*value, digits),
            Value::Numbers(values) => values.map(|value| number(value, digits)).join(", "),
            Value::Estimate(estimate) => estimate.text(digits),
            Value::Verdict(verdict) => if *verdict { "yes" } else { "no" }.into(),
        }
    }
}

macro_rules! value_from {
    ($($type:ty => $variant:ident),+) => {
        $(impl From<$type> for Value {
            fn from(value: $type) -> Value {
                Value::$variant(value.into())
            }
        })+
    };
}
value_from!(
    &str => Text, String => Text, usize => Count, [usize; 3] => Counts, f64 => Number,
    [f64; 3] => Numbers, Estimate => Estimate, bool => Verdict
);

impl<T: Into<Value>> From<Option<T>> for Value {
    fn from(value: Option<T>) -> Value {
        value.map_or(Value::Missing, T::into)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_is_the_same_on_the_page_and_in_json() {
        let gap = Estimate {
            value: 1.25,
            interval: Some([1.0, 1.5]),
        };
        let row = Row::default()
            .with("clips", "clips", 0, 3)
            .with("gap_mm", "gap, mm", 1, Some(gap))
            .with("tuck_mm", "tuck, mm", 1, None::<f64>)
            .of_group("source", "grid");
        assert_eq!(row.titles(), ["source", "clips", "gap, mm", "tuck, mm"]);
        assert_eq!(row.texts(), ["grid", "3", "1.2 (1.0 to 1.5)", "–"]);
        let json = r#"{"clips":3,"gap_mm":{"value":1.25,"interval":[1.0,1.5]},"tuck_mm":null}"#;
        assert_eq!(serde_json::to_string(&row).unwrap(), json);
        assert_eq!(row.estimate("gap_mm"), Some(gap));
        assert_eq!(row.estimate("clips"), None);
    }
}
