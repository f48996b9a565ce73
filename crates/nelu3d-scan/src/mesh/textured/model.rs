//! A mesh with its picture.

use crate::mesh::model::Mesh;

/// A mesh and the picture that lies on it.
#[derive(Clone, Copy, Debug)]
pub struct TexturedMesh<'a> {
    /// The mesh; its vertices' own colors are not written.
    pub mesh: &'a Mesh,
    /// Where in the picture each vertex is: 0 to 1 from its left edge and from its upper edge.
    pub uv: &'a [[f32; 2]],
    /// The picture, a PNG file.
    pub png: &'a [u8],
}

impl TexturedMesh<'_> {
    /// Panics if there is not one place in the picture per vertex.
    pub(super) fn assert_whole(&self) {
        self.mesh.assert_whole();
        assert_eq!(self.uv.len(), self.mesh.vertices.len(), "one place in the picture per vertex");
    }
}
