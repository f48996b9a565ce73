//! Closest points and signed distances on a triangle mesh.

use std::collections::HashMap;

use nalgebra::{Point3, Vector3};
use nelu3d_scan::Mesh;
use parry3d_f64::math::Vector;
use parry3d_f64::query::PointQueryWithLocation;
use parry3d_f64::shape::{TriMesh, TriMeshFlags, TrianglePointLocation};

/// A mesh that can be asked for closest points, in its own frame, mm.
pub struct CadSurface {
    mesh: TriMesh,
    /// Outward when closed.
    normals: Vec<Vector3<f64>>,
    areas: Vec<f64>,
    /// Whether every edge joins exactly two triangles that are oriented alike.
    closed: bool,
    /// Edges of one triangle only, and their vertices: where an open mesh ends.
    border: Border,
    low: Point3<f64>,
    high: Point3<f64>,
}

#[derive(Default)]
struct Border {
    edges: std::collections::HashSet<(u32, u32)>,
    vertices: std::collections::HashSet<u32>,
}

/// The closest point of a [`CadSurface`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Closest {
    /// Where.
    pub point: Point3<f64>,
    /// Unit normal of its triangle; outward when the mesh is closed.
    pub normal: Vector3<f64>,
    /// Distance, mm; negative inside of a closed mesh, never negative on an open one.
    pub distance: f64,
    /// Whether it lies on the border of an open mesh: the surface ends there, so that this says nothing about its error.
    pub on_border: bool,
}

impl CadSurface {
    /// Builds the surface. Vertices at equal places are merged, triangles without area left out, and a closed mesh that is
    /// inside out is turned. `None` when no triangle is left.
    pub fn new(mesh: &Mesh, scale: f64) -> Option<Self> {
        let mut number: HashMap<[u32; 3], u32> = HashMap::with_capacity(mesh.vertices.len());
        let mut vertices: Vec<Vector> = Vec::new();
        let merged: Vec<u32> = mesh
            .vertices
            .iter()
            .map(|v| {
                // −0 and 0 are one place.
                *number.entry(v.map(|c| (c + 0.0).to_bits())).or_insert_with(|| {
                    let [x, y, z] = v.map(|c| scale * f64::from(c));
                    vertices.push(Vector::new(x, y, z));
                    vertices.len() as u32 - 1
                })
            })
            .collect();
        let cross = |[a, b, c]: [u32; 3]| {
            let [a, b, c] = [a, b, c].map(|i| vertices[i as usize]);
            (b - a).cross(c - a)
        };
        let mut faces: Vec<[u32; 3]> = mesh.faces.iter().map(|f| f.map(|i| merged[i as usize])).collect();
        faces.retain(|&f| f[0] != f[1] && f[1] != f[2] && f[2] != f[0] && cross(f).length() > 0.0);
        if faces.is_empty() {
            return None;
        }
        let (closed, border) = topology(&faces);
        // The divergence theorem: six times the volume.
        let volume = |f: &[u32; 3]| {
            let [a, b, c] = f.map(|i| vertices[i as usize] - vertices[faces[0][0] as usize]);
            a.dot(b.cross(c))
        };
        if closed && faces.iter().map(volume).sum::<f64>() < 0.0 {
            faces.iter_mut().for_each(|f| f.swap(1, 2));
        }
        let crosses: Vec<Vector> = faces.iter().map(|&f| cross(f)).collect();
        let mut low = Point3::from([f64::INFINITY; 3]);
        let mut high = Point3::from([f64::NEG_INFINITY; 3]);
        for &i in faces.iter().flatten() {
            let v = point(vertices[i as usize]);
            (low, high) = (low.inf(&v), high.sup(&v));
        }
        // Signs by pseudo-normals (Bærentzen and Aanæs 2005), which a mesh has only if it bounds something.
        let flags = if closed { TriMeshFlags::ORIENTED } else { TriMeshFlags::empty() };
        Some(Self {
            normals: crosses.iter().map(|&c| vector(c).normalize()).collect(),
            areas: crosses.iter().map(|c| 0.5 * c.length()).collect(),
            mesh: TriMesh::with_flags(vertices, faces, flags).ok()?,
            closed,
            border,
            low,
            high,
        })
    }

    /// Whether the mesh bounds a volume.
    pub fn closed(&self) -> bool {
        self.closed
    }

    /// Length of the diagonal of the bounding box, mm.
    pub fn diagonal(&self) -> f64 {
        (self.high - self.low).norm()
    }

    /// Number of triangles.
    pub fn n_faces(&self) -> usize {
        self.areas.len()
    }

    /// The corners and normal of a triangle.
    pub(super) fn triangle(&self, face: usize) -> ([Point3<f64>; 3], Vector3<f64>) {
        let corners = self.mesh.indices()[face].map(|i| point(self.mesh.vertices()[i as usize]));
        (corners, self.normals[face])
    }

    /// Areas of the triangles, mm².
    pub(super) fn areas(&self) -> &[f64] {
        &self.areas
    }

    /// The closest point, if there is one within `reach` mm.
    pub fn closest(&self, p: &Point3<f64>, reach: f64) -> Option<Closest> {
        let at = Vector::new(p.x, p.y, p.z);
        let (found, (face, location)) =
            self.mesh.project_local_point_and_get_location_with_max_dist(at, false, reach)?;
        let distance = (at - found.point).length();
        let corners = self.mesh.indices()[face as usize];
        let on_border = match location {
            // Edge i joins corners i and i + 1.
            TrianglePointLocation::OnEdge(i, _) => {
                let [a, b] = [corners[i as usize], corners[(i as usize + 1) % 3]];
                self.border.edges.contains(&(a.min(b), a.max(b)))
            }
            TrianglePointLocation::OnVertex(i) => self.border.vertices.contains(&corners[i as usize]),
            TrianglePointLocation::OnFace(..) | TrianglePointLocation::OnSolid => false,
        };
        Some(Closest {
            point: point(found.point),
            normal: self.normals[face as usize],
            distance: if self.closed && found.is_inside { -distance } else { distance },
            on_border,
        })
    }
}

fn point(v: Vector) -> Point3<f64> {
    Point3::new(v.x, v.y, v.z)
}

fn vector(v: Vector) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}

/// Whether every edge is passed once in each direction, and the edges that are passed but once.
fn topology(faces: &[[u32; 3]]) -> (bool, Border) {
    // Passes in the direction of growing numbers, and against it.
    let mut passes: HashMap<(u32, u32), [u32; 2]> = HashMap::with_capacity(3 * faces.len() / 2);
    for f in faces {
        for i in 0..3 {
            let (a, b) = (f[i], f[(i + 1) % 3]);
            passes.entry((a.min(b), a.max(b))).or_default()[usize::from(a > b)] += 1;
        }
    }
    let mut border = Border::default();
    for (&edge, passes) in &passes {
        if passes[0] + passes[1] == 1 {
            border.edges.insert(edge);
            border.vertices.extend([edge.0, edge.1]);
        }
    }
    (passes.values().all(|&p| p == [1, 1]), border)
}
