//! Triangle meshes and point clouds, and their files.

/// A triangle mesh in the camera's frame, mm.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Vertex positions, mm.
    pub vertices: Vec<[f32; 3]>,
    /// Unit vertex normals; empty or one per vertex.
    pub normals: Vec<[f32; 3]>,
    /// Vertex colors; empty or one per vertex.
    pub colors: Vec<[u8; 3]>,
    /// Triangles, counter-clockwise seen from outside (from the camera's side).
    pub faces: Vec<[u32; 3]>,
}
