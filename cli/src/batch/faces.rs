//! Faces and models that many rows share. Each is prepared once, when the first of its rows needs
//! it.

use std::{
    collections::{HashMap, HashSet},
    path::PathBuf,
    sync::{Arc, Mutex, OnceLock, PoisonError},
};

use anyface::{Engine, Error, Face, Result, job::ProgressFn, mesh::NamedMesh, output::TakeWeights};

use super::{ledger::Failure, line::Line, rows::Row};
use crate::stages::{new_report, note_face};

/// This many faces stay in memory. A few are enough, because the rows of one face come one after the other.
const MOST: usize = 4;

/// A face with the models that move it.
pub struct Ready {
    pub engine: Arc<Engine>,
    /// `None` if the rows have no mesh.
    pub face: Option<Face>,
    /// The file of its mesh.
    pub mesh: Option<PathBuf>,
    /// `Some` if a row of the face wants weights of its shapes as the result.
    pub weights: Option<TakeWeights>,
    /// What the user should know about the face.
    pub warnings: Vec<String>,
}

type Slot<T> = Arc<OnceLock<std::result::Result<Arc<T>, Failure>>>;

/// All faces of a batch.
#[derive(Default)]
pub struct Faces {
    /// Keyed by [`Row::face`], the most recently used face last.
    faces: Mutex<Vec<(String, Slot<Ready>)>>,
    /// Keyed by the options that choose them.
    engines: Mutex<HashMap<String, Slot<Engine>>>,
}

impl Faces {
    /// The face of a row. The first caller prepares it, and callers that come meanwhile wait.
    /// `rows`: all rows that may move it.
    ///
    /// # Errors
    /// The reason why the face cannot be prepared. Callers that share the face get the same error.
    pub fn ready(
        &self,
        row: &Row,
        line: &Line,
        rows: &[Row],
        progress: ProgressFn<'_>,
    ) -> std::result::Result<Arc<Ready>, Failure> {
        let slot = {
            let mut faces = self.faces.lock().unwrap_or_else(PoisonError::into_inner);
            let known = faces.iter().position(|(key, _)| *key == row.face);
            let known = known.map(|at| faces.remove(at).1);
            let slot = known.unwrap_or_default();
            faces.push((row.face.clone(), Arc::clone(&slot)));
            if faces.len() > MOST {
                faces.remove(0);
            }
            slot
        };
        let ready = slot.get_or_init(|| {
            let engine = self.engine(line)?;
            let ready = make(engine, row, line, rows, progress);
            ready.map(Arc::new).map_err(|error| Failure::from(&error))
        });
        ready.clone()
    }

    /// Prepares the first faces that the rows need, as many as stay in memory. A face that cannot
    /// be prepared is skipped.
    pub fn prepare(&self, rows: &[Row], progress: ProgressFn<'_>) {
        let mut known = HashSet::new();
        let first = rows.iter().filter(|row| known.insert(row.face.as_str()));
        for row in first.take(MOST) {
            if let Ok(line) = &row.line {
                let _ = self.ready(row, line, rows, progress);
            }
        }
    }

    /// The face of a row, if it is prepared and still in memory.
    pub fn at_hand(&self, row: &Row) -> Option<Arc<Ready>> {
        let faces = self.faces.lock().unwrap_or_else(PoisonError::into_inner);
        let (_, slot) = faces.iter().find(|(key, _)| *key == row.face)?;
        slot.get()?.as_ref().ok().cloned()
    }

    /// The models of a line.
    fn engine(&self, line: &Line) -> std::result::Result<Arc<Engine>, Failure> {
        let key = line.shared.key();
        let slot = {
            let mut engines = self.engines.lock().unwrap_or_else(PoisonError::into_inner);
            Arc::clone(engines.entry(key).or_default())
        };
        let open = || line.shared.engine().map(Arc::new);
        let engine = slot.get_or_init(|| open().map_err(|error: Error| Failure::from(&error)));
        engine.clone()
    }
}

fn make(
    engine: Arc<Engine>,
    row: &Row,
    line: &Line,
    rows: &[Row],
    progress: ProgressFn<'_>,
) -> Result<Ready> {
    let mut ready = Ready {
        engine,
        face: None,
        mesh: None,
        weights: None,
        warnings: Vec::new(),
    };
    let Some(path) = line.options.mesh.as_deref() else {
        return Ok(ready);
    };
    let named = NamedMesh::read(path)?;
    let mut report = new_report();
    let face = &line.options.face;
    let options = face.options((path, &named), None, &mut report.warnings)?;
    let face = ready.engine.prepare(&named.mesh, &options, progress)?;
    note_face(&mut report, &face);
    let reach = ready.engine.mouth_reach(&face, progress)?;
    let limits = reach.map(|reach| reach.sentences());
    report.warnings.extend(limits.into_iter().flatten());
    ready.warnings = report.warnings;
    let is_weights = |other: &Row| {
        let line = other.line.as_ref();
        other.face == row.face && line.is_ok_and(Line::wants_weights)
    };
    if rows.iter().any(is_weights) {
        ready.weights = Some(ready.engine.take_weights(&face, progress)?);
    }
    (ready.face, ready.mesh) = (Some(face), Some(path.to_owned()));
    Ok(ready)
}
