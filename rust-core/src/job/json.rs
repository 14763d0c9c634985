//! Refuses JSON that would fill memory once it is parsed.
//!
//! A value of two letters takes thirty bytes in memory, and an object of seven letters takes seven
//! hundred. So a file within the limit of its kind may still grow a hundred times.

/// The most memory that the values of one text may take, bytes. A description of a scene with fifty
/// thousand nodes takes a quarter of it.
const MAX_MEMORY: usize = 512 << 20;
/// Memory of an object: a node of a map, which has room for eleven values, and the value itself.
const OBJECT: usize = 768;
/// Memory of any other value, and of a name. Lists have room for twice their values.
const VALUE: usize = 96;

/// Checks that the values of a text would take no more memory than [`MAX_MEMORY`].
///
/// Counts brackets, commas and colons outside of strings. The text need not be valid JSON.
///
/// # Errors
/// A message that says how much memory was expected and how much the text would take.
pub(crate) fn check_json(text: &[u8]) -> Result<(), String> {
    let memory = memory_of(text);
    if memory <= MAX_MEMORY {
        return Ok(());
    }
    let [most, got] = [MAX_MEMORY, memory].map(|bytes| bytes >> 20);
    Err(format!(
        "expected values that take at most {most} MiB of memory, got {got} MiB in {} bytes; divide the file, or check that it is the right one",
        text.len()
    ))
}

/// The memory that the values of a text take at most, in addition to that of its strings, bytes.
fn memory_of(text: &[u8]) -> usize {
    let mut memory = 0;
    let (mut is_in_string, mut is_escaped) = (false, false);
    for letter in text {
        if is_in_string {
            is_in_string = is_escaped || *letter != b'"';
            is_escaped = !is_escaped && *letter == b'\\';
            continue;
        }
        match letter {
            b'"' => is_in_string = true,
            b'{' => memory += OBJECT,
            b'[' | b',' | b':' => memory += VALUE,
            _ => {}
        }
    }
    memory
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strings_hide_their_brackets() {
        for (text, expected) in [
            (r#"{"a": [1, 2]}"#, OBJECT + 3 * VALUE),
            (r#"["{[,:", "\"{", "\\"]"#, 3 * VALUE),
            (r#"["\\\"{{{"#, VALUE),
            ("", 0),
        ] {
            assert_eq!(memory_of(text.as_bytes()), expected, "{text}");
        }
    }

    #[test]
    fn many_small_values_are_refused_and_long_strings_are_not() {
        let objects = format!("[{}]", "{},".repeat(700_000));
        let message = check_json(objects.as_bytes()).unwrap_err();
        assert!(message.contains("512 MiB of memory, got 576"), "{message}");
        let string = format!("[\"{}\"]", "{".repeat(2_000_000));
        check_json(string.as_bytes()).unwrap();
    }
}
