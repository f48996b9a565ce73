//! `sequence`: the frames of a moving scene, one after the other.

use std::sync::{Arc, Mutex, PoisonError};

use nelu3d::color_field::{check_field, check_mono};
use nelu3d::reconstruct::Context;
use nelu3d::sequence::{
    FrameInput, FrameReconstruction, FrameState, MotionMode, MotionOptions, Neighbors, Plan, reconstruct_frame,
};
use nelu3d::{Progress, ReconstructionOptions};
use nelu3d_scan::rig::{Need, PatternSet, Shot};
use pyo3::prelude::*;
use pyo3::sync::MutexExt;
use pyo3::types::PyDict;

use crate::error::{Error, Problem, exception};
use crate::reconstruct::field_of;
use crate::result::Reconstruction;
use crate::rig::Rig;
use crate::{json, work};

/// The frames of a sequence, as an iterator of `Reconstruction`: each is computed when it is asked for.
#[pyclass(frozen, module = "nelu3d", name = "Sequence")]
pub(crate) struct Sequence {
    rig: Arc<nelu3d_scan::Rig>,
    set: PatternSet,
    frames: Vec<Shot>,
    field: Arc<nelu3d::ColorField>,
    options: ReconstructionOptions,
    motion: MotionOptions,
    plan: Plan,
    accept: bool,
    progress: Option<Py<PyAny>>,
    at: Mutex<Position>,
}

/// How far the iteration is.
#[derive(Default)]
struct Position {
    /// The frame that comes next.
    next: usize,
    /// What the frame before it left, unless it failed.
    state: Option<FrameState>,
}

impl Sequence {
    /// Computes frame `i`.
    fn compute(
        &self,
        i: usize,
        state: Option<&FrameState>,
        progress: &Progress,
    ) -> Result<FrameReconstruction, Problem> {
        let (rig, shot) = (&self.rig, &self.frames[i]);
        let capture = rig.read_shot(shot, &self.set, Need::Frame)?;
        check_mono(&capture, &self.set, shot, &self.field)?;
        // A neighbor that cannot be read is none, and fails when its turn comes.
        let white = |i: usize| {
            let shot = self.frames.get(i).filter(|_| self.motion.motion != MotionMode::Off)?;
            rig.reader(shot).read(&rig.white).ok()
        };
        let neighbors = Neighbors::new(i.checked_sub(1).and_then(white), white(i + 1));
        let input = FrameInput {
            state: state.filter(|_| !self.plan.is_key(i)),
            neighbors: &neighbors,
            rig,
            field: &self.field,
            options: &self.options,
            motion: &self.motion,
        };
        let cx = Context::new(progress, self.options.device)?;
        reconstruct_frame(&input, capture, cx).map_err(|failure| failure.at(&shot.dir).into())
    }
}

#[pymethods]
impl Sequence {
    fn __iter__(this: Bound<'_, Self>) -> Bound<'_, Self> {
        this
    }

    fn __len__(&self) -> usize {
        self.frames.len()
    }

    /// Computes the next frame. After an exception the iteration goes on with the frame after, which then begins anew.
    fn __next__(&self, py: Python<'_>) -> PyResult<Option<Py<Reconstruction>>> {
        let mut at = self.at.lock_py_attached(py).unwrap_or_else(PoisonError::into_inner);
        let i = at.next;
        if i >= self.frames.len() {
            return Ok(None);
        }
        at.next += 1;
        let state = at.state.take();
        let callback = self.progress.as_ref().map(|p| p.bind(py));
        let made = work::run(py, callback, |progress| self.compute(i, state.as_ref(), progress))?;
        at.state = Some(made.state());
        let result = Reconstruction {
            judgment: made.diagnostics.reconstruction.judgment.clone(),
            diagnostics: serde_json::to_value(&made.diagnostics).map_err(exception)?,
            surface: made.surface,
            stages: made.stages,
            rig: self.rig.clone(),
            set: self.set.clone(),
            shot: self.frames[i].clone(),
            files: Vec::new(),
        };
        result.hand_out(py, self.accept).map(Some)
    }

    fn __repr__(&self) -> String {
        // While a frame is computed the position is not to be had.
        let done = self.at.try_lock().map(|at| format!(", {} done", at.next)).unwrap_or_default();
        format!("<nelu3d.Sequence of {} frames{done}>", self.frames.len())
    }
}

/// Reconstructs a moving scene frame after frame, as `nelu3d sequence` does. `motion` is "auto", "interpolate", or
/// "off"; `keyframe` the number of frames from one that begins anew to the next.
#[pyfunction]
#[pyo3(signature = (
    rig, name, field = None, *, set = None, keyframe = 30, motion = "auto",
    pattern_time = None, accept = false, device = "auto", progress = None, **settings
))]
pub(crate) fn sequence(
    rig: &Bound<'_, Rig>,
    name: &str,
    field: Option<&Bound<'_, PyAny>>,
    set: Option<&str>,
    keyframe: usize,
    motion: &str,
    pattern_time: Option<f32>,
    accept: bool,
    device: &str,
    progress: Option<Bound<'_, PyAny>>,
    settings: Option<&Bound<'_, PyDict>>,
) -> PyResult<Sequence> {
    let py = rig.py();
    if keyframe == 0 {
        return Err(Error::new_err(
            "keyframe: is 0; give the number of frames from one keyframe to the next, at least 1",
        ));
    }
    let (rig, set) = (rig.get(), rig.get().set(set)?);
    let frames = rig.rig.sequence(name).map_err(exception)?;
    let mut options: ReconstructionOptions = json::settings(&ReconstructionOptions::default(), settings)?;
    options.device = work::device(device)?;
    let given = PyDict::new(py);
    given.set_item("motion", motion)?;
    given.set_item("pattern_time", pattern_time)?;
    let motion = json::settings(&MotionOptions::default(), Some(&given))?;
    let (field, _) = field_of(rig, &set.name, field)?;
    check_field(&rig.rig, &set, &field).map_err(exception)?;
    Ok(Sequence {
        plan: Plan { frames: frames.len(), keyframe },
        rig: rig.rig.clone(),
        set,
        frames,
        field,
        options,
        motion,
        accept,
        progress: progress.map(Bound::unbind),
        at: Mutex::default(),
    })
}
