//! Checks that a shared library exports the functions of the header and needs nothing that a plain
//! system lacks.

use std::{collections::BTreeSet, fs, path::Path};

use anyhow::{Context, Result, ensure};
use object::{
    Endianness, Object, ObjectSymbol,
    macho::{LC_CODE_SIGNATURE, LC_LOAD_DYLIB},
    read::macho::{LoadCommandVariant, MachHeader, MachOFile64},
};

use crate::{cross::GLIBC, machine, platform::Platform};

/// Major and minor number.
pub type Version = (u32, u32);

/// The libraries that every such system has: the names that a library lists, or the beginnings of
/// names.
fn libraries_of_systems(platform: Platform) -> &'static [&'static str] {
    match platform {
        Platform::LinuxX64 | Platform::LinuxArm64 => &[
            "libc.so.6",
            "libm.so.6",
            "libdl.so.2",
            "librt.so.1",
            "libpthread.so.0",
            "libgcc_s.so.1",
            "ld-linux-",
        ],
        Platform::MacosArm64 | Platform::MacosX64 => &["/usr/lib/", "/System/Library/Frameworks/"],
        Platform::WindowsX64 => &[
            "kernel32.dll",
            "ntdll.dll",
            "msvcrt.dll",
            "ucrtbase.dll",
            "advapi32.dll",
            "userenv.dll",
            "ws2_32.dll",
            "bcryptprimitives.dll",
            "vcruntime140.dll",
            "api-ms-win-",
            "shell32.dll",
            "combase.dll",
            "ole32.dll",
        ],
    }
}

/// Checks that the main library exports the functions of include/anyface.h and loads on a plain
/// system.
///
/// # Errors
/// Names the missing functions, or what the library needs that a plain system may lack.
pub fn check(platform: Platform, library: &Path) -> Result<()> {
    let bytes = read(library)?;
    let file = parse(library, &bytes)?;
    let exports: BTreeSet<String> = exports(&file)?.into_iter().collect();
    let missing: Vec<_> = functions_of_header()?
        .into_iter()
        .filter(|name| !exports.contains(name))
        .collect();
    ensure!(
        missing.is_empty(),
        "{}: expected every function of include/anyface.h, {} lack: {missing:?}",
        library.display(),
        missing.len()
    );
    let known = libraries_of_systems(platform);
    let strange: Vec<_> = needed(&file, &bytes)?
        .into_iter()
        .filter(|name| {
            let small = name.to_lowercase();
            let is_own = small.ends_with(platform.shared_library());
            !is_own
                && !known
                    .iter()
                    .any(|known| name.starts_with(known) || small.starts_with(known))
        })
        .collect();
    ensure!(
        strange.is_empty(),
        "{}: expected libraries that every {} has, got {strange:?}",
        library.display(),
        platform.name()
    );
    if platform.is_linux() {
        let newest = glibc_of(library, &bytes)?;
        ensure!(
            newest <= GLIBC,
            "{}: expected symbols up to glibc {GLIBC:?}, got {newest:?}",
            library.display()
        );
    }
    if platform == Platform::MacosArm64 {
        check_signature(library, &bytes)?;
    }
    Ok(())
}

/// The functions of ours that `library` exports, sorted by name.
///
/// # Errors
/// If the file is not a library.
pub fn exported(library: &Path) -> Result<Vec<String>> {
    exports(&parse(library, &read(library)?)?)
}

/// The oldest glibc that has every symbol that `library` needs.
///
/// # Errors
/// If the file cannot be read or names no version of glibc.
pub fn needed_glibc(library: &Path) -> Result<Version> {
    glibc_of(library, &read(library)?)
}

/// Like `needed_glibc`, for a library in memory. The file contains the names of the versions as
/// text.
fn glibc_of(library: &Path, bytes: &[u8]) -> Result<Version> {
    newest_glibc(&String::from_utf8_lossy(bytes))
        .with_context(|| format!("{}: expected symbols of glibc, got none", library.display()))
}

fn read(library: &Path) -> Result<Vec<u8>> {
    fs::read(library).with_context(|| format!("reading {}", library.display()))
}

fn parse<'a>(library: &Path, bytes: &'a [u8]) -> Result<object::File<'a>> {
    object::File::parse(bytes)
        .with_context(|| format!("{}: expected a shared library", library.display()))
}

fn exports(file: &object::File) -> Result<Vec<String>> {
    let mut names: Vec<String> = match file {
        object::File::Elf64(_) => file
            .dynamic_symbols()
            .filter(|symbol| symbol.is_definition())
            .filter_map(|symbol| Some(symbol.name().ok()?.to_owned()))
            .collect(),
        _ => file
            .exports()?
            .into_iter()
            .map(|export| {
                let name = String::from_utf8_lossy(export.name()).into_owned();
                // macOS puts an underscore before the names of C functions.
                name.strip_prefix('_').map_or(name.clone(), str::to_owned)
            })
            .collect(),
    };
    names.retain(|name| name.starts_with("anyface_"));
    names.sort();
    Ok(names)
}

