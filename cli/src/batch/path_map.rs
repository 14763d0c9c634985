//! Translates paths from another machine, as `--map FROM=TO` says.

use std::{
    fmt::{Display, Formatter},
    str::FromStr,
};

/// Two names of one folder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PathMap {
    from: String,
    to: String,
}

impl FromStr for PathMap {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (from, to) = text.split_once('=').unwrap_or_default();
        if from.is_empty() || to.is_empty() {
            Err(format!(
                "expected FROM=TO, as in P:\\show=/mnt/show, got {text:?}"
            ))
        } else {
            Ok(PathMap {
                from: from.to_owned(),
                to: to.to_owned(),
            })
        }
    }
}

impl Display for PathMap {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}={}", self.from, self.to)
    }
}

/// Whether this is a Windows path, which begins with a drive or has backslashes.
pub fn is_of_windows(path: &str) -> bool {
    let drive = path.as_bytes();
    let has_drive = drive.len() > 1 && drive[0].is_ascii_alphabetic() && drive[1] == b':';
    has_drive || path.contains('\\')
}

impl PathMap {
    /// Moves a path from one folder of the map into the other. Returns `None` if it does not lie in
    /// the first. If only one folder is a Windows path, the result lies in the one that suits this
    /// system, otherwise in `to`.
    fn translate(&self, path: &str, is_windows: bool) -> Option<String> {
        let (from, to) = (self.from.as_str(), self.to.as_str());
        let turned = is_of_windows(from) != is_of_windows(to) && is_of_windows(to) != is_windows;
        let (foreign, local) = if turned { (to, from) } else { (from, to) };
        let rest = rest_of(path, foreign)?;
        let separator = if is_of_windows(local) { "\\" } else { "/" };
        let local = local.trim_end_matches(['/', '\\']);
        Some(match rest.is_empty() {
            true if local.is_empty() => separator.to_owned(),
            true => local.to_owned(),
            false => format!("{local}{separator}{}", rest.join(separator)),
        })
    }
}

/// The path as this system opens it, translated by the first map that applies.
pub fn translated(path: &str, maps: &[PathMap]) -> String {
    let by_map = |map: &PathMap| map.translate(path, cfg!(windows));
    maps.iter()
        .find_map(by_map)
        .unwrap_or_else(|| path.to_owned())
}

/// The components of a path below a folder. `None` if the path does not lie in it.
fn rest_of<'a>(path: &'a str, folder: &'a str) -> Option<Vec<&'a str>> {
    // Windows ignores case and accepts both separators.
    let of_windows = is_of_windows(folder);
    let separators: &[char] = if of_windows { &['/', '\\'] } else { &['/'] };
    let [path, folder] = [path, folder].map(|text| {
        let parts = text.trim_end_matches(separators).split(separators);
        parts.collect::<Vec<&str>>()
    });
    let same = |(a, b): (&&str, &&str)| {
        if of_windows {
            a.eq_ignore_ascii_case(b)
        } else {
            a == b
        }
    };
    let is_inside = path.len() >= folder.len() && path.iter().zip(&folder).all(same);
    is_inside.then(|| path[folder.len()..].to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(text: &str, path: &str, is_windows: bool) -> Option<String> {
        text.parse::<PathMap>().unwrap().translate(path, is_windows)
    }

    #[test]
    fn the_path_of_this_system_is_opened_whichever_side_the_row_has() {
        for map_text in ["P:\\show=/mnt/show", "/mnt/show=P:\\show"] {
            let unix = |path: &str| map(map_text, path, false);
            assert_eq!(
                unix("P:\\show\\a\\b.wav").as_deref(),
                Some("/mnt/show/a/b.wav")
            );
            assert_eq!(unix("p:/Show/b.wav").as_deref(), Some("/mnt/show/b.wav"));
            assert_eq!(unix("/mnt/show/a.wav"), None);
            let windows = |path: &str| map(map_text, path, true);
            assert_eq!(
                windows("/mnt/show/a/b.wav").as_deref(),
                Some("P:\\show\\a\\b.wav")
            );
            assert_eq!(windows("P:\\show\\b.wav"), None);
        }
    }

    #[test]
    fn of_two_paths_alike_the_second_is_meant() {
        for is_windows in [true, false] {
            let unix = |path: &str| map("/old/=/new", path, is_windows);
            assert_eq!(unix("/old/a.wav").as_deref(), Some("/new/a.wav"));
            assert_eq!(unix("/older/a.wav"), None);
            assert_eq!(unix("/OLD/a.wav"), None);
            assert_eq!(unix("/old").as_deref(), Some("/new"));
            let windows = |path: &str| map("C:\\old=D:\\new\\", path, is_windows);
            assert_eq!(
                windows("c:\\OLD\\x/y.wav").as_deref(),
                Some("D:\\new\\x\\y.wav")
            );
        }
        assert_eq!(map("/old=/", "/old/a", false).as_deref(), Some("/a"));
        assert_eq!(
            map("/=/mnt", "/old/a", false).as_deref(),
            Some("/mnt/old/a")
        );
    }

    #[test]
    fn half_a_map_is_refused() {
        for text in ["", "a", "=b", "a="] {
            let message = text.parse::<PathMap>().unwrap_err();
            assert!(message.contains("expected FROM=TO"), "{text}: {message}");
        }
    }
}
