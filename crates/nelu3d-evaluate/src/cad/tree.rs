//! Closest points on many triangles: a tree of boxes, and the closest point of one triangle.

use nalgebra::{Point3, Vector3};

/// Maximum number of triangles in a leaf.
const MAX_LEAF: usize = 4;

/// The part of a triangle that a point lies on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Feature {
    /// The inside of the triangle.
    Face,
    /// The edge from corner i to corner i + 1.
    Edge(usize),
    /// Corner i.
    Vertex(usize),
}

/// The closest point of a [`TriangleTree`].
#[derive(Clone, Copy, Debug)]
pub struct TreeHit {
    /// The point itself.
    pub point: Point3<f64>,
    /// Index of the closest triangle; of several equally close ones any, but always the same.
    pub face: usize,
    /// The part of the triangle that it lies on.
    pub feature: Feature,
}

/// Triangles that can be asked for closest points.
#[derive(Clone, Debug)]
pub struct TriangleTree {
    vertices: Vec<Point3<f64>>,
    faces: Vec<[u32; 3]>,
    /// The first is the root; both children of a node stand side by side after it.
    nodes: Vec<Node>,
    /// Triangles in the order of the leaves.
    order: Vec<u32>,
}

/// A box around some triangles.
#[derive(Clone, Copy, Debug)]
struct Node {
    low: Point3<f64>,
    high: Point3<f64>,
    /// The first triangle of a leaf in `order`, or the first child.
    first: u32,
    /// Triangles of a leaf; 0 for a node with children.
    count: u32,
}

impl Node {
    /// Returns the squared distance from a point to the box; 0 inside.
    fn distance_squared(&self, p: &Point3<f64>) -> f64 {
        let gap = (self.low - p).sup(&(p - self.high)).sup(&Vector3::zeros());
        gap.norm_squared()
    }
}

impl TriangleTree {
    /// Builds the tree by halves along the longest side. There is at least one triangle, and all have their vertices.
    pub fn new(vertices: Vec<Point3<f64>>, faces: Vec<[u32; 3]>) -> Self {
        let corners = |face: u32| faces[face as usize].map(|i| vertices[i as usize]);
        let centers: Vec<Vector3<f64>> = (0..faces.len() as u32)
            .map(|face| corners(face).iter().fold(Vector3::zeros(), |sum, p| sum + p.coords) / 3.0)
            .collect();
        let mut order: Vec<u32> = (0..faces.len() as u32).collect();
        let bounds = |part: &[u32]| {
            let points = part.iter().flat_map(|&face| corners(face));
            let nowhere = [f64::INFINITY, f64::NEG_INFINITY].map(|v| Point3::from([v; 3]));
            points.fold(nowhere, |[low, high], p| [low.inf(&p), high.sup(&p)])
        };
        let [low, high] = bounds(&order);
        let mut nodes = vec![Node { low, high, first: 0, count: order.len() as u32 }];
        let mut open = vec![0];
        while let Some(i) = open.pop() {
            let Node { low, high, first, count } = nodes[i];
            if count as usize <= MAX_LEAF {
                continue;
            }
            let part = &mut order[first as usize..(first + count) as usize];
            let axis = (high - low).imax();
            let half = part.len() / 2;
            part.select_nth_unstable_by(half, |&a, &b| {
                centers[a as usize][axis].total_cmp(&centers[b as usize][axis]).then(a.cmp(&b))
            });
            let (left, right) = part.split_at(half);
            let child = |part: &[u32], first: u32| {
                let [low, high] = bounds(part);
                Node { low, high, first, count: part.len() as u32 }
            };
            let children = [child(left, first), child(right, first + half as u32)];
            nodes[i].first = nodes.len() as u32;
            nodes[i].count = 0;
            open.extend([nodes.len(), nodes.len() + 1]);
            nodes.extend(children);
        }
        Self { vertices, faces, nodes, order }
    }

    /// Returns the triangles as numbers of vertices.
    pub(super) fn faces(&self) -> &[[u32; 3]] {
        &self.faces
    }

    /// Returns the corners of a triangle.
    pub fn corners(&self, face: usize) -> [Point3<f64>; 3] {
        self.faces[face].map(|i| self.vertices[i as usize])
    }

    /// Returns the closest point, if there is one within `reach`.
    pub fn closest(&self, p: &Point3<f64>, reach: f64) -> Option<TreeHit> {
        let mut best = None;
        let mut best_squared = reach * reach;
        // A node and its distance; the nearer child on top.
        let mut open = Vec::with_capacity(64);
        open.push((0u32, self.nodes[0].distance_squared(p)));
        while let Some((i, distance)) = open.pop() {
            if distance > best_squared {
                continue;
            }
            let node = &self.nodes[i as usize];
            if node.count == 0 {
                let mut children =
                    [node.first, node.first + 1].map(|i| (i, self.nodes[i as usize].distance_squared(p)));
                if children[0].1 < children[1].1 {
                    children.swap(0, 1);
                }
                open.extend(children);
                continue;
            }
            for &face in &self.order[node.first as usize..(node.first + node.count) as usize] {
                let (point, feature) = closest_of_triangle(p, &self.corners(face as usize));
                let squared = (p - point).norm_squared();
                if squared < best_squared || (best.is_none() && squared <= best_squared) {
                    best_squared = squared;
                    best = Some(TreeHit { point, face: face as usize, feature });
                }
            }
        }
        best
    }
}

/// Returns the closest point of a triangle, by the Voronoi region of the part that it lies on (Ericson, Real-Time
/// Collision Detection, 2005, §5.1.5).
fn closest_of_triangle(p: &Point3<f64>, [a, b, c]: &[Point3<f64>; 3]) -> (Point3<f64>, Feature) {
    let (ab, ac) = (b - a, c - a);
    let from_a = p - a;
    let (d1, d2) = (ab.dot(&from_a), ac.dot(&from_a));
    if d1 <= 0.0 && d2 <= 0.0 {
        return (*a, Feature::Vertex(0));
    }
    let from_b = p - b;
    let (d3, d4) = (ab.dot(&from_b), ac.dot(&from_b));
    if d3 >= 0.0 && d4 <= d3 {
        return (*b, Feature::Vertex(1));
    }
    let weight_c = d1 * d4 - d3 * d2;
    if weight_c <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return (a + ab * (d1 / (d1 - d3)), Feature::Edge(0));
    }
    let from_c = p - c;
    let (d5, d6) = (ab.dot(&from_c), ac.dot(&from_c));
    if d6 >= 0.0 && d5 <= d6 {
        return (*c, Feature::Vertex(2));
    }
    let weight_b = d5 * d2 - d1 * d6;
    if weight_b <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return (a + ac * (d2 / (d2 - d6)), Feature::Edge(2));
    }
    let weight_a = d3 * d6 - d5 * d4;
    if weight_a <= 0.0 && d4 >= d3 && d5 >= d6 {
        return (b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6))), Feature::Edge(1));
    }
    let sum = weight_a + weight_b + weight_c;
    (a + ab * (weight_b / sum) + ac * (weight_c / sum), Feature::Face)
}
