//! Times stages.

use serde::Serialize;

use crate::stopwatch::Stopwatch;
use anyface::Result;

/// One stage, with the least times of all its runs.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Stage {
    pub name: &'static str,
    /// Wall-clock time.
    pub elapsed_s: f64,
    /// Processor time of all threads.
    pub work_s: f64,
    /// Billions of additions and multiplications, if known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gflop: Option<f64>,
}

/// Times stages.
pub(super) struct Clock {
    pub runs: usize,
    pub stages: Vec<Stage>,
}

impl Clock {
    /// Runs `work` several times, records the least times and returns the last result.
    pub(super) fn time<T>(
        &mut self,
        name: &'static str,
        gflop: Option<f64>,
        mut work: impl FnMut() -> Result<T>,
    ) -> Result<T> {
        let mut best = Stage {
            name,
            elapsed_s: f64::INFINITY,
            work_s: f64::INFINITY,
            gflop,
        };
        let mut result = None;
        for _ in 0..self.runs {
            drop(result.take());
            let stopwatch = Stopwatch::start();
            result = Some(work()?);
            best.elapsed_s = best.elapsed_s.min(stopwatch.elapsed_s());
            best.work_s = best.work_s.min(stopwatch.work_s());
        }
        self.stages.push(best);
        Ok(result.expect("at least one run"))
    }
}
