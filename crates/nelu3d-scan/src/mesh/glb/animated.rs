//! A sequence of meshes as one animated file: every frame is a node whose scale is 1 during its own frame and 0
//! otherwise.
//!
//! glTF has no visibility that could be animated; a scale of 0 is what its specification recommends for hiding (2.0,
//! §5.25: with all of it zero, renderers may skip the node). Steps, not blends: in any viewer that plays animations
//! exactly one frame is to be seen. One that does not shows the first.

use std::io;
use std::path::Path;

use serde_json::{Value, json};

use super::{Buffers, FLOAT, push_mesh, write_file};
use crate::mesh::model::Mesh;
use crate::output::write_atomic;

/// An animated `.glb` file in the making: one mesh after the other is pushed, then the file is written. What is kept of
/// a mesh are its bytes in the file: 12 a vertex, 12 more for normals, 8 for colors, and 6 or 12 a triangle.
#[derive(Debug)]
pub struct AnimatedGlb {
    fps: f64,
    buffers: Buffers,
    meshes: Vec<Value>,
    /// The mesh of each frame, if it has one.
    frames: Vec<Option<usize>>,
}

impl AnimatedGlb {
    /// Starts a sequence that is shown at this many frames a second.
    ///
    /// # Panics
    ///
    /// If `fps` is not a number above 0.
    pub fn new(fps: f64) -> Self {
        assert!(fps > 0.0 && fps.is_finite(), "frames a second above 0");
        Self { fps, buffers: Buffers::default(), meshes: Vec::new(), frames: Vec::new() }
    }

    /// Appends a frame, with normals and colors as [`write`](crate::mesh::write()) has them. An empty mesh shows
    /// nothing.
    ///
    /// # Errors
    ///
    /// The file would be larger than the format allows.
    ///
    /// # Panics
    ///
    /// As [`write`](crate::mesh::write()).
    pub fn push(&mut self, mesh: &Mesh) -> io::Result<&mut Self> {
        mesh.assert_whole();
        if mesh.vertices.is_empty() {
            self.frames.push(None);
            return Ok(self);
        }
        let primitive = push_mesh(mesh, &mut self.buffers);
        self.frames.push(Some(self.meshes.len()));
        self.meshes.push(json!({"primitives": [primitive]}));
        if self.buffers.bytes.len() > u32::MAX as usize {
            let problem = format!("{} frames are too large for one .glb (4 GiB)", self.frames.len());
            return Err(io::Error::other(format!("{problem}; use fewer frames, or write one file each")));
        }
        Ok(self)
    }

    /// Writes the file, which is whole or absent.
    ///
    /// # Errors
    ///
    /// There is no frame, or the file cannot be written; the message names it.
    pub fn write(mut self, path: &Path) -> io::Result<()> {
        if self.frames.is_empty() {
            let problem = format!("{}: a sequence without frames cannot be shown; push one first", path.display());
            return Err(io::Error::new(io::ErrorKind::InvalidInput, problem));
        }
        let animation = self.animation();
        let node = |(i, mesh): (usize, &Option<usize>)| {
            let mut node = json!({"name": format!("frame {i:04}")});
            if let Some(mesh) = mesh {
                node["mesh"] = json!(mesh);
            }
            if i > 0 {
                node["scale"] = json!([0.0, 0.0, 0.0]);
            }
            node
        };
        let mut scene = json!({
            "asset": {"version": "2.0", "generator": "nelu3d"},
            "scene": 0,
            "scenes": [{"nodes": (0..self.frames.len()).collect::<Vec<_>>()}],
            "nodes": self.frames.iter().enumerate().map(node).collect::<Vec<_>>(),
            "animations": [animation],
        });
        if !self.meshes.is_empty() {
            scene["meshes"] = Value::Array(self.meshes);
        }
        write_atomic(path, |w| write_file(scene, self.buffers, w))
    }

    /// Makes the animation, whose arrays are appended to the buffer. Frame i is shown from i / fps to (i + 1) / fps;
    /// the last one also at the very end, for the moment before the viewer begins again.
    fn animation(&mut self) -> Value {
        let n = self.frames.len();
        let time = |i: usize| (i as f64 / self.fps) as f32;
        let scale = |shown: bool| [f32::from(u8::from(shown)); 3];
        // Few different courses: frames in the middle share theirs.
        let courses: [&[bool]; 4] = [&[true, true], &[true, false], &[false, true, false], &[false, true, true]];
        let mut outputs = [None; 4];
        let (mut samplers, mut channels) = (Vec::new(), Vec::new());
        for i in 0..n {
            let (course, times) = match i {
                0 if n == 1 => (0, vec![time(0), time(1)]),
                0 => (1, vec![time(0), time(1)]),
                i if i + 1 < n => (2, vec![time(0), time(i), time(i + 1)]),
                i => (3, vec![time(0), time(i), time(i + 1)]),
            };
            let buffers = &mut self.buffers;
            let output = *outputs[course].get_or_insert_with(|| {
                let values = courses[course];
                let bytes = values.iter().flat_map(|&v| scale(v)).flat_map(f32::to_le_bytes).collect();
                buffers.push(bytes, values.len(), FLOAT, "VEC3", Value::Null)
            });
            let bounds = json!({"min": [times[0]], "max": [times[times.len() - 1]]});
            let bytes = times.iter().flat_map(|t| t.to_le_bytes()).collect();
            let input = buffers.push(bytes, times.len(), FLOAT, "SCALAR", bounds);
            samplers.push(json!({"input": input, "output": output, "interpolation": "STEP"}));
            channels.push(json!({"sampler": i, "target": {"node": i, "path": "scale"}}));
        }
        json!({"name": "sequence", "samplers": samplers, "channels": channels})
    }
}
