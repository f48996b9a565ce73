//! Closest points and signed distances on a triangle mesh.

use std::collections::HashMap;

use nalgebra::{Isometry3, Point3, Vector3};
use nelu3d_scan::Mesh;

use super::tree::{Feature, TriangleTree};

/// A mesh that can be asked for closest points, in its own frame, mm.
pub struct CadSurface {
    tree: TriangleTree,
    /// Unit normals of the triangles, outward when the mesh is closed.
    normals: Vec<Vector3<f64>>,
    /// Directions outward at edges and vertices; empty when the mesh is open.
    pseudo_normals: PseudoNormals,
    areas: Vec<f64>,
    /// Whether every edge joins exactly two triangles that are oriented alike.
    closed: bool,
    /// Edges of one triangle only, and their vertices: where an open mesh ends.
    border: Border,
    low: Point3<f64>,
    high: Point3<f64>,
}

/// The border of an open mesh.
#[derive(Default)]
struct Border {
    edges: std::collections::HashSet<(u32, u32)>,
    vertices: std::collections::HashSet<u32>,
}

/// Directions outward at edges and vertices of a closed mesh, of any length: whether a point is inside is told by that
/// of the edge or vertex that is closest to it (Bærentzen and Aanæs, Signed distance computation using the angle
/// weighted pseudonormal, 2005).
#[derive(Default)]
struct PseudoNormals {
    edges: HashMap<(u32, u32), Vector3<f64>>,
    vertices: Vec<Vector3<f64>>,
}

/// The closest point of a [`CadSurface`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClosestPoint {
    /// The point itself.
    pub point: Point3<f64>,
    /// Unit normal of its triangle; outward when the mesh is closed.
    pub normal: Vector3<f64>,
    /// Distance, mm; negative inside of a closed mesh, never negative on an open one.
    pub distance: f64,
    /// Whether it lies on the border of an open mesh: the surface ends there, so that this says nothing about its
    /// error.
    pub on_border: bool,
}

impl CadSurface {
    /// Builds the surface. Vertices at equal places are merged, triangles without area dropped, and a closed mesh that
    /// is inside out is turned. `None` when no triangle is left.
    pub fn new(mesh: &Mesh, scale: f64) -> Option<Self> {
        let mut number: HashMap<[u32; 3], u32> = HashMap::with_capacity(mesh.vertices.len());
        let mut vertices: Vec<Point3<f64>> = Vec::new();
        let merged: Vec<u32> = mesh
            .vertices
            .iter()
            .map(|v| {
                // −0 and 0 are one place.
                *number.entry(v.map(|c| (c + 0.0).to_bits())).or_insert_with(|| {
                    vertices.push(Point3::from(v.map(|c| scale * f64::from(c))));
                    vertices.len() as u32 - 1
                })
            })
            .collect();
        let cross = |[a, b, c]: [u32; 3]| {
            let [a, b, c] = [a, b, c].map(|i| vertices[i as usize]);
            (b - a).cross(&(c - a))
        };
        let mut faces: Vec<[u32; 3]> = mesh.faces.iter().map(|f| f.map(|i| merged[i as usize])).collect();
        faces.retain(|&f| f[0] != f[1] && f[1] != f[2] && f[2] != f[0] && cross(f).norm() > 0.0);
        if faces.is_empty() {
            return None;
        }
        let (closed, border) = topology(&faces);
        // The divergence theorem: six times the volume.
        let volume = |f: &[u32; 3]| {
            let [a, b, c] = f.map(|i| vertices[i as usize] - vertices[faces[0][0] as usize]);
            a.dot(&b.cross(&c))
        };
        if closed && faces.iter().map(volume).sum::<f64>() < 0.0 {
            faces.iter_mut().for_each(|f| f.swap(1, 2));
        }
        let crosses: Vec<Vector3<f64>> = faces.iter().map(|&f| cross(f)).collect();
        let mut low = Point3::from([f64::INFINITY; 3]);
        let mut high = Point3::from([f64::NEG_INFINITY; 3]);
        for v in faces.iter().flatten().map(|&i| &vertices[i as usize]) {
            (low, high) = (low.inf(v), high.sup(v));
        }
        let normals: Vec<Vector3<f64>> = crosses.iter().map(Vector3::normalize).collect();
        let pseudo_normals =
            if closed { PseudoNormals::new(&vertices, &faces, &normals) } else { PseudoNormals::default() };
        Some(Self {
            areas: crosses.iter().map(|c| 0.5 * c.norm()).collect(),
            normals,
            pseudo_normals,
            tree: TriangleTree::new(vertices, faces),
            closed,
            border,
            low,
            high,
        })
    }

