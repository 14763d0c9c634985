//! Time and memory of this process.

use std::time::Instant;

/// Linux counts processor time in hundredths of a second.
const TICKS_PER_S: f64 = 100.0;

/// Counts the processor time of this process where Linux reports it, so that other programs do not
/// matter. Elsewhere it counts the time that passes.
pub(super) struct Stopwatch {
    work_s: Option<f64>,
    start: Instant,
}

impl Stopwatch {
    pub(super) fn start() -> Self {
        Stopwatch {
            work_s: processor_s(),
            start: Instant::now(),
        }
    }

    /// Seconds of work since the start.
    pub(super) fn work_s(&self) -> f64 {
        match (self.work_s, processor_s()) {
            (Some(before), Some(now)) => now - before,
            _ => self.elapsed_s(),
        }
    }

    /// Wall-clock seconds since the start.
    pub(super) fn elapsed_s(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }
}

/// Processor time of this process so far: fields 14 and 15 of `/proc/self/stat`.
fn processor_s() -> Option<f64> {
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The second field is a name in parentheses, which may contain any character.
    let (_, fields) = stat.rsplit_once(')')?;
    let mut times = fields.split_whitespace().skip(11).take(2);
    let mut ticks = || times.next()?.parse::<f64>().ok();
    Some((ticks()? + ticks()?) / TICKS_PER_S)
}

/// Asks Linux to measure the peak memory from now on. Elsewhere nothing happens.
pub(super) fn forget_peak() {
    // If Linux refuses, the peak still counts from the start of the process.
    let _ = std::fs::write("/proc/self/clear_refs", "5");
}

/// Peak memory of the process, MiB, where the system reports it.
pub(super) fn peak_mib() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    let kib: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib / 1024.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_is_counted_from_the_start() {
        let stopwatch = Stopwatch::start();
        let mut x = 1.0f64;
        // Work before the first look, since a tick may pass before it. A busy machine may keep this
        // process waiting, so give it up to a minute.
        loop {
            x = (x + 1.0).sqrt();
            if stopwatch.work_s() > 0.0 || stopwatch.elapsed_s() > 60.0 {
                break;
            }
        }
        assert!(x > 1.0 && stopwatch.work_s() > 0.0);
    }
}