/// Names of the libraries that this one needs to load.
fn needed(file: &object::File, bytes: &[u8]) -> Result<Vec<String>> {
    Ok(match file {
        object::File::Elf64(elf) => {
            use object::read::elf::{Dyn, FileHeader};
            let endian = elf.endian();
            let sections = elf.elf_header().sections(endian, bytes)?;
            let (dynamic, strings) = sections
                .dynamic(endian, bytes)?
                .context("expected a dynamic section")?;
            let strings = sections.strings(endian, bytes, strings)?;
            let names = dynamic
                .iter()
                .filter(|entry| entry.tag(endian) == object::elf::DT_NEEDED);
            names
                .map(|entry| {
                    let name = entry.string(endian, strings)?;
                    Ok(String::from_utf8_lossy(name).into_owned())
                })
                .collect::<Result<_>>()?
        }
        object::File::MachO64(_) => {
            let mut names = Vec::new();
            for (command, name) in load_commands(bytes)? {
                if command == LC_LOAD_DYLIB {
                    names.extend(name);
                }
            }
            names
        }
        _ => {
            let mut names: Vec<String> = file
                .imports()?
                .into_iter()
                .map(|import| String::from_utf8_lossy(import.library()).into_owned())
                .collect();
            names.sort();
            names.dedup();
            names
        }
    })
}

/// The numbers of a macOS library's load commands, each with the library that it names, if any.
fn load_commands(bytes: &[u8]) -> Result<Vec<(u32, Option<String>)>> {
    let file = MachOFile64::<Endianness>::parse(bytes)?;
    let endian = file.endian();
    let mut commands = file.macho_header().load_commands(endian, bytes, 0)?;
    let mut entries = Vec::new();
    while let Some(command) = commands.next()? {
        let name = match command.variant()? {
            LoadCommandVariant::Dylib(library) => {
                let name = command.string(endian, library.dylib.name)?;
                Some(String::from_utf8_lossy(name).into_owned())
            }
            _ => None,
        };
        entries.push((command.cmd(), name));
    }
    Ok(entries)
}

/// Checks the signature: Apple's processors load nothing unsigned, though the linker's signature is
/// enough.
fn check_signature(library: &Path, bytes: &[u8]) -> Result<()> {
    let commands = load_commands(bytes)?;
    let is_signed = commands
        .iter()
        .any(|(command, _)| *command == LC_CODE_SIGNATURE);
    ensure!(
        is_signed,
        "{}: expected a signature, as Apple's processors load nothing without; got none",
        library.display()
    );
    Ok(())
}

/// The functions that include/anyface.h declares.
fn functions_of_header() -> Result<Vec<String>> {
    let text = fs::read_to_string(machine::root().join("include/anyface.h"))?;
    let code: String = text
        .lines()
        .filter(|line| !line.trim_start().starts_with(['*', '/', '#']))
        .collect::<Vec<_>>()
        .join("\n");
    let mut names: Vec<String> = code
        .match_indices("anyface_")
        .filter_map(|(at, _)| {
            let end = code[at..].find(|c: char| !c.is_ascii_alphanumeric() && c != '_')? + at;
            let is_word = !code[..at].ends_with(|c: char| c.is_ascii_alphanumeric() || c == '_');
            (is_word && code[end..].starts_with('(')).then(|| code[at..end].to_owned())
        })
        .collect();
    names.sort();
    names.dedup();
    ensure!(
        !names.is_empty(),
        "include/anyface.h: expected functions, found none"
    );
    Ok(names)
}

/// The newest version of glibc that a text names.
fn newest_glibc(text: &str) -> Option<Version> {
    let versions = text.split("GLIBC_").skip(1).filter_map(|rest| {
        let end = rest.find(|c: char| c != '.' && !c.is_ascii_digit());
        let mut numbers = rest[..end.unwrap_or(rest.len())].split('.');
        Some((numbers.next()?.parse().ok()?, numbers.next()?.parse().ok()?))
    });
    versions.max()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_compared_as_numbers() {
        let table = "0 DF *UND* 0 (GLIBC_2.9) open\n0 DF *UND* 0 (GLIBC_2.28) fcntl64\n\
                     0 DF *UND* 0 (GLIBC_2.2.5) read\n";
        assert_eq!(newest_glibc(table), Some((2, 28)));
        assert_eq!(newest_glibc("no versions"), None);
    }

    #[test]
    fn the_header_names_its_functions() {
        let names = functions_of_header().unwrap();
        for name in ["anyface_abi_version", "anyface_stream_obey"] {
            assert!(names.iter().any(|known| known == name), "{name}: {names:?}");
        }
    }

    /// Builds a library with two functions that needs only the C library.
    #[test]
    #[cfg(target_os = "linux")]
    fn what_a_library_lacks_is_named() {
        let folder = std::env::temp_dir().join(format!("anyface-symbols-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        fs::write(
            folder.join("stub.c"),
            "#include <stdlib.h>\nint anyface_abi_version(void) { return abs(rand()); }\n\
             int anyface_zebra(void) { return 2; }\n",
        )
        .unwrap();
        let status = std::process::Command::new("sh")
            .current_dir(&folder)
            .args(["-c", "cc -shared -fPIC stub.c -o libanyface.so"])
            .status();
        assert!(status.unwrap().success());
        let library = folder.join("libanyface.so");
        let names = exported(&library).unwrap();
        assert_eq!(names, ["anyface_abi_version", "anyface_zebra"]);
        let bytes = read(&library).unwrap();
        let file = parse(&library, &bytes).unwrap();
        assert_eq!(needed(&file, &bytes).unwrap(), ["libc.so.6"]);
        let message = check(Platform::here().unwrap(), &library).unwrap_err();
        let message = message.to_string();
        assert!(message.contains("anyface_stream_obey"), "{message}");
        assert!(!message.contains("anyface_abi_version"), "{message}");
        fs::remove_dir_all(folder).unwrap();
    }
}