    /// Returns whether the mesh bounds a volume.
    pub fn closed(&self) -> bool {
        self.closed
    }

    /// Returns the length of the diagonal of the bounding box, mm.
    pub fn diagonal(&self) -> f64 {
        (self.high - self.low).norm()
    }

    /// Returns the number of triangles.
    pub fn n_faces(&self) -> usize {
        self.areas.len()
    }

    /// Returns the signed distance of a point of the camera's frame, mm, as in
    /// [`CadComparison::distances`](super::CadComparison::distances).
    pub fn signed_distance(&self, cam_from_cad: &Isometry3<f64>, p: &Point3<f64>) -> f64 {
        let q = cam_from_cad.inverse_transform_point(p);
        let Some(c) = self.closest(&q, f64::MAX) else { return f64::NAN };
        if self.closed() {
            return c.distance;
        }
        if c.on_border {
            return f64::NAN;
        }
        let eye = cam_from_cad.inverse_transform_point(&Point3::origin());
        let same_side = c.normal.dot(&(q - c.point)) * c.normal.dot(&(eye - c.point)) >= 0.0;
        if same_side { c.distance } else { -c.distance }
    }

    /// Returns the corners and the normal of a triangle.
    pub(super) fn triangle(&self, face: usize) -> ([Point3<f64>; 3], Vector3<f64>) {
        (self.tree.corners(face), self.normals[face])
    }

    /// Returns the areas of the triangles, mm².
    pub(super) fn areas(&self) -> &[f64] {
        &self.areas
    }

    /// Returns the closest point, if there is one within `reach` mm.
    pub fn closest(&self, p: &Point3<f64>, reach: f64) -> Option<ClosestPoint> {
        let found = self.tree.closest(p, reach)?;
        let corners = self.tree.faces()[found.face];
        let edge = |i: usize| key(corners[i], corners[(i + 1) % 3]);
        let on_border = match found.feature {
            Feature::Face => false,
            Feature::Edge(i) => self.border.edges.contains(&edge(i)),
            Feature::Vertex(i) => self.border.vertices.contains(&corners[i]),
        };
        let offset = p - found.point;
        let inside = self.closed
            && offset.dot(&match found.feature {
                Feature::Face => self.normals[found.face],
                Feature::Edge(i) => self.pseudo_normals.edges[&edge(i)],
                Feature::Vertex(i) => self.pseudo_normals.vertices[corners[i] as usize],
            }) < 0.0;
        Some(ClosestPoint {
            point: found.point,
            normal: self.normals[found.face],
            distance: if inside { -offset.norm() } else { offset.norm() },
            on_border,
        })
    }
}

impl PseudoNormals {
    fn new(vertices: &[Point3<f64>], faces: &[[u32; 3]], normals: &[Vector3<f64>]) -> Self {
        let mut all = Self { edges: HashMap::new(), vertices: vec![Vector3::zeros(); vertices.len()] };
        for (f, normal) in faces.iter().zip(normals) {
            for i in 0..3 {
                let [a, b, c] = [f[i], f[(i + 1) % 3], f[(i + 2) % 3]];
                *all.edges.entry(key(a, b)).or_default() += normal;
                let [a, b, c] = [a, b, c].map(|i| vertices[i as usize]);
                all.vertices[f[i] as usize] += normal * (b - a).angle(&(c - a));
            }
        }
        all
    }
}

/// Returns an edge as a key that does not depend on its direction.
fn key(a: u32, b: u32) -> (u32, u32) {
    (a.min(b), a.max(b))
}

/// Returns whether every edge is passed once in each direction, and the edges that are passed only once.
fn topology(faces: &[[u32; 3]]) -> (bool, Border) {
    // Passes in the direction of growing numbers, and against it.
    let mut passes: HashMap<(u32, u32), [u32; 2]> = HashMap::with_capacity(3 * faces.len() / 2);
    for f in faces {
        for i in 0..3 {
            let (a, b) = (f[i], f[(i + 1) % 3]);
            passes.entry(key(a, b)).or_default()[usize::from(a > b)] += 1;
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
