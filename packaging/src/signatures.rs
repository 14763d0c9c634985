//! The table of the library's functions for Python's ctypes, from the generated header.

use std::fmt::Write;

use anyhow::{Context, Result};

/// Where the table is.
pub const PATH: &str = "blender-addon/core/signatures.py";

const HEAD: &str = r#""""The functions of the native library, for ctypes.

Generated from `include/anyface.h` by `cargo xtask header`; change it there.
"""

from ctypes import (
    POINTER,
    c_char_p,
    c_double,
    c_float,
    c_int32,
    c_size_t,
    c_uint32,
    c_uint64,
    c_void_p,
)

"#;

const NAMES: &str = "
_HANDLE, _OUT, _TEXTS = c_void_p, POINTER(c_void_p), POINTER(c_char_p)
_FLOATS, _DOUBLES = POINTER(c_float), POINTER(c_double)
_INDICES, _NUMBERS, _COUNTS = POINTER(c_uint32), POINTER(c_int32), POINTER(c_size_t)

# Name: return type and argument types. Handles are untyped pointers.
SIGNATURES = {
";

/// Columns of a line of Python.
const WIDTH: usize = 100;

/// The Python file for a header.
///
/// # Errors
/// For a declaration whose types are not known here.
pub fn table(header: &str) -> Result<String> {
    let version = header
        .lines()
        .find_map(|line| line.strip_prefix("#define ANYFACE_ABI_VERSION "))
        .context("the header states no ANYFACE_ABI_VERSION")?;
    let mut table = format!("{HEAD}ABI_VERSION = {version}\n{NAMES}");
    for declaration in code(header).split(';') {
        let declaration = declaration.rsplit(['{', '}']).next().unwrap_or_default();
        if let Some((function, arguments)) = declaration.split_once('(')
            && let Some((result, name)) = function.rsplit_once(' ')
            && let name = name.trim_start_matches('*')
            && name.starts_with("anyface_")
        {
            let stars = "*".repeat(function.matches('*').count());
            let result = ctypes(&format!("{} {stars}", result.replace('*', "")))?;
            let arguments = arguments.trim_end().trim_end_matches(')');
            let arguments = arguments.split(',').map(str::trim);
            let arguments = arguments.filter(|argument| !matches!(*argument, "" | "void"));
            let arguments: Vec<&str> = arguments
                .map(|argument| ctypes(without_name(argument)))
                .collect::<Result<_>>()?;
            write_entry(&mut table, name, result, &arguments)?;
        }
    }
    table.push_str("}\n");
    Ok(table)
}

/// The header without comments and directives, in one line.
fn code(header: &str) -> String {
    let outside = header.split("/*").enumerate().map(|(n, part)| match n {
        0 => part,
        _ => part.split_once("*/").map_or("", |(_, rest)| rest),
    });
    let outside: String = outside.collect();
    let lines = outside.lines().filter(|line| !line.starts_with('#'));
    let lines = lines.map(|line| line.split("//").next().unwrap_or_default().trim());
    lines.collect::<Vec<_>>().join(" ")
}

/// The type of a parameter.
fn without_name(parameter: &str) -> &str {
    parameter.trim_end_matches(|c: char| c.is_ascii_alphanumeric() || c == '_')
}

/// The ctypes type of a C type.
fn ctypes(kind: &str) -> Result<&'static str> {
    let stars = kind.matches('*').count();
    let is_lent = kind.contains("const");
    let name = kind.replace("const", "").replace('*', "");
    Ok(match (name.trim(), stars) {
        ("void", 0) => "None",
        ("float", 0) => "c_float",
        ("double", 0) => "c_double",
        ("size_t", 0) => "c_size_t",
        ("uint32_t", 0) => "c_uint32",
        ("uint64_t", 0) => "c_uint64",
        ("int32_t" | "AnyfaceStatus", 0) => "c_int32",
        ("AnyfaceProgressFn" | "AnyfaceFramesFn", 0) => "c_void_p",
        ("char", 1) if is_lent => "c_char_p",
        ("char", 2) if is_lent => "_TEXTS",
        ("float", 1) => "_FLOATS",
        ("double", 1) => "_DOUBLES",
        ("uint32_t", 1) => "_INDICES",
        ("int32_t", 1) => "_NUMBERS",
        ("size_t", 1) => "_COUNTS",
        (_, 1) => "_HANDLE",
        (_, 2) => "_OUT",
        _ => anyhow::bail!("{kind}: expected a type that signatures.rs knows"),
    })
}

/// Writes an entry with the line breaks of ruff.
fn write_entry(table: &mut String, name: &str, result: &str, arguments: &[&str]) -> Result<()> {
    let list = format!("[{}]", arguments.join(", "));
    let line = format!("    \"{name}\": ({result}, {list}),");
    if line.len() <= WIDTH {
        writeln!(table, "{line}")?;
        return Ok(());
    }
    writeln!(table, "    \"{name}\": (\n        {result},")?;
    if 8 + list.len() < WIDTH {
        writeln!(table, "        {list},")?;
    } else {
        writeln!(table, "        [")?;
        for argument in arguments {
            writeln!(table, "            {argument},")?;
        }
        writeln!(table, "        ],")?;
    }
    writeln!(table, "    ),")?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const VERSION: &str = "#define ANYFACE_ABI_VERSION 3\n";

    #[test]
    fn a_declaration_becomes_an_entry() {
        let header = "/* A (comment); */\nextern \"C\" {\n/// Another; one.\nAnyfaceStatus \
                      anyface_mesh_read(const char *path, AnyfaceMesh **out,\nAnyfaceError **error);\n\
                      const char *anyface_version(void);\n}";
        let python = table(&format!("{VERSION}{header}")).unwrap();
        assert!(python.contains("\nABI_VERSION = 3\n"));
        let entries = "SIGNATURES = {\n    \"anyface_mesh_read\": (c_int32, [c_char_p, _OUT, _OUT]),\n    \
                       \"anyface_version\": (c_char_p, []),\n}\n";
        assert!(python.ends_with(entries), "{python}");
    }

    #[test]
    fn an_unknown_type_is_an_error() {
        let wrong = format!("{VERSION}void anyface_wait(long milliseconds);");
        let message = table(&wrong).unwrap_err().to_string();
        assert!(message.contains("long"), "{message}");
        assert!(table("").unwrap_err().to_string().contains("ABI_VERSION"));
    }
}
