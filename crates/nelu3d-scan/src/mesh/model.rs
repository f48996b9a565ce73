//! The mesh itself.

/// A triangle mesh in the camera's frame, mm. Without faces it is a point cloud.
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

impl Mesh {
    /// Sets the vertex normals: the mean of the adjacent triangles' normals, weighted by area. A vertex without a
    /// triangle gets (0, 0, 0).
    pub fn compute_normals(&mut self) {
        let mut sums = vec![[0.0f64; 3]; self.vertices.len()];
        for face in &self.faces {
            // The cross product's length is twice the triangle's area: the weight comes for free.
            let n = self.face_cross(*face);
            for &i in face {
                for (sum, c) in sums[i as usize].iter_mut().zip(n) {
                    *sum += c;
                }
            }
        }
        self.normals = sums.into_iter().map(normalized).collect();
    }

    /// Panics where [`write`](super::write()) says so.
    pub(super) fn assert_whole(&self) {
        let n = self.vertices.len();
        assert!(self.normals.is_empty() || self.normals.len() == n, "one normal per vertex");
        assert!(self.colors.is_empty() || self.colors.len() == n, "one color per vertex");
        assert!(self.faces.iter().flatten().all(|&i| (i as usize) < n), "a face of existing vertices");
    }

    /// Returns (b − a) × (c − a) of a triangle: its outward normal times twice its area, mm².
    pub(super) fn face_cross(&self, [a, b, c]: [u32; 3]) -> [f64; 3] {
        let [a, b, c] = [a, b, c].map(|i| self.vertices[i as usize].map(f64::from));
        let (u, v) = ([b[0] - a[0], b[1] - a[1], b[2] - a[2]], [c[0] - a[0], c[1] - a[1], c[2] - a[2]]);
        [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
    }
}

/// Returns a unit vector, or zero where there is no direction.
pub(super) fn normalized(v: [f64; 3]) -> [f32; 3] {
    let length = v.iter().map(|c| c * c).sum::<f64>().sqrt();
    if length > 0.0 && length.is_finite() { v.map(|c| (c / length) as f32) } else { [0.0; 3] }
}

/// Cuts a polygon into a fan of triangles.
pub(super) fn push_polygon(faces: &mut Vec<[u32; 3]>, corners: &[u32]) {
    for i in 2..corners.len() {
        faces.push([corners[0], corners[i - 1], corners[i]]);
    }
}
