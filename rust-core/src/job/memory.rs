//! Estimates a job's peak memory before the work starts, and finds how much memory is available.

use std::{fs, path::Path};

use crate::{Error, Result};

/// Memory of the code and of models that are not large, bytes.
const BASE: u64 = 70 << 20;
/// Additional memory for finding and moving a face, even on the smallest mesh.
const OF_ANY_MESH: u64 = 25 << 20;
/// Most memory per vertex while a face is found and prepared: the mesh twice, edges, trees, the
/// skin.
const PREPARED: u64 = 800;
/// Memory per vertex that stays while frames are made.
const KEPT: u64 = 600;
/// Memory per vertex of a rig's shape and of its sources.
const SHAPE: u64 = 18;
/// Memory per vertex of a frame.
const FRAME: u64 = 12;
/// Percent of the parts that are in memory at once. On five meshes and five lengths the sum of the
/// parts was 83 to 133 % of the measured memory.
const AT_ONCE_PERCENT: u64 = 92;
/// Share of an estimate that the job surely needs.
const SURELY: f64 = 0.6;

/// The sizes of a job that decide how much memory it needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct MemoryNeed {
    /// Vertices of the mesh.
    pub vertices: usize,
    /// Shapes made for the mesh.
    pub shapes: usize,
    /// How many frames have their displacements in memory at once.
    pub frames: usize,
    /// Memory for analysing the sound and performing to it, bytes.
    pub speech: u64,
    /// Memory of large models, bytes. That of the others is part of every estimate.
    pub models: u64,
}

impl MemoryNeed {
    /// Estimates the peak memory of a process that does only this job, bytes. The estimate is
    /// within a quarter of the measured values from 468 to 13,380 vertices and from ten seconds to
    /// two hours of speech, and within 40 % up to 2.3 million vertices.
    pub fn bytes(&self) -> u64 {
        let [vertices, shapes, frames] =
            [self.vertices, self.shapes, self.frames].map(|count| count as u64);
        let of_all = |bytes: u64| bytes.saturating_mul(vertices);
        // Frames start when most of the memory for speech is free again.
        let moved = of_all(frames.saturating_mul(FRAME));
        let (more, less) = (moved.max(self.speech), moved.min(self.speech));
        let animation = of_all(KEPT).saturating_add(more).saturating_add(less / 2);
        let any = if vertices > 0 { OF_ANY_MESH } else { 0 };
        let parts = animation
            .max(of_all(PREPARED))
            .saturating_add(of_all(shapes.saturating_mul(SHAPE)))
            .saturating_add(BASE + any)
            .saturating_add(self.models);
        parts / 100 * AT_ONCE_PERCENT
    }

    /// Returns a warning if the job needs more than the free memory.
    ///
    /// # Errors
    /// `OutOfMemory` if the job would not fit even with an estimate that is too high by its largest
    /// error.
    pub fn check(&self) -> Result<Option<String>> {
        available().map_or(Ok(None), |available| self.compare(available))
    }

    fn compare(&self, available: u64) -> Result<Option<String>> {
        let needed = self.bytes();
        let megabytes = |bytes: u64| bytes >> 20;
        let message = format!(
            "{} vertices take about {} MB of memory, and {} MB are left",
            self.vertices,
            megabytes(needed),
            megabytes(available)
        );
        match (
            needed as f64 * SURELY > available as f64,
            needed > available,
        ) {
            (true, _) => Err(Error::OutOfMemory(message)),
            (_, true) => Ok(Some(message)),
            _ => Ok(None),
        }
    }
}

/// Memory that this process may still take, bytes. It is the least of the system's free memory, the
/// remainder that the control groups allow and the rest of the address space. `None` if the system
/// does not report them (all but Linux).
pub fn available() -> Option<u64> {
    let read = |path: &str| fs::read_to_string(path).unwrap_or_default();
    let left = kilobytes(&read("/proc/meminfo"), "MemAvailable:");
    let mapped = kilobytes(&read("/proc/self/status"), "VmSize:");
    let addresses = most_addresses(&read("/proc/self/limits"))
        .zip(mapped)
        .map(|(most, mapped)| most.saturating_sub(mapped));
    let groups = left_of_groups(&read("/proc/self/cgroup"), Path::new("/sys/fs/cgroup"));
    [left, addresses, groups].into_iter().flatten().min()
}

/// Reads a row such as `VmSize:   1234 kB`, in bytes.
fn kilobytes(text: &str, name: &str) -> Option<u64> {
    let row = text.lines().find_map(|line| line.strip_prefix(name))?;
    let number = row.split_whitespace().next()?.parse::<u64>().ok()?;
    Some(number << 10)
}

/// The limit of the address space (`ulimit -v`), bytes.
fn most_addresses(limits: &str) -> Option<u64> {
    let mut rows = limits.lines();
    let row = rows.find_map(|line| line.strip_prefix("Max address space"))?;
    row.split_whitespace().next()?.parse().ok()
}

/// Memory that a process may still take under its control groups and their parents, bytes. Reads
/// both versions of the interface.
fn left_of_groups(groups: &str, root: &Path) -> Option<u64> {
    let left = |line: &str| {
        let (_, rest) = line.split_once(':')?;
        let (controllers, path) = rest.split_once(':')?;
        let (root, limit, used) = match controllers {
            "" => (root.to_owned(), "memory.max", "memory.current"),
            "memory" => (
                root.join("memory"),
                "memory.limit_in_bytes",
                "memory.usage_in_bytes",
            ),
            _ => return None,
        };
        let group = root.join(path.trim_start_matches('/'));
        let above = group
            .ancestors()
            .take_while(|folder| folder.starts_with(&root));
        above
            .filter_map(|folder| left_of_group(folder, limit, used))
            .min()
    };
    groups.lines().filter_map(left).min()
}

/// The limit less the memory in use. Pages of files that can be dropped count as free.
fn left_of_group(folder: &Path, limit: &str, used: &str) -> Option<u64> {
    let read = |file: &str| fs::read_to_string(folder.join(file)).ok();
    let number = |file: &str| read(file)?.trim().parse::<u64>().ok();
    let statistics = read("memory.stat").unwrap_or_default();
    let files = ["inactive_file ", "active_file "]
        .into_iter()
        .filter_map(|name| {
            let row = statistics
                .lines()
                .find_map(|line| line.strip_prefix(name))?;
            row.trim().parse::<u64>().ok()
        });
    let in_use = number(used)?.saturating_sub(files.sum());
    Some(number(limit)?.saturating_sub(in_use))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_read_from_what_linux_says() {
        let status = "Name:\tanyface\nVmSize:\t    2048 kB\nVmRSS:\t 1024 kB\n";
        assert_eq!(kilobytes(status, "VmSize:"), Some(2 << 20));
        assert_eq!(kilobytes(status, "MemAvailable:"), None);
        let limits = "Max stack size   8388608   unlimited   bytes\n\
                      Max address space         3000000              unlimited            bytes\n";
        assert_eq!(most_addresses(limits), Some(3_000_000));
        assert_eq!(
            most_addresses(&limits.replace("3000000", "unlimited")),
            None
        );
    }

    #[test]
    fn the_narrowest_group_counts_and_pages_of_files_do_not() {
        let root = tempfile::tempdir().unwrap();
        let write = |folder: &str, files: [(&str, &str); 3]| {
            let folder = root.path().join(folder);
            fs::create_dir_all(&folder).unwrap();
            for (name, text) in files {
                fs::write(folder.join(name), text).unwrap();
            }
        };
        let of_two = |limit, used| {
            let files = "anon 5\ninactive_file 10\nactive_file 20\n";
            [
                ("memory.max", limit),
                ("memory.current", used),
                ("memory.stat", files),
            ]
        };
        write("a/b", of_two("max\n", "500\n"));
        write("a", of_two("1000\n", "430\n"));
        assert_eq!(left_of_groups("0::/a/b\n", root.path()), Some(600));
        let of_one = [
            ("memory.limit_in_bytes", "700\n"),
            ("memory.usage_in_bytes", "600\n"),
            ("memory.stat", ""),
        ];
        write("memory/c", of_one);
        let groups = "4:memory:/c\n3:cpu:/c\n0::/a/b\n";
        assert_eq!(left_of_groups(groups, root.path()), Some(100));
        assert_eq!(left_of_groups("0::/\n", root.path()), None);
    }

    #[test]
    fn what_surely_does_not_fit_is_an_error_and_what_may_not_a_warning() {
        let need = MemoryNeed {
            vertices: 1_000_000,
            ..MemoryNeed::default()
        };
        let bytes = need.bytes();
        assert_eq!(need.compare(bytes).unwrap(), None);
        let warning = need.compare(bytes - (1 << 20)).unwrap().unwrap();
        assert!(
            warning.starts_with("1000000 vertices take about"),
            "{warning}"
        );
        let error = need.compare(bytes / 2).unwrap_err();
        assert!(matches!(error, Error::OutOfMemory(_)), "{error}");
    }

    #[test]
    fn an_estimate_grows_with_all_that_it_counts() {
        let sizes = [0, 100, 1_000, 1_000_000, usize::MAX];
        for pair in sizes.windows(2) {
            for [vertices, shapes, frames] in [[1, 0, 0], [0, 1, 0], [0, 0, 1]] {
                let at = |size: usize| {
                    let need = MemoryNeed {
                        vertices: 1_000 + vertices * size.min(1 << 50),
                        shapes: shapes * size,
                        frames: frames * size,
                        ..MemoryNeed::default()
                    };
                    need.bytes()
                };
                assert!(at(pair[0]) < at(pair[1]) || at(pair[1]) == u64::MAX);
            }
        }
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn linux_says_what_is_left() {
        assert!(available().unwrap() > 1 << 20);
    }
}
